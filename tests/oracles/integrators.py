"""Motions by other people's integrators: an event loop around SciPy, and smooth models.

They know nothing of `simulate` and are the second routes for it: what `wormopt.simulation` does for
itself is done here once more, in the plainest way, so that a mistake there is not repeated. Dry
friction goes by scipy's solve_ivp with terminal events, what one would write without wormopt:
sliding masses have the event v = 0, resting ones the events that their force leaves its interval;
at every event the modes are decided anew, on the level of accelerations, and solve_ivp starts
again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.driven_chain import Happening, Motion, Plant, Rates
from wormopt.model.model import Model, Signal, pack
from wormopt.model.schedule import Schedule

_SLACK = 1e-12

# -- dry friction --------------------------------------------------------------------------------


class _Loop:
    def __init__(self, plant: Plant) -> None:
        self.plant, self.velocity, self.mass = plant, plant.velocity, plant.mass
        self.ahead = np.array([-grip.forward for grip in plant.grips])
        # a spike never slides backward; what its force would be then is of no matter
        self.behind = np.array([g.backward if np.isfinite(g.backward) else 0 for g in plant.grips])
        # A mass is let go when its force is out of bounds by more than rounding, so that its
        # acceleration then has the right sign.
        self.hold = np.array([grip.hold for grip in plant.grips]) + np.array([-_SLACK, _SLACK])
        self.modes = np.zeros(len(self.mass), dtype=int)
        self.slip = np.zeros(len(self.mass))
        self.let_go = np.full(len(self.mass), -np.inf)  # when
        self.within = (0.0, 0.0)
        self.none = np.zeros(len(self.mass))
        self.happenings: list[Happening] = []

    def stay_within(self, start: float, stop: float) -> None:
        """Evaluate no more on the far side of a break, where rates may be quite different."""
        rounding = 1e-13 * max(stop, 1.0)
        self.within = (start + rounding, stop - rounding)

    def free(self, t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        low, high = self.within
        return self.plant.rates(min(max(t, low), high), y, force.copy())

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        dy = self.free(t, y, self.slip)
        dy[self.velocity[self.modes == 0]] = 0.0
        return dy

    def holding(self, t: float, y: np.ndarray) -> np.ndarray:
        """Force that each mass needs to stay at rest."""
        return -self.mass * self.free(t, y, self.none)[self.velocity]

    def decide(self, t: float, y: np.ndarray, event: int = -1) -> None:
        """Modes of masses without velocity; `event` is the mass whose event it is."""
        before, force = self.modes.copy(), self.holding(t, y)
        for i, (least, largest) in enumerate(self.hold):
            if i == event:
                y[self.velocity[i]] = 0.0
            if y[self.velocity[i]] != 0:
                self.modes[i] = np.sign(y[self.velocity[i]])
            elif i == event and before[i] == 0:  # let go, whatever rounding says of its force
                self.modes[i] = 1 if force[i] - least < largest - force[i] else -1
                self.let_go[i] = t
            elif self.let_go[i] < t:
                self.modes[i] = int(force[i] < least) - int(force[i] > largest)
        self.slip = np.where(self.modes > 0, self.ahead, self.behind)
        for i in np.flatnonzero(before != self.modes) if t > 0 else ():
            self.happenings.append(Happening.of(t, int(i), before[i], self.modes[i]))

    def events(self) -> list[Any]:
        """Functions that fall through 0 at an event, each with the mass it is of."""
        functions: list[Any] = []
        for i, mode in enumerate(self.modes):
            found: list[Any] = [lambda _, y, s=mode, v=self.velocity[i]: s * y[v]]
            if mode == 0:
                found = [
                    lambda t, y, i=i, b=bound, s=sign: s * (self.holding(t, y)[i] - b)
                    for bound, sign in zip(self.hold[i], (1, -1), strict=True)
                    if np.isfinite(bound)
                ]
            for function in found:
                function.terminal, function.direction, function.mass = True, -1, i
            functions += found
        return functions


def event_loop(
    plant: Plant,
    span: float,
    times: np.ndarray | None = None,
    *,
    start: np.ndarray | None = None,
    method: str = "DOP853",
    relative: float = 1e-10,
    max_step: float = np.inf,
    max_events: int = 100_000,
) -> Motion:
    """Follow a plant from 0 to `span` with solve_ivp; `times` (m,) are sampled, ascending.

    The absolute tolerance is a tenth of the `relative` one.
    Bound `max_step`: a velocity that dips below zero and comes back in a step goes unseen.
    Raises RuntimeError if solve_ivp fails or there are more than `max_events` events.
    """
    loop = _Loop(plant)
    times = np.zeros(0) if times is None else times
    y, t, event = (plant.start if start is None else start).copy(), 0.0, -1
    states, sampled = np.empty((len(y), len(times))), 0
    stalled, last = 0, -np.inf
    for stop in [*plant.breaks(span), span]:
        loop.stay_within(t, stop)
        while t < stop:
            stalled, last = (stalled + 1, last) if t - last < 1e-13 * span else (0, t)
            loop.decide(t, y, event)
            functions = loop.events()
            wanted = times[sampled:]
            wanted = wanted[(wanted >= t) & (wanted <= stop)]
            found = solve_ivp(
                loop.rates,
                (t, stop),
                y,
                method,
                dense_output=len(wanted) > 0,
                events=functions,
                rtol=relative,
                atol=0.1 * relative,
                # A velocity that starts at 0 and is back within the first step has its event,
                # for solve_ivp, at the start: it needs a shorter step.
                max_step=max_step if stalled == 0 else min(max_step, 0.01) * 0.5**stalled,
            )
            stuck = stalled > 30 + 2 * len(plant.mass) or len(loop.happenings) > max_events
            if found.status < 0 or stuck:
                raise RuntimeError(f"the event loop is given up at t = {t:g}: {found.message}")
            event, t_end, y_end = -1, stop, found.y[:, -1]
            if found.status == 1:
                first = [k for k, at in enumerate(found.t_events) if len(at)]
                k = min(first, key=lambda k: found.t_events[k][0])
                event, t_end = functions[k].mass, found.t_events[k][0]
                y_end = found.y_events[k][0]
            taken = int(np.sum(wanted <= t_end))
            if taken and found.sol is not None:
                states[:, sampled : sampled + taken] = found.sol(wanted[:taken])
                sampled += taken
            y, t = y_end.copy(), float(t_end)
    states[:, sampled:] = y[:, None]
    return Motion(states, y, loop.happenings)


# -- smooth contact ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of time in which no schedule has a break."""

    start: float
    end: float
    values: np.ndarray  # of all schedules: start of the piece, scheduled numbers


