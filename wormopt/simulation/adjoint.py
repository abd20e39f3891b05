"""The adjoint equation along a motion, itself a Model that is simulated backwards in time.

With H = l' f(t, x, p) the costate follows l' = -H_x; the integral of H_p is the derivative with
respect to the parameters. A schedule contains the motion, one piece for each step: its polynomial,
modes, and the values of the model's schedules. At samples and events the costate jumps: two
switches fire in turn where a piece says so.

At an event x+ = R(t, x-, p), at the time at which g(t, x, p) = 0. A neighbouring motion has it
dt = -(g_x dx + g_p dp) / g' later, so that dx+ = R_x dx + R_p dp + (R' - f+) dt, where
g' and R' are rates along the motion before. Breaks of schedules do not move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

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
from wormopt.simulation.trajectory import Event, Trajectory

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
                "loosen the tolerance, or use simulate(..., sensitivities=[...])",
                code=outcome.status,
            )
        summed = np.diff(outcome.samples[:, n_x:] / self._sizes, axis=0, prepend=0.0)
        return outcome.samples[-1, :n_x] / self._nominal, summed[::-1]


# Largest error, in nominal sizes, of a guard that has fired and of the simulated state.
_NEAR = 1e-7


class Jumps:
    """Guards and resets of a System with their derivatives."""

    def __init__(self, system: System) -> None:
        self.system, self._n_x = system, system.model.n_x
        self.contacts = [contact.name for contact in system.contacts] if system.exact else []
        self.switches = [switch.name for switch in system.model.switches]
        self.forward, self.back = cache(self._forward), cache(self._back)

    @cached_property
    def guards(self) -> ca.Function:
        """Per contact velocity, force above the least and below the largest; then switches."""
        symbols, n = self.system.symbols, len(self.contacts)
        guards = ca.SX(0, 1)
        if self.system.exact:
            velocity, _, force, least, largest = ca.vertsplit(
                self.system.probe(*symbols)[: 5 * n], n
            )
            guards = ca.vertcat(velocity, force - least, largest - force)
        if self.switches:
            guards = ca.vertcat(guards, self.system.guards(*symbols)[: len(self.switches)])
        return ca.Function("guards", list(symbols), [guards])

    @cached_property
    def resets(self) -> list[ca.Function]:
        """States after each switch, pushes included."""
        symbols = list(self.system.symbols)
        columns = ca.horzsplit(self.system.resets(*symbols))
        return [ca.Function("reset", symbols, [column]) for column in columns]

    def _forward(self, function: ca.Function) -> ca.Function:
        """Value and rate of change of a function along a state's rate, time passing."""
        t, x, *_ = symbols = self.system.symbols
        rate = ca.SX.sym("rate", self._n_x)
        value = function(*symbols)
        moved = ca.vertcat(rate, ca.SX.zeros(x.numel() - self._n_x))
        slope = ca.jtimes(value, x, moved) + ca.jacobian(value, t)
        return ca.Function("forward", [*symbols, rate], [value, slope])

    def _back(self, function: ca.Function) -> ca.Function:
        """Propagate weights of a function's entries back to those of state and parameters."""
        _, x, p, _ = symbols = self.system.symbols
        value = function(*symbols)
        weights = ca.SX.sym("weights", value.numel())
        slopes = ca.jtimes(value, ca.vertcat(x[: self._n_x], p), weights, True)
        return ca.Function("back", [*symbols, weights], [slopes[: self._n_x], slopes[self._n_x :]])


