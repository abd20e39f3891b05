"""Sign changes of contact velocities within a period, as expressions of the slow states.

With theta in [0, 1] as the elapsed share of the period, a contact's velocity is a trigonometric
polynomial c_0 + sum_k (a_k cos(2 pi k theta) + b_k sin(2 pi k theta)) with coefficients that
depend on the slow states. Its sign changes are computed, not sampled:

- One harmonic, of order k, has 2 k of them, in closed form.
- Several harmonics of a fixed shape g, velocity = A + B g(theta): between two extrema of g, which
  are numbers, the velocity is monotonic and has one at most. It is bracketed by bisection and
  sharpened by Newton's method, all as one expression, so that its derivatives are exact too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError

_HALVINGS = 30  # leaves 1e-9 of the bracket, which two Newton steps square twice
_NEGLIGIBLE = 1e-12
_BESIDE = 1e-2  # of the unit circle: effect of round-off on a fivefold zero
_MOST = 31  # harmonics
_ELSEWHERE = np.array([0.07, 0.3, 0.61, 0.88])  # shares of the period at which harmonics differ


@dataclass(frozen=True, eq=False)
class Crossing:
    """A place where a velocity may change its sign."""

    place: ca.SX  # share theta of the period, in [0, 1)
    real: ca.SX  # 1: sign change; 0: none, and `place` is arbitrary
    rising: ca.SX  # 1: velocity becomes positive; 0: negative


@dataclass(frozen=True, eq=False)
class Wave:
    """A velocity over one period as a trigonometric polynomial."""

    mean: ca.SX  # coefficient c_0
    cosines: ca.SX  # (K, 1) coefficients of the harmonics 1 to K
    sines: ca.SX  # (K, 1) coefficients of the harmonics 1 to K

    @property
    def degree(self) -> int:
        """Number of harmonics K."""
        return self.cosines.numel()

    def __call__(self, theta: ca.SX | float) -> ca.SX:
        """Velocity at the share `theta` of the period."""
        angle = 2 * np.pi * theta * ca.DM(np.arange(1, self.degree + 1))
        return self.mean + ca.dot(self.cosines, ca.cos(angle)) + ca.dot(self.sines, ca.sin(angle))

    def slope(self, theta: ca.SX | float) -> ca.SX:
        """Derivative of the velocity by theta, the elapsed share of the period."""
        order = 2 * np.pi * ca.DM(np.arange(1, self.degree + 1))
        turn = order * theta
        return ca.dot(order, self.sines * ca.cos(turn) - self.cosines * ca.sin(turn))

    @classmethod
    def of(cls, velocity: ca.Function, symbols: ca.SX, values: np.ndarray) -> Wave:
        """Shortest wave equal to `velocity`, a function (symbols, theta) -> velocity.

        `values` (n, m): numbers for `symbols` (n, 1) that show which harmonics are present. Raises
        ArgumentError above 31 harmonics, or for other functions than trigonometric polynomials.
        """
        degree = _harmonics_in(velocity, values)
        count = 2 * degree + 2
        grid = np.arange(count) / count
        samples = ca.vertcat(*(velocity(symbols, theta) for theta in grid))
        turns = 2 * np.pi * np.outer(np.arange(1, degree + 1), grid)
        # exact zeros of cosines instead of 6e-17 omit coefficients that are 0
        table = np.vstack([np.cos(turns), np.sin(turns)]) * 2 / count
        table[np.abs(table) < _NEGLIGIBLE] = 0.0
        harmonics = ca.mtimes(ca.DM(table), samples)
        return cls(ca.sum1(samples) / count, harmonics[:degree], harmonics[degree:])

    def crossings(self, symbols: ca.SX, values: np.ndarray) -> list[Crossing]:
        """Find the sign changes of a velocity that depends on theta.

        `values` (n, m): numbers for `symbols` (n, 1), on which the coefficients depend.
        Raises ArgumentError for several harmonics whose shape depends on the states.
        """
        there = self._there(symbols, values)
        if len(there) == 1:
            return self._of_one_harmonic(int(there[0]) + 1)
        return self._of_a_shape(symbols, values)

    def _harmonics(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        """Harmonics as complex numbers, a column for each of the samples."""
        parts = ca.horzcat(self.cosines, self.sines)
        both = ca.Function("harmonics", [symbols], [parts, self.mean])
        found = []
        for column in values.T:
            swing, mean = map(np.array, both(column))
            swing[np.abs(swing) <= _NEGLIGIBLE * np.abs(mean)] = 0.0  # rounding errors of 0
            found.append(swing @ (1, -1j))
        return np.stack(found, axis=1)

    def _there(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        sizes = np.abs(self._harmonics(symbols, values))
        return np.flatnonzero((sizes > _NEGLIGIBLE * sizes.max(axis=0)).any(axis=1))

    def _of_one_harmonic(self, order: int) -> list[Crossing]:
        cosine, sine = self.cosines[order - 1], self.sines[order - 1]
        size = ca.sqrt(cosine**2 + sine**2)
        real = ca.fabs(self.mean) < size
        # the guards keep derivatives finite where there is no sign change
        share = ca.if_else(real, -self.mean / ca.if_else(real, size, 1), 0)
        top = ca.atan2(ca.if_else(real, sine, 0), ca.if_else(real, cosine, 1))
        half = ca.acos(share)
        return [
            Crossing(_turned((turn / (2 * np.pi) + k) / order), real, ca.SX(rising))
            for k in range(order)
            for turn, rising in ((top - half, 1), (top + half, 0))
        ]

    def _of_a_shape(self, symbols: ca.SX, values: np.ndarray) -> list[Crossing]:
        extrema = _extrema(self._shape(symbols, values))
        found = []
        for low, high in pairwise([*extrema, extrema[0] + 1]):
            at_low, at_high = self(low), self(high)
            real = at_low * at_high < 0
            place = self._bracketed(low, high, at_low)
            for _ in range(2):
                slope = ca.if_else(real, self.slope(place), 1)
                place = ca.if_else(real, place - self(place) / slope, (low + high) / 2)
            found.append(Crossing(_turned(place), real, at_high > 0))
        return found

    def _shape(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        """Harmonics as complex numbers, which may depend on states by one common factor only."""
        found = self._harmonics(symbols, values).T
        shape = next(harmonics for harmonics in found if np.any(harmonics))
        for harmonics in found:
            # the factor is real: a complex one would turn all harmonics by one angle, which is no
            # shift in time
            factor = np.vdot(shape, harmonics).real / np.vdot(shape, shape).real
            if np.abs(harmonics - factor * shape).max() > 1e-9 * np.abs(harmonics).max():
                raise ArgumentError(
                    "a contact velocity has several harmonics whose ratios depend on states or "
                    "parameters; only a common factor of all of them may do so"
                )
        return shape / np.abs(shape).max()

    def _bracketed(self, start: float, end: float, at_low: ca.SX) -> ca.SX:
        """Bisect a bracket; its derivative is 0, Newton's steps add that of the place."""
        low, high = ca.SX(start), ca.SX(end)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            before = self(middle) * at_low > 0
            low, high = ca.if_else(before, middle, low), ca.if_else(before, high, middle)
        return (low + high) / 2


