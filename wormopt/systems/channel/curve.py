"""Plane curves by their length, distances of two curves, and the centre line of a rod."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from wormopt.errors import ArgumentError
from wormopt.numerics.chebyshev import Series, resolve
from wormopt.systems.channel.rod import Rod

# Gauss points per element for lengths, steps of Newton's method, and size of round-off.
_POINTS, _STEPS, _ROUNDING = 24, 60, 1e-15


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve by the share of its length, 0 to 1."""

    length: float
    points: Callable[[np.ndarray], np.ndarray]  # shares (m,) to x, y and angle of tangent (3, m)
    breaks: tuple[float, ...] = (0.0, 1.0)  # shares from 0 to 1 between which it is smooth

    def steepest(self) -> float:
        """Largest angle of the tangent."""
        pieces = pairwise(self.breaks)
        return max(
            float(resolve(lambda s: self.points(s)[2:], a, b).extremes()[1][0]) for a, b in pieces
        )


def graph_curve(height: Callable[[np.ndarray], np.ndarray], span: float) -> Curve:
    """Return the curve of a smooth function y = height(x), 0 <= x <= span, with span > 0.

    `height` maps positions (m,) to heights (m,).
    """
    slope = resolve(lambda x: height(x)[None], 0.0, span).derivative()
    stretch = resolve(lambda x: np.hypot(1.0, slope(x)), 0.0, span)
    along = stretch.primitive()
    length = float(along(np.array([span]))[0, 0])

    def points(share: np.ndarray) -> np.ndarray:
        wanted = length * np.asarray(share, dtype=float)
        x = wanted * span / length
        for _ in range(_STEPS):
            step = (along(x)[0] - wanted) / stretch(x)[0]
            x = np.clip(x - step, 0.0, span)
            if np.abs(step).max(initial=0.0) <= _ROUNDING * span:
                break
        return np.array([x, height(x), np.arctan(slope(x)[0])])

    return Curve(length, points)


def distances(one: Curve, other: Curve) -> tuple[float, float]:
    """Return largest and root mean square distance of points at the same share of the length.

    Neither is less than the distance of a point of one curve from the nearest point of the other.
    """

    def squares(share: np.ndarray) -> np.ndarray:
        apart = one.points(share)[:2] - other.points(share)[:2]
        return (apart**2).sum(axis=0)[None]

    breaks = sorted({*one.breaks, *other.breaks})
    pieces: list[Series] = [resolve(squares, a, b) for a, b in pairwise(breaks)]
    largest = max(float(series.extremes()[1][0]) for series in pieces)
    mean = sum(float(series.integral()[0]) for series in pieces)
    return float(np.sqrt(max(largest, 0.0))), float(np.sqrt(max(mean, 0.0)))


