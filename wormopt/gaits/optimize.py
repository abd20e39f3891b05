"""Design a gait: search the order of rest and cycles a period, sharpen it, or say why not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from wormopt.core.ceiling import ceiling
from wormopt.core.gait import Gait
from wormopt.core.task import Cost, Limits, Objective, Search, Task, Worm
from wormopt.errors import ArgumentError, SolveError
from wormopt.gaits.costs import has_cost_columns, is_energy
from wormopt.gaits.orders import first_orders
from wormopt.gaits.search import Survey, effort_of, search
from wormopt.gaits.sequences import Sequence_
from wormopt.gaits.split import split_matters
from wormopt.gaits.trial import Trial, Trier
from wormopt.gaits.verify import violations
from wormopt.progress import Report, silent
from wormopt.worms.crawl import Crawl, crawl

if TYPE_CHECKING:
    from wormopt.gaits.smooth import Solved

__all__ = ["Design", "design", "designed", "finished"]

# Halving the arcs ends where it gains less than this, relatively, or arcs become too many.
_RESOLVED, _RESOLVED_DRAGGED, _MOST_UNKNOWNS, _MOST_HALVINGS = 1e-9, 1e-7, 1000, 5
# Degree of velocities where drag bends them, and most steps of a climb between two halvings.
_DRAGGED, _STEPS = 3, 15
# Trials within this share of the best are sharpened too: one of them may end higher.
_CLOSE, _TIE = 2e-3, 1e-8
# Excess over a limit, and how many times more trials are sharpened before one within it is found.
_ACCEPTED, _MOST_UNSOUND = 1e-9, 4
_SEARCH = Search()
# Smooth costs are solved for from so many of the best trials.
_POLISHED = 2
# Resolving the energy ends where halving gains less than this share of the whole; limits count as
# kept that are exceeded by less.
_GAINED, _KEPT = 3e-7, 1e-9


@dataclass(frozen=True, eq=False)
class Design:
    """A designed gait with what is known of its quality.

    Parameters
    ----------
    task : Task
        What was asked for.
    gait : Gait
        One cycle of the gait.
    cycles : int
        How many such cycles fill the period.
    sequence : tuple of tuple of int
        Resting masses of a cycle, phase after phase.
    durations : tuple of float
        How long each phase is.
    ceiling : float
        Bound on the speed by rates and resting masses alone, for any gait.
    error : float
        Relative gain in the objective that the last halving of every arc brought.
    survey : Survey
        What was searched.
    solver : mapping
        How the last program ended: violation, arcs, degree and the like.
    timings_s : dict of str to float
        Seconds of each stage.
    ended : str
        "searched"; or "time limit" or "interrupted", where the search was cut short.
    trial : Trial, optional
        The last program, from which multipliers are taken; None for smooth costs.

    Examples
    --------
    >>> worm = Worm(links=1, load=5.0)
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = design(worm, limits)
    >>> round(found.speed, 9), found.sequence, max(found.violations.values()) < 1e-9
    (0.425, ((0,), (1,)), True)
    """

    task: Task
    gait: Gait
    cycles: int
    sequence: Sequence_
    durations: tuple[float, ...]
    ceiling: float
    error: float
    survey: Survey
    solver: dict[str, Any]
    timings_s: dict[str, float]
    ended: str = "searched"
    trial: Trial | None = field(default=None, repr=False)

    @cached_property
    def motion(self) -> Crawl:
        """How the worm crawls with it, in closed form; under the largest load of a range."""
        return self.motion_under(self.task.worm.load_range[1])

    def motion_under(self, load: float) -> Crawl:
        """How the worm crawls with it under some load.

        Parameters
        ----------
        load : float
            On each mass.
        """
        worm, limits = self.task.worm, self.task.limits
        return crawl(self.gait, worm.masses, worm.drag, load, limits.sharing, limits.spike_load)

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.motion.speed

    @property
    def value(self) -> float:
        """The objective as it was optimised: the speed, or a peak load."""
        return self.speed if self.trial is None else abs(self.trial.value)

    @cached_property
    def violations(self) -> dict[str, float]:
        """Excess over each limit by its size; the worst of a load range's ends and middle."""
        low, high = self.task.worm.load_range
        loads = [low] if low == high else [low, (low + high) / 2, high]
        found = [
            violations(self.motion_under(load), self.task.limits, self.cycles) for load in loads
        ]
        return {key: max(excess[key] for excess in found) for key in found[0]}


