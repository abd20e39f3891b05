"""Rows of equal coils and their field, for numbers and CasADi expressions.

A single coil is in `wormopt.magnetics.winding`, also available from here. Currents over time are in
`wormopt.magnetics.travelling`.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.winding import Coil

if TYPE_CHECKING:
    import casadi as ca


Axis = Literal["across", "along", "vertical"]
Sides = Literal["both", "alternating"]
# Directions of the components x, y, z.
_AXES = ("along", "across", "vertical")
# Angles over half a turn times the clearance over the radius: sums over all of them then have an
# error of about exp(-1.6 * 24). The other half of the turn is the same.
_ANGLES, _MOST_ANGLES = 24, 24_000
_TOLERANCE = 1e-10
# Number of radii next to a winding: where more are needed, a point nearly touches it.
_PIECES = 100


@dataclass(frozen=True)
class CoilRow:
    """Equal coils in a row along x; the middle of coil k is at x = k pitch, y = z = 0.

    Parameters
    ----------
    coil : Coil
        The coil at each place.
    count : int
        Number of coils.
    pitch : float
        Distance of neighbouring coils in m.
    axis : {"across", "along", "vertical"}, optional
        Direction of the coil axes: along y (horizontal, across the row), x or z.
    gap : float, optional
        Distance in m between two coils that face each other at each place with the same current;
        the middle between them is at y = z = 0. Not for axes along the row.
    sides : {"both", "alternating"}, optional
        With a gap: whether each place has both coils, or coil k the one on the positive side for
        even k and the one on the negative side for odd k.

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
    sides: Sides = "both"

    def __post_init__(self) -> None:
        for name, known in (("axis", get_args(Axis)), ("sides", get_args(Sides))):
            if getattr(self, name) not in known:
                given = getattr(self, name)
                raise ArgumentError(f'{name} is "{given}"; write one of {", ".join(known)}')
        if self.count < 1 or not 0 < self.pitch < math.inf:
            raise ArgumentError("a row needs at least one coil, and a pitch above 0")
        alternate = self.sides == "alternating"
        size = self.coil.length if self.axis == "along" else 2 * self.coil.outer
        apart = (1 + alternate) * self.pitch
        if apart < size:
            raise ArgumentError(
                f"coils overlap: each has the size {size:g} m along the row, but neighbours are "
                f"{apart:g} m apart; write a larger pitch, or smaller coils"
            )
        if alternate and self.gap is None:
            raise ArgumentError('sides = "alternating" needs two sides; write a gap')
        if self.gap is not None and (self.axis == "along" or not 0 < self.gap < math.inf):
            raise ArgumentError('gap must be above 0, and needs axis = "across" or "vertical"')

    @property
    def places(self) -> np.ndarray:
        """Positions of the coils along x in m, shape (count,)."""
        return self.pitch * np.arange(self.count)

    def check_currents(self, currents: ArrayLike) -> np.ndarray:
        """Check that the coils carry the given currents, and return them as an array.

        Parameters
        ----------
        currents : array_like, shape (count, ...)
            Ampere-turns of each coil.

        Returns
        -------
        ndarray, shape (count, ...)
            The currents.

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
                f"a current of {largest:g} ampere-turns exceeds the coils' limit of "
                f"{self.coil.ampere_turns:g}"
            )
        return values

    def clearance(self, x: ArrayLike, z: ArrayLike, y: ArrayLike = 0.0) -> np.ndarray:
        """Distance of points from the nearest winding.

        Parameters
        ----------
        x, z, y : array_like
            Coordinates of the points in m; broadcast against each other.

        Returns
        -------
        ndarray
            Distance in m; 0 in a winding.
        """
        parts = [self.coil.clearance(q, s) for _, q, s, _ in self._seen(x, y, z)]
        return np.min(parts, axis=0)

    def influence(
        self,
        x: ArrayLike,
        z: ArrayLike,
        y: ArrayLike = 0.0,
        *,
        coils: Container[int] | None = None,
    ) -> np.ndarray:
        """Field of each coil at points, per ampere-turn.

        Parameters
        ----------
        x, z, y : array_like
            Coordinates of the points in m; broadcast to one axis of m points.
        coils : container of int, optional
            Indices of the coils to compute; the others are 0.

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
            raise ArgumentError("a coil is inside the fluid: a point is in a winding")
        found = np.zeros((3, len(x), self.count))
        for k, q, s, away in self._seen(x, y, z):
            if coils is not None and k not in coils:
                continue
            axial, radial = self.coil.field(q, s)
            for component, distance in enumerate(away):
                found[component, :, k] += axial if distance is None else radial * distance
        return found

    def field(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """Field of the whole row at points, for one or several sets of currents.

        Parameters
        ----------
        x, z, y : array_like
            Coordinates of the points in m; broadcast to one axis of m points.
        currents : array_like, shape (count, ...)
            Ampere-turns of each coil.

        Returns
        -------
        ndarray, shape (3, m, ...)
            Components along x, y, z, in A/m.

        Raises
        ------
        ArgumentError
            If a point lies in a winding, or a current exceeds the coils' limit.
        """
        values = self.check_currents(currents)
        lit = set(np.flatnonzero(values.reshape(self.count, -1).any(axis=1)).tolist())
        return np.tensordot(self.influence(x, z, y, coils=lit), values, axes=1)

    def square(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """Square H² of the field of the whole row.

        Parameters
        ----------
        x, z, currents, y : array_like
            As for `field`.

        Returns
        -------
        ndarray, shape (m, ...)
            H² in A²/m².
        """
        return np.sum(self.field(x, z, currents, y) ** 2, axis=0)

    def square_gradient(
        self, x: ArrayLike, z: ArrayLike, currents: ArrayLike, y: ArrayLike = 0.0
    ) -> np.ndarray:
        """Gradient of H², which is proportional to the force on a magnetisable body.

        Parameters
        ----------
        x, z, y : array_like
            Coordinates of the points in m; broadcast to one axis of m points.
        currents : array_like, shape (count,)
            Ampere-turns of each coil.

        Returns
        -------
        ndarray, shape (3, m)
            Components along x, y, z in A²/m³, by differentiation of the formulas, not by
            differences.

        Raises
        ------
        ArgumentError
            As for `field`.
        """
        points = np.vstack([np.ravel(part) for part in np.broadcast_arrays(x, y, z)]).astype(float)
        least = np.min(self.clearance(points[0], points[2], points[1]))
        if not least > 0:
            raise ArgumentError("a coil is inside the fluid: a point is in a winding")
        values = self.check_currents(currents)
        nodes = self.coil.nodes(float(least))
        one = _slopes(self.coil, self.axis, nodes).map(points.shape[1])
        H, J = np.zeros((3, points.shape[1])), np.zeros((3, 3, points.shape[1]))
        for k, middle in self._middles():
            if values[k] == 0:
                continue
            strength, slopes = one(points - middle[:, None])
            H += values[k] * np.asarray(strength)
            # CasADi sets the Jacobians of the points side by side
            J += values[k] * np.asarray(slopes).reshape(3, -1, 3).transpose(0, 2, 1)
        return 2 * np.einsum("cm,cdm->dm", H, J)

    def expression(self, place: ca.SX, currents: Any, nodes: int) -> ca.SX:
        """Field at a point as a CasADi expression of the point and the currents.

        Parameters
        ----------
        place : casadi.SX
            Column x, y, z in m.
        currents : casadi.SX or ndarray
            Ampere-turns of the ``count`` coils.
        nodes : int
            Nodes over the radius, see `Coil.nodes`.

        Returns
        -------
        casadi.SX
            Column of the components along x, y, z, in A/m. It is not checked, and valid outside the
            windings only.
        """
        import casadi as ca  # only derivatives need CasADi

        found: list[Any] = [ca.SX(0)] * 3
        for k, q, s, away in self._seen(place[0], place[1], place[2]):
            axial, radial = self.coil.expression(q, s, nodes)
            for component, distance in enumerate(away):
                part = axial if distance is None else radial * distance
                found[component] = found[component] + currents[k] * part
        return ca.vertcat(*found)

    def _middles(self) -> Iterator[tuple[int, np.ndarray]]:
        """Number and middle of each coil; facing coils have the same number."""
        direction = _AXES.index(self.axis)
        offset = 0.0 if self.gap is None else (self.gap + self.coil.length) / 2
        for k in range(self.count):
            both = (0.0,) if self.gap is None else (-offset, offset)
            for side in both if self.sides == "both" else (offset * (1 - 2 * (k % 2)),):
                middle = np.array([k * self.pitch, 0.0, 0.0])
                middle[direction] += side
                yield k, middle

    def _seen(self, x: Any, y: Any, z: Any) -> Iterator[tuple[int, Any, Any, list[Any]]]:
        """Squared and axial distance of points from each coil, components away from its axis."""
        for k, middle in self._middles():
            yield k, *_frame(self.axis, x - middle[0], y - middle[1], z - middle[2])


def _frame(axis: Axis, x: Any, y: Any, z: Any) -> tuple[Any, Any, list[Any]]:
    """Squared distance from an axis, position along it, components away from it."""
    away: list[Any] = [x, y, z]
    direction = _AXES.index(axis)
    s, away[direction] = away[direction], None
    one, other = (part for part in away if part is not None)
    return one * one + other * other, s, away


@lru_cache(maxsize=16)
def _slopes(coil: Coil, axis: Axis, nodes: int) -> ca.Function:
    """CasADi function of a point relative to a coil: field per ampere-turn, and its Jacobian."""
    import casadi as ca  # only derivatives need CasADi

    place = ca.SX.sym("place", 3)
    q, s, away = _frame(axis, place[0], place[1], place[2])
    axial, radial = coil.expression(q, s, nodes)
    H = ca.vertcat(*(axial if part is None else radial * part for part in away))
    return ca.Function("slopes", [place], [H, ca.densify(ca.jacobian(H, place))])


def field_by_quadrature(row: CoilRow, x: np.ndarray, z: float, currents: np.ndarray) -> np.ndarray:
    """Field (3, m) in A/m at points of the line by Biot-Savart, integrated over the windings.

    `currents` (count, m): ampere-turns at each point. It uses no elliptic integral: sums over the
    angle, adaptive quadrature over the radius and, except for close points, over the length.
    """
    direction = _AXES.index(row.axis)
    offset = 0.0 if row.gap is None else (row.gap + row.coil.length) / 2
    sides = np.array([[0.0]] if row.gap is None else [[-offset], [offset]])
    if row.sides == "alternating":
        sides = offset * (1 - 2 * (np.arange(row.count) % 2))[None]
    # Points relative to each coil: shape (3, sides, count, m).
    seen = np.zeros((3, len(sides), row.count, len(x)))
    seen[0] = x - row.places[:, None]
    seen[2] = z
    seen[direction] -= sides[:, :, None]
    s, away = seen[direction], np.delete(seen, direction, axis=0)
    rho = np.hypot(*away)
    share = np.clip(row.coil.clearance(rho**2, s) / row.coil.outer, _ANGLES / _MOST_ANGLES, 1.0)
    # points next to a winding need more angles
    doublings = np.ceil(-np.log2(share)).astype(int)
    axial, radial = np.zeros_like(s), np.zeros_like(s)
    for k in np.unique(doublings):
        alike = doublings == k
        angle = np.pi * (np.arange(_ANGLES << k) + 0.5) / (_ANGLES << k)
        field = _field_near if k else _field_far
        axial[alike], radial[alike] = field(row.coil, rho[alike], s[alike], angle)
    outward = np.divide(away, rho, out=np.zeros_like(away), where=rho > 0)
    vector = np.insert(outward * radial, direction, axial, axis=0)
    return np.einsum("cskm,km->cm", vector, currents)


def _field_far(coil: Coil, rho: np.ndarray, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Axial and radial field (2, m) per ampere-turn at distances from a coil's axis and middle."""
    # By quadrature over radius and length of an integrand without cancellation at large distances.
    from scipy.integrate import quad_vec

    cosine = np.cos(angle)
    flat, across = (rho * rho)[:, None], 2 * rho[:, None] * cosine

    def loop(a: float, place: float) -> np.ndarray:
        rise = s[:, None] - place
        square = a * a + rise * rise + flat  # less a * across it is that of the distance
        # power -3/2 of the distance over that of `square`, less 1, which is all that is left far
        # away, where it is far below rounding of 1
        more = np.expm1(-1.5 * np.log1p(-a * across / square))
        first, second = 1 + more.mean(axis=-1), (cosine * more).mean(axis=-1)
        both = np.stack([a * first - rho * second, rise[:, 0] * second])
        return a / 2 * both / (square * np.sqrt(square))[:, 0]

    half, rule = coil.length / 2, {"epsrel": _TOLERANCE, "norm": "max"}

    def sheet(a: float) -> np.ndarray:
        return quad_vec(lambda place: loop(a, place), -half, half, **rule)[0]

    whole = quad_vec(sheet, coil.inner, coil.outer, **rule)[0]
    return whole / (coil.length * (coil.outer - coil.inner))


def _field_near(coil: Coil, rho: np.ndarray, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """As `_field_far`, next to a winding: the integral over the length is a closed form."""
    # Differences of nearly equal numbers are written out.
    from scipy.integrate import quad_vec

    rho, s = rho[:, None], s[:, None]
    below, above, apart = -coil.length / 2 - s, coil.length / 2 - s, -2 * s * coil.length
    beyond, turned = below * above > 0, 2 * np.sin(angle / 2) ** 2  # 1 - cosine

    def sheet(a: float) -> np.ndarray:
        square = (a - rho) ** 2 + 2 * a * rho * turned
        low, high = np.sqrt(square + below**2), np.sqrt(square + above**2)
        # of the sines of the angles at which both ends are seen, over `square`
        sines = np.where(beyond, apart, above / high - below / low)
        divisor = np.where(beyond, low * high * (above * low + below * high), square)
        axial = (a - rho + rho * turned) * sines / divisor
        radial = (turned - 1) * apart / (low * high * (low + high))
        return a / 2 * np.stack([axial.mean(axis=-1), radial.mean(axis=-1)])

    whole = quad_vec(sheet, coil.inner, coil.outer, epsrel=_TOLERANCE, norm="max", limit=_PIECES)
    return whole[0] / (coil.length * (coil.outer - coil.inner))
