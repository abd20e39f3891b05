"""Chains that follow a reference by a tracker: their motions, numbers, signals and checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check
from wormopt.simulation.ensemble import Ensemble, Scenario, simulate_ensemble
from wormopt.simulation.options import Recheck, Tolerance, Treatment
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.loops import Links, tube_radius
from wormopt.systems.chain.measured import (
    ENTERS,
    Balance,
    balance,
    chain_numbers,
    funnel_checks,
    measure_power,
    signals_of,
    time_in_tube,
    watch_tube,
)
from wormopt.systems.chain.tables import FunnelTracker, Tracker
from wormopt.systems.shared.proof import CrossCheck, cross_check, one_or_all, warnings_of_motion
from wormopt.systems.shared.signals import (
    at_ends,
    event_arrays,
    sample,
    simulate_whole,
)

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of the members that bound the bands."""

# If this number of members exhausts its steps, the others are not tried.
_IN_VAIN = 3


def watched(loop: Model, tracker: Tracker) -> Model:
    """Add the measured quantities to a closed loop."""
    return watch_tube(measure_power(loop), tube_radius(tracker))


@dataclass(frozen=True, eq=False)
class Tracked:
    """Motion of one tracker."""

    label: str
    tracker: Tracker
    loop: Model  # closed loop, without measured quantities
    motion: Trajectory

    @cached_property
    def gain(self) -> ca.SX:
        """Factor of the error's rate in the input."""
        if isinstance(self.tracker, FunnelTracker):
            return self.loop["gain"] * self.loop["funnel_gain"][1]
        return self.loop["gain"]

    @cached_property
    def expressions(self) -> dict[str, ca.SX]:
        """Signals by name."""
        return signals_of(self.motion.system.model) | {
            "error_norm": self.loop["error_norm"],
            "tube": ca.SX(tube_radius(self.tracker)),
            "gain": self.gain,
        }

    def numbers_of(self, motion: Trajectory) -> dict[str, Any]:
        """Scalars of a motion of this loop, by their names in a Result."""
        outside, captured = time_in_tube(motion)
        filtered = any(signal.name == "filter" for signal in self.loop.x)
        return chain_numbers(motion) | {
            "k_end": at_ends(motion).observe(self.gain)[0, -1],
            "filter_end": motion["filter"][:, -1] if filtered else None,
            "time_outside_tube": outside,
            "capture_time": captured,
        }

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """Scalars by their names in a Result."""
        return self.numbers_of(self.motion)

    @cached_property
    def energies(self) -> Balance | None:
        """Energy balance."""
        return balance(self.motion)

    def recheck(self, tolerance: Tolerance, again: Recheck, report: Report) -> CrossCheck | None:
        """Compare with a second route."""
        return cross_check(self.loop, self.motion, tolerance, recheck=again, report=report)

    def own_checks(self, before: str) -> Iterator[Check]:
        """Whether errors stay in their funnels; names begin with `before`."""
        yield from funnel_checks(self.loop, self.motion, before)

    def warnings(self, second: CrossCheck | None, period: float) -> Iterator[str]:
        """Warn of an unusual second route, and if the error may not stay in the tube."""
        yield from warnings_of_motion(self.motion, second)
        end, captured = self.motion.end_time, self.numbers["capture_time"]
        if captured is None and not any(e.name == ENTERS for e in self.motion.events):
            yield f"{self.label}: the error never reaches the tube by t = {end:g}"
        elif captured is None:
            yield f"{self.label}: the error is outside the tube at the end, t = {end:g}"
        elif end - captured < period:
            yield (
                f"{self.label}: the last entry of the error into the tube is at t = "
                f"{captured:.6g}, less than a period of the reference before the end; the error "
                "may leave again"
            )


