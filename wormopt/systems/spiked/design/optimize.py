"""Designs a gait: searches resting sequence and cycles, refines the result, or explains failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from time import monotonic, perf_counter
from typing import Any, Literal

import numpy as np
from msgspec import structs

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.given import check_kind
from wormopt.progress import Report, silent
from wormopt.shown import enough
from wormopt.systems.shared.sequences import Sequence_, ascending
from wormopt.systems.spiked.design.design import Design, sharpest
from wormopt.systems.spiked.gait_problem import Cost, GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.search.orders import ceiling_of, first_orders
from wormopt.systems.spiked.search.search import DONE, Known, Survey, search
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.verify import ACCEPTED

_SEARCH = Search()
# Periods with a smaller relative difference are equal.
_SAME = 1e-12
# Settings of the climbs by which gaits of whole ticks are compared.
_HELD, _HELD_STEPS = 1e-9, 40
# Gaits slower than this share of the rates do not advance.
_STANDSTILL = 1e-9
# Number of sequences tried; most have the same limits in conflict.
_MOST = 8
# Number of fastest gaits from which the least cost of a speed is sought where nothing else has it.
_FASTEST = 8
# Smallest and largest relative relaxation of a limit, and the precision of the result.
_LEAST, _FULL, _NEAR = 1e-4, 1e3, 1.0005


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
    for key, message in search.faults_for(worm.links, limits):
        raise ArgumentError(f"search.{key}: {message}")
    if search.certify is not None:
        raise ArgumentError(
            "search.certify: only scenes have this key; leave it out and call wormopt.certify"
        )
    found = designed(task, search, report)
    name, excess = max(found.violations.items(), key=lambda item: item[1])
    if excess > ACCEPTED:
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
    known: Known | None = None,
    better: Callable[[Trial], None] = lambda _: None,
) -> Design:
    """Design the optimal gait of a task, as `design`.

    `known` is from the search of a similar task; `better` is called with every improved trial.
    """
    if task.limits.tick is not None:
        without_tick = structs.replace(task, limits=task.limits.without_ticks())
        free = designed(without_tick, settings, report, known, better)
        return ticked(task, settings, free, report)
    bound = ceiling_of(task)
    required = task.objective.speed
    if required is not None and required > bound:
        raise SolveError(
            f"objective.speed = {required:g} is above the ceiling {bound:.9g} of all gaits, set by "
            + " and ".join(keys := _deciding(task, bound)),
            f"write a speed below {bound:.6g}, or relax {' or '.join(keys)}",
        )
    begin = perf_counter()
    survey = search(task, settings, report, known, better)
    if not survey.trials and survey.bounded and required is not None:
        raise SolveError(
            f"objective.speed = {required:g} is above {survey.bounded.bound:.9g}, the proven bound "
            "on the speed of every gait",
            "design the fastest gait to see which speeds exist, or relax its limits",
        )
    if not survey.trials and survey.ended == "searched" and required is not None and not known:
        survey = _from_the_fastest(task, settings, survey, report, better)
    is_still = (
        task.objective.minimise is None
        and survey.trials
        and (survey.trials[0].value < _STANDSTILL * task.speed_nominal)
    )
    if is_still or not survey.trials:
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


def _from_the_fastest(
    task: GaitProblem,
    settings: Search,
    survey: Survey,
    report: Report,
    better: Callable[[Trial], None],
) -> Survey:
    """Search again from the fastest gaits if these reach the required speed; else `survey`."""
    of_speed = structs.replace(task, objective=Objective())
    fast = search(of_speed, _left(settings, survey), report)
    survey = replace(survey, seconds=survey.seconds | {"fastest gaits": sum(fast.seconds.values())})
    if fast.ended in ("interrupted", "time limit"):
        return replace(survey, ended=fast.ended)
    if not fast.trials:
        return survey
    # straight velocities may just miss a speed that bent ones reach
    best = sharpest(of_speed, settings, fast, ceiling_of(task), report)
    if best.ended == "interrupted":
        return replace(survey, ended="interrupted")
    if best.trial is None or best.trial.value < (task.objective.speed or 0.0):
        return survey
    known = replace(fast.known(_FASTEST), poor=frozenset())
    found = search(task, _left(settings, survey), report, known, better)
    if not found.trials and found.ended == "searched":
        left = _left(settings, survey).time_limit
        until = np.inf if left is None else monotonic() + left
        same = Trier(task, until).with_the_motion(best.trial)
        if same is not None:
            better(same)
            found = replace(found, trials=(same,))
    again = {stage: s + survey.seconds.get(stage, 0.0) for stage, s in found.seconds.items()}
    return replace(
        found,
        tried=survey.tried | found.tried,
        varied=survey.varied + found.varied,
        programs=survey.programs + fast.programs + found.programs,
        seconds=survey.seconds | again,
    )


def _left(settings: Search, survey: Survey) -> Search:
    """Settings with the time that a search left."""
    if settings.time_limit is None:
        return settings
    left = settings.time_limit - sum(survey.seconds.values())
    return structs.replace(settings, time_limit=max(left, 0.0))


def ticked(task: GaitProblem, settings: Search, free: Design, report: Report) -> Design:
    """Solve a design again with cycles of whole ticks next to its own, and return the best.

    `free` is the design of the task without the tick; its resting sequence is kept.
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
            if not trials and task.objective.speed is not None:
                # these cycles may be too slow; that of the fastest gait is not
                with suppress(SolveError):
                    of_speed = structs.replace(task, objective=Objective())
                    fast = designed(of_speed, _left(settings, free.survey), report)
                    ended = ended if fast.ended in DONE else fast.ended
                    trials += _held(task, fast.trial or fast.survey.trials[0], fast.period)
        except KeyboardInterrupt:
            if not trials:
                raise
            ended = "interrupted"
        if not trials:
            raise SolveError(
                f"no gait was found whose cycle is a whole number of ticks near {free.period:.6g}",
                f"write a {limits.name}.tick below {limits.tick:g}",
                free,
            )
        trials.sort(key=lambda trial: -trial.value)
        survey = replace(free.survey, trials=tuple(trials), ended=ended)
        found = _finest(task, settings, survey, free.ceiling, report)
    ticks = round(found.period / (limits.tick or 1.0))
    return replace(
        found,
        gait=found.gait.with_period(limits.whole_ticks(ticks)),
        survey=free.survey,
        timings_s=free.timings_s | {"ticks": perf_counter() - begin},
        free=free,
    )


