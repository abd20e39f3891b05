"""Design a gait: search the order of rest and cycles a period, sharpen it, or say why not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from time import perf_counter
from typing import Literal

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.given import check_kind
from wormopt.progress import Report, silent
from wormopt.systems.shared.sequences import Sequence_, ascending
from wormopt.systems.spiked.design.conflict import STANDS, conflict, deciding
from wormopt.systems.spiked.design.design import Design, sharpest
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.search.orders import ceiling_of, first_orders
from wormopt.systems.spiked.search.search import Survey, search
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.task import Cost, GaitProblem, Objective, Search, Worm

_SEARCH = Search()
# Limits of a design are exceeded by no more than this share of their size.
_ACCEPTED = 1e-9
# Periods are alike that differ by a smaller share.
_SAME = 1e-12
# How far gaits of whole ticks are climbed before they are compared, and the most steps of it.
_HELD, _HELD_STEPS = 1e-9, 40


def design(
    worm: Worm,
    limits: Limits,
    objective: Literal["speed"] | Cost | Objective = "speed",
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
    objective : str or Objective, optional
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
    wormopt.errors.SolveError: objective.speed = 2 is above the ceiling 1 of all gaits, set ...
    """
    task = GaitProblem(worm, limits, Objective.of(objective, speed))
    check_kind("search", search, Search)
    for key, message in search.faults(worm.links, limits.resting):
        raise ArgumentError(f"search.{key}: {message}")
    found = designed(task, search, report)
    name, excess = max(found.violations.items(), key=lambda item: item[1])
    if excess > _ACCEPTED:
        raise SolveError(
            f"the best gait found exceeds {name} by {excess:.2g} of its size",
            "relax limits of very different sizes, or try another search.seed",
            found,
        )
    return found


def designed(
    task: GaitProblem,
    settings: Search,
    report: Report,
    hints: Iterable[Sequence_] = (),
    better: Callable[[Trial], None] = lambda _: None,
) -> Design:
    """Design the best gait of a task, as `design`.

    `hints` are orders of rest to try first; `better` gets every trial that beats all before.
    """
    if task.limits.tick is not None:
        free = designed(without_tick(task), settings, report, hints, better)
        return ticked(task, settings, free, report)
    bound = ceiling_of(task)
    required = task.objective.speed
    if required is not None and required > bound:
        raise SolveError(
            f"objective.speed = {required:g} is above the ceiling {bound:.9g} of all gaits, set by "
            + " and ".join(keys := deciding(task, bound)),
            f"require less than {bound:.6g}, or relax {' or '.join(keys)}",
        )
    begin = perf_counter()
    survey = search(task, settings, report, hints, better)
    stands = (
        task.objective.minimise is None
        and survey.trials
        and (survey.trials[0].value < STANDS * task.speed_nominal)
    )
    if stands or not survey.trials:
        raise _nothing(task, settings, survey, report)
    searched = perf_counter()
    found = _finest(task, settings, survey, bound, report)
    timings = {"search": searched - begin, "sharpen": perf_counter() - searched}
    return replace(found, timings_s=timings)


def _finest(
    task: GaitProblem, settings: Search, survey: Survey, bound: float, report: Report
) -> Design:
    if not task.objective.is_smooth:
        return sharpest(task, settings, survey, bound, report)
    from wormopt.systems.spiked.design.smooth import smoothest  # few designs need its solver

    return smoothest(task, settings, survey, bound, report)


def without_tick(task: GaitProblem) -> GaitProblem:
    """The same task with cycles of any length."""
    return replace(task, limits=task.limits.without_ticks())


def ticked(task: GaitProblem, settings: Search, free: Design, report: Report) -> Design:
    """Solve a design again with cycles of whole ticks, the next to its own, and take the best.

    `free` is the design of the task `without_tick`; its order of rest is kept. Raises SolveError
    where no such cycle has a gait.
    """
    begin, limits = perf_counter(), task.limits
    periods = [limits.whole_ticks(count) for count in limits.ticks_of(free.period)]
    if len(periods) == 1 and abs(periods[0] - free.period) <= _SAME * free.period:
        found = replace(free, task=task)
    else:
        trials, ended = list[Trial](), free.ended
        start = free.trial or free.survey.trials[0]
        try:
            for period in periods:
                report(f"solving again for a cycle of {period:g}", 0.96)
                trials += _held(task, start, period)
        except KeyboardInterrupt:
            if not trials:
                raise
            ended = "interrupted"
        if not trials:
            raise SolveError(
                f"no gait was found whose cycle is a whole number of ticks near {free.period:.6g}",
                f"write a limits.tick shorter than {limits.tick:g}",
                free,
            )
        trials.sort(key=lambda trial: -trial.value)
        survey = replace(free.survey, trials=tuple(trials), ended=ended)
        found = _finest(task, settings, survey, free.ceiling, report)
    ticks = round(found.period / (limits.tick or 1.0))
    return replace(
        found,
        gait=found.gait.with_period(limits.whole_ticks(ticks)),  # phases sum to it but for rounding
        survey=free.survey,
        timings_s=free.timings_s | {"ticks": perf_counter() - begin},
        free=free,
    )


def _held(task: GaitProblem, start: Trial, period: float) -> Iterator[Trial]:
    """Yield a trial with its cycle held at another length, if there is a gait of it."""
    trier = Trier(replace(task, limits=replace(task.limits, period=period)))
    held = trier.fitted(start, 1) or trier.near(start.sequence, start.durations, 1)
    if held is not None:
        held = trier.climbed(held, _HELD, _HELD_STEPS)
        yield replace(held, cycles=task.limits.cycles_of(period))


def _nothing_slows(task: GaitProblem) -> SolveError:
    """Tell of a sole moving mass: spikes push forward alone, so m a >= -k v, and it never rests."""
    return SolveError(
        "no gait advances: all masses but one rest at any time, and without worm.load nothing "
        "brings that one to rest, as spikes only push forwards and drag fades with the velocity",
        f"give worm.load above 0, or gait.resting below {task.limits.resting}",
    )


def _nothing(task: GaitProblem, settings: Search, survey: Survey, report: Report) -> BaseException:
    if survey.ended == "interrupted":
        return KeyboardInterrupt()
    if survey.ended == "time limit":
        return SolveError("no gait was found before search.time_limit", "give it more seconds")
    if task.limits.resting == task.worm.links and task.worm.load_range[0] <= 0.0:
        return _nothing_slows(task)
    orders = [ascending(settings.sequence)] if settings.sequence else first_orders(task)
    seconds = (settings.time_limit or np.inf) - sum(survey.seconds.values())
    return conflict(task, orders, report, seconds)
