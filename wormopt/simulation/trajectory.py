"""Trajectory: what `simulate` returns, a motion from its first instant to its last."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.labelled import SampledMotion
from wormopt.model.schedule import Schedule
from wormopt.numerics.expressions import at_rows
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import KINDS
from wormopt.simulation.variation import Directions, variation

# Points within a step at which a largest value is searched first, and number of refinements. The
# last is before a jump at the end of the step.
_WITHIN = np.array([0.0, 0.25, 0.5, 0.75, 1 - 1e-9])
_ZOOMS, _ZOOM_POINTS = 4, 41
# Error of the time of an event, relative to the span.
_ROUNDING = 1e-10
# Number of times at which expressions are evaluated at once.
_CHUNK = 50_000


def latest(end: float, start: float) -> float:
    """Latest time that is the end of a motion within rounding and errors of a last event."""
    return end + _ROUNDING * (abs(end) + end - start)


@dataclass(frozen=True)
class Event:
    """An instant at which a contact changes its mode or a switch of the model fires.

    Parameters
    ----------
    time : float
        When.
    name : str
        Name of the contact or of the switch.
    kind : {"reversal", "stick", "release", "impact", "switch"}
        A velocity zero is a "reversal" (the contact slides on, in either direction) or a "stick";
        a "release" ends a stick; an "impact" is a velocity that jumps to zero.
    mode : int
        Direction of the contact from then on: +1, -1, or 0 at rest; 0 for a switch.
    derivative : ndarray, shape (k,), optional
        Derivative of the time along the requested directions.

    Examples
    --------
    >>> Event(1.3, "mass 0", "stick", 0).kind
    'stick'
    """

    time: float
    name: str
    kind: str
    mode: int
    derivative: np.ndarray | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class NonsmoothEvent:
    """An event at which the derivatives of a motion do not exist, or hold on one side only.

    Derivatives after it belong to the branch that was followed.

    Parameters
    ----------
    event : Event
        The event, or an event that nearly occurs.
    reason : {"grazing", "simultaneous", "edge"}
        "grazing": a velocity or force barely crosses or misses its limit, so a small change may
        remove or add the event; "simultaneous": another event occurs at the same time, and a
        small change may reverse their order;
        "edge": a force is exactly at its limit, so a small change may release the contact.

    Examples
    --------
    >>> NonsmoothEvent(Event(1.3, "mass 0", "stick", 0), "edge").reason
    'edge'
    """

    event: Event
    reason: str


@dataclass(frozen=True, eq=False)
class Dense:
    """Polynomials of every step.

    In step k, with s = (t - time[k]) / (time[k+1] - time[k]) and r = 1 - s, the state is
    c0 + s (c1 + r (c2 + s (c3 + r (c4 + s (c5 + r (c6 + s c7)))))).
    """

    time: np.ndarray  # (steps + 1,) ends of the steps
    coefficients: np.ndarray  # (steps, 8, n_x) c0 to c7 of each step

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """States at times ``t`` (m,) within the motion; shape (n_x, m)."""
        step = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        s = np.minimum((t - self.time[step]) / (self.time[step + 1] - self.time[step]), 1.0)
        value = np.zeros((len(t), self.coefficients.shape[2]))
        for k in range(7, 0, -1):
            value = (value + self.coefficients[step, k]) * (s if k % 2 else 1 - s)[:, None]
        return (value + self.coefficients[step, 0]).T


@dataclass(frozen=True, eq=False)
class Trajectory(SampledMotion):
    """A simulated motion.

    Parameters
    ----------
    system : System
        Model and treatment of its contacts.
    route : str
        Integrator that was used: "native", "python", "radau", "cvodes" or "idas".
    p : ndarray
        Parameters, from `System.parameters`.
    schedules : tuple of Schedule
        Schedules of the model, with the values used.
    time : ndarray, shape (m,)
        Sample times; by default the ends of the steps, see `simulate`.
    states : ndarray, shape (n_x, m)
        States then; after a jump where one happens at that time.
    end_time : float
        Time at which the motion ends.
    end : ndarray, shape (n_x,)
        State there.
    event_rows : ndarray, shape (events, 4 + k)
        Time, index of contact or switch, kind, mode and derivatives of the time of each event in
        order of time, by numbers; see `events`.
    modes : ndarray, shape (1 + changes, 1 + contacts)
        Each row a time and the modes (+1, -1, 0) of ``system.contacts`` from then on; four more
        columns for each contact in the plane, how it begins to slip. Empty where
        contact was treated as smooth.
    n_steps, n_rejected, n_evaluations : int
        Accepted and rejected steps, evaluations of the ode.
    dense : Dense, optional
        Polynomials of all steps, if requested.
    along : Directions, optional
        Along which directions derivatives are known.
    state_derivatives : ndarray, shape (n_x, k, m)
        Derivatives of the states at the sample times; at a jump, the values after it.
    end_derivative : ndarray, shape (n_x, k)
        Derivatives of the last state at its time; at a terminal switch, at the switching time.
    nonsmooth_events : tuple of NonsmoothEvent
        Where derivatives do not exist, or hold on one side only.
    notes : tuple of str
        Notes about jumps and pulses that may have been missed.

    Examples
    --------
    A block thrown at speed 1 over ground that resists with 1 comes to rest at t = 1 after 0.5:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, f = (ca.SX.sym(name) for name in "xvf")
    >>> states = [wo.Signal("position", x, value=0.0), wo.Signal("velocity", v, value=1.0)]
    >>> ground = wo.Contact("block", v, f, wo.Coulomb(1.0, 2.0))
    >>> block = wo.Model("block", states, ca.vertcat(v, f), contacts=[ground])
    >>> motion = wo.simulate(block, 3.0, times=[0.5, 2.0])
    >>> motion["position"].round(9), motion.events[0].kind
    (array([[0.375, 0.5  ]]), 'stick')
    """

    system: System
    route: str
    p: np.ndarray
    schedules: tuple[Schedule, ...]
    time: np.ndarray
    states: np.ndarray
    end_time: float
    end: np.ndarray
    event_rows: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    modes: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))
    n_steps: int = 0
    n_rejected: int = 0
    n_evaluations: int = 0
    dense: Dense | None = None
    along: Directions | None = None
    state_derivatives: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    end_derivative: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    nonsmooth_events: tuple[NonsmoothEvent, ...] = ()
    notes: tuple[str, ...] = ()

    __repr__ = SampledMotion.__repr__

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Events in order of time."""
        rows, names = self.event_rows, self.system.happening
        changes = rows[:, 4:] if rows.shape[1] > 4 else [None] * len(rows)
        return tuple(
            Event(t, names[int(which)], KINDS[int(kind)], int(mode), along)
            for (t, which, kind, mode), along in zip(rows[:, :4].tolist(), changes, strict=True)
        )

    @property
    def _title(self) -> str:
        how = "exact" if self.system.exact else "smooth"
        counts = f"{len(self.event_rows)} events, {self.n_steps} steps"
        return f"Trajectory of {self.system.model.name} ({how}, {self.route}; {counts})"

    @cached_property
    def _rows(self) -> dict[str, slice]:
        signals = self.system.model.x
        ends = np.cumsum([s.size for s in signals]).tolist()
        return {s.name: slice(e - s.size, e) for s, e in zip(signals, ends, strict=True)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its states, then of the model's outputs."""
        outputs = (output.name for output in self.system.model.outputs)
        return tuple(dict.fromkeys([*self._rows, *outputs]))

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (entries, m) of a state, or of anything the model knows by name.

        UnknownNameError, a KeyError, where there is none; the message lists those there are.
        """
        if name in self._rows:
            return self.states[self._rows[name]]
        return self.values(self.system.named(name))

    @property
    def directions(self) -> tuple[str, ...]:
        """Labels of the directions along which derivatives are known."""
        return self.along.labels if self.along else ()

    def derivative(self, name: str) -> np.ndarray:
        """Derivative of the samples of a signal along the requested directions.

        Parameters
        ----------
        name : str
            A state, or anything the model knows by name.

        Returns
        -------
        ndarray, shape (size, k, m)
            For each direction, at fixed times.

        Raises
        ------
        ArgumentError
            If the motion was simulated without ``sensitivities``.
        UnknownNameError
            If the model has no signal of this name.
        """
        if self.along is None:
            raise ArgumentError("simulate with sensitivities=[...] to differentiate the motion")
        if name in self._rows:
            return self.state_derivatives[self._rows[name]]
        return self._observed_along(self.system.model[name])

    def _observed_along(self, expression: ca.SX) -> np.ndarray:
        assert self.along is not None
        t, n_fixed = self.time, self.system.n_fixed
        function, places = variation(self.system, self.along.active(n_fixed)).observed(expression)
        values = self.values(function)
        moved = [self.state_derivatives, self.along.scheduled(n_fixed, self.schedules, t)]
        change, n_x = np.zeros((expression.numel(), self.along.k, len(t))), len(self.states)
        for value, row, column in zip(values, *places.tolist(), strict=True):
            change[row] += value * moved[column >= n_x][column - n_x * (column >= n_x)]
        return change

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the trust report: open laws, what may be missed, inputs at bounds."""
        return (*self.system.warnings, *self.notes, *self._saturation())

    def _saturation(self) -> tuple[str, ...]:
        """Warning with the share of time in which inputs are cut to their bounds, if they are."""
        if "saturated" not in self.names or len(self.time) < 2:
            return ()
        cut = np.any(self["saturated"] != 0, axis=0)
        if not cut.any():
            return ()
        share = float(np.sum(np.diff(self.time)[cut[:-1]]) / (self.time[-1] - self.time[0]))
        return (
            f"inputs are cut to their bounds for {share:.2g} of the time, "
            f"first at t = {self.time[int(np.argmax(cut))]:.6g}",
        )

    def at(self, t: np.ndarray) -> Trajectory:
        """Sample the motion anew, at any times within it.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times, ascending.

        Raises
        ------
        ArgumentError
            If the motion was simulated without ``dense = True``, or a time lies outside it.
        """
        if self.dense is None:
            raise ArgumentError("simulate with dense=True to sample the motion afterwards")
        t = np.asarray(t, dtype=float)
        first, last = self.dense.time[0], self.dense.time[-1]
        if t.size and not (first <= t.min() and t.max() <= latest(last, first)):
            raise ArgumentError(f"times must be from {first:g} to {last:g}")
        x, (n_x, k) = self.dense(t), self.end_derivative.shape
        states, along = x[: len(self.states)], x[len(self.states) :]
        return replace(self, time=t, states=states, state_derivatives=along.reshape(n_x, k, len(t)))

    def modes_at(self, t: np.ndarray) -> np.ndarray:
        """Modes of the contacts that may rest, at any times.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times; at an event the mode after it counts.

        Returns
        -------
        ndarray, shape (contacts, m)
            Resting contacts at each time; no rows if contact was smooth.
        """
        return self.s_at(t)[: len(self.system.contacts)]

    def s_at(self, t: np.ndarray) -> np.ndarray:
        """Modes and onsets of the contacts, as functions of the System take them.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times; at an event, the modes after it.

        Returns
        -------
        ndarray, shape (n_s, m)
            Values at each time; no rows if contact was smooth.
        """
        if len(self.modes) == 0:
            return np.zeros((0, len(t)))
        row = np.searchsorted(self.modes[:, 0], t, side="right") - 1
        return self.modes[np.maximum(row, 0), 1:].T

    def observe(self, expression: ca.SX) -> np.ndarray:
        """Value (k, m) of any expression of the model's symbols at the sample times.

        Parameters
        ----------
        expression : casadi.SX
            Column of k entries; it may contain contact forces.
        """
        return self.values(self.system.observe(expression))

    def values(self, function: ca.Function, *further: np.ndarray) -> np.ndarray:
        """Values (k, m) of a function of `System.observe` at the sample times.

        In groups of samples, since parameters are repeated for each.

        Parameters
        ----------
        function : casadi.Function
            Function of (t, x, p, s), with one column as its result.
        *further : ndarray, shape (any, m)
            Arguments of the function after these, at the sample times.
        """
        found = np.empty((function.numel_out(0), len(self.time)))
        for k in range(0, len(self.time), _CHUNK):
            t, x = self.time[k : k + _CHUNK], self.states[:, k : k + _CHUNK]
            p = self.system.scheduled(self.p, self.schedules, t)
            more = [one[:, k : k + _CHUNK] for one in further]
            columns = (t[None], x, p, self.s_at(t), *more)
            found[:, k : k + _CHUNK] = at_rows(function, *(one.T for one in columns))[0].T
        return found

    def stick_intervals(self) -> list[tuple[str, float, float]]:
        """Find the intervals in which contacts rest; requires exact contact.

        Returns
        -------
        list of (str, float, float)
            Name of the contact, begin and end, in order of their begin.
        """
        found = []
        for column, contact in enumerate(self.system.contacts, start=1):
            resting = np.append(self.modes[:, column] == 0, False) if len(self.modes) else []
            times = np.append(self.modes[:, 0], self.end_time)
            begun = None
            for time, holds in zip(times, resting, strict=False):
                if holds and begun is None:
                    begun = float(time)
                elif not holds and begun is not None:
                    if time > begun:
                        found.append((contact.name, begun, float(time)))
                    begun = None
        return sorted(found, key=lambda interval: interval[1])

    def largest(self, expression: str | ca.SX) -> float:
        """Find the largest absolute value of a signal's entries over all time.

        Parameters
        ----------
        expression : str or casadi.SX
            Name of a signal, or a column of the model's symbols.

        Returns
        -------
        float
            Computed from the samples if simulated without ``dense = True``.
        """
        expression = self.system.model[expression] if isinstance(expression, str) else expression
        if self.dense is None:
            return float(np.max(np.abs(self.observe(expression))))
        function = self.system.observe(expression)

        def sizes(t: np.ndarray) -> np.ndarray:
            return np.abs(self.at(t).values(function)).max(axis=0)

        ends = self.dense.time
        t = (ends[:-1, None] + np.diff(ends)[:, None] * _WITHIN).ravel()
        t = np.append(t, ends[-1])
        found = np.concatenate([sizes(t[k : k + _CHUNK]) for k in range(0, len(t), _CHUNK)])
        best = found.max()
        for _ in range(_ZOOMS):
            k = int(np.argmax(found))
            t = np.linspace(t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)], _ZOOM_POINTS)
            found = sizes(t)
            best = max(best, found.max())
        return float(best)
