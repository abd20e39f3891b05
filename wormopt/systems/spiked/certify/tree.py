"""Branch and bound over sequences of resting masses and boxes of durations.

Every gait belongs to one branch of the tree: a sequence and a box that holds the period of its
cycle and the phases' shares of it. A gait that repeats has the period of one repetition. The
relaxation bounds the speed of all gaits of a branch at once. What is below the cutoff is done
with; the rest is cut in two where the relaxed optimum lies, or looked at with finer cells.

Where loads matter there are thousands of sequences, most of which differ in masses that rest
besides others. What is true of all sequences of a family, in which at least certain masses rest
in each phase, need not be proven for each.
"""

from __future__ import annotations

import heapq
import math
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain, combinations, product
from typing import Any, NamedTuple

import numpy as np

from wormopt.numerics.workers import Workers
from wormopt.systems.shared.sequences import Sequence_, canonical
from wormopt.systems.spiked.certify.relaxation import Box, Relaxation, Relaxed
from wormopt.systems.spiked.task import GaitProblem

CELLS = 2  # per phase, to begin with
_MOST_CELLS = 128
# Products count as tight where they explain less than this share of what is above the cutoff.
_TIGHT = 0.2
# Sides are narrow if their slack is no more than this share of the square of what they hold.
_NARROW = 0.02
# Ratio of the longest period of a box to its shortest.
_WIDEST = 2.0
# Sides are not cut any further; periods and longest periods are 1.
_NARROWEST = 1e-6
# A cut leaves at least this share of an interval on either side.
_LEAST_SHARE = 0.35
# Periods of cycles are quotients.
_ROUNDING = 1e-15
# Families of so many sequences are divided first, larger ones where loads are to blame.
_FEW = 16
# Programs that each process keeps, some megabytes each.
_KEPT = 200
# Branches of a job, boxes after which it ends, and jobs between two looks at the whole tree, for
# each process.
_SENT, _BOXES, _JOBS = 4, 16, 2


# Sequences of as many phases, in phases of one order.
Family = tuple[Sequence_, ...]


class Node(NamedTuple):
    """All gaits of a sequence in a box."""

    bound: float  # proven: none of them is faster
    sequence: Sequence_  # resting masses, phase by phase
    box: Box  # (min, max) share of the period per phase, then cycle period / longest allowed
    cells: int = CELLS  # per phase, at the next look
    refined: bool = False  # the next look is finer than one before
    family: Family = ()  # all sequences; where several, others may rest besides

    @property
    def more(self) -> tuple[int, ...]:
        """How many masses may rest in each phase besides those of the sequence."""
        most = [max(map(len, sets)) for sets in zip(*self.family, strict=True)]
        return tuple(m - len(s) for m, s in zip(most, self.sequence, strict=False))

    @property
    def durations(self) -> Box:
        """Shortest and longest duration of each phase, as shares of the longest period."""
        *shares, (shortest, longest) = self.box
        return tuple((low * shortest, high * longest) for low, high in shares)


@dataclass(frozen=True)
class Tree:
    """What is known of all gaits, as branches that together contain every one of them."""

    open: tuple[Node, ...]  # in heap order: the largest bound first
    done: float = -np.inf  # largest bound of the branches that are done with
    leaves: tuple[Node, ...] = ()  # branches done with, of sequences in `watched`
    boxes: int = 0  # linear programs solved
    watched: tuple[Sequence_, ...] = ()  # sequences whose leaves are kept, for a picture
    shortest: float = 1.0  # shortest period / longest; cycles last a whole part of a period

    @property
    def bound(self) -> float:
        """Proven: no gait in the tree is faster."""
        return max(self.done, self.open[0].bound if self.open else -np.inf)


def plant(
    sequences: Sequence[Sequence_], watched: Sequence[Sequence_] = (), shortest: float = 1.0
) -> Tree:
    """Begin a tree of which nothing is known yet, from resting masses phase by phase.

    Leaves of `watched` sequences are kept; `shortest` period is a share of the longest.
    """
    halves = (periods(shortest, 0.0, 1 / _WIDEST), periods(shortest, 1 / _WIDEST, 1.0))
    roots = [
        Node(np.inf, common, ((0.0, 1.0),) * len(common) + (period,), family=family)
        for common, family in families(sequences).items()
        for period in halves
    ]
    return Tree(tuple(roots), watched=tuple(watched), shortest=shortest)


