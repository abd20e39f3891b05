"""Measured quantities of motions of chains: additional states and events without effect on them.

These quantities are as exact as the motion itself, independent of the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.model import Model, Signal, Switch, pack
from wormopt.result import Check
from wormopt.simulation.functions import System
from wormopt.simulation.options import Tolerance
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.tables import Tube
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.models import with_integrals
from wormopt.systems.shared.proof import CrossCheck, accepted_error, motion_facts, one_or_all
from wormopt.systems.shared.signals import at_ends, chain_expressions

ENTERS, LEAVES = "enters the tube", "leaves the tube"
"""Names of the crossings of the tube, which are events."""
_TUBE = ("tube_time", "tube_entered")
_SPRINGS = ("stiffness", "rest_length")
# Energies below this share of their usual size are due to rounding and tolerance.
_LEAST_SHARE = 1e-3
# Number of times at which the largest error is sought if the motion is kept whole.
_INSTANTS = 20_001


# -- power ---------------------------------------------------------------------------------------


def is_chain(model: Model) -> bool:
    """Whether a model is a chain, driven or controlled, not a plant of the user's own."""
    return any(output.name == "spring_force" for output in model.outputs)


def signals_of(model: Model) -> dict[str, ca.SX]:
    """Expressions of the signals that a kind declares: all of a chain, few of another plant."""
    if is_chain(model):
        return chain_expressions(model)
    return {"length": model["length"], "input": model["input"]}


def measure_power(model: Model) -> Model:
    """Add states that integrate the powers of a plant and the square of its inputs.

    ``input_square`` (integral of |u|^2), ``input_work``; of a chain also ``spring_work`` (absorbed
    by springs) and ``losses`` (to dashpots, ground, drag and load).
    """
    u, rate = model["input"], model["rate"]
    force, length = np.float64(_nominal(model, "input")), _nominal(model, "position")
    rates = {"input_square": ca.dot(u, u), "input_work": ca.dot(u, rate)}
    if is_chain(model):
        rates |= _chain_powers(model)
    sizes = {"input_square": force**2 * length / _nominal(model, "velocity")}
    states = [
        Signal(name, ca.SX.sym(name), nominal=float(sizes.get(name, force * length)), value=0.0)
        for name in rates
    ]
    return with_integrals(model, states, list(rates.values()))


def _chain_powers(model: Model) -> dict[str, ca.SX]:
    rate, v = model["rate"], model["velocity"]
    spring, links = model["spring_force"], rate.numel()
    # The spring force is c (l - l0) + d l', and l_j' = v_j - v_{j+1}.
    damping = ca.diag(ca.jacobian(spring, v)[:, :links])
    lost = ca.dot(damping, rate**2)
    lost += ca.dot(model["drag"] * v + model["load"], v)
    for contact in model.contacts:
        lost -= contact.force * contact.velocity
    return {"spring_work": ca.dot(spring - damping * rate, rate), "losses": lost}


def measure_tracking(model: Model) -> Model:
    """Add integrals of the squared output ``error`` and of the positive power of the actuators.

    ``error_square`` (integral of |e|^2) and ``positive_work`` (integral of the positive part of
    each actuator's power, without recovery).
    """
    error, power = model["error"], model["input"] * model["rate"]
    force, length = np.float64(_nominal(model, "input")), _nominal(model, "position")
    states = [
        Signal("error_square", ca.SX.sym("error_square"), nominal=length**2, value=0.0),
        Signal("positive_work", ca.SX.sym("positive_work"), nominal=force * length, value=0.0),
    ]
    return with_integrals(model, states, [ca.dot(error, error), ca.sum1(ca.fmax(power, 0))])


def _nominal(model: Model, name: str) -> float:
    """Usual size of a signal; that of an inserted input force is derived from the others."""
    found = {s.name: s.nominal for s in (*model.x, *model.u)}
    if name in found:
        return found[name]
    if not is_chain(model):
        return 1.0
    mass = next(s.value for s in model.p if s.name == "mass")
    return float(np.mean(np.asarray(mass))) * found["velocity"] ** 2 / found["position"]


