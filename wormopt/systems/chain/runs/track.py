"""Run scenes of kind ``track``: a chain whose links follow a gait by adaptive controllers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain.loops import (
    build_loop,
    draw_links,
    labels,
    laws_of,
)
from wormopt.systems.chain.measured import (
    ENTERS,
    Tracked,
    balance,
    chain_checks,
    chain_facts,
    funnel_checks,
    loop_expressions,
    loop_numbers,
    time_in_tube,
    watched,
)
from wormopt.systems.chain.scenes.track import TrackScene
from wormopt.systems.chain.tables import FunnelTracker
from wormopt.systems.shared.proof import (
    CrossCheck,
    cross_check,
    one_or_all,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import (
    event_arrays,
    fitted,
    gait_arrays,
    sample,
    simulate_whole,
)
from wormopt.systems.spiked import gait_of_shape


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[TrackScene], report: Report) -> Result:
    """Simulate the worm with each tracker, or an ensemble; "failed" where checks disagree.

    The checks are second route, energy balance and funnels. Raises SceneError for a gait file or
    start, SolveError if a motion stops early, and Interrupted; the last two with partial results.
    """
    if scene.table.ensemble is not None:
        from wormopt.systems.chain.runs.track_ensemble import run_ensemble

        return run_ensemble(scene, report)
    table = scene.table
    clock = time.perf_counter()
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    found: list[Tracked] = []
    try:
        for index in range(len(table.trackers)):
            found.append(_follow(scene, index, gait, found, report))
        simulated = time.perf_counter()
        tolerance = tolerance_of(table.tolerance)
        recheck = table.tolerance.recheck
        seconds = [
            cross_check(each.loop, each.motion, tolerance, recheck=recheck, report=report)
            for each in found
        ]
    except KeyboardInterrupt as stop:
        raise _interrupted(scene, gait, found, stop) from None
    timings = {"simulate": simulated - clock, "recheck": time.perf_counter() - simulated}
    return _result(scene, gait, found, seconds, timings)


def _follow(
    scene: Scene[TrackScene], index: int, gait: Gait, before: list[Tracked], report: Report
) -> Tracked:
    table = scene.table
    tracker, label = table.trackers[index], labels(table.trackers)[index]
    links = draw_links(table.worm, table.time.end)
    loop = build_loop(scene, index, gait, links)
    try:
        motion = simulate_whole(
            watched(loop, tracker),
            table.time.end,
            table.time.samples,
            treatment_of(table.contact),
            tolerance_of(table.tolerance),
            lambda _, fraction: report(f"simulating {label}", fraction),
            motions=len(table.trackers),
        )
    except SolveError as error:
        partial = [*before, Tracked(label, tracker, loop, error.partial)]
        several = len(table.trackers) > 1
        reason = f"{label}: {error.reason}" if several else error.reason
        result = _unfinished(scene, gait, partial, reason)
        raise SolveError(reason, error.suggestion, result, error.code) from None
    except Interrupted as stop:
        raise Interrupted(Tracked(label, tracker, loop, stop.partial)) from None
    return Tracked(label, tracker, loop, motion)


def models_of(scene: Scene[TrackScene]) -> dict[str, Model]:
    """Make the closed loop of every tracker, by label; links are those of the first draw."""
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    links = draw_links(table.worm, table.time.end)
    names = labels(table.trackers)
    return {name: build_loop(scene, k, gait, links) for k, name in enumerate(names)}


# -- checks, warnings and signals ------------------------------------------------------------------


def _result(
    scene: Scene[TrackScene],
    gait: Gait,
    found: Sequence[Tracked],
    seconds: Sequence[CrossCheck | None],
    timings: dict[str, float],
) -> Result:
    tolerance = tolerance_of(scene.table.tolerance)
    energies = [balance(each.motion) for each in found]
    numbers = [
        loop_numbers(each) | {"recheck_error": second and second.error}
        for each, second in zip(found, seconds, strict=True)
    ]
    checks: list[Check] = []
    for each, second, energy in zip(found, seconds, energies, strict=True):
        label = each.label if len(found) > 1 else ""
        before = f"{label}: " if label else ""
        checks += chain_checks(second, energy, tolerance, label)
        checks += funnel_checks(each.loop, each.motion, before)
    return conclude(
        scene,
        {name: one_or_all([each[name] for each in numbers]) for name in numbers[0]},
        _signals(gait, found),
        checks=checks,
        facts=chain_facts([each.motion for each in found], seconds, tolerance, energies),
        warnings=_warnings(scene, gait, found, seconds),
        timings=timings,
        attributes={"trackers": [each.label for each in found]},
    )


def _unfinished(scene: Scene[TrackScene], gait: Gait, found: Sequence[Tracked], why: str) -> Result:
    """Keep the completed motions and the last one, which was given up."""
    names = {"trackers": [each.label for each in found]}
    return conclude(scene, {}, _signals(gait, found), attributes=names).failed(why)


def _interrupted(
    scene: Scene[TrackScene], gait: Gait, found: Sequence[Tracked], stop: KeyboardInterrupt
) -> KeyboardInterrupt:
    """Keep the completed motions, or the first as far as it was simulated."""
    total = len(scene.table.trackers)
    if len(found) == total:
        why = "before the second route was complete"
    elif found:
        why = f"after {len(found)} of {total} trackers"
    elif isinstance(stop, Interrupted):
        found = [stop.partial]
        why = f"at t = {found[0].motion.end_time:.6g}"
    else:
        return stop
    return Interrupted(_unfinished(scene, gait, found, f"interrupted {why}"))


def _signals(gait: Gait, found: Sequence[Tracked]) -> dict[str, Any]:
    """Samples up to the earliest end of all motions."""
    count = min(len(each.motion.time) for each in found)
    if count == 0:
        return {}
    signals = [sample(each.motion, loop_expressions(each)) for each in found]
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
        **fitted(arrays, TrackScene.variables),
        **event_arrays([each.motion for each in found], several=True),
        **gait_arrays(gait),
    }


def _warnings(
    scene: Scene[TrackScene],
    gait: Gait,
    found: Sequence[Tracked],
    seconds: Sequence[CrossCheck | None],
) -> Iterator[str]:
    table = scene.table
    yield from warnings_of_contact(treatment_of(table.contact), laws_of(table.worm))
    for each, second in zip(found, seconds, strict=True):
        yield from warnings_of_motion(each.motion, second)
        yield from (f"{each.label}: {what}" for what in _escapes(each, gait.period))


def _escapes(each: Tracked, period: float) -> Iterator[str]:
    """Warn if the error may not stay in the tube."""
    end, (_, captured) = each.motion.end_time, time_in_tube(each.motion)
    if captured is None and not any(e.name == ENTERS for e in each.motion.events):
        yield f"the error never reaches the tube by t = {end:g}"
    elif captured is None:
        yield f"the error is outside the tube at the end, t = {end:g}"
    elif end - captured < period:
        yield (
            f"the last entry of the error into the tube is at t = {captured:.6g}, less than a "
            "period of the reference before the end; the error may leave again"
        )
