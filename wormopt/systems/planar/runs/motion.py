"""Scenes of kind ``planar-motion``: a worm of masses and springs in the plane, simulated."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.scene.conclude import conclude
from wormopt.scene.numerics import SmoothContact, ToleranceTable
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.planar.body.strokes import Harmonics
from wormopt.systems.planar.dynamics.chain import chain_places, planar_chain
from wormopt.systems.planar.dynamics.motion import (
    energy_error,
    measure_works,
    resting_masses,
    swing,
)
from wormopt.systems.planar.dynamics.stepping import Stepped, step_again, stepper_of
from wormopt.systems.planar.runs.ground import ground_of
from wormopt.systems.planar.scenes.motion import PlanarMotionScene, Swinging
from wormopt.systems.shared.proof import (
    CrossCheck,
    accepted_error,
    cross_check,
    motion_facts,
    warnings_of_motion,
)
from wormopt.systems.shared.signals import event_arrays, simulate_whole

_FOLDED = 3.1  # a joint that bends farther is taken to fold
# What is accepted of the second route's end over the longest way, if it goes by steps of first
# order, and of what a quarter of its step leaves of that (a quarter), unless that is noise:
# single stops and releases that fall into one step or the next are as much.
_STEPPED, _ORDER, _NOISE = 0.01, 0.5, 1e-4


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[PlanarMotionScene], report: Report) -> Result:
    """Simulate the worm; "failed" if the second route or the balance of energy disagrees.

    Raises SolveError if the motion stops short, Interrupted if the user stops it, both with the
    motion so far as partial result.
    """
    table, clock = scene.table, time.perf_counter()
    plain = build_planar(table)
    model = measure_works(plain, _usual_work(table))
    built = time.perf_counter()
    contact, settings = table.contact, table.tolerance
    treatment = Smooth(contact.v_reg) if isinstance(contact, SmoothContact) else Exact()
    tolerance = tolerance_of(settings)
    try:
        motion = simulate_whole(
            model, table.time.end, table.time.samples, treatment, tolerance, report
        )
    except SolveError as error:
        partial = _unfinished(scene, error.partial, error.reason)
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except Interrupted as stop:
        why = f"interrupted at t = {stop.partial.end_time:.6g}"
        raise Interrupted(_unfinished(scene, stop.partial, why)) from None
    simulated = time.perf_counter()
    try:
        second = _recheck(plain, motion, tolerance, report) if settings.recheck else None
    except KeyboardInterrupt:
        why = "interrupted before the second route was done"
        raise Interrupted(_unfinished(scene, motion, why)) from None
    check = second and second.check
    scalars = _scalars(motion, second)
    return conclude(
        scene,
        scalars,
        _signals(motion),
        checks=_checks(scalars, second, tolerance),
        facts=motion_facts([motion], [check], tolerance),
        warnings=[*motion.warnings, *warnings_of_motion(motion, check)],
        timings={
            "build": built - clock,
            "simulate": simulated - built,
            "recheck": time.perf_counter() - simulated,
        },
        attributes=_attributes(motion),
    )


def models_of(scene: Scene[PlanarMotionScene]) -> dict[str, Model]:
    """Make the model that is simulated."""
    return {"": build_planar(scene.table)}


def build_planar(table: PlanarMotionScene) -> Model:
    """Model of the worm with what moves it."""
    worm, start = table.worm, table.start
    links, joints = worm.links, worm.links - 1
    lengths = per(worm.rest_length if start.lengths is None else start.lengths, links)
    angles = per(worm.rest_angle if start.angles is None else start.angles, joints)
    mass = np.array(per(worm.mass, links + 1))
    places = _turned(start.direction, chain_places(lengths, angles)) + start.tail
    model = planar_chain(
        links,
        mass=mass,
        stiffness=worm.stiffness,
        damping=worm.damping,
        rest_length=worm.rest_length,
        bending_stiffness=worm.bending_stiffness,
        bending_damping=worm.bending_damping,
        rest_angle=worm.rest_angle,
        rod_mass=worm.rod_mass,
        law=[ground_of(ground) for ground in table.grounds],
        pull=_weights(table),
        heading=worm.heading,
        position=places,
        velocity=_velocities(table, places),
        length_nominal=float(np.mean(lengths)),
        time_nominal=table.actuation.period if table.actuation else table.time.end,
    )
    if table.actuation is None:
        return model
    told = {"input": (table.actuation.force, links), "torque": (table.actuation.torque, joints)}
    courses = {name: _harmonics(given, count) for name, (given, count) in told.items() if given}
    return swing(model, table.actuation.period, courses)


def _harmonics(table: Swinging, count: int) -> Harmonics:
    """Course of `count` values; rows that are missing are 0."""
    most = max(len(table.cosine), len(table.sine))
    parts = np.zeros((2, most, count))
    for part, rows in zip(parts, (table.cosine, table.sine), strict=True):
        part[: len(rows)] = np.reshape(rows, (len(rows), count))
    return Harmonics(np.array(table.mean or (0.0,) * count), *parts)


def tolerance_of(table: ToleranceTable) -> Tolerance:
    """Tolerance that a scene asks for."""
    return Tolerance(table.relative, table.absolute, table.max_steps, table.max_step)


def _turned(angle: float, rows: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return rows @ np.array([[c, s], [-s, c]])


def _weights(table: PlanarMotionScene) -> np.ndarray:
    """Weight of each mass, and of half the rods beside it, down the slope."""
    worm = table.worm
    weight = np.array(per(worm.mass, worm.links + 1))
    if worm.rod_mass is not None:
        half = np.array(per(worm.rod_mass, worm.links)) / 2
        weight = weight + np.append(half, 0.0) + np.append(0.0, half)
    down = worm.standard * np.sin(worm.slope) if worm.slope else 0.0
    return np.stack([-down * weight, 0.0 * weight], axis=1)


def _velocities(table: PlanarMotionScene, places: np.ndarray) -> np.ndarray:
    """Of all masses: one for all, and a turn about the centre of mass."""
    worm, start = table.worm, table.start
    weight = np.array(per(worm.mass, worm.links + 1))
    if worm.rod_mass is not None:
        half = np.array(per(worm.rod_mass, worm.links)) / 2
        weight = weight + np.append(half, 0.0) + np.append(0.0, half)
    arms = places - weight @ places / weight.sum()
    left = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    return np.array(start.velocity) + start.turning * left


def _usual_work(table: PlanarMotionScene) -> float:
    lengths = np.mean(per(table.worm.rest_length, table.worm.links))
    period = table.actuation.period if table.actuation else table.time.end
    return float(np.mean(per(table.worm.mass, table.worm.links + 1)) * (lengths / period) ** 2)


# -- the second route ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Recheck:
    """What another route finds."""

    check: CrossCheck
    stepped: Stepped | None = None  # where it goes by steps


def _recheck(model: Model, motion: Trajectory, tolerance: Tolerance, report: Report) -> Recheck:
    """By steps of Moreau and Jean, which know no events; where they do not fit, by tolerance."""
    exact = isinstance(motion.system.treatment, Exact)
    stepper = stepper_of(model) if exact else None
    if stepper is None:
        return Recheck(cross_check(model, motion, tolerance, report=report))
    name, shared = "steps of Moreau and Jean", "the model"
    try:
        found = step_again(stepper, motion, report=report)
    except SolveError as error:
        return Recheck(CrossCheck(name, None, _STEPPED, shared, error.reason))
    return Recheck(CrossCheck(name, found.fine, _STEPPED, shared), found)


# -- results -------------------------------------------------------------------------------------


def _unfinished(scene: Scene[PlanarMotionScene], motion: Trajectory, why: str) -> Result:
    signals = _signals(motion) if len(motion.time) else {}
    return conclude(scene, {}, signals, attributes=_attributes(motion)).failed(why)


def _attributes(motion: Trajectory) -> dict[str, Any]:
    return {"contacts": [contact.name for contact in motion.system.model.contacts]}


def _scalars(motion: Trajectory, second: Recheck | None) -> dict[str, Any]:
    center, lengths = motion["center_of_mass"], motion["length"]
    way = center[:, -1] - center[:, 0]
    looks = np.unwrap(motion["heading"][0])
    works = _works(motion)
    return {
        "x_way": float(way[0]),
        "y_way": float(way[1]),
        "distance": float(np.hypot(*way)),
        "turn": float(looks[-1] - looks[0]),
        "angle_max": float(np.abs(motion["angle"]).max(initial=0.0)),
        "length_min": float(lengths.min()),
        **{f"{name}_work": float(done[-1]) for name, done in works.items()},
        "energy_error": energy_error(motion, "energy"),
        "rest_share": float(resting_masses(motion).mean()),
        "n_events": len(motion.events),
        "n_steps": motion.n_steps,
        "recheck_error": second and second.check.error,
        "moreau_coarse": second and second.stepped and second.stepped.coarse,
        "moreau_step": second and second.stepped and second.stepped.step,
    }


def _works(motion: Trajectory) -> dict[str, np.ndarray]:
    done = {name: motion[f"{name}_work"][0] for name in ("input", "torque", "ground", "damping")}
    return {
        "actuator": done.pop("input") + done.pop("torque"),
        **done,
        "pull": motion["pull_work"][0],
    }


def _signals(motion: Trajectory) -> dict[str, Any]:
    ground = motion["ground_force"]
    links, joints = len(motion["length"]), len(motion["angle"])
    torque = motion["torque"] if joints else np.zeros((0, len(motion.time)))
    center = motion["center_of_mass"]
    return {
        "time": motion.time,
        "x": motion["position"][::2],
        "y": motion["position"][1::2],
        "heading": np.unwrap(motion["heading"], axis=1),
        "speed": motion["speed"],
        "resting": resting_masses(motion).astype(float),
        "ground_x": ground[::2],
        "ground_y": ground[1::2],
        "length": motion["length"],
        "input": motion["input"],
        **({"angle": motion["angle"], "torque": torque} if joints else {}),
        "power": motion["power"].reshape(links + joints, -1),
        "center_x": center[0],
        "center_y": center[1],
        "energy": motion["energy"][0],
        **{f"work_{name}": done for name, done in _works(motion).items()},
        **event_arrays([motion], several=False),
    }


def _checks(
    scalars: dict[str, Any], second: Recheck | None, tolerance: Tolerance
) -> Iterator[Check]:
    if second:
        yield second.check.check
    if second and second.stepped:
        yield Check(
            "second route, order",
            second.stepped.fine / max(second.stepped.coarse, _NOISE),
            _ORDER,
            "the second route does not come nearer at its order; a motion this sensitive is not "
            "to be trusted",
        )
    error = scalars["energy_error"]
    yield Check(
        "energy balance", error, accepted_error(tolerance),
        f"energies do not balance, by {error:.2g} of their size",
    )  # fmt: skip
    yield Check(
        "joints", scalars["angle_max"], _FOLDED,
        "a joint folds, where its angle is not told from its opposite; write a larger "
        "worm.bending_stiffness or smaller actuation.torque",
    )  # fmt: skip
