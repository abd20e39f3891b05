"""Checks a gait against its limits, over all time and not by sampling."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.limits import Limits, whole_beside
from wormopt.systems.spiked.stretches import at_breaks

ACCEPTED = 1e-9
"""Accepted violation of a limit, as a share of it."""


def violations(motion: Crawl, limits: Limits) -> dict[str, float]:
    """Compute the violation of every limit, relative to the limit; at most 0 if it holds.

    Extremes are those of the motion's functions over all time, see `Crawl.extremes`.

    Parameters
    ----------
    motion : Crawl
        Motion under the gait.
    limits : Limits
        Limits to check.

    Returns
    -------
    dict of str to float
        Violations by name of the limit. ``closed`` is the gap between the gait's end and start.
        ``sigma`` is the violation of the condition that no mass glides, relative to the size of
        the forces. ``limits.spike_load`` is infinite if the gait has impulses.

    Examples
    --------
    >>> from wormopt.systems.spiked.construct import block_wave
    >>> from wormopt.systems.spiked.crawl import crawl
    >>> wave = block_wave(2, 1, 1.0, (0.8, 1.2), "trapezoid")  # rates up to 1.6
    >>> motion = crawl(wave, [1.0] * 3, 0.0, 50.0)
    >>> found = violations(motion, Limits(period=1.0, length=(0.7, 1.2), rate=1.0))
    >>> {key: round(value, 3) for key, value in found.items() if value > 1e-9}
    {'limits.rate': 0.6}
    """
    n, named = motion.gait.links, limits.name
    ranges = np.array(limits.length_ranges(n))
    found = {f"{named}.length": _excess(motion, "length", ranges[:, 0], ranges[:, 1])}
    rates = limits.rate_limits(n)
    if rates is not None:
        found[f"{named}.rate"] = _excess(motion, "rate", -np.array(rates[0]), np.array(rates[1]))
    for key, signal, count in (
        ("acceleration", "acceleration", n),
        ("spike_load", "reaction", n + 1),
        ("actuator_force", "actuator_force", n),
    ):
        if getattr(limits, key) is not None:
            most = np.broadcast_to(getattr(limits, key), count)
            found[f"{named}.{key}"] = _excess(motion, signal, -most, most)
    if limits.spike_load is not None and motion.impulses:
        found[f"{named}.spike_load"] = np.inf
    low = motion.extremes("sigma")[0].item()
    if limits.sigma_margin > 0:
        size = max(limits.sigma_margin, motion.force_scale)
        found[f"{named}.sigma_margin"] = (limits.sigma_margin - low) / size
    found["sigma"] = -low / motion.force_scale
    found[f"{named}.resting"] = float(limits.resting - motion.resting_min)
    shortest, longest = limits.period_range
    period = motion.gait.period * limits.cycles_of(motion.gait.period)
    found[f"{named}.period"] = max(shortest - period, period - longest) / longest
    if limits.tick is not None:
        whole = limits.whole_ticks(round(motion.gait.period / limits.tick))
        found[f"{named}.tick"] = abs(motion.gait.period - whole) / motion.gait.period
    found["closed"] = _gap(motion, limits)
    return found


def _excess(motion: Crawl, signal: str, low: np.ndarray, high: np.ndarray) -> float:
    least, most = motion.extremes(signal)
    size = np.maximum(np.abs(low), np.abs(high))
    return float(np.max(np.maximum(low - least, most - high) / size))


def _gap(motion: Crawl, limits: Limits) -> float:
    """Largest jump of lengths between pieces, and of rates unless impulses are allowed."""
    gaps = []
    for derivative in (0,) if limits.impulses else (0, 1):
        after, before = at_breaks(motion.gait, derivative)
        # rates may vanish at every break, so they are compared with those of the whole period
        size = np.abs(motion.extremes(("length", "rate")[derivative])).max()
        gaps.append(np.abs(after - before).max() / (size or 1.0))
    return float(max(gaps))


def in_steps(lengths: np.ndarray, step: float, ranges: Sequence[Sequence[float]]) -> np.ndarray:
    """Round lengths (n, m) to the nearest multiples of a step within the range of each link."""
    exact, rows = Fraction(repr(float(step))), []
    for row, (shortest, longest) in zip(lengths, ranges, strict=True):
        fewest, most = whole_beside(shortest, step)[1], whole_beside(longest, step)[0]
        counts, where = np.unique(np.clip(np.rint(row / step), fewest, most), return_inverse=True)
        rows.append(np.array([float(int(k) * exact) for k in counts])[where])
    return np.array(rows)


def speed_of(table: np.ndarray, period: float) -> float:
    """Mean speed if lengths (n, m) change linearly between columns and a mass always rests."""
    # The speed of the head is the largest sum of rates before a mass, so that none slips back.
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
