"""Poses in the plane, (x, y, heading), and the pose of a body from its velocity, by quadrature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from wormopt.numerics.collocation import Collocation


def compose(first: ArrayLike, then: ArrayLike) -> np.ndarray:
    """Return the pose after two successive displacements, each in the frame it starts from.

    Parameters
    ----------
    first, then : array_like, shape (..., 3)
        x, y (in units of length) and angle (in rad); leading dimensions broadcast.

    Returns
    -------
    ndarray, shape (..., 3)
        x, y and angle of the pose.

    Examples
    --------
    >>> import numpy as np
    >>> compose([1.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0]).round(12).tolist()
    [1.0, 1.0, 1.570796326795]
    """
    a, b = np.asarray(first, dtype=float), np.asarray(then, dtype=float)
    return np.concatenate(
        [a[..., :2] + rotate(a[..., 2], b[..., :2]), (a[..., 2] + b[..., 2])[..., None]], axis=-1
    )


def inverse(pose: ArrayLike) -> np.ndarray:
    """Return the inverse of displacements (..., 3): x, y and angle."""
    g = np.asarray(pose, dtype=float)
    back = -rotate(-g[..., 2], g[..., :2])
    return np.concatenate([back, -g[..., 2:]], axis=-1)


def rotate(angle: ArrayLike, vectors: ArrayLike) -> np.ndarray:
    """Rotate vectors (..., 2) to the left by angles (...,) in rad."""
    c, s, vectors = np.cos(angle), np.sin(angle), np.asarray(vectors, dtype=float)
    x, y = vectors[..., 0], vectors[..., 1]
    first = c * x - s * y
    turned = np.empty((*first.shape, 2))  # np.stack takes three times as long
    turned[..., 0], turned[..., 1] = first, s * x + c * y
    return turned


@dataclass(frozen=True)
class Circle:
    """Circle of a body that repeats one displacement."""

    centre: tuple[float, float]  # in the frame it starts from
    radius: float


def circle_of(displacement: ArrayLike) -> Circle | None:
    """Return the circle of a repeated displacement (3,); None if it does not turn.

    Its radius is |d| / (2 |sin(angle / 2)|).
    """
    x, y, angle = np.asarray(displacement, dtype=float).tolist()
    half = np.sin(angle / 2)
    if abs(half) < 1e-12:
        return None
    cot = np.cos(angle / 2) / half
    centre = ((x - cot * y) / 2, (y + cot * x) / 2)
    return Circle((float(centre[0]), float(centre[1])), float(np.hypot(x, y) / (2 * abs(half))))


Twists = Callable[[np.ndarray], np.ndarray]
"""Velocities (m, 3) of the frame, in the frame, by the phase, at phases (m,).

