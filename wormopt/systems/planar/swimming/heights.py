"""Curvature of the local connection: displacement of a body by a small loop of its shape.

For g' = g A s' the displacement by a small loop from the first to the second of two shape variables
is its area times F = dA_2/ds_1 - dA_1/ds_2 + [A_1, A_2], a twist. Its first two entries depend on
the frame of the body; the third does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.swimming.stroke import Swim
from wormopt.systems.planar.swimming.swimmer import Swimmer

Frame = Literal["head", "middle", "calm"]
"""Frames: first link; middle link or midway between the two; that with the least motion."""

# Degree of the polynomials of the calm frame, and number of points of their fit.
_DEGREE, _NODES = 14, 24


@dataclass(frozen=True, eq=False)
class Heights:
    """Result of `heights`: curvature of a connection over two shape variables.

    Parameters
    ----------
    swimmer : Swimmer
        The body, in the frame.
    frame : {"head", "middle", "calm"}
        The frame.
    """

    swimmer: Swimmer
    frame: Frame

    def at(self, s: ArrayLike) -> np.ndarray:
        """Return the curvature at shapes.

        Parameters
        ----------
        s : array_like, shape (m, 2)
            Shapes.

        Returns
        -------
        ndarray, shape (m, 3)
            Displacement forward, to the left, and turn, per area of a small loop.
        """
        shapes = np.atleast_2d(np.asarray(s, dtype=float))
        return np.asarray(curvature(self.swimmer)(shapes.T)).T


def curvature(swimmer: Swimmer) -> ca.Function:
    """Return curvature (3 rows, a column for each pair i < j of shape variables) by ``s``."""
    s, A = swimmer.shape.s, swimmer.connection
    pairs = [(i, j) for i in range(s.numel()) for j in range(i + 1, s.numel())]
    columns = [ca.jtimes(A[:, j], s, _unit(s, i)) - ca.jtimes(A[:, i], s, _unit(s, j))
               + bracket(A[:, i], A[:, j]) for i, j in pairs]  # fmt: skip
    return ca.Function("curvature", [s], [ca.densify(ca.horzcat(*columns))], ["s"], ["F"])


def _unit(s: ca.SX, i: int) -> ca.DM:
    unit = ca.DM.zeros(s.numel())
    unit[i] = 1
    return unit


def bracket(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Lie bracket of two twists."""
    return ca.vertcat(b[2] * a[1] - a[2] * b[1], a[2] * b[0] - b[2] * a[0], 0)


def heights(
    swimmer: Swimmer,
    frame: Frame = "calm",
    reach: float = 2.0,
    middle: tuple[float, float] = (0.0, 0.0),
) -> Heights:
    """Return the curvature (height) functions of a body with two shape variables.

    Theory: docs/theory-planar.md, section 5. Source: R. L. Hatton and H. Choset, Int. J. Robotics
    Res. 30 (2011) 988.

    Parameters
    ----------
    swimmer : Swimmer
        The body.
    frame : {"head", "middle", "calm"}, optional
        Frame of the displacement: at the head, along the first link; at the middle of the chain,
        along its middle link (or midway between both); or the frame that moves least in the mean
        over a square of shapes while the shape changes. In the calm frame the area under the
        curvature predicts the displacement of large loops best.
    reach : float, optional
        The calm frame counts shapes from middle - reach to middle + reach.
    middle : (float, float), optional
        Middle of these shapes.

    Returns
    -------
    Heights

    Raises
    ------
    ArgumentError
        If there are not two shape variables.

    Examples
    --------
    >>> from wormopt.systems.planar.body.shape import chain_shape
    >>> purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> (heights(purcell, "middle").at([[0.0, 0.0]]) * 81 / 5).round(12).tolist()
    [[1.0, 0.0, 0.0]]
    """
    if swimmer.shape.s.numel() != 2:
        raise ArgumentError(f"height functions need two shape variables, not {swimmer.shape.names}")
    return Heights(in_frame(swimmer, frame, reach, middle), frame)


def in_frame(
    swimmer: Swimmer,
    frame: Frame,
    reach: float = 2.0,
    middle: tuple[float, float] = (0.0, 0.0),
) -> Swimmer:
    """Return the same body in another frame."""
    if frame == "head":
        return swimmer
    place, angle = middle_of(swimmer.shape)
    if frame == "middle":
        return swimmer.seen_from(place, angle)
    if frame != "calm":
        raise ArgumentError(f"frame must be head, middle or calm, not {frame!r}")
    return _calm(swimmer.seen_from(place, angle), reach, np.array(middle))


