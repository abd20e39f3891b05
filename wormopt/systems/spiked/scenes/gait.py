"""Scenes of kind "gait": what a given gait does under kinematic theory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from wormopt.errors import Fault
from wormopt.scene.types import SceneTable
from wormopt.systems.spiked.limits import Sharing
from wormopt.systems.spiked.scenes.shapes import (
    AccordionShape,
    BlockWaveShape,
    FastShape,
    FileShape,
)
from wormopt.systems.spiked.scenes.worm import WormTable


class FastGait(FastShape, frozen=True, kw_only=True):
    """The chapter's gait (15) of a worm of two links.

    Parameters
    ----------
    period, rest_length, elongation : float
        As for `FastShape`.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    sharing: Sharing = "equal"


class BlockWave(BlockWaveShape, frozen=True, kw_only=True):
    """A block of neighbouring resting masses runs from tail to head.

    Parameters
    ----------
    period, length, profile, ramp, resting : object
        As for `BlockWaveShape`.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    sharing: Sharing = "equal"


class Accordion(AccordionShape, frozen=True, kw_only=True):
    """All links contract while the head rests, then extend while the tail rests.

    Parameters
    ----------
    period, length, profile, ramp : object
        As for `AccordionShape`.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    sharing: Sharing = "equal"


class GaitFile(FileShape, frozen=True, kw_only=True):
    """A gait from a file.

    Parameters
    ----------
    file, period : object
        As for `FileShape`.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    sharing: Sharing = "equal"


class GaitScene(SceneTable, frozen=True, kw_only=True):
    """A given gait of a given worm.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"gait"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        The worm.
    gait : FastGait, BlockWave, Accordion or GaitFile
        The gait.
    """

    kind: Literal["gait"]
    want: tuple[Literal["gait", "motion", "spikes", "animation"], ...] = ()
    worm: WormTable
    gait: FastGait | BlockWave | Accordion | GaitFile

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults()
        yield from self.gait.faults(self.worm.links, folder)
