"""Time stepping of Moreau and Jean: motions between walls, with impacts and dry friction.

Unilateral contact and friction hold as set-valued laws, at the level of velocities: over each step
of fixed length, walls that are touched at its middle give impulses by which nothing moves into
them, and friction holds or slides by the law's own numbers. Impacts need not be located, however
many there are. Without contact and damping the steps are those of the leapfrog: symplectic, of
second order, their energy oscillates and does not drift.

Walls must not act on one another within a step, as is so where masses are lumped and every mass
touches at most one wall at a time. Then impulses are a closed expression of the state. Friction
whose limits do not depend on a wall's impulse needs no gap, and may couple contacts. In the plane
its impulse is the nearest of those of the law to the one that would stop the contact.

Sources: J. J. Moreau, in Nonsmooth Mechanics and Applications (1988) 1; M. Jean, Comput. Methods
Appl. Mech. Eng. 177 (1999) 235; E. Hairer, C. Lubich, G. Wanner, Acta Numerica 12 (2003) 399.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SolveError, interruptible
from wormopt.model.given import check_kind
from wormopt.model.model import Model
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.impulses import Impulses
from wormopt.simulation.native.function import repeated

# Number of steps between two samples of the state, and of samples between two reports.
_STRIDE, _SPAN = 10, 500
# Share of the longest stable step that is taken by default.
_SAFE = 0.8


@dataclass(frozen=True, eq=False)
class StepRecord:
    """A motion, sampled every few steps."""

    time: np.ndarray  # (m,)
    states: np.ndarray  # (n_x, m)
    pressed: np.ndarray  # (contacts, m - 1) mean normal force between two samples
    rubbed: np.ndarray  # (components, m - 1) mean tangential force, likewise
    # (m,) each, work until then: by "walls" (impacts), by "friction", integrals of outputs
    work: dict[str, np.ndarray]
    n_steps: int


@dataclass(frozen=True, eq=False)
class MoreauJean:
    """The steps of one model, compiled once for all its parameters.

    Parameters
    ----------
    model : Model
        Its states are places and then their rates, and so many of each. Contacts have a gap and a
        normal force, or neither.
    integrals : sequence of str, optional
        Outputs to integrate over time.
    inputs : casadi.Function, optional
        From the places and a column of scheduled values to the model's inputs, which are 0 without
        it. Unlike an expression in the model it is not unrolled, and loops stay loops.

    Raises
    ------
    ArgumentError
        If the model is not of this form.

    Examples
    --------
    A block of weight 1 falls from 0.5 to the floor, which then presses back with 1:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> y, v, force, N = (ca.SX.sym(name) for name in ("y", "v", "force", "N"))
    >>> floor = wo.Contact("floor", ca.SX(0), force, wo.Coulomb(N, N), gap=y, normal_force=N)
    >>> states = [wo.Signal("height", y, value=0.5), wo.Signal("speed", v, value=0.0)]
    >>> block = wo.Model("block", states, ca.vertcat(v, N - 1), contacts=[floor])
    >>> motion = MoreauJean(block).march(2.0, step=1e-3)
    >>> bool(abs(motion.states[0, -1]) < 1e-3), float(motion.pressed[0, -1].round(9))
    (True, 1.0)
    """

    model: Model
    integrals: Sequence[str] = ()
    inputs: ca.Function | None = None

    _impulses: Impulses = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_kind("model", self.model, Model)
        object.__setattr__(self, "_impulses", Impulses(self.model, self.integrals))

    def march(
        self,
        end: float,
        x0: np.ndarray | None = None,
        *,
        p: dict[str, float] | None = None,
        schedule: Schedule | None = None,
        step: float | None = None,
        report: Report = silent,
    ) -> StepRecord:
        """Follow the motion.

        Parameters
        ----------
        end : float
            Last time; the first is 0.
        x0 : ndarray, shape (n_x,), optional
            State at time 0; the model's own start if left out.
        p : dict, optional
            Parameters by name, where they are not the model's own.
        schedule : Schedule, optional
            The values that ``inputs`` takes.
        step : float, optional
            Longest step; 0.8 of the longest stable one at the start if left out.
        report : callable, optional
            Told how far it is.

        Returns
        -------
        StepRecord

        Raises
        ------
        ArgumentError
            If walls act on one another, or there is no step to take: nothing resists, and none
            is given.
        SolveError
            If the motion is no longer a number; ``partial`` holds it up to there.
        Interrupted
            If the user stopped it; likewise.
        """
        numbers = signal_values(tuple(self.model.p), p, "parameter")
        x0 = signal_values(self.model.x, None, "state", fill=0.0) if x0 is None else x0
        self._impulses.check(x0, numbers)
        longest = self.safe_step(x0, numbers) if step is None else step
        if not (0 < longest < math.inf and 0 < end < math.inf):
            raise ArgumentError(f"steps of {longest:g} do not lead to t = {end:g}; name a step")
        times = _looks(schedule, end, longest)
        sizes = np.diff(times) / _STRIDE
        scheduled = self._scheduled(schedule, times)
        columns = [np.append(x0, np.zeros(self._impulses.n_gathered))[:, None]]
        last = len(sizes)
        for first in range(0, last, _SPAN):
            part = slice(first, min(first + _SPAN, last))
            try:
                report("stepping", first / last)
                with interruptible():
                    found = self._advance(
                        columns[-1][:, -1], scheduled[:, part], numbers, sizes[part]
                    )
            except KeyboardInterrupt:
                raise Interrupted(self._steps(times, columns)) from None
            columns.append(found)
            if not np.all(np.isfinite(found[:, -1])):
                reason = f"the motion is no longer a number before t = {times[part.stop]:.6g}"
                partial = self._steps(times, columns[:-1])
                raise SolveError(reason, "take a shorter step", partial, "not_finite")
        return self._steps(times, columns)

    def stable_step(self, x0: np.ndarray, numbers: np.ndarray) -> float:
        """Longest step that keeps small vibrations about a state small.

        Parameters
        ----------
        x0 : ndarray, shape (n_x,)
            The state.
        numbers : ndarray
            Parameters.

        Returns
        -------
        float
            Infinite where nothing resists.
        """
        half = self._impulses.n_q
        J = np.array(self._impulses.linear(x0, numbers))[half:]
        stiffness = np.abs(np.linalg.eigvals(J[:, :half])).max(initial=0.0)
        damping = np.abs(np.linalg.eigvals(J[:, half:])).max(initial=0.0)
        if not stiffness and not damping:
            return math.inf
        # the leapfrog with damping at the beginning of the step: 2 c h + k h² < 4, both at most so
        return float(4 / (damping + math.sqrt(damping**2 + 4 * stiffness)))

    def safe_step(self, x0: np.ndarray, numbers: np.ndarray) -> float:
        """Step that is taken where none is given: 0.8 of the longest stable one.

        Parameters
        ----------
        x0, numbers : ndarray
            As for `stable_step`.

        Returns
        -------
        float
        """
        return _SAFE * self.stable_step(x0, numbers)

    def _scheduled(self, schedule: Schedule | None, times: np.ndarray) -> np.ndarray:
        """Values of the schedule between the samples."""
        middle = (times[:-1] + times[1:]) / 2
        if schedule is None:
            return np.zeros((self._n_scheduled, len(middle)))
        return schedule.values[schedule.locate(middle)[1]].T

    def _advance(
        self, x: np.ndarray, scheduled: np.ndarray, numbers: np.ndarray, sizes: np.ndarray
    ) -> np.ndarray:
        count = len(sizes)
        many = self._span if count == _SPAN else self._stride.mapaccum("march", count)
        return np.array(many(x, scheduled, np.tile(numbers[:, None], count), sizes[None, :]))

    @cached_property
    def _span(self) -> ca.Function:
        return self._stride.mapaccum("march", _SPAN)

    def _steps(self, times: np.ndarray, columns: list[np.ndarray]) -> StepRecord:
        found = np.hstack(columns)
        count, n_c = found.shape[1], len(self.model.contacts)
        states, gathered = found[: self.model.n_x], found[self.model.n_x :]
        n_work = 2 + len(self.integrals)
        work, impulses = gathered[:n_work], gathered[n_work:]
        forces = np.diff(impulses, axis=1) / np.diff(times[:count])
        names = ("walls", "friction", *self.integrals)
        return StepRecord(
            time=times[:count],
            states=states,
            pressed=forces[:n_c],
            rubbed=forces[n_c:],
            work=dict(zip(names, work, strict=True)),
            n_steps=(count - 1) * _STRIDE,
        )

    @cached_property
    def _stride(self) -> ca.Function:
        """A few steps: of state and accumulated values, scheduled values, parameters, step size."""
        return repeated(self._step, _STRIDE)

    @property
    def _step(self) -> ca.Function:
        impulses, n_x = self._impulses, self.model.n_x
        half, u, p = impulses.n_q, *impulses.symbols[2:4]
        sizes = [n_x + impulses.n_gathered, self._n_scheduled, p.numel(), 1]
        x, c, p, h = given = [
            ca.MX.sym(name, size) for name, size in zip("xcph", sizes, strict=True)
        ]
        q, v, gathered = x[:half], x[half:n_x], x[n_x:]
        middle = q + h / 2 * v
        u = ca.DM.zeros(u.numel()) if self.inputs is None else self.inputs(middle, c)
        after, more = impulses.kick(middle, v, u, p, h)
        found = ca.vertcat(middle + h / 2 * after, after, gathered + more)
        return ca.Function("step", given, [found], [*"xcph"], ["found"])

    @property
    def _n_scheduled(self) -> int:
        return 0 if self.inputs is None else int(self.inputs.size1_in(1))


def _looks(schedule: Schedule | None, end: float, longest: float) -> np.ndarray:
    """Times of the samples: even between breaks of the schedule."""
    breaks = np.array([0.0, end])
    if schedule is not None:
        clock = Model("clock", x=(), ode=ca.SX(0, 1), schedules=[schedule])
        breaks = clock.breaks(end)
    counts = np.maximum(np.ceil(np.diff(breaks) / (_STRIDE * longest) - 1e-9), 1).astype(int)
    parts = [
        np.linspace(a, b, k, endpoint=False)
        for a, b, k in zip(breaks[:-1], breaks[1:], counts, strict=True)
    ]
    return np.append(np.concatenate(parts), end)
