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
    """Modes that together reach the ceiling; a length is periodic if modes take turns.

    No motion within the limits has a larger weighted sum of velocities than the ceiling,
    which proves it.
    """

    ceiling: float  # upper bound on the mean speed, see `ceiling`
    speed: float  # mean speed of this mix, the ceiling to about 1e-9
    sets: tuple[tuple[int, ...], ...]  # resting masses of each mode, sorted
    shares: tuple[float, ...]  # of time, by mode
    velocities: tuple[tuple[float, ...], ...]  # of all masses, by mode
    weights: tuple[float, ...]  # multipliers of the masses, with sum 1


def ceiling(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    sets: Iterable[Iterable[int]] | None = None,
) -> float:
    """Upper bound on the mean speed that link rates -l_j', l_j' (n,) and resting masses allow.

    Mode linear program, for any period and order of modes; at most about 1e-9 above optimum.
    Rates count as ≥ 1e-6 of the fastest. See section 7 of the page on kinematic theory.
    """
    return _generate(contraction, extension, resting, _as_sets(sets)).ceiling


def best_modes(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    count: int = 1,
    seed: int = 0,
) -> tuple[ModeMix, ...]:
    """Find up to `count` mixes of few modes that reach the ceiling, fewest resting sets first.

    Sets are left out in random order; none of a mix returned can be spared, yet smaller
    mixes may exist. Raises ArithmeticError where none reaches the ceiling to 1e-8 of it.
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

    The fastest motions of the resting sets `sets` are there from the start.
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
