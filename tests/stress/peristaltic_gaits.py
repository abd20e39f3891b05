"""Gaits of peristaltic worms, on drag and with anchors.

Judged by sums of drags over a period, eigenvalues, linear programs, power at every stop.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from scipy.optimize import linprog

from tests.stress.means import refused
from tests.stress.verdict import Dice, Judged, Kind, Undecided, apart, spread
from wormopt.model.gait import Gait
from wormopt.systems.peristaltic.anchored import anchored_wave, common_velocity
from wormopt.systems.peristaltic.anchored_fastest import mode_bound
from wormopt.systems.peristaltic.crawl import harmonic_wave, switched_wave
from wormopt.systems.peristaltic.drag import displacement
from wormopt.systems.peristaltic.drag_gaits import small_gaits


def _way(lengths: np.ndarray, rates: np.ndarray, exponent: float, period: float) -> float:
    """Way of the mean centre by the sum of drags, which is 0, at even instants (N, m)."""
    head = -(np.cumsum(rates, axis=0) - rates / 2)  # velocities of centres, the head at rest
    grip = lengths**exponent
    speed = head.mean(axis=0) - np.sum(grip * head, axis=0) / np.sum(grip, axis=0)
    return float(speed.mean() * period)


def _drag(dice: Dice) -> Judged:
    n, period, exponent = (
        int(dice.integers(2, 9)),
        spread(dice, 1e-3, 1e3),
        float(dice.normal() * 2),
    )
    size, length = float(dice.uniform(0.01, 0.9)), spread(dice, 1e-3, 1e3)
    swing = dice.uniform(-1, 1, (2, n))
    a, b = length * size * swing / np.hypot(*swing).max()
    omega = 2 * math.pi / period
    gait = Gait(
        np.array([0.0, period]), np.full((1, n, 1), length), np.array([omega]), a[None], b[None]
    )
    turn = 2 * math.pi * np.arange(4096) / 4096
    lengths = length + np.outer(a, np.cos(turn)) + np.outer(b, np.sin(turn))
    rates = omega * (np.outer(b, np.cos(turn)) - np.outer(a, np.sin(turn)))
    known = _way(lengths, rates, exponent, period)
    yield "way", apart(displacement(gait, exponent), known, 1e-8, size=length * size**2 * 1e-2)


def _quadratic(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Area of pairs of strains by expanding the sum of drags, and what drag dissipates.

    Places along the body by Gauss' rule in each segment, velocities linear in the rates.
    """
    centre = np.array([[-(i > j) - 0.5 * (i == j) for j in range(n)] for i in range(n)])
    centre -= centre.mean(axis=0)
    area = -(centre - centre.T) / 2
    nodes, weights = np.polynomial.legendre.leggauss(2)
    cost = np.zeros((n, n))
    for i in range(n):
        for node, weight in zip(nodes / 2, weights / 2, strict=True):
            row = centre[i] + node * np.eye(n)[i]
            cost += weight * np.outer(row, row)
    return area, cost


def _small(dice: Dice) -> Judged:
    n = int(dice.integers(2, 41))
    exponent = float(dice.choice([-1, 1])) * spread(dice, 1e-3, 10.0)
    dissipation = bool(dice.random() < 0.5)
    best = small_gaits(n, exponent, "dissipation" if dissipation else "strain_rate")[0]
    area, cost = _quadratic(n)
    own = np.linalg.eigvals(1j * np.linalg.solve(cost if dissipation else np.eye(n), area))
    yield "gain", apart(best.gain, float(own.real.max()), 1e-9)
    # such a gait, small as it is, goes as far as drags sum to 0
    effort, period = 1e-6, 2.0
    gait, m = best.gait(effort, 1.0, period), 256
    t = period * np.arange(m) / m
    lengths, rates = gait.on_piece(0, t, 0), gait.on_piece(0, t, 1)
    told = best.displacement(exponent, effort, 1.0, period)
    yield "way", apart(_way(lengths, rates, exponent, period), told, 1e-2)


def _waves(dice: Dice) -> Judged:
    n, period, size = int(dice.integers(1, 12)), spread(dice, 1e-3, 1e3), spread(dice, 1e-3, 1e5)
    lag, back = float(dice.uniform(0, 1)), bool(dice.random() < 0.5)
    wave = harmonic_wave(n, lag, period=period, size=size, retrograde=back)
    share = float(dice.uniform(0, 1))
    j = np.arange(n) * (1 if back else -1)
    known = size * np.cos(math.pi * (share - lag * j)) ** 2
    yield "harmonic", apart(wave(np.array(share * period)).ravel(), known, 1e-12, size=size)
    on = int(dice.integers(1, n + 1))
    block = switched_wave(n, on, step=period, size=size, retrograde=back)
    k = int(dice.integers(n))
    lit = [(k + i) % n for i in range(on)]
    lit = lit if back else [n - 1 - i for i in lit]
    known = np.isin(np.arange(n), lit) * size
    yield "switched", apart(block(np.array((k + 0.5) * period)).ravel(), known, 1e-12)


