"""Run scenes of kind ``film-wave``: the best wave of a film of magnetic fluid."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import SceneError, SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.design.check import HELD, CosineBeside, Sampled, check_wave, cosine_beside
from wormopt.systems.film.design.search import DesignedWave, best_wave
from wormopt.systems.film.design.wave import WaveAim, WaveLimits, largest_flow
from wormopt.systems.film.lubrication import surface_velocity
from wormopt.systems.film.scenes.film_wave import FilmWaveScene, WaveMapTable
from wormopt.systems.shared.optimum import (
    optimum_facts,
    optimum_timings,
    refused,
    warnings_of_optimum,
)
from wormopt.systems.shared.proof import CrossCheck

_OTHERS = 401


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FilmWaveScene], report: Report) -> Result:
    """Find the best wave, and evaluate its shape by quadrature alone.

    The result is "failed" where that differs from the optimiser. Raises SceneError if no field can
    reach the aim, and SolveError if no wave is found.
    """
    table, begin = scene.table, time.perf_counter()
    given = table.limits
    least, most = given.thickness
    limits = WaveLimits(table.film.tension, (least, most), given.field, given.gradient)
    aim = WaveAim()  # what is sought first
    if table.aim.minimise:
        aim = WaveAim("field", table.aim.mean_flow, table.aim.capture)
    impossible = aim.out_of_reach(limits.thickness)
    if impossible:
        key = "aim.mean_flow" if aim.mean_flow is not None else "aim.capture"
        raise SceneError(scene.name, [(key, impossible)])
    try:
        waves, missed = _waves(table, limits, aim, report)
    except SolveError as error:
        raise refused(scene, error) from None
    solved = time.perf_counter()
    wave = waves[-1]
    shape, checks = check_wave(wave, aim)
    cosine = cosine_beside(limits, aim)
    swept = _sweep(table, table.map, limits, report) if table.map else {}
    return conclude(
        scene,
        _scalars(table, wave, shape, cosine),
        _variables(wave, shape, cosine) | swept,
        checks=checks,
        facts=_facts(waves, checks),
        warnings=[*missed, *_warnings(table, wave, shape, cosine)],
        timings={
            **optimum_timings(wave.stages),
            "optimise": solved - begin,
            "check": time.perf_counter() - solved,
        },
    )


def _waves(
    table: FilmWaveScene, limits: WaveLimits, aim: WaveAim, report: Report
) -> tuple[list[DesignedWave], list[str]]:
    """All waves found, the requested one last, and the reasons why later searches failed."""

    def best(aim: WaveAim, near: DesignedWave | None = None) -> DesignedWave:
        return best_wave(limits, aim, near=near, report=report, **_options(table))

    waves, missed = [best(aim)], list[str]()
    if table.aim.maximise != "float_speed":
        return waves, missed

    def add(what: str, aim: WaveAim) -> None:
        try:
            waves.append(best(aim, waves[-1]))
        except SolveError as error:
            missed.append(
                f"the search for the wave with {what} failed ({error.reason}): a float may be "
                "faster than on the reported wave"
            )

    def speed(wave: DesignedWave) -> float:
        return check_wave(wave, aim)[0].drift

    margin = check_wave(waves[0], aim)[0].margin
    if margin >= 0:
        return waves, missed
    # A wave with less flow may hold a float by a higher crest.
    add("the highest crest", WaveAim("margin"))
    margin = max(margin, check_wave(waves[-1], aim)[0].margin)
    if check_wave(waves[-1], aim)[0].margin >= 0:
        return waves, missed
    waves.sort(key=speed)
    add("the fastest float", WaveAim("drift", margin=margin))
    return sorted(waves, key=speed), missed


def _options(table: FilmWaveScene) -> dict[str, Any]:
    mesh = table.mesh
    return {
        "crests": table.search.crests,
        "mesh": Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme)),
        "tolerance": mesh.tolerance,
    }


# -- results ---------------------------------------------------------------------------------------


def _scalars(
    table: FilmWaveScene, wave: DesignedWave, shape: Sampled, cosine: CosineBeside
) -> dict[str, Any]:
    flow, most = 1 + shape.constant, largest_flow(wave.limits.thickness)
    if table.aim.minimise:
        gain = cosine.field_range / wave.field_range
    elif table.aim.maximise == "float_speed":
        gain = shape.drift / cosine.drift
    else:
        gain = flow / cosine.mean_flow
    return {
        "mean_flow": flow,
        "mean_flow_cosine": cosine.mean_flow,
        "mean_flow_supremum": most,
        "gap_to_supremum": most - flow,
        "gain": gain,
        "c_constant": shape.constant,
        "crests": wave.crests,
        "field_range": wave.field_range,
        "field_range_cosine": cosine.field_range,
        "cosine_delta": cosine.delta,
        "captured": shape.drift == 1.0,
        "float_drift": shape.drift,
        "float_drift_cosine": cosine.drift,
        "capture_margin": shape.margin,
        "thickness_min": float(shape.thickness.min()),
        "thickness_max": float(shape.thickness.max()),
        "plateau_share": _on_bounds(shape.thickness, wave.limits.thickness),
        "tension_number": wave.limits.tension,
        "thickness_limits": wave.limits.thickness,
        "field_limit": wave.limits.field,
        "n_phases": wave.repeats * wave.motion.mesh.phases,
        "defect_max": float(wave.optimum.defects.max()),
        "recheck_error": abs(flow - wave.mean_flow),
        "solve_iterations": sum(stage.iterations for stage in wave.stages.values()),
    }


def _on_bounds(h: np.ndarray, thickness: tuple[float, float]) -> float:
    """Share of the wave at a bound of the thickness."""
    near = 1e-6 * (thickness[1] - thickness[0])
    return float(np.mean((h <= thickness[0] + near) | (h >= thickness[1] - near)))


def _variables(wave: DesignedWave, shape: Sampled, cosine: CosineBeside) -> dict[str, np.ndarray]:
    xi = wave.instants()
    h = wave.thickness(xi)
    found = {
        "xi": xi,
        "height": h,
        "height_slope": wave.slope(xi),
        "field_pressure": wave.field(xi),
        "surface_velocity": surface_velocity(h, shape.constant),
    }
    if math.isnan(cosine.delta):
        return found
    xi, beside = np.linspace(0, 2 * math.pi, _OTHERS), CosineWave(cosine.delta)
    D = beside.field_function(xi, wave.limits.tension)
    return found | {
        "xi_cosine": xi,
        "height_cosine": beside.height(xi),
        "field_pressure_cosine": D.max() - D,
        "surface_velocity_cosine": surface_velocity(beside.height(xi), beside.constant),
    }


def _sweep(
    table: FilmWaveScene, sweep: WaveMapTable, limits: WaveLimits, report: Report
) -> dict[str, Any]:
    """Best flow of other films and fields; NaN where no wave is found."""
    assert limits.field is not None
    tensions, fields = sweep.tension or (limits.tension,), sweep.field or (limits.field,)
    found, cosine, crests = np.full((3, len(tensions), len(fields)), np.nan)
    for k, (i, j) in enumerate(np.ndindex(found.shape)):
        report(f"sweep: W = {tensions[i]:g}, field {fields[j]:g}", k / found.size)
        there = WaveLimits(tensions[i], limits.thickness, fields[j], limits.gradient)
        cosine[i, j] = CosineWave(there.cosine()).mean_flow
        try:
            wave = best_wave(there, WaveAim(), **_options(table))
        except SolveError:
            continue
        shape, checks = check_wave(wave, WaveAim())
        if all(check.passed for check in checks):
            found[i, j], crests[i, j] = 1 + shape.constant, wave.crests
    return {
        "sweep_tension": np.array(tensions),
        "sweep_field": np.array(fields),
        "sweep_mean_flow": found,
        "sweep_mean_flow_cosine": cosine,
        "sweep_crests": crests,
    }


# -- trust -----------------------------------------------------------------------------------------


def _facts(waves: list[DesignedWave], checks: tuple[Check, ...]) -> dict[str, Any]:
    wave, constant = waves[-1], checks[0]
    second = CrossCheck(
        "quadrature over the thickness alone", constant.value, constant.limit,
        "the equations of the film",
    )  # fmt: skip
    trust = optimum_facts(wave.stages, second)
    phased = "phases" in wave.stages
    trust["treatment"] = "phases between switches of the field" if phased else "fixed mesh"
    del trust["complementarity_max"]
    starts = [
        {"start": t.start, "crests": t.crests, "reached": t.reached}
        for each in waves
        for t in each.tries
    ]
    return {**trust, "accepted": {c.name: c.limit for c in checks}, "starts": starts}


def _warnings(
    table: FilmWaveScene, wave: DesignedWave, shape: Sampled, cosine: CosineBeside
) -> Iterator[str]:
    yield from warnings_of_optimum(wave.optimum, table.mesh.tolerance)
    if wave.crests >= table.search.crests and table.search.crests > 1:
        yield (
            f"the best wave has {wave.crests} crests, and the search begins with at most "
            f"{table.search.crests}; increase search.crests to check for better waves"
        )
    if -HELD <= shape.margin < HELD:
        yield (
            f"the wave barely holds a small float: capture_margin is {shape.margin:.2g}, and a "
            "disturbance may release it"
        )
    if wave.limits.gradient is not None and "phases" not in wave.stages:
        yield (
            "with a limited slope, the field of the exact optimum switches infinitely often before "
            "the film reaches a bound of its thickness; on this mesh it switches a few times"
        )
    if math.isnan(cosine.delta):
        yield "no cosine wave within the limits meets the requirements, so there is no comparison"
