"""Runs of kind ``coil-design``: design currents, and compare them with blocks and mean field."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.numerics.workers import Workers
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.cargo import Float
from wormopt.systems.coils.design.pattern import Copper, Pattern
from wormopt.systems.coils.design.recheck import travel_by_radau
from wormopt.systems.coils.design.rides import Rides
from wormopt.systems.coils.design.rivals import rivals
from wormopt.systems.coils.design.search import Budget, Found, neighbours, search, starts_of
from wormopt.systems.coils.design.task import Judged, Task, best
from wormopt.systems.coils.runs import cargo
from wormopt.systems.coils.runs.coil_film import Setup, layer_of
from wormopt.systems.coils.runs.coil_row import row_of, warnings_of_coils
from wormopt.systems.coils.scenes.coil_design import CoilDesignScene
from wormopt.systems.shared.optimum import refused

ACCEPTED = {
    "smaller steps": 1e-2,
    "second integrator": 1e-2,
    "volume": 1e-10,
    "limits": 1 + 1e-9,
    "neighbours": 0.05,
}
"""Accepted errors over the float's length, the volume, current limits, and the objective."""
SORTS = ("design", "block", "wave")
"""Sorts of currents whose best ones are compared."""
_FINE = 1e-4  # tolerance on the fine grid that distinguishes candidates
# Factors on the rates from the coarse grid that are also tried on the fine grid, because it loses
# floats at other rates.
_RATES = (1.03, 1.0, 0.97, 0.93, 0.88, 0.82)
_MARGIN = 1.02  # over the required speed, during the search
_NEIGHBOUR = 0.05
_ADVICE = "raise film.top, grid.cells or fluid.viscosity, or lower coils.ampere_turns"


@dataclass(frozen=True, eq=False)
class Contest:
    """The design and the best rival of each sort, on the fine grid."""

    design: Judged
    block: Judged
    wave: Judged
    tuned: list[Judged]  # all rivals, on the search grid
    searches: list[Found]


def run(scene: Scene[CoilDesignScene], report: Report) -> Result:
    """Tune the rivals, search, and simulate the best of each sort in full.

    Status "failed" if routes differ, limits are violated or a rival is better. Raises SceneError if
    a winding is too near, SolveError if no rival carries the float.
    """
    table, begin = scene.table, time.perf_counter()
    task, workers = task_of(scene), Workers()
    try:
        contest = design(scene, task, workers, report)
        searched = time.perf_counter()
        report("full simulation", 0.9)
        found = _followed(scene, task, contest, report)
    except SolveError as error:
        raise refused(scene, error) from None
    layer, body = _finer(scene, task).layer, task.rides.cargo
    off = _off(scene, task, contest, found, workers)
    done = time.perf_counter()
    scalars = _scalars(scene, task, contest, found.motions)
    scalars |= {"neighbour_gain": off["neighbours"]}
    scalars |= cargo.scalars_of(layer, body, found.motions["design"], found.rough)
    return conclude(
        scene,
        scalars,
        _variables(task, contest, found.motions),
        checks=[*_checks(task, scalars, off), *cargo.checks_of(scalars, body, layer)],
        facts=_facts(contest, task),
        warnings=_warnings(table, body, scalars, contest),
        timings={"search": searched - begin, "recheck": done - searched},
        attributes={"float": {"length": table.cargo.length, "thickness": table.cargo.thickness}},
    )


@dataclass(frozen=True, eq=False)
class Followed:
    """Motions from `simulate`."""

    motions: dict[str, Trajectory]  # of the best of each sort
    rough: Trajectory  # the design on half the cells
    close: Trajectory  # the same with smaller steps


def _followed(
    scene: Scene[CoilDesignScene], task: Task, contest: Contest, report: Report
) -> Followed:
    cells, tolerance = scene.table.grid.cells, scene.table.grid.tolerance
    motions = {
        sort: _follow(scene, task, getattr(contest, sort).pattern, cells, tolerance, report)
        for sort in SORTS
    }
    pattern, half = contest.design.pattern, cells // 2
    rough = _follow(scene, task, pattern, half, tolerance, report)
    close = _follow(scene, task, pattern, half, tolerance / 10, report)
    return Followed(motions, rough, close)


def _off(
    scene: Scene[CoilDesignScene], task: Task, contest: Contest, found: Followed, workers: Workers
) -> dict[str, float]:
    """Return errors against other routes, excess of limits, and the best neighbour's gain."""
    pattern, motion, length = (
        contest.design.pattern,
        found.motions["design"],
        task.rides.cargo.length,
    )
    travel = motion["position"][0, -1] - task.rides.start
    change = found.close["position"][0, -1] - found.rough["position"][0, -1]
    second = travel_by_radau(_finer(scene, task), pattern)
    here = task.judge(("design", pattern))
    return {
        "smaller steps": abs(change) / length,
        "second integrator": abs(second - travel) / length,
        "volume": np.abs(motion["thickness"].mean(axis=0) / task.rides.layer.depth - 1).max(),
        "limits": _limits(scene, pattern),
        "neighbours": _gain(task, here, best(neighbours(task, pattern, _NEIGHBOUR, workers))),
    }


