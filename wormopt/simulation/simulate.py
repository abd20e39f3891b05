"""The verb `simulate`: the motion of a Model, or a reason for failure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.model.given import check_flag
from wormopt.model.model import Model
from wormopt.model.schedule import Schedule
from wormopt.model.values import check_names, numbers, signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import REASONS, InitialValueProblem, Outcome
from wormopt.simulation.options import Exact, Route, Smooth, Tolerance, Treatment
from wormopt.simulation.routes import integrate
from wormopt.simulation.trajectory import Dense, Event, NonsmoothEvent, Trajectory, latest
from wormopt.simulation.variation import Sensitivities, directions

Values = Mapping[str, ArrayLike]

# Most steps kept if no times are named: this many, or as many as have this many numbers, but not
# fewer than the last.
_KEPT, _NUMBERS, _LEAST_KEPT = 10_000, 2_000_000, 200

_REFUSALS = {
    "step_too_small": (
        "steps became too small at t = {t:.6g}: the motion is not smooth there, or grows beyond "
        "bounds",
        "loosen the relative tolerance, use a larger v_reg, or treat contact exactly",
    ),
    "not_finite": (
        "the motion becomes infinite or NaN at t = {t:.6g}",
        "check whether a state grows without bound, for example a gain, and shorten the time",
    ),
    "too_many_steps": (
        "the limit of {steps} steps was reached at t = {t:.6g}",
        "loosen the tolerances, allow more max_steps, or shorten the time",
    ),
    "stiff": (
        "the motion is too stiff for explicit steps at t = {t:.6g}",
        'use route = "cvodes", a larger v_reg, or treat contact exactly',
    ),
    "events_accumulate": (
        "events follow each other without time passing at t = {t:.6g}",
        "tighten the tolerance, treat contact as smooth, or change the friction law or the switch "
        "that chatters; a switch can be terminal or have a state of rest",
    ),
    "slides_on_condition": (
        "the motion stays on a jump of the right-hand side at t = {t:.6g}: on both sides of a "
        "condition it returns to the condition",
        "write a Contact for the sticking part, a Switch with a state of rest, or a steep smooth "
        "curve",
    ),
    "no_contact_mode": (
        "no choice of resting and sliding contacts fits the forces at t = {t:.6g}, or several "
        "contacts that share one degree of freedom rest together, so their forces are undetermined",
        "treat contact as smooth, or make the links elastic",
    ),
    "open_force": (
        "a contact rests at t = {t:.6g}, but no contact force acts on its velocity, so the force "
        "that holds it is undetermined",
        "add this force to the ode, or treat contact as smooth",
    ),
    "layer_not_resolved": (
        "steps are too long for the steep part of the smooth law at t = {t:.6g}",
        "use a larger v_reg, or treat contact exactly",
    ),
    "solver_failed": (
        "the implicit integrator failed at t = {t:.6g}",
        "loosen the tolerances or use a larger v_reg",
    ),
    "steep_derivatives": (
        "the motion has no derivatives at t = {t:.6g}: a slope of the model is infinite or has no "
        "limit there, like a square root at 0",
        "change this law, or use differences of motions without sensitivities",
    ),
    "no_memory": ("out of memory at t = {t:.6g}", "keep fewer samples, or write dense = False"),
}


def simulate(
    model: Model,
    span: float | tuple[float, float],
    *,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    x0: Values | None = None,
    p: Values | None = None,
    schedules: Mapping[str, np.ndarray] | None = None,
    times: ArrayLike | None = None,
    dense: bool = False,
    tolerance: Tolerance = Tolerance(),  # noqa: B008  frozen
    route: Route = "auto",
    sensitivities: Sensitivities | None = None,
    report: Report = silent,
) -> Trajectory:
    """Simulate a model in time, by the method of steps if it has delays.

    Parameters
    ----------
    model : Model
        The model. Inputs keep their values.
    span : float or (float, float)
        End time, or start and end times.
    contact : Exact or Smooth, optional
        Treatment of contacts.
    x0 : mapping of str to array_like, optional
        Initial values of states by name; the model's own if left out.
    p : mapping of str to array_like, optional
        Parameters and inputs by name; the model's own if left out. They change without a
        new compilation.
    schedules : mapping of str to ndarray, optional
        Other values of schedules by name, of the same shape.
    times : array_like, shape (m,), optional
        Sample times, ascending within the span; ``[]`` keeps no sample. If left out, the ends of
        the steps are kept: all of them up to 10,000, then every second, every fourth and so on,
        so that memory is bounded whatever the span.
    dense : bool, optional
        Keep the whole motion, for `Trajectory.at`.
    tolerance : Tolerance, optional
        Tolerances and limits of the integration.
    route : {"auto", "native", "python", "radau", "cvodes"}, optional
        Integrator. "auto" is compiled code if there is a compiler, and an implicit integrator
        if the motion is too stiff for explicit steps.
    sensitivities : sequence of str, or mapping of str to mapping of str to array_like, optional
        Directions in which the motion is differentiated: names of parameters, inputs, states (then:
        their start) and schedules, all entries of each, ``"mass[0]"`` for one; or for each label a
        direction, as ``{"friction": {"friction_forward": [1, 1, 1]}}``, in one or several of them.
    report : callable, optional
        Receives the progress, see `wormopt.progress`.

    Returns
    -------
    Trajectory

    Raises
    ------
    ArgumentError
        If an argument is something else, or names, sizes, bounds, times or the route do not fit
        the model.
    SolveError
        If the motion could not be followed to its end; `partial` is the trajectory up to there,
        `code` the reason in one word.
    Interrupted
        If the user stopped it; `partial` is the trajectory up to there.

    Examples
    --------
    A block thrown at speed 1 over ground that resists with 1 comes to rest at t = 1 after 0.5:

    >>> import casadi as ca
    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.model.model import Contact, Signal
    >>> x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f")
    >>> states = [Signal("position", x, value=0.0), Signal("velocity", v, value=1.0)]
    >>> ground = Contact("block", v, f, Coulomb(1.0, 2.0))
    >>> block = Model("block", x=states, ode=ca.vertcat(v, f), contacts=[ground])
    >>> motion = simulate(block, 3.0)
    >>> motion.end.round(12), [(round(e.time, 12), e.kind) for e in motion.events]
    (array([0.5, 0. ]), [(1.0, 'stick')])
    """
    check(model, contact, tolerance, route)
    task = task_of(
        model,
        span,
        contact,
        x0=x0,
        p=p,
        schedules=schedules,
        times=times,
        dense=dense,
        tolerance=tolerance,
        sensitivities=sensitivities,
    )
    if model.delays:
        from wormopt.simulation.delays import integrate_delayed

        return trajectory_of(*integrate_delayed(task, route, report))
    return trajectory_of(task, integrate(task, route, report))


def check(model: object, contact: object, tolerance: object, route: object) -> None:
    """Refuse arguments of wrong types."""
    if not isinstance(model, Model):
        raise ArgumentError(f"model must be a Model, not {type(model).__name__}")
    if not isinstance(contact, Smooth | Exact):
        raise ArgumentError(f"contact must be Exact() or Smooth(v_reg), not {contact!r}")
    if not isinstance(tolerance, Tolerance):
        raise ArgumentError(f"tolerance must be Tolerance(relative, absolute), not {tolerance!r}")
    if route not in get_args(Route):
        raise ArgumentError(f"route must be one of {', '.join(get_args(Route))}, not {route!r}")


@lru_cache(maxsize=64)
def system_of(model: Model, contact: Treatment) -> System:
    """The System of a model, cached."""
    return System(model, contact)


def task_of(
    model: Model,
    span: float | tuple[float, float],
    contact: Treatment,
    *,
    x0: Values | None,
    p: Values | None,
    schedules: Mapping[str, np.ndarray] | None,
    times: ArrayLike | None,
    dense: bool,
    tolerance: Tolerance,
    sensitivities: Sensitivities | None,
) -> InitialValueProblem:
    """Arguments of `simulate` as a task; raises its ArgumentErrors."""
    system = system_of(model, contact)
    check_flag("dense", dense)
    start, end = _ends(span)
    sampled = np.zeros(0) if times is None else numbers("times", times).ravel()
    sampled = np.where(np.abs(sampled - end) <= 4 * np.spacing(abs(end)), end, sampled)
    if sampled.size and not (
        np.all(np.diff(sampled) >= 0) and start <= sampled[0] and sampled[-1] <= end
    ):
        raise ArgumentError(f"sample times must ascend within [{start:g}, {end:g}]")
    scheduled = _with_values(tuple(model.schedules), schedules)
    along = directions(system, scheduled, sensitivities)
    task = InitialValueProblem(
        system=system,
        span=(start, end),
        x0=np.append(signal_values(model.x, x0, "state", fill=0.0), np.zeros(system.n_pushes)),
        p=system.parameters(p),
        schedules=scheduled,
        tolerance=tolerance,
        times=sampled,
        dense=dense,
        directions=along,
    )
    return task if times is not None else replace(task, keep=_most_kept(len(task.start)))


def _most_kept(size: int) -> int:
    """Largest number of states of this size to keep if no times are named."""
    return max(_LEAST_KEPT, min(_KEPT, _NUMBERS // size))


def _ends(span: float | tuple[float, float]) -> tuple[float, float]:
    given = numbers("span", span)
    start, end = np.append([0.0, 0.0], given)[-2:].tolist()
    if given.size > 2 or not -np.inf < start < end < np.inf:
        raise ArgumentError(f"span must be end or (start, end) with start < end, not {span!r}")
    return start, end


def _with_values(
    schedules: tuple[Schedule, ...], given: Mapping[str, np.ndarray] | None
) -> tuple[Schedule, ...]:
    given = {} if given is None else given
    check_names(given, [s.name for s in schedules], "schedule")
    return tuple(
        replace(s, values=numbers(f"schedule {s.name}", given[s.name])) if s.name in given else s
        for s in schedules
    )


def trajectory_of(task: InitialValueProblem, outcome: Outcome) -> Trajectory:
    """Trajectory of an outcome; raises SolveError if it did not reach the end."""
    n_x, first = task.system.model.n_x, len(task.x0)
    reached, samples = _sampled(task, outcome)
    dense = outcome.dense
    if first > n_x and len(dense):
        dense = np.delete(dense, slice(n_x, first), axis=2)
    motion = Trajectory(
        system=task.system,
        route=outcome.route,
        p=task.p,
        schedules=task.schedules,
        time=reached,
        states=samples[:, :n_x].T,
        end_time=outcome.t,
        end=outcome.x[:n_x],
        event_rows=outcome.events,
        modes=outcome.modes,
        n_steps=outcome.n_steps,
        n_rejected=outcome.n_rejected,
        n_evaluations=outcome.n_evaluations,
        dense=Dense(outcome.dense_time, dense) if len(dense) else None,
        along=task.directions,
        state_derivatives=samples[:, first:].T.reshape(n_x, task.k, len(reached)),
        end_derivative=outcome.x[first:].reshape(n_x, task.k),
        notes=outcome.notes,
    )
    if len(outcome.doubts):
        motion = replace(motion, nonsmooth_events=_doubts(motion, outcome.doubts))
    if outcome.status == "done":
        return motion
    if outcome.status == "interrupted":
        raise Interrupted(motion)
    reason, suggestion = _REFUSALS[outcome.status]
    reason = reason.format(t=outcome.t, steps=outcome.n_steps + outcome.n_rejected)
    raise SolveError(reason, suggestion, motion, outcome.status)


def _sampled(task: InitialValueProblem, outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) at which states are known, and the states (m, n)."""
    # A sample at the end of a motion is included, though rounding may end it a little earlier.
    if task.keep:
        before = outcome.kept[outcome.kept[:, 0] < outcome.t]
        return np.append(before[:, 0], outcome.t), np.vstack([before[:, 1:], outcome.x])
    late = task.times[len(outcome.samples) :]
    near = int(np.sum(late <= latest(outcome.t, task.span[0]))) * (outcome.status == "done")
    samples = np.vstack([outcome.samples, *near * [outcome.x]])
    return task.times[: len(samples)], samples


def _doubts(motion: Trajectory, rows: np.ndarray) -> tuple[NonsmoothEvent, ...]:
    """Doubts by their events; an event that nearly happened is constructed."""
    system, happened = motion.system, {(e.time, e.name): e for e in motion.events}
    found = {}
    for t, which, mode, reason in rows.tolist():
        name, why = system.happening[int(which)], REASONS[int(reason)]
        kind = "reversal" if mode else "stick" if why == "edge" else "release"
        kind = "switch" if which >= len(system.contacts) else kind
        made_up = Event(t, name, kind, int(mode))
        found[t, name, why] = NonsmoothEvent(happened.get((t, name), made_up), why)
    return tuple(found.values())
