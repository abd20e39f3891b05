"""Steady velocities of a worm with one slow velocity: averages, and exact periodic motions.

An exact motion is periodic if the velocity at the end of a period equals that at its start. The
simulation continues over several periods, which shows the remaining drift.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeVar

import casadi as ca
import numpy as np

from wormopt.analysis.average import average
from wormopt.analysis.steady import Rates
from wormopt.errors import SolveError
from wormopt.model.model import Model, Signal
from wormopt.numerics.roots import root
from wormopt.progress import Report
from wormopt.simulation.options import Exact, Recheck, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared.models import with_integrals
from wormopt.systems.shared.proof import CrossCheck, cross_check
from wormopt.systems.shared.signals import rests

_T = TypeVar("_T")

# Points between two velocities at which a mass begins or ceases to reverse, and the distance kept
# from these, relative to the largest velocity: the second order has poles there.
_POINTS, _AWAY = 200, 1e-7
# A root is where the rate is below this share of its largest; at a pole it is not.
_ROOT = 1e-6
# Periods after which end and start are compared, and number of simulations to find the start.
_PERIODS, _TRIALS = 10, 60
# Accepted difference over a period, relative to the usual velocity, and the size of the first
# trial.
_CLOSED, _FIRST = 1e-13, 1e-4


# -- by averages ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Steady:
    """A velocity at which mean friction vanishes."""

    velocity: float  # of the centre
    slope: float  # of the mean acceleration by it; negative: stable

    @property
    def stable(self) -> bool:
        """Whether small deviations decay."""
        return self.slope < 0


@dataclass(frozen=True, eq=False)
class SlowVelocity:
    """A model with one slow state, averaged."""

    model: Model  # with the state center_velocity alone
    period: ca.SX  # an expression of the model's parameters
    order: Literal[1, 2]  # of the average
    nodes: int  # points of quadrature on a piece

    @cached_property
    def averaged(self) -> Model:
        """The averaged Model."""
        return average(self.model, self.period, order=self.order, nodes=self.nodes)

    @cached_property
    def _rates(self) -> Rates:
        return Rates(self.averaged)

    @cached_property
    def _p(self) -> np.ndarray:
        return self._rates.parameters(None)

    def rate(self, V: float) -> float:
        """Mean acceleration at velocity V of the centre."""
        return float(self._rates(np.array([[V]]), self._p)[0, 0])

    def steady(self, bends: Sequence[float]) -> list[Steady]:
        """Find all steady velocities, ascending.

        At `bends` a mass begins or ceases to reverse; no velocity beyond the outermost is steady.
        """
        found = sign_changes(self.rate, _grid(bends))
        slopes = self._rates.slopes(np.reshape(found, (-1, 1)), self._p).ravel().tolist()
        return [Steady(V, slope) for V, slope in zip(found, slopes, strict=True)]


def sign_changes(rate: Callable[[float], float], grid: np.ndarray) -> list[float]:
    """Find zeros of a function with a sign change, without poles; ascending.

    It is assumed to have at most one zero between two points of the ascending `grid`.
    """
    values = np.array([rate(V) for V in grid])
    usual = np.median(np.abs(values[np.isfinite(values)]))
    found = [float(V) for V, value in zip(grid, values, strict=True) if value == 0]
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        low, high = grid[k : k + 2]
        V = root(rate, low, high, xtol=1e-300)
        if abs(rate(V)) <= _ROOT * usual:
            found.append(V)
    return sorted(found)


def _grid(bends: Sequence[float]) -> np.ndarray:
    """Points around and between the bends, none of them on a bend."""
    places = np.unique(np.append(bends, 0.0))
    away = _AWAY * np.abs(places).max()
    edges = np.concatenate([[places[0] - 1e3 * away], places, [places[-1] + 1e3 * away]])
    parts = [
        np.linspace(low + away, high - away, _POINTS)
        for low, high in pairwise(edges)
        if high - low > 4 * away
    ]
    return np.concatenate(parts)


def nearest(steady: Steady, among: Sequence[Steady]) -> Steady | None:
    """Return the nearest of several steady velocities that are stable alike."""
    alike = [other for other in among if other.stable == steady.stable]
    return min(alike, key=lambda other: abs(other.velocity - steady.velocity), default=None)


def tends_to(velocity: float, steady: Sequence[Steady], near: float) -> int:
    """Steady velocity to which a slow motion converges: it stays on one, and cannot pass one."""
    away = [abs(s.velocity - velocity) for s in steady]
    if min(away) <= near:
        return away.index(min(away))
    ahead = [k for k, s in enumerate(steady) if s.velocity > velocity]
    behind = [k for k, s in enumerate(steady) if s.velocity < velocity]
    for k in [*ahead[:1], *behind[-1:]]:
        if steady[k].stable:
            return k
    return (ahead[:1] or behind[-1:])[0]


# -- exactly --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion."""

    velocity: float  # mean, of the centre over several periods
    start: float  # velocity at the start of a period
    drift: float  # change of velocity after these periods
    ripple: float  # largest less smallest velocity within a period
    force: np.ndarray  # (N,) mean friction of every contact
    power: float  # mean, of the actuators
    rest_share: float  # largest share of the period one contact rests
    motion: Trajectory  # over several periods
    second: CrossCheck | None  # check by another route; None: not wanted
    trials: int  # simulations to find it


