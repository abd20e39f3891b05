"""Kind "gait": the motion of a worm with a given gait under the kinematic theory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    arrays,
    checks,
    entry,
    facts,
    on_use,
    positive,
    scalar,
    scalars,
    stage,
    warnings,
)
from wormopt.study.types import NonNegativePair, Pair, wrong_order
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.gait_problem import SceneWorm
from wormopt.systems.spiked.motion import (
    MOTION_SCALARS,
    MOTION_VARIABLES,
    agreement,
    cross_check,
    motion_facts,
    motion_scalars,
    motion_variables,
)
from wormopt.systems.spiked.shapes import GivenGait

with on_use():
    import numpy as np

    from wormopt.systems.shared.gravity import assumed
    from wormopt.systems.spiked.bimodal import BimodalMotion
    from wormopt.systems.spiked.construct import gait_of_shape
    from wormopt.systems.spiked.crawl import Crawl, crawl
    from wormopt.systems.spiked.region import Region
    from wormopt.systems.spiked.stretches import Drive

_PERIODS, _LOADS = 121, 81
_CHECKED = 4  # periods at which both sides of the border are simulated
_ASIDE = (0.01, 0.1)  # distance from the border, as shares of its load
_MOVES, _LOAD_OFF = 1e-7, 1e-6  # glides slower than this share of the rates are rounding

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


class MapRange(Given):
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

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield ranges that are empty."""
        for key in ("periods", "loads"):
            pair = getattr(self, key)
            if pair is not None:
                yield from wrong_order(key, pair, may_be_equal=False)


