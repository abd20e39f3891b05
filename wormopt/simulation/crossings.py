"""Events, at which contacts and switches are decided anew: zeros of event functions in a step.

An event function is positive while a mode lasts: for a sliding contact it is its velocity in the
direction of sliding, for a resting one the distance of its force from the nearer bound, for a
switch minus its guard. In the plane a contact slides while its speed is above that of a stop; its
onset lasts while it moves ahead, until it is fast enough and its error matters. An event is a fall
below the level of the function. The level is 0 once the function has been well above 0; until then
it is a little lower, so that rounding does not stop a contact that has just been released with no
velocity and perhaps no acceleration. A switch that has just fired has no level while its guard
rises.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from wormopt.lazy import on_use
from wormopt.numerics.expressions import Call
from wormopt.numerics.roots import root
from wormopt.simulation.functions import System
from wormopt.simulation.grip import ENTRIES
from wormopt.simulation.initial_value import F_REST, InitialValueProblem
from wormopt.simulation.sharing import SHARE_REST, Sharing
from wormopt.simulation.steps import GivenUp, Step, Stepper, floor_of_step

with on_use():  # slow to import, and few motions touch
    from scipy.optimize import minimize_scalar

_SAMPLES = np.array([0.0, 1 / 64, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 63 / 64, 1.0])

# A guard whose rate is below this share of the rate before the event is constant.
FALLS = 1e-9
# Share of the whole time from which a step at velocity 0, but for rounding, is no mere touch.
_AT_REST = 1e-3


class Crossing(NamedTuple):
    """An event function falls through its level."""

    which: int  # event function; indices of switches follow those of contacts
    theta: float  # fraction of the step
    level: float


class Near(NamedTuple):
    """Tolerances of zero guards, per switch, at the event of a switch that must be crossed."""

    size: np.ndarray  # of guards; negative for switches that need not be crossed
    rate: np.ndarray  # of guards, their time derivatives before


class Located(NamedTuple):
    """Step to an event."""

    step: Step | None  # None if the event is at the start already
    arrived: bool  # whether it ends at the event


class Watch:
    """The event functions of a motion.

    Their owners rewrite `p` and `modes`.
    """

    def __init__(
        self,
        task: InitialValueProblem,
        p: np.ndarray,
        modes: np.ndarray,
        sharing: Sharing | None,
    ) -> None:
        system, shared = task.system, (("p", p), ("s", modes))
        self._task, self._modes, self._sharing = task, modes, sharing
        self._n_x = len(task.x0)
        self.grazes = False  # whether the last crossing found is hardly one
        self.touched: list[tuple[int, float]] = []  # near crossings of the last step
        self.n_contacts = len(system.contacts) if system.exact else 0
        self.n = self.n_contacts + len(system.model.switches)
        self._levels = np.zeros(self.n)
        self._prescribed = list(system.prescribed) if system.exact else []
        # a fired switch has level 0 again once its guard has fallen by more than this
        self._passed = np.zeros(len(system.model.switches))
        # crossed switches that last fired because their guards jumped
        self._jumped = np.zeros(len(system.model.switches), dtype=bool)
        self._fired = np.full(len(system.model.switches), -np.inf)  # times they last fired
        if self.n:
            reach = ("reach", task.reach[:, : self.n_contacts].ravel())
            value, within, scan, rates = (Call(f, *shared, reach) for f in _event_functions(system))
            self._values, self._inside, self._scan, self._rates = value, within, scan, rates

    # -- values ----------------------------------------------------------------------------

    def value(self, which: int, t: float, x: np.ndarray) -> float:
        """Value of one event function."""
        return float(self._all(t, x)[which])

    def _all(self, t: float, x: np.ndarray) -> np.ndarray:
        (values,) = self._values(t, x)
        return self._shared(values, t, x)

    def _shared(self, values: np.ndarray, t: float, x: np.ndarray) -> np.ndarray:
        """Distance of the best split from the holding forces, if forces are undetermined."""
        if self._sharing and self._sharing.active:
            for split in self._sharing.look(t, x):
                values[split.contacts] = 1 - split.share
        return values

    def _rows(self, step: Step) -> np.ndarray:
        """Rows of a step's polynomial for the states that matter."""
        return step.rows[:, : self._n_x].ravel()

    def _within(self, which: int, step: Step, theta: float) -> float:
        (values,) = self._inside(theta, step.t, step.h, self._rows(step))
        if self._sharing and self._sharing.active:
            self._shared(values, step.t + theta * step.h, step.states(theta))
        return float(values[which])

    def _small(self) -> np.ndarray:
        """Sizes below which the event functions are rounding."""
        v_rest, f_rest = self._task.v_rest, self._task.f_rest
        slides = self._modes[: self.n_contacts] != 0
        rest = np.where(slides, v_rest, f_rest) if self.n_contacts else np.zeros(0)
        if self._sharing and self._sharing.active:  # a split is less exact than a force
            rest = np.maximum(rest, np.where(slides, 0.0, SHARE_REST))
        return np.concatenate([rest, self._passed])

    # -- levels ----------------------------------------------------------------------------

    def start(self, t: float, x: np.ndarray) -> None:
        """Set the initial levels; those of guards above 0 are infinitely low."""
        if self.n:
            self._levels = -self._small()
            guards = self._all(t, x)[self.n_contacts :]
            self._levels[self.n_contacts :] = np.where(guards < 0, -np.inf, 0.0)

    def raise_levels(self, t: float, x: np.ndarray) -> None:
        """Raise levels of functions well above 0."""
        if self.n:
            self._levels[self._all(t, x) > self._small()] = 0.0

    def note_change(self, t: float, x: np.ndarray, contacts: set[int]) -> None:
        """Lower the levels of contacts whose modes have changed, or that were slow."""
        small = self._small()
        velocities = self._all(t, x) if contacts else small
        for i in contacts:
            slides = self._modes[i] != 0 and i not in self._task.system.planar
            self._levels[i] = min(-small[i], 2 * velocities[i] if slides else 0.0)

    def error_of(self, k: int, t: float, x: np.ndarray, h: float) -> tuple[float, float]:
        """Accuracy of the event of switch `k`.

        Returns the rounding error of its guard, and the guard's time derivative. Raises GivenUp if
        the guard falls and the switch fires again by rounding: a ball on its way up from a floor
        that lies between two numbers. The step of length `h` was to go much further.
        """
        rate = self._rate(k, t, x)
        crosses = self._task.system.model.switches[k].crosses
        if rate < 0 and not crosses and t - self._fired[k] <= _SAMPLES[1] * h:
            raise GivenUp("events_accumulate")
        off = abs(self.value(self.n_contacts + k, t, x))
        return 2 * off + abs(rate) * floor_of_step(self._task, t), abs(rate)

    def fires_in_vain(self, k: int, t: float, crossing: Crossing) -> bool:
        """Whether a switch has fired and not been above 0 since."""
        # A crossed switch may have been 0 for a while, and its guard may have jumped.
        if self._task.system.model.switches[k].crosses:
            return not self._jumped[k] and t - self._fired[k] <= floor_of_step(self._task, t)
        return crossing.level != 0

    def _rate(self, k: int, t: float, x: np.ndarray) -> float:
        """Time derivative of the guard of switch `k`."""
        return float(self.rates(t, x)[k])

    def rates(self, t: float, x: np.ndarray) -> np.ndarray:
        """Time derivatives of the guards of all switches."""
        return self._rates(t, x)[0]

    def note_fired(
        self, k: int, t: float, x: np.ndarray, error: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Lower the level of a switch that has fired.

        It may fire again at once if its guard falls now, even from a rounding error above 0
        (bouncing ball); else once it was below 0 by more than `error` (0 if it jumped).
        """
        which, residual, rate = self.n_contacts + k, *error
        value, now = self.value(which, t, x), self._rate(k, t, x)
        crosses = self._task.system.model.switches[k].crosses
        again = crosses or now < -FALLS * rate
        self._jumped[k] = error == (0.0, 0.0) and crosses
        near = again and value >= -residual
        self._levels[which] = 2 * min(value, 0.0) - 1e-300 if near else -np.inf
        self._passed[k], self._fired[k] = residual, t

    # -- switches that must be crossed -------------------------------------------------------

    def near(
        self, k: int, error: tuple[float, float], rates: np.ndarray, t: float, x: np.ndarray
    ) -> Near:
        """Tolerances of zero guards, when switch `k` has been found with an `error`.

        `rates`: sizes of the guards' time derivatives before it fired.
        """
        residual, rate = error
        late = residual / rate if rate else floor_of_step(self._task, t)
        size = late * np.maximum(rates, np.abs(self.rates(t, x)))
        size[k] = residual
        crosses = [switch.crosses for switch in self._task.system.model.switches]
        return Near(np.where(crosses, size, -1.0), rates)

    def at_guard(self, t: float, x: np.ndarray, near: Near) -> list[int]:
        """Switches that must be crossed whose guards are 0."""
        (values,) = self._values(t, x)
        return np.flatnonzero(np.abs(values[self.n_contacts :]) <= near.size).tolist()

    def jumped(self, t: float, x: np.ndarray, near: Near) -> np.ndarray:
        """Switches that must be crossed whose guards have jumped above 0."""
        (values,) = self._values(t, x)
        least = np.minimum(self._levels[self.n_contacts :], -near.size)
        return np.flatnonzero((near.size >= 0) & (values[self.n_contacts :] < least))

    def returns(self, t: float, x: np.ndarray, near: Near, leaves: float) -> np.ndarray:
        """Whether the motion leads back to the guard of each switch, or is beyond it.

        `leaves`: share of its rate before the event at which a guard falls.
        """
        rises = self.rates(t, x) > -leaves * near.rate
        rises[np.setdiff1d(np.arange(len(rises)), self.at_guard(t, x, near))] = False
        rises[self.jumped(t, x, near)] = True
        return rises

    def jumped_switch(self, t: float, x: np.ndarray) -> int | None:
        """Index of the first switch whose guard has jumped above 0."""
        if self.n == self.n_contacts:
            return None
        (values,) = self._values(t, x)
        jumped = values < self._levels
        return next(iter(np.flatnonzero(jumped[self.n_contacts :]).tolist()), None)

    def guards(self, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Guards of the switches, and whether they fire as soon as they are above 0."""
        (values,) = self._values(t, x)
        return values[self.n_contacts :], self._levels[self.n_contacts :] == 0

    # -- location --------------------------------------------------------------------------

    def find(self, step: Step) -> Crossing | None:
        """First event of an attempted step; else raises levels of functions well above 0."""
        (scan,) = self._scan(step.t, step.h, self._rows(step))
        values = scan.reshape(len(_SAMPLES), self.n)
        if self._sharing and self._sharing.active:
            for theta, row in zip(_SAMPLES, values, strict=True):
                self._shared(row, step.t + theta * step.h, step.states(theta))
        if np.isnan(values).any():
            raise GivenUp("not_finite")
        self._check_moves(step, values)
        dips = _dips(values[:-2], values[1:-1], values[2:])
        suspects = np.flatnonzero((values.min(axis=0) < 0) | dips.any(axis=0))
        small = self._small()
        self.touched = []
        found = [self._first(int(j), step, values[:, j], small[j]) for j in suspects]
        crossings = [crossing for crossing in found if crossing]
        if crossings:
            first = min(crossings, key=lambda crossing: crossing.theta)
            self.grazes = self._grazes(step, first, values[:, first.which])
            return first
        self._levels[values.max(axis=0) > small] = 0.0
        return None

    def _check_moves(self, step: Step, values: np.ndarray) -> None:
        """Give up if a prescribed velocity stays 0: the force of its contact is undetermined."""
        long = step.h > _AT_REST * (self._task.span[1] - self._task.span[0])
        for i in self._prescribed:
            largest = np.abs(values[:, i]).max()
            if largest == 0 or (long and largest <= self._task.v_rest[i]):
                raise GivenUp("open_force")

    def _first(self, j: int, step: Step, value: np.ndarray, small: float) -> Crossing | None:
        level = float(self._levels[j])

        def above(theta: float) -> float:
            return self._within(j, step, theta) - level

        for k, here in enumerate(value):
            if here < level:
                theta = _root(above, _SAMPLES[max(k - 1, 0)], _SAMPLES[k])
                return self._since(step, Crossing(j, theta, level))
            if k >= 2 and _dips(*(value[k - 2 : k + 1] - level)):
                ends = _SAMPLES[k - 2], _SAMPLES[k]
                near = {"bounds": ends, "method": "bounded", "options": {"xatol": 1e-7}}
                low: Any = minimize_scalar(above, **near)
                if low.fun < 0:
                    return self._since(step, Crossing(j, _root(above, ends[0], low.x), level))
                if low.fun + level <= self._next_to_nothing(j, max(value[k - 2], here)):
                    self.touched.append((j, float(low.x)))
            if here > small:
                level = 0.0
        return None

    def _since(self, step: Step, crossing: Crossing) -> Crossing:
        """Crossing of 0 by a fired switch that has been above 0 since, between samples."""
        j, theta, level = crossing
        if j < self.n_contacts or level == 0:
            return crossing
        for at in theta * 0.5 ** np.arange(1, 10):
            if self._within(j, step, at) > self._passed[j - self.n_contacts]:
                theta = _root(lambda s: self._within(j, step, s), at, theta)
                at_once = theta * step.h <= floor_of_step(self._task, step.t)
                return Crossing(j, theta, level if at_once else 0.0)
        return crossing

    def _grazes(self, step: Step, crossing: Crossing, value: np.ndarray) -> bool:
        """Whether a function would fall only negligibly below 0, and rise again in the step."""
        after = value[:-1][_SAMPLES[:-1] > crossing.theta]
        if not self._task.k or not (np.any(after < value[-1]) or value[-1] > 0):
            return False
        near: Any = {"bounds": (crossing.theta, 1.0), "method": "bounded"}
        low: Any = minimize_scalar(lambda at: self._within(crossing.which, step, at), **near)
        return bool(low.fun >= -self._next_to_nothing(crossing.which, np.abs(value).max()))

    def _next_to_nothing(self, j: int, around: float) -> float:
        """Value of an event function within errors of the motion; `around` are others."""
        if j < self.n_contacts:
            held = self._task.f_rest[j] / F_REST
            around = self._task.system.contacts[j].nominal_speed if self._modes[j] else held
        return self._task.small_value * around

    def _slope(self, step: Step, crossing: Crossing) -> float:
        """Time derivative of an event function about its crossing."""
        low, high = max(crossing.theta - 1e-4, 0.0), min(crossing.theta + 1e-4, 1.0)
        change = self._within(crossing.which, step, high) - self._within(crossing.which, step, low)
        return change / ((high - low) * step.h)

    def locate(self, step: Step, crossing: Crossing, stepper: Stepper) -> Located:
        """Step to an event found by `find`."""
        # The step itself is taken and corrected by Newton's method, since the order of the
        # polynomial is lower than that of the steps.
        which, length = crossing.which, crossing.theta * step.h
        if length <= floor_of_step(self._task, step.t):
            return Located(None, arrived=True)
        slope, small = self._slope(step, crossing), float(self._small()[which])
        best, least = step, np.inf
        for _ in range(4):
            tried = stepper.redo(step, length)
            if tried.end < min(step.t + length, step.end):
                return Located(tried, arrived=False)
            value = self.value(which, tried.end, tried.x_new[: self._n_x])
            if abs(value) > least:
                break
            best, least = tried, abs(value)
            if crossing.level != 0 or not slope < 0 or least <= 1e-3 * small:
                break
            corrected = length - value / slope
            if not 0 < corrected <= step.h or corrected == length:
                break
            length = corrected
        return Located(best, arrived=True)


def _dips(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Whether there may be a zero between three samples."""
    return (b < a) & (b <= c) & (b < 4 * (np.maximum(a, c) - b))


def _root(function: Callable[[float], float], a: float, b: float) -> float:
    """Fall of a function through 0; an end if rounding has it there already."""
    if function(a) <= 0:
        return float(a)
    if function(b) >= 0:
        return float(b)
    return root(function, a, b)


@lru_cache(maxsize=64)
def _event_functions(system: System) -> tuple[ca.Function, ...]:
    """Event functions at a state, at a fraction of a step, at all its samples; rates of guards."""
    t, x, p, s = system.rhs.mx_in()
    parts, rates = [], ca.MX(0, 1)
    n = len(system.contacts) if system.exact else 0
    reach = ca.MX.sym("reach", 4 * n)
    if n:
        velocity, _, force, low, high = ca.vertsplit(system.probe(t, x, p, s)[:-1], n)
        margin = ca.fmin(force - low, high - force)
        moving = s[:n] * velocity
        for place, i in enumerate(system.planar.tolist()):
            d = s[n + ENTRIES * place : n + ENTRIES * place + 2]
            stop, least, largest, per_error = (reach[k * n + i] for k in range(4))
            v, error = velocity[i], -force[i]
            goes_on = ca.fmin(largest - v, least - per_error * error)
            begins = ca.fmin(v, ca.fmax(least - v, goes_on))
            moving[i] = ca.if_else(ca.sumsqr(d) > 0, begins, v - stop)
        parts.append(ca.if_else(s[:n] == 0, margin, moving))
    if system.model.switches:
        guards, rates = ca.vertsplit(system.guards(t, x, p, s), len(system.model.switches))
        parts.append(-guards)
    names = ["t", "x", "p", "s", "reach"]
    arguments = [t, x, p, s, reach]
    values = ca.Function("values", arguments, [ca.vertcat(*parts)], names, ["values"])
    theta, h, rows = ca.MX.sym("theta"), ca.MX.sym("h"), ca.MX.sym("rows", x.numel(), 8)
    product = [ca.MX(1)]
    for k in range(7):
        product.append(product[-1] * (1 - theta if k % 2 else theta))
    inner = values(t + theta * h, rows @ ca.vertcat(*product), p, s, reach)
    symbols = [theta, t, h, rows, p, s, reach]
    long = ["theta", "t", "h", "rows", "p", "s", "reach"]
    within = ca.Function("within", symbols, [inner], long, ["values"])
    samples = within.map("within", "serial", len(_SAMPLES), [1, 2, 3, 4, 5, 6], [])
    every = samples(ca.DM(_SAMPLES).T, *symbols[1:])
    scan = ca.Function("scan", symbols[1:], [every], long[1:], ["values"])
    return values, within, scan, ca.Function("rates", arguments, [rates], names, ["rates"])
