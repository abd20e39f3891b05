"""Curvatures of swimmers and their best strokes.

Judged by differences of the connection written anew, by the same stroke followed by SciPy, and by
strokes that go round evenly, none of which may be better.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from tests.stress.means import STENCIL, refused
from tests.stress.resistive import Chain, Heading, connection, resisted
from tests.stress.verdict import Dice, Judged, Kind, above, apart, spread
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.systems.planar.shape import chain_shape
from wormopt.systems.planar.swimming.best import best_stroke, curvature, heights
from wormopt.systems.planar.swimming.swimmer import Swimmer

_NONE = (0.0, 0.0)

Course = Callable[[float], tuple[np.ndarray, np.ndarray]]


def _connected(
    chain: Chain, rods: tuple[float, float], masses: tuple[float, float], s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    return connection(resisted(chain, s, rods, masses))


def _curved(
    chain: Chain, rods: tuple[float, float], masses: tuple[float, float], s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Curvature by pairs of shape variables, by differences, and the connection."""
    n_s, step = len(s), 1e-3
    A = _connected(chain, rods, masses, s)[0]
    by = np.zeros((n_s, *A.shape))
    for k in range(n_s):
        for times, weight in STENCIL:
            moved = s + times * step * np.eye(n_s)[k]
            by[k] += weight / step * _connected(chain, rods, masses, moved)[0]
    pairs = [(i, j) for i in range(n_s) for j in range(i + 1, n_s)]
    columns = []
    for i, j in pairs:
        a, b = (_twist(A[:, k]) for k in (i, j))
        bracket = a @ b - b @ a
        along = by[i][:, j] - by[j][:, i]
        columns.append(along + np.array([bracket[0, 2], bracket[1, 2], bracket[1, 0]]))
    return np.array(columns).T, A


def _twist(v: np.ndarray) -> np.ndarray:
    """As a matrix that moves points."""
    return np.array([[0.0, -v[2], v[0]], [v[2], 0.0, v[1]], [0.0, 0.0, 0.0]])


def _curvature(dice: Dice) -> Judged:
    """Any chain, its lengths of order 1; twists are told at its head."""
    n = int(dice.integers(3, 6))
    heading: Heading = ("bisector", "front", "rear")[int(dice.integers(3))]
    lengths = tuple(dice.uniform(0.3, 2.0, n).tolist())
    rods = (1.0, spread(dice, 1.01, 1e4))
    each = spread(dice, 1e-2, 1e2) if dice.random() < 0.3 else 0.0
    masses = (each, each)
    s = dice.uniform(-1, 1, n - 1) * spread(dice, 1e-2, 2.5)
    body = Swimmer(chain_shape(n, lengths=lengths, heading=heading), rods, masses)
    known, A = _curved(Chain(n, lengths, heading), rods, masses, s)
    size = float(np.abs(A).max() ** 2 + np.abs(A).max())
    yield "curvature", apart(np.asarray(curvature(body)(s)), known, 1e-7, size=size * 1e-2)


def _heights(dice: Dice) -> Judged:
    """Small loops: way and turn of a stroke that goes round once, over its area."""
    lengths = tuple(dice.uniform(0.5, 1.5, 3).tolist())
    rods = (1.0, spread(dice, 1.1, 100.0))
    body = Swimmer(chain_shape(3, lengths=lengths), rods)
    s = dice.uniform(-1.5, 1.5, 2)
    known, A = _curved(Chain(3, lengths, "bisector"), rods, _NONE, s)
    size = float(np.abs(A).max() ** 2 + np.abs(A).max()) * 1e-2
    yield "head", apart(heights(body, "head").at(s)[0], known[:, 0], 1e-7, size=size)
    for frame in ("middle", "calm"):
        turn = heights(body, frame).at(s)[0, 2]
        yield f"turn, {frame}", apart(turn, known[2, 0], 1e-7, size=size)
    back = heights(body, "head").at(-s)[0]  # of the mirror image a loop goes round backward
    yield "mirrored", apart(back, known[:, 0] * [1, -1, -1], 1e-7, size=size)


