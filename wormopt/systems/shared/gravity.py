"""Weights of masses on a slope, and the cost of transport: energy by weight and distance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.study.given import says
from wormopt.study.types import Positive

_ADDS = (
    "angle at which the ground rises forward: *m*<sub>i</sub> *g* sin(`slope`) is added to the "
    "load on each mass"
)
Uphill = Annotated[
    Annotated[float, Meta(ge=0, le=math.pi / 2, description="an angle from 0 to pi/2")],
    says("rad", f"{_ADDS}; kind `fit-design` needs equal masses then"),
]
Inclined = Annotated[
    Annotated[
        float, Meta(ge=-math.pi / 2, le=math.pi / 2, description="an angle from -pi/2 to pi/2")
    ],
    says("rad", f"{_ADDS}; negative is downhill. Friction forces keep their given values"),
]
Gravity = Annotated[
    Positive | None,
    says("acceleration", "*g* for `slope`; default 9.80665 m/s² in SI scenes, required in others"),
]


def weights(slope: float, gravity: float | None, masses: tuple[float, ...]) -> tuple[float, ...]:
    """Component of each mass's weight that pulls it back along the ground."""
    pull = (GRAVITY if gravity is None else gravity) * math.sin(slope)
    return tuple(mass * pull for mass in masses)


def facts_of_slope(
    slope: float, gravity: float | None, masses: tuple[float, ...]
) -> dict[str, Any]:
    """Facts of a trust report on a slope: its pull on each mass, and assumptions."""
    if not slope:
        return {}
    pull = list(weights(slope, gravity, masses))
    known = {"gravity": GRAVITY if gravity is None else gravity, "pull": pull}
    taken = "standard gravity, because worm.gravity is not given"
    return {"slope": known | ({"assumed": taken} if gravity is None else {})}


def faults_of_slope(slope: float, gravity: float | None, units: str) -> Iterator[Fault]:
    """Yield a fault if `slope` is given without gravity in a scene without SI units."""
    if slope and gravity is None and units != "SI":
        yield (
            "worm.gravity",
            'missing; worm.slope needs it if units are not "SI": write the acceleration of '
            "gravity in units of the scene",
        )


def cost_of_transport(energy: float | None, units: str) -> dict[str, float | None]:
    """The scalar, from the energy divided by mass and distance; empty in a dimensionless scene."""
    if units != "SI":
        return {}
    return {"cost_of_transport": None if energy is None else energy / GRAVITY}


def assumed(units: str, **others: str) -> dict[str, dict[str, str]]:
    """Assumptions for a trust report, with standard gravity in SI scenes; empty if none."""
    gravity = f"cost_of_transport uses weights under standard gravity, {GRAVITY} m/s2"
    found = others | ({"gravity": gravity} if units == "SI" else {})
    return {"assumptions": found} if found else {}