def follow(
    label: str,
    tracker: Tracker,
    loop: Model,
    end: float,
    samples: int,
    contact: Treatment,
    tolerance: Tolerance,
    report: Report,
    *,
    motions: int = 1,
) -> Tracked:
    """Simulate a closed loop."""
    try:
        motion = simulate_whole(
            watched(loop, tracker),
            end,
            samples,
            contact,
            tolerance,
            lambda _, fraction: report(f"simulating {label}", fraction),
            motions=motions,
        )
    except (SolveError, Interrupted) as error:
        error.partial = Tracked(label, tracker, loop, error.partial)
        if isinstance(error, SolveError) and motions > 1:
            error.reason = f"{label}: {error.reason}"
        raise
    return Tracked(label, tracker, loop, motion)


def follow_in_turn(simulations: Iterable[Callable[[], Tracked]]) -> list[Tracked]:
    """Simulate several trackers.

    Raises SolveError and Interrupted with the motions so far as `partial`; one that was interrupted
    is kept only if it is the first, because signals end where the shortest motion does.
    """
    found: list[Tracked] = []
    for simulation in simulations:
        try:
            found.append(simulation())
        except SolveError as error:
            error.partial = [*found, error.partial] if error.partial else None
            raise
        except Interrupted as stop:
            stop.partial = found or [stop.partial]
            raise
    return found


def tracked_signals(found: Sequence[Tracked]) -> dict[str, Any]:
    """Samples of several trackers up to the earliest end of all motions; {} if there is none."""
    count = min(len(each.motion.time) for each in found)
    if count == 0:
        return {}
    signals = [sample(each.motion, each.expressions) for each in found]
    arrays = {name: np.array([s[name][:, :count] for s in signals]) for name in signals[0]}
    if any(isinstance(each.tracker, FunnelTracker) for each in found):
        widths = [
            each.motion["funnel"][:, :count]
            if isinstance(each.tracker, FunnelTracker)
            else np.full((1, count), np.nan)
            for each in found
        ]
        arrays["funnel"] = np.array(widths)
    first = found[0]
    return {
        "time": first.motion.time[:count],
        "reference": first.motion.observe(first.loop["reference"])[:, :count],
        **arrays,
        **event_arrays([each.motion for each in found], several=True),
    }


# -- ensembles -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Herd(Tracked):
    """Motions of many worms with one tracker; `motion` is that of the first."""

    ensemble: Ensemble
    members: Sequence[Scenario]

    @cached_property
    def completed(self) -> dict[int, Trajectory]:
        """Motions that came to their end, by member."""
        codes = self.ensemble.codes
        return {k: self.ensemble.motions[k] for k, code in enumerate(codes) if not code}

    @cached_property
    def each(self) -> list[dict[str, Any]]:
        """Scalars of every completed member."""
        return [self.numbers_of(motion) for motion in self.completed.values()]

    def values(self, name: str) -> list[Any]:
        """A quantity of every completed member."""
        return [numbers[name] for numbers in self.each]

    def of_all(self, name: str) -> np.ndarray:
        """A quantity of every member, NaN where it is unknown."""
        values = np.full(len(self.ensemble.codes), np.nan)
        values[[*self.completed]] = [np.nan if v is None else v for v in self.values(name)]
        return values

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """Medians over the members, and the spread."""
        captured = [time is not None for time in self.values("capture_time")]
        return {name: _median(self.values(name)) for name in self.each[0]} | {
            "distance_quantiles": np.quantile(self.values("distance"), QUANTILES),
            "captured_share": np.mean(captured),
            "members": len(captured),
        }

    @cached_property
    def energies(self) -> Balance | None:
        """Worst energy balance of all members."""
        found = [balance(motion) for motion in self.completed.values()]
        return max((e for e in found if e), key=lambda e: abs(e.residual), default=None)

    def recheck(self, tolerance: Tolerance, again: Recheck, report: Report) -> CrossCheck | None:
        """Recheck the first, the slowest and the fastest member; return the worst."""
        whole, order = list(self.completed), np.argsort(self.values("distance"))
        found = [
            cross_check(
                self.loop,
                self.ensemble.motions[k],
                tolerance,
                p=self.members[k].p,
                schedules=self.members[k].schedules,
                recheck=again,
                report=report,
            )
            for k in sorted({whole[k] for k in (0, int(order[0]), int(order[-1]))})
        ]
        return max(filter(None, found), key=_badness, default=None)

    def own_checks(self, before: str) -> Iterator[Check]:
        """Whether all members were completed, and errors stay in their funnels."""
        codes = self.ensemble.codes
        lost, why = len(codes) - len(self.completed), ", ".join(sorted({*filter(None, codes)}))
        advice = f"{before}{lost} of {len(codes)} members were not completed ({why})"
        yield Check(f"{before}members given up", lost, 0.0, advice)
        motions = {f"{before}member {k}: ": motion for k, motion in self.completed.items()}
        yield from funnel_checks(self.loop, motions, before)

    def warnings(self, second: CrossCheck | None, period: float) -> Iterator[str]:
        """Warn of an unusual second route, and of members that end outside the tube."""
        yield from warnings_of_motion(self.motion, second)
        if never := sum(time is None for time in self.values("capture_time")):
            yield f"{self.label}: {never} of {len(self.each)} members end outside the tube"


