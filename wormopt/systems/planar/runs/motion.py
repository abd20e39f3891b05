"""Runs of kind ``planar-motion``: simulation of a worm of masses and springs in the plane."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.planar.dynamics.motion import (
    closed_link,
    energy_error,
    measure_works,
    resting_masses,
    watch_links,
)
from wormopt.systems.planar.dynamics.stepping import Stepped, longest_way, step_again, stepper_of
from wormopt.systems.planar.runs.worms import build_planar
from wormopt.systems.planar.scenes.motion import PlanarMotionScene
from wormopt.systems.shared.proof import (
    CrossCheck,
    accepted_error,
    cross_check,
    motion_facts,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import event_arrays, simulate_whole

_FOLDED = 3.1  # a joint angle above this counts as folded
_CLOSED = 1e-3  # a link shorter than this share of the usual length has closed up
# Softening of obstacles, and the accepted change of the end: estimates the error to rigid ones.
_SOFTER, _YIELDING = 0.25, 0.02
# A mass pressed against a compliant obstacle slips as slowly as the forces change, and its
# direction turns ever faster. Below this share of the usual speed it stops. The paths change far
# less by this than by compliant obstacles. Other slow slip may still cost many steps.
_STOP_AT_OBSTACLES, _STEPS_AT_OBSTACLES = 1e-7, 300_000
# Accepted error of the second route's end over the longest path if its steps are of first order,
# and the accepted part of it at a quarter of the step (a quarter), unless that is noise: single
# stops and releases that fall into one step or the next cause as much.
_STEPPED, _ORDER, _NOISE = 0.01, 0.5, 1e-6


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarMotionScene], report: Report) -> Result:
    """Simulate the worm; status "failed" if the second route or the energy balance disagrees.

    Raises SolveError if the motion ends early, Interrupted if the user stops it, both with the
    motion computed so far as partial result.
    """
    table, clock = scene.table, time.perf_counter()
    plain = build_planar(scene)
    built = time.perf_counter()
    tolerance = _tolerance_of(table)
    motion = _follow(scene, plain, tolerance, report)
    simulated = time.perf_counter()
    try:
        second = _recheck(scene, plain, motion, report)
    except KeyboardInterrupt:
        why = "interrupted before the second route was finished"
        raise Interrupted(_unfinished(scene, motion, why)) from None
    check = second and second.check
    scalars = _scalars(scene, motion, second)
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
        attributes=_attributes(scene, motion),
    )


def models_of(scene: Scene[PlanarMotionScene]) -> dict[str, Model]:
    """Return the model that is simulated."""
    return {"": build_planar(scene)}


def _follow(
    scene: Scene[PlanarMotionScene], plain: Model, tolerance: Tolerance, report: Report
) -> Trajectory:
    """Simulate the worm; raises SolveError or Interrupted with a partial Result."""
    table = scene.table
    measured = measure_works(plain, _usual_work(table))
    watched = watch_links(measured, _CLOSED * plain.x[0].nominal)
    try:
        motion = simulate_whole(
            watched,
            table.time.end,
            table.time.samples,
            treatment_of(table.contact),
            tolerance,
            report,
        )
    except SolveError as error:
        partial = _unfinished(scene, error.partial, error.reason)
        advice = error.suggestion
        if table.obstacles and error.code == "too_many_steps":
            advice = "masses stop too slowly at obstacles; write a smaller obstacle_stiffness"
        raise SolveError(error.reason, advice, partial, error.code) from None
    except Interrupted as stop:
        why = f"interrupted at t = {stop.partial.end_time:.6g}"
        raise Interrupted(_unfinished(scene, stop.partial, why)) from None
    link = closed_link(motion)
    if link:
        why = f"{link} closes up at t = {motion.end_time:.6g} and has no direction there"
        advice = (
            "write less actuation.force, or a larger worm.stiffness, worm.damping or "
            "worm.bending_stiffness"
        )
        raise SolveError(why, advice, _unfinished(scene, motion, why), "link_closed")
    return motion


def _tolerance_of(table: PlanarMotionScene) -> Tolerance:
    """Return the tolerance of the scene, with a least speed among obstacles."""
    tolerance = tolerance_of(table.tolerance)
    if not table.obstacles:
        return tolerance
    steps = min(tolerance.max_steps, _STEPS_AT_OBSTACLES)
    return replace(tolerance, max_steps=steps, stop=_STOP_AT_OBSTACLES)


def _usual_work(table: PlanarMotionScene) -> float:
    lengths = np.mean(per(table.worm.rest_length, table.worm.links))
    period = table.actuation.period if table.actuation else table.time.end
    return float(np.mean(per(table.worm.mass, table.worm.links + 1)) * (lengths / period) ** 2)


# -- the second route ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Recheck:
    """Results of the second route."""

    check: CrossCheck
    stepped: Stepped | None = None  # if it is time stepping
    wall_error: float | None = None  # if there are obstacles


def _recheck(
    scene: Scene[PlanarMotionScene], model: Model, motion: Trajectory, report: Report
) -> Recheck | None:
    """Repeat the motion by Moreau-Jean steps; where they do not apply, by another integrator."""
    recheck, obstacles = scene.table.tolerance.recheck, scene.table.obstacles
    if not recheck:
        return None
    tolerance = _tolerance_of(scene.table)
    exact = isinstance(motion.system.treatment, Exact) and not obstacles
    stepper = stepper_of(model) if exact else None
    if stepper is None:
        check = cross_check(model, motion, tolerance, recheck=recheck, report=report)
        softness = _softness(scene, motion, tolerance, report) if check and obstacles else None
        return check and Recheck(check, wall_error=softness)
    name, shared = "Moreau-Jean time stepping", "the model"
    try:
        found = step_again(stepper, motion, report=report)
    except SolveError as error:
        return Recheck(CrossCheck(name, None, _STEPPED, shared, error.reason))
    return Recheck(CrossCheck(name, found.fine, _STEPPED, shared), found)


def _softness(
    scene: Scene[PlanarMotionScene], motion: Trajectory, tolerance: Tolerance, report: Report
) -> float:
    """Return the change of the end among softer obstacles, over the longest path of a mass."""
    softer = build_planar(scene, stiffer=_SOFTER)
    treatment = motion.system.treatment
    end = motion.end_time
    again = simulate(
        softer, end, contact=treatment, times=[end], tolerance=tolerance, report=report
    )
    places = motion["position"]
    off = np.abs(again["position"][:, -1] - places[:, -1]).max()
    return float(off / longest_way(places, softer.x[0].nominal))


# -- results -------------------------------------------------------------------------------------


def _unfinished(scene: Scene[PlanarMotionScene], motion: Trajectory, why: str) -> Result:
    signals = _signals(motion) if len(motion.time) else {}
    return conclude(scene, {}, signals, attributes=_attributes(scene, motion)).failed(why)


def _attributes(scene: Scene[PlanarMotionScene], motion: Trajectory) -> dict[str, Any]:
    found: dict[str, Any] = {"contacts": [contact.name for contact in motion.system.model.contacts]}
    if scene.table.obstacles:
        found["obstacles"] = [msgspec.to_builtins(each) for each in scene.table.obstacles]
    return found


def _scalars(
    scene: Scene[PlanarMotionScene], motion: Trajectory, second: Recheck | None
) -> dict[str, Any]:
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
        **_pressed(scene, motion),
        "wall_error": second and second.wall_error,
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
    if "wall_work" in motion.names:
        done["wall"] = motion["wall_work"][0]
    return {
        "actuator": done.pop("input") + done.pop("torque"),
        **done,
        "pull": motion["pull_work"][0],
    }


def _pressed(scene: Scene[PlanarMotionScene], motion: Trajectory) -> dict[str, float]:
    """Return forces and depths at obstacles."""
    if not scene.table.obstacles:
        return {}
    largest = float(motion["wall_force"].max())
    return {
        "wall_force_max": largest,
        "wall_depth": max(-float(motion["wall_gap"].min()), 0.0),
    }


def _signals(motion: Trajectory) -> dict[str, Any]:
    ground = motion["ground_force"]
    links, joints = len(motion["length"]), len(motion["angle"])
    torque = motion["torque"] if joints else np.zeros((0, len(motion.time)))
    center, walls = motion["center_of_mass"], "wall_work" in motion.names
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
        **({"wall_force": _by_mass(motion["wall_force"], len(ground) // 2)} if walls else {}),
        "center_x": center[0],
        "center_y": center[1],
        "energy": motion["energy"][0],
        **{f"work_{name}": done for name, done in _works(motion).items()},
        **event_arrays([motion], several=False),
    }


def _by_mass(rows: np.ndarray, masses: int) -> np.ndarray:
    """Sum rows (obstacles x masses, m) over obstacles to (masses, m)."""
    return rows.reshape(-1, masses, rows.shape[1]).sum(axis=0)


def _checks(
    scalars: dict[str, Any], second: Recheck | None, tolerance: Tolerance
) -> Iterator[Check]:
    if second:
        yield second.check.check
    if second and second.stepped:
        yield Check(
            "second route, order",
            second.stepped.fine / max(second.stepped.coarse, second.stepped.rounding, _NOISE),
            _ORDER,
            "the second route does not converge at its order; a motion this sensitive is not "
            "reliable",
        )
    if second and second.wall_error is not None:
        yield Check(
            "obstacles",
            second.wall_error,
            _YIELDING,
            "the motion depends on the compliance of obstacles; write a larger obstacle_stiffness "
            "or a shorter time.end",
        )
    error = scalars["energy_error"]
    yield Check(
        "energy balance", error, accepted_error(tolerance),
        f"energy is not balanced; the error is {error:.2g}, relative to the works",
    )  # fmt: skip
    yield Check(
        "joints", scalars["angle_max"], _FOLDED,
        "a joint folds, where its angle and the opposite angle coincide; write a larger "
        "worm.bending_stiffness or smaller actuation.torque",
    )  # fmt: skip
