"""Ensembles of scenes of kind ``track``: many worms with random links under the same trackers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.ensemble import Ensemble, Member, simulate_ensemble
from wormopt.systems.chain.runs.chains import draw_links, laws_of, tolerance_of, treatment_of
from wormopt.systems.chain.runs.loops import build_loop, labels
from wormopt.systems.chain.runs.tracked import (
    LOOP_SIGNALS,
    Tracked,
    faults_of_funnel,
    loop_expressions,
    loop_numbers,
    watched,
)
from wormopt.systems.chain.scenes.track import Tracker, TrackScene
from wormopt.systems.shared.proof import (
    Recheck,
    faults_of_motion,
    one_or_all,
    recheck,
    trust,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.signals import sample, variable
from wormopt.systems.shared.watch import balance
from wormopt.systems.spiked.files import gait_variables
from wormopt.systems.spiked.runs.reference import gait_of_shape

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Shares of the members that lie below the lines of a band."""

# Signals of which bands are kept.
_BANDS = ("position", "length", "input", "error_norm", "gain")
# Numbers that every member has of its own, kept as variables.
_EACH = ("distance", "mean_speed", "time_outside_tube", "capture_time", "input_rms", "k_end")


@dataclass(frozen=True, eq=False)
class _Herd:
    """An ensemble under one tracker."""

    first: Tracked  # motion of the first member
    ensemble: Ensemble
    # (value, quantity) of each motion that came to its end
    numbers: list[dict[str, tuple[Any, str]]]
    whole: list[int]  # members of these motions

    def values(self, name: str) -> list[Any]:
        """One number of every member that came to its end."""
        return [number[name][0] for number in self.numbers]

    def member(self, k: int) -> Tracked:
        """Motion of one member."""
        return replace(self.first, motion=self.ensemble.motions[k])


def run_ensemble(scene: Scene[TrackScene], report: Report) -> Result:
    """Simulate every member under each tracker; scalars are medians over the members.

    "failed" where one was given up, or the second route disagrees (first, slowest, fastest).
    Raises SceneError for gait file or start; SolveError if none ends; Interrupted, partial.
    """
    clock = time.perf_counter()
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    members = _members(table)
    herds: list[_Herd] = []
    try:
        for index in range(len(table.trackers)):
            herds += [_simulate(scene, index, gait, members, report)]
        simulated = time.perf_counter()
        seconds = [_seconds(scene, herd, members, report) for herd in herds]
    except KeyboardInterrupt as stop:
        raise _interrupted(scene, gait, herds, stop) from None
    timings = {"simulate": simulated - clock, "recheck": time.perf_counter() - simulated}
    return _result(scene, gait, herds, seconds, timings)


def _members(table: TrackScene) -> list[Member]:
    assert table.ensemble is not None
    drawn = [draw_links(table.worm, table.time.end, k) for k in range(table.ensemble.members)]
    return [Member(p=links.numbers, schedules=links.paths) for links in drawn]


def _simulate(
    scene: Scene[TrackScene], index: int, gait: Gait, members: Sequence[Member], report: Report
) -> _Herd:
    table = scene.table
    tracker, label = table.trackers[index], labels(table.trackers)[index]
    loop = build_loop(scene, index, gait, draw_links(table.worm, table.time.end))
    try:
        ensemble = simulate_ensemble(
            watched(loop, tracker),
            table.time.end,
            members,
            contact=treatment_of(table.contact),
            times=np.linspace(0.0, table.time.end, table.time.samples),
            tolerance=tolerance_of(table.tolerance),
            report=lambda _, fraction: report(f"simulating members under {label}", fraction),
        )
    except Interrupted as stop:
        raise Interrupted(_herd(label, tracker, loop, stop.partial)) from None
    herd = _herd(label, tracker, loop, ensemble)
    if not herd.whole:
        codes = ", ".join(sorted(set(ensemble.codes)))
        raise SolveError(
            f"{label}: no member came to its end ({codes})",
            "run the scene without [ensemble] to see why",
            code=ensemble.codes[0],
        )
    return herd


