"""One motion of a rod in a channel: its tables, and the objects built from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from wormopt.magnetics.blocks import BlockField, channel_field
from wormopt.magnetics.coils import Coil
from wormopt.model.schedule import Schedule
from wormopt.simulation.moreau import MoreauJean
from wormopt.systems.channel.closed_forms import warnings_of_susceptibility
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import (
    Blocks,
    block_load,
    block_schedule,
    channel_rod,
    magnetic_strength,
    straight,
    switched_blocks,
)
from wormopt.systems.channel.scenes.rod import (
    ChannelTable,
    CourseTable,
    MeshTable,
    PatternTable,
    WormTable,
    ZigzagTable,
)

_POWERS = ("damping_power", "load_power")

ASSUMED = {
    "plane": "the rod moves in one plane; gravity acts across it and is neglected, as is drag",
    "row": "the row of coils extends beyond both ends of the worm's path",
    "field": "the worm does not change the field; no iron; the pull acts on its centre line",
    "impact": "impacts on a wall are inelastic",
    "magnetisation": "linear in the field, without saturation and hysteresis",
}


@dataclass(frozen=True)
class RodCase:
    """One motion of a rod in a channel, by the tables of its scene."""

    worm: WormTable
    channel: ChannelTable
    coils: ZigzagTable
    pattern: PatternTable
    mesh: MeshTable
    course: CourseTable
    rate: float  # coil switches per second

    def varied(self, **tables: dict[str, Any]) -> RodCase:
        """Return a copy with new values by key, for each table named."""
        changed = {
            name: msgspec.structs.replace(getattr(self, name), **numbers)
            for name, numbers in tables.items()
        }
        return replace(self, **changed)

    @property
    def key(self) -> str:
        """Return text that is equal for equal motions."""
        return msgspec.json.encode(self, order="deterministic").decode()

    @property
    def cycle(self) -> float:
        """Return the time after which the pattern repeats, in s."""
        return self.pattern.every / self.rate

    @property
    def field_speed(self) -> float:
        """Return the speed of the travelling field, in m/s."""
        return self.rate * self.coils.pitch

    @property
    def room(self) -> float:
        """Return the room of the centre line to either side of the channel's middle, in m."""
        return (self.channel.diameter - self.worm.diameter) / 2

    @property
    def end(self) -> float:
        """Return the end time, after whole repeats of the pattern, in s."""
        repeats = max(self.course.cycles, int(np.ceil(self.course.duration / self.cycle)))
        return repeats * self.cycle

    @property
    def rod(self) -> Rod:
        """Return the rod."""
        return Rod(
            self.worm.length,
            self.worm.diameter,
            self.worm.youngs_modulus,
            self.worm.density,
            damping_time=self.worm.damping_time,
            poisson_ratio=self.worm.poisson_ratio,
            elements=self.mesh.elements,
            degree=self.mesh.degree,
            skin=self.worm.skin or 0.0,
        )

    @property
    def blocks(self) -> Blocks:
        """Return the sequence of active coils."""
        pattern = self.pattern
        return switched_blocks(pattern.every, self.rate, pattern.duration, pattern.shift)

    @property
    def schedule(self) -> Schedule:
        """Return the times and strengths of the blocks."""
        coils = self.coils
        strength = magnetic_strength(self.rod, self.worm.susceptibility, coils.ampere_turns)
        return block_schedule(self.blocks, coils.pitch, strength)

    @property
    def fields(self) -> tuple[BlockField, ...]:
        """Return the fields of the blocks that occur."""
        coils = self.coils
        coil = Coil(coils.inner, coils.outer, coils.length)
        return tuple(
            channel_field(
                coil, coils.pitch, self.channel.diameter, coils.clearance, self.worm.diameter,
                count, self.pattern.every, self.mesh.field_tolerance,
            )
            for count in self.blocks.counts
        )  # fmt: skip

    @property
    def numbers(self) -> dict[str, float]:
        """Return the parameters of the rod's model by name."""
        return {
            "youngs_modulus": self.worm.youngs_modulus,
            "density": self.worm.density,
            "damping_time": self.worm.damping_time,
            "friction": self.channel.friction,
        }

    @property
    def marcher(self) -> MoreauJean:
        """Return the rod's time stepper, compiled once for all materials, frictions and rates."""
        rod = self.rod
        sizes = rod.length, rod.diameter, rod.poisson_ratio, rod.elements, rod.degree, rod.skin
        return _marcher(*sizes, self.channel.diameter, self.fields)

    @property
    def start(self) -> np.ndarray:
        """Return the state of a straight rod at rest, one repeat of the pattern from coil 0."""
        state = straight(self.rod, along=self.pattern.every * self.coils.pitch)
        return np.concatenate([state[signal.name] for signal in self.marcher.model.x])

    @property
    def step(self) -> float:
        """Return the longest time step, in s."""
        if self.mesh.step is not None:
            return self.mesh.step
        values = [self.numbers[signal.name] for signal in self.marcher.model.p]
        return self.marcher.safe_step(self.start, np.array(values))

    @property
    def assumed(self) -> dict[str, float | None]:
        """Return the assumed parameters as scalars, so that results list them."""
        worm = self.worm
        return {
            "assumed_density": worm.density,
            "assumed_damping_time": worm.damping_time,
            "assumed_susceptibility": worm.susceptibility,
            "assumed_friction": self.channel.friction,
            "assumed_skin": worm.skin,
            "assumed_skin_modulus": worm.youngs_modulus if worm.skin else None,
        } | self.coils.assumed

    def warnings(self) -> Iterator[str]:
        """Yield warnings near the limits of the assumptions."""
        yield from warnings_of_susceptibility(self.worm.susceptibility)


@lru_cache(maxsize=16)
def _marcher(
    length: float,
    diameter: float,
    poisson_ratio: float,
    elements: int,
    degree: int,
    skin: float,
    channel: float,
    fields: tuple[BlockField, ...],
) -> MoreauJean:
    """Return the steps of a rod; material and friction are parameters."""
    rod = Rod(length, diameter, 1.0, 1.0, poisson_ratio=poisson_ratio, elements=elements,
              degree=degree, skin=skin)  # fmt: skip
    model = channel_rod(rod, channel, friction=1.0)
    return MoreauJean(model, integrals=_POWERS, inputs=block_load(rod, fields))
