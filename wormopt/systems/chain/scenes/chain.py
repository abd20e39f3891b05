"""The ``[worm]`` table of simulations: masses on visco-elastic links, friction, chance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    FinitePerMass,
    NonNegativePerLink,
    NonNegativePerMass,
    PerMass,
    Positive,
    Seed,
    Table,
    per,
    says,
    wrong_count,
)
from wormopt.systems.shared.incline import (
    Gravity,
    Inclined,
    faults_of_slope,
    told_of_slope,
    weights,
)

# A path of a random parameter may have so many pieces: more would fill the memory.
_MOST_PIECES = 1_000_000


Forward = Annotated[NonNegativePerMass, says("force", "*F*<sub>+</sub>, against sliding forward")]
Backward = Annotated[NonNegativePerMass, says("force", "*F*<sub>−</sub>, against sliding back")]


class CoulombFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="coulomb"):
    """Dry friction (9), stronger one way than the other, with stiction.

    Forces are ≥ 0; each number may be one for all masses or, in a table for all masses, a list
    with one per mass. While sliding they are *F*<sub>+</sub>, *F*<sub>−</sub>; at rest anything up
    to stiction. Refused: stiction below the sliding force.
    """

    forward: Forward
    backward: Backward
    stick_forward: Annotated[
        NonNegativePerMass | None,
        says("force", "stiction *F*<sub>s+</sub>; the sliding force if left out"),
    ] = None
    stick_backward: Annotated[
        NonNegativePerMass | None,
        says("force", "stiction *F*<sub>s−</sub>; the sliding force if left out"),
    ] = None


class StribeckFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="stribeck"):
    """Dry friction whose sliding force falls from stiction to its value at high speed.

    Refused: stiction below the sliding force.
    """

    forward: Forward
    backward: Backward
    stick_forward: Annotated[NonNegativePerMass, says("force", "stiction *F*<sub>s+</sub>")]
    stick_backward: Annotated[NonNegativePerMass, says("force", "stiction *F*<sub>s−</sub>")]
    v_stribeck: Annotated[PerMass, says("speed", "velocity over which the force falls")]


class ViscousFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="viscous"):
    """Linear drag −*k v*, which never sticks."""

    drag: Annotated[NonNegativePerMass, says("drag", "*k*")]


class SpikeFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="spike"):
    """Spikes: no force forward, any force backward, (4)."""

    scale: Annotated[
        PerMass,
        says(
            "force",
            "of the *smooth* stand-in alone: load that it carries at *v* = −3/4 `v_reg`",
        ),
    ] = 1.0


Friction = CoulombFriction | StribeckFriction | ViscousFriction | SpikeFriction

# Spreads and deviations count as the parameter that they are of.
_SPREAD = says("", "half width of the range, in units of the parameter")


class FixedDraw(Table, frozen=True, kw_only=True, tag_field="process", tag="fixed"):
    """Drawn once for each link, uniform within ± `spread` of the worm's own value.

    Refused: a `spread` that is not below the mean.
    """

    spread: Annotated[NonNegativePerLink, _SPREAD]


class Steps(Table, frozen=True, kw_only=True, tag_field="process", tag="steps"):
    """Drawn anew after every interval, uniform within ± `spread` of the worm's own value.

    Refused: a `spread` that is not below the mean; more than a million pieces.
    """

    spread: Annotated[NonNegativePerLink, _SPREAD]
    interval: Annotated[Positive, says("time", "time between two changes")]


class Wandering(Table, frozen=True, kw_only=True, tag_field="process", tag="ornstein_uhlenbeck"):
    """The logarithm is a stationary Ornstein-Uhlenbeck process.

    Mean (the worm's own value) and standard deviation are as given; the path is exact at multiples
    of `step` and linear between. Refused: a `deviation` around 0; more than a million pieces.
    """

    deviation: Annotated[
        NonNegativePerLink, says("", "standard deviation, in units of the parameter")
    ]
    correlation_time: Annotated[
        Positive, says("time", "time after which the correlation has fallen to 1/e")
    ]
    step: Annotated[Positive, says("time", "grid of the path in time")]


Process = FixedDraw | Steps | Wandering
# How a parameter departs from the worm's own, which is the mean.
Chance = Annotated[
    Process | None,
    says("", "how it departs from the worm's own, which is the mean; not random if left out"),
]


class RandomLinks(Table, frozen=True, kw_only=True):
    """Chance in the links. What is left out is not random.

    Links are independent of each other; the same seed gives the same worm.
    """

    seed: Annotated[Seed, says("", "the same seed gives the same worm")] = 0
    stiffness: Chance = None
    damping: Chance = None
    rest_length: Chance = None

    @property
    def processes(self) -> dict[str, Process]:
        """What is random, by the parameter's name."""
        found = {
            "stiffness": self.stiffness,
            "damping": self.damping,
            "rest_length": self.rest_length,
        }
        return {name: process for name, process in found.items() if process is not None}


class ChainTable(Table, frozen=True, kw_only=True):
    """A chain of *n* + 1 point masses joined by *n* visco-elastic links, (8)–(12).

    Links have actuators, and the ground resists motion. Theory:
    [theory-dynamics.md](../theory-dynamics.md); the same from Python:
    [simulation.md](../simulation.md). Refused: a list of tables of `friction` that is not one per
    mass; a per-mass list in a table of one mass.
    """

    links: Annotated[
        int,
        Meta(ge=1, le=100, description="a whole number from 1 to 100"),
        says("count", "*n*; mass 0 is the head"),
    ]
    mass: Annotated[PerMass, says("mass", "point masses *m*<sub>i</sub>")]
    stiffness: Annotated[NonNegativePerLink, says("stiffness", "spring constants *c*<sub>j</sub>")]
    damping: Annotated[NonNegativePerLink, says("drag", "dashpot constants *d*<sub>j</sub>")]
    rest_length: Annotated[
        NonNegativePerLink, says("length", "*l*<sub>0j</sub>, length of a link without force")
    ]
    drag: Annotated[NonNegativePerMass, says("drag", "viscous drag *k*<sub>i</sub>")] = 0.0
    load: Annotated[
        FinitePerMass,
        says("force", "*Γ*<sub>i</sub>, force against forward motion; negative downhill"),
    ] = 0.0
    slope: Inclined = 0.0
    gravity: Gravity = None
    friction: Annotated[
        Friction | tuple[Friction, ...] | None,
        says(
            "",
            "law of the ground: a table for all masses, or a list of tables, one per mass; none "
            "if left out",
        ),
    ] = None
    random: Annotated[RandomLinks | None, says("", "chance in the links; none if left out")] = None

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass, head first; empty where there is none."""
        if self.friction is None:
            return ()
        if isinstance(self.friction, tuple):
            return self.friction
        return (self.friction,) * (self.links + 1)

    @property
    def pull(self) -> float | tuple[float, ...]:
        """Load and weight of each mass along the ground, against forward motion."""
        if not self.slope:
            return self.load
        masses, loads = (per(given, self.links + 1) for given in (self.mass, self.load))
        pull = weights(self.slope, self.gravity, masses)
        return tuple(map(sum, zip(loads, pull, strict=True)))

    @property
    def facts(self) -> dict[str, Any]:
        """What its weight does."""
        return told_of_slope(self.slope, self.gravity, per(self.mass, self.links + 1))

    def faults(self, horizon: float, units: str) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table.

        `horizon` is how long it moves, `units` are the scene's.
        """
        yield from faults_of_slope(self.slope, self.gravity, units)
        for name in ("mass", "drag", "load"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links + 1, "masses")
        for name in ("stiffness", "damping", "rest_length"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")
        yield from self._faults_of_friction()
        if self.random:
            yield from self._faults_of_chance(self.random, horizon)

    def _faults_of_friction(self) -> Iterator[Fault]:
        if not isinstance(self.friction, tuple):
            if self.friction:
                yield from faults_of_law("worm.friction", self.friction, self.links + 1)
            return
        yield from wrong_count("worm.friction", self.friction, self.links + 1, "masses", "table")
        for i, law in enumerate(self.friction):
            for name in law.__struct_fields__:
                if isinstance(getattr(law, name), tuple):
                    yield f"worm.friction[{i}].{name}", "this table is of one mass; write a number"
                    return
            yield from faults_of_law(f"worm.friction[{i}]", law, 1)

    def _faults_of_chance(self, random: RandomLinks, horizon: float) -> Iterator[Fault]:
        if not random.processes:
            yield "worm.random", "nothing is random; write stiffness, damping or rest_length"
        for name, process in random.processes.items():
            key = f"worm.random.{name}"
            wanders = isinstance(process, Wandering)
            width = "deviation" if wanders else "spread"
            mean, spread = getattr(self, name), getattr(process, width)
            wrong = list(wrong_count(f"{key}.{width}", spread, self.links, "links"))
            yield from wrong
            if wrong or any(wrong_count(name, mean, self.links, "links")):
                continue
            pairs = list(zip(per(mean, self.links), per(spread, self.links), strict=True))
            if wanders and any(m <= 0 for m, _ in pairs):
                yield f"{key}.deviation", f"worm.{name} is 0; a mean above 0 is needed"
            elif not wanders and any(s > 0 and s >= m for m, s in pairs):
                yield f"{key}.spread", f"is not below worm.{name}, so {name} might not be above 0"
            step = {Steps: "interval", Wandering: "step"}.get(type(process))
            if step and horizon / getattr(process, step) > _MOST_PIECES:
                yield f"{key}.{step}", f"makes more than {_MOST_PIECES} pieces; write a longer one"


def held_at_rest(law: Friction) -> tuple[float, float]:
    """What the ground holds of one mass at rest, pushed forward and backward."""
    if isinstance(law, SpikeFriction):
        return 0.0, math.inf
    if isinstance(law, ViscousFriction):
        return 0.0, 0.0
    forward = law.forward if law.stick_forward is None else law.stick_forward
    backward = law.backward if law.stick_backward is None else law.stick_backward
    return per(forward, 1)[0], per(backward, 1)[0]


def faults_of_law(key: str, law: Friction, masses: int) -> Iterator[Fault]:
    """Yield what is wrong between the numbers of a friction law for so many masses.

    `key` is the key path of its table.
    """
    wrong = [
        fault
        for name in law.__struct_fields__
        for fault in wrong_count(f"{key}.{name}", getattr(law, name), masses, "masses")
    ]
    yield from wrong
    if wrong or not isinstance(law, CoulombFriction | StribeckFriction):
        return
    for side in ("forward", "backward"):
        slide, stick = getattr(law, side), getattr(law, f"stick_{side}")
        if stick is None:
            continue
        if any(s < f for f, s in zip(per(slide, masses), per(stick, masses), strict=True)):
            message = f"stiction below the sliding force {side}; write at least as much"
            yield f"{key}.stick_{side}", message