def design(
    worm: Worm,
    limits: Limits,
    objective: Literal["speed"] | Cost = "speed",
    speed: float | None = None,
    search: Search = _SEARCH,
    report: Report = silent,
) -> Design:
    """Design the best gait of a worm within limits.

    Parameters
    ----------
    worm : Worm
        Links, masses, drag, load.
    limits : Limits
        What the gait must keep to.
    objective : str, optional
        "speed", made large, or a cost, made small.
    speed : float, optional
        Mean speed required where a cost is made small.
    search : Search, optional
        How to search.
    report : callable, optional
        Told what goes on.

    Returns
    -------
    Design
        The best gait found: its speed, loads (``motion``) and how it keeps its limits
        (``violations``).

    Raises
    ------
    ArgumentError
        If the arguments are wrong or do not fit together.
    SolveError
        If no gait meets the limits; the message names those in conflict.
    KeyboardInterrupt
        If the user stops it before a gait was found; later the design is marked interrupted.

    Examples
    --------
    >>> worm = Worm(links=2, load=5.0)
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> round(design(worm, limits).speed, 9)
    0.825666653
    >>> design(worm, limits, "peak_spike_load", speed=2.0)
    Traceback (most recent call last):
    wormopt.errors.SolveError: objective.speed = 2 is above the ceiling 1 that ...
    """
    task = Task(worm, limits, Objective.of(objective, speed))
    for key, message in search.faults(worm.links, limits.resting):
        raise ArgumentError(f"search.{key}: {message}")
    return designed(task, search, report)


def designed(
    task: Task,
    settings: Search,
    report: Report,
    hints: Iterable[Sequence_] = (),
    better: Callable[[Trial], None] = lambda _: None,
) -> Design:
    """Design the best gait of a task, as `design`.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    settings : Search
        How to search.
    report : callable
        Told what goes on.
    hints : iterable of sequences, optional
        Orders of rest that are tried first.
    better : callable, optional
        Given every trial that is better than all before it.

    Returns
    -------
    Design
    """
    bound = _ceiling(task)
    required = task.objective.speed
    if required is not None and required > bound:
        raise SolveError(
            f"objective.speed = {required:g} is above the ceiling {bound:.9g} that gait.rate, "
            "gait.acceleration and gait.resting put on any gait",
            f"require less than {bound:.6g}, or raise gait.rate",
        )
    if task.objective.is_smooth:
        _refuse_load_range(task)
    begin = perf_counter()
    survey = search(task, settings, report, hints, better)
    if not survey.trials:
        raise _nothing(task, settings, survey, report)
    searched = perf_counter()
    if task.objective.is_smooth:
        found = _smooth(task, settings, survey, bound, report)
    else:
        found = _sharpest(task, settings, survey, bound, report)
    timings = {"search": searched - begin, "sharpen": perf_counter() - searched}
    return replace(found, timings_s=timings)


def _ceiling(task: Task) -> float:
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    return ceiling(contraction, extension, task.limits.resting)


def _refuse_load_range(task: Task) -> None:
    low, high = task.worm.load_range
    if low < high:
        raise SolveError(
            f"{task.objective.minimise} depends on the load, and worm.load is a range",
            "give one load, or seek speed or a peak",
        )


def _nothing(task: Task, settings: Search, survey: Survey, report: Report) -> BaseException:
    if survey.ended == "interrupted":
        return KeyboardInterrupt()
    if survey.ended == "time limit":
        return SolveError("no gait was found before search.time_limit", "give it more seconds")
    report("looking for the limits in conflict", 0.8)
    from wormopt.gaits.conflict import conflict  # loads a solver that few designs need

    own = settings.sequence and tuple(tuple(sorted(s)) for s in settings.sequence)
    return conflict(task, [own] if own else first_orders(task))