@dataclass(frozen=True, eq=False)
class RodLine:
    """Polynomials of places and angles on the elements of a rod.

    Raises ArgumentError if the number of places is wrong, or one is not finite.
    """

    rod: Rod
    places: np.ndarray  # (3 * count,) x of nodes, then y, then section angles

    def __post_init__(self) -> None:
        fits = np.shape(self.places) == (3 * self.rod.count,)
        if not fits or not np.all(np.isfinite(self.places)):
            raise ArgumentError(f"places must be {3 * self.rod.count} finite numbers")

    def at(self, material: np.ndarray) -> np.ndarray:
        """Return places and angles (3, m) at distances `material` (m,) from the first end.

        Distances are along the straight rod, in elements: 0 to ``elements``.
        """
        return self._evaluated(self._series, material)

    def slope(self, material: np.ndarray) -> np.ndarray:
        """Return derivatives (3, m) of `at`, per element."""
        return self._evaluated(2 * legendre.legder(self._series), material)

    def crossings(self, x: float) -> np.ndarray:
        """Return where the centre line passes `x`, as `at` takes it, ascending; may be empty."""
        found = []
        for k in range(self.rod.elements):
            series = self._series[:, 0, k].copy()
            series[0] -= x
            roots = legendre.legroots(legendre.legtrim(series, 1e-14 * np.abs(series).max()))
            real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
            found.extend(k + (np.clip(real[np.abs(real) <= 1 + 1e-12], -1, 1) + 1) / 2)
        ordered = np.sort(np.array(found, dtype=float))
        apart = np.diff(ordered, prepend=-np.inf) > 1e-9  # at nodes two elements find the same
        return ordered[apart]

    def between(self, first: float, last: float) -> Curve:
        """Return the centre line between two x, by its own length, from the end nearer `first`.

        Angles are of the cross sections. If an x is passed several times, all between is included.
        Raises ArgumentError if the rod does not reach from one to the other.
        """
        edges, forward = self._edges(first, last)
        lengths = np.array([self._length(*pair) for pair in pairwise(edges)])
        upto = np.append(0.0, np.cumsum(lengths))
        whole = float(upto[-1])

        def points(share: np.ndarray) -> np.ndarray:
            share = np.asarray(share, dtype=float)
            wanted = whole * (share if forward else 1 - share)
            x, y, angle = self.at(self._material(edges, upto, wanted))
            return np.array([x, y, angle if forward else angle - np.pi])

        shares = upto / whole if forward else (1 - upto / whole)[::-1]
        return Curve(whole, points, (0.0, *shares[1:-1].tolist(), 1.0))

    def curvature(self, first: float, last: float) -> tuple[float, float]:
        """Return half the integral of squared curvature, and largest curvature, between two x.

        Both are in 1/m, per length of the straight rod; raises ArgumentError like `between`.
        """
        edges, _ = self._edges(first, last)
        size = self.rod.length / self.rod.elements
        energy, largest = 0.0, 0.0
        nodes, weights = legendre.leggauss(_POINTS)
        for a, b in pairwise(edges.tolist()):
            bend = self.slope(a + (nodes + 1) / 2 * (b - a))[2] / size
            energy += size * (b - a) / 4 * float(weights @ bend**2)
            largest = max(largest, float(np.abs(bend).max()))
        return energy, largest

    def unloaded(self, first: float, last: float) -> float:
        """Return the length of the straight rod that lies between two x.

        Raises ArgumentError like `between`.
        """
        edges, _ = self._edges(first, last)
        return float(edges[-1] - edges[0]) * self.rod.length / self.rod.elements

    def _edges(self, first: float, last: float) -> tuple[np.ndarray, bool]:
        """Return ends of the part between, with those of elements; whether it starts at `first`."""
        begins, ends = self.crossings(first), self.crossings(last)
        if not (begins.size and ends.size):
            raise ArgumentError(f"the rod does not reach from {first:g} m to {last:g} m")
        forward = bool(begins[0] < ends[-1])
        a, b = (begins[0], ends[-1]) if forward else (begins[-1], ends[0])
        low, high = min(a, b), max(a, b)
        return np.array([low, *np.arange(np.floor(low) + 1, np.ceil(high)), high]), forward

    @cached_property
    def _series(self) -> np.ndarray:
        """Legendre coefficients, shape (degree + 1, 3, elements)."""
        rod, degree = self.rod, self.rod.degree
        local = 2 * rod.nodes[: degree + 1] / rod.nodes[degree] - 1
        first = np.arange(rod.elements) * degree
        own = self.places.reshape(3, -1)[:, first[:, None] + np.arange(degree + 1)]
        inverse = np.linalg.inv(legendre.legvander(local, degree))
        return np.einsum("ij,kej->ike", inverse, own)

    def _evaluated(self, series: np.ndarray, material: np.ndarray) -> np.ndarray:
        material = np.asarray(material, dtype=float)
        which = np.clip(np.floor(material).astype(int), 0, self.rod.elements - 1)
        return legendre.legval(2 * (material - which) - 1, series[:, :, which], tensor=False)

    def _length(self, low: float, high: float) -> float:
        nodes, weights = legendre.leggauss(_POINTS)
        # just inside of the element, not on the next one
        x, y, _ = self.slope(low + (nodes + 1) / 2 * (high - low))
        return float((high - low) / 2 * (weights @ np.hypot(x, y)))

    def _material(self, edges: np.ndarray, upto: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return where the length from the first edge is as wanted, by Newton's method."""
        which = np.clip(np.searchsorted(upto, wanted, side="right") - 1, 0, len(edges) - 2)
        low, high = edges[which], edges[which + 1]
        rest = wanted - upto[which]
        share = rest / (upto[which + 1] - upto[which])
        nodes, weights = legendre.leggauss(_POINTS)
        for _ in range(_STEPS):
            inner = low + np.multiply.outer((nodes + 1) / 2, share * (high - low))
            speeds = np.hypot(*self.slope(inner.ravel())[:2]).reshape(inner.shape)
            reached = weights @ speeds / 2 * share * (high - low)
            here = low + share * (high - low)
            speed = np.hypot(*self.slope(here)[:2]) * (high - low)
            step = (reached - rest) / speed
            share = np.clip(share - step, 0.0, 1.0)
            if np.abs(step).max(initial=0.0) <= 4 * _ROUNDING:
                break
        return low + share * (high - low)
