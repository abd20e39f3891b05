"""Into which direction a contact in the plane begins to slip: that of its acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import root_scalar

from wormopt.simulation.functions import System
from wormopt.simulation.steps import Call

# Share of the force that does not turn a direction.
_SMALL = 1e-13
_SWEEPS = 30


class Aim:
    """Directions of onset, the entries of `s` after the modes; 0 where there is none."""

    def __init__(
        self, system: System, s: np.ndarray, shared: tuple[tuple[str, np.ndarray], ...]
    ) -> None:
        n = len(system.contacts)
        self._directions = s[n:].reshape(-1, 2)
        self._place = {i: k for k, i in enumerate(system.planar.tolist())}
        self._sizes = [system.contacts[i].nominal_force for i in self._place]
        self._toward = np.zeros((0, 2))
        self._joint: set[int] = set()  # places of what was let go together and must stay in line
        if self._place:
            self._call = Call(system.aims, *shared)

    def is_set(self, contact: int) -> bool:
        """Whether a contact is in its onset."""
        return contact in self._place and bool(self._directions[self._place[contact]].any())

    def clear(self, contact: int) -> None:
        """End the onset of a contact."""
        if contact in self._place:
            self._directions[self._place[contact]] = 0.0
            self._joint.discard(self._place[contact])

    def look(self, t: float, x: np.ndarray) -> None:
        """Note where contacts at rest are pushed, before modes change."""
        if self._place:
            self._toward = self._call(t, x)[0].reshape(-1, 3)[:, :2].copy()

    def set(self, t: float, x: np.ndarray, contacts: Sequence[int]) -> None:
        """Begin the onset of contacts that have been let go."""
        places = [self._place[i] for i in contacts if i in self._place]
        for k in places:
            self._directions[k] = self._toward[k] / np.linalg.norm(self._toward[k])
        for k in places:
            self._turn(k, t, x)

    def set_together(self, contacts: Sequence[int], velocities: Sequence[np.ndarray]) -> None:
        """Begin the onset of contacts on one body, whose velocities fit each other already."""
        for i, v in zip(contacts, velocities, strict=True):
            if i in self._place:
                self._directions[self._place[i]] = v / np.linalg.norm(v)
                self._joint.add(self._place[i])

    def sweep(self, t: float, x: np.ndarray) -> None:
        """Turn what begins to slip until all directions fit each other."""
        begun = np.flatnonzero(self._directions.any(axis=1))
        places = [int(k) for k in begun if int(k) not in self._joint]
        for _ in range(_SWEEPS if len(places) > 1 else 0):
            before = self._directions.copy()
            for k in places:
                self._turn(k, t, x)
            if np.abs(self._directions - before).max() < _SMALL:
                break

    def _turn(self, k: int, t: float, x: np.ndarray) -> None:
        """Turn a direction until the force of onset is that of sliding.

        A force on the edge of what holds tells its direction at once; one beyond does not where
        resistance is not the same all around.
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
        while (end := off(turn)) * begin > 0 and abs(turn) < np.pi / 4:
            near, turn = turn, 4 * turn
        if not end * begin <= 0:  # a law that is not that of most power may have no such direction
            off(0.0)
            return
        found = root_scalar(off, bracket=(near, turn), method="brentq", xtol=1e-15)
        off(float(found.root))
