"""Kind "planar-block": a block slides in the plane until it stops."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.study import (
    Given,
    Study,
    attributes,
    check,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.systems.planar.tables import EllipticGround, UnitGround, Vector

with on_use():
    import numpy as np

    from wormopt.model.model import Model
    from wormopt.simulation.options import Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.planar.dynamics.driven import Stop, driven_shape, stop_of
    from wormopt.systems.planar.dynamics.motion import energy_error
    from wormopt.systems.planar.shape import rigid_shape
    from wormopt.systems.shared.models import measure_works

_AFTER = 1.1  # simulated time over the time of the stop


class Block(Given):
    """The block. It slides without turning."""

    mass: float = positive("mass", "mass of the block")
    velocity: Vector = entry("initial velocity", quantity="speed")
    heading: float = number("rad", "heading, measured from the *x* axis", default=0.0)
    pull: Vector = entry("constant applied force", quantity="force", default=(0.0, 0.0))

    @property
    def speed(self) -> float:
        """Initial speed."""
        return math.hypot(*self.velocity)

    def in_own_axes(self, vector: tuple[float, ...]) -> tuple[float, float]:
        """Components of a vector along the heading and to its left."""
        return turned(vector, -self.heading)

    def faults_of_keys(self) -> Iterator[Fault]:
        if not any(self.velocity):
            yield "velocity", "the block is at rest; write a velocity other than 0"


@dataclass(frozen=True)
class Signals:
    """Motion of the block over time."""

    time: np.ndarray = signal("time", "time", "time")
    x: np.ndarray = signal("length", "time", "place")
    y: np.ndarray = signal("length", "time", "place")
    x_velocity: np.ndarray = signal("speed", "time", "velocity")
    y_velocity: np.ndarray = signal("speed", "time", "velocity")
    friction_x: np.ndarray = signal("force", "time", "friction force along *x*")
    friction_y: np.ndarray = signal("force", "time", "friction force along *y*")
    kinetic_energy: np.ndarray = signal("energy", "time", "kinetic energy of the block")


@dataclass(frozen=True)
class Numbers:
    """Where and when the block stops, and what that took."""

    stop_time: float = value("time", "time at which the block stops", headline=True)
    x_stop: float = value("length", "*x* coordinate at which the block stops", headline=True)
    y_stop: float = value("length", "*y* coordinate at which the block stops", headline=True)
    distance: float = value("length", "straight distance from start to stop")
    path: float = value("length", "length of the path")
    last_direction: float = value("angle", "direction of the velocity just before the stop")
    friction_work: float = value("energy", "work done by friction")
    pull_work: float = value("energy", "work done by the pull")
    energy_error: float = value(
        "share", "works less the energy gained, relative to the largest of them"
    )
    stop_error: float = value(
        "share", "relative difference in stop time and place to the second route"
    )
    n_steps: int = value("count", "number of integrator steps")


class PlanarBlock(Study, kind="planar-block"):
    """Compute how a block stops on anisotropic dry friction.

    The block slides over ground with direction-dependent friction until it stops. The stop is
    located as an event. A second route computes it by quadrature in a transformed time in which
    the stop lies at infinity. Theory: [theory-planar.md](../theory-planar.md). The status is
    `failed` if the two routes disagree or energy is not balanced.
    """

    pictures: ClassVar = {
        "block": "path with the velocity, its components over time, and the friction ellipse",
    }

    block: Block = entry("the block")
    ground: EllipticGround | UnitGround = entry("ground under the block")
    samples: int = whole(10, 100000, "samples kept, until shortly after the stop", default=601)

    def faults_of_keys(self) -> Iterator[Fault]:
        if (share := self.pull_share) >= 1:
            yield (
                "block.pull",
                f"is {share:.4g} times the largest force that the ground can hold, so the block "
                "may never stop; write a smaller pull, or more friction",
            )

    @property
    def pull_share(self) -> float:
        """Pull relative to the largest force that friction can hold in its direction."""
        along, across = self.block.in_own_axes(self.block.pull)
        forward, backward, sideways = self.ground.numbers
        return math.hypot(along / (forward if along > 0 else backward), across / sideways)

    # -- computing ---------------------------------------------------------------------------------

    def model(self) -> Model:
        """Return the model of the block: one point, whose inertia only keeps its heading."""
        block = self.block
        time = block.mass * block.speed / max(self.ground.forward, self.ground.sideways or 0.0)
        return driven_shape(
            rigid_shape([(0.0, 0.0)]),
            mass=block.mass,
            inertia=block.mass * (block.speed * time) ** 2,
            law=self.ground.friction(),
            pull=block.pull,
            angle=block.heading,
            velocity=block.velocity,
            length_nominal=block.speed * time,
            time_nominal=time,
        )

    def models(self) -> dict[str, Model]:
        return {"": self.model()}

    @stage
    def recheck(self) -> Stop:
        block = self.block
        velocity, pull = block.in_own_axes(block.velocity), block.in_own_axes(block.pull)
        return stop_of(self.ground.friction(), block.mass, velocity, pull)

    @stage
    def motion(self) -> Trajectory:
        end, block = _AFTER * self.recheck.time, self.block
        with np.errstate(all="ignore"):  # values that are not finite are checked where it matters
            motion = simulate(
                measure_works(self.model(), block.mass * block.speed**2 / 2),
                end,
                times=np.linspace(0.0, end, self.samples),
                tolerance=Tolerance(1e-12, 1e-13),
                route="radau",  # sideways motion decays quickly, which makes the end stiff
                report=self.report,
            )
        if not any(event.kind == "stick" for event in motion.events):
            raise SolveError(
                "the block does not come to rest", "write a smaller block.pull, or more friction"
            )
        return motion

    # -- results -----------------------------------------------------------------------------------

    @parts(Signals)
    def signals(self) -> Signals:
        names = ("center", "center_velocity", "ground_force", "kinetic_energy")
        rows = [row for name in names for row in self.motion[name]]
        return Signals(self.motion.time, *rows)

    @parts(Numbers)
    def numbers(self) -> Numbers:
        motion, block = self.motion, self.block
        stopped = [event.time for event in motion.events if event.kind == "stick"][-1]
        (x, y), other = motion["center"][:, -1].tolist(), turned(self.recheck.place, block.heading)
        size = max(math.hypot(x, y), 1e-12 * block.speed * stopped)
        apart = math.hypot(x - other[0], y - other[1]) / size
        moving = motion["center_velocity"][:, motion.time < stopped]
        return Numbers(
            stop_time=stopped,
            x_stop=x,
            y_stop=y,
            distance=math.hypot(x, y),
            path=float(np.hypot(*np.diff(motion["center"], axis=1)).sum()),
            last_direction=float(np.arctan2(moving[1, -1], moving[0, -1])),
            friction_work=float(motion["ground_work"][0, -1]),
            pull_work=float(motion["pull_work"][0, -1]),
            energy_error=energy_error(motion, "kinetic_energy"),
            stop_error=max(apart, abs(stopped / self.recheck.time - 1)),
            n_steps=motion.n_steps,
        )

    @scalar("share", "pull relative to the largest force that friction can hold")
    def holding_share(self) -> float:
        return self.pull_share

    @attributes
    def drawn(self) -> Mapping[str, Any]:
        names = ("forward", "backward", "sideways")
        resistances = dict(zip(names, self.ground.numbers, strict=True))
        return {"heading": self.block.heading, "pull": list(self.block.pull), **resistances}

    # -- the trust report --------------------------------------------------------------------------

    @check(1e-8, "quadrature finds another stop, so the result is not reliable")
    def second_route(self) -> float:
        return self.numbers.stop_error

    @check(1e-9, "energy is not balanced")
    def energy_balance(self) -> float:
        return self.numbers.energy_error

    @facts
    def routes(self) -> Mapping[str, Any]:
        return {
            "route": self.motion.route,
            "recheck": "SciPy's DOP853 in a time in which the stop lies at infinity",
        }

    @warnings
    def of_motion(self) -> Iterable[str]:
        return self.motion.warnings


def turned(vector: tuple[float, ...], angle: float) -> tuple[float, float]:
    """Rotate a vector to the left by an angle."""
    (x, y), c, s = vector, math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y
