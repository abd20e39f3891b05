"""The gear-shifting worm as a chain: links with springs that follow the strokes by a tracker.

A reference worm runs through the strokes. The chain's link lengths follow those of the reference by
a lambda-tracker with a feed-forward. The feed-forward holds the springs at the reference lengths
and
adds the actuator forces with which resting masses share the load equally. Links between resting
masses keep their lengths at any force, so without it each spike would keep its initial load.

The forces of the chain are measured. The supervisor decides by their sums. The feed-forward needs
the load on each mass, which is the unexplained part of these forces, averaged over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import Reference
from wormopt.model.friction import Law
from wormopt.model.model import Model, Output, Signal, Switch, pack
from wormopt.systems.chain import chain
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.model import Shifted, arrives
from wormopt.systems.gears.supervisor import Supervisor


@dataclass(frozen=True, eq=False)
class Body:
    """Parameters of the links and of their adaptive control."""

    stiffness: float  # of each link
    damping: float  # of each link
    law: Law  # of every mass on the ground
    tube_radius: float
    gain_start: float
    growth: float
    memory: float  # averaging time of measured loads


def geared_chain(
    box: GearBox,
    ground: Ground,
    supervisor: Supervisor,
    body: Body,
    *,
    gear: int,
    begin: np.ndarray,
    goal: float,
) -> Model:
    """Close the loop of a chain of links that follows the strokes of a gear box.

    It starts at positions `begin` (n+1,) at rest, with a cycle of `gear` and a known load. The
    motion ends when the mean of the masses reaches `goal`. States: the chain's,
    ``reference_position``, those of the gear box, ``believed_load``, ``gain``.
    """
    shifted, masses, drag = Shifted.of(box), len(box.mass), box.gears[0].drag
    ahead, believed = (ca.SX.sym(name, masses) for name in ("reference_position", "believed_load"))
    wanted, rate = ahead[:-1] - ahead[1:], shifted.velocity[:-1] - shifted.velocity[1:]
    _, shared = shifted.shared(shifted.need(believed, drag))
    plant = _held(_on_ground(_worm(box, body, gear, begin), ground), wanted, rate, shared)
    forces, nominal = plant["link_force"], plant.x[0].nominal
    felt = plant.forces + ca.vertcat(0, forces) - ca.vertcat(forces, 0)
    states = [
        Signal("reference_position", ahead, "length", nominal, value=tuple(begin.tolist())),
        Signal("believed_load", believed, "force", value=tuple(ground.pull(begin).tolist())),
        *shifted.states(gear, supervisor.dwell),
    ]
    x = [*plant.x, *states]
    rates = (
        shifted.velocity,
        (felt - shifted.need(ca.SX(masses, 1), drag) - believed) / body.memory,
        shifted.rates(ca.dot(shifted.resting, plant.forces), ca.sumsqr(forces)),
    )
    reset = ca.vertcat(pack(plant.x), ahead, believed, shifted.reset(supervisor))
    driven = replace(
        plant,
        name=f"chain of {masses - 1} links with {len(box.gears)} gears",
        x=x,
        ode=ca.vertcat(plant.ode, *rates),
        outputs=[
            *plant.outputs,
            Output("reference_length", wanted, "length"),
            Output("length_error", plant["length"] - wanted, "length"),
        ],
        switches=[
            Switch("a stroke ends", shifted.clock - shifted.duration, reset),
            arrives(plant["position"], x, goal),
        ],
    )
    none = ca.SX.zeros(masses - 1)
    return lambda_tracker(
        driven,
        Reference(none, none, none),
        tube_radius=body.tube_radius,
        gain_start=body.gain_start,
        adaptation=Quadratic(body.growth),
        output="length_error",
    )


def _worm(box: GearBox, body: Body, gear: int, begin: np.ndarray) -> Model:
    """The chain without control; its springs are free of force at the mean initial length."""
    length = float(box.gears[gear].lengths[0].mean())
    return chain(
        len(box.mass) - 1,
        mass=box.mass,
        stiffness=body.stiffness,
        damping=body.damping,
        rest_length=length,
        law=body.law,
        position=begin,
        length_nominal=length,
        time_nominal=box.gears[gear].period,
    )


def _on_ground(worm: Model, ground: Ground) -> Model:
    place, known = worm["position"], ("load", "drag")
    met = ground.pull_expression(place), ground.expression("drag", place)
    left = [signal for signal in worm.p if signal.name not in known]
    return replace(_put(worm, [worm[name] for name in known], met), p=left)


def _held(worm: Model, wanted: ca.SX, rate: ca.SX, shared: ca.SX) -> Model:
    """Add to the input the forces that hold the springs while actuators carry `shared` (n, 1)."""
    held = worm["stiffness"] * (wanted - worm["rest_length"]) + worm["damping"] * rate
    return _put(worm, [worm["input"]], [worm["input"] + held - shared])


def _put(worm: Model, symbols: Sequence[ca.SX], values: Sequence[ca.SX]) -> Model:
    """Replace symbols of a model without switches by expressions."""
    expressions = [worm.ode, *(output.expression for output in worm.outputs)]
    ode, *shown = ca.substitute(expressions, [*symbols], [*values])
    outputs = [replace(o, expression=e) for o, e in zip(worm.outputs, shown, strict=True)]
    put = copy(worm)  # not `replace`, which refuses symbols that the caller still declares
    for name, part in (("ode", ode), ("outputs", outputs)):
        object.__setattr__(put, name, part)
    return put
