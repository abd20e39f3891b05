"""Least power over a single unknown, for many bodies at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_DOUBLED, _LAST, _TINY = 60, 1e-17, 1e-100


@dataclass(frozen=True, eq=False)
class Line:
    """Problem of G bodies: minimise sum psi_i(v_i + w a_i) - w load over w.

    Arrays are (m, G), masses first, which makes sums over them fast.
    """

    v: np.ndarray  # along the headings
    v_n: np.ndarray  # to the left, times the resistance there
    a: np.ndarray
    a_n: np.ndarray
    ahead: np.ndarray  # resistances
    back: np.ndarray
    load: np.ndarray  # (G,)

    def slope(self, w: np.ndarray) -> np.ndarray:
        """Return the slope (G,) at w (G,), which never falls and jumps where masses stop."""
        along, aside = self.v + w * self.a, self.v_n + w * self.a_n
        force = np.where(along >= 0, self.ahead, self.back)
        along *= force
        size = np.maximum(np.hypot(along, aside), _TINY)
        return ((along * force * self.a + aside * self.a_n) / size).sum(axis=0) - self.load

    def least(self) -> np.ndarray:
        """Return the minimum (G,) by bisection to the last digit, the most reliable method."""
        force = np.where(self.v >= 0, self.ahead, self.back)
        square = (force * self.a) ** 2 + self.a_n**2
        product = force**2 * self.v * self.a + self.v_n * self.a_n
        stops = np.divide(-product, square, np.zeros_like(square), where=square > 0)
        low, high = stops.min(axis=0), stops.max(axis=0)
        gap = high - low + np.abs(stops).max(axis=0) + _TINY
        low, high = self._beyond(low, -gap), self._beyond(high, gap)
        while (high - low > _LAST * gap).any():
            middle = (low + high) / 2
            if not ((low < middle) & (middle < high)).any():
                break
            up = self.slope(middle) < 0
            low, high = np.where(up, middle, low), np.where(up, high, middle)
        return self._stopped(low, high, stops, gap)

    def _beyond(self, end: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return an end of the bracket, moved out until the slope leads back."""
        for _ in range(_DOUBLED):
            out = np.sign(reach) * self.slope(end) < 0
            if not out.any():
                break
            end = np.where(out, end + reach, end)
            reach = 2 * reach
        return end

    def _stopped(
        self, low: np.ndarray, high: np.ndarray, stops: np.ndarray, gap: np.ndarray
    ) -> np.ndarray:
        """Return the better end of the last bracket, or the stop of a mass beside it."""
        w = np.where(np.abs(self.slope(low)) < np.abs(self.slope(high)), low, high)
        off = np.abs(stops - w)
        nearest = np.take_along_axis(stops, off.argmin(axis=0)[None], axis=0)[0]
        return np.where(off.min(axis=0) < 1e-15 * gap, nearest, w)
