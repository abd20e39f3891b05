"""Run scenes of kind ``simulate``: a chain with given inputs, or a user-defined model."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.loop import TrackingError, close
from wormopt.control.reference import Reference, gait_reference
from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output
from wormopt.progress import Report
from wormopt.quantities import UNITS, Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.numerics import Start
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.chain.loops import (
    build_chain,
    draw_links,
    laws_of,
)
from wormopt.systems.chain.measured import (
    balance,
    chain_checks,
    chain_facts,
    chain_numbers,
    measure_power,
)
from wormopt.systems.chain.runs.own_model import load_model
from wormopt.systems.chain.scenes.simulate import ConstantForce, HarmonicChange, SimulateScene
from wormopt.systems.chain.tables import ChainTable
from wormopt.systems.shared.proof import (
    CrossCheck,
    cross_check,
    motion_facts,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import (
    chain_expressions,
    event_arrays,
    fitted,
    sample,
    simulate_whole,
)
from wormopt.systems.spiked import gait_of_shape

# Signals of a chain in the picture, in this order.
_SHOWN = ("length", "velocity", "contact_force", "input")


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[SimulateScene], report: Report) -> Result:
    """Simulate a chain or the user's model; "failed" if second route or energy balance disagrees.

    Raises SceneError for an unusable gait file or model. Raises SolveError if the motion stops
    early, and Interrupted if the user stops it, both with the motion so far as partial result.
    """
    table = scene.table
    clock = time.perf_counter()
    if table.worm is None:
        plain = model = load_model(scene)
    else:
        plain = _driven_chain(scene, table.worm)
        model = measure_power(plain)
    built = time.perf_counter()
    treatment, tolerance = treatment_of(table.contact), tolerance_of(table.tolerance)
    try:
        motion = simulate_whole(
            model, table.time.end, table.time.samples, treatment, tolerance, report
        )
    except SolveError as error:
        partial = _unfinished(scene, error.partial, error.reason)
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except Interrupted as stop:
        why = f"interrupted at t = {stop.partial.end_time:.6g}"
        raise Interrupted(_unfinished(scene, stop.partial, why)) from None
    except (ValueError, RuntimeError, NotImplementedError) as error:
        if table.worm is not None:
            raise
        raise SceneError(scene.name, [("model", f"cannot be simulated: {error}")]) from error
    simulated = time.perf_counter()
    try:
        recheck = table.tolerance.recheck
        second = cross_check(plain, motion, tolerance, recheck=recheck, report=report)
    except KeyboardInterrupt:
        why = "interrupted before the second route was complete"
        raise Interrupted(_unfinished(scene, motion, why)) from None
    checks, facts = [second.check] if second else [], motion_facts([motion], [second], tolerance)
    if table.worm is not None:
        energy = balance(motion)
        checks = chain_checks(second, energy, tolerance)
        facts = chain_facts([motion], [second], tolerance, [energy])
    return conclude(
        scene,
        {**_scalars(scene, motion), "recheck_error": second and second.error},
        _signals(scene, motion),
        checks=checks,
        facts=facts,
        warnings=_warnings(scene, motion, second),
        timings={
            "build": built - clock,
            "simulate": simulated - built,
            "recheck": time.perf_counter() - simulated,
        },
        attributes=_attributes(scene, motion),
    )


def models_of(scene: Scene[SimulateScene]) -> dict[str, Model]:
    """Make the model to simulate; raises SceneError as `run`."""
    worm = scene.table.worm
    return {"": load_model(scene) if worm is None else _driven_chain(scene, worm)}


# -- chains --------------------------------------------------------------------------------------


def _driven_chain(scene: Scene[SimulateScene], worm: ChainTable) -> Model:
    table = scene.table
    start, actuation = table.start or Start(), table.actuation
    links = draw_links(worm, table.time.end)
    rest = np.array(per(worm.rest_length, worm.links))
    gait, shift = _command(scene, rest)
    period = gait.period if gait else table.time.end
    model = build_chain(worm, start, links, float(rest.mean()) or 1.0, period)
    if isinstance(actuation, ConstantForce):
        held = per(actuation.force, worm.links)
        return replace(model, u=[replace(signal, value=held) for signal in model.u])
    if gait is None:
        return model
    command = gait_reference(gait, model.t, shift=shift % gait.period)
    # Eq. 11 of Zimmermann et al. 2007: c_j times the change of rest length, with the link's own
    # c_j.
    x = model["position"]
    stiffness = ca.diag(ca.jacobian(model["spring_force"], x)[:, : worm.links])
    return _with_input(model, command, stiffness * (command.value - rest))


def _with_input(model: Model, command: Reference, force: ca.SX) -> Model:
    error = TrackingError.of(model, command)
    closed = close(model, command, error, force, name="commanded rest lengths")
    kept = [o for o in closed.outputs if o.name not in ("reference", "error", "error_norm")]
    return replace(closed, outputs=[*kept, Output("command", command.value, "length")])


def _command(scene: Scene[SimulateScene], rest: np.ndarray) -> tuple[Gait | None, float]:
    """Commanded rest lengths, and their time shift."""
    actuation = scene.table.actuation
    if actuation is None or isinstance(actuation, ConstantForce):
        return None, 0.0
    if not isinstance(actuation, HarmonicChange):
        return gait_of_shape(actuation.gait, scene, "actuation.gait"), actuation.shift
    links = len(rest)
    amplitude = np.array(per(actuation.amplitude, links))
    behind = 2 * np.pi * actuation.lag * np.arange(1, links + 1)
    gait = Gait(
        np.array([0.0, actuation.period]),
        rest[None, :, None],
        np.array([2 * np.pi / actuation.period]),
        -(amplitude * np.sin(behind))[None, :],
        (amplitude * np.cos(behind))[None, :],
    )
    return gait, 0.0


# -- results -------------------------------------------------------------------------------------


def _unfinished(scene: Scene[SimulateScene], motion: Trajectory, why: str) -> Result:
    attributes = _attributes(scene, motion)
    return conclude(scene, {}, _signals(scene, motion), attributes=attributes).failed(why)


def _attributes(scene: Scene[SimulateScene], motion: Trajectory) -> dict[str, Any]:
    """Names of contacts, and of the signals in the picture."""
    model = motion.system.model
    shown = _SHOWN if scene.table.worm is not None else _own_signals(model)
    if not model.contacts:
        shown = [name for name in shown if name != "contact_force"]
    return {
        "contacts": [contact.name for contact in model.contacts],
        "signals": [*shown] if len(motion.time) else [],
    }


def _signals(scene: Scene[SimulateScene], motion: Trajectory) -> dict[str, Any]:
    model, events = motion.system.model, event_arrays([motion], several=False)
    if not len(motion.time):
        return events
    if scene.table.worm is None:
        return {"time": motion.time, **_own_variables(scene, motion), **events}
    expressions = chain_expressions(model)
    if any(output.name == "command" for output in model.outputs):
        expressions["command"] = model["command"]
    arrays = fitted(sample(motion, expressions), SimulateScene.variables)
    return {"time": motion.time, **arrays, **events}


def _own_signals(model: Model) -> dict[str, tuple[ca.SX, str]]:
    """Expression and unit of every named state and output of a user's model."""
    named = {s.name: (s.symbol, s.unit) for s in model.x}
    named |= {o.name: (o.expression, o.unit) for o in model.outputs}
    if model.contacts and "contact_force" not in named:
        named["contact_force"] = (model.forces, "force")
    return named