def _sharpest(task: Task, settings: Search, survey: Survey, bound: float, report: Report) -> Design:
    """Halve the arcs of the best trials until that gains nothing, and take the best vertex."""
    best = survey.trials[0]
    ended, solved = survey.ended, []
    trier, most, sound = Trier(task), max(1, effort_of(settings).width - 1), False
    for k, trial in enumerate(survey.trials[: _MOST_UNSOUND * most]):
        if sound and (k >= most or trial.value < best.value - _CLOSE * abs(best.value)):
            break
        try:
            report("sharpening", 0.9)
            solved.append(_sharpen(trier, trial, quickly=ended != "searched"))
        except KeyboardInterrupt:
            ended = "interrupted"
            solved.append((trial, np.nan))
        if ended != "searched":
            break
        sound = sound or _keeps_split(task, solved[-1][0])
    if sound:
        solved = [s for s in solved if _keeps_split(task, s[0])]
    value = max(trial.value for trial, _ in solved)
    trial, error = min(
        (s for s in solved if s[0].value >= value - _TIE * abs(value)),
        key=lambda s: len(s[0].sequence),
    )
    return _of_trial(task, trial, error, bound, survey, ended)


def _of_trial(
    task: Task, trial: Trial, error: float, bound: float, survey: Survey, ended: str
) -> Design:
    """The gait of a trial as it is."""
    return Design(
        task=task,
        gait=trial.program.gait(trial.point),
        cycles=trial.cycles,
        sequence=trial.sequence,
        durations=tuple(trial.durations.tolist()),
        ceiling=bound,
        error=error,
        survey=survey,
        solver={
            "status": "solved" if ended == "searched" else "cut short",
            "violation": trial.program.bilinear.violation(trial.point.x),
            "arcs_per_phase": trial.program.arcs.tolist(),
            "degree": trial.program.degree + 1,
        },
        timings_s={},
        ended=ended,
        trial=None if task.objective.is_smooth else trial,
    )


def finished(design: Design, trial: Trial) -> Design:
    """Make a design of a trial of the same task, sharpened.

    Parameters
    ----------
    design : Design
        Of the same task.
    trial : Trial
        A better gait.
    """
    sharp, error = _sharpen(Trier(design.task), trial, quickly=False)
    found = _of_trial(design.task, sharp, error, design.ceiling, design.survey, design.ended)
    return replace(found, timings_s=design.timings_s)


def _keeps_split(task: Task, trial: Trial) -> bool:
    """Whether limits hold with the split of all masses that rest in fact, where that matters.

    The program knows of those that are to rest; more may, and take their share.
    """
    if not any(split_matters(task, resting) for resting in trial.sequence):
        return True
    worm, limits, gait = task.worm, task.limits, trial.program.gait(trial.point)
    motions = [
        crawl(gait, worm.masses, worm.drag, load, limits.sharing, limits.spike_load)
        for load in sorted({*worm.load_range, float(np.mean(worm.load_range))})
    ]
    return all(max(violations(m, limits, trial.cycles).values()) < _ACCEPTED for m in motions)


def _sharpen(trier: Trier, trial: Trial, quickly: bool) -> tuple[Trial, float]:
    """Halve arcs until that gains nothing, then solve for what is active exactly.

    With drag the optimum bends velocities: their degree is raised first.
    """
    error = np.inf
    if trier.task.worm.drag and trial.program.degree < _DRAGGED:
        trial = trier.finer(trial, 1e-7, _DRAGGED, parts=1, steps=_STEPS)
    for _ in range(1 if quickly else _MOST_HALVINGS):
        if len(trial.point.x) > _MOST_UNKNOWNS:
            break
        finer = trier.finer(trial, 1e-8, steps=_STEPS)
        error = (finer.value - trial.value) / abs(trial.value or 1.0)
        trial = finer
        if error <= (_RESOLVED_DRAGGED if trier.task.worm.drag else _RESOLVED):
            break
    trial = trier.climbed(trial, tolerance=1e-10, steps=_STEPS)
    point, _ = trial.program.bilinear.sharpen(trial.point)
    return replace(trial, point=point), error