@dataclass(frozen=True, eq=False)
class Regularised:
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
        held = [_stretches(schedule, span) for schedule in self.model.schedules]
        edges = sorted({0.0, span, *(t for begins, _ in held for t in begins[1:] if 0 < t < span)})
        # the same break of two schedules may differ by rounding
        kept = [0.0, *(b for a, b in pairwise(edges) if b - a > 1e-12 * span)]
        kept[-1] = span
        for a, b in pairwise(kept):
            values = [np.zeros(0)]
            for begins, numbers in held:
                k = max(int(begins.searchsorted(0.5 * (a + b))) - 1, 0)
                values += [begins[k : k + 1], numbers[k]]
            yield Piece(a, b, np.concatenate(values))


def _values(signals: list[Signal]) -> np.ndarray:
    known = [np.broadcast_to(0.0 if s.value is None else s.value, s.size) for s in signals]
    return np.concatenate([np.zeros(0), *known])


def _stretches(schedule: Schedule, span: float) -> tuple[np.ndarray, np.ndarray]:
    """When the pieces of a schedule begin (m,), from before 0 to `span`, and their values."""
    period, cycles = schedule.breaks[-1], np.zeros(1)
    if schedule.periodic:
        cycles = np.floor(-schedule.start / period) + np.arange(np.ceil(span / period) + 2)
    begins = schedule.start + cycles[:, None] * period + schedule.breaks[None, :-1]
    return begins.ravel(), np.tile(schedule.values, (len(cycles), 1))


def called(function: ca.Function) -> Rates:
    """Wrap a CasADi function of (t, x, q) to avoid the overhead of its calls.

    The result is flat by columns. For `Regularised.function` or `Regularised.jacobian`.
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


def by_casadi(
    smoothed: Regularised, plugin: str, times: np.ndarray, relative: float, **options: Any
) -> Callable[[np.ndarray], np.ndarray]:
    """CasADi's integrator `plugin`: (n_x,) at the start to (n_x, m) at the `times`, ascending.

    Pieces are a grid on which the scheduled numbers are piecewise constant controls.
    """
    t, x, q, ode = smoothed.expressions
    pieces = list(smoothed.pieces(float(times[-1])))
    ends = np.array([piece.end for piece in pieces])
    grid = np.unique(np.concatenate([times, ends]))
    grid = grid[grid > 0]
    values = np.stack([piece.values for piece in pieces], axis=1)
    controls = values[:, np.searchsorted(ends, grid - 1e-13)]
    chosen = {"reltol": relative, "abstol": 0.1 * relative, **options}
    system = {"t": t, "x": x, "u": q, "ode": ode}
    integrator = ca.integrator("peer", plugin, system, 0.0, grid, chosen)
    wanted = np.searchsorted(grid, times)
    return lambda start: np.array(integrator(x0=start, u=controls)["xf"])[:, wanted]


def by_lsoda(
    smoothed: Regularised, times: np.ndarray, start: np.ndarray, relative: float
) -> np.ndarray:
    """States (n_x, m) at the `times`, ascending, by SciPy's LSODA with an analytic Jacobian."""
    rates, jacobian = called(smoothed.function), called(smoothed.jacobian)
    n, y = len(start), start
    found, sampled = np.empty((n, len(times))), 0
    for piece in smoothed.pieces(float(times[-1])):
        within = times[(times > piece.start) & (times <= piece.end)]
        done = solve_ivp(
            lambda t, x, q=piece.values: rates(t, x, q),
            (piece.start, piece.end),
            y,
            "LSODA",
            t_eval=np.unique(np.append(within, piece.end)),
            jac=lambda t, x, q=piece.values: jacobian(t, x, q).reshape(n, n, order="F"),
            rtol=relative,
            atol=0.1 * relative,
        )
        if not done.success:
            raise RuntimeError(done.message)
        found[:, sampled : sampled + len(within)] = done.y[:, : len(within)]
        sampled += len(within)
        y = done.y[:, -1]
    return found
