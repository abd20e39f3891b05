"""The gear box as part of a Model, of prescribed strokes or of a chain that follows them.

A reference worm is shifted by measured loads. The current stroke, its coefficients, the gear, timer
and sums are discrete or simply increasing states. The only Switch is the end of a stroke, at which
the next stroke is read from the table.

A chain has links with springs. Its link lengths follow those of the reference by a lambda-tracker
with a feed-forward, which holds the springs at the reference lengths and adds the actuator forces
with which resting masses share the load equally. Links between resting masses keep their lengths at
any force, so without it each spike would keep its initial load. The forces of the chain are
measured. The supervisor decides by their sums. The feed-forward needs the load on each mass, which
is the unexplained part of these forces, averaged over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import Reference
from wormopt.model.model import Model, Output, Signal, Switch, pack
from wormopt.systems.chain import chain, law_of
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Ground
from wormopt.systems.gears.tables import Adaptive
from wormopt.systems.gears.walk import Supervisor

# Threshold that is never reached, and its negative for one that always is.
_FAR = 1e30
# Accepted relative error of the dwell time by rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Shifted:
    """Symbols of a reference worm that runs through strokes."""

    box: GearBox
    velocity: ca.SX  # (n+1, 1) of the masses
    acceleration: ca.SX  # (n+1, 1)
    resting: ca.SX  # (n+1, 1) 1 if the mass rests
    coefficient: ca.SX  # of the stroke, power by power
    row: ca.SX
    clock: ca.SX  # time since the stroke began
    duration: ca.SX
    gear: ca.SX
    wanted: ca.SX
    whole: ca.SX  # 1 if the gear has been used since its cycle began
    since: ca.SX  # time since the last shift
    stroke_sum: ca.SX  # of the spikes since the stroke began
    spike_sum: ca.SX  # since the cycle began, or the shift
    actuator_sum: ca.SX

    @classmethod
    def of(cls, box: GearBox) -> Shifted:
        """Make the symbols."""
        masses, powers = len(box.mass), box.degree + 1
        coefficient = ca.SX.sym("stroke", masses * powers)
        clock = ca.SX.sym("clock")
        velocity = acceleration = ca.SX(masses, 1)
        for power, part in enumerate(ca.vertsplit(coefficient, masses)):
            velocity += part * clock**power
            acceleration += power * part * clock ** max(power - 1, 0)
        names = ("row", "duration", "gear", "wanted", "whole", "since")
        names += ("stroke_sum", "spike_sum", "actuator_sum")
        return cls(
            box,
            velocity,
            acceleration,
            ca.SX.sym("stroke_resting", masses),
            coefficient,
            clock=clock,
            **{name: ca.SX.sym(name) for name in names},
        )

    def need(self, load: ca.SX, drag: ca.SX | float) -> ca.SX:
        """Force on each mass (n+1, 1) for its motion under `load` and `drag`."""
        return ca.DM(self.box.mass) * self.acceleration + drag * self.velocity + load

    def shared(self, need: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Load of each spike (n+1, 1), and actuator forces (n, 1), with equal sharing."""
        spike = self.resting * (ca.sum1(need) / ca.sum1(self.resting))
        return spike, ca.cumsum(spike - need)[:-1]

    def states(self, gear: int, dwell: float) -> list[Signal]:
        """States with initial values at the start of a cycle."""
        box, number = self.box, self.box.first_row(gear)
        table = _table(box)[number]
        size, masses = self.coefficient.numel(), len(box.mass)
        period = box.gears[gear].period
        return [
            Signal("stroke", self.coefficient, value=tuple(table[:size])),
            Signal("stroke_resting", self.resting, value=tuple(table[size : size + masses])),
            Signal("row", self.row, value=float(number)),
            Signal("clock", self.clock, "time", period, value=0.0),
            Signal("duration", self.duration, "time", period, value=float(table[size + masses])),
            Signal("gear", self.gear, value=float(gear)),
            Signal("wanted", self.wanted, value=float(gear)),
            Signal("whole", self.whole, value=1.0),
            Signal("since", self.since, "time", period, value=dwell),
            Signal("stroke_sum", self.stroke_sum, "impulse", value=0.0),
            Signal("spike_sum", self.spike_sum, "impulse", value=0.0),
            Signal("actuator_sum", self.actuator_sum, "effort", value=0.0),
        ]

    def rates(self, spike: ca.SX, actuator: ca.SX) -> ca.SX:
        """Time derivatives of the states.

        `spike` is the measured load of all spikes, `actuator` the measured sum of squared forces.
        """
        held = ca.SX(self.coefficient.numel() + self.resting.numel(), 1)
        none, one = ca.SX(1, 1), ca.SX(1)
        return ca.vertcat(held, none, one, none, none, none, none, one, spike, spike, actuator)

    def reset(self, supervisor: Supervisor) -> ca.SX:
        """The states after the end of a stroke."""
        box = self.box
        rows = box.rows
        now = _one_hot(self.row, len(rows))
        ends = ca.dot(now, ca.DM([row.ends_cycle for row in rows]))
        alarm = ca.dot(now, ca.DM(np.minimum(supervisor.alarm, _FAR)))
        wanted = self._wanted(supervisor, ends, self.stroke_sum > alarm)
        kept, slower, faster = (
            ca.dot(now, ca.DM([_number(getattr(row, name)) for row in rows]))
            for name in ("follows", "slower", "faster")
        )
        leaves = ca.logic_and(wanted < self.gear, slower >= 0)
        climbs = ca.logic_and(wanted > self.gear, faster >= 0)
        following = ca.if_else(leaves, slower, ca.if_else(climbs, faster, kept))
        then = _one_hot(following, len(rows))
        stroke = ca.mtimes(ca.sparsify(ca.DM(_table(box))).T, then)
        gear = ca.dot(then, ca.DM([row.gear for row in rows]))
        same = ca.eq(gear, self.gear)
        goes_on = ca.if_else(ends, 0, same)  # whether the sums continue
        whole = ca.if_else(same, ca.fmax(self.whole, ends), 0)
        return ca.vertcat(
            stroke[:-1],
            following,
            0,
            stroke[-1],
            gear,
            wanted,
            whole,
            same * self.since,
            0,
            goes_on * self.spike_sum,
            goes_on * self.actuator_sum,
        )

    def _wanted(self, supervisor: Supervisor, ends: ca.SX, alarmed: ca.SX) -> ca.SX:
        """Wanted gear, decided at the end of a whole cycle or on an alarm."""
        gears = self.box.gears
        now = _one_hot(self.gear, len(gears))
        period = ca.dot(now, ca.DM([gear.period for gear in gears]))
        limits = {
            name: ca.dot(now, ca.DM(np.clip(getattr(supervisor, name), -_FAR, _FAR)))
            for name in ("spike_down", "spike_up", "actuator_down", "actuator_up")
        }
        spike, actuator = self.spike_sum / period, self.actuator_sum / period
        high = ca.logic_or(spike > limits["spike_down"], actuator > limits["actuator_down"])
        low = ca.logic_and(spike < limits["spike_up"], actuator < limits["actuator_up"])
        decided = self.gear + ca.if_else(high, -1, ca.if_else(low, 1, 0))
        ripe = self.since >= supervisor.dwell * (1 - _ROUNDING)
        wanted = ca.if_else(ends * self.whole * ripe, decided, self.wanted)
        return ca.if_else(alarmed * ripe, ca.fmin(wanted, self.gear - 1), wanted)


