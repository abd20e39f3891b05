"""Common parts of closed loops: the reference, the tracking error, a plant with inserted inputs."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.model.given import check_choice, check_kind
from wormopt.model.model import Model, Output, Signal, Switch, lie, pack
from wormopt.model.schedule import Delay, Schedule
from wormopt.model.values import numbers_of


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of outputs, as expressions of time.

    Parameters
    ----------
    value, rate, acceleration : casadi.SX, shape (n, 1)
        Reference and its time derivatives.
    schedule : Schedule, optional
        Gives the symbols in them their values, piece by piece.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> swing = Reference(2 + ca.sin(worm.t), ca.cos(worm.t), -ca.sin(worm.t))
    >>> loop = wo.lambda_tracker(worm, swing, tube_radius=0.2)
    >>> [signal.name for signal in loop.x]
    ['position', 'velocity', 'gain']
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    schedule: Schedule | None = None

    @property
    def schedules(self) -> tuple[Schedule, ...]:
        """The schedule, if there is one."""
        return () if self.schedule is None else (self.schedule,)


def gait_reference(
    gait: Gait,
    time: ca.SX,
    *,
    shift: float = 0.0,
    periodic: bool = True,
    name: str = "reference",
) -> Reference:
    """Make the reference whose value at time t is that of the gait at t + shift.

    Parameters
    ----------
    gait : Gait
        Link lengths; they may have corners and jumps at breaks.
    time : casadi.SX
        The model's symbol of time.
    shift : float, optional
        Time shift of the gait, positive if it is ahead.
    periodic : bool, optional
        Whether the gait repeats. Otherwise it runs once; its first value is held before, its last
        value after.
    name : str, optional
        Name of the schedule.

    Returns
    -------
    Reference
        With a schedule, by which solvers stop at every break. Gaits with as many pieces, links
        and powers share one compiled model.

    Raises
    ------
    ArgumentError
        If ``shift`` is not finite.

    Examples
    --------
    >>> import casadi as ca
    >>> gait = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[1.0, 0.5]], [[1.5, -0.5]]]))
    >>> reference = gait_reference(gait, ca.SX.sym("t"), shift=0.25)
    >>> reference.schedule.values, reference.schedule.start
    (array([[ 1. ,  0.5],
           [ 1.5, -0.5]]), -0.25)
    """
    if not np.isfinite(shift):
        raise ArgumentError("shift must be finite")
    start = -float(np.mod(shift, gait.period)) if periodic else -shift - gait.period
    if not periodic:
        gait = _with_held_ends(gait)
    pieces, n, powers = gait.polynomial.shape
    parts = [gait.polynomial.transpose(0, 2, 1).reshape(pieces, -1)]
    if gait.omega is not None and gait.cosine is not None and gait.sine is not None:
        parts += [gait.omega[:, None], gait.cosine, gait.sine]
    values = np.hstack(parts)

    symbol, begin = ca.SX.sym(name, values.shape[1]), ca.SX.sym(f"{name}_begin")
    s = time - begin
    coefficients = ca.vertsplit(symbol[: n * powers], n)
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * s + coefficient
    if gait.omega is not None:
        omega, cosine, sine = ca.vertsplit(symbol[n * powers :], [0, 1, 1 + n, 1 + 2 * n])
        value += cosine * ca.cos(omega * s) + sine * ca.sin(omega * s)
    rate = ca.jacobian(value, time)
    schedule = Schedule(name, symbol, begin, gait.breaks, values, periodic, start)
    return Reference(value, rate, ca.jacobian(rate, time), schedule)


def _with_held_ends(gait: Gait) -> Gait:
    """The gait between two pieces of its length that hold its first and its last value."""
    # A polynomial continued beyond its piece would grow.
    last = gait.period - gait.breaks[-2:-1]
    first, end = np.zeros((2, 1, *gait.polynomial.shape[1:]))
    first[0, :, :1], end[0, :, :1] = gait.on_piece(0, np.zeros(1)), gait.on_piece(-1, last)
    breaks = gait.period + np.concatenate([[-gait.period], gait.breaks, [2 * gait.period]])
    polynomial = np.concatenate([first, gait.polynomial, end])
    if gait.omega is None or gait.cosine is None or gait.sine is None:
        return Gait(breaks, polynomial)
    cosine, sine = (np.pad(part, ((1, 1), (0, 0))) for part in (gait.cosine, gait.sine))
    return Gait(breaks, polynomial, np.pad(gait.omega, 1), cosine, sine)


Actuator = Literal["force", "rest_length"]
"""Command of a controller: the force u, or by (11) the change l of rest lengths, u = c l."""

# Relative real part of an eigenvalue that is 0; number of listed eigenvalues.
_SINGULAR, _LISTED = 1e-12, 4
_RATES = {"length": "speed", "angle": "angular_frequency", "share": "rate"}


@dataclass(frozen=True, eq=False)
class FeedForward:
    """Force that holds links with these parameters on the reference, c (y_ref - l0) + d y_ref'.

    These are the values that the controller assumes; they may differ from those of the worm.

    Parameters
    ----------
    stiffness, rest_length : array_like, shape (n,)
        Spring constants c_j and rest lengths l0_j.
    damping : array_like, shape (n,), optional
        Dashpot constants d_j.

    Examples
    --------
    A spring of stiffness 10 is held 0.5 longer than its rest length of 2, by a force of 5:

    >>> import wormopt as wo
    >>> still = wo.Reference(ca.SX([2.5]), ca.SX(1, 1), ca.SX(1, 1))
    >>> force, numbers = FeedForward(stiffness=10.0, rest_length=2.0).force(still)
    >>> ca.substitute(force, ca.vertcat(*(s.symbol for s in numbers)), ca.SX([10.0, 2.0, 0.0]))
    SX(5)
    """

    stiffness: ArrayLike
    rest_length: ArrayLike
    damping: ArrayLike = 0.0

    def force(self, reference: Reference) -> tuple[ca.SX, tuple[Signal, ...]]:
        """Expression of the force, and the parameters in it.

        Parameters
        ----------
        reference : Reference
            Reference of the link lengths.

        Returns
        -------
        force : casadi.SX, shape (n, 1)
        parameters : tuple of Signal
            ``feedforward_stiffness``, ``feedforward_rest_length`` and ``feedforward_damping``.

        Raises
        ------
        ArgumentError
            If an assumed value is not one finite number, or one per link.

        Examples
        --------
        >>> import casadi as ca
        >>> still = Reference(ca.SX([2.0]), ca.SX(1, 1), ca.SX(1, 1))
        >>> FeedForward(stiffness=10.0, rest_length=1.5).force(still)[1][0].value
        (10.0,)
        """
        size = reference.value.numel()
        c, rest, d = parameters = [
            Signal(
                f"feedforward_{item.name}",
                ca.SX.sym(f"feedforward_{item.name}", size),
                {"rest_length": "length", "damping": "drag"}.get(item.name, item.name),
                value=numbers_of(item.name, getattr(self, item.name), size),
            )
            for item in fields(self)
        ]
        force = c.symbol * (reference.value - rest.symbol) + d.symbol * reference.rate
        return force, tuple(parameters)


@dataclass(frozen=True, eq=False)
class TrackingError:
    """Error e = y - y_ref of a plant's output and its rate."""

    value: ca.SX  # (n, 1) error e
    rate: ca.SX  # (n, 1) e'
    unit: str  # quantity of both y and e

    @classmethod
    def of(cls, plant: Model, reference: Reference, output: str = "length") -> TrackingError:
        """Tracking error of a plant's output; e' follows from the plant's ode."""
        y = followed_by(plant, reference, output)
        rate = lie(plant, y)
        acting = ca.vertcat(pack(plant.u), plant.forces)
        if ca.depends_on(ca.vertcat(y, rate), acting):
            raise ArgumentError(f"forces change rates of {plant.name} directly, not accelerations")
        unit = next(part.unit for part in (*plant.x, *plant.outputs) if part.name == output)
        return cls(y - reference.value, rate - reference.rate, unit)

    @property
    def rate_unit(self) -> str:
        """Quantity of the rate, if it has a name."""
        return _RATES.get(self.unit, "1")

    def per(self, quantity: str) -> str:
        """Quantity of a gain; it has a name if a force responds to a length."""
        return quantity if self.unit == "length" else "1"

    @property
    def square(self) -> ca.SX:
        """Square of the Euclidean norm, which is smooth everywhere."""
        return ca.dot(self.value, self.value)

    def shown(self, reference: Reference) -> list[Output]:
        """Outputs ``reference``, ``error`` and ``error_norm``."""
        return [
            Output("reference", reference.value, self.unit),
            Output("error", self.value, self.unit),
            Output("error_norm", ca.sqrt(self.square), self.unit),
        ]

    def at_start(self, plant: Model, reference: Reference) -> tuple[np.ndarray, np.ndarray] | None:
        """Error and its rate at time 0; None if the plant gives no initial state."""
        known = [*plant.x, *plant.p]
        if any(signal.value is None for signal in known):
            return None
        symbols, numbers = [plant.t], [ca.DM(0)]
        for signal in known:
            symbols.append(signal.symbol)
            numbers.append(ca.DM(np.broadcast_to(np.asarray(signal.value, float), signal.size)))
        scheduled, values = at_zero((*plant.schedules, *reference.schedules))
        outputs = [self.value, self.rate]
        value, rate = ca.Function("start", [*symbols, scheduled], outputs)(*numbers, values)
        return np.array(value).ravel(), np.array(rate).ravel()


