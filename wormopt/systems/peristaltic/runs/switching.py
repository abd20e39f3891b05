"""Runs of kind ``peristaltic-switching``: optimal times of coils that are on or off."""

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
from wormopt.systems.peristaltic.drag.worm import rings
from wormopt.systems.peristaltic.scenes.switching import DragGround, PeristalticSwitchingScene
from wormopt.systems.peristaltic.switching.orders import Search, search
from wormopt.systems.peristaltic.switching.problem import polish
from wormopt.systems.peristaltic.switching.switching import (
    OFF,
    Aim,
    Drag,
    SwitchedWorm,
    SwitchingProgram,
    SwitchLimits,
    Tube,
    walk,
)
from wormopt.systems.shared.optimum import (
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
)

# Accepted relative difference of both routes to the displacement per period.
_AGREED = 1e-8
# Useful periods have at most this number of time constants per segment.
_USED = 3.0
# A limit approached within this share counts as reached.
_REACHED = 1e-6


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PeristalticSwitchingScene], report: Report) -> Result:
    """Find the best order and times; status "failed" if simulation or closed form disagrees.

    Raises SolveError if none are found.
    """
    table, begin = scene.table, time.perf_counter()
    worm, given = worm_of(table), table.mesh
    limits = _limits(table).that_count(worm)
    aim: Aim = "speed" if table.aim.maximise else "thrift"
    mesh = Mesh.even(1, given.arcs, Collocation(given.degree, given.scheme))
    try:
        found = search(
            worm, aim, limits, starts=table.search.starts, seed=table.search.seed, report=report
        )
        searched = time.perf_counter()
        best = polish(worm, aim, limits, found.best, mesh, given.tolerance, report)
    except SolveError as error:
        if error.code == "not_solved":
            error = SolveError(error.reason, _remedy(worm), code=error.code)
        raise refused(scene, error) from None
    order, durations = found.best.lasting[0], np.diff(best.motion.phase_breaks())
    solved = time.perf_counter()
    return conclude_optimum(
        scene,
        {"phases": best},
        cross_check(best.motion, report=report),
        _scalars(table, best.motion, order, durations, found),
        _variables(best.motion),
        checks=[*_checks(worm, aim, order, durations, best)],
        facts={
            "search": {"orders_tried": found.tried, "all_orders": found.complete},
            "assumptions": ["each coil goes on once and off once per period"],
        },
        warnings=_warnings(table, limits, best, found),
        timings={
            "search": searched - begin,
            "optimise": solved - searched,
            "recheck": time.perf_counter() - solved,
        },
        shown=("coil", "length", "velocity"),
    )


def worm_of(table: PeristalticSwitchingScene) -> SwitchedWorm:
    """Return the worm on its ground."""
    worm, ground = table.worm, table.ground
    return SwitchedWorm(
        worm.segments,
        worm.length_on,
        worm.length_off,
        worm.time_on,
        worm.time_on if worm.time_off is None else worm.time_off,
        Drag(ground.exponent) if isinstance(ground, DragGround) else Tube(ground.contact),
    )


def _limits(table: PeristalticSwitchingScene) -> SwitchLimits:
    given = table.limits
    low, high = given.period
    return SwitchLimits((low, high), given.duty, given.dwell, given.together, table.aim.speed)


def _checks(
    worm: SwitchedWorm, aim: Aim, order: np.ndarray, durations: np.ndarray, best: Optimum
) -> Iterator[Check]:
    """Yield checks of the times by closed arcs, and in a tube by a walk of the coils."""
    found = SwitchingProgram(worm, len(durations), aim).at(order, durations)
    worth = found.worth / worm.speed
    advice = f"by closed-form arcs the objective is {-worth:.9g}; {_remedy(worm)}"
    yield Check("arcs in closed form", abs(worth / best.objective + 1), _AGREED, advice)
    if worm.ground.contact is None:
        return
    walked = walk(worm, order != OFF, durations, found.start)
    wrong = max(abs(walked.way - found.way), walked.slip) / found.way
    advice = (
        f"by the coils alone the displacement is {walked.way:.9g}, the slip {walked.slip:.3g}; "
        f"{_remedy(worm)}"
    )
    yield Check("walk by the coils alone", max(wrong, walked.loose / found.period), _AGREED, advice)


def _remedy(worm: SwitchedWorm) -> str:
    """Return what to write if the best times are not determined well enough."""
    slow = max(worm.tau_on, worm.tau_off)
    return (
        f"write limits.period within [{slow:g}, {_USED * worm.segments * slow:g}], where lengths "
        "change much and do not rest, or another search.seed"
    )


def _scalars(
    table: PeristalticSwitchingScene,
    motion: Motion,
    order: np.ndarray,
    durations: np.ndarray,
    found: Search,
) -> dict[str, Any]:
    ends = motion.state("position", np.array([0.0, motion.duration]))[0]
    way, period = float(ends[1] - ends[0]), motion.duration
    coils = (order != OFF).astype(int)
    on = durations @ coils
    begins = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
    goes_on = coils > np.roll(coils, 1, axis=0)
    start = np.array([begins[np.argmax(column)] for column in goes_on.T])
    lengths = motion.state("length", np.linspace(0.0, period, 2001))
    return {
        "speed": way / period,
        "energy_per_distance": table.worm.power * float(on.sum()) / way,
        "distance": way,
        "on_time": on,
        "on_start": np.mod(start - start[0], period),
        "duty": float(on.max()) / period,
        "together": int(coils.sum(axis=1).max()),
        "coil_states": order,
        "orders_tried": found.tried,
        "length_min": float(lengths.min()),
        "length_max": float(lengths.max()),
    }


def _variables(motion: Motion) -> dict[str, np.ndarray]:
    model = motion.program.problem.model
    expressions: dict[str, ca.SX] = {
        "length": model["length"],
        "coil": model["coil"],
        "anchored": model["resting"],
        "velocity": model["speed"],
        "position": rings(model["position"], model["length"]),
    }
    return sample_motion(motion, expressions).arrays(PeristalticSwitchingScene.variables)


def _warnings(
    table: PeristalticSwitchingScene, limits: SwitchLimits, best: Optimum, found: Search
) -> Iterator[str]:
    yield from warnings_of_optimum(best, table.mesh.tolerance)
    if not found.complete:
        yield (
            f"{found.tried} orders of switching were tried, not all; write another search.starts "
            "or search.seed to try others"
        )
    low, high = limits.period
    if low < high and best.motion.duration > high * (1 - _REACHED):
        if high < table.limits.period[1]:
            yield f"periods above {high:.4g} were not tried: all lengths rest before they end"
        else:
            yield "the best period is the longest one allowed; limits.period may be too narrow"
    if low < high and best.motion.duration < low * (1 + _REACHED):
        yield "the best period is the shortest one allowed; limits.period may be too narrow"
