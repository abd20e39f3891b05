"""Field of blocks of coils that repeat along an endless row.

On a strip along the row, the square of the field is a double series: a Fourier series along the
row, where it is periodic, and powers across it. The field is smooth there, so the series converges
geometrically; its truncation error is measured. The force on magnetisable matter is proportional to
the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from wormopt.errors import ArgumentError
from wormopt.magnetics.coils import Coil, CoilRow

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
        height, total = y / self.half, ca.SX(0)
        for part, _ in self._rows(x):
            total = total * height + part
        return total

    def _rows(self, x: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Coefficients of the powers across at `x`, and their slopes, the highest power first."""
        turn, count = 2 * np.pi / self.period, self.coefficients.shape[1]
        waves, slopes = _waves(turn * x, count), 1j * turn * np.arange(count)

        def total(row: np.ndarray) -> ca.SX:
            part = ca.SX(0)
            for (cosine, sine), c in zip(waves, row, strict=True):
                part += c.real * cosine if c.real else 0
                part -= c.imag * sine if c.imag else 0
            return part

        return [(total(row), total(slopes * row)) for row in self.coefficients[::-1]]

    @cached_property
    def gradient(self) -> ca.Function:
        """Function of x and y, as for `expression`, with the column of dH²/dx and dH²/dy."""
        place = ca.SX.sym("place", 2)
        height, value, along, across = place[1] / self.half, ca.SX(0), ca.SX(0), ca.SX(0)
        # shorter than what differentiation makes of `expression`, and many nodes ask in every step
        for part, slope in self._rows(place[0]):
            across = across * height + value
            value, along = value * height + part, along * height + slope
        slope = ca.vertcat(along, across / self.half)
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

    `half`: half width of the strip, m; terms below the share `tolerance` are dropped.
    """
    if not 0 < on < every:
        raise ArgumentError(
            f"a block of {on} coils does not fit into a pattern of {every} coils; write fewer"
        )
    if row.gap is None or not 0 < half < row.gap / 2:
        raise ArgumentError(f"a strip of half width {half:g} m touches the coils; write less")
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
    wider than the centre line needs, since time steps enter walls, but not up to the coils.
    """
    row = CoilRow(coil, 2, pitch, gap=channel + 2 * clearance, sides="alternating")
    needed, coils = (channel - body) / 2, channel / 2 + clearance
    return block_field(row, min(_WIDER * needed, (needed + coils) / 2), on, every, tolerance)


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
