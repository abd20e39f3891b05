"""Motions in the plane: harmonic inputs, work, compliant obstacles, and steps without events."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal, Switch, pack
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.trajectory import Trajectory
from wormopt.simulation.walls import smooth_walls
from wormopt.systems.planar.shape import Harmonics
from wormopt.systems.shared.models import drags_in_ode


def swing(plant: Model, period: float, courses: dict[str, Harmonics]) -> Model:
    """Replace inputs of a plant, by name, by harmonics of time; the phase is 0 at time 0.

    Outputs have the names of the inputs. Parameters are the `period` and the mean and coefficients,
    ``<input>_mean``, ``<input>_cosine``, ``<input>_sine``.
    """
    known = {signal.name: signal for signal in plant.u}
    T = Signal("period", ca.SX.sym("period"), "time", value=float(period))
    expressions, parameters, shown = [], [T], []
    for name, course in courses.items():
        if name not in known or known[name].size != course.n_s:
            sizes = ", ".join(f"{s.name} of {s.size}" for s in plant.u)
            raise ArgumentError(f"{name} of size {course.n_s} is none of the inputs: {sizes}")
        value, own = _course(name, known[name].unit, course, 2 * ca.pi * plant.t / T.symbol)
        expressions.append(value)
        parameters += own
        shown.append(Output(name, value, known[name].unit))
    fed = feed(plant, [known[name] for name in courses], ca.vertcat(ca.SX(0, 1), *expressions))
    return replace(fed, p=[*fed.p, *parameters], outputs=[*fed.outputs, *shown])


def _course(name: str, unit: str, course: Harmonics, phase: ca.SX) -> tuple[ca.SX, list[Signal]]:
    mean = Signal(f"{name}_mean", ca.SX.sym("mean", course.n_s), unit, value=tuple(course.mean))
    value, signals = mean.symbol, [mean]
    orders = range(1, len(course.cosine) + 1)
    for part, wave in (("cosine", ca.cos), ("sine", ca.sin)):
        table = getattr(course, part)
        symbol = ca.SX.sym(part, table.size)
        signals.append(Signal(f"{name}_{part}", symbol, unit, value=tuple(table.ravel())))
        rows = ca.vertsplit(symbol, course.n_s) if table.size else []
        for h, row in zip(orders, rows, strict=True):
            value = value + row * wave(h * phase)
    return value, [signal for signal in signals if signal.size]


def watch_links(model: Model, least: float) -> Model:
    """End the motion of a chain if a link gets shorter than `least`.

    A link without length has no direction: its mass turns about the other ever faster. Links that
    are shorter at the start are ignored until they have been longer.
    """
    lengths = model["length"]
    closes = [
        Switch(f"link {j + 1} closes", least - lengths[j], pack(model.x), terminal=True)
        for j in range(lengths.numel())
    ]
    return replace(model, switches=[*model.switches, *closes])


def closed_link(motion: Trajectory) -> str:
    """Return the link that ended a motion of a model of `watch_links`, for example "link 1"."""
    last = motion.events[-1] if motion.events else None
    return last.name.removesuffix(" closes") if last and last.kind == "switch" else ""


def energy_error(motion: Trajectory, stored: str) -> float:
    """Return the largest difference of all works and the energy `stored`, over the largest.

    The motion is of a model of `measure_works`. Both count from the state after the first instant,
    in which the ground may stop what it does not allow.
    """
    names = [s.name for s in motion.system.model.x if s.name.endswith("_work")]
    works, energy = np.array([motion[name][0] for name in names]), motion[stored][0]
    works -= works[:, :1]
    gap = np.abs(works.sum(axis=0) - (energy - energy[0])).max()
    size = max(np.abs(works).max(), np.abs(energy).max())
    return float(gap / size) if size else 0.0


def energy_stopped(motion: Trajectory, stored: str) -> float:
    """Return the energy `stored` that the ground takes in the first instant."""
    model = motion.system.model
    start = signal_values(model.x, None, "state", fill=0.0)
    given = replace(motion, time=motion.time[:1], states=start[:, None])[stored][0, 0]
    return float(given - motion[stored][0, 0])


def at_steps(motion: Trajectory) -> Trajectory:
    """Return the motion also at the ends of its steps, if they are known.

    Samples may be so few that links oscillate or turn between them.
    """
    if motion.dense is None:
        return motion
    return motion.at(np.union1d(motion.time, motion.dense.time))


def unwrapped(motion: Trajectory, name: str) -> np.ndarray:
    """Return angles at the samples without jumps by whole turns."""
    fine = at_steps(motion)
    return np.unwrap(fine[name], axis=1)[:, np.searchsorted(fine.time, motion.time)]


def resting_masses(motion: Trajectory) -> np.ndarray:
    """Return which points rest at the samples, by all their contacts; shape (points, m).

    A point rests if its contacts hold it along its heading and across. Points with resistance in a
    single direction never count as resting, nor does anything with smooth contact.
    """
    model = motion.system.model
    points = model["heading"].numel()
    modes, names = motion.modes_at(motion.time), [c.name for c in motion.system.contacts]
    held = {name: row == 0 for name, row in zip(names, modes, strict=False)}
    never = np.zeros(len(motion.time), bool)
    rows = []
    for i in range(points):
        both = [held.get(f"mass {i} {word}", never) for word in ("along", "across")]
        rows.append(held.get(f"mass {i}", both[0] & both[1]))
    return np.array(rows)


_TOUCHES = 1e-3  # of the usual force: push of an obstacle that is just touched
_DAMPED = 2.1  # times sqrt(m / k): above 2 a mass does not bounce


@dataclass(frozen=True)
class Yielding:
    """Compliance of obstacles."""

    stiffness: float  # force per depth, positive
    mass: float  # largest mass that hits one
    v_reg: float = math.inf  # width of velocities over which their friction is steep


def let_give_way(worm: Model, obstacles: Yielding) -> Model:
    """Let obstacles push by explicit forces; the worm keeps the contacts with its ground.

    Masses enter obstacles by force over stiffness, and do not bounce. Friction on obstacles is
    smooth, and 0 by default: masses creep with it, which is incompatible with exact contact,
    because the direction of friction turns faster for slower masses. Adds outputs ``wall_force``
    and ``wall_gap``, one for each mass and obstacle, and ``wall_power`` on the worm.
    """
    k = obstacles.stiffness
    touching = [contact for contact in worm.contacts if contact.gap is not None]
    soft = smooth_walls(
        worm,
        k,
        smoothing=(_TOUCHES * touching[0].nominal_force) ** 2 / k,
        relaxation=_DAMPED * math.sqrt(obstacles.mass / k),
    )
    pressed, push = soft.z[-1].symbol, soft["wall_force"]
    rubbing = [c.law.smooth(c.velocity, obstacles.v_reg) for c in touching]  # type: ignore[union-attr,call-arg]
    old = ca.vertcat(*(c.force for c in touching), pressed)
    new = ca.vertcat(*(ca.substitute(f, pressed, push) for f in rubbing), push)
    names = {contact.name for contact in touching}
    rates = ca.jtimes(ca.vertcat(*(c.gap for c in touching)), pack(worm.x), worm.ode)  # type: ignore[misc]
    sliding = ca.vertcat(*(c.velocity for c in touching))
    power = ca.dot(push, rates) + ca.dot(new[: len(touching)], sliding)
    outputs = [replace(o, expression=ca.substitute(o.expression, old, new)) for o in soft.outputs]
    return replace(
        soft,
        z=soft.z[:-1],
        alg=ca.SX(0, 1),
        ode=ca.substitute(soft.ode, old, new),
        outputs=[
            *outputs,
            Output("wall_gap", ca.vertcat(*(c.gap for c in touching)), "length"),  # type: ignore[misc]
            Output("wall_power", power, "power"),
        ],
        contacts=[contact for contact in soft.contacts if contact.name not in names],
    )


def gaps_at_start(worm: Model) -> np.ndarray:
    """Return distances (obstacles, masses) of the masses from obstacles at the start."""
    gaps = [contact.gap for contact in worm.contacts if contact.gap is not None]
    function = ca.Function("gaps", [pack(worm.x)], [ca.vertcat(*gaps)])
    start = signal_values(worm.x, None, "state", fill=0.0)
    return np.array(function(start)).reshape(-1, worm.x[0].size // 2)


_FINER = 4  # ratio of both steps
# The place of an event within its step changes the error at first order, randomly: a mass that
# reverses slides to one side for the whole step. So several steps estimate the longer one's error.
_LENGTHS = (1.0, 0.93, 0.87, 0.81)
_SHARE = 0.005  # of the longest stable step
_PER_WAY = 1e-9  # of the usual size: a displacement below counts as none


@dataclass(frozen=True)
class Stepped:
    """End by Moreau-Jean steps, compared with the end by events."""

    step: float  # the longer step; the shorter one is a quarter of it
    # error by the longer step, a root mean square over steps near it: largest difference of a
    # place over the longest displacement
    coarse: float
    fine: float  # error by the shorter step: about a quarter, at first order
    rounding: float  # possible round-off of the short steps, over the same displacement


def stepper_of(worm: Model) -> MoreauJean | None:
    """Return the time stepper of a planar chain without inputs; None if it cannot treat its ground.

    It treats laws with an elliptic or box set of forces and linear drag, with rods or without.
    """
    try:
        return MoreauJean(_with_clock(drags_in_ode(worm)))
    except ArgumentError:
        return None


def step_again(
    stepper: MoreauJean, motion: Trajectory, step: float | None = None, report: Report = silent
) -> Stepped:
    """Simulate the same worm with steps of one length, then of a quarter of it.

    Errors are of first order. `motion` is that of the worm, from time 0, with places as first
    states. Raises SolveError or Interrupted like `MoreauJean.march`.
    """
    model = stepper.model
    if step is None:
        start = signal_values(model.x, None, "state", fill=0.0)
        numbers = signal_values(tuple(model.p), None, "parameter")
        step = min(_SHARE * stepper.safe_step(start, numbers), motion.end_time / 200)
    places, way = motion["position"], longest_way(motion)

    def error(length: float) -> float:
        found = stepper.march(motion.end_time, step=length, report=report)
        return float(np.abs(found.states[: len(places), -1] - places[:, -1]).max() / way)

    coarse = np.sqrt(np.mean([(error(share * step) / share) ** 2 for share in _LENGTHS]))
    roundings = 2 * _FINER * motion.end_time / step  # places move twice in a step
    rounding = roundings * np.finfo(float).eps / 2 * float(np.abs(places).max()) / way
    return Stepped(step, float(coarse), error(step / _FINER), rounding)


def longest_way(motion: Trajectory) -> float:
    """Return the longest path of a coordinate, at least a billionth of the usual size."""
    places, nominal = at_steps(motion)["position"], motion.system.model.x[0].nominal
    return float(max(np.abs(np.diff(places, axis=1)).sum(axis=1).max(), _PER_WAY * nominal))


def _with_clock(worm: Model) -> Model:
    """Return the same worm with time as a place that moves at rate 1."""
    clock, tick = ca.SX.sym("clock"), ca.SX.sym("tick")
    (place, speed), half = worm.x, worm.n_x // 2
    ode = ca.vertcat(worm.ode[:half], tick, worm.ode[half:], 0)
    contacts = [
        replace(c, velocity=ca.substitute(c.velocity, worm.t, clock)) for c in worm.contacts
    ]
    return Model(
        worm.name,
        [place, Signal("clock", clock, "time", value=0.0),
         speed, Signal("tick", tick, "1", value=1.0)],
        ca.substitute(ode, worm.t, clock),
        u=worm.u,
        p=worm.p,
        contacts=contacts,
    )  # fmt: skip
