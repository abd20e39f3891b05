"""Tables of scenes of the kinds "two-mass" and "capsule": worms driven by an internal mass."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says
from wormopt.study.types import PositiveOrPair, SceneTable, wrong_order
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

Signals = Annotated[tuple[Literal["signals"], ...], says("", "`signals`: signals over time")]


class PairTable(Given):
    """Two masses on rough ground."""

    mass: float = positive("mass", "big mass", default=1.0)
    ratio: PositiveOrPair = entry(
        "small mass over big mass, below 1, fixed or a range",
        quantity="share",
        default=(0.01, 0.99),
    )
    friction: float = positive("share", "coefficient of dry friction, equal in both directions")
    gravity: float = positive("acceleration", "gravitational acceleration", default=1.0)
    stroke: float = positive("length", "displacement of the small mass relative to the big one")

    @property
    def ratios(self) -> tuple[float, float]:
        """Smallest and largest ratio."""
        low, high = self.ratio if isinstance(self.ratio, tuple) else (self.ratio, self.ratio)
        return low, high


class TwoMassScene(SceneTable):
    """The fastest cycle of two masses: a slow stroke and an instantaneous return.

    A mass that moves to and fro drives the worm. In the slow stroke of the small mass, the big mass
    is at rest. The return is instantaneous: momentum is conserved and friction has no effect. The
    optimum is known in closed form. Signals cover the slow stroke and contain the instants at which
    arcs join twice. `timings_s`: `build` and `solve` (of all programs), `optimise` and `recheck`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "advance": ("length", "displacement in a cycle"),
        "mass_ratio": ("share", "small mass over big mass"),
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
    pair: PairTable = entry("the masses")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("pair.ratio", self.pair.ratios, may_be_equal=True)
        if self.pair.ratios[1] >= 1:
            yield (
                "pair.ratio",
                "is 1 or above, and then the big mass cannot hold the small one; write less than 1",
            )


class CapsuleTable(Given):
    """A capsule with a mass inside."""

    share: float = number("share", "inner mass over total mass", above=0, below=1)
    friction: float = positive(
        "acceleration", "dry friction per total mass, equal in both directions"
    )
    stroke: float = positive("length", "displacement of the inner mass")


class CapsuleScene(SceneTable):
    """The fastest capsule whose inner mass moves to and fro at two constant relative velocities.

    The inner mass has the relative velocities *u*<sub>1</sub> and −*u*<sub>2</sub> in turn, changed
    by impulses. The body is at rest at both ends of a cycle. The optimum is known in closed form.
    The arrays contain the instants at which arcs join twice. `timings_s`: `build` and `solve` (of
    all programs), `optimise` and `recheck`.
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
            "force of the ground per total mass",
        ),
    }

    kind: Literal["capsule"]
    want: Signals = ()
    capsule: CapsuleTable = entry("the capsule")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
