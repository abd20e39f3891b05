"""Planar stops in MuJoCo, where it is installed: time steps, contacts of a rigid-body engine.

Points are small spheres on a plane that slide along x, y and z. Two choices matter. MuJoCo couples
slip to the normal direction: a sliding contact is pushed up in proportion to its friction
coefficient. A weight ten thousand times the friction makes that small, and the coefficients as
small. And contacts are soft; they are made as stiff as a time step allows, two steps in `solref`.
With both, and elliptic cones, the error is in proportion to the time step. As MuJoCo comes (its
softness, weight 9.81) it is not. Impedance stays at 0.9: feet of one body share the weight by it.
"""

from __future__ import annotations

import importlib
import math
from copy import copy
from functools import cache
from typing import Any

import numpy as np

from tests.benchmarks.planar_rivals import Answer, Solver
from tests.benchmarks.planar_tasks import TRIPOD_ANGLES, Stop

_WEIGHT, _RADIUS, _REST = 1e4, 0.1, 1e-6  # of a unit mass; of the spheres; speed of rest
_SETTLE = 2000  # steps before the start


def by_mujoco(task: Stop, *, tuned: bool = True) -> Solver:
    """MuJoCo, asked for a time step; `tuned`: made as exact as its options allow."""
    mujoco: Any = importlib.import_module("mujoco")  # without types, where it is installed

    @cache
    def settled(step: float) -> tuple[Any, Any]:
        model = mujoco.MjModel.from_xml_string(_scene(task, step, tuned))
        data = mujoco.MjData(model)
        for _ in range(_SETTLE):
            mujoco.mj_step(model, data)
        return model, data

    def run(step: float) -> Answer:
        model, data = settled(step)
        return _stepped(mujoco, model, copy(data), task, step)

    return run


def _stepped(mujoco: Any, model: Any, data: Any, task: Stop, step: float) -> Answer:
    worm, rested = task.worm, math.nan
    data.time = 0.0
    if worm is None:  # the tripod: x, y, z, angle
        plane = np.array([0, 1, 3])
        data.qpos[plane], data.qvel[plane] = 0.0, [1.0, 0.0, 1.0]
    else:
        plane = np.array([3 * i + k for i in range(worm.n) for k in (0, 1)])
        data.qpos[plane], data.qvel[plane] = 0.0, worm.velocity.ravel()
        if worm.load is not None:
            data.xfrc_applied[1:, :2] = worm.load
    for k in range(round(task.span / step)):
        if worm is not None and worm.pairs:
            data.ctrl[:] = worm.drive.at(k * step)
        mujoco.mj_step(model, data)
        if math.isnan(rested) and np.abs(data.qvel[plane]).max() < _REST:
            rested = (k + 1) * step
    begin = np.zeros(3) if worm is None else worm.place.ravel()
    return begin + data.qpos[plane], rested


def _scene(task: Stop, step: float, tuned: bool) -> str:
    worm = task.worm
    weight = _WEIGHT if tuned else 9.81
    # a fixed frame of the plane has its first tangent along y, its second along -x
    bodies, pairs, tendons, motors = [], [], [], []
    soft = f'solref="{2 * step} 1" solimp="0.9 0.9 0.001 0.5 2"' if tuned else ""

    def pair(name: str, mass: float, ahead: float, beside: float) -> str:
        cone = f"{beside / (mass * weight)} {ahead / (mass * weight)} 0 0 0"
        return f'<pair geom1="floor" geom2="{name}" condim="3" friction="{cone}" {soft}/>'

    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    if worm is None:
        points = [(math.cos(a), math.sin(a)) for a in TRIPOD_ANGLES]
        spheres = "".join(
            f'<geom name="g{i}" type="sphere" size="{_RADIUS}" pos="{x} {y} 0" mass="0"/>'
            for i, (x, y) in enumerate(points)
        )
        inertial = '<inertial pos="0 0 0" mass="3" diaginertia="3 3 3"/>'
        turn = '<joint type="hinge" axis="0 0 1"/>'
        bodies.append(f'<body pos="0 0 {_RADIUS}">{inertial}{slides}{turn}{spheres}</body>')
        pairs += [pair(f"g{i}", 1.0, 1.0, 1.0) for i in range(3)]
    else:
        for i in range(worm.n):
            x, y = worm.place[i]
            ball = f'<geom name="g{i}" type="sphere" size="{_RADIUS}" mass="{worm.mass[i]}"/>'
            site = f'<site name="s{i}"/>'
            bodies.append(f'<body pos="{x} {y} {_RADIUS}">{slides}{ball}{site}</body>')
            pairs.append(pair(f"g{i}", worm.mass[i], worm.forward[i], worm.sideways[i]))
        for k, (i, j) in enumerate(worm.pairs):
            numbers = (
                f'stiffness="{worm.stiffness[k]}" damping="{worm.damping[k]}" '
                f'springlength="{worm.length[k]}"'
            )
            ends = f'<site site="s{i}"/><site site="s{j}"/>'
            tendons.append(f'<spatial name="t{k}" {numbers}>{ends}</spatial>')
            motors.append(f'<motor tendon="t{k}"/>')
    best = (
        'impratio="100" tolerance="1e-15" iterations="200" ls_iterations="200" ls_tolerance="1e-6"'
    )
    return (
        f'<mujoco><option timestep="{step}" gravity="0 0 -{weight}" cone="elliptic" '
        f'integrator="implicitfast" {best if tuned else ""}/>'
        f'<worldbody><geom name="floor" type="plane" size="9 9 1" contype="0" conaffinity="0"/>'
        f"{''.join(bodies)}</worldbody><contact>{''.join(pairs)}</contact>"
        f"<tendon>{''.join(tendons)}</tendon><actuator>{''.join(motors)}</actuator></mujoco>"
    )
