"""Evolution strategy: the best of a dozen numbers where a look is a simulation without slopes.

Each generation is drawn from a normal distribution that moves to the better half of it; its
covariance learns along which directions the steps that helped lay, and its size by how far they
add up (CMA-ES). Draws beyond bounds are put on them. It finds local optima, and goes over cliffs
and noise that stop methods with slopes.

Source: N. Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772, with its constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Evolved:
    """What was found."""

    point: np.ndarray
    value: float
    course: np.ndarray  # best value after each generation, the start's before them
    looks: int


def evolve(
    look: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    step: float,
    bounds: tuple[np.ndarray, np.ndarray],
    generations: int,
    *,
    size: int = 0,
    seed: int = 0,
) -> Evolved:
    """Search for the largest value from a start on; never worse than it.

    `look` is given points (k, n), which may be looked at side by side, and gives values (k,), -inf
    where there is none. `step`: standard deviation at first, alike for all numbers. `size` of a
    generation, 4 + 3 ln n if 0.
    """
    n, (low, high), rng = len(start), bounds, np.random.default_rng(seed)
    size = size or 4 + int(3 * math.log(n))
    weights = np.log((size + 1) / 2) - np.log(np.arange(1, size // 2 + 1))
    weights /= weights.sum()
    mass = 1 / np.sum(weights**2)
    path_rate = (4 + mass / n) / (n + 4 + 2 * mass / n)
    size_rate = (mass + 2) / (n + mass + 5)
    one_rate = 2 / ((n + 1.3) ** 2 + mass)
    many_rate = min(1 - one_rate, 2 * (mass - 2 + 1 / mass) / ((n + 2) ** 2 + mass))
    damping = 1 + 2 * max(0.0, math.sqrt((mass - 1) / (n + 1)) - 1) + size_rate
    usual = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))  # length of a normal draw
    mean, C = np.clip(start, low, high), np.eye(n)
    path, turned = np.zeros(n), np.zeros(n)
    best, value = mean, float(look(mean[None])[0])
    course = [value]
    for k in range(generations):
        squares, axes = np.linalg.eigh(C)
        roots = np.sqrt(np.maximum(squares, 1e-20))
        drawn = rng.standard_normal((size, n)) * roots @ axes.T
        points = np.clip(mean + step * drawn, low, high)
        values = look(points)
        order = np.argsort(-values, kind="stable")
        if values[order[0]] > value:
            best, value = points[order[0]], float(values[order[0]])
        course.append(value)
        chosen = (points[order[: len(weights)]] - mean) / step  # as they were put on the bounds
        move = weights @ chosen
        mean = mean + step * move
        turned = (1 - size_rate) * turned + math.sqrt(size_rate * (2 - size_rate) * mass) * (
            axes @ ((axes.T @ move) / roots)
        )
        length = float(np.linalg.norm(turned))
        far = length / math.sqrt(1 - (1 - size_rate) ** (2 * k + 2)) > (1.4 + 2 / (n + 1)) * usual
        path = (1 - path_rate) * path
        if not far:
            path = path + math.sqrt(path_rate * (2 - path_rate) * mass) * move
        kept = 1 - one_rate - many_rate + far * one_rate * path_rate * (2 - path_rate)
        C = kept * C + one_rate * np.outer(path, path)
        C += many_rate * (chosen.T * weights) @ chosen
        step *= math.exp(min(1.0, size_rate / damping * (length / usual - 1)))
    return Evolved(best, value, np.array(course), 1 + generations * size)
