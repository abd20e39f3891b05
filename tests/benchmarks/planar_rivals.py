"""Planar stops as one would compute them with SciPy alone: solve_ivp, events, rest by hand.

A stop is a double zero of the squared speed, which no sign change tells: the event is that the
speed falls below a small number, which a user has to choose; it is the tolerance here. Then the
mass is put to rest, if the ground can hold it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.benchmarks.planar_tasks import TRIPOD_ANGLES, Stop
from tests.oracles.planar_worm import PlanarWorm, flat, plane

Answer = tuple[np.ndarray, float]
"""Places at the end, and when all came to rest (NaN if unknown)."""
Solver = Callable[[float], Answer]


def _event(function: Callable[[float, np.ndarray], float], direction: int) -> Any:
    def event(t: float, y: np.ndarray) -> float:
        return function(t, y)

    event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return event


def masses_by_events(worm: PlanarWorm, span: float, method: str, tolerance: float) -> Answer:
    """Point masses on ellipses that are alike ahead and behind, and do not turn."""
    m, law = worm.n, np.stack([worm.forward, worm.sideways], axis=1)
    y, t, slides = worm.start.copy(), 0.0, np.hypot(*worm.velocity.T) > 0
    least, rested = tolerance, math.nan

    def pull(t: float, y: np.ndarray) -> np.ndarray:
        force = worm.pull(t, plane(y[: 2 * m]).tolist(), plane(y[2 * m :]).tolist())
        return flat(force).reshape(m, 2)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        v = y[2 * m :].reshape(m, 2)
        power = np.sqrt(((law * v) ** 2).sum(axis=1))
        slip = -(law**2) * v / np.where(power > 0, power, 1.0)[:, None]
        a = (pull(t, y) + slip) / worm.mass[:, None]
        return np.concatenate([v.ravel(), np.where(slides[:, None], a, 0.0).ravel()])

    def speed(i: int, y: np.ndarray) -> float:
        return math.hypot(y[2 * m + 2 * i], y[2 * m + 2 * i + 1]) - least

    def excess(i: int, t: float, y: np.ndarray) -> float:
        return float(np.hypot(*(pull(t, y)[i] / law[i]))) - 1.0

    def start_off(i: int, t: float, y: np.ndarray) -> None:
        way = pull(t, y)[i] / law[i] ** 2  # exact where the ground is isotropic
        y[2 * m + 2 * i : 2 * m + 2 * i + 2] = 2 * least * way / np.hypot(*way)
        slides[i] = True

    for i in np.flatnonzero(~slides):
        if excess(int(i), t, y) > 0:
            start_off(int(i), t, y)
    while t < span:
        events = [
            _event(lambda _, y, i=i: speed(i, y), -1)
            if slides[i]
            else _event(lambda t, y, i=i: excess(i, t, y), 1)
            for i in range(m)
        ]
        found = solve_ivp(
            rates, (t, span), y, method, events=events, rtol=tolerance, atol=0.1 * tolerance
        )
        if found.status < 0:
            raise RuntimeError(found.message)
        y, t = found.y[:, -1].copy(), float(found.t[-1])
        for i in [i for i, at in enumerate(found.t_events) if len(at)]:
            if not slides[i]:
                start_off(i, t, y)
                continue
            slides[i], y[2 * m + 2 * i : 2 * m + 2 * i + 2] = False, 0.0
            if excess(i, t, y) > 0:
                start_off(i, t, y)
        rested = math.nan if slides.any() else t if math.isnan(rested) else rested
        if not slides.any() and not any(worm.drive.cosine.ravel()):
            break
    return y[: 2 * m], rested


def masses_smoothed(worm: PlanarWorm, span: float, tolerance: float) -> Answer:
    """The same with friction that is steep instead of set-valued, over a hundredth of the root."""
    m, law, width = worm.n, np.stack([worm.forward, worm.sideways], axis=1), 0.01 * tolerance**0.5

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        v = y[2 * m :].reshape(m, 2)
        power = np.sqrt(((law * v) ** 2).sum(axis=1) + width**2)
        pull = worm.pull(t, plane(y[: 2 * m]).tolist(), plane(y[2 * m :]).tolist())
        a = (flat(pull).reshape(m, 2) - law**2 * v / power[:, None]) / worm.mass[:, None]
        return np.concatenate([v.ravel(), a.ravel()])

    found = solve_ivp(rates, (0.0, span), worm.start, "Radau", rtol=tolerance, atol=0.1 * tolerance)
    if found.status < 0:
        raise RuntimeError(found.message)
    return found.y[: 2 * m, -1], math.nan


def tripod_by_events(method: str, tolerance: float) -> Answer:
    """Rigid tripod: slides until a foot stops, turns about it until it rests."""
    arms = np.stack([np.cos(TRIPOD_ANGLES), np.sin(TRIPOD_ANGLES)], axis=1)

    def feet(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, s = math.cos(y[2]), math.sin(y[2])
        arm = arms @ np.array([[c, s], [-s, c]])
        return arm, y[3:5] + y[5] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)

    def sliding(_: float, y: np.ndarray) -> np.ndarray:
        arm, v = feet(y)
        force = -v / np.hypot(v[:, 0], v[:, 1])[:, None]
        moment = float((arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum())
        return np.concatenate([y[3:], force.sum(axis=0) / 3, [moment / 3]])

    def slow(i: int, y: np.ndarray) -> float:
        return float(np.hypot(*feet(y)[1][i])) - tolerance

    events = [_event(lambda _, y, i=i: slow(i, y), -1) for i in range(3)]
    start = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    options: Any = {"rtol": tolerance, "atol": 0.1 * tolerance}
    found = solve_ivp(sliding, (0.0, 3.0), start, method, events=events, **options)
    if found.status != 1:
        raise RuntimeError(found.message)
    y, t = found.y[:, -1], float(found.t[-1])
    foot = next(i for i, at in enumerate(found.t_events) if len(at))
    # About a foot: moment of inertia 3 m + 3 m = 6, arms of the other two sqrt(3), so that
    # w' = -2 sqrt(3) / 6; the foot holds while 3 w² <= 1.
    arm = feet(y)[0][foot]
    if 3 * y[5] ** 2 + 1e-9 > 1.0:
        raise RuntimeError("the foot does not hold")
    time = math.sqrt(3) * y[5]
    turn = 0.5 * y[5] * time
    c, s = math.cos(turn), math.sin(turn)
    centre = y[:2] + arm - np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
    return np.append(centre, y[2] + turn), t + time


def by_scipy(task: Stop, method: str) -> Solver:
    """SciPy with events."""
    if task.name == "tripod":
        return lambda tolerance: tripod_by_events(method, tolerance)
    assert task.worm is not None
    worm = task.worm
    return lambda tolerance: masses_by_events(worm, task.span, method, tolerance)


def by_smoothing(task: Stop) -> Solver:
    """SciPy with steep friction."""
    worm = task.worm
    if worm is None:
        raise NotImplementedError("not written for rigid bodies")
    return lambda tolerance: masses_smoothed(worm, task.span, tolerance)