def _tracked(plant: Model, output: str) -> ca.SX:
    """Output or state that follows a reference; ArgumentError if there is none of that name."""
    names = [part.name for part in (*plant.x, *plant.outputs)]
    if output not in names:
        raise ArgumentError(
            f"{plant.name} has no output {output!r} that can follow the reference; write output= "
            f"one of {', '.join(map(repr, names))}"
        )
    return plant[output]


def followed_by(plant: Model, reference: Reference, output: str) -> ca.SX:
    """Output or state that follows a reference; ArgumentError if they do not fit each other."""
    check_kind("plant", plant, Model)
    if not isinstance(reference, Reference):
        what = type(reference).__name__
        raise ArgumentError(f"reference must be gait_reference(gait, plant.t), not {what}")
    own = ca.vertcat(plant.t, *(ca.vertcat(s.symbol, s.begin) for s in reference.schedules))
    parts = [reference.value, reference.rate]
    if ca.Function("reference", [own], parts, {"allow_free": True}).has_free():
        raise ArgumentError("the reference must be a function of the plant's own time, plant.t")
    y, count = _tracked(plant, output), reference.value.numel()
    if y.shape != reference.value.shape:
        raise ArgumentError(
            f"the reference has {count} entr{'y' if count == 1 else 'ies'}, but {output} of "
            f"{plant.name} has {y.numel()}; write a reference with {y.numel()}"
        )
    return y


