"""Scenes of kind ``track``: a chain whose links follow a gait by adaptive controllers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
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
from wormopt.systems.chain.scenes.track import FunnelTracker, TrackScene
from wormopt.systems.shared.proof import (
    Recheck,
    faults_of_motion,
    one_or_all,
    recheck,
    trust,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.signals import (
    event_variables,
    sample,
    simulate_whole,
    variable,
)
from wormopt.systems.shared.watch import ENTERS, balance, time_in_tube
from wormopt.systems.spiked.files import gait_variables
from wormopt.systems.spiked.runs.reference import gait_of_shape


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[TrackScene], report: Report) -> Result:
    """Simulate the worm under each tracker, or an ensemble; "failed" where checks disagree.

    These are second route, energy balance, funnels. Raises SceneError for a gait file or start,
    SolveError if a motion stops short, Interrupted by the user; these two with partial results.
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
        seconds = [_second(scene, each, report) for each in found]
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


def _second(scene: Scene[TrackScene], each: Tracked, report: Report) -> Recheck | None:
    table = scene.table
    if not table.tolerance.recheck:
        return None
    return recheck(each.loop, each.motion, tolerance_of(table.tolerance), report=report)


# -- what is said of the motions -----------------------------------------------------------------


def _result(
    scene: Scene[TrackScene],
    gait: Gait,
    found: Sequence[Tracked],
    seconds: Sequence[Recheck | None],
    timings: dict[str, float],
) -> Result:
    table = scene.table
    tolerance = tolerance_of(table.tolerance)
    energies = [balance(each.motion) for each in found]
    faults = [
        f"{each.label}: {fault}" if len(found) > 1 else fault
        for each, second, energy in zip(found, seconds, energies, strict=True)
        for fault in [*faults_of_motion(second, energy, tolerance), *faults_of_funnel(each)]
    ]
    numbers = [loop_numbers(each) for each in found]
    for number, second in zip(numbers, seconds, strict=True):
        number["recheck_error"] = (second and second.error, "share")
    scalars = {
        name: Scalar(one_or_all([n[name][0] for n in numbers]), unit_of(quantity, table.units))
        for name, (_, quantity) in numbers[0].items()
    }
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=scalars,
        variables=tuple(_variables(scene, gait, found)),
        trust=trust(
            [each.motion for each in found],
            seconds,
            tolerance,
            energies,
            list(_warnings(scene, gait, found, seconds)),
        ),
        timings_s=timings,
        scene_text=scene.text,
        attributes={"trackers": [each.label for each in found]},
    )


def _unfinished(scene: Scene[TrackScene], gait: Gait, found: Sequence[Tracked], why: str) -> Result:
    """Keep what there is of motions of which the last was given up."""
    return Result(
        scene.name,
        scene.table.kind,
        scene.title,
        "failed",
        reason=why,
        variables=tuple(_variables(scene, gait, found)),
        scene_text=scene.text,
        attributes={"trackers": [each.label for each in found]},
    )


def _interrupted(
    scene: Scene[TrackScene], gait: Gait, found: Sequence[Tracked], stop: KeyboardInterrupt
) -> KeyboardInterrupt:
    """Keep the motions that are done, or the first as far as it came."""
    total = len(scene.table.trackers)
    if len(found) == total:
        why = "before the second route was done"
    elif found:
        why = f"after {len(found)} of {total} trackers"
    elif isinstance(stop, Interrupted):
        found = [stop.partial]
        why = f"at t = {found[0].motion.end_time:.6g}"
    else:
        return stop
    return Interrupted(_unfinished(scene, gait, found, f"interrupted {why}"))


def _variables(
    scene: Scene[TrackScene], gait: Gait, found: Sequence[Tracked]
) -> Iterator[Variable]:
    units = scene.table.units
    count = min(len(each.motion.time) for each in found)
    if count == 0:
        return
    yield Variable("time", unit_of("time", units), ("time",), found[0].motion.time[:count], "time")
    reference = found[0].motion.observe(found[0].loop.output("reference"))[:, :count]
    kind = ("length", ("link",), "reference of the link length")
    yield variable("reference", kind, (), reference, units)
    signals = [sample(each.motion, loop_expressions(each)) for each in found]
    for name in signals[0]:
        values = np.array([signal[name][:, :count] for signal in signals])
        kind = LOOP_SIGNALS[name]
        yield variable(name, kind, ("tracker",), values, units)
    yield from _funnels(found, count, units)
    yield from event_variables([each.motion for each in found], units, several=True)
    yield from gait_variables(gait, units)


def _funnels(found: Sequence[Tracked], count: int, units: str) -> Iterator[Variable]:
    """Widths of funnels, not a number for the other trackers."""
    if not any(isinstance(each.tracker, FunnelTracker) for each in found):
        return
    rows = [
        each.motion.output("funnel")[:, :count]
        if isinstance(each.tracker, FunnelTracker)
        else np.full((1, count), np.nan)
        for each in found
    ]
    yield variable("funnel", LOOP_SIGNALS["funnel"], ("tracker",), np.array(rows), units)


def _warnings(
    scene: Scene[TrackScene],
    gait: Gait,
    found: Sequence[Tracked],
    seconds: Sequence[Recheck | None],
) -> Iterator[str]:
    table = scene.table
    yield from warnings_of_contact(treatment_of(table.contact), laws_of(table.worm))
    for each, second in zip(found, seconds, strict=True):
        yield from warnings_of_motion(each.motion, second)
        yield from (f"{each.label}: {what}" for what in _escapes(each, gait.period))


def _escapes(each: Tracked, period: float) -> Iterator[str]:
    """Say where it has not been seen that the error stays in the tube."""
    end, (_, captured) = each.motion.end_time, time_in_tube(each.motion)
    if captured is None and not any(e.name == ENTERS for e in each.motion.events):
        yield f"the error never reaches the tube by t = {end:g}"
    elif captured is None:
        yield f"the error is outside of the tube at the end, t = {end:g}"
    elif end - captured < period:
        yield (
            f"the error entered the tube last at t = {captured:.6g}, less than a period of the "
            "reference before the end: it may leave again"
        )
