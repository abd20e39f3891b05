"""Evolution strategy (CMA-ES): optimises a dozen variables by simulations, without slopes.

Each generation is drawn from a normal distribution whose mean, directions and size adapt to the
better half of the last one. It finds local optima, and copes with jumps and noise that stop
methods with slopes.

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
