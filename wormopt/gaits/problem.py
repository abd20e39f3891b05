"""The gait-design problem of a scene, in the terms of optimal control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.core.model import Model, Signal
from wormopt.optimal.problem import Bound, Ends, Problem
from wormopt.scenes.gait_design import GaitLimits, Objective
from wormopt.scenes.worm import WormTable
from wormopt.worms.spiked import spiked_worm

__all__ = ["gait_problem", "loads_matter", "rate_bounds"]


def rate_bounds(limits: GaitLimits, links: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest contraction and extension rates, given or implied by length and acceleration.

    A link that swings within a range R with acceleration at most a is never faster than
    sqrt(a R): it starts from and returns to rate 0 within that range.

    Parameters
    ----------
    limits : GaitLimits
        With a rate or an acceleration limit.
    links : int
        Number of links n.

    Returns
    -------
    contraction, extension : ndarray, shape (n,)

    Examples
    --------
    >>> limits = GaitLimits(period=1.0, length=(0.75, 1.0), acceleration=16.0)
    >>> rate_bounds(limits, 1)
    (array([2.]), array([2.]))
    """
    implied = np.full(links, np.inf)
    if limits.acceleration is not None:
        ranges = np.ptp(np.array(limits.length_ranges(links)), axis=1)
        implied = np.sqrt(np.broadcast_to(limits.acceleration, links) * ranges)
    given = limits.rate_limits(links)
    if given is None:
        return implied, implied
    return np.minimum(given[0], implied), np.minimum(given[1], implied)


def loads_matter(limits: GaitLimits, objective: Objective) -> bool:
    """Whether it matters how resting masses share the load: a limit or the cost depends on it.

    Parameters
    ----------
    limits : GaitLimits
        Limits of the scene.
    objective : Objective
        What is sought.

    Returns
    -------
    bool

    Examples
    --------
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, impulses=True)
    >>> loads_matter(limits, Objective(maximise="speed"))
    False
    """
    costs = ("peak_spike_load", "peak_actuator_force", "energy_per_distance")
    limited = limits.spike_load is not None or limits.actuator_force is not None
    return limited or objective.minimise in costs


@dataclass(frozen=True, eq=False)
class _Terms:
    """What costs are made of: the way per period, and nominal sizes."""

    model: Model
    ends: Ends
    way: ca.SX
    speed_nominal: float

    @property
    def force_nominal(self) -> float:
        return float(sum(c.nominal_force for c in self.model.contacts))


@dataclass(frozen=True, eq=False)
class _Cost:
    """What an objective adds to the problem."""

    minimise: ca.SX
    along: tuple[Bound, ...] = ()
    slacks: tuple[Signal, ...] = ()
    design: tuple[Signal, ...] = ()
    integrand: ca.SX | None = None


def gait_problem(worm: WormTable, limits: GaitLimits, objective: Objective) -> Problem:
    """State the design of a kinematic gait as an optimal-control problem.

    Costs are scaled to about 1: a speed by the largest rate, forces by the worm's inertia over a
    period. A peak becomes a design constant that bounds the force from above at all times; the
    positive part of a power becomes a slack (epigraph form), so that all stays smooth.

    Parameters
    ----------
    worm : WormTable
        Masses, drag, load.
    limits : GaitLimits
        What the gait must keep to; the number of resting masses is left to the mode sequence.
    objective : Objective
        What to seek.

    Returns
    -------
    Problem
        Periodic up to the advance; its model is that of (1)-(7). Its bounds have the names of
        the scene's keys, by which `elastic` explains a conflict.

    Examples
    --------
    >>> worm = WormTable(links=2, mass=1.0, load=5.0)
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> problem = gait_problem(worm, limits, Objective(maximise="speed"))
    >>> [bound.name for bound in problem.along]
    ['gait.length', 'gait.rate', 'gait.acceleration']
    """
    n, shortest_longest = worm.links, limits.period_range
    ranges = np.array(limits.length_ranges(n))
    model = spiked_worm(
        worm.masses,
        worm.drag,
        worm.load,
        length_nominal=float(ranges.max()),
        time_nominal=shortest_longest[1],
    )
    ends = Ends.of(model, 1)
    advance = ends.end[0] - ends.start[0]
    speed_nominal = float(np.max(rate_bounds(limits, n)))
    at_ends = [Bound("start", ends.start[0], 0.0, 0.0)]
    way = advance
    if objective.speed is not None:
        at_ends.append(
            Bound(
                "objective.speed", advance / ends.duration, objective.speed, nominal=speed_nominal
            )
        )
        # Costs per distance stay finite at rest, where every start begins.
        way = ca.fmax(advance, objective.speed * ends.duration / 2)
    cost = _COSTS[objective.minimise or "speed"](_Terms(model, ends, way, speed_nominal))
    return Problem(
        model=model,
        ends=ends,
        minimise=cost.minimise,
        duration=shortest_longest,
        periodic=["length", "velocity", "rate"],
        integrands=cost.integrand if cost.integrand is not None else ca.SX(0),
        along=[*_limits_along(model, limits, n, ranges), *cost.along],
        at_ends=at_ends,
        slacks=cost.slacks,
        design=cost.design,
        sharing=_sharing(model, limits, objective),
        impulses=limits.impulses,
    )


