"""Play an exported gait in MuJoCo, without a window, and compare it with exact contact."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.exports import mjcf
from wormopt.exports.robot import robot_of
from wormopt.result import Result


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion in MuJoCo."""

    step: float  # time step in s
    time: np.ndarray  # (m,) times of all steps
    position: np.ndarray  # (m, masses, 2) places of the masses
    # (cycles, 3) displacement ahead, to the left and angle of every cycle, in the frame of the head
    # at its start
    displacements: np.ndarray
    # (3,) displacement per cycle with exact contact, where the result has it
    exact: np.ndarray | None

    @property
    def error(self) -> float:
        """Distance between the ends of the last cycle here and with exact contact."""
        if self.exact is None:
            raise ArgumentError(
                "the result has no displacement per cycle; compare positions over time"
            )
        return float(np.hypot(*(self.displacements[-1] - self.exact)[:2]))


def play(result: Result, step: float = 0.001, cycles: int = 2) -> Playback:
    """Run the MJCF export of a result in MuJoCo, in the plane with `friction_by_direction`.

    Parameters
    ----------
    result : Result
        A result that can be exported as MJCF.
    step : float, optional
        Largest time step; a cycle has a whole number of steps.
    cycles : int, optional
        Number of cycles.

    Returns
    -------
    Playback
        Motion, and displacements per cycle beside that of exact contact.

    Raises
    ------
    ArgumentError
        If the result cannot be exported, or MuJoCo is not installed.
    SolveError
        If MuJoCo diverges.
    """
    mujoco = _mujoco()
    robot = robot_of(result)
    (text,) = mjcf.make(robot, "worm", step).values()
    model = mujoco.MjModel.from_xml_string(text.decode())
    data, rub = mujoco.MjData(model), friction_by_direction(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    bodies = [model.body(f"mass_{i}").id for i in range(len(robot.mass))]
    mujoco.mj_forward(model, data)
    places, poses = [data.xpos[bodies, :2].copy()], [data.qpos[:3].copy()]
    for _ in range(cycles):
        for ctrl in model.key_ctrl:
            data.ctrl[:] = ctrl
            rub(data)
            mujoco.mj_step(model, data)
            places.append(data.xpos[bodies, :2].copy())
        poses.append(data.qpos[:3].copy())
    if warned := sum(warning.number for warning in data.warning):
        raise SolveError(f"MuJoCo gave {warned} warnings", "use a smaller step")
    if not robot.planar:  # the joints behind the first are links
        poses = [np.array([pose[0], 0.0, 0.0]) for pose in poses]
    return Playback(
        model.opt.timestep,
        model.opt.timestep * np.arange(len(places)),
        np.array(places),
        np.array([_displacement(a, b) for a, b in pairwise(poses)]),
        None if robot.displacement is None else np.array(robot.displacement),
    )


def friction_by_direction(model: Any) -> Callable[[Any], None]:
    """Let friction of an exported planar worm differ ahead and back exactly.

    It takes the place of the constant pushes in the file, which are exact along the heading only.

    Parameters
    ----------
    model : mujoco.MjModel
        Model of the file; its pushes are set to 0.

    Returns
    -------
    callable
        Function of the MjData, to be called before every step. It sets the friction of each foot by
        the direction of its velocity. Feet at rest creep against the force that holds them, so the
        direction is known there, too.
    """
    mujoco = _mujoco()
    feet: list[tuple[int, int, np.ndarray]] = []
    for i in range(model.nsite):
        pair, names = model.pair(f"ground_{i}"), (model.actuator(k).name for k in range(model.nu))
        if f"push_{i}" in names:
            push, foot = model.actuator(f"push_{i}"), model.joint(f"foot_{i}")
            press = -foot.stiffness[0] * model.qpos_spring[foot.qposadr[0]]
            share = push.biasprm[0] / press
            push.biasprm[0] = 0.0
            both = pair.friction[0] + share, pair.friction[0] - share
            feet.append((model.site(f"foot_{i}").id, pair.id, np.array(both)))
    velocity = np.zeros(6)

    def rub(data: Any) -> None:
        for site, pair, (back, ahead) in feet:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 1)
            model.pair_friction[pair, 0] = ahead if velocity[3] >= 0 else back

    return rub


def _mujoco() -> Any:
    try:
        import mujoco  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ArgumentError("MuJoCo is not installed; run: pip install 'wormopt[mujoco]'") from None
    return mujoco


def _displacement(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    c, s = math.cos(before[2]), math.sin(before[2])
    x, y, turn = after - before
    return np.array([c * x + s * y, c * y - s * x, turn])
