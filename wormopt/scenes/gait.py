"""Scenes of kind "gait": what a given gait does under kinematic theory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scenes.types import Pair, Positive, SceneTable, Sharing, Table, wrong_order
from wormopt.scenes.worm import WormTable


class FastGait(Table, frozen=True, kw_only=True, tag_field="shape", tag="fast"):
    """The chapter's gait (15) of a worm of two links.

    Parameters
    ----------
    period : float
        Period of the gait.
    rest_length : float
        Length l0: link 1 is l0 at its shortest, link 2 at its longest.
    elongation : float
        e of (15), above 0 and below 1/2: each link changes by 2 e l0.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    period: Positive
    rest_length: Positive = 2.0
    elongation: Annotated[
        float, Meta(gt=0, lt=0.5, description="a number above 0 and below 0.5")
    ] = 0.15
    sharing: Sharing = "equal"

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links.

        Parameters
        ----------
        links : int
            Number of links.
        folder : Path
            Folder of the scene.
        """
        if links != 2:
            yield "gait.shape", f'"fast" has 2 links, the worm {links}; set worm.links = 2'


class Wave(Table, frozen=True, kw_only=True, tag_field="shape"):
    """What the constructed gaits share: links that go between two lengths.

    Parameters
    ----------
    period : float
        Period of the gait.
    length : tuple of two floats
        Shortest and longest length of every link.
    profile : {"cosine", "quintic", "trapezoid"}
        Course of a link from one length to the other: cosine is C1, quintic C2, trapezoid has
        a piecewise linear rate.
    ramp : float, optional
        Of a trapezoid, the share of the stroke spent speeding up and again slowing down, 0 to
        1/2; 0 means corners in the length.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    period: Positive
    length: Pair
    profile: Literal["cosine", "quintic", "trapezoid"] = "cosine"
    ramp: Annotated[float, Meta(ge=0, le=0.5, description="a number from 0 to 0.5")] | None = None
    sharing: Sharing = "equal"

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what is wrong between the keys, or does not fit a worm of so many links.

        Parameters
        ----------
        links : int
            Number of links.
        folder : Path
            Folder of the scene.
        """
        yield from wrong_order("gait.length", self.length, may_be_equal=False)
        if self.profile == "trapezoid" and self.ramp is None:
            yield "gait.ramp", 'missing; profile = "trapezoid" needs a number from 0 to 0.5'
        if self.profile != "trapezoid" and self.ramp is not None:
            yield "gait.ramp", f'profile = "{self.profile}" has no ramp; leave the key out'


class BlockWave(Wave, frozen=True, kw_only=True, tag="block_wave"):
    """A block of neighbouring resting masses runs from tail to head.

    Parameters
    ----------
    period : float
        Period of the gait.
    length : tuple of two floats
        Shortest and longest length of every link.
    profile : {"cosine", "quintic", "trapezoid"}
        Course of a link from one length to the other.
    ramp : float, optional
        Share of the stroke a trapezoid speeds up, and slows down.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    resting : int
        Number of resting masses, 1 to the number of links.
    """

    resting: Annotated[int, Meta(ge=1, le=8, description="a whole number, 1 or above")] = 1

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield what is wrong between the keys, or does not fit a worm of so many links.

        Parameters
        ----------
        links : int
            Number of links.
        folder : Path
            Folder of the scene.
        """
        yield from super().faults(links, folder)
        yield from too_many_resting(self.resting, links)


class Accordion(Wave, frozen=True, kw_only=True, tag="accordion"):
    """All links contract while the head rests, then extend while the tail rests.

    Parameters
    ----------
    period : float
        Period of the gait.
    length : tuple of two floats
        Shortest and longest length of every link.
    profile : {"cosine", "quintic", "trapezoid"}
        Course of a link from one length to the other.
    ramp : float, optional
        Share of the stroke a trapezoid speeds up, and slows down.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """


class GaitFile(Table, frozen=True, kw_only=True, tag_field="shape", tag="file"):
    """A gait from a file.

    Parameters
    ----------
    file : str
        A CSV table t, l_1, ..., l_n or the ``result.nc`` of a designed gait; relative to the
        folder of the scene.
    period : float, optional
        Run the gait with this period instead of the file's own.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    """

    file: Annotated[str, Meta(min_length=1, description="the name of a .csv or .nc file")]
    period: Positive | None = None
    sharing: Sharing = "equal"

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield a fault if the file is of no known form or cannot be read.

        Parameters
        ----------
        links : int
            Number of links; whether the file has so many shows when it is read.
        folder : Path
            Folder of the scene.
        """
        path = folder / self.file
        if path.suffix.lower() not in (".csv", ".nc"):
            yield "gait.file", f'"{self.file}" ends in neither .csv nor .nc'
            return
        try:
            with path.open("rb"):
                pass
        except (OSError, ValueError) as error:  # ValueError: a name with a null character
            why = getattr(error, "strerror", None) or error
            yield "gait.file", f'"{self.file}" cannot be read from {folder}: {why}'


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
        """Check what no single key shows.

        Parameters
        ----------
        folder : Path
            Folder of the scene.
        """
        yield from super().faults(folder)
        yield from self.worm.faults()
        yield from self.gait.faults(self.worm.links, folder)


def too_many_resting(resting: int, links: int) -> Iterator[Fault]:
    """Yield a fault if more masses are to rest than can while the worm moves.

    Parameters
    ----------
    resting : int
        Number of masses that rest at any time.
    links : int
        Number of links.
    """
    if resting > links:
        yield (
            "gait.resting",
            f"{resting} resting masses leave a worm of {links} links none to move; "
            f"write at most {links}",
        )
