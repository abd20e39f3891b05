"""Circular coils of rectangular cross section, and rows of them: what field they carry.

The current fills the winding evenly; there is no iron and no fluid that changes the field. A
winding is a nest of thin solenoids: each in closed form, and Gauss's quadrature over their radii
with as many nodes as the distance from the winding asks for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.sheets import sheet_field

if TYPE_CHECKING:
    import casadi as ca

__all__ = ["Axis", "Coil", "CoilRow"]

Axis = Literal["across", "along", "vertical"]
# Nodes are chosen so that the quadrature is off by exp(-2 _DIGITS) of the field; the most of them
# are enough as near to the winding as a tenth of its depth.
_DIGITS, _MOST = 14.0, 150
# Points taken at a time: their intermediate values fit into the cache.
_CHUNK = 2048


@dataclass(frozen=True)
class Coil:
    """A circular coil with a winding of rectangular cross section.

    Parameters
    ----------
    inner, outer : float
        Radii between which the winding lies, in m.
    length : float
        Length of the winding along the axis, in m.
    ampere_turns : float, optional
        Largest ampere-turns that the coil carries, either way; no limit if left out.

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
                f"coil: the winding lies between inner = {self.inner:g} and outer = "
                f"{self.outer:g}; write inner below outer, and finite sizes"
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
            In m; 0 in the winding and on it.
        """
        rho = np.sqrt(np.asarray(q, dtype=float))
        beside = np.maximum(np.maximum(self.inner - rho, rho - self.outer), 0)
        return np.hypot(beside, np.maximum(np.abs(s) - self.length / 2, 0))

    def nodes(self, clearance: float) -> int:
        """Number of nodes over the radius for points at least so far from the winding.

        Parameters
        ----------
        clearance : float
            Least distance from the winding, in m.

        Returns
        -------
        int
            From 4 to 150.
        """
        # the integrand is analytic in an ellipse about the radii that reaches to the nearest point
        reach = math.asinh(2 * clearance / (self.outer - self.inner))
        return min(_MOST, 2 + math.ceil(max(_DIGITS / reach, 2.0))) if reach else _MOST

    def expression(self, q: Any, s: Any, nodes: int) -> tuple[Any, Any]:
        """Field per ampere-turn at points off the winding, for numbers, arrays and expressions.

        Parameters
        ----------
        q : float, ndarray or casadi.SX
            Square of the distance from the axis, in m².
        s : float, ndarray or casadi.SX
            Distance from the middle along the axis, in m.
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
        Derivatives are exact, on the axis too: there the field is largest in the middle.

        >>> import casadi as ca
        >>> s = ca.SX.sym("s")
        >>> slope = ca.gradient(Coil(2e-3, 5e-3, 20e-3).expression(0.0, s, 12)[0], s)
        >>> abs(float(ca.Function("slope", [s], [slope])(0.0))) < 1e-9
        True
        """
        middle, half = (self.inner + self.outer) / 2, self.length / 2
        # off the winding all sheets are inside or outside of the point alike
        axial, radial = (s * s < half * half) * (q < middle * middle), 0.0
        for node, weight in zip(*_gauss(nodes), strict=True):
            radius = middle + node * (self.outer - self.inner) / 2
            one, other = sheet_field(radius, half, q, s)
            axial, radial = axial + weight * one, radial + weight * other
        return axial / self.length, radial / self.length

    def field(self, q: ArrayLike, s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Field per ampere-turn at points off the winding.

        Parameters
        ----------
        q : array_like, shape (m,)
            Squares of the distances from the axis, in m².
        s : array_like, shape (m,)
            Distances from the middle along the axis, in m.

        Returns
        -------
        axial, radial : ndarray, shape (m,)
            As for `expression`.

        Raises
        ------
        ArgumentError
            If a point lies in the winding.
        """
        q, s = np.broadcast_arrays(np.asarray(q, dtype=float), np.asarray(s, dtype=float))
        clearance = self.clearance(q, s)
        if not np.all(clearance > 0):
            raise ArgumentError("a point lies in the winding of a coil")
        found = np.empty((2, *q.shape))
        # near points ask for many nodes; far ones need not have them too
        needed = np.array([self.nodes(float(d)) for d in clearance.flat]).reshape(q.shape)
        for low, high in ((0, 6), (6, 12), (12, 30), (30, 80), (80, _MOST)):
            where = np.flatnonzero((needed > low) & (needed <= high))
            for start in range(0, len(where), _CHUNK):
                part = where[start : start + _CHUNK]
                nodes = int(needed.flat[part].max())
                found.reshape(2, -1)[:, part] = self.expression(q.flat[part], s.flat[part], nodes)
        return found[0], found[1]


