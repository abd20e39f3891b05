"""Motions that constraints determine: phases of a stroke, displacement, singular shapes."""

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

_SINGULAR_LOOKS = 64  # samples between two breaks, in search of singular shapes


@dataclass(frozen=True)
class Phase:
    """Constraints until a phase of the stroke, from the end of the previous ones.

    Parameters
    ----------
    until : float
        Phase of the stroke, at most 1.
    constraints : Constraints
        The constraints.

    Examples
    --------
    >>> Phase(0.5, Constraints(pins=(2,), skids=(0,))).until
    0.5
    """

    until: float
    constraints: Constraints


@dataclass(frozen=True, eq=False)
class KinematicMotion:
    """Result of `kinematic_motion`: the velocity follows from shape and constraints.

    Parameters
    ----------
    shape : Shape
        The body.
    stroke : Stroke
        Its shape over a phase.
    phases : tuple of Phase
        Constraints over the stroke.
    course : Travel
        Its pose over the stroke.
    condition : float
        Largest condition number of the constraints over the stroke.
    worst_phase : float
        Phase of that condition number.
    contradiction : float
        Largest residual velocity of a constraint, over the fastest one from the shape alone.
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
        """x, y and angle of the frame after one stroke, in the frame at its start, (3,)."""
        return self.course.displacement

    def held_at(self, tau: float) -> Constraints:
        """Return the constraints just after a phase."""
        return self.phases[_which(self.phases, np.array([tau]))[0]].constraints

    def points(self, tau: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return places (m, n, 2) of the masses at phases (m,), with the frame at poses (m, 3)."""
        at = kinematics_at(self.shape, self.stroke.at(tau)[0])
        return poses[:, None, :2] + rotate(poses[:, None, 2], at.points)

    def repeated(self, times: int) -> np.ndarray:
        """Return poses (times + 1, 3) of the frame before the first stroke and after each."""
        poses = [np.zeros(3)]
        for _ in range(times):
            poses.append(compose(poses[-1], self.displacement))
        return np.array(poses)


def kinematic_motion(
    shape: Shape, stroke: Stroke, phases: Constraints | Sequence[Phase]
) -> KinematicMotion:
    """Return the motion of a body from the change of its shape and its constraints.

    Theory: docs/theory-planar.md, section 7.

    Parameters
    ----------
    shape : Shape
        The body.
    stroke : Stroke
        Its shape over a phase; the result does not depend on the pace.
    phases : Constraints or sequence of Phase
        Constraints for the whole stroke, or until phases, the last of which is 1.

    Returns
    -------
    KinematicMotion
        Its displacement is that of the frame at the head per stroke.

    Raises
    ------
    ArgumentError
        If phases do not ascend to 1, a mass does not exist, or the stroke is of another body.
    SolveError
        If a shape of the stroke is singular, or constraints contradict one another; the message
        names the shape.

    Notes
    -----
    Two pins hold at once only while their distance is constant. A pin a and a skid b are singular
    if the heading of b is perpendicular to the line from a to b. Three skids are singular if their
    normals meet in one point or are parallel. The condition number is based on velocities of the
    masses' mean place, and on rotation times their mean distance from it, so it does not depend on
    the frame.

    Examples
    --------
    The tail is pinned, the head has a skid; straight links that stretch push it forward.

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
        raise ArgumentError(f"phases must ascend from above 0 to 1, not {ends[1:].tolist()}")
    if stroke.n_s != shape.s.numel():
        raise ArgumentError(
            f"the stroke has {stroke.n_s} variables, but the body has {shape.s.numel()}"
        )
    for part in parts:
        part.constraints.check(shape)
    return parts


def _which(parts: Sequence[Phase], tau: np.ndarray) -> np.ndarray:
    """Return the index of the phase of each of m phases of the stroke, (m,)."""
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
    """Return the largest condition number and its phase; refuse singular shapes."""
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
    """Return where between a and b a function (m,) -> (m,) is least, and its value."""
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
