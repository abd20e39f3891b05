"""How far simulated motions are to be trusted: a second route, warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import atanh
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.friction import Coulomb, Law
from wormopt.model.model import Model
from wormopt.model.values import nominal_of, signal_values
from wormopt.progress import Report
from wormopt.result import NOT_RECHECKED, Check
from wormopt.simulation.event_free import ending
from wormopt.simulation.options import Recheck, Route, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import Values, simulate
from wormopt.simulation.trajectory import Trajectory

# Both routes shall agree at the end, and energies balance, to this or to so many tolerances, but
# at most to a hundredth.
_AGREED, _TOLERANCES, _LARGEST = 1e-7, 1e3, 1e-2
# What a second route has in common with the first.
_SHARED = {
    "cvodes": "the model",
    "python": "the model; the rules for steps, events and contact modes, though not their code",
    "radau": "the model; the rules for events and contact modes, though not their code",
    "steps without events": "the model",
}
# Implicit integrators take more steps than explicit ones of order 8.
_MORE_STEPS = 100
# A step in Python costs a thousand compiled ones: so many are spent on a check, and of more than so
# many a motion is stiff, or goes through so many events that a part of it has to do.
_SPENT_IN_PYTHON, _STIFF = 10_000, 10_000
# Implicit steps of order 5 are some forty times as many where a motion swings: of one that took
# more than so many, its first so many have to do.
_LONG = 30_000


@dataclass(frozen=True)
class CrossCheck:
    """What the second route found."""

    route: str  # by what it went; empty: there was none
    # largest at the end, relative to max(state, its nominal size); None: unknown
    error: float | None
    accepted: float  # largest error that is accepted
    shared: str = ""  # in common with the first route: errors there go unseen
    reason: str = ""  # why the error is not known
    until: float | None = None  # where it was given up and compared, before the end

    @property
    def fault(self) -> str:
        """What is wrong, in words; empty if nothing is."""
        if self.error is not None and not self.error <= self.accepted:
            return (
                f"the second route ({self.route}) ends elsewhere, by {self.error:.2g} of the "
                f"states' size where {self.accepted:.2g} is accepted"
            )
        if self.error is None and self.route:
            return (
                f"the second route ({self.route}) gave up: {self.reason}; "
                "tolerance.recheck = false takes the result without it"
            )
        return ""

    @property
    def check(self) -> Check:
        """The line of a trust report."""
        return Check("second route", self.error, self.accepted, self.fault, not self.fault)

    @property
    def facts(self) -> dict[str, Any]:
        """What a trust report says of it."""
        told = ("route", "error", "accepted", "shared", *(["until"] if self.until else []))
        return {name: getattr(self, name) for name in told}


def cross_check(
    model: Model,
    motion: Trajectory,
    tolerance: Tolerance,
    *,
    p: Values | None = None,
    schedules: Mapping[str, np.ndarray] | None = None,
    recheck: Recheck = True,
    report: Report,
) -> CrossCheck | None:
    """Simulate again by another route and compare the ends; the model's states come first.

    None if `recheck` is False. "independent": exact contact by steps without events. Else smooth
    systems go to CasADi's implicit integrators, exact contact and switches to the
    Python event loop; if that was the first route, again with a tenth of `tolerance`. What would
    take Python for ever is compared as far as it came, which is told.
    """
    if not recheck:
        return None
    start, treatment = float(motion.time[0]), motion.system.treatment
    route = _second_route(model, motion)
    accepted = accepted_error(tolerance)
    if recheck == "independent" and route != "cvodes":
        return _without_events(model, motion, accepted, report)
    label, shared = str(route), _SHARED[route]
    if route == motion.route or model.alg.numel():
        label = motion.route
        label += " with a tenth of the tolerance"
        shared = "all but the tolerance"
        relative = max(tolerance.relative / 10, 1e-14)
        tolerance = replace(tolerance, relative=relative, absolute=tolerance.absolute / 10)

    def again(by: Route, until: float, most: int) -> Trajectory:
        return simulate(
            model,
            (start, until),
            contact=treatment,
            p=p,
            schedules=schedules,
            times=[until],
            tolerance=replace(tolerance, max_steps=most),
            route=by,
            report=lambda _, fraction: report("rechecking", fraction),
        )

    until, first = None, motion.end
    try:
        if route == "cvodes" and motion.n_steps > _LONG:
            begun = _begun(again, motion)
            until, first = begun.end_time, begun.end
        second, through = _as_far_as_it_goes(again, route, motion, until, tolerance)
        if not through:  # what was kept of the first is as exact as its interpolation only
            until = second.end_time
            first = again("auto", until, motion.n_steps + motion.n_rejected + 1).end
    except SolveError as error:
        return CrossCheck(label, None, accepted, shared, error.reason)
    if route == "cvodes" and second.route == "python":
        label, shared = "python", _SHARED["python"]
    sizes = nominal_of(model.x)
    size = np.maximum(sizes, np.abs(second.end))
    error = np.max(np.abs(first[: model.n_x] - second.end) / size)
    return CrossCheck(label, float(error), accepted, shared, until=until)


def _begun(again: Callable[[Route, float, int], Trajectory], motion: Trajectory) -> Trajectory:
    """The first `_LONG` steps of a motion."""
    try:
        return again("auto", motion.end_time, _LONG)
    except SolveError as error:
        if error.code != "too_many_steps" or error.partial is None:
            raise
        return error.partial


def _without_events(
    model: Model, motion: Trajectory, accepted: float, report: Report
) -> CrossCheck:
    """Compare with steps that know no events, as well as these are known themselves."""
    label = "steps without events"
    x0 = signal_values(motion.system.model.x, None, "state", fill=0.0)
    x0[: model.n_x] = signal_values(model.x, None, "state", fill=0.0)
    try:
        found = ending(motion, x0, accepted, report=report)
    except ArgumentError as error:
        return CrossCheck(label, None, accepted, _SHARED[label], str(error))
    if not found.doubt <= _LARGEST:
        reason = f"after {found.n_steps} steps their end is known to {found.doubt:.2g} only"
        return CrossCheck(label, None, accepted, _SHARED[label], reason)
    end = found.end[: model.n_x]
    size = np.maximum(nominal_of(model.x), np.abs(end))
    error = np.max(np.abs(motion.end[: model.n_x] - end) / size)
    return CrossCheck(label, float(error), max(accepted, found.doubt), _SHARED[label])


def _as_far_as_it_goes(
    again: Callable[[Route, float, int], Trajectory],
    route: Route,
    motion: Trajectory,
    until: float | None,
    tolerance: Tolerance,
) -> tuple[Trajectory, bool]:
    """The motion by a second route until some time, its end if None, and whether it came so far.

    Raises SolveError.
    """
    most = _MORE_STEPS * tolerance.max_steps
    if route in ("python", "radau"):
        most = max(_SPENT_IN_PYTHON, 2 * motion.n_steps if route == "python" else 0)
    try:
        return again(route, motion.end_time if until is None else until, most), True
    except SolveError as error:
        if error.code == "too_many_steps" and route in ("python", "radau"):
            if error.partial and error.partial.end_time > motion.time[0]:
                return error.partial, False
        # Newton steps may fail where explicit ones go on, and implicit ones pass a layer unseen
        elif route == "radau" or error.code == "layer_not_resolved":
            short = replace(motion, n_steps=0)
            return _as_far_as_it_goes(again, "python", short, until, tolerance)
        raise


def accepted_error(tolerance: Tolerance) -> float:
    """Largest relative error by which ends and energies may disagree."""
    several = _TOLERANCES * max(tolerance.relative, tolerance.absolute)
    return min(max(_AGREED, several), _LARGEST)


def _second_route(model: Model, motion: Trajectory) -> Route:
    by_events = motion.system.exact or model.switches or model.delays
    if not by_events and motion.route != "cvodes":
        return "cvodes"
    return "radau" if motion.n_steps > _STIFF else "python"


def warnings_of_contact(treatment: Treatment, laws: Sequence[Law]) -> Iterator[str]:
    """Warn where the smooth law does what no ground does; `laws` hold numbers."""
    if not isinstance(treatment, Smooth):
        return
    for law in laws:
        if any(isinstance(number, ca.SX) for number in vars(law).values()):
            continue  # a user's law of symbols: what it does shows only in the motion
        at_rest = float(law.smooth(0.0, treatment.v_reg))
        if at_rest != 0:
            yield _push(law, at_rest, treatment.v_reg)
        low, high = law.stick_interval
        slips = [float(law.slip_force(0.0, d)) for d in law.directions]
        if isinstance(law, Coulomb) and (low < min(slips) or high > max(slips)):
            yield "the smooth law knows no stiction; treat contact as exact to have it"


def _push(law: Law, force: float, v_reg: float) -> str:
    text = f"the smooth law pushes a mass at rest with {force:+.6g}: it feeds energy in"
    if isinstance(law, Coulomb):
        both = float(law.forward) + float(law.backward)
        ratio = (float(law.backward) - float(law.forward)) / both
        if abs(ratio) < 1:
            text += f", and a worm that does nothing drifts at {v_reg * atanh(ratio):+.6g}"
    return text


def count_events(motion: Trajectory) -> dict[str, int]:
    """Count events by their kind; switches by their name."""
    names = (e.name if e.kind == "switch" else e.kind for e in motion.events)
    return dict(sorted(Counter(names).items()))


def one_or_all(values: Sequence[Any]) -> Any:
    """The only value by itself, several (one per tracker) as a list."""
    return values[0] if len(values) == 1 else list(values)


def warnings_of_motion(motion: Trajectory, second: CrossCheck | None) -> Iterator[str]:
    """Warn where a motion was not integrated the usual way."""
    from wormopt.simulation.native.build import compiler

    if second is None:
        yield NOT_RECHECKED
    elif second.until is not None:
        yield (
            f"the second route ({second.route}) was compared at t = {second.until:.6g}, not at the "
            f"end: it takes too long, as the first took {motion.n_steps} steps"
        )
    if motion.route != "native" and compiler() is None:
        yield "there is no C compiler: simulated without one, which is slower but as exact"
    if motion.dense is None and any(s.name == "input_work" for s in motion.system.model.x):
        yield "not kept whole: input_peak is the largest of the samples"


def motion_facts(
    motions: Sequence[Trajectory], rechecks: Sequence[CrossCheck | None], tolerance: Tolerance
) -> dict[str, Any]:
    """What the trust reports of all simulations say; sequences have one entry per tracker.

    `rechecks` hold None where none was wanted.
    """
    treatment = motions[0].system.treatment
    smooth = isinstance(treatment, Smooth)
    return {
        "treatment": f"smooth, v_reg = {treatment.v_reg:.6g}" if smooth else "exact",
        "route": one_or_all([motion.route for motion in motions]),
        "tolerance": {"relative": tolerance.relative, "absolute": tolerance.absolute},
        "recheck": one_or_all([second and second.facts for second in rechecks]),
        "events": one_or_all([count_events(motion) for motion in motions]),
    }
