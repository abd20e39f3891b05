"""Right-hand sides of the benchmarks as one would write them by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from wormopt.bench.driven_chain import Grip
from wormopt.bench.event_loop import Plant
from wormopt.control.lambda_tracker import Feedback

# Gait (15) with T = 1, l0 = 2, e = 0.15: on each third MIDDLE + WAVE cos(3 pi s).
_MIDDLE = 2.0 + 0.3 * np.array([[1, -1], [1, -2], [0, -1]])
_WAVE = 0.3 * np.array([[-1, 1], [1, 0], [0, -1]])
_OMEGA = 3 * math.pi


def track_start(feedback: Feedback) -> np.ndarray:
    """Start of benchmarks TRACK13 (7,) and TRACK14 (9,), with tracker (13) or (14).

    Positions, velocities, gain and, for (14), the filter's state.
    """
    start = [0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0]
    return np.array([*start, 1.0, 1.0] if feedback == "filter" else start)


def track_rates(feedback: Feedback) -> Callable[[float, np.ndarray], np.ndarray]:
    """Benchmarks TRACK13 and TRACK14, trackers (13) and (14), in NumPy: (t, y) -> y'."""

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        v, k = y[3:6], y[6]
        third = int(3 * (t % 1.0))
        angle = _OMEGA * (t % 1.0 - third / 3)
        length, rate = y[:2] - y[1:3], v[:2] - v[1:]
        e = length - (_MIDDLE[third] + _WAVE[third] * np.cos(angle))
        dk = max(math.sqrt(e @ e) - 0.2, 0.0) ** 2
        dy = np.empty_like(y)
        if feedback == "filter":
            fed = y[7:]
            dy[7:] = fed_rate = k * k * (e - fed)
        else:
            fed, fed_rate = e, rate + _OMEGA * _WAVE[third] * np.sin(angle)
        pull = 10.0 * length + 5.0 * rate + (k + dk) * fed + k * fed_rate
        dy[:3], dy[6] = v, dk
        dy[3:6] = 4.5 - 5.5 * np.tanh(40.0 * v)
        dy[3:5] -= pull
        dy[4:6] += pull
        return dy

    return rates


def track_loops(feedback: Feedback) -> Callable[[float, np.ndarray], np.ndarray]:
    """Benchmarks TRACK13 and TRACK14 number by number, as numba wants it: (t, y) -> y'."""
    filtered = feedback == "filter"
    middle, wave, omega = _MIDDLE, _WAVE, _OMEGA

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        k = y[6]
        third = int(3 * (t % 1.0))
        angle = omega * (t % 1.0 - third / 3)
        c, s = math.cos(angle), math.sin(angle)
        e1 = y[0] - y[1] - (middle[third, 0] + wave[third, 0] * c)
        e2 = y[1] - y[2] - (middle[third, 1] + wave[third, 1] * c)
        dk = max(math.sqrt(e1 * e1 + e2 * e2) - 0.2, 0.0) ** 2
        dy = np.empty_like(y)
        if filtered:
            f1, f2 = y[7], y[8]
            d1, d2 = k * k * (e1 - f1), k * k * (e2 - f2)
            dy[7], dy[8] = d1, d2
        else:
            f1, f2 = e1, e2
            d1 = y[3] - y[4] + omega * wave[third, 0] * s
            d2 = y[4] - y[5] + omega * wave[third, 1] * s
        pull1 = 10.0 * (y[0] - y[1]) + 5.0 * (y[3] - y[4]) + (k + dk) * f1 + k * d1
        pull2 = 10.0 * (y[1] - y[2]) + 5.0 * (y[4] - y[5]) + (k + dk) * f2 + k * d2
        for i in range(3):
            dy[i] = y[3 + i]
            dy[3 + i] = 4.5 - 5.5 * math.tanh(40.0 * y[3 + i])
        dy[3] -= pull1
        dy[4] += pull1 - pull2
        dy[5] += pull2
        dy[6] = dk
        return dy

    return rates


def track_traced(
    feedback: Feedback, y: list[Any], s: Any, middle: Any, wave: Any, np: Any
) -> list[Any]:
    """Rates of TRACK13 and TRACK14 on one third of the period, for packages that trace code.

    `s`: time since the third began; its reference is middle + wave cos(3 pi s).
    `np` is the module whose cos, sin, tanh, sqrt and maximum are called.
    """
    k, c = y[6], np.cos(_OMEGA * s)
    e = [y[j] - y[j + 1] - (middle[j] + wave[j] * c) for j in range(2)]
    dk = np.maximum(np.sqrt(e[0] * e[0] + e[1] * e[1]) - 0.2, 0.0) ** 2
    if feedback == "filter":
        fed = y[7:]
        fed_rate = [k * k * (e[j] - fed[j]) for j in range(2)]
        more = fed_rate
    else:
        turn = _OMEGA * np.sin(_OMEGA * s)
        fed, fed_rate = e, [y[3 + j] - y[4 + j] + turn * wave[j] for j in range(2)]
        more = []
    pull = [
        10.0 * (y[j] - y[j + 1]) + 5.0 * (y[3 + j] - y[4 + j]) + (k + dk) * fed[j] + k * fed_rate[j]
        for j in range(2)
    ]
    grip = [4.5 - 5.5 * np.tanh(40.0 * y[3 + i]) for i in range(3)]
    net = [grip[0] - pull[0], grip[1] + pull[0] - pull[1], grip[2] + pull[1]]
    return [*y[3:6], *net, dk, *more]


def mag2_plant() -> Plant:
    """Benchmark MAG2 in NumPy."""
    eps = 0.036
    nu = math.sqrt(2.0) + 0.5 * eps

    def rates(t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        pull = y[0] - y[1] + eps * (1.0 + math.cos(nu * t))
        return np.array([y[2], y[3], force[0] - pull, force[1] + pull])

    grips = [Grip(0.5 * eps, eps)] * 2
    return Plant(rates, np.zeros(4), np.array([2, 3]), np.ones(2), grips, lambda _: np.zeros(0))


def thirds(span: float) -> list[tuple[float, float, np.ndarray, np.ndarray]]:
    """Pieces of the reference of TRACK13 and TRACK14: first and last time, middle and wave.

    `span`: last time, a multiple of a third.
    """
    count = round(3 * span)
    return [(q / 3, (q + 1) / 3, _MIDDLE[q % 3], _WAVE[q % 3]) for q in range(count)]
