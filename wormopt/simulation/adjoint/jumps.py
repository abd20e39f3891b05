"""Effect of an event on the costate: the saltation matrix, transposed.

At an event x+ = R(t, x-, p), at the time at which g(t, x, p) = 0. A neighbouring motion has it
dt = -(g_x dx + g_p dp) / g' later, so that dx+ = R_x dx + R_p dp + (R' - f+) dt, where
g' and R' are rates along the motion before. Breaks of schedules do not move.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.values import nominal_of
from wormopt.simulation.adjoint.costate import Kicks
from wormopt.simulation.functions import System
from wormopt.simulation.trajectory import Event, Trajectory

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
        f"what happens at t = {t:.6g} has no derivative that the adjoint equation knows",
        "take sensitivities forward in time",
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