def _limits_along(model: Model, limits: GaitLimits, links: int, ranges: np.ndarray) -> list[Bound]:
    x = {s.name: s for s in model.x}
    bounds = [
        Bound("gait.length", x["length"].symbol, ranges[:, 0], ranges[:, 1], x["length"].nominal)
    ]
    rates = limits.rate_limits(links)
    if rates is not None:
        size = float(np.max(rates))
        bounds.append(
            Bound("gait.rate", x["rate"].symbol, -np.array(rates[0]), np.array(rates[1]), size)
        )
    if limits.acceleration is not None:
        most = np.broadcast_to(limits.acceleration, links)
        bounds.append(Bound("gait.acceleration", model.u[0].symbol, -most, most, float(most.max())))
    if limits.spike_load is not None:
        most = np.broadcast_to(limits.spike_load, links + 1)
        bounds.append(Bound("gait.spike_load", model.forces, upper=most, nominal=float(most.max())))
    if limits.actuator_force is not None:
        most = np.broadcast_to(limits.actuator_force, links)
        force = model.output("actuator_force")
        bounds.append(Bound("gait.actuator_force", force, -most, most, float(most.max())))
    if limits.sigma_margin > 0:
        sigma = model.output("reaction_mean")
        bounds.append(
            Bound("gait.sigma_margin", sigma, limits.sigma_margin, nominal=limits.sigma_margin)
        )
    return bounds


def _sharing(
    model: Model, limits: GaitLimits, objective: Objective
) -> Callable[[ca.SX], ca.SX] | None:
    """Residual of the sharing rule, for contacts whose load the motion leaves open."""
    if limits.resting == 1 and not loads_matter(limits, objective):
        return None

    def equal(stick: ca.SX) -> ca.SX:
        return model.forces - ca.dot(stick, model.forces) / ca.sum1(stick)

    def least_actuation(stick: ca.SX) -> ca.SX:
        # Stationarity: between neighbouring resting masses the actuator forces sum to zero.
        force = ca.vertcat(0, model.output("actuator_force"))
        rows = [ca.SX(0)]
        for i in range(1, stick.numel()):
            rows.append(force[i] + (1 - stick[i - 1]) * rows[-1])
        return ca.vertcat(*rows)

    if limits.sharing == "equal" or not loads_matter(limits, objective):
        return equal
    return least_actuation


def _speed(terms: _Terms) -> _Cost:
    return _Cost(-terms.way / terms.ends.duration / terms.speed_nominal)


def _peak(terms: _Terms, expression: ca.SX, name: str) -> _Cost:
    """Smallest upper bound of an expression at all times."""
    peak = Signal("peak", ca.SX.sym("peak"), "force", terms.force_nominal, 0.0)
    bound = Bound(name, expression - peak.symbol, upper=0.0, nominal=peak.nominal)
    return _Cost(peak.symbol / peak.nominal, along=(bound,), design=(peak,))


def _peak_spike_load(terms: _Terms) -> _Cost:
    return _peak(terms, terms.model.forces, "peak_spike_load")


def _peak_actuator_force(terms: _Terms) -> _Cost:
    force = terms.model.output("actuator_force")
    return _peak(terms, ca.vertcat(force, -force), "peak_actuator_force")


def _energy(terms: _Terms) -> _Cost:
    power = terms.model.output("power")
    nominal = terms.force_nominal * terms.speed_nominal
    spent = Signal("spent", ca.SX.sym("spent", power.numel()), "power", nominal, 0)
    return _Cost(
        terms.ends.integrals[0] / terms.way / terms.force_nominal,
        along=(
            Bound("power", spent.symbol - power, 0.0, nominal=nominal),
            Bound("power", spent.symbol, 0.0, nominal=nominal),
        ),
        slacks=(spent,),
        integrand=ca.sum1(spent.symbol),
    )


def _effort(terms: _Terms) -> _Cost:
    u = terms.model.u[0]
    return _Cost(
        terms.ends.integrals[0] / terms.ends.duration / u.nominal**2,
        integrand=ca.sumsqr(u.symbol),
    )


_COSTS: dict[str, Callable[[_Terms], _Cost]] = {
    "speed": _speed,
    "peak_spike_load": _peak_spike_load,
    "peak_actuator_force": _peak_actuator_force,
    "energy_per_distance": _energy,
    "acceleration_effort": _effort,
}
