"""The direction in which a contact in the plane begins to slip: that of its acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import root, root_scalar

from wormopt.simulation.call import Call
from wormopt.simulation.grip import ENTRIES
from wormopt.simulation.initial_value import InitialValueProblem

# Share of the force too small to turn a direction.
_SMALL = 1e-13
_SWEEPS = 300
# After this many sweeps all directions are turned at once.
_PATIENCE = 5
# Share of the force to which directions must fit.
_FIT = 1e-10
# Share of the whole time to measure how fast a direction turns.
_GLANCE = 1e-7


class Aim:
    """Directions of onset, the entries of `s` after the modes; 0 for none."""

    def __init__(
        self, task: InitialValueProblem, s: np.ndarray, shared: tuple[tuple[str, np.ndarray], ...]
    ) -> None:
        system = task.system
        self._onsets = s[len(system.contacts) :].reshape(-1, ENTRIES)
        self._directions = self._onsets[:, :2]  # initial directions
        self._glance = _GLANCE * (task.span[1] - task.span[0])
        self._place = {i: k for k, i in enumerate(system.planar.tolist())}
        self._sizes = [system.contacts[i].nominal_force for i in self._place]
        self._toward = np.zeros((0, 2))
        self._joint: set[int] = set()  # of contacts released together, to stay in line
        if self._place:
            self._call, self._rates = Call(system.aims, *shared), Call(system.rhs, *shared)

    def is_set(self, contact: int) -> bool:
        """Whether a contact is in its onset."""
        return contact in self._place and bool(self._directions[self._place[contact]].any())

    def clear(self, contact: int) -> None:
        """End the onset of a contact."""
        if contact in self._place:
            self._onsets[self._place[contact]] = 0.0
            self._joint.discard(self._place[contact])

    def look(self, t: float, x: np.ndarray) -> None:
        """Note the directions of forces on contacts at rest, before modes change."""
        if self._place:
            self._toward = self._call(t, x)[0].reshape(-1, 3)[:, :2].copy()

    def set(self, t: float, x: np.ndarray, contacts: Sequence[int]) -> None:
        """Begin the onset of released contacts."""
        places = [self._place[i] for i in contacts if i in self._place]
        for k in places:
            self._begin(k, t, self._toward[k])
        for k in places:
            self._turn(k, t, x)

    def _begin(self, k: int, t: float, toward: np.ndarray) -> None:
        self._onsets[k] = *(toward / np.linalg.norm(toward)), 0.0, t

    def set_together(
        self, t: float, contacts: Sequence[int], velocities: Sequence[np.ndarray]
    ) -> None:
        """Begin the onset of contacts on one body, whose velocities fit each other already."""
        for i, v in zip(contacts, velocities, strict=True):
            if i in self._place:
                self._begin(self._place[i], t, v)
                self._joint.add(self._place[i])

    def sweep(self, t: float, x: np.ndarray) -> None:
        """Turn directions of onset until they fit each other.

        Those that do not converge end with the first step, since their error is large: then the
        motion turns the velocities itself.
        """
        begun = np.flatnonzero(self._directions.any(axis=1))
        places = [int(k) for k in begun if int(k) not in self._joint]
        for sweep in range(1, _SWEEPS + 1 if places else 0):
            before = self._directions.copy()
            for k in places:
                self._turn(k, t, x)
            if np.abs(self._directions - before).sum() <= _SMALL:
                break
            if sweep % _PATIENCE == 0 and self._turn_together(places, t, x):
                break

    def _turn_together(self, places: list[int], t: float, x: np.ndarray) -> bool:
        """Turn all directions at once, if sweeps take too long; returns whether they fit."""
        before, sizes = self._directions[places], np.array(self._sizes)[places]

        def off(angles: np.ndarray) -> np.ndarray:
            self._directions[places] = np.column_stack([np.cos(angles), np.sin(angles)])
            lacking: np.ndarray = self._call(t, x)[0][2::3][places] / sizes
            return lacking

        first = np.arctan2(before[:, 1], before[:, 0])
        fit = bool(np.abs(off(root(off, first, tol=_SMALL).x)).max() <= _FIT)
        if not fit:
            self._directions[places] = before
        return fit

    def follow(self, t: float, x: np.ndarray) -> None:
        """Find how fast the directions of contacts in onset turn."""
        begun = self._directions.any(axis=1) & (self._onsets[:, 3] == t) & (self._onsets[:, 2] == 0)
        places = [int(k) for k in np.flatnonzero(begun) if int(k) not in self._joint]
        if not places:
            return
        later, ahead = t + self._glance, x + self._glance * self._rates(t, x)[0]
        for k in places * min(len(places), 2):
            self._onsets[k, 2] = 0.0
            still = float(self._call(later, ahead)[0][3 * k + 2])
            self._onsets[k, 2] = 1.0
            change = float(self._call(later, ahead)[0][3 * k + 2]) - still
            turns = _SMALL * self._sizes[k] < abs(still) < abs(change) / self._glance
            self._onsets[k, 2] = -still / change if turns else 0.0

    def _turn(self, k: int, t: float, x: np.ndarray) -> None:
        """Turn a direction until the force of onset is that of sliding.

        A force on the edge of the holding set gives its direction at once; one beyond it does not
        if resistance is anisotropic.
        """
        first = float(np.arctan2(self._directions[k, 1], self._directions[k, 0]))

        def off(turn: float) -> float:
            angle = first + turn
            self._directions[k] = np.cos(angle), np.sin(angle)
            return float(self._call(t, x)[0][3 * k + 2])

        begin = off(0.0)
        small = _SMALL * self._sizes[k]
        if not abs(begin) > small:
            return
        near, turn = 0.0, -np.sign(begin) * 1e-6
        while (end := off(turn)) * begin > 0 and abs(turn) < 2 * np.pi:
            near, turn = turn, turn + np.clip(turn, -0.5, 0.5)
        if not end * begin <= 0:  # other laws than that of largest dissipation may have none
            off(0.0)
            return
        found = root_scalar(off, bracket=(near, turn), method="brentq", xtol=1e-15)
        off(float(found.root))
