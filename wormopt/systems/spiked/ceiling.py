"""Ceiling on the mean speed by link rates and resting masses alone, and the modes that reach it.

The mode linear program has a share of time for every set of resting masses, far too many to list
for a long worm. So it is solved by column generation (Gilmore and Gomory; Dantzig and Wolfe): a
small program mixes the velocity patterns found so far, its multipliers weigh the masses, and the
best pattern for these weights comes in until none is better than the mix. The best pattern is
found exactly: between two neighbouring masses at rest its value does not depend on the rest of
the worm, and choosing where masses rest is then a longest path along the chain.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.systems.spiked.fastest import Chain, longest_paths, offer_of

__all__ = ["ModeMix", "best_modes", "ceiling"]

# Of the speed: by so much a pattern must beat the mix to be worth adding, and so far from the
# best may a mix be that counts as best. The solver's tolerance must be below the first.
_WORTHWHILE = 2e-10
_SOLVED = 1e-10
_SAME = 1e-8
# Of the largest rate: slower links are taken to be as fast as this, which the solver can tell
# from 0; and what is slower counts as rest where a unit of speed is chosen.
_SLOWEST = 1e-6
_TINY = 1e-9
# Rounds after which the bound stands as it is, true but not sharp; 32 links take about 100.
_ROUNDS = 500
# Sets drawn per mass when mixes of few are sought.
_DRAWS = 4


@dataclass(frozen=True)
class ModeMix:
    """Modes that together reach the ceiling.

    Parameters
    ----------
    ceiling : float
        Upper bound on the mean speed, see `ceiling`.
    speed : float
        Mean speed of this mix, the ceiling to within about 1e-9 of it.
    sets : tuple of tuple of int
        Resting masses of each mode, sorted.
    shares : tuple of float
        Shares of time of the modes.
    velocities : tuple of tuple of float
        Velocities of all masses in each mode. A length is periodic if modes take turns.
    weights : tuple of float
        Multipliers of the masses, with sum 1: no motion within the limits has a larger weighted
        sum of velocities than the ceiling, which proves it.
    """

    ceiling: float
    speed: float
    sets: tuple[tuple[int, ...], ...]
    shares: tuple[float, ...]
    velocities: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]


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
        Distance per time, never below the speed of a gait within these limits: a bound by
        multipliers, true but for rounding, and at most about 1e-9 of it above the optimum. Links
        slower than 1e-6 of the fastest rate count as if they had that rate.

    Raises
    ------
    ArithmeticError
        If a linear program is not solved, which it always can be: rest is feasible.

    Notes
    -----
    For equal rates r and n links it is (n/2 - a + 1) r if 3 a <= n + 2, 2 r/n for a = n - 1 and
    r/(n + 1) for a = n; with n + 2 <= 3 a and 2 a <= n + 1 it is ((n + 2)/3 - a/2) r, checked up
    to n = 59. No closed form is known otherwise. See section 7 of the page on kinematic theory.

    Examples
    --------
    >>> round(ceiling([1.0, 1.0], [1.0, 1.0], resting=1), 12)
    1.0
    >>> round(ceiling([1.0] * 32, [1.0] * 32, resting=8), 9)
    9.0
    """
    return _generate(contraction, extension, resting, _as_sets(sets)).ceiling


def best_modes(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    count: int = 1,
    seed: int = 0,
) -> tuple[ModeMix, ...]:
    """Find mixes of few modes that reach the ceiling; their orders are candidates for gaits.

    Optima are many. In every try, sets that can be part of one are drawn at random and taken out
    again as long as those left still reach the ceiling. So no set can be left out of a mix
    returned, but a mix of entirely different and fewer sets may exist: more tries help.

    Parameters
    ----------
    contraction, extension : sequence of float, shape (n,)
        Largest rates -l_j' and l_j'.
    resting : int
        Masses at rest at any time, 1 <= a <= n.
    count : int
        Most mixes to return, and tries to find them.
    seed : int
        Start of the random order.

    Returns
    -------
    tuple of ModeMix
        Different in their sets, fewest sets first; at least one.

    Raises
    ------
    ArithmeticError
        If no mix is found that reaches the ceiling to 1e-8 of it, as can happen where rates differ
        by many powers of ten.

    Examples
    --------
    >>> (mix,) = best_modes([1.0] * 4, [1.0] * 4, resting=1)
    >>> mix.sets, [round(share, 9) for share in mix.shares]
    (((0,), (4,)), [0.5, 0.5])
    """
    whole = _generate(contraction, extension, resting, None)
    if whole.speed < whole.ceiling * (1 - _SAME):
        raise ArithmeticError("no modes were found that reach the ceiling: rates differ too much")
    rng, found = np.random.default_rng(seed), {}
    for _ in range(count):
        mix = _thinned(
            whole, contraction, extension, _perhaps_used(whole, contraction, extension, rng)
        )
        found.setdefault(mix.sets, mix)
    return tuple(sorted(found.values(), key=lambda mix: (len(mix.sets), mix.sets)))


