"""Optimal-control problem of the best periodic crawl of a chain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.tables import Aim, CrawlLimits

PERIODS = 6
"""Simulated periods, of which the last is the first guess."""
# Inputs of the first guess as a share of the largest force.
_PART = 0.9


def crawl_problem(
    plant: Model, limits: CrawlLimits, aim: Aim, judge: Literal["mean", "worst"] = "mean"
) -> Problem:
    """State the periodic crawl of a chain: velocities repeat, positions repeat up to the advance.

    `plant` is from `chain`, or several from `scenario_model`, of which `judge` says whether the
    mean or the worst speed counts. The tail starts at 0; bounds have the names of scene keys.
    Raises ArgumentError if energy is the cost and the plant has no ``mass``.
    """
    plant = replace(plant, u=[replace(u, lower=-limits.force, upper=limits.force) for u in plant.u])
    length, speed = plant.x[0].nominal, plant.x[1].nominal
    costs = aim.minimise is not None
    ends = Ends.of(plant, 1)
    places = _rows_of_positions(plant)
    advances = [ends.end[rows[0]] - ends.start[rows[0]] for rows in places]
    speeds = ca.vertcat(*advances) / ends.duration
    at_ends = [
        Constraint("start", ca.vertcat(*(ends.start[r[-1]] for r in places)), 0.0, 0.0, length)
    ]
    if aim.speed is not None:
        at_ends.append(Constraint("objective.speed", speeds, aim.speed, nominal=speed))
    along = []
    if limits.length is not None:
        lengths = ca.vertcat(*_outputs(plant, "length"))
        least, most = limits.length
        along.append(Constraint("limits.length", lengths, least, most, nominal=most))
    cost = _transport(plant, speeds) if costs else _effort(plant)
    design: list[Signal] = []
    merit = ca.sum1(speeds) / speeds.numel()
    if judge == "worst" and speeds.numel() > 1:
        worst = Signal("worst speed", ca.SX.sym("worst"), "speed", speed)
        design.append(worst)
        at_ends.append(Constraint("worst speed", speeds - worst.symbol, 0.0, nominal=speed))
        merit = worst.symbol
    # Integrals are variables of the program, so they are scaled to the size of 1.
    size = cost.nominal * length / speed
    mean = ends.integrals[0] * size / ends.duration
    minimise = (
        mean / ca.fmax(merit, (aim.speed or 0.0) / 2) if costs else -merit + aim.effort * mean
    )
    return Problem(
        model=plant,
        ends=ends,
        minimise=minimise,
        duration=limits.period_range,
        periodic=[s.name for s in plant.x if s.name.startswith("velocity")],
        displaced=[s.name for s in plant.x if s.name.startswith("position")],
        integrands=cost.integrand / size,
        path_constraints=[*along, *cost.along],
        boundary_constraints=at_ends,
        slacks=cost.slacks,
        design=design,
        nominal=cost.nominal / speed if costs else speed,
    )


def sine_guess(
    plant: Model, period: float, force: float, phase: np.ndarray | None = None, worms: int = 1
) -> Guess:
    """Simulate periods under sine inputs and return the last one as a first guess.

    Positions are relative to the tail at its begin. By default the phases run along the worm. With
    several `worms` all move alike. Raises SolveError if the motion cannot be simulated.
    """
    links = sum(u.size for u in plant.u)
    if phase is None:
        phase = 2 * np.pi / (links + 1) * np.arange(links)
    size = _PART * force
    sines = Gait(
        np.array([0.0, period]),
        np.zeros((1, links, 1)),
        np.array([2 * np.pi / period]),
        size * np.cos(phase)[None],
        -size * np.sin(phase)[None],
    )
    loose = Tolerance(relative=1e-8, absolute=1e-8)
    driven = drive(plant, sines, periodic=True)
    motion = simulate(driven, PERIODS * period, tolerance=loose, dense=True)
    if motion.dense is None:
        raise SolveError("the first guess cannot be simulated", "write a smaller limits.force")
    dense, first, masses = motion.dense, (PERIODS - 1) * period, links + 1

    def states(t: np.ndarray) -> np.ndarray:
        x = dense(first + t)[: 2 * masses]
        x[:masses] -= dense(np.array([first]))[masses - 1]
        return np.tile(x, (worms, 1))

    return Guess(period, states, sines)


@dataclass(frozen=True, eq=False)
class _Cost:
    """Rate of a cost, its usual size, and the variables it needs."""

    integrand: ca.SX
    nominal: float
    along: tuple[Constraint, ...] = ()
    slacks: tuple[Signal, ...] = ()


def _effort(plant: Model) -> _Cost:
    return _Cost(ca.sumsqr(ca.vertcat(*(u.symbol for u in plant.u))), plant.u[0].nominal ** 2)


def _transport(plant: Model, speeds: ca.SX) -> _Cost:
    """Positive power of the actuators over the mass, by slacks above 0 and above the power."""
    power = ca.vertcat(*_outputs(plant, "power"))
    length, speed = plant.x[0].nominal, plant.x[1].nominal
    size = plant.u[0].nominal * speed
    spent = Signal("spent", ca.SX.sym("spent", power.numel()), "power", size, lower=0.0)
    bounds = (Constraint("power", spent.symbol - power, 0.0, nominal=size),)
    masses = [s.symbol for s in plant.p if s.name == "mass"]
    if not masses:
        raise ArgumentError(
            f"energy over mass and distance needs the parameter mass, which {plant.name} does not "
            "have"
        )
    mass = ca.sum1(ca.vertcat(*masses))
    rate = ca.sum1(spent.symbol) / mass / speeds.numel()
    return _Cost(rate, speed**3 / length, bounds, (spent,))


def _rows_of_positions(plant: Model) -> list[list[int]]:
    first, found = 0, []
    for signal in plant.x:
        if signal.name.split(" ")[0] == "position":
            found.append(list(range(first, first + signal.size)))
        first += signal.size
    return found


def _outputs(plant: Model, name: str) -> list[ca.SX]:
    return [o.expression for o in plant.outputs if o.name.split(" ")[0] == name]
