"""Tables of optimal crawls: limits, objective, search, uncertain chains."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault, SceneError
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.types import PairPerLink, PerLink, PositiveOrPair, Seed
from wormopt.systems.spiked import Limits


class CrawlLimits(Given):
    """Limits of the crawl. A limit that is not given does not apply."""

    period: PositiveOrPair = entry(
        "the crawl repeats after this time, one number or a range to choose from; it is filled "
        "with the optimal number of equal cycles",
        quantity="time",
    )
    actuator_force: PerLink = entry(
        "largest |*u*<sub>j</sub>|, one number for all links or one per link",
        quantity="force",
        per="links",
    )
    length: PairPerLink | None = entry("range of each link", quantity="length", default=None)
    rate: PerLink | None = entry("largest |*l*′|", quantity="speed", default=None, per="links")
    acceleration: PerLink | None = entry(
        "largest |*l*″|", quantity="acceleration", default=None, per="links"
    )
    actuator_power: PerLink | None = entry(
        "largest power *u*<sub>j</sub> *l*<sub>j</sub>′ that an actuator gives",
        quantity="power",
        default=None,
        per="links",
    )
    energy_per_cycle: float | None = positive(
        "energy", "largest positive work of all actuators in a cycle", default=None
    )
    tick: float | None = positive(
        "time",
        "tick of a controller: a cycle is a whole number of ticks, at most a million in the "
        "shortest period",
        default=None,
    )

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period."""
        range_ = self.period if isinstance(self.period, tuple) else (self.period, self.period)
        return range_[0], range_[-1]

    @property
    def ticked(self) -> Limits:
        """Period and tick, as limits of gaits."""
        return Limits(period=self.period, length=(1.0, 2.0), tick=self.tick)

    def length_ranges(self, links: int) -> tuple[tuple[float, float], ...] | None:
        """Shortest and longest length of each link; None without a limit."""
        if self.length is None:
            return None
        return Limits(period=self.period, length=self.length).length_ranges(links)

    def cycles_of(self, duration: float) -> int:
        """Return the smallest number of cycles of this duration that fill the shortest period."""
        return self.ticked.cycles_of(duration)

    def durations_near(self, duration: float, ratio: float) -> tuple[float, float]:
        """Return the range of durations of a cycle around one, at most a `ratio` from it.

        Whole numbers of cycles fill a period within the limits.
        """
        shortest, longest = self.period_range
        fewest = most = self.cycles_of(duration)
        while longest / (most + 1) >= shortest / most > duration / ratio:
            most += 1
        while fewest > 1 and longest / fewest >= shortest / (fewest - 1):
            if longest / fewest > duration * ratio:
                break
            fewest -= 1
        low, high = shortest / most, longest / fewest
        return max(low, min(duration / ratio, high)), min(high, max(duration * ratio, low))

    def faults_of_keys(self) -> Iterator[Fault]:
        try:
            _ = self.ticked
        except SceneError as error:
            yield from error.faults

    def faults_for(self, links: int) -> Iterator[Fault]:
        """Yield lists that do not have one entry per link."""
        for name in ("actuator_force", "rate", "acceleration", "actuator_power"):
            yield from wrong_count(f"limits.{name}", getattr(self, name), links, "links")
        if self.length is not None:
            ranged = Limits(period=1.0, length=self.length, rate=1.0, impulses=True)
            yield from (
                (f"limits.{key}", what)
                for key, what in ranged.faults_for(links)
                if key.startswith("length")
            )


class Aim(Given):
    """Objective of the crawl: exactly one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry(
        "mean speed − `effort` · mean of |*u*|²", default=None
    )
    minimise: Literal["energy_per_mass_distance"] | None = entry(
        "positive work of the actuators over mass and distance; requires `speed`", default=None
    )
    effort: float = number("", "weight of the squared inputs, for `maximise`", least=0, default=0.0)
    speed: float | None = positive(
        "speed", "lower limit of the mean speed; default: none", default=None
    )

    @property
    def quantity(self) -> str:
        """Quantity of the minimised value."""
        return "acceleration" if self.minimise else "speed"

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.maximise is None) == (self.minimise is None):
            which = "has both" if self.maximise else "has neither"
            yield (
                "",
                f'{which} of maximise and minimise; write either maximise = "speed" or '
                'minimise = "energy_per_mass_distance"',
            )
        elif self.minimise and self.speed is None:
            yield (
                "speed",
                "missing, and without it the cheapest crawl stays at rest; write the least mean "
                "speed",
            )
        elif self.minimise and self.effort:
            yield "effort", 'applies to maximise = "speed" only; leave it out'


class Search(Given):
    """Starting points of the search. Results are local optima; strong actuators have many."""

    starts: int = whole(
        1,
        1000,
        "number of starts: the best of simulated waves of forces, the optimum with smoothed "
        "friction, the designed gait of a worm with spikes, another wave, random waves",
        default=4,
    )
    seed: Seed = entry("seed of the starts", default=0)
    result: Annotated[str, Meta(pattern=r"\.nc$", description='text ending in ".nc"')] | None = (
        entry(
            "the first start is the crawl of an earlier result with the same number of links; "
            "path relative to the scene's folder",
            default=None,
        )
    )


class Robust(Given):
    """One input for several chains with randomly drawn parameters.

    Masses, stiffness, damping and friction are drawn around the scene's values. Contact is then a
    complementarity condition on the grid of `[mesh]`, which is not exact. `speed_simulated` lists
    the speed of each chain after many periods. Not allowed: `minimise`, and `want =
    ["convergence"]`.
    """

    draws: int = whole(1, 20, "number of chains besides the nominal one", default=4)
    spread: float = number(
        "share",
        "half width of the range, as a share of the nominal value",
        above=0,
        below=1,
        default=0.3,
    )
    seed: Seed = entry("seed of the drawn chains", default=0)
    judge: Literal["mean", "worst"] = entry(
        "criterion: the average speed of the chains, or the speed of the slowest", default="mean"
    )
