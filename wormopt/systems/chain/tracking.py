"""Bases of studies of a plant, a chain or one of your own, whose output follows a reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.quantities import Variable, unit_of_signal
from wormopt.study import Study, entry, on_use
from wormopt.study.numerics import Horizon, Start
from wormopt.systems.chain.own_model import OwnPlant, own_signals, own_variables
from wormopt.systems.chain.tables import ChainTable, FunnelTracker, Reference, Tracker
from wormopt.systems.spiked import Shape

with on_use():
    from wormopt.control.loop import Reference as Followed
    from wormopt.control.loop import gait_reference
    from wormopt.model.friction import Law
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain.controllers import DesignedShape
    from wormopt.systems.chain.loops import Links, chain_for, close_loop, draw_links, laws_of
    from wormopt.systems.spiked import gait_of_shape


class Following(Study):
    """Base of studies of a plant that follows references."""

    worm: ChainTable | None = entry("the chain", default=None)
    model: OwnPlant | None = entry("a plant of your own, instead of the chain", default=None)
    start: Start = entry(
        "initial state of the chain; a plant of your own has that of its Model", default=Start
    )
    time: Horizon

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what no single key shows, of a plant of your own without running its file."""
        if self.worm is not None and self.model is not None:
            yield "model", "both [worm] and [model] are given; leave one out"
        elif self.worm is not None:
            yield from self.worm.faults(self.time.end, self.units)
            yield from self.start.faults(self.worm.links)
            yield from self.faults_of_worm(self.worm)
            yield from self.faults_of_sizes(self.worm.links)
        elif self.model is not None:
            if self.start != Start():
                yield "start", "applies to [worm] only; write value= of the states of your Model"
            yield from self.model.faults_in(self.folder)
        else:
            yield "worm", 'missing; write [worm], or [model] file = "plant.py:plant"'

    def faults_of_worm(self, worm: ChainTable) -> Iterator[Fault]:
        """Yield what this kind does not support of a chain."""
        yield from ()

    def faults_of_sizes(self, links: int) -> Iterator[Fault]:
        """Yield lists and gaits that do not fit `links`, the entries of the tracked output."""
        yield from ()

    def faults_of_gait(self, shape: Shape | DesignedShape, links: int, key: str) -> Iterator[Fault]:
        """Yield what of a shape does not fit the tracked output."""
        for path, message in shape.faults(links, self.folder, key):
            if self.model is None:
                yield path, message
            else:
                wrong = message.partition(";")[0].replace("the worm has", "the output has")
                yield path, f"{wrong}; write a gait for all entries of {self.model.output}"

    @cached_property
    def own(self) -> Model | None:
        """The plant of the user's own; SceneError if other keys do not fit it."""
        if self.model is None:
            return None
        plant = self.model.plant(self.name, self.folder)
        if faults := list(self.faults_of_sizes(plant["length"].numel())):
            raise SceneError(self.name, faults)
        return plant

    @property
    def links(self) -> int:
        """Entries of the tracked output."""
        if self.own is not None:
            return self.own["length"].numel()
        assert self.worm is not None
        return self.worm.links

    @property
    def laws(self) -> list[Law]:
        """Friction law of every contact."""
        if self.own is not None:
            return [contact.law for contact in self.own.contacts]
        assert self.worm is not None
        return laws_of(self.worm)

    def plant_for(self, gait: Gait, links: Links | None = None) -> Model:
        """The plant without a controller; a chain, with drawn links, is scaled by the gait."""
        if self.own is not None:
            return self.own
        assert self.worm is not None
        links = draw_links(self.worm, self.time.end) if links is None else links
        return chain_for(self.worm, self.start, links, gait)

    def gait_of(self, shape: Shape, key: str) -> Gait:
        """Gait of a shape; `key` is its path."""
        return gait_of_shape(shape, self.scene, key, self.links)

    def closed(self, plant: Model, reference: Followed, tracker: Tracker, key: str) -> Model:
        """Close the loop of a tracker with the path `key`; SceneError if it cannot be closed."""
        try:
            return close_loop(plant, reference, tracker, self.worm)
        except ArgumentError as error:
            hint = "; write wider funnels, or another start"
            message = f"{error}{hint if isinstance(tracker, FunnelTracker) else ''}"
            raise SceneError(self.name, [(key, message)]) from None

    def own_arrays(self, motions: Sequence[Trajectory], over: str) -> dict[str, Variable]:
        """Every named state and output of a plant of the user's own; {} for a chain."""
        if self.own is None:
            return {}
        return own_variables(motions, own_signals(self.own), self.units, over)

    def unit_in_results(self, quantity: str) -> str:
        """Unit of a quantity; lengths and forces are those of the tracked output and its input."""
        if self.own is None or self.units != "SI" or quantity not in _OF_PLANT:
            return super().unit_in_results(quantity)
        units = [next(s.unit for s in self.own.u)]
        units += [s.unit for s in (*self.own.x, *self.own.outputs) if s.name == "length"]
        force, length = (unit_of_signal(unit, self.units) for unit in units)
        return _joined(_OF_PLANT[quantity], {"length": length, "force": force, "time": "s"})


# Exponents of the tracked output, its input and time in quantities.
_OF_PLANT = {
    "length": {"length": 1},
    "force": {"force": 1},
    "speed": {"length": 1, "time": -1},
    "energy": {"force": 1, "length": 1},
    "compliance": {"length": 1, "force": -1},
    "length_squared_time": {"length": 2, "time": 1},
    "effort": {"force": 2, "time": 1},
}


def _joined(exponents: dict[str, int], units: dict[str, str]) -> str:
    """Product of units to integer powers, "rad2 s" say."""
    found: dict[str, int] = {}
    for name, exponent in exponents.items():
        for part in units[name].split():
            base = part.rstrip("-0123456789")
            power = int(part[len(base) :] or 1) if base else 0
            found[base] = found.get(base, 0) + exponent * power
    kept = {base: power for base, power in found.items() if power and base}
    return " ".join(b if n == 1 else f"{b}{n}" for b, n in kept.items()) or "1"


class Tracking(Following):
    """Base of studies of a plant that follows one gait."""

    reference: Reference = entry("reference of the links, or of the plant's output")

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what no single key shows, and pictures that need a chain."""
        yield from super().faults_of_keys()
        for word in ("motion", "animation"):
            if self.model is not None and word in self.want:
                yield "want", f'"{word}" shows masses of a chain; write "trackers"'

    def faults_of_sizes(self, links: int) -> Iterator[Fault]:
        """Yield what does not fit the number of links."""
        yield from self.faults_of_gait(self.reference.gait, links, "reference.gait")

    @cached_property
    def gait(self) -> Gait:
        """The gait that the links follow."""
        return self.gait_of(self.reference.gait, "reference.gait")

    @cached_property
    def plant(self) -> Model:
        """The plant without a controller."""
        return self.plant_for(self.gait)

    @cached_property
    def followed(self) -> Followed:
        """Reference of the output of `plant`."""
        return self.target(self.plant)

    @property
    def shift(self) -> float:
        """How far the gait is ahead, within a period."""
        return self.reference.shift % self.gait.period

    def target(self, plant: Model) -> Followed:
        """Reference of a plant."""
        return gait_reference(self.gait, plant.t, shift=self.shift)