def _held(task: GaitProblem, start: Trial, period: float) -> Iterator[Trial]:
    """Yield the trial with a cycle of another duration, if it has a gait."""
    trier = Trier(structs.replace(task, limits=structs.replace(task.limits, period=period)))
    held = trier.fitted(start, 1) or trier.near(start.sequence, start.durations, 1)
    if held is not None:
        held = trier.climbed(held, _HELD, _HELD_STEPS)
        yield replace(held, cycles=task.limits.cycles_of(period))


def _nothing(task: GaitProblem, settings: Search, survey: Survey, report: Report) -> BaseException:
    if survey.ended == "interrupted":
        return KeyboardInterrupt()
    if survey.ended == "time limit":
        return SolveError(
            "no gait was found before search.time_limit", "increase search.time_limit"
        )
    if task.limits.resting == task.worm.links and task.worm.load_range[0] <= 0.0:
        return SolveError(
            "no gait advances: all masses but one rest at any time, and without worm.load "
            "nothing stops that mass, because spikes push forward only and drag decreases with "
            "the velocity",
            f"write worm.load above 0, or {task.limits.name}.resting below {task.limits.resting}",
        )
    orders = [ascending(settings.sequence)] if settings.sequence else first_orders(task)
    seconds = (settings.time_limit or np.inf) - sum(survey.seconds.values())
    return _conflict(task, orders, report, seconds)


# -- conflicting limits: each is relaxed only as far as necessary ----------------------------


def _conflict(
    task: GaitProblem, sequences: Sequence[Sequence_], report: Report, seconds: float = np.inf
) -> SolveError:
    """Find the limits in conflict and their smallest relaxation; returns an error to raise."""
    until, orders = monotonic() + seconds, _typical(sequences)

    def least(keys: Sequence[str], given: Mapping[str, float]) -> float:
        """Smallest relaxation of `keys` besides `given` that allows a gait; infinite if none."""
        report(f"relaxing {' and '.join(keys)}", 0.8)

        def exists(share: float, order: Sequence_) -> bool:
            shares = {**given, **dict.fromkeys(keys, share)}
            return monotonic() < until and _exists(_relaxed(task, shares), order, until)

        helped = [order for order in orders if exists(_FULL, order)]
        low, high = _LEAST, _FULL if helped else np.inf
        while low * _NEAR < high < np.inf and monotonic() < until:
            share = float(np.sqrt(low * high))
            still = [order for order in helped if exists(share, order)]
            helped, low, high = (still, low, share) if still else (helped, share, high)
        return high

    keys = [key for key in _RELAXATIONS if _relaxed(task, {key: _FULL}) != task]
    alone = {key: share for key in keys if np.isfinite(share := least([key], {}))}
    if alone:
        found, word = dict(sorted(alone.items(), key=lambda item: item[1])), " or "
    elif np.isfinite(least(keys, {})):
        found, word = _together(keys, least), " and "
    else:
        return SolveError(
            "no resting sequence has a gait, even with all limits relaxed a thousandfold",
            'write limits that match the size of the motion, or try search.effort = "thorough" or '
            "another search.seed",
        )
    needed = word.join(_change(task, key, share) for key, share in found.items())
    return SolveError(
        f"no gait meets these limits together; a gait exists with {needed}",
        "relax one of these limits" if word == " or " and len(found) > 1 else "relax as stated",
    )