@lru_cache(maxsize=64)
def _observer(system: System) -> tuple[tuple[str, ...], ca.Function]:
    """Function of all measured expressions, made once for all motions of a model."""
    model = system.model
    rows = {
        "input": ca.norm_inf(model["input"]),
        **(
            {"center": model["center_of_mass"], "mass": ca.sum1(model["mass"])}
            if is_chain(model)
            else {}
        ),
        **{o.name: o.expression for o in model.outputs if o.name == "error_norm"},
    }
    for switch in model.switches:
        if switch.name == LEAVES:
            rows["outside"] = switch.guard
    return tuple(rows), system.observe(ca.vertcat(*rows.values()))


@lru_cache(maxsize=1)  # several functions ask for it, one motion after the other
def _seen(motion: Trajectory) -> dict[str, np.ndarray]:
    names, function = _observer(motion.system)
    return dict(zip(names, motion.values(function), strict=True))


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def chain_numbers(motion: Trajectory) -> dict[str, Any]:
    """Scalars of every motion of a plant, by their names in a Result; some of a chain only.

    The motion is of a model of `measure_power`, sampled at start and end. Peaks are those of the
    samples if the motion was not kept whole.
    """
    seen, time = _seen(motion), motion.time[-1] - motion.time[0]
    whole, found = motion.dense is not None, dict[str, Any]()
    if "center" in seen:
        distance = _change(seen["center"])
        found = {
            "x_end": motion["position"][:, -1],
            "v_end": motion["velocity"][:, -1],
            "distance": distance,
            "mean_speed": distance / time,
        }
    return found | {
        "input_rms": float(np.sqrt(_change(motion["input_square"][0]) / time)),
        "input_peak": motion.largest(motion.system.model["input"])
        if whole
        else float(seen["input"].max()),
        "n_events": len(motion.events),
        "n_steps": motion.n_steps,
    }


@dataclass(frozen=True)
class Balance:
    """Energy balance of the actuators' work.

    The residual is input work minus losses and stored energy, relative to the largest of them, but
    at least to a thousandth of (usual force) times (usual length).
    """

    input_work: float
    losses: float  # to dashpots, ground, drag and load
    stored: float  # change of kinetic and elastic energy
    residual: float  # relative

    def check(self, tolerance: Tolerance) -> Check:
        """Check of a trust report for a motion simulated to a tolerance."""
        advice = f"energies do not balance, by {self.residual:.2g} of their size"
        return Check("energy balance", self.residual, accepted_error(tolerance), advice)


@np.errstate(all="ignore")
def balance(motion: Trajectory) -> Balance | None:
    """Energy balance from the first sample to the last, of a motion of `measure_power`.

    None if an impact stops a mass, since no integral contains its energy, and if it is no chain.
    """
    if not is_chain(motion.system.model):
        return None
    if any(event.kind == "impact" and event.time > motion.time[0] for event in motion.events):
        return None
    model = motion.system.model
    v, motion = model["velocity"], at_ends(motion)
    kinetic = motion.observe(ca.dot(model["mass"], v**2) / 2)[0]
    energy = motion["energy"][0]
    work, lost, springs = (
        _change(motion[name][0]) for name in ("input_work", "losses", "spring_work")
    )
    # Springs with constant parameters store what they absorb, which needs no integration.
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

    Adds ``tube_time`` and ``tube_entered`` for `time_in_tube`, constant between crossings. `radius`
    is used without a parameter ``tube_radius``; existing crossing events are kept.
    """
    own = [p.symbol for p in model.p if p.name == "tube_radius"]
    width = own[0] if own else ca.SX(radius)
    error = model["error"]
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
    """Time that the error is outside the tube, from `since` on.

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
    """Time that the error is outside the tube, and the time of its last entry.

    The latter is the first sample's time if the error never leaves, and None if the motion ends
    outside. The motion is of a model of `watch_tube`, sampled at start and end.
    """
    size = _seen(motion)["outside"]
    start, end = motion.time[0], motion.time[-1]
    # Crossings are counted with the sign of their direction; the ends complete the sum.
    total = float(motion["tube_time"][0, -1])
    total += (end if size[-1] > 0 else 0.0) - (start if size[0] > 0 else 0.0)
    entered = float(motion["tube_entered"][0, -1])
    return float(total), None if size[-1] > 0 else entered