def task_of(scene: Scene[CoilDesignScene]) -> Task:
    """Return the task of a scene, on the grid of its search."""
    table = scene.table
    row = row_of(table.coils)
    layer = layer_of(table, row, table.search.cells)
    body = cargo.float_of(table.cargo, layer)
    low, high = table.pattern.rate
    rides = Rides(
        layer, row, table.film.ground,
        table.film.top * table.film.depth, table.film.own_field, body, table.cargo.start,
        table.course.time,
    )  # fmt: skip
    return Task(
        rides, Copper(table.copper.resistivity, table.copper.fill), table.aim.seek,
        table.pattern.form, table.pattern.per_step, (low, high), table.aim.speed,
        table.pattern.slew,
    )  # fmt: skip


def design(scene: Scene[CoilDesignScene], task: Task, workers: Workers, report: Report) -> Contest:
    """Tune the rivals, search from the best, and choose the best of each sort on the fine grid."""
    table, wanted = scene.table, task.speed
    sought = task if wanted is None else replace(task, speed=_MARGIN * wanted)
    report("blocks and waves", 0.0)
    try:
        tuned = rivals(sought, table.pattern.repeats, workers)
    except ArgumentError as error:
        raise SceneError(scene.name, [("film.ground", str(error))]) from None
    if {one.name for one in tuned if np.isfinite(one.speed)} != {"block", "wave"}:
        reason = "no block of coils, or no mean-field wave, can be simulated to the end"
        raise SolveError(reason, _ADVICE, code="not_solved")
    one = table.search
    budget = Budget(one.starts, one.generations, one.size, one.seed)
    searches = search(sought, starts_of(tuned, one.starts), budget, workers, report)
    found = [*tuned, *(replace(each.end, name="design") for each in searches)]
    jobs = [(each.name, each.pattern.paced(r, task.rates)) for each in found for r in _RATES]
    report("the best on the fine grid", 0.8)
    fine = replace(task, rides=_finer(scene, task))
    judged = list(workers.map(fine.judge, jobs))
    block, wave = (best(each for each in judged if each.name == sort) for sort in SORTS[1:])
    # blocks and waves are patterns too: if nothing improves on one, it is the design
    winner = replace(best(judged), name="design")
    return Contest(winner, block, wave, tuned, searches)


def _finer(scene: Scene[CoilDesignScene], task: Task) -> Rides:
    """Return rides on the fine grid."""
    layer = layer_of(scene.table, task.rides.row, scene.table.grid.cells)
    return replace(task.rides, layer=layer, tolerance=_FINE)


def _follow(
    scene: Scene[CoilDesignScene],
    task: Task,
    pattern: Pattern,
    per_pitch: int,
    tolerance: float,
    report: Report,
) -> Trajectory:
    """Simulate film and float with `simulate`."""
    rides, table = task.rides, scene.table
    layer = layer_of(table, rides.row, per_pitch)
    setup = Setup(
        layer, rides.row, pattern.course(rides.row.count), rides.ground, rides.top,
        rides.own_field, rides.cargo, rides.start, rides.time,
        np.linspace(0.0, rides.time, table.course.samples),
    )  # fmt: skip
    try:
        return setup.follow(tolerance, report)
    except SolveError as error:
        raise SolveError(error.reason, _ADVICE, code=error.code) from None


def _speed(motion: Trajectory, begin: int = 0) -> float:
    X, t = motion["position"][0], motion.time
    return float((X[-1] - X[begin]) / (t[-1] - t[begin]))


def _gain(task: Task, here: Judged, other: Judged) -> float:
    """Return the relative gain of another pattern, in speed or in power."""
    gain = max(other.value - here.value, 0.0)
    return float(gain / here.speed if task.seek == "speed" else gain)


def _limits(scene: Scene[CoilDesignScene], pattern: Pattern) -> float:
    """Return the largest current and slope over their limits, from all pieces of the Gait."""
    table = scene.table
    course = pattern.course(table.coils.count)
    lengths = np.diff(course.breaks)[:, None]
    begin, slope = course.polynomial[:, :, 0], course.polynomial[:, :, 1]
    largest = max(np.abs(begin).max(), np.abs(begin + slope * lengths).max())
    found = largest / table.coils.ampere_turns
    if table.pattern.slew is not None:
        found = max(found, np.abs(slope).max() / table.pattern.slew)
    return float(found)


