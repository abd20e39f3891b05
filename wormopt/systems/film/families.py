"""Families of films: steady films over the field's amplitude, outcomes of flat films."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.analysis.continuation import Branch, continue_branch
from wormopt.analysis.steady import rates_of
from wormopt.errors import SolveError
from wormopt.model.model import Signal
from wormopt.numerics.newton import newton
from wormopt.progress import Report
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.courses import OUTCOMES, Course, Setting, resolved
from wormopt.systems.film.given_field import (
    WaveField,
    film_thickness,
    film_volume,
    resampled,
    thin_film,
)
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.shapes import grid

_MOST = 400  # points of a branch
# Films that differ by less are the same.
_SAME = 1e-6


# -- steady films along the amplitude --------------------------------------------------------------


def steady_branches(
    course: Course,
    tension: float,
    span: tuple[float, float],
    *,
    points: int,
    order: int,
    report: Report,
) -> list[Branch]:
    """Continue the prescribed wave, and the steady film at the end of a motion, in the amplitude.

    `course`: in a cosine wave's field; `tension`: W; `span`: of amplitudes; `order`: of the
    differences on the given number of `points`. The branch of the end is left out if it is the
    same.
    """
    assert course.wave is not None
    delta, xi = ca.SX.sym("delta"), ca.DM(grid(points))
    wave, h = CosineWave(delta), course.wave.thickness
    slope = field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, tension)
    own = float(2 * np.mean(h * np.cos(grid(len(h)))))
    model = thin_film(slope, tension, order=order, p=[Signal("delta", delta, value=own)])
    rates = rates_of(model)
    p, starts, branches = rates.parameters(None), [h], []
    if course.end is not None and np.abs(course.end.thickness - h).max() > _SAME:
        starts.append(course.end.thickness)
    for k, thickness in enumerate(starts):
        report("continuing steady films", k / len(starts))
        guess = film_volume(resampled(thickness, points), order=order)
        x, found = newton(rates, guess[None], p)
        if found[0]:
            start = rates.steady(x[0], p)
            branches.append(continue_branch(start, "delta", span, max_points=_MOST))
    return branches


def branch_scalars(branches: Sequence[Branch]) -> dict[str, Any]:
    """Number of branches, their folds, and amplitudes near which stability changes."""
    crossings = []
    for branch in branches:  # Amplitudes at which the largest growth rate passes 0, between
        # neighbours.
        rate, delta = branch.eigenvalues[:, 0].real, branch.parameter
        at = np.flatnonzero(rate[:-1] * rate[1:] < 0)
        share = rate[at] / (rate[at] - rate[at + 1])
        crossings += (delta[at] + share * (delta[at + 1] - delta[at])).tolist()
    return {
        "branches": len(branches),
        "delta_fold": sorted(fold.parameter for branch in branches for fold in branch.folds),
        "delta_stability": sorted(crossings),
    }


def branch_variables(branches: Sequence[Branch], order: int) -> dict[str, np.ndarray]:
    """Variables of branches, one after the other; `order`: of the differences."""
    parts: dict[str, list[np.ndarray]] = {}
    for number, branch in enumerate(branches):
        h = film_thickness(branch.x.T, order=order)
        # Steady films have the flow Q = h + C, and C is minus the ratio of the means of h^-2 and
        # h^-3.
        constant = -np.mean(h**-2, axis=0) / np.mean(h**-3, axis=0)
        for name, values in (
            ("delta", branch.parameter),
            ("thickness_max", h.max(axis=0)),
            ("thickness_min", h.min(axis=0)),
            ("mean_flow", 1 + constant),
            ("growth", branch.eigenvalues[:, 0].real),
            ("number", np.full(len(branch.parameter), number)),
        ):
            parts.setdefault(f"branch_{name}", []).append(values)
    return {name: np.concatenate(values) for name, values in parts.items()}


# -- where flat films go ---------------------------------------------------------------------------


def basins(
    setting: Setting, delta: Sequence[float], tension: Sequence[float], report: Report
) -> list[list[Course | None]]:
    """Simulate a flat film in the field of every cosine wave, by amplitude, then tension.

    None where the allowed steps did not suffice.
    """
    courses: list[list[Course | None]] = [[] for _ in delta]
    for k, (i, j) in enumerate(np.ndindex(len(delta), len(tension))):
        report(f"map: delta = {delta[i]:g}, W = {tension[j]:g}", k / (len(delta) * len(tension)))
        wave, W = CosineWave(delta[i]), tension[j]
        slope, flat = WaveField(wave, W).slope, np.ones_like
        own = replace(setting, slope=slope, tension=W, start=flat, wave=wave.height)
        try:
            courses[i].append(resolved(own, once=True).course)
        except SolveError:
            courses[i].append(None)
    return courses


def map_variables(courses: Sequence[Sequence[Course | None]]) -> dict[str, np.ndarray]:
    """Variables of the map (amplitudes, tensions), NaN where they are unknown."""
    rows = [[_numbers(course) for course in row] for row in courses]
    found = {
        name: np.array([[course[name] for course in row] for row in rows], dtype=float)
        for name in rows[0][0]
    }
    return found | {"map_outcome": found["map_outcome"].astype(int)}


def _numbers(course: Course | None) -> dict[str, float | None]:
    if course is None:
        unknown = ("distance", "growth", "growth_end", "crest", "least", "time", "points")
        found = dict.fromkeys((f"map_{name}" for name in unknown), np.nan)
        return found | {"map_outcome": OUTCOMES.index("unresolved")}
    return {
        "map_outcome": OUTCOMES.index(course.outcome),
        "map_distance": course.distance,
        "map_growth": None if course.wave is None else course.wave.growth,
        "map_growth_end": None if course.end is None else course.end.growth,
        "map_crest": course.thickness[:, -1].max(),
        "map_least": course.thickness.min(),
        "map_time": course.time[-1],
        "map_points": course.points,
    }


def map_scalars(outcome: np.ndarray, growth: np.ndarray) -> dict[str, int]:
    """Count the outcomes of the map, with the growth rates of the prescribed waves."""
    counts = {f"map_{name}": int(np.sum(outcome == k)) for k, name in enumerate(OUTCOMES)}
    return counts | {
        "map_wave_unstable": int(np.sum(growth > 0)),
        # a stable wave that the film does not reach
        "map_wave_stable_not_reached": int(np.sum((growth < 0) & (outcome > 0))),
    }
