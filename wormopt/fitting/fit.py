"""The verb `fit`: estimates parameters from recordings, with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.fitting.estimate import Attempt, Fit
from wormopt.fitting.information import held_at, offset_of, triangle
from wormopt.fitting.noise import noise_of, unexplained
from wormopt.fitting.stretches import Lifted, lifted, states_read
from wormopt.fitting.task import FitTask, Shooting
from wormopt.fitting.unknowns import Coordinate
from wormopt.progress import Report, silent
from wormopt.simulation.options import Smooth
from wormopt.simulation.trajectory import NonsmoothEvent

# Without bounds, numbers are searched within this factor around starts; starts of motions, which
# readings determine, within this share of their nominal size.
_FACTOR, _SHARE = 5.0, 0.1
_HARDLY = 1e-9  # distance of a start from its bounds as a share of its range


def starts_of(task: FitTask, count: int, seed: int) -> np.ndarray:
    """The given start, then a Latin hypercube around it, (count, n)."""
    from scipy.stats.qmc import LatinHypercube

    n = len(task.coordinates)
    if count == 1 or n == 0:
        return task.start[None]
    share = LatinHypercube(n, rng=np.random.default_rng(seed)).random(count - 1)
    states = {state.name for state in task.model.x}
    spread = [
        [_spread(c, s, states) for c, s in zip(task.coordinates, row, strict=True)] for row in share
    ]
    return np.vstack([task.start, spread])


def _spread(coordinate: Coordinate, share: float, states: set[str]) -> float:
    lower, upper, start = coordinate.lower, coordinate.upper, coordinate.start
    if states & set(coordinate.directions):
        found = start + (2 * share - 1) * _SHARE * coordinate.nominal
    elif coordinate.log:
        found = start + (2 * share - 1) * np.log(_FACTOR)
    elif start > 0 and lower >= 0:
        found = start * _FACTOR ** (2 * share - 1)
    else:
        found = start + (2 * share - 1) * _FACTOR * coordinate.nominal
    inside = _HARDLY * min(upper - lower, 1.0)
    return float(np.clip(found, lower + inside, upper - inside))


ARRIVED = 1e-3
"""Standard errors within which a fit has converged."""
# Widths of the smooth law, in typical contact speeds.
_WIDTHS = (1.0, 0.2)
# Default number of nodes, and standard deviation of jumps, in nominal sizes of states.
_NODES, _MANY_NODES, _JUMPS = 6, 20, (0.1, 0.01, 1e-3)
# Most steps; least relative gain of a step if only a start is needed.
_LOOKS, _LOOKS_ROUGH, _GAIN_ROUGH = 100, 20, 1e-1
# Number of restarts of a trust region that shrank at a kink, or reached a bound.
_REGIONS = 4
# Distance in standard errors, of one unknown alone, at which a bound is reached.
_NEAR_A_BOUND = 0.3


@dataclass(frozen=True)
class Descent:
    """End of one descent."""

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    offset: float
    evaluations: int

    @property
    def cost(self) -> float:
        """Half the sum of squares."""
        return float(self.residuals @ self.residuals) / 2


Squares = FitTask | Lifted  # residuals whose sum of squares is minimised
Seen = Callable[[Descent], None]


class _Arrived(Exception):
    """The descent has converged."""


def descend(
    task: Squares,
    theta: np.ndarray,
    seen: Seen = lambda _: None,
    *,
    rough: bool = False,
) -> Descent:
    """Follow Gauss-Newton steps in a trust region until convergence or small gains.

    `seen` gets every point on the path; `rough`: only a start for the next descent is needed.
    Raises SolveError if the motion at the start cannot be simulated.
    """
    best = _look(task, _inside(task, theta), 0)
    for _ in range(_REGIONS):
        before = best
        best = _settled(task, _region(task, best, seen, rough))
        spent = best.evaluations >= _LOOKS
        if rough or spent or best.offset < ARRIVED or best.cost > before.cost * (1 - 1e-6):
            break
    return best


def _region(task: Squares, begin: Descent, seen: Seen, rough: bool) -> Descent:
    """Use SciPy's trust region; points that cannot be simulated are rejected."""
    # Coordinates at a bound stay there.
    from scipy.optimize import least_squares

    free = ~held_at(task.bounds, begin.theta, begin.jacobian.T @ begin.residuals)
    if begin.offset < ARRIVED or not free.any():
        return begin
    points = {begin.theta.tobytes(): begin}
    best, count = begin, begin.evaluations

    def at(part: np.ndarray) -> Descent | None:
        nonlocal best, count
        theta = begin.theta.copy()
        theta[free] = part
        key = theta.tobytes()
        if key not in points:
            count += 1
            points.clear()  # residuals and slopes are requested for one point after the other
            try:
                points[key] = _look(task, theta, 0)
            except (SolveError, ArgumentError):
                return None
        if points[key].cost <= best.cost:
            best = points[key]
            seen(best)
        return points[key]

    # SciPy sees n + 1 rows with the same products: it is slow on tall thin matrices.
    def residuals(part: np.ndarray) -> np.ndarray:
        point = at(part)
        return np.full(free.sum() + 1, np.inf) if point is None else _short(point, free)[:, -1]

    def jacobian(part: np.ndarray) -> np.ndarray:
        point = at(part)
        assert point is not None
        if point.offset < ARRIVED:
            raise _Arrived
        return _short(point, free)[:, :-1]

    with suppress(_Arrived):
        least_squares(
            residuals,
            begin.theta[free],
            jacobian,  # pyright: ignore[reportArgumentType]
            bounds=tuple(bound[free] for bound in task.bounds),
            x_scale="jac",
            max_nfev=_LOOKS_ROUGH if rough else _LOOKS,
            ftol=_GAIN_ROUGH if rough else 1e-12,
            xtol=1e-12,
            gtol=1e-15,
        )
    return replace(best, evaluations=count)


