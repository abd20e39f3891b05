"""Rows of equal coils and their field, for numbers and CasADi expressions.

A single coil is in `wormopt.magnetics.winding`, also available from here. Currents over time are in
`wormopt.magnetics.travelling`.

The field of blocks of coils that repeat along an endless row is known on a strip as a double
series: a Fourier series of its square along the row, where it is periodic, and powers across it.
The field is smooth there, so the series converges geometrically; its truncation error is measured.
The force on magnetisable matter is proportional to the gradient.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.winding import Coil

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
            raise ArgumentError("gap must be above 0, with coil axes across or vertical")

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
            raise ArgumentError("a coil lies inside the fluid: a point is in a winding")
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
            raise ArgumentError("a coil lies inside the fluid: a point is in a winding")
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
        """Points relative to each coil: squared and axial distance, components away from its axis.

        The component along the axis is None.
        """
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
    """Axial and radial field (2, m) per ampere-turn at distances from a coil's axis and middle.

    By quadrature over radius and length of an integrand without cancellation at large distances.
    """
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
    """As `_field_far`, next to a winding: the integral over the length is a closed form.

    Differences of nearly equal numbers are written out.
    """
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


# Powers across the strip, points along two repeats of the pattern that determine the series, and
# number of blocks on each side.
_DEGREE, _POINTS, _BLOCKS = 12, 256, 3
_ROUNDING = 1e-9
_WIDER = 1.05


@dataclass(frozen=True, eq=False)
class BlockField:
    """H² per squared ampere-turn of equal blocks of coils, as a series.

    H² = Re sum_jm coefficients[j, m] (y / half)^j exp(2 pi i m x / period), with x from the
    middle of a block whose first coil is on the positive side.
    """

    period: float  # of the series along the row, m
    half: float  # half the width of the strip, m
    coefficients: np.ndarray  # (powers, harmonics), complex
    error: float  # largest error of H² on the strip, over its maximum

    def expression(self, x: ca.SX, y: ca.SX) -> ca.SX:
        """H² at a point, in 1/m² per squared ampere-turn.

        `x`: along the row from the middle of the block, m; `y`: across from the middle of the
        channel, m, positive on the side of the block's first coil.
        """
        angle, height, total = 2 * np.pi * x / self.period, y / self.half, ca.SX(0)
        waves = _waves(angle, self.coefficients.shape[1])
        for row in self.coefficients[::-1]:
            part = ca.SX(0)
            for (cosine, sine), c in zip(waves, row, strict=True):
                part += c.real * cosine if c.real else 0
                part -= c.imag * sine if c.imag else 0
            total = total * height + part
        return total

    @cached_property
    def gradient(self) -> ca.Function:
        """Function of x and y, as for `expression`, with the column of dH²/dx and dH²/dy."""
        place = ca.SX.sym("place", 2)
        slope = ca.gradient(self.expression(place[0], place[1]), place)
        return ca.Function("gradient", [place], [ca.densify(slope)], {"cse": True})


def _waves(angle: ca.SX, count: int) -> list[tuple[ca.SX, ca.SX]]:
    """Cosine and sine of 0, 1, 2, ... angles; even and odd multiples by separate recurrences."""
    c, s = ca.cos(angle), ca.sin(angle)
    c2, s2 = c * c - s * s, 2 * s * c
    found = [(ca.SX(1), ca.SX(0)), (c, s)]
    for m in range(2, count):
        a, b = found[m - 2]
        found.append((a * c2 - b * s2, a * s2 + b * c2))
    return found[:count]


def block_field(
    row: CoilRow, half: float, on: int, every: int, tolerance: float = 1e-4
) -> BlockField:
    """Series of the field of blocks of `on` coils in an endless row, repeated every `every` coils.

    `half`: half width of the strip, m; terms below the share `tolerance` are dropped. Raises
    ArgumentError if a block exceeds the pattern, or the strip reaches the coils.
    """
    if not 0 < on < every:
        raise ArgumentError(
            f"a block of {on} coils does not fit into a pattern of {every}; write fewer coils"
        )
    if row.gap is None or not 0 < half < row.gap / 2:
        raise ArgumentError(f"a strip of half width {half:g} m reaches the coils")
    period = 2 * every * row.pitch  # after one repeat sides may have changed
    x = period * np.arange(_POINTS) / _POINTS
    height = chebyshev.chebpts1(_DEGREE + 1)
    values = _square(row, on, every, x, half * height)
    harmonics = np.fft.rfft(values, axis=1) / _POINTS
    harmonics[:, 1:] *= 2
    series = np.linalg.solve(chebyshev.chebvander(height, _DEGREE), harmonics)
    powers = np.stack([_powers(column) for column in series.T], axis=1)
    largest = np.abs(powers).max()
    # parts that vanish by symmetry are rounding errors, and are not computed with
    real, imag = (
        np.where(np.abs(part) > _ROUNDING * largest, part, 0.0)
        for part in (np.real(powers), np.imag(powers))
    )
    kept = np.where(np.abs(powers) > tolerance * largest, real + 1j * imag, 0)
    rows, columns = (np.flatnonzero(np.any(kept, axis=axis))[-1] + 1 for axis in (1, 0))
    field = BlockField(period, half, kept[:rows, :columns], 0.0)
    return replace(field, error=_error(field, row, on, every))


@lru_cache(maxsize=32)
def channel_field(
    coil: Coil,
    pitch: float,
    channel: float,
    clearance: float,
    body: float,
    on: int,
    every: int,
    tolerance: float,
) -> BlockField:
    """Field of blocks of coils alternating on both sides of a channel; see `block_field`.

    Lengths in m; `clearance`: inner side of a wall to windings; `body`: diameter. The strip is 1/20
    wider than the centre line needs, since time steps enter walls.
    """
    row = CoilRow(coil, 2, pitch, gap=channel + 2 * clearance, sides="alternating")
    return block_field(row, _WIDER * (channel - body) / 2, on, every, tolerance)


def _square(row: CoilRow, on: int, every: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """H² per squared ampere-turn, one row per y, with all relevant blocks on; x from the middle."""
    first = 2 * _BLOCKS * every  # an even number, so the central block begins on its own side
    many = replace(row, count=first + 2 * _BLOCKS * every)
    place = (np.arange(many.count) - first) % every
    currents = np.where(place < on, 1.0, 0.0)
    middle = (first + (on - 1) / 2) * row.pitch
    # The pattern's period: points farther away see the same row, with y mirrored.
    turns, rest = np.divmod(x + every * row.pitch / 2, every * row.pitch)
    flip = np.where((turns * every) % 2, -1.0, 1.0) if row.sides == "alternating" else 1 + 0 * x
    X = np.broadcast_to(middle + rest - every * row.pitch / 2, (len(y), len(x)))
    Y = y[:, None] * flip[None, :]
    return many.square(X, 0.0, currents, Y).reshape(X.shape)


def _powers(series: np.ndarray) -> np.ndarray:
    """Coefficients of powers from those of a Chebyshev series, also complex."""
    real, imag = (np.append(chebyshev.cheb2poly(part), np.zeros(len(series)))[: len(series)]
                  for part in (np.real(series), np.imag(series)))  # fmt: skip
    return real + 1j * imag


def _error(field: BlockField, row: CoilRow, on: int, every: int) -> float:
    """Largest error at points between those that determine the series."""
    x = field.period * (np.arange(97) + 0.37) / 97
    y = field.half * np.linspace(-1, 1, 11)
    exact = _square(row, on, every, x, y)
    place = ca.SX.sym("place", 2)
    value = ca.Function("value", [place], [field.expression(place[0], place[1])])
    X, Y = (part.ravel() for part in np.broadcast_arrays(x[None, :], y[:, None]))
    found = np.array(value.map(X.size)(np.vstack([X, Y]))).reshape(exact.shape)
    return float(np.abs(found - exact).max() / np.abs(exact).max())
