"""Controllers that see a plant through sensors with noise and delay."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from wormopt.control.loop import Reference, feed, gait_reference, input_of
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import TINY, Model, Output, Signal, Switch, lie, pack
from wormopt.model.schedule import Delay

NOISE = "noise"
"""Name of the schedule with the values that sensors add."""

_TRUE = ("reference", "error", "error_norm")


@dataclass(frozen=True, eq=False)
class Sensors:
    """Output y of a plant as a controller sees it: y(t - delay) + noise(t), and its rate.

    The rate is that of the signal seen, y'(t - delay) + noise'(t). Before time 0 the output is
    that at time 0. Raises ArgumentError if the delay is negative or not finite.
    """

    noise: Gait | None = None  # a row for each entry of y; held at its ends
    delay: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.delay < math.inf:
            raise ArgumentError(f"delay must be finite and not negative, not {self.delay!r}")


def band_limited(
    deviation: float, interval: float, end: float, entries: int, seed: int | Sequence[int]
) -> Gait:
    """Noise that is smooth between samples: normal numbers every `interval`, joined by cubics.

    It has hardly anything above the frequency 1 / (2 interval), and a continuous rate. `deviation`
    is that of the samples, from time 0 until `end` at least; the same seed gives the same noise.
    """
    count = max(math.ceil(end / interval * (1 - 1e-12)), 1)
    normal = np.random.default_rng(seed).standard_normal((count + 1, entries))
    curve = CubicSpline(interval * np.arange(count + 1), deviation * normal)
    return Gait(curve.x, curve.c[::-1].transpose(1, 2, 0))


def through_sensors(
    plant: Model,
    loop: Model,
    sensors: Sensors,
    output: str = "length",
    input: str = "input",  # noqa: A002
) -> Model:
    """Let the controller of a closed loop see the plant's output through sensors.

    `loop` is a loop closed around `plant`, whose states come first. The controller's force, rates
    and switches use the signal seen instead of the plant's states; ``error`` and ``error_norm``
    remain those of the plant. Adds the output ``seen`` (y and y'), with
    a delay the parameter ``measurement_delay``, with noise the schedule ``noise``.
    Raises ArgumentError if the output is not linear in the states with constant coefficients, if
    noise lacks a row for each entry, or if the loop has delays of the delayed signal.
    """
    x, n = pack(plant.x), plant.n_x
    y = plant[output]
    own = ca.vertcat(y, lie(plant, y))
    seen, late = _late(own, sensors)
    noise = _noise(plant, sensors, y.numel())
    if noise is not None:
        seen += ca.vertcat(noise.value, noise.rate)
    believed = _states_of(plant, own) @ seen
    memories = loop.delays[len(plant.delays) :]
    if late and memories:
        raise ArgumentError(f"{loop.name} has delays already; leave the delay of sensors out")

    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, x, believed)

    force = put(loop[input])
    fed = feed(plant, [input_of(plant, force.numel(), input)], force)
    outputs = {o.name: o for o in fed.outputs}
    switches = loop.switches[len(plant.switches) :]
    return replace(
        loop,
        name=f"{loop.name}, through sensors",
        ode=ca.vertcat(fed.ode, put(loop.ode[n:])),
        p=[*loop.p, *(signal for _, signal in late)],
        outputs=[
            *(
                outputs.get(o.name, o)
                if o.name in outputs or o.name in _TRUE
                else Output(o.name, put(o.expression), o.unit)
                for o in loop.outputs
            ),
            Output("seen", seen),
        ],
        switches=[
            *(
                replace(s, reset=ca.vertcat(s.reset, pack(loop.x)[n:]))
                for s in fed.switches
            ),
            *(_seen_switch(s, put, n) for s in switches),
        ],
        schedules=[*loop.schedules, *(noise.schedules if noise else ())],
        delays=[
            *plant.delays,
            *(replace(d, signal=put(d.signal)) for d in memories),
            *(delay for delay, _ in late),
        ],
    )  # fmt: skip


def _late(own: ca.SX, sensors: Sensors) -> tuple[ca.SX, list[tuple[Delay, Signal]]]:
    """Outputs of sensors without noise, and the additions to a model."""
    if not sensors.delay:
        return own, []
    past, lag = ca.SX.sym("past_output", own.numel()), ca.SX.sym("measurement_delay")
    signal = Signal("measurement_delay", lag, "time", lower=TINY, value=sensors.delay)
    return past, [(Delay("past_output", past, own, lag), signal)]


def _noise(plant: Model, sensors: Sensors, entries: int) -> Reference | None:
    if sensors.noise is None:
        return None
    if sensors.noise.links != entries:
        raise ArgumentError(f"noise has {sensors.noise.links} rows, the output {entries} entries")
    return gait_reference(sensors.noise, plant.t, periodic=False, name=NOISE)


def _states_of(plant: Model, own: ca.SX) -> ca.DM:
    """Matrix from y and y' to the states of least norm that have them."""
    x = pack(plant.x)
    slopes = ca.jacobian(own, x)
    offset = ca.simplify(own - slopes @ x)
    if ca.symvar(slopes) or not offset.is_zero():
        raise ArgumentError(f"the output of {plant.name} is not linear in its states alone")
    return ca.DM(np.linalg.pinv(ca.evalf(slopes).full()))


def _seen_switch(switch: Switch, put: Callable[[ca.SX], ca.SX], n: int) -> Switch:
    """A controller's switch under another name: its guard uses the signal seen."""
    reset = ca.vertcat(switch.reset[:n], put(switch.reset[n:]))
    return replace(switch, name=f"{switch.name}, as seen", guard=put(switch.guard), reset=reset)