def at_zero(schedules: Sequence[Schedule]) -> tuple[ca.SX, np.ndarray]:
    """Symbols (m, 1) of schedules and their values (m,) at time 0."""
    symbols, values = ca.SX(0, 1), np.zeros(0)
    for schedule in schedules:
        begin, piece = schedule.locate(np.zeros(1))
        symbols = ca.vertcat(symbols, schedule.symbol, schedule.begin)
        values = np.concatenate([values, schedule.values[piece[0]], begin])
    return symbols, values


def input_of(plant: Model, size: int, name: str = "input") -> Signal:
    """The plant's input by which a loop is closed."""
    for signal in plant.u:
        if signal.name == name and signal.size == size:
            return signal
    known = ", ".join(f"{s.name!r} of {s.size}" for s in plant.u) or "none"
    raise ArgumentError(
        f"{plant.name} has no input {name!r} of {size} scalars; write input= one of {known}"
    )


def actuated(
    plant: Model,
    reference: Reference,
    command: ca.SX,
    actuator: Actuator,
    feedforward: FeedForward | None,
) -> tuple[ca.SX, tuple[Signal, ...]]:
    """Force (n, 1) of actuators under a command, with a feed-forward, and its parameters."""
    check_choice("actuator", actuator, get_args(Actuator))
    force = _moved(plant, command) if actuator == "rest_length" else command
    if feedforward is None:
        return force, ()
    check_kind("feedforward", feedforward, FeedForward)
    ahead, believed = feedforward.force(reference)
    return ahead + force, believed


def _moved(plant: Model, command: ca.SX) -> ca.SX:
    """Force of actuators that move rest lengths, (11)."""
    try:
        stiffness = plant["stiffness"]
    except UnknownNameError:
        stiffness = ca.SX(0, 1)
    if stiffness.shape != command.shape:
        raise ArgumentError(
            f"actuators that move rest lengths need a stiffness of {command.numel()} entries, but "
            f"{plant.name} has {stiffness.numel()}; write actuator='force'"
        )
    return stiffness * command


