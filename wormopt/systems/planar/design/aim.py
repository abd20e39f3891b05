"""What a planar gait shall do, and what its shape, its rates and its room must keep to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.design.ground import Dry, ground_of

Purpose = Literal["speed", "turn", "work"]
_STROKES = 20
"""The smallest stroke takes this part of the time of the usual one."""
PIVOTS = ("any", "centre")


@dataclass(frozen=True)
class PlanarLimits:
    """What a gait must keep to.

    Parameters
    ----------
    length : (float, float), optional
        Least and largest length of links that vary.
    angle : (float, float), optional
        Least and largest angle of a joint.
    length_rate, angle_rate : float, optional
        Largest rate of a length and of an angle.
    effort : float, optional
        Most work in a cycle.
    half_width : float, optional
        Half the width of a passage along the way; free if left out.
    radius : float, optional
        Of the links, as rods with round ends, in the passage.

    Examples
    --------
    >>> PlanarLimits(length=(0.5, 1.0), angle=(-1.0, 1.0)).angle
    (-1.0, 1.0)
    """

    length: tuple[float, float] = (0.5, 1.0)
    angle: tuple[float, float] = (-2.0, 2.0)
    length_rate: float = 1.0
    angle_rate: float = 1.0
    effort: float | None = None
    half_width: float | None = None
    radius: float = 0.0

    def __post_init__(self) -> None:
        for name in ("length", "angle"):
            least, most = getattr(self, name)
            if not least < most:
                raise ArgumentError(f"{name} must go from less to more, not {least} to {most}")
        if self.length[0] <= 0:
            raise ArgumentError(f"links must be longer than 0, not {self.length[0]}")
        if max(map(abs, self.angle)) >= np.pi:
            raise ArgumentError("angles of joints stay below pi to either side")
        if min(self.length_rate, self.angle_rate) <= 0:
            raise ArgumentError("rates must be positive")
        if self.half_width is not None and self.half_width <= self.radius:
            raise ArgumentError("the passage is narrower than a link")


def _kind(name: str) -> str:
    return name.partition(" ")[0]


@dataclass(frozen=True, eq=False)
class PlanarAim:
    """A body on its ground, and what its gait is for.

    Parameters
    ----------
    shape : Shape
        The body.
    ground : Elliptic, sequence of Elliptic, or Swimmer
        Dry friction of all masses, or of each, head first; or the same body with its drags.
    limits : PlanarLimits
        What the gait must keep to.
    purpose : {"speed", "turn", "work"}
        Fastest without net turn; fastest turn in place; least work to a pose.
    pose : (float, float, float), optional
        Of ``"work"``: x, y and angle of the head to reach, seen from the one at the start.
    cycles : int, optional
        Cycles in which it is reached.
    closed : bool, optional
        Whether the shape returns.
    start : tuple of float, optional
        Shape to begin with; free if left out.
    pivot : int or {"any", "centre"}, optional
        Of ``"turn"``: the mass, the masses' centre, or nothing, that is where it was after a cycle.
    corners : int, optional
        Corners of the stroke, joined by straight sides.
    time : float, optional
        Of ``"work"``: that a cycle takes, of which drag's work depends.

    Examples
    --------
    >>> from wormopt.model.planar_friction import Elliptic
    >>> from wormopt.systems.planar.body.shape import chain_shape
    >>> aim = PlanarAim(chain_shape(2), Elliptic(1.0, 1.0, 1.0), PlanarLimits(), "turn")
    >>> aim.duration_usual
    8.0
    """

    shape: Shape
    ground: Any  # kept as Dry or Viscous
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
            raise ArgumentError("a rigid body has no gait")
        if (self.purpose == "work") != (self.pose is not None):
            raise ArgumentError("a pose is what the purpose 'work', and it alone, needs")
        if self.purpose != "work" and not self.closed:
            raise ArgumentError("only a course to a pose may end with another shape")
        if not self.closed and self.cycles > 1:
            raise ArgumentError("a course whose shape does not return has one cycle")
        if self.start is not None and len(self.start) != n_s:
            raise ArgumentError(f"start needs {n_s} numbers, not {len(self.start)}")
        if self.limits.effort is not None and self.timed and not isinstance(self.ground, Dry):
            raise ArgumentError("linear drag's work knows no least time; leave the effort out")
        if isinstance(self.pivot, int) and not 0 <= self.pivot < self.shape.n_points:
            raise ArgumentError(f"there is no mass {self.pivot}")
        if isinstance(self.pivot, str) and self.pivot not in PIVOTS:
            raise ArgumentError(f"pivot is a mass, 'any' or 'centre', not {self.pivot!r}")
        if self.closed and n_s == 1 and self.ground.symmetric:
            raise ArgumentError(
                "one shape variable goes there and back on the same way, and ground with F+ = F- "
                "takes the body back with it: let lengths vary, or take more joints"
            )

        self._refuse_an_anchor()

    def _refuse_an_anchor(self) -> None:
        straight = self.pose is not None and self.pose[2] == 0 and self.pose != (0.0, 0.0, 0.0)
        if not isinstance(self.ground, Dry) or not self.closed:
            return
        held = self.ground.anchor(self.shape)
        if held is not None and (self.purpose == "speed" or straight):
            raise ArgumentError(
                f"mass {held} holds what all others together can pull, hence never moves, and a "
                "closed gait without a turn gets nowhere: let it grip less than their sum"
            )

    @property
    def ranges(self) -> np.ndarray:
        """Least and largest value of each shape variable, (n_s, 2)."""
        limits = [getattr(self.limits, _kind(name)) for name in self.shape.names]
        return np.array(limits, dtype=float).reshape(-1, 2)

    @property
    def rates(self) -> np.ndarray:
        """Largest rate of each shape variable, (n_s,)."""
        return np.array([getattr(self.limits, f"{_kind(name)}_rate") for name in self.shape.names])

    @cached_property
    def length(self) -> float:
        """Length of the body, its shape in the middle of its ranges."""
        points = np.asarray(self.shape.kinematics(self.ranges.mean(axis=1))[0])
        return float(np.hypot(*np.diff(points, axis=1)).sum())

    @cached_property
    def reaches(self) -> np.ndarray:
        """How far each shape variable may move a part of the body, (n_s,)."""
        sizes = [1.0 if _kind(name) == "length" else self.length for name in self.shape.names]
        return np.ptp(self.ranges, axis=1) * sizes

    @property
    def usual(self) -> float:
        """Usual size of what is sought: a speed, a rate of turning, or a work."""
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
        """Least time of a cycle: on dry ground small strokes may be as fast as large ones."""
        return self.duration_usual / _STROKES

    @property
    def timed(self) -> bool:
        """Whether the time it takes counts."""
        return self.purpose != "work"

    @property
    def work_factor(self) -> float:
        """Work by the integral of the power over a phase that lasts 1."""
        return 1.0 if isinstance(self.ground, Dry) else 1.0 / self.time

    @property
    def step(self) -> np.ndarray:
        """Pose (3,) to reach in one cycle, repeated to reach the pose."""
        assert self.pose is not None
        return root(np.array(self.pose), self.cycles)


def root(pose: np.ndarray, cycles: int) -> np.ndarray:
    """Displacement (3,) that leads to a pose when repeated so often."""
    turn = pose[2] / cycles
    factor = np.exp(1j * turn * np.arange(cycles)).sum()
    first = complex(pose[0], pose[1]) / factor
    return np.array([first.real, first.imag, turn])
