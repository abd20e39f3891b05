"""Pins and skids: the velocity of the body they determine, and shapes where they fail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.planar.body.shape import Shape

CONSISTENT = 1e-9
"""Accepted contradiction of more than three constraints, relative to the fastest rate."""
SINGULAR = 1e-7
"""Inverse condition number below which a shape is refused."""


@dataclass(frozen=True)
class Constraints:
    """Constraints of a body on the ground: pins, skids, and spikes.

    Parameters
    ----------
    pins : tuple of int, optional
        Masses that do not move; each removes two velocities.
    skids : tuple of int, optional
        Masses that move only along their heading; each removes one velocity.
    spikes : tuple of int, optional
        Masses that cannot move backward. Spikes that are also pins are held against backward
        sliding alone; for the others the result shows whether they ever slide backward. Spikes do
        not determine the motion.

    Raises
    ------
    ArgumentError
        If a mass is both pin and skid, is listed twice, or fewer than three velocities are removed.

    Notes
    -----
    A pin and a skid are the least that determines a motion, without a condition on the shape. Two
    pins need a constant distance; more pins and skids need further conditions. These are checked
    when a motion is computed.
    motion is made.

    Examples
    --------
    >>> Constraints(pins=(2,), skids=(0,)).count
    3
    """

    pins: tuple[int, ...] = ()
    skids: tuple[int, ...] = ()
    spikes: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("pins", "skids", "spikes"):
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
        for name in ("pins", "skids", "spikes"):
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


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Places, headings and velocities (J twist + B rates) of points at m shapes."""

    points: np.ndarray  # (m, n, 2)
    headings: np.ndarray  # (m, n)
    J: np.ndarray  # (m, 2n, 3)
    B: np.ndarray  # (m, 2n, n_s)

    @property
    def scaling(self) -> np.ndarray:
        """Matrices (m, 3, 3) from twists to mean velocities, and rotation times size."""
        middle = self.points.mean(axis=1)
        spread = self.points - middle[:, None]
        size = np.sqrt(np.mean(np.sum(spread**2, axis=-1), axis=-1))
        T = np.tile(np.eye(3), (len(size), 1, 1))
        T[:, 0, 2], T[:, 1, 2] = middle[:, 1] / size, -middle[:, 0] / size
        T[:, 2, 2] = 1 / size
        return T


def kinematics_at(shape: Shape, s: np.ndarray) -> Kinematics:
    """Return the kinematics at shapes (m, n_s)."""
    m, n = len(s), shape.n_points
    points, headings, J, B = (np.asarray(part) for part in shape.kinematics(s.T))
    return Kinematics(
        points.T.reshape(m, n, 2),
        headings.T.reshape(m, n),
        np.moveaxis(J.reshape(2 * n, m, 3), 1, 0),
        np.moveaxis(B.reshape(2 * n, m, -1), 1, 0),
    )


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
