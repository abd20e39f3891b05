"""A planar rod with any stretch, shear and bending: energy on finite elements, centre line.

The cross sections of the geometrically exact rod move as rigid discs: each has a place (x, y) and
an angle. Elements interpolate all three by polynomials on Gauss-Lobatto nodes. Strains are taken at
as many Gauss points as the degree, one less than exact quadrature of slender rods would need, so
shear does not lock for slender rods. Masses are lumped by Lobatto quadrature. Frequencies converge
at the order 2 degree.

Sources: E. Reissner, ZAMP 23 (1972) 795 for the strains; J. C. Simo, Comput. Methods Appl. Mech.
Eng. 49 (1985) 55; T. J. R. Hughes, The Finite Element Method (1987), 4.4 and 7.3 for the
quadratures; G. R. Cowper, J. Appl. Mech. 33 (1966) 335 for the shear of round sections.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from operator import itemgetter
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from wormopt.errors import ArgumentError
from wormopt.numerics.chebyshev import Series, resolve

_DIGITS = 1e-15


@dataclass(frozen=True)
class Stiffness:
    """Stiffnesses of a rod against its strains; numbers or CasADi expressions."""

    stretching: Any  # E A, N
    shearing: Any  # k G A, N
    bending: Any  # E I, N m²


@dataclass(frozen=True)
class Rod:
    """A round rod of linear elastic material, straight without load.

    Parameters
    ----------
    length, diameter : float
        Length and diameter, m.
    youngs_modulus : float
        Young's modulus, Pa.
    density : float
        Density, kg/m³.
    damping_time : float, optional
        Ratio of viscosity and Young's modulus of a Kelvin-Voigt material, in s: a vibration of
        angular frequency w loses 2 pi w times this share of its energy in a period.
    poisson_ratio : float, optional
        Poisson's ratio, 0.5 for constant volume.
    elements, degree : int, optional
        Number of elements, and degree of their polynomials.
    skin : float, optional
        Thickness, in m, of the skin of a rod that is filled with a fluid: only the skin resists
        strains, only the fluid is magnetised, `density` is that of the whole. Solid if 0.

    Raises
    ------
    ArgumentError
        If a value is not positive or out of its range.

    Examples
    --------
    >>> rod = Rod(length=48e-3, diameter=4e-3, youngs_modulus=5e4, density=1100.0, elements=12)
    >>> rod.count, float(rod.weights.sum().round(12)), round(rod.stiffness().bending * 1e9, 3)
    (25, 0.048, 628.319)
    """

    length: float
    diameter: float
    youngs_modulus: float
    density: float
    damping_time: float = 0.0
    poisson_ratio: float = 0.5
    elements: int = 24
    degree: int = 2
    skin: float = 0.0

    def __post_init__(self) -> None:
        least = {
            "damping_time": 0.0,
            "skin": 0.0,
            "poisson_ratio": -1.0,
            "elements": 1,
            "degree": 1,
        }
        for item in fields(self):
            value = getattr(self, item.name)
            low = least.get(item.name, 0.0)
            fine = value >= low if item.name in least else value > low
            if not (fine and math.isfinite(value)):
                words = f"at least {low:g}" if item.name in least else "positive"
                raise ArgumentError(f"rod: {item.name} must be {words}, not {value!r}")
        if not -1 < self.poisson_ratio <= 0.5:
            raise ArgumentError(
                f"rod: poisson_ratio must be above -1 and at most 0.5, not {self.poisson_ratio:g}"
            )

        if 2 * self.skin > self.diameter:
            raise ArgumentError(
                f"rod: skin {self.skin:g} m is above the radius; "
                f"write at most {self.diameter / 2:g}"
            )

    @property
    def _hole(self) -> float:
        """Inner over outer diameter of the section that resists strains."""
        return 1 - 2 * self.skin / self.diameter if self.skin else 0.0

    @property
    def magnetised_area(self) -> float:
        """Area on which the field acts: whole section, or the fluid in its skin, in m²."""
        return self.area * (self._hole**2 if self.skin else 1.0)

    @property
    def area(self) -> float:
        """Area of the cross section, in m²."""
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> float:
        """Second moment of the cross section about its axis of bending, in m⁴."""
        return math.pi * self.diameter**4 / 64

    @property
    def shear_ratio(self) -> float:
        """Share k of the section that carries shear times G / E (Cowper, round or a tube)."""
        nu, square = self.poisson_ratio, self._hole**2
        bulge = (7 + 6 * nu) * (1 + square) ** 2 + (20 + 12 * nu) * square
        return 3 * (1 + square) ** 2 / bulge

    def stiffness(self, youngs_modulus: Any = None) -> Stiffness:
        """Return the stiffness against stretching, shearing and bending.

        Parameters
        ----------
        youngs_modulus : float or casadi.SX, optional
            Young's modulus instead of the rod's own, Pa.
        """
        E = self.youngs_modulus if youngs_modulus is None else youngs_modulus
        stretching = E * self.area * (1 - self._hole**2)
        bending = E * self.second_moment * (1 - self._hole**4)
        return Stiffness(stretching, stretching * self.shear_ratio, bending)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.elements * self.degree + 1

    @cached_property
    def nodes(self) -> np.ndarray:
        """Distances of the nodes from the first end along the rod, shape (count,), in m."""
        size = self.length / self.elements
        inner = (_lobatto(self.degree)[0][:-1] + 1) / 2
        return np.append((np.arange(self.elements)[:, None] + inner).ravel() * size, self.length)

    @cached_property
    def weights(self) -> np.ndarray:
        """Lengths lumped at the nodes, shape (count,), in m; their sum is the length."""
        share = np.multiply(_lobatto(self.degree)[1], self.length / (2 * self.elements))
        found = np.zeros(self.count)
        for first in range(0, self.count - 1, self.degree):
            found[first : first + self.degree + 1] += share
        return found

    @property
    def inertia(self) -> tuple[np.ndarray, np.ndarray]:
        """Mass of every node in kg, and moment of inertia in kg m², shape (count,) each."""
        lumped = self.density * self.weights
        return self.area * lumped, self.second_moment * lumped

    def strains(self, x: Any, y: Any, angle: Any) -> tuple[Any, Any, Any]:
        """Return stretch, shear and curvature at the Gauss points.

        Parameters
        ----------
        x, y, angle : casadi.SX or casadi.DM
            Columns of ``count`` places in m, and angles of the sections in rad.

        Returns
        -------
        stretch, shear, curvature : casadi.SX or casadi.DM
            Columns of ``elements * degree``; the last one in 1/m.
        """
        slope, value, _ = self._gauss
        along, across, turned = slope @ x, slope @ y, value @ angle
        cosine, sine = ca.cos(turned), ca.sin(turned)
        return along * cosine + across * sine - 1, across * cosine - along * sine, slope @ angle

    def energy(self, strains: Iterable[Any], stiffness: Stiffness | None = None) -> Any:
        """Return the elastic energy of strains; of their rates, the power per damping time.

        Parameters
        ----------
        strains : iterable
            Stretch, shear and curvature, as from `strains`.
        stiffness : Stiffness, optional
            Stiffness instead of the rod's own.

        Returns
        -------
        casadi.SX or casadi.DM
            Energy in J.

        Examples
        --------
        A quarter circle has the energy E I pi² / (8 length) on any mesh:

        >>> rod = Rod(1.0, 0.1, 1e6, 1000.0, elements=3, degree=2)
        >>> bend = (ca.DM.zeros(6), ca.DM.zeros(6), ca.DM([math.pi / 2] * 6))
        >>> float(rod.energy(bend) / rod.stiffness().bending - math.pi**2 / 8) < 1e-14
        True
        """
        resist = self.stiffness() if stiffness is None else stiffness
        weights = self._gauss[2]
        stretch, shear, curvature = (ca.dot(weights, part * part) / 2 for part in strains)
        return resist.stretching * stretch + resist.shearing * shear + resist.bending * curvature

    @cached_property
    def _gauss(self) -> tuple[ca.DM, ca.DM, ca.DM]:
        """Matrices from nodes to slopes and values at the Gauss points, and their weights."""
        places, weights = legendre.leggauss(self.degree)
        value, slope = _lagrange(_lobatto(self.degree)[0], places)
        size, parts = self.length / self.elements, range(self.elements)
        return (
            _chained(slope * 2 / size, parts),
            _chained(value, parts),
            ca.DM(np.tile(weights * size / 2, self.elements)),
        )


def _chained(block: np.ndarray, parts: range) -> ca.DM:
    """Return the sparse matrix of a row of elements that share their end nodes."""
    rows, columns = block.shape
    shared = np.zeros((rows * len(parts), (columns - 1) * len(parts) + 1))
    for k in parts:
        first = k * (columns - 1)
        shared[k * rows : (k + 1) * rows, first : first + columns] = block
    return ca.sparsify(ca.DM(shared), _DIGITS)


def _lobatto(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Lobatto nodes on [-1, 1] and their weights."""
    series = np.zeros(degree + 1)
    series[-1] = 1.0
    inner = legendre.legroots(legendre.legder(series)).real
    nodes = np.concatenate([[-1.0], np.sort(inner), [1.0]])
    return nodes, 2 / (degree * (degree + 1) * legendre.legval(nodes, series) ** 2)


def _lagrange(nodes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and slopes of the Lagrange polynomials of nodes, one row per place."""
    degree = len(nodes) - 1
    coefficients = np.linalg.inv(legendre.legvander(nodes, degree))
    slopes = legendre.legval(places, legendre.legder(coefficients))
    return legendre.legvander(places, degree) @ coefficients, np.atleast_2d(slopes.T)


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
    """Return the curve of a smooth function y = height(x), 0 <= x <= span, with span > 0."""
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
    largest = 0.0
    above = [float(np.abs(series.coefficients).sum()) for series in pieces]  # |T_k| <= 1
    for bound, series in sorted(zip(above, pieces, strict=True), key=itemgetter(0), reverse=True):
        if bound <= largest:
            break
        largest = float(np.maximum(largest, series.extremes()[1][0]))  # NaN stays
    mean = sum(float(series.integral()[0]) for series in pieces)
    return float(np.sqrt(largest)), float(np.sqrt(max(mean, 0.0)))


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
        """Return the length of the straight rod that lies between two x."""
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
