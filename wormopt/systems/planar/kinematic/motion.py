"""Motions that constraints determine: phases of a stroke, the way in a stroke, singular shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.se2 import compose, rotate
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.body.travel import Travel, travel
from wormopt.systems.planar.kinematic.constraints import (
    SINGULAR,
    Constraints,
    Held,
    held,
    kinematics_at,
    refuse_contradiction,
    singular_error,
)

_SINGULAR_LOOKS = 64  # looks between two breaks, in search of singular shapes


@dataclass(frozen=True)
class Phase:
    """Constraints that hold up to a phase of the stroke, from where those before end.

    Parameters
    ----------
    until : float
        Phase of the stroke, at most 1.
    constraints : Constraints
        What holds.

    Examples
    --------
    >>> import wormopt as wo
    >>> hold = wo.planar.Phase(0.5, wo.planar.Constraints(pins=(2,), skids=(0,)))
    >>> hold.until, hold.constraints.pins
    (0.5, (2,))
    """

    until: float
    constraints: Constraints


@dataclass(frozen=True, eq=False)
class KinematicMotion:
    """A body whose velocity follows from its shape and what is held.

    Parameters
    ----------
    shape : Shape
        The body.
    stroke : Stroke
        How its shape goes round.
    phases : tuple of Phase
        What is held when.
    course : Travel
        Its pose over the stroke.
    condition : float
        Largest condition number of the constraints over the stroke.
    worst_phase : float
        Where that is.
    contradiction : float
        Largest velocity left of a constraint, in units of the fastest that shapes alone would give.
    """

    shape: Shape
    stroke: Stroke
    phases: tuple[Phase, ...]
    course: Travel
    condition: float
    worst_phase: float
    contradiction: float

    @property
    def displacement(self) -> np.ndarray:
        """x, y and angle by which a stroke moves the frame of the body, told in it, (3,)."""
        return self.course.displacement

    def held_at(self, tau: float) -> Constraints:
        """What holds just after a phase."""
        return self.phases[_which(self.phases, np.array([tau]))[0]].constraints

    def points(self, tau: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Places (m, n, 2) of the masses at phases (m,), with the frame at poses (m, 3)."""
        at = kinematics_at(self.shape, self.stroke.at(tau)[0])
        return poses[:, None, :2] + rotate(poses[:, None, 2], at.points)

    def repeated(self, times: int) -> np.ndarray:
        """Poses (times + 1, 3) of the frame before the first stroke and after each."""
        poses = [np.zeros(3)]
        for _ in range(times):
            poses.append(compose(poses[-1], self.displacement))
        return np.array(poses)


