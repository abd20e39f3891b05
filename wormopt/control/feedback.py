"""Feedback laws of lambda-trackers: from error, gain and tube to a force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
from numpy.typing import ArrayLike

from wormopt.control.loop import TrackingError
from wormopt.model.delay import Delay
from wormopt.model.given import check_number
from wormopt.model.model import TINY, Signal
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
