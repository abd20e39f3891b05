"""Runs of kind ``peristaltic-drag``: the best gait of a worm on linear drag."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion
from wormopt.ocp.optimise import Optimum
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.scene import Scene
from wormopt.systems.peristaltic.drag.large_gaits import (
    SHORTEST,
    DragAim,
    best_gait,
    first_gait,
    touches,
)
from wormopt.systems.peristaltic.drag.small_gaits import Cost, SmallGait, mean_step, small_gaits
from wormopt.systems.peristaltic.drag.stationary_gaits import Stationary, stationary
from wormopt.systems.peristaltic.drag.worm import rings
from wormopt.systems.peristaltic.scenes.drag import PeristalticDragScene
from wormopt.systems.shared.optimum import (
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
)

# Accepted relative difference of both routes to the best gait.
_AGREED = 1e-7
_INSTANTS = 512


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PeristalticDragScene], report: Report) -> Result:
    """Find the best gait; status "failed" if its simulation or the second route disagrees.

    Raises SolveError if no gait is found.
    """
    table, begin = scene.table, time.perf_counter()
    aim, given = _aim(table), table.mesh
    mesh = Mesh.even(
        1, given.arcs, Collocation(given.degree, given.scheme), max(0, given.degree - 1)
    )
    try:
        best, tried = best_gait(
            aim, mesh, given.tolerance, starts=table.search.starts, report=report
        )
    except SolveError as error:
        raise refused(scene, error) from None
    solved = time.perf_counter()
    again, reason = _again(best.motion, aim)
    return conclude_optimum(
        scene,
        {"gait": best},
        cross_check(best.motion, report=report),
        _scalars(best.motion, aim, again),
        _variables(best.motion, aim),
        checks=_checks(best.motion, again, reason),
        facts={"starts": [-aim.small_way * objective for objective in tried], "second_way": reason},
        warnings=_warnings(table, best, aim, reason),
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def _aim(table: PeristalticDragScene) -> DragAim:
    effort, limits, L = table.effort, table.limits, table.worm.length
    cost: Cost = "dissipation" if effort.strain_rate is None else "strain_rate"
    least, most = limits.length or (SHORTEST * L, float("inf"))
    return DragAim(
        segments=table.worm.segments,
        exponent=table.drag.exponent,
        cost=cost,
        effort=effort.strain_rate or effort.dissipation or 0.0,
        period=table.period,
        length=L,
        drag=table.drag.coefficient,
        mean=limits.mean_length,
        keeps_length=limits.keeps_length,
        limits=(least, most),
    )


def _again(motion: Motion, aim: DragAim) -> tuple[Stationary | None, str]:
    """Return the gait by its Euler-Lagrange equations, and the method or why there is none."""
    if touches(motion, aim):
        return None, "none: a segment reaches a limit of its length"
    if aim.mean is None:
        return None, "none: without a mean length the mean of the lengths is not determined"
    try:
        return stationary(motion, aim), "Euler-Lagrange equations, by Newton's method"
    except SolveError as error:
        return None, f"failed: {error.reason}"


def _checks(motion: Motion, again: Stationary | None, reason: str) -> Iterator[Check]:
    """Yield checks that the gait is a local optimum."""
    if again is not None:
        off = abs(again.way / _way(motion) - 1)
        advice = f"by the Euler-Lagrange equations the displacement is {again.way:.9g}"
        yield Check("equations of Euler and Lagrange", off, _AGREED, advice)
    elif reason.startswith("failed"):
        advice = (
            "the Euler-Lagrange equations were not solved: "
            f"{reason.removeprefix('failed: ')}; write a drag.exponent farther from 0, or less "
            "effort"
        )
        yield Check("equations of Euler and Lagrange", None, _AGREED, advice)


def _way(motion: Motion) -> float:
    ends = motion.state("position", np.array([0.0, motion.duration]))
    return float(ends[0, 1] - ends[0, 0])


def _scalars(motion: Motion, aim: DragAim, again: Stationary | None) -> dict[str, Any]:
    t = np.arange(_INSTANTS) / _INSTANTS * motion.duration
    lengths = motion.output("lengths", t)
    way, step = _way(motion), mean_step(np.fft.rfft(lengths, axis=1)[:, 1])
    by_cost = {cost: _first(aim, cost) for cost in ("strain_rate", "dissipation")}
    efforts = {"effort_strain_rate": "strain_power", "effort_dissipation": "dissipation"}
    return {
        "distance": way,
        "speed": way / motion.duration,
        "distance_small": aim.small_way,
        "distance_stationary": again and again.way,
        "price": again and again.price * aim.effort / aim.length,
        "wave_step": step,
        "segments_per_wave": _per_wave(step),
        **{f"gain_{cost}": gait.gain for cost, gait in by_cost.items()},
        **{f"segments_per_wave_{cost}": _per_wave(gait.step) for cost, gait in by_cost.items()},
        "length_min": float(lengths.min()),
        "length_max": float(lengths.max()),
        **{name: _integral(motion, power) for name, power in efforts.items()},
    }


def _integral(motion: Motion, name: str) -> float:
    """Return the integral of an output over the motion, by the points of its mesh."""
    arcs, points = motion.arcs, motion.mesh.collocation
    t = motion.breaks[:-1] + np.multiply.outer(points.tau, arcs.duration)
    values = motion.output(name, t.ravel()).reshape(t.shape)
    return float(points.B @ values @ arcs.duration)


def _first(aim: DragAim, cost: Cost) -> SmallGait:
    return small_gaits(aim.segments, aim.exponent, cost, fixed_total=aim.keeps_length)[0]


def _per_wave(step: float) -> float:
    return 2 * np.pi / abs(step) if step else np.inf


def _variables(motion: Motion, aim: DragAim) -> dict[str, np.ndarray]:
    model = motion.program.problem.model
    names = {"length": "lengths", "rate": "rates", "velocity": "speed"}
    expressions: dict[str, ca.SX] = {
        **{name: model[output] for name, output in names.items()},
        "dissipation": model["dissipation"],
        "position": rings(model["position"], model["lengths"]),
    }
    sampled = sample_motion(motion, expressions)
    return sampled.arrays(PeristalticDragScene.variables) | {
        "length_small": _small_lengths(motion, aim, sampled.time)
    }


def _small_lengths(motion: Motion, aim: DragAim, t: np.ndarray) -> np.ndarray:
    """Return lengths (N, m) of the best small gait, in phase with the gait found at its start."""
    even = np.arange(_INSTANTS) / _INSTANTS * aim.period
    found = np.fft.rfft(motion.output("lengths", even), axis=1)[:, 1]
    small = aim.small[0]
    ahead = float(np.angle(small.mode.conj() @ found)) / (2 * np.pi) * aim.period
    return first_gait(aim, small)(t + ahead)


def _warnings(
    table: PeristalticDragScene, best: Optimum, aim: DragAim, reason: str
) -> Iterator[str]:
    yield from warnings_of_optimum(best, table.mesh.tolerance)
    if reason.startswith("none"):
        yield f"no second route to this gait: {reason.removeprefix('none: ')}"
    if touches(best.motion, aim) and table.limits.length is None:
        yield (
            f"a segment reaches the least length, {SHORTEST:g} of its usual length; write "
            "limits.length, or a smaller effort"
        )
    if len(aim.small) > 1:
        yield ("a local optimum; write more search.starts to try more waves on the body")