Further columns, such as a length or a work, are integrated too.
"""

_DEGREE, _MOST_PANELS = 16, 2048


@dataclass(frozen=True, eq=False)
class Travel:
    """Pose over a stroke, from the pose (0, 0, 0).

    `nodes` and `weights` integrate over the phase; at a node the velocity is `twists`.
    """

    ends: np.ndarray  # (K + 1,) ends of the panels of the quadrature
    poses: np.ndarray  # (K + 1, 3) at the ends
    nodes: np.ndarray  # (K d,)
    weights: np.ndarray  # (K d,)
    twists: np.ndarray  # (K d, 3)
    node_poses: np.ndarray  # (K d, 3)
    sums: np.ndarray  # (K + 1, c) integrals of c further rates, at the ends
    node_sums: np.ndarray  # (K d, c)
    error: float  # estimate, of displacement and sums

    @property
    def displacement(self) -> np.ndarray:
        """Pose at the end, (3,)."""
        return self.poses[-1]

    @property
    def reached(self) -> np.ndarray:
        """Pose and sums at the end, (3 + c,)."""
        return np.append(self.poses[-1], self.sums[-1])

    def fastest(self, velocities: np.ndarray) -> np.ndarray:
        """Return bounds (K,) of vectors over each panel, from those (K d, n, 2) at the nodes.

        Legendre polynomials are at most 1, so the sum of the coefficients' sizes bounds the
        interpolating polynomial at every instant. The last two coefficients count twice, to include
        the error of interpolation, which is smaller on panels that resolve the curve.
        """
        panels = len(self.ends) - 1
        at_nodes = velocities.reshape(panels, _DEGREE, -1, 2)
        sizes = np.linalg.norm(np.einsum("kd,pdnc->pknc", to_series(), at_nodes), axis=-1)
        return (sizes.sum(axis=1) + sizes[:, -2:].sum(axis=1)).max(axis=1)


def travel(
    twists: Twists, breaks: np.ndarray, *, panels: int = 4, accuracy: float = 1e-13
) -> Travel:
    """Integrate velocities in the frame of the body over phases.

    Velocities must be smooth between `breaks`. Each smooth part starts with `panels` panels, which
    are halved until displacement and sums change by less than `accuracy` of their size, or of 1.
    """
    coarse = _uniform(twists, breaks, panels)
    while True:
        panels *= 2
        fine = _uniform(twists, breaks, panels)
        error = float(np.abs(fine.reached - coarse.reached).max())
        scale = max(1.0, float(np.abs(fine.poses).max()), float(np.abs(fine.reached).max()))
        if error <= accuracy * scale or panels >= _MOST_PANELS:
            return replace(fine, error=error)
        coarse = fine


def _uniform(twists: Twists, breaks: np.ndarray, panels: int) -> Travel:
    parts = [np.linspace(a, b, panels + 1) for a, b in pairwise(breaks)]
    ends = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    nodes = gauss_nodes(ends[:-1], ends[1:])
    return travel_along(ends, twists(nodes.ravel()).reshape(*nodes.shape, -1), np.inf)


def travel_along(ends: np.ndarray, rates: np.ndarray, error: float) -> Travel:
    """Return the poses from rates (K, d, 3 + c) at Gauss nodes between `ends` (K + 1,)."""
    twists, h = rates[..., :3], np.diff(ends)
    turns, angle = _summed(h, twists[..., 2:])
    places, within = _summed(h, rotate(angle[..., 0], twists[..., :2]))
    sums, node_sums = _summed(h, rates[..., 3:])
    nodes = len(h) * gauss().degree
    return Travel(
        ends,
        np.hstack([places, turns]),
        gauss_nodes(ends[:-1], ends[1:]).ravel(),
        (h[:, None] * gauss().B).ravel(),
        twists.reshape(nodes, 3),
        np.concatenate([within, angle], axis=-1).reshape(nodes, 3),
        sums,
        node_sums.reshape(nodes, -1),
        error,
    )


def _summed(h: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return integrals (K + 1, c) from 0 to the ends of panels, and (K, d, c) to their nodes."""
    rule = gauss()
    whole = h[:, None] * np.einsum("kdc,d->kc", rates, rule.B)
    ends = np.vstack([np.zeros(rates.shape[-1]), np.cumsum(whole, axis=0)])
    return ends, ends[:-1, None] + h[:, None, None] * np.einsum("ed,kdc->kec", rule.A, rates)


def gauss_nodes(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return phases (K, d) of Gauss nodes between starts and ends (K,)."""
    return start[:, None] + (end - start)[:, None] * gauss().tau


@cache
def gauss() -> Collocation:
    """Return the quadrature rule of each panel."""
    return Collocation(_DEGREE)


def divided(course: Travel, longest: float) -> Travel:
    """Divide panels longer than `longest`; poses do not change."""
    ends, xi = course.ends, course.twists.reshape(-1, _DEGREE, 3)
    parts = np.ceil(np.diff(ends) / longest).astype(int)
    cuts = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(ends), parts, strict=True)]
    fine = np.append(np.concatenate(cuts), ends[-1])
    which = np.repeat(np.arange(len(parts)), parts)
    start, size = ends[:-1][which, None], np.diff(ends)[which, None]
    nodes = gauss_nodes(fine[:-1], fine[1:])
    at = np.polynomial.legendre.legvander(2 * (nodes - start) / size - 1, _DEGREE - 1)
    twists = np.einsum("pdk,kj,pjc->pdc", at, to_series(), xi[which])
    return travel_along(fine, twists, course.error)


@cache
def to_series() -> np.ndarray:
    """Return the matrix (16, 16) from values at the nodes to Legendre coefficients."""
    rule, degrees = gauss(), np.arange(_DEGREE)
    at_nodes = np.polynomial.legendre.legvander(2 * rule.tau - 1, _DEGREE - 1)
    return (2 * degrees[:, None] + 1) * at_nodes.T * rule.B
