"""Scenes of the kinds "two-mass" and "capsule": worms driven by a mass that moves to and fro."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Positive,
    PositiveOrPair,
    SceneTable,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Signals = Annotated[tuple[Literal["signals"], ...], says("", "`signals`: signals below each other")]


class PairTable(Table, frozen=True, kw_only=True):
    """Two masses on rough ground."""

    mass: Annotated[Positive, says("mass", "big mass")] = 1.0
    ratio: Annotated[
        PositiveOrPair, says("share", "small mass over big one, below 1, given or chosen")
    ] = (0.01, 0.99)
    friction: Annotated[Positive, says("share", "coefficient of dry friction, alike both ways")]
    gravity: Annotated[Positive, says("acceleration", "weight per mass")] = 1.0
    stroke: Annotated[Positive, says("length", "way of the small mass relative to the big one")]

    @property
    def ratios(self) -> tuple[float, float]:
        """Smallest and largest ratio."""
        low, high = self.ratio if isinstance(self.ratio, tuple) else (self.ratio, self.ratio)
        return low, high


class TwoMassScene(SceneTable, frozen=True, kw_only=True):
    """The fastest two masses: a slow stroke with the big one at rest, an instantaneous return.

    A worm that is driven by a mass moving to and fro, with an optimum in closed form: a slow
    stroke of the small mass, with the big one at rest, and an instantaneous return, in which
    momentum is conserved and friction does not count. Signals cover the slow stroke; where arcs
    join, the instant stands twice. `timings_s`: `build` and `solve` (of all programs), `optimise`
    and `recheck`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "advance": ("length", "way in a cycle"),
        "mass_ratio": ("share", "small mass over big one"),
        **OPTIMUM,
    }
    variables: ClassVar = INSTANT | {
        "position": ("length", ("mass", "instant"), "position of the mass"),
        "velocity": ("speed", ("mass", "instant"), "velocity of the mass"),
        "force": ("force", ("instant",), "force of the actuator"),
        "contact_share": ("share", ("mass", "instant"), "force of the ground over the weight"),
    }

    kind: Literal["two-mass"]
    want: Signals = ()
    pair: Annotated[PairTable, says("", "the masses")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("pair.ratio", self.pair.ratios, may_be_equal=True)
        if self.pair.ratios[1] >= 1:
            yield (
                "pair.ratio",
                "1 or above: the big mass cannot hold the small one; stay below 1",
            )


class CapsuleTable(Table, frozen=True, kw_only=True):
    """A capsule with a mass inside."""

    share: Annotated[Share, says("share", "inner mass over the whole")]
    friction: Annotated[
        Positive, says("acceleration", "dry friction per mass of the whole, alike both ways")
    ]
    stroke: Annotated[Positive, says("length", "how far the inner mass goes")]


class CapsuleScene(SceneTable, frozen=True, kw_only=True):
    """The fastest capsule whose inner mass moves to and fro at two constant relative velocities.

    A worm that is driven by a mass moving to and fro, with an optimum in closed form: the inner
    mass has the relative velocities *u*<sub>1</sub>, −*u*<sub>2</sub> in turn, changed by
    impulses; the body is at rest at both ends of a cycle. Where arcs join, the instant stands
    twice. `timings_s`: `build` and `solve` (of all programs), `optimise` and `recheck`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "inner_speeds": ("speed", "relative velocities *u*<sub>1</sub>, −*u*<sub>2</sub>"),
        **OPTIMUM,
    }
    variables: ClassVar = INSTANT | {
        "position": ("length", ("instant",), "position of the body"),
        "velocity": ("speed", ("instant",), "velocity of the body"),
        "inner_position": ("length", ("instant",), "position of the inner mass in the body"),
        "inner_velocity": (
            "speed",
            ("instant",),
            "velocity of the inner mass relative to the body",
        ),
        "contact_force": (
            "acceleration",
            ("instant",),
            "force of the ground per mass of the whole",
        ),
    }

    kind: Literal["capsule"]
    want: Signals = ()
    capsule: Annotated[CapsuleTable, says("", "the capsule")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
