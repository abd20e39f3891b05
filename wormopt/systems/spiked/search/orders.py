"""Orders of rest: the first ones of a search, and their ceilings from link rates and rest alone.

The mode linear program has a share of time for every set of resting masses, which are too many for
a long worm. It is therefore solved by column generation (Gilmore and Gomory; Dantzig and Wolfe). A
small program mixes the velocity patterns found so far; its multipliers are weights of the masses.
The best pattern for these weights is added until none is better than the mix. The best pattern is
found exactly: between two neighbouring resting masses its value does not depend on the rest of the
worm, so the choice of resting masses is a longest path along the chain.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, combinations, permutations
from math import comb
from typing import Any

import highspy
import numpy as np

from wormopt.numerics.linear_program import simplex, solve
from wormopt.systems.shared.sequences import (
    Resting,
    Sequence_,
    block_wave_sequence,
    is_gait,
    mirrored,
    sequences,
    wave_orders,
)
from wormopt.systems.spiked.gait_problem import GaitProblem

# Shares of the speed: smallest gain for which a pattern is added, and largest distance of a best
# mix from the optimum. The solver's tolerance must be below the first.
_WORTHWHILE = 2e-10
_SOLVED = 1e-10
_SAME = 1e-8
_TOLERANCE = 1e-10
# Shares of the largest rate: slower links count as this fast, which the solver can distinguish from
# 0; slower masses count as resting in the choice of the unit of speed.
_SLOWEST = 1e-6
_TINY = 1e-9
# Rounds after which the bound is used without convergence; 32 links take about 100.
_ROUNDS = 500
# Largest relative error of sums of some hundred terms of one sign.
_ROUNDING = 1e-13
# Largest number of links of waves with twice as many phases.
_HANDED_OVER = 6
# Sets drawn per mass in the search for mixes of few sets.
_DRAWS = 4


@dataclass(frozen=True)
class ModeMix:
    """Modes that together reach the ceiling; lengths are periodic if modes alternate.

    The largest weighted sum of velocities within the limits is the ceiling, which proves it.
    """

    ceiling: float  # upper bound on the mean speed, see `ceiling`
    speed: float  # mean speed of this mix, the ceiling to about 1e-9
    sets: tuple[tuple[int, ...], ...]  # resting masses of each mode, sorted
    shares: tuple[float, ...]  # of time, for each mode
    velocities: tuple[tuple[float, ...], ...]  # of all masses, for each mode
    weights: tuple[float, ...]  # multipliers of the masses, with sum 1


def ceiling(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    sets: Iterable[Iterable[int]] | None = None,
) -> float:
    """Upper bound on the mean speed from link rates -l_j', l_j' (n,) and resting masses.

    Mode linear program, for any period and order of modes. The result is at most about 1e-9 above
    the optimum and never below it: weights of the masses prove it for any rounding, and its sums
    are rounded up. Rates count as at least 1e-6 of the fastest. See section 7 of the page on
    kinematic theory.
    """
    given = sorted({tuple(sorted(set(z))) for z in sets or ()}) or None
    return _generate(np.array([contraction, extension], float), resting, given).ceiling


def best_modes(
    contraction: Sequence[float],
    extension: Sequence[float],
    resting: int,
    count: int = 1,
) -> tuple[ModeMix, ...]:
    """Find up to `count` mixes of few modes that reach the ceiling, fewest resting sets first.

    Sets are removed in random order. No set of a returned mix can be removed, but smaller mixes
    may exist. Raises ArithmeticError if none reaches the ceiling to 1e-8 of it.
    """
    rates = np.array([contraction, extension], float)
    whole = _generate(rates, resting, None)
    if whole.speed < whole.ceiling * (1 - _SAME):
        raise ArithmeticError("no modes that reach the ceiling were found: rates differ too much")
    rng, found = np.random.default_rng(0), {}
    for _ in range(count):
        mix = _thinned(whole, rates, _perhaps_used(whole, rates, rng))
        found.setdefault(mix.sets, mix)
    return tuple(sorted(found.values(), key=lambda mix: (len(mix.sets), mix.sets)))


def _perhaps_used(
    whole: ModeMix, rates: np.ndarray, rng: np.random.Generator
) -> list[tuple[int, ...]]:
    """Draw resting sets of optimal mixes: those whose weighted sum is the ceiling."""
    resting = len(whole.sets[0])
    gains = _Chain(rates / whole.ceiling).gains(np.array(whole.weights))
    behind = _longest_paths(gains[::-1, ::-1].T, resting)[0][:, ::-1]
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


def _thinned(whole: ModeMix, rates: np.ndarray, sets: list[tuple[int, ...]]) -> ModeMix:
    """Remove sets, many at a time at first, while the others reach the ceiling."""
    mix, size = whole, len(sets)
    while size := size // 2:
        start = 0
        while start < len(sets):
            others = sets[:start] + sets[start + size :]
            fewer = _generate(rates, len(sets[0]), others) if others else None
            if fewer and fewer.speed >= whole.ceiling * (1 - _SAME):
                mix, sets = fewer, others
            else:
                start += size
    # weights that prove optimality for fewer sets do not prove it for all
    return replace(mix, ceiling=whole.ceiling, weights=whole.weights)


def _generate(rates: np.ndarray, resting: int, sets: list[tuple[int, ...]] | None) -> ModeMix:
    """Solve the mode linear program by column generation."""
    masses = rates.shape[1] + 1
    blocks = (range(start, start + resting) for start in range(masses))
    first = sets or [tuple(sorted(i % masses for i in block)) for block in blocks]
    rates = np.maximum(rates, _SLOWEST * rates.max())  # this can only raise the ceiling
    # Tolerances of the solver are absolute, so the speed of the first mix becomes the unit.
    unit = float(rates.max())
    speed = _Mixer(_Chain(rates / unit), first).mix()[0]
    unit *= speed if speed > _TINY else 1.0
    chain = _Chain(rates / unit)
    mixer = _Mixer(chain, first)
    bound, best = np.inf, np.zeros(masses)
    speed = 0.0
    for _ in range(_ROUNDS):
        speed, weights = mixer.mix()
        values, offered = _offer(chain.gains(weights), resting, sets)
        if (proven := _proven(values, weights)) < bound:
            bound, best = proven, weights
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


def _proven(values: np.ndarray, weights: np.ndarray) -> float:
    """Proven bound on the speed from the largest weighted sums of velocities of the resting sets.

    If all masses advance alike, the speed is such a sum over the sum of the weights, accumulated as
    in `_Chain.gains`. Any weights give a bound; sums of terms of one sign have a known error.
    """
    return float(values.max() / np.cumsum(weights)[-1]) * (1 + _ROUNDING)


class _Mixer:
    """Fastest mixes of velocity patterns in which all masses advance alike.

    The fastest motions of the resting sets `sets` are included from the start.
    """

    def __init__(self, chain: _Chain, sets: list[tuple[int, ...]]) -> None:
        self._solver = simplex(
            small_matrix_value=1e-12,
            primal_feasibility_tolerance=_TOLERANCE,
            dual_feasibility_tolerance=_TOLERANCE,
        )
        self._solver.changeObjectiveSense(highspy.ObjSense.kMaximize)
        self._rows = np.arange(chain.masses + 1, dtype=np.int32)
        self._sets: list[tuple[int, ...]] = []
        self._patterns: list[np.ndarray] = []
        self._units: list[float] = []
        nothing = np.empty(0, np.int32), np.empty(0)
        self._solver.addCol(1.0, 0.0, np.inf, 0, *nothing)  # the speed
        for _ in range(chain.masses):  # velocity of the mass = speed
            self._solver.addRow(0.0, 0.0, 1, self._rows[:1], np.array([-1.0]))
        self._solver.addRow(1.0, 1.0, 0, *nothing)  # sum of shares
        self.add((), np.zeros(chain.masses))  # ensures that a mix exists
        for z in sets:
            fastest = chain.fastest_of_all(z)
            self.add(z, fastest)
            self.add(z, np.minimum(fastest, chain.slowest))  # blocks that alternate crawl

    def add(self, resting: tuple[int, ...], velocities: np.ndarray) -> None:
        """Add a pattern."""
        self._sets.append(resting)
        self._patterns.append(velocities)
        # fast patterns have small shares, and the solver drops entries that are too small
        self._units.append(float(np.sqrt(max(1.0, velocities.max()))))
        entries = np.append(velocities, 1.0) / self._units[-1]
        self._solver.addCol(0.0, 0.0, np.inf, len(entries), self._rows, entries)

    def mix(self) -> tuple[float, np.ndarray]:
        """Speed of the best mix, and the weights of the masses that prove it best."""
        values, duals = _solution(self._solver)
        weights = -duals[:-1]
        return float(values[0]), weights / weights.sum()  # the sum is 1 but for rounding

    def modes(self) -> tuple[dict[tuple[int, ...], float], list[np.ndarray]]:
        """Shares and mean velocities of the resting sets in the best mix, sets sorted."""
        parts = _solution(self._solver)[0][1:] / self._units
        way: dict[tuple[int, ...], np.ndarray] = {}
        shares: dict[tuple[int, ...], float] = {}
        for i in sorted(np.flatnonzero(parts > _SOLVED).tolist(), key=lambda i: self._sets[i]):
            z = self._sets[i]
            shares[z] = shares.get(z, 0.0) + float(parts[i])
            way[z] = way.get(z, 0.0) + parts[i] * self._patterns[i]
        return shares, [way[z] / share for z, share in shares.items()]


def _solution(solver: Any) -> tuple[np.ndarray, np.ndarray]:
    """Solve; returns values of the columns and multipliers of the rows."""
    status, _ = solve(solver)
    for tolerance in (_TOLERANCE, 1e-7):  # bounds hold for any multipliers
        if status == highspy.HighsModelStatus.kOptimal:
            break
        solver.clearSolver()  # the basis of the last program may be a poor start
        solver.setOptionValue("primal_feasibility_tolerance", tolerance)
        solver.setOptionValue("dual_feasibility_tolerance", tolerance)
        status, _ = solve(solver)
    if status != highspy.HighsModelStatus.kOptimal:
        raise ArithmeticError(f"the mode linear program failed: {status}")
    solution = solver.getSolution()
    return np.array(solution.col_value), np.array(solution.row_dual)


class _Chain:
    """Velocities within link rates; `rates` (2, n) are of contraction and extension.

    Nodes are the masses, numbered from 1, and a virtual resting one at each end, with a link too
    fast to matter. Every section of the chain is thus between two resting nodes.
    """

    def __init__(self, rates: np.ndarray) -> None:
        self.masses = rates.shape[1] + 1
        self._rates, self.slowest = rates, rates.min()
        self._fast = rates.sum()  # no mass is faster while another one rests
        ends = np.full((2, 1), self._fast)
        self._contraction, self._extension = np.hstack([ends, rates, ends])
        behind = np.concatenate([[0.0], np.cumsum(rates[0])])
        ahead = np.concatenate([[0.0], np.cumsum(rates[1])])
        # A mass behind a resting one is at most as fast as the links between them contract, a mass
        # ahead at most as fast as they extend.
        self._reach = np.maximum(behind - behind[:, None], ahead[:, None] - ahead)

    def fastest_of_all(self, resting: tuple[int, ...]) -> np.ndarray:
        """Largest velocity of every mass; all can be reached at the same time."""
        return self._reach[list(resting)].min(axis=0)

    def fastest(self, weights: np.ndarray, resting: tuple[int, ...]) -> np.ndarray:
        """Velocities with the largest sum, weighted by `weights` (n + 1,), head first.

        Dynamic programming from the head: the largest sum over a mass and those ahead is a concave
        function of its velocity from 0 on, stored as segments in order of slope.
        """
        ahead = np.concatenate([[0.0], np.cumsum(weights)]).tolist()
        levels: list[float] = []  # slope = sum of weights so far - level
        lengths: list[float] = []
        best, most = np.zeros(self.masses), np.zeros(self.masses)
        links = zip(self._contraction, self._extension, strict=True)
        for i, (c, e) in zip(range(self.masses), links, strict=False):  # links ahead of masses
            place = bisect_right(levels, ahead[i])
            levels.insert(place, ahead[i])
            lengths.insert(place, float(c + e))
            _shorten(levels, lengths, float(e))
            if i in resting:
                levels.clear()
                lengths.clear()
            best[i] = sum(lengths[: bisect_right(levels, ahead[i + 1])])
            most[i] = sum(lengths)
        velocities = best.copy()
        for i in range(self.masses - 2, -1, -1):  # nearest admissible to the best
            least = max(0.0, velocities[i + 1] - self._rates[0, i])
            largest = min(most[i], velocities[i + 1] + self._rates[1, i])
            velocities[i] = min(max(best[i], least), largest)
        return velocities

    def gains(self, weights: np.ndarray) -> np.ndarray:
        """Largest weighted velocity sums between resting nodes ahead and behind, or -inf.

        Shape (n + 3, n + 3). The dual, flows g_j of cost c_j [g]+ + e_j [-g]+, is an isotonic
        regression in u_j = g_j + (weights ahead of link j), solved for all pairs by link.
        """
        ahead = np.concatenate([[0.0], np.cumsum(weights)])
        levels = np.sort(ahead)
        flow = levels - ahead[:, None]
        cost = np.maximum(self._contraction[:, None] * flow, -self._extension[:, None] * flow)
        nodes = self.masses + 2
        lowest, gains = np.zeros((nodes, nodes - 1)), np.full((nodes, nodes), -np.inf)
        for j in range(nodes - 1):
            open_ = lowest[: j + 1]  # one row for every node ahead
            open_[:] = np.minimum.accumulate(open_[:, ::-1], axis=1)[:, ::-1] + cost[j]
            gains[: j + 1, j + 1] = open_.min(axis=1)
        return gains


def _shorten(levels: list[float], lengths: list[float], by: float) -> None:
    """Remove a length from the front of segments."""
    while lengths and lengths[0] <= by:
        by -= lengths.pop(0)
        levels.pop(0)
    if lengths:
        lengths[0] -= by


def _offer(
    gains: np.ndarray, resting: int, sets: list[tuple[int, ...]] | None
) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Largest sums for `_Chain.gains`, and their resting sets: the best of all, or these sets."""
    if sets is None:
        return _best_sets(gains, resting)
    last, most = len(gains) - 1, max(map(len, sets))
    nodes = np.array([[0, *(i + 1 for i in z), *[last] * (most + 1 - len(z))] for z in sets])
    gains[last, last] = 0.0
    return gains[nodes[:, :-1], nodes[:, 1:]].sum(axis=1), sets


