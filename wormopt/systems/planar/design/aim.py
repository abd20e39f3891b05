"""Objective of a planar gait, its limits, and potentials of the ground.

The minimum of a potential is the motion of a changing shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.shape import Shape
from wormopt.systems.planar.swimming.swimmer import Swimmer
from wormopt.systems.planar.tables import PlanarLimits

_NOWHERE = "a closed gait without turn has no displacement; "


@dataclass(frozen=True, eq=False)
class Dry:
    """Dry friction with maximal dissipation on every mass, head first, or one law for all."""

    laws: tuple[Elliptic, ...]

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the sum of sqrt(psi² + width²) less the width, which the twist minimises.

        It is an expression in the shape, its rates and the twist; friction is smooth below the
        power `width`.
        """
        laws = self.each_law(shape)
        squares = [_squared(law, shape.velocities[:, i]) for i, law in enumerate(laws)]
        return sum((ca.sqrt(one + width**2) - width for one in squares), start=ca.SX(0))

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the power dissipated by the ground, up to the width; smooth at rest."""
        return self.potential(shape, width)

    def each_law(self, shape: Shape) -> list[Elliptic]:
        """Return the law of every mass."""
        if len(self.laws) not in (1, shape.n_points):
            raise ArgumentError(f"{shape.n_points} masses need as many laws, not {len(self.laws)}")
        return list(self.laws) * (shape.n_points if len(self.laws) == 1 else 1)

    def least_each(self, shape: Shape) -> np.ndarray:
        """Return the least resistance of every mass (m,)."""
        laws = self.each_law(shape)
        return np.array([min(_numbers(law)) for law in laws])

    def why_held(self, shape: Shape) -> str:
        """Return why no closed gait without turn has a displacement; "" if it may have one.

        A mass that holds the pull of all others together never moves: with it at rest the body
        turns about it so that moments balance, and it carries the forces of the others, which it
        can. This motion has least power for any change of shape.
        """
        laws = self.each_law(shape)
        least, most = self.least_each(shape), np.array([max(_numbers(law)) for law in laws])
        found = np.flatnonzero(least >= most.sum() - most)
        why = "mass {} holds the pull of all others together and never moves, so " + _NOWHERE
        return why.format(found[0]) + "give it less friction than their sum" if len(found) else ""

    @property
    def most(self) -> float:
        """Largest resistance."""
        return max(max(_numbers(law)) for law in self.laws)

    @property
    def mean(self) -> float:
        """Mean resistance of the masses, forward, backward and to both sides."""
        return float(np.mean([(*_numbers(law), float(law.sideways)) for law in self.laws]))

    @property
    def symmetric(self) -> bool:
        """Whether a reversed stroke returns the body."""
        return all(float(law.forward) == float(law.backward) for law in self.laws)


@dataclass(frozen=True, eq=False)
class Viscous:
    """Linear drag on rods and masses; ArgumentError for another shape than the swimmer's."""

    swimmer: Swimmer

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return half the power, which the twist minimises; the width has no effect."""
        return self.power(shape, width) / 2

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the power dissipated by the ground; the width has no effect."""
        if shape is not self.swimmer.shape:
            raise ArgumentError("the shape is not that of the swimmer; give the same one")
        return self.swimmer.power

    def why_held(self, shape: Shape) -> str:
        """Return why no closed gait without turn has a displacement; "" if it may have one.

        The centre of drag never moves if drags are constant and equal in all directions.
        """
        (along, across), masses = self.swimmer.rods, self.swimmer.masses
        constant = not along or not any(name.startswith("length") for name in shape.names)
        alike = along == across and masses[0] == masses[1]
        why = "drag that is equal along and across holds the centre of drag in its place, so "
        return why + _NOWHERE + "write more drag across" if alike and constant else ""

    symmetric: ClassVar = True
    """Whether a reversed stroke returns the body."""


Ground = Dry | Viscous


