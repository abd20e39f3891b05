"""Model of a block on the ground, driven by a bounded force, and the phases of its best slide."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.model.modes import ModeSequence
from wormopt.ocp.motion import Curve, Guess

# Shares of usual sizes that count as zero, and the accuracy of the fastest slide; multiple of the
# simple duration after which a block counts as stuck; number of checks for braking.
_SMALL, _EXACT, _FOR_EVER, _LOOKS = 1e-12, 1e-10, 1e12, 9


def block(
    law: Law,
    *,
    mass: float = 1.0,
    force: float = float("inf"),
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build the model x' = v, m v' = u + friction, |u| <= force, with one contact.

    States ``position``, ``velocity``; input ``force``; output ``energy``; parameters ``mass`` and
    those of the law. Solvers scale by `*_nominal`. ArgumentError if mass or force is not positive.
    """
    if not (mass > 0 and force > 0):
        raise ArgumentError(f"mass and force must be positive, not {mass:g} and {force:g}")
    x, v, u, f, m = (ca.SX.sym(name) for name in ("x", "v", "u", "friction", "mass"))
    (lifted,), friction = lift([law])
    speed = length_nominal / time_nominal
    size = force if force < float("inf") else mass * speed / time_nominal
    return Model(
        "block",
        x=[
            Signal("position", x, "length", length_nominal, value=0.0),
            Signal("velocity", v, "speed", speed, value=0.0),
        ],
        ode=ca.vertcat(v, (u + f) / m),
        u=[Signal("force", u, "force", size, lower=-force, upper=force, value=0.0)],
        p=[Signal("mass", m, "mass", lower=TINY, value=mass), *friction],
        outputs=[Output("energy", m * v**2 / 2, "energy")],
        contacts=[Contact("block", v, f, lifted, size, speed)],
    )


@dataclass(frozen=True)
class Transfer:
    """Task of a block on the ground: to get from one position and velocity to another."""

    law: Law
    mass: float
    force: float  # largest drive
    start: tuple[float, float]  # position and velocity
    end: tuple[float, float]
    v_reg: float | None = None  # width of the smoothed law; None for exact contact

    @cached_property
    def plain_time(self) -> float:
        """Duration of a simple motion: stop, go from rest to rest, accelerate; near the slowest."""
        a, b = self._least_net_force / self.mass, self.force / self.mass
        (x0, v0), (x1, v1) = self.start, self.end
        way = abs(x1 - x0) + v0**2 / (2 * b) + v1**2 / (2 * a)
        return abs(v0) / b + abs(v1) / a + math.sqrt(2 * way * (1 / a + 1 / b))

    @property
    def _least_net_force(self) -> float:
        """Least positive difference between drive and friction over both directions."""
        left = (self.force - abs(float(self.law.slip_force(0.0, d))) for d in self.law.directions)
        return min((net for net in left if net > 0), default=self.force)

    def model(self, duration: float) -> Model:
        """Model with nominal sizes for a motion of about so long a duration."""
        (x0, v0), (x1, v1) = self.start, self.end
        return block(
            self.law,
            mass=self.mass,
            force=self.force,
            length_nominal=max(abs(x1 - x0), (abs(v0) + abs(v1)) * duration / 4),
            time_nominal=duration,
        )

    def cubic(self, duration: float) -> Guess:
        """Guess a motion whose position is a cubic polynomial of time."""
        (x0, v0), (x1, v1) = self.start, self.end
        way, p, q = x1 - x0, duration * v0, duration * v1
        cubic = np.polynomial.Polynomial([x0, p, 3 * way - 2 * p - q, p + q - 2 * way])
        slope = cubic.deriv()
        return Guess(
            duration, lambda t: np.vstack([cubic(t / duration), slope(t / duration) / duration])
        )

    def phases(self, *, least_effort: bool) -> Phases | None:
        """Phases of the best slide, by Pontryagin's principle; None if there is none of this kind.

        The costate of the velocity in x'' = (u + f(v))/m changes its sign at most once. The drive
        of the fastest slide is first at one limit and then at the other. The drive of least effort
        leaves one limit once, and the block may rest where its speed is 0.
        """
        slides = (_Slide(self, side).phases(least_effort=least_effort) for side in (1, -1))
        return next(filter(None, slides), None)


