"""One motion of a rod in a channel as scenes ask for it: its tables, and what is built of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from wormopt.magnetics.blocks import BlockField, channel_field
from wormopt.magnetics.coils import Coil
from wormopt.model.model import Schedule
from wormopt.quantities import Scalar, unit_of
from wormopt.simulation.moreau import Marcher
from wormopt.systems.channel.channel_rod import channel_rod, straight
from wormopt.systems.channel.magnetic_rod import (
    Blocks,
    block_load,
    block_schedule,
    magnetic_strength,
    switched_blocks,
)
from wormopt.systems.channel.rod import Rod
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
    "plane": "the rod moves in one plane; gravity acts across it and is left out, and so is drag",
    "row": "the row of coils goes on beyond both ends of the worm's way",
    "field": "the worm does not change the field; no iron; the pull acts on its centre line",
    "impact": "what hits a wall does not bounce",
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
        """Copy with new numbers by key, for each table named."""
        changed = {
            name: msgspec.structs.replace(getattr(self, name), **numbers)
            for name, numbers in tables.items()
        }
        return replace(self, **changed)

    @property
    def key(self) -> str:
        """Text that is the same for the same motions."""
        return msgspec.json.encode(self, order="deterministic").decode()

    @property
    def cycle(self) -> float:
        """Time after which the pattern repeats, in s."""
        return self.pattern.every / self.rate

    @property
    def field_speed(self) -> float:
        """Speed of the travelling field, in m/s."""
        return self.rate * self.coils.pitch

    @property
    def room(self) -> float:
        """How far the centre line may go from the middle of the channel, in m."""
        return (self.channel.diameter - self.worm.diameter) / 2

    @property
    def end(self) -> float:
        """Time at which it ends, after whole repeats of the pattern, in s."""
        repeats = max(self.course.cycles, int(np.ceil(self.course.duration / self.cycle)))
        return repeats * self.cycle


def rod_of(worm: WormTable, mesh: MeshTable) -> Rod:
    """Make the rod of a scene."""
    return Rod(
        worm.length,
        worm.diameter,
        worm.youngs_modulus,
        worm.density,
        damping_time=worm.damping_time,
        poisson_ratio=worm.poisson_ratio,
        elements=mesh.elements,
        degree=mesh.degree,
    )


def blocks_of(case: RodCase) -> Blocks:
    """Which coils are on when."""
    pattern = case.pattern
    return switched_blocks(pattern.every, case.rate, pattern.duration, pattern.shift)


def numbers_of(case: RodCase) -> dict[str, float]:
    """Parameters of the model of a rod, by name."""
    return {
        "youngs_modulus": case.worm.youngs_modulus,
        "density": case.worm.density,
        "damping_time": case.worm.damping_time,
        "friction": case.channel.friction,
    }


def warnings_of_case(case: RodCase) -> Iterator[str]:
    """Yield warnings where assumptions are stretched."""
    if case.worm.susceptibility > 1:
        yield (
            f"a susceptibility of {case.worm.susceptibility:g} changes the field in and near the "
            "body, which the pull by the field without it leaves out"
        )


def fields_of(case: RodCase) -> tuple[BlockField, ...]:
    """Fields of the blocks that occur."""
    coils = case.coils
    coil = Coil(coils.inner, coils.outer, coils.length)
    return tuple(
        channel_field(
            coil, coils.pitch, case.channel.diameter, coils.clearance, case.worm.diameter, count,
            case.pattern.every, case.mesh.field_tolerance,
        )
        for count in blocks_of(case).counts
    )  # fmt: skip


def schedule_of(case: RodCase) -> Schedule:
    """When which block is on, and how strongly it pulls."""
    rod = rod_of(case.worm, case.mesh)
    strength = magnetic_strength(rod, case.worm.susceptibility, case.coils.ampere_turns)
    return block_schedule(blocks_of(case), case.coils.pitch, strength)


def start_of(case: RodCase, marcher: Marcher) -> np.ndarray:
    """State of a straight rod at rest, one repeat of the pattern away from the first coil.

    In the order of the states of `marcher`.
    """
    rod = rod_of(case.worm, case.mesh)
    state = straight(rod, along=case.pattern.every * case.coils.pitch)
    return np.concatenate([state[signal.name] for signal in marcher.model.x])


def step_of(case: RodCase) -> float:
    """Longest time step that is taken, in s."""
    if case.mesh.step is not None:
        return case.mesh.step
    marcher, numbers = marcher_of(case), numbers_of(case)
    values = np.array([numbers[signal.name] for signal in marcher.model.p])
    return marcher.safe_step(start_of(case, marcher), values)


def marcher_of(case: RodCase) -> Marcher:
    """Time stepper of a rod, compiled once for all materials, frictions and frequencies."""
    rod = rod_of(case.worm, case.mesh)
    sizes = rod.length, rod.diameter, rod.poisson_ratio, rod.elements, rod.degree
    return _marcher(*sizes, case.channel.diameter, fields_of(case))


def assumed_scalars(case: RodCase) -> dict[str, Scalar]:
    """Numbers that are assumptions, so that results show them."""
    found = {
        "density": (case.worm.density, "density"),
        "damping_time": (case.worm.damping_time, "time"),
        "susceptibility": (case.worm.susceptibility, "share"),
        "friction": (case.channel.friction, "share"),
        "coil_inner": (case.coils.inner, "length"),
        "coil_outer": (case.coils.outer, "length"),
        "coil_length": (case.coils.length, "length"),
        "coil_clearance": (case.coils.clearance, "length"),
        "ampere_turns": (case.coils.ampere_turns, "ampere_turns"),
    }
    return {
        f"assumed_{name}": Scalar(value, unit_of(unit, "SI"))
        for name, (value, unit) in found.items()
    }


@lru_cache(maxsize=16)
def _marcher(
    length: float,
    diameter: float,
    poisson_ratio: float,
    elements: int,
    degree: int,
    channel: float,
    fields: tuple[BlockField, ...],
) -> Marcher:
    """Steps of a rod, whatever its material and friction: those are parameters."""
    rod = Rod(length, diameter, 1.0, 1.0, poisson_ratio=poisson_ratio, elements=elements,
              degree=degree)  # fmt: skip
    model = channel_rod(rod, channel, friction=1.0)
    return Marcher(model, integrals=_POWERS, inputs=block_load(rod, fields))
