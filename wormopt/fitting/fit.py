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
from wormopt.fitting.levels import MEDIAN, noise_of
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

    Examples
    --------
    How fast does it decay?

    >>> import casadi as ca
    >>> from wormopt.fitting.recording import Recording
    >>> from wormopt.fitting.unknowns import Unknown
    >>> from wormopt.model.model import Model, Signal
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> rates = [Signal("rate", rate, value=1.0)]
    >>> decay = Model("decay", [Signal("x", x, value=1.0)], -rate * x, p=rates)
    >>> seen = Recording([0.5, 1.0, 1.5], {"x": [0.37, 0.14, 0.05]}, span=(0.0, 1.5))
    >>> found = fit(FitTask(decay, [seen], [Unknown("rate")]))
    >>> found.converged, found.values.round(2), found.standard_errors.round(2)
    (True, array([1.98]), array([0.01]))
    """
    _check(task, seeds, enough, nodes)
    asked, estimated = task, task.estimated
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
        partial = _told(asked, task, points[0], ends, "interrupted") if points else None
        raise Interrupted(partial) from None
    return _told(asked, task, best, ends)


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
    # by the errors of this noise; what is estimated later may be far smaller
    ends[:] = [replace(end, agrees=_agrees(best, end)) for end in ends]
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


def _excess(asked: FitTask, task: FitTask, theta: np.ndarray) -> float:
    """How many times what noise explains is left of the signal of which most is left.

    Noise that nobody said is held against how readings scatter from one to the next.
    """
    plain, _ = task.plain(theta)
    left = np.abs(plain[: task.count] * task.deviations / asked.deviations)
    if task.loss == "linear":
        return max(float(np.sqrt(np.mean(left[rows] ** 2))) for rows in task.groups.values())
    return max(float(np.median(left[rows])) / MEDIAN for rows in task.groups.values())


def _told(
    asked: FitTask, task: FitTask, best: Descent, ends: list[Attempt], reason: str = ""
) -> Fit:
    """Say what was found and whether it holds; `asked` is the task before noise was estimated."""
    ends = sorted(ends, key=lambda end: end.cost)
    same = sum(end.agrees for end in ends)
    excess = _excess(asked, task, best.theta)
    warnings = list(task.warnings)
    if same < len(ends) and not reason:
        warnings.append(f"{len(ends) - same} of {len(ends)} starts ended elsewhere, see starts")
    if excess > _EXPLAINED:
        which = "noise said" if not asked.estimated else "scatter of the readings"
        warnings.append(
            f"residuals are {excess:.2g} times the {which}: the model does not tell all, or the "
            "noise is of another kind"
        )
    if not reason and best.offset >= ARRIVED:
        reason = (
            f"the bottom was not reached: {best.offset:.2g} standard errors are left; events may "
            "appear or vanish there, or other starts help"
        )
    still = np.flatnonzero(~np.any(best.jacobian, axis=0))
    if not reason and excess > _EXPLAINED and still.size:
        names = ", ".join(task.names[k] for k in still)
        reason = (
            f"the motion does not depend on {names} here, and does not fit; begin with other "
            "numbers, at which it does"
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
        estimated=asked.estimated,
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