def _anchors(dice: Dice) -> Judged:
    n = int(dice.integers(3, 7))
    held = int(dice.integers(1, n))
    shrink, grow = spread(dice, 1e-3, 1e3), spread(dice, 1e-3, 1e3)
    if dice.random() < 0.5:
        grow = shrink
    mid = bool(dice.random() < 0.4)
    bound = mode_bound(n, held, (shrink, grow), "mid" if mid else "clamp")
    known = _ceiling(n, held, shrink, grow, mid)
    yield "ceiling", apart(bound.speed, known, 1e-7, size=1e-2 * max(shrink, grow))
    if held > 1:
        stroke, step = spread(dice, 1e-6, 10), spread(dice, 1e-3, 1e3)
        wave = anchored_wave(n, held, stroke=stroke, step=step)
        yield "advance", apart(wave.advance, (n - held) * stroke, 1e-12)
        yield "speed", apart(wave.speed, (n - held) * stroke / (n * step), 1e-12)
        yield "faults", float(wave.faults().max()) / (1e-12 * stroke)


def _ceiling(n: int, held: int, shrink: float, grow: float, mid: bool) -> float:
    """Most speed of all shares of sets at rest: rings' ways dense, shares last but one."""
    sets = list(combinations(range(n), held))
    rings, m = n + 1, len(sets)
    unit = max(shrink, grow)
    size = m * rings + m + 1
    upper, equal, right = [], [], []
    for k, rest in enumerate(sets):
        for j in range(n):
            row = np.zeros(size)
            row[k * rings + j], row[k * rings + j + 1] = 1.0, -1.0
            for sign, rate in ((1, grow), (-1, shrink)):
                one = sign * row
                one[m * rings + k] = -rate / unit
                upper.append(one)
            if j in rest:
                still = np.abs(row)
                equal.append(still)
                right.append(0.0)
                if not mid:
                    equal.append(row)
                    right.append(0.0)
    for i in range(rings):
        row = np.zeros(size)
        row[i : m * rings : rings], row[-1] = 1.0, -1.0
        equal.append(row)
        right.append(0.0)
    row = np.zeros(size)
    row[m * rings : -1] = 1.0
    equal.append(row)
    right.append(1.0)
    cost = np.zeros(size)
    cost[-1] = -1.0
    bounds = [(None, None)] * (m * rings) + [(0, None)] * m + [(None, None)]
    exact = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    found = linprog(
        cost, np.array(upper), np.zeros(len(upper)), np.array(equal), right, bounds, options=exact
    )  # fmt: skip
    if found.status:
        raise Undecided(found.message)
    return -found.fun * unit


def _slide(dice: Dice) -> Judged:
    """Velocities that take least power are those between which it does not change."""
    n = int(dice.integers(1, 30))
    v, (ahead, back) = spread(dice, 1e-6, 1e6) * dice.normal(size=n), dice.uniform(0.1, 3, (2, n))
    if dice.random() < 0.3:  # whole numbers, with ties
        ahead, back = np.round(ahead), np.round(back)
    force = float(dice.uniform(-0.9, 0.9)) * min(ahead.sum(), back.sum())
    if not ahead.any() or not back.any():
        raise Undecided("no friction")

    def power(V: float) -> float:
        u = v + V
        return float(ahead @ np.maximum(u, 0) + back @ np.maximum(-u, 0) - force * V)

    stops = np.sort(-v)
    values = np.array([power(V) for V in stops])
    least = stops[values <= values.min() + 1e-12 * (np.abs(v) @ (ahead + back))]
    yield "velocities", apart(common_velocity(v, ahead, back, force), [least[0], least[-1]], 1e-12)
    beyond = ahead.sum() * (1 + spread(dice, 1e-6, 1))
    yield "force", refused(lambda: common_velocity(v, ahead, back, beyond), "exceeds the friction")


GAITS: tuple[Kind, ...] = (
    ("gaits on drag", _drag, 15),
    ("best small gaits", _small, 10),
    ("waves of currents", _waves, 6),
    ("anchored worms", _anchors, 10),
    ("sliding worms", _slide, 8),
)
"""Kinds of cases: name, compare, count."""