def _herd(label: str, tracker: Tracker, loop: Model, ensemble: Ensemble) -> _Herd:
    first = Tracked(label, tracker, loop, ensemble.motions[0])
    whole = [k for k, code in enumerate(ensemble.codes) if not code]
    numbers = [loop_numbers(replace(first, motion=ensemble.motions[k])) for k in whole]
    return _Herd(first, ensemble, numbers, whole)


def _interrupted(
    scene: Scene[TrackScene], gait: Gait, herds: Sequence[_Herd], stop: KeyboardInterrupt
) -> KeyboardInterrupt:
    """Keep the trackers that are done, or the members of the first that came to their end."""
    total = len(scene.table.trackers)
    if len(herds) == total:
        why = "before the second route was done"
    elif herds:
        why = f"after {len(herds)} of {total} trackers"
    elif isinstance(stop, Interrupted) and stop.partial.whole:
        herds = [stop.partial]
        why = f"after {len(herds[0].whole)} of {len(herds[0].ensemble.codes)} members"
    else:
        return KeyboardInterrupt()
    return Interrupted(
        Result(
            scene.name,
            scene.table.kind,
            scene.title,
            "failed",
            reason=f"interrupted {why}",
            variables=tuple(_variables(scene, gait, herds)),
            scene_text=scene.text,
            attributes={"trackers": [herd.first.label for herd in herds]},
        )
    )


def _seconds(
    scene: Scene[TrackScene], herd: _Herd, members: Sequence[Member], report: Report
) -> list[Recheck]:
    """Recheck the first, the slowest and the fastest member."""
    table = scene.table
    if not table.tolerance.recheck:
        return []
    order = np.argsort(herd.values("distance"))
    chosen = {herd.whole[k] for k in (0, int(order[0]), int(order[-1]))}
    return [
        recheck(
            herd.first.loop,
            herd.ensemble.motions[k],
            tolerance_of(table.tolerance),
            p=members[k].p,
            schedules=members[k].schedules,
            report=report,
        )
        for k in sorted(chosen)
    ]


# -- what is said of the members -----------------------------------------------------------------


def _result(
    scene: Scene[TrackScene],
    gait: Gait,
    herds: Sequence[_Herd],
    seconds: Sequence[Sequence[Recheck]],
    timings: dict[str, float],
) -> Result:
    table = scene.table
    tolerance = tolerance_of(table.tolerance)
    energies = [[balance(herd.member(k).motion) for k in herd.whole] for herd in herds]
    worst = [max((e for e in es if e), key=lambda e: abs(e.residual), default=None)
             for es in energies]  # fmt: skip
    found = [max(each, key=_badness, default=None) for each in seconds]
    faults = [
        f"{herd.first.label}: {fault}"
        for herd, second, energy in zip(herds, found, worst, strict=True)
        for fault in [*faults_of_motion(second, energy, tolerance), *_faults(herd)]
    ]
    laws = laws_of(table.worm)
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(herds, found, table.units),
        variables=tuple(_variables(scene, gait, herds)),
        trust=trust(
            [herd.first.motion for herd in herds],
            found,
            tolerance,
            worst,
            [
                *warnings_of_contact(treatment_of(table.contact), laws),
                *(
                    w
                    for herd, second in zip(herds, found, strict=True)
                    for w in _warnings(herd, second)
                ),
            ],
        ),
        timings_s=timings,
        scene_text=scene.text,
        attributes={"trackers": [herd.first.label for herd in herds]},
    )


def _badness(second: Recheck) -> float:
    return np.inf if second.error is None else second.error


def _faults(herd: _Herd) -> Iterator[str]:
    lost = len(herd.ensemble.codes) - len(herd.whole)
    if lost:
        codes = ", ".join(sorted(set(filter(None, herd.ensemble.codes))))
        yield f"{lost} of {len(herd.ensemble.codes)} members were given up ({codes})"
    for k in herd.whole:
        yield from (f"member {k}: {fault}" for fault in faults_of_funnel(herd.member(k)))