def sign_after(wave: Wave, crossings: Sequence[Crossing]) -> ca.SX:
    """Sign (+1 or -1) of a velocity at the beginning of the period, before any crossing.

    It is that after the last crossing, one period earlier; without any, that of the mean.
    """
    last, sign = ca.SX(-1), ca.if_else(wave.mean < 0, -1, 1)
    for crossing in crossings:
        later = ca.logic_and(crossing.real, crossing.place > last)
        last = ca.if_else(later, crossing.place, last)
        sign = ca.if_else(later, 2 * crossing.rising - 1, sign)
    return sign


def _turned(place: ca.SX) -> ca.SX:
    """The place shifted to [0, 1), with its derivative."""
    turned = place - ca.floor(place)
    return turned - (turned >= 1)  # a place below 0 by less than round-off


def _harmonics_in(velocity: ca.Function, values: np.ndarray) -> int:
    """Highest harmonic present."""
    count = 2 * _MOST + 2
    samples = _sampled(velocity, values, np.arange(count) / count)
    spectrum = np.fft.rfft(samples, axis=1) / count
    sizes = np.abs(spectrum).max(axis=0)
    there = np.flatnonzero(sizes > _NEGLIGIBLE * max(sizes.max(), 1e-300))
    highest = int(there[-1]) if there.size else 0
    # harmonics above half the number of samples have aliases on them, and nowhere else
    turns = np.exp(2j * np.pi * np.outer(np.arange(len(sizes)), _ELSEWHERE))
    series = 2 * (spectrum @ turns).real - spectrum[:, :1].real
    off = np.abs(_sampled(velocity, values, _ELSEWHERE) - series).max()
    if highest > _MOST or off > 1e-9 * np.abs(samples).max():
        raise ArgumentError(
            f"contact velocities must be a mean and at most {_MOST} harmonics of the period; "
            "give the period of all of them, and smooth what jumps or bends"
        )
    return highest


def _sampled(velocity: ca.Function, values: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Velocity at shares of the period (n,) for all columns of `values` (k, m): (m, n)."""
    count = values.shape[1]
    points, shares = np.repeat(values, len(theta), axis=1), np.tile(theta, count)
    return np.array(velocity(points, shares[None])).reshape(count, len(theta))


def _extrema(harmonics: np.ndarray) -> list[float]:
    """Extrema of Re sum_k c_k exp(2 pi i k theta), ascending in [0, 1).

    With w = exp(2 pi i theta) its derivative is a polynomial in w over a power of w; extrema are
    its roots on the unit circle. Multiple roots come out beside the circle; nearby roots that are
    no extrema only split monotonic parts.
    """
    slopes = 1j * np.arange(1, len(harmonics) + 1) * harmonics
    roots = np.roots(np.concatenate([slopes[::-1], [0.0], slopes.conj()]))
    on_circle = roots[np.abs(np.abs(roots) - 1) < _BESIDE]
    return np.sort(np.angle(on_circle) / (2 * np.pi) % 1.0).tolist()