def _one_hot(symbol: ca.SX, count: int) -> ca.SX:
    return ca.vertcat(*(ca.eq(symbol, k) for k in range(count)))


def _number(row: int | None) -> float:
    return -1.0 if row is None else float(row)


def _table(box: GearBox) -> np.ndarray:
    """Coefficients, resting masses and duration of every row, (rows, numbers)."""
    masses, powers = len(box.mass), box.degree + 1
    table = np.zeros((len(box.rows), masses * powers + masses + 1))
    for number, row in enumerate(box.rows):
        velocity = row.stroke.velocity
        table[number, : velocity.size] = velocity.T.ravel()
        table[number, [masses * powers + i for i in row.stroke.resting]] = 1.0
        table[number, -1] = row.stroke.duration
    return table


def geared_worm(
    box: GearBox,
    ground: Ground,
    supervisor: Supervisor,
    *,
    gear: int,
    begin: np.ndarray,
    goal: float,
) -> Model:
    """Make the Model of a worm with spikes whose lengths follow the strokes exactly.

    It starts with a cycle of `gear` at positions `begin` (n+1,). The motion ends when the mean of
    the masses reaches `goal`. Outputs: ``velocity``, ``spike_total`` (the worm would glide below
    0), ``spike_load``, ``actuator_force``.
    """
    shifted, masses = Shifted.of(box), len(box.mass)
    place = ca.SX.sym("position", masses)
    need = shifted.need(ground.pull_expression(place), ground.expression("drag", place))
    total, (spike, force) = ca.SX(ca.sum1(need)), shifted.shared(need)
    states = shifted.states(gear, supervisor.dwell)
    x = [Signal("position", place, "length", value=tuple(begin.tolist())), *states]
    return Model(
        name=f"worm of {masses} masses with {len(box.gears)} gears",
        x=x,
        ode=ca.vertcat(shifted.velocity, shifted.rates(total, ca.sumsqr(force))),
        outputs=[
            Output("velocity", shifted.velocity, "speed"),
            Output("spike_total", total, "force"),
            Output("spike_load", spike, "force"),
            Output("actuator_force", force, "force"),
            Output("length", place[:-1] - place[1:], "length"),
        ],
        switches=[
            Switch(
                "a stroke ends",
                shifted.clock - shifted.duration,
                ca.vertcat(place, shifted.reset(supervisor)),
            ),
            arrives(place, x, goal),
        ],
    )


