"""The ``[worm]`` table of simulations: masses on visco-elastic links, friction, chance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

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
    wrong_count,
)

# A path of a random parameter may have so many pieces: more would fill the memory.
_MOST_PIECES = 1_000_000


class CoulombFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="coulomb"):
    """Anisotropic dry friction with stiction, (9).

    Parameters
    ----------
    forward, backward : float or tuple of float
        Sliding forces F+ and F- against forward and backward motion, alike for all or one per
        mass.
    stick_forward, stick_backward : float or tuple of float, optional
        Stiction Fs+ and Fs-; the sliding forces if left out.
    """

    forward: NonNegativePerMass
    backward: NonNegativePerMass
    stick_forward: NonNegativePerMass | None = None
    stick_backward: NonNegativePerMass | None = None


class StribeckFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="stribeck"):
    """Dry friction whose sliding force falls from stiction to Coulomb's value.

    Parameters
    ----------
    forward, backward : float or tuple of float
        Sliding forces F+ and F- at high speed.
    stick_forward, stick_backward : float or tuple of float
        Stiction Fs+ and Fs-.
    v_stribeck : float or tuple of float
        Velocity over which the force falls.
    """

    forward: NonNegativePerMass
    backward: NonNegativePerMass
    stick_forward: NonNegativePerMass
    stick_backward: NonNegativePerMass
    v_stribeck: PerMass


class ViscousFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="viscous"):
    """Linear drag, which never sticks.

    Parameters
    ----------
    drag : float or tuple of float
        Force per velocity.
    """

    drag: NonNegativePerMass


class SpikeFriction(Table, frozen=True, kw_only=True, tag_field="kind", tag="spike"):
    """Spikes: no force forward, any force backward, (4).

    Parameters
    ----------
    scale : float or tuple of float
        Of the smooth stand-in alone: load that it carries at v = -3/4 v_reg.
    """

    scale: PerMass = 1.0


Friction = CoulombFriction | StribeckFriction | ViscousFriction | SpikeFriction


class FixedDraw(Table, frozen=True, kw_only=True, tag_field="process", tag="fixed"):
    """A value drawn once for each link, uniform around the worm's own.

    Parameters
    ----------
    spread : float or tuple of float
        Half width of the range.
    """

    spread: NonNegativePerLink


class Steps(Table, frozen=True, kw_only=True, tag_field="process", tag="steps"):
    """A value that is drawn anew after every interval, uniform around the worm's own.

    Parameters
    ----------
    spread : float or tuple of float
        Half width of the range.
    interval : float
        Time between two changes.
    """

    spread: NonNegativePerLink
    interval: Positive


class Wandering(Table, frozen=True, kw_only=True, tag_field="process", tag="ornstein_uhlenbeck"):
    """A value whose logarithm is a stationary Ornstein-Uhlenbeck process.

    Parameters
    ----------
    deviation : float or tuple of float
        Standard deviation; the worm's own value is the mean.
    correlation_time : float
        Time after which the correlation has fallen to 1/e.
    step : float
        Grid of the path in time; between its points the value is linear.
    """

    deviation: NonNegativePerLink
    correlation_time: Positive
    step: Positive


Process = FixedDraw | Steps | Wandering


class RandomLinks(Table, frozen=True, kw_only=True):
    """Chance in the links. What is left out is not random.

    Parameters
    ----------
    seed : int
        The same seed gives the same worm.
    stiffness, damping, rest_length : FixedDraw, Steps or Wandering, optional
        How the parameter of each link, independent of the others, departs from the worm's own.
    """

    seed: Seed = 0
    stiffness: Process | None = None
    damping: Process | None = None
    rest_length: Process | None = None

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
    """A chain of point masses on visco-elastic links, (8)-(12).

    Parameters
    ----------
    links : int
        Number of links n, 1 to 100; the masses are n + 1.
    mass : float or tuple of float
        Mass, alike for all or one per mass, head first.
    stiffness, damping : float or tuple of float
        Spring constants c and dashpot constants d, alike for all or one per link.
    rest_length : float or tuple of float
        Length l0 of a link without force.
    drag : float or tuple of float
        Viscous drag coefficient of each mass.
    load : float or tuple of float
        Force against forward motion on each mass (slope or towed load); negative downhill.
    friction : table or tuple of tables, optional
        Law of the ground, one table for all or one per mass; none without it.
    random : RandomLinks, optional
        Chance in the links.

    Examples
    --------
    >>> ChainTable(links=2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0).drag
    0.0
    """

    links: Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")]
    mass: PerMass
    stiffness: NonNegativePerLink
    damping: NonNegativePerLink
    rest_length: NonNegativePerLink
    drag: NonNegativePerMass = 0.0
    load: FinitePerMass = 0.0
    friction: Friction | tuple[Friction, ...] | None = None
    random: RandomLinks | None = None

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass, head first; empty where there is none."""
        if self.friction is None:
            return ()
        if isinstance(self.friction, tuple):
            return self.friction
        return (self.friction,) * (self.links + 1)

    def faults(self, horizon: float) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table, for a motion as long as `horizon`."""
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