def measured(model: Model) -> Model:
    """Append the states ``impulse`` (of the contacts) and ``work`` (of the actuators)."""
    count, size = len(model.contacts), model.x[-1].nominal
    states = [
        Signal("impulse", ca.SX.sym("impulse", count), "impulse", size, value=(0.0,) * count),
        Signal("work", ca.SX.sym("work"), "energy", size, value=0.0),
    ]
    return with_integrals(model, states, [model.forces, model["power"]])


@dataclass(frozen=True, eq=False)
class Runner:
    """Simulates a worm from an initial velocity."""

    model: Model  # from `measured`, with center and center_velocity
    period: float
    tolerance: Tolerance
    report: Report

    def run(self, velocity: float, periods: int, samples: int = 2) -> Trajectory:
        """Simulate with exact contact from a velocity of the centre.

        Keeps `samples` equidistant instants, ends included. Raises SolveError as `simulate`.
        """
        end = periods * self.period
        return simulate(
            self.model,
            end,
            contact=Exact(),
            x0={"center_velocity": velocity},
            times=np.linspace(0.0, end, samples),
            tolerance=self.tolerance,
            report=self.report,
        )

    def orbit(self, guess: float, *, recheck: Recheck = True) -> Orbit:
        """Find the periodic motion near a velocity of the centre.

        `recheck`: as of `cross_check`.
        """
        start, trials = self._start(guess)
        samples = 400 * _PERIODS + 1
        motion = self.run(start, _PERIODS, samples)
        x0 = tuple(
            replace(s, value=start) if s.name == "center_velocity" else s for s in self.model.x
        )
        second = cross_check(
            replace(self.model, x=x0), motion, self.tolerance,
            recheck=recheck, report=self.report,
        )  # fmt: skip
        time, V = _PERIODS * self.period, motion["center_velocity"][0]
        rested: dict[int, float] = {}
        for contact, begin, end in rests(motion):
            rested[contact] = rested.get(contact, 0.0) + (end - begin) / time
        return Orbit(
            velocity=float(motion["center"][0, -1]) / time,
            start=start,
            drift=float(V[-1] - V[0]),
            ripple=float(np.ptp(V)),
            force=motion["impulse"][:, -1] / time,
            power=float(motion["work"][0, -1]) / time,
            rest_share=max(rested.values(), default=0.0),
            motion=motion,
            second=second,
            trials=trials,
        )

    def _start(self, guess: float) -> tuple[float, int]:
        """Velocity that repeats after a period: by secants, else by longer simulation."""
        size = next(s.nominal for s in self.model.x if s.name == "center_velocity")

        def change(V: float) -> float:
            return float(self.run(V, 1)["center_velocity"][0, -1]) - V

        # not at the guess itself, at which masses often reverse at the same instant
        before, V = guess + 0.7 * _FIRST * size, guess + _FIRST * size
        change_before, best = change(before), (np.inf, guess)
        for trial in range(2, _TRIALS):
            now = change(V)
            best = min(best, (abs(now), V))
            flat = now == change_before
            if abs(now) <= _CLOSED * size or (flat and abs(now) <= 1e-9 * size):
                return V, trial
            step = now if flat else -now * (V - before) / (now - change_before)
            if not abs(step) < size:
                step = now
            before, change_before = V, now
            V += step
            if before == V:
                return V, trial
        if best[0] <= 1e-9 * size:
            return best[1], _TRIALS
        raise SolveError(
            f"no periodic motion was found near the velocity {guess:.6g}: after a period the "
            f"velocity differs by {best[0]:.2g}",
            "write smaller friction, or another start.velocity",
            code="no_periodic_motion",
        )


def attempt(solve: Callable[[], _T]) -> tuple[_T | None, SolveError | None]:
    """Return what a function returns, or its SolveError."""
    try:
        return solve(), None
    except SolveError as error:
        return None, error
