"""Scenes of kind "planar-serpenoid": speed of a long worm with a bending wave."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import entry, number, whole
from wormopt.study.types import Positive, SceneTable

Amplitude = Annotated[
    float, Meta(gt=0, le=2.4, description="a number above 0, at most 2.4: J0 is 0 at 2.4048")
]


class PlanarSerpenoidScene(SceneTable):
    """Speed of a worm with a serpenoid bending wave that travels backward along the body.

    The tangent angle is *α* sin *ks*. Infinite worms on viscous or dry ground are computed over
    the amplitude. On viscous ground, worms of finite length, made of rods, are computed too; their
    ends recoil. See [theory](../theory-planar.md#6-serpenoid-waves).

    `timings_s`: `infinite` and `finite`.
    """

    headline: ClassVar = ("speed", "speed_over_wave", "amplitude_best", "speed_best")
    scalars: ClassVar = {
        "speed": ("1", "speed relative to that of the material along the wave, *V*/*c*"),
        "speed_over_wave": ("1", "speed relative to that of the wave in space"),
        "amplitude_best": ("angle", "amplitude with the highest *V*/*c*"),
        "speed_best": ("1", "`speed` at `amplitude_best`"),
        "recheck_error": (
            "share",
            "difference to the speed of a second route, relative to speed + *α*²/4",
        ),
        "finite_over_wave": ("1", "`speed_over_wave` of finite worms with `waves`, viscous ground"),
    }
    variables: ClassVar = {
        "amplitude": ("angle", ("amplitude",), "amplitude of the tangent angle"),
        "speed_by_amplitude": ("1", ("amplitude",), "speed relative to that of the material"),
    }

    kind: Literal["planar-serpenoid"]
    want: tuple[Literal["serpenoid"], ...] = entry(
        "`serpenoid`: speed over amplitude, and the wave in the plane", default=()
    )
    amplitude: float = number("angle", "amplitude *α* of the tangent angle", above=0, most=2.4)
    ratio: float = number(
        "1", "resistance across over along: *r*, or *ρ* on dry ground", above=1, most=1000000.0
    )
    ground: Literal["viscous", "elliptic", "unit"] = entry(
        "`viscous`, or dry: `elliptic` (maximal dissipation), `unit` (direction alone)",
        default="viscous",
    )
    waves: tuple[Positive, ...] = entry(
        "numbers of waves on finite worms; viscous ground only", quantity="count", default=()
    )
    rods_per_wave: int = whole(3, 60, "number of rods per wave on finite worms", default=12)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        if self.waves and self.ground != "viscous":
            yield (
                "waves",
                "finite worms are computed on viscous ground only; leave it out",
            )
        for waves in self.waves:
            rods = waves * self.rods_per_wave
            if abs(rods - round(rods)) > 1e-9 * rods:
                yield "waves", f"{waves:g} waves are no whole number of rods; change rods_per_wave"
            elif not 2 <= round(rods) <= 60:
                yield "waves", f"{waves:g} waves need 2 to 60 rods in all; change rods_per_wave"