class GaitMotion(Study, kind="gait"):
    """Simulate a given gait: speed, anchored masses, spike loads, forces, energy.

    [Kinematic theory](../theory-kinematic.md) explains the model and its equations, which are those
    of Zimmermann et al. 2007 [1]. The [trust report](../quickstart.md#3-the-trust-report) compares
    two independent computations (routes).

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
    pictures: ClassVar = {
        "gait": "lengths, rates and resting masses",
        "motion": "paths of the masses, time upward",
        "spikes": "loads and forces",
        "region": "periods and loads at which kinematics alone determines the motion, with the "
        "largest spike load",
        "animation": ("two periods as a GIF", "wormopt.pictures.worms:animation"),
    }
    wanted: ClassVar = ("gait", "motion", "spikes", "region", "animation")

    worm: SceneWorm = entry("the worm")
    gait: GivenGait = entry("the gait; `shape` selects the other keys")
    region: MapRange | None = entry("used if `want` contains `region`", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.worm.faults_in_scene(self.units)
        yield from self.gait.faults(self.worm.links, self.folder)
        if self.region and not self.is_mapped:
            yield (
                "region",
                'the table is given, but used only if want contains "region"; add "region" to want '
                "or remove the table",
            )
        if self.is_mapped and self.gait.sharing != "equal":
            yield (
                "gait.sharing",
                f'"{self.gait.sharing}" cannot be used with the picture region; write "equal"',
            )

    @property
    def is_mapped(self) -> bool:
        """Whether the map over periods and loads is wanted."""
        return "region" in self.want

    # -- the motion --------------------------------------------------------------------------------

    @stage
    def motion(self) -> Crawl:
        plant = self.worm
        loads = plant.loads(plant.load_range[1])
        gait = gait_of_shape(self.gait, self.scene)
        return crawl(gait, plant.masses, plant.drag, loads, self.gait.sharing)

    @stage
    def second_route(self) -> BimodalMotion:
        return cross_check(self.motion)

    @scalars(MOTION_SCALARS)
    def numbers(self) -> Mapping[str, Any]:
        return motion_scalars(self.motion, self.units)

    @scalar("speed", "difference in speed between the two routes")
    def recheck_speed_error(self) -> float:
        return abs(self.second_route.speed - self.motion.speed)

    @arrays(MOTION_VARIABLES | GAIT, when="want")
    def signals(self) -> Mapping[str, Any]:
        return motion_variables(self.motion)

    @checks
    def agreements(self) -> Iterator[Check]:
        yield from agreement(self.motion, self.second_route)

    @facts
    def residuals(self) -> Mapping[str, Any]:
        return motion_facts(self.motion, self.second_route) | assumed(self.units)

    @warnings
    def oddities(self) -> Iterator[str]:
        motion = self.motion
        if motion.glides:
            yield (
                "the worm glides: at some times no mass rests and nothing holds the forward motion"
            )
        elif motion.drops:
            yield "the kinematic velocity jumps down: there the worm is thrown forward"
        if motion.corners:
            yield "link rates jump: actuators act by impulses, so force and energy are undefined"
        if motion.impulses:
            yield "corners of the gait cause impulses on the spikes"

    # -- the map over periods and loads ------------------------------------------------------------

    @scalar("force", "*Γ* of the scene, including the weight along the slope", when="is_mapped")
    def region_gait_load(self) -> float:
        return self.motion.drive.load

    @scalar("force", "load at which a spike breaks", when="is_mapped")
    def region_spike_strength(self) -> float | None:
        return self.region.spike_load if self.region else None

    @stage
    def map_of_periods_and_loads(self) -> dict[str, np.ndarray]:
        table, drive = self.region or MapRange(), self.motion.drive
        if self.motion.corners:
            raise SolveError(
                "the gait has corners; there forces are impulses at every period and load, so the "
                "region is undefined",
                "smooth its corners (a `ramp`, another `profile`), or remove `region` from `want`",
            )
        region, period = Region(drive), drive.gait.period
        most = 2 * max(drive.load, region.least_load(period), 0.0) or drive.force_scale
        first, last = table.periods or (period / 2, 2 * period)
        lightest, heaviest = table.loads or (0.0, most)
        periods, loads = np.linspace(first, last, _PERIODS), np.linspace(lightest, heaviest, _LOADS)
        least = np.array([region.least_load(t) for t in periods])
        peaks = np.array([region.spike_loads(t, loads) for t in periods])
        variables = {
            "region_period": periods,
            "region_load": loads,
            "region_spike_load": np.where(loads >= least[:, None], peaks, np.nan),
            "region_least_load": least,
        }
        if table.spike_load is not None:
            breaks = [region.most_load(t, table.spike_load) for t in periods]
            variables["region_most_load"] = np.array(breaks)
        return variables

    @arrays(REGION_VARIABLES, when="is_mapped")
    def the_map(self) -> Mapping[str, Any]:
        return self.map_of_periods_and_loads

    @checks
    def of_the_map(self) -> Iterator[Check]:
        """Simulate at random periods with loads on both sides of the border."""
        if not self.is_mapped:
            return
        periods, region = self.map_of_periods_and_loads["region_period"], Region(self.motion.drive)
        numbers, wrong, off = np.random.default_rng(0), 0, 0.0
        for period in numbers.uniform(periods[0], periods[-1], _CHECKED):
            border = region.least_load(period)
            for side in (-1, 1):
                load = border * (1 + side * numbers.uniform(*_ASIDE))
                if border <= 0:  # no load is needed: there is one side only
                    load = numbers.uniform(0.0, region.drive.force_scale)
                glides, total = _simulated(region.drive, period, load)
                wrong += glides != (load < border)
                if not glides:
                    off = max(off, abs(total / region.total_load(period, load) - 1))
        advice = "the simulated worm glides where the map predicts no gliding, or vice versa"
        yield Check("sides of the border, simulated", wrong, 0, advice)
        advice = "the simulated spike loads differ from those of the map"
        yield Check("loads of the map, simulated", off, _LOAD_OFF, advice)


def _simulated(drive: Drive, period: float, load: float) -> tuple[bool, float]:
    """Whether the worm glides in a period, and the largest load on all spikes together."""
    # here, because only maps need the simulator
    from wormopt.simulation.simulate import simulate
    from wormopt.systems.spiked.dynamics import driven_worm

    gait = drive.gait.with_period(period)
    worm = driven_worm(gait, drive.mass.tolist(), drive.drag, load)
    motion = simulate(worm, period, times=np.linspace(0.0, period, 401), dense=True)
    slow = _MOVES * drive.rate_scale * drive.gait.period / period
    return bool(motion["glide"].max() > slow), motion.largest("spike_load")
