"""Effect of events on the derivatives of a motion: they jump, or do not exist.

Compiled in native/variation.c, and in native/doubts.c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.numerics.expressions import Call
from wormopt.simulation.initial_value import REASONS, InitialValueProblem

_GRAZING, _SIMULTANEOUS, _EDGE = range(len(REASONS))
# Share of the whole time; relative difference of equal changes.
_AT_ONCE, ALIKE = 1e-10, 1e-6


@dataclass(eq=False)
class Doubts:
    """Doubts about the derivatives of a running motion, as rows of an `Outcome`."""

    task: InitialValueProblem

    def __post_init__(self) -> None:
        self.rows: list[tuple[float, int, float, int]] = []
        self._span = self.task.span[1] - self.task.span[0]
        self._coupled = self.task.system.exact and self.task.system.coupled
        self._time, self._which, self._stopped = -np.inf, -1, False
        self._dt = np.zeros(self.task.k)

    def event(self, t: float, which: int, mode: float, dt: np.ndarray, grazes: bool) -> None:
        """Doubt an event with the derivatives `dt` of its time."""
        if grazes:
            self._add(t, which, mode, _GRAZING)
        # stops of contacts that do not act on each other commute
        stop = self._is_stop(mode)
        size = max(np.abs(dt).max(), np.abs(self._dt).max())
        near = t - self._time <= _AT_ONCE * self._span and which != self._which
        apart = np.abs(dt - self._dt).max() > ALIKE * size
        if near and apart and not (stop and self._stopped):
            self._add(t, which, mode, _SIMULTANEOUS)
        self._time, self._which, self._stopped, self._dt = t, which, stop, dt.copy()

    def _is_stop(self, mode: float) -> bool:
        return mode != 0 and not self._coupled

    def decision(
        self,
        t: float,
        modes: np.ndarray,
        shares: np.ndarray,
        suspects: np.ndarray,
        forced_mode: float | None,
        *,
        at_start: bool,
    ) -> None:
        """Doubt a decision.

        Arguments: unused shares of holding forces, contacts that stop along with that of the event,
        and its mode before.
        """
        alone = forced_mode is not None and self._is_stop(forced_mode)
        for i, mode in enumerate(modes):
            if mode == 0 and shares[i] <= self.task.small_value:
                self.rows.append((t, i, mode, _EDGE))
            if suspects[i] and (mode != 0 or not (at_start or alone)):
                self.rows.append((t, i, mode, _EDGE if at_start else _SIMULTANEOUS))

    def slides_on(self, t: float, contact: int) -> None:
        """Doubt a contact that rests, but would not stop if it moved."""
        self.rows.append((t, contact, 0.0, _EDGE))

    def let_go(self, t: float, contact: int, mode: float, lacking: float) -> None:
        """Doubt a released contact that nearly holds."""
        if lacking <= self.task.small_value:
            self.rows.append((t, contact, mode, _EDGE))

    def land(self, t: float, which: int) -> None:
        """Doubt a switch whose guard is near 0 after a jump."""
        row = (t, self._place(which), 0.0, _EDGE)
        if row not in self.rows:
            self.rows.append(row)

    def touch(self, t: float, which: int, mode: float) -> None:
        """Doubt an event that nearly happened."""
        self._add(t, which, mode, _GRAZING)

    def _add(self, t: float, which: int, mode: float, reason: int) -> None:
        self.rows.append((t, self._place(which), mode, reason))

    def _place(self, which: int) -> int:
        """Index of an event; with smooth contact only switches have events."""
        system = self.task.system
        return which + (0 if system.exact else len(system.contacts))

    def suspects(self, changes: list[np.ndarray], s: np.ndarray) -> np.ndarray:
        """Which velocities change with the columns `s` (n_x, k), by contact."""
        nominal = self.task.absolute[: len(s), None] / self.task.tolerance.absolute
        sizes = (np.abs(s) / nominal).max(axis=0)
        speeds = np.array([c.nominal_speed for c in self.task.system.contacts])
        least = ALIKE * np.outer(sizes, speeds)
        return np.any(np.abs(np.array(changes)) > least, axis=0)


class Columns:
    """The columns S of a motion, `s` (n_x, k), and the change of the time of the current event.

    Their owners rewrite `p`, followed by its directions, and `modes`.
    """

    def __init__(self, task: InitialValueProblem, p: np.ndarray, modes: np.ndarray) -> None:
        n_p, system = len(task.p), task.system
        self.k = task.k
        self.s = task.directions.x0.copy() if task.directions else np.zeros((system.model.n_x, 0))
        self.dt, self.doubts = np.zeros(self.k), Doubts(task)
        if task.variation is None:
            return
        self._directions = p[n_p:].reshape(n_p, self.k)  # a view: schedules rewrite it
        self._n_x, self._states, self._rows = len(task.x0), system.row_state, system.row_contact
        self._modes, self._exact, self._small_rate = modes, system.exact, task.small_rate
        self._small_value, self._sizes = task.small_value, task.column_sizes
        self._n_contacts = len(system.contacts) if system.exact else 0
        shared = (("p", p), ("s", modes))
        self._rhs = Call(system.rhs, *shared)
        self._probe = Call(system.probe, *shared) if system.exact else None
        along = task.variation.functions
        self._along = {n: Call(f, *shared) for n, f in along.items() if n != "slopes"}

    def leave(self, which: int, t: float, x: np.ndarray, grazes: bool) -> None:
        """Begin an event: compute the change of its time and move S to the event."""
        if not self.k:
            return
        n, row = self._n_contacts, which
        mode = float(self._modes[which]) if which < n else 0.0
        name = "contacts_along" if which < n else "guards_along"
        if which >= n:
            row -= n
        elif self._modes[which] == 0:
            assert self._probe is not None
            force, least, largest = self._probe(t, x)[0][2 * n : 5 * n].reshape(3, n)[:, which]
            row += n if force - least < largest - force else 2 * n
        dx = self._rhs(t, x)[0].copy()
        rate = self._change(name, t, x, 1.0, dx, np.zeros(len(self._directions)))[row]
        changes = np.array([c[row] for c in self._each(name, t, x, self.dt)])
        self.dt[:] = np.where(changes == 0, 0.0, -changes / rate)
        parts = self._along[name.replace("s_along", "_parts")](t, x)[0][row]
        slow = grazes or abs(rate) <= self._small_rate * parts
        self.doubts.event(t, which, mode, self.dt, slow)
        self.s += np.outer(dx[: len(self.s)], self.dt)

    def suspects(self, t: float, x: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        """Contacts among the stopping ones whose velocities change."""
        if not (self.k and stopped.any()):
            return np.zeros_like(stopped)
        changes = self._each("contacts_along", t, x, self.dt)
        return stopped & self.doubts.suspects([c[: len(stopped)] for c in changes], self.s)

    def carry(self, name: str, t: float, x: np.ndarray, k: int = 0) -> None:
        """Propagate the change of the state through the jump that is about to happen."""
        if self.k:
            rows = slice(k * self._n_x, k * self._n_x + len(self.s))
            self.s = np.column_stack([c[rows] for c in self._each(name, t, x, self.dt)])

    def carry_rest(self, t: float, x: np.ndarray) -> None:
        """Remove velocities of resting contacts."""
        if self.k and np.any(self._modes[: self._n_contacts] == 0):
            self.carry("project_along", t, x)

    def land(self, t: float, x: np.ndarray, guards: np.ndarray, armed: np.ndarray) -> None:
        """Doubt moving guards that are near 0 after a jump: small changes decide whether they fire.

        Guards that reach 0 along with that of the event do not move.
        """
        changes = np.abs(self._each("guards_along", t, x, self.dt))
        parts, sizes = self._along["guard_parts"](t, x)[0], self._sizes[:, None]
        moves = changes > ALIKE * np.outer(np.abs(self.dt), parts)
        near = np.abs(guards) * sizes <= self._small_value * changes
        for j in np.flatnonzero(armed & np.any(moves & near, axis=0)):
            self.doubts.land(t, self._n_contacts + int(j))

    def arrive(self, t: float, x: np.ndarray) -> None:
        """End what `leave` began: move S back to the state at a given time."""
        if not self.k:
            return
        self.s -= np.outer(self._rhs(t, x)[0][: len(self.s)], self.dt)
        if self._exact:
            self.s[self._states[(self._modes[self._rows] == 0) & (self._states >= 0)]] = 0.0
        self.dt[:] = 0.0

    def _each(self, name: str, t: float, x: np.ndarray, dt: np.ndarray) -> list[np.ndarray]:
        dx = np.zeros(self._n_x)
        found = []
        for c in range(self.k):
            dx[: len(self.s)] = self.s[:, c]
            found.append(self._change(name, t, x, dt[c], dx, self._directions[:, c]))
        return found

    def _change(
        self, name: str, t: float, x: np.ndarray, dt: float, dx: np.ndarray, dp: np.ndarray
    ) -> np.ndarray:
        return self._along[name](t, x, dt, dx, dp)[0].copy()
