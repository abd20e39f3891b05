"""Tables of scenes of kind "film-body": a heavy float, or a body on the ground, in a wave."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive
from wormopt.study.numerics import ToleranceTable
from wormopt.study.types import SceneTable
from wormopt.systems.film.scenes.film import Length, RideTable
from wormopt.systems.film.tables import Film

# Keys that apply to one type of body, or to one system of units, only.
_GROUND = ("friction_forward", "friction_backward", "friction_coefficient")
_SCALED = ("mass", "weight", "friction_forward", "friction_backward")
_SI = ("density", "friction_coefficient")
_FARTHEST = 1e6  # In wavelengths: farther away, phases have no more than nine digits.


class BodyTable(Given):
    """The body.

    Scenes without units use the scales of eq. 25 of Zimmermann et al. 2007: *η* is the viscosity,
    *ω* and *k* are frequency and wave number, *d* is the mean thickness.
    """

    on: Literal["surface", "ground"] = entry(
        "type of body: it floats, or lies in the film on the ground"
    )
    length: Length = entry("length in wavelengths; 0: a short body", quantity="1", default=0.0)
    height: float = number(
        "1",
        "height over the mean film thickness; on the ground below the least film thickness",
        least=0,
        default=0.0,
    )
    position: float = number(
        "1", "initial position of the middle, in wavelengths ahead of a crest", default=0.0
    )
    mass: float | None = positive("1", "mass per area times *ω d*/*η*", default=None)
    weight: float | None = number(
        "1", "weight of a float per area, times (*k d*)²/(*η ω*); default 0", least=0, default=None
    )
    friction_forward: float | None = number(
        "1",
        "friction on the ground per area, times *k d*/(*η ω*), against motion with the wave",
        least=0,
        default=None,
    )
    friction_backward: float | None = number(
        "1",
        "friction on the ground against motion opposite to the wave; default: the same",
        least=0,
        default=None,
    )
    density: float | None = positive("density", "density of the body (SI)", default=None)
    friction_coefficient: float | None = number(
        "1", "friction on the ground over weight minus buoyancy (SI)", least=0, default=None
    )

    def faults(self, units: str, fluid_density: float | None) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        given = {name for name in self.__struct_fields__ if getattr(self, name) is not None}
        for name in _SI if units != "SI" else _SCALED:
            if name in given:
                other = 'write units = "SI"' if units != "SI" else "density determines it here"
                yield f"body.{name}", f"applies to scenes {_sort(units)} units only; {other}"
        for name in _GROUND if self.on == "surface" else ("weight",):
            if name in given and name not in (_SI if units != "SI" else _SCALED):
                yield f"body.{name}", f'does not apply to on = "{self.on}"; leave it out'
        needed = ["mass"] if units != "SI" else ["density"]
        if self.on == "ground":
            needed.append("friction_forward" if units != "SI" else "friction_coefficient")
        for name in needed:
            if name not in given:
                yield f"body.{name}", "missing"
        if abs(self.position) > _FARTHEST:
            yield (
                "body.position",
                f"{self.position:g} wavelengths are too far for an accurate phase; all "
                f"wavelengths are equal: write {math.fmod(self.position, 1.0):g}",
            )
        if units == "SI" and not self.height:
            yield (
                "body.height",
                "is 0, but the mass is density times height; write a height above 0",
            )
        if fluid_density is not None and self.density is not None:
            lighter = self.density < fluid_density
            if lighter != (self.on == "surface"):
                place, does = ("ground", "sinks") if not lighter else ("surface", "rises")
                message = f"a body of this density {does} in a fluid of {fluid_density:g} kg/m³"
                yield "body.on", f'{message}; write on = "{place}"'


def _sort(units: str) -> str:
    return "with SI" if units != "SI" else "without"


class FilmBodyScene(SceneTable):
    """Motion of a body with mass in a travelling wave.

    The body is a float with mass and weight, or lies in the film on the ground, where it sticks and
    slips. It does not change the wave. Theory:
    [theory-film.md](../theory-film.md#26-floats-with-a-mass). Speeds are relative to the wave
    speed, in SI scenes in m/s.

    The integrals of the forces must agree with momentum and energy of the body, to 1e-7 or a
    thousand tolerances. A second route must end at the same state.
    """

    scalars: ClassVar = {
        "drift": (
            "speed",
            "mean velocity between the last two troughs that passed; the wave speed if the body "
            "is held; unknown if fewer passed",
        ),
        "drift_massless": ("speed", "mean velocity of the same body without mass, by quadrature"),
        "held": ("1", "whether the wave carries the body along at the end"),
        "settled": ("1", "relative difference between the last two turns"),
        "speed_max": ("speed", "largest velocity in the last turn"),
        "speed_min": ("speed", "least velocity in the last turn; negative: opposite to the wave"),
        "at_rest": ("1", "share of the last turn in which the ground holds the body"),
        "friction_forward": (
            "stress",
            "least friction per area at which the body never moves with the wave (on the ground)",
        ),
        "friction_backward": (
            "stress",
            "least friction per area at which the body never moves opposite to the wave (on the "
            "ground)",
        ),
        "friction": ("stress", "friction of the ground per area, against motion with the wave"),
        "mass": ("1", "mass per area times *ω d*/*η*"),
        "weight": ("1", "weight per area times (*k d*)²/(*η ω*)"),
        "draught": ("1", "draught of the float over the mean film thickness (SI)"),
        "turn": ("time", "time between the last two troughs"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "wavelength": ("length", "wavelength of the wave (SI)"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "position": ("length", ("time",), "position of the middle of the body"),
        "velocity": ("speed", ("time",), "velocity of the body"),
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("length", ("xi",), "thickness of the film"),
        "velocity_massless": ("speed", ("xi",), "velocity of the body without mass over the phase"),
    }

    kind: Literal["film-body"]
    want: tuple[Literal["carried"], ...] = entry(
        "`carried`: the body in the wave, and its velocity", default=()
    )
    film: Film = entry("film and wave")
    body: BodyTable = entry("the body")
    course: RideTable = entry("duration of the simulation", default=RideTable)
    tolerance: ToleranceTable = entry("tolerances of the simulation", default=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults_in(self.units)
        fluid = self.film.fluid
        yield from self.body.faults(self.units, fluid.density if fluid else None)
        if self.film.tension and self.body.on == "surface":
            yield "film.tension", "has no effect on floats; leave it out"
