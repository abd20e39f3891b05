"""Scenes of kind "planar-block": a block slides in the plane until it stops."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Finite, SceneTable
from wormopt.systems.planar.scenes.ground import EllipticGround, UnitGround
from wormopt.systems.shared.declared import TIME

_Vector = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [x, y]"),
]


class BlockTable(Given):
    """The block. It slides without turning."""

    mass: float = positive("mass", "mass of the block")
    velocity: _Vector = entry("initial velocity", quantity="speed")
    heading: float = number("rad", "heading, measured from the *x* axis", default=0.0)
    pull: _Vector = entry("constant applied force", quantity="force", default=(0.0, 0.0))


class PlanarBlockScene(SceneTable):
    """A block slides over ground with direction-dependent dry friction until it stops.

    The stop is located as an event. A second route computes it by quadrature in a transformed time
    in which the stop lies at infinity. Theory: [theory-planar.md](../theory-planar.md). The status
    is `failed` if the two routes disagree or energy is not balanced.
    """

    headline: ClassVar = ("stop_time", "x_stop", "y_stop")
    scalars: ClassVar = {
        "stop_time": ("time", "time at which the block stops"),
        "x_stop": ("length", "*x* coordinate at which the block stops"),
        "y_stop": ("length", "*y* coordinate at which the block stops"),
        "distance": ("length", "straight distance from start to stop"),
        "path": ("length", "length of the path"),
        "last_direction": ("angle", "direction of the velocity just before the stop"),
        "friction_work": ("energy", "work done by friction"),
        "pull_work": ("energy", "work done by the pull"),
        "energy_error": ("share", "works less the energy gained, relative to the largest of them"),
        "stop_error": ("share", "relative difference in stop time and place to the second route"),
        "holding_share": ("share", "pull relative to the largest force that friction can hold"),
        "n_steps": ("count", "number of integrator steps"),
    }
    variables: ClassVar = TIME | {
        "x": ("length", ("time",), "place"),
        "y": ("length", ("time",), "place"),
        "x_velocity": ("speed", ("time",), "velocity"),
        "y_velocity": ("speed", ("time",), "velocity"),
        "friction_x": ("force", ("time",), "friction force along *x*"),
        "friction_y": ("force", ("time",), "friction force along *y*"),
        "kinetic_energy": ("energy", ("time",), "kinetic energy of the block"),
    }

    kind: Literal["planar-block"]
    want: tuple[Literal["block"], ...] = entry(
        "`block`: path, velocity over time, and friction against its limit", default=()
    )
    block: BlockTable = entry("the block")
    ground: EllipticGround | UnitGround = entry("ground under the block")
    samples: int = whole(10, 100000, "samples kept, until shortly after the stop", default=601)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if not any(self.block.velocity):
            yield "block.velocity", "the block is at rest; write a velocity other than 0"
        share = self.holding_share
        if share >= 1:
            yield (
                "block.pull",
                f"is {share:.4g} times the largest force that the ground can hold, so the block "
                "may never stop; write a smaller pull, or more friction",
            )

    @property
    def turned_pull(self) -> tuple[float, float]:
        """Components of the pull along the heading and to its left."""
        return turned(self.block.pull, -self.block.heading)

    @property
    def holding_share(self) -> float:
        """Pull relative to the largest force that friction can hold in its direction."""
        ahead, aside = self.turned_pull
        ground = self.ground
        along = ground.forward if ahead > 0 else ground.backward or ground.forward
        return math.hypot(ahead / along, aside / (ground.sideways or ground.forward))


def turned(vector: tuple[float, ...], angle: float) -> tuple[float, float]:
    """Rotate a vector to the left by an angle."""
    (x, y), c, s = vector, math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y
