"""Adaptive lambda-tracking, (13) and (14): a gain that grows until the error stays in a tube."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args, runtime_checkable

import casadi as ca
from numpy.typing import ArrayLike

from wormopt.control.loop import (
    Actuator,
    FeedForward,
    Reference,
    TrackingError,
    actuated,
    check_sign,
    close,
)
from wormopt.errors import ArgumentError
from wormopt.model.given import check_choice, check_number
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Model, Output, Signal, Switch
from wormopt.model.schedule import Delay
from wormopt.model.values import numbers_of


@dataclass(frozen=True, eq=False)
class Fed:
    """A force, and its own states."""

    force: ca.SX  # (n, 1)
    states: Sequence[Signal] = ()
    rates: Sequence[ca.SX] = ()  # time derivatives of `states`
    parameters: Sequence[Signal] = ()
    delays: Sequence[Delay] = ()


@dataclass(frozen=True, eq=False)
class Known:
    """Arguments of a feedback law."""

    error: TrackingError
    gain: ca.SX  # k
    gain_rate: ca.SX  # k'
    start: ArrayLike  # of the filter
    lag: float  # of the difference

    @property
    def size(self) -> int:
        """Number of entries of the error."""
        return self.error.value.numel()

    def started(self) -> tuple[float, ...]:
        """Start of a filter, one number for each entry."""
        return numbers_of("filter_start", self.start, self.size)


def by_derivative(known: Known) -> Fed:
    """Feed back -(k e + (k e)'), (13)."""
    k, e = known.gain, known.error
    return Fed(-(k * e.value + known.gain_rate * e.value + k * e.rate))


def by_filter(known: Known) -> Fed:
    """Feed back -(k theta + (k theta)') with theta' = -k^2 theta + k^2 e, (14)."""
    k, theta = known.gain, ca.SX.sym("filter", known.size)
    rate = k**2 * (known.error.value - theta)
    state = Signal("filter", theta, known.error.unit, value=known.started())
    return Fed(-(k * theta + known.gain_rate * theta + k * rate), [state], [rate])


def by_difference(known: Known) -> Fed:
    """Feed back (13) with (e(t) - e(t - h)) / h instead of e'; before the start e was e(0)."""
    check_number("lag", known.lag, above=0.0)
    k, e, h = known.gain, known.error.value, ca.SX.sym("lag")
    past = ca.SX.sym("past_error", known.size)
    slope = (e - past) / h
    return Fed(
        -(k * e + known.gain_rate * e + k * slope),
        parameters=[Signal("lag", h, "time", lower=TINY, value=known.lag)],
        delays=[Delay("past_error", past, e, h)],
    )


def by_backstepping(known: Known) -> Fed:
    """Feed back -k e - (k^2 + |e|^2) k^4 (1 + |xi|^2) (xi + k e) with xi' = -xi + u."""
    k, e, xi = known.gain, known.error.value, ca.SX.sym("input_filter", known.size)
    steep = (k**2 + known.error.square) * k**4 * (1 + ca.dot(xi, xi))
    force = -k * e - steep * (xi + k * e)
    state = Signal("input_filter", xi, known.error.per("force"), value=0.0)
    return Fed(force, [state], [force - xi])


FEEDBACKS: dict[str, Callable[[Known], Fed]] = {
    "derivative": by_derivative,
    "filter": by_filter,
    "difference": by_difference,
    "backstepping": by_backstepping,
}


Feedback = Literal["derivative", "filter", "difference", "backstepping"]
"""Replacement of e': the rate itself (13), a filter (14), a difference in time, nothing."""

Number = float | ca.SX


@dataclass(frozen=True, eq=False)
class Growth:
    """Time derivative of the gain, and the states of the adaptation."""

    rate: ca.SX  # time derivative of the gain
    states: Sequence[Signal] = ()  # of the adaptation
    rates: Sequence[ca.SX] = ()  # time derivatives of `states`
    switches: Sequence[Switch] = ()  # jumps of `states`; ``reset`` contains only these


@runtime_checkable
class Adaptation(Protocol):
    """Adaptation law of the gain: a frozen dataclass; its numbers become parameters."""

    def grow(self, gain: ca.SX, square: ca.SX, tube_radius: ca.SX) -> Growth:
        """Time derivative of the gain.

        Parameters
        ----------
        gain, square, tube_radius : casadi.SX
            k, |e|² of the error, and lambda, which is positive.
        """
        ...


@dataclass(frozen=True, eq=False)
class Quadratic(Adaptation):
    """Gain adaptation law k' = gamma ([|e| - lambda]+)^2 of Zimmermann et al. 2007.

    Parameters
    ----------
    growth : float or casadi.SX, optional
        Factor gamma, positive.

    Raises
    ------
    ArgumentError
        If ``growth`` is not positive.

    Examples
    --------
    An error of 0.5 exceeds a tube of 0.2 by 0.3; the gain grows at the rate 2 * 0.3^2:

    >>> gain, square, tube_radius = ca.SX(1.0), ca.SX(0.25), ca.SX(0.2)
    >>> Quadratic(growth=2.0).grow(gain, square, tube_radius).rate
    SX(0.18)
    """

    growth: Number = 1.0

    def __post_init__(self) -> None:
        _check_field("growth", self.growth, above=0.0)

    def grow(self, gain: ca.SX, square: ca.SX, tube_radius: ca.SX) -> Growth:
        return Growth(self.growth * _excess(square, tube_radius) ** 2)


@dataclass(frozen=True, eq=False)
class Exponent(Adaptation):
    """Gain adaptation law k' = gamma [|e| - lambda]+ |e|^(r - 1).

    Parameters
    ----------
    exponent : float or casadi.SX
        Exponent r, at least 1.
    growth : float or casadi.SX, optional
        Factor gamma, positive.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Examples
    --------
    An error of 0.5 exceeds a tube of 0.2 by 0.3; with r = 2 the gain grows at the rate 0.3 * 0.5:

    >>> gain, square, tube_radius = ca.SX(1.0), ca.SX(0.25), ca.SX(0.2)
    >>> Exponent(2.0).grow(gain, square, tube_radius).rate
    SX(0.15)
    """

    exponent: Number
    growth: Number = 1.0

    def __post_init__(self) -> None:
        _check_field("growth", self.growth, above=0.0)
        _check_field("exponent", self.exponent, least=1.0)

    def grow(self, gain: ca.SX, square: ca.SX, tube_radius: ca.SX) -> Growth:
        excess = _excess(square, tube_radius)
        return Growth(self.growth * excess * (tube_radius + excess) ** (self.exponent - 1))


@dataclass(frozen=True, eq=False)
class Decay(Adaptation):
    """Growth with two exponents, and decay once the error has stayed in the tube for a while.

    k' = gamma (|e| - lambda)^2 for |e| >= lambda + 1, gamma sqrt(|e| - lambda) for
    lambda <= |e| < lambda + 1, and in the tube 0 until the dwell time has passed, then -sigma k.

    Crossings of the tube and of |e| = lambda + 1, where k' has kinks, are events of the model,
    and so is the end of the dwell time, counted from the last crossing of the tube; outside the
    tube this event has no effect.

    Parameters
    ----------
    dwell : float or casadi.SX
        Time in the tube before the gain decays, positive. An error that starts in the tube
        entered it at the start.
    decay : float or casadi.SX
        Rate sigma of decay, not negative.
    growth : float or casadi.SX, optional
        Factor gamma, positive.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Examples
    --------
    A gain that decays at the rate 0.5 once the error has been in the tube for 1 s:

    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> reference = wo.gait_reference(wo.Gait([0.0, 1.0], [[[2.5]]]), worm.t)
    >>> loop = wo.lambda_tracker(worm, reference, tube_radius=0.2, adaptation=Decay(1.0, 0.5))
    >>> [switch.name for switch in loop.switches][-1]
    'dwell time passes'
    """

    dwell: Number
    decay: Number
    growth: Number = 1.0

    def __post_init__(self) -> None:
        _check_field("growth", self.growth, above=0.0)
        _check_field("dwell", self.dwell, above=0.0)
        _check_field("decay", self.decay, least=0.0)

    def grow(self, gain: ca.SX, square: ca.SX, tube_radius: ca.SX) -> Growth:
        # `decaying` is 1 while the gain decays, else 0; `timer` is the time since the error entered
        # or left the tube
        decaying, timer = ca.SX.sym("gain_decaying"), ca.SX.sym("gain_timer")
        own = ca.vertcat(decaying, timer)
        excess = _excess(square, tube_radius)
        # Both exponents in one formula: below 1 only the root differs from 1, above only the
        # square. A tiny number keeps the derivative of the root at 0 finite.
        both = ca.sqrt(ca.fmin(ca.fmax(excess, 1e-40), 1)) * ca.fmax(excess, 1) ** 2
        # The timer also runs outside the tube, where it is ignored.
        inside = square <= tube_radius**2
        return Growth(
            self.growth * both - decaying * self.decay * gain,
            [
                Signal("gain_decaying", decaying, value=0.0),
                Signal("gain_timer", timer, "time", value=0.0),
            ],
            [ca.SX(0), ca.SX(1)],
            [
                *_crossings(square, tube_radius, ca.SX(2, 1)),
                *_crossings(square, tube_radius + 1, own, "wide tube"),
                Switch("dwell time passes", timer - self.dwell, ca.vertcat(inside, timer)),
            ],
        )


def lambda_tracker(
    plant: Model,
    reference: Reference,
    *,
    tube_radius: float,
    feedback: Feedback = "derivative",
    adaptation: Adaptation | None = None,
    gain_start: float = 1.0,
    filter_start: ArrayLike = 1.0,
    actuator: Actuator = "force",
    lag: float = 0.01,
    feedforward: FeedForward | None = None,
    watch: bool = False,
    output: str = "length",
    input: str = "input",  # noqa: A002
    any_sign: bool = False,
) -> Model:
    """Close the loop by a lambda-tracker: the error e = y - y_ref is forced into |e| <= lambda.

    With ``feedback="derivative"``, (13), u = -(k e + (k e)') = -(k e + k' e + k e'). With
    "filter", (14), u = -(k theta + (k theta)') and theta' = -k^2 theta + k^2 e, which needs no
    derivative of the output. |.| is the Euclidean norm. Neither do the other two:

    - "difference" is (13) with (e(t) - e(t - h)) / h in place of e'; before time 0 the error
      equals its value at time 0. The loop is a delay equation. It is stable at high gain only
      while k h is small against the inertia: unlike e', a difference does not allow every gain.
    - "backstepping" is a filter xi' = -xi + u of the input and
      u = -k e - (k^2 + |e|^2) k^4 (1 + |xi|^2) (xi + k e): Ye's way (Automatica 35, 109-119, 1999)
      in the form that Ilchmann, Ryan and Townsend gave it for relative degree two (SIAM J. Control
      Optim. 46, 210-230, 2007), for a high-frequency gain of known sign. Powers of the gain up
      to k^7 make the loop stiff.

    Parameters
    ----------
    plant : Model
        With an input and an output of relative degree two, of as many entries.
    reference : Reference
        Reference of the output.
    tube_radius : float
        Radius lambda of the tube, positive.
    feedback : {"derivative", "filter", "difference", "backstepping"}, optional
        Kind of tracker.
    adaptation : Adaptation, optional
        Adaptation law of the gain; `Quadratic` by default.
    gain_start : float, optional
        Gain k at the start.
    filter_start : array_like, shape (n,), optional
        The filter's theta at the start.
    actuator : {"force", "rest_length"}, optional
        Whether the tracker's u above is the force itself, or by (11) moves the rest lengths: the
        force is then c_j times u_j, with the plant's own ``stiffness`` c.
    lag : float, optional
        Time h over which "difference" takes its difference.
    feedforward : FeedForward, optional
        Force added to the tracker's.
    watch : bool, optional
        Whether crossings of the tube are events of the model, so that solvers locate them. A
        `Decay` has these events anyway.
    output, input : str, optional
        Names of the plant's output or state that follows the reference, and of the input.
    any_sign : bool, optional
        Whether an input that accelerates the output in the wrong direction is accepted; the loop
        is then unstable.

    Returns
    -------
    Model
        States: the plant's, ``gain``, for (14) ``filter`` (n), for "backstepping"
        ``input_filter`` (n), and those of the adaptation. Parameters: the plant's,
        ``tube_radius``, ``gain_growth`` and the adaptation's others, for "difference" ``lag``, and
        those of the feed-forward. Delays: for "difference" ``past_error``. Outputs: the plant's,
        ``reference``, ``error``, ``error_norm``, the input under its name, ``gain_rate``, and
        ``saturated`` where the input has bounds, which then hold.

    Raises
    ------
    ArgumentError
        If a number is out of range, the plant has no such output or input, or no ``stiffness``
        where rest lengths are moved, sizes of plant and reference differ, forces act on the
        output's rate at once, or the input accelerates the output in the wrong direction.

    Examples
    --------
    >>> import numpy as np
    >>> from wormopt.model.gait import Gait
    >>> from wormopt.control.loop import gait_reference
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1)
    >>> still = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.5))
    >>> reference = gait_reference(still, worm.t)
    >>> loop = lambda_tracker(worm, reference, tube_radius=0.2, feedback="filter")
    >>> [signal.name for signal in loop.x]
    ['position', 'velocity', 'gain', 'filter']
    """
    check_number("tube_radius", tube_radius, above=0.0)
    check_number("gain_start", gain_start, above=0.0)
    check_choice("feedback", feedback, get_args(Feedback))
    error = TrackingError.of(plant, reference, output)
    if not any_sign:
        check_sign(plant, output, input)
    k, lam = ca.SX.sym("gain"), ca.SX.sym("tube_radius")
    given = Quadratic() if adaptation is None else adaptation
    if not isinstance(given, Adaptation):
        raise ArgumentError(f"adaptation must be Quadratic(growth) or the like, not {given!r:.60}")
    (law,), numbers = lift([given], "gain", {"dwell": "time"})
    growth = law.grow(k, error.square, lam)
    fed = FEEDBACKS[feedback](Known(error, k, growth.rate, filter_start, lag))

    states, rates = [Signal("gain", k, value=gain_start), *fed.states], [growth.rate, *fed.rates]
    force, believed = actuated(plant, reference, fed.force, actuator, feedforward)

    kept = ca.vertcat(*(state.symbol for state in states))
    states += growth.states
    switches = [Switch(s.name, s.guard, ca.vertcat(kept, s.reset)) for s in growth.switches]
    if watch and not switches:
        switches = _crossings(error.square, lam, ca.vertcat(*(state.symbol for state in states)))
    return close(
        plant,
        reference,
        error,
        force,
        name="a lambda-tracker",
        input=input,
        states=states,
        rates=[*rates, *growth.rates],
        parameters=[
            Signal("tube_radius", lam, error.unit, lower=TINY, value=tube_radius),
            *numbers,
            *fed.parameters,
            *believed,
        ],
        outputs=[Output("gain_rate", growth.rate)],
        switches=switches,
        delays=fed.delays,
    )


def _excess(square: ca.SX, tube_radius: ca.SX) -> ca.SX:
    """[|e| - lambda]+, with finite derivatives at e = 0."""
    return ca.sqrt(ca.fmax(square, tube_radius**2)) - tube_radius


def _crossings(square: ca.SX, radius: ca.SX, reset: ca.SX, name: str = "tube") -> list[Switch]:
    """Events |e| = radius in both directions; squares keep the guards smooth."""
    outside = square - radius**2
    return [
        Switch(f"leaves the {name}", outside, reset),
        Switch(f"enters the {name}", -outside, reset),
    ]


def _check_field(name: str, value: Number, **bound: float) -> None:
    """Refuse a number out of range; symbols pass."""
    if not isinstance(value, ca.SX):
        check_number(name, value, **bound)
