"""What is measured along a motion: states and events added to a model, without effect on it.

What is measured this way is as exact as the motion itself, wherever samples may lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.model import Model, Signal, Switch, pack
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared.signals import at_ends, inputs, largest, symbol

ENTERS, LEAVES = "enters the tube", "leaves the tube"
"""Names of the crossings of the tube, which are events."""
_TUBE = ("tube_time", "tube_entered")
_SPRINGS = ("stiffness", "rest_length")
# Energies below such a share of their usual size are rounding and tolerance.
_LEAST_SHARE = 1e-3


def _add_states(model: Model, states: Sequence[Signal], rates: Sequence[ca.SX]) -> Model:
    own = pack(states)
    return replace(
        model,
        x=[*model.x, *states],
        ode=ca.vertcat(model.ode, *rates),
        switches=[replace(s, reset=ca.vertcat(s.reset, own)) for s in model.switches],
    )


# -- power ---------------------------------------------------------------------------------------


def measure_power(model: Model) -> Model:
    """Add states that integrate power and the square of the inputs of a chain.

    ``input_square`` (integral of |u|^2), ``input_work``, ``spring_work`` (taken up by
    springs) and ``losses`` (to dashpots, ground, drag and load).
    """
    u, rate, v = inputs(model), model.output("rate"), symbol(model, "velocity")
    spring, links = model.output("spring_force"), rate.numel()
    # the spring force is c (l - l0) + d l', and l_j' = v_{j-1} - v_j
    damping = ca.diag(ca.jacobian(spring, v)[:, :links])
    lost = ca.dot(damping, rate**2)
    lost += ca.dot(symbol(model, "drag") * v + symbol(model, "load"), v)
    for contact in model.contacts:
        lost -= contact.force * contact.velocity
    force, length = np.float64(_nominal(model, "input")), _nominal(model, "position")
    rates = {
        "input_square": ca.dot(u, u),
        "input_work": ca.dot(u, rate),
        "spring_work": ca.dot(spring - damping * rate, rate),
        "losses": lost,
    }
    sizes = {"input_square": force**2 * length / _nominal(model, "velocity")}
    states = [
        Signal(name, ca.SX.sym(name), nominal=float(sizes.get(name, force * length)), value=0.0)
        for name in rates
    ]
    return _add_states(model, states, list(rates.values()))


def measure_tracking(model: Model) -> Model:
    """Add integrals of the squared output ``error`` and of the power that actuators spend.

    ``error_square`` (integral of |e|^2) and ``positive_work`` (integral of the positive part
    of each actuator's power: nothing is recovered).
    """
    error, power = model.output("error"), inputs(model) * model.output("rate")
    force, length = np.float64(_nominal(model, "input")), _nominal(model, "position")
    states = [
        Signal("error_square", ca.SX.sym("error_square"), nominal=length**2, value=0.0),
        Signal("positive_work", ca.SX.sym("positive_work"), nominal=force * length, value=0.0),
    ]
    return _add_states(model, states, [ca.dot(error, error), ca.sum1(ca.fmax(power, 0))])


def _nominal(model: Model, name: str) -> float:
    """Usual size of a signal; that of a force where inputs are put in follows from the others."""
    found = {s.name: s.nominal for s in (*model.x, *model.u)}
    if name in found:
        return found[name]
    mass = next(s.value for s in model.p if s.name == "mass")
    return float(np.mean(np.asarray(mass))) * found["velocity"] ** 2 / found["position"]


def chain_numbers(motion: Trajectory) -> dict[str, tuple[Any, str]]:
    """Scalars reported for every motion of a chain, name to (value, quantity).

    The motion is of a model of `measure_power`, sampled at start and end.
    """
    center = at_ends(motion).output("center_of_mass")[0]
    distance = float(center[-1] - center[0])
    return {
        "x_end": (motion.state("position")[:, -1], "length"),
        "v_end": (motion.state("velocity")[:, -1], "speed"),
        "distance": (distance, "length"),
        "mean_speed": (distance / (motion.time[-1] - motion.time[0]), "speed"),
        "input_rms": (input_rms(motion), "force"),
        "input_peak": (largest(motion, inputs(motion.system.model)), "force"),
        "n_events": (len(motion.events), "count"),
        "n_steps": (motion.n_steps, "count"),
    }


def input_rms(motion: Trajectory) -> float:
    """Root of the mean over time of |u|^2, the Euclidean norm over the links.

    The motion is of a model of `measure_power`.
    """
    square = motion.state("input_square")[0]
    return float(np.sqrt((square[-1] - square[0]) / (motion.time[-1] - motion.time[0])))


@dataclass(frozen=True)
class Balance:
    """Where the actuators' energy went.

    The residual is input work less losses and stored energy, relative to the largest of them
    or to a thousandth of (force of usual size) times (length), where that is more.
    """

    input_work: float
    losses: float  # to dashpots, ground, drag and load
    stored: float  # change of kinetic and elastic energy
    residual: float  # relative


def balance(motion: Trajectory) -> Balance | None:
    """Energy balance from the first sample to the last, of a motion of `measure_power`.

    None where a contact stops a mass by an impact, whose energy no integral sees.
    """
    if any(event.kind == "impact" and event.time > motion.time[0] for event in motion.events):
        return None
    model = motion.system.model
    v, motion = symbol(model, "velocity"), at_ends(motion)
    kinetic = motion.observe(ca.dot(symbol(model, "mass"), v**2) / 2)[0]
    energy = motion.output("energy")[0]
    work, lost, springs = (
        _change(motion.state(name)[0]) for name in ("input_work", "losses", "spring_work")
    )
    # Springs of constant numbers keep what they take up, which is known without integration.
    vary = any(schedule.name in _SPRINGS for schedule in model.schedules)
    stored = _change(kinetic) + springs if vary else _change(energy)
    usual = next(s.nominal for s in model.x if s.name == "input_work")
    size = max(abs(work), abs(lost), abs(stored), float(np.max(energy)), _LEAST_SHARE * usual)
    return Balance(work, lost, stored, (work - lost - stored) / size)


def _change(values: np.ndarray) -> float:
    return float(values[-1] - values[0])


# -- the tube ------------------------------------------------------------------------------------


def watch_tube(model: Model, radius: float) -> Model:
    """Make crossings of a tube events of a closed loop with output ``error``; sum time outside.

    Adds ``tube_time`` and ``tube_entered`` for `time_in_tube`, constant between crossings.
    `radius` counts without a parameter ``tube_radius``; existing crossing events are kept.
    """
    own = [p.symbol for p in model.p if p.name == "tube_radius"]
    width = own[0] if own else ca.SX(radius)
    error = model.output("error")
    outside, x = ca.dot(error, error) - width**2, pack(model.x)
    switches = list(model.switches)
    known = {switch.name for switch in switches}
    for name, guard in ((LEAVES, outside), (ENTERS, -outside)):
        if name not in known:
            switches.append(Switch(name, guard, x))
    states = [Signal(name, ca.SX.sym(name), "time", value=0.0) for name in _TUBE]
    total, entered = (s.symbol for s in states)
    after = {
        LEAVES: ca.vertcat(total - model.t, entered),
        ENTERS: ca.vertcat(total + model.t, model.t),
    }
    kept = ca.vertcat(total, entered)
    return replace(
        model,
        x=[*model.x, *states],
        ode=ca.vertcat(model.ode, ca.SX(2, 1)),
        switches=[replace(s, reset=ca.vertcat(s.reset, after.get(s.name, kept))) for s in switches],
    )


def outside_between(motion: Trajectory, outside: bool, since: float) -> float:
    """How long the error was outside of the tube from time `since` on.

    The motion is of a model of `watch_tube`, from time 0; `outside`: it starts outside.
    """
    total, before = 0.0, since
    for event in motion.events:
        if event.name in (ENTERS, LEAVES):
            time = max(event.time, since)
            total += (time - before) * outside
            outside, before = event.name == LEAVES, time
    return total + (motion.end_time - before) * outside


def time_in_tube(motion: Trajectory) -> tuple[float, float | None]:
    """Time the error was outside of the tube, and the time of its last entry.

    The latter is the first sample's time if the error never left, None if the motion ends
    outside. The motion is of a model of `watch_tube`, sampled at start and end.
    """
    motion = at_ends(motion)
    guard = next(s.guard for s in motion.system.model.switches if s.name == LEAVES)
    size = motion.observe(guard)[0]
    start, end = motion.time[0], motion.time[-1]
    # crossings have been counted with the sign of their direction; the ends complete the sum
    total = float(motion.state("tube_time")[0, -1])
    total += (end if size[-1] > 0 else 0.0) - (start if size[0] > 0 else 0.0)
    entered = float(motion.state("tube_entered")[0, -1])
    return float(total), None if size[-1] > 0 else entered
