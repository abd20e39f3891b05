"""A slow crawl as one would compute it with SciPy alone: a velocity by `minimize` at each instant.

Three links of length 1 whose joints go round (cos t, sin t), on ground that resists 1 along and 3
across. A user who knows of no rest smooths the power over a small speed, asks a generic solver for
the velocity of least power in the middle of each of N even steps, and puts the steps together. The
small speed is in proportion to the square of the step, so that both make errors of that order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize

from tests.benchmarks.planar_rivals import Answer, Solver
from tests.benchmarks.run import OWN
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.shape import Harmonics, chain_shape

_ALONG, _ACROSS = 1.0, 3.0
_STEPS = (32.0, 128.0, 512.0, 2048.0)
_SLOW = 10.0  # widths below which a mass that creeps is said to rest
_SMOOTH = 10.0  # of the speed over which power is smooth, over the square of the step


@dataclass(frozen=True)
class CrawlTask:
    """A stroke that all solvers are asked for: way and turn, and when masses first come to rest."""

    title: str
    source: str
    end: np.ndarray
    stop: float


THREE_LINKS = CrawlTask(
    "three links crawl slowly, a stroke (way and turn)",
    "two other programs (docs/theory-planar.md); digits end at 5e-9",
    np.array([1.14837049, 0.0]),
    0.2954567555,
)


def by_phases(_task: CrawlTask) -> Solver:
    """wormopt, asked for so many instants at first."""
    shape, law = chain_shape(3, lengths=(1.0, 1.0, 1.0)), Elliptic(_ALONG, _ALONG, _ACROSS)
    circle = Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])

    def run(instants: float) -> Answer:
        found = crawl(shape, law, circle, samples=int(instants))
        x, y, turn = found.displacement
        return np.array([np.hypot(x, y), turn]), 2 * np.pi * float(found.breaks[1])

    return run


def by_minimize(_task: CrawlTask, method: str) -> Solver:
    """SciPy's `minimize` at the middle of so many steps."""

    def run(steps: float) -> Answer:
        step = 2 * np.pi / int(steps)
        width, guess, pose, rested = _SMOOTH * step**2, np.zeros(3), 0j, np.nan
        heading = 0.0
        for k in range(int(steps)):
            t = (k + 0.5) * step
            given, power = _power(t, width)
            options: Any = {"jac": True} if method == "BFGS" else {}
            cost = power if method == "BFGS" else partial(_value, power)
            guess = minimize(cost, guess, method=method, tol=1e-3 * width, **options).x
            half = np.exp(1j * (heading + 0.5 * guess[2] * step))
            pose += step * half * complex(guess[0], guess[1])
            heading += guess[2] * step
            slow = np.abs(given(guess)) < _SLOW * width
            if np.isnan(rested) and slow.any():
                rested = k * step
        return np.array([abs(pose), heading]), rested

    return run


def solvers() -> dict[str, tuple[Any, tuple[float, ...]]]:
    """What makes each solver, and its settings: instants or steps in a stroke."""
    found: dict[str, tuple[Any, tuple[float, ...]]] = {OWN: (by_phases, (128.0,))}
    for method in ("BFGS", "Nelder-Mead"):
        found[f"SciPy {method}, even steps"] = partial(by_minimize, method=method), _STEPS
    return found


def _value(power: Callable[[np.ndarray], tuple[float, np.ndarray]], xi: np.ndarray) -> float:
    return power(xi)[0]


def _power(
    t: float, width: float
) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], tuple[float, np.ndarray]]]:
    """Velocities of the masses by the twist, and the smoothed power with its slope."""
    phi, rates = np.array([np.cos(t), np.sin(t)]), np.array([-np.sin(t), np.cos(t)])
    angles = -np.concatenate([[0.0], np.cumsum(phi)])
    turns = -np.concatenate([[0.0], np.cumsum(rates)])
    links = np.exp(1j * angles)
    places = np.concatenate([[0j], -np.cumsum(links)])
    drift = np.concatenate([[0j], -np.cumsum(1j * turns * links)])
    looks = np.exp(1j * np.array([angles[0], *(angles[1:] + phi / 2), angles[2]]))
    by_twist = np.stack([np.ones(4), np.full(4, 1j), 1j * places], axis=1) / looks[:, None]
    own = drift / looks

    def velocities(xi: np.ndarray) -> np.ndarray:
        return own + by_twist @ xi

    def power(xi: np.ndarray) -> tuple[float, np.ndarray]:
        v = velocities(xi)
        pull = _ALONG**2 * np.real(v) + 1j * _ACROSS**2 * np.imag(v)
        sizes = np.sqrt(np.real(pull.conj() * v) + width**2)
        return float(sizes.sum()), np.real((pull / sizes).conj() @ by_twist)

    return velocities, power
