"""Scenes of kind ``film-wave``: the best wave of a film of magnetic fluid, checked by its shape."""

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
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.design.search import DesignedWave, best_wave
from wormopt.systems.film.design.wave import WaveAim, WaveLimits
from wormopt.systems.film.limits import Sampled, fitting_cosine, largest_flow
from wormopt.systems.film.lubrication import surface_velocity
from wormopt.systems.film.runs.film_wave_check import (
    CosineBeside,
    check_wave,
    cosine_beside,
    faults_of_checks,
)
from wormopt.systems.film.scenes.film_wave import FilmWaveScene
from wormopt.systems.shared.optimum import (
    optimum_timings,
    optimum_trust,
    refused,
    warnings_of_optimum,
)
from wormopt.systems.shared.proof import Recheck

_OTHERS = 401


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FilmWaveScene], report: Report) -> Result:
    """Find the best wave, and say what its shape does by quadrature alone.

    Status "failed" where that differs from what the optimiser says. Raises SceneError if the
    aim is out of reach of any field, SolveError if no wave is found.
    """
    table, begin = scene.table, time.perf_counter()
    given = table.limits
    least, most = given.thickness
    limits = WaveLimits(table.film.tension, (least, most), given.field, given.gradient)
    aim = _aim(table)
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
    swept = _sweep(table, limits, report) if table.sweep else ()
    faults = faults_of_checks(checks)
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(table, wave, shape, cosine),
        variables=(*_variables(wave, shape, cosine), *swept),
        trust=_trust(table, waves, checks, cosine, missed),
        timings_s={
            **optimum_timings(wave.stages),
            "optimise": solved - begin,
            "check": time.perf_counter() - solved,
        },
        scene_text=scene.text,
    )


def _aim(table: FilmWaveScene) -> WaveAim:
    """What is sought first."""
    if table.aim.minimise:
        return WaveAim("field", table.aim.mean_flow, table.aim.capture)
    return WaveAim()


def _waves(
    table: FilmWaveScene, limits: WaveLimits, aim: WaveAim, report: Report
) -> tuple[list[DesignedWave], list[str]]:
    """Waves found on the way, the one sought last, and why later searches found none."""

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
                f"the search for the wave with {what} found none ({error.reason}): a float may go "
                "faster than on the wave told"
            )

    def speed(wave: DesignedWave) -> float:
        return check_wave(wave, aim)[0].drift

    margin = check_wave(waves[0], aim)[0].margin
    if margin >= 0:
        return waves, missed
    # a wave that carries less may hold a float by a higher crest
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


# -- what comes out --------------------------------------------------------------------------------


def _scalars(
    table: FilmWaveScene, wave: DesignedWave, shape: Sampled, cosine: CosineBeside
) -> dict[str, Scalar]:
    flow, most = 1 + shape.constant, largest_flow(wave.limits.thickness)
    if table.aim.minimise:
        gain = cosine.field_range / wave.field_range
    elif table.aim.maximise == "float_speed":
        gain = shape.drift / cosine.drift
    else:
        gain = flow / cosine.mean_flow
    return {
        "mean_flow": Scalar(flow),
        "mean_flow_cosine": Scalar(cosine.mean_flow),
        "mean_flow_supremum": Scalar(most),
        "gap_to_supremum": Scalar(most - flow),
        "gain": Scalar(gain),
        "c_constant": Scalar(shape.constant),
        "crests": Scalar(wave.crests),
        "field_range": Scalar(wave.field_range),
        "field_range_cosine": Scalar(cosine.field_range),
        "cosine_delta": Scalar(cosine.delta),
        "captured": Scalar(shape.drift == 1.0),
        "float_drift": Scalar(shape.drift),
        "float_drift_cosine": Scalar(cosine.drift),
        "capture_margin": Scalar(shape.margin),
        "thickness_min": Scalar(float(shape.thickness.min())),
        "thickness_max": Scalar(float(shape.thickness.max())),
        "plateau_share": Scalar(_on_bounds(shape.thickness, wave.limits.thickness)),
        "tension_number": Scalar(wave.limits.tension),
        "thickness_limits": Scalar(list(wave.limits.thickness)),
        "field_limit": Scalar(wave.limits.field),
        "n_phases": Scalar(wave.repeats * wave.motion.mesh.phases),
        "defect_max": Scalar(float(wave.optimum.defects.max())),
        "recheck_error": Scalar(abs(flow - wave.mean_flow)),
        "solve_iterations": Scalar(sum(stage.iterations for stage in wave.stages.values())),
    }


def _on_bounds(h: np.ndarray, thickness: tuple[float, float]) -> float:
    """Share of the wave that lies at a bound of the thickness."""
    near = 1e-6 * (thickness[1] - thickness[0])
    return float(np.mean((h <= thickness[0] + near) | (h >= thickness[1] - near)))


