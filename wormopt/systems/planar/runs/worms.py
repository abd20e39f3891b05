"""Models of the worms of kind ``planar-motion``, built from scenes."""

from __future__ import annotations

import numpy as np

from wormopt.errors import SceneError
from wormopt.model.model import Model
from wormopt.study.numerics import SmoothContact
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.planar.body.obstacles import Disc, Wall
from wormopt.systems.planar.body.strokes import Harmonics
from wormopt.systems.planar.dynamics.chain import chain_places, planar_chain
from wormopt.systems.planar.dynamics.motion import swing
from wormopt.systems.planar.dynamics.standing import Yielding, gaps_at_start, let_give_way
from wormopt.systems.planar.runs.ground import ground_of
from wormopt.systems.planar.scenes.motion import PlanarMotionScene, Swinging
from wormopt.systems.planar.scenes.standing import Standing, StandingDisc


def build_planar(scene: Scene[PlanarMotionScene], *, stiffer: float = 1.0) -> Model:
    """Return the model of the worm with its actuators; obstacles may be `stiffer` by a factor.

    Raises SceneError if a mass starts in an obstacle.
    """
    table = scene.table
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
        obstacles=[_obstacle(each) for each in table.obstacles],
        position=places,
        velocity=_velocities(table, places),
        length_nominal=float(np.mean(lengths)),
        time_nominal=table.actuation.period if table.actuation else table.time.end,
    )
    if table.obstacles:
        _refuse_overlap(scene, model)
        stiffness = stiffer * (table.wall_stiffness or 0.0)
        v_reg = table.contact.v_reg if isinstance(table.contact, SmoothContact) else np.inf
        model = let_give_way(model, Yielding(stiffness, float(mass.max()), v_reg))
    if table.actuation is None:
        return model
    told = {"input": (table.actuation.force, links), "torque": (table.actuation.torque, joints)}
    courses = {name: _harmonics(given, count) for name, (given, count) in told.items() if given}
    return swing(model, table.actuation.period, courses)


def _harmonics(table: Swinging, count: int) -> Harmonics:
    """Return the harmonics of `count` values; missing rows are 0."""
    most = max(len(table.cosine), len(table.sine))
    parts = np.zeros((2, most, count))
    for part, rows in zip(parts, (table.cosine, table.sine), strict=True):
        part[: len(rows)] = np.reshape(rows, (len(rows), count))
    return Harmonics(np.array(table.mean or (0.0,) * count), *parts)


def _turned(angle: float, rows: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return rows @ np.array([[c, s], [-s, c]])


def _weights(table: PlanarMotionScene) -> np.ndarray:
    """Return the weight of each mass and its half rods along the slope."""
    worm = table.worm
    weight = np.array(per(worm.mass, worm.links + 1))
    if worm.rod_mass is not None:
        half = np.array(per(worm.rod_mass, worm.links)) / 2
        weight = weight + np.append(half, 0.0) + np.append(0.0, half)
    down = worm.standard * np.sin(worm.slope) if worm.slope else 0.0
    return np.stack([-down * weight, 0.0 * weight], axis=1)


def _velocities(table: PlanarMotionScene, places: np.ndarray) -> np.ndarray:
    """Return the velocities of all masses: a common one and a rotation about the mass centre."""
    worm, start = table.worm, table.start
    weight = np.array(per(worm.mass, worm.links + 1))
    if worm.rod_mass is not None:
        half = np.array(per(worm.rod_mass, worm.links)) / 2
        weight = weight + np.append(half, 0.0) + np.append(0.0, half)
    arms = places - weight @ places / weight.sum()
    left = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    return np.array(start.velocity) + start.turning * left


def _obstacle(table: Standing) -> Disc | Wall:
    if isinstance(table, StandingDisc):
        x, y = table.centre
        return Disc((x, y), table.radius, table.friction)
    x, y = table.point
    return Wall((x, y), table.angle, table.friction)


def _refuse_overlap(scene: Scene[PlanarMotionScene], worm: Model) -> None:
    for k, row in enumerate(gaps_at_start(worm)):
        i = int(np.argmin(row))
        if not row[i] > 0:
            told = f"mass {i} starts within it, {-row[i]:.3g} deep; move it, or start.tail"
            raise SceneError(scene.name, [(f"obstacles[{k}]", told)])