def _warnings(herd: _Herd, second: Recheck | None) -> Iterator[str]:
    yield from warnings_of_motion(herd.first.motion, second)
    never = sum(time is None for time in herd.values("capture_time"))
    if never:
        what = "members are not in the tube at the end"
        yield f"{herd.first.label}: {never} of {len(herd.whole)} {what}"


def _scalars(
    herds: Sequence[_Herd], found: Sequence[Recheck | None], units: str
) -> dict[str, Scalar]:
    scalars = {
        name: Scalar(one_or_all([_median(herd.values(name)) for herd in herds]),
                     unit_of(quantity, units))
        for name, (_, quantity) in herds[0].numbers[0].items()
    }  # fmt: skip
    spread = [np.quantile(herd.values("distance"), QUANTILES) for herd in herds]
    captured = [np.mean([t is not None for t in herd.values("capture_time")]) for herd in herds]
    return scalars | {
        "distance_quantiles": Scalar(one_or_all(spread), unit_of("length", units)),
        "captured_share": Scalar(one_or_all(captured)),
        "members": Scalar(one_or_all([len(herd.whole) for herd in herds])),
        "recheck_error": Scalar(one_or_all([second and second.error for second in found])),
    }


def _median(values: Sequence[Any]) -> Any:
    """Median, entry by entry of vectors; None stands for never, and stays where most never do."""
    if isinstance(values[0], np.ndarray):
        return np.median(values, axis=0)
    numbers = [np.inf if value is None else value for value in values]
    return float(np.median(numbers)) if np.isfinite(np.median(numbers)) else None


def _variables(scene: Scene[TrackScene], gait: Gait, herds: Sequence[_Herd]) -> Iterator[Variable]:
    units = scene.table.units
    time = herds[0].ensemble.time
    yield Variable("time", unit_of("time", units), ("time",), time, "time")
    yield Variable("quantile", "1", ("quantile",), np.array(QUANTILES), "share of members below")
    first = herds[0].member(herds[0].whole[0])
    reference = first.motion.observe(first.loop.output("reference"))
    kind = ("length", ("link",), "reference of the link length")
    yield variable("reference", kind, (), reference, units)
    tubes = []
    rows: dict[str, list[np.ndarray]] = {name: [] for name in _BANDS}
    for herd in herds:
        samples = [sample(herd.member(k).motion, _band_signals(herd)) for k in herd.whole]
        for name in _BANDS:
            values = np.array([each[name] for each in samples])
            rows[name].append(np.quantile(values, QUANTILES, axis=0))
        tubes.append(sample(first.motion, {"tube": loop_expressions(herd.first)["tube"]})["tube"])
    yield variable("tube", LOOP_SIGNALS["tube"], ("tracker",), tubes, units)
    for name, values in rows.items():
        quantity, own, long_name = LOOP_SIGNALS[name]
        kind = (quantity, own, f"quantiles over the members: {long_name}")
        yield variable(f"{name}_band", kind, ("tracker", "quantile"), np.array(values), units)
    for name in _EACH:
        quantity = herds[0].numbers[0][name][1]
        each = np.array([_of_all(herd, name) for herd in herds])
        unit = unit_of(quantity, units)
        yield Variable(f"member_{name}", unit, ("tracker", "member"), each, f"{name} of the member")
    yield from gait_variables(gait, units)


def _band_signals(herd: _Herd) -> dict[str, Any]:
    expressions = loop_expressions(herd.first)
    return {name: expressions[name] for name in _BANDS}


def _of_all(herd: _Herd, name: str) -> np.ndarray:
    """Number of every member, not a number where it is not known."""
    values = np.full(len(herd.ensemble.codes), np.nan)
    values[herd.whole] = [np.nan if v is None else v for v in herd.values(name)]
    return values
