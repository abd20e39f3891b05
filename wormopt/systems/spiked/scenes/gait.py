"""Scenes of kind "gait": what a given gait does under kinematic theory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Loads,
    NonNegative,
    NonNegativePair,
    Pair,
    PerMass,
    Positive,
    SceneTable,
    Table,
    per,
    says,
    wrong_order,
)
from wormopt.systems.shared.declared import COST_OF_TRANSPORT, GAIT
from wormopt.systems.shared.incline import (
    Gravity,
    Uphill,
    faults_of_slope,
    told_of_slope,
    weights,
)
from wormopt.systems.spiked.limits import Sharing
from wormopt.systems.spiked.scenes.shapes import (
    AccordionShape,
    BlockWaveShape,
    FastShape,
    FileShape,
)
from wormopt.systems.spiked.task import MOST_LINKS, Worm

Links = Annotated[
    int, Meta(ge=1, le=MOST_LINKS, description=f"a whole number from 1 to {MOST_LINKS}")
]
Shared = Annotated[
    Sharing,
    says(
        "",
        "how several resting masses share the load, see "
        "[theory](../theory-kinematic.md#5-spike-loads-and-sharing-rules); no spike has a limit "
        "here",
    ),
]

MOTION_SCALARS: dict[str, tuple[str, str]] = {
    "speed": ("speed", "mean speed"),
    "advance": ("length", "distance per period"),
    "period": ("time", "period"),
    "resting_min": (
        "count",
        "smallest number of masses at rest at any time; 0 where the worm glides",
    ),
    "lambda_min": (
        "force",
        "smallest *λ* of (7), the mean over the masses of their spike loads",
    ),
    "lambda_max": ("force", "largest *λ*"),
    "lambda_mean": ("force", "its mean over the period, impulses included"),
    "spike_load_max": (
        "force",
        "largest load of a single spike, under the sharing rule, impulses not included",
    ),
    "actuator_force_max": (
        "force",
        "largest \\|*μ*<sub>j</sub>\\|; unknown where velocities jump",
    ),
    "energy_per_distance": (
        "energy_per_distance",
        "energy the actuators spend, nothing recovered; unknown where velocities jump or the worm "
        "stands still",
    ),
    **COST_OF_TRANSPORT,
    "mode_sequence": (
        "count",
        "lists of resting masses, phase after phase; an empty list is a glide",
    ),
    "glides": (
        "time",
        "begin and end of each glide; one that runs past the end of the period appears in two "
        "parts",
    ),
    "impulses": (
        "impulse",
        "time and size of each impulse on the spikes, summed over the masses",
    ),
    "smallest_load": (
        "force",
        "smallest *Γ* for which this gait is ruled by kinematics alone; unknown where none is",
    ),
    "smallest_period": (
        "time",
        "smallest period for which this shape is, at the load of the scene; unknown where none is",
    ),
    "recheck_speed_error": ("speed", "difference between the speeds of both routes"),
}
"""What every result with a gait tells of its motion."""

_LINK, _MASS = ("link", "time"), ("mass", "time")
MOTION_VARIABLES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "time": ("time", ("time",), "time"),
    "length": ("length", _LINK, "link length"),
    "rate": ("speed", _LINK, "rate of the link length"),
    "acceleration": ("acceleration", _LINK, "acceleration of the link length"),
    "position": ("length", _MASS, "position of the mass"),
    "velocity": ("speed", _MASS, "velocity of the mass"),
    "reaction": ("force", _MASS, "load on the spike"),
    "reaction_mean": ("force", ("time",), "mean spike load lambda of (7)"),
    "sigma": ("force", ("time",), "driving term sigma of (7)"),
    "glide": ("speed", ("time",), "common velocity w of (7)"),
    "actuator_force": ("force", _LINK, "actuator force"),
    "resting": ("count", _MASS, "1 where the mass rests"),
}
"""Signals over one period."""


REGION_VARIABLES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "region_period": ("time", ("region_period",), "periods of the map"),
    "region_load": ("force", ("region_load",), "loads *Γ* of the map"),
    "region_spike_load": (
        "force",
        ("region_period", "region_load"),
        "largest load on a spike; not a number where the worm glides",
    ),
    "region_least_load": (
        "force",
        ("region_period",),
        "smallest *Γ* that holds the worm, w = 0; below 0 where it is held without load",
    ),
    "region_most_load": (
        "force",
        ("region_period",),
        "*Γ* at which a spike carries `region.spike_load`; there if that is given",
    ),
}
"""Where kinematics alone rules the gait, by period and load."""


class WormTable(Table, frozen=True, kw_only=True):
    """A chain of *n* + 1 point masses on the ground, joined by *n* links.

    Links have the lengths they are given, and every mass has spikes that let it slide forward and
    never backward.
    """

    links: Annotated[Links, says("count", "*n*")]
    mass: Annotated[PerMass, says("mass", "point masses *m*<sub>i</sub>; mass 0 is the head")]
    drag: Annotated[NonNegative, says("drag", "*k*: viscous drag −*k v* on each mass")] = 0.0
    load: Annotated[
        Loads,
        says(
            "force",
            "*Γ*: force against the direction of motion on each mass (towed load, slope). A pair "
            "is a range, for designs only: a designed gait keeps its limits under all of it. "
            "Three or more numbers are the loads of the masses, head first: a cable at the tail of "
            "a worm of two links is [0, 0, 0.3]",
        ),
    ] = 0.0
    slope: Uphill = 0.0
    gravity: Gravity = None

    @property
    def worm(self) -> Worm:
        """The worm itself, pulled back by its load and by its weight."""
        if not self.slope:
            return Worm(self.links, self.mass, self.drag, self.load)
        pull = weights(self.slope, self.gravity, per(self.mass, self.links + 1))
        if len(set(pull)) > 1:
            return Worm(self.links, self.mass, self.drag, self.load, pull)
        if isinstance(self.load, tuple):
            loads = tuple(load + pull[0] for load in self.load)
            return Worm(self.links, self.mass, self.drag, loads)
        return Worm(self.links, self.mass, self.drag, self.load + pull[0])

    @property
    def facts(self) -> dict[str, Any]:
        """What its weight does."""
        return told_of_slope(self.slope, self.gravity, self.masses)

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return self.worm.masses

    def faults(self, units: str, loads: bool = False) -> Iterator[Fault]:
        """Yield what is wrong between the keys.

        `units` are the scene's; `loads`: whether the load may be a range.
        """
        yield from faults_of_slope(self.slope, self.gravity, units)
        if isinstance(self.load, tuple) and len(self.load) == 2 and not loads:
            yield (
                "worm.load",
                "a range of loads is for gaits that are designed; write one number, or the loads "
                "of three or more masses",
            )
        for key, message in self.worm.faults():
            yield f"worm.{key}", message


class FastGait(FastShape, frozen=True, kw_only=True):  # noqa: D101
    __doc__ = FastShape.__doc__
    sharing: Shared = "equal"


class BlockWave(BlockWaveShape, frozen=True, kw_only=True):  # noqa: D101
    __doc__ = BlockWaveShape.__doc__
    sharing: Shared = "equal"


class Accordion(AccordionShape, frozen=True, kw_only=True):  # noqa: D101
    __doc__ = AccordionShape.__doc__
    sharing: Shared = "equal"


class GaitFile(FileShape, frozen=True, kw_only=True):  # noqa: D101
    __doc__ = FileShape.__doc__
    sharing: Shared = "equal"


class RegionTable(Table, frozen=True, kw_only=True):
    """Over which periods and loads the map `region` is drawn."""

    periods: Annotated[
        Pair | None, says("time", "range of periods; null: from half to twice the gait's")
    ] = None
    loads: Annotated[
        NonNegativePair | None,
        says(
            "force",
            "range of *Γ*, the weight's pull included; null: from 0 to twice the scene's, or "
            "twice the smallest that holds the worm, whichever is more",
        ),
    ] = None
    spike_load: Annotated[
        Positive | None, says("force", "load at which a spike breaks; null: not known")
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        for key in ("periods", "loads"):
            pair = getattr(self, key)
            if pair is not None:
                yield from wrong_order(f"region.{key}", pair, may_be_equal=False)


GivenGait = FastGait | BlockWave | Accordion | GaitFile


class GaitScene(SceneTable, frozen=True, kw_only=True):
    """What a given gait does to the worm.

    Theory: [theory-kinematic.md](../theory-kinematic.md). The
    [trust report](../quickstart.md#3-the-trust-report) compares two routes. Timings: `crawl`,
    `recheck`.

    With an empty `want` no variables are saved, only scalars. Signals are over one period, from
    time 0; where something jumps, the instant appears twice, with the values before and after.
    Link 0 is at the head, between masses 0 and 1; the head starts at position 0. `sigma` is what is
    needed to hold the worm; `glide` is 0 while a mass rests; `actuator_force` is positive where
    the link pulls its masses together.

    The gait, exactly: on piece *q*, with *s* the time since it began, *l*<sub>j</sub> =
    Σ<sub>k</sub> `gait_polynomial`[q, j, k] *s*<sup>k</sup> + `gait_cosine`[q, j]
    cos(`gait_omega`[q] *s*) + `gait_sine`[q, j] sin(`gait_omega`[q] *s*). The last three are there
    only for gaits with harmonics. Coefficients count in length times time<sup>−k</sup>.
    """

    headline: ClassVar = ("speed", "period", "resting_min", "mode_sequence", "glides")
    scalars: ClassVar = MOTION_SCALARS | {
        "region_gait_load": ("force", "*Γ* of the scene, the weight's pull included, on the map"),
        "region_spike_strength": ("force", "load at which a spike breaks, on the map"),
    }
    variables: ClassVar = MOTION_VARIABLES | GAIT | REGION_VARIABLES

    kind: Literal["gait"]
    want: Annotated[
        tuple[Literal["gait", "motion", "spikes", "region", "animation"], ...],
        says(
            "",
            "`gait`: lengths, rates, resting masses; `motion`: paths, time upward; `spikes`: loads "
            "and forces; `region`: periods and loads at which kinematics alone rules the gait, and "
            "the largest load on a spike there; `animation`: two periods, a GIF",
        ),
    ] = ()
    worm: Annotated[WormTable, says("", "the worm")]
    gait: Annotated[GivenGait, says("", "`shape` decides which other keys there are")]
    region: Annotated[RegionTable | None, says("", "read where `want` holds `region`")] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults(self.units)
        yield from self.gait.faults(self.worm.links, folder)
        if self.region:
            yield from self.region.faults()
            if "region" not in self.want:
                yield (
                    "region",
                    'is read only where `want` holds "region"; add it, or leave this out',
                )
        if "region" in self.want and self.gait.sharing != "equal":
            yield "gait.sharing", 'the map of loads, `region`, is for "equal" only; write that'
