"""Trust in simulated motions: second routes and warnings."""

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
from wormopt.simulation.options import Recheck, Route, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import Values, simulate
from wormopt.simulation.trajectory import Trajectory

# Ends of both routes and energy balances must agree to the largest of an absolute error and
# a multiple of the tolerance, but at most to a hundredth.
_AGREED, _TOLERANCES, _LARGEST = 1e-7, 1e3, 1e-2
# What the second route has in common with the first.
_SHARED = {
    "cvodes": "the model",
    "python": "the model; the coefficients of the steps; the rules for steps, events and contact "
    "modes",
    "radau": "the model; the rules for events and contact modes",
    "steps without events": "the model",
}
# Implicit integrators take more steps than explicit ones of order 8.
_MORE_STEPS = 100
# A Python step costs as much as a thousand compiled ones. A check spends at most this many; a
# motion of more steps is stiff or has many events, and only a part of it is checked.
_SPENT_IN_PYTHON, _STIFF = 10_000, 10_000
# Implicit steps of order 5 are about forty times as many in an oscillating motion. Of a motion
# with more steps than this, only the first ones are checked.
_LONG = 30_000
# Most implicit steps of a check in Python, which cost twice an explicit one, and their tolerance
# as a share of the accepted error. If the routes disagree, the check is repeated with the tolerance
# of the first route.
_IMPLICIT, _ROUGH = 4_000, 1e-2

# A last event nearer to the end than this share of the time may happen in one route only.
_LATE = 1e-6
_AT_THE_END = "rounding decides whether the event there still happens"


