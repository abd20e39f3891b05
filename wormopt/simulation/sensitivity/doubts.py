"""Where derivatives of a motion do not exist, or on one side only; compiled, native/doubts.c."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.simulation.initial_value import InitialValueProblem

REASONS = ("grazing", "simultaneous", "edge")
"""Why derivatives are in doubt, by the numbers of integrators."""

_GRAZING, _SIMULTANEOUS, _EDGE = range(len(REASONS))
# Of the whole time; and changes that differ by no more, relative to them, are the same.
_AT_ONCE, ALIKE = 1e-10, 1e-6


@dataclass(eq=False)
class Doubts:
    """What casts doubt on the derivatives of a motion under way, as rows of an `Outcome`."""

    task: InitialValueProblem

    def __post_init__(self) -> None:
        self.rows: list[tuple[float, int, float, int]] = []
        self._span = self.task.span[1] - self.task.span[0]
        self._coupled = self.task.system.exact and self.task.system.coupled
        self._time, self._which, self._stopped = -np.inf, -1, False
        self._dt = np.zeros(self.task.k)

    def event(self, t: float, which: int, mode: float, dt: np.ndarray, grazes: bool) -> None:
        """Of an event whose time's derivatives are `dt`."""
        if grazes:
            self._add(t, which, mode, _GRAZING)
        # stops of contacts that do not act on each other may come in any order
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
        """Of what has been decided.

        Shares of what holds that are left, contacts that stop along with that of the event; mode
        of that before.
        """
        alone = forced_mode is not None and self._is_stop(forced_mode)
        for i, mode in enumerate(modes):
            if mode == 0 and shares[i] <= self.task.small_value:
                self.rows.append((t, i, mode, _EDGE))
            if suspects[i] and (mode != 0 or not (at_start or alone)):
                self.rows.append((t, i, mode, _EDGE if at_start else _SIMULTANEOUS))

    def slides_on(self, t: float, contact: int) -> None:
        """Of a contact that rests, but would not stop if it moved."""
        self.rows.append((t, contact, 0.0, _EDGE))

    def let_go(self, t: float, contact: int, mode: float, lacking: float) -> None:
        """Of a contact that is let go although it all but holds."""
        if lacking <= self.task.small_value:
            self.rows.append((t, contact, mode, _EDGE))

    def land(self, t: float, which: int) -> None:
        """Of a switch whose guard is next to 0 after a jump."""
        row = (t, self._place(which), 0.0, _EDGE)
        if row not in self.rows:
            self.rows.append(row)

    def touch(self, t: float, which: int, mode: float) -> None:
        """Of an event that all but happened."""
        self._add(t, which, mode, _GRAZING)

    def _add(self, t: float, which: int, mode: float, reason: int) -> None:
        """Note a doubt."""
        self.rows.append((t, self._place(which), mode, reason))

    def _place(self, which: int) -> int:
        """With smooth contact only switches have events."""
        system = self.task.system
        return which + (0 if system.exact else len(system.contacts))

    def suspects(self, changes: list[np.ndarray], s: np.ndarray) -> np.ndarray:
        """Which velocities change with the columns `s` (n_x, k); changes of each by contact."""
        nominal = self.task.absolute[: len(s), None] / self.task.tolerance.absolute
        sizes = (np.abs(s) / nominal).max(axis=0)
        speeds = np.array([c.nominal_speed for c in self.task.system.contacts])
        least = ALIKE * np.outer(sizes, speeds)
        return np.any(np.abs(np.array(changes)) > least, axis=0)