def middle_of(shape: Shape) -> tuple[ca.SX, ca.SX]:
    """Return place and angle of the middle link, or midway between the two at the middle mass."""
    n = shape.n_points - 1
    first = [shape.points[:, j] - shape.points[:, j + 1] for j in ((n - 1) // 2, n // 2)]
    if n % 2:
        d = first[0]
        place = (shape.points[:, n // 2] + shape.points[:, n // 2 + 1]) / 2
        return place, ca.atan2(d[1], d[0])
    a, b = first
    half = ca.atan2(a[0] * b[1] - a[1] * b[0], ca.dot(a, b)) / 2
    return shape.points[:, n // 2], ca.atan2(a[1], a[0]) + half


def _calm(swimmer: Swimmer, reach: float, middle: np.ndarray) -> Swimmer:
    """Return the body in the frame whose place p and angle b, polynomials of s, minimise A.

    In this frame the twist is w + grad b and R(-b)(V + w J p + grad p) for any shape rates. These
    are two least-squares problems at Gauss points, the second with the connection's own w.
    """
    x, weight = legendre.leggauss(_NODES)
    u, v = (grid.ravel() for grid in np.meshgrid(x, x, indexing="ij"))
    root = np.sqrt(np.outer(weight, weight).ravel())
    A, _ = swimmer.local(middle + reach * np.stack([u, v], axis=1))
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    basis, slopes = _basis(u, v, powers, reach)
    w = A[:, 2, :].T  # (2, m)
    turn = np.concatenate([root[:, None] * slopes[k] for k in (0, 1)])
    b = np.linalg.lstsq(turn[:, 1:], -np.concatenate([root * w[k] for k in (0, 1)]), rcond=None)[0]
    b = np.concatenate([[0.0], b])
    rows, right = [], []
    for k in (0, 1):
        whirl = root[:, None] * w[k][:, None] * basis
        slope = root[:, None] * slopes[k]
        rows += [np.hstack([slope, -whirl]), np.hstack([whirl, slope])]
        right += [-root * A[:, 0, k], -root * A[:, 1, k]]
    p = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-12)[0]
    straight = _basis(np.zeros(1), np.zeros(1), powers, reach)[0][0]
    b[0] -= straight @ b  # in the middle of the shapes its angle is that of the middle link
    symbols = [_terms((swimmer.shape.s[k] - middle[k]) / reach) for k in (0, 1)]
    terms = ca.vertcat(*(symbols[0][i] * symbols[1][j] for i, j in powers))
    count = len(powers)
    place = ca.vertcat(ca.dot(ca.DM(p[:count]), terms), ca.dot(ca.DM(p[count:]), terms))
    return swimmer.seen_from(place, ca.dot(ca.DM(b), terms))


def _basis(
    u: np.ndarray, v: np.ndarray, powers: list[tuple[int, int]], reach: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Products of Chebyshev's polynomials (m, terms), and their slopes by both variables."""

    def table(x: np.ndarray, order: int) -> np.ndarray:
        series = chebyshev.chebder(np.eye(_DEGREE + 1), order) if order else np.eye(_DEGREE + 1)
        return chebyshev.chebval(x, series).T / reach**order

    own, slope = [table(x, 0) for x in (u, v)], [table(x, 1) for x in (u, v)]
    i, j = np.array(powers).T
    return own[0][:, i] * own[1][:, j], [
        slope[0][:, i] * own[1][:, j],
        own[0][:, i] * slope[1][:, j],
    ]


def _terms(x: ca.SX) -> list[ca.SX]:
    """Chebyshev's polynomials of an expression."""
    found = [ca.SX(1), x]
    for _ in range(_DEGREE - 1):
        found.append(2 * x * found[-1] - found[-2])
    return found


def small_efficiency(swimmer: Swimmer, done: Swim) -> float:
    """Return the efficiency of the best small stroke with the same distance, to first order.

    The displacement of area S is |F| S, and the length around it in the metric is at least
    (4 pi S sqrt(det G))^1/2: action >= 4 pi sqrt(det G) X / |F|. F and G are those of the middle
    frame at the shape midway between the stroke's extremes. For large strokes this value is a
    reference, not a bound.
    """
    shape = (done.shapes.min(axis=0) + done.shapes.max(axis=0)) / 2
    seen = in_frame(swimmer, "middle")
    _, G = seen.local(shape)
    F = np.asarray(curvature(seen)(shape)).ravel()
    least = 4 * np.pi * np.sqrt(np.linalg.det(G)) / np.hypot(*F[:2])
    return float(done.drag * done.distance / least)