@dataclass(frozen=True, eq=False)
class Place:
    """A motion at one instant, before or after its jump."""

    t: float
    x: np.ndarray  # with pushes, which are 0
    p: np.ndarray
    s: np.ndarray
    rate: np.ndarray  # (n_x,)
    inside: float  # a time on this side, at which schedules have their values of this side

    @property
    def arguments(self) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Arguments for the functions of a System."""
        return self.t, self.x, self.p, self.s


@dataclass(frozen=True, eq=False)
class Jump:
    """Jump at one instant."""

    jumps: Jumps
    before: Place
    after: Place
    maps: tuple[tuple[ca.Function, np.ndarray], ...]  # of the state, in order, with modes
    events: tuple[Event, ...]
    guard: int | None  # which of `Jumps.guards` sets the time; None for a schedule

    def back(self, costate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Costate before from that after; derivatives by parameters before, and by those after."""
        place, jumps = self.before, self.jumps
        passed, rate = self._pass()
        jump, by_after = costate @ (rate - self.after.rate), np.zeros_like(place.p)
        for (function, modes), x in zip(reversed(self.maps), passed[-2::-1], strict=True):
            weights = np.append(costate, np.zeros(len(x) - len(costate)))
            by_x, by_p = jumps.back(function)(place.t, x, self.after.p, modes, weights)
            costate, by_after = np.array(by_x).ravel(), by_after + np.array(by_p).ravel()
        if self.guard is None:
            return costate, np.zeros_like(by_after), by_after
        speeds = np.array(jumps.forward(jumps.guards)(*place.arguments, place.rate)[1]).ravel()
        weights = np.zeros(len(speeds))
        weights[self.guard] = jump / speeds[self.guard]
        by_x, by_p = jumps.back(jumps.guards)(*place.arguments, weights)
        return costate - np.array(by_x).ravel(), -np.array(by_p).ravel(), by_after

    def _pass(self) -> tuple[list[np.ndarray], np.ndarray]:
        """States after none, one, ... of the maps, and the rate of the last along the motion."""
        passed, rate = [self.before.x], self.before.rate
        for function, modes in self.maps:
            value, slope = self.jumps.forward(function)(
                self.before.t, passed[-1], self.after.p, modes, rate
            )
            passed.append(np.array(value).ravel())
            rate = np.array(slope).ravel()[: len(rate)]
        return passed, rate

    def check(self, sizes: np.ndarray) -> None:
        """Refuse a jump that differs from the simulated one; `sizes` (n_x,) of the states."""
        n_x = len(sizes)
        error = np.abs(self._pass()[0][-1][:n_x] - self.after.x[:n_x]) / sizes
        if not error.max(initial=0.0) < _NEAR * (1 + np.abs(self.after.x[:n_x] / sizes).max()):
            raise _not_understood(self.before.t)


def _not_understood(t: float) -> SolveError:
    return SolveError(
        f"the adjoint equation does not support the event at t = {t:.6g}",
        "use simulate(..., sensitivities=[...])",
        code="unknown_jump",
    )


@lru_cache(maxsize=32)
def _jumps_of(system: System) -> Jumps:
    return Jumps(system)


