"""Crawls by optimal control: pairs of masses, capsules, and chains with actuators.

Judged by closed forms, by steps of implicit friction along the inputs that were found, and by
inputs at full force to and fro, which must not go faster.
"""

from __future__ import annotations

import math

import numpy as np

from tests.stress.means import least, refused
from tests.stress.verdict import Dice, Judged, Kind, Undecided, above, apart, spread
from wormopt.model.friction import Coulomb
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.crawl_tables import Aim, CrawlLimits
from wormopt.systems.chain.dynamic import crawl_problem, sine_guess
from wormopt.systems.swinging.capsule import CapsuleTable
from wormopt.systems.swinging.two_mass import Pair

_MESH = Mesh.even(2, 1, Collocation(2))
_TIGHT = Ipopt(tolerance=1e-10)
_ARCS = 60  # of a crawl with relaxed contact


def _pair(dice: Dice) -> Judged:
    """The small mass is driven ahead and braked, each as hard as the big one holds."""
    mu, g, L = (spread(dice, 1e-3, 1e3) for _ in range(3))
    low = spread(dice, 1e-3, 0.9)
    high = low if dice.random() < 0.3 else float(dice.uniform(low, 0.95))
    table = Pair(mass=spread(dice, 1e-3, 1e3), ratio=(low, high), friction=mu, gravity=g,
                      stroke=L)  # fmt: skip
    modes = FixedModes(ModeSequence(((0, 1), (0, 1))))
    found = optimise(table.problem(), _MESH, modes, table.guess(), solver=_TIGHT)

    def speed(r: float) -> float:
        ahead, back = mu * g * (1 / r - 1), mu * g * (1 / r + 1)
        return L * r / (1 + r) / math.sqrt(2 * L * (1 / ahead + 1 / back))

    best = speed(low)
    if high > low:
        best = max(best, speed(high), -least(lambda r: -speed(r), low, high, 1e-10)[1])
    yield "speed", apart(-found.objective, best, 1e-8)
    ratio = float(found.motion.arcs.design[0])
    yield "ratio", apart(speed(ratio), best, 1e-8)


def _capsule(dice: Dice) -> Judged:
    """Momentum rises and falls as fast as friction lets it; to and fro take the same time t.

    The way of a cycle is F t², and the body turns back before the impulse unless F t² < share L.
    """
    share, F, L = float(dice.uniform(0.02, 0.98)), spread(dice, 1e-3, 1e3), spread(dice, 1e-3, 1e3)
    table = CapsuleTable(share=share, friction=F, stroke=L)
    modes = FixedModes(ModeSequence(((-1,), (1,))))
    found = optimise(table.problem(), _MESH, modes, table.guess(), solver=_TIGHT)
    yield "speed", apart(-found.objective, math.sqrt(share * F * L) / 2, 1e-8)


class _Worm:
    """Two masses on a spring, with a bounded actuator, on ground that holds them back."""

    def __init__(self, dice: Dice) -> None:
        size, way, time = spread(dice, 1e-2, 1e2), spread(dice, 1e-2, 1e2), spread(dice, 0.1, 10.0)
        unit = size * way / time**2
        self.period, self.way = 2 * math.pi * time, way
        self.mass = size * dice.uniform(0.7, 1.4, 2)
        self.stiffness = unit / way * float(dice.uniform(0.5, 2.0))
        self.damping = unit / way * time * float(dice.uniform(0.2, 1.0))
        self.forward = unit * float(dice.uniform(0.1, 0.3))
        self.backward = self.forward * float(dice.uniform(2.0, 6.0))
        self.force = unit * float(dice.uniform(1.0, 2.0))

    @property
    def speed(self) -> float:
        """By which speeds are measured."""
        return 0.1 * self.way / self.period

    def crawl(self, arcs: int) -> Optimum:
        plant = chain(
            1, mass=self.mass, stiffness=self.stiffness, damping=self.damping,
            rest_length=3 * self.way, law=Coulomb(self.forward, self.backward),
            length_nominal=self.way, time_nominal=self.period,
        )  # fmt: skip
        limits = CrawlLimits(period=self.period, actuator_force=self.force)
        mesh = Mesh.even(1, arcs, Collocation(2, "radau"))
        guess = sine_guess(plant, self.period, self.force)
        relaxed = Complementarity(residual=1e-5, first=1.0)
        return optimise(crawl_problem(plant, limits, Aim(maximise="speed")), mesh, relaxed, guess)

    def under(self, inputs: np.ndarray) -> float:
        """Mean speed under inputs of even steps, by implicit friction, when it is periodic."""
        h = self.period / len(inputs)
        M, m = self.mass.tolist()
        ahead, behind = h * self.forward, h * self.backward

        def held(p: float) -> float:
            return p - ahead if p > ahead else p + behind if p < -behind else 0.0

        stretch, v, w, speed = 0.0, 0.0, 0.0, math.nan
        for _ in range(40):
            way, before = 0.0, speed
            for u in inputs.tolist():
                pull = h * (self.stiffness * stretch + self.damping * (v - w) - u)
                v, w = held(M * v - pull) / M, held(m * w + pull) / m
                stretch += h * (v - w)
                way += h * v
            speed = way / self.period
            if abs(speed - before) < 1e-4 * self.speed:
                return speed
        raise Undecided("it does not come to a periodic motion")


def _chain(dice: Dice) -> Judged:
    """As fast as its inputs make it, and no slower than to and fro at full force."""
    worm, steps = _Worm(dice), 6000
    found = worm.crawl(_ARCS)
    instants = worm.period * (np.arange(steps) + 0.5) / steps
    inputs = found.motion.inputs(instants)[0]
    yield "force", above(float(np.abs(inputs).max()), worm.force, 1e-6)
    speed = worm.under(inputs)
    # contacts change some eight times in a period, each told to half an arc
    yield "speed", apart(-found.objective, speed, 4 / _ARCS)
    for share in dice.uniform(0.2, 0.8, 3):
        square = np.where(instants < share * worm.period, worm.force, -worm.force)
        yield "beaten", above(worm.under(square), speed, 4 / _ARCS)


def _no_crawl(dice: Dice) -> Judged:
    """Crawls that cannot be."""
    more = 1 + spread(dice, 1e-3, 1e2)
    yield "cheap", refused(lambda: Aim(maximise=None), "neither of maximise and minimise")
    yield (
        "mass",
        refused(lambda: chain(1, mass=-more, stiffness=1, damping=1, rest_length=1), "mass"),
    )
    yield "share", refused(lambda: CapsuleTable(share=more, friction=1.0, stroke=1.0), "below 1")


OPTIMAL_CRAWLS: tuple[Kind, ...] = (
    ("optima: pairs of masses", _pair, 8),
    ("optima: capsules", _capsule, 6),
    ("optima: crawls", _chain, 8),
    ("optima: no crawls", _no_crawl, 2),
)