def arrives(place: ca.SX, states: Sequence[Signal], goal: float) -> Switch:
    """Switch at the end of the motion, when the mean position reaches the goal."""
    own = ca.vertcat(*(signal.symbol for signal in states))
    return Switch("arrives", ca.sum1(place) / place.numel() - goal, own, terminal=True)


def geared_chain(
    box: GearBox,
    ground: Ground,
    supervisor: Supervisor,
    links: Adaptive,
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
    plant = _held(_on_ground(_worm(box, links, gear, begin), ground), wanted, rate, shared)
    forces, nominal = plant["link_force"], plant.x[0].nominal
    felt = plant.forces + ca.vertcat(0, forces) - ca.vertcat(forces, 0)
    states = [
        Signal("reference_position", ahead, "length", nominal, value=tuple(begin.tolist())),
        Signal("believed_load", believed, "force", value=tuple(ground.pull(begin).tolist())),
        *shifted.states(gear, supervisor.dwell),
    ]
    x = [*plant.x, *states]
    memory = links.memory or min(each.period for each in box.gears) / 4
    rates = (
        shifted.velocity,
        (felt - shifted.need(ca.SX(masses, 1), drag) - believed) / memory,
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
        tube_radius=links.tube_radius,
        gain_start=links.gain_start,
        adaptation=Quadratic(links.growth),
        output="length_error",
    )


def _worm(box: GearBox, links: Adaptive, gear: int, begin: np.ndarray) -> Model:
    """The chain without control; its springs are free of force at the mean initial length."""
    length = float(box.gears[gear].lengths[0].mean())
    return chain(
        len(box.mass) - 1,
        mass=box.mass,
        stiffness=links.stiffness,
        damping=links.damping,
        rest_length=length,
        law=law_of(links.friction),
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