def _smooth(task: Task, settings: Search, survey: Survey, bound: float, report: Report) -> Design:
    """Resolve the best trials of a smooth cost, solve for it from the best, and take the best gait.

    What is compared in the end are costs of gaits, in closed form.
    """
    known = has_cost_columns(task)  # else trials are merely fast
    trials, ended, error = list(survey.trials), survey.ended, np.nan
    solved, error_of_solved = None, np.nan
    try:
        if ended == "searched" and is_energy(task):
            trials, error = _resolved(task, settings, trials, report)
        if ended == "searched" or not known:
            report("solving for the cost", 0.9)
            solved, error_of_solved = _solved(task, trials[:_POLISHED], error, ended)
    except KeyboardInterrupt:
        ended = "interrupted"
    found = []
    if solved is not None:
        found.append(_of_solved(task, solved, survey, bound, error_of_solved, ended))
    if known:
        found.append(_of_trial(task, trials[0], error, bound, survey, ended))
    if found:
        return min(found, key=_cost)
    if ended == "interrupted":
        raise KeyboardInterrupt
    raise SolveError("no motion was found for this cost", "try another search.seed")


def _cost(found: Design) -> float:
    """Smooth cost of a gait; infinite where it keeps its limits worse than solvers do."""
    if max(found.violations.values()) > _KEPT:
        return np.inf
    if found.task.objective.minimise == "acceleration_effort":
        return found.motion.effort
    return found.motion.energy / found.motion.advance


def _resolved(
    task: Task, settings: Search, trials: list[Trial], report: Report
) -> tuple[list[Trial], float]:
    """Halve arcs of the best trials while that helps; best first, and its last relative gain."""
    trier, found = Trier(task), []
    for trial in trials[: 4 * effort_of(settings).width]:
        report("resolving the best orders", 0.85)
        gained = np.inf
        for _ in range(_MOST_HALVINGS):
            if len(trial.point.x) > _MOST_UNKNOWNS / 4:
                break
            finer = trier.finer(trial, 1e-6)
            trial, gained = finer, (finer.value - trial.value) / abs(finer.cost)
            if gained <= _GAINED:
                break
        found.append((trial, gained))
    found.sort(key=lambda one: -one[0].value)
    return [trial for trial, _ in found], found[0][1]


def _solved(
    task: Task, trials: list[Trial], error: float, ended: str
) -> tuple[Solved | None, float]:
    """The best solution from some trials, refined where those are not resolved, and its error."""
    from wormopt.gaits.smooth import refine_cost, solve_cost  # a solver that few designs need

    resolved = is_energy(task)
    found = [s for trial in trials[: 1 if resolved else None] if (s := solve_cost(task, trial))]
    best = min(found, key=lambda s: s.objective, default=None)
    if best is None or resolved or ended != "searched":
        return best, error
    return refine_cost(best)


def _of_solved(
    task: Task, best: Solved, survey: Survey, bound: float, error: float, ended: str
) -> Design:
    from wormopt.gaits.smooth import gait_of_arcs

    mesh = best.program.mesh
    durations = np.bincount(mesh.phase, weights=best.arcs.duration)
    return Design(
        task=task,
        gait=gait_of_arcs(best.arcs, mesh, task.worm.links),
        cycles=best.trial.cycles,
        sequence=best.trial.sequence,
        durations=tuple(durations.tolist()),
        ceiling=bound,
        error=error,
        survey=survey,
        solver={
            "status": best.solution.status,
            "violation": best.solution.violation,
            "arcs_per_phase": mesh.counts,
            "degree": mesh.collocation.degree,
        },
        timings_s={},
        ended=ended,
    )