def _own_variables(scene: Scene[SimulateScene], motion: Trajectory) -> dict[str, Variable]:
    named = _own_signals(motion.system.model)
    values = sample(motion, {name: ca.vec(ca.densify(e)) for name, (e, _) in named.items()})
    found = {}
    for name, (_, quantity) in named.items():
        rows = values[name]
        alone = len(rows) == 1
        dims = ("time",) if alone else (f"{name}_entry", "time")
        unit = _unit(quantity, scene.table.units)
        found[name] = Variable(name, unit, dims, rows[0] if alone else rows, name)
    return found


def _unit(quantity: str, units: str) -> str:
    """Unit for the name of a quantity or of a unit."""
    if quantity in UNITS:
        return unit_of(quantity, units)
    return quantity if units == "SI" else "1"


def _scalars(scene: Scene[SimulateScene], motion: Trajectory) -> dict[str, Any]:
    if scene.table.worm is not None:
        return chain_numbers(motion)
    own = _own_variables(scene, motion)
    return {
        **{f"{name}_end": Scalar(v.values[..., -1], v.unit) for name, v in own.items()},
        "n_events": len(motion.events),
        "n_steps": motion.n_steps,
    }


def _warnings(
    scene: Scene[SimulateScene], motion: Trajectory, second: CrossCheck | None
) -> Iterator[str]:
    table = scene.table
    laws = (
        laws_of(table.worm)
        if table.worm is not None
        else [contact.law for contact in motion.system.contacts]
    )
    yield from warnings_of_contact(motion.system.treatment, laws)
    yield from warnings_of_motion(motion, second)
