"""Points at which derivatives do not exist or are one-sided; compiled in native/doubts.c."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.simulation.initial_value import InitialValueProblem

REASONS = ("grazing", "simultaneous", "edge")
"""Why derivatives are in doubt, by the numbers of integrators."""

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