class Instants:
    """Jumps of a motion up to some time: those of its rate only, and others."""

    def __init__(self, motion: Trajectory, until: float) -> None:
        assert motion.dense is not None
        self._motion, self._dense = motion, motion.dense
        self._jumps = _jumps_of(motion.system)
        self._sizes = nominal_of(motion.system.model.x)
        self.events: dict[float, list[Event]] = {}
        for event in motion.events:
            if event.time <= until:
                self.events.setdefault(event.time, []).append(event)
        self._times = np.array(sorted(self.events))
        self._step = np.searchsorted(self._dense.time, self._times)
        wrong = (self._dense.time[self._step] != self._times) | (self._step == 0)
        if wrong.any():
            raise _not_understood(float(self._times[np.argmax(wrong)]))

    def _places(self, steps: np.ndarray, x: np.ndarray, inside: np.ndarray) -> list[Place]:
        """Motion at ends of steps (of `Dense.time`) with the values `inside` a step beside them."""
        motion, t = self._motion, self._dense.time[steps]
        p = motion.system.scheduled(motion.p, motion.schedules, inside)
        s = motion.s_at(inside)
        whole = np.hstack([x, np.zeros((len(x), motion.system.n_pushes))])
        rates = np.array(motion.system.rhs(t[None], whole.T, p, s)).T[:, : len(self._sizes)]
        rows = zip(t, whole, p.T, s.T, rates, inside, strict=True)
        return [Place(float(a), b, c, d, e, float(f)) for a, b, c, d, e, f in rows]

    def _after(self, steps: np.ndarray) -> list[Place]:
        time, last = self._dense.time, len(self._dense.time) - 1
        x = self._dense.coefficients[np.minimum(steps, last - 1), 0, : len(self._sizes)].copy()
        x[steps == last] = self._motion.end
        return self._places(steps, x, (time[steps] + time[np.minimum(steps + 1, last)]) / 2)

    def start(self) -> Jump:
        """Costate at the start: resting contacts begin without velocity, however small the push."""
        (after,) = self._after(np.array([0]))
        rests = self._motion.system.exact and np.any(after.s[: len(self._jumps.contacts)] == 0)
        maps = ((self._motion.system.project, after.s),) if rests else ()
        return Jump(self._jumps, after, after, maps, (), None)

    @cached_property
    def all(self) -> list[Jump]:
        """Jumps at events, in order of time."""
        if not len(self._times):
            return []
        time, steps = self._dense.time, self._step
        x = self._dense.coefficients[steps - 1, :2, : len(self._sizes)].sum(axis=1)
        before = self._places(steps, x, (time[steps - 1] + time[steps]) / 2)
        guards, speeds = self._all_guards(before)
        found = []
        for k, (here, after) in enumerate(zip(before, self._after(steps), strict=True)):
            events = tuple(self.events[here.t])
            maps = self._maps(events, here.s, after.s)
            guard = self._guard(here, after, events, guards[k], speeds[k])
            found.append(Jump(self._jumps, here, after, maps, events, guard))
            found[-1].check(self._sizes)
        return found

    def _all_guards(self, places: list[Place]) -> tuple[np.ndarray, np.ndarray]:
        """Guards and their rates, a row for each place."""
        forward = self._jumps.forward(self._jumps.guards)
        found = forward(*_stacked(places), np.array([place.rate for place in places]).T)
        return np.array(found[0]).T, np.array(found[1]).T

    def kicks(self, jumps: list[Jump]) -> Kicks:
        """Jumps of the rate only, all at once."""
        n_x, n_p, m = len(self._sizes), len(self._motion.p), len(jumps)
        time, zero = np.array([jump.before.t for jump in jumps]), np.zeros((m, n_x))
        if not jumps:
            return Kicks(time, zero, zero, zero, np.zeros((0, n_p)))
        places = [jump.before for jump in jumps]
        _, speeds = self._all_guards(places)
        weights = np.zeros_like(speeds)
        for k, jump in enumerate(jumps):
            if jump.guard is not None:
                weights[k, jump.guard] = 1 / speeds[k, jump.guard]
        by_x, by_p = self._jumps.back(self._jumps.guards)(*_stacked(places), weights.T)
        rate = np.array([jump.before.rate - jump.after.rate for jump in jumps])
        return Kicks(time, zero, rate, np.array(by_x).T, np.array(by_p).T)

    def _maps(
        self, events: tuple[Event, ...], before: np.ndarray, after: np.ndarray
    ) -> tuple[tuple[ca.Function, np.ndarray], ...]:
        """Maps of the state: resets, with the modes before, and impulses."""
        found, modes, jumps = [], before, self._jumps
        for event in events:
            if event.kind == "switch":
                found.append((jumps.resets[jumps.switches.index(event.name)], modes))
                modes = after
            elif event.kind == "impact" and not (found and found[-1][0] is jumps.system.project):
                found.append((jumps.system.project, after))
        return tuple(found)

    def _guard(
        self,
        before: Place,
        after: Place,
        events: tuple[Event, ...],
        guards: np.ndarray,
        speeds: np.ndarray,
    ) -> int | None:
        """The guard that has fired: of the candidates, the one nearest to 0 in time."""
        jumps, n = self._jumps, len(self._jumps.contacts)
        rows = list[int]()
        for event in events:
            if event.kind == "switch":
                rows.append(3 * n + jumps.switches.index(event.name))
                continue
            i = jumps.contacts.index(event.name)
            rows += [i] if before.s[i] != 0 else [n + i, 2 * n + i]
        with np.errstate(over="ignore"):  # a guard at rest never fires
            off = np.abs(guards[rows]) / np.maximum(np.abs(speeds[rows]), np.finfo(float).tiny)
        nearest = int(np.argmin(off))
        if off[nearest] <= _NEAR * (self._dense.time[-1] - self._dense.time[0]):
            return rows[nearest]
        if np.array_equal(before.p, after.p):
            raise _not_understood(before.t)
        return None  # a break of a schedule


def _stacked(places: list[Place]) -> tuple[np.ndarray, ...]:
    """Arguments of the functions of a System, a column for each place."""
    t = np.array([[place.t for place in places]])
    return t, *(np.array([getattr(place, name) for place in places]).T for name in ("x", "p", "s"))
