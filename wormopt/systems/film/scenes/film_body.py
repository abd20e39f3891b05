"""Scenes of kind "film-body": a heavy float, or a body on the ground, under a given wave."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.scene.numerics import ToleranceTable
from wormopt.scene.types import Finite, NonNegative, Positive, SceneTable, Table, says
from wormopt.systems.film.scenes.film import FilmTable, Length, RideTable

# What only bodies of one place, or scenes of one sort of units, have.
_GROUND = ("friction_forward", "friction_backward", "friction_coefficient")
_SCALED = ("mass", "weight", "friction_forward", "friction_backward")
_SI = ("density", "friction_coefficient")
_FARTHEST = 1e6  # wavelengths: further away, phases have no more than nine digits


class BodyTable(Table, frozen=True, kw_only=True):
    """The body.

    Scenes without units count in the scales of (25), *η* being the viscosity, *ω* and *k*
    frequency and number of the wave, *d* the mean thickness.
    """

    on: Annotated[
        Literal["surface", "ground"], says("", "where it is: it floats, or lies in the film")
    ]
    length: Annotated[Length, says("1", "in wavelengths; 0 is a short one")] = 0.0
    height: Annotated[
        NonNegative,
        says("1", "over the mean thickness of the film; on the ground below its least thickness"),
    ] = 0.0
    position: Annotated[
        Finite, says("1", "place of its middle at time 0, in wavelengths ahead of a crest")
    ] = 0.0
    mass: Annotated[Positive | None, says("1", "mass per area times *ω d*/*η*")] = None
    weight: Annotated[
        NonNegative | None, says("1", "of a float, per area times (*k d*)²/(*η ω*); default 0")
    ] = None
    friction_forward: Annotated[
        NonNegative | None,
        says("1", "on the ground, per area times *k d*/(*η ω*), against motion with the wave"),
    ] = None
    friction_backward: Annotated[
        NonNegative | None, says("1", "the same against the wave; default: the same")
    ] = None
    density: Annotated[Positive | None, says("density", "of the body (SI)")] = None
    friction_coefficient: Annotated[
        NonNegative | None,
        says("1", "friction over the weight less buoyancy, on the ground (SI)"),
    ] = None

    def faults(self, units: str, fluid_density: float | None) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        given = {name for name in self.__struct_fields__ if getattr(self, name) is not None}
        for name in _SI if units != "SI" else _SCALED:
            if name in given:
                other = 'write units = "SI"' if units != "SI" else "density tells it here"
                yield f"body.{name}", f"belongs to scenes {_sort(units)} units; {other}"
        for name in _GROUND if self.on == "surface" else ("weight",):
            if name in given and name not in (_SI if units != "SI" else _SCALED):
                yield f"body.{name}", f'is not of a body with on = "{self.on}"; leave it out'
        needed = ["mass"] if units != "SI" else ["density"]
        if self.on == "ground":
            needed.append("friction_forward" if units != "SI" else "friction_coefficient")
        for name in needed:
            if name not in given:
                yield f"body.{name}", "missing"
        if abs(self.position) > _FARTHEST:
            yield (
                "body.position",
                f"{self.position:g} wavelengths away no digits are left for the phase; every "
                f"wavelength is alike: write {math.fmod(self.position, 1.0):g}",
            )
        if units == "SI" and not self.height:
            yield "body.height", "must be above 0: density times height is the mass"
        if fluid_density is not None and self.density is not None:
            lighter = self.density < fluid_density
            if lighter != (self.on == "surface"):
                place, does = ("ground", "sinks") if not lighter else ("surface", "rises")
                message = f"of this density in a fluid of {fluid_density:g} kg/m³ it {does}"
                yield "body.on", f'{message}; write on = "{place}"'


def _sort(units: str) -> str:
    return "with SI" if units != "SI" else "without"


class FilmBodyScene(SceneTable, frozen=True, kw_only=True):
    """What a travelling wave does to a body with a mass.

    A float that has a mass and a weight, or a body that lies in the film on the ground, sticks and
    slips. It does not change the wave. Theory:
    [theory-film.md](../theory-film.md#26-floats-with-a-mass). Speeds are over the wave's, in SI
    scenes in m/s.

    What forces gave must be the momentum and the energy of the body, to 1e-7 or a thousand
    tolerances, and a second route must end where the first does.
    """

    scalars: ClassVar = {
        "drift": (
            "speed",
            "mean velocity between the last two troughs that passed, the wave's if it is held; "
            "unknown where fewer passed",
        ),
        "drift_massless": ("speed", "of the same body without mass, by quadrature"),
        "held": ("1", "whether the wave carries it along in the end"),
        "settled": ("1", "how far the last two turns differ, over the last"),
        "speed_max": ("speed", "largest velocity in the last turn"),
        "speed_min": ("speed", "least velocity in the last turn: negative against the wave"),
        "at_rest": ("1", "share of the last turn in which the ground holds it"),
        "friction_forward": (
            "stress",
            "friction per area from which on it never moves with the wave (on the ground)",
        ),
        "friction_backward": ("stress", "the same against the wave"),
        "friction": ("stress", "the ground's, per area, against motion with the wave"),
        "mass": ("1", "per area times *ω d*/*η*"),
        "weight": ("1", "per area times (*k d*)²/(*η ω*)"),
        "draught": ("1", "of a float over the mean thickness of the film (SI)"),
        "turn": ("time", "between the last two troughs"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "wavelength": ("length", "of the wave (SI)"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "position": ("length", ("time",), "middle of the body"),
        "velocity": ("speed", ("time",), "of the body"),
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("length", ("xi",), "thickness of the film"),
        "velocity_massless": ("speed", ("xi",), "of the body without mass by phase"),
    }

    kind: Literal["film-body"]
    want: Annotated[
        tuple[Literal["carried"], ...], says("", "`carried`: the body under the wave, its velocity")
    ] = ()
    film: Annotated[FilmTable, says("", "film and wave")]
    body: Annotated[BodyTable, says("", "the body")]
    course: Annotated[RideTable, says("", "the time")] = field(default_factory=RideTable)
    tolerance: Annotated[ToleranceTable, says("", "how exact simulations are")] = field(
        default_factory=ToleranceTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults(self.units)
        fluid = self.film.fluid
        yield from self.body.faults(self.units, fluid.density if fluid else None)
        if self.film.tension and self.body.on == "surface":
            yield "film.tension", "does not act on what floats; leave it out"
