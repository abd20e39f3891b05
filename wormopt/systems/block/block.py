"""Model of a block on the ground, driven by a bounded force, and its optimal motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
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
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.study.numerics import SmoothContact
from wormopt.systems.block.scenes import SlideScene
from wormopt.systems.chain import law_of

# Upper limit of the duration, in multiples of a simple motion, see `_plain_time`.
_LONGEST = 10.0
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


def problem_of(table: SlideScene) -> Problem:
    """Optimal-control problem of the block; names of bounds are keys of the scene."""
    known = phases_of(table)
    slow = _plain_time(table) if known is None else known.guess.duration
    model = _model(table, slow)
    effort = table.minimise == "effort"
    ends = Ends.of(model, int(effort))
    sizes = np.array([s.nominal for s in model.x])
    at_ends = [
        Constraint(f"{name}.{signal.name}", state[k] / sizes[k], value / sizes[k], value / sizes[k])
        for name, place, state in (("start", table.start, ends.start), ("end", table.end, ends.end))
        for k, signal, value in zip(
            range(2), model.x, (place.position, place.velocity), strict=False
        )
    ]
    longest = _LONGEST * slow
    if table.time is not None:
        at_ends.append(Constraint("time", ends.duration, upper=table.time, nominal=table.time))
        longest = max(longest, 2 * table.time)
    # Integrals are variables of the program, so they are scaled to the size of 1.
    size = model.u[0].nominal ** 2 * slow if effort else slow
    return Problem(
        model,
        ends,
        size * ends.integrals[0] if effort else ends.duration,
        (1e-6 * slow, longest),
        integrands=ca.sumsqr(model["force"]) / size if effort else ca.SX(0, 1),
        boundary_constraints=at_ends,
        nominal=size,
    )


def _model(table: SlideScene, slow: float) -> Model:
    way = abs(table.end.position - table.start.position)
    speeds = abs(table.start.velocity) + abs(table.end.velocity)
    return block(
        law_of(table.block.friction),
        mass=table.block.mass,
        force=table.block.force,
        length_nominal=max(way, speeds * slow / 4),
        time_nominal=slow,
    )


def _plain_time(table: SlideScene) -> float:
    """Duration of a simple motion: stop, go from rest to rest, accelerate; none is much slower."""
    weakest = _least_net_force(law_of(table.block.friction), table.block.force)
    a, b = weakest / table.block.mass, table.block.force / table.block.mass
    v0, v1 = table.start.velocity, table.end.velocity
    way = abs(table.end.position - table.start.position) + v0**2 / (2 * b) + v1**2 / (2 * a)
    return abs(v0) / b + abs(v1) / a + math.sqrt(2 * way * (1 / a + 1 / b))


def _least_net_force(law: Law, force: float) -> float:
    """Least positive difference between drive and friction over both directions."""
    left = (force - abs(float(law.slip_force(0.0, d))) for d in law.directions)
    return min((net for net in left if net > 0), default=force)


def cubic_guess(table: SlideScene) -> Guess:
    """Cubic from one position and velocity to another."""
    duration = _plain_time(table) if table.time is None else table.time
    start, end = table.start, table.end
    way = end.position - start.position
    p, q = duration * start.velocity, duration * end.velocity
    cubic = np.polynomial.Polynomial([start.position, p, 3 * way - 2 * p - q, p + q - 2 * way])
    slope = cubic.deriv()
    return Guess(
        duration, lambda t: np.vstack([cubic(t / duration), slope(t / duration) / duration])
    )


@dataclass(frozen=True, eq=False)
class Phases:
    """Phases of the best slide, and the fastest slide as a first guess."""

    modes: ModeSequence
    active: tuple[tuple[int, ...], ...]  # limits at which the drive is held, see `FixedModes`
    guess: Guess
    excess: float  # least share of the drive that is left to gather speed, where it must


def phases_of(table: SlideScene) -> Phases | None:
    """Phases of the best slide, by Pontryagin's principle; None if there is none of this kind.

    The costate of the velocity in x'' = (u + f(v))/m changes its sign at most once. The drive of
    the fastest slide is first at one limit and then at the other. The drive of least effort leaves
    one limit once, and the block may rest where its speed is 0.
    """
    return next(filter(None, (_phases(table, way) for way in (1, -1))), None)


def _phases(table: SlideScene, way: int) -> Phases | None:
    """Phases of a slide that is first driven towards `way`; None if it ends elsewhere."""
    slide = _Slide(table, way)
    legs = slide.legs()
    if not legs:
        return None
    least, smooth = table.minimise == "effort", isinstance(table.contact, SmoothContact)
    steps = [  # contact, drive at a limit or 0, duration
        (mode, side, sum(leg.duration for leg in same))
        for (side, mode), same in groupby(
            legs, lambda leg: (leg.side, leg.side if smooth else leg.mode)
        )
    ]
    if least:  # The drive is at its limit where it accelerates forward; before and after that it
        # may rest.
        steps = [(mode, int(side == mode == 1), t) for mode, side, t in steps]
        ahead = [k for k, (mode, *_) in enumerate(steps) if mode > 0]
        for k, v in ((ahead[-1] + 1, slide.last), (ahead[0], slide.first)) if ahead else ():
            if v <= 0:
                steps.insert(k, (0, 0, 0.0))
    edges = np.cumsum([0.0, *(leg.duration for leg in legs)])

    def along(of: Callable[[_Leg, float], ArrayLike]) -> Curve:
        def curve(t: np.ndarray) -> np.ndarray:
            at = np.searchsorted(edges[1:-1], t, side="right")
            return (
                way
                * np.array([of(legs[k], s) for k, s in zip(at, t - edges[at], strict=True)])
                .reshape(len(t), -1)
                .T
            )

        return curve

    begin, states = np.array([[table.start.position], [0.0]]), along(lambda leg, t: leg.states(t))
    gathers = [leg for leg in legs if leg.side == leg.mode]
    left = (leg.side * slide.net(0.0, leg.side, leg.mode) / slide.drive for leg in gathers)
    return Phases(
        ModeSequence(tuple((way * mode,) for mode, *_ in steps)),
        tuple((way * side,) for _, side, _ in steps),
        Guess(
            float(edges[-1]),
            lambda t: begin + states(t),
            along(lambda leg, _: [leg.side * slide.drive]),
            along(lambda leg, t: [slide.ground(leg.states(t)[1], leg.mode)]),
            np.array([t for *_, t in steps]),
        ),
        min(left, default=math.inf),
    )


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

    def __init__(self, table: SlideScene, way: int) -> None:
        self._slow = _plain_time(table)
        self._sizes = np.array([s.nominal for s in _model(table, self._slow).x])
        self._way, self._law, self._contact = way, law_of(table.block.friction), table.contact
        self._run = way * (table.end.position - table.start.position)
        self._mass, self.drive = table.block.mass, table.block.force
        self.first, self.last = way * table.start.velocity, way * table.end.velocity

    def ground(self, v: float, mode: int) -> float:
        """Force of the ground."""
        way, law = self._way, self._law
        if isinstance(self._contact, SmoothContact):
            return way * float(law.smooth(way * v, self._contact.v_reg))
        if way * mode not in law.directions:
            return -mode * math.inf
        return way * float(law.slip_force(way * v, way * mode))

    def net(self, v: float, side: int, mode: int) -> float:
        """Total force, which changes the velocity."""
        return side * self.drive + self.ground(v, mode)

    def legs(self) -> list[_Leg]:
        """Legs of the slide; none if it ends elsewhere."""
        least = max(self.last, 0.0)  # the velocity must not fall below it before the drive reverses
        legs, y = list[_Leg](), np.array([0.0, self.first, 0.0])
        for target in (*sorted(u for u in {0.0, self.last} if u > self.first), math.inf):
            v, may_turn = float(y[1]), y[1] >= self.last
            y[2] = self._way_back(v) if may_turn else 0.0
            missing, mode = self._run - y[0] - y[2], 1 if v >= 0 else -1
            if may_turn and abs(missing) <= _SMALL * self._sizes[0]:
                break
            force = self.net(v, 1, mode)
            stays = math.isinf(force) or (v <= 0 and force <= 0) or (v >= least and missing < 0)
            if stays or not math.isfinite(missing):
                return []
            leg, y, came = self._go(1, mode, y, target, least, may_turn=may_turn)
            legs.append(leg)
            if came == "turns":
                break
            if came != "there":
                return []
        legs = legs or [_Leg(1, 1 if self.first >= 0 else -1, 0.0, lambda _, at=y: at[:2])]
        for target in (*([0.0] if y[1] > 0 > self.last else []), self.last):
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
        """Integrate to a velocity, or to where the drive reverses; report which comes first.

        `y`: position, velocity, and the distance from this velocity to the last one after the
        reversal.
        """
        from scipy.integrate import solve_ivp

        if abs(y[1] - target) <= _SMALL * self._sizes[1]:
            return _Leg(side, mode, 0.0, lambda _: y[:2]), y, "there"

        def rates(_: float, y: np.ndarray) -> tuple[float, float, float]:
            v = float(y[1])
            force = self.net(v, side, mode)
            return v, force / self._mass, -v * force / self.net(v, -1, mode)

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
            (0.0, _FOR_EVER * self._slow),
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

        way, last = 0.0, self.last
        for low, high, mode in ((min(last, 0), min(v, 0), -1), (max(last, 0), max(v, 0), 1)):
            if low < high or (v == last and mode == (1 if v >= 0 else -1)):
                if any(self.net(w, -1, mode) >= 0 for w in np.linspace(low, high, _LOOKS)):
                    return math.inf
                way += quad(lambda w, m=mode: -self._mass * w / self.net(w, -1, m), low, high)[0]
        return way
