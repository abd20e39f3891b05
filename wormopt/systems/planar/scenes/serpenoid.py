"""Scenes of kind "planar-serpenoid": how fast a wave of bending carries a long worm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, SceneTable, says

Amplitude = Annotated[
    float, Meta(gt=0, le=2.4, description="a number above 0, at most 2.4: J0 is 0 at 2.4048")
]
Ratio = Annotated[float, Meta(gt=1, le=1e6, description="a number above 1, at most 1000000")]


class PlanarSerpenoidScene(SceneTable, frozen=True, kw_only=True):
    """Speed of a worm through which a serpenoid wave of bending runs backward.

    The tangent leans from the way by *α* sin *ks*. Infinite worms on viscous or dry ground, by
    amplitude; on viscous ground also worms of rods, whose ends recoil. See
    [theory](../theory-planar.md#6-serpenoid-waves).

    `timings_s`: `infinite` and `finite`.
    """

    headline: ClassVar = ("speed", "speed_over_wave", "amplitude_best", "speed_best")
    scalars: ClassVar = {
        "speed": ("1", "speed over that of the material along the wave, *V*/*c*"),
        "speed_over_wave": ("1", "over that of the wave along the way"),
        "amplitude_best": ("angle", "at which the speed over that of the material is largest"),
        "speed_best": ("1", "`speed` there"),
        "recheck_error": (
            "share",
            "difference to the speed found by another way, over speed + *α*²/4",
        ),
        "finite_over_wave": ("1", "`speed_over_wave` of worms of so many `waves`, viscous"),
    }
    variables: ClassVar = {
        "amplitude": ("angle", ("amplitude",), "amplitude of the tangent's angle"),
        "speed_by_amplitude": ("1", ("amplitude",), "speed over that of the material"),
    }

    kind: Literal["planar-serpenoid"]
    want: Annotated[
        tuple[Literal["serpenoid"], ...],
        says("", "`serpenoid`: speed by amplitude, and the wave in the plane"),
    ] = ()
    amplitude: Annotated[Amplitude, says("angle", "*α* of the tangent's angle")]
    ratio: Annotated[Ratio, says("1", "resistance across over along: *r*, or *ρ* on dry ground")]
    ground: Annotated[
        Literal["viscous", "elliptic", "unit"],
        says("", "`viscous`; or dry: `elliptic` takes most power, `unit` goes by direction alone"),
    ] = "viscous"
    waves: Annotated[
        tuple[Positive, ...],
        says("count", "waves on worms of finite length; viscous ground only"),
    ] = ()
    rods_per_wave: Annotated[
        int,
        Meta(ge=3, le=60, description="a whole number from 3 to 60"),
        says("count", "rods of these"),
    ] = 12

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        if self.waves and self.ground != "viscous":
            yield (
                "waves",
                "worms of finite length are computed on viscous ground only; leave it out",
            )
        for waves in self.waves:
            rods = waves * self.rods_per_wave
            if abs(rods - round(rods)) > 1e-9 * rods:
                yield "waves", f"{waves:g} waves are no whole number of rods; change rods_per_wave"
            elif not 2 <= round(rods) <= 60:
                yield "waves", f"{waves:g} waves need 2 to 60 rods in all; change rods_per_wave"