def feed(plant: Model, inputs: Sequence[Signal], force: ca.SX) -> Model:
    """Replace inputs of a plant by the expression `force` (m, 1), in their order.

    The caller must declare new symbols of the force as states, parameters or schedules.
    """
    expressions = [plant.ode, plant.alg, *(o.expression for o in plant.outputs)]
    for switch in plant.switches:
        expressions += [switch.guard, switch.reset]
    # All at once, so that they keep common subexpressions.
    ode, alg, *rest = ca.substitute(expressions, [pack(inputs)], [force])
    shown, left = rest[: len(plant.outputs)], rest[len(plant.outputs) :]
    parts = {
        "ode": ode,
        "alg": alg,
        "u": [signal for signal in plant.u if signal not in inputs],
        "outputs": [replace(o, expression=e) for o, e in zip(plant.outputs, shown, strict=True)],
        "switches": [
            replace(s, guard=guard, reset=reset)
            for s, guard, reset in zip(plant.switches, left[::2], left[1::2], strict=True)
        ],
    }
    fed = copy(plant)  # not `replace`: a Model with undeclared symbols would be refused
    for name, part in parts.items():
        object.__setattr__(fed, name, part)
    return fed


def close(
    plant: Model,
    reference: Reference,
    error: TrackingError,
    force: ca.SX,
    *,
    name: str,
    input: str = "input",  # noqa: A002
    states: Sequence[Signal] = (),
    rates: Sequence[ca.SX] = (),
    parameters: Sequence[Signal] = (),
    outputs: Sequence[Output] = (),
    switches: Sequence[Switch] = (),
    schedules: Sequence[Schedule] = (),
    delays: Sequence[Delay] = (),
) -> Model:
    """Insert `force` (n, 1) as the plant's input, and add the controller's states and parameters.

    Plant states come first; the ``reset`` of `switches` contains the controller's states only. The
    input's name becomes that of an output. If the input has bounds the force is cut to them, and
    the output ``saturated`` is 1 while it is cut.
    """
    signal = input_of(plant, force.numel(), input)
    force, saturation = saturated(signal, force)
    fed = feed(plant, [signal], force)
    x, own = pack(plant.x), pack(states)
    return replace(
        fed,
        name=f"{plant.name} under {name}",
        x=[*plant.x, *states],
        ode=ca.vertcat(fed.ode, *rates),
        p=[*plant.p, *parameters],
        outputs=[
            *fed.outputs,
            *error.shown(reference),
            Output(signal.name, force, signal.unit),
            *saturation,
            *outputs,
        ],
        switches=[
            *(replace(s, reset=ca.vertcat(s.reset, own)) for s in fed.switches),
            *(replace(s, reset=ca.vertcat(x, s.reset)) for s in switches),
        ],
        schedules=[*plant.schedules, *reference.schedules, *schedules],
        delays=[*plant.delays, *delays],
    )


def cut(plant: Model, loop: Model, input: str = "input") -> Model:  # noqa: A002
    """Cut the input that a loop around `plant` commands to its bounds; the loop if it has none."""
    signal = input_of(plant, loop[input].numel(), input)
    force, saturation = saturated(signal, loop[input])
    if not saturation:
        return loop
    fed = feed(plant, [signal], force)
    shown = {o.name: o for o in fed.outputs} | {input: Output(input, force, signal.unit)}
    outputs = {o.name: o for o in (*saturation, *loop.outputs)}  # a loop may show its own cuts
    n, own = plant.n_x, len(plant.switches)
    return replace(
        loop,
        ode=ca.vertcat(fed.ode, loop.ode[n:]),
        outputs=[shown.get(name, o) for name, o in outputs.items()],
        switches=[
            *(
                replace(s, reset=ca.vertcat(s.reset, whole.reset[n:]))
                for s, whole in zip(fed.switches, loop.switches[:own], strict=True)
            ),
            *loop.switches[own:],
        ],
    )


def saturated(signal: Signal, command: ca.SX) -> tuple[ca.SX, tuple[Output, ...]]:
    """Cut a command to its input's bounds; the output is 1 where it is cut, else 0."""
    kept, beyond = command, ca.SX.zeros(command.numel())
    if signal.lower > -np.inf:
        kept, beyond = ca.fmax(kept, signal.lower), beyond + (command < signal.lower)
    if signal.upper < np.inf:
        kept, beyond = ca.fmin(kept, signal.upper), beyond + (command > signal.upper)
    bounded = signal.lower > -np.inf or signal.upper < np.inf
    return kept, (Output("saturated", beyond),) if bounded else ()


