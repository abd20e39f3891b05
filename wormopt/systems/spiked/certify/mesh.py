"""Simplices of the masses' velocities on which it is known who rests and how each link moves.

A worm that crawls has velocities V ≥ 0, of which at least `resting` are 0, and link rates
V[j-1] - V[j] within limits. Planes V[i] = 0 and V[j-1] = V[j] cut this set into polytopes whose
corners are whole numbers where the rates are: the matrix is that of a network. Each polytope is
divided into the simplices below the lower hull of Σ (V[i] - V[k])², and these are divided
edgewise. Both divisions of a common face agree. For alike rates they are the alcoves of A_n.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations, product

import numpy as np

from wormopt.systems.shared.sequences import Resting

# Heights of corners are changed by this share of the largest, so that no two hulls fit.
_TILT = 1e-5
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Mesh:
    """Simplices by the masses that rest on all of each, `vertices` (count, n + 1) as integers."""

    vertices: np.ndarray
    pieces: dict[Resting, np.ndarray]  # (count, dimension + 1), numbers of vertices

    def finer(self, parts: int) -> Mesh:
        """Divide every edge into equal parts; the unit of velocity is divided by their number."""
        if parts == 1:
            return self
        numbers: dict[tuple[int, ...], int] = {}
        finer = {}
        for resting, simplices in self.pieces.items():
            shares = _edgewise(simplices.shape[1] - 1, parts)
            points = np.einsum("kaq,pqi->pkai", shares, self.vertices[simplices])
            flat = points.reshape(-1, points.shape[-1]).tolist()
            found = [numbers.setdefault(tuple(point), len(numbers)) for point in flat]
            finer[resting] = np.array(found).reshape(-1, simplices.shape[1])
        return Mesh(np.array(list(numbers)), finer)

    def with_faces(self, sizes: range) -> dict[Resting, np.ndarray]:
        """Add the faces with numbers of resting masses in `sizes`."""
        masses = self.vertices.shape[1]
        every = [simplex for simplices in self.pieces.values() for simplex in simplices.tolist()]
        found = dict(self.pieces)
        for size in sizes:
            for resting in combinations(range(masses), size):
                still = np.all(self.vertices[:, list(resting)] == 0, axis=1)
                faces = {tuple(i for i in simplex if still[i]) for simplex in every}
                whole = sorted(face for face in faces if len(face) == masses - size + 1)
                if whole:
                    found[resting] = np.array(whole)
        return found

    @cached_property
    def is_mirrored(self) -> bool:
        """Whether head and tail exchanged it is the same."""
        last = self.vertices.shape[1] - 1
        points = [tuple(vertex) for vertex in self.vertices.tolist()]

        def shapes(resting: Resting, turn: int) -> set[frozenset[tuple[int, ...]]]:
            every = self.pieces[resting].tolist()
            return {frozenset(points[i][::turn] for i in simplex) for simplex in every}

        return all(
            shapes(resting, 1) == shapes(tuple(sorted(last - i for i in resting)), -1)
            for resting in self.pieces
        )


def mesh_of(rates: np.ndarray, resting: int) -> Mesh:
    """Divide all velocities with `resting` masses at rest; `rates` (2, n) are whole numbers."""
    links = rates.shape[1]
    numbers: dict[tuple[int, ...], int] = {}
    found: dict[Resting, list[list[int]]] = {}
    for still in combinations(range(links + 1), resting):
        for signs in product((1, -1), repeat=links):
            corners = _corners(rates, still, np.array(signs))
            for simplex in _simplices(corners, still, float(rates.max())):
                # alcoves divide into alcoves in this order
                simplex = sorted(simplex, key=lambda v: (sum(v[0] - x for x in v), v))
                own = [numbers.setdefault(vertex, len(numbers)) for vertex in simplex]
                found.setdefault(still, []).append(own)
    return Mesh(np.array(list(numbers)), {s: np.array(own) for s, own in found.items()})


def _corners(rates: np.ndarray, still: Resting, signs: np.ndarray) -> np.ndarray:
    """Velocities at the corners of the polytope where these rest and rates have these signs."""
    links = len(signs)
    moving = [i for i in range(links + 1) if i not in still]
    rate = (signs[:, None] * -np.diff(np.eye(links + 1), axis=0))[:, moving]
    if np.any((signs < 0) & ~rate.any(axis=1)):  # two neighbours rest: one sign is enough
        return np.empty((0, links + 1))
    most = np.where(signs > 0, rates[1], rates[0])
    normals = np.vstack([np.eye(len(moving)), rate, -rate])
    sides = np.concatenate([np.zeros(len(moving) + links), most])  # normals V + sides >= 0
    chosen = np.array(list(combinations(range(len(sides)), len(moving))))
    chosen = chosen[np.abs(np.linalg.det(normals[chosen])) > 0.5]
    points = np.rint(np.linalg.solve(normals[chosen], -sides[chosen][:, :, None])[:, :, 0])
    inside = np.all(points @ normals.T + sides > -0.5, axis=1)
    points = np.unique(points[inside], axis=0)
    whole = np.zeros((len(points), links + 1))
    whole[:, moving] = points
    return whole


def _simplices(corners: np.ndarray, still: Resting, size: float) -> list[list[tuple[int, ...]]]:
    """Divide a polytope at the lower hull of heights that depend on its corners alone."""
    moving = [i for i in range(corners.shape[1]) if i not in still]
    count = len(moving) + 1
    if len(corners) < count:
        return []
    scaled = corners / size
    height = ((scaled[:, :, None] - scaled[:, None]) ** 2).sum(axis=(1, 2))
    ends = scaled + scaled[:, ::-1]  # the same for mirror images
    height += _TILT * np.sin(1.0 + ends @ np.arange(1.0, corners.shape[1] + 1))
    points = np.hstack([scaled[:, moving], np.ones((len(corners), 1))])
    chosen = np.array(list(combinations(range(len(corners)), count)))
    chosen = chosen[np.abs(np.linalg.det(points[chosen])) > _FLAT]
    if not len(chosen):
        return []
    below = np.linalg.solve(points[chosen], height[chosen][:, :, None])[:, :, 0]
    lowest = np.min(height - below @ points.T, axis=1) > -_FLAT
    whole = [tuple(corner) for corner in corners.astype(int).tolist()]
    return [[whole[i] for i in simplex] for simplex in chosen[lowest].tolist()]


def _edgewise(dimension: int, parts: int) -> np.ndarray:
    """Shares (count, vertex, vertex of the whole) of the parts of a simplex, times `parts`."""
    found = []
    for start in product(range(parts), repeat=dimension):
        for order in permutations(range(dimension)):
            path = np.vstack([np.zeros(dimension), np.cumsum(np.eye(dimension)[list(order)], 0)])
            path = np.hstack([np.full((dimension + 1, 1), parts), start + path, 0 * path[:, :1]])
            shares = -np.diff(path, axis=1)
            if shares.min(initial=0) >= 0:
                found.append(shares)
    return np.array(found).astype(int)
