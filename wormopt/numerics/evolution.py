"""Evolution strategy: the best of a dozen numbers where a look is a simulation without slopes.

Each generation is drawn from a normal distribution that learns from its better half where to go,
along which directions and how far (CMA-ES). It finds local optima, and goes over cliffs and noise
that stop methods with slopes.

Source: N. Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Evolved:
    """What was found."""

    point: np.ndarray
    value: float
    course: np.ndarray  # best value after each generation, the start's before them


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
    """Search for the largest value from a start on; never worse than it.

    `look` is given points (k, n), which may be looked at side by side, and gives values (k,), -inf
    where there is none. `step`: standard deviation at first, alike for all numbers. `size` of a
    generation, 4 + 3 ln n if None.
    """
    from cmaes import CMA  # a search alone needs it

    best = np.clip(start, *bounds)
    # 0: draws beyond bounds are put on them, where the best often lies, and not drawn again
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
