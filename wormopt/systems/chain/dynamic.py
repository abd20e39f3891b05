"""Optimal-control problem of the best periodic crawl of a chain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

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
from wormopt.study.types import per
from wormopt.systems.chain.crawl_tables import Aim, CrawlLimits

PERIODS = 6
"""Simulated periods, of which the last is the first guess."""
# Limits above the first number of usual sizes do not scale their expressions. Those above the
# second never bind, and count as that number: an interior point loses its way below 1e15.
_LARGE, _FAR = 20.0, 1e6
# Inputs of the first guess as a share of the largest force.
_PART = 0.9


def crawl_problem(
    plant: Model, limits: CrawlLimits, aim: Aim, judge: Literal["mean", "worst"] = "mean"
) -> Problem:
    """State the periodic crawl of a chain: velocities repeat, positions repeat up to the advance.

    `plant` is from `chain`, or several from `scenario_model`, of which `judge` says whether the
    mean or the worst speed counts. The tail starts at 0; bounds have the names of scene keys.
    """
    force = min(max(per(limits.actuator_force, 1)), _FAR * plant.u[0].nominal)
    plant = replace(plant, u=[replace(u, lower=-force, upper=force) for u in plant.u])
    length, speed = plant.x[0].nominal, plant.x[1].nominal
    costs = aim.minimise is not None
    effort, work = _effort(plant), _work(plant)
    needed = [work] if costs else [effort]
    if limits.energy_per_cycle is not None and not costs:
        needed.append(work)
    ends = Ends.of(plant, len(needed))
    places = _rows_of_positions(plant)
    advances = [ends.end[rows[0]] - ends.start[rows[0]] for rows in places]
    speeds = ca.vertcat(*advances) / ends.duration
    at_ends = [
        Constraint("start", ca.vertcat(*(ends.start[r[-1]] for r in places)), 0.0, 0.0, length)
    ]
    if aim.speed is not None:
        at_ends.append(Constraint("objective.speed", speeds, aim.speed, nominal=speed))
    design: list[Signal] = []
    merit = ca.sum1(speeds) / speeds.numel()
    if judge == "worst" and speeds.numel() > 1:
        worst = Signal("worst speed", ca.SX.sym("worst"), "speed", speed)
        design.append(worst)
        at_ends.append(Constraint("worst speed", speeds - worst.symbol, 0.0, nominal=speed))
        merit = worst.symbol
    # Integrals are variables of the program, so they are scaled to the size of 1.
    sizes = [each.nominal * length / speed for each in needed]
    totals = [ends.integrals[k] * size for k, size in enumerate(sizes)]
    if limits.energy_per_cycle is not None:
        most, size = _limit(limits.energy_per_cycle, plant.u[0].nominal * length)
        spent = totals[-1] / speeds.numel()
        at_ends.append(Constraint("limits.energy_per_cycle", spent, upper=most, nominal=size))
    mean = totals[0] / ends.duration
    if costs:
        mean = mean / _mass(plant) / speeds.numel()
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
        integrands=ca.vertcat(*(n.integrand / z for n, z in zip(needed, sizes, strict=True))),
        path_constraints=[*_along(plant, limits), *(b for each in needed for b in each.along)],
        boundary_constraints=at_ends,
        slacks=[s for each in needed for s in each.slacks],
        design=design,
        nominal=speed**2 / length if costs else speed,
    )


def _along(plant: Model, limits: CrawlLimits) -> Iterator[Constraint]:
    """Limits at all times, named as the keys of scenes."""
    worms = len(_rows_of_positions(plant))
    links = sum(u.size for u in plant.u)
    rate = ca.vertcat(*_outputs(plant, "rate"))
    length, speed, force = (s.nominal for s in (*plant.x[:2], plant.u[0]))
    x = ca.vertcat(*(s.symbol for s in plant.x))

    def tiled(given: float | tuple[float, ...]) -> np.ndarray:
        return np.tile(per(given, links), worms)

    def within(key: str, expression: ca.SX, most: np.ndarray, usual: float) -> Constraint:
        most, size = _limit(most, usual)
        return Constraint(f"limits.{key}", expression, -most, most, size)

    if isinstance(limits.actuator_force, tuple):
        u = ca.vertcat(*(s.symbol for s in plant.u))
        yield within("actuator_force", u, np.array(per(limits.actuator_force, links)), force)
    if (ranges := limits.length_ranges(links)) is not None:
        low, high = np.tile(np.array(ranges).T, worms)
        lengths = ca.vertcat(*_outputs(plant, "length"))
        high, size = _limit(high, length)
        yield Constraint("limits.length", lengths, low, high, size)
    if limits.rate is not None:
        yield within("rate", rate, tiled(limits.rate), speed)
    if limits.acceleration is not None:
        second = ca.jtimes(rate, x, plant.ode)
        yield within("acceleration", second, tiled(limits.acceleration), speed**2 / length)
    if limits.actuator_power is not None:
        most, size = _limit(tiled(limits.actuator_power), force * speed)
        power = ca.vertcat(*_outputs(plant, "power"))
        yield Constraint("limits.actuator_power", power, upper=most, nominal=size)


def _limit(most: Any, usual: float) -> tuple[Any, float]:
    """Return a limit, or `_FAR` usual sizes if it is larger, and the size that scales its rows."""
    return np.minimum(most, _FAR * usual), min(float(np.max(most)), _LARGE * usual)


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
        raise SolveError(
            "the first guess cannot be simulated", "write a smaller limits.actuator_force"
        )
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


def _work(plant: Model) -> _Cost:
    """Positive power of the actuators, by slacks above 0 and above the power."""
    power = ca.vertcat(*_outputs(plant, "power"))
    size = plant.u[0].nominal * plant.x[1].nominal
    spent = Signal("spent", ca.SX.sym("spent", power.numel()), "power", size, lower=0.0)
    bounds = (Constraint("power", spent.symbol - power, 0.0, nominal=size),)
    return _Cost(ca.sum1(spent.symbol), size, bounds, (spent,))


def _mass(plant: Model) -> ca.SX:
    masses = [s.symbol for s in plant.p if s.name == "mass"]
    if not masses:
        raise ArgumentError(
            f"energy over mass and distance needs the parameter mass, which {plant.name} does not "
            "have"
        )
    return ca.sum1(ca.vertcat(*masses))


def _rows_of_positions(plant: Model) -> list[list[int]]:
    first, found = 0, []
    for signal in plant.x:
        if signal.name.split(" ")[0] == "position":
            found.append(list(range(first, first + signal.size)))
        first += signal.size
    return found


def _outputs(plant: Model, name: str) -> list[ca.SX]:
    return [o.expression for o in plant.outputs if o.name.split(" ")[0] == name]