class Solver:
    """Grows a tree in several processes, each of which keeps the programs that it needs.

    `workers` defaults to the number of processors.
    """

    def __init__(self, task: GaitProblem, workers: int | None = None) -> None:
        self._workers = Workers(workers)
        self._task, self._programs = task, Programs(task)

    def grow(
        self,
        tree: Tree,
        cutoff: float,
        found: float | None = None,
        look: Look = lambda *_: None,
    ) -> Tree:
        """Look at the most promising branches; the old tree stays as it was, safe to interrupt.

        Branches below `cutoff` are done with; some must be above. `found`: speed of a
        (nearly) best gait. `look` is told branches not done with, or only the most promising.
        """
        if self._workers.count == 1:
            return grow(tree, cutoff, self._programs, found, look)
        first = heapq.nsmallest(_SENT * _JOBS * self._workers.count, tree.open, key=_promise)
        first = [branch for branch in first if branch.bound > cutoff]
        sent = {id(branch) for branch in first}
        first.sort(key=lambda branch: branch.sequence)  # those of a sequence share its program
        jobs = [
            replace(tree, open=tuple(sorted(first[k : k + _SENT], key=_promise)), **_NOTHING_DONE)
            for k in range(0, len(first), _SENT)
        ]
        work = partial(_grown, self._task, cutoff, found)
        parts, seen = zip(*self._workers.map(work, jobs), strict=True)
        for pair in filter(None, seen):
            look(*pair)
        rest = [branch for branch in tree.open if id(branch) not in sent]
        return _joined(tree, rest, parts)

    def close(self) -> None:
        """Let the processes go."""
        self._workers.close()

    def __enter__(self) -> Solver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


Look = Callable[[Node, Relaxed], None]
_NOTHING_DONE: dict[str, Any] = {"done": -np.inf, "leaves": (), "boxes": 0}


class Programs:
    """Relaxations of a task; those used last are kept, with their bases and cuts."""

    def __init__(self, task: GaitProblem) -> None:
        self._task = task
        self._kept = OrderedDict[tuple, Relaxation]()

    def solve(self, branch: Node, cutoff: float) -> Relaxed:
        """Solve the relaxation of a branch; bounds below `cutoff` are not wanted."""
        key = (branch.sequence, branch.cells, branch.more)
        relaxation = self._kept.pop(key, None) or Relaxation(self._task, *key)
        self._kept[key] = relaxation
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return relaxation.solve(branch.box, cutoff)


@lru_cache(maxsize=1)
def _programs(task: GaitProblem) -> Programs:
    return Programs(task)


def _grown(
    task: GaitProblem, cutoff: float, found: float | None, tree: Tree
) -> tuple[Tree, tuple[Node, Relaxed] | None]:
    """Grow a tree for a while; with its most promising branch of those seen, relaxed."""
    seen: list[tuple[Node, Relaxed]] = []
    most = _BOXES if tree.bound < np.inf else len(tree.open)  # first there must be any bound

    def look(branch: Node, relaxed: Relaxed) -> None:
        seen.append((branch, relaxed))

    while tree.boxes < most and tree.open and tree.bound > cutoff:
        tree = grow(tree, cutoff, _programs(task), found, look)
    return tree, max(seen, key=lambda pair: pair[0].bound, default=None)


def _joined(tree: Tree, rest: list[Node], parts: Sequence[Tree]) -> Tree:
    """The tree with these branches as they were, and the others as they have grown."""
    opened = [*rest, *chain(*(part.open for part in parts))]
    return replace(
        tree,
        open=tuple(sorted(opened, key=_promise)),
        done=max(tree.done, *(part.done for part in parts)),
        leaves=(*tree.leaves, *chain(*(part.leaves for part in parts))),
        boxes=tree.boxes + sum(part.boxes for part in parts),
    )


def _promise(branch: Node) -> tuple[float, Node]:
    return -branch.bound, branch


def grow(
    tree: Tree,
    cutoff: float,
    programs: Programs,
    found: float | None = None,
    look: Look = lambda *_: None,
) -> Tree:
    """Look at the two most promising branches; see `Solver.grow`."""
    heap = [(-branch.bound, branch) for branch in tree.open]
    batch: list[Node] = []
    while heap and len(batch) < 2 and -heap[0][0] > cutoff:
        batch.append(heapq.heappop(heap)[1])
    done, leaves, aim = tree.done, list(tree.leaves), cutoff if found is None else found
    for branch in batch:
        relaxed = programs.solve(branch, cutoff)
        known = branch._replace(bound=min(branch.bound, relaxed.bound))
        twigs = []
        if known.bound > cutoff:
            look(known, relaxed)
            twigs = _twigs(known, relaxed, branch.bound, cutoff, aim, tree.shortest)
        for twig in twigs:
            heapq.heappush(heap, (-twig.bound, twig))
        if not twigs:
            done = max(done, known.bound)
            if known.sequence in tree.watched:
                leaves.append(known)
    return replace(
        tree,
        open=tuple(branch for _, branch in heap),
        done=done,
        leaves=tuple(leaves),
        boxes=tree.boxes + len(batch),
    )