@dataclass(frozen=True, eq=False)
class Phases:
    """Phases of the best slide, and the fastest slide as a first guess."""

    modes: ModeSequence
    active: tuple[tuple[int, ...], ...]  # limits at which the drive is held, see `FixedModes`
    guess: Guess
    excess: float  # least share of the drive that is left to gather speed, where it must


class _Leg(NamedTuple):
    """Part of a slide with constant drive and direction; both are -1 or 1."""

    side: int
    mode: int
    duration: float
    states: Callable[[float], np.ndarray]  # place and velocity, at times from 0 on


class _Slide:
    """The slide with the drive at its limit towards `way` first, then at the other limit.

    Positions and velocities are positive towards `way`; the position is 0 at the start.
    """

    def __init__(self, task: Transfer, way: int) -> None:
        self._task, self._way = task, way
        self._sizes = np.array([s.nominal for s in task.model(task.plain_time).x])
        (x0, v0), (x1, v1) = task.start, task.end
        self._run, self._first, self._last = way * (x1 - x0), way * v0, way * v1

    def phases(self, *, least_effort: bool) -> Phases | None:
        """Phases of the slide; None if it ends elsewhere."""
        legs, way, drive = self._legs(), self._way, self._task.force
        if not legs:
            return None
        smooth = self._task.v_reg is not None
        steps = [  # contact, drive at a limit or 0, duration
            (mode, side, sum(leg.duration for leg in same))
            for (side, mode), same in groupby(
                legs, lambda leg: (leg.side, leg.side if smooth else leg.mode)
            )
        ]
        if least_effort:
            # The drive is at its limit where it accelerates forward; the block may rest before
            # and after that.
            steps = [(mode, int(side == mode == 1), t) for mode, side, t in steps]
            ahead = [k for k, (mode, *_) in enumerate(steps) if mode > 0]
            for k, v in ((ahead[-1] + 1, self._last), (ahead[0], self._first)) if ahead else ():
                if v <= 0:
                    steps.insert(k, (0, 0, 0.0))
        edges = np.cumsum([0.0, *(leg.duration for leg in legs)])

        def along(of: Callable[[_Leg, float], ArrayLike]) -> Curve:
            def curve(t: np.ndarray) -> np.ndarray:
                at = np.searchsorted(edges[1:-1], t, side="right")
                rows = [of(legs[k], s) for k, s in zip(at, t - edges[at], strict=True)]
                return way * np.array(rows).reshape(len(t), -1).T

            return curve

        begin, states = (
            np.array([[self._task.start[0]], [0.0]]),
            along(lambda leg, t: leg.states(t)),
        )
        gathers = [leg for leg in legs if leg.side == leg.mode]
        left = (leg.side * self._net(0.0, leg.side, leg.mode) / drive for leg in gathers)
        return Phases(
            ModeSequence(tuple((way * mode,) for mode, *_ in steps)),
            tuple((way * side,) for _, side, _ in steps),
            Guess(
                float(edges[-1]),
                lambda t: begin + states(t),
                along(lambda leg, _: [leg.side * drive]),
                along(lambda leg, t: [self._ground(leg.states(t)[1], leg.mode)]),
                np.array([t for *_, t in steps]),
            ),
            min(left, default=math.inf),
        )

    def _ground(self, v: float, mode: int) -> float:
        way, law, v_reg = self._way, self._task.law, self._task.v_reg
        if v_reg is not None:
            return way * float(law.smooth(way * v, v_reg))
        if way * mode not in law.directions:
            return -mode * math.inf
        return way * float(law.slip_force(way * v, way * mode))

    def _net(self, v: float, side: int, mode: int) -> float:
        """Total force, which changes the velocity."""
        return side * self._task.force + self._ground(v, mode)

    def _legs(self) -> list[_Leg]:
        """Legs of the slide; none if it ends elsewhere."""
        least = max(
            self._last, 0.0
        )  # the velocity must not fall below it before the drive reverses
        legs, y = list[_Leg](), np.array([0.0, self._first, 0.0])
        for target in (*sorted(u for u in {0.0, self._last} if u > self._first), math.inf):
            v, may_turn = float(y[1]), y[1] >= self._last
            y[2] = self._way_back(v) if may_turn else 0.0
            missing, mode = self._run - y[0] - y[2], 1 if v >= 0 else -1
            if may_turn and abs(missing) <= _SMALL * self._sizes[0]:
                break
            force = self._net(v, 1, mode)
            stays = math.isinf(force) or (v <= 0 and force <= 0) or (v >= least and missing < 0)
            if stays or not math.isfinite(missing):
                return []
            leg, y, came = self._go(1, mode, y, target, least, may_turn=may_turn)
            legs.append(leg)
            if came == "turns":
                break
            if came != "there":
                return []
        legs = legs or [_Leg(1, 1 if self._first >= 0 else -1, 0.0, lambda _, at=y: at[:2])]
        for target in (*([0.0] if y[1] > 0 > self._last else []), self._last):
            leg, y, _ = self._go(-1, 1 if y[1] > 0 or target >= 0 else -1, y, target)
            legs.append(leg)
        return legs

    def _go(
        self,
        side: int,
        mode: int,
        y: np.ndarray,
        target: float,
        least: float = -math.inf,
        *,
        may_turn: bool = False,
    ) -> tuple[_Leg, np.ndarray, str]:
        """Integrate to a velocity, or to where the drive reverses; report which comes first."""
        from scipy.integrate import solve_ivp

        if abs(y[1] - target) <= _SMALL * self._sizes[1]:
            return _Leg(side, mode, 0.0, lambda _: y[:2]), y, "there"

        def rates(_: float, y: np.ndarray) -> tuple[float, float, float]:
            v = float(y[1])
            force = self._net(v, side, mode)
            return v, force / self._task.mass, -v * force / self._net(v, -1, mode)

        def there(_: float, y: np.ndarray) -> float:
            return y[1] - target

        def falls(_: float, y: np.ndarray) -> float:
            return y[1] - least

        def turns(_: float, y: np.ndarray) -> float:
            return y[0] + y[2] - self._run

        falls.direction = -1  # type: ignore[attr-defined]
        events = [there, falls, *([turns] if may_turn else [])]
        for event in events:
            event.terminal = True  # type: ignore[attr-defined]
        found = solve_ivp(
            rates,
            (0.0, _FOR_EVER * self._task.plain_time),
            y,
            method="LSODA",
            events=events,
            dense_output=True,
            rtol=_EXACT,
            atol=_EXACT * np.array([*self._sizes, self._sizes[0]]),
        )
        came = [e.__name__ for e, t in zip(events, found.t_events, strict=True) if len(t)]
        end = found.y[:, -1]
        if came == ["there"]:
            end[1] = target
        leg = _Leg(side, mode, float(found.t[-1]), lambda t: found.sol(t)[:2])
        return leg, end, came[-1] if came else "stays"

    def _way_back(self, v: float) -> float:
        """Distance from a velocity to the last after the reversal; infinite if it stops before."""
        from scipy.integrate import quad

        way, last = 0.0, self._last
        for low, high, mode in ((min(last, 0), min(v, 0), -1), (max(last, 0), max(v, 0), 1)):
            if low < high or (v == last and mode == (1 if v >= 0 else -1)):
                if any(self._net(w, -1, mode) >= 0 for w in np.linspace(low, high, _LOOKS)):
                    return math.inf
                way += quad(
                    lambda w, m=mode: -self._task.mass * w / self._net(w, -1, m), low, high
                )[0]
        return way