def _variables(wave: DesignedWave, shape: Sampled, cosine: CosineBeside) -> list[Variable]:
    xi = wave.instants()
    h = wave.thickness(xi)
    columns = {
        "height": (h, "thickness over its mean"),
        "height_slope": (wave.slope(xi), "slope of the thickness by the phase"),
        "field_pressure": (wave.field(xi), "field (mu - 1) H^2 / (8 pi), least"),
        "surface_velocity": (
            surface_velocity(h, shape.constant),
            "velocity of the surface over that of the wave",
        ),
    }
    found = [Variable("xi", "rad", ("xi",), xi, "phase t - x")]
    found += [Variable(name, "1", ("xi",), *values) for name, values in columns.items()]
    return [*found, *_cosine_variables(cosine, wave.limits.tension)]


def _cosine_variables(cosine: CosineBeside, tension: float) -> Iterator[Variable]:
    if math.isnan(cosine.delta):
        return
    xi, beside = np.linspace(0, 2 * math.pi, _OTHERS), CosineWave(cosine.delta)
    h = np.asarray(beside.height(xi))
    D = np.asarray(beside.field_function(xi, tension))
    speed = surface_velocity(h, beside.constant)
    yield Variable("xi_cosine", "rad", ("xi_cosine",), xi, "phase t - x")
    for name, values, what in (
        ("height_cosine", h, "thickness of the cosine wave"),
        ("field_pressure_cosine", D.max() - D, "its least field (mu - 1) H^2 / (8 pi)"),
        ("surface_velocity_cosine", speed, "velocity of its surface"),
    ):
        yield Variable(name, "1", ("xi_cosine",), values, what)


def _sweep(table: FilmWaveScene, limits: WaveLimits, report: Report) -> list[Variable]:
    """Best flow of other films and fields; NaN where no wave is found."""
    assert table.sweep is not None
    assert limits.field is not None
    tensions = table.sweep.tension or (limits.tension,)
    fields = table.sweep.field or (limits.field,)
    names = ("sweep_mean_flow", "sweep_mean_flow_cosine", "sweep_crests")
    found = np.full((3, len(tensions), len(fields)), np.nan)
    for k, (i, j) in enumerate(np.ndindex(len(tensions), len(fields))):
        report(f"sweep: W = {tensions[i]:g}, field {fields[j]:g}", k / found[0].size)
        there = WaveLimits(tensions[i], limits.thickness, fields[j], limits.gradient)
        gradient = math.inf if limits.gradient is None else limits.gradient
        delta = fitting_cosine(tensions[i], limits.thickness, fields[j], gradient)
        found[1, i, j] = CosineWave(delta).mean_flow
        try:
            wave = best_wave(there, WaveAim(), **_options(table))
        except SolveError:
            continue
        shape, checks = check_wave(wave, WaveAim())
        if not faults_of_checks(checks):
            found[0, i, j], found[2, i, j] = 1 + shape.constant, wave.crests
    words = ("largest mean flow", "mean flow of the cosine wave", "crests of the best wave")
    dims = ("sweep_tension", "sweep_field")
    return [
        Variable(dims[0], "1", dims[:1], np.array(tensions), "number W of surface tension"),
        Variable(dims[1], "1", dims[1:], np.array(fields), "largest range of the field"),
        *(Variable(n, "1", dims, v, w) for n, v, w in zip(names, found, words, strict=True)),
    ]


# -- trust -----------------------------------------------------------------------------------------


def _trust(
    table: FilmWaveScene,
    waves: list[DesignedWave],
    checks: dict[str, tuple[float, float]],
    cosine: CosineBeside,
    missed: list[str],
) -> dict[str, Any]:
    wave = waves[-1]
    error, accepted = checks["C by quadrature"]
    second = Recheck(
        "quadrature over the thickness alone", error, accepted, "the equations of the film"
    )
    trust = optimum_trust(wave.stages, second, [*missed, *_warnings(table, wave, cosine)])
    phased = "phases" in wave.stages
    trust["treatment"] = "phases between switches of the field" if phased else "fixed mesh"
    del trust["complementarity_max"]
    return {
        **trust,
        "checks": {name: value for name, (value, _) in checks.items()},
        "accepted": {name: most for name, (_, most) in checks.items()},
        "starts": [
            {"start": t.start, "crests": t.crests, "reached": t.reached}
            for each in waves
            for t in each.tries
        ],
    }


def _warnings(table: FilmWaveScene, wave: DesignedWave, cosine: CosineBeside) -> Iterator[str]:
    yield from warnings_of_optimum(wave.optimum, table.mesh.tolerance)
    if wave.crests >= table.search.crests and table.search.crests > 1:
        yield (
            f"the best wave has {wave.crests} crests and the search began with "
            f"{table.search.crests} at most; raise search.crests to see whether more are better"
        )
    if wave.limits.gradient is not None and "phases" not in wave.stages:
        yield (
            "under a bounded slope the field switches without end before the film rests at a bound "
            "of its thickness; on this mesh it does so a few times"
        )
    if math.isnan(cosine.delta):
        yield "no cosine wave between these limits does what is asked, so that none is compared"
