"""Play an exported gait in MuJoCo, without a window, and compare its way with exact contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.exports import mjcf
from wormopt.exports.robot import robot_of
from wormopt.result import Result


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion in MuJoCo.

    Parameters
    ----------
    step : float
        Time step.
    time : ndarray, shape (m,)
        Times of all steps.
    position : ndarray, shape (m, masses, 2)
        Places of the masses.
    ways : ndarray, shape (cycles, 3)
        Displacement ahead, to the left and angle of every cycle, in the frame of the head at its
        start.
    exact : ndarray, shape (3,), or None
        The same with exact contact, of a cycle that repeats.
    """

    step: float
    time: np.ndarray
    position: np.ndarray
    ways: np.ndarray
    exact: np.ndarray | None

    @property
    def error(self) -> float:
        """Distance between the ends of the last cycle here and with exact contact."""
        if self.exact is None:
            raise ArgumentError("the result has no way per cycle; compare positions over time")
        return float(np.hypot(*(self.ways[-1] - self.exact)[:2]))


def play(result: Result, step: float = 0.001, cycles: int = 2) -> Playback:
    """Run the MJCF export of a result in MuJoCo.

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
        Motion, and ways per cycle beside those of exact contact.

    Raises
    ------
    ArgumentError
        If there is no such export, or MuJoCo is not installed.
    SolveError
        If MuJoCo diverges.
    """
    try:
        import mujoco  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ArgumentError("MuJoCo is not installed; run: pip install 'wormopt[mujoco]'") from None
    robot = robot_of(result)
    (text,) = mjcf.make(robot, "worm", step).values()
    model = mujoco.MjModel.from_xml_string(text.decode())
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    bodies = [model.body(f"mass_{i}").id for i in range(len(robot.mass))]
    mujoco.mj_kinematics(model, data)
    places, poses = [data.xpos[bodies, :2].copy()], [data.qpos[:3].copy()]
    for _ in range(cycles):
        for ctrl in model.key_ctrl:
            data.ctrl[:] = ctrl
            mujoco.mj_step(model, data)
            places.append(data.xpos[bodies, :2].copy())
        poses.append(data.qpos[:3].copy())
    if warned := sum(warning.number for warning in data.warning):
        raise SolveError(f"MuJoCo warns {warned} times of its own steps", "take a smaller step")
    if not robot.planar:  # the joints behind the first are links
        poses = [np.array([pose[0], 0.0, 0.0]) for pose in poses]
    return Playback(
        model.opt.timestep,
        model.opt.timestep * np.arange(len(places)),
        np.array(places),
        np.array([_way(a, b) for a, b in pairwise(poses)]),
        None if robot.way is None else np.array(robot.way),
    )


def _way(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    c, s = math.cos(before[2]), math.sin(before[2])
    x, y, turn = after - before
    return np.array([c * x + s * y, c * y - s * x, turn])
