"""Controllers that act by hardware: sensors with noise and delay, a clock, actuators."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from wormopt.control.loop import Reference, feed, gait_reference, input_of, saturated
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.given import check_number
from wormopt.model.model import TINY, Model, Output, Signal, Switch, lie, pack
from wormopt.model.schedule import Delay

NOISE = "noise"
"""Name of the schedule with the values that sensors add."""

_NONE = ca.SX(0, 1)
_TRIES = 3  # random states at which a controller is tested
_TRUE = ("reference", "error", "error_norm")


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


def through_hardware(
    plant: Model,
    loop: Model,
    *,
    noise: Gait | None = None,
    delay: float = 0.0,
    period: float | None = None,
    rate: float = math.inf,
    output_step: float = 0.0,
    input_step: float = 0.0,
    output: str = "length",
    input: str = "input",  # noqa: A002
) -> Model:
    """Let the controller of a closed loop act by sensors and actuators, and by a clock.

    `loop` is a loop closed around `plant`, whose states come first, or the plant driven by inputs
    over time. The controller's force, rates and switches use the signal seen instead of the plant's
    states, y(t - delay) + noise(t) and its rate; ``error`` and ``error_norm`` remain those of the
    plant. Before time 0 the output is that at time 0; `noise` has a row for each entry of y.

    Forces are cut to the bounds of the plant's input, whatever the controller commands.

    With a `period`, the controller measures and decides at its multiples from 0 on. Between them
    the signal seen and the force are held; its own states and the reference continue. Lengths are
    rounded to multiples of `output_step`, and rates are then differences of rounded lengths,
    0 at first; forces are rounded to multiples of `input_step`. Actuators start at 0 and approach
    the force at most at `rate`, in every scalar of the input.

    Adds the output or state ``seen`` (y and y'), with a delay the parameter ``measurement_delay``,
    with noise the schedule ``noise``, with a period the states ``held_input``, ``input_before``
    (where the rate is limited) and ``next_sample``.
    """
    _check(delay, period, rate, output_step, input_step)
    x, n, y = pack(plant.x), plant.n_x, plant[output]
    switches, memories = loop.switches[len(plant.switches) :], loop.delays[len(plant.delays) :]
    acts = ca.vertcat(loop[input], loop.ode[n:], *(switch.guard for switch in switches))
    if not ca.depends_on(acts, x):
        noise, delay = None, 0.0  # an open loop measures nothing
    own = ca.vertcat(y, lie(plant, y))
    measured, late = _late(own, delay)
    course = _noise(plant, noise, y.numel())
    if course is not None:
        measured += ca.vertcat(course.value, course.rate)
    if late and memories:
        raise ArgumentError(f"{loop.name} already has delays; leave out the delay of sensors")
    slopes, offset = _slopes(plant, own)
    states_of = _inverse(slopes)  # of least norm with these y and y'
    _check_seen(loop, acts, x, ca.SX.eye(n) - states_of @ slopes, output)

    def put(expression: ca.SX, known: ca.SX) -> ca.SX:
        return ca.substitute(expression, x, states_of @ (known - offset))

    signal = input_of(plant, loop[input].numel(), input)

    def decided(known: ca.SX) -> ca.SX:
        raw = put(loop[input], known)
        limited = saturated(signal, raw)[0]
        # a limit would hide that, at some parameters, the output does not determine the command
        return ca.if_else(ca.fabs(raw) < ca.inf, limited, raw) if ca.symvar(slopes) else limited

    if period is None:
        states, ticks, outputs = [], [], [Output("seen", measured)]
        seen, force = measured, decided(measured)
    else:
        clock = _Clock(signal, y.numel(), period, rate, loop.t)
        tick = clock.tick(pack(loop.x), decided, measured, output_step, input_step)
        states, ticks, outputs = clock.states, [tick], []
        seen, force = clock.seen.symbol, clock.force
    fed = feed(plant, [signal], force)
    known = [*(o for o in loop.outputs if o.name in _TRUE), *fed.outputs]
    shown = {o.name: o for o in (*known, Output(input, force, signal.unit))}
    beyond = ca.vertcat(_NONE, *(s.symbol for s in states))
    after = ca.vertcat(pack(loop.x)[n:], beyond)
    return replace(
        loop,
        name=f"{loop.name}, by hardware",
        x=[*loop.x, *states],
        ode=ca.vertcat(fed.ode, put(loop.ode[n:], seen), ca.SX.zeros(beyond.numel())),
        p=[*loop.p, *(lag for _, lag in late)],
        outputs=[
            *(
                shown.get(o.name) or replace(o, expression=put(o.expression, seen))
                for o in loop.outputs
            ),
            *outputs,
        ],
        switches=[
            *(replace(s, reset=ca.vertcat(s.reset, after)) for s in fed.switches),
            *(_seen_switch(s, lambda e: put(e, seen), n, beyond) for s in switches),
            *ticks,
        ],
        schedules=[*loop.schedules, *(course.schedules if course else ())],
        delays=[
            *plant.delays,
            *(replace(d, signal=put(d.signal, measured)) for d in memories),
            *(past for past, _ in late),
        ],
    )


def _check(
    delay: float, period: float | None, rate: float, output_step: float, input_step: float
) -> None:
    check_number("delay", delay, least=0.0)
    check_number("output_step", output_step, least=0.0)
    check_number("input_step", input_step, least=0.0)
    if rate != math.inf:
        check_number("rate", rate, above=0.0)
    if period is not None:
        check_number("period", period, above=0.0)
    elif rate != math.inf or output_step or input_step:
        raise ArgumentError(
            "rate, output_step and input_step need a sampled controller; write period= too"
        )


class _Clock:
    """States and switch of a controller that decides at multiples of a period."""

    def __init__(
        self, signal: Signal, entries: int, period: float, rate: float, time: ca.SX
    ) -> None:
        self.signal, self.period, self.time = signal, period, time
        held = replace(signal, name="held_input", symbol=ca.SX.sym("held_input", signal.size))
        held = replace(held, lower=-math.inf, upper=math.inf, value=0.0)
        self.seen = Signal("seen", ca.SX.sym("seen", 2 * entries), value=0.0)
        self.next = Signal("next_sample", ca.SX.sym("next_sample"), "time", value=0.0)
        self.limited: list[Signal] = []
        self.force = held.symbol
        if rate < math.inf:
            before = ca.SX.sym("before", signal.size)
            self.limited = [replace(held, name="input_before", symbol=before)]
            # not below 0 by rounding, which a rate that means none would magnify
            way = rate * ca.fmax(time - self.next.symbol + period, 0.0)
            self.force = before + ca.fmax(-way, ca.fmin(way, held.symbol - before))
        self.states = [self.seen, held, *self.limited, self.next]

    def tick(
        self,
        kept: ca.SX,
        decided: Callable[[ca.SX], ca.SX],
        measured: ca.SX,
        output_step: float,
        input_step: float,
    ) -> Switch:
        """The switch of a sample; `kept`: states without those of the clock."""
        begin, m = self.next.symbol, self.seen.size // 2
        if output_step:
            y = _rounded(measured[:m], output_step)
            rates = (y - self.seen.symbol[:m]) / self.period
            measured = ca.vertcat(y, ca.if_else(begin > 0, rates, 0))
        force = decided(measured)
        if input_step:
            force, _ = saturated(self.signal, _rounded(force, input_step))
        before = [self.force for _ in self.limited]
        reset = ca.vertcat(kept, measured, force, *before, begin + self.period)
        return Switch("sample", self.time - begin, reset)


def _rounded(values: ca.SX, step: float) -> ca.SX:
    return step * ca.floor(values / step + 0.5)


def _late(own: ca.SX, delay: float) -> tuple[ca.SX, list[tuple[Delay, Signal]]]:
    """Outputs of sensors without noise, and the additions to a model."""
    if not delay:
        return own, []
    past, lag = ca.SX.sym("past_output", own.numel()), ca.SX.sym("measurement_delay")
    signal = Signal("measurement_delay", lag, "time", lower=TINY, value=delay)
    return past, [(Delay("past_output", past, own, lag), signal)]


def _noise(plant: Model, noise: Gait | None, entries: int) -> Reference | None:
    if noise is None:
        return None
    if noise.links != entries:
        what = f"write {entries}, one per entry of the output"
        raise ArgumentError(f"noise has {noise.links} rows; {what}")
    return gait_reference(noise, plant.t, periodic=False, name=NOISE)


def _slopes(plant: Model, own: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Matrix from the states to y and y', and their values at states 0."""
    x = pack(plant.x)
    if not ca.is_linear(own, x):
        raise ArgumentError(
            f"the output of {plant.name} and its rate are not linear in its states, which sensors "
            "and sampling need; choose another output"
        )
    return ca.jacobian(own, x), ca.substitute(own, x, 0)


def _inverse(slopes: ca.SX) -> ca.SX:
    """Pseudoinverse; if it depends on parameters, of independent rows only."""
    known = ca.symvar(slopes)
    if not known:
        return ca.SX(np.linalg.pinv(ca.evalf(slopes).full()))
    dense = ca.densify(slopes)
    some = ca.Function("slopes", [ca.vertcat(*known)], [dense])
    drawn = np.random.default_rng(0).uniform(0.5, 1.5, len(known))
    if np.linalg.matrix_rank(some(drawn).full()) < slopes.size1():
        raise ArgumentError(
            "entries of the output and its rate depend on each other, and their coefficients are "
            "parameters; choose fewer entries"
        )
    return ca.densify(ca.pinv(dense))


def _check_seen(loop: Model, acts: ca.SX, x: ca.SX, hidden: ca.SX, output: str) -> None:
    """Refuse a controller that uses more of the plant than y and y', by derivatives.

    Columns of `hidden` span the changes of states that change neither.
    """
    change = ca.vertcat(_NONE, *(ca.jtimes(acts, x, way) for way in ca.horzsplit(hidden)))
    symbols = ca.vertcat(_NONE, *ca.symvar(ca.vertcat(change, acts)))
    function = ca.Function("change", [symbols], [ca.densify(change), ca.densify(acts)])
    random = np.random.default_rng(0)
    for _ in range(_TRIES):
        off, size = (
            np.abs(np.array(part)) for part in function(random.uniform(0.5, 1.5, symbols.numel()))
        )
        if np.any(off > 1e-9 * (1 + np.nanmax(size, initial=0.0))):
            raise ArgumentError(
                f"the controller of {loop.name} uses more of the plant than {output} and its rate, "
                "but sensors measure only these"
            )


def _seen_switch(switch: Switch, put: Callable[[ca.SX], ca.SX], n: int, beyond: ca.SX) -> Switch:
    """A controller's switch under another name: its guard uses the signal seen."""
    reset = ca.vertcat(switch.reset[:n], put(switch.reset[n:]), beyond)
    return replace(switch, name=f"{switch.name}, as seen", guard=put(switch.guard), reset=reset)