def _short(point: Descent, free: np.ndarray) -> np.ndarray:
    """Jacobian with residuals as last column, as few rows with the same products."""
    return triangle(np.column_stack([point.jacobian[:, free], point.residuals]))


def _settled(task: Squares, found: Descent) -> Descent:
    """Move coordinates near a bound, and pushing against it, to the bound: steps never reach it."""
    lower, upper = task.bounds
    gradient = found.jacobian.T @ found.residuals
    length = np.linalg.norm(found.jacobian, axis=0)
    near = _NEAR_A_BOUND / np.where(length > 0, length, np.inf)
    low = (found.theta - lower < near) & (gradient > 0)
    high = (upper - found.theta < near) & (gradient < 0)
    theta = np.where(low, lower, np.where(high, upper, found.theta))
    if np.array_equal(theta, found.theta):
        return found
    try:
        there = _look(task, theta, found.evaluations)
    except SolveError:
        return found
    return there if there.cost <= found.cost * (1 + 1e-9) else found


def _look(task: Squares, theta: np.ndarray, count: int) -> Descent:
    residuals, jacobian = task.residuals(theta)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        raise SolveError("the motion or its derivatives become infinite or NaN", "")
    free = ~held_at(task.bounds, theta, jacobian.T @ residuals)
    return Descent(theta, residuals, jacobian, offset_of(residuals, jacobian, free), count + 1)


def _inside(task: Squares, theta: np.ndarray) -> np.ndarray:
    """Move strictly between the bounds, as SciPy requires of a start."""
    lower, upper = task.bounds
    room = np.minimum(upper - lower, np.maximum(1.0, np.abs(theta)))
    return np.clip(theta, lower + 1e-10 * room, upper - 1e-10 * room)


@dataclass(frozen=True)
class Way:
    """First stage of a descent, before contact is that of the task and runs are whole."""

    widths: tuple[float, ...] = ()  # of smooth contact, in typical contact speeds
    nodes: int = 0  # number of nodes of each run


def ways_of(task: FitTask, nodes: int | None) -> tuple[Way, ...]:
    """First stages to try in turn: they fail for different problems."""
    # The last is expensive, for when all others have left more than noise.
    if nodes:
        return (Way(nodes=nodes), Way(nodes=nodes))
    rough = isinstance(task.contact, Smooth) or not task.model.contacts
    over = () if rough else (Way(_WIDTHS), Way(_WIDTHS[:1]))
    if nodes is None and all(_is_read(shooting) for shooting in task.shootings):
        return (Way(nodes=_NODES), *over[:1], Way(), Way(nodes=_MANY_NODES))
    return (*over, Way(), over[0] if over else Way())


def _is_read(shooting: Shooting) -> bool:
    """Whether readings determine all states."""
    if shooting.model.delays:
        return False
    middle = float(np.median(shooting.run.times))
    return bool(np.isfinite(states_read(shooting.model, shooting.run, middle)).all())


def approach(task: FitTask, theta: np.ndarray, speed: float, way: Way, seen: Seen) -> Descent:
    """Descend on a problem with wide valleys, then on the task."""
    # Valleys are wide over smooth contact, or in short stretches between nodes.
    count = 0
    with suppress(SolveError, ArgumentError):  # such as too stiff: continue from the point reached
        for found in _led(task, theta, speed, way):
            theta, count = found.theta[: len(theta)], count + found.evaluations
    found = descend(task, theta, seen)
    return replace(found, evaluations=found.evaluations + count)


