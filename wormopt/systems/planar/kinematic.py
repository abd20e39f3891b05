"""Motions that pins and skids determine: displacement, singular shapes, loads and work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize_scalar

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.poses import Travel, rotate, travel
from wormopt.systems.planar.shape import Kinematics, Shape, Stroke, kinematics_at

CONSISTENT = 1e-9
"""Accepted contradiction of more than three constraints, relative to the fastest rate."""
SINGULAR = 1e-7
"""Inverse condition number below which a shape is refused."""


@dataclass(frozen=True)
class Constraints:
    """Constraints of a body on the ground: pins and skids.

    Parameters
    ----------
    pins : tuple of int, optional
        Masses that do not move; each removes two velocities.
    skids : tuple of int, optional
        Masses that move only along their heading; each removes one velocity.

    Raises
    ------
    ArgumentError
        If a mass is both pin and skid, is listed twice, or fewer than three velocities are removed.

    Notes
    -----
    A pin and a skid are the least that determines a motion, without a condition on the shape. Two
    pins need a constant distance; more pins and skids need further conditions. These are checked
    when a motion is computed.

    Examples
    --------
    >>> Constraints(pins=(2,), skids=(0,)).count
    3
    """

    pins: tuple[int, ...] = ()
    skids: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("pins", "skids"):
            masses = tuple(sorted(int(mass) for mass in getattr(self, name)))
            object.__setattr__(self, name, masses)
            if len(set(masses)) < len(masses) or (masses and masses[0] < 0):
                raise ArgumentError(f"{name} must be different masses from 0 on, not {masses}")
        if both := set(self.pins) & set(self.skids):
            raise ArgumentError(f"mass {min(both)} is a pin and a skid; leave it out of the skids")
        if self.count < 3:
            raise ArgumentError(f"{self._left()}; give at least a pin and a skid")

    @property
    def count(self) -> int:
        """Number of velocities that they remove; three are needed."""
        return 2 * len(self.pins) + len(self.skids)

    @property
    def rows(self) -> list[int]:
        """Rows of (v_t, v_n) of all masses that are zero, pins first."""
        pinned = [row for mass in self.pins for row in (2 * mass, 2 * mass + 1)]
        return pinned + [2 * mass + 1 for mass in self.skids]

    def check(self, shape: Shape) -> None:
        """Raise ArgumentError if a mass does not exist.

        Parameters
        ----------
        shape : Shape
            The body.
        """
        for name in ("pins", "skids"):
            for mass in getattr(self, name):
                if mass >= shape.n_points:
                    raise ArgumentError(
                        f"{name}: there is no mass {mass}, only 0 to {shape.n_points - 1}"
                    )

    def _left(self) -> str:
        if len(self.pins) == 1:
            return f"the body can turn freely about mass {self.pins[0]}"
        return f"constraints remove {self.count} of three velocities"


@dataclass(frozen=True, eq=False)
class Held:
    """Velocities of a constrained body at m shapes."""

    twist: np.ndarray  # (m, 3)
    condition: np.ndarray  # (m,) of the constraints, independent of units and frame
    contradiction: np.ndarray  # (m,) largest residual velocity of a constraint
    scale: np.ndarray  # (m,) size of the velocities from the shape alone


def held(at: Kinematics, rates: np.ndarray, constraints: Constraints) -> Held:
    """Return the velocity of the body from its rates of shape (m, n_s), by least squares."""
    rows, T = constraints.rows, at.scaling
    C = at.J[:, rows] @ T
    given = -np.einsum("mrs,ms->mr", at.B[:, rows], rates)
    U, sigma, Vt = np.linalg.svd(C, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.einsum("mrk,mr->mk", U, given) / sigma
        z = np.einsum("mkj,mk->mj", Vt, parts)
        condition = sigma[:, 0] / sigma[:, -1]
    left = np.einsum("mrj,mj->mr", C, z) - given
    scale = np.abs(np.einsum("mrs,ms->mr", at.B, rates)).max(axis=1)
    twist = np.einsum("mij,mj->mi", T, z)
    return Held(twist, condition, np.abs(left).max(axis=1), scale)


def refuse_contradiction(
    shape: Shape, s: np.ndarray, found: Held, constraints: Constraints
) -> None:
    """Raise SolveError if constraints contradict one another, at shapes (m, n_s)."""
    with np.errstate(invalid="ignore"):
        off = found.contradiction > CONSISTENT * np.maximum(found.scale, found.scale.max())
    if constraints.count > 3 and off.any():
        worst = int(np.argmax(found.contradiction))
        raise SolveError(
            f"{_words(constraints)} contradict one another at {shape_words(shape, s[worst])}: one "
            f"of them would have to move with velocity {found.contradiction[worst]:.3g}",
            _mend(constraints),
            code="contradiction",
        )


def _mend(constraints: Constraints) -> str:
    if len(constraints.pins) >= 2:
        return "change the shape so that the distance of the pins is constant, or remove a pin"
    return "use three rows only: a pin and a skid, or three skids"


def singular_error(shape: Shape, s: np.ndarray, constraints: Constraints) -> SolveError:
    """Return the error of a shape (n_s) at which constraints do not determine the motion."""
    return SolveError(
        f"{_words(constraints)} do not determine the motion at {shape_words(shape, s)}: "
        f"{_why(shape, s, constraints)}",
        "keep the stroke away from this shape, or constrain other masses",
        code="singular",
    )


def _why(shape: Shape, s: np.ndarray, constraints: Constraints) -> str:
    at = kinematics_at(shape, s[None])
    T = at.scaling[0]
    Vt = np.linalg.svd(at.J[0, constraints.rows] @ T)[2]
    x, y, w = T @ Vt[-1]
    size = 1 / T[2, 2]
    if abs(w) * size < 1e-3 * np.hypot(x, y):
        free = f"it can move along ({x:.3g}, {y:.3g}) of its frame"
    else:
        free = f"it can turn about the point ({-y / w:.3g}, {x / w:.3g}) of its frame"
    if len(constraints.pins) == 1 and len(constraints.skids) == 1:
        a, b = constraints.pins[0], constraints.skids[0]
        free += f", as the heading of mass {b} is perpendicular to the line from mass {a} to it"
    elif not constraints.pins:
        normals = "are parallel" if "move" in free else "meet there"
        free += f", as the normals of all skids {normals}"
    return free


def shape_words(shape: Shape, s: np.ndarray) -> str:
    """Name a shape by its variables."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(shape.names, s, strict=True))


