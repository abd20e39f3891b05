"""Shapes of gaits: link lengths over one period, as given in scenes or read from results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault
from wormopt.study.given import Given, entry, number, positive, says
from wormopt.study.types import Pair, Positive, wrong_order
from wormopt.systems.spiked.limits import Sharing
from wormopt.tables import SUFFIXES

Few = Annotated[int, Meta(ge=1, description="a whole number, 1 or above")]
Point = Annotated[int, Meta(ge=0, description="a whole number, 0 or above")]
GaitPath = Annotated[str, Meta(min_length=1, description="the name of a .csv or .nc file")]
Period = Annotated[Positive, says("time", "period *T*")]
Shared = Annotated[
    Sharing,
    says(
        "",
        "how several resting masses share the load, see "
        "[theory](../theory-kinematic.md#5-spike-loads-and-sharing-rules); spikes have no load "
        "limit here",
    ),
]


class FastShape(Given, tag_field="shape", tag="fast"):
    """The gait of eq. 15 of Zimmermann et al. 2007: two links, one mass at rest at any time.

    Refused: `worm.links` other than 2.
    """

    period: Period
    rest_length: float = positive(
        "length",
        "*l*<sub>0</sub> of eq. 15: link 0 moves between 1 and 1 + 2*e* times this length, "
        "link 1 between 1 − 2*e* and 1 times it",
        default=2.0,
    )
    elongation: float = number(
        "share",
        "*e*: the worm advances 4 *e l*<sub>0</sub> per period",
        above=0,
        below=0.5,
        default=0.15,
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what does not fit a worm with `links` links; `key` is this table's key path."""
        if links != 2:
            yield f"{key}.shape", f'"fast" has 2 links, the worm has {links}; set worm.links = 2'


class WaveShape(Given, tag_field="shape"):
    """Keys common to the constructed gaits: all links move between two lengths."""

    period: Period
    length: Pair = entry("range of every link; the difference is the stroke *D*", quantity="length")
    profile: Literal["cosine", "quintic", "trapezoid"] = entry(
        "profile of a length within a phase: `cosine` is once and `quintic` twice "
        "continuously differentiable, `trapezoid` has a piecewise linear rate",
        default="cosine",
    )
    ramp: float | None = number(
        "share",
        "for `trapezoid`: share of the phase in which the rate rises, and again in which it "
        "falls; 0 gives corners in the lengths",
        least=0,
        most=0.5,
        default=None,
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys; `key` is this table's key path."""
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)
        if self.profile == "trapezoid" and self.ramp is None:
            yield f"{key}.ramp", 'missing; profile = "trapezoid" needs it: write 0 to 0.5'
        if self.profile != "trapezoid" and self.ramp is not None:
            yield f"{key}.ramp", f'given, but profile = "{self.profile}" has no ramp; remove it'


class BlockWaveShape(WaveShape, tag="block_wave"):
    """A block of neighbouring resting masses moves from tail to head, in *n* + 1 equal phases.

    Refused: an empty range of lengths; `resting` above *n*; `profile = "trapezoid"` without
    `ramp`, `ramp` with another profile.
    """

    resting: Few = entry("masses in the block, up to *n*", quantity="count", default=1)

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield the faults between the keys, and what does not fit a worm with `links` links."""
        yield from super().faults(links, folder, key)
        if self.resting > links:
            yield (
                f"{key}.resting",
                f"{self.resting} resting masses leave a worm of {links} links no mass to move; "
                f"write at most {links}",
            )


class AccordionShape(WaveShape, tag="accordion"):
    """All links contract while the head rests, then extend while the tail rests.

    Refused: an empty range of lengths; `profile = "trapezoid"` without `ramp`, `ramp` with
    another profile.
    """


class SineShape(Given, tag_field="shape", tag="sine"):
    """A sine wave that runs from link to link; each link lags behind the one ahead of it.

    *l*<sub>j</sub> = `rest_length` + `amplitude` sin(2π(*t*/`period` − (*j* + 1) `lag`)).
    """

    period: Period
    rest_length: float = number("length", "mean length of every link", default=2.0)
    amplitude: float = positive("length", "amplitude of every link", default=0.6)
    lag: float = number(
        "share",
        "lag of each link behind the one ahead of it, as a share of a period; link 0 lags by "
        "the same share",
        default=1 / 3,
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield nothing: a sine fits every worm."""
        yield from ()


class FileShape(Given, tag_field="shape", tag="file"):
    """A gait from a file.

    A table holds times and lengths over one closed period as text. Units in column names, `l_0
    [mm]`, are converted to those of the scene. A time with two rows is a break of the rates. Steep
    tables are interpolated such that lengths stay between the rows. The trust report says so, and
    reports where the interpolation adds more than 1 %.

    Refused: a file that cannot be read, contains no gait, or has a different number of links than
    the worm; units in a scene without units.
    """

    file: GaitPath = entry(
        "table `t,l_0,l_1,...` (`.csv`, `.txt`, `.tsv`, `.dat`), or the `result.nc` of any "
        "scene with a gait; relative to the scene's folder"
    )
    point: Point | None = entry(
        "point of a front (kind `gait-pareto`), 0 is the slowest; default: its knee", default=None
    )
    period: float | None = positive(
        "time", "run the gait with this period instead of the file's own", default=None
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield a fault if the file has no known suffix or cannot be read.

        Whether it has `links` links is known only after reading.
        """
        path = folder / self.file
        is_table = path.suffix.lower() in SUFFIXES
        if not is_table and path.suffix.lower() != ".nc":
            known = ", ".join((*SUFFIXES, ".nc"))
            yield f"{key}.file", f'"{self.file}" has no known suffix; name a file with {known}'
            return
        unreadable = why_unreadable(path)
        if unreadable:
            yield f"{key}.file", f'"{self.file}" cannot be read from {folder}: {unreadable}'
        if self.point is not None and is_table:
            yield f"{key}.point", "given, but a table holds one gait; remove it"

    def file_warnings(self, folder: Path, units: str) -> Iterator[str]:
        """Yield notes on the interpolation of a table."""
        path = folder / self.file
        if path.suffix.lower() in SUFFIXES:
            from wormopt.model.gait_table import read_gait

            with suppress(OSError, ArgumentError):  # reported by the run
                _, _, notes = read_gait(path, "SI" if units == "SI" else "dimensionless")
                yield from (f"{self.file}: {what}" for what in notes)


Shape = FastShape | BlockWaveShape | AccordionShape | SineShape | FileShape


class FastGait(FastShape):  # noqa: D101
    __doc__ = FastShape.__doc__
    sharing: Shared = "equal"


class BlockWave(BlockWaveShape):  # noqa: D101
    __doc__ = BlockWaveShape.__doc__
    sharing: Shared = "equal"


class Accordion(AccordionShape):  # noqa: D101
    __doc__ = AccordionShape.__doc__
    sharing: Shared = "equal"


class GaitFile(FileShape):  # noqa: D101
    __doc__ = FileShape.__doc__
    sharing: Shared = "equal"


GivenGait = FastGait | BlockWave | Accordion | GaitFile


def why_unreadable(path: Path) -> str:
    """Say why a file cannot be read, and what to write instead; empty if it can."""
    try:
        with path.open("rb"):
            return ""
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        why = getattr(error, "strerror", None) or str(error)
        return f"{why}; write the name of a file, relative to this folder"
