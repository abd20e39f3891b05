"""Integration in Python: the compiled driver's steps, events and decisions, without a compiler."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wormopt.errors import interruptible
from wormopt.progress import Report
from wormopt.simulation.call import Call
from wormopt.simulation.contacts import Contacts
from wormopt.simulation.crossings import Crossing, Watch
from wormopt.simulation.initial_value import KINDS, InitialValueProblem, Outcome
from wormopt.simulation.layer import Layer
from wormopt.simulation.sensitivity.columns import Columns
from wormopt.simulation.sharing import Sharing
from wormopt.simulation.steps import GivenUp, Step, Stepper

_SWITCH = KINDS.index("switch")
_STEPS_PER_REPORT = 500
_ROUND_OFF = 4 * float(np.finfo(float).eps)


def integrate(task: InitialValueProblem, report: Report, *, stiff: bool = False) -> Outcome:
    """Integrate a task in Python.

    Explicit steps of order 8, or if `stiff` implicit ones (Radau IIA of order 5).
    """
    with np.errstate(all="ignore"):  # what is not finite is noticed where it matters
        motion = _Motion(task, stiff)
        status = motion.follow(report)
    return motion.outcome(status)


class _Clock:
    """Schedules: write their values into the parameters and tell when they change next."""

    def __init__(self, task: InitialValueProblem, p: np.ndarray) -> None:
        self._p, self._schedules = p, task.schedules
        sizes = [1 + schedule.symbol.numel() for schedule in task.schedules]
        self._offsets = task.system.n_fixed + np.cumsum([0, *sizes])
        self._along = task.directions.schedules if task.directions else ()
        self._directions = p[len(task.p) :].reshape(len(task.p), -1)
        self.next = np.inf

    def follow(self, t: float) -> None:
        """Set all values to those at time t; a break within round-off of t counts as passed."""
        self.next = np.inf
        for i, schedule in enumerate(self._schedules):
            begin, piece = schedule.locate(np.array([t]))
            self._p[self._offsets[i]] = begin[0]
            self._p[self._offsets[i] + 1 : self._offsets[i + 1]] = schedule.values[piece[0]]
            if self._along:
                rows = slice(self._offsets[i] + 1, self._offsets[i + 1])
                self._directions[rows] = self._along[i][piece[0]]
            self.next = min(self.next, schedule.next_break(t))


@dataclass(eq=False)
class _Record:
    """What is kept of a motion."""

    task: InitialValueProblem
    samples: list[np.ndarray] = field(default_factory=list)
    events: list[tuple[float, ...]] = field(default_factory=list)
    modes: list[np.ndarray] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    rows: list[np.ndarray] = field(default_factory=list)

    def keep(self, step: Step) -> None:
        """Samples within a step, its end left to what comes next."""
        times, sampled = self.task.times, len(self.samples)
        stop = int(np.searchsorted(times, step.end))
        if stop > sampled:
            theta = np.maximum((times[sampled:stop] - step.t) / step.h, 0.0)
            self.samples.extend(step.states(theta))
        if self.task.dense:
            self.ends.append(step.end)
            self.rows.append(step.rows)

    def keep_end(self, t: float, x: np.ndarray) -> None:
        reached = int(np.searchsorted(self.task.times, t, side="right"))
        self.samples.extend([x] * (reached - len(self.samples)))


def _stepper(task: InitialValueProblem, p: np.ndarray, modes: np.ndarray, stiff: bool) -> Stepper:
    if stiff:
        from wormopt.simulation.radau import Stiff

        return Stiff(task, p, modes)
    from wormopt.simulation.dop853 import Explicit

    return Explicit(task, p, modes)


class _Motion:
    """A motion under way."""

    def __init__(self, task: InitialValueProblem, stiff: bool) -> None:
        system, p = task.system, task.all_p.copy()
        modes = system.sliding
        self._task, self._modes, self._record = task, modes, _Record(task)
        self._t, self._x, self._n_steps = task.span[0], task.x0.copy(), 0
        self._crowd, self._crowd_start = 0, -np.inf  # events since
        self._ended = False  # by a terminal switch
        self._clock = _Clock(task, p)
        self._stepper = _stepper(task, p, modes, stiff)
        sharing = Sharing(task, p, modes) if system.exact and system.shares else None
        self._watch, self._layer = Watch(task, p, modes, sharing), Layer(task, p, modes)
        self._columns = columns = Columns(task, p, modes)
        self._contacts = Contacts(task, p, modes, sharing, columns) if system.exact else None
        self._resets = None
        if system.model.switches:
            self._resets = Call(system.resets, ("p", p), ("s", modes))

    def follow(self, report: Report) -> str:
        """Go to the end, or as far as it goes; gives the status."""
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
        self._clock.follow(self._t)
        self._decide(record=False)
        self._watch.start(self._t, self._x)
        self._start_afresh()

    # -- steps -----------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Try one step."""
        stop = min(self._task.span[1], self._clock.next)
        step = self._stepper.attempt(stop)
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
        if self._t >= self._clock.next - _ROUND_OFF * abs(self._t):
            self._clock.follow(self._t)
            self._decide()
            self._start_afresh()

    def _note_touches(self, step: Step, crossing: Crossing | None) -> None:
        """Doubt derivatives where an event before the first one all but happened."""
        before = crossing.theta if crossing else 2.0
        for which, theta in self._watch.touched if self._columns.k else ():
            if theta < before:
                mode = self._modes[which] if which < self._watch.n_contacts else 0.0
                self._columns.doubts.touch(step.t + theta * step.h, which, float(mode))

    def _take(self, step: Step) -> None:
        self._record.keep(step)
        self._t, self._x = step.end, step.x_new[: len(self._x)]
        self._columns.s = step.x_new[len(self._x) :].reshape(self._columns.s.shape).copy()
        self._n_steps += 1

    @property
    def _all(self) -> np.ndarray:
        """State, and behind it its derivatives."""
        return np.append(self._x, self._columns.s)

    def _go_to(self, step: Step, crossing: Crossing) -> None:
        """Step to an event and let it happen."""
        located = self._watch.locate(step, crossing, self._stepper)
        if located.step is not None:
            self._take(located.step)
            self._watch.raise_levels(self._t, self._x)
        elif crossing.which >= self._watch.n_contacts and crossing.level != 0:
            raise GivenUp("events_accumulate")  # it has fired at this very instant
        self._stepper.h = step.h
        if located.arrived:
            self._count_crowd()
            self._columns.leave(crossing.which, self._t, self._x, self._watch.grazes)
            k = crossing.which - self._watch.n_contacts
            if k < 0:
                self._decide(crossing.which)
            else:
                self._fire(k, self._watch.error_of(k, self._t, self._x))
        self._start_afresh()

    def _count_crowd(self) -> None:
        """Give up where events follow each other with hardly any time passing."""
        start, end = self._task.span
        if self._t - self._crowd_start > 1e-10 * (end - start):
            self._crowd, self._crowd_start = 0, self._t
        self._crowd += 1
        if self._crowd > 32 + 16 * self._watch.n:
            raise GivenUp("events_accumulate")

    # -- what happens without time passing ---------------------------------------------------

    def _start_afresh(self) -> None:
        """Fire switches whose guards have jumped above 0, and tell the stepper."""
        for _ in range(10 * len(self._task.system.model.switches) + 1):
            self._note_landings()
            k = self._watch.jumped_switch(self._t, self._x)
            if k is None or self._ended:
                break
            self._fire(k)
        else:
            raise GivenUp("events_accumulate")
        if self._ended:
            return  # the end moves with its event, and so does the state there
        self._watch.raise_levels(self._t, self._x)
        self._columns.arrive(self._t, self._x)
        self._stepper.restart(self._t, self._all)

    def _note_landings(self) -> None:
        """Doubt derivatives where a guard is next to 0 after a jump."""
        if self._columns.k and self._task.system.model.switches:
            guards, armed = self._watch.guards(self._t, self._x)
            self._columns.land(self._t, self._x, guards, armed)

    def _fire(self, k: int, error: tuple[float, float] = (0.0, 0.0)) -> None:
        assert self._resets is not None
        columns = self._resets(self._t, self._x)[0].reshape(-1, len(self._x))
        self._columns.carry("resets_along", self._t, self._x, k)
        self._x = columns[k].copy()
        which = len(self._task.system.contacts) + k
        self._record.events.append((self._t, which, _SWITCH, 0, *self._columns.dt))
        self._decide()
        self._watch.note_fired(k, self._t, self._x, error)
        self._ended |= self._task.system.model.switches[k].terminal

    def _decide(self, forced: int | None = None, *, record: bool = True) -> None:
        """Decide the contacts' modes anew."""
        if self._contacts is None:
            return
        before = self._modes.copy()
        self._x, changes, stopped = self._contacts.decide(
            self._t, self._x, forced, at_start=not record
        )
        for contact in {*stopped, *(change.which for change in changes)}:
            self._watch.note_change(contact)
        if record:
            dt = self._columns.dt
            self._record.events += [(self._t, c.which, c.kind, c.mode, *dt) for c in changes]
        if not record or np.any(before != self._modes):
            self._record.modes.append(np.array([self._t, *self._modes]))

    # -- the end -----------------------------------------------------------------------------

    def outcome(self, status: str) -> Outcome:
        """What was found."""
        task, record, x = self._task, self._record, self._all
        record.keep_end(self._t, x)
        # An interrupted step may have left more behind than it came to.
        reached = int(np.searchsorted(task.times, self._t, side="right"))
        steps = min(int(np.searchsorted(record.ends, self._t, side="right")), len(record.rows))
        return Outcome(
            status=status,
            route="python",
            t=float(self._t),
            x=x,
            samples=np.array(record.samples[:reached]).reshape(-1, len(x)),
            n_steps=self._n_steps,
            n_rejected=self._stepper.n_rejected,
            n_evaluations=self._stepper.n_evaluations,
            events=np.array(record.events).reshape(-1, 4 + self._columns.k),
            modes=np.array(record.modes).reshape(-1, 1 + task.system.n_s),
            doubts=np.array(self._columns.doubts.rows).reshape(-1, 4),
            dense_time=np.array([task.span[0], *record.ends[:steps]] if task.dense else []),
            dense=np.array(record.rows[:steps]).reshape(-1, 8, len(x)),
        )
