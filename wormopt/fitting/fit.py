"""The verb `fit`: recordings in, numbers out, with how well they are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.fitting.descent import (
    ARRIVED,
    Descent,
    Seen,
    approach,
    contact_speed,
    descend,
    ways_of,
)
from wormopt.fitting.estimate import Attempt, Fit
from wormopt.fitting.levels import noise_of
from wormopt.fitting.starts import starts_of
from wormopt.fitting.task import FitTask
from wormopt.progress import Report, silent
from wormopt.simulation.trajectory import Doubt

# Starts end at the same place if they are within so many standard errors of the best.
_SAME = 0.1
# Noise is estimated until it changes by less than this share.
_SETTLED, _MOST_LEVELS = 1e-3, 20
# Residuals so many times the noise said, on average, are more than chance.
_EXPLAINED = 1.5


def fit(
    task: FitTask,
    *,
    seeds: int = 8,
    enough: int = 3,
    nodes: int | None = None,
    seed: int = 0,
    report: Report = silent,
) -> Fit:
    """Find the numbers with which a model reproduces recordings best.

    Parameters
    ----------
    task : FitTask
        What is to be fitted.
    seeds : int, optional
        From how many starts at most: the first is the one given, the others are spread around it
        within the bounds.
    enough : int, optional
        How many starts have to end at the best before no other is tried.
    nodes : int, optional
        At how many readings each run is cut while starts are led downhill (multiple shooting):
        many for long runs, and motions that soon go elsewhere. 0: nowhere; if left out every third
        start is led so, where readings tell all states.
    seed : int, optional
        Of the random numbers that starts are drawn with.
    report : callable, optional
        Told how far it is, see `wormopt.progress`.

    Returns
    -------
    Fit
        Not `converged` where it did not come to the bottom, or the best start is alone and
        leaves more than noise.

    Raises
    ------
    ArgumentError
        If something is of another kind than it should be.
    SolveError
        If no start leads anywhere; the reason is that of the first.
    Interrupted
        If the user stopped it; `partial` is the best fit so far, None before there is one.
    """
    _check(task, seeds, enough, nodes)
    estimated = task.estimated
    ends: list[Attempt] = []
    points: list[Descent] = []  # the best so far, or none

    def seen(point: Descent) -> None:
        if not points or point.cost < points[0].cost:
            points[:] = [point]

    try:
        best = _of_starts(task, starts_of(task, seeds, seed), enough, nodes, ends, seen, report)
        if estimated:
            report("estimating noise", None)
            task, best = _with_levels(task, best, estimated)
    except KeyboardInterrupt:
        partial = _told(task, points[0], ends, estimated, "interrupted") if points else None
        raise Interrupted(partial) from None
    return _told(task, best, ends, estimated)


def _of_starts(
    task: FitTask,
    starts: np.ndarray,
    enough: int,
    nodes: int | None,
    ends: list[Attempt],
    seen: Seen,
    report: Report,
) -> Descent:
    """Lead starts downhill, one after the other, until enough of them agree."""
    speed, ways, best, first = contact_speed(task, task.start), ways_of(task, nodes), None, None
    for number, start in enumerate(starts):
        report(f"fitting from start {number + 1} of {len(starts)}", number / len(starts))
        try:
            found = approach(task, start, speed, ways[number % len(ways)], seen)
        except (SolveError, ArgumentError) as error:
            first = first or error
            ends.append(Attempt(start, start, np.inf, np.inf, 0))
            continue
        ends.append(Attempt(start, found.theta, found.cost, found.offset, found.evaluations))
        best = found if best is None or found.cost < best.cost else best
        if sum(_agrees(best, end) for end in ends) >= enough and best.offset < ARRIVED:
            break
    if best is None:
        assert first is not None
        raise SolveError(
            f"no start of the fit could be simulated: {first}",
            "begin with other numbers, or narrower bounds",
        ) from first
    return best


def _agrees(best: Descent, end: Attempt) -> bool:
    """Whether a start ended where the best did, but for what the data do not tell."""
    if not np.isfinite(end.cost):
        return False
    step = best.jacobian @ (end.theta - best.theta)
    return bool(np.linalg.norm(step) < _SAME * np.sqrt(len(end.theta)))


def _with_levels(
    task: FitTask, best: Descent, estimated: tuple[str, ...]
) -> tuple[FitTask, Descent]:
    """Estimate noise and numbers in turn until neither changes."""
    for _ in range(_MOST_LEVELS):
        noise = noise_of(task, best.theta, estimated)
        change = max(abs(noise[s] / task.level(s) - 1) for s in estimated)
        task = task.with_noise(noise)
        best = descend(task, best.theta)
        if change < _SETTLED:
            break
    return task, best


def _told(
    task: FitTask,
    best: Descent,
    ends: list[Attempt],
    estimated: tuple[str, ...],
    reason: str = "",
) -> Fit:
    """Say what was found and whether it holds."""
    ends = sorted((replace(end, agrees=_agrees(best, end)) for end in ends), key=lambda e: e.cost)
    same = sum(end.agrees for end in ends)
    plain, _ = task.plain(best.theta)
    excess = float(np.sqrt(np.mean(plain[: task.count] ** 2)))
    warnings = list(task.warnings)
    if same < len(ends):
        warnings.append(f"{len(ends) - same} of {len(ends)} starts ended elsewhere, see starts")
    if excess > _EXPLAINED and not estimated:
        warnings.append(
            f"residuals are {excess:.2g} times the noise said: the model does not tell all, or the "
            "noise is larger"
        )
    if not reason and best.offset >= ARRIVED:
        reason = (
            f"the bottom was not reached: {best.offset:.2g} standard errors are left; events may "
            "appear or vanish there, or other starts help"
        )
    if not reason and len(ends) > 1 and same < 2 and excess > _EXPLAINED:
        reason = f"the best of {len(ends)} starts is alone and leaves {excess:.2g} times the noise"
    found = Fit(
        task=task,
        theta=best.theta,
        residuals=best.residuals,
        jacobian=best.jacobian,
        offset=best.offset,
        converged=not reason,
        reason=reason,
        starts=tuple(ends),
        estimated=estimated,
        warnings=tuple(warnings),
    )
    return replace(found, warnings=(*warnings, *_doubted(found)))


def _doubted(found: Fit) -> list[str]:
    """Where errors rest on derivatives that do not exist; a line for each run."""
    doubts: dict[str, list[Doubt]] = {}
    for run, doubt in found.doubts:
        doubts.setdefault(run, []).append(doubt)
    return [
        f"{run}: derivatives are of one side only at {len(each)} events, first {each[0].reason} of "
        f"{each[0].event.name} at t = {each[0].event.time:.4g}: errors may be larger"
        for run, each in doubts.items()
    ]


def _check(task: object, seeds: object, enough: object, nodes: object) -> None:
    if not isinstance(task, FitTask):
        raise ArgumentError(f"fit takes a FitTask, not {type(task).__name__}")
    for what, count, least in (("seeds", seeds, 1), ("enough", enough, 1), ("nodes", nodes, 0)):
        whole = isinstance(count, int | np.integer) and count >= least
        if not whole and (what != "nodes" or count is not None):
            raise ArgumentError(f"{what} must be a whole number from {least} on, not {count!r}")
