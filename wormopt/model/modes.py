"""Mode sequences: the contacts that rest in each phase."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.given import Frozen, whole


@dataclass(frozen=True)
class ModeSequence(Frozen):
    """Contact states, phase after phase.

    Parameters
    ----------
    phases : sequence of sequence of int
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
        super().__post_init__()
        given = self.phases
        if not (isinstance(given, tuple) and given and all(isinstance(p, tuple) for p in given)):
            raise ArgumentError(
                "phases must be lists of the states of all contacts, one for each phase, for "
                f"example ((0, 1), (1, 0)), not {given!r:.60}"
            )
        if len(set(map(len, given))) > 1:
            raise ArgumentError(
                "all phases must have the same number of contacts, with a state for each, not "
                f"{given!r:.60}"
            )
        if not all(one in (0, 1, -1) for phase in given for one in phase):
            raise ArgumentError(f"states of contacts must be 0, +1 or -1, not as in {given!r:.60}")
        object.__setattr__(self, "phases", tuple(tuple(map(int, phase)) for phase in given))

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
        contacts = whole("contacts", contacts, 1)
        known = range(contacts)
        if not all(isinstance(phase, Iterable) and set(phase) <= set(known) for phase in resting):
            raise ArgumentError(
                f"resting contacts must be sets of numbers from 0 to {contacts - 1}, one for each "
                f"phase, not {resting!r:.60}"
            )
        return cls(tuple(tuple(int(i not in phase) for i in known) for phase in map(set, resting)))

    @property
    def resting(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the contacts at rest, per phase."""
        return tuple(tuple(i for i, s in enumerate(phase) if s == 0) for phase in self.phases)

    @property
    def states(self) -> np.ndarray:
        """Contact states as an array, shape (phases, contacts)."""
        return np.array(self.phases, dtype=int)
