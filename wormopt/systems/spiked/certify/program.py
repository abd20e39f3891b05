"""A linear program whose solution bounds the speed of every gait, with any phases and period.

Let y_j be the length at which link j would stop, minus its shortest length. W(y, V) is continuous,
multilinear in y on cells, and of degree p in V on simplices. If dW/dt + (V_0 + V_n)/2 <= B for
every admissible motion, B bounds the mean speed. With W in Bernstein form, this becomes finitely
many rows, linear in the coefficients of W and in B.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import chain, combinations, permutations, product
from typing import Any, NamedTuple

import numpy as np

from wormopt.numerics.linear_program import interior_point
from wormopt.systems.shared.sequences import Resting
from wormopt.systems.spiked.certify.statement import Statement, rounded_up, up, wider
from wormopt.systems.spiked.programs.scaled_limits import of_actuators


class Level(NamedTuple):
    """Resolution of W."""

    parts: int  # on every edge of the simplices
    cells: int  # over every link's stopping length
    degree: int  # in the velocities


# Level of the programs for mean rates; factor by which strokes must shrink to continue.
OF_STROKES, _SHORTER = Level(1, 1, 3), 0.999
# Corners of accelerations: tolerance of being inside, smallest determinant, and decimals in which
# equal corners agree.
_OUTSIDE, _FLAT, _SAME = 1e-9, 1e-9, 7
# Programs for longer worms, or with more moving masses, are too large.
_MOST_LINKS, _MOST_DIMENSIONS = 6, 3
# Coefficients of the program below this are rounding.
_NOTHING = 1e-12
# Decimals of the unit in which values of W are whole numbers.
_PART = 9
# Bound on |W| and on the bound, in units in which rates and strokes are at most 1.
_LARGEST = 100.0
# Perturbation of the heights of corners, so that the lower hull is unique.
_TILT, _FLAT_HULL = 1e-5, 1e-9


class Corners(NamedTuple):
    """Accelerations whose convex hulls contain the admissible ones of simplices.

    They are linear in the velocities and given at the d + 1 vertices of their simplex; without drag
    they are equal at all vertices.
    """

    simplex: np.ndarray  # (k,) index of the simplex
    masses: np.ndarray  # (k, d + 1, d), moving masses only
    links: np.ndarray  # (k, d + 1, n)


@dataclass(frozen=True, eq=False)
class Face:
    """Simplices with the same masses at rest."""

    resting: Resting
    simplices: np.ndarray  # (count, d + 1), numbers of vertices
    velocities: np.ndarray  # (count, d + 1, n + 1)

    @cached_property
    def moving(self) -> list[int]:
        return [i for i in range(self.velocities.shape[2]) if i not in self.resting]

    @cached_property
    def rates(self) -> np.ndarray:
        """Link rates at the vertices, (count, d + 1, n)."""
        return -np.diff(self.velocities, axis=2)

    @cached_property
    def signs(self) -> np.ndarray:
        """Signs of the link rates, (count, n)."""
        return np.sign(self.rates.sum(axis=1))


class Outer:
    """Numbers of a statement for a proof, some of them widened, in scaled units."""

    def __init__(self, statement: Statement) -> None:
        self.statement = statement
        self.rates = statement.rates_taken
        self.part = max(statement.ranges) / 10**_PART
        self.rate_unit = _common([x for way in self.rates for x in way])
        self.speed, self.length = float(max(map(max, self.rates))), float(max(statement.ranges))
        self._acceleration = self.speed**2 / self.length
        self._force = float(sum(statement.masses)) / len(statement.masses) * self._acceleration
        self.most = _floats(statement.acceleration) / self._acceleration
        self.mesh: Mesh | None = None
        n = statement.links
        if n <= _MOST_LINKS and n + 1 - statement.resting <= _MOST_DIMENSIONS:
            whole = np.array([[int(x / self.rate_unit) for x in way] for way in self.rates])
            self.mesh = mesh_of(whole, statement.resting)
        self.starts, self.brakes = statement.most, statement.most
        if self.mesh is not None:
            starts, brakes = self._extremes(self.mesh)
            if min(starts.min(), brakes.min()) > 0:
                self.starts, self.brakes = wider(starts), wider(brakes)
            else:  # no gait exists, because limits on forces are too tight
                self.mesh = None
        self.slowing = self.brakes.astype(float) / self._acceleration
        self.strokes = statement.strokes(self.starts, self.brakes)
        self._earlier: list[dict[str, Any]] = []  # proofs of strokes

    @property
    def width(self) -> np.ndarray:
        """Strokes in units of the longest range."""
        return _floats(self.strokes) / self.length

    @property
    def is_mirrored(self) -> bool:
        """Whether the worm is symmetric under exchange of head and tail."""
        s = self.statement
        both = [s.masses, s.beyond, s.acceleration, s.spike_load, s.actuator_force, self.strokes]
        ways = [self.rates, self.starts.tolist(), self.brakes.tolist()]
        return all(x is None or list(x) == list(x)[::-1] for x in both) and all(
            list(way[0]) == list(way[1])[::-1] for way in ways
        )

    @property
    def is_single(self) -> bool:
        """Whether there is one link without drag, so that its mean rate is the best possible bound.

        A motion within the limits on rates and accelerations has this mean rate.
        """
        return self.statement.links == 1 and not self.statement.drag

    def shorten(self, seconds: float) -> None:
        """Shorten strokes: in a period a link covers its stroke twice, at most at its mean rate.

        If only one mass must rest, a link can be as fast as it is alone, and nothing is gained.
        """
        s, mirrored, until = self.statement, self.is_mirrored, time.perf_counter() + seconds
        while self.mesh and s.resting > 1 and time.perf_counter() < until:
            found, proofs = list(self.strokes), []
            for j, stroke in enumerate(self.strokes):
                if time.perf_counter() > until:
                    return
                bound, proof = Program(self, OF_STROKES, j).solve(until - time.perf_counter())
                most = rounded_up(max(bound, 0.0))
                if most * s.period / 2 < stroke:
                    found[j] = up(most * s.period / 2, self.part)
                    proofs.append({"link": j, "bound": most, "proof": proof})
            if mirrored:
                found = [max(pair) for pair in zip(found, found[::-1], strict=True)]
            if all(new >= _SHORTER * old for new, old in zip(found, self.strokes, strict=True)):
                return
            self.strokes = tuple(found)
            self._earlier = [*self._earlier, *proofs]

    def faces(self, mesh: Mesh, parts: int) -> Iterator[Face]:
        """Yield the simplices that need rows, by their resting masses."""
        fewest = self.statement.resting
        most = self.statement.links if self.statement.loads_matter else fewest
        unit = float(self.rate_unit) / parts / self.speed
        for resting, simplices in mesh.with_faces(range(fewest + 1, most + 1)).items():
            yield Face(resting, simplices, mesh.vertices[simplices] * unit)

    def corners(self, face: Face) -> Corners:
        """Corners of the accelerations that the limits admit on each simplex."""
        s, count = self.statement, len(self.statement.masses)
        mass = _floats(s.masses) * self._acceleration / self._force
        drag = float(s.drag) * self.speed / self._force
        step = -np.diff(np.eye(count), axis=0)
        rows = [(step, self.most, self.most)]  # weights, room above and below
        low, high = (float(x) / self._force for x in s.load)
        spikes, rest = s.spike_load, face.resting
        above = np.inf
        if spikes is not None:
            own = [float(spikes[i]) for i in rest]
            shared = len(own) * min(own) if s.sharing == "equal" else sum(own)
            above = shared / self._force - count * high
        below = count * (low - float(s.sigma_margin) / self._force)
        rows.append((np.ones((1, count)), np.array([above]), np.array([below])))
        if s.actuator_force is not None and (len(rest) == 1 or s.sharing == "equal"):
            weights, per_load = of_actuators(rest, count)
            most = _floats(s.actuator_force) / self._force
            own = weights @ _floats(s.beyond) / self._force
            ends = np.sort(np.outer(per_load, [low, high]), axis=1) + own[:, None]
            rows.append((weights, most - ends[:, 1], most + ends[:, 0]))
        normals, sides, follow = [], [], []
        for number, (weights, above, below) in enumerate(rows):
            forces = number > 0
            acting = (weights * mass if forces else weights)[:, face.moving]
            dragged = forces * drag * face.velocities @ weights.T
            for sign, room in ((-1.0, above), (1.0, below)):
                used = np.isfinite(room) & acting.any(axis=1)
                normals.append(sign * acting[used])
                sides.append((room + sign * dragged)[:, :, used])
                follow.append(np.full(used.sum(), number == 1))  # the sum of the reactions
        own = _vertices(np.vstack(normals), np.concatenate(sides, axis=2), np.hstack(follow))
        return Corners(*own, own[1] @ step[:, face.moving].T)

    def proof(self, mesh: Mesh | None = None, parts: int = 1, whole: bool = True) -> dict[str, Any]:
        """Data of a proof: motion of the links and, with `mesh`, the simplices.

        `whole`: with the proofs of strokes.
        """
        known: dict[str, Any] = {
            "strokes": self.strokes,
            "rates": self.rates,
            "starts": self.starts.tolist(),
            "brakes": self.brakes.tolist(),
        }
        if whole and self._earlier:
            known["stroke_proofs"] = self._earlier
        if mesh is None:
            return known
        return known | {
            "mesh_unit": self.rate_unit / parts,
            "vertices": mesh.vertices.tolist(),
            "pieces": [simplex for own in mesh.pieces.values() for simplex in own.tolist()],
        }

    def _extremes(self, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
        """Largest accelerations (2, n) of contracting and extending links, along and against it."""
        found = np.zeros((2, 2, self.statement.links))
        for face in self.faces(mesh, 1):
            corners = self.corners(face)
            signs = face.signs[corners.simplex][:, None]
            for way, sign in enumerate((-1, 1)):
                own = np.where(signs == sign, sign * corners.links, 0.0)
                for k, value in enumerate((own, -own)):
                    found[k, way] = np.maximum(found[k, way], value.max(axis=(0, 1), initial=0.0))
        return found[0] * self._acceleration, found[1] * self._acceleration


def _floats(values: tuple[Fraction, ...]) -> np.ndarray:
    return np.array([float(x) for x in values])


def _common(values: list[Fraction]) -> Fraction:
    """Largest fraction whose whole multiples they all are."""
    below = math.lcm(*(x.denominator for x in values))
    return Fraction(math.gcd(*(int(x * below) for x in values)), below)


def _vertices(
    normals: np.ndarray, sides: np.ndarray, follow: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points, linear in λ, whose convex hull contains the polytopes normals x + Σ λ_c sides_c >= 0.

    `sides` (count, c, rows) are widened to their largest, except for rows in `follow`, whose
    normals must be equal. A vertex on such a row moves along its edge while it stays admissible.
    Returns the indices (k,) of the polytopes, and the points (k, c, d).
    """
    length = np.linalg.norm(normals, axis=1)
    normals, sides = normals / length[:, None], sides / length
    widest = sides.max(axis=1)
    sides = np.where(follow, sides, widest[:, None])
    numbers, points = [], []
    for chosen in map(list, combinations(range(len(normals)), normals.shape[1])):
        if abs(np.linalg.det(normals[chosen])) < _FLAT:
            continue
        inverse = np.linalg.inv(normals[chosen]).T
        own = -widest[:, chosen] @ inverse
        away = _OUTSIDE * (1.0 + np.abs(own).max(axis=1, keepdims=True))
        inside = np.all(own @ normals.T + widest > -away, axis=1)
        at = np.repeat(own[:, None], sides.shape[1], axis=1)
        if follow[chosen].any():
            moved = -sides[:, :, chosen] @ inverse
            left = (moved @ normals.T + widest[:, None])[:, :, ~follow]
            at = np.where(np.all(left > -away[:, None], axis=(1, 2))[:, None, None], moved, at)
        numbers.append(np.flatnonzero(inside))
        points.append(at[inside])
    number, point = np.concatenate(numbers), np.concatenate(points)
    flat = np.round(point, _SAME).reshape(len(point), math.prod(point.shape[1:]))
    alike = np.column_stack([number, flat])
    first = np.unique(alike, axis=0, return_index=True)[1]
    return number[first], point[first]


