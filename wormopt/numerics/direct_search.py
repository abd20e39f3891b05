"""Direct search: optimises a few variables by simulated values, without slopes.

`compass`: each round looks one step both ways along every axis. The best point becomes the new
centre if its gain exceeds both uncertainties, else the steps are halved.

Source: T. G. Kolda, R. M. Lewis, V. Torczon, SIAM Review 45 (2003) 385.

`evolve` (CMA-ES): each generation is drawn from a normal distribution whose mean, directions and
size adapt to the better half of the last one. It finds local optima, and copes with jumps and noise
that stop methods with slopes.

Source: N. Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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
    again: Callable[[Point], Look] | None = None,
) -> list[Look]:
    """Search for the largest value; returns the centres, from the start to the best.

    `look` evaluates several points at once, which may be computed in parallel. The largest of
    several uncertain values is large by chance in part: `again` evaluates a point anew before it
    becomes the centre.
    """

    def anew(one: Look) -> Look:
        return again(one.point) if again else one

    def gains(one: Look) -> bool:
        return one.value - one.error > centres[-1].value + centres[-1].error

    centres, seen = [*map(anew, look([dict(start)]))], {_key(start)}
    sizes = dict(steps)
    for _ in range(rounds):
        around = [p for p in _around(centres[-1].point, sizes, bounds) if _key(p) not in seen]
        seen.update(map(_key, around))
        found = filter(gains, look(around) if around else [])
        found = sorted(found, key=lambda one: one.value, reverse=True)
        best = next(filter(gains, map(anew, found)), None)
        if best is not None:
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


@dataclass(frozen=True, eq=False)
class Evolved:
    """Best point, its value and the history."""

    point: np.ndarray
    value: float
    course: np.ndarray  # best value after each generation, after that of the start


def evolve(
    look: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    step: float,
    bounds: tuple[np.ndarray, np.ndarray],
    generations: int,
    *,
    size: int | None = None,
    seed: int = 0,
) -> Evolved:
    """Search for the largest value from a start; never worse than the start.

    `look` takes points (k, n), which may be computed in parallel, and returns values (k,), -inf
    if there is none. `step`: initial standard deviation of all variables. `size` of a
    generation, 4 + 3 ln n if None.
    """
    from cmaes import CMA  # a search alone needs it

    best = np.clip(start, *bounds)
    # 0: draws beyond bounds are moved to them, where optima often are, and not drawn again
    strategy = CMA(
        best.copy(), step, np.stack(bounds, axis=1), n_max_resampling=0, seed=seed,
        population_size=size,
    )  # fmt: skip
    value = float(look(best[None])[0])
    course = [value]
    for _ in range(generations):
        points = np.array([strategy.ask() for _ in range(strategy.population_size)])
        values = look(points)
        first = int(np.argmax(values))
        if values[first] > value:
            best, value = points[first], float(values[first])
        course.append(value)
        strategy.tell(list(zip(points, -values, strict=True)))
    return Evolved(best, value, np.array(course))
