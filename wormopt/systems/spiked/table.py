"""Lengths of links at the ticks of a controller, as multiples of a step."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from wormopt.systems.spiked.gait_problem import Limits, whole_beside


def in_steps(lengths: np.ndarray, step: float, ranges: Sequence[Sequence[float]]) -> np.ndarray:
    """Round lengths (n, m) to the nearest multiples of a step within the range of each link."""
    exact, rows = Fraction(repr(float(step))), []
    for row, (shortest, longest) in zip(lengths, ranges, strict=True):
        fewest, most = whole_beside(shortest, step)[1], whole_beside(longest, step)[0]
        counts, where = np.unique(np.clip(np.rint(row / step), fewest, most), return_inverse=True)
        rows.append(np.array([float(int(k) * exact) for k in counts])[where])
    return np.array(rows)


def speed_of(table: np.ndarray, period: float) -> float:
    """Mean speed if lengths (n, m) change linearly between columns and a mass always rests.

    The speed of the head is the largest sum of rates before a mass, so that none slips back.
    """
    advance = np.cumsum(np.diff(table, axis=1), axis=0).max(axis=0)
    return float(np.maximum(advance, 0.0).sum()) / period


def excess_of(table: np.ndarray, tick: float, limits: Limits) -> dict[str, float]:
    """Violation of limits by a closed table's rates and their changes, relative to the limits."""
    links, rates = len(table), np.diff(table, axis=1) / tick
    found = {}
    if limits.rate is not None and (most := limits.rate_limits(links)):
        contraction, extension = (np.array(way)[:, None] for way in most)
        over = np.maximum(-rates / contraction, rates / extension)
        found[f"{limits.name}.rate"] = float(over.max()) - 1.0
    if limits.acceleration is not None:
        changes = np.abs(rates - np.roll(rates, 1, axis=1)) / tick
        most = np.broadcast_to(limits.acceleration, links)[:, None]
        found[f"{limits.name}.acceleration"] = float((changes / most).max()) - 1.0
    return found
