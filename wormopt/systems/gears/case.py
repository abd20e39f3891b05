"""Builds ground, gears and supervisor from a scene of kind ``gait-shift``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.quantities import GRAVITY
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.gears.box import GearBox, gear_box
from wormopt.systems.gears.gear import Gear, Limits
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.scenes import GaitShiftScene
from wormopt.systems.gears.supervisor import Supervisor, supervise
from wormopt.systems.gears.walk import Choose, Walk, walk
from wormopt.systems.spiked import gait_of_shape

# Accepted excess of link limits by rounding, as a share.
_KEPT = 1e-9
# Longest simulated time, relative to the time of the slowest gear.
_PATIENCE = 3.0


@dataclass(frozen=True, eq=False)
class Case:
    """Objects described by a scene."""

    scene: Scene[GaitShiftScene]

    @property
    def table(self) -> GaitShiftScene:
        """Table of the scene."""
        return self.scene.table

    @cached_property
    def limits(self) -> Limits:
        """Limits on gears and transitions."""
        given = self.table.limits
        force = math.inf if given.actuator_force is None else given.actuator_force
        low, high = given.length
        return Limits(given.spike_load, force, given.rate, given.acceleration, (low, high))

    @cached_property
    def ground(self) -> Ground:
        """The ground along the route."""
        given, count = self.table.ground, len(self.table.ground.place)
        gravity = GRAVITY if given.gravity is None else given.gravity
        pull = self.table.masses[0] * gravity * np.sin(per(given.slope, count))
        drag = self.table.worm.drag if given.drag is None else given.drag
        return Ground(
            np.array(given.place),
            pull + np.array(per(given.load, count)),
            np.array(per(drag, count)),
            np.array(per(given.towed, count)),
        )

    @cached_property
    def gears(self) -> list[Gear]:
        """Gears from slow to fast; SceneError if one violates a limit of the links."""
        found = [self._gear(k) for k in range(len(self.table.gears))]
        return sorted(found, key=lambda gear: gear.speed)

    def _gear(self, k: int) -> Gear:
        shape, key = self.table.gears[k], f"gears[{k}]"
        gait = gait_of_shape(shape, self.scene, key)
        try:
            gear = Gear(f"gears[{k}]", gait, np.array(self.table.masses), self.table.worm.drag)
        except ArgumentError as error:
            raise SceneError(self.scene.name, [(key, str(error))]) from None
        faults = list(_faults_of_links(gear, self.limits))
        if faults:
            raise SceneError(self.scene.name, [(key, text) for text in faults])
        return gear

    @cached_property
    def box(self) -> GearBox:
        """The gear box; SceneError if gears cannot be combined."""
        try:
            return gear_box(self.gears, self.limits, resting=self.table.limits.resting)
        except ArgumentError as error:
            raise SceneError(self.scene.name, [("gears", str(error))]) from None

    @cached_property
    def supervisor(self) -> Supervisor:
        """The supervisor."""
        given = self.table.supervisor
        return supervise(self.box, self.limits, down=given.down, up=given.up, dwell=given.dwell)

    @cached_property
    def first(self) -> int:
        """Fastest gear that the supervisor would keep at the start."""
        load = self.load(np.array([self.table.way.start]))[0]
        share = self.limits.times(self.table.supervisor.down)
        bears = [min(gear.bears(share)) >= load for gear in self.box.gears]
        return max((k for k, fine in enumerate(bears) if fine), default=0)

    def load(self, place: np.ndarray) -> np.ndarray:
        """Load on each mass, with an equal share of the towed load."""
        return self.ground.at("load", place) + self.ground.at("towed", place) / len(self.box.mass)

    def begin(self, gear: int) -> np.ndarray:
        """Positions of the masses at time 0, (n+1,)."""
        place = -np.concatenate([[0.0], np.cumsum(self.box.gears[gear].lengths[0])])
        return place - place.mean() + self.table.way.start

    @property
    def longest(self) -> float:
        """Longest simulated time."""
        way = self.table.way.goal - self.table.way.start
        return _PATIENCE * way / self.box.gears[0].speed

    def walk(self, gear: int, choose: Choose) -> Walk:
        """Travel from a cycle of a gear, with rows selected by `choose`."""
        first = self.box.first_row(gear)
        goal = self.table.way.goal
        return walk(self.box, self.ground, self.begin(gear), first, choose, goal, self.longest)


def _faults_of_links(gear: Gear, limits: Limits) -> Iterator[str]:
    ends = [np.linspace(0.0, w, 65) for w in np.diff(gear.gait.breaks)]
    size = limits.length[1]
    for name, order, low, high in (
        ("length", 0, *limits.length),
        ("rate", 1, -limits.rate, limits.rate),
        ("acceleration", 2, -limits.acceleration, limits.acceleration),
    ):
        values = [gear.gait.on_piece(q, s, order) for q, s in enumerate(ends)]
        least, most = min(v.min() for v in values), max(v.max() for v in values)
        if least < low - _KEPT * size or most > high + _KEPT * max(size, abs(high)):
            yield (
                f"its {name} goes from {least:.4g} to {most:.4g}, outside limits.{name}; write a "
                "longer period or a wider limit"
            )