@dataclass(frozen=True)
class CoilRow:
    """Equal coils in a row along x: the middle of coil k is at x = k pitch, y = z = 0.

    Parameters
    ----------
    coil : Coil
        What each of them is.
    count : int
        Number of coils.
    pitch : float
        Distance of neighbours, in m.
    axis : {"across", "along", "vertical"}, optional
        Whether their axes lie along y (horizontal, across the row), along x or along z.
    gap : float, optional
        Where given, each place has two coils that face each other over this gap, with the same
        current; the middle between them is at y = z = 0. Not for axes along the row.

    Raises
    ------
    ArgumentError
        If there is no coil, or coils overlap.

    Examples
    --------
    >>> row = CoilRow(Coil(2e-3, 4.5e-3, 20e-3), count=3, pitch=10e-3, axis="vertical")
    >>> H = row.field(x=[10e-3], z=12e-3, currents=[[1000.0], [3000.0], [1000.0]])
    >>> H.shape, bool(abs(H[0, 0, 0]) < 1e-6 * H[2, 0, 0])
    ((3, 1, 1), True)
    """

    coil: Coil
    count: int
    pitch: float
    axis: Axis = "across"
    gap: float | None = None

    def __post_init__(self) -> None:
        if self.axis not in get_args(Axis):
            raise ArgumentError(f'no axis "{self.axis}"; there are {", ".join(get_args(Axis))}')
        if self.count < 1 or not 0 < self.pitch < math.inf:
            raise ArgumentError("a row has at least one coil, and a pitch above 0")
        size = self.coil.length if self.axis == "along" else 2 * self.coil.outer
        if self.pitch < size:
            raise ArgumentError(
                f"coils overlap: each takes {size:g} m of the row, their pitch is {self.pitch:g} m"
            )
        if self.gap is not None and (self.axis == "along" or not 0 < self.gap < math.inf):
            raise ArgumentError("a gap above 0 belongs to coils with axes across or vertical")

    @property
    def places(self) -> np.ndarray:
        """Where the coils are along x, shape (count,), in m."""
        return self.pitch * np.arange(self.count)

    def check_currents(self, currents: ArrayLike) -> np.ndarray:
        """Give currents back as an array, if the coils carry them.

        Parameters
        ----------
        currents : array_like, shape (count, ...)
            Ampere-turns of each coil.

        Returns
        -------
        ndarray

        Raises
        ------
        ArgumentError
            If there is not one row per coil, or a current is above the coils' ampere-turns.
        """
        values = np.asarray(currents, dtype=float)
        if not values.ndim or len(values) != self.count:
            raise ArgumentError(f"currents have the shape {values.shape}, not ({self.count}, ...)")
        largest = float(np.max(np.abs(values), initial=0.0))
        if not largest <= self.coil.ampere_turns * (1 + 1e-12):
            raise ArgumentError(
                f"a current of {largest:g} ampere-turns is above the {self.coil.ampere_turns:g} "
                "that the coils carry"
            )
        return values

    def clearance(self, x: ArrayLike, z: ArrayLike, y: ArrayLike = 0.0) -> np.ndarray:
        """Distance of points from the nearest winding.

        Parameters
        ----------
        x, z, y : array_like
            Points, in m; broadcast against each other.

        Returns
        -------
        ndarray
            In m; 0 in a winding.
        """
        parts = [self.coil.clearance(q, s) for _, q, s, _ in self._seen(x, y, z)]
        return np.min(parts, axis=0)

    def influence(self, x: ArrayLike, z: ArrayLike, y: ArrayLike = 0.0) -> np.ndarray:
        """Field of each coil at points, per ampere-turn.

        Parameters
        ----------
        x, z, y : array_like
            Points, in m; broadcast to one axis of m points.

        Returns
        -------
        ndarray, shape (3, m, count)
            Components along x, y, z over the coil's ampere-turns, in 1/m.

        Raises
        ------
        ArgumentError
            If a point lies in a winding.
        """
        x, y, z = (np.ravel(part) for part in np.broadcast_arrays(x, y, z))
        if not np.all(self.clearance(x, z, y) > 0):
            raise ArgumentError("a coil lies inside the fluid: a point is in a winding")
        found = np.zeros((3, len(x), self.count))
        for k, q, s, away in self._seen(x, y, z):
            axial, radial = self.coil.field(q, s)
            for component, distance in enumerate(away):
                found[component, :, k] += axial if distance is None else radial * distance
        return found

    def field(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """Field of the whole row at points, for one set of currents or several.

        Parameters
        ----------
        x, z, y : array_like
            Points, in m; broadcast to one axis of m points.
        currents : array_like, shape (count, ...)
            Ampere-turns.

        Returns
        -------
        ndarray, shape (3, m, ...)
            Components along x, y, z, in A/m.

        Raises
        ------
        ArgumentError
            If a point lies in a winding, or the coils do not carry the currents.
        """
        return np.tensordot(self.influence(x, z, y), self.check_currents(currents), axes=1)

    def square(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """H² of the whole row.

        Parameters
        ----------
        x, z, currents, y : array_like
            As for `field`.

        Returns
        -------
        ndarray, shape (m, ...)
            In A²/m².
        """
        return np.sum(self.field(x, z, currents, y) ** 2, axis=0)

    def square_gradient(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """Gradient of H², to which the force on a magnetisable body is proportional.

        Parameters
        ----------
        x, z, y : array_like
            Points, in m; broadcast to one axis of m points.
        currents : array_like, shape (count,)
            Ampere-turns.

        Returns
        -------
        ndarray, shape (3, m)
            Along x, y, z, in A²/m³; by differentiation of the formulas, not by differences.

        Raises
        ------
        ArgumentError
            As for `field`.
        """
        points = np.vstack([np.ravel(part) for part in np.broadcast_arrays(x, y, z)]).astype(float)
        least = np.min(self.clearance(points[0], points[2], points[1]))
        if not least > 0:
            raise ArgumentError("a coil lies inside the fluid: a point is in a winding")
        values = self.check_currents(currents)
        slope = _slope(self, self.coil.nodes(float(least)))
        return np.asarray(slope.map(points.shape[1])(points, values))

    def expression(self, place: ca.SX, currents: Any, nodes: int) -> ca.SX:
        """Field at a point as a CasADi expression of the point and the currents.

        Parameters
        ----------
        place : casadi.SX
            Column x, y, z, in m.
        currents : casadi.SX or ndarray
            ``count`` ampere-turns.
        nodes : int
            Nodes over the radius, see `Coil.nodes`.

        Returns
        -------
        casadi.SX
            Column of the components along x, y, z, in A/m. It checks nothing, and holds off the
            windings only.
        """
        import casadi as ca  # only who differentiates needs it

        found: list[Any] = [ca.SX(0)] * 3
        for k, q, s, away in self._seen(place[0], place[1], place[2]):
            axial, radial = self.coil.expression(q, s, nodes)
            for component, distance in enumerate(away):
                part = axial if distance is None else radial * distance
                found[component] = found[component] + currents[k] * part
        return ca.vertcat(*found)

    def _seen(self, x: Any, y: Any, z: Any) -> Iterator[tuple[int, Any, Any, list[Any]]]:
        """Points as each coil sees them: square and axial distance, components away from its axis.

        The component along the axis is None.
        """
        direction = ("along", "across", "vertical").index(self.axis)
        offset = 0.0 if self.gap is None else (self.gap + self.coil.length) / 2
        for k in range(self.count):
            for side in (0.0,) if self.gap is None else (-offset, offset):
                away: list[Any] = [x - k * self.pitch, y, z]
                s, away[direction] = away[direction] - side, None
                one, other = (part for part in away if part is not None)
                yield k, one * one + other * other, s, away


@lru_cache(maxsize=64)
def _gauss(nodes: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Nodes on [-1, 1] and weights of the mean."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return tuple(map(float, places)), tuple(map(float, weights / 2))


@lru_cache(maxsize=8)
def _slope(row: CoilRow, nodes: int) -> ca.Function:
    """CasADi function (point, currents) -> gradient of H²."""
    import casadi as ca  # only who differentiates needs it

    place, currents = ca.SX.sym("place", 3), ca.SX.sym("currents", row.count)
    H = row.expression(place, currents, nodes)
    return ca.Function("slope", [place, currents], [ca.gradient(ca.sumsqr(H), place)])
