"""Design a gait: search the order of rest and cycles a period, sharpen it, or say why not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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
from wormopt.systems.spiked.search.trial import Trial
from wormopt.systems.spiked.task import Cost, GaitProblem, Objective, Search, Worm

_SEARCH = Search()
# Limits of a design are exceeded by no more than this share of their size.
_ACCEPTED = 1e-9


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
    if task.objective.is_smooth:
        from wormopt.systems.spiked.design.smooth import smoothest  # few designs need its solver

        found = smoothest(task, settings, survey, bound, report)
    else:
        found = sharpest(task, settings, survey, bound, report)
    timings = {"search": searched - begin, "sharpen": perf_counter() - searched}
    return replace(found, timings_s=timings)


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