@dataclass(frozen=True)
class CrossCheck:
    """Result of the second route."""

    route: str  # how it was computed; empty without a second route
    # largest error at the end, relative to max(state, its nominal size); None: unknown
    error: float | None
    accepted: float  # largest error that is accepted
    shared: str = ""  # in common with the first route: errors there go undetected
    reason: str = ""  # why the error is unknown, or known at an earlier time only
    until: float | None = None  # time of the comparison, if before the end

    @property
    def fault(self) -> str:
        """Description of a disagreement; empty if there is none."""
        if self.error is not None and not self.error <= self.accepted:
            return (
                f"the second route ({self.route}) ends in other states, by {self.error:.2g} "
                f"of the states' size, where {self.accepted:.2g} is accepted"
            )
        if self.error is None and self.route:
            return (
                f"the second route ({self.route}) failed: {self.reason}; set "
                "tolerance.recheck = false to run without it"
            )
        return ""

    @property
    def reach(self) -> float:
        """Time up to which the routes are compared; infinite: to the end."""
        return np.inf if self.until is None else self.until

    @property
    def check(self) -> Check:
        """Check of a trust report."""
        return Check("second route", self.error, self.accepted, self.fault, not self.fault)

    @property
    def facts(self) -> dict[str, Any]:
        """Facts of a trust report."""
        names = ("route", "error", "accepted", "shared", *(["until"] if self.until else []))
        return {name: getattr(self, name) for name in names}


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
    """Simulate again by another method and compare the ends; the model's states come first.

    None if `recheck` is False. With "independent", exact contact is simulated by steps without
    events. Otherwise smooth systems are simulated by CasADi's implicit integrators, exact contact
    and switches by the Python event loop. If that was already the first method, it runs again
    with a tenth of `tolerance`. Implicit steps in Python are as accurate as the comparison needs. A
    comparison that would take Python too long ends early, at the reported time `until`, and so does
    one in which rounding decides whether an event at the end still happens.
    """
    if not recheck:
        return None
    start, treatment = float(motion.time[0]), motion.system.treatment
    route = _second_route(model, motion)
    accepted = accepted_error(tolerance)
    if recheck == "independent" and route != "cvodes":
        return _without_events(model, motion, accepted, report)
    label, shared, given = str(route), _shared(route, motion), tolerance
    if route == motion.route or model.alg.numel():
        label = motion.route
        label += " with a tenth of the tolerance"
        shared = "everything except the tolerance"
        relative = max(tolerance.relative / 10, 1e-14)
        tolerance = replace(tolerance, relative=relative, absolute=tolerance.absolute / 10)

    def compared(implicit: Tolerance, most: int, before: float | None = None) -> CrossCheck:
        def again(by: Route, until: float, most: int) -> Trajectory:
            return simulated(by, until, most, implicit if by == "radau" else tolerance)

        def simulated(by: Any, until: float, most: int, within: Tolerance) -> Trajectory:
            return simulate(
                model,
                (start, until),
                contact=treatment,
                p=p,
                schedules=schedules,
                times=[until],
                tolerance=replace(within, max_steps=most),
                route=by,
                report=lambda _, fraction: report("rechecking", fraction),
            )

        until, first = before, motion.end
        try:
            if route == "cvodes" and motion.n_steps > _LONG:
                begun = _begun(again, motion)
                until, first = begun.end_time, begun.end
            second, through = _as_far_as_it_goes(again, route, motion, until, tolerance, most)
            if before is not None or not through:  # a stored motion is only interpolated there
                until = second.end_time
                steps = motion.n_steps + motion.n_rejected + 1
                first = simulated(motion.route, until, steps, given).end
        except SolveError as error:
            return CrossCheck(label, None, accepted, shared, error.reason)
        by, own = label, shared
        if second.route != route and second.route in _SHARED:  # the second one failed
            by, own = second.route, _shared(second.route, motion)
        sizes = nominal_of(model.x)
        size = np.maximum(sizes, np.abs(second.end))
        error = float(np.max(np.abs(first[: model.n_x] - second.end) / size))
        if before is not None:
            return CrossCheck(by, error, accepted, own, _AT_THE_END, until)
        late = min(accepted, _LATE) * (motion.end_time - start)
        counts = [len(each.events) for each in (motion, second)]
        times = [e.time for e in (*motion.events, *second.events)]
        one_more = counts[0] != counts[1] and max(times) > motion.end_time - late
        if until is None and one_more and not error <= accepted:
            return compared(implicit, most, motion.end_time - 2 * late)
        return CrossCheck(by, error, accepted, own, until=until)

    if label != "radau":
        return compared(tolerance, _IMPLICIT)
    enough = _ROUGH * accepted
    relative, absolute = max(tolerance.relative, enough), max(tolerance.absolute, enough)
    found = compared(replace(tolerance, relative=relative, absolute=absolute), _IMPLICIT)
    if not found.fault:
        return found
    exact = compared(tolerance, _SPENT_IN_PYTHON)
    # agreement up to an earlier time does not excuse a later disagreement
    return found if found.error is not None and exact.reach < found.reach else exact


def _shared(second: str, first: Trajectory) -> str:
    """What a second route has in common with the first."""
    in_python = {"python", "radau"}
    if {second, first.route} == in_python:
        return _SHARED["radau"] + ", and their code"
    return _SHARED[second] + (", though not their code" if second in in_python else "")


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
    """Compare with a method without events, to the accuracy of that method."""
    from wormopt.simulation.event_free import ending  # most motions need none

    label = "steps without events"
    x0 = signal_values(motion.system.model.x, None, "state", fill=0.0)
    x0[: model.n_x] = signal_values(model.x, None, "state", fill=0.0)
    try:
        found = ending(motion, x0, accepted, report=report)
    except ArgumentError as error:
        return CrossCheck(label, None, accepted, _SHARED[label], str(error))
    if not found.doubt <= _LARGEST:
        reason = f"after {found.n_steps} steps their end is known only to {found.doubt:.2g}"
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
    implicit: int,
) -> tuple[Trajectory, bool]:
    """Simulate by a second method until some time, the end if None; also whether it got there.

    `implicit`: most implicit steps in Python.
    """
    most = _MORE_STEPS * tolerance.max_steps
    if route == "radau":
        most = implicit
    elif route == "python":
        most = max(_SPENT_IN_PYTHON, 2 * motion.n_steps if motion.n_steps <= _STIFF else 0)
    try:
        return again(route, motion.end_time if until is None else until, most), True
    except SolveError as error:
        if error.code == "too_many_steps" and route in ("python", "radau"):
            if error.partial and error.partial.end_time > motion.time[0]:
                return error.partial, False
        # Newton steps may fail where explicit steps work, and implicit ones may miss a layer
        elif route == "radau" or error.code in ("layer_not_resolved", "solver_failed"):
            other: Route = "radau" if motion.route == "python" else "python"
            # neither the first route again, nor equations that the event loop does not solve
            if other != route and motion.route != "idas":
                short = replace(motion, n_steps=0)
                return _as_far_as_it_goes(again, other, short, until, tolerance, implicit)
        raise


