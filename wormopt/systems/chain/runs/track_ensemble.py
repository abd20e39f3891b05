"""Run ensembles of scenes of kind ``track``: many worms with random links and the same trackers."""

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
from wormopt.result import Check, Result
from wormopt.simulation.ensemble import Ensemble, Scenario, simulate_ensemble
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain.loops import (
    build_loop,
    draw_links,
    labels,
    laws_of,
)
from wormopt.systems.chain.measured import (
    Tracked,
    balance,
    chain_checks,
    chain_facts,
    funnel_checks,
    loop_expressions,
    loop_numbers,
    watched,
)
from wormopt.systems.chain.scenes.track import TrackScene
from wormopt.systems.chain.tables import Tracker
from wormopt.systems.shared.proof import (
    CrossCheck,
    cross_check,
    one_or_all,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import fitted, gait_arrays, sample
from wormopt.systems.spiked import gait_of_shape

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of the members that bound the bands."""

# If this number of members exhausts its steps, the others, drawn in the same way, are not tried.
_IN_VAIN = 3


@dataclass(frozen=True, eq=False)
class _Herd:
    """An ensemble with one tracker."""

    first: Tracked  # motion of the first member
    ensemble: Ensemble
    numbers: list[dict[str, Any]]  # of each motion that came to its end
    whole: list[int]  # members of these motions

    def values(self, name: str) -> list[Any]:
        """A quantity of every completed member."""
        return [number[name] for number in self.numbers]

    def member(self, k: int) -> Tracked:
        """Motion of one member."""
        return replace(self.first, motion=self.ensemble.motions[k])


def run_ensemble(scene: Scene[TrackScene], report: Report) -> Result:
    """Simulate every member with each tracker; scalars are medians over the members.

    The result is "failed" if a member was given up, or the second route disagrees (first, slowest,
    fastest). Raises SceneError for gait file or start, SolveError if no member is completed, and
    Interrupted with a partial result.
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


def _members(table: TrackScene) -> list[Scenario]:
    assert table.ensemble is not None
    drawn = [draw_links(table.worm, table.time.end, k) for k in range(table.ensemble.members)]
    return [Scenario(p=links.numbers, schedules=links.paths) for links in drawn]


def _simulate(
    scene: Scene[TrackScene], index: int, gait: Gait, members: Sequence[Scenario], report: Report
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
            give_up_after=_IN_VAIN,
            report=lambda _, fraction: report(f"simulating members under {label}", fraction),
        )
    except Interrupted as stop:
        raise Interrupted(_herd(label, tracker, loop, stop.partial)) from None
    herd = _herd(label, tracker, loop, ensemble)
    if not herd.whole or "given_up" in ensemble.codes:
        which = (
            f"none of the first {_IN_VAIN} members" if "given_up" in ensemble.codes else "no member"
        )
        codes = ", ".join(sorted({*ensemble.codes} - {"given_up"}))
        raise SolveError(
            f"{label}: {which} was completed ({codes})",
            "run the scene without [ensemble] to see the reason",
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
    """Keep the completed trackers, or the completed members of the first."""
    total = len(scene.table.trackers)
    if len(herds) == total:
        why = "before the second route was complete"
    elif herds:
        why = f"after {len(herds)} of {total} trackers"
    elif isinstance(stop, Interrupted) and stop.partial.whole:
        herds = [stop.partial]
        why = f"after {len(herds[0].whole)} of {len(herds[0].ensemble.codes)} members"
    else:
        return KeyboardInterrupt()
    names = {"trackers": [herd.first.label for herd in herds]}
    partial = conclude(scene, {}, _signals(scene, gait, herds), attributes=names)
    return Interrupted(partial.failed(f"interrupted {why}"))


def _seconds(
    scene: Scene[TrackScene], herd: _Herd, members: Sequence[Scenario], report: Report
) -> list[CrossCheck]:
    """Recheck the first, the slowest and the fastest member."""
    table = scene.table
    order = np.argsort(herd.values("distance"))
    chosen = {herd.whole[k] for k in (0, int(order[0]), int(order[-1]))}
    found = [
        cross_check(
            herd.first.loop,
            herd.ensemble.motions[k],
            tolerance_of(table.tolerance),
            p=members[k].p,
            schedules=members[k].schedules,
            recheck=table.tolerance.recheck,
            report=report,
        )
        for k in sorted(chosen)
    ]
    return [second for second in found if second]


# -- checks, warnings and scalars ------------------------------------------------------------------


def _result(
    scene: Scene[TrackScene],
    gait: Gait,
    herds: Sequence[_Herd],
    seconds: Sequence[Sequence[CrossCheck]],
    timings: dict[str, float],
) -> Result:
    table, tolerance = scene.table, tolerance_of(scene.table.tolerance)
    energies = [[balance(herd.member(k).motion) for k in herd.whole] for herd in herds]
    worst = [max((e for e in es if e), key=lambda e: abs(e.residual), default=None)
             for es in energies]  # fmt: skip
    found = [max(each, key=_badness, default=None) for each in seconds]
    warnings = list(warnings_of_contact(treatment_of(table.contact), laws_of(table.worm)))
    checks: list[Check] = []
    for herd, second, energy in zip(herds, found, worst, strict=True):
        checks += chain_checks(second, energy, tolerance, herd.first.label)
        checks += _checks(herd)
        warnings += _warnings(herd, second)
    return conclude(
        scene,
        _scalars(herds, found),
        _signals(scene, gait, herds),
        checks=checks,
        facts=chain_facts([herd.first.motion for herd in herds], found, tolerance, worst),
        warnings=warnings,
        timings=timings,
        attributes={"trackers": [herd.first.label for herd in herds]},
    )


def _badness(second: CrossCheck) -> float:
    return np.inf if second.error is None else second.error


def _checks(herd: _Herd) -> Iterator[Check]:
    before, codes = f"{herd.first.label}: ", herd.ensemble.codes
    lost, why = len(codes) - len(herd.whole), ", ".join(sorted(set(filter(None, codes))))
    advice = f"{before}{lost} of {len(codes)} members were not completed ({why})"
    yield Check(f"{before}members given up", lost, 0.0, advice)
    motions = {f"{before}member {k}: ": herd.member(k).motion for k in herd.whole}
    yield from funnel_checks(herd.first.loop, motions, before)


def _warnings(herd: _Herd, second: CrossCheck | None) -> Iterator[str]:
    yield from warnings_of_motion(herd.first.motion, second)
    never = sum(time is None for time in herd.values("capture_time"))
    if never:
        what = "members end outside the tube"
        yield f"{herd.first.label}: {never} of {len(herd.whole)} {what}"


def _scalars(herds: Sequence[_Herd], found: Sequence[CrossCheck | None]) -> dict[str, Any]:
    scalars = {
        name: one_or_all([_median(herd.values(name)) for herd in herds])
        for name in herds[0].numbers[0]
    }
    spread = [np.quantile(herd.values("distance"), QUANTILES) for herd in herds]
    captured = [np.mean([t is not None for t in herd.values("capture_time")]) for herd in herds]
    return scalars | {
        "distance_quantiles": one_or_all(spread),
        "captured_share": one_or_all(captured),
        "members": one_or_all([len(herd.whole) for herd in herds]),
        "recheck_error": one_or_all([second and second.error for second in found]),
    }


def _median(values: Sequence[Any]) -> Any:
    """Median, entry by entry for vectors; None means never, and remains if it holds for most."""
    if isinstance(values[0], np.ndarray):
        return np.median(values, axis=0)
    numbers = [np.inf if value is None else value for value in values]
    return float(np.median(numbers)) if np.isfinite(np.median(numbers)) else None


def _signals(scene: Scene[TrackScene], gait: Gait, herds: Sequence[_Herd]) -> dict[str, Any]:
    first = herds[0].member(herds[0].whole[0])
    names = [name for name in scene.table.variables if name.endswith("_band")]
    tubes: list[np.ndarray] = []
    bands: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for herd in herds:
        expressions = loop_expressions(herd.first)
        wanted = {name: expressions[name.removesuffix("_band")] for name in names}
        samples = [sample(herd.member(k).motion, wanted) for k in herd.whole]
        for name in names:
            values = np.array([each[name] for each in samples])
            bands[name].append(np.quantile(values, QUANTILES, axis=0))
        tubes.append(sample(first.motion, {"tube": expressions["tube"]})["tube"])
    each = [name for name in scene.table.variables if name.startswith("member_")]
    return {
        "time": herds[0].ensemble.time,
        "quantile": QUANTILES,
        "reference": first.motion.observe(first.loop["reference"]),
        **fitted({"tube": tubes, **bands}, TrackScene.variables),
        **{
            name: np.array([_of_all(herd, name.removeprefix("member_")) for herd in herds])
            for name in each
        },
        **gait_arrays(gait),
    }


def _of_all(herd: _Herd, name: str) -> np.ndarray:
    """A quantity of every member, NaN where it is unknown."""
    values = np.full(len(herd.ensemble.codes), np.nan)
    values[herd.whole] = [np.nan if v is None else v for v in herd.values(name)]
    return values