def _as_sets(sets: Iterable[Iterable[int]] | None) -> list[tuple[int, ...]] | None:
    return sorted({tuple(sorted(set(z))) for z in sets or ()}) or None


def _perhaps_used(
    whole: ModeMix,
    contraction: Sequence[float],
    extension: Sequence[float],
    rng: np.random.Generator,
) -> list[tuple[int, ...]]:
    """Draw resting sets that a best mix can have: those whose weighted sum is the ceiling."""
    rates, unit, resting = np.array([contraction, extension]), whole.ceiling, len(whole.sets[0])
    gains = Chain(rates / unit).gains(np.array(whole.weights))
    behind = longest_paths(gains[::-1, ::-1].T, resting)[0][:, ::-1]
    sets = set(whole.sets)
    for _ in range(_DRAWS * len(gains)):
        path, value = [0], 0.0
        for left in range(resting, 0, -1):
            ahead = value + gains[path[-1]]
            total = ahead + behind[left]
            path.append(int(rng.choice(np.flatnonzero(total > total.max() - _SAME))))
            value = ahead[path[-1]]
        sets.add(tuple(node - 1 for node in path[1:]))
    return [z for _, z in sorted(zip(rng.permutation(len(sets)), sorted(sets), strict=True))]


def _thinned(
    whole: ModeMix,
    contraction: Sequence[float],
    extension: Sequence[float],
    sets: list[tuple[int, ...]],
) -> ModeMix:
    """Take out sets, many at a time at first, as long as the others reach the ceiling."""
    mix, size = whole, len(sets)
    while size := size // 2:
        start = 0
        while start < len(sets):
            others = sets[:start] + sets[start + size :]
            fewer = _generate(contraction, extension, len(sets[0]), others) if others else None
            if fewer and fewer.speed >= whole.ceiling * (1 - _SAME):
                mix, sets = fewer, others
            else:
                start += size
    # weights that prove the best for fewer sets prove nothing for all
    return replace(mix, ceiling=whole.ceiling, weights=whole.weights)


def _generate(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    sets: list[tuple[int, ...]] | None,
) -> ModeMix:
    """Solve the mode linear program by column generation."""
    masses = len(contraction) + 1
    first = sets or [_block(start, resting, masses) for start in range(masses)]
    rates = np.array([contraction, extension], float)
    rates = np.maximum(rates, _SLOWEST * rates.max())  # which can only raise the ceiling
    # Tolerances of the solver are absolute, so the speed of the first mix becomes the unit.
    unit = float(rates.max())
    speed = _Mixer(Chain(rates / unit), first).mix()[0]
    unit *= speed if speed > _TINY else 1.0
    chain = Chain(rates / unit)
    mixer, offer = _Mixer(chain, first), offer_of(chain, resting, sets)
    bound, best = np.inf, np.zeros(masses)
    speed = 0.0
    for _ in range(_ROUNDS):
        speed, weights = mixer.mix()
        values, offered = offer(chain.gains(weights))
        if values.max() < bound:
            bound, best = float(values.max()), weights
        worthwhile = values > speed + _WORTHWHILE * max(speed, 1.0)
        new = {z for z, better in zip(offered, worthwhile, strict=True) if better}
        if bound <= speed * (1 + _SOLVED) or not new:
            break
        for z in sorted(new):
            mixer.add(z, chain.fastest(weights, z))
    shares, velocities = mixer.modes()
    return ModeMix(
        ceiling=bound * unit,
        speed=speed * unit,
        sets=tuple(shares),
        shares=tuple(shares.values()),
        velocities=tuple(tuple((v * unit).tolist()) for v in velocities),
        weights=tuple(best.tolist()),
    )


