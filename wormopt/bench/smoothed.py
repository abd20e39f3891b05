"""A Model with its smooth contact forces put in, made ready for other people's integrators.

It does on its own, in the plainest way, what `wormopt.simulation` does for itself: a mistake there
is not repeated here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from wormopt.model.model import Model, Schedule, Signal, pack

Called = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of time in which no schedule has a break."""

    start: float
    end: float
    values: np.ndarray  # of all schedules: start of the piece, scheduled numbers


@dataclass(frozen=True, eq=False)
class Smoothed:
    """x' = rates(t, x, q), q what changes from piece to piece; other numbers as in the model."""

    model: Model  # without switches or algebraic equations
    v_reg: float | None  # width of the smooth law; None: contact forces are the last entries of q

    @cached_property
    def expressions(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """t, x, q and the rates of x."""
        model, x = self.model, pack(self.model.x)
        q = ca.vertcat(ca.SX(0, 1), *(ca.vertcat(s.begin, s.symbol) for s in model.schedules))
        ode = model.ode
        if self.v_reg is None:
            q = ca.vertcat(q, model.forces)
        else:
            forces = [c.law.smooth(c.velocity, self.v_reg) for c in model.contacts]
            ode = ca.substitute(ode, model.forces, ca.vertcat(ca.SX(0, 1), *forces))
        fixed = [*model.p, *model.u]
        ode = ca.substitute(ode, pack(fixed), ca.DM(_values(fixed)))
        return model.t, x, q, ode

    @cached_property
    def function(self) -> ca.Function:
        """Rates as a function of (t, x, q)."""
        t, x, q, ode = self.expressions
        return ca.Function("rates", [t, x, q], [ca.densify(ode)])

    @cached_property
    def jacobian(self) -> ca.Function:
        """Jacobian of the rates by x."""
        t, x, q, ode = self.expressions
        return ca.Function("jacobian", [t, x, q], [ca.densify(ca.jacobian(ode, x))])

    @cached_property
    def start(self) -> np.ndarray:
        """States at the start."""
        return _values(list(self.model.x))

    def pieces(self, span: float) -> Iterator[Piece]:
        """Cut the time from 0 to `span` at all breaks."""
        schedules = self.model.schedules
        cuts = {0.0, span}
        for schedule in schedules:
            cuts.update(t for t in _breaks(schedule, span) if 0 < t < span)
        edges = sorted(cuts)
        # the same break of two schedules may differ by rounding
        kept = [0.0, *(b for a, b in pairwise(edges) if b - a > 1e-12 * span)]
        kept[-1] = span
        for a, b in pairwise(kept):
            values = [_held(schedule, 0.5 * (a + b)) for schedule in schedules]
            yield Piece(a, b, np.concatenate([np.zeros(0), *values]))


def _values(signals: list[Signal]) -> np.ndarray:
    known = [np.broadcast_to(0.0 if s.value is None else s.value, s.size) for s in signals]
    return np.concatenate([np.zeros(0), *known])


def _breaks(schedule: Schedule, span: float) -> np.ndarray:
    period = schedule.breaks[-1]
    if not schedule.periodic:
        return schedule.start + schedule.breaks[1:-1]
    first = np.floor(-schedule.start / period)
    cycles = np.arange(first, first + np.ceil(span / period) + 2)
    return (schedule.start + cycles[:, None] * period + schedule.breaks[None, :-1]).ravel()


def _held(schedule: Schedule, t: float) -> np.ndarray:
    """Beginning and values of the piece in the midst of which t is."""
    period = schedule.breaks[-1]
    turn = np.floor((t - schedule.start) / period) * period if schedule.periodic else 0.0
    since = t - schedule.start - turn
    piece = int(np.clip(np.searchsorted(schedule.breaks, since) - 1, 0, schedule.pieces - 1))
    begin = schedule.start + turn + schedule.breaks[piece]
    return np.append(begin, schedule.values[piece])


def called(function: ca.Function) -> Called:
    """Wrap a CasADi function of (t, x, q) to avoid the overhead of its calls.

    The result is flat by columns. For `Smoothed.function` or `Smoothed.jacobian`.
    """
    buffer, run = function.buffer()
    arrays = [np.zeros(function.numel_in(k)) for k in range(3)]
    result = np.zeros(function.numel_out(0))
    for k, array in enumerate(arrays):
        if array.size:
            buffer.set_arg(k, array.data)  # type: ignore[call-arg]
    buffer.set_res(0, result.data)  # type: ignore[call-arg]

    def call(t: float, x: np.ndarray, q: np.ndarray, _kept: object = buffer) -> np.ndarray:
        arrays[0][0], arrays[1][:], arrays[2][:] = t, x, q
        run()
        return result.copy()

    return call
