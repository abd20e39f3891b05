"""The adjoint equation along a motion, itself a Model that is simulated backwards in time.

With H = l' f(t, x, p) the costate follows l' = -H_x; the integral of H_p is the derivative with
respect to the parameters. A schedule contains the motion, one piece for each step: its polynomial,
modes, and the values of the model's schedules. At samples and events the costate jumps: two
switches fire in turn where a piece says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.model.values import nominal_of
from wormopt.progress import silent
from wormopt.simulation.functions import System
from wormopt.simulation.initial_value import InitialValueProblem
from wormopt.simulation.options import Exact, Route, Tolerance
from wormopt.simulation.routes import integrate
from wormopt.simulation.trajectory import Trajectory

_ROUND_OFF = 32 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Kicks:
    """Jumps of a costate, in order of time: l1 = l + add, then l1 - (l1' rate) by_x.

    The derivative with respect to the parameters increases by -(l1' rate) by_p.
    """

    time: np.ndarray  # (m,)
    add: np.ndarray  # (m, n_x)
    rate: np.ndarray  # (m, n_x)
    by_x: np.ndarray  # (m, n_x)
    by_p: np.ndarray  # (m, n_p)

    def part(self, chosen: np.ndarray) -> Kicks:
        """A slice of them."""
        return Kicks(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def apply(self, k: int, costate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Costate before the jumps, and increase of the derivative by the parameters."""
        costate = costate + self.add[k]
        share = costate @ self.rate[k]
        return costate - share * self.by_x[k], -share * self.by_p[k]


class Costate:
    """The adjoint equation of a System; its time runs backwards from the end of a stretch."""

    def __init__(self, system: System) -> None:
        t, x, p, s = system.symbols
        self.n_x, self.n_p = system.model.n_x, p.numel()
        n_fixed, n = system.n_fixed, system.model.n_x
        backwards, begin = ca.SX.sym("backwards"), ca.SX.sym("begin")
        polynomial = ca.SX.sym("polynomial", n, 8)
        piece = [ca.SX.sym(name) for name in ("begin", "length", "last")]
        first, length, last = piece
        share = last - (backwards - begin) / length
        costate, size = ca.SX.sym("costate", n), ca.SX.sym("size", self.n_p)
        summed = ca.SX.sym("summed", self.n_p)
        nominal = nominal_of(system.model.x)
        rates = system.rhs(t, x, p, s)[:n]
        slopes = ca.jtimes(rates, ca.vertcat(x[:n], p), costate / nominal, True)
        slopes = ca.substitute(
            slopes * ca.vertcat(nominal, size),
            ca.vertcat(t, x[:n]),
            ca.vertcat(first + length * share, _value(polynomial, share)),
        )
        sizes = (("fires", 2), ("add", n), ("rate", n), ("by_x", n), ("by_p", self.n_p))
        fires, add, rate, by_x, by_p = kick = [ca.SX.sym(*each) for each in sizes]
        _, scheduled = ca.vertsplit(p, [0, n_fixed, self.n_p])  # a slice of no entries has a row
        value = ca.vertcat(*piece, ca.vec(polynomial), s, scheduled, *kick)
        pieces = np.zeros((1, value.numel()))
        past = Schedule("past", value, begin, np.array([0.0, 1.0]), pieces)
        grown = costate + add
        jump = ca.dot(grown, rate)
        after = ca.vertcat(grown - jump * by_x, summed - jump * by_p)
        model = Model(
            f"adjoint of {system.model.name}",
            x=[Signal("costate", costate), Signal("summed", summed)],
            ode=slopes,
            p=[Signal("fixed", p[:n_fixed]), Signal("size", size)],
            t=backwards,
            schedules=[past],
            switches=[Switch(name, fires[k], after) for k, name in enumerate(("one", "other"))],
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
    """The adjoint equation of a System, cached."""
    return Costate(system)


class Backwards:
    """Costates along one motion.

    `sizes`: of the parameters (n_p,), to which errors of their derivatives are compared.
    """

    def __init__(
        self, motion: Trajectory, sizes: np.ndarray, tolerance: Tolerance, route: Route
    ) -> None:
        assert motion.dense is not None
        self._motion, self._time, self._tolerance = motion, motion.dense.time, tolerance
        self._route: Route = route
        self._equation = costate_of(motion.system)
        self._nominal, self._sizes = nominal_of(motion.system.model.x), sizes
        fixed = motion.p[: motion.system.n_fixed]
        self._p = self._equation.system.parameters({"fixed": fixed, "size": sizes})

    @cached_property
    def _pieces(self) -> np.ndarray:
        """Rows of the schedule without kicks, one for each step of the motion."""
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

    def near(self, late: float) -> float:
        """Times before `late` closer than this are one to a schedule."""
        return _ROUND_OFF * max(abs(late), late - float(self._time[0]))

    def _past(self, late: float, early: float, kicks: Kicks) -> Schedule:
        """Schedule of the motion between two times, backwards."""
        inner = self._time[(self._time > early) & (self._time < late)]
        far = np.abs(inner[:, None] - kicks.time).min(axis=1, initial=np.inf)
        inner = np.union1d(inner[far > self.near(late)], kicks.time)
        edges = np.concatenate([[late], inner[::-1], [early]])
        ends, middles = edges[:-1], (edges[:-1] + edges[1:]) / 2
        step = np.searchsorted(self._time, middles, side="right") - 1
        step = np.clip(step, 0, len(self._time) - 2)
        values = np.zeros((len(ends), self._equation.system.model.schedules[0].symbol.numel()))
        known = self._pieces[step]
        values[:, : known.shape[1]] = known
        values[:, 2] = (ends - self._time[step]) / np.diff(self._time)[step]
        kicked = values[:, known.shape[1] :]
        kicked[:, :2] = -1.0
        rows = len(ends) - 1 - np.searchsorted(inner, kicks.time)
        kicked[rows, np.arange(len(rows)) % 2] = 1.0
        kicked[rows, 2:] = np.hstack(
            [
                kicks.add * self._nominal,
                kicks.rate / self._nominal,
                kicks.by_x * self._nominal,
                kicks.by_p * self._sizes,
            ]
        )
        (past,) = self._equation.system.model.schedules
        breaks = late - edges
        keep = np.diff(breaks) > 0  # but for rounding
        return replace(past, breaks=np.append(breaks[:-1][keep], breaks[-1]), values=values[keep])

    def go(
        self, costate: np.ndarray, late: float, early: float, kicks: Kicks, stops: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Costate (n_x,) at `early` from that at `late`, with the kicks in between.

        Returns it and the derivatives by parameters (stops + 1, n_p), integrated over the time
        before each of the `stops` (ascending, within) and after the last.
        """
        n_x, length = self._equation.n_x, late - early
        task = InitialValueProblem(
            system=self._equation.system,
            span=(0.0, length),
            x0=np.append(costate * self._nominal, np.zeros(self._equation.n_p)),
            p=self._p,
            schedules=(self._past(late, early, kicks),),
            tolerance=replace(self._tolerance, max_step=length),
            times=np.clip(np.append(late - stops[::-1], length), 0.0, length),
        )
        outcome = integrate(task, self._route, silent)
        if outcome.status != "done" or len(outcome.events) != len(kicks.time):
            raise SolveError(
                f"the adjoint equation could not be followed back below t = {late - outcome.t:.6g}",
                "loosen the tolerance, or take sensitivities forward in time",
                code=outcome.status,
            )
        summed = np.diff(outcome.samples[:, n_x:] / self._sizes, axis=0, prepend=0.0)
        return outcome.samples[-1, :n_x] / self._nominal, summed[::-1]
