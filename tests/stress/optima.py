"""Optimal control under stress: the fastest and the least costly ways of a block, by closed forms.

A block of mass m on dry ground gets faster by (U - F+)/m and slower by (U + F+)/m, forward; the
fastest way uses the whole force U. What is found is also repeated by steps that look for no event:
implicit Euler with the friction that lets the block end nearest to rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial

import casadi as ca
import numpy as np

from tests.stress.optimal_crawls import OPTIMAL_CRAWLS
from tests.stress.verdict import Case, Dice, Judged, apart, many, spread
from wormopt.model.friction import Coulomb
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.optimise import Contacts, Optimum, optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.ocp.switching import optimise_switching_times
from wormopt.systems.block.block import block


class Slide:
    """Random numbers of a block that slides: mass, frictions, force, way, all sizes alike."""

    def __init__(self, dice: Dice, *, decades: float = 0.0) -> None:
        self.mass = spread(dice, 10**-decades, 10**decades) * dice.uniform(0.5, 2.0)
        self.way = spread(dice, 10**-decades, 10**decades)
        self.force = spread(dice, 10**-decades, 10**decades)
        self.forward = self.force * dice.uniform(0.05, 0.6)
        self.backward = self.force * dice.uniform(0.05, 0.6)
        self.faster = (self.force - self.forward) / self.mass
        self.slower = (self.force + self.forward) / self.mass

    def fastest(self, way: float) -> float:
        """Shortest time from rest to rest, forward."""
        return math.sqrt(2 * way * (1 / self.faster + 1 / self.slower))

    def problem(self, speed: float, end: float, time: float, *, effort: bool = False) -> Problem:
        """From 0 at a speed to rest at the end: in the shortest time, or with the least effort."""
        law, size = Coulomb(self.forward, self.backward), max(end, self.way)
        most = math.inf if effort else self.force
        model = block(law, mass=self.mass, force=most, length_nominal=size, time_nominal=time)
        ends, scale = Ends.of(model, int(effort)), np.array([size, size / time])
        start, stop = np.array([0.0, speed]) / scale, np.array([end, 0.0]) / scale
        at_ends = [
            Constraint("start", ends.start / scale, start, start),
            Constraint("end", ends.end / scale, stop, stop),
        ]
        return Problem(
            model,
            ends,
            ends.integrals[0] / self.force**2 / time if effort else ends.duration,
            (time, time) if effort else (0.01 * time, 10 * time),
            integrands=ca.sumsqr(model["force"]) if effort else ca.SX(0, 1),
            boundary_constraints=at_ends,
        )


def _treatment(slide: Slide, time: float, dice: Dice) -> Contacts:
    if dice.random() < 0.5:
        return Complementarity(residual=1e-3, first=1e-1)
    speed = slide.way / time
    return Regularised(0.03 * speed, 0.3 * speed)


def _forward(decades: float, dice: Dice) -> Judged:
    """From rest to rest."""
    slide = Slide(dice, decades=decades)
    time = slide.fastest(slide.way)

    def guess(t: np.ndarray) -> np.ndarray:
        return np.vstack([slide.way * t / (1.2 * time), 0 * t + 0.6 * slide.way / time])

    problem = slide.problem(0.0, slide.way, time)
    mesh = Mesh.even(1, int(dice.integers(15, 30)), Collocation(2, "radau"))
    coarse = optimise(problem, mesh, _treatment(slide, time, dice), Guess(1.2 * time, guess))
    found = optimise_switching_times(coarse)
    yield "shortest time", apart(found.objective, time, 1e-8)
    yield "steps without events", _far_by_steps(slide, found, 0.0, slide.way)


def _back(decades: float, dice: Dice) -> Judged:
    """Thrown forward from 0, back to rest there."""
    slide = Slide(dice, decades=decades)
    speed = math.sqrt(2 * slide.way * slide.slower)  # it turns back after the way
    out = speed / slide.slower
    faster, slower = (slide.force + np.array([-1, 1]) * slide.backward) / slide.mass
    time = out + math.sqrt(2 * slide.way * (1 / faster + 1 / slower))

    def guess(t: np.ndarray) -> np.ndarray:
        s = t / time
        return np.vstack([speed * t * (1 - s) ** 2, speed * (1 - s) * (1 - 3 * s)])

    mesh = Mesh.even(1, int(dice.integers(20, 30)), Collocation(2, "radau"))
    relaxed = Complementarity(residual=1e-3, first=1e-1)
    coarse = optimise(slide.problem(speed, 0.0, time), mesh, relaxed, Guess(time, guess))
    found = optimise_switching_times(coarse)
    yield "shortest time", apart(found.objective, time, 1e-8)
    yield "steps without events", _far_by_steps(slide, found, speed, 0.0)


def _effort(decades: float, dice: Dice) -> Judged:
    """Least integral of the force squared, in less time than it takes to pay for a rest.

    The acceleration falls linearly, from 6 d/T^2 to its opposite.
    """
    slide = Slide(dice, decades=decades)
    longest = math.sqrt(6 * slide.mass * slide.way / slide.forward)
    time = longest * dice.uniform(0.3, 0.95)
    cost = slide.forward**2 * time + 12 * (slide.mass * slide.way) ** 2 / time**3

    def guess(t: np.ndarray) -> np.ndarray:
        return np.vstack([slide.way * t / time, 0 * t + slide.way / time])

    problem = slide.problem(0.0, slide.way, time, effort=True)
    mesh = Mesh.even(1, 40, Collocation(3, "radau"))
    found = optimise(problem, mesh, FixedModes(ModeSequence(((1,),))), Guess(time, guess))
    # inputs are held on each arc: the best stairs miss the slope by (12 m d / T^2)^2 T / 12 / 40^2
    stairs = (12 * slide.mass * slide.way / time**2) ** 2 * time / 12 / 40**2
    least = found.objective * slide.force**2 * time
    yield "less than can be had", max(cost - least, 0.0) / (1e-7 * cost)
    yield "more than stairs cost", max(least - cost - 1.2 * stairs, 0.0) / (1e-7 * cost)


def _far_by_steps(slide: Slide, found: Optimum, speed: float, end: float) -> float:
    """How far from the end the forces found lead, over what steps of that size err."""
    steps = 4000
    h = found.motion.duration / steps
    forces = found.motion.inputs(h * (np.arange(steps) + 0.5))[0]
    x, v = 0.0, speed
    for force in forces.tolist():
        free = v + h * force / slide.mass
        ahead, behind = (h * grip / slide.mass for grip in (slide.forward, slide.backward))
        v = free - ahead if free > ahead else free + behind if free < -behind else 0.0
        x += h * v
    return abs(x - end) / (slide.way * 40 / steps)


def cases(*, quick: bool) -> Iterable[Case]:
    """Slides forward, back, and with least effort; `quick`: two of each."""
    kinds = (
        ("optima: forward", partial(_forward, 0.0), 25),
        ("optima: forward, any sizes", partial(_forward, 3.0), 20),
        ("optima: back", partial(_back, 0.0), 15),
        ("optima: back, any sizes", partial(_back, 3.0), 10),
        ("optima: effort", partial(_effort, 0.0), 20),
        ("optima: effort, any sizes", partial(_effort, 3.0), 15),
        *OPTIMAL_CRAWLS,
    )
    return many(kinds, quick=quick)
