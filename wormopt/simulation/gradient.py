"""The verb `gradient`: derivatives of one number of a motion by all values it depends on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import pack
from wormopt.model.values import by_name, check_names, nominal_of, numbers
from wormopt.simulation.adjoint import Backwards, Instants, Jump, Kicks
from wormopt.simulation.held import jumps_move
from wormopt.simulation.options import Route, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import NonsmoothEvent, Trajectory


@dataclass(frozen=True, eq=False)
class Gradient:
    """Derivatives of one number of a motion.

    Parameters
    ----------
    x0 : dict of str to ndarray, shape (size,)
        By the initial values of states. By velocities of contacts that slide from rest, to the
        side to which they slide; of those that stay at rest, 0.
    p : dict of str to ndarray, shape (size,)
        By parameters and inputs.
    schedules : dict of str to ndarray, shape (pieces, size)
        By the values of schedules.
    nonsmooth_events : tuple of NonsmoothEvent
        Events at which derivatives do not exist or hold on one side only; the gradient is then
        that of the branch that was followed.

    Examples
    --------
    A block of mass 1 thrown with v = 1 over ground that resists with f = 1 comes to rest after
    v^2 / (2 f), whose derivative with respect to v is 1:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, f = (ca.SX.sym(name) for name in "xvf")
    >>> states = [wo.Signal("position", x, value=0.0), wo.Signal("velocity", v, value=1.0)]
    >>> ground = wo.Contact("block", v, f, wo.Coulomb(1.0, 2.0))
    >>> block = wo.Model("block", states, ca.vertcat(v, f), contacts=[ground])
    >>> found = wo.gradient(wo.simulate(block, 3.0, dense=True), {"position": [1.0]})
    >>> found.x0["velocity"].round(12), found.nonsmooth_events
    (array([1.]), ())
    """

    x0: dict[str, np.ndarray]
    p: dict[str, np.ndarray]
    schedules: dict[str, np.ndarray]
    nonsmooth_events: tuple[NonsmoothEvent, ...] = ()


def gradient(
    motion: Trajectory,
    weights: Mapping[str, ArrayLike],
    *,
    tolerance: Tolerance = Tolerance(),  # noqa: B008  frozen
    route: Route = "auto",
) -> Gradient:
    """Differentiate a number of a motion by all initial states, parameters, inputs and schedules.

    The adjoint equation is solved once, backwards along the motion and through all events, for any
    number of derivatives. `simulate(..., sensitivities=...)` integrates one more system forward
    for each derivative, and returns all states at all times.

    Parameters
    ----------
    motion : Trajectory
        From ``simulate(..., dense=True)``.
    weights : mapping of str to array_like, shape (size, m) or (size,)
        By name of a state or output, the derivative of the number by its samples, in the shape of
        ``motion[name]``; by the last sample alone in the shape (size,). For the sum of
        squares of a residual r these are 2 r.
    tolerance : Tolerance, optional
        Tolerance of the adjoint equation, in usual sizes of states and values of parameters.
    route : {"auto", "native", "python"}, optional
        Integrator.

    Returns
    -------
    Gradient

    Raises
    ------
    ArgumentError
        If the motion was simulated without ``dense = True``, the model has delays, contacts of it
        slide in the plane or share loads in exact treatment, or weights do not fit.
    UnknownNameError
        If the model has no such state or output.
    SolveError
        If the equation cannot be followed back, or an event is none that it knows.

    Examples
    --------
    A block of mass m thrown with v over ground that resists with f comes to rest after
    m v^2 / (2 f), here 0.5:

    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.model.model import Contact, Model, Signal
    >>> from wormopt.simulation.simulate import simulate
    >>> x, v, f, m = (ca.SX.sym(name) for name in "xvfm")
    >>> states = [Signal("position", x, value=0.0), Signal("velocity", v, value=1.0)]
    >>> ground = Contact("block", v, f, Coulomb(1.0, 2.0))
    >>> block = Model("block", states, ca.vertcat(v, f / m), p=[Signal("mass", m, value=1.0)],
    ...     contacts=[ground])
    >>> found = gradient(simulate(block, 3.0, dense=True), {"position": [1.0]})
    >>> found.x0["velocity"].round(12), found.p["mass"].round(12)
    (array([1.]), array([0.5]))
    """
    _check(motion, route)
    number = _Number(motion, weights)
    if number.last is None:
        return number.gradient(np.zeros(motion.system.model.n_x), ())
    late = float(number.motion.time[number.last])
    happens = motion.system.exact or motion.system.model.switches
    doubts = _doubts(motion, late, tolerance, route) if happens else ()
    return number.gradient(number.follow(tolerance, route), doubts)


def _check(motion: object, route: object) -> None:
    if route not in get_args(Route):
        raise ArgumentError(f"route must be one of {', '.join(get_args(Route))}, not {route!r}")
    if not isinstance(motion, Trajectory):
        raise ArgumentError(f"motion must be a Trajectory, not {type(motion).__name__}")
    system, name = motion.system, motion.system.model.name
    if motion.dense is None:
        raise ArgumentError("simulate with dense=True for the gradient of the motion")
    system.model.refuse_delays("the gradient of a motion")
    if jumps_move(system.model):
        raise ArgumentError(
            f"the right-hand side of {name} jumps at times that depend on parameters or states, "
            "where this gradient is unknown; use simulate(..., sensitivities=[...])"
        )
    if system.exact and (len(system.planar) or system.shares):
        raise ArgumentError(
            f"contacts of {name} slide in the plane or share loads, where exact treatment has no "
            "derivatives; simulate with contact=Smooth(v_reg)"
        )


def _doubts(
    motion: Trajectory, late: float, tolerance: Tolerance, route: Route
) -> tuple[NonsmoothEvent, ...]:
    """Doubts of a simulation forward in time along a direction in which everything moves."""
    # Those at the start are left out: a velocity at the start of a contact that slides from rest
    # would have two derivatives, which hardly anyone needs.
    dense, model = motion.dense, motion.system.model
    assert dense is not None
    start = float(dense.time[0])
    if late <= start:
        return ()
    random = np.random.default_rng(0)
    held = by_name((*model.p, *model.u), motion.p[: motion.system.n_fixed - 1])
    begun = by_name(model.x, dense.coefficients[0, 0, : model.n_x])
    moved = {name: x * random.uniform(0.5, 1.5, x.size) for name, x in begun.items()}
    for signal in (*model.p, *model.u):
        size = np.where(held[signal.name] != 0, np.abs(held[signal.name]), signal.nominal)
        moved[signal.name] = size * random.uniform(0.5, 1.5, signal.size)
    for schedule in motion.schedules:
        moved.setdefault(schedule.name, random.uniform(0.5, 1.5, schedule.values.shape))
    return simulate(
        model,
        (start, late),
        contact=motion.system.treatment,
        x0=begun,
        p=held,
        schedules={schedule.name: schedule.values for schedule in motion.schedules},
        tolerance=tolerance,
        route=route,
        times=[],
        sensitivities={"all": moved},
    ).nonsmooth_events


def _crowded(times: np.ndarray, near: float) -> set[float]:
    """Ascending times that coincide, within round-off, with the next or the last."""
    close = np.diff(times) <= near
    return set(times[np.append(close, False) | np.append(False, close)].tolist())


def _merged(times: np.ndarray, near: float) -> np.ndarray:
    """Ascending times without those that coincide, within round-off, with an earlier one."""
    first = np.append(True, np.diff(times) > near)
    return times[first][np.cumsum(first) - 1]


def _at_last(motion: Trajectory) -> Trajectory:
    """The motion with its last sample only."""
    along = motion.state_derivatives[..., -1:]
    states = motion.states[:, -1:]
    return replace(motion, time=motion.time[-1:], states=states, state_derivatives=along)


class _Number:
    """A number, as its derivatives by samples of a motion, and its gradient so far."""

    def __init__(self, motion: Trajectory, weights: Mapping[str, ArrayLike]) -> None:
        system, n_x = motion.system, motion.system.model.n_x
        check_names(weights, motion.names, "state or output")
        if all(np.shape(w) == (system.model[name].numel(),) for name, w in weights.items()):
            motion = _at_last(motion)
        self.motion, self._unit, m = motion, 1.0, len(motion.time)
        self._nominal = nominal_of(system.model.x)
        self._by_x, by_p = np.zeros((m, n_x)), np.zeros((m, len(motion.p)))
        for name, given in weights.items():
            of_x, of_p = self._samples(name, given)
            self._by_x, by_p = self._by_x + of_x, by_p + of_p
        weighed = np.flatnonzero(np.any(self._by_x != 0, axis=1))
        self.last = int(weighed[-1]) if len(weighed) else None
        self._by_p = np.zeros(system.n_fixed)
        self._by_schedules = [np.zeros_like(s.values) for s in motion.schedules]
        self._add(motion.time, by_p)

    def _samples(self, name: str, given: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by states (m, n_x) and parameters (m, n_p) at the samples."""
        motion, system = self.motion, self.motion.system
        expression, m = ca.vec(system.model[name]), len(motion.time)
        size, w = expression.numel(), numbers(f"weights of {name}", given)
        w = w[None] if size == 1 and w.shape == (m,) else w
        if w.shape == (size,) and m:
            w = np.column_stack([np.zeros((size, m - 1)), w])
        if w.shape != (size, m) or not np.all(np.isfinite(w)):
            raise ArgumentError(
                f"weights of {name} must be finite, of shape {(size, m)} or {(size,)}, not "
                f"{w.shape}"
            )
        t, _, p, s = system.symbols
        x, each = pack(system.model.x), ca.SX.sym("weights", size)
        value = system.observe(expression)(t, x, p, s)
        slopes = ca.densify(ca.jtimes(value, ca.vertcat(x, p), each, True))
        at = ca.Function("weighed", [t, x, p, s, each], [slopes])
        found = motion.values(at, w).T
        return found[:, : x.numel()], found[:, x.numel() :]

    def _add(self, t: np.ndarray, by_p: np.ndarray) -> None:
        """Add derivatives (m, n_p) with respect to the parameters at times (m,)."""
        n = self.motion.system.n_fixed
        self._by_p += by_p[:, :n].sum(axis=0)
        for schedule, found in zip(self.motion.schedules, self._by_schedules, strict=True):
            end = n + 1 + schedule.values.shape[1]
            np.add.at(found, schedule.locate(t)[1], by_p[:, n + 1 : end])
            n = end

    def _sizes(self) -> np.ndarray:
        """Sizes of all parameters: their values, or nominal sizes for values 0."""
        motion, model = self.motion, self.motion.system.model
        fixed = np.abs(motion.p[: motion.system.n_fixed])
        found = [np.where(fixed > 0, fixed, np.append(nominal_of((*model.p, *model.u)), 1.0))]
        for schedule in motion.schedules:
            largest = np.abs(schedule.values).max(axis=0)
            found += [np.ones(1), np.where(largest > 0, largest, 1.0)]
        return np.concatenate(found)

    def follow(self, tolerance: Tolerance, route: Route) -> np.ndarray:
        """Costate (n_x,) before the start; adds up derivatives by parameters."""
        motion, dense = self.motion, self.motion.dense
        assert dense is not None
        assert self.last is not None
        self._unit = float(np.abs(self._by_x * self._nominal).max())
        back = Backwards(motion, self._sizes(), tolerance, route)
        early, late = float(dense.time[0]), float(motion.time[self.last])
        instants, near = Instants(motion, late), back.near(late)
        crowded = _crowded(np.array([early, *instants.events, late]), near)
        jumps = {j.before.t: j for j in instants.all if j.maps or j.before.t in crowded}
        kicks = instants.kicks([j for j in instants.all if j.before.t not in jumps])
        kicks = self._with_samples(kicks, np.array([early, *jumps, late]), near)
        costate, breaks = np.zeros(motion.system.model.n_x), self._breaks(late)
        for t in sorted({early, *jumps, late}, reverse=True):
            if late - t > near:
                stops = breaks[(breaks > t) & (breaks < late)]
                within = kicks.part((kicks.time > t) & (kicks.time < late))
                costate, summed = back.go(costate, late, t, within, stops)
                edges = np.concatenate([[t], stops, [late]])
                self._add((edges[:-1] + edges[1:]) / 2, self._unit * summed)
            for k in np.flatnonzero(kicks.time == t).tolist():
                costate, by_p = kicks.apply(k, costate)
                self._add(np.array([t]), self._unit * by_p[None])
            if t in jumps:
                costate = self._through(jumps[t], costate)
            late = t
        return self._unit * self._through(instants.start(), costate)

    def _through(self, jump: Jump, costate: np.ndarray) -> np.ndarray:
        """Costate before a jump."""
        costate, before, after = jump.back(costate)
        sides = np.array([jump.before.inside, jump.after.inside])
        self._add(sides, self._unit * np.array([before, after]))
        return costate

    def _with_samples(self, kicks: Kicks, others: np.ndarray, near: float) -> Kicks:
        """Kicks of events and of the weights of samples; one for each time."""
        weighed = np.any(self._by_x != 0, axis=1)
        sampled, known = self.motion.time[weighed], np.append(kicks.time, others)
        off = np.abs(sampled[:, None] - known)
        at = np.where(off.min(axis=1) <= near, known[off.argmin(axis=1)], _merged(sampled, near))
        time = np.unique(np.append(kicks.time, at))
        rows, (n_x, n_p) = (
            np.searchsorted(time, kicks.time),
            (self._by_x.shape[1], kicks.by_p.shape[1]),
        )
        found = Kicks(time, *(np.zeros((len(time), n)) for n in (n_x, n_x, n_x, n_p)))
        np.add.at(found.add, np.searchsorted(time, at), self._by_x[weighed] / self._unit)
        found.rate[rows], found.by_x[rows], found.by_p[rows] = kicks.rate, kicks.by_x, kicks.by_p
        return found

    def _breaks(self, end: float) -> np.ndarray:
        """Breaks of schedules from the start to `end`."""
        dense = self.motion.dense
        assert dense is not None
        start = float(dense.time[0])
        found = [schedule.breaks_between(start, end) for schedule in self.motion.schedules]
        return np.unique(np.concatenate([[], *found]))

    def gradient(self, costate: np.ndarray, doubts: tuple[NonsmoothEvent, ...]) -> Gradient:
        """The results by name."""
        model, names = self.motion.system.model, [s.name for s in self.motion.schedules]
        return Gradient(
            by_name(model.x, costate),
            by_name((*model.p, *model.u), self._by_p[:-1]),
            dict(zip(names, self._by_schedules, strict=True)),
            doubts,
        )
