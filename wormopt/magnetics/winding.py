"""Field of a circular coil with a winding of rectangular cross section, by formulas.

The current density in the winding is uniform, without iron and without the effect of a fluid. A
winding is a set of nested thin solenoids: each has a closed form, and Gauss's quadrature over their
radii uses as many nodes as the distance from the winding requires. The contributions of both ends
of a solenoid cancel at large distances: expressions lose the share 1e-16 (distance / outer radius)³
of the field; far away, numbers are those of wire loops instead.

The closed forms have no special cases. Complete elliptic integrals use the arithmetic-geometric
mean of the largest and the least distance to the wire. Its first step is explicit: the rest depends
on the distance from the axis only by its square ``q``, so values and derivatives are regular on the
axis. The number of steps is fixed. These functions take numbers, arrays or CasADi expressions
without checks, and use only arithmetic and comparisons.

Sources: N. Derby and S. Olbert, Cylindrical magnets and ideal solenoids, Am. J. Phys. 78 (2010)
229; DLMF 19.8 for the means; F. Paxton, Rev. Sci. Instrum. 30 (1959) 254 for the solid angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError

if TYPE_CHECKING:
    import casadi as ca

    Expression = ca.SX | np.ndarray | float

# Largest number of nodes: sufficient down to a tenth of the winding's depth.
_MOST = 150
# Points times nodes in a block: their intermediate values fit into the cache.
_CHUNK = 4096
# Beyond this many sizes of the coil, the contributions of both ends of a sheet nearly cancel. Loops
# are summed there, this many along the coil and over its depth, with an error of (1 / 20)^(2 nodes)
# or less.
_FAR, _LOOPS = 10.0, (6, 5)
# Steps of the mean after the first: sufficient for distances from the wire of 1e-7 of its radius.
_STEPS = 6


@dataclass(frozen=True)
class Coil:
    """A circular coil with a winding of rectangular cross section.

    Parameters
    ----------
    inner : float
        Inner radius of the winding in m.
    outer : float
        Outer radius of the winding in m.
    length : float
        Length of the winding along the axis in m.
    ampere_turns : float, optional
        Largest ampere-turns of the coil, of either sign. Default: no limit.

    Raises
    ------
    ArgumentError
        If a size is not positive or inner is not below outer.

    Examples
    --------
    >>> coil = Coil(inner=2e-3, outer=5e-3, length=20e-3)
    >>> axial, radial = coil.field(np.array([0.0, 4e-6]), np.array([0.0, 12e-3]))
    >>> axial.round(3).tolist(), radial.round(3).tolist()
    ([47.087, 9.996], [0.0, 2081.218])
    """

    inner: float
    outer: float
    length: float
    ampere_turns: float = math.inf

    def __post_init__(self) -> None:
        for name in ("inner", "outer", "length", "ampere_turns"):
            if not getattr(self, name) > 0:
                raise ArgumentError(f"coil: {name} must be above 0, not {getattr(self, name):g}")
        if not self.inner < self.outer < math.inf or not self.length < math.inf:
            raise ArgumentError(
                f"coil: inner = {self.inner:g} must be below outer = {self.outer:g}, and all sizes "
                "finite"
            )

    def clearance(self, q: ArrayLike, s: ArrayLike) -> np.ndarray:
        """Distance of points from the winding.

        Parameters
        ----------
        q, s : array_like
            As for `field`.

        Returns
        -------
        ndarray
            Distance in m; 0 in the winding and on it.
        """
        rho = np.sqrt(np.asarray(q, dtype=float))
        beside = np.maximum(np.maximum(self.inner - rho, rho - self.outer), 0)
        return np.hypot(beside, np.maximum(np.abs(s) - self.length / 2, 0))

    def nodes(self, clearance: float, digits: float = 14.0) -> int:
        """Number of quadrature nodes over the radius for points at a distance from the winding.

        Parameters
        ----------
        clearance : float
            Least distance from the winding in m.
        digits : float, optional
            The quadrature has a relative error of exp(-2 digits).

        Returns
        -------
        int
            From 4 to 150.
        """
        return int(self._nodes(np.array(clearance, dtype=float), digits))

    def _nodes(self, clearance: np.ndarray, digits: float = 14.0) -> np.ndarray:
        # the integrand is analytic in an ellipse about the radii that extends to the nearest point
        reach = np.arcsinh(2 * clearance / (self.outer - self.inner))
        with np.errstate(divide="ignore"):
            needed = 2 + np.ceil(np.maximum(digits / reach, 2.0))
        return np.minimum(needed, _MOST).astype(int)

    def expression(self, q: Any, s: Any, nodes: int) -> tuple[Any, Any]:
        """Field per ampere-turn at points outside the winding, for numbers, arrays and expressions.

        Parameters
        ----------
        q : float, ndarray or casadi.SX
            Squared distance from the axis in m².
        s : float, ndarray or casadi.SX
            Distance from the middle along the axis in m.
        nodes : int
            Nodes over the radius, see `nodes`.

        Returns
        -------
        axial : float, ndarray or casadi.SX
            Component along the axis over the ampere-turns, in 1/m.
        radial : float, ndarray or casadi.SX
            Component away from the axis over the distance from it and the ampere-turns, in 1/m².

        Examples
        --------
        Derivatives are exact, also on the axis, where the field is largest in the middle:

        >>> import casadi as ca
        >>> s = ca.SX.sym("s")
        >>> slope = ca.gradient(Coil(2e-3, 5e-3, 20e-3).expression(0.0, s, 12)[0], s)
        >>> abs(float(ca.Function("slope", [s], [slope])(0.0))) < 1e-9
        True
        """
        middle, half = (self.inner + self.outer) / 2, self.length / 2
        # off the winding all sheets are inside or outside of the point alike
        # as comparisons that agree with those of the sheet for every rounding
        axial, radial = (s + half >= 0) * (s - half < 0) * (q < middle * middle), 0.0
        places, weights = _gauss(nodes)
        radii = [middle + place * (self.outer - self.inner) / 2 for place in places]
        if all(isinstance(part, (np.ndarray, float, int)) for part in (q, s)):
            # all sheets at once, along a first axis
            sheets = np.reshape(radii, (-1, *[1] * max(np.ndim(q), np.ndim(s))))
            one, other = sheet_field(sheets, half, q, s)
            axial, radial = axial + np.tensordot(weights, one, 1), np.tensordot(weights, other, 1)
            return axial / self.length, radial / self.length
        for radius, weight in zip(radii, weights, strict=True):
            one, other = sheet_field(radius, half, q, s)
            axial, radial = axial + weight * one, radial + weight * other
        return axial / self.length, radial / self.length

    def field(self, q: ArrayLike, s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Field per ampere-turn at points outside the winding.

        Parameters
        ----------
        q : array_like, shape (m,)
            Squared distances from the axis in m².
        s : array_like, shape (m,)
            Distances from the middle along the axis in m.

        Returns
        -------
        axial, radial : ndarray, shape (m,)
            As for `expression`, in 1/m and 1/m².

        Raises
        ------
        ArgumentError
            If a point lies in the winding.
        """
        q, s = np.broadcast_arrays(np.asarray(q, dtype=float), np.asarray(s, dtype=float))
        clearance = self.clearance(q, s)
        if not np.all(clearance > 0):
            raise ArgumentError("a point is in the winding of a coil")
        found = np.empty((2, *q.shape))
        far = np.flatnonzero(clearance > _FAR * math.hypot(self.outer, self.length))
        size = _CHUNK // math.prod(_LOOPS)
        for part in (far[start : start + size] for start in range(0, len(far), size)):
            found.reshape(2, -1)[:, part] = self._loops(q.flat[part], s.flat[part])
        # Close points need many nodes; far points use fewer.
        needed = np.array(self._nodes(clearance))
        needed.flat[far] = 0
        for low, high in ((0, 6), (6, 12), (12, 30), (30, 80), (80, _MOST)):
            where = np.flatnonzero((needed > low) & (needed <= high))
            size = _CHUNK // high
            for part in (where[start : start + size] for start in range(0, len(where), size)):
                nodes = int(needed.flat[part].max())
                found.reshape(2, -1)[:, part] = self.expression(q.flat[part], s.flat[part], nodes)
        return found[0], found[1]

    def _loops(self, q: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Field (2, m) per ampere-turn at points far away."""
        (along, share), (deep, part) = map(_gauss, _LOOPS)
        middle, half = (self.inner + self.outer) / 2, (self.outer - self.inner) / 2
        radii = middle + half * np.reshape(deep, (-1, 1))
        away = s - np.reshape(along, (-1, 1, 1)) * self.length / 2
        return np.einsum("i,j,cijm->cm", share, part, np.array(loop_field(radii, q, away)))


@lru_cache(maxsize=64)
def _gauss(nodes: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Nodes on [-1, 1] and weights of the mean."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return tuple(map(float, places)), tuple(map(float, weights / 2))


def loop_field(radius: Expression, q: Expression, s: Expression) -> tuple[Any, Any]:
    """Field of a wire loop that carries one ampere: axial (A/m), radial / distance (A/m²).

    `q`: squared distance from the axis, m²; `s`: distance from the loop's plane, m.
    The radial component over the distance from the axis is regular on the axis.
    """
    a2 = radius * radius
    A, P, means, sigma = _means(a2, q, s)
    M = means[-1][0]
    axial = (2 * a2 * (a2 + s * s - q) + (q + s * s - a2) * q * sigma) / (4 * M * P * P)
    radial = s * (4 * a2 - A * sigma) / (4 * M * P * P)
    return axial, radial


def sheet_field(radius: Expression, half: Expression, q: Expression, s: Expression) -> Any:
    """Field of a thin solenoid with one ampere per metre, without the uniform field inside.

    Axial, and radial / distance (1/m); `q`, `s` as for `loop_field`, `s` from the middle. Add 1 to
    axial where |s| < half, q < radius²; without it, the field is smooth beyond the ends.
    """
    axial, radial = 0.0, 0.0
    for end, sign in ((s + half, -1), (s - half, 1)):
        side = 2 * (end >= 0) - 1  # not sign(): at 0 the derivative from the right is the one
        cover, potential = _end(radius * radius, q, side * end)
        axial = axial + sign * side * cover
        radial = radial + sign * potential
    return axial, radial


def _end(a2: Any, q: Any, z: Any) -> tuple[Any, Any]:
    """Cover and potential of one end, at the distance z >= 0 beyond it."""
    # The cover is the field along the axis beyond the end of a half-infinite solenoid: the solid
    # angle of its disc over 4 pi. It is an elliptic integral of the third kind, in the form that
    # stays regular where q passes a2. The potential is that of the loop, over the distance from the
    # axis.
    _, P, means, sigma = _means(a2, q, z)
    M = means[-1][0]
    # e is z times the third variable of the mean, so z = 0 is no special case
    e = (z * z + P) / 2
    ratio = z / e
    total, weight = ratio, (1 - z * ratio) / 2
    for mean, geometric in means[:-1]:
        product = mean * geometric
        square = e * e + z * z * product
        ratio = 2 * z * product / square
        total = total + weight * ratio
        weight = weight * (1 - z * ratio) / 2
        e = square / (2 * e)
    # contribution of infinitely many further steps, now that both means are M
    total = total + weight * 2 * M / (e + M * z)
    return 0.25 - (2 * z - (a2 - q) * total) / (8 * M), sigma / (4 * M)


def _means(a2: Any, q: Any, s: Any) -> tuple[Any, Any, list[tuple[Any, Any]], Any]:
    """Sum of squares, product of the largest and least distance, the means, and their defect."""
    # The defect is the sum of 2^(n-1) c_n² / q over n >= 1, with c_n the half differences, here by
    # c_{n+1} = c_n² / (4 a_{n+1}) without cancellation.
    A = a2 + q + s * s
    P = ((a2 - q) * (a2 - q) + s * s * (2 * (a2 + q) + s * s)) ** 0.5
    mean, geometric = ((A + P) / 2) ** 0.5, P**0.5
    part = 2 * a2 / (A + P)
    sigma, means = part, [(mean, geometric)]
    for step in range(_STEPS):
        mean, geometric = (mean + geometric) / 2, (mean * geometric) ** 0.5
        part = q * part * part / (16 * mean * mean)
        sigma = sigma + 2.0 ** (step + 1) * part
        means.append((mean, geometric))
    return A, P, means, sigma
