"""Compass search: maximises over a few variables a simulated, slightly inexact function.

Each round looks one step both ways along every axis. The best point becomes the new centre if
its gain exceeds both uncertainties, else the steps are halved. No slope is needed.

Source: T. G. Kolda, R. M. Lewis, V. Torczon, SIAM Review 45 (2003) 385.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Point = dict[str, float]


@dataclass(frozen=True)
class Look:
    """Value found at a point."""

    point: Point
    value: float
    error: float  # uncertainty of the value


def compass(
    look: Callable[[Sequence[Point]], Sequence[Look]],
    start: Mapping[str, float],
    steps: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
    rounds: int,
) -> list[Look]:
    """Search for the largest value; returns the centres, from the start to the best.

    `look` evaluates several points at once, which may be computed in parallel.
    """
    centres, seen = list(look([dict(start)])), {_key(start)}
    sizes = dict(steps)
    for _ in range(rounds):
        around = [p for p in _around(centres[-1].point, sizes, bounds) if _key(p) not in seen]
        seen.update(map(_key, around))
        found = look(around) if around else []
        best = max(found, key=lambda one: one.value, default=None)
        now = centres[-1]
        if best is not None and best.value - best.error > now.value + now.error:
            centres.append(best)
        else:
            sizes = {name: size / 2 for name, size in sizes.items()}
    return centres


def _key(point: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(round(value, 9) for value in point.values())


def _around(
    centre: Point, sizes: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]
) -> list[Point]:
    """One step each way along every axis, cut at the bounds."""
    found = []
    for name, size in sizes.items():
        low, high = bounds[name]
        for value in (centre[name] - size, centre[name] + size):
            moved = min(max(value, low), high)
            if moved != centre[name]:
                found.append(centre | {name: moved})
    return found
