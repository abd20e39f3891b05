"""Motions of piecewise linear velocities, by which rivals are judged, in closed form.

Shares no code with the designer or with `crawl`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.bench.design_cases import Arrays

Course = list[tuple[float, float]]
"""Seconds since the start, and the best speed known by then."""

_REST = 1e-9  # velocities below are none, as parts of the largest


@dataclass(frozen=True, eq=False)
class Motion:
    """One cycle; velocities are linear within arcs, and periodic."""

    durations: np.ndarray  # (arcs,)
    velocities: np.ndarray  # (arcs, n + 1) of all masses where each arc begins
    lengths: np.ndarray  # (n,) of the links where the first arc begins

    @property
    def period(self) -> float:
        """Duration of the cycle."""
        return float(self.durations.sum())

    @property
    def speed(self) -> float:
        """Slowest mean speed of any mass; the same for all where lengths are periodic."""
        return float((self.durations @ self._means).min() / self.period)

    @property
    def _means(self) -> np.ndarray:
        return (self.velocities + np.roll(self.velocities, -1, axis=0)) / 2

    def excess(self, limits: Arrays) -> dict[str, float]:
        """Excess over every limit relative to its size, not positive where it holds.

        Extremes are those of the linear and quadratic functions on all arcs, not of samples.
        Vanishing arcs are judged by the change of velocities, not by a quotient.
        """
        h, start = self.durations[:, None], self.velocities
        end = np.roll(start, -1, axis=0)
        rate, later = -np.diff(start), -np.diff(end)
        fastest = float(limits.fastest.max())
        low, high = -limits.contraction, limits.extension
        reach = limits.acceleration * h
        still = (np.maximum(start, end) <= _REST * fastest).sum(axis=1)
        return {
            "period": self._off_period(limits),
            "velocity": float(-start.min()) / fastest,
            "resting": float(limits.resting - still[self.durations > 0].min()),
            "rate": float(np.maximum(low - rate, rate - high).max()) / fastest,
            "acceleration": float((np.abs(later - rate) - reach).max()) / fastest,
            **self._length_excess(rate, later, limits),
            **self._force_excess(start, end, still, limits),
        }

    def worst(self, limits: Arrays) -> float:
        """Largest excess over any limit, relative to its size."""
        return max(self.excess(limits).values())

    def _off_period(self, limits: Arrays) -> float:
        """How far whole numbers of cycles miss the allowed periods."""
        shortest, longest = limits.period
        counts = np.unique([max(1, round(p / self.period)) for p in limits.period])
        counts = np.arange(counts[0], counts[-1] + 1)
        totals = counts * self.period
        return float(np.maximum(shortest - totals, totals - longest).min()) / longest

    def _length_excess(
        self, rate: np.ndarray, later: np.ndarray, limits: Arrays
    ) -> dict[str, float]:
        h = self.durations[:, None]
        begin = self.lengths + np.vstack(
            [np.zeros(limits.links), np.cumsum(h * (rate + later) / 2, axis=0)]
        )
        # the quadratic turns within an arc whose rate changes its sign
        turns = rate * later < 0
        share = np.where(turns, rate / np.where(turns, rate - later, 1.0), 0.0)
        inner = begin[:-1] + h * share * rate / 2
        every = np.vstack([begin, inner])
        size = limits.length[:, 1]
        over = np.maximum(limits.length[:, 0] - every, every - size) / size
        closed = np.abs(begin[-1] - begin[0]) / size
        return {"length": float(over.max()), "closed": float(closed.max())}

    def _force_excess(
        self, start: np.ndarray, end: np.ndarray, still: np.ndarray, limits: Arrays
    ) -> dict[str, float]:
        """Momentum that the spikes give on each arc, were its force that of its start or end."""
        h = self.durations
        gained = (end - start) @ limits.mass + h * limits.static_load
        given = [gained + h * limits.drag * v.sum(axis=1) for v in (start, end)]
        size = float(limits.mass.sum() * limits.fastest.max())
        found = {"sigma": float(-np.min(given)) / size}
        if np.isfinite(limits.spike_load):
            most = limits.spike_load * still * h
            found["spike_load"] = float(np.max(np.array(given) - most)) / size
        return found
