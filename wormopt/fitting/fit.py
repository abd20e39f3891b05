"""The verb `fit`: estimates parameters from recordings, with their uncertainty."""

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
from wormopt.fitting.levels import noise_of, unexplained
from wormopt.fitting.starts import starts_of
from wormopt.fitting.task import FitTask
from wormopt.progress import Report, silent
from wormopt.simulation.trajectory import NonsmoothEvent

# Standard errors from the best within which starts have the same end.
_SAME = 0.1
# Noise is estimated until it changes by less than this share.
_SETTLED, _MOST_LEVELS = 1e-3, 20


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
        How many starts have to end at the best, and leave noise only, before no other is tried.
        Where they leave more, all are tried.
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
        Not `converged` where it did not come to the bottom, or leaves more than noise and the
        best start is alone, or half of the numbers are at bounds. Other residuals that are no
        noise are warnings: the model may lack something, and all starts were tried.

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
        partial = _fit_of(asked, task, points[0], ends, "interrupted") if points else None
        raise Interrupted(partial) from None
    return _fit_of(asked, task, best, ends)


def _of_starts(
    task: FitTask,
    starts: np.ndarray,
    enough: int,
    nodes: int | None,
    ends: list[Attempt],
    seen: Seen,
    report: Report,
) -> Descent:
    """Descend from starts, one after the other, until enough of them agree."""
    speed, (*ways, last) = contact_speed(task, task.start), ways_of(task, nodes)
    best, first, noisy = None, None, False  # whether the best leaves noise only
    for number, start in enumerate(starts):
        report(f"fitting from start {number + 1} of {len(starts)}", number / len(starts))
        way = ways[number % len(ways)] if noisy or number < len(ways) else last
        try:
            found = approach(task, start, speed, way, seen)
        except (SolveError, ArgumentError) as error:
            first = first or error
            ends.append(Attempt(start, start, np.inf, np.inf, 0))
            continue
        ends.append(Attempt(start, found.theta, found.cost, found.offset, found.evaluations))
        if best is None or found.cost < best.cost:
            best = found
            noisy = not any(unexplained(task, task, task.plain(best.theta)[0]))
        agree = sum(_agrees(best, end) for end in ends)
        if noisy and agree >= enough and best.offset < ARRIVED:
            break
    if best is None:
        assert first is not None
        raise SolveError(
            f"no start of the fit could be simulated: {first}",
            "begin with other numbers, or narrower bounds",
        ) from first
    # by the errors of this noise; estimates may be far smaller later
    ends[:] = [replace(end, agrees=_agrees(best, end)) for end in ends]
    return best


def _agrees(best: Descent, end: Attempt) -> bool:
    """Whether a start ended at the best, except along directions that the data do not determine."""
    if not np.isfinite(end.cost):
        return False
    step = best.jacobian @ (end.theta - best.theta)
    return bool(np.linalg.norm(step) < _SAME * np.sqrt(len(end.theta)))


def _with_levels(
    task: FitTask, best: Descent, estimated: tuple[str, ...]
) -> tuple[FitTask, Descent]:
    """Estimate noise and unknowns in turn until neither changes."""
    for _ in range(_MOST_LEVELS):
        noise = noise_of(task, best.theta, estimated)
        change = max(abs(noise[s] / task.level(s) - 1) for s in estimated)
        task = task.with_noise(noise)
        best = descend(task, best.theta)
        if change < _SETTLED:
            break
    return task, best


def _fit_of(
    asked: FitTask, task: FitTask, best: Descent, ends: list[Attempt], reason: str = ""
) -> Fit:
    """Make the Fit with warnings; `asked` is the task before noise was estimated."""
    ends = sorted(ends, key=lambda end: end.cost)
    found = Fit(
        task=task,
        theta=best.theta,
        residuals=best.residuals,
        jacobian=best.jacobian,
        offset=best.offset,
        converged=False,
        reason=reason,
        starts=tuple(ends),
        estimated=asked.estimated,
    )
    strange = [*unexplained(asked, task, task.plain(best.theta)[0])]
    warnings, same = list(task.warnings), sum(end.agrees for end in ends)
    if same < len(ends) and not reason:
        warnings.append(f"{len(ends) - same} of {len(ends)} starts ended elsewhere, see starts")
    if strange:
        warnings.append(
            f"{'; '.join(strange)}: the model is incomplete, the search ended in a wrong minimum, "
            "or a clock, a unit or a column is wrong"
        )
    warnings += (f"{name} is at its bound" for name in found.at_bound)
    reason = reason or _failing(found, strange)
    return replace(
        found,
        converged=not reason,
        reason=reason,
        warnings=(*warnings, *_doubted(found)),
    )


def _failing(found: Fit, strange: list[str]) -> str:
    """Reason why a search has not converged, if residuals may not be noise; "" if it has."""
    names, same, held = found.names, sum(end.agrees for end in found.starts), found.at_bound
    if strange and 2 * len(held) >= len(names):
        return (
            f"{len(held)} of {len(names)} unknowns are at their bounds, and {strange[0]}; check "
            "units, signs and columns, or write wider bounds"
        )
    if found.offset >= ARRIVED:
        return (
            f"the search did not reach a minimum: {found.offset:.2g} standard errors are left; "
            "events may appear or vanish there; try other starts"
        )
    still = np.flatnonzero(~np.any(found.jacobian, axis=0))
    if strange and still.size:
        return (
            f"the motion does not depend on {', '.join(names[k] for k in still)} here, and does "
            "not fit; write starts at which it depends on them"
        )
    if strange and len(found.starts) > 1 and same < 2:
        return (
            f"only one of {len(found.starts)} starts found the best fit, and {strange[0]}; write "
            "other or more starts, or check the other values of the model"
        )
    return ""


def _doubted(found: Fit) -> list[str]:
    """Warnings about errors from derivatives that do not exist; a line for each run."""
    doubts: dict[str, list[NonsmoothEvent]] = {}
    for run, doubt in found.nonsmooth_events:
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
