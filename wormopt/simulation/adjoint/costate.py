"""The adjoint equation along a motion, itself a Model that is simulated: backwards in time.

With H = l' f(t, x, p) the costate follows l' = -H_x, and H_p summed over time is the derivative by
the parameters. The motion comes in by a schedule, one piece for each of its steps: the polynomial
of the step, its modes, and what the schedules of the model were.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model, Signal
from wormopt.model.schedule import Schedule
from wormopt.progress import silent
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.options import Exact, Route, Tolerance
from wormopt.simulation.routes import integrate
from wormopt.simulation.trajectory import Trajectory


class Costate:
    """The adjoint equation of a System; its time runs backwards from the end of a stretch."""

    def __init__(self, system: System) -> None:
        t, x, p, s = system.symbols
        self.n_x, self.n_p = system.model.n_x, p.numel()
        n_fixed = system.n_fixed
        backwards, begin = ca.SX.sym("backwards"), ca.SX.sym("begin")
        polynomial = ca.SX.sym("polynomial", self.n_x, 8)
        piece = [ca.SX.sym(name, n) for name, n in (("begin", 1), ("length", 1), ("last", 1))]
        first, length, last = piece
        share = last - (backwards - begin) / length
        costate, size = ca.SX.sym("costate", self.n_x), ca.SX.sym("size", self.n_p)
        nominal = np.concatenate([np.full(s.size, s.nominal) for s in system.model.x])
        rates = system.rhs(t, x, p, s)[: self.n_x]
        slopes = ca.jtimes(rates, ca.vertcat(x[: self.n_x], p), costate / nominal, True)
        slopes = slopes * ca.vertcat(nominal, size)
        slopes = ca.substitute(
            slopes,
            ca.vertcat(t, x[: self.n_x]),
            ca.vertcat(first + length * share, _value(polynomial, share)),
        )
        value = ca.vertcat(*piece, ca.vec(polynomial), s, p[n_fixed:])
        pieces = np.zeros((1, value.numel()))
        past = Schedule("past", value, begin, np.array([0.0, 1.0]), pieces)
        summed = ca.SX.sym("summed", self.n_p)
        model = Model(
            f"adjoint of {system.model.name}",
            x=[Signal("costate", costate), Signal("summed", summed)],
            ode=slopes,
            p=[Signal("fixed", p[:n_fixed]), Signal("size", size)],
            t=backwards,
            schedules=[past],
        )
        self.system = System(model, Exact())


def _value(polynomial: ca.SX, share: ca.SX) -> ca.SX:
    """State within a step, see `Dense`; columns are c0 to c7."""
    value = ca.SX.zeros(polynomial.size1())
    for k in range(7, 0, -1):
        value = (value + polynomial[:, k]) * (share if k % 2 else 1 - share)
    return value + polynomial[:, 0]


@lru_cache(maxsize=32)
def costate_of(system: System) -> Costate:
    """The adjoint equation of a System, made once."""
    return Costate(system)


class Backwards:
    """Costates along one motion.

    `sizes`: of the parameters (n_p,), by which errors of the derivatives by them are judged.
    """

    def __init__(
        self, motion: Trajectory, sizes: np.ndarray, tolerance: Tolerance, route: Route
    ) -> None:
        self._motion, self._tolerance = motion, tolerance
        self._route: Route = route
        self._equation = costate_of(motion.system)
        nominal = [np.full(s.size, s.nominal) for s in motion.system.model.x]
        self._units = np.append(np.concatenate(nominal), sizes)
        fixed = motion.p[: motion.system.n_fixed]
        self._p = self._equation.system.parameters({"fixed": fixed, "size": sizes})

    @cached_property
    def _pieces(self) -> np.ndarray:
        """Rows of the schedule but for their third entry, one for each step of the motion."""
        motion, dense = self._motion, self._motion.dense
        assert dense is not None
        begins, lengths = dense.time[:-1], np.diff(dense.time)
        middle = begins + lengths / 2
        p = motion.system.scheduled(motion.p, motion.schedules, middle)[motion.system.n_fixed :]
        steps = len(lengths)
        polynomials = dense.coefficients[:, :, : self._equation.n_x].reshape(steps, -1)
        return np.hstack(
            [np.c_[begins, lengths, np.ones(steps)], polynomials, motion.s_at(middle).T, p.T]
        )

    def go(
        self, costate: np.ndarray, late: float, early: float, stops: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Costate (n_x,) at `early` from that at `late`, without anything happening between.

        Gives it and the derivatives by parameters (stops + 1, n_p), summed over the time before
        each of the `stops` (ascending, within) and after the last.
        """
        dense = self._motion.dense
        assert dense is not None
        first = int(np.searchsorted(dense.time, early, side="right")) - 1
        last = int(np.searchsorted(dense.time, late, side="left")) - 1
        steps = np.arange(last, first - 1, -1)
        ends = np.minimum(dense.time[steps + 1], late)
        breaks = np.append(late - ends, late - early)
        keep = np.diff(breaks) > 0  # but for rounding
        values = self._pieces[steps][keep]
        values[:, 2] = ((ends - dense.time[steps]) / np.diff(dense.time)[steps])[keep]
        (past,) = self._equation.system.model.schedules
        system, n_x = self._equation.system, self._equation.n_x
        length = late - early
        sampled = np.append(late - stops[::-1], length)
        task = InitialValueProblem(
            system=system,
            span=(0.0, length),
            x0=np.append(costate * self._units[:n_x], np.zeros(self._equation.n_p)),
            p=self._p,
            schedules=(replace(past, breaks=np.append(breaks[:-1][keep], length), values=values),),
            tolerance=replace(self._tolerance, max_step=length),
            times=np.clip(sampled, 0.0, length),
        )
        outcome = integrate(task, self._route, silent)
        if outcome.status != "done":
            raise SolveError(
                f"the adjoint equation could not be followed back below t = {late - outcome.t:.6g}",
                "loosen the tolerance, or take sensitivities forward in time",
                code=outcome.status,
            )
        found = outcome.samples / self._units
        summed = np.diff(found[:, n_x:], axis=0, prepend=0.0)
        return found[-1, :n_x], summed[::-1]
