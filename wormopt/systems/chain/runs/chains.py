"""Chains as scenes describe them, made into models; what all simulating studies read alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.model import Model
from wormopt.model.path import ParameterPath, ornstein_uhlenbeck, piecewise_constant
from wormopt.scene.numerics import ContactTable, SmoothContact, Start, ToleranceTable
from wormopt.scene.types import per
from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.scenes.chain import (
    ChainTable,
    CoulombFriction,
    FixedDraw,
    Friction,
    Process,
    SpikeFriction,
    Steps,
    StribeckFriction,
)

_RANDOM = ("stiffness", "damping", "rest_length")


@dataclass(frozen=True, eq=False)
class Links:
    """Parameters of the links, as chance made them: one number per link, or a course in time."""

    stiffness: np.ndarray | ParameterPath
    damping: np.ndarray | ParameterPath
    rest_length: np.ndarray | ParameterPath

    @property
    def numbers(self) -> dict[str, np.ndarray]:
        """Those that do not vary in time: parameters of the model."""
        found = {name: getattr(self, name) for name in _RANDOM}
        return {k: v for k, v in found.items() if not isinstance(v, ParameterPath)}

    @property
    def paths(self) -> dict[str, np.ndarray]:
        """Values of the schedules of those that do."""
        found = {name: getattr(self, name) for name in _RANDOM}
        return {k: v.values for k, v in found.items() if isinstance(v, ParameterPath)}


def draw_links(worm: ChainTable, horizon: float, member: int = 0) -> Links:
    """Draw the parameters of the links of one member of an ensemble, over the time `horizon`.

    Members do not depend on how many there are.
    """
    processes = worm.random.processes if worm.random else {}
    seed = worm.random.seed if worm.random else 0
    drawn = {}
    for index, name in enumerate(_RANDOM):
        mean = np.array(per(getattr(worm, name), worm.links))
        rng = np.random.default_rng([seed, member, index])  # each its own: none shifts another
        process = processes.get(name)
        drawn[name] = mean if process is None else _course(process, mean, horizon, rng)
    return Links(**drawn)


def _course(
    process: Process, mean: np.ndarray, horizon: float, rng: np.random.Generator
) -> np.ndarray | ParameterPath:
    if isinstance(process, FixedDraw):
        spread = np.broadcast_to(np.array(process.spread), mean.shape)
        return rng.uniform(mean - spread, mean + spread)
    if isinstance(process, Steps):
        return piecewise_constant(rng, mean, process.spread, process.interval, horizon)
    return ornstein_uhlenbeck(
        rng, mean, process.deviation, process.correlation_time, process.step, horizon
    )


def build_chain(
    worm: ChainTable, start: Start, links: Links, length_nominal: float, time_nominal: float
) -> Model:
    """Make the Model of a chain; `*_nominal` are usual sizes of a link length and of a period.

    Without start positions, links have the rest length that the scene says, even where chance
    makes it another.
    """
    position = start.position
    if position is None:
        rest = np.array(per(worm.rest_length, worm.links))
        position = tuple(np.append(np.cumsum(rest[::-1])[::-1], 0.0).tolist())
    return chain(
        worm.links,
        mass=worm.mass,
        stiffness=links.stiffness,
        damping=links.damping,
        rest_length=links.rest_length,
        law=laws_of(worm) or None,
        drag=worm.drag,
        load=worm.load,
        position=position,
        velocity=start.velocity,
        length_nominal=length_nominal,
        time_nominal=time_nominal,
    )


class Grounded(Protocol):
    """A table of masses on the ground."""

    @property
    def friction(self) -> Any:
        """A table for all masses, several for one each, or None."""
        ...

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass."""
        ...


def laws_of(worm: Grounded) -> list[Law]:
    """Friction law of every mass; empty where nothing rubs."""
    one_each = isinstance(worm.friction, tuple)
    return [law_of(table, 0 if one_each else i) for i, table in enumerate(worm.ground)]


def law_of(table: Friction, mass: int = 0) -> Law:
    """Law of one mass; the table's numbers are alike for all masses or listed one per mass."""

    def number(value: float | tuple[float, ...]) -> float:
        return value[mass] if isinstance(value, tuple) else value

    numbers = {
        name: number(getattr(table, name))
        for name in table.__struct_fields__
        if getattr(table, name) is not None
    }
    if isinstance(table, CoulombFriction):
        return Coulomb(**numbers)
    if isinstance(table, StribeckFriction):
        return Stribeck(**numbers)
    return Spike(**numbers) if isinstance(table, SpikeFriction) else Viscous(**numbers)


def treatment_of(contact: ContactTable) -> Treatment:
    """Treatment of contact that a scene asks for."""
    return Smooth(contact.v_reg) if isinstance(contact, SmoothContact) else Exact()


def tolerance_of(table: ToleranceTable) -> Tolerance:
    """Tolerance that a scene asks for."""
    return Tolerance(table.relative, table.absolute, table.max_steps, table.max_step)
