"""Dry friction by scipy's solve_ivp with terminal events: what one would write without wormopt.

Sliding masses have the event v = 0, resting ones the events that their force leaves its interval;
at every event the modes are decided anew, on the level of accelerations, and solve_ivp starts
again. It knows nothing of `simulate` and is the second route for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.bench.driven_chain import DrivenChain, Grip
from wormopt.bench.linear_flow import Happening, Motion

_SLACK = 1e-12
Rates = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Plant:
    """Masses on dry ground."""

    rates: Rates  # (t, y, friction forces) -> y'; a mass's force accelerates no other mass
    start: np.ndarray  # (n_y,) state at time 0
    velocity: np.ndarray  # (masses,) indices of their velocities in the state
    mass: np.ndarray  # (masses,)
    grips: Sequence[Grip]  # friction of each mass
    breaks: Callable[[float], np.ndarray]  # (span) -> times within at which rates are not smooth


def plant_of_chain(chain: DrivenChain) -> Plant:
    """Take a driven chain for a plant."""
    masses = chain.links + 1

    def breaks(span: float) -> np.ndarray:
        cycles = np.arange(np.ceil(span / chain.gait.period)) * chain.gait.period
        times = (cycles[:, None] + chain.gait.breaks[None, :-1]).ravel()
        return times[(times > 0) & (times < span)]

    velocity = np.arange(masses, 2 * masses)
    return Plant(chain.rates, chain.start, velocity, chain.mass, chain.grips, breaks)


class _Loop:
    def __init__(self, plant: Plant) -> None:
        self.plant, self.velocity, self.mass = plant, plant.velocity, plant.mass
        self.ahead = np.array([-grip.forward for grip in plant.grips])
        # a spike never slides backward; what its force would be then is of no matter
        self.behind = np.array([g.backward if np.isfinite(g.backward) else 0 for g in plant.grips])
        # A mass is let go when its force is out of bounds by more than rounding, so that its
        # acceleration then has the right sign.
        self.hold = np.array([grip.hold for grip in plant.grips]) + np.array([-_SLACK, _SLACK])
        self.modes = np.zeros(len(self.mass), dtype=int)
        self.slip = np.zeros(len(self.mass))
        self.let_go = np.full(len(self.mass), -np.inf)  # when
        self.within = (0.0, 0.0)
        self.none = np.zeros(len(self.mass))
        self.happenings: list[Happening] = []

    def stay_within(self, start: float, stop: float) -> None:
        """Evaluate no more on the far side of a break, where rates may be quite different."""
        rounding = 1e-13 * max(stop, 1.0)
        self.within = (start + rounding, stop - rounding)

    def free(self, t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        low, high = self.within
        return self.plant.rates(min(max(t, low), high), y, force.copy())

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        dy = self.free(t, y, self.slip)
        dy[self.velocity[self.modes == 0]] = 0.0
        return dy

    def holding(self, t: float, y: np.ndarray) -> np.ndarray:
        """Force that each mass needs to stay at rest."""
        return -self.mass * self.free(t, y, self.none)[self.velocity]

    def decide(self, t: float, y: np.ndarray, event: int = -1) -> None:
        """Modes of masses without velocity; `event` is the mass whose event it is."""
        before, force = self.modes.copy(), self.holding(t, y)
        for i, (least, largest) in enumerate(self.hold):
            if i == event:
                y[self.velocity[i]] = 0.0
            if y[self.velocity[i]] != 0:
                self.modes[i] = np.sign(y[self.velocity[i]])
            elif i == event and before[i] == 0:  # let go, whatever rounding says of its force
                self.modes[i] = 1 if force[i] - least < largest - force[i] else -1
                self.let_go[i] = t
            elif self.let_go[i] < t:
                self.modes[i] = int(force[i] < least) - int(force[i] > largest)
        self.slip = np.where(self.modes > 0, self.ahead, self.behind)
        for i in np.flatnonzero(before != self.modes) if t > 0 else ():
            kind = "release" if before[i] == 0 else "stick" if self.modes[i] == 0 else "reversal"
            self.happenings.append(Happening(t, int(i), kind))

    def events(self) -> tuple[list[Callable[[float, np.ndarray], float]], list[int]]:
        functions: list[Any] = []
        owners = []
        for i, mode in enumerate(self.modes):
            if mode:
                functions.append(lambda _, y, s=mode, v=self.velocity[i]: s * y[v])
                owners.append(i)
                continue
            for bound, sign in zip(self.hold[i], (1, -1), strict=True):
                if np.isfinite(bound):
                    functions.append(
                        lambda t, y, i=i, b=bound, s=sign: s * (self.holding(t, y)[i] - b)
                    )
                    owners.append(i)
        for function in functions:
            function.terminal, function.direction = True, -1
        return functions, owners


def event_loop(
    plant: Plant,
    span: float,
    times: np.ndarray | None = None,
    *,
    start: np.ndarray | None = None,
    method: str = "DOP853",
    relative: float = 1e-10,
    absolute: float = 1e-11,
    max_step: float = np.inf,
    max_events: int = 100_000,
) -> Motion:
    """Follow a plant from 0 to `span` with solve_ivp; `times` (m,) are sampled, ascending.

    Bound `max_step`: a velocity that dips below zero and comes back in a step goes unseen.
    Raises RuntimeError if solve_ivp fails or there are more than `max_events` events.
    """
    loop = _Loop(plant)
    times = np.zeros(0) if times is None else times
    y, t, event = (plant.start if start is None else start).copy(), 0.0, -1
    states, sampled, steps = np.empty((len(y), len(times))), 0, 0
    stalled, last = 0, -np.inf
    for stop in [*plant.breaks(span), span]:
        loop.stay_within(t, stop)
        while t < stop:
            stalled, last = (stalled + 1, last) if t - last < 1e-13 * span else (0, t)
            loop.decide(t, y, event)
            functions, owners = loop.events()
            wanted = times[sampled:]
            wanted = wanted[(wanted >= t) & (wanted <= stop)]
            found = solve_ivp(
                loop.rates,
                (t, stop),
                y,
                method,
                dense_output=len(wanted) > 0,
                events=functions,
                rtol=relative,
                atol=absolute,
                # A velocity that starts at 0 and is back within the first step has its event,
                # for solve_ivp, at the start: it needs a shorter step.
                max_step=max_step if stalled == 0 else min(max_step, 0.01) * 0.5**stalled,
            )
            stuck = stalled > 30 + 2 * len(plant.mass) or len(loop.happenings) > max_events
            if found.status < 0 or stuck:
                raise RuntimeError(f"the event loop is given up at t = {t:g}: {found.message}")
            steps += found.nfev
            event = -1
            t_end, y_end = stop, found.y[:, -1] if found.status == 0 else y
            if found.status == 1:
                first = [k for k, at in enumerate(found.t_events) if len(at)]
                k = min(first, key=lambda k: found.t_events[k][0])
                event, t_end, y_end = owners[k], found.t_events[k][0], found.y_events[k][0]
            taken = int(np.sum(wanted <= t_end))
            if taken and found.sol is not None:
                states[:, sampled : sampled + taken] = found.sol(wanted[:taken])
                sampled += taken
            y, t = y_end.copy(), float(t_end)
    states[:, sampled:] = y[:, None]
    return Motion(states, y, loop.happenings, steps)
