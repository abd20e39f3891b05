"""A block on the ground, driven by a bounded force, and its best way somewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.model.modes import ModeSequence
from wormopt.ocp.motion import Curve, Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.block.scenes import SlideScene
from wormopt.systems.chain import law_of

# No motion takes longer than so many times a plain one, see `_plain_time`.
_LONGEST = 10.0


def block(
    law: Law,
    *,
    mass: float = 1.0,
    force: float = float("inf"),
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build x' = v, m v' = u + friction, |u| <= force, with one contact.

    States ``position``, ``velocity``; input ``force``; output ``energy``; parameters ``mass``
    and the law's. Solvers scale by `*_nominal`. ArgumentError if mass or force is not positive.
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
    """What to optimise; names of bounds are keys of the scene."""
    slow = _plain_time(table)
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
    # integrals are variables of the program: of the size of 1
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
    """Time of a plain way: stop, go from rest to rest, gather speed; none is much slower."""
    weakest = _least_net_force(law_of(table.block.friction), table.block.force)
    a, b = weakest / table.block.mass, table.block.force / table.block.mass
    v0, v1 = table.start.velocity, table.end.velocity
    way = abs(table.end.position - table.start.position) + v0**2 / (2 * b) + v1**2 / (2 * a)
    return abs(v0) / b + abs(v1) / a + math.sqrt(2 * way * (1 / a + 1 / b))


def _least_net_force(law: Law, force: float) -> float:
    """Least of what is left of the drive against friction, of the directions where any is."""
    left = (force - abs(float(law.slip_force(0.0, d))) for d in law.directions)
    return min((net for net in left if net > 0), default=force)


def cubic_guess(table: SlideScene) -> Guess:
    """Cubic from one place and velocity to the other."""
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
    """Phases of the best slide, and a motion to start from."""

    modes: ModeSequence
    active: tuple[tuple[int, ...], ...]  # limits at which the drive is held, see `FixedModes`
    guess: Guess
    excess: float  # least share of the drive that is left to gather speed, where it must


def phases_of(table: SlideScene) -> Phases | None:
    """Phases of the best slide, by Pontryagin's principle; None if friction departs too much.

    The costate of the velocity in x'' = (u + f(v))/m changes its sign at most once. The drive of
    the fastest slide is at one limit and then at the other; that of least effort leaves one limit
    once, and the block may rest where its speed is 0.
    """
    law = law_of(table.block.friction)
    if len(law.directions) < 2:
        return None
    return next(filter(None, (_phases(table, law, way) for way in (1, -1))), None)


def _phases(table: SlideScene, law: Law, way: int) -> Phases | None:
    """Phases of a slide that goes towards `way`; the motion is the fastest if f were f(0)."""
    drive, mass, least = table.block.force, table.block.mass, table.minimise == "effort"
    ahead, back = (abs(float(law.slip_force(0.0, d))) for d in (way, -way))
    v0, v1 = way * table.start.velocity, way * table.end.velocity
    # forces that stop it where it goes back, set it going, brake it, set it going back
    stop, go, brake, leave = drive + back, drive - ahead, drive + ahead, drive - back
    if go <= 0 or (v1 < 0 and leave <= 0):
        return None
    first, last = max(v0, 0.0), max(v1, 0.0)
    run = way * (table.end.position - table.start.position) + min(v0, 0.0) ** 2 * mass / stop / 2
    run += v1**2 * mass / leave / 2 if v1 < 0 else 0.0
    square = (2 * go * brake * run / mass + brake * first**2 + go * last**2) / (go + brake)
    if run < 0 or square < max(first, last) ** 2:
        return None
    steps = [  # contact, drive at a limit or 0, force, speed at the end
        (v0 < 0, -way, 0 if least else way, stop, 0.0),
        (v0 <= 0 and least, 0, 0, 1.0, 0.0),
        (True, way, way, go, math.sqrt(square)),
        (True, way, 0 if least else -way, brake, last),
        (v1 <= 0 and least, 0, 0, 1.0, 0.0),
        (v1 < 0, -way, 0 if least else -way, leave, v1),
    ]
    _, modes, active, forces, speeds = zip(*(step for step in steps if step[0]), strict=True)
    speeds = np.array([v0, *speeds])
    durations = np.abs(np.diff(speeds)) * mass / np.array(forces)
    edges = np.cumsum([0.0, *durations])
    ways = np.cumsum([0.0, *durations * (speeds[1:] + speeds[:-1]) / 2])

    def states(t: np.ndarray) -> np.ndarray:
        v = np.interp(t, edges, speeds)
        k = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(durations) - 1)
        x = ways[k] + (t - edges[k]) * (speeds[k] + v) / 2
        return np.vstack([table.start.position + way * x, way * v])

    def along(values: Sequence[float]) -> Curve:
        return lambda t: np.array(values)[None, np.searchsorted(edges[1:-1], t, side="right")]

    pushes = [drive * side for side in active]
    grounds = [-mode * (ahead if mode == way else back) for mode in modes]
    guess = Guess(float(edges[-1]), states, along(pushes), along(grounds), durations)
    return Phases(
        ModeSequence(tuple((m,) for m in modes)),
        tuple((a,) for a in active),
        guess,
        min(go, leave if v1 < 0 else go) / drive,
    )
