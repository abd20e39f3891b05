"""Task and Outcome: input and output of every integrator, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.model.schedule import Schedule
from wormopt.model.values import nominal_of
from wormopt.numerics.expressions import Call
from wormopt.simulation.functions import System
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.variation import Directions, Variation, rhs_of, variation

KINDS = ("reversal", "stick", "release", "impact", "switch")
"""Kinds of events by their numbers."""
REASONS = ("grazing", "simultaneous", "edge")
"""Why derivatives are in doubt, by the numbers of integrators."""

F_REST = 1e-13
"""Share of a holding force that is rounding."""

SLACK = 10.0
"""Factor by which relative errors of derivatives may exceed those of states."""

# Largest error of an onset, in tolerances: errors of steps are far below these. It decreases with
# at least the fourth power of the onset's length, so that a small error costs few steps.
_ONSET = 0.05


@dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """One motion to integrate."""

    system: System
    span: tuple[float, float]  # first and last time
    x0: np.ndarray  # (n_x,) the model's states, then those counted by `System.n_pushes`
    p: np.ndarray  # from `System.parameters`
    schedules: tuple[Schedule, ...]  # those of the model, perhaps with other values
    tolerance: Tolerance
    times: np.ndarray  # (m,) ascending sample times within the span
    dense: bool = False  # keep the polynomials of all steps
    keep: int = 0  # most ends of steps to keep; 0: samples at `times`
    directions: Directions | None = None  # of derivatives to integrate, too
    # the smooth equations as CVODES takes them, in states of nominal size, if already compiled
    equations: ca.Function | None = None

    @cached_property
    def start(self) -> np.ndarray:
        """x0, then row by row its derivatives along the directions."""
        return self.x0 if self.directions is None else np.append(self.x0, self.directions.x0)

    @cached_property
    def all_p(self) -> np.ndarray:
        """P, then row by row its directions."""
        return self.p if self.directions is None else np.append(self.p, self.directions.p)

    @cached_property
    def k(self) -> int:
        """Number of directions."""
        return self.directions.k if self.directions else 0

    @cached_property
    def variation(self) -> Variation | None:
        """Functions for derivatives along the directions."""
        along = self.directions
        return variation(self.system, along.active(self.system.n_fixed)) if along else None

    @cached_property
    def rhs(self) -> ca.Function:
        """X', followed by its derivatives along the directions."""
        return rhs_of(self.variation, self.k, True) if self.variation else self.system.rhs

    @property
    def smooth_rhs(self) -> ca.Function:
        """Differentiable `rhs`: without limits of slopes that are 0/0."""
        return rhs_of(self.variation, self.k, False) if self.variation else self.system.rhs

    def broken(self, x: np.ndarray, dx: np.ndarray) -> str | None:
        """Reason to give up if states or rates are not finite; None if all are."""
        n_x = len(self.x0)
        if not np.all(np.isfinite([x[:n_x], dx[:n_x]])):
            return "not_finite"
        return None if np.all(np.isfinite([x, dx])) else "steep_derivatives"

    @cached_property
    def absolute(self) -> np.ndarray:
        """Absolute tolerance of every state."""
        pushed = self._nominal_speeds[self.system.row_contact][: self.system.n_pushes]
        return self.tolerance.absolute * np.append(nominal_of(self.system.model.x), pushed)

    @cached_property
    def all_absolute(self) -> np.ndarray:
        """Absolute tolerances of states, then of derivatives as large as they are nominally."""
        if self.directions is None:
            return self.absolute
        own = self.absolute[: self.system.model.n_x]
        return np.append(self.absolute, SLACK * np.outer(own, self.column_sizes))

    @cached_property
    def column_sizes(self) -> np.ndarray:
        """Expected sizes of derivatives per direction, in units of nominal sizes of states."""
        # With these, nominal directions change states by nominal sizes.
        if self.directions is None:
            return np.zeros(0)
        model, nominal_p = self.system.model, np.ones(len(self.p))
        given = nominal_of((*model.p, *model.u))
        nominal_p[: len(given)] = given
        return self.directions.sizes(nominal_of(model.x), self.p, nominal_p, self.schedules)

    @cached_property
    def column_floor(self) -> np.ndarray:
        """Least sizes of columns, in absolute tolerances of states."""
        # Where a column leaves 0 all of it is error, and zeros of theory are rounding.
        return 0.01 * self.column_sizes / self.tolerance.absolute

    @cached_property
    def _nominal_speeds(self) -> np.ndarray:
        return np.array([c.nominal_speed for c in self.system.contacts], dtype=float)

    @cached_property
    def v_rest(self) -> np.ndarray:
        """Per contact the speed that is rounding."""
        return 1e-14 * self._nominal_speeds

    @cached_property
    def v_stop(self) -> np.ndarray:
        """Per contact the speed at which it stops: in the plane speeds have no sign to change."""
        errors = self.tolerance.stop or 10 * (self.tolerance.relative + self.tolerance.absolute)
        return self._in_plane(errors * self._nominal_speeds, self.v_rest)

    @cached_property
    def reach(self) -> np.ndarray:
        """Speeds of contacts in the plane, see `wormopt.simulation.crossings`; (4, contacts).

        Speed of a stop; least and largest at the end of an onset; least over largest error of an
        onset. 0 for others.
        """
        tolerated = self.tolerance.relative + self.tolerance.absolute
        least, error = 100 * self.v_stop, _ONSET * tolerated
        rows = [self.v_stop, least, 0.1 * self._nominal_speeds, least / error]
        return self._in_plane(np.array(rows), 0.0)

    def _in_plane(self, there: np.ndarray, else_: np.ndarray | float) -> np.ndarray:
        planar = np.zeros(len(self.system.contacts), dtype=bool)
        planar[self.system.planar] = True
        return np.where(planar, there, else_)

    @cached_property
    def v_drift(self) -> np.ndarray:
        """Per contact the speed that a resting velocity may accumulate by errors of steps."""
        errors = (self.tolerance.relative + self.tolerance.absolute) * self._nominal_speeds
        return 1e3 * (self.v_rest + errors)

    @cached_property
    def f_rest(self) -> np.ndarray:
        """Per contact the force that is rounding, relative to its holding force."""
        n = len(self.system.contacts)
        if not self.system.exact:
            return np.zeros(n)
        p = self.system.scheduled(self.p, self.schedules, np.array([self.span[0]]))[:, 0]
        call = Call(self.system.probe)  # an ordinary call takes as long as 2000 evaluations
        (probe,) = call(self.span[0], self.x0, p, self.system.sliding)
        held = np.abs(probe[3 * n : 5 * n].reshape(2, n))
        # the smaller of both directions: a large holding force of the other does not act
        some = np.isfinite(held) & (held > 0)
        least = np.where(some, held, np.inf).min(axis=0, initial=np.inf)
        nominal = np.array([c.nominal_force for c in self.system.contacts])
        none = ~some.any(axis=0) | (held == 0).any(axis=0)
        return F_REST * np.where(none, np.minimum(least, nominal), least)

    @property
    def small_value(self) -> float:
        """Share of a velocity or a force within errors of the motion."""
        return 100 * (self.tolerance.relative + self.tolerance.absolute)

    @property
    def small_rate(self) -> float:
        """Share of its parts below which the rate of an event function is negligible."""
        # A function that falls so slowly stays within errors of the motion of 0.
        return float(np.sqrt(10 * (self.tolerance.relative + self.tolerance.absolute)))

    @property
    def max_step(self) -> float:
        """Longest step."""
        longest = self.tolerance.max_step
        return (self.span[1] - self.span[0]) / 50 if longest is None else longest

    @cached_property
    def v_layer(self) -> np.ndarray:
        """Per contact the width over which the smooth law is steep."""
        treatment = self.system.treatment
        width = treatment.v_reg if isinstance(treatment, Smooth) else 0.0
        return np.full(len(self.system.contacts), width)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of an integrator, as far as it came; `status` is "done" or the reason to stop.

    Reasons: "step_too_small", "not_finite", "too_many_steps", "stiff", "events_accumulate",
    "no_contact_mode", "no_memory", "layer_not_resolved", "solver_failed", "interrupted",
    "steep_derivatives", "open_force".
    """

    status: str
    route: str  # name of the integrator
    t: float  # time reached
    x: np.ndarray  # (n_x,) at `t`, then derivatives as in `InitialValueProblem.start`
    samples: np.ndarray  # (reached, n_x) at the sample times reached
    n_steps: int
    n_rejected: int
    n_evaluations: int
    # rows: time, contact (indices of switches follow), index in `KINDS`, mode from then on, then
    # derivatives of the time
    events: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    # rows: time, contact or switch, its mode, index in `REASONS`
    doubts: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    # (1 + changes, 1 + contacts) time, modes from then on
    modes: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))
    # (m, 1 + n_x) times and states at the beginnings of steps, where kept, see `Kept`
    kept: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))
    # (steps + 1,) ends of the steps, where kept
    dense_time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    # (steps, 8, n_x) polynomials, see `Dense`
    dense: np.ndarray = field(default_factory=lambda: np.zeros((0, 8, 0)))
    notes: tuple[str, ...] = ()  # possibly missed events