def _best_sets(gains: np.ndarray, resting: int) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Find, for every mass, the best set of `resting` masses that contains it.

    More resting masses are never better. Longest paths from either end give, by the number of
    resting masses up to and including a node, the largest gain and the node before it.
    """
    nodes = len(gains)
    ahead, before = _longest_paths(gains, resting)
    behind, after = _longest_paths(gains[::-1, ::-1].T, resting)
    behind, after = behind[:, ::-1], nodes - 1 - after[:, ::-1]
    total = (ahead[1:] + behind[:0:-1])[:, 1:-1]  # position of a mass in its set, mass
    places = total.argmax(axis=0)
    sets = []
    for mass, place in enumerate(places):
        path = [mass + 1]
        for k in range(place + 1, 1, -1):
            path.insert(0, int(before[k, path[0]]))
        for k in range(resting - place, 1, -1):
            path.append(int(after[k, path[-1]]))
        sets.append(tuple(node - 1 for node in path))
    return total.max(axis=0), sets


def _longest_paths(gains: np.ndarray, resting: int) -> tuple[np.ndarray, np.ndarray]:
    """Best choice of at most `resting` resting masses up to every node, from `_Chain.gains`.

    Returns the largest sums by number at rest and last of them, and the previous node; both have
    shape (resting + 1, n + 3).
    """
    value = np.full((resting + 1, len(gains)), -np.inf)
    value[0, 0] = 0.0
    before = np.zeros(value.shape, int)
    for k in range(1, resting + 1):
        through = value[k - 1][:, None] + gains
        before[k], value[k] = through.argmax(axis=0), through.max(axis=0)
        value[k, [0, -1]] = -np.inf  # the virtual nodes do not count
    return value, before


# Largest numbers of sets, and of sequences of them, that are all listed.
_MOST_SETS, _MOST_WORDS = 64, 4000
# Number of solutions of the ceiling's linear program from which orders are made.
_MIXES = 3


def is_mirror_symmetric(task: GaitProblem) -> bool:
    """Whether i -> n - i with l_j -> shortest + longest - l_{n-1-j} maps gaits on gaits."""
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    of_each = [*task.of_each, task.worm.beyond if task.loads_matter else (0.0,)]
    return contraction == extension and all(values == values[::-1] for values in of_each)


def first_orders(task: GaitProblem) -> list[Sequence_]:
    """First orders of every search, for any number of links.

    Head and tail in turn, with and without a block between; the ceiling's resting sets in every
    order; travelling waves. Where resting masses share a load, one mass more also rests for a while
    at each end, or between two phases, and waves also have more resting masses.
    """
    n, fewest = task.worm.links, task.limits.resting
    found = [*_ends_in_turn(n, fewest), *_best_sets_in_turn(task)]
    blocks = {a: tuple(block_wave_sequence(n, a)) for a in task.resting_sizes}
    found += blocks.values()
    waves = wave_orders(n, fewest)
    if fewest + 1 in blocks:
        found.append(_relieved_ends_in_turn(n, fewest))
    if n <= _HANDED_OVER:
        waves += [_handed_over(wave) for a, wave in blocks.items() if a + 1 in blocks]
    if not is_mirror_symmetric(task):
        waves += [mirrored(wave, n + 1) for wave in waves]
    return [s for s in dict.fromkeys([*found, *waves]) if is_gait(s)]


def _handed_over(wave: Sequence_) -> Sequence_:
    """The wave in which, between two phases, the resting masses of both share the load."""
    both = (tuple(sorted({*a, *b})) for a, b in zip(wave, (*wave[1:], wave[0]), strict=True))
    return tuple(chain.from_iterable(zip(wave, both, strict=True)))


def _ends_in_turn(links: int, resting: int) -> Iterator[Sequence_]:
    """Accordions: a block at the head in turn with one at the tail, also with one between."""
    head, tail = tuple(range(resting)), tuple(range(links + 1 - resting, links + 1))
    yield (head, tail)
    spare = links + 1 - resting
    for start in sorted({spare // 2, spare // 3, spare - spare // 3} - {0, spare}):
        yield (head, tuple(range(start, start + resting)), tail)


def _relieved_ends_in_turn(links: int, resting: int) -> Sequence_:
    """The accordion in which a further mass takes load in the middle of each phase."""
    head, more = tuple(range(resting)), tuple(range(resting + 1))
    tail, longer = (tuple(links - i for i in reversed(block)) for block in (head, more))
    return (head, more, head, tail, longer, tail)


def _best_sets_in_turn(task: GaitProblem) -> Iterator[Sequence_]:
    """All cyclic orders of the resting sets in the ceiling's solutions, if these are few."""
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    count = _MIXES if task.worm.links <= 12 else 1
    for mix in best_modes(contraction, extension, task.limits.resting, count=count):
        first, *others = (tuple(sorted(s)) for s in mix.sets)
        if len(others) <= 3:
            yield from ((first, *order) for order in permutations(others))


