"""The best periodic crawl of a dynamic chain, stated as an optimal-control problem."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Signal
from wormopt.ocp.problem import Bound, Ends, Problem

__all__ = ["Aim", "CrawlLimits", "crawl_problem"]


@dataclass(frozen=True)
class CrawlLimits:
    """What a crawl must keep to.

    Parameters
    ----------
    period : tuple of float
        Shortest and longest period, positive; alike where it is given.
    force : float
        Largest size of every input.
    length : tuple of float, optional
        Least and largest length of every link.
    """

    period: tuple[float, float]
    force: float
    length: tuple[float, float] | None = None


@dataclass(frozen=True)
class Aim:
    """What a crawl is to be good at.

    Parameters
    ----------
    maximise : {"speed"}, optional
        The mean speed, less ``effort`` times the mean of |u|^2.
    effort : float, optional
        Weight of the mean of |u|^2.
    speed : float, optional
        Least mean speed. With it and without ``maximise`` the cost of transport is minimised:
        positive work of the actuators over mass and way.
    judge : {"mean", "worst"}, optional
        Of several copies of the worm, whether their mean or the worst one counts.

    Raises
    ------
    ArgumentError
        If the cost of transport is sought without a speed.
    """

    maximise: Literal["speed"] | None = "speed"
    effort: float = 0.0
    speed: float | None = None
    judge: Literal["mean", "worst"] = "mean"

    def __post_init__(self) -> None:
        if self.maximise is None and not (self.speed or 0.0) > 0:
            raise ArgumentError("the cheapest crawl rests; give the least speed, above 0")


def crawl_problem(plant: Model, limits: CrawlLimits, aim: Aim) -> Problem:
    """State the periodic crawl of a chain: velocities return, positions up to the advance.

    Parameters
    ----------
    plant : Model
        From `chain`, or several of them from `copies`.
    limits : CrawlLimits
        What the crawl must keep to.
    aim : Aim
        What it is to be good at.

    Returns
    -------
    Problem
        The tail starts at 0. Its bounds have the names of the scene's keys.

    Raises
    ------
    ArgumentError
        If the cost of transport of a plant without the parameter ``mass`` is sought.

    Examples
    --------
    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(
    ...     2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=Coulomb(1.0, 10.0)
    ... )
    >>> limits = CrawlLimits((1.0, 1.0), force=12.0, length=(1.4, 2.6))
    >>> problem = crawl_problem(worm, limits, Aim(effort=1e-3))
    >>> [bound.name for bound in (*problem.along, *problem.at_ends)]
    ['limits.length', 'start']
    """
    plant = replace(plant, u=[replace(u, lower=-limits.force, upper=limits.force) for u in plant.u])
    costs = aim.maximise is None
    ends = Ends.of(plant, 1)
    places = _rows(plant, "position")
    advances = [ends.end[rows[0]] - ends.start[rows[0]] for rows in places]
    speeds = ca.vertcat(*advances) / ends.duration
    at_ends = [Bound("start", ca.vertcat(*(ends.start[rows[-1]] for rows in places)), 0.0, 0.0)]
    if aim.speed is not None:
        at_ends.append(Bound("aim.speed", speeds, aim.speed))
    along = []
    if limits.length is not None:
        lengths = ca.vertcat(*_outputs(plant, "length"))
        along.append(Bound("limits.length", lengths, *limits.length, nominal=limits.length[1]))
    cost = _transport(plant, speeds) if costs else _effort(plant)
    design: list[Signal] = []
    merit = ca.sum1(speeds) / speeds.numel()
    if aim.judge == "worst" and speeds.numel() > 1:
        worst = Signal("worst speed", ca.SX.sym("worst"), "speed")
        design.append(worst)
        at_ends.append(Bound("worst speed", speeds - worst.symbol, 0.0))
        merit = worst.symbol
    mean = ends.integrals[0] / ends.duration
    minimise = (
        mean / ca.fmax(merit, (aim.speed or 0.0) / 2) if costs else -merit + aim.effort * mean
    )
    return Problem(
        model=plant,
        ends=ends,
        minimise=minimise,
        duration=limits.period,
        periodic=[s.name for s in plant.x if s.name.startswith("velocity")],
        displaced=[s.name for s in plant.x if s.name.startswith("position")],
        integrands=cost.integrand,
        along=[*along, *cost.along],
        at_ends=at_ends,
        slacks=cost.slacks,
        design=design,
    )


@dataclass(frozen=True, eq=False)
class _Cost:
    """Rate of a cost, and what it needs."""

    integrand: ca.SX
    along: tuple[Bound, ...] = ()
    slacks: tuple[Signal, ...] = ()


def _effort(plant: Model) -> _Cost:
    return _Cost(ca.sumsqr(ca.vertcat(*(u.symbol for u in plant.u))))


def _transport(plant: Model, speeds: ca.SX) -> _Cost:
    """Positive power of the actuators over the worm's mass, by slacks above 0 and above it."""
    power = ca.vertcat(*_outputs(plant, "power"))
    spent = Signal("spent", ca.SX.sym("spent", power.numel()), "power", lower=0.0)
    bounds = (Bound("power", spent.symbol - power, 0.0),)
    masses = [s.symbol for s in plant.p if s.name == "mass"]
    if not masses:
        raise ArgumentError(
            f"the cost of transport needs the parameter mass; {plant.name} has none"
        )
    mass = ca.sum1(ca.vertcat(*masses))
    return _Cost(ca.sum1(spent.symbol) / mass / speeds.numel(), bounds, (spent,))


def _rows(plant: Model, name: str) -> list[list[int]]:
    """Rows of each state of which the name begins so."""
    first, found = 0, []
    for signal in plant.x:
        if signal.name.split(" ")[0] == name:
            found.append(list(range(first, first + signal.size)))
        first += signal.size
    return found


def _outputs(plant: Model, name: str) -> list[ca.SX]:
    return [o.expression for o in plant.outputs if o.name.split(" ")[0] == name]
