"""The film that results under the field of a row of coils: the steady one next to the wave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.runs.film_courses import Setting, flow, steady
from wormopt.systems.film.runs.film_fields import GivenField
from wormopt.systems.film.scenes.film_forward import CourseTable, GridTable, StepsTable
from wormopt.systems.film.shapes import grid

_POINTS = 256


@dataclass(frozen=True, eq=False)
class CarriedFilm:
    """A steady film that travels with the mean field of a row."""

    xi: np.ndarray  # (points,) phases
    thickness: np.ndarray  # (points,) over the mean
    distance: float  # largest difference of thickness from the wave wanted
    mean_flow: float  # 1 + C
    growth: float  # largest growth rate of a small deviation
    residual: float  # of Newton's method


def carried_film(wave: CosineWave, pressure: np.ndarray, tension: float) -> CarriedFilm | None:
    """Steady film near `wave` under a field that is not quite the wave's own; None without one.

    `pressure` (m,): (mu - 1) H² / (8 pi) over one wavelength, in units of the film.
    """
    setting = Setting(
        slope=GivenField(pressure).slope,
        tension=tension,
        start=np.ones_like,
        wave=wave.height,
        course=CourseTable(),
        grid=GridTable(),
        tolerance=StepsTable(),
    )
    xi = grid(_POINTS)
    film = steady(setting, _POINTS, wave.height(xi))
    if film is None:
        return None
    # Q at rest on the ground is h + C everywhere
    carried = flow(setting, film.thickness).mean()
    distance = float(np.abs(film.thickness - wave.height(xi)).max())
    return CarriedFilm(
        xi, film.thickness, distance, float(carried), film.growth, film.state.residual
    )
