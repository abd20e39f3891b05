"""Integration in Python: steps, events and decisions of the compiled driver, without a compiler."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import interruptible
from wormopt.numerics.expressions import Call
from wormopt.progress import Report
from wormopt.simulation.contacts import Contacts
from wormopt.simulation.crossings import FALLS, Crossing, Near, Watch
from wormopt.simulation.initial_value import KINDS, InitialValueProblem, Outcome
from wormopt.simulation.saltation import Columns
from wormopt.simulation.sharing import Sharing
from wormopt.simulation.steps import GivenUp, Kept, Step, Stepper

_SAMPLES = np.linspace(0.0, 1.0, 17)
# From this number of widths on the law is flat to 2e-7.
_WIDTHS = 8.0
# Largest change of a velocity across the kink at velocity 0 along the heading in a step, as shares
# of the speed and of the nominal speed.
_BEND, _LEAST_BEND = 1e-6, 1e-9


class Layer:
    """Speeds below which the smooth law of each contact is steep.

    The owners of the parameters `p` and the modes rewrite them.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        system, self._n_x = task.system, len(task.x0)
        self._states: list[int] = system.velocity_state.tolist()
        self._layers: list[float] = [] if system.exact else (_WIDTHS * task.v_layer).tolist()
        self._bends = None
        if system.exact and len(system.planar):
            speeds = np.array([system.contacts[i].nominal_speed for i in system.planar])
            self._least, self._bends = (
                _LEAST_BEND * speeds,
                Call(system.bends, ("p", p), ("s", modes)),
            )
        if self._layers:
            self._velocities = Call(system.velocities, ("p", p), ("s", modes))

    def is_passed_unseen(self, step: Step) -> bool:
        """Whether a velocity enters and leaves the steep layer of the smooth law within a step."""
        # The layer would act between the stages, unseen by the error estimate. For exact laws in
        # the plane: whether a long step passes a kink, which the estimate may miss.
        if not self._layers:
            return self._bends is not None and self._goes_over_bend(step)
        suspects = self._may_dip(step)
        if not any(suspects):
            return False
        v, plain = self._along(step, step.states(_SAMPLES)), self._along(step, _cubics(step))
        sign = np.where(v[0] > 0, 1.0, -1.0)
        least = np.minimum(_least_between(sign * v), _least_between(sign * plain))
        outside = np.minimum(sign * v[0], sign * v[-1]) > self._layers
        return bool(np.any(outside & (least < self._layers) & suspects))

    def _along(self, step: Step, states: np.ndarray) -> np.ndarray:
        """Velocities of contacts (17, n) at the samples of a step, of given states."""
        pairs = zip(step.t + _SAMPLES * step.h, states, strict=True)
        return np.array([self._velocities(t, x[: self._n_x])[0].copy() for t, x in pairs])

    def _goes_over_bend(self, step: Step) -> bool:
        before, speed = self._bend(step.t, step.x)
        after, later = self._bend(step.end, step.x_new)
        allowed = _BEND * np.maximum(speed, later) + self._least
        return bool(np.any((before * after < 0) & (np.abs(after - before) > allowed)))

    def _bend(self, t: float, x: np.ndarray) -> np.ndarray:
        """Velocities along the headings, and speeds."""
        assert self._bends is not None
        (found,) = self._bends(t, x)
        return found.copy().reshape(len(self._least), 2).T

    def _may_dip(self, step: Step) -> list[bool]:
        """Which velocities may dip, judged by the cubic through both ends where they are states."""
        x, x_new = step.x.tolist(), step.x_new.tolist()
        dx, dx_new = step.dx.tolist(), step.dx_new.tolist()
        found = []
        for i, layer in zip(self._states, self._layers, strict=True):
            sign = 1.0 if x[i] > 0 else -1.0
            a, b = sign * x[i], sign * x_new[i]
            first, second = a + sign * step.h * dx[i] / 3, b - sign * step.h * dx_new[i] / 3
            low = min(first, second) <= max(layer, 0.3 * min(a, b))
            found.append(i < 0 or (a > layer and b > layer and low))
        return found


def _cubics(step: Step) -> np.ndarray:
    """States at the samples by the cubics through the ends of a step."""
    # Stages within a dip may distort the step's own polynomial.
    s, rise = _SAMPLES[:, None], step.x_new - step.x
    first, last = step.h * step.dx, step.h * step.dx_new
    bend = 3 * rise - 2 * first - last + s * (first + last - 2 * rise)
    return step.x + s * (first + s * bend)


