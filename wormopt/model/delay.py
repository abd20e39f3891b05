"""Delay: a signal of the past in a Model, by which its equations become delay equations."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.given import check_kind, check_number


@dataclass(frozen=True, eq=False)
class Delay:
    """Signal some time ago: ``symbol(t) = signal(t - lag)``.

    Parameters
    ----------
    name : str
        What is remembered, for instance ``"past_error"``.
    symbol : casadi.SX
        Column of m symbols that stand for the past in the model's equations.
    signal : casadi.SX
        Column of m expressions of time, states, parameters and schedules, without contact forces
        and without other delays.
    lag : float or casadi.SX
        How long ago, positive; a number, or an expression of the model's parameters.
    before : casadi.SX, optional
        What the signal was before the start, a column of m expressions of time and parameters.
        If left out it was what it is at the start.

    Raises
    ------
    ArgumentError
        If sizes disagree, what should be an expression is none, or the lag is not positive and
        finite.

    Examples
    --------
    >>> x, past = ca.SX.sym("x"), ca.SX.sym("past")
    >>> Delay("past", past, x, lag=0.1).symbol
    SX(past)
    """

    name: str
    symbol: ca.SX
    signal: ca.SX
    lag: float | ca.SX
    before: ca.SX | None = None

    def __post_init__(self) -> None:
        check_kind("name of a delay", self.name, str)
        for name in ("symbol", "signal", "before"):
            value = getattr(self, name)
            if name != "before" or value is not None:
                check_kind(f"delay {self.name}: {name}", value, ca.SX)
        columns = [self.signal] if self.before is None else [self.signal, self.before]
        shape = (self.symbol.numel(), 1)
        if not self.symbol.is_valid_input() or any(c.shape != shape for c in columns):
            raise ArgumentError(f"delay {self.name}: signal and symbol must be columns of one size")
        if not isinstance(self.lag, ca.SX):
            check_number(f"delay {self.name}: lag", self.lag, above=0.0)
