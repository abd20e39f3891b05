"""Runs of kind ``coil-inverse``: currents of a row of coils for the field that a wave needs."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.magnetics.coils import CoilRow, field_by_quadrature
from wormopt.magnetics.travelling import MovingProfile, moving_profile
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.row_currents import RowFit, TravellingTarget, fit_currents
from wormopt.systems.coils.runs.coil_row import (
    ACCEPTED,
    in_the_frame,
    interior,
    row_of,
    sizes,
    warnings_of_coils,
)
from wormopt.systems.coils.scenes.coil_rows import CoilInverseScene
from wormopt.systems.film import CarriedFilm, CosineWave, Fluid, carried_film
from wormopt.systems.shared.optimum import refused

# Refinement of the check's grid, in places and in phases.
_FINER = 4
_POINTS, _SAMPLES = 3, 201
# Difference of residuals above which starts count as different optima.
_SPREAD = 1e-3
_VIOLATION = 1e-7
# Largest residual of Newton's method of a converged film.
_SOLVED = 1e-6
# Residuals above which the field differs much from the wanted one, or is worse than a constant.
_POOR, _WORSE = 0.5, 1.0


@dataclass(frozen=True, eq=False)
class CurrentsFound:
    """Results of a scene of kind ``coil-inverse``."""

    row: CoilRow
    fluid: Fluid  # the film
    wave: CosineWave  # wanted wave of the film
    target: TravellingTarget  # field needed for the wave
    fit: RowFit  # currents found
    profile: MovingProfile  # resulting field, on a finer grid

    @property
    def pressure(self) -> np.ndarray:
        """Return (mu - 1) H² / (8 pi) of the mean in the wave's frame, in units of the film's P."""
        return self.profile.mean / _square_unit(self.fluid)

    @property
    def wanted(self) -> np.ndarray:
        """Return the wanted H² at the phases of the profile, in A²/m²."""
        return self.fit.square - self.target.function(self.profile.xi)


def run(scene: Scene[CoilInverseScene], report: Report) -> Result:
    """Find currents, evaluate the resulting field, and check it by a second route.

    Status "failed" if quadrature finds another field, or a bound is violated. Raises SceneError if
    the given field is below the least needed, SolveError if no start succeeds.
    """
    table, begin = scene.table, time.perf_counter()
    try:
        found = find_currents(scene, report)
    except SolveError as error:
        raise refused(scene, error) from None
    done = time.perf_counter()
    report("second route", 0.9)
    recheck, excess = _recheck(found, table.line.height), _excess(found, table)
    film = carried_film(found.wave, found.pressure, found.fluid.tension)
    residual = film.residual if film else None
    if residual is not None and not residual <= _SOLVED:
        film = None
    error, solution = recheck["error"], found.fit.solution
    return conclude(
        scene,
        _scalars(found, film) | sizes(table),
        _variables(found, film),
        checks=[
            Check(
                "field by quadrature",
                error,
                ACCEPTED,
                f"H² by quadrature differs by {error:.2g} of the largest",
            ),
            Check(
                "bounds of the currents",
                excess,
                _VIOLATION,
                f"currents exceed their bounds by {excess:.2g} of these",
            ),
        ],
        facts={
            "solver": {
                name: getattr(solution, name) for name in ("status", "success", "iterations")
            },
            "violation": solution.violation,
            "bound_violation": excess,
            "recheck": recheck,
            "film_residual": residual,
            "film_accepted": _SOLVED,
            "starts": list(found.fit.starts),
        },
        warnings=(*_warnings(found, table), *_film_warnings(found, film, residual)),
        timings={"optimise": done - begin, "recheck": time.perf_counter() - done},
    )


def find_currents(scene: Scene[CoilInverseScene], report: Report) -> CurrentsFound:
    """Return the currents of a scene and the field in the film, without a `Result`.

    `CurrentsFound.pressure` has the field, its profile the ripple. Raises SceneError if the
    given field is below the least needed, SolveError if no start succeeds.
    """
    table = scene.table
    row, film = row_of(table.coils), table.film
    fluid = Fluid(
        film.mu_r, film.viscosity, film.density, film.surface_tension, film.depth,
        table.wave.wavelength, table.wave.frequency,
    )  # fmt: skip
    wave = CosineWave(table.wave.delta)
    try:
        target = _target(fluid, wave, table.wave.field)
    except ArgumentError as error:
        raise SceneError(
            scene.name, [("wave.field", f"{error}; write at least that, or leave it out")]
        ) from None
    search, z = table.search, table.line.height
    fit = fit_currents(
        row,
        target,
        interior(row, table.line, search.places),
        z,
        nodes=search.nodes,
        slew=table.limits.slew,
        polarity=table.limits.polarity,
        starts=search.starts,
        seed=search.seed,
        report=report,
    )
    profile = moving_profile(
        row,
        fit.course,
        interior(row, table.line, _FINER * search.places),
        z,
        wavelength=target.wavelength,
        period=target.period,
        phases=_FINER * search.nodes,
    )
    return CurrentsFound(row, fluid, wave, target, fit, profile)


def _square_unit(fluid: Fluid) -> float:
    """Return H² with the pressure P, in A²/m²."""
    return float(fluid.field(1.0)) ** 2


def _target(fluid: Fluid, wave: CosineWave, field: float | None) -> TravellingTarget:
    unit, tension = _square_unit(fluid), fluid.tension
    return TravellingTarget(
        lambda xi: unit * np.asarray(wave.field_function(xi, tension)),
        unit * wave.peak(tension).value,
        fluid.wavelength,
        2 * math.pi / fluid.frequency,
        None if field is None else field**2,
    )


def _recheck(found: CurrentsFound, z: float) -> dict[str, Any]:
    """Return H² at a few places and times by quadrature of the Biot-Savart law."""
    share = (np.arange(_POINTS) * 0.6180339887 + 0.1) % 1.0
    places = found.profile.places
    x = places[0] + (places[-1] - places[0]) * share
    t = found.fit.course.period * share[::-1]
    currents = found.fit.course(t)
    second = np.sum(field_by_quadrature(found.row, x, z, currents) ** 2, axis=0)
    formula = np.einsum("cmk,km->cm", found.row.influence(x, z), currents)
    error = float(np.max(np.abs(np.sum(formula**2, axis=0) - second)))
    phase = 2 * np.pi * (t / found.target.period - x / found.target.wavelength)
    wanted = found.fit.square - found.target.function(phase)
    off = np.sqrt(np.mean((second - wanted) ** 2)) / np.std(found.wanted)
    largest = float(found.profile.square.max())
    return {
        "error": error / largest if largest else 0.0,
        "accepted": ACCEPTED,
        "points": _POINTS,
        "field_residual_there": float(off),
    }


def _slew(found: CurrentsFound) -> float:
    return float(np.max(np.abs(found.fit.course.polynomial[:, :, 1])))


def _excess(found: CurrentsFound, table: CoilInverseScene) -> float:
    """Return the largest violation of bounds by the waveform itself, over the bound."""
    ends = found.fit.course(found.fit.course.breaks[:-1])
    excess = np.max(np.abs(ends)) / table.coils.ampere_turns - 1
    if table.limits.slew is not None:
        excess = max(excess, _slew(found) / table.limits.slew - 1)
    if table.limits.polarity == "one":
        excess = max(excess, -ends.min() / table.coils.ampere_turns)
    return max(float(excess), 0.0)


def _scalars(found: CurrentsFound, film: CarriedFilm | None) -> dict[str, Any]:
    fit, target, profile = found.fit, found.target, found.profile
    largest = float(np.max(np.abs(fit.nodes)))
    off = profile.mean - found.wanted
    return {
        "field_residual": profile.residual(found.wanted),
        "field_residual_mean": float(np.sqrt(np.mean(off**2)) / np.std(found.wanted)),
        "field_residual_program": fit.residual,
        "ripple": profile.ripple,
        "H0": math.sqrt(fit.square),
        "H0_least": math.sqrt(target.least_square),
        "field_max": math.sqrt(float(profile.square.max())),
        "currents_max": largest,
        "currents_share": largest / found.row.coil.ampere_turns,
        "slew_max": _slew(found),
        "wavelength": target.wavelength,
        "period": target.period,
        "wave_speed": target.wavelength / target.period,
        "pressure_unit": found.fluid.pressure,
        "tension_number": found.fluid.tension,
        "eps": found.fluid.eps,
        "mean_flow": found.wave.mean_flow,
        "film_distance": film.distance if film else None,
        "film_mean_flow": film.mean_flow if film else None,
        "film_growth_rate": film.growth if film else None,
    }


def _variables(found: CurrentsFound, film: CarriedFilm | None) -> dict[str, np.ndarray]:
    course = found.fit.course
    t = np.linspace(0.0, course.period, _SAMPLES)
    told = in_the_frame(found.profile) | {
        "square_target": found.wanted,
        "pressure_mean": found.pressure,
        "time": t,
        "current": course(t),
        "gait_breaks": course.breaks,
        "gait_polynomial": course.polynomial,
    }
    return told | ({"film_phase": film.xi, "film_thickness": film.thickness} if film else {})


def _warnings(found: CurrentsFound, table: CoilInverseScene) -> Iterator[str]:
    fit, limit = found.fit, table.coils.ampere_turns
    yield from found.fluid.warnings()
    largest = float(np.max(np.abs(fit.nodes)))
    yield from warnings_of_coils(table.coils, largest)
    if largest > limit * (1 - 1e-6):
        yield (
            f"currents are at the limit of {limit:g} ampere-turns of the coils; a higher limit, or "
            "a wave that needs less field, reduces the residual"
        )
    solved = [start["residual"] for start in fit.starts if isinstance(start["residual"], float)]
    if max(solved) > min(solved) * (1 + _SPREAD):
        yield f"starts ended at residuals from {min(solved):.4g} to {max(solved):.4g}"
    finer = found.profile.residual(found.wanted)
    yield from _poor(finer)
    if finer > 1.1 * fit.residual:
        yield (
            f"on a finer grid the residual is {finer:.4g} instead of {fit.residual:.4g}; write "
            "more search.nodes or search.places"
        )


def _poor(residual: float) -> Iterator[str]:
    remedy = "write more ampere-turns, a smaller wave or other coils to reduce it"
    if not residual < _WORSE:
        yield (
            f"the field is worse than a constant field: field_residual is {residual:.3g}; " + remedy
        )
    elif residual > _POOR:
        yield f"the field is far from the wanted one: field_residual is {residual:.3g}; {remedy}"


def _film_warnings(
    found: CurrentsFound, film: CarriedFilm | None, residual: float | None
) -> Iterator[str]:
    if film is None and residual is not None:
        yield (
            f"the resulting film is unknown: Newton's method left a residual of {residual:.2g}, "
            f"but {_SOLVED:g} is accepted"
        )
        return
    if film is None:
        yield "no steady film was found near the wave under the resulting field"
        return
    if film.growth > 0:
        yield f"the resulting film is unstable: deviations grow at the rate {film.growth:.3g}"
    if film.distance > 0.5 * found.wave.delta:
        yield (
            f"the resulting film differs from the wave by {film.distance:.3g} of the mean "
            f"thickness; the wave's amplitude is {found.wave.delta:g}"
        )
    yield "the film is computed with the mean field in the wave's frame; its ripple is neglected"
