"""Rods at rest between two walls, under forces that bend them from one to the other.

Judged by the conditions of a least energy, with energies integrated anew and complex steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from tests.stress.means import refused
from tests.stress.verdict import Dice, Judged, Kind, apart, spread
from wormopt.analysis.resting import Loaded, Rest
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod

_STEP = 1e-30


@dataclass(frozen=True)
class _Bent:
    """A rod, half the room between walls, and forces A cos(k x) across it, per length."""

    rod: Rod
    room: float
    wave: float  # k
    size: float  # A

    @cached_property
    def shares(self) -> np.ndarray:
        """Lengths that nodes stand for: integrals of the polynomials of an element."""
        rules = self._rules(self.rod.degree + 1)
        return np.sum([weights @ value for value, _, weights in rules], axis=0)

    def _rules(self, points: int) -> list[tuple[np.ndarray, ...]]:
        """Of each element: values and slopes at Gauss points by nodes, and weights."""
        rod, d = self.rod, self.rod.degree
        gauss, weights = np.polynomial.legendre.leggauss(points)
        found = []
        for k in range(rod.elements):
            own = np.arange(k * d, k * d + d + 1)
            at = rod.nodes[own]
            half = (at[-1] - at[0]) / 2
            local = (at - at[0]) / half - 1
            value, slope = np.zeros((points, rod.count)), np.zeros((points, rod.count))
            for j, node in enumerate(own):
                others = np.delete(local, j)
                one = np.poly1d(others, r=True) / np.prod(local[j] - others)
                value[:, node], slope[:, node] = one(gauss), one.deriv()(gauss) / half
            found.append((value, slope, weights * half))
        return found

    @cached_property
    def _elastic(self) -> list[tuple[np.ndarray, ...]]:
        return self._rules(self.rod.degree)

    def energy(self, q: np.ndarray) -> complex:
        """Of stretch, shear and bending, less the work of the forces; for complex places too."""
        rod, (x, y, angle) = self.rod, q.reshape(3, -1)
        E, nu, d = rod.youngs_modulus, rod.poisson_ratio, rod.diameter
        area, second = math.pi * d**2 / 4, math.pi * d**4 / 64
        shear = E * area * 3 / (7 + 6 * nu)  # Cowper's 6 (1 + nu) / (7 + 6 nu) of G A
        total = -self.size * np.sum(self.shares * y * np.cos(self.wave * x))
        for value, slope, weights in self._elastic:
            dx, dy, turn, a = slope @ x, slope @ y, slope @ angle, value @ angle
            along = dx * np.cos(a) + dy * np.sin(a) - 1
            across = dy * np.cos(a) - dx * np.sin(a)
            part = E * area * along**2 + shear * across**2 + E * second * turn**2
            total += weights @ part / 2
        return complex(total)

    def slope(self, q: np.ndarray) -> np.ndarray:
        steps = 1j * _STEP * np.eye(len(q))
        return np.array([self.energy(q + step).imag / _STEP for step in steps])

    def stiffness(self, q: np.ndarray) -> np.ndarray:
        step = 1e-6 * np.repeat([self.rod.diameter, self.rod.diameter, 1.0], self.rod.count)
        moved = np.diag(step)
        rows = [(self.slope(q + m) - self.slope(q - m)) / (2 * m.max()) for m in moved]
        return (np.array(rows) + np.array(rows).T) / 2

    def rest(self, start: np.ndarray) -> Rest:
        n = self.rod.count
        q, given = ca.SX.sym("q", 3 * n), ca.SX.sym("size")
        x, y = q[:n], q[n : 2 * n]
        work = given * ca.dot(ca.DM(self.rod.weights), y * ca.cos(self.wave * x))
        potential = ca.Function("potential", [q, given], [-work])
        forces = ca.gradient(work, q)[: 2 * n]
        inputs = ca.Function("inputs", [q, given], [ca.densify(forces)])
        model = channel_rod(self.rod, 2 * self.room + self.rod.diameter, 0.5)
        size = self.rod.stiffness().bending / self.rod.length
        return Loaded(model, potential, inputs, size=size).rest(start, [self.size])


def _drawn(dice: Dice) -> _Bent:
    d = spread(dice, 1e-4, 1e-2)
    rod = Rod(
        d * spread(dice, 5.0, 60.0), d, spread(dice, 1e3, 1e9), 1e3,
        poisson_ratio=float(dice.uniform(0.0, 0.5)), elements=int(dice.integers(6, 11)), degree=2,
    )  # fmt: skip
    half_waves = int(dice.integers(1, 4))
    wave = half_waves * math.pi / rod.length
    room = rod.length / half_waves * spread(dice, 3e-3, 0.15)
    hard = rod.youngs_modulus * math.pi * d**4 / 64 * wave**4 * room
    return _Bent(rod, room, wave, hard * spread(dice, 1e-2, 30.0))


def _between(dice: Dice) -> Judged:
    """Forces of walls are what is left of the slope of the energy, and push; nothing is softer."""
    bent = _drawn(dice)
    rod, n = bent.rod, bent.rod.count
    y = 0.5 * bent.room * np.cos(bent.wave * rod.nodes)
    found = bent.rest(np.concatenate([rod.nodes, y, np.zeros(n)]))
    q = found.places
    slope, height = bent.slope(q), q[n : 2 * n]
    above, below = found.pressed[::2], found.pressed[1::2]
    unit = bent.size * rod.length / n
    yield "energy", apart(found.energy, bent.energy(q).real, 1e-8)
    yield "along", apart(slope[:n], np.zeros(n), 1e-6, size=unit)
    yield "turning", apart(slope[2 * n :], np.zeros(n), 1e-6, size=unit * rod.diameter)
    yield "across", apart(slope[n : 2 * n], below - above, 1e-6, size=unit)
    yield "walls pull", max(-found.pressed.min(), 0.0) / (1e-9 * unit)
    yield "through the walls", max(np.abs(height).max() - bent.room, 0.0) / (1e-9 * bent.room)
    apart_by = np.minimum(above * (bent.room - height), below * (bent.room + height))
    yield "from afar", apart(apart_by, np.zeros(n), 1e-6, size=unit * bent.room)
    touched = above + below > 1e-6 * unit
    free = np.concatenate([np.full(n, True), ~touched, np.full(n, True)])
    scale = np.repeat([1.0, 1.0, 1 / rod.diameter], n)[free]
    K = bent.stiffness(q)[np.ix_(free, free)] * np.outer(scale, scale)
    softest = np.linalg.eigvalsh(K)
    # differences of slopes are good to some 1e-9 of the stiffest
    least = 1e-8 * softest[-1]
    if abs(softest[0]) > least:
        yield "stable", 0.0 if found.stable == (softest[0] > 0) else math.inf


def _pressed_flat(dice: Dice) -> Judged:
    """A strong even load lays it on one wall: each node's weight is held where it stands."""
    bent = _drawn(dice)
    even = replace(bent, wave=0.0, size=30 * bent.size)
    rod, n = even.rod, even.rod.count
    model = channel_rod(rod, 2 * even.room + rod.diameter, 0.5)
    q, size = ca.SX.sym("q", 3 * n), ca.SX.sym("size")
    hold = rod.stiffness().stretching / rod.length * 1e-3
    across = size * ca.DM(rod.weights)
    along = -hold * (q[:n] - ca.DM(rod.nodes))
    held = hold * ca.sumsqr(q[:n] - ca.DM(rod.nodes)) / 2
    potential = ca.Function("potential", [q, size], [held - ca.dot(across, q[n : 2 * n])])
    inputs = ca.Function("inputs", [q, size], [ca.vertcat(along, across)])
    loaded = Loaded(model, potential, inputs, size=rod.stiffness().bending / rod.length)
    start = np.concatenate([rod.nodes, np.full(n, 0.5 * even.room), np.zeros(n)])
    found = loaded.rest(start, [even.size])
    yield "height", apart(found.places[n : 2 * n], np.full(n, even.room), 1e-9)
    yield "walls", apart(found.pressed[::2], even.size * even.shares, 1e-7)
    yield "other wall", apart(found.pressed[1::2], np.zeros(n), 1e-9, size=even.size * rod.length)
    yield "energy", apart(found.energy, -even.size * rod.length * even.room, 1e-8)


def _no_rest(dice: Dice) -> Judged:
    """Rods without walls to rest between, and starts that are none."""
    more = 1 + spread(dice, 1e-3, 10.0)
    rod = Rod(1.0, 0.1, 1.0, 1.0, elements=2)
    yield "room", refused(lambda: channel_rod(rod, 0.1 / more, 0.5), "diameter", "channel")
    yield "friction", refused(lambda: channel_rod(rod, 1.0, -more), "friction must be positive")
    loaded = Loaded(channel_rod(rod, 1.0, 0.5))
    yield "start", refused(lambda: loaded.rest([0.0]), "start", "finite entries")
    nowhere = np.full(3 * rod.count, math.nan)
    yield "nowhere", refused(lambda: loaded.rest(nowhere), "finite entries")


RODS: tuple[Kind, ...] = (
    ("rods between walls", _between, 14),
    ("rods on a wall", _pressed_flat, 6),
    ("no rods at rest", _no_rest, 2),
)
