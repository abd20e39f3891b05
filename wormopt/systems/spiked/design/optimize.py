"""Designs a gait: searches resting sequence and cycles, refines the result, or explains failure."""

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
# Limits of a design are exceeded by at most this share of their size.
_ACCEPTED = 1e-9
# Periods with a smaller relative difference are equal.
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
    """Design the optimal gait of a worm within limits.

    Parameters
    ----------
    worm : Worm
        Links, masses, drag, load.
    limits : Limits
        Limits of the gait.
    objective : str or Objective, optional
        "speed", which is maximised, or a cost, which is minimised.
    speed : float, optional
        Required mean speed if a cost is minimised.
    search : Search, optional
        Settings of the search.
    report : callable, optional
        Called with a text and the share done, a number from 0 to 1 or None.

    Returns
    -------
    Design
        The best gait found, with its speed, loads (``motion``) and ``violations`` of the limits.

    Raises
    ------
    ArgumentError
        If arguments are invalid or do not fit together.
    SolveError
        If no gait meets the limits; the message names the limits in conflict.
    KeyboardInterrupt
        If the user stops it before a gait is found; later the design is marked "interrupted".

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
            f"the best gait found exceeds {name} by {excess:.2g} of its value",
            "relax limits of very different magnitudes, or try another search.seed",
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
    """Design the optimal gait of a task, as `design`.

    `hints` are resting sequences to try first; `better` is called with every improved trial.
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
            f"write a speed below {bound:.6g}, or relax {' or '.join(keys)}",
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
    """The task without the tick."""
    return replace(task, limits=task.limits.without_ticks())


def ticked(task: GaitProblem, settings: Search, free: Design, report: Report) -> Design:
    """Solve a design again with cycles of whole ticks next to its own, and return the best.

    `free` is the design of the task `without_tick`; its resting sequence is kept. Raises
    SolveError if no cycle of whole ticks has a gait.
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
                f"write a limits.tick below {limits.tick:g}",
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
    """Error for a single moving mass: spikes push forward only, so it never comes to rest."""
    return SolveError(
        "no gait advances: all masses but one rest at any time, and without worm.load nothing "
        "stops that mass, because spikes push forward only and drag decreases with the velocity",
        f"write worm.load above 0, or gait.resting below {task.limits.resting}",
    )


def _nothing(task: GaitProblem, settings: Search, survey: Survey, report: Report) -> BaseException:
    if survey.ended == "interrupted":
        return KeyboardInterrupt()
    if survey.ended == "time limit":
        return SolveError(
            "no gait was found before search.time_limit", "increase search.time_limit"
        )
    if task.limits.resting == task.worm.links and task.worm.load_range[0] <= 0.0:
        return _nothing_slows(task)
    orders = [ascending(settings.sequence)] if settings.sequence else first_orders(task)
    seconds = (settings.time_limit or np.inf) - sum(survey.seconds.values())
    return conflict(task, orders, report, seconds)