def ground_of(given: Ground | Swimmer | Elliptic | Sequence[Elliptic]) -> Ground:
    """Return the ground from a law for all masses, one for each, or a body with its drags."""
    if isinstance(given, Dry | Viscous):
        return given
    if isinstance(given, Swimmer):
        return Viscous(given)
    return Dry((given,) if isinstance(given, Elliptic) else tuple(given))


def _squared(law: Elliptic, v: ca.SX) -> ca.SX:
    """Return the squared power of the law, which is differentiable at rest."""
    return (law.along(v[0]) * v[0]) ** 2 + (law.sideways * v[1]) ** 2


def _numbers(law: Elliptic) -> tuple[float, float, float]:
    return float(law.forward), float(law.backward), float(law.sideways)


Purpose = Literal["speed", "turn", "work"]
_STROKES = 20
"""Duration of the smallest stroke over that of the usual one."""
PIVOTS = ("any", "centre")


def _kind(name: str) -> str:
    return name.partition(" ")[0]


@dataclass(frozen=True, eq=False)
class PlanarAim:
    """A body on its ground, and the objective of its gait.

    Parameters
    ----------
    shape : Shape
        The body.
    ground : Elliptic, sequence of Elliptic, or Swimmer
        Dry friction of all masses, or of each, head first; or the same body with its drags.
    limits : PlanarLimits
        Limits of the gait.
    purpose : {"speed", "turn", "work"}
        Highest speed without net turn; fastest turn in place; least work to a pose.
    pose : (float, float, float), optional
        For ``"work"``: x, y and angle (rad) of the head to reach, in its frame at the start.
    cycles : int, optional
        Number of cycles in which the pose is reached.
    closed : bool, optional
        Whether the shape must return to its start.
    start : tuple of float, optional
        Initial shape; free if left out.
    pivot : int or {"any", "centre"}, optional
        For ``"turn"``: the point that returns after a cycle: a mass, the masses' centre, or none.
    corners : int, optional
        Number of corners of the stroke, joined by straight sides.
    time : float, optional
        For ``"work"``: duration of a cycle, on which the work of drag depends.

    Raises
    ------
    ArgumentError
        If the objective is inconsistent.

    Examples
    --------
    >>> from wormopt.model.planar_friction import Elliptic
    >>> from wormopt.systems.planar.shape import chain_shape
    >>> aim = PlanarAim(chain_shape(2), Elliptic(1.0, 1.0, 1.0), PlanarLimits(), "turn")
    >>> aim.duration_usual
    8.0
    """

    shape: Shape
    ground: Any  # stored as Dry or Viscous
    limits: PlanarLimits
    purpose: Purpose = "speed"
    pose: tuple[float, float, float] | None = None
    cycles: int = 1
    closed: bool = True
    start: tuple[float, ...] | None = None
    pivot: int | str = "any"
    corners: int = 12
    time: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "ground", ground_of(self.ground))
        n_s = len(self.shape.names)
        if n_s == 0:
            raise ArgumentError("a rigid body has no gait; give a shape with shape variables")
        if (self.purpose == "work") != (self.pose is not None):
            raise ArgumentError("purpose 'work' needs a pose; other purposes have none")
        if self.purpose != "work" and not self.closed:
            raise ArgumentError("only purpose 'work' may end with another shape; set closed")
        if not self.closed and self.cycles > 1:
            raise ArgumentError("a path with another final shape has one cycle; set cycles=1")
        if self.start is not None and len(self.start) != n_s:
            raise ArgumentError(f"start needs {n_s} numbers, not {len(self.start)}")
        if self.limits.effort is not None and self.timed and not isinstance(self.ground, Dry):
            raise ArgumentError("on linear drag the work has no least time; leave effort out")
        if isinstance(self.pivot, int) and not 0 <= self.pivot < self.shape.n_points:
            raise ArgumentError(f"there is no mass {self.pivot}")
        if isinstance(self.pivot, str) and self.pivot not in PIVOTS:
            raise ArgumentError(f"pivot must be a mass, 'any' or 'centre', not {self.pivot!r}")
        if self.closed and n_s == 1 and self.ground.symmetric:
            raise ArgumentError(
                "one shape variable goes to and fro on one curve, and ground with F+ = F- "
                "returns the body; let lengths vary, or use more joints"
            )
        turns = self.purpose == "turn" or (self.pose is not None and any(self.pose[1:]))
        if self.single and turns:
            raise ArgumentError(
                "a single link moves along itself and cannot turn; use more links, or write "
                "purpose 'speed', or a pose [x, 0, 0]"
            )
        straight = self.pose is not None and self.pose[2] == 0 and self.pose != (0.0, 0.0, 0.0)
        returns = self.closed and (self.purpose == "speed" or straight)
        if returns and (why := self.ground.why_held(self.shape)):
            raise ArgumentError(why)

    @property
    def single(self) -> bool:
        """Whether the body is a single link, which moves along itself only."""
        return self.shape.n_points == 2

    @property
    def ranges(self) -> np.ndarray:
        """Least and largest value of each shape variable, (n_s, 2)."""
        known = {"length": self.limits.length or (0.5, 1.0), "angle": self.limits.angle}
        limits = [known[_kind(name)] for name in self.shape.names]
        return np.array(limits, dtype=float).reshape(-1, 2)

    @property
    def rates(self) -> np.ndarray:
        """Largest rate of each shape variable, (n_s,)."""
        return np.array([getattr(self.limits, f"{_kind(name)}_rate") for name in self.shape.names])

    @cached_property
    def length(self) -> float:
        """Length of the body with its shape in the middle of its ranges."""
        points = np.asarray(self.shape.kinematics(self.ranges.mean(axis=1))[0])
        return float(np.hypot(*np.diff(points, axis=1)).sum())

    @cached_property
    def reaches(self) -> np.ndarray:
        """Largest displacement of a part of the body by each shape variable, (n_s,)."""
        sizes = [1.0 if _kind(name) == "length" else self.length for name in self.shape.names]
        return np.ptp(self.ranges, axis=1) * sizes

    @property
    def usual(self) -> float:
        """Usual size of the objective: a speed, a turn rate, or a work."""
        if self.purpose == "turn":
            return 1.0 / self.duration_usual
        if self.purpose == "speed":
            return self.length / self.duration_usual
        return self.usual_work

    @property
    def usual_work(self) -> float:
        """Usual work of a cycle."""
        ground, reach = self.ground, float(self.reaches.max())
        if isinstance(ground, Dry):
            return ground.mean * self.shape.n_points * reach
        swimmer = ground.swimmer
        drag = sum(swimmer.rods) / 2 * self.length + sum(swimmer.masses) / 2 * self.shape.n_points
        return drag * reach**2 * self.work_factor

    @property
    def duration_usual(self) -> float:
        """Time to go through the widest range of shape and back."""
        spans = self.ranges[:, 1] - self.ranges[:, 0]
        return float(2 * (spans / self.rates).max())

    @property
    def shortest(self) -> float:
        """Least duration of a cycle: on dry ground small strokes may be as fast as large ones."""
        return self.duration_usual / _STROKES

    @property
    def timed(self) -> bool:
        """Whether the duration matters."""
        return self.purpose != "work"

    @property
    def work_factor(self) -> float:
        """Ratio of work to the integral of the power over a phase of unit duration."""
        return 1.0 if isinstance(self.ground, Dry) else 1.0 / self.time

    @property
    def step(self) -> np.ndarray:
        """Pose (3,) to reach in one cycle, whose repetition leads to `pose`."""
        assert self.pose is not None
        return root(np.array(self.pose), self.cycles)


def root(pose: np.ndarray, cycles: int) -> np.ndarray:
    """Return the displacement (3,) that leads to a pose after `cycles` repetitions."""
    turn = pose[2] / cycles
    factor = np.exp(1j * turn * np.arange(cycles)).sum()
    first = complex(pose[0], pose[1]) / factor
    return np.array([first.real, first.imag, turn])