def kinematic_motion(
    shape: Shape, stroke: Stroke, phases: Constraints | Sequence[Phase]
) -> KinematicMotion:
    """Move a body by the change of its shape and by what holds it to the ground.

    Parameters
    ----------
    shape : Shape
        The body.
    stroke : Stroke
        How its shape goes round once; pace and timing do not matter.
    phases : Constraints or sequence of Phase
        What holds all the time, or up to which phase; the last one up to 1.

    Returns
    -------
    KinematicMotion
        Its displacement is that of the frame at the head in one stroke.

    Raises
    ------
    ArgumentError
        If phases do not rise to 1, a mass is not there, or the stroke is of another body.
    SolveError
        If a shape on the way is singular, or constraints contradict one another; the shape is
        named.

    Notes
    -----
    Two pins hold at once only while their distance stays. A pin a and a skid b are singular where
    the heading of b is perpendicular to the way from a to it, three skids where their normals meet
    in one point or are parallel. The condition number refers to velocities of the middle of the
    masses, and to turning times their mean distance from it, so that it does not hang on the frame.

    Examples
    --------
    The tail is pinned, the head has a skid; straight links that stretch push it ahead.

    >>> import wormopt as wo
    >>> from wormopt.systems.planar.kinematic.motion import kinematic_motion
    >>> worm = wo.planar.chain_shape(2)
    >>> there = wo.planar.Polygon([[1.0, 1.0, 0.0], [1.5, 1.0, 0.0]])
    >>> hold, pull = Constraints(pins=(2,), skids=(0,)), Constraints(pins=(0,), skids=(2,))
    >>> motion = kinematic_motion(worm, there, [Phase(0.5, hold), Phase(1.0, pull)])
    >>> motion.displacement.round(12).tolist()
    [0.5, 0.0, 0.0]
    """
    parts = _checked(shape, stroke, phases)
    breaks = np.union1d(stroke.breaks, [part.until for part in parts])
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-14])]
    condition, where = _worst(shape, stroke, parts, breaks)
    worst = [0.0]

    def twists(tau: np.ndarray) -> np.ndarray:
        found, _ = _held(shape, stroke, parts, tau, refuse=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = found.contradiction / max(float(found.scale.max()), 1e-300)
        worst[0] = max(worst[0], float(np.nan_to_num(ratio).max()))
        return found.twist

    course = travel(twists, breaks)
    return KinematicMotion(shape, stroke, parts, course, condition, where, worst[0])


def _checked(
    shape: Shape, stroke: Stroke, phases: Constraints | Sequence[Phase]
) -> tuple[Phase, ...]:
    parts = (Phase(1.0, phases),) if isinstance(phases, Constraints) else tuple(phases)
    ends = np.array([0.0, *(part.until for part in parts)])
    if len(parts) == 0 or (np.diff(ends) <= 0).any() or ends[-1] != 1.0:
        raise ArgumentError(f"phases must rise from above 0 to 1, not {ends[1:].tolist()}")
    if stroke.n_s != shape.s.numel():
        raise ArgumentError(f"a stroke of {stroke.n_s} variables for {shape.s.numel()} of the body")
    for part in parts:
        part.constraints.check(shape)
    return parts


def _which(parts: Sequence[Phase], tau: np.ndarray) -> np.ndarray:
    """Number of the phase that each of m phases of the stroke lies in, (m,)."""
    ends = np.array([part.until for part in parts])
    return np.minimum(np.searchsorted(ends, tau, side="right"), len(parts) - 1)


def _held(
    shape: Shape, stroke: Stroke, parts: Sequence[Phase], tau: np.ndarray, *, refuse: bool = False
) -> tuple[Held, np.ndarray]:
    """Velocities by the phase, (m,); and the shapes."""
    s, ds = stroke.at(tau)
    which = _which(parts, tau)
    size = (len(tau),)
    all_of = Held(np.zeros((*size, 3)), np.zeros(size), np.zeros(size), np.zeros(size))
    for k in np.unique(which):
        mine = which == k
        found = held(kinematics_at(shape, s[mine]), ds[mine], parts[k].constraints)
        if refuse:
            refuse_contradiction(shape, s[mine], found, parts[k].constraints)
        for name in ("twist", "condition", "contradiction", "scale"):
            getattr(all_of, name)[mine] = getattr(found, name)
    return all_of, s


def _worst(
    shape: Shape, stroke: Stroke, parts: Sequence[Phase], breaks: np.ndarray
) -> tuple[float, float]:
    """Largest condition number over the stroke, and where; refuses singular shapes."""
    worst, where = 0.0, 0.0
    for a, b in pairwise(breaks):
        part = parts[_which(parts, np.array([(a + b) / 2]))[0]]

        def inverse(tau: np.ndarray, part: Phase = part) -> np.ndarray:
            at = kinematics_at(shape, stroke.at(tau)[0])
            sigma = np.linalg.svd(at.J[:, part.constraints.rows] @ at.scaling, compute_uv=False)
            return sigma[:, -1] / sigma[:, 0]

        tau, least = _least(inverse, a, b)
        if least <= SINGULAR:
            raise singular_error(shape, stroke.at(tau)[0][0], part.constraints)
        if 1 / least > worst:
            worst, where = 1 / least, tau
    return worst, where


def _least(inverse: Callable[[np.ndarray], np.ndarray], a: float, b: float) -> tuple[float, float]:
    """Where between a and b a function (m,) -> (m,) is least, and how small it is."""
    tau = np.linspace(a, b, _SINGULAR_LOOKS + 1)
    value = inverse(tau)
    k = int(np.argmin(value))
    best = float(tau[k]), float(value[k])
    inner = np.flatnonzero((value[1:-1] <= value[:-2]) & (value[1:-1] <= value[2:])) + 1
    slope = np.maximum(value[inner - 1], value[inner + 1]) - value[inner]
    inner = inner[value[inner] < 2 * slope]  # others cannot come near 0 in between
    for j in inner[np.argsort(value[inner])][:8]:
        found: Any = minimize_scalar(
            lambda t: float(inverse(np.array([t]))[0]),
            bounds=(tau[j - 1], tau[j + 1]),
            method="bounded",
            options={"xatol": 1e-13},
        )
        if found.fun < best[1]:
            best = float(found.x), float(found.fun)
    return best