def _together(
    keys: list[str], least: Callable[[Sequence[str], Mapping[str, float]], float]
) -> dict[str, float]:
    """A minimal set of limits, each relaxed no farther than the others require."""
    for key in list(keys):
        if np.isfinite(least(fewer := [k for k in keys if k != key], {})):
            keys = fewer
    shares = dict.fromkeys(keys, least(keys, {}))
    for key in keys:
        shares[key] = least([key], {k: share for k, share in shares.items() if k != key})
    return shares


def _exists(task: GaitProblem, order: Sequence_, until: float) -> bool:
    trier = Trier(task, until=until, work=1.0)  # one step is enough
    trial = trier.free(order)
    if trial is None or (trial := trier.fit(trial)) is None:
        return False
    return task.objective.speed is not None or trial.value > _STANDSTILL * task.speed_nominal


def _relaxed(task: GaitProblem, shares: Mapping[str, float]) -> GaitProblem:
    """The task with limits relaxed by these shares; limits that are not given remain so."""
    for key, share in shares.items():
        part, _, name = key.partition(".")
        value = getattr(getattr(task, part), name)
        if value is not None:
            changed = {name: _RELAXATIONS[key](value, 1.0 + share)}
            task = structs.replace(task, **{part: structs.replace(getattr(task, part), **changed)})
    return task


def _deciding(task: GaitProblem, bound: float) -> list[str]:
    """Limits that determine the ceiling `bound`; all given ones if none does alone."""
    keys = ("limits.rate", "limits.acceleration", "limits.resting", "limits.length")
    given = [key for key in keys if _relaxed(task, {key: _FULL}) != task]
    raised = [k for k in given if ceiling_of(_relaxed(task, {k: _FULL})) > bound * _NEAR]
    return list(map(task.key_of, raised or given))


def _change(task: GaitProblem, key: str, share: float) -> str:
    part, _, name = key.partition(".")
    old, new = (getattr(getattr(t, part), name) for t in (task, _relaxed(task, {key: share})))
    if isinstance(old, int | float) and isinstance(new, int | float):
        change = "larger" if new > old else "smaller"
        return f"{task.key_of(key)} {change} by {enough(abs(new - old), 3):g}"
    return f"{task.key_of(key)} wider by {enough(100 * share, 3):g} %"


def _raised(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_raised(item, factor) for item in value)
    if isinstance(value, Rates):
        return Rates(_raised(value.contraction, factor), _raised(value.extension, factor))
    return value * factor


def _widened(value: Any, factor: float) -> Any:
    if isinstance(value[0], tuple):
        return tuple(_widened(item, factor) for item in value)
    low, high = value
    return low, low + (high - low) * factor


def _longer(value: Any, factor: float) -> Any:
    low, high = value if isinstance(value, tuple) else (value, value)
    return low, high * factor


_RELAXATIONS: dict[str, Callable[[Any, float], Any]] = {
    "limits.spike_load": _raised,
    "limits.actuator_force": _raised,
    "limits.sigma_margin": lambda value, factor: value / factor,
    "limits.resting": lambda value, factor: max(1, int(value / factor)),
    "objective.speed": lambda value, factor: value / factor,
    "limits.rate": _raised,
    "limits.acceleration": _raised,
    "limits.length": _widened,
    "limits.period": _longer,
}


def _typical(sequences: Sequence[Sequence_]) -> list[Sequence_]:
    """Short orders of few and of many resting masses: loads need many, rates and lengths few."""
    by_size: dict[int, list[Sequence_]] = {}
    for sequence in sorted(sequences, key=len):
        by_size.setdefault(min(map(len, sequence)), []).append(sequence)
    sizes = sorted(by_size)
    outer = sizes if len(sizes) <= _MOST // 2 else [*sizes[:2], *sizes[-2:]]
    return [sequence for size in outer for sequence in by_size[size][: _MOST // len(outer)]]
