"""Many motions of one model with different numbers: compiled once, run on all cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.model.model import Model
from wormopt.numerics.workers import thread_pool
from wormopt.progress import Report, silent
from wormopt.shown import lines
from wormopt.simulation.held import hold
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.options import Exact, Route, Tolerance, Treatment
from wormopt.simulation.routes import STIFF_STEPS
from wormopt.simulation.simulate import (
    Values,
    check,
    simulate,
    system_of,
    task_of,
    trajectory_of,
)
from wormopt.simulation.trajectory import Trajectory
from wormopt.simulation.variation import Sensitivities

_LANES = 8  # number of members from which several are integrated side by side
Found = tuple[Trajectory, str]


@dataclass(frozen=True)
class Scenario:
    """Start, parameters and schedules of one member of an ensemble.

    Parameters
    ----------
    x0, p : mapping of str to array_like, optional
        Start and parameters, as for `simulate`.
    schedules : mapping of str to ndarray, optional
        Values of schedules.

    Examples
    --------
    >>> Scenario(p={"stiffness": 9.5}).p["stiffness"]
    9.5
    """

    x0: Values | None = None
    p: Values | None = None
    schedules: Mapping[str, np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions of N members.

    Parameters
    ----------
    time : ndarray, shape (m,)
        Sample times.
    states : ndarray, shape (N, n_x, m)
        States then; NaN from where a member was given up.
    motions : tuple of Trajectory
        Every member's own trajectory, as far as it came.
    codes : tuple of str
        Empty for a member that came to its end, else why it did not, as in `SolveError.code`;
        "interrupted" if the user stopped it, "given_up" where the first had spent all their steps.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> states, numbers = [wo.Signal("x", x, value=1.0)], [wo.Signal("rate", rate)]
    >>> decay = wo.Model("decay", states, -rate * x, p=numbers)
    >>> members = [wo.Scenario(p={"rate": value}) for value in (0.0, np.log(2.0))]
    >>> found = wo.simulate_ensemble(decay, 1.0, members)
    >>> found.end.round(9), found.codes
    (array([[1. ], [0.5]]), ('', ''))
    """

    time: np.ndarray
    states: np.ndarray
    motions: tuple[Trajectory, ...]
    codes: tuple[str, ...]

    def __repr__(self) -> str:
        given_up = sum(code != "" for code in self.codes)
        summary = f"Ensemble of {len(self.codes)} motions, {given_up} of them not to the end"
        return lines(summary, repr(self.motions[0]).partition("\n")[0] if self.motions else "")

    @property
    def end(self) -> np.ndarray:
        """Last states, shape (N, n_x); NaN for members that were given up."""
        ends = np.array([motion.end for motion in self.motions])
        ends[[code != "" for code in self.codes]] = np.nan
        return ends

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (N, size, m) of a signal, NaN from where a member was given up.

        UnknownNameError, a KeyError, where there is none; the message lists those there are.
        """
        return np.array([_filled(motion[name], len(self.time)) for motion in self.motions])

    def derivative(self, name: str) -> np.ndarray:
        """Derivatives (N, size, k, m) of a signal, NaN from where a member was given up.

        Parameters
        ----------
        name : str
            A state, or anything the model knows by name.

        Returns
        -------
        ndarray, shape (N, size, k, m)
            Along the directions that were asked for, see `Trajectory.derivative`.
        """
        count = len(self.time)
        return np.array([_filled(motion.derivative(name), count) for motion in self.motions])


def simulate_ensemble(
    model: Model,
    span: float | tuple[float, float],
    members: Sequence[Scenario],
    *,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    times: ArrayLike | None = None,
    tolerance: Tolerance = Tolerance(),  # noqa: B008  frozen
    route: Route = "auto",
    sensitivities: Sensitivities | None = None,
    threads: int | None = None,
    give_up_after: int | None = None,
    report: Report = silent,
) -> Ensemble:
    """Integrate a model once for each member, several at a time.

    Parameters
    ----------
    model : Model
        The model.
    span : float or (float, float)
        Last time, or first and last.
    members : sequence of Scenario
        Differences of each member from the model.
    contact : Exact or Smooth, optional
        Treatment of contacts.
    times : array_like, shape (m,), optional
        When to sample, alike for all; start and end if left out.
    tolerance : Tolerance, optional
        Tolerance of each simulation.
    route : {"auto", "native", "python", "radau", "cvodes"}, optional
        Integrator, see `simulate`.
    sensitivities : sequence of str, or mapping, optional
        Directions of differentiation, see `simulate`.
    threads : int, optional
        Number of parallel runs; one per core if left out.
    give_up_after : int, optional
        If the first so many members all spend all their steps, the others are given up, but for
        those that other threads have ended by then.
    report : callable, optional
        Receives the share that is done.

    Returns
    -------
    Ensemble
        Members that were given up are marked, not left out.

    Raises
    ------
    ArgumentError
        If there are no members, one does not fit the model, or `give_up_after` is below 1.
    Interrupted
        If the user stopped it; `partial` is the ensemble as far as its members came.

    Examples
    --------
    >>> import casadi as ca
    >>> from wormopt.model.model import Signal
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> states, rates = [Signal("x", x, value=1.0)], [Signal("rate", rate)]
    >>> decay = Model("decay", x=states, ode=-rate * x, p=rates)
    >>> members = [Scenario(p={"rate": value}) for value in (0.0, np.log(2.0))]
    >>> simulate_ensemble(decay, 1.0, members).end.round(9)
    array([[1. ],
           [0.5]])
    """
    if not members:
        raise ArgumentError("an ensemble needs at least one member")
    for member in members:
        if not isinstance(member, Scenario):
            raise ArgumentError(f"write each member as Scenario(p=..., x0=...), not {member!r}")
    if give_up_after is not None and not give_up_after >= 1:
        raise ArgumentError(f"give_up_after must be 1 or above, not {give_up_after}")
    check(model, contact, tolerance, route)
    stopped = Event()
    stop_if = partial(_stop_if, stopped)
    start, end = span if isinstance(span, tuple) else (0.0, span)
    time = np.array([start, end]) if times is None else np.asarray(times, dtype=float)
    shared = {"contact": contact, "times": time, "tolerance": tolerance}
    shared |= {"sensitivities": sensitivities}
    one = partial(_one, model, span, route=route, report=stop_if, **shared)
    alike = len(members) >= _LANES and sensitivities is None and not model.delays
    together = alike and _goes_together(model, contact, route)
    found: list[Future[Found]] = []
    in_vain = False
    with thread_pool(threads) as pool:
        try:
            if together:
                task = partial(_task, model, span, **shared)
                found += _together(pool, members, task, one, stop_if)
            else:
                found.append(pool.submit(one, members[0]))
                found[0].result()  # compiles once
                found += [pool.submit(one, member) for member in members[1:]]
            in_vain = _wait(found, stopped, give_up_after, report)
        except BaseException as error:
            stopped.set()  # running members end soon, waiting ones at once
            if not isinstance(error, KeyboardInterrupt) or len(found) < len(members):
                raise
    motions, codes = zip(*(future.result() for future in found), strict=True)
    states = np.array([_filled(motion.states, len(time)) for motion in motions])
    if in_vain:
        codes = tuple("given_up" if code == "interrupted" else code for code in codes)
    ensemble = Ensemble(time, states, motions, codes)
    if stopped.is_set() and not in_vain:
        raise Interrupted(ensemble)
    return ensemble


def _wait(
    found: Sequence[Future[Found]], stopped: Event, give_up_after: int | None, report: Report
) -> bool:
    """Wait for all members, or until the first have used all their steps; return whether so."""
    spent = 0
    for number, future in enumerate(found, start=1):
        spent += future.result()[1] == "too_many_steps"
        report("simulating members", number / len(found))
        if number == spent == give_up_after:
            stopped.set()
            return True
    return False


def _one(
    model: Model,
    span: float | tuple[float, float],
    member: Scenario,
    *,
    route: Route,
    report: Report,
    **shared: Any,
) -> Found:
    own: dict[str, Any] = {"x0": member.x0, "p": member.p, "schedules": member.schedules}
    return _outcome_of(partial(simulate, model, span, route=route, report=report, **own, **shared))


def _outcome_of(find: Callable[[], Trajectory]) -> Found:
    """Motion and code, also of a failed simulation."""
    try:
        return find(), ""
    except SolveError as error:
        return error.partial, error.code
    except Interrupted as stop:
        return stop.partial, "interrupted"


# -- several in one thread ---------------------------------------------------------------------


def _goes_together(model: Model, contact: Treatment, route: Route) -> bool:
    """Whether members are integrated side by side in vectors: with a compiler that supports it."""
    if route not in ("auto", "native"):
        return False
    from wormopt.simulation.native.build import CompilerError
    from wormopt.simulation.native.kernel import takes

    try:
        return takes(system_of(model, contact))
    except CompilerError:
        return False  # single members report the error


def _task(
    model: Model, span: float | tuple[float, float], member: Scenario, **shared: Any
) -> InitialValueProblem:
    own: dict[str, Any] = {"x0": member.x0, "p": member.p, "schedules": member.schedules}
    return task_of(model, span, dense=False, **own, **shared)


def _together(
    pool: ThreadPoolExecutor,
    members: Sequence[Scenario],
    task: Callable[[Scenario], InitialValueProblem],
    alone: Callable[[Scenario], Found],
    report: Report,
) -> list[Future[Found]]:
    """Start all members, side by side in each thread; those that need other steps run alone."""
    found: list[Future[Found]] = [Future() for _ in members]
    waiting = deque(zip(members, found, strict=True))
    for _ in range(-(-len(members) // _LANES)):
        pool.submit(_work, waiting, task, alone, report)
    return found


def _work(
    waiting: deque[tuple[Scenario, Future[Found]]],
    task: Callable[[Scenario], InitialValueProblem],
    alone: Callable[[Scenario], Found],
    report: Report,
) -> None:
    """Integrate waiting members, side by side."""
    from wormopt.simulation.native.kernel import integrate_side_by_side

    taken: dict[InitialValueProblem, tuple[Scenario, Future[Found]]] = {}

    def tasks() -> Iterator[InitialValueProblem]:
        while waiting:
            try:
                member, future = waiting.popleft()
            except IndexError:  # another thread took it
                return
            try:
                made = task(member)
                held = hold(made, switches=True)
            except (ArgumentError, SolveError) as error:
                future.set_exception(error)
                continue
            if held is not None:  # it has its own system
                future.set_result(alone(member))
                continue
            taken[made] = member, future
            yield made

    stiff = []
    try:
        for made, outcome in integrate_side_by_side(tasks(), report, STIFF_STEPS):
            if outcome.status == "stiff":
                stiff.append(made)
                continue
            _, future = taken.pop(made)
            future.set_result(_outcome_of(partial(trajectory_of, made, outcome)))
        for made in stiff:
            member, future = taken.pop(made)
            future.set_result(alone(member))
    except BaseException as error:
        for _, future in taken.values():
            future.set_exception(error)


def _stop_if(stopped: Event, _text: str, _fraction: float | None) -> None:
    if stopped.is_set():
        raise KeyboardInterrupt


def _filled(values: np.ndarray, count: int) -> np.ndarray:
    missing = [(0, 0)] * (values.ndim - 1) + [(0, count - values.shape[-1])]
    return np.pad(values, missing, constant_values=np.nan)