def _twigs(
    branch: Node, relaxed: Relaxed, before: float, cutoff: float, aim: float, shortest: float
) -> list[Node]:
    """Parts of a branch, or the branch with finer cells; nothing if that leads no further."""
    if not relaxed.point.size:  # the solver failed
        longest = int(np.argmax(np.ptp(np.array(branch.box), axis=1)))
        return _cut(branch, longest, float(np.mean(branch.box[longest])), shortest)
    least, most = branch.box[-1]
    if most > _WIDEST * least:  # little is true of such different periods at once
        at = math.sqrt(least * most) if least else 0.75 * most
        return _cut(branch, len(branch.sequence), at, shortest)
    tight = _TIGHT * (branch.bound - aim)
    exact = relaxed.losses.sum() < tight
    period = min(max(float(relaxed.point[-1]), least), most)
    fastest, slowest = periods(shortest, period, period)
    if exact and fastest > slowest and most - least >= _NARROWEST:  # no cycle lasts so long
        return _cut(branch, len(branch.sequence), period, shortest)
    narrow = bool(np.all(relaxed.slack < _NARROW * relaxed.point**2 + _NARROWEST))
    vain = branch.refined and before - branch.bound < tight
    few = len(branch.family) <= _FEW
    if any(branch.more) and (few or exact or relaxed.loads > relaxed.losses.sum()):
        return _members(branch)
    if exact and (narrow or not vain):
        if branch.cells < _MOST_CELLS:
            return [branch._replace(cells=2 * branch.cells, refined=True)]
        if relaxed.losses.sum() < branch.bound - cutoff:  # no box is narrow enough
            return []
    if vain and not narrow:  # the box is what is too coarse, whatever the multipliers say
        branch = branch._replace(cells=branch.cells // 2)
    explained = relaxed.losses.sum() > _TIGHT * tight
    side = int(np.argmax(relaxed.losses if explained else relaxed.slack))
    return _cut(branch, side, float(relaxed.point[side]), shortest)


def _members(branch: Node) -> list[Node]:
    """The parts of a family that differ in the phase where most others may rest."""
    phase = int(np.argmax(branch.more))
    twigs = []
    for family in parts(branch.family, phase):
        word = next(iter(family))
        known = (*branch.sequence[:phase], word[phase], *branch.sequence[phase + 1 :])
        sequence = known if len(family) > 1 else word
        twigs.append(branch._replace(sequence=sequence, family=family, refined=False))
    return twigs


def _cut(branch: Node, side: int, at: float, shortest: float) -> list[Node]:
    low, high = branch.box[side]
    if high - low < _NARROWEST:
        return []
    margin = _LEAST_SHARE * (high - low)
    at = min(max(at, low + margin), high - margin)
    parts = [(low, at), (at, high)]
    if side == len(branch.sequence):
        parts = [p for p in (periods(shortest, *part) for part in parts) if p[0] <= p[1]]
    boxes = ((*branch.box[:side], part, *branch.box[side + 1 :]) for part in parts)
    twigs = [_ordered(branch._replace(box=box, refined=False)) for box in boxes]
    return [twig for twig in twigs if all(low <= high for low, high in twig.box)]


def _ordered(branch: Node) -> Node:
    """Of a word that repeats itself the gaits that begin with the shortest of the like phases."""
    word, box = branch.sequence, list(branch.box)
    for k in range(1, len(word)):
        if word[k:] + word[:k] == word and not any(branch.more):
            (least, low), (high, most) = box[0], box[k]
            box[0], box[k] = (least, min(low, most)), (max(least, high), most)
    return branch._replace(box=tuple(box))


def periods(shortest: float, low: float, high: float) -> tuple[float, float]:
    """Shortest and longest period of a cycle in a range; the first is larger if there is none.

    A cycle lasts a whole part of a period between `shortest` and 1.
    """
    fewest = max(1, math.ceil(shortest / high * (1 - _ROUNDING)))
    most = math.floor(1 / low * (1 + _ROUNDING)) if low > 0.0 else math.inf
    least = max(low, shortest / most * (1 - _ROUNDING))
    return least, min(high, 1 / fewest * (1 + _ROUNDING))


def families(words: Sequence[Sequence_]) -> dict[Sequence_, Family]:
    """Sort sequences by the smallest sets of masses that rest in their phases.

    Each sequence occurs once, in some rotation, with those that share the same sets.
    """
    size = min((len(resting) for word in words for resting in word), default=0)
    found: dict[Sequence_, list[Sequence_]] = defaultdict(list)
    for word in words:
        common = _common(word, size)
        turned = canonical(common, 0, mirror=False)
        k = next(k for k in range(len(word)) if common[k:] + common[:k] == turned)
        found[turned].append(word[k:] + word[:k])
    return {common: tuple(family) for common, family in found.items()}


def _common(word: Sequence_, size: int) -> Sequence_:
    """Sets of so many masses of each phase's, neighbours different; else the word itself."""
    for choice in product(*(combinations(resting, size) for resting in word)):
        if all(choice[k] != choice[k - 1] for k in range(len(choice))):
            return choice
    return word


def parts(family: Family, phase: int) -> list[Family]:
    """Divide a family by what rests in a phase."""
    found: dict[tuple[int, ...], list[Sequence_]] = defaultdict(list)
    for word in family:
        found[word[phase]].append(word)
    return [tuple(part) for part in found.values()]