def check_sign(plant: Model, output: str, input: str) -> None:  # noqa: A002
    """Refuse an input that accelerates an output in the wrong direction for high-gain trackers.

    The eigenvalues of the high-frequency gain d(y'')/du must have positive real parts at the
    plant's start. Gains that depend on values the plant does not give are not checked, nor is an
    input without effect. Raises ArgumentError otherwise, or if there is no such input.
    """
    size = plant[output].numel()
    signal = input_of(plant, size, input)
    if not ca.depends_on(plant.ode, signal.symbol):
        return
    gain = ca.jacobian(lie(plant, lie(plant, plant[output])), signal.symbol)
    scheduled, values = at_zero(plant.schedules)
    symbols = [plant.t, plant.forces, scheduled, *(u.symbol for u in plant.u)]
    numbers: list[object] = [0, 0, values, *(0 if u.value is None else u.value for u in plant.u)]
    for known in (*plant.x, *plant.p):
        if known.value is not None:
            symbols.append(known.symbol)
            numbers.append(np.broadcast_to(np.asarray(known.value, float), known.size))
    function = ca.Function("gain", symbols, [ca.densify(gain)], {"allow_free": True})
    if function.has_free():
        return
    found = np.array(function(*numbers))
    if not np.all(np.isfinite(found)):
        return
    parts = np.linalg.eigvals(found).real
    least = _SINGULAR * np.abs(found).max()
    if parts.min() > least:
        return
    what = f"the input {signal.name!r} of {plant.name}"
    listed = ", ".join(f"{part:.3g}" for part in np.sort(parts)[:_LISTED])
    if parts.max() < -least:
        raise ArgumentError(
            f"{what} accelerates {output} in the wrong direction: the high-frequency gain "
            f"d(y'')/du has the eigenvalues {listed} at the start, but a tracker needs positive "
            "ones; reverse the sign of the input"
        )
    raise ArgumentError(
        f"{what} does not accelerate all entries of {output} independently: the high-frequency "
        f"gain d(y'')/du has the eigenvalues {listed} (real parts) at the start, but a tracker "
        "needs positive ones; choose other outputs or another order and sign of the inputs"
    )


def with_reference(plant: Model, reference: Reference, output: str = "length") -> Model:
    """Compare a plant's output with a reference unknown to the plant itself.

    Adds the reference's schedule and sets ``reference``, ``error`` and ``error_norm``.
    """
    compared = TrackingError.of(plant, reference, output).shown(reference)
    names = {output.name for output in compared}
    return replace(
        plant,
        outputs=[*(o for o in plant.outputs if o.name not in names), *compared],
        schedules=[*plant.schedules, *reference.schedules],
    )


def as_tracked(plant: Model, output: str = "length", input: str = "input") -> Model:  # noqa: A002
    """Call a plant's output ``length``, its rate ``rate`` and its input ``input``, as of a chain.

    Other inputs become parameters with their values.
    """
    y = _tracked(plant, output)
    signal = input_of(plant, y.numel(), input)
    rate = lie(plant, y)
    acting = ca.vertcat(signal.symbol, plant.forces)
    if ca.depends_on(ca.vertcat(y, rate), acting):
        raise ArgumentError(
            f"{output} of {plant.name} has a relative degree below two: its rate depends on "
            f"{input} or on forces; write output= a signal that {input} accelerates, for example "
            "a position"
        )
    if not ca.depends_on(lie(plant, rate), signal.symbol):
        raise ArgumentError(
            f"{output} of {plant.name} has no relative degree of two: {input} does not act on its "
            f"acceleration; write output= a signal that {input} accelerates, or another input="
        )
    check_sign(plant, output, input)
    units = {part.name: part.unit for part in (*plant.x, *plant.outputs)}
    own = {"length": (y, units[output]), "rate": (rate, _RATES.get(units[output], "1"))}
    for name, (expression, _) in own.items():
        if name in units and not ca.is_equal(plant[name], expression, 9):
            raise ArgumentError(
                f"{plant.name} has another signal {name!r}, the name of the {name} of the tracked "
                f"output; rename it, or write output={name!r}"
            )
    added = [Output(name, *given) for name, given in own.items() if name not in units]
    return replace(
        plant,
        u=[replace(signal, name="input")],
        p=[*plant.p, *(each for each in plant.u if each is not signal)],
        outputs=[*plant.outputs, *added],
    )