def _scalars(
    scene: Scene[CoilDesignScene], task: Task, contest: Contest, motions: dict[str, Trajectory]
) -> dict[str, Any]:
    speed = {sort: _speed(motion) for sort, motion in motions.items()}
    power = {sort: getattr(contest, sort).power for sort in motions}
    pattern, h = contest.design.pattern, motions["design"]["thickness"]
    return {
        "late_speed": _speed(motions["design"], len(motions["design"].time) // 2),
        "mean_field_speed": speed["wave"],
        "block_speed": speed["block"],
        "over_mean_field": _over(task, speed, power, "wave"),
        "over_block": _over(task, speed, power, "block"),
        "power": power["design"],
        "mean_field_power": power["wave"],
        "block_power": power["block"],
        "resistance": task.copper.resistance(task.rides.row),
        "rate": pattern.rate,
        "repeat": pattern.repeat,
        "wave_speed": pattern.rate * scene.table.coils.pitch,
        "currents_max": pattern.largest,
        "slew_max": pattern.slew if np.isfinite(pattern.slew) else None,
        "thickness_max": float(h.max()),
        "thickness_min": float(h.min()),
    }


def _over(task: Task, speed: dict[str, float], power: dict[str, float], sort: str) -> float | None:
    """Return the relative gain of the design; unknown against a rival that is too slow."""
    if task.seek == "speed":
        return speed["design"] / speed[sort] - 1
    assert task.speed is not None
    return None if speed[sort] < 0.99 * task.speed else 1 - power["design"] / power[sort]


def _variables(task: Task, contest: Contest, motions: dict[str, Trajectory]) -> dict[str, Any]:
    motion, course = motions["design"], contest.design.pattern.course(task.rides.row.count)
    cells = motion["thickness"].shape[0]
    found = {
        "time": motion.time,
        "x": replace(task.rides.layer, cells=cells).places,
        "thickness": motion["thickness"].T,
        "coil_place": task.rides.row.places,
        "current": course(np.mod(motion.time, course.period)).T,
        "float_position": motion["position"][0],
        "pattern": contest.design.pattern.values,
    }
    for sort, name in (("wave", "mean_field"), ("block", "block")):
        found[f"{name}_pattern"] = getattr(contest, sort).pattern.values
        found[f"{name}_time"] = motions[sort].time
        found[f"{name}_position"] = motions[sort]["position"][0]
    return found


def _checks(task: Task, scalars: dict[str, Any], off: dict[str, float]) -> Iterator[Check]:
    advice = {
        "smaller steps": "smaller steps change the float's end by {:.2g} of its length; lower "
        "grid.tolerance",
        "second integrator": "with SciPy's Radau the float ends {:.2g} of its length elsewhere; "
        "lower grid.tolerance",
        "volume": "{:.2g} of the volume is lost",
        "limits": "currents reach {:.4g} of a limit",
        "neighbours": "a neighbouring pattern is better by {:.2g}; raise search.generations",
    }
    for name, accepted in ACCEPTED.items():
        value = float(off[name])
        yield Check(name, value, accepted, advice[name].format(value))
    if task.speed is not None:
        short = max(1 - scalars["float_speed"] / task.speed, 0.0)
        yield Check(
            "speed kept", short, 0.01,
            f"the float is slower than aim.speed by {short:.2g}; lower aim.speed, or raise "
            "coils.ampere_turns or the rates",
        )  # fmt: skip
    high = scalars["thickness_max"]
    yield Check(
        "top", high, task.rides.top,
        f"the film reaches a thickness of {high:.3g} m, above film.top times film.depth; raise "
        "film.top",
    )  # fmt: skip


def _facts(contest: Contest, task: Task) -> dict[str, Any]:
    def told(one: Judged) -> dict[str, Any]:
        return {
            "sort": one.name, "repeat": one.pattern.repeat, "rate": one.pattern.rate,
            "speed": one.speed, "power": one.power,
        }  # fmt: skip

    return {
        "rivals": [told(one) for one in contest.tuned],
        "searches": [{"start": told(one.start), "end": told(one.end)} for one in contest.searches],
        "search_cells": task.rides.layer.cells,
    }


def _warnings(
    table: CoilDesignScene, body: Float, scalars: dict[str, Any], contest: Contest
) -> Iterator[str]:
    yield "the optimum is local: better currents may exist"
    yield (
        f"power is that of the wire alone, with assumed resistivity {table.copper.resistivity:g} "
        f"ohm m and fill {table.copper.fill:g}"
    )
    yield from warnings_of_coils(table.coils, scalars["currents_max"])
    yield from cargo.warnings_of(table.cargo, table.film, body, scalars)
    wall = (table.coils.count - 1) * table.coils.pitch + table.film.overhang
    if table.cargo.start + scalars["float_travel"] > wall - table.cargo.length:
        yield "the wall stops the float near it; write more coils, or a shorter course.time"
    for sort in (contest.block, contest.wave):
        if sort.pattern is contest.design.pattern:
            yield f"no search improved on the best {sort.name}, so this is the design"
    ends = [one.end.value for one in contest.searches]
    if len(ends) > 1 and abs(ends[0] - ends[-1]) > 0.01 * abs(ends[0]):
        yield "searches from different starts ended in different optima"
    low, high = table.pattern.rate
    if not 1.01 * low < scalars["rate"] < 0.99 * high:
        yield f"the rate is at an end of pattern.rate: {scalars['rate']:.3g}; widen it"
