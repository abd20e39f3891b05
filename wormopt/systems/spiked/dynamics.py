"""The worm with spikes, (1)-(7), as a Model; its gait design as a problem of optimal control."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.model.friction import Spike
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.ocp.problem import Bound, Ends, Problem
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.task import Objective, Task, Worm


def spiked_worm(
    mass: Sequence[float],
    drag: float,
    load: float,
    *,
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build the chain of n+1 point masses (head first), n link lengths prescribed, (1)-(7).

    States: ``position``, ``velocity`` of the head, ``length``, ``rate``; inputs l_j'';
    outputs ``reaction_mean`` (lambda of (7)), ``actuator_force``, ``power``; a spike each.
    """
    n = len(mass) - 1
    speed = length_nominal / time_nominal
    force = sum(mass) / len(mass) * speed / time_nominal
    position, velocity = ca.SX.sym("x0"), ca.SX.sym("v0")
    length, rate, acceleration = (ca.SX.sym(s, n) for s in ("l", "dl", "ddl"))
    reaction = ca.SX.sym("reaction", n + 1)

    span_rate = ca.vertcat(0, ca.cumsum(rate))  # S_i', (2)
    span_acceleration = ca.vertcat(0, ca.cumsum(acceleration))
    v = velocity - span_rate
    momentum = ca.sum1(reaction) - drag * ca.sum1(v) - load * (n + 1)
    head_acceleration = (momentum + ca.dot(ca.DM(mass), span_acceleration)) / sum(mass)
    # Recursion from the head down, (3): mu_{i+1} = mu_i + reaction_i - k v_i - Gamma - m_i v_i'.
    surplus = reaction - drag * v - load - ca.DM(mass) * (head_acceleration - span_acceleration)
    actuator_force = ca.cumsum(surplus)[:n]

    return Model(
        name=f"spiked worm of {n} links",
        x=[
            Signal("position", position, "length", length_nominal),
            Signal("length", length, "length", length_nominal),
            Signal("velocity", velocity, "speed", speed),
            Signal("rate", rate, "speed", speed),
        ],
        ode=ca.vertcat(velocity, rate, head_acceleration, acceleration),
        u=[Signal("acceleration", acceleration, "acceleration", speed / time_nominal)],
        outputs=[
            Output("reaction_mean", ca.sum1(reaction) / (n + 1), "force"),
            Output("actuator_force", actuator_force, "force"),
            Output("power", -actuator_force * rate, "power"),
        ],
        contacts=[
            Contact(f"mass {i}", v[i], reaction[i], Spike(scale=force), force, speed)
            for i in range(n + 1)
        ],
    )


@dataclass(frozen=True, eq=False)
class _Terms:
    """What costs are made of: the way per period, and nominal sizes."""

    model: Model
    ends: Ends
    way: ca.SX
    speed_nominal: float
    time_nominal: float

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


def gait_problem(worm: Worm, limits: Limits, objective: Objective) -> Problem:
    """Kinematic gait design as an optimal-control problem, periodic up to the advance, (1)-(7).

    Costs are scaled to about 1; peaks become bounding constants, positive powers slacks
    (epigraph form). Bounds bear the scene's keys, by which `elastic` explains a conflict.
    """
    n, period_range = worm.links, limits.period_range
    ranges = np.array(limits.length_ranges(n))
    model = spiked_worm(
        worm.masses,
        worm.drag,
        worm.load_range[-1 if limits.spike_load is not None else 0],
        length_nominal=float(ranges.max()),
        time_nominal=period_range[1],
    )
    ends = Ends.of(model, 1)
    advance = ends.end[0] - ends.start[0]
    speed_nominal = float(np.max(limits.rate_bounds(n)))
    at_ends = [Bound("start", ends.start[0], 0.0, 0.0, nominal=float(ranges.max()))]
    way = advance
    if objective.speed is not None:
        at_ends.append(
            Bound(
                "objective.speed", advance / ends.duration, objective.speed, nominal=speed_nominal
            )
        )
        # Costs per distance stay finite at rest, where every start begins.
        way = ca.fmax(advance, objective.speed * ends.duration / 2)
    cost = _COSTS[objective.minimise or "speed"](
        _Terms(model, ends, way, speed_nominal, period_range[1])
    )
    return Problem(
        model=model,
        ends=ends,
        minimise=cost.minimise,
        duration=period_range,
        periodic=["length", "velocity", "rate"],
        integrands=cost.integrand if cost.integrand is not None else ca.SX(0),
        along=[*_limits_along(model, limits, n, ranges), *cost.along],
        at_ends=at_ends,
        slacks=cost.slacks,
        design=cost.design,
        sharing=_sharing(model, limits, Task(worm, limits, objective).loads_matter),
        impulses=limits.impulses,
    )


def _limits_along(model: Model, limits: Limits, links: int, ranges: np.ndarray) -> list[Bound]:
    x = {s.name: s for s in model.x}
    bounds = [
        Bound("limits.length", x["length"].symbol, ranges[:, 0], ranges[:, 1], x["length"].nominal)
    ]
    rates = limits.rate_limits(links)
    if rates is not None:
        size = float(np.max(rates))
        bounds.append(
            Bound("limits.rate", x["rate"].symbol, -np.array(rates[0]), np.array(rates[1]), size)
        )
    if limits.acceleration is not None:
        most = np.broadcast_to(limits.acceleration, links)
        bounds.append(
            Bound("limits.acceleration", model.u[0].symbol, -most, most, float(most.max()))
        )
    if limits.spike_load is not None:
        most = np.broadcast_to(limits.spike_load, links + 1)
        bounds.append(
            Bound("limits.spike_load", model.forces, upper=most, nominal=float(most.max()))
        )
    if limits.actuator_force is not None:
        most = np.broadcast_to(limits.actuator_force, links)
        force = model.output("actuator_force")
        bounds.append(Bound("limits.actuator_force", force, -most, most, float(most.max())))
    if limits.sigma_margin > 0:
        sigma = model.output("reaction_mean")
        bounds.append(
            Bound("limits.sigma_margin", sigma, limits.sigma_margin, nominal=limits.sigma_margin)
        )
    return bounds


def _sharing(model: Model, limits: Limits, matter: bool) -> Callable[[ca.SX], ca.SX] | None:
    """Residual of the sharing rule, for contacts whose load the motion leaves open."""
    if limits.resting == 1 and not matter:
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

    if limits.sharing == "equal" or not matter:
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
        terms.ends.integrals[0] * terms.time_nominal * terms.speed_nominal / terms.way,
        along=(
            Bound("power", spent.symbol - power, 0.0, nominal=nominal),
            Bound("power", spent.symbol, 0.0, nominal=nominal),
        ),
        slacks=(spent,),
        integrand=ca.sum1(spent.symbol) / nominal / terms.time_nominal,
    )


def _effort(terms: _Terms) -> _Cost:
    u = terms.model.u[0]
    return _Cost(
        terms.ends.integrals[0] * terms.time_nominal / terms.ends.duration,
        integrand=ca.sumsqr(u.symbol / u.nominal) / terms.time_nominal,
    )


_COSTS: dict[str, Callable[[_Terms], _Cost]] = {
    "speed": _speed,
    "peak_spike_load": _peak_spike_load,
    "peak_actuator_force": _peak_actuator_force,
    "energy_per_distance": _energy,
    "acceleration_effort": _effort,
}
