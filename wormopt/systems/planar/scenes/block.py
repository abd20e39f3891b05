"""Scenes of kind "planar-block": a block slides in the plane and comes to rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Finite, Positive, SceneTable, Table, says
from wormopt.systems.planar.scenes.ground import EllipticGround, UnitGround
from wormopt.systems.shared.declared import TIME

_Vector = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [x, y]"),
]
_Samples = Annotated[int, Meta(ge=10, le=100_000, description="a whole number from 10 to 100000")]


class BlockTable(Table, frozen=True, kw_only=True):
    """The block, which does not turn."""

    mass: Annotated[Positive, says("mass", "its mass")]
    velocity: Annotated[_Vector, says("speed", "with which it is thrown")]
    heading: Annotated[Finite, says("rad", "direction in which it looks, from *x*")] = 0.0
    pull: Annotated[_Vector, says("force", "constant force on it")] = (0.0, 0.0)


class PlanarBlockScene(SceneTable, frozen=True, kw_only=True):
    """A block is thrown over ground that resists each direction differently: where it stops.

    The stop is located as an event, and found again by a time in which it never comes. Theory:
    [theory-planar.md](../theory-planar.md). Status `failed`: both disagree, or energy is not
    balanced.
    """

    headline: ClassVar = ("stop_time", "x_stop", "y_stop")
    scalars: ClassVar = {
        "stop_time": ("time", "when it comes to rest"),
        "x_stop": ("length", "where, along *x*"),
        "y_stop": ("length", "where, along *y*"),
        "distance": ("length", "from start to stop, straight"),
        "path": ("length", "length of its way"),
        "last_direction": ("angle", "direction of its velocity just before it stops"),
        "friction_work": ("energy", "done by friction"),
        "pull_work": ("energy", "done by the pull"),
        "energy_error": ("share", "works less the energy gained, over the largest of them"),
        "stop_error": ("share", "second route: difference of time and place, over their size"),
        "holding_share": ("share", "part of what holds that the pull takes at rest"),
        "n_steps": ("count", "steps of the integrator"),
    }
    variables: ClassVar = TIME | {
        "x": ("length", ("time",), "place"),
        "y": ("length", ("time",), "place"),
        "x_velocity": ("speed", ("time",), "velocity"),
        "y_velocity": ("speed", ("time",), "velocity"),
        "friction_x": ("force", ("time",), "force of friction"),
        "friction_y": ("force", ("time",), "force of friction"),
        "kinetic_energy": ("energy", ("time",), "kinetic energy"),
    }

    kind: Literal["planar-block"]
    want: Annotated[
        tuple[Literal["block"], ...],
        says("", "`block`: its way in the plane, its velocity, and friction against what holds"),
    ] = ()
    block: Annotated[BlockTable, says("", "what slides")]
    ground: Annotated[EllipticGround | UnitGround, says("", "on what")]
    samples: Annotated[_Samples, says("count", "instants kept until a little after the stop")] = 601

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if not any(self.block.velocity):
            yield "block.velocity", "the block is at rest; write a velocity that is not 0"
        share = self.holding_share
        if share >= 1:
            yield (
                "block.pull",
                f"takes {share:.4g} times what the ground can hold: the block need not stop; write "
                "a smaller pull, or more friction",
            )

    @property
    def turned_pull(self) -> tuple[float, float]:
        """The pull along the heading and to its left."""
        return turned(self.block.pull, -self.block.heading)

    @property
    def holding_share(self) -> float:
        """The pull in units of what holds against it."""
        ahead, aside = self.turned_pull
        ground = self.ground
        along = ground.forward if ahead > 0 else ground.backward or ground.forward
        return math.hypot(ahead / along, aside / (ground.sideways or ground.forward))


def turned(vector: tuple[float, ...], angle: float) -> tuple[float, float]:
    """A vector turned to the left."""
    (x, y), c, s = vector, math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y
