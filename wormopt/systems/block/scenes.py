"""Tables of scenes of kind "slide": the optimal motion of a block on the ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive
from wormopt.study.numerics import Contacts, ExactContact, MeshTable
from wormopt.study.types import SceneTable
from wormopt.systems.chain import Friction, faults_of_law, held_at_rest
from wormopt.systems.shared.declared import INSTANT, OPTIMUM


class Place(Given):
    """Position and velocity of the block."""

    position: float = number("length", "place")
    velocity: float = number("speed", "velocity at this position", default=0.0)


class BlockTable(Given):
    """The block."""

    mass: float = positive("mass", "mass", default=1.0)
    force: float = positive("force", "largest drive in both directions")
    friction: Friction = entry("friction law of the ground")


class SlideScene(SceneTable):
    """The fastest motion of a block, or that of least effort.

    A block on the ground moves from one position and velocity to another in the shortest time, or
    with the least effort ∫*u*² d*t*. See [optimal.md](../optimal.md).

    `contact` with `treatment = "exact"`: relaxed complementarity, then phases with free switching
    times; with `"smooth"`: phases of the drive only.

    The arrays contain the instants at which arcs join twice. `timings_s`: `build` and `solve` (of
    all programs), `optimise` and `recheck`.
    """

    scalars: ClassVar = OPTIMUM | {
        "objective": (
            "time",
            'minimised quantity: the time, or with `minimise = "effort"` the effort (force² time)',
        )
    }
    variables: ClassVar = INSTANT | {
        "position": ("length", ("instant",), "position of the block"),
        "velocity": ("speed", ("instant",), "velocity of the block"),
        "force": ("force", ("instant",), "drive"),
        "contact_force": ("force", ("instant",), "force of the ground"),
    }

    kind: Literal["slide"]
    want: tuple[Literal["signals"], ...] = entry("`signals`: signals over time", default=())
    block: BlockTable = entry("the block")
    start: Place = entry("initial state")
    end: Place = entry("final state")
    minimise: Literal["time", "effort"] = entry("minimised quantity", default="time")
    time: float | None = positive(
        "time", 'upper limit of the duration; required for `"effort"`', default=None
    )
    contact: Contacts = field(default_factory=ExactContact)
    mesh: MeshTable = entry("mesh in time", default=MeshTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        wrong = list(faults_of_law("block.friction", self.block.friction, 1))
        yield from wrong
        if not wrong and self.start != self.end and isinstance(self.contact, ExactContact):
            yield from self._faults_of_drive()
        if self.start == self.end:
            yield "end", "equals the start; write another position or velocity"
        if self.minimise == "effort" and self.time is None:
            yield (
                "time",
                "missing, and the least effort takes infinite time; write the longest allowed "
                "duration",
            )

    def _faults_of_drive(self) -> Iterator[Fault]:
        """Yield a fault if the drive cannot start the block from rest in the required direction."""
        forward, backward = held_at_rest(self.block.friction)
        for way, name, held in ((1, "forward", forward), (-1, "backward", backward)):
            ahead = way * (self.end.position - self.start.position)
            first, last = way * self.start.velocity, way * self.end.velocity
            from_rest = first <= 0 <= ahead or (last > 0 and (first <= 0 or ahead <= 0))
            if from_rest and self.block.force <= held:
                more = f"write more than {held:.12g}, or " if held < math.inf else "write "
                yield (
                    "block.force",
                    f"{self.block.force:.12g} does not move the block {name} from rest against "
                    f"this friction, which is necessary to get from start to end; {more}another "
                    "end",
                )
