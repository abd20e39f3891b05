"""Certify a gait: prove how much better any gait of so many phases could be.

A speed is certified by one tree, grown until no branch is left above the target. A peak load at
a required speed is certified by trees too: with the limit lowered a little below what was found,
no gait must reach the speed. How far it can be lowered is the gap. The proof may better the
design.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.given import check_kind, per
from wormopt.progress import Report, silent
from wormopt.shown import lines
from wormopt.systems.shared.sequences import Sequence_, ascending
from wormopt.systems.spiked.certify.relaxation import Relaxed
from wormopt.systems.spiked.certify.tree import Node, Solver, Tree, periods, plant
from wormopt.systems.spiked.design.design import Design, finished
from wormopt.systems.spiked.design.optimize import ticked
from wormopt.systems.spiked.search.orders import all_sequences
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.task import Certify, GaitProblem, Objective, Search

Improve = Callable[[Sequence_, tuple[float, ...]], float]
Ending = Literal["gap reached", "time limit", "finest cells", "interrupted"]

# A limit is lowered in such shares, so that a run that is stopped has proven something.
_SHARES = (0.1, 0.01, 1e-3, 1e-4)
_LIMIT_OF = {"peak_spike_load": "spike_load", "peak_actuator_force": "actuator_force"}
# A try takes as long as some ten programs; it may take a tenth of the time.
_FIRST_TRIES, _BRANCHES_PER_TRY = 2, 40
_SAVED_EVERY = 10.0  # seconds
# Shares of the longest period that are too short to make a gait of.
_SHORTEST = 1e-6
# Relaxed gaits that end below this share of the best speed are not looked at any closer.
_NEAR = 0.95


@dataclass(frozen=True)
class Progress:
    """How far a certificate has come; another run can go on from it."""

    bound: float  # no gait is faster (first: inf) or cheaper (first: 0)
    tree: Tree | None = None  # what is known of all gaits, at this step
    step: int = 0  # number of the step; a cost takes several
    boxes: int = 0  # linear programs solved
    seconds: float = 0.0  # time spent
    history: tuple[tuple[float, float], ...] = ()  # (seconds, bound) whenever the bound improved
    found: float = -np.inf  # speed of the best gait made so far, see `prove`


@dataclass(frozen=True)
class Certificate:
    """How much better than a gait any other could be, proven.

    Parameters
    ----------
    progress : Progress
        What was proven, and how.
    gap : float
        By which share of its own value the gait could be better at most.
    phases : int
        It speaks of gaits of at most so many phases a cycle.
    sequence : tuple of tuple of int, optional
        The one order of rest it speaks of; None for all.
    ending : str
        Why it ended.
    """

    progress: Progress
    gap: float
    phases: int
    sequence: Sequence_ | None
    ending: Ending

    def __repr__(self) -> str:
        scope = "all orders of rest" if self.sequence is None else f"the order {self.sequence}"
        proven = f"bound {self.progress.bound:.9g}, gap {self.gap:.3g} ({self.ending})"
        limited = f"gaits of at most {self.phases} phases a cycle, {scope}"
        return lines(f"Certificate: {proven}", f"{limited}; {self.progress.boxes} boxes")


@dataclass(frozen=True, eq=False)
class Certified:
    """A design with a proof.

    Parameters
    ----------
    design : Design
        The design, or a better one that was found on the way.
    certificate : Certificate
        What is proven, and how.
    """

    design: Design
    certificate: Certificate

    def __repr__(self) -> str:
        shown = (repr(part).partition("\n")[0] for part in (self.design, self.certificate))
        return lines(*(f"Certified {part[0].lower()}{part[1:]}" for part in shown))

    @property
    def bound(self) -> float:
        """No gait of which the certificate speaks is faster, or cheaper."""
        return self.certificate.progress.bound

    @property
    def gap(self) -> float:
        """By which share of its own value the design could be better at most."""
        return self.certificate.gap


def certify(
    design: Design,
    phases: int = Certify.phases,
    gap: float = Certify.gap,
    time_limit: float = Certify.time_limit,
    sequence: Sequence[Sequence[int]] | None = None,
    workers: int | None = None,
    report: Report = silent,
) -> Certified:
    """Prove how much better than a design any gait could be.

    Parameters
    ----------
    design : Design
        Of the speed or of a peak load.
    phases : int, optional
        The proof speaks of all gaits of at most so many phases a cycle, and any number of cycles.
    gap : float, optional
        How much better a gait might still be when it is enough, as a share.
    time_limit : float, optional
        Seconds after which it ends with the gap it has.
    sequence : sequence of sequences of int, optional
        Resting masses of each phase of a cycle in turn; the proof speaks of this order alone then.
    workers : int, optional
        Number of processes; one per processor if left out.
    report : callable, optional
        Told the gap.

    Returns
    -------
    Certified
        The design, or a better one found on the way, with its bound and gap.

    Raises
    ------
    ArgumentError
        If the design's cost has no proof, or an argument is wrong.

    Examples
    --------
    >>> from wormopt.systems.spiked.limits import Limits
    >>> from wormopt.systems.spiked.task import Worm
    >>> from wormopt.systems.spiked.design.optimize import design
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proof = certify(design(Worm(links=1, load=5.0), limits))
    >>> proof.gap <= 1e-3, proof.bound >= proof.design.speed
    (True, True)
    """
    check_kind("design", design, Design)
    if design.task.objective.is_smooth:
        raise ArgumentError(
            f"there is no proof for {design.task.objective.minimise}; seek speed, "
            "peak_spike_load or peak_actuator_force"
        )
    task = design.task
    # lists and arrays are made tuples
    wanted = Certify(phases, gap, time_limit, sequence, workers)  # pyright: ignore[reportArgumentType]
    faults = chain(
        wanted.faults(task.worm.links, task.limits.resting), wanted.faults_of_orders(task)
    )
    for key, message in faults:
        raise ArgumentError(f"{key}: {message}" if key else message)
    return certified(design, wanted, report)


def certified(
    design: Design,
    wanted: Certify,
    report: Report,
    begun: Progress | None = None,
    save: Callable[[Progress], None] = lambda _: None,
) -> Certified:
    """Prove as `prove`; relaxed gaits are starts from which the design may become better."""
    task, trier = design.task, Trier(design.task)
    cost = task.objective.minimise is not None
    if design.free is not None:  # what no gait is better than, none of whole ticks is
        of_free = certified(design.free, wanted, report, begun, save)
        if of_free.design is not design.free:
            again = ticked(task, Search(sequence=of_free.design.sequence), of_free.design, report)
            design = again if again.value > design.value else design
        gap = gap_of(design.value, of_free.certificate.progress.bound, cost)
        return Certified(design, replace(of_free.certificate, gap=gap))
    best: list[Trial] = []

    def improve(sequence: Sequence_, durations: tuple[float, ...]) -> float:
        record = best[-1].value if best else design.value
        free = trier.free(sequence, np.array(durations), enough=_NEAR * record)
        fitted = None if free is None or free.value < _NEAR * record else trier.fit(free)
        if fitted is None:
            return -np.inf
        finer = trier.finer(trier.finer(fitted))
        if finer.value > record + 1e-11 * abs(record):  # by more than rounding
            best.append(finer)
        return finer.value

    begun = begun or _begun(design)
    if not cost:  # what is kept may be of an earlier run
        begun = replace(begun, bound=min(begun.bound, design.ceiling))
    proof = prove(task, design.value, wanted, report, begun, save, improve)
    with suppress(KeyboardInterrupt):  # the design as it was
        better = finished(design, best[-1]) if best else design
        design = better if better.value > design.value else design
    gap = gap_of(design.value, proof.progress.bound, cost)
    return Certified(design, replace(proof, gap=gap))


def _begun(design: Design) -> Progress:
    """What is known before the proof: the ceiling of a speed, that a cost is not negative."""
    bound = design.ceiling if design.task.objective.minimise is None else 0.0
    return Progress(bound, history=((0.0, bound),))


def prove(
    task: GaitProblem,
    value: float,
    wanted: Certify,
    report: Report,
    begun: Progress | None = None,
    save: Callable[[Progress], None] = lambda _: None,
    improve: Improve | None = None,
) -> Certificate:
    """Prove how much better than one of objective `value` any gait could be, unless stopped.

    `begun`: earlier progress on this task and value; `save` gets it too if the gap is open
    at the end. `improve`: a relaxed cycle to a true gait's speed (-inf: none); not for costs.
    """
    cost = task.objective.minimise is not None
    progress = begun = begun or Progress(0.0 if cost else np.inf)
    widest, saved, stopped = 0.0, time.monotonic(), "finest cells"
    until = saved + wanted.time_limit
    try:
        with closing(_prove(task, value, wanted, begun, improve)) as steps:
            for progress in steps:
                gap = gap_of(max(value, progress.found), progress.bound, cost)
                widest = max(widest, gap if gap < np.inf else 0.0)
                report(f"certifying: gap {gap:.2g}", _fraction(gap, widest, wanted.gap))
                if time.monotonic() > saved + _SAVED_EVERY:
                    save(progress)
                    saved = time.monotonic()
                if gap > wanted.gap and time.monotonic() > until:
                    stopped = "time limit"
                    break
    except KeyboardInterrupt:
        stopped = "interrupted"
    gap = gap_of(max(value, progress.found), progress.bound, cost)
    if gap > wanted.gap and stopped != "finest cells":  # else another run has nothing to add
        save(progress)
    own = wanted.sequence
    return Certificate(
        progress=progress,
        gap=gap,
        phases=len(own) if own else wanted.phases,
        sequence=own,
        ending=stopped if gap > wanted.gap else "gap reached",
    )


class _Best:
    """The best speed known, and who may raise it."""

    def __init__(self, task: GaitProblem, speed: float, improve: Improve | None) -> None:
        self.speed = speed
        shortest, self._unit = task.limits.period_range
        self._shortest, self._improve = shortest / self._unit, improve
        self._seen: Counter[Sequence_] = Counter()
        self._tries: Counter[Sequence_] = Counter()

    def look(self, branch: Node, relaxed: Relaxed) -> None:
        """Try a relaxed gait now and then; of one sequence ever fewer, as boxes become alike."""
        if self._improve is None or not relaxed.point.size or len(branch.family) > 1:
            return
        own, seen = branch.sequence, self._seen
        seen[own] += 1
        may = _FIRST_TRIES + seen.total() // _BRANCHES_PER_TRY
        if self._tries.total() < may and seen[own] >= 2 ** self._tries[own]:
            self._tries[own] += 1
            period = periods(self._shortest, min(float(relaxed.point[-1]), 1.0), 1.0)[0]
            if period < _SHORTEST:  # jumps cost no time, so that cycles may be as short as any
                return
            durations = relaxed.point[:-1] * period * self._unit
            found = self._improve(branch.sequence, tuple(durations.tolist()))
            self.speed = max(self.speed, found)


def _prove(
    task: GaitProblem, value: float, wanted: Certify, begun: Progress, improve: Improve | None
) -> Generator[Progress]:
    """Improve a bound step by step; stopping between two steps loses nothing.

    A speed takes one tree. For a cost each tree has its limit lowered further below ``value``,
    and is done when no gait within that limit can have the required speed.
    """
    clock, progress = time.perf_counter() - begun.seconds, begun
    for number, (reduced, required, lowered) in enumerate(_steps(task, value, wanted.gap)):
        if number < begun.step:
            continue
        tree = begun.tree if number == begun.step else None
        tree = tree or _planted(reduced, wanted)
        earlier = progress.boxes - (tree.boxes if number == begun.step else 0)
        best = _Best(task, max(value, begun.found), improve if lowered is None else None)
        with Solver(reduced, wanted.workers) as solver:
            while tree.bound > (cutoff := required or best.speed * (1 + wanted.gap)):
                if not tree.open or tree.open[0].bound <= cutoff:
                    return  # the finest cells do not tell
                tree = solver.grow(tree, cutoff, None if required else best.speed, best.look)
                seconds, bound = time.perf_counter() - clock, progress.bound
                if lowered is None:
                    bound = min(bound, tree.bound)
                elif tree.bound <= cutoff:
                    bound = max(bound, lowered)
                history = progress.history
                if bound != progress.bound:
                    history = (*history, (seconds, bound))
                found = begun.found if required else best.speed
                boxes = earlier + tree.boxes
                progress = Progress(bound, tree, number, boxes, seconds, history, found)
                yield progress


def _planted(task: GaitProblem, wanted: Certify) -> Tree:
    own, phases = wanted.sequence, wanted.phases
    sequences = [ascending(own)] if own else all_sequences(task, phases)
    shortest, longest = task.limits.period_range
    return plant(sequences, [s for s in sequences if len(s) == 3], shortest / longest)


def _steps(
    task: GaitProblem, value: float, gap: float
) -> list[tuple[GaitProblem, float | None, float | None]]:
    """Tasks, the speeds that nothing in them must pass, and the costs that this proves.

    Of a speed only the task: nothing must pass the best gait by more than the gap.
    """
    cost, required = task.objective.minimise, task.objective.speed
    if cost is None or required is None:
        return [(task, None, None)]
    key = _LIMIT_OF[cost]
    given = getattr(task.limits, key)
    fastest, below = Objective(), float(np.nextafter(required, 0.0))
    steps = []
    for share in [*(s for s in _SHARES if s > gap), gap]:
        lowered = value * (1 - share)
        while (value - lowered) / value > share:  # by a rounding
            lowered = float(np.nextafter(lowered, value))
        count = np.size(given) if given is not None else 1
        limit = tuple(min(lowered, g) for g in per(lowered if given is None else given, count))
        limits = replace(task.limits, **{key: limit if count > 1 else limit[0]})
        steps.append((replace(task, limits=limits, objective=fastest), below, lowered))
    return steps


def gap_of(value: float, bound: float, cost: bool) -> float:
    """By which share of its own value a gait could still be better, given a proven bound.

    `cost`: small values are good.
    """
    if not value > 0.0:  # a worm that stands still can be better by any share
        return np.inf
    return (value - bound) / value if cost else (bound - value) / value


def _fraction(gap: float, widest: float, wanted: float) -> float | None:
    """Share of the way on which gaps are multiplied, from the first gap to the wanted one."""
    if not wanted < gap < np.inf or widest <= wanted:
        return None
    return float(np.log(widest / gap) / np.log(widest / wanted))