def _words(constraints: Constraints) -> str:
    parts = (("pin", constraints.pins), ("skid", constraints.skids))
    return " and ".join(
        f"{name}{'s' * (len(who) > 1)} {', '.join(map(str, who))}" for name, who in parts if who
    )


_SINGULAR_LOOKS = 64  # samples between two breaks, in search of singular shapes


@dataclass(frozen=True)
class Phase:
    """Constraints that hold from the end of the previous Phase until a phase of the stroke.

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
    contradiction : float
        Largest residual velocity of a constraint, over the fastest one from the shape alone.
    """

    shape: Shape
    stroke: Stroke
    phases: tuple[Phase, ...]
    course: Travel
    condition: float
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
    >>> from wormopt.systems.planar.kinematic import kinematic_motion
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
    condition = _worst(shape, stroke, parts, breaks)
    worst = [0.0]

    def twists(tau: np.ndarray) -> np.ndarray:
        found, _ = _held(shape, stroke, parts, tau, refuse=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = found.contradiction / max(float(found.scale.max()), 1e-300)
        worst[0] = max(worst[0], float(np.nan_to_num(ratio).max()))
        return found.twist

    course = travel(twists, breaks)
    return KinematicMotion(shape, stroke, parts, course, condition, worst[0])


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


def _worst(shape: Shape, stroke: Stroke, parts: Sequence[Phase], breaks: np.ndarray) -> float:
    """Return the largest condition number; refuse singular shapes."""
    worst = 0.0
    for a, b in pairwise(breaks):
        part = parts[_which(parts, np.array([(a + b) / 2]))[0]]

        def inverse(tau: np.ndarray, part: Phase = part) -> np.ndarray:
            at = kinematics_at(shape, stroke.at(tau)[0])
            sigma = np.linalg.svd(at.J[:, part.constraints.rows] @ at.scaling, compute_uv=False)
            return sigma[:, -1] / sigma[:, 0]

        tau, least = _least(inverse, a, b)
        if least <= SINGULAR:
            raise singular_error(shape, stroke.at(tau)[0][0], part.constraints)
        worst = max(worst, 1 / least)
    return worst


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


_RESTS = 1e-11  # over the fastest mass; slower ones rest, where dry friction is not determined


Ground = PlanarLaw | Sequence[PlanarLaw | None] | None
"""Law of all masses, or of each; None if the ground does not resist."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces of the ground on the n masses of a body that moves without inertia, at m phases."""

    tau: np.ndarray  # (m,)
    # (m, n, 2) along headings and to their left; if loads are not determined, the balanced ones
    # with the least sum of squares; NaN if none balance
    force: np.ndarray
    determined: np.ndarray  # (m,), whether balance alone determines the loads of pins and skids
    power: np.ndarray  # (m,), dissipated by sliding, by the phase
    velocity: np.ndarray  # (m, n, 2), along headings and to their left, by the phase
    pinned: np.ndarray  # (m, n), whether a mass is a pin

    @property
    def pin_load(self) -> float:
        """Largest force on a pin; 0 without pins."""
        size = np.hypot(self.force[..., 0], self.force[..., 1])
        return float(size[self.pinned].max()) if self.pinned.any() else 0.0


def loads(motion: KinematicMotion, ground: Ground, tau: np.ndarray | None = None) -> Loads:
    """Return the loads of pins and skids, for given friction of sliding masses.

    `ground` is the law of all masses, or of each; a pin has no friction beside its load, a skid has
    that along its heading. Without phases `tau` (m,) those of the quadrature are used, with which
    ``power`` integrates to the work.

    Force and moment balance without inertia. Three rows of constraints are statically determined;
    each further one leaves a load undetermined. The force on a mass that rests on dry ground
    without a pin is undetermined too; it counts as none, and the instant as not determined.
    """
    shape = motion.shape
    tau = motion.course.nodes if tau is None else np.asarray(tau, dtype=float)
    laws = _laws(shape, ground)
    found, s = _held(shape, motion.stroke, motion.phases, tau)
    at, rates = kinematics_at(shape, s), motion.stroke.at(tau)[1]
    v = np.einsum("mrj,mj->mr", at.J, found.twist) + np.einsum("mrs,ms->mr", at.B, rates)
    m, n = len(tau), shape.n_points
    v = v.reshape(m, n, 2)
    force, known = np.zeros((m, n, 2)), np.ones(m, bool)
    pinned = np.zeros((m, n), bool)
    which = _which(motion.phases, tau)
    fastest = np.abs(v).max() if v.size else 0.0
    for k in np.unique(which):
        mine, constraints = which == k, motion.phases[k].constraints
        _slide(force, known, v, mine, constraints, laws, _RESTS * fastest)
    power = -np.sum(force * v, axis=(1, 2))
    for k in np.unique(which):
        mine, constraints = which == k, motion.phases[k].constraints
        pinned[np.ix_(mine, list(constraints.pins))] = True
        reactions = _balance(at.J[mine], at.scaling[mine], force[mine], constraints)
        flat = force[mine].reshape(mine.sum(), -1)
        flat[:, constraints.rows] += reactions
        force[mine] = flat.reshape(-1, n, 2)
        known[mine] &= constraints.count == 3
    return Loads(tau, force, known, power, v, pinned)


def _slide(
    force: np.ndarray,
    known: np.ndarray,
    v: np.ndarray,
    mine: np.ndarray,
    constraints: Constraints,
    laws: Sequence[ca.Function | None],
    least: float,
) -> None:
    """Add the friction of sliding masses in place."""
    for i, law in enumerate(laws):
        if law is None or i in constraints.pins:
            continue
        own = v[mine, i].copy()
        if i in constraints.skids:
            own[:, 1] = 0.0
        moves = np.hypot(own[:, 0], own[:, 1]) > least
        slip = np.zeros_like(own)
        if moves.any():
            slip[moves] = np.asarray(law(own[moves].T)).T
        force[mine, i] = slip
        if i in constraints.skids:
            force[mine, i, 1] = 0.0
        known[mine] &= moves


def _balance(
    J: np.ndarray, T: np.ndarray, force: np.ndarray, constraints: Constraints
) -> np.ndarray:
    """Return least reactions (m, r) of constraints that balance forces (m, n, 2)."""
    C = J[:, constraints.rows] @ T
    on = np.einsum("mrj,mr->mj", J @ T, force.reshape(len(force), -1))
    return -np.einsum("mrj,mj->mr", np.linalg.pinv(np.swapaxes(C, 1, 2)), on)


def _laws(shape: Shape, ground: Ground) -> list[ca.Function | None]:
    n = shape.n_points
    laws = list(ground) if isinstance(ground, Sequence) else [ground] * n
    if len(laws) != n:
        raise ArgumentError(f"{len(laws)} laws for {n} masses; give one, or one for each")
    return [None if law is None else _function(law) for law in laws]


def _function(law: PlanarLaw) -> ca.Function:
    v = ca.SX.sym("v", 2)
    return ca.Function("slip", [v], [law.slip_force(v)])
