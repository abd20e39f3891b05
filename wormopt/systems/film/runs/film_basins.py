"""Where flat films go under the fields of cosine waves: a map over amplitude and tension."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.runs.film_courses import OUTCOMES, Course, Setting
from wormopt.systems.film.runs.film_fields import WaveField
from wormopt.systems.film.runs.film_resolution import resolved
from wormopt.systems.film.scenes.film_forward import MapTable


@dataclass(frozen=True, eq=False)
class Basins:
    """Outcomes over a grid of amplitudes and tensions."""

    table: MapTable
    # by amplitude, then tension; None where the allowed steps did not suffice
    courses: list[list[Course | None]]

    def each(self, name: str) -> np.ndarray:
        """An attribute of all courses (amplitudes, tensions), NaN where it is unknown.

        `name`: distance, points, growth, growth_end, outcome, crest, least or time.
        """
        return np.array([[_number(course, name) for course in row] for row in self.courses])


def _number(course: Course | None, name: str) -> float:
    if course is None:
        return float(OUTCOMES.index("unresolved")) if name == "outcome" else np.nan
    found = {
        "outcome": OUTCOMES.index(course.outcome),
        "distance": course.distance,
        "points": course.points,
        "growth": None if course.wave is None else course.wave.growth,
        "growth_end": None if course.end is None else course.end.growth,
        "crest": course.thickness[:, -1].max(),
        "least": course.thickness.min(),
        "time": course.time[-1],
    }[name]
    return np.nan if found is None else float(found)


def basins(table: MapTable, setting: Setting, report: Report) -> Basins:
    """Follow a flat film under every field of the map."""
    courses: list[list[Course | None]] = []
    done, count = 0, len(table.delta) * len(table.tension)
    for delta in table.delta:
        wave, row = CosineWave(delta), []
        for tension in table.tension:
            report(f"map: delta = {delta:g}, W = {tension:g}", done / count)
            field = WaveField(wave, tension)
            own = replace(
                setting,
                slope=field.slope,
                tension=tension,
                start=_flat,
                wave=wave.height,
            )
            row.append(_course(own))
            done += 1
        courses.append(row)
    return Basins(table, courses)


def _flat(xi: np.ndarray) -> np.ndarray:
    return np.ones(len(xi))


def _course(setting: Setting) -> Course | None:
    try:
        return resolved(setting, once=True).course
    except SolveError:
        return None


def basins_scalars(found: Basins) -> dict[str, Scalar]:
    """How often each outcome is."""
    outcome, growth = found.each("outcome"), found.each("growth")
    counts = {f"map_{name}": Scalar(int(np.sum(outcome == k))) for k, name in enumerate(OUTCOMES)}
    # a wave that is stable and yet not where the film goes
    astray = (growth < 0) & (outcome > 0)
    return counts | {
        "map_wave_unstable": Scalar(int(np.sum(growth > 0))),
        "map_wave_stable_not_reached": Scalar(int(np.sum(astray))),
    }


def basins_variables(found: Basins) -> Iterator[Variable]:
    """Signals of the map."""
    dims = ("map_delta", "map_tension")
    yield Variable(dims[0], "1", dims[:1], np.array(found.table.delta), "amplitude of the wave")
    yield Variable(dims[1], "1", dims[1:], np.array(found.table.tension), "surface tension W")
    outcome = found.each("outcome").astype(int)
    words = ", ".join(f"{k} {name}" for k, name in enumerate(OUTCOMES))
    yield Variable("map_outcome", "1", dims, outcome, words)
    for name, what in (
        ("distance", "distance from the prescribed wave at the end"),
        ("growth", "largest rate of growth on the prescribed wave"),
        ("growth_end", "largest rate of growth on the steady film at the end"),
        ("crest", "largest thickness at the end"),
        ("least", "least thickness over time"),
        ("time", "time until the end, or until it broke"),
        ("points", "points"),
    ):
        yield Variable(f"map_{name}", "1", dims, found.each(name), what)
