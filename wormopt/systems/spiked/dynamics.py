"""The worm with spikes (eqs. 1 to 7) as a Model: for gait design, or under a known gait.

Under a known gait masses, drag and load can be fitted. While any mass rests, the gait alone
determines which ones do; this is a schedule. The only state left is the common velocity w of a
glide, on one spike for all masses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.loop import gait_reference
from wormopt.errors import ArgumentError
from wormopt.model.friction import Spike
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.schedule import Schedule
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.shared.parameters import parameter
from wormopt.systems.spiked.gait_problem import GaitProblem
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.stretches import Drive, at_breaks, kinematic_stretches


def spiked_worm(
    mass: Sequence[float],
    drag: float,
    load: float | Sequence[float],
    *,
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build a chain of n+1 point masses (head first) with n prescribed link lengths.

    States: ``position``, ``velocity`` of the head, ``length``, ``rate``; inputs l_j'';
    outputs ``reaction_mean`` (lambda of eq. 7), ``actuator_force``, ``power``; one spike per mass.
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
    loads = ca.DM(np.broadcast_to(load, n + 1))
    momentum = ca.sum1(reaction) - drag * ca.sum1(v) - ca.sum1(loads)
    head_acceleration = (momentum + ca.dot(ca.DM(mass), span_acceleration)) / sum(mass)
    # Recursion from the head down, (3): mu_{i+1} = mu_i + reaction_i - k v_i - Gamma - m_i v_i'.
    surplus = reaction - drag * v - loads - ca.DM(mass) * (head_acceleration - span_acceleration)
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


def gait_problem(task: GaitProblem) -> Problem:
    """Formulate the design for a smooth cost as an optimal-control problem.

    It is periodic up to the advance. Costs are about 1, positive powers are slacks.
    """
    worm, limits, required = task.worm, task.limits, task.objective.speed
    assert required is not None
    ranges, (_, longest) = np.array(limits.length_ranges(worm.links)), limits.period_range
    model = spiked_worm(
        worm.masses,
        worm.drag,
        worm.loads(worm.load_range[0]),
        length_nominal=float(ranges.max()),
        time_nominal=longest,
    )
    ends = Ends.of(model, 1)
    advance = ends.end[0] - ends.start[0]
    # costs per distance stay finite at rest, where every start begins
    cost = _cost(task, model, ends, ca.fmax(advance, required * ends.duration / 2))
    reached = advance / ends.duration
    return Problem(
        model=model,
        ends=ends,
        duration=limits.period_range,
        periodic=["length", "velocity", "rate"],
        path_constraints=[*_limits_along(model, limits, ranges), *cost.pop("along", ())],
        boundary_constraints=[
            Constraint("start", ends.start[0], 0.0, 0.0, nominal=float(ranges.max())),
            Constraint("objective.speed", reached, required, nominal=task.speed_nominal),
        ],
        sharing=_sharing(model, limits, task.loads_matter),
        **cost,
    )


def _limits_along(model: Model, limits: Limits, ranges: np.ndarray) -> Iterator[Constraint]:
    x, named, (low, high) = {s.name: s for s in model.x}, limits.name, ranges.T
    yield Constraint(f"{named}.length", x["length"].symbol, low, high, x["length"].nominal)
    if (rates := limits.rate_limits(len(ranges))) is not None:
        contraction, extension = np.array(rates)
        size = float(np.max(rates))
        yield Constraint(f"{named}.rate", x["rate"].symbol, -contraction, extension, size)
    for key, expression in (
        ("acceleration", model.u[0].symbol),
        ("spike_load", model.forces),
        ("actuator_force", model["actuator_force"]),
    ):
        if getattr(limits, key) is not None:
            most = np.broadcast_to(getattr(limits, key), expression.numel())
            least = -np.inf if key == "spike_load" else -most  # spikes cannot pull
            yield Constraint(f"{named}.{key}", expression, least, most, float(most.max()))
    if (margin := limits.sigma_margin) > 0:
        sigma = model["reaction_mean"]
        yield Constraint(f"{named}.sigma_margin", sigma, margin, nominal=margin)


def _sharing(model: Model, limits: Limits, matter: bool) -> Callable[[ca.SX], ca.SX] | None:
    """Residual of the sharing rule, for contacts whose load the motion does not determine."""
    if limits.resting == 1 and not matter:
        return None

    def equal(stick: ca.SX) -> ca.SX:
        return model.forces - ca.dot(stick, model.forces) / ca.sum1(stick)

    def least_actuation(stick: ca.SX) -> ca.SX:
        # Stationarity: between neighbouring resting masses the actuator forces sum to zero.
        force = ca.vertcat(0, model["actuator_force"])
        rows = [ca.SX(0)]
        for i in range(1, stick.numel()):
            rows.append(force[i] + (1 - stick[i - 1]) * rows[-1])
        return ca.vertcat(*rows)

    if limits.sharing == "equal" or not matter:
        return equal
    return least_actuation


def _cost(task: GaitProblem, model: Model, ends: Ends, way: ca.SX) -> dict[str, Any]:
    """Terms of the cost in the problem; `way` is the advance."""
    _, time = task.limits.period_range
    if task.objective.minimise == "acceleration_effort":
        u = model.u[0]
        return {
            "minimise": ends.integrals[0] * time / ends.duration,
            "integrands": ca.sumsqr(u.symbol / u.nominal) / time,
        }
    power, speed = model["power"], task.speed_nominal
    nominal = float(sum(c.nominal_force for c in model.contacts)) * speed
    spent = Signal("spent", ca.SX.sym("spent", power.numel()), "power", nominal, 0)
    return {
        "minimise": ends.integrals[0] * time * speed / way,
        "integrands": ca.sum1(spent.symbol) / nominal / time,
        "slacks": (spent,),
        "along": (
            Constraint("power", spent.symbol - power, 0.0, nominal=nominal),
            Constraint("power", spent.symbol, 0.0, nominal=nominal),
        ),
    }


# A smaller jump of a rate, as a share of the largest rate, is rounding.
_NO_CORNER = 1e-9


def driven_worm(gait: Gait, mass: float | Sequence[float], drag: float, load: float) -> Model:
    """Build the bimodal system of a gait that repeats from time 0, where the worm is at rest.

    States are ``position`` of the head and ``glide`` w; parameters are ``mass``, ``drag`` and
    ``load``. Outputs are ``velocity`` (n+1), ``spike_load`` (sum of all spikes),
    ``actuator_force`` (n) and ``length`` (n). Resting masses share the load equally. Raises
    ArgumentError if the gait has a corner, where forces are impulses, or a mass is not positive.
    """
    n = gait.links
    drive = Drive(gait, np.ones(n + 1), 0.0, 0.0, "equal")
    after, before = at_breaks(gait, 1)
    if np.abs(after - before).max() > _NO_CORNER * drive.rate_scale:
        raise ArgumentError("the gait has corners, where forces are impulses; round the corners")
    t = ca.SX.sym("t")
    course, resting = gait_reference(gait, t), _resting(drive)
    m, k, gamma = (
        parameter("mass", mass, n + 1, "mass"),
        parameter("drag", drag, 1, "drag"),
        parameter("load", load, 1, "force"),
    )
    position, w, spikes = ca.SX.sym("position"), ca.SX.sym("glide"), ca.SX.sym("spikes")

    rate = ca.vertcat(0, ca.cumsum(course.rate))  # S_i', (2)
    bend = ca.vertcat(0, ca.cumsum(course.acceleration))
    held = ca.dot(resting.symbol, rate) - rate
    velocity = held + w
    turning = ca.dot(resting.symbol, bend) - bend
    needed = ca.dot(m.symbol, turning) + k.symbol * ca.sum1(velocity) + (n + 1) * gamma.symbol
    slope = (spikes - needed) / ca.sum1(m.symbol)
    # from the head down, (3): mu_{i+1} = mu_i + lambda_i - k v_i - Gamma - m_i v_i'
    surplus = (
        spikes * resting.symbol - k.symbol * velocity - gamma.symbol - m.symbol * (turning + slope)
    )
    force = (n + 1) * (float(np.mean(mass)) * drive.force_scale + load)
    return Model(
        name=f"worm of {n} links under a gait",
        x=[
            Signal("position", position, "length", drive.rate_scale * gait.period, value=0.0),
            Signal("glide", w, "speed", drive.rate_scale, value=0.0),
        ],
        ode=ca.vertcat(velocity[0], slope),
        p=[m, k, gamma],
        t=t,
        outputs=[
            Output("velocity", velocity, "speed"),
            Output("spike_load", spikes, "force"),
            Output("actuator_force", ca.cumsum(surplus)[:n], "force"),
            Output("length", course.value, "length"),
        ],
        contacts=[Contact("worm", w, spikes, Spike(scale=force), force, drive.rate_scale)],
        schedules=[*course.schedules, resting],
    )


def _resting(drive: Drive) -> Schedule:
    """Shares of the load of all masses while the worm does not glide, as a schedule (n+1)."""
    gait, masses = drive.gait, len(drive.mass)
    stretches = kinematic_stretches(drive)
    shares = np.zeros((len(stretches), masses))
    for row, stretch in zip(shares, stretches, strict=True):
        row[list(stretch.resting)] = 1 / len(stretch.resting)
    begins = [gait.breaks[stretch.piece] + stretch.start for stretch in stretches]
    symbol, begin = ca.SX.sym("resting", masses), ca.SX.sym("resting_begin")
    breaks = np.append(begins, gait.period)
    return Schedule("resting", symbol, begin, breaks, shares, periodic=True)