def _block(start: int, size: int, masses: int) -> tuple[int, ...]:
    return tuple(sorted((start + i) % masses for i in range(size)))


class _Mixer:
    """Mixes of velocity patterns in which all masses advance alike, as fast as possible.

    Parameters
    ----------
    chain : Chain
        The worm.
    sets : list of tuple of int
        Resting sets whose fastest motion is there from the start.
    """

    def __init__(self, chain: Chain, sets: list[tuple[int, ...]]) -> None:
        self._solver, self._rows = _simplex(), np.arange(chain.masses + 1, dtype=np.int32)
        self._sets: list[tuple[int, ...]] = []
        self._patterns: list[np.ndarray] = []
        self._units: list[float] = []
        nothing = np.empty(0, np.int32), np.empty(0)
        self._solver.addCol(1.0, 0.0, _INFINITE, 0, *nothing)  # the speed
        for _ in range(chain.masses):  # velocity of the mass = speed
            self._solver.addRow(0.0, 0.0, 1, self._rows[:1], np.array([-1.0]))
        self._solver.addRow(1.0, 1.0, 0, *nothing)  # sum of shares
        self.add((), np.zeros(chain.masses))  # so that a mix exists
        for z in sets:
            fastest = chain.fastest_of_all(z)
            self.add(z, fastest)
            self.add(z, np.minimum(fastest, chain.slowest))  # blocks that take turns crawl

    def add(self, resting: tuple[int, ...], velocities: np.ndarray) -> None:
        """Add a pattern."""
        self._sets.append(resting)
        self._patterns.append(velocities)
        # fast patterns have small shares, and the solver drops entries that are too small
        self._units.append(float(np.sqrt(max(1.0, velocities.max()))))
        entries = np.append(velocities, 1.0) / self._units[-1]
        self._solver.addCol(0.0, 0.0, _INFINITE, len(entries), self._rows, entries)

    def mix(self) -> tuple[float, np.ndarray]:
        """Give the speed of the best mix, and the weights of the masses that prove it best."""
        values, duals = _solution(self._solver)
        weights = -duals[:-1]
        return float(values[0]), weights / weights.sum()  # the sum is 1 but for rounding

    def modes(self) -> tuple[dict[tuple[int, ...], float], list[np.ndarray]]:
        """Give shares and mean velocities of the resting sets in the best mix, sets sorted."""
        parts = _solution(self._solver)[0][1:] / self._units
        way: dict[tuple[int, ...], np.ndarray] = {}
        shares: dict[tuple[int, ...], float] = {}
        for i in sorted(np.flatnonzero(parts > _SOLVED).tolist(), key=lambda i: self._sets[i]):
            z = self._sets[i]
            shares[z] = shares.get(z, 0.0) + float(parts[i])
            way[z] = way.get(z, 0.0) + parts[i] * self._patterns[i]
        return shares, [way[z] / share for z, share in shares.items()]


_INFINITE = float("inf")


def _simplex() -> Any:
    """Give an empty linear program to maximise."""
    import highspy

    solver: Any = highspy.Highs()  # its stubs lack half of its methods
    solver.silent()
    for option, value in _OPTIONS.items():
        solver.setOptionValue(option, value)
    solver.changeObjectiveSense(highspy.ObjSense.kMaximize)
    return solver


def _solution(solver: Any) -> tuple[np.ndarray, np.ndarray]:
    """Solve; give values of the columns and multipliers of the rows."""
    import highspy

    solver.run()
    for tolerance in (_TOLERANCE, 1e-7):  # bounds are true for any multipliers
        if solver.getModelStatus() == highspy.HighsModelStatus.kOptimal:
            break
        solver.clearSolver()  # the basis of the last program may be a poor start
        solver.setOptionValue("primal_feasibility_tolerance", tolerance)
        solver.setOptionValue("dual_feasibility_tolerance", tolerance)
        solver.run()
    if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        raise ArithmeticError(f"the mode linear program failed: {solver.getModelStatus()}")
    solution = solver.getSolution()
    return np.array(solution.col_value), np.array(solution.row_dual)


_TOLERANCE = 1e-10
_OPTIONS = {
    "threads": 1,
    "solver": "simplex",
    "small_matrix_value": 1e-12,
    "presolve": "off",  # programs differ little from the last: its basis is worth more
    "primal_feasibility_tolerance": _TOLERANCE,
    "dual_feasibility_tolerance": _TOLERANCE,
}
