"""Bodies with a mass on a wave of a film: floats that slide down it, plates on the ground.

Judged by forces integrated anew over their length, and by motions that SciPy follows from one stop
to the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from tests.stress.means import refused, zero
from tests.stress.verdict import Dice, Judged, Kind, Undecided, apart, spread
from wormopt.simulation.simulate import simulate
from wormopt.systems.film.body import HeavyFloat, LyingBody, carried_body
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.shapes import FourierWave, Wave

_TURN = 2 * math.pi
_GAUSS = np.polynomial.legendre.leggauss(12)

Force = Callable[[float], float]


@dataclass(frozen=True)
class _Surface:
    """1 + sum a_k cos(k xi) + b_k sin(k xi), and the flow of its wave."""

    a: np.ndarray
    b: np.ndarray

    def at(self, xi: np.ndarray, order: int = 0) -> np.ndarray:
        k = np.arange(1, len(self.a) + 1)
        turned = np.exp(1j * np.multiply.outer(xi, k)) * (1j * k) ** order
        return np.real(turned @ (self.a - 1j * self.b)) + (order == 0)

    @property
    def constant(self) -> float:
        """No pressure is left after a wavelength."""
        h = self.at(_TURN * np.arange(1 << 14) / (1 << 14))
        return float(-np.mean(h**-2) / np.mean(h**-3))

    @property
    def wave(self) -> Wave:
        plain = len(self.a) == 1 and not self.b.any()
        return CosineWave(float(self.a[0])) if plain else FourierWave(self.a, self.b)


def _surface(dice: Dice, thinnest: float) -> _Surface:
    """A cosine, or some harmonics; at its thinnest so thin."""
    if dice.random() < 0.5:
        return _Surface(np.array([1 - thinnest]), np.zeros(1))
    count = int(dice.integers(2, 5))
    a, b = dice.uniform(-1, 1, (2, count)) / np.arange(1, count + 1) ** 2
    depth = -(_Surface(a, b).at(np.linspace(0, _TURN, 4001)) - 1).min()
    return _Surface((1 - thinnest) * a / depth, (1 - thinnest) * b / depth)


def _length(dice: Dice) -> float:
    return 0.0 if dice.random() < 0.3 else spread(dice, 1e-3, 6.2)


def _mean(of: Callable[[np.ndarray], np.ndarray], xi: float, length: float, panels: int) -> float:
    """Over the body's length, by Gauss' rule on panels."""
    if not length:
        return float(of(np.array([xi]))[0])
    edges = xi - length / 2 + length / panels * np.arange(panels)
    nodes, weights = _GAUSS
    places = edges[:, None] + length / panels * (1 + nodes) / 2
    return float((of(places.ravel()) * np.tile(weights / 2, panels)).sum() / panels)


# -- forces ----------------------------------------------------------------------------------------


def _float_forces(s: _Surface, length: float, weight: float, panels: int) -> tuple[Force, Force]:
    """Push and drag: the surface's mean velocity against the mean shear, and the mean slope."""
    C = s.constant

    def drag(xi: float) -> float:
        return _mean(lambda at: 1 / s.at(at), xi, length, panels)

    def push(xi: float) -> float:
        surface = _mean(lambda at: 1.5 * (1 + C / s.at(at)), xi, length, panels)
        return surface * drag(xi) + weight * _mean(lambda at: s.at(at, 1), xi, length, panels)

    return push, drag


def _plate_forces(
    s: _Surface, height: float, length: float, tension: float, panels: int
) -> tuple[Force, Force]:
    """Shear on a plate by the flow over it: u = v + F ((z - b)² / 2 - (z - b) (h - b))."""
    C = s.constant

    def shear(at: np.ndarray, v: float) -> np.ndarray:
        h = s.at(at)
        gap = h - height
        through = h + C - v * height - v * gap  # by pressure alone
        gradient = -3 * through / gap**3
        return -gradient * gap

    def push(xi: float) -> float:
        ends = _mean(lambda at: -s.at(at, 3), xi, length, panels)  # x runs against the phase
        return _mean(lambda at: shear(at, 0.0), xi, length, panels) + tension * height * ends

    def drag(xi: float) -> float:
        return _mean(lambda at: shear(at, 0.0) - shear(at, 1.0), xi, length, panels)

    return push, drag


def _compared(body: HeavyFloat | LyingBody, push: Force, drag: Force, dice: Dice) -> Judged:
    phases = dice.uniform(-10.0, 10.0, 3)
    known = [[force(xi) for xi in phases] for force in (push, drag)]
    yield "push", apart([body.push(xi) for xi in phases], known[0], 1e-9, size=known[1][0] * 1e-2)
    yield "drag", apart([body.drag(xi) for xi in phases], known[1], 1e-9)


def _weighty(dice: Dice) -> Judged:
    s, length = _surface(dice, spread(dice, 1e-2, 1.0)), _length(dice)
    weight = 0.0 if dice.random() < 0.2 else spread(dice, 1e-6, 1e6)
    body = HeavyFloat(s.wave, length, weight)
    yield from _compared(body, *_float_forces(s, length, weight, 60), dice)


def _plate(dice: Dice) -> Judged:
    thinnest = spread(dice, 1e-2, 0.9)
    s, length = _surface(dice, thinnest), _length(dice)
    height = 0.0 if dice.random() < 0.3 else thinnest * float(dice.uniform(0.01, 0.8))
    tension = 0.0 if dice.random() < 0.5 else spread(dice, 1e-6, 1e3)
    body = LyingBody(s.wave, height, length, tension)
    yield from _compared(body, *_plate_forces(s, height, length, tension, 60), dice)


