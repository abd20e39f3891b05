"""Run scenes of kind ``film-forward``: the wave of a film in a given travelling field."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.progress import Report
from wormopt.result import NOT_RECHECKED, Check, Result
from wormopt.simulation.options import Tolerance
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.film.courses import TAIL, Course, Resolved, Setting, flow, follow, resolved
from wormopt.systems.film.families import (
    basins,
    branch_scalars,
    branch_variables,
    map_scalars,
    map_variables,
    steady_branches,
)
from wormopt.systems.film.given_field import GivenField, WaveField, film_volume, resampled
from wormopt.systems.film.next_order import reach_warnings
from wormopt.systems.film.runs.film_fields import field_of_scene
from wormopt.systems.film.scenes.film_forward import FilmForwardScene, StartTable
from wormopt.systems.film.shapes import Wave, grid

# Accepted loss of volume, residual of steady films, and effect of a tighter integrator.
_VOLUME, _RESIDUAL, _STEPS = 1e-12, 1e-6, 1e-5
# Share of the field in unresolved harmonics above which a warning is given.
_LEFT_OUT = 1e-6
# Number of eigenvalues that are kept.
_MODES = 24


@dataclass(frozen=True, eq=False)
class _Found:
    """A simulated film, and the settings of the simulation."""

    setting: Setting
    field: WaveField | GivenField
    wave: Wave | None
    resolved: Resolved
    tighter: Course | None

    @property
    def course(self) -> Course:
        return self.resolved.course

    @property
    def changed(self) -> float | None:
        """Effect of a hundredth of the tolerances on the end state."""
        one, other = self.course, self.tighter
        if other is None or one.outcome != other.outcome or one.outcome == "unresolved":
            return None
        if one.broke is not None and other.broke is not None:
            return abs(one.broke[0] - other.broke[0])
        return float(np.abs(one.thickness[:, -1] - other.thickness[:, -1]).max())


def run(scene: Scene[FilmForwardScene], report: Report) -> Result:
    """Simulate a film in time, and find its final state and the stability.

    The result is "failed" where the points do not suffice, or a check fails. Raises SceneError for
    an impossible field, wave or start, and SolveError if the allowed steps do not suffice.
    """
    table, begin = scene.table, time.perf_counter()
    fluid = table.film.scales
    tension = table.film.tension_number
    wave = table.film.wave(scene.name) if table.film.has_wave else None
    field = field_of_scene(scene, wave, tension)
    setting = _setting(scene, field, wave, tension)
    course = resolved(setting, report)
    followed = time.perf_counter()
    tighter = None
    if table.tolerance.recheck:
        given = setting.tolerance
        close = replace(
            given, relative=max(given.relative / 100, 1e-13), absolute=given.absolute / 100
        )
        tighter = follow(replace(setting, tolerance=close), course.course.points, report)
    rechecked = time.perf_counter()
    found = _Found(setting, field, wave, course, tighter)
    scalars, variables = _scalars(found), _variables(found)
    if table.branch is not None:
        least, largest = table.branch.delta
        branches = steady_branches(
            found.course, tension, (least, largest), points=table.branch.points,
            order=setting.order, report=report,
        )  # fmt: skip
        scalars |= branch_scalars(branches)
        variables |= branch_variables(branches, setting.order)
    branched = time.perf_counter()
    if table.map is not None:
        delta, tensions = table.map.delta, table.map.tension
        films = map_variables(basins(setting, delta, tensions, report))
        scalars |= map_scalars(films["map_outcome"], films["map_growth"])
        variables |= {"map_delta": delta, "map_tension": tensions, **films}
    return conclude(
        scene,
        scalars,
        variables,
        checks=_checks(found),
        facts=_facts(found),
        warnings=[
            *_warnings(found),
            *(fluid.warnings() if fluid else ()),
            *(reach_warnings(wave, table.film.thinness) if wave else ()),
            *(() if table.tolerance.recheck else (NOT_RECHECKED,)),
        ],
        timings={
            "film": followed - begin,
            "recheck": rechecked - followed,
            "branch": branched - rechecked,
            "map": time.perf_counter() - branched,
        },
    )


def _setting(
    scene: Scene[FilmForwardScene], field: WaveField | GivenField, wave: Wave | None, tension: float
) -> Setting:
    table = scene.table
    start = _start(table.start, wave)
    try:
        h = start(grid(table.grid.points))
        if h.min() <= 0:
            raise ArgumentError("the thickness must be above 0 everywhere")  # noqa: TRY301
        film_volume(h, order=table.grid.order)
    except ArgumentError as error:
        key = "start.samples" if table.start.shape == "samples" else "start.nudge"
        raise SceneError(scene.name, [(key, str(error))]) from None
    steps = table.tolerance
    return Setting(
        field.slope,
        tension,
        start,
        None if wave is None else wave.height,
        **msgspec.structs.asdict(table.course),
        **msgspec.structs.asdict(table.grid),
        tolerance=Tolerance(steps.relative, steps.absolute, steps.max_steps),
    )


def _start(table: StartTable, wave: Wave | None) -> Callable[[np.ndarray], np.ndarray]:
    """Thickness at time 0 over the phase."""

    def thickness(xi: np.ndarray) -> np.ndarray:
        h = np.ones(len(xi))
        if table.shape == "wave" and wave is not None:
            h = wave.height(xi)
        elif table.samples is not None:
            h = resampled(np.array(table.samples), len(xi))
        return h + table.nudge * np.cos(table.harmonic * xi)

    return thickness


# -- results ---------------------------------------------------------------------------------------


def _checks(found: _Found) -> Iterator[Check]:
    course, coarser, tighter = found.course, found.resolved.coarser, found.tighter
    thin, last = course.thickness[:, -1], course.time[-1]
    held = course.outcome != "unresolved"
    advice = (
        f"{course.points} points do not resolve the film at t = {last:.6g} "
        f"({last / (2 * math.pi):.4g} periods), with thicknesses from {thin.min():.3g} to "
        f"{thin.max():.4g}; write more grid.most, or a larger course.rupture"
    )
    yield Check("points hold the film", course.tail, TAIL, advice, passed=held)
    if not held:
        return
    if coarser is not None:
        advice = (
            f"{coarser.points} points end with {coarser.outcome!r}, {course.points} with "
            f"{course.outcome!r}; write more than grid.most = {found.setting.most}"
        )
        alike, limit = coarser.outcome == course.outcome, found.setting.agreement
        yield Check("outcome on half the points", found.resolved.difference, limit, advice, alike)
    advice = f"the volume changes by a share of {course.volume_error:.2g}"
    yield Check("volume", course.volume_error, _VOLUME, advice)
    if tighter is not None and tighter.outcome != course.outcome:
        advice = (
            f"with a hundredth of the tolerances the film ends with {tighter.outcome!r}, "
            f"not {course.outcome!r}; write smaller tolerances"
        )
        yield Check("tighter tolerances", None, _STEPS, advice)
    elif found.changed is not None:
        advice = f"a hundredth of the tolerances changes the end state by {found.changed:.2g}"
        fine = course.outcome == "moving" or not found.changed > _STEPS
        yield Check("tighter tolerances", found.changed, _STEPS, advice, fine)
    for name, film in (("prescribed wave", course.wave), ("film at the end", course.end)):
        if film is not None:
            left = film.state.residual
            advice = f"{name} is not steady: its rates of change are {left:.2g}"
            yield Check(f"rates of the {name}", left, _RESIDUAL, advice)


def _scalars(found: _Found) -> dict[str, Any]:
    course, wave = found.course, found.wave
    last = course.thickness[:, -1]
    scalars = {
        "outcome": course.outcome,
        "tension_number": found.setting.tension,
        "distance_to_wave": course.distance,
        "distance_to_steady": course.settled_to,
        "growth_rate_max": course.wave and course.wave.growth,
        "growth_rate_end": course.end and course.end.growth,
        "volume_error": course.volume_error,
        "mean_flow": float(np.mean(flow(found.setting, last))),
        "mean_flow_wave": wave and wave.mean_flow,
        "thickness_max": float(last.max()),
        "thickness_min": float(last.min()),
        "thickness_least": float(course.thickness.min()),
        "rupture_thickness": found.setting.rupture,
        "points": course.points,
    }
    if course.broke is not None:
        scalars["broke_time"], scalars["broke_xi"] = course.broke
    return scalars


def _variables(found: _Found) -> dict[str, Any]:
    course, xi = found.course, grid(found.course.points)
    last = course.thickness[:, -1]
    variables = {
        "xi": xi,
        "time": course.time,
        "thickness": course.thickness.T,
        "thickness_end": last,
        "flow_end": flow(found.setting, last),
        "field_pressure": found.field.values(course.points),
    }
    if found.wave is not None:
        variables["thickness_wave"] = found.wave.height(xi)
    for name, film in (("wave", course.wave), ("end", course.end)):
        if film is not None:
            rates = film.state.eigenvalues[:_MODES]
            variables |= {f"growth_{name}": rates.real, f"swing_{name}": rates.imag}
    return variables


def _facts(found: _Found) -> dict[str, Any]:
    course, coarser, tighter = found.course, found.resolved.coarser, found.tighter
    off = None  # The prescribed wave on the points, compared with its closed form.
    if course.wave is not None and isinstance(found.field, WaveField):
        off = np.abs(course.wave.thickness - found.field.wave.height(grid(course.points))).max()
    return {
        "points": course.points,
        "points_coarser": coarser and coarser.points,
        "outcome_coarser": coarser and coarser.outcome,
        "resolution_difference": found.resolved.difference,
        "highest_harmonics": course.tail,
        "outcome_tighter": tighter and tighter.outcome,
        "tolerance_difference": found.changed,
        "steps": course.steps,
        "volume_error": course.volume_error,
        "residual_wave": course.wave and course.wave.state.residual,
        "residual_end": course.end and course.end.state.residual,
        "closed_form_difference": off,
        "assumptions": [
            "lubrication theory: slopes are small against 1 / (depth times wave number)",
            f"a film thinner than {found.setting.rupture:g} of its mean counts as ruptured",
        ],
    }


def _warnings(found: _Found) -> Iterator[str]:
    course, wave, difference = found.course, found.course.wave, found.resolved.difference
    given = isinstance(found.field, GivenField)
    lost = found.field.left_out(course.points) if isinstance(found.field, GivenField) else 0.0
    if lost > _LEFT_OUT:
        yield (
            f"a share of {lost:.2g} of the field is in harmonics that {course.points} points "
            "do not resolve"
        )
    if found.resolved.coarser is None:
        yield "there is only one resolution, since grid.most does not allow a second"
    elif difference is not None and difference > found.setting.agreement:
        yield (
            f"twice the points change the end state by {difference:.2g}: its outcome is reliable, "
            "its last digits are not"
        )
    if wave is not None and wave.growth > 0:
        yield (f"the prescribed wave is unstable: deviations grow at the rate {wave.growth:.4g}")
    elif wave is not None and course.outcome in ("other", "moving", "breaks"):
        yield "the prescribed wave is stable, but the film does not reach it from this start"
    if course.outcome == "wave" and wave is not None and wave.growth > 0:
        yield "the film stays on it only because it starts there"
    if course.outcome == "moving":
        yield "the film still moves at the end; write more course.periods"
    if found.wave is not None and given:
        yield (
            "the field is not that of film's wave: the film is compared with that wave, and growth "
            "rates are those of the nearest steady film"
        )
