"""The problem of a certificate in rationals, and the rounded numbers of its proof."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from wormopt.model.given import per
from wormopt.numerics.roots import root
from wormopt.systems.spiked.gait_problem import GaitProblem

# Digits to which derived numbers of a proof are rounded, on the safe side.
_DIGITS = 6
# A bound is rounded up by this share.
_SPARE = 1e-9
# Floating-point numbers are replaced by simple fractions within this relative distance.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Statement:
    """A worm and its limits in rationals, by link and by mass, head first.

    Limits that are not given are None. `rates` are of contraction and extension.
    """

    masses: tuple[Fraction, ...]
    drag: Fraction
    load: tuple[Fraction, ...]  # range of the mean over all masses
    beyond: tuple[Fraction, ...]  # load of each mass minus the mean
    length: tuple[tuple[Fraction, ...], ...]
    rates: tuple[tuple[Fraction, ...], ...] | None
    acceleration: tuple[Fraction, ...]
    spike_load: tuple[Fraction, ...] | None
    actuator_force: tuple[Fraction, ...] | None
    sigma_margin: Fraction
    sharing: str
    resting: int
    period: Fraction

    @classmethod
    def of(cls, task: GaitProblem) -> Statement:
        """Make the statement of a task whose accelerations are limited."""
        worm, limits, n = task.worm, task.limits, task.worm.links
        assert limits.acceleration is not None
        rates = limits.rate_limits(n)
        spikes, forces = limits.spike_load, limits.actuator_force
        return cls(
            masses=exactly(worm.masses),
            drag=exactly([worm.drag])[0],
            load=exactly(worm.load_range),
            beyond=exactly(worm.beyond),
            length=tuple(exactly(pair) for pair in limits.length_ranges(n)),
            rates=rates and tuple(exactly(way) for way in rates),
            acceleration=exactly(per(limits.acceleration, n)),
            spike_load=None if spikes is None else exactly(per(spikes, n + 1)),
            actuator_force=None if forces is None else exactly(per(forces, n)),
            sigma_margin=exactly([limits.sigma_margin])[0],
            sharing=limits.sharing,
            resting=limits.resting,
            period=exactly(limits.period_range)[1],
        )

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.length)

    @property
    def loads_matter(self) -> bool:
        """Whether a limit depends on how resting masses share the load."""
        return self.spike_load is not None or self.actuator_force is not None

    @cached_property
    def ranges(self) -> tuple[Fraction, ...]:
        """Length range of each link."""
        return tuple(high - low for low, high in self.length)

    @cached_property
    def rates_taken(self) -> tuple[tuple[Fraction, ...], ...]:
        """Rates of contraction and extension that no motion exceeds, rounded up.

        A link that oscillates within a stroke D is never faster than sqrt(a D).
        """
        strokes = self.strokes(self.most, self.most)
        found = []
        for way in self.rates or ((None,) * self.links,) * 2:
            swings = zip(way, self.acceleration, strokes, strict=True)
            found.append([r if r and r * r <= a * d else math.sqrt(a * d) for r, a, d in swings])
        unit = _unit(max(map(max, found)))
        return tuple(tuple(up(x, unit) for x in way) for way in found)

    @property
    def most(self) -> np.ndarray:
        """Limits on accelerations in the form of `strokes`, (2, n)."""
        return np.array([self.acceleration] * 2, dtype=object)

    def strokes(self, starts: np.ndarray, brakes: np.ndarray) -> tuple[Fraction, ...]:
        """Largest change of each link's length in a period: its range or less, rounded up.

        A change A with a rate of at most r, acceleration α and deceleration β takes A/r + r e with
        e = (1/α + 1/β)/2, or 2 sqrt(A e) if r is not reached.
        """
        found = []
        for j, whole in enumerate(self.ranges):

            def late(stroke: float, j: int = j) -> float:
                return self._there_and_back(stroke, j, starts, brakes) - float(self.period)

            if late(float(whole)) > 0.0:
                most = root(late, 0.0, float(whole), xtol=1e-30 * float(whole))
                whole = min(whole, up(most, _unit(whole)))
            found.append(whole)
        return tuple(found)

    def mean_rates(
        self, strokes: Sequence[Fraction], starts: np.ndarray, brakes: np.ndarray
    ) -> float:
        """Bound on the speed: half the sum of the links' largest mean rates.

        V_0 + V_n <= Σ |V_j-1 - V_j|, and no link covers its stroke twice in less time.
        """
        total = 0.0
        for j, stroke in enumerate(strokes):
            total += float(stroke) / self._there_and_back(float(stroke), j, starts, brakes)
        return total

    def _there_and_back(
        self, amplitude: float, j: int, starts: np.ndarray, brakes: np.ndarray
    ) -> float:
        time = 0.0
        for way in (0, 1):
            e = float(1 / starts[way, j] + 1 / brakes[way, j]) / 2
            rate = float(self.rates[way][j]) if self.rates else math.inf
            short = rate * rate * e > amplitude
            time += 2 * math.sqrt(amplitude * e) if short else amplitude / rate + rate * e
        return time


def exactly(values: Iterable[float]) -> tuple[Fraction, ...]:
    """Convert numbers to decimal fractions of eleven digits.

    Numbers derived from them in floating point are rounded up by less, so 5 + 1e-15 must become 5.
    """
    return tuple(Fraction(f"{float(x):.11g}") for x in values)


def _unit(size: float | Fraction, digits: int = _DIGITS) -> Fraction:
    return Fraction(10) ** (math.floor(math.log10(size)) - digits)


def up(value: float | Fraction, unit: Fraction) -> Fraction:
    """Round up to a multiple; a float that equals one up to rounding is kept."""
    rounding = Fraction(_ROUNDING) if isinstance(value, float) else 0
    return math.ceil(Fraction(value) / unit * (1 - rounding)) * unit


def rounded_up(bound: float) -> Fraction:
    """Round a bound up by more than the rounding of floating-point sums."""
    if bound <= 0.0:
        return Fraction(0)
    return up(bound * (1 + _SPARE), _unit(bound, 9))


def wider(values: np.ndarray) -> np.ndarray:
    """Round numbers (...,) up to fractions of few digits."""
    return np.vectorize(lambda x: up(float(x), _unit(float(x))), otypes=[object])(values)