# -- motions ---------------------------------------------------------------------------------------


def _slid(
    push: Force, drag: Force, mass: float, law: tuple[float, float], span: float
) -> tuple[float, float]:
    """Place and velocity after so long: rest while the ground can hold, else a slide to a stop."""
    ahead, behind = law
    t, x, v = 0.0, 0.0, 0.0
    for _ in range(200):
        force = push(t - x)
        if v == 0.0 and -behind <= force <= ahead:
            let_go = _let_go(lambda s, x=x: push(s - x), ahead, behind, t, span)
            if let_go is None:
                return x, 0.0
            t, force = let_go
        way = math.copysign(1.0, v or force)
        grip = ahead if way > 0 else behind

        def rates(at: float, y: np.ndarray, held: float = way * grip) -> list[float]:
            return [y[1], (push(at - y[0]) - drag(at - y[0]) * y[1] - held) / mass]

        def stop(_: float, y: np.ndarray) -> float:
            return y[1]

        stop.terminal, stop.direction = bool(ahead or behind), -way  # type: ignore[attr-defined]
        slide = solve_ivp(
            rates, (t, span), [x, v], "LSODA", events=stop, rtol=1e-11, atol=1e-12, max_step=0.1
        )
        t, (x, v) = float(slide.t[-1]), slide.y[:, -1].tolist()
        if t >= span:
            return x, v
        v = 0.0
    raise Undecided("it stops again and again")


def _let_go(
    force: Force, ahead: float, behind: float, t: float, span: float
) -> tuple[float, float] | None:
    """When the ground no longer holds, and the force's sign then; None if it does to the end."""
    step = 0.01
    for k in range(math.ceil((span - t) / step)):
        a, b = t + k * step, min(t + (k + 1) * step, span)
        for sign, grip in ((1.0, ahead), (-1.0, behind)):
            if sign * force(b) > grip:
                return zero(lambda s, d=sign, g=grip: d * force(s) - g, a, b) + 1e-13, sign
    return None


def _followed(dice: Dice) -> Judged:
    """Floats, from such that follow the fluid at once to such that hardly follow."""
    s, length = _surface(dice, float(dice.uniform(0.15, 0.9))), _length(dice)
    weight, mass = spread(dice, 1e-3, 1e2), spread(dice, 1e-4, 1e4)
    push, drag = _float_forces(s, length, weight, 6)
    span = float(dice.uniform(5.0, 15.0))
    motion = simulate(carried_body(HeavyFloat(s.wave, length, weight), mass=mass), span)
    x, v = _slid(push, drag, mass, (0.0, 0.0), span)
    yield "position", apart(motion["position"][0, -1], x, 1e-7, size=1.0)
    yield "velocity", apart(motion["velocity"][0, -1], v, 1e-6, size=0.1)
    yield "impulse", apart(motion["impulse"][0, -1], mass * v, 1e-6, size=0.1 * max(mass, 1.0))


def _sticking(dice: Dice) -> Judged:
    """Plates that the ground holds for a part of the time, for all of it, or hardly at all."""
    thinnest = float(dice.uniform(0.2, 0.9))
    s, length = _surface(dice, thinnest), _length(dice)
    height, mass = thinnest * float(dice.choice([0.0, 0.3, 0.6])), spread(dice, 1e-3, 1e3)
    push, drag = _plate_forces(s, height, length, 0.0, 6)
    largest = max(abs(push(xi)) for xi in np.linspace(0, _TURN, 41))
    ahead, behind = (largest * spread(dice, 1e-2, 1.2) for _ in range(2))
    span = float(dice.uniform(5.0, 12.0))
    body = LyingBody(s.wave, height, length)
    motion = simulate(carried_body(body, mass=mass, forward=ahead, backward=behind), span)
    x, v = _slid(push, drag, mass, (ahead, behind), span)
    yield "position", apart(motion["position"][0, -1], x, 1e-7, size=0.1)
    yield "velocity", apart(motion["velocity"][0, -1], v, 1e-6, size=0.1)


def _not_carried(dice: Dice) -> Judged:
    """Bodies that cannot be."""
    more = 1 + spread(dice, 1e-3, 1e2)
    delta = float(dice.uniform(0.1, 0.9))
    wave = CosineWave(delta)
    yield "long", refused(lambda: HeavyFloat(wave, _TURN * more), "length", "below a wavelength")
    yield "light", refused(lambda: HeavyFloat(wave, 0.0, -more), "weight must be 0 or above")
    high = (1 - delta) * more
    yield "high", refused(lambda: LyingBody(wave, high), "height", "least film thickness")
    yield "tension", refused(lambda: LyingBody(wave, tension=-more), "tension must be 0 or above")
    body = HeavyFloat(wave)
    yield "mass", refused(lambda: carried_body(body, mass=-more), "mass must be above 0")
    yield "friction", refused(lambda: carried_body(body, mass=1.0, forward=more), "LyingBody")


CARRIED: tuple[Kind, ...] = (
    ("forces on floats", _weighty, 10),
    ("forces on plates", _plate, 10),
    ("heavy floats", _followed, 10),
    ("plates on the ground", _sticking, 12),
    ("no bodies on films", _not_carried, 3),
)