class Program:
    """The linear program of a level, for the speed or for the mean rate of a link."""

    def __init__(self, outer: Outer, level: Level, link: int | None = None) -> None:
        self._outer, self.level, self._link = outer, level, link
        assert outer.mesh is not None
        self.mesh = outer.mesh.finer(level.parts)
        self._cells = level.cells + 1
        self._faces = list(outer.faces(self.mesh, level.parts))
        corners = [self.mesh.vertices[face.simplices] for face in self._faces]
        places = [
            np.einsum("aq,pqi->pai", _exponents(level.degree, own.shape[1]), own) for own in corners
        ]
        flat = np.concatenate([place.reshape(-1, place.shape[2]) for place in places])
        self.points, number = np.unique(flat, axis=0, return_inverse=True)
        ends = np.cumsum([place.shape[0] * place.shape[1] for place in places])[:-1]
        split = np.split(number.ravel(), ends)
        self._places = [n.reshape(p.shape[:2]) for n, p in zip(split, places, strict=True)]
        self._column = self._columns()

    @cached_property
    def _mirrored(self) -> bool:
        return self._link is None and self._outer.is_mirrored and self.mesh.is_mirrored

    def _columns(self) -> np.ndarray:
        """Index of the unknown (point, place in y); pairs that the mirror exchanges share one."""
        n = self._outer.statement.links
        number = np.arange(len(self.points) * self._cells**n)
        if self._mirrored:
            found = {point: k for k, point in enumerate(map(tuple, self.points.tolist()))}
            other = [found[point[::-1]] for point in found]
            whole = number.reshape(-1, *(self._cells,) * n)[other]
            image = np.flip(whole, tuple(range(1, n + 1))).transpose(0, *range(n, 0, -1)).ravel()
            number = np.unique(np.minimum(number, image), return_inverse=True)[1].ravel()
        return number.reshape(len(self.points), -1)

    def solve(self, seconds: float) -> tuple[float, dict[str, Any]]:
        """Solve within a time; return the bound of the W found, optimal or not, and its proof.

        The bound is exact up to the rounding of sums.
        """
        parts = [*chain.from_iterable(map(self._rows, self._faces, self._places))]
        count = int(self._column.max()) + 1
        rows = np.cumsum([0, *(len(cost) for *_, cost in parts)])
        row = np.concatenate([r + start for (r, *_), start in zip(parts, rows, strict=False)])
        column, value = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        cost = np.concatenate([part[3] for part in parts], dtype=float)
        every = np.arange(len(cost))
        entries = (
            np.append(row, every),
            np.append(column, np.full(len(cost), count)),
            np.append(value, np.full(len(cost), -1.0)),
        )
        w = interior_point(np.eye(1, count + 1, count)[0], entries, -cost, _LARGEST, seconds)[:-1]
        whole = np.rint(w * 10**_PART)
        w = whole / 10**_PART
        above = np.bincount(row, value * w[column], len(cost)) + cost
        proof = {
            "degree": self.level.degree,
            "cells": self.level.cells,
            "unit": self._outer.part,
            "points": self.points.tolist(),
            "values": whole.astype(int)[self._column].tolist(),
        }
        mesh = self._outer.proof(self.mesh, self.level.parts, self._link is None)
        return float(above.max()) * self._outer.speed, mesh | proof

    def _rows(
        self, face: Face, place: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Rows, columns and values of the coefficients of dW/dt, and the cost of each row."""
        if self._mirrored:
            face, place = _half(face, place, self.mesh)
        if not len(place):
            return
        n, o, degree = len(self._outer.most), self._outer, self.level.degree
        corners = o.corners(face)
        at = corners.simplex
        signs = face.signs[at][:, None]
        slowing = np.where(signs > 0, o.slowing[1], o.slowing[0])
        gain = (1.0 + signs * corners.links / slowing) / (o.width / self.level.cells)
        velocities, last = face.velocities[:, :, face.moving], len(face.moving)
        moved = np.insert(velocities, last, 1.0, axis=2).transpose(0, 2, 1)
        pushed = np.insert(corners.masses, last, 0.0, axis=2).transpose(0, 2, 1)
        turn = np.linalg.solve(moved[at], pushed).transpose(0, 2, 1)
        size = turn.shape[2]
        slope, times = _derivative(degree, size), _product(degree, size)
        if o.statement.drag:  # accelerations are linear in the velocities
            degree, linear = degree + 1, _product(degree + 1, size)
        else:
            turn, gain, linear = turn[:, :1], gain[:, :1], np.eye(len(slope))[:, :, None]
        # dW/dV times the acceleration, and dW/dy times y'
        own = np.einsum("hgr,zrga->zha", linear, np.einsum("gaq,zrq->zrga", slope, turn))
        ways = np.einsum("gaq,zqj,zrj->jzrga", times, face.rates[at], gain, optimize=True)
        way = np.einsum("hgr,jzrga->jzha", linear, ways, optimize=True)
        if self._link is None:
            gained = (face.velocities[:, :, 0] + face.velocities[:, :, -1]) / 2
        else:
            gained = np.abs(face.rates[:, :, self._link])
        cost = (gained[at] @ _exponents(degree + 1, size).T / (degree + 1)).ravel()
        row = np.broadcast_to(np.arange(len(cost)).reshape(*own.shape[:2], 1), own.shape)
        stride = self._cells ** np.arange(n - 1, -1, -1)
        for cell in product(range(self.level.cells), repeat=n):
            for corner in product((0, 1), repeat=n):
                here = int((np.add(cell, corner) * stride).sum())
                sign = 1.0 - 2.0 * np.array(corner)
                entries = [(here, own - np.einsum("j,jzga->zga", sign, way))]
                entries += [
                    (here + int(s * k), s * w) for s, k, w in zip(sign, stride, way, strict=True)
                ]
                found = []
                for where, value in entries:
                    kept = np.abs(value) > _NOTHING
                    column = np.broadcast_to(self._column[place[at], where][:, None], value.shape)
                    found.append((row[kept], column[kept], value[kept]))
                yield *(np.concatenate(part) for part in zip(*found, strict=True)), cost  # pyright: ignore


def _half(face: Face, place: np.ndarray, mesh: Mesh) -> tuple[Face, np.ndarray]:
    """One of each pair of simplices that are mirror images."""
    image = tuple(sorted(mesh.vertices.shape[1] - 1 - i for i in face.resting))
    middle = mesh.vertices[face.simplices].sum(axis=1).tolist()
    kept = np.array([(face.resting, m) <= (image, m[::-1]) for m in middle], bool)
    return Face(face.resting, face.simplices[kept], face.velocities[kept]), place[kept]


def _exponents(degree: int, count: int) -> np.ndarray:
    """All exponents (k, count) of `count` barycentric coordinates."""
    every = [e for e in product(range(degree + 1), repeat=count) if sum(e) == degree]
    return np.array(every)


def _product(degree: int, count: int) -> np.ndarray:
    """Coefficients (g, a, q) of degree + 1 of W (a) times a linear function (q)."""
    low, high = _exponents(degree, count), _exponents(degree + 1, count)
    below = high[:, None, None] - np.eye(count, dtype=int)  # (g, 1, q, coordinate)
    return np.all(below == low[:, None], axis=3) * high[:, None] / (degree + 1)


def _derivative(degree: int, count: int) -> np.ndarray:
    """Coefficients (g, a, q) of degree + 1 of dW/dλ_q from W (a) of its degree, elevated twice."""
    lower = _product(degree - 1, count)
    slopes = degree * (lower > 0.0).swapaxes(0, 1)
    twice = _product(degree, count).sum(axis=2) @ lower.sum(axis=2)
    return np.einsum("gb,baq->gaq", twice, slopes)


def size_of(outer: Outer, level: Level) -> float:
    """Estimate the number of coefficients of a program, which determines its time."""
    assert outer.mesh is not None
    n = outer.statement.links
    dimension = n + 1 - outer.statement.resting
    simplices = sum(map(len, outer.mesh.pieces.values())) * level.parts**dimension
    own = math.comb(level.degree + 1 + dimension, dimension)
    return float(simplices * (2 * level.cells) ** n * own**2 * 2**dimension * n)


# -- simplices of the masses' velocities -----------------------------------------------------------
# A crawling worm has velocities V ≥ 0, at least `resting` of them 0, and link rates V[j-1] - V[j]
# within limits. The planes V[i] = 0 and V[j-1] = V[j] cut this set into polytopes. Their corners
# are whole numbers if the rates are, because the matrix is that of a network. Each polytope is
# divided into the simplices below the lower hull of Σ (V[i] - V[k])², and these are divided
# edgewise. Both divisions agree on common faces. With equal rates they are the alcoves of A_n.


@dataclass(frozen=True, eq=False)
class Mesh:
    """Simplices by the masses that rest on them, `vertices` (count, n + 1) as integers."""

    vertices: np.ndarray
    pieces: dict[Resting, np.ndarray]  # (count, dimension + 1), numbers of vertices

    def finer(self, parts: int) -> Mesh:
        """Divide every edge into equal parts, and the unit of velocity by their number."""
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
        """Whether the mesh is symmetric under exchange of head and tail."""
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
                # in this order, alcoves divide into alcoves
                simplex = sorted(simplex, key=lambda v: (sum(v[0] - x for x in v), v))
                own = [numbers.setdefault(vertex, len(numbers)) for vertex in simplex]
                found.setdefault(still, []).append(own)
    return Mesh(np.array(list(numbers)), {s: np.array(own) for s, own in found.items()})


def _corners(rates: np.ndarray, still: Resting, signs: np.ndarray) -> np.ndarray:
    """Velocities at the corners of the polytope with these masses at rest and signs of rates."""
    links = len(signs)
    moving = [i for i in range(links + 1) if i not in still]
    rate = (signs[:, None] * -np.diff(np.eye(links + 1), axis=0))[:, moving]
    if np.any((signs < 0) & ~rate.any(axis=1)):  # rate 0: one sign is enough
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
    """Divide a polytope by the lower hull of heights that depend only on its corners."""
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
    chosen = chosen[np.abs(np.linalg.det(points[chosen])) > _FLAT_HULL]
    if not len(chosen):
        return []
    below = np.linalg.solve(points[chosen], height[chosen][:, :, None])[:, :, 0]
    lowest = np.min(height - below @ points.T, axis=1) > -_FLAT_HULL
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