def _followed(
    chain: Chain, rods: tuple[float, float], stroke: Course, breaks: np.ndarray
) -> tuple[np.ndarray, float]:
    """Displacement and work of a stroke in unit time."""

    def rates(tau: float, y: np.ndarray) -> np.ndarray:
        s, ds = stroke(tau)
        A, G = _connected(chain, rods, _NONE, s)
        v, w, turn = A @ ds
        c, n = math.cos(y[2]), math.sin(y[2])
        return np.array([c * v - n * w, n * v + c * w, turn, ds @ G @ ds])

    y = np.zeros(4)
    for a, b in pairwise(breaks):
        y = solve_ivp(rates, (a, b * (1 - 1e-13)), y, rtol=1e-7, atol=1e-9).y[:, -1]
    return y[:3], float(y[3])


_MESH = Mesh.even(1, 10, Collocation(5, "legendre"), 4)


def _best(dice: Dice) -> Judged:
    """A chain of three links, alike at both ends: strokes that go round evenly do not turn it."""
    end, middle = dice.uniform(0.7, 1.3, 2).tolist()
    lengths, rods = (end, middle, end), (1.0, float(dice.uniform(1.5, 4.0)))
    limit = float(dice.uniform(1.0, 2.2))
    body, chain = Swimmer(chain_shape(3, lengths=lengths), rods), Chain(3, lengths, "bisector")
    found = best_stroke(body, -limit, limit, starts=1, mesh=_MESH, tolerance=1e-3)
    drag = float(resisted(chain, np.zeros(2), rods, _NONE)[0, 0])

    def at(tau: float) -> tuple[np.ndarray, np.ndarray]:
        s, ds = found.stroke.at([tau])
        return s[0], ds[0]

    pose, work = _followed(chain, rods, at, found.stroke.breaks)
    yield "efficiency", apart(found.value, drag * (pose[:2] @ pose[:2]) / work, 1e-4)
    yield "turn", abs(pose[2]) / 1e-4
    shapes = found.stroke.at(np.linspace(0, 1, 401))[0]
    yield "limits", above(float(np.abs(shapes).max()), limit, 1e-3)
    for _ in range(6):
        half = dice.uniform(0.2, 1.0, 2) * limit / math.sqrt(2)

        def even(tau: float, half: np.ndarray = half) -> tuple[np.ndarray, np.ndarray]:
            angle = 2 * math.pi * tau
            both = np.array([[1, 1], [1, -1]]) / math.sqrt(2)
            return (
                both @ (half * [math.cos(angle), math.sin(angle)]),
                2 * math.pi * both @ (half * [-math.sin(angle), math.cos(angle)]),
            )

        pose, work = _followed(chain, rods, even, np.linspace(0, 1, 3))
        yield "beaten", above(drag * float(pose[:2] @ pose[:2]) / work, found.value, 1e-4)


def _no_stroke(dice: Dice) -> Judged:
    """Bodies and limits that have no best stroke."""
    limit = spread(dice, 0.1, 3.0)
    purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), (1.0, 2.0))
    scallop = Swimmer(chain_shape(2, lengths=(1.0, 1.0)), (1.0, 2.0))
    yield (
        "scallop",
        refused(lambda: best_stroke(scallop, -limit, limit), "two or more shape variables"),
    )
    yield "limits", refused(lambda: best_stroke(purcell, limit, -limit), "lower limit", "below")
    yield "none", refused(lambda: best_stroke(purcell, -math.inf, limit), "limits")
    yield "one angle", refused(lambda: heights(scallop), "two shape variables")


STROKES: tuple[Kind, ...] = (
    ("curvatures of swimmers", _curvature, 12),
    ("heights of swimmers", _heights, 8),
    ("best strokes", _best, 4),
    ("no best strokes", _no_stroke, 2),
)
