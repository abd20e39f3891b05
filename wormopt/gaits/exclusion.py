"""Rule out sequences of resting masses by their relaxations, so that few are left to try."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wormopt.gaits.attempt import Task
from wormopt.gaits.sequences import Sequence_
from wormopt.gaits.tree import Branch, Solver, grow, plant, take

__all__ = ["rule_out"]

# With finer cells the relaxed durations are those of a true gait, nearly.
_CELLS_OF_A_START = 20
# Linear programs in all, and per sequence: more than that takes as long as trying does.
_BOXES, _BOXES_OF_EACH = 40, 12
# Starts from relaxed durations: if these do not help, the bounds are too loose for it.
_STARTS = 2


def rule_out(
    task: Task,
    sequences: Sequence[Sequence_],
    cutoff: Callable[[], float],
    start: Callable[[Branch], None],
) -> set[Sequence_]:
    """Rule out sequences whose gaits are all slower than a cutoff.

    Parameters
    ----------
    task : Task
        Worm and limits.
    sequences : sequence of sequences
        Resting masses, phase after phase.
    cutoff : callable
        Gives the speed that matters, which may rise meanwhile.
    start : callable
        Told a small box of durations that cannot be ruled out, from which to try a gait.

    Returns
    -------
    set of sequences
        Those that are ruled out. Less than possible where it takes too long.

    Examples
    --------
    Two masses that rest in turn cannot move as fast as their links.

    >>> from wormopt.scenes.gait_design import GaitLimits, Objective
    >>> from wormopt.scenes.worm import WormTable
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> task = Task(WormTable(links=1, mass=1.0, load=5.0), limits, Objective(maximise="speed"))
    >>> rule_out(task, [((0,), (1,))], lambda: 0.6, lambda branch: None)
    {((0,), (1,))}
    """
    shortest, longest = task.limits.period_range
    tree, starts = plant(sequences, shortest=shortest / longest), 0
    most = _BOXES + _BOXES_OF_EACH * len(sequences)
    # one thread: what is found must not depend on which of them is faster
    with Solver(task, workers=1) as solver:
        while tree.open and tree.open[0].bound > cutoff():
            if tree.boxes >= most or starts >= _STARTS:
                break
            tree = grow(tree, cutoff(), solver)
            if tree.open and tree.open[0].cells > _CELLS_OF_A_START:
                branch, tree = take(tree)
                start(branch)
                starts += 1
    if tree.done > cutoff():  # of branches that led no further only the bound is known
        return set()
    return set(sequences) - {b.sequence for b in tree.open if b.bound > cutoff()}
