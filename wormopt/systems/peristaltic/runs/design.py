"""Runs of kind ``peristaltic-design``: the fastest anchored gait, its bound and its reserves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.peristaltic.anchored.fastest import AnchorLimits, Fastest, fastest
from wormopt.systems.peristaltic.anchored.gait import AnchoredGait, anchored_wave, anchors_needed
from wormopt.systems.peristaltic.anchored.quasi_static import slip
from wormopt.systems.peristaltic.scenes.design import PeristalticDesignScene

# Accepted round-off of a gait, relative to strokes and rates; of a bound, relative to the speed.
_ROUNDING, _SOLVED = 1e-8, 1e-6
# Gap above which a warning is given.
_WIDE = 0.01
_ASSUMED = {
    "segments": "sealed cylinders: radius R sqrt(L/l), and no change of length by uniform pressure",
    "anchors": "clamped: a segment rests with both of its rings, and only while it is shortest",
    "rates": "lengths follow the coils at any rate within the limits; no inertia, no creep",
    "drag": "dry, the same for every moving segment, in both directions",
}


def run(scene: Scene[PeristalticDesignScene], report: Report) -> Result:
    """Design the fastest gait; status "failed" if it violates its limits."""
    table, begin = scene.table, time.perf_counter()
    limits = _limits(scene)
    found = fastest(limits, table.search.phases, table.search.time_limit, report)
    wave = anchored_wave(
        limits.segments, limits.anchors + 1, limits.stroke, limits.stroke / min(limits.rate)
    )
    shortest = table.length_of(table.tube.radius)
    return conclude(
        scene,
        _scalars(table, limits, found, wave),
        _signals(table, found.gait, shortest) | _of_wave(wave),
        checks=_checks(table, limits, found, wave),
        facts={"assumptions": _ASSUMED, "certificate": _certificate(limits, found)},
        warnings=_warnings(table, found),
        timings={"design": time.perf_counter() - begin},
    )


def _limits(scene: Scene[PeristalticDesignScene]) -> AnchorLimits:
    """Return the limits of the gait; raises SceneError if too few segments can hold."""
    table = scene.table
    worm, limits, tube = table.worm, table.limits, table.tube
    try:
        needed = anchors_needed(worm.segments, tube.hold, worm.drag, worm.load, limits.reserve)
    except ArgumentError as error:
        least = limits.reserve * (worm.load + 2 * worm.drag) / (worm.segments - 2) / tube.friction
        message = f"{error}; write at least {least * (1 + 1e-5):.6g}"  # never rounded down
        raise SceneError(scene.name, [("tube.wall_force", message)]) from None
    anchors = limits.anchors or needed
    if anchors < needed:
        message = f"{anchors} do not hold; write at least {needed}, or leave it out"
        raise SceneError(scene.name, [("limits.anchors", message)])
    shortest = table.length_of(tube.radius)
    lift = table.length_of(tube.radius - limits.clearance) - shortest
    stroke = worm.length - shortest
    return AnchorLimits(worm.segments, anchors, stroke, min(lift, stroke), table.rates)


def _scalars(
    table: PeristalticDesignScene, limits: AnchorLimits, found: Fastest, wave: AnchoredGait
) -> dict[str, Any]:
    gait, worm = found.gait, table.worm
    reserves = gait.reserves(table.tube.hold, worm.drag, worm.load)
    shortest = table.length_of(table.tube.radius)
    known = reserves[np.isfinite(reserves)]
    thickest = worm.radius * np.sqrt(worm.length / (shortest + gait.clearances().min()))
    return {
        "speed": gait.speed,
        "advance": gait.advance,
        "period": gait.period,
        "ceiling": found.ceiling,
        "bound": found.bound,
        "gap_certified": found.gap,
        "wave_speed": wave.speed,
        "wave_short": limits.anchors + 1,
        "gain": gait.speed / wave.speed,
        "anchors": limits.anchors,
        "hold": table.tube.hold,
        "reserve_min": float(known.min()) if known.size else None,
        "push_max": float(gait.pushes(worm.drag).max()),
        "shortest": shortest,
        "stroke": limits.stroke,
        "lift": limits.clearance,
        "clearance_min": float(table.tube.radius - thickest),
        "rate_limit": list(limits.rate),
        "order": [list(rest) for rest in gait.order],
        "durations": gait.durations.tolist(),
        "reserves": [float(r) if np.isfinite(r) else None for r in reserves],
        "n_phases": int(gait.lasting.sum()),
        "nodes": found.nodes,
        "worm_radius": worm.radius,
        "tube_radius": table.tube.radius,
    }


def _signals(
    table: PeristalticDesignScene, gait: AnchoredGait, shortest: float
) -> dict[str, np.ndarray]:
    """Return both ends of every phase; between them all signals but the radius are linear."""
    begin, kept = np.concatenate([[0.0], np.cumsum(gait.durations)]), gait.lasting
    length = shortest + gait.lengths
    behind = np.concatenate([[0.0], np.cumsum(length[0])])
    rings = np.vstack([[-behind], -behind + np.cumsum(gait.ways, axis=0)])

    def ends(values: np.ndarray) -> np.ndarray:
        return np.stack([values[:-1][kept], values[1:][kept]], axis=1).reshape(
            -1, *values.shape[1:]
        )

    lengths = ends(np.vstack([length, length[:1]]))
    return {
        "time": ends(begin),
        "length": lengths.T,
        "radius": table.worm.radius * np.sqrt(table.worm.length / lengths.T),
        "anchored": np.repeat(gait.anchored[kept], 2, axis=0).T.astype(float),
        "position": ends(rings).T,
    }


def _of_wave(wave: AnchoredGait) -> dict[str, np.ndarray]:
    way = np.concatenate([[0.0], np.cumsum(wave.ways[:, 0])])
    return {
        "wave_time": np.concatenate([[0.0], np.cumsum(wave.durations)]),
        "wave_position": way,
    }


def _checks(
    table: PeristalticDesignScene, limits: AnchorLimits, found: Fastest, wave: AnchoredGait
) -> Iterator[Check]:
    """Yield the checks of the gait, computed from its lengths and displacements alone."""
    gait, unit = found.gait, limits.stroke
    course, moves = gait.faults() / unit
    yield Check("lengths against ways", course, _ROUNDING, "lengths and ring positions disagree")
    yield Check("anchors", moves, _ROUNDING, "an anchored segment moves, or is not short")
    missing = max(0.0, 1 - float(gait.clearances().min()) / limits.clearance)
    yield Check("clearance", missing, _ROUNDING, "a flight is nearer to the wall than allowed")
    allowed = np.outer(gait.durations, limits.rate)[:, None, :] / unit
    change = gait.changes[:, :, None] / unit * [-1, 1]
    over = max(0.0, float((change - allowed).max()))
    yield Check("rates", over, _ROUNDING, "a length changes faster than allowed")
    slipped = slip(gait, table.tube.hold, table.worm.drag, table.worm.load) / unit
    yield Check("slides", slipped, _ROUNDING, "the anchors slip")
    above = max(0.0, gait.speed / min(found.ceiling, found.bound) - 1)
    yield Check("over the bound", above, _SOLVED, "the gait exceeds its bound; please report this")
    below = max(0.0, wave.speed / gait.speed - 1)
    yield Check("below the wave", below, _SOLVED, "the wave is faster; please report this scene")


def _certificate(limits: AnchorLimits, found: Fastest) -> dict[str, str]:
    every = found.gait.speed >= found.ceiling * (1 - _SOLVED)
    phases = "any number of" if every else f"at most {found.phases}"
    proof = (
        "the mode program, rigorous under round-off"
        if every
        else f"branch and bound over orders of anchors ({found.nodes} nodes), to 1e-6"
    )
    kept = f"with {limits.anchors} or more segments anchored at any time"
    return {"holds_for": f"gaits of {phases} phases per cycle {kept}", "proof": proof}


def _warnings(table: PeristalticDesignScene, found: Fastest) -> Iterator[str]:
    if found.gap > _WIDE:
        yield (
            f"the gait may be up to {found.gap:.2g} of the speed below the optimum; write a larger "
            "search.time_limit, or fewer search.phases"
        )
    reserves = found.gait.reserves(table.tube.hold, table.worm.drag, table.worm.load)
    if np.any(reserves < 1 + _ROUNDING):  # NaN for phases of no duration
        yield (
            "in some phase the anchors have no reserve: reserve_min is 1, and any disturbance "
            "makes them slip; write a larger limits.reserve"
        )
    push, most = float(found.gait.pushes(table.worm.drag).max()), table.worm.push
    if most is not None and push > most:
        yield (
            f"a growing segment must push {push:.4g}, more than worm.push = {most:g}; write more "
            "limits.anchors, which leaves fewer segments to push"
        )