def accepted_error(tolerance: Tolerance) -> float:
    """Largest relative error by which ends and energies may differ."""
    several = _TOLERANCES * max(tolerance.relative, tolerance.absolute)
    return min(max(_AGREED, several), _LARGEST)


def _second_route(model: Model, motion: Trajectory) -> Route:
    by_events = motion.system.exact or model.switches or model.delays
    if not by_events and motion.route != "cvodes":
        return "cvodes"
    # a delay equation takes more implicit steps, and explicit ones check at least a third of it
    return "radau" if motion.n_steps > (_LONG if model.delays else _STIFF) else "python"


def warnings_of_contact(treatment: Treatment, laws: Sequence[Law]) -> Iterator[str]:
    """Warn where the smooth law behaves unlike any ground; `laws` contain numbers."""
    if not isinstance(treatment, Smooth):
        return
    for law in laws:
        if any(isinstance(number, ca.SX) for number in vars(law).values()):
            continue  # a user's symbolic law: its effect shows only in the motion
        at_rest = float(law.smooth(0.0, treatment.v_reg))
        if at_rest != 0:
            yield _push(law, at_rest, treatment.v_reg)
        low, high = law.stick_interval
        slips = [float(law.slip_force(0.0, d)) for d in law.directions]
        if isinstance(law, Coulomb) and (low < min(slips) or high > max(slips)):
            yield "the smooth law has no stiction; use exact contact to include it"


def _push(law: Law, force: float, v_reg: float) -> str:
    text = f"the smooth law pushes a mass at rest with {force:+.6g}: it adds energy"
    if isinstance(law, Coulomb):
        both = float(law.forward) + float(law.backward)
        ratio = (float(law.backward) - float(law.forward)) / both
        if abs(ratio) < 1:
            text += f", and a worm without input drifts at {v_reg * atanh(ratio):+.6g}"
    return text


def count_events(motion: Trajectory) -> dict[str, int]:
    """Count events by their kind; switches by their name."""
    names = (e.name if e.kind == "switch" else e.kind for e in motion.events)
    return dict(sorted(Counter(names).items()))


def one_or_all(values: Sequence[Any]) -> Any:
    """Return a single value itself, and several (one per tracker) as a list."""
    return values[0] if len(values) == 1 else list(values)


def warnings_of_motion(motion: Trajectory, second: CrossCheck | None) -> Iterator[str]:
    """Warn if a motion was not integrated or rechecked in the usual manner."""
    from wormopt.simulation.native.build import compiler

    if second is None:
        yield NOT_RECHECKED
    elif second.until is not None:
        slow = f"it takes too long, because the first took {motion.n_steps} steps"
        yield (
            f"the second route ({second.route}) was compared at t = {second.until:.6g}, not "
            f"at the end: {second.reason or slow}"
        )
    if motion.route != "native" and compiler() is None:
        yield "no C compiler was found: the simulation is slower, but equally exact"
    if motion.dense is None and any(s.name == "input_work" for s in motion.system.model.x):
        yield "the motion was too long to keep: input_peak is the largest of the samples"


def motion_facts(
    motions: Sequence[Trajectory], rechecks: Sequence[CrossCheck | None], tolerance: Tolerance
) -> dict[str, Any]:
    """Facts of the trust reports of all simulations; sequences have one entry per tracker.

    `rechecks` contain None where no recheck was wanted.
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
