"""Delay equations by the method of steps: in stretches no longer than the least lag.

On a stretch the past is known, and the model is one with schedules: any integrator with dense
output can integrate it, contacts and switches included. A jump of a derivative (an event, a break
of a schedule, the start) causes a jump of a higher derivative one lag later, and so on. These
breaking points bound the pieces of the memory, so that no step passes one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Signal, pack
from wormopt.model.schedule import GENERATIONS, Course, Memory, Piece, Schedule, fitted
from wormopt.progress import Report
from wormopt.simulation.conditions import lifted
from wormopt.simulation.functions import System
from wormopt.simulation.held import scheduled
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.options import Route
from wormopt.simulation.routes import integrate
from wormopt.simulation.steps import Kept
from wormopt.simulation.trajectory import Dense

# Relative error of the memory: a share of the relative tolerance, but not less than rounding.
_SHARE, _LEAST = 0.01, 1e-14
_REPORTS = 200  # a run


def integrate_delayed(
    task: InitialValueProblem, route: Route, report: Report
) -> tuple[InitialValueProblem, Outcome]:
    """Integrate a task whose model has delays.

    Returns it with the schedules of all past signals, by which these can be observed.
    """
    if route == "cvodes" or task.system.model.alg.numel():
        raise ArgumentError("implicit integrators do not support delays; write route = 'auto'")
    if task.directions:
        raise ArgumentError(
            f"{task.system.model.name} has delays, which have no derivatives here; "
            "use differences of motions without sensitivities"
        )
    pasts = [_Past(task, memory) for memory in task.system.memories]
    for past in pasts:
        stretches = (task.span[1] - task.span[0]) / past.lag
        if stretches > task.tolerance.max_steps:
            raise ArgumentError(
                f"the lag {past.lag:g} of {past.memory.delay.name} cuts the time into "
                f"{stretches:.3g} stretches, more than max_steps; write a longer lag"
            )
    return _Stretches(task, route, pasts).follow(report)


class _Past:
    """Memory of one signal."""

    def __init__(self, task: InitialValueProblem, memory: Memory) -> None:
        self.memory, self._task = memory, task
        self.lag = _lag(task, memory)
        signal, x = memory.delay.signal, pack(task.system.model.x)
        self._signal = _function(task.system, memory, signal)
        # e = y - y_ref may be 0, but only as exactly as steps know y
        least = task.absolute[: x.numel()] / task.tolerance.relative
        parts = ca.fabs(ca.jacobian(signal, x)) @ (ca.fabs(x) + least) + ca.fabs(signal)
        self._parts = _function(task.system, memory, parts)
        self.pieces = self._before(task.span[0])

    def _before(self, start: float) -> list[Piece]:
        before, x0 = self.memory.delay.before, self._task.x0[:, None]
        function = (
            self._signal if before is None else _function(self._task.system, self.memory, before)
        )
        begin = start - self.lag

        def course(t: np.ndarray) -> np.ndarray:
            at = np.full_like(t, start) if before is None else t
            return self._values(function, at, np.repeat(x0, len(t), axis=1))

        if before is None:
            allowed = self._allowed(np.array([start]), lambda t: x0 + 0 * t)
            return fitted(course, begin, start, np.zeros(0), allowed, 0, GENERATIONS)
        knots = self._instants(before, begin, start)
        # The signal after the start, which may be 0 there, gives no size of the signal before it.
        edges = np.union1d(np.linspace(begin, start, 33), knots)
        seen = course(np.concatenate([edges, (edges[:-1] + edges[1:]) / 2]))
        allowed = self._share * float(np.abs(seen).max())
        return fitted(course, begin, start, knots, allowed, 0, GENERATIONS)

    def _instants(self, before: ca.SX, begin: float, end: float) -> np.ndarray:
        """Times at which the history before the start jumps, or between which it is narrow."""
        task, model = self._task, self._task.system.model
        course = Model(
            model.name,
            [Signal(self.memory.delay.name, self.memory.delay.symbol)],
            before,
            t=model.t,
            p=model.p,
            u=model.u,
            schedules=model.schedules,
        )
        found = lifted(course, False, moving=False)
        if found is None:
            return np.zeros(0)
        given, own = task.p[: task.system.n_fixed - 1], len(model.schedules)
        pieces, _ = scheduled(
            found.timed,
            found.model.schedules[own],
            (begin, end),
            given,
            task.schedules[:own],
            end - begin,
        )
        return begin + pieces.breaks

    def _values(self, function: ca.Function, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        task = self._task
        p = task.system.scheduled(task.p, task.schedules, t)
        return np.array(function(t[None], x[: task.system.model.n_x], p))

    def _allowed(self, t: np.ndarray, states: Course) -> float:
        size = float(self._values(self._parts, t, states(t)).max(initial=0.0))
        return self._share * size

    @property
    def _share(self) -> float:
        """Relative error allowed for a signal."""
        return max(_SHARE * self._task.tolerance.relative, _LEAST)

    def schedule(self, begin: float, end: float) -> Schedule:
        """The delayed signal from `begin` to `end`."""
        # omit a piece that reaches into this stretch only by rounding
        least = 1e-9 * (end - begin)
        acts = [
            piece
            for piece in self.pieces[-_recent(self.pieces, begin - self.lag + least) :]
            if piece.begin + self.lag < end - least
        ]
        return self.memory.schedule(acts, self.lag)

    def all(self) -> Schedule:
        """The delayed signal at all times."""
        return self.memory.schedule(self.pieces, self.lag)

    def breaking(self, begin: float, end: float) -> list[tuple[float, int]]:
        """Times at which jumps of derivatives return in a stretch, with how many returns."""
        count = _recent(self.pieces, begin - self.lag)
        found = [(piece.begin + self.lag, piece.generation + 1) for piece in self.pieces[-count:]]
        return [(t, g) for t, g in found if begin <= t < end and g < GENERATIONS]

    def remember(self, dense: Dense, breaking: Sequence[tuple[float, int]]) -> None:
        """Store the signal along a stretch with ascending breaking points."""
        if dense.time[0] + self.lag >= self._task.span[1]:
            return  # it does not return before the end

        def course(t: np.ndarray) -> np.ndarray:
            return self._values(self._signal, t, dense(t))

        ends = [*(t for t, _ in breaking[1:]), float(dense.time[-1])]
        allowed = self._allowed((dense.time[1:] + dense.time[:-1]) / 2, dense)
        for (begin, generation), end in zip(breaking, ends, strict=True):
            self.pieces += fitted(course, begin, end, dense.time, allowed, generation)


def _recent(pieces: Sequence[Piece], since: float) -> int:
    """Number of last pieces in a list that end after a time."""
    count = 0
    for piece in reversed(pieces):
        if piece.end <= since:
            break
        count += 1
    return max(count, 1)


def _lag(task: InitialValueProblem, memory: Memory) -> float:
    lag, name = memory.delay.lag, memory.delay.name
    if isinstance(lag, ca.SX):
        known = pack((*task.system.model.p, *task.system.model.u))
        try:
            function = ca.Function("lag", [known], [lag])
        except RuntimeError:
            raise ArgumentError(f"the lag of {name} must depend on parameters only") from None
        lag = float(function(task.p[: known.numel()]))
    if not 0 < lag < np.inf:
        raise ArgumentError(f"the lag of {name} must be positive and finite, not {lag:g}")
    return lag


def _function(system: System, memory: Memory, signal: ca.SX) -> ca.Function:
    t, _, p, _ = system.symbols
    try:
        return ca.Function("signal", [t, pack(system.model.x), p], [ca.densify(signal)])
    except RuntimeError:
        raise ArgumentError(
            f"the delay {memory.delay.name} may depend on time, states, parameters and schedules, "
            "but not on contact forces or delayed signals"
        ) from None


@dataclass(eq=False)
class _Stretches:
    """A motion under way."""

    task: InitialValueProblem
    route: Route
    pasts: list[_Past]
    found: list[Outcome] = field(default_factory=list)
    _steps: int = 0  # of all stretches but the last

    def __post_init__(self) -> None:
        self._kept = Kept(self.task.keep)

    def follow(self, report: Report) -> tuple[InitialValueProblem, Outcome]:
        """Advance to the end, or as far as possible."""
        status = "done"
        try:
            self._follow(report)
        except KeyboardInterrupt:
            if not self.found:
                raise
            status = "interrupted"
        if self.found[-1].status == "done" != status:
            self.found[-1] = replace(self.found[-1], status=status)
        whole = (*self.task.schedules, *(past.all() for past in self.pasts))
        return replace(self.task, schedules=whole), self._joined()

    def _follow(self, report: Report) -> None:
        (begin, end), x = self.task.span, self.task.x0
        step = min(past.lag for past in self.pasts)
        count = max(math.ceil((end - begin) / step * (1 - 1e-12)), 1)
        # multiples of the lag: a running sum would accumulate rounding errors
        ends = [*(begin + k * step for k in range(1, count)), end]
        for k, until in enumerate(ends):
            if k % max(count // _REPORTS, 1) == 0:
                report("simulating", k / count)
            outcome = self._stretch(begin, until, x)
            dense = Dense(outcome.dense_time, outcome.dense)
            for row in outcome.kept:
                self._kept.add(row[0], row[1:])
            self.found.append(self._shortened(outcome))
            if len(outcome.dense):
                breaking = self._breaking(begin, outcome.t)
                for past in self.pasts:
                    past.remember(dense, breaking)
            if outcome.status != "done" or self._ends(outcome):
                return
            begin, x = until, outcome.x

    def _ends(self, outcome: Outcome) -> bool:
        """Whether a terminal switch has ended the motion."""
        system = self.task.system
        fired = outcome.events[:, 1].astype(int) - len(system.contacts)
        return any(system.model.switches[k].terminal for k in fired if k >= 0)

    def _stretch(self, begin: float, end: float, x: np.ndarray) -> Outcome:
        task, times = self.task, self.task.times
        first, last = np.searchsorted(times, [begin, end], side="right")
        first = 0 if not self.found else first
        self._steps += sum(part.n_steps + part.n_rejected for part in self.found[-1:])
        left = max(task.tolerance.max_steps - self._steps, 1)
        part = InitialValueProblem(
            system=task.system,
            span=(begin, end),
            x0=x,
            p=task.p,
            schedules=(*task.schedules, *(past.schedule(begin, end) for past in self.pasts)),
            tolerance=replace(task.tolerance, max_step=task.max_step, max_steps=left),
            times=times[first:last],
            dense=True,
            keep=task.keep,
        )
        return integrate(part, self.route, _quiet)

    def _shortened(self, outcome: Outcome) -> Outcome:
        """A stretch without parts that are not requested, or kept for all stretches."""
        outcome = replace(outcome, kept=outcome.kept[:0])
        if self.task.dense:
            return outcome
        return replace(outcome, dense_time=np.zeros(0), dense=outcome.dense[:0])

    def _breaking(self, begin: float, end: float) -> list[tuple[float, int]]:
        """Jumps of derivatives on a stretch, in order of time, from its beginning on."""
        least = 1e-9 * (end - begin)
        jumps = {begin: 0 if begin == self.task.span[0] else GENERATIONS}
        points = [point for past in self.pasts for point in past.breaking(begin - least, end)]
        # an event at the end of the stretch before belongs to this one
        points += [(float(t), 0) for part in self.found[-2:] for t in part.events[:, 0]]
        for schedule in self.task.schedules:
            points += [(t, 0) for t in schedule.breaks_between(begin - least, end).tolist()]
        for t, generation in sorted(points):
            near = next((s for s in jumps if abs(s - t) <= least), None)
            if near is not None:
                jumps[near] = min(jumps[near], generation)
            elif begin < t < end - least:
                jumps[t] = generation
        return sorted(jumps.items())

    def _joined(self) -> Outcome:
        parts, last = self.found, self.found[-1]
        modes = np.concatenate([part.modes for part in parts])
        if len(modes):
            changes = np.append(True, np.any(modes[1:, 1:] != modes[:-1, 1:], axis=1))
            modes = modes[changes]
        return Outcome(
            status=last.status,
            route=last.route,
            t=last.t,
            x=last.x,
            samples=np.concatenate([part.samples for part in parts]),
            n_steps=sum(part.n_steps for part in parts),
            n_rejected=sum(part.n_rejected for part in parts),
            n_evaluations=sum(part.n_evaluations for part in parts),
            events=np.concatenate([part.events for part in parts]),
            modes=modes,
            kept=np.array(self._kept.rows).reshape(len(self._kept.rows), 1 + len(last.x)),
            dense_time=np.concatenate(
                [parts[0].dense_time[:1], *(part.dense_time[1:] for part in parts)]
            ),
            dense=np.concatenate([part.dense for part in parts]),
        )


def _quiet(_text: str, _fraction: float | None) -> None:
    """Report no progress of a single stretch."""
