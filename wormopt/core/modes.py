"""Which contact holds when: mode sequences, and the ceiling that modes alone put on the speed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wormopt.errors import ArgumentError

__all__ = ["ModeSequence", "ceiling"]


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


def ceiling(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    sets: Iterable[Iterable[int]] | None = None,
) -> float:
    """Upper bound on the mean speed that link-rate limits and resting masses alone allow.

    The mode linear program: each mode (which masses rest) has a share of the period and a
    distance for every moving mass; all masses advance alike and no link changes faster than its
    rate. It holds for any period, any order of modes and any further limit.

    Parameters
    ----------
    contraction, extension : sequence of float, shape (n,)
        Largest rates -l_j' and l_j'.
    resting : int
        Masses at rest at any time, 1 <= a <= n.
    sets : iterable of iterables of int, optional
        Resting sets that may occur; by default all of ``resting`` masses.

    Returns
    -------
    float
        Distance per time, never below the speed of a gait within these limits.

    Raises
    ------
    ArithmeticError
        If the linear program is not solved, which it always can be: rest is feasible.

    Examples
    --------
    >>> round(ceiling([1.0, 1.0], [1.0, 1.0], resting=1), 12)
    1.0
    """
    from scipy import sparse
    from scipy.optimize import linprog

    n, scale = len(contraction), float(max(*contraction, *extension))
    modes = [frozenset(s) for s in (sets or combinations(range(n + 1), resting))]
    # Columns per mode: share of the period, then the distance of every mass.
    width, total = n + 2, (n + 2) * len(modes)
    change = np.zeros((n, width))  # lengthening of link j over the mode
    change[np.arange(n), np.arange(n) + 1] = 1.0
    change[np.arange(n), np.arange(n) + 2] = -1.0
    too_long, too_short = change.copy(), -change
    too_long[:, 0] = -np.asarray(extension) / scale  # tolerances of the solver are absolute
    too_short[:, 0] = -np.asarray(contraction) / scale
    rates = sparse.kron(np.eye(len(modes)), np.vstack([too_long, too_short]), format="csr")
    shares = np.tile(np.eye(1, width), len(modes))
    closed = sparse.csr_matrix(np.tile(change, len(modes)))
    upper = np.full((len(modes), width), np.inf)
    for row, mode in enumerate(modes):
        upper[row, [i + 1 for i in mode]] = 0.0
    head = np.zeros((len(modes), width))
    head[:, 1] = -1.0
    answer = linprog(
        head.ravel(),
        A_ub=rates,
        b_ub=np.zeros(2 * n * len(modes)),
        A_eq=sparse.vstack([sparse.csr_matrix(shares), closed]),
        b_eq=np.concatenate([[1.0], np.zeros(n)]),
        bounds=np.column_stack([np.zeros(total), upper.ravel()]),
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if answer.status != 0:
        raise ArithmeticError(f"the mode linear program failed: {answer.message}")
    return float(-answer.fun) * scale