def follow_all(
    label: str,
    tracker: Tracker,
    loop: Model,
    members: Sequence[Links],
    times: np.ndarray,
    contact: Treatment,
    tolerance: Tolerance,
    report: Report,
) -> Herd:
    """Simulate a closed loop for every member of an ensemble."""
    scenarios = [Scenario(p=links.numbers, schedules=links.paths) for links in members]

    def herd(ensemble: Ensemble) -> Herd:
        return Herd(label, tracker, loop, ensemble.motions[0], ensemble, scenarios)

    try:
        ensemble = simulate_ensemble(
            watched(loop, tracker),
            float(times[-1]),
            scenarios,
            contact=contact,
            times=times,
            tolerance=tolerance,
            give_up_after=_IN_VAIN,
            report=lambda _, fraction: report(f"simulating members under {label}", fraction),
        )
    except Interrupted as stop:
        begun = herd(stop.partial)
        raise (Interrupted(begun) if begun.completed else KeyboardInterrupt()) from None
    found = herd(ensemble)
    codes = {*ensemble.codes}
    if found.completed and "given_up" not in codes:
        return found
    which = f"none of the first {_IN_VAIN} members" if "given_up" in codes else "no member"
    raise SolveError(
        f"{label}: {which} was completed ({', '.join(sorted(codes - {'given_up'}))})",
        "run the scene without [ensemble] to see the reason",
        code=ensemble.codes[0],
    )


def herd_signals(
    herds: Sequence[Herd], bands: Sequence[str], each: Sequence[str]
) -> Mapping[str, Any]:
    """Quantiles of the signals `bands` over the members, and the quantities `each` of all."""
    tubes: list[np.ndarray] = []
    found: dict[str, list[np.ndarray]] = {name: [] for name in bands}
    first = next(iter(herds[0].completed.values()))
    for herd in herds:
        wanted = {name: herd.expressions[name] for name in bands}
        samples = [sample(motion, wanted) for motion in herd.completed.values()]
        for name in bands:
            values = np.array([one[name] for one in samples])
            found[name].append(np.quantile(values, QUANTILES, axis=0))
        tubes.append(sample(first, {"tube": herd.expressions["tube"]})["tube"])
    return {
        "time": herds[0].ensemble.time,
        "quantile": QUANTILES,
        "reference": first.observe(herds[0].loop["reference"]),
        "tube": tubes,
        **{f"{name}_band": values for name, values in found.items()},
        **{f"member_{name}": np.array([herd.of_all(name) for herd in herds]) for name in each},
    }


def _badness(second: CrossCheck) -> float:
    return np.inf if second.error is None else second.error


def _median(values: Sequence[Any]) -> Any:
    """Median, entry by entry for vectors; None means never, and remains if it holds for most."""
    if isinstance(values[0], np.ndarray):
        return np.median(values, axis=0)
    numbers = [np.inf if value is None else value for value in values]
    return float(np.median(numbers)) if np.isfinite(np.median(numbers)) else None


def of_trackers(found: Sequence[Tracked]) -> dict[str, Any]:
    """Scalars of several trackers: a list where there is more than one."""
    return {name: one_or_all([each.numbers[name] for each in found]) for name in found[0].numbers}
