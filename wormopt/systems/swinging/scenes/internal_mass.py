"""Scenes of the kinds "two-mass" and "capsule": worms driven by a mass that moves to and fro."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Positive,
    PositiveOrPair,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)

Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]


class PairTable(Table, frozen=True, kw_only=True):
    """Two masses on rough ground.

    Parameters
    ----------
    mass : float
        Mass M of the big one.
    ratio : float or tuple of float
        Mass of the small one over that of the big one, or a range in which it is chosen.
    friction : float
        Coefficient of dry friction, alike both ways.
    gravity : float
        Weight per mass.
    stroke : float
        How far the small mass goes.
    """

    mass: Positive = 1.0
    ratio: PositiveOrPair = (0.01, 0.99)
    friction: Positive
    gravity: Positive = 1.0
    stroke: Positive

    @property
    def ratios(self) -> tuple[float, float]:
        """Smallest and largest ratio."""
        low, high = self.ratio if isinstance(self.ratio, tuple) else (self.ratio, self.ratio)
        return low, high


class TwoMassScene(SceneTable, frozen=True, kw_only=True):
    """The fastest two masses: a slow stroke with the big one at rest, an instantaneous return.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"two-mass"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    pair : PairTable
        The masses.
    """

    kind: Literal["two-mass"]
    want: tuple[Literal["signals"], ...] = ()
    pair: PairTable

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from wrong_order("pair.ratio", self.pair.ratios, may_be_equal=True)
        if self.pair.ratios[1] >= 1:
            yield (
                "pair.ratio",
                "1 or above: the big mass cannot hold the small one; stay below 1",
            )


class CapsuleTable(Table, frozen=True, kw_only=True):
    """A capsule with a mass inside.

    Parameters
    ----------
    share : float
        Share mu of the inner mass in the whole.
    friction : float
        Dry friction per mass of the whole, alike both ways.
    stroke : float
        How far the inner mass goes.
    """

    share: Share
    friction: Positive
    stroke: Positive


class CapsuleScene(SceneTable, frozen=True, kw_only=True):
    """The fastest capsule whose inner mass moves to and fro at two constant relative velocities.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"capsule"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    capsule : CapsuleTable
        The capsule.
    """

    kind: Literal["capsule"]
    want: tuple[Literal["signals"], ...] = ()
    capsule: CapsuleTable

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
