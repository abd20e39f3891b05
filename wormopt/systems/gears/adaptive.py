"""The worm that shifts by itself as a chain: links with springs, held to the strokes by a tracker.

A reference worm runs through the strokes; the chain's link lengths follow its own by a
lambda-tracker, beside the force that would hold them there. What the supervisor measures are the
forces of the chain itself, and the ground is met where the chain's own masses are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.reference import Reference
from wormopt.model.friction import Law
from wormopt.model.model import Model, Output, Signal, Switch
from wormopt.systems.chain import chain
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.model import Shifted, arrives
from wormopt.systems.gears.supervisor import Supervisor


@dataclass(frozen=True, eq=False)
class Body:
    """What the links are made of, and how their tracker adapts."""

    stiffness: float  # of each link
    damping: float  # of each link
    law: Law  # of every mass on the ground
    tube_radius: float
    gain_start: float
    growth: float


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

    It begins at places `begin` (n+1,) at rest, with a cycle of `gear`; the motion ends where the
    mean of the masses reaches `goal`. States: the chain's, ``reference_position``, those of the
    gear box, ``gain``.
    """
    shifted, masses = Shifted.of(box), len(box.mass)
    lengths = box.gears[gear].lengths[0]
    worm = chain(
        masses - 1,
        mass=box.mass,
        stiffness=body.stiffness,
        damping=body.damping,
        rest_length=lengths.mean(),
        law=body.law,
        position=begin,
        length_nominal=float(lengths.mean()),
        time_nominal=box.gears[gear].period,
    )
    ahead = ca.SX.sym("reference_position", masses)
    wanted, rate = ahead[:-1] - ahead[1:], shifted.velocity[:-1] - shifted.velocity[1:]
    plant = _on_ground(worm, ground, wanted, rate)
    nominal = plant.x[0].nominal
    states = [
        Signal("reference_position", ahead, "length", nominal, value=tuple(begin.tolist())),
        *shifted.states(gear, supervisor.dwell),
    ]
    held = ca.vertcat(*(signal.symbol for signal in plant.x))
    spike, forces = ca.sum1(plant.forces), plant["link_force"]
    x = [*plant.x, *states]
    driven = replace(
        plant,
        name=f"chain of {masses - 1} links with {len(box.gears)} gears",
        x=x,
        ode=ca.vertcat(plant.ode, shifted.velocity, shifted.rates(spike, ca.sumsqr(forces))),
        outputs=[
            *plant.outputs,
            Output("reference_length", wanted, "length"),
            Output("length_error", plant["length"] - wanted, "length"),
        ],
        switches=[
            Switch(
                "a stroke ends",
                shifted.clock - shifted.duration,
                ca.vertcat(held, ahead, shifted.reset(supervisor)),
            ),
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


def _on_ground(worm: Model, ground: Ground, wanted: ca.SX, rate: ca.SX) -> Model:
    """Put the ground under the chain, and the force that would hold its links as wanted."""
    place, masses = worm["position"], worm["position"].numel()
    load = ground.expression("load", place)
    load[masses - 1] += ground.expression("towed", place[masses - 1])
    hold = worm["stiffness"] * (wanted - worm["rest_length"]) + worm["damping"] * rate
    known = {
        "load": load,
        "drag": ground.expression("drag", place),
        "input": worm["input"] + hold,
    }
    expressions = [worm.ode, *(output.expression for output in worm.outputs)]
    ode, *shown = ca.substitute(expressions, [worm[name] for name in known], [*known.values()])
    return replace(
        worm,
        ode=ode,
        p=[signal for signal in worm.p if signal.name not in ("load", "drag")],
        outputs=[replace(o, expression=e) for o, e in zip(worm.outputs, shown, strict=True)],
    )
