"""Averages of first and second order under stress: quadrature on even instants.

Fields that are smooth in time are averaged by sums over even instants, which are exact up to the
highest harmonic, and integrated harmonic by harmonic. Friction that reverses is averaged between
roots found one by one; to second order as the limit of ever steeper smooth laws, extrapolated.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.optimize import root_scalar

from tests.stress.verdict import Case, Dice, Judged, apart, many, spread
from wormopt.analysis.average import average
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal

_HARMONICS, _INSTANTS = 3, 64


class Field:
    """x' = sum over k of (products of states) times harmonics, all with random numbers."""

    def __init__(self, dice: Dice, states: int, period: float, size: float) -> None:
        self.period, self.omega = period, 2 * np.pi / period
        shape = (_HARMONICS + 1, states)
        self.constant = size * dice.normal(size=shape)
        self.linear = size * dice.normal(size=(*shape, states))
        self.square = size * dice.normal(size=(*shape, states))
        self.phase = dice.uniform(0, 2 * np.pi, shape)

    def expression(self, x: ca.SX, t: ca.SX) -> ca.SX:
        """The field for the package."""
        rows = []
        for i in range(x.numel()):
            row = ca.SX(0)
            for k in range(_HARMONICS + 1):
                part = self.constant[k, i] + ca.dot(self.linear[k, i], x)
                part += ca.dot(self.square[k, i], x * ca.sin(x))
                row += part * ca.cos(k * self.omega * t + self.phase[k, i])
            rows.append(row)
        return ca.vertcat(*rows)

    def at(self, x: np.ndarray, t: np.ndarray) -> np.ndarray:
        """The field (n, m)."""
        parts = self.constant + self.linear @ x + self.square @ (x * np.sin(x))
        return np.einsum("ki,kim->im", parts, self._waves(t))

    def slope(self, x: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Its derivative by the states (n, n, m)."""
        parts = self.linear + self.square * (np.sin(x) + x * np.cos(x))
        return np.einsum("kij,kim->ijm", parts, self._waves(t))

    def _waves(self, t: np.ndarray) -> np.ndarray:
        k = np.arange(_HARMONICS + 1)[:, None, None]
        return np.cos(k * self.omega * t + self.phase[:, :, None])


def _even(period: float, count: int = _INSTANTS) -> np.ndarray:
    return period * np.arange(count) / count


def _swing(values: np.ndarray, period: float) -> np.ndarray:
    """Integral without mean of what is left of rows (n, m) without their mean."""
    count = values.shape[1]
    frequency = 2j * np.pi * np.fft.fftfreq(count, period / count)
    frequency[0] = 1.0
    found = np.fft.fft(values) / frequency
    found[:, 0] = 0.0
    return np.real(np.fft.ifft(found))


def _ask(model: Model, period: float, order: int, x: ca.SX, places: np.ndarray) -> np.ndarray:
    """What the package says the averaged field is at places (n, m)."""
    averaged = average(model, period, order=order)  # pyright: ignore[reportArgumentType]
    return np.array(ca.Function("F", [x], [averaged.ode]).map(places.shape[1])(places))


def _smooth(order: int, dice: Dice) -> Judged:
    states, period = int(dice.integers(1, 4)), spread(dice, 1e-3, 1e3)
    size = spread(dice, 1e-3, 1.0) / period
    field = Field(dice, states, period, size)
    x, t = ca.SX.sym("x", states), ca.SX.sym("t")
    model = Model("field", x=[Signal("x", x)], ode=field.expression(x, t), t=t)
    places, times = dice.normal(size=(states, 4)), _even(period)
    known = []
    for place in places.T:
        values = field.at(place, times)
        mean = values.mean(axis=1)
        if order == 2:
            shift = _swing(values, period)
            mean = mean + np.einsum("ijm,jm->i", field.slope(place, times), shift) / len(times)
        known.append(mean)
    yield "averaged field", apart(_ask(model, period, order, x, places), np.array(known).T, 1e-9)


class Shaken:
    """A block on ground that shakes to and fro, which a force that changes pushes a little."""

    def __init__(self, dice: Dice) -> None:
        self.period = spread(dice, 1e-3, 1e3)
        self.omega = 2 * np.pi / self.period
        self.swing = spread(dice, 1e-3, 1e3)  # of the ground's speed
        self.second = dice.choice([0.0, 0.2, 0.8]) * dice.uniform(0.5, 1.0)
        self.phase, self.beat = dice.uniform(0, 2 * np.pi, 2)
        self.ahead, self.behind = (
            self.swing / self.period * spread(dice, 1e-4, 1e-1) for _ in "ab"
        )
        self.push = self.ahead * dice.uniform(0.1, 3.0)
        self.drag = dice.uniform(0.0, 0.1) / self.period

    def ground(self, t: np.ndarray) -> np.ndarray:
        """Velocity of the ground."""
        first = np.cos(self.omega * t)
        return self.swing * (first + self.second * np.cos(2 * self.omega * t + self.phase))

    def force(self, v: float, t: np.ndarray) -> np.ndarray:
        """All but friction."""
        return self.push * np.cos(self.omega * t + self.beat) - self.drag * v

    def model(self) -> tuple[Model, ca.SX]:
        """Build it for the package, and the symbol of its speed."""
        t, v, f = ca.SX.sym("t"), ca.SX.sym("v"), ca.SX.sym("f")
        second = self.second * ca.cos(2 * self.omega * t + self.phase)
        ground = self.swing * (ca.cos(self.omega * t) + second)
        push = self.push * ca.cos(self.omega * t + self.beat) - self.drag * v
        contact = Contact("block", v + ground, f, Coulomb(self.ahead, self.behind))
        return Model("block", x=[Signal("v", v)], ode=f + push, t=t, contacts=[contact]), v

    def first(self, v: float) -> float:
        """Mean between the roots of the velocity, one by one."""
        times = np.linspace(0.0, self.period, 4001)
        speed = v + self.ground(times)
        turns = np.flatnonzero(np.signbit(speed[1:]) != np.signbit(speed[:-1]))
        roots = [
            root_scalar(lambda t: v + self.ground(t), bracket=times[k : k + 2], xtol=1e-300).root
            for k in turns
        ]
        total = 0.0
        for a, b in pairwise([0.0, *roots, self.period]):
            forward = v + self.ground(np.array((a + b) / 2)) > 0
            total += (b - a) * (-self.ahead if forward else self.behind)
        return total / self.period - self.drag * v

    def second_order(self, v: float, width: float) -> float:
        """Mean to second order by a smooth law of some width."""
        times = _even(self.period, 2**15)
        steep = np.tanh((v + self.ground(times)) / width)
        mean, half = (self.ahead + self.behind) / 2, (self.ahead - self.behind) / 2
        values = self.force(v, times) - mean * steep - half
        slope = -mean * (1 - steep**2) / width - self.drag
        return float(values.mean() + (slope * _swing(values[None], self.period)[0]).mean())


def _friction(dice: Dice) -> Judged:
    shaken = Shaken(dice)
    model, v = shaken.model()
    speeds = shaken.swing * dice.uniform(-1.5, 1.5, 6)
    known = np.array([[shaken.first(speed) for speed in speeds]])
    found = _ask(model, shaken.period, 1, v, speeds[None])
    yield "averaged friction", apart(found, known, 1e-9, shaken.ahead + shaken.behind)


def _friction_twice(dice: Dice) -> Judged:
    """Steep laws of four widths: their errors have parts as the width and as its square."""
    shaken = Shaken(dice)
    model, v = shaken.model()
    speeds = shaken.swing * dice.uniform(-0.6, 0.6, 4)
    found = _ask(model, shaken.period, 2, v, speeds[None])[0]
    size = (shaken.ahead + shaken.behind + shaken.push) ** 2 * shaken.period / shaken.swing
    for speed, value in zip(speeds, found, strict=True):
        widths = shaken.swing * np.array([16e-3, 8e-3, 4e-3, 2e-3])
        values = np.array([shaken.second_order(speed, width) for width in widths])
        values = 2 * values[1:] - values[:-1]
        near, known = (4 * values[1:] - values[:-1]) / 3
        yield "second order", abs(value - known) / (abs(known - near) + 1e-6 * size)


def cases(*, quick: bool) -> Iterable[Case]:
    """Smooth fields and friction, to first and to second order; `quick`: two of each."""
    kinds = (
        ("averages: smooth, order 1", partial(_smooth, 1), 25),
        ("averages: smooth, order 2", partial(_smooth, 2), 25),
        ("averages: friction, order 1", _friction, 30),
        ("averages: friction, order 2", _friction_twice, 25),
    )
    return many(kinds, quick=quick)
