"""Shapes of gaits: link lengths over one period, as scenes name them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Finite, Pair, Positive, Table, wrong_order


class FastShape(Table, frozen=True, kw_only=True, tag_field="shape", tag="fast"):
    """The chapter's gait (15) of a worm of two links.

    Parameters
    ----------
    period : float
        Period of the gait.
    rest_length : float
        Length l0: link 1 is l0 at its shortest, link 2 at its longest.
    elongation : float
        e of (15), above 0 and below 1/2: each link changes by 2 e l0.
    """

    period: Positive
    rest_length: Positive = 2.0
    elongation: Annotated[
        float, Meta(gt=0, lt=0.5, description="a number above 0 and below 0.5")
    ] = 0.15

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is this table's key path."""
        if links != 2:
            yield f"{key}.shape", f'"fast" has 2 links, the worm {links}; set worm.links = 2'


class WaveShape(Table, frozen=True, kw_only=True, tag_field="shape"):
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
    """

    period: Positive
    length: Pair
    profile: Literal["cosine", "quintic", "trapezoid"] = "cosine"
    ramp: Annotated[float, Meta(ge=0, le=0.5, description="a number from 0 to 0.5")] | None = None

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys, or does not fit a worm of so many links.

        `key` is the key path of this table.
        """
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)
        if self.profile == "trapezoid" and self.ramp is None:
            yield f"{key}.ramp", 'missing; profile = "trapezoid" needs a number from 0 to 0.5'
        if self.profile != "trapezoid" and self.ramp is not None:
            yield f"{key}.ramp", f'profile = "{self.profile}" has no ramp; leave the key out'


class BlockWaveShape(WaveShape, frozen=True, kw_only=True, tag="block_wave"):
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
    resting : int
        Number of resting masses, 1 to the number of links.
    """

    resting: Annotated[int, Meta(ge=1, description="a whole number, 1 or above")] = 1

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys, or does not fit a worm of so many links.

        `key` is the key path of this table.
        """
        yield from super().faults(links, folder, key)
        yield from too_many_resting(self.resting, links, key)


class AccordionShape(WaveShape, frozen=True, kw_only=True, tag="accordion"):
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
    """


class SineShape(Table, frozen=True, kw_only=True, tag_field="shape", tag="sine"):
    """A sine that runs from link to link, each behind the one ahead of it.

    Parameters
    ----------
    period : float
        Period of the gait.
    rest_length : float
        Mean length of every link.
    amplitude : float
        Amplitude of every link.
    lag : float
        By how much of a period each link is behind the one ahead of it; link 1 itself lags by
        as much.
    """

    period: Positive
    rest_length: Finite = 2.0
    amplitude: Positive = 0.6
    lag: Finite = 1 / 3

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield nothing: a sine fits every worm."""
        yield from ()


class FileShape(Table, frozen=True, kw_only=True, tag_field="shape", tag="file"):
    """A gait from a file.

    Parameters
    ----------
    file : str
        A CSV table t, l_1, ..., l_n or the ``result.nc`` of a designed gait; relative to the
        folder of the scene.
    period : float, optional
        Run the gait with this period instead of the file's own.
    """

    file: Annotated[str, Meta(min_length=1, description="the name of a .csv or .nc file")]
    period: Positive | None = None

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield a fault if the file is of no known form or cannot be read.

        Whether it has `links` links shows only when it is read.
        """
        path = folder / self.file
        if path.suffix.lower() not in (".csv", ".nc"):
            yield f"{key}.file", f'"{self.file}" ends in neither .csv nor .nc'
            return
        unreadable = why_unreadable(path)
        if unreadable:
            yield f"{key}.file", f'"{self.file}" cannot be read from {folder}: {unreadable}'


Shape = FastShape | BlockWaveShape | AccordionShape | SineShape | FileShape


def too_many_resting(resting: int, links: int, key: str = "gait") -> Iterator[Fault]:
    """Yield a fault if more masses are to rest than can while the worm moves.

    `key` is the key path of the table that says so.
    """
    if resting > links:
        yield (
            f"{key}.resting",
            f"{resting} resting masses leave a worm of {links} links none to move; "
            f"write at most {links}",
        )


def why_unreadable(path: Path) -> str:
    """Say why a file cannot be read; empty if it can."""
    try:
        with path.open("rb"):
            return ""
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        return getattr(error, "strerror", None) or str(error)