def search_letters(task: GaitProblem) -> list[Resting]:
    """Sets of resting masses from which orders are made.

    All sets if few, else those of sizes with few sets, and blocks of neighbours that wrap round.
    """
    masses, sizes = task.worm.links + 1, task.resting_sizes
    counts = [comb(masses, size) for size in sizes]
    if sum(counts) <= _MOST_SETS:
        return [s for size in sizes for s in combinations(range(masses), size)]
    least = [size for size, count in zip(sizes, counts, strict=True) if count <= _MOST_SETS]
    found = {s for size in least for s in combinations(range(masses), size)}
    found |= {s for size in sizes for s in block_wave_sequence(task.worm.links, size)}
    return sorted(found, key=lambda s: (len(s), s))


def plain_orders(task: GaitProblem, phases: int | None = None) -> list[Sequence_]:
    """Orders of at most `phases` phases, the highest ceilings first, then the shortest.

    Only short orders have more resting masses than required.
    """
    masses, mirror = task.worm.links + 1, is_mirror_symmetric(task)
    letters = search_letters(task)
    exact = [s for s in letters if len(s) == task.limits.resting]
    found: set[Sequence_] = set()
    for sets, most in ((exact, phases or 4), (letters, min(phases or 3, 3))):
        for count in range(2, most + 1):
            if len(sets) ** count <= _MOST_WORDS * count:
                found |= set(sequences(masses, sets, count, mirror=mirror))
    return sorted(found, key=lambda s: (-_rounded_ceiling(task, s), len(s), s))


def _rounded_ceiling(task: GaitProblem, sequence: Sequence_) -> float:
    """Ceiling of an order to six digits; 0 for long worms, where it takes too long."""
    return float(f"{ceiling_of(task, sequence):.6g}") if task.worm.links <= 8 else 0.0


def ceiling_of(task: GaitProblem, sequence: Sequence_ | None = None) -> float:
    """Bound on the speed by rates and the resting sets of a sequence, or of any, see `ceiling`."""
    return _ceiling_of_sets(task, sequence and frozenset(sequence))


@lru_cache(maxsize=4096)
def _ceiling_of_sets(task: GaitProblem, sets: frozenset[Resting] | None) -> float:
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    return ceiling(contraction, extension, task.limits.resting, sets)
