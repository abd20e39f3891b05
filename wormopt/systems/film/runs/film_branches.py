"""Steady films followed along the amplitude of the wave that the field prescribes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.analysis.continuation import Branch, follow_branch
from wormopt.analysis.steady import rates_of
from wormopt.model.model import Signal
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.runs.film_courses import Course
from wormopt.systems.film.scenes.film_forward import BranchTable
from wormopt.systems.film.shapes import grid
from wormopt.systems.film.thin_film import film_thickness, film_volume, thin_film

_MOST = 400
# Films that differ by less are the same.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Waves:
    """Branches of steady films."""

    branches: tuple[Branch, ...]  # prescribed wave's first; that of the end if another
    order: int  # of the differences


def follow_waves(
    table: BranchTable, order: int, tension: float, course: Course, report: Report
) -> Waves:
    """Follow the prescribed wave, and the steady film at the end of a course, by amplitude.

    `order`: of the differences; `tension`: number W; `course`: under a cosine wave's field.
    """
    assert course.wave is not None
    delta, xi = ca.SX.sym("delta"), ca.DM(grid(table.points))
    own = _amplitude(course)
    wave = CosineWave(delta)
    slope = field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, tension)
    model = thin_film(slope, tension, order=order, p=[Signal("delta", delta, value=own)])
    rates = rates_of(model)
    p = rates.parameters(None)
    starts = [course.wave.thickness]
    apart = course.end is not None and np.abs(course.end.thickness - starts[0]).max() > _SAME
    if course.end is not None and apart:
        starts.append(course.end.thickness)
    branches = []
    for k, thickness in enumerate(starts):
        report("following steady films", k / len(starts))
        guess = film_volume(_on(thickness, table.points), order=order)
        x, found = rates.newton(guess[None], p)
        if found[0]:
            start = rates.steady(x[0], p)
            span = (table.delta[0], table.delta[1])
            branches.append(follow_branch(start, "delta", span, max_points=_MOST))
    return Waves(tuple(branches), order)


def _amplitude(course: Course) -> float:
    assert course.wave is not None
    h = course.wave.thickness
    return float(2 * np.mean(h * np.cos(grid(len(h)))))


def _on(thickness: np.ndarray, points: int) -> np.ndarray:
    """The same film on other points."""
    found = np.fft.rfft(thickness) / len(thickness)
    kept = min((len(thickness) - 1) // 2, (points - 1) // 2) + 1
    other = np.zeros(points // 2 + 1, dtype=complex)
    other[:kept] = found[:kept]
    return np.fft.irfft(other * points, points)


def branch_scalars(waves: Waves) -> dict[str, Scalar]:
    """Numbers about branches."""
    folds = sorted(fold.parameter for branch in waves.branches for fold in branch.folds)
    lost = [c for branch in waves.branches for c in _crossings(branch)]
    return {
        "branches": Scalar(len(waves.branches)),
        "delta_fold": Scalar(folds),
        "delta_stability": Scalar(sorted(lost)),
    }


def _crossings(branch: Branch) -> list[float]:
    """Amplitudes at which the largest rate of growth passes 0, between neighbours."""
    rate, delta = branch.eigenvalues[:, 0].real, branch.parameter
    at = np.flatnonzero(rate[:-1] * rate[1:] < 0)
    share = rate[at] / (rate[at] - rate[at + 1])
    return (delta[at] + share * (delta[at + 1] - delta[at])).tolist()


def branch_variables(waves: Waves) -> Iterator[Variable]:
    """Signals of branches, one after the other."""
    if not waves.branches:
        return
    parts: dict[str, list[np.ndarray]] = {}
    for number, branch in enumerate(waves.branches):
        h = film_thickness(branch.x.T, order=waves.order)
        # steady films carry Q = h + C, and C is minus the ratio of the means of h^-2 and h^-3
        constant = -np.mean(h**-2, axis=0) / np.mean(h**-3, axis=0)
        for name, values in (
            ("delta", branch.parameter),
            ("thickness_max", h.max(axis=0)),
            ("thickness_min", h.min(axis=0)),
            ("mean_flow", 1 + constant),
            ("growth", branch.eigenvalues[:, 0].real),
            ("number", np.full(len(branch.parameter), number)),
        ):
            parts.setdefault(name, []).append(values)
    words = {
        "delta": "amplitude of the wave that the field prescribes",
        "thickness_max": "largest thickness",
        "thickness_min": "least thickness",
        "mean_flow": "mean flow",
        "growth": "largest rate of growth",
        "number": "number of the branch",
    }
    for name, values in parts.items():
        yield Variable(f"branch_{name}", "1", ("branch",), np.concatenate(values), words[name])