def _least_between(v: np.ndarray) -> np.ndarray:
    """Least velocities (n,) within a step, by parabolas through neighbouring samples (m, n)."""
    slope, bend = (v[2:] - v[:-2]) / 2, v[:-2] + v[2:] - 2 * v[1:-1]
    turns = np.abs(slope) < bend
    dip = np.where(turns, slope**2 / (2 * np.where(turns, bend, 1.0)), 0.0)
    return (v[1:-1] - dip).min(axis=0)


_SWITCH = KINDS.index("switch")
_STEPS_PER_REPORT = 500
# Most switches crossed together of which all choices are tried.
_TOGETHER = 8


def integrate(task: InitialValueProblem, report: Report, *, stiff: bool) -> Outcome:
    """Integrate a task in Python.

    Explicit steps of order 8, or if `stiff` implicit ones (Radau IIA of order 5).
    """
    with np.errstate(all="ignore"):  # values that are not finite are detected where they matter
        motion = _Motion(task, stiff)
        status = motion.follow(report)
    return motion.outcome(status)


class _Clock:
    """Schedules: write their values into the parameters and give the next break."""

    def __init__(self, task: InitialValueProblem, p: np.ndarray) -> None:
        self._p, self._schedules = p, task.schedules
        sizes = [1 + schedule.symbol.numel() for schedule in task.schedules]
        ends = task.system.n_fixed + np.cumsum([0, *sizes])
        self._places = [slice(*place) for place in pairwise(ends)]
        self._along = task.directions.schedules if task.directions else ()
        self._directions = p[len(task.p) :].reshape(len(task.p), task.k)

    def follow(self, t: float) -> float:
        """Set all values to those at time t, and the next break."""
        # A break within round-off of t counts as passed.
        end = np.inf
        for i, (schedule, place) in enumerate(zip(self._schedules, self._places, strict=True)):
            (begin,), (piece,) = schedule.locate(np.array([t]))
            self._p[place] = np.append(begin, schedule.values[piece])
            if self._along:
                self._directions[place][1:] = self._along[i][piece]
            end = min(end, schedule.end(begin, piece))
        return end


@dataclass
class _Record:
    """Recorded parts of a motion."""

    task: InitialValueProblem
    samples: list[np.ndarray] = field(default_factory=list)
    events: list[tuple[float, ...]] = field(default_factory=list)
    modes: list[np.ndarray] = field(default_factory=list)
    steps: list[tuple[float, np.ndarray]] = field(default_factory=list)  # end and polynomial

    def __post_init__(self) -> None:
        self.kept = Kept(self.task.keep)

    def keep(self, step: Step) -> None:
        """Store samples within a step; its end belongs to the next step."""
        times, sampled = self.task.times, len(self.samples)
        stop = int(np.searchsorted(times, step.end))
        if stop > sampled:
            self.samples.extend(step.states((times[sampled:stop] - step.t) / step.h))
        if self.task.keep:
            self.kept.add(step.t, step.x)
        if self.task.dense:
            self.steps.append((step.end, step.rows))


def _stepper(task: InitialValueProblem, p: np.ndarray, modes: np.ndarray, stiff: bool) -> Stepper:
    if stiff:
        from wormopt.simulation.steps import Stiff

        return Stiff(task, p, modes)
    from wormopt.simulation.steps import Explicit

    return Explicit(task, p, modes)


