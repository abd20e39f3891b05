"""Worms of membrane segments in a row: on drag, on dry ground, in tubes that give way.

Judged by motions that SciPy follows from slopes of energies by complex steps, with events where the
ground holds rings, and by forces in random states.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.driven_chain import Grip, Plant
from tests.oracles.integrators import event_loop
from tests.stress.means import refused
from tests.stress.verdict import Dice, Judged, Kind, apart, spread
from wormopt.model.model import Model, pack
from wormopt.quantities import GRAVITY
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.peristaltic.chain import Bed, Body, DragGround, DryGround, peristaltic_worm
from wormopt.systems.peristaltic.crawl import crawl, switched_wave
from wormopt.systems.peristaltic.segment import Segment
from wormopt.systems.peristaltic.tables import Tube

_MU0 = 4e-7 * math.pi
_STEP = 1e-30
_CHI = 0.35


@dataclass(frozen=True, eq=False)
class _Worm:
    """Segments of one kind, unlike masses, and a block of fields that runs along them."""

    segment: Segment
    mass: np.ndarray
    damping: np.ndarray
    on: int
    step: float
    pressure: float
    load: float

    @property
    def body(self) -> Body:
        return Body([self.segment] * len(self.mass), self.mass, self.damping, 1 + _CHI,
                    load=self.load)  # fmt: skip

    @property
    def rings(self) -> np.ndarray:
        return np.convolve(self.mass, [0.5, 0.5])

    @property
    def field(self) -> float:
        return math.sqrt(2 * self.pressure / (_MU0 * _CHI))

    @property
    def period(self) -> float:
        return len(self.mass) * self.step

    def lit(self, t: float) -> np.ndarray:
        """Pressures: the block starts at the head, and goes on by a segment after each step."""
        n = len(self.mass)
        first = math.floor(t / self.step * (1 + 1e-14)) % n
        return self.pressure * np.isin(np.arange(n), (first + np.arange(self.on)) % n)

    def pull(self, lengths: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Slope of the energy of membrane and field by the lengths of segments."""
        s = self.segment
        lam = lengths / s.length * (1 + 1j * _STEP)
        a, hoop = s.neo_hookean, 1 / np.sqrt(lam)
        squares = [lam**2, hoop**2, 1 / (lam * hoop) ** 2]
        first, second = sum(squares) - 3, sum(1 / q for q in squares) - 3
        wall = 2 * math.pi * s.radius * s.length * s.wall * s.shear_modulus
        elastic = wall * (a * first + (1 - a) * second) / 2
        coil = -pressure * math.pi * s.radius**2 * s.length * s.coil_share / lam
        return np.imag(elastic + coil) / (_STEP * lengths)

    def forces(self, x: np.ndarray, v: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """On rings, without the ground's: segments pull both their ends together."""
        pull = self.pull(x[:-1] - x[1:], pressure) + self.damping * (v[:-1] - v[1:])
        shared = self.load * self.rings / self.rings.sum()
        return np.append(0.0, pull) - np.append(pull, 0.0) - shared

    @property
    def start(self) -> np.ndarray:
        n = len(self.mass) + 1
        return np.append(-self.segment.length * np.arange(n), np.zeros(n))


def _worm(dice: Dice, most: int) -> _Worm:
    radius = spread(dice, 1e-3, 0.1)
    s = Segment(
        radius * spread(dice, 1.0, 20.0), radius, radius * spread(dice, 1e-2, 0.2),
        spread(dice, 1e3, 1e7), float(dice.uniform(0.2, 0.7)),
        1.0 if dice.random() < 0.5 else float(dice.uniform(0.5, 1.0)),
    )  # fmt: skip
    n = int(dice.integers(2, most + 1))
    mass = s.volume * 1200 * dice.uniform(0.5, 2.0, n)
    stiff = 6 * math.pi * s.radius * s.shear_modulus * s.wall / s.length
    pace = math.sqrt(mass.mean() / stiff)
    damping = spread(dice, 1e-2, 2.0) * math.sqrt(stiff * mass.mean()) * dice.uniform(0.5, 1.5, n)
    pressure = spread(dice, 1e-3, 0.3) * s.shear_modulus * s.wall / s.radius
    return _Worm(
        s, mass, damping, int(dice.integers(1, n)), pace * spread(dice, 0.5, 10.0), pressure, 0.0
    )


def _crawled(worm: _Worm, ground: DragGround | DryGround, cycles: int) -> Trajectory:
    model = peristaltic_worm(worm.body, ground, "clamp")
    n = len(worm.mass)
    course = switched_wave(n, worm.on, step=worm.step, size=worm.field, retrograde=True)
    return crawl(model, course, cycles, nominal_work=worm.body.nominal_work, samples=2 * n)


def _on_drag(dice: Dice) -> Judged:
    worm = _worm(dice, 5)
    n, s = len(worm.mass), worm.segment
    stiff = 6 * math.pi * s.radius * s.shear_modulus * s.wall / s.length
    c0 = spread(dice, 1e-2, 3.0) * math.sqrt(stiff * worm.mass.mean())
    exponent = float(dice.choice([-2.0, -1.0, 0.0, 1.0, 3.0]))

    def rates(_: float, y: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        x, v = y[: n + 1], y[n + 1 : 2 * n + 2]
        lengths, middle = x[:-1] - x[1:], (v[:-1] + v[1:]) / 2
        drag = -c0 * (lengths / s.length) ** exponent * middle
        ground = np.convolve(drag, [0.5, 0.5])
        forces = worm.forces(x, v, pressure) + ground
        stretching = v[:-1] - v[1:]
        coil = worm.pull(lengths, pressure) - worm.pull(lengths, 0 * pressure)
        powers = [-coil @ stretching, -worm.damping @ stretching**2, drag @ middle]
        return np.concatenate([v, forces / worm.rings, powers])

    y, motion = np.append(worm.start, np.zeros(3)), _crawled(worm, DragGround(c0, exponent), 2)
    for k in range(2 * n):
        span, lit = (k * worm.step, (k + 1) * worm.step), worm.lit((k + 0.5) * worm.step)
        y = solve_ivp(rates, span, y, "DOP853", args=(lit,), rtol=1e-10, atol=1e-13).y[:, -1]
    yield from _ended(worm, motion, y)
    names = ("coil", "damping", "drag")
    works = [motion[f"{name}_work"][0, -1] for name in names]
    yield "works", apart(works, y[-3:], 1e-6)


def _ended(worm: _Worm, motion: Trajectory, y: np.ndarray) -> Judged:
    n, small = len(worm.mass), worm.pressure * worm.segment.radius
    small /= worm.segment.shear_modulus * worm.segment.wall
    way = small * worm.segment.length
    yield "places", apart(motion["position"][:, -1], y[: n + 1], 1e-12 + 1e-7 * small)
    pace = way / worm.step
    yield "velocities", apart(motion["velocity"][:, -1], y[n + 1 : 2 * n + 2], 1e-6, size=pace)


def _on_dry_ground(dice: Dice) -> Judged:
    """Rings that stick and slip, with the weight of half of both their segments."""
    worm = _worm(dice, 4)
    n = len(worm.mass)
    # friction that an active coil's pull overcomes, or does not
    pull = worm.pressure * math.pi * worm.segment.radius**2 * worm.segment.coil_share
    weight = worm.rings * GRAVITY
    ahead = pull / weight.mean() * spread(dice, 0.03, 1.5)
    behind = ahead * (1.0 if dice.random() < 0.3 else spread(dice, 1.0, 10.0))
    motion = _crawled(worm, DryGround(ahead, behind), 1)

    def rates(t: float, y: np.ndarray, ground: np.ndarray) -> np.ndarray:
        x, v = y[: n + 1], y[n + 1 :]
        return np.append(v, (worm.forces(x, v, worm.lit(t)) + ground) / worm.rings)

    plant = Plant(
        rates, worm.start, np.arange(n + 1, 2 * n + 2), worm.rings,
        [Grip(ahead * w, behind * w) for w in weight],
        lambda span: worm.step * np.arange(1, round(span / worm.step)),
    )  # fmt: skip
    found = event_loop(plant, worm.period, relative=1e-11, max_step=worm.step / 20)
    yield from _ended(worm, motion, found.end)


def _called(model: Model, *symbols: ca.SX) -> Callable[..., np.ndarray]:
    call = ca.Function("called", [pack(model.x), pack(model.u), model.forces], list(symbols))
    return lambda *given: np.array(call(*given)).ravel()


def _in_tubes(dice: Dice) -> Judged:
    """Accelerations of rings, and what holds them, in any state: the wall by virtual work."""
    worm = _worm(dice, 6)
    n, s = len(worm.mass), worm.segment
    tube = Tube(s.radius * (1 + spread(dice, 1e-5, 0.05)), spread(dice, 1e-2, 2.0))
    k = spread(dice, 1e-2, 1e4) * worm.pressure / s.radius
    anchoring = "mid" if dice.random() < 0.5 else "clamp"
    model = peristaltic_worm(worm.body, Bed(tube, k), anchoring)
    lengths = s.length * np.exp(dice.normal(size=n) * spread(dice, 1e-3, 0.3))
    lengths = np.maximum(lengths, 1.01 * s.coil_share * s.length)
    x = spread(dice, 1e-3, 10.0) * s.length - np.append(0.0, np.cumsum(lengths))
    v = dice.normal(size=n + 1) * s.length / worm.step
    lit = worm.pressure * dice.integers(0, 2, n)
    field = np.sqrt(2 * lit / (_MU0 * _CHI))
    contacts = n if anchoring == "mid" else n + 1
    held = dice.normal(size=contacts) * worm.pressure * s.radius**2
    radius = np.sqrt(s.volume / (math.pi * lengths))
    presses = k * np.maximum(radius - tube.radius, 0.0)
    wall = presses * 2 * s.volume / radius * radius / (2 * lengths)  # -dE/dl: r falls as l grows
    ground = np.convolve(held, [0.5, 0.5]) if anchoring == "mid" else held
    forces = worm.forces(x, v, lit) + np.append(wall, 0.0) - np.append(0.0, wall) + ground
    state = np.append(x, v)
    found = _called(model, model.ode)(state, field, held)
    size = float(np.abs(worm.pull(lengths, lit)).max() / worm.rings.mean())
    yield "accelerations", apart(found[n + 1 :], forces / worm.rings, 1e-9, size=size)
    pressed = presses * 2 * math.pi * radius * lengths
    weight = worm.mass * GRAVITY
    limits = tube.friction * (weight + pressed)
    if anchoring == "clamp":
        limits = np.convolve(limits, [0.5, 0.5])
    told = _called(model, model["limit_forward"])(state, field, held)
    yield "what the ground holds", apart(told, limits, 1e-9)


def _no_worm(dice: Dice) -> Judged:
    """Worms that cannot be."""
    more = 1 + spread(dice, 1e-6, 10.0)
    s = Segment(20e-3, 5e-3, 0.3e-3, 20e3)
    yield "mass", refused(lambda: Body([s] * 3, mass=-more), "mass must be positive")
    yield "count", refused(lambda: Body([s] * 3, mass=[more] * 2), "2 numbers for 3 segments")
    body = Body([s] * 3, mass=1e-3)
    narrow = Bed(Tube(5e-3 / more, 0.3), 1e6)
    yield "tube", refused(lambda: peristaltic_worm(body, narrow), "radius", "below")
    yield "wall", refused(lambda: Bed(Tube(6e-3, 0.3), -more), "stiffness")
    yield "drag", refused(lambda: DragGround(-more), "coefficient")


WORMS: tuple[Kind, ...] = (
    ("worms on drag", _on_drag, 12),
    ("worms on dry ground", _on_dry_ground, 12),
    ("worms in tubes", _in_tubes, 12),
    ("no peristaltic worms", _no_worm, 3),
)
