"""Which contact holds when: mode sequences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError


@dataclass(frozen=True)
class ModeSequence:
    """Contact states, phase after phase.

    Parameters
    ----------
    phases : tuple of tuple of int
        One entry per contact and phase: 0 sticks, +1 slides forward, -1 slides backward.

    Raises
    ------
    ArgumentError
        If there is no phase, phases differ in their number of contacts, or a state is none.

    Examples
    --------
    >>> ModeSequence.of_resting([{0}, {2}, {1}], 3).phases
    ((0, 1, 1), (1, 1, 0), (1, 0, 1))
    """

    phases: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        if len({len(phase) for phase in self.phases}) != 1:
            raise ArgumentError(
                "a mode sequence needs phases over one and the same set of contacts"
            )
        if not {state for phase in self.phases for state in phase} <= {0, 1, -1}:
            raise ArgumentError("the state of a contact is 0, +1 or -1")

    @classmethod
    def of_resting(cls, resting: Sequence[Iterable[int]], contacts: int) -> ModeSequence:
        """Build a sequence in which the named contacts rest and all others slide forward.

        Parameters
        ----------
        resting : sequence of iterables of int
            Indices of the contacts at rest, one iterable per phase.
        contacts : int
            Number of contacts.

        Returns
        -------
        ModeSequence
            With 0 for the resting contacts and +1 for the others.

        Raises
        ------
        ArgumentError
            If there is no phase, or a phase names a contact that does not exist.
        """
        sets = [frozenset(phase) for phase in resting]
        if not frozenset().union(*sets) <= frozenset(range(contacts)):
            raise ArgumentError(
                f"resting contacts must lie within 0..{contacts - 1}, not in {resting}"
            )
        return cls(tuple(tuple(int(i not in s) for i in range(contacts)) for s in sets))

    @property
    def resting(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the contacts at rest, per phase."""
        return tuple(tuple(i for i, s in enumerate(phase) if s == 0) for phase in self.phases)

    @property
    def states(self) -> np.ndarray:
        """Contact states as an array, shape (phases, contacts)."""
        return np.array(self.phases, dtype=int)
