"""Ground that slopes: keys of a worm by which its weight pulls every mass back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.scene.types import Positive, says

_ADDS = (
    "the ground rises forward by this angle: *m*<sub>i</sub> *g* sin(`slope`) is added to the "
    "load on each mass"
)
Uphill = Annotated[
    Annotated[float, Meta(ge=0, le=math.pi / 2, description="an angle from 0 to pi/2")],
    says("rad", f"{_ADDS}, which must be alike"),
]
Inclined = Annotated[
    Annotated[
        float, Meta(ge=-math.pi / 2, le=math.pi / 2, description="an angle from -pi/2 to pi/2")
    ],
    says("rad", f"{_ADDS}; negative downhill. Forces of friction stay as they are given"),
]
Gravity = Annotated[
    Positive | None,
    says("acceleration", "*g* of `slope`; left out, 9.80665 m/s² in SI scenes, others need it"),
]


def weights(slope: float, gravity: float | None, masses: tuple[float, ...]) -> tuple[float, ...]:
    """Part of the weight of each mass that pulls it back along the ground."""
    pull = (GRAVITY if gravity is None else gravity) * math.sin(slope)
    return tuple(mass * pull for mass in masses)


def told_of_slope(slope: float, gravity: float | None, masses: tuple[float, ...]) -> dict[str, Any]:
    """Say in a trust report what a slope does, and what was taken for granted."""
    if not slope:
        return {}
    pull = list(weights(slope, gravity, masses))
    known = {"gravity": GRAVITY if gravity is None else gravity, "pull": pull}
    taken = "standard gravity, as worm.gravity is left out"
    return {"slope": known | ({"assumed": taken} if gravity is None else {})}


def faults_of_slope(slope: float, gravity: float | None, units: str) -> Iterator[Fault]:
    """Yield what is missing where no unit says how large the acceleration of the fall is."""
    if slope and gravity is None and units != "SI":
        yield (
            "worm.gravity",
            'missing; worm.slope needs it where units are not "SI": write the acceleration of the '
            "fall in units of the scene",
        )