def _led(task: FitTask, theta: np.ndarray, speed: float, way: Way) -> Iterator[Descent]:
    for width in way.widths:
        found = descend(replace(task, contact=Smooth(width * speed)), theta, rough=True)
        theta = found.theta
        yield found
    if not way.nodes:
        return
    whole, w = lifted(task, theta, way.nodes)
    for jump in _JUMPS:
        found = descend(replace(whole, jump=jump), w, rough=True)
        w = found.theta
        yield found


def contact_speed(task: FitTask, theta: np.ndarray) -> float:
    """Typical speed over the ground, the unit of widths of smooth contact."""
    if not task.model.contacts:
        return 1.0
    usual = float(np.mean([c.nominal_speed for c in task.model.contacts]))
    try:
        motions = task.motions(theta)
    except SolveError:
        return usual
    speeds = [m.observe(m.system.model.contact_velocities) for m in motions]
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(v) for v in speeds]) ** 2))) or usual


# Standard errors from the best within which starts have the same end.
_SAME = 0.1
# Costs above the least that readings hardly tell from it; distance in standard errors that is then
# strange.
_AS_GOOD, _OUTSIDE = 2.0, 3.0
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
    """Estimate the parameters of a model from recordings.

    Parameters
    ----------
    task : FitTask
        Model, recordings and unknowns.
    seeds : int, optional
        Largest number of starts: the first is the given one, the others are distributed around
        it within the bounds.
    enough : int, optional
        The search ends when this number of starts has ended at the best fit with only noise left.
        Otherwise all starts are tried.
    nodes : int, optional
        Number of readings at which each run is restarted (multiple shooting): many for long or
        sensitive motions, 0 for none. By default every third start uses it, if the readings
        determine all states.
    seed : int, optional
        Seed of the random starts.
    report : callable, optional
        Receives the progress, see `wormopt.progress`.

    Returns
    -------
    Fit
        It is not `converged` if the search did not reach a minimum, if only one start reached the
        best fit and its residuals exceed the noise, or if half of the unknowns are at bounds.
        Otherwise residuals above the noise cause a warning: the model may be incomplete.

    Raises
    ------
    ArgumentError
        If an argument has the wrong type.
    SolveError
        If no start can be simulated; the message gives the reason of the first.
    Interrupted
        If the user stopped it; `partial` is the best fit so far, None before there is one.

    Examples
    --------
    Rate at which a velocity decays:

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
            "write other start values, or narrower bounds",
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


def _rivals(found: Fit, task: FitTask) -> Iterator[str]:
    """Yield estimates that other starts, which fit as well, put outside their errors."""
    errors = np.sqrt(np.diag(found.covariance))
    least = min(end.cost for end in found.starts)
    # costs of starts are relative to a first guess of the noise
    most = least * (1 + _AS_GOOD / found.cost) if found.cost > 0 else least
    ends = [end.theta for end in found.starts if end.cost <= most]
    for k, name in enumerate(task.names):
        others = [task.values(theta)[k] for theta in ends]
        if any(abs(theta[k] - found.theta[k]) > _OUTSIDE * errors[k] for theta in ends):
            yield (
                f"{name} ended between {min(others):.4g} and {max(others):.4g} at starts that fit "
                "as well, so its standard error is too small; see its profile"
            )


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
    strange = [*unexplained(asked, task, found.plain[0])]
    warnings, same = list(task.warnings), sum(end.agrees for end in ends)
    if same < len(ends) and not reason:
        warnings.append(f"{len(ends) - same} of {len(ends)} starts ended elsewhere, see starts")
        warnings += _rivals(found, task)
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
            f"the search ended {found.offset:.2g} standard errors from a minimum, perhaps because "
            "events appear or vanish there; try other starts"
        )
    still = np.flatnonzero(~np.any(found.jacobian, axis=0))
    if strange and still.size:
        return (
            f"the motion does not depend on {', '.join(names[k] for k in still)} here, and does "
            "not fit; write start values at which it depends on them"
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
        f"{run}: derivatives are one-sided at {len(each)} events, first {each[0].reason} of "
        f"{each[0].event.name} at t = {each[0].event.time:.4g}: errors may be larger"
        for run, each in doubts.items()
    ]


def _check(task: object, seeds: object, enough: object, nodes: object) -> None:
    if not isinstance(task, FitTask):
        raise ArgumentError(f"task must be a FitTask, not {type(task).__name__}")
    for what, count, least in (("seeds", seeds, 1), ("enough", enough, 1), ("nodes", nodes, 0)):
        whole = isinstance(count, int | np.integer) and count >= least
        if not whole and (what != "nodes" or count is not None):
            raise ArgumentError(f"{what} must be a whole number, {least} or above, not {count!r}")
