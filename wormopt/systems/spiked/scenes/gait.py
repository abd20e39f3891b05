"""Scenes of kind "gait": the motion of a worm with a given gait under the kinematic theory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says
from wormopt.study.types import (
    Loads,
    NonNegativePair,
    Pair,
    PerMass,
    SceneTable,
    per,
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
        "[theory](../theory-kinematic.md#5-spike-loads-and-sharing-rules); spikes have no load "
        "limit here",
    ),
]

MOTION_SCALARS: dict[str, tuple[str, str]] = {
    "speed": ("speed", "mean speed"),
    "advance": ("length", "distance travelled per period"),
    "period": ("time", "period"),
    "resting_min": ("count", "smallest number of resting masses over time; 0 if the worm glides"),
    "lambda_min": (
        "force",
        "smallest *λ*, the spike load averaged over the masses (eq. 7 of Zimmermann et al. 2007)",
    ),
    "lambda_max": ("force", "largest *λ*"),
    "lambda_mean": ("force", "mean *λ* over the period, impulses included"),
    "spike_load_max": (
        "force",
        "largest load on a single spike under the sharing rule, without impulses",
    ),
    "actuator_force_max": (
        "force",
        "largest \\|*μ*<sub>j</sub>\\|; unknown if velocities jump",
    ),
    "energy_per_distance": (
        "energy_per_distance",
        "energy spent by the actuators per distance, without recovery; unknown if velocities jump "
        "or the worm does not advance",
    ),
    **COST_OF_TRANSPORT,
    "mode_sequence": (
        "count",
        "resting masses of each phase in order; an empty list is a glide",
    ),
    "glides": (
        "time",
        "start and end of each glide; a glide across the end of the period is split into two "
        "entries",
    ),
    "impulses": (
        "impulse",
        "time and size of each impulse on the spikes, summed over the masses",
    ),
    "smallest_load": (
        "force",
        "smallest *Γ* at which kinematics alone determines the motion; unknown if there is none",
    ),
    "smallest_period": (
        "time",
        "smallest period at which kinematics alone determines the motion of this gait shape at "
        "the scene's load; unknown if there is none",
    ),
    "recheck_speed_error": ("speed", "difference in speed between the two routes"),
}
"""Scalars of the motion in every result with a gait."""

_LINK, _MASS = ("link", "time"), ("mass", "time")
MOTION_VARIABLES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "time": ("time", ("time",), "time"),
    "length": ("length", _LINK, "link length"),
    "rate": ("speed", _LINK, "rate of the link length"),
    "acceleration": ("acceleration", _LINK, "acceleration of the link length"),
    "position": ("length", _MASS, "position of the mass"),
    "velocity": ("speed", _MASS, "velocity of the mass"),
    "reaction": ("force", _MASS, "load on the spike"),
    "reaction_mean": ("force", ("time",), "mean spike load lambda (eq. 7)"),
    "sigma": ("force", ("time",), "driving term sigma (eq. 7)"),
    "glide": ("speed", ("time",), "common velocity w (eq. 7)"),
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
        "largest load on one spike; NaN where the worm glides",
    ),
    "region_least_load": (
        "force",
        ("region_period",),
        "smallest *Γ* at which the worm does not glide; negative if no load is needed",
    ),
    "region_most_load": (
        "force",
        ("region_period",),
        "*Γ* at which one spike carries `region.spike_load`; only if that key is given",
    ),
}
"""Periods and loads at which kinematics alone determines the motion."""


class WormTable(Given):
    """A chain of *n* + 1 point masses on the ground, joined by *n* links.

    The link lengths are prescribed. Spikes on every mass let it slide forward but never backward.
    """

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry("point masses *m*<sub>i</sub>; mass 0 is the head", quantity="mass")
    drag: float = number("drag", "*k*: each mass has viscous drag −*k v*", least=0, default=0.0)
    load: Loads = entry(
        "*Γ*: force on each mass against the direction of motion (towed load, slope). A pair "
        "is a range and is allowed in designs only: the designed gait meets its limits over "
        "the whole range. Three or more numbers are the loads of the individual masses, head "
        "first. Example: a cable at the tail of a worm with two links is [0, 0, 0.3]",
        quantity="force",
        default=0.0,
    )
    slope: Uphill = 0.0
    gravity: Gravity = None

    @property
    def worm(self) -> Worm:
        """The worm, with its load and its weight along the slope."""
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
        """Effect of the weight on a slope, for the trust report."""
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
                "a range of loads is allowed in gait designs only; write one number, or one load "
                "for each of three or more masses",
            )
        for key, message in self.worm.faults():
            yield f"worm.{key}", message


class FastGait(FastShape):  # noqa: D101
    __doc__ = FastShape.__doc__
    sharing: Shared = "equal"


class BlockWave(BlockWaveShape):  # noqa: D101
    __doc__ = BlockWaveShape.__doc__
    sharing: Shared = "equal"


class Accordion(AccordionShape):  # noqa: D101
    __doc__ = AccordionShape.__doc__
    sharing: Shared = "equal"


class GaitFile(FileShape):  # noqa: D101
    __doc__ = FileShape.__doc__
    sharing: Shared = "equal"


class RegionTable(Given):
    """Range of periods and loads on the map `region`."""

    periods: Pair | None = entry(
        "range of periods; null: half to twice the gait's period", quantity="time", default=None
    )
    loads: NonNegativePair | None = entry(
        "range of *Γ*, including the weight along the slope; null: from 0 to twice the "
        "scene's load or twice the smallest load without gliding, whichever is larger",
        quantity="force",
        default=None,
    )
    spike_load: float | None = positive(
        "force", "load at which a spike breaks; null: unknown", default=None
    )

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        for key in ("periods", "loads"):
            pair = getattr(self, key)
            if pair is not None:
                yield from wrong_order(f"region.{key}", pair, may_be_equal=False)


GivenGait = FastGait | BlockWave | Accordion | GaitFile


class GaitScene(SceneTable):
    """The motion of a worm with a given gait.

    [Kinematic theory](../theory-kinematic.md) explains the model and its equations, which are those
    of Zimmermann et al. 2007 [1]. The [trust report](../quickstart.md#3-the-trust-report) compares
    two independent computations (routes). Timings: `crawl`, `recheck`.

    With an empty `want` only scalars are saved. Signals cover one period from time 0. Where a
    signal jumps, the time appears twice, with the values before and after. Link 0 is at the head,
    between masses 0 and 1; the head starts at position 0. `sigma` is the mean spike load needed to
    keep the worm from gliding. `glide` is 0 while a mass rests. `actuator_force` is positive where
    the link pulls its masses together.

    The gait is saved exactly. On piece *q*, where *s* is the time since the piece began,
    *l*<sub>j</sub> = Σ<sub>k</sub> `gait_polynomial`[q, j, k] *s*<sup>k</sup> + `gait_cosine`[q, j]
    cos(`gait_omega`[q] *s*) + `gait_sine`[q, j] sin(`gait_omega`[q] *s*). `gait_omega`,
    `gait_cosine` and `gait_sine` exist only for gaits with harmonics. Coefficients have the unit
    length times time<sup>−k</sup>.
    """

    headline: ClassVar = ("speed", "period", "resting_min", "mode_sequence", "glides")
    scalars: ClassVar = MOTION_SCALARS | {
        "region_gait_load": ("force", "*Γ* of the scene, including the weight along the slope"),
        "region_spike_strength": ("force", "load at which a spike breaks"),
    }
    variables: ClassVar = MOTION_VARIABLES | GAIT | REGION_VARIABLES

    kind: Literal["gait"]
    want: tuple[Literal["gait", "motion", "spikes", "region", "animation"], ...] = entry(
        "`gait`: lengths, rates and resting masses; `motion`: paths of the masses, time "
        "upward; `spikes`: loads and forces; `region`: periods and loads at which kinematics "
        "alone determines the motion, with the largest spike load; `animation`: two periods "
        "as a GIF",
        default=(),
    )
    worm: WormTable = entry("the worm")
    gait: GivenGait = entry("the gait; `shape` selects the other keys")
    region: RegionTable | None = entry("used if `want` contains `region`", default=None)

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
                    'the table is given, but used only if want contains "region"; add "region" to '
                    "want or remove the table",
                )
        if "region" in self.want and self.gait.sharing != "equal":
            yield (
                "gait.sharing",
                f'"{self.gait.sharing}" cannot be used with the picture region; write "equal"',
            )