# -- trust ---------------------------------------------------------------------------------------


def chain_checks(
    second: CrossCheck | None, energies: Balance | None, tolerance: Tolerance, label: str = ""
) -> Iterator[Check]:
    """Checks of one motion of a chain; those of several motions begin with a `label`."""
    found = [second.check] if second else []
    found += [energies.check(tolerance)] if energies else []
    for each in found:
        if label:
            each = replace(each, name=f"{label}: {each.name}", advice=f"{label}: {each.advice}")
        yield each


def chain_facts(
    motions: Sequence[Trajectory],
    rechecks: Sequence[CrossCheck | None],
    tolerance: Tolerance,
    energies: Sequence[Balance | None],
) -> dict[str, Any]:
    """Facts as `motion_facts`, with energy balances; sequences have one entry per tracker."""
    balances = one_or_all([each and asdict(each) for each in energies])
    return motion_facts(motions, rechecks, tolerance) | {"energy_balance": balances}


def funnel_checks(
    loop: Model, motions: Trajectory | Mapping[str, Trajectory], label: str = ""
) -> Iterator[Check]:
    """Whether errors stay in their funnels, if there are any; `motions` are by label."""
    if not any(output.name == "rate_funnel" for output in loop.outputs):
        return
    if isinstance(motions, Trajectory):
        motions = {label: motions}
    for norm, width in (("error_norm", "funnel"), ("rate_error_norm", "rate_funnel")):
        shares = {
            name: motion.largest(loop[norm] / loop[width]) for name, motion in motions.items()
        }
        advice = [
            f"{name}{norm} leaves its {width}, outside which the controller is undefined"
            for name, share in shares.items()
            if not share < 1
        ]
        yield Check(
            f"{label}{norm} in its {width}",
            max(shares.values()),
            1.0,
            "; ".join(advice),
            not advice,
        )


# -- judged by a tube from a time on ---------------------------------------------------------------


def judged(model: Model, tube: Tube) -> Model:
    """Add the measured quantities to a chain, driven or controlled.

    It must have the output ``error``.
    """
    return watch_tube(measure_tracking(measure_power(model)), tube.radius)


def judged_numbers(motion: Trajectory, tube: Tube) -> dict[str, Any]:
    """Scalars of a `judged` motion from time 0 on, by their names in a Result.

    ``work`` and quantities derived from it count the positive power of each actuator, ``net_work``
    all power.
    """
    seen, chain = _seen(motion), chain_numbers(motion)
    missed, work, net_work, spent = (
        float(motion[name][0, -1])
        for name in ("error_square", "positive_work", "input_work", "input_square")
    )
    distance = chain.get("distance")
    errors = seen["error_norm"][motion.time >= tube.capture]
    if motion.dense is not None:
        whole = motion.at(np.linspace(tube.capture, motion.end_time, _INSTANTS))
        errors = whole["error_norm"]
    found = chain | {
        "capture_time": time_in_tube(motion)[1],
        "time_outside_tube": outside_between(motion, bool(seen["outside"][0] > 0), tube.capture),
        "error_peak": float(np.max(errors, initial=0.0)),
        "error_integral": missed,
        "input_integral": spent,
        "work": work,
        "net_work": net_work,
        "energy_per_mass_distance": work / (float(seen["mass"][0]) * distance)
        if distance and distance > 0
        else None,
    }
    return {name: found.get(name) for name in (*JUDGED, *chain)}
