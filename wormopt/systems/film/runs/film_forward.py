"""Scenes of kind ``film-forward``: the wave a film takes under a given travelling field."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.film.runs.film_basins import Basins, basins, basins_scalars, basins_variables
from wormopt.systems.film.runs.film_branches import (
    Waves,
    branch_scalars,
    branch_variables,
    follow_waves,
)
from wormopt.systems.film.runs.film_courses import Course, Setting, Steady, flow, follow
from wormopt.systems.film.runs.film_fields import GivenField, WaveField, field_of_scene
from wormopt.systems.film.runs.film_flow import fluid_of, wave_of
from wormopt.systems.film.runs.film_resolution import Resolved, resolved
from wormopt.systems.film.scenes.film_forward import FilmForwardScene, StartTable
from wormopt.systems.film.shapes import Wave, grid
from wormopt.systems.film.thin_film import film_volume

# Volume that may be lost, residual of steady films, what a tighter integrator may change.
_VOLUME, _RESIDUAL, _STEPS = 1e-12, 1e-6, 1e-5
# Shares of the field that the points may leave out before it is told.
_LEFT_OUT = 1e-6
# Eigenvalues that are kept.
_MODES = 24


@dataclass(frozen=True, eq=False)
class _Found:
    """All that was computed."""

    setting: Setting
    field: WaveField | GivenField
    wave: Wave | None
    tension: float
    resolved: Resolved
    tighter: Course | None
    waves: Waves | None
    basins: Basins | None

    @property
    def course(self) -> Course:
        return self.resolved.course

    @property
    def changed(self) -> float | None:
        """What a hundredth of the tolerances changes at the end."""
        one, other = self.course, self.tighter
        if other is None or one.outcome != other.outcome or one.outcome == "unresolved":
            return None
        if one.broke is not None and other.broke is not None:
            return abs(one.broke[0] - other.broke[0])
        return float(np.abs(one.thickness[:, -1] - other.thickness[:, -1]).max())


def run(scene: Scene[FilmForwardScene], report: Report) -> Result:
    """Follow a film in time, tell where it goes and what is stable.

    Status "failed" where points do not suffice, or a check fails. Raises SceneError for an
    impossible field, wave or start, SolveError if the allowed steps do not suffice.
    """
    table, begin = scene.table, time.perf_counter()
    fluid = fluid_of(table.film)
    tension = fluid.tension if fluid else table.film.tension or 0.0
    wave = wave_of(scene, table.film) if table.has_wave else None
    field = field_of_scene(scene, wave, tension)
    setting = _setting(scene, field, wave, tension)
    found = resolved(setting, report)
    followed = time.perf_counter()
    tighter = None
    if table.tolerance.recheck:
        closer = replace(setting, tolerance=_closer(table.tolerance))
        tighter = follow(closer, found.course.points, report)
    rechecked = time.perf_counter()
    waves = None
    if table.branch is not None:
        waves = follow_waves(table.branch, table.grid.order, tension, found.course, report)
    branched = time.perf_counter()
    all_ = _Found(
        setting, field, wave, tension, found, tighter, waves,
        None if table.map is None else basins(table.map, setting, report),
    )  # fmt: skip
    faults = [*_faults(all_)]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=table.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(all_),
        variables=(*_variables(all_),),
        trust=_trust(all_),
        timings_s={
            "film": followed - begin,
            "recheck": rechecked - followed,
            "branch": branched - rechecked,
            "map": time.perf_counter() - branched,
        },
        scene_text=scene.text,
    )


def _closer(tolerance: Any) -> Any:
    values = {name: getattr(tolerance, name) for name in tolerance.__struct_fields__}
    values["relative"] = max(values["relative"] / 100, 1e-13)
    values["absolute"] /= 100
    return type(tolerance)(**values)


def _setting(
    scene: Scene[FilmForwardScene],
    field: WaveField | GivenField,
    wave: Wave | None,
    tension: float,
) -> Setting:
    table = scene.table
    start = _Start(table.start, wave)
    try:
        h = start(grid(table.grid.points))
        if h.min() <= 0:
            raise ArgumentError("the thickness must be above 0 everywhere")  # noqa: TRY301
        film_volume(h, order=table.grid.order)
    except ArgumentError as error:
        key = "start.samples" if table.start.shape == "samples" else "start.nudge"
        raise SceneError(scene.name, [(key, str(error))]) from None
    height = None if wave is None else wave.height
    return Setting(
        field.slope, tension, start, height, table.course, table.grid, table.tolerance
    )  # fmt: skip


class _Start:
    """Thickness at time 0 over the phase."""

    def __init__(self, table: StartTable, wave: Wave | None) -> None:
        self.table, self.wave = table, wave

    def __call__(self, xi: np.ndarray) -> np.ndarray:
        h = np.ones(len(xi))
        if self.table.shape == "wave" and self.wave is not None:
            h = np.asarray(self.wave.height(xi))
        elif self.table.samples is not None:
            h = _resampled(np.array(self.table.samples), len(xi))
        return h + self.table.nudge * np.cos(self.table.harmonic * xi)


def _resampled(samples: np.ndarray, points: int) -> np.ndarray:
    """Trigonometric polynomial through samples, at other points."""
    kept = min((len(samples) - 1) // 2, (points - 1) // 2)
    found = np.zeros(points // 2 + 1, dtype=complex)
    found[: kept + 1] = np.fft.rfft(samples)[: kept + 1] / len(samples)
    return np.fft.irfft(found * points, points)


# -- what is told ----------------------------------------------------------------------------------


def _faults(found: _Found) -> Iterator[str]:
    course, most = found.course, found.setting.grid.most
    if course.outcome == "unresolved":
        yield (
            f"the film leaves what {course.points} points can hold at t = {course.time[-1]:.6g} "
            f"({course.time[-1] / (2 * math.pi):.4g} periods): at its thinnest it is "
            f"{course.thickness[:, -1].min():.3g}, at its thickest "
            f"{course.thickness[:, -1].max():.4g}; write more grid.most, or a larger "
            "course.rupture"
        )
        return
    coarser = found.resolved.coarser
    if coarser is not None and coarser.outcome != course.outcome:
        yield (
            f"{coarser.points} points end with {coarser.outcome!r}, {course.points} with "
            f"{course.outcome!r}; write more grid.most than {most}"
        )
    if not course.volume_error <= _VOLUME:
        yield f"the volume changes by {course.volume_error:.2g} of itself"
    if found.tighter is not None and found.tighter.outcome != course.outcome:
        yield (
            f"to a hundredth of the tolerances the film ends with {found.tighter.outcome!r}, not "
            f"{course.outcome!r}; write smaller ones"
        )
    elif found.changed is not None and course.outcome != "moving" and found.changed > _STEPS:
        yield f"a hundredth of the tolerances changes the end by {found.changed:.2g}"
    for name, film in (("prescribed wave", course.wave), ("film at the end", course.end)):
        if film is not None and film.state.residual > _RESIDUAL:
            yield f"{name}: rates of {film.state.residual:.2g} are left"


def _growth(film: Steady | None) -> float | None:
    return None if film is None else film.growth


def _scalars(found: _Found) -> dict[str, Scalar]:
    course, wave = found.course, found.wave
    last = course.thickness[:, -1]
    values: dict[str, Any] = {
        "outcome": course.outcome,
        "tension_number": found.tension,
        "distance_to_wave": course.distance,
        "distance_to_steady": course.settled_to,
        "growth_rate_max": _growth(course.wave),
        "growth_rate_end": _growth(course.end),
        "volume_error": course.volume_error,
        "mean_flow": float(np.mean(flow(found.setting, last))),
        "mean_flow_wave": None if wave is None else wave.mean_flow,
        "thickness_max": float(last.max()),
        "thickness_min": float(last.min()),
        "thickness_least": float(course.thickness.min()),
        "rupture_thickness": found.setting.course.rupture,
        "points": course.points,
    }
    scalars = {name: Scalar(value) for name, value in values.items()}
    if course.broke is not None:
        scalars["broke_time"] = Scalar(course.broke[0])
        scalars["broke_xi"] = Scalar(course.broke[1], "rad")
    if found.waves is not None:
        scalars |= branch_scalars(found.waves)
    if found.basins is not None:
        scalars |= basins_scalars(found.basins)
    return scalars


def _variables(found: _Found) -> Iterator[Variable]:
    course, points = found.course, found.course.points
    xi = grid(points)

    def over(name: str, values: np.ndarray, what: str) -> Variable:
        return Variable(name, "1", ("xi",), values, what)

    yield Variable("xi", "rad", ("xi",), xi, "phase t - x")
    yield Variable("time", "1", ("time",), course.time, "time")
    yield Variable(
        "thickness", "1", ("time", "xi"), course.thickness.T, "thickness over the mean one"
    )
    yield over("thickness_end", course.thickness[:, -1], "thickness at the end")
    yield over("flow_end", flow(found.setting, course.thickness[:, -1]), "flow Q at the end")
    yield over("field_pressure", found.field.values(points), "(mu - 1) H² / (8 pi)")
    if found.wave is not None:
        yield over("thickness_wave", np.asarray(found.wave.height(xi)), "prescribed thickness")
    for name, film in (("wave", course.wave), ("end", course.end)):
        if film is not None:
            rates = film.state.eigenvalues[:_MODES]
            dims = (f"mode_{name}",)
            yield Variable(f"growth_{name}", "1", dims, rates.real, "rates of growth")
            yield Variable(f"swing_{name}", "1", dims, rates.imag, "angular rates")
    if found.waves is not None:
        yield from branch_variables(found.waves)
    if found.basins is not None:
        yield from basins_variables(found.basins)


def _trust(found: _Found) -> dict[str, Any]:
    course, coarser = found.course, found.resolved.coarser
    return {
        "points": course.points,
        "points_coarser": None if coarser is None else coarser.points,
        "outcome_coarser": None if coarser is None else coarser.outcome,
        "resolution_difference": found.resolved.difference,
        "highest_harmonics": course.tail,
        "outcome_tighter": None if found.tighter is None else found.tighter.outcome,
        "tolerance_difference": found.changed,
        "steps": course.steps,
        "volume_error": course.volume_error,
        "residual_wave": None if course.wave is None else course.wave.state.residual,
        "residual_end": None if course.end is None else course.end.state.residual,
        "closed_form_difference": _closed_form(found),
        "assumptions": [
            "lubrication: slopes are small against 1 / (depth times wave number)",
            f"a film thinner than {found.setting.course.rupture:g} of its mean counts as broken",
        ],
        "warnings": [*_warnings(found)],
    }


def _closed_form(found: _Found) -> float | None:
    """How far the prescribed wave as the points hold it is from what was prescribed."""
    film = found.course.wave
    if film is None or found.wave is None or isinstance(found.field, GivenField):
        return None
    xi = grid(found.course.points)
    return float(np.abs(film.thickness - np.asarray(found.wave.height(xi))).max())


def _warnings(found: _Found) -> Iterator[str]:
    course, agreement = found.course, found.setting.grid.agreement
    if isinstance(found.field, GivenField):
        lost = found.field.left_out(course.points)
        if lost > _LEFT_OUT:
            yield f"{lost:.2g} of the field are harmonics that {course.points} points cannot hold"
    difference = found.resolved.difference
    if found.resolved.coarser is None:
        yield "one resolution only: grid.most allows no second one"
    elif difference is not None and difference > agreement:
        yield (
            f"twice the points change the film at the end by {difference:.2g}: trust where it "
            "goes, not its last digits"
        )
    if course.wave is not None and course.wave.growth > 0:
        yield (
            f"the prescribed wave is not stable: deviations grow at the rate "
            f"{course.wave.growth:.4g}"
        )
    elif course.wave is not None and course.outcome in ("other", "moving", "breaks"):
        yield "the prescribed wave is stable, but the film does not reach it from this start"
    if course.outcome == "wave" and course.wave is not None and course.wave.growth > 0:
        yield "the film stays on it for having begun there"
    if course.outcome == "moving":
        yield "the film still moves at the end; write more course.periods"
    if found.wave is not None and isinstance(found.field, GivenField):
        yield (
            "the field is not that of film's wave: the film is compared with the wave, and rates "
            "of growth are those of the steady film next to it"
        )