class _Motion:
    """A motion under way."""

    def __init__(self, task: InitialValueProblem, stiff: bool) -> None:
        system, p = task.system, task.all_p.copy()
        modes = system.sliding
        self._task, self._modes, self._record = task, modes, _Record(task)
        self._t, self._x, self._n_steps = task.span[0], task.x0.copy(), 0
        self._crowd: list[float] = []  # times of recent events
        self._ended = False  # by a terminal switch
        self._clock = _Clock(task, p)
        self._stepper, self._stiff = _stepper(task, p, modes, stiff), stiff
        sharing = Sharing(task, p, modes) if system.exact and system.shares else None
        self._watch, self._layer = Watch(task, p, modes, sharing), Layer(task, p, modes)
        self._columns = columns = Columns(task, p, modes)
        self._contacts = Contacts(task, p, modes, sharing, columns) if system.exact else None
        switches = system.model.switches
        self._resets = Call(system.resets, ("p", p), ("s", modes)) if switches else None

    def follow(self, report: Report) -> str:
        """Advance to the end, or as far as possible; returns the status."""
        try:
            with interruptible():
                return self._follow(report)
        except GivenUp as reason:
            return reason.status
        except KeyboardInterrupt:
            return "interrupted"

    def _follow(self, report: Report) -> str:
        task, (start, end) = self._task, self._task.span
        self._begin()
        while self._t < end and not self._ended:
            if self._n_steps % _STEPS_PER_REPORT == 0:
                report("simulating", (self._t - start) / (end - start))
            if self._n_steps + self._stepper.n_rejected >= task.tolerance.max_steps:
                return "too_many_steps"
            self._go_on()
        return "done"

    def _begin(self) -> None:
        self._break = self._clock.follow(self._t)
        self._decide()
        self._watch.start(self._t, self._x)
        self._start_afresh()

    # -- steps -----------------------------------------------------------------------------

    def _go_on(self) -> None:
        step = self._stepper.attempt(min(self._task.span[1], self._break))
        if step is None:
            return
        if self._layer.is_passed_unseen(step):
            self._stepper.shorten(step, 0.5)
            return
        crossing = self._watch.find(step) if self._watch.n else None
        self._note_touches(step, crossing)
        if crossing:
            self._go_to(step, crossing)
        else:
            self._take(step)
            self._stepper.accept(step)
        if self._t >= self._break:
            self._break = self._clock.follow(self._t)
            self._decide()
            self._start_afresh()

    def _note_touches(self, step: Step, crossing: Crossing | None) -> None:
        """Doubt derivatives if an event before the first one nearly happened."""
        for which, theta in self._watch.touched if self._columns.k else ():
            if not crossing or theta < crossing.theta:
                mode = self._modes[which] if which < self._watch.n_contacts else 0.0
                self._columns.doubts.touch(step.t + theta * step.h, which, float(mode))

    def _take(self, step: Step) -> None:
        self._record.keep(step)
        self._t, self._x = step.end, step.x_new[: len(self._x)]
        self._columns.s = step.x_new[len(self._x) :].reshape(self._columns.s.shape).copy()
        self._n_steps += 1

    @property
    def _all(self) -> np.ndarray:
        return np.append(self._x, self._columns.s)

    def _go_to(self, step: Step, crossing: Crossing) -> None:
        """Step to an event and process it."""
        located = self._watch.locate(step, crossing, self._stepper)
        if located.step is not None:
            self._take(located.step)
            self._watch.raise_levels(self._t, self._x)
        k = crossing.which - self._watch.n_contacts
        if k >= 0 and located.arrived and self._watch.fires_in_vain(k, self._t, crossing):
            raise GivenUp("events_accumulate")
        if located.arrived:
            self._count_crowd()
            self._columns.leave(crossing.which, self._t, self._x, self._watch.grazes)
            if k < 0:
                self._decide(crossing.which)
            else:
                self._fire(k, self._watch.error_of(k, self._t, self._x, step.h))
        self._start_afresh()

    def _count_crowd(self) -> None:
        """Give up if events follow each other with hardly any time in between."""
        start, end = self._task.span
        if self._crowd and self._t - self._crowd[0] > 1e-10 * (end - start):
            self._crowd.clear()
        self._crowd.append(self._t)
        if len(self._crowd) > 32 + 16 * self._watch.n:
            raise GivenUp("events_accumulate")

    # -- changes at one instant --------------------------------------------------------------

    def _start_afresh(self) -> None:
        """Fire switches whose guards have jumped above 0, and restart the stepper."""
        for _ in range(10 * len(self._task.system.model.switches) + 1):
            self._note_landings()
            k = self._watch.jumped_switch(self._t, self._x)
            if k is None or self._ended:
                break
            self._fire(k)
        else:
            raise GivenUp("events_accumulate")
        if self._ended:
            return  # the end moves with its event, as does the state there
        self._watch.raise_levels(self._t, self._x)
        self._columns.arrive(self._t, self._x)
        self._stepper.restart(self._t, self._all)

    def _note_landings(self) -> None:
        """Doubt derivatives if a guard is near 0 after a jump."""
        if self._columns.k and self._task.system.model.switches:
            guards, armed = self._watch.guards(self._t, self._x)
            self._columns.land(self._t, self._x, guards, armed)

    def _fire(self, k: int, error: tuple[float, float] = (0.0, 0.0)) -> None:
        switch, rates = self._task.system.model.switches[k], self._watch.rates(self._t, self._x)
        self._apply(k)
        self._decide()
        self._watch.note_fired(k, self._t, self._x, error)
        if switch.crosses and error != (0.0, 0.0):
            self._cross(k, self._watch.near(k, error, np.abs(rates), self._t, self._x))
        self._ended |= switch.terminal

    def _apply(self, k: int) -> None:
        """Reset the state as a switch does."""
        which = len(self._task.system.contacts) + k
        self._columns.carry("resets_along", self._t, self._x, k)
        self._x = self._reset(k, self._x)
        self._record.events.append((self._t, which, _SWITCH, 0, *self._columns.dt))

    def _reset(self, k: int, x: np.ndarray) -> np.ndarray:
        assert self._resets is not None
        (states,) = self._resets(self._t, x)
        return np.split(states, len(self._task.system.model.switches))[k].copy()

    def _cross(self, k: int, near: Near) -> None:
        """Fire all switches that must fire together with the crossed switch `k`."""
        # If several guards are 0 or jump at once, the first choice of these switches is taken after
        # which the motion leaves all their guards.
        watch, t = self._watch, self._t
        choices = list(_choices(watch.at_guard(t, self._x, near)[:_TOGETHER]))
        for leaves, choice in product((FALLS, -FALLS), choices):  # rather than staying there
            x, jumped = self._x, list[int]()
            for j in choice:
                x = self._reset(j, x)
            while len(jumped) < len(near.size) and len(more := watch.jumped(t, x, near)):
                jumped.append(int(more[0]))
                x = self._reset(jumped[-1], x)
            if not watch.returns(t, x, near, leaves).any():
                break
        else:
            if watch.returns(t, self._x, near, -FALLS)[k]:
                raise GivenUp("events_accumulate")
            return
        for j in (*choice, *jumped):
            self._apply(j)
        if choice or jumped:
            self._decide()
        for j in jumped:
            watch.note_fired(j, t, self._x)
        for j in watch.at_guard(t, self._x, near):  # switches that have not fired must not
            watch.note_fired(j, t, self._x, (near.size[j], near.rate[j]))

    def _decide(self, forced: int | None = None) -> None:
        """Decide the contacts' modes, for the first time or anew."""
        if self._contacts is None:
            return
        before, at_start = self._modes.copy(), not self._record.modes
        self._x, changes, stopped = self._contacts.decide(self._t, self._x, forced, at_start)
        self._watch.note_change(self._t, self._x, {*stopped, *(c.which for c in changes)})
        if not at_start:
            dt = self._columns.dt
            self._record.events += [(self._t, c.which, c.kind, c.mode, *dt) for c in changes]
        if at_start or np.any(before != self._modes):
            self._record.modes.append(np.array([self._t, *self._modes]))

    # -- the end -----------------------------------------------------------------------------

    def outcome(self, status: str) -> Outcome:
        """The results."""
        task, record, x = self._task, self._record, self._all
        # An interrupted step may have stored more than it reached.
        reached = int(np.searchsorted(task.times, self._t, side="right"))
        samples = [*record.samples, *reached * [x]][:reached]
        steps = [(end, rows) for end, rows in record.steps if end <= self._t]
        return Outcome(
            status=status,
            route="radau" if self._stiff else "python",
            t=float(self._t),
            x=x,
            samples=_table(samples, len(x)),
            n_steps=self._n_steps,
            n_rejected=self._stepper.n_rejected,
            n_evaluations=self._stepper.n_evaluations,
            events=_table(record.events, 4 + task.k),
            modes=_table(record.modes, 1 + task.system.n_s),
            doubts=_table(self._columns.doubts.rows, 4),
            kept=_table(record.kept.rows, 1 + len(x)),
            dense_time=np.array([task.span[0], *(end for end, _ in steps)] if task.dense else []),
            dense=_table([rows for _, rows in steps], 8, len(x)),
        )


def _choices(of: Sequence[int]) -> Iterator[list[int]]:
    """All choices of some, the smallest first."""
    for bits in sorted(range(1 << len(of)), key=int.bit_count):
        yield [k for place, k in enumerate(of) if bits >> place & 1]


def _table(rows: Sequence[ArrayLike], *shape: int) -> np.ndarray:
    """Rows of a shape as one array, possibly empty."""
    return np.array(rows, dtype=float).reshape(len(rows), *shape)
