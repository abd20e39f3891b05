"""Limits of a design task in units of size 1, as linear forms of accelerations and velocities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from wormopt.systems.shared.sequences import Resting
from wormopt.systems.spiked.task import GaitProblem

# Acceleration within 1e-7 of a longest period from rest to the largest rate.
_ABRUPT = 1e7
# Limits are widened by this share of the numbers that they are the difference of.
_ROUNDING = 1e-14


class Slope(NamedTuple):
    """How fast a sum changes at most: at a rate, less a decay in proportion to the sum."""

    rate: float  # infinite where nothing limits it
    decay: float = 0.0  # per duration of the phase
    longest: bool = False  # the largest duration in a box is safe, not the smallest


@dataclass(frozen=True, eq=False)
class Form:
    """A limit -below ≤ alpha a + k beta v ≤ above on accelerations a and velocities v.

    Drag is in none of its masses or in all: beta is 0, or vanishes where alpha does and else has
    its sign.
    """

    alpha: np.ndarray  # (n+1,) weights of the masses' accelerations
    beta: np.ndarray  # (n+1,) weights of the masses' drags k v
    below: float = np.inf  # left below the value at rest; infinite: no limit
    above: float = np.inf  # left above the value at rest; infinite: no limit
    shared: float = 0.0  # part of `above` borne by masses that may not rest


class Bounds(NamedTuple):
    """What limits say of a form's weighted sum of velocities, alpha v."""

    form: Form  # the limits
    least: float  # of the sum
    largest: float  # of the sum
    fall: float  # largest downward slope
    rise: float  # largest upward slope
    courses: list[tuple[Slope, Slope]]  # pairs of laws for its fall and rise


@dataclass(frozen=True, eq=False)
class ScaledLimits:
    """A task in units of its largest link rate, longest period and mean mass."""

    task: GaitProblem
    like: ScaledLimits | None = None  # whose units are taken instead, to compare the two

    @property
    def links(self) -> int:
        """Number of links n."""
        return self.task.worm.links

    @cached_property
    def speed(self) -> float:
        """Unit of speeds: the largest link rate."""
        return self.like.speed if self.like else self.task.speed_nominal

    @cached_property
    def time(self) -> float:
        """Unit of times: the longest period."""
        return self.like.time if self.like else self.task.limits.period_range[1]

    @cached_property
    def shortest_period(self) -> float:
        """Shortest period."""
        return self.task.limits.period_range[0] / self.time

    @cached_property
    def longest_period(self) -> float:
        """Longest period: 1 in its own units."""
        return self.task.limits.period_range[1] / self.time

    @cached_property
    def mean_mass(self) -> float:
        """Unit of masses."""
        return self.like.mean_mass if self.like else float(np.mean(self.task.worm.masses))

    @cached_property
    def force(self) -> float:
        """Unit of forces."""
        return self.mean_mass * self.speed / self.time

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses, shape (n + 1,)."""
        return np.array(self.task.worm.masses) / self.mean_mass

    @cached_property
    def beyond(self) -> np.ndarray:
        """Load of each mass beyond the mean, shape (n + 1,)."""
        return np.array(self.task.worm.beyond) / self.force

    @cached_property
    def drag(self) -> float:
        """Drag coefficient k of each mass."""
        return self.task.worm.drag * self.speed / self.force

    @cached_property
    def rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest contraction and extension rates, shape (n,) each."""
        contraction, extension = map(np.array, self.task.limits.rate_bounds(self.links))
        return contraction / self.speed, extension / self.speed

    @cached_property
    def strokes(self) -> np.ndarray:
        """How far the length of each link may change, shape (n,)."""
        ranges = np.array(self.task.limits.length_ranges(self.links))
        return np.ptp(ranges, axis=1) / (self.speed * self.time)

    @cached_property
    def acceleration(self) -> np.ndarray | None:
        """Largest link accelerations, shape (n,); None where velocities may jump.

        Programs lose digits where numbers differ too much, and a larger one gains next to nothing.
        """
        limit = self.task.limits.acceleration
        if limit is None:
            return None
        return np.minimum(np.broadcast_to(limit, self.links) * self.time / self.speed, _ABRUPT)

    @cached_property
    def spikes(self) -> np.ndarray:
        """Largest loads of the spikes, shape (n + 1,); infinite without a limit."""
        return _spread(self.task.limits.spike_load, self.links + 1) / self.force

    @cached_property
    def actuator_most(self) -> np.ndarray:
        """Largest forces of the actuators, shape (n,); infinite without a limit."""
        return _spread(self.task.limits.actuator_force, self.links) / self.force

    def weighted(self, weights: np.ndarray) -> Form:
        """Sum of the forces (n + 1,) m a + k v that must act on the masses, without limits."""
        return Form(weights * self.mass, weights)

    def fastest(self, resting: Resting) -> np.ndarray:
        """Largest velocity (n + 1,) of each mass that link rates allow from those at rest."""
        contraction, extension = self.rates
        masses = range(self.links + 1)
        return np.array(
            [min(contraction[m:i].sum() + extension[i:m].sum() for m in resting) for i in masses]
        )

    def forms(self, resting: Resting, more: int = 0) -> list[Form]:
        """All limits on link accelerations, the sum of the spikes' loads and actuator forces.

        `more` others may rest as well.
        """
        given = self.acceleration
        most_of_each = np.full(self.links, np.inf) if given is None else given
        links = [
            Form(-step, 0.0 * step, most, most)
            for step, most in zip(
                np.diff(np.eye(self.links + 1), axis=0), most_of_each, strict=True
            )
        ]
        forces = [self._momentum(resting, more), *([] if more else self._actuators(resting))]
        return [*links, *(self._binding(form, resting) for form in forces)]

    def _binding(self, form: Form, resting: Resting) -> Form:
        """The form without a limit that accelerations and drag cannot reach."""
        implied, slow, fast = self._implied(form, resting)
        below = form.below if form.below < implied - slow else np.inf
        return replace(
            form, below=below, above=form.above if form.above < implied + fast else np.inf
        )

    def _implied(self, form: Form, resting: Resting) -> tuple[float, float, float]:
        """Largest size of alpha a by the links' limits, least and largest k beta v."""
        v_max = self.fastest(resting)
        slow = self.drag * float(np.minimum(form.beta, 0.0) @ v_max)
        fast = self.drag * float(np.maximum(form.beta, 0.0) @ v_max)
        if self.acceleration is None:
            return np.inf, slow, fast
        a, masses = self.acceleration, range(self.links + 1)
        between = [min(a[min(m, i) : max(m, i)].sum() for m in resting) for i in masses]
        return float(np.abs(form.alpha) @ between), slow, fast

    def admits_rest(self, resting: Resting) -> bool:
        """Whether the worm may stand still on the spikes of these masses."""
        return all(min(form.below, form.above) >= 0.0 for form in self.forms(resting))

    def _momentum(self, resting: Resting, more: int) -> Form:
        """Sum of the reactions: the momentum's change, the drag and the load, (7)."""
        limits, count = self.task.limits, self.links + 1
        spikes = _spread(limits.spike_load, count)[list(resting)]
        # However they share it, together they carry no more than the sum of what each may.
        if limits.sharing == "equal":
            known, others = len(spikes) * spikes.min(), more * spikes.min() if more else 0.0
        else:
            moving = np.sort(np.delete(_spread(limits.spike_load, count), list(resting)))
            known, others = spikes.sum(), moving[len(moving) - more :].sum()
        lightest, heaviest = self.task.worm.load_range  # limits hold under every load
        below = self._apart(count * lightest, count * limits.sigma_margin)
        above = self._apart(float(known + others), count * heaviest)
        shared = float(others) / self.force if above < np.inf else 0.0
        return Form(self.mass, np.ones(count), below, above, shared)

    def _actuators(self, resting: Resting) -> Iterator[Form]:
        """Actuator forces by the recursion (3), where the spikes' loads are known."""
        limits = self.task.limits
        known = len(resting) == 1 or limits.sharing == "equal"
        if limits.actuator_force is None or not known:
            return
        most_of_each = _spread(limits.actuator_force, self.links)
        for (weight, per_load), most in zip(self.actuators(resting), most_of_each, strict=True):
            own = float(weight @ np.array(self.task.worm.beyond))
            at_rest = sorted(load * per_load + own for load in self.task.worm.load_range)
            yield Form(
                weight * self.mass,
                weight,
                self._apart(at_rest[0], -float(most)),
                self._apart(float(most), at_rest[1]),
            )

    def actuators(self, resting: Resting) -> Iterator[tuple[np.ndarray, float]]:
        """Weights (n + 1,) of masses' forces in each actuator's, its force at rest per load.

        The latter under loads alike. The resting masses share the load equally.
        """
        count, rest = self.links + 1, len(resting)
        for j in range(1, count):
            held = sum(i < j for i in resting)  # whole numbers, so that what cancels is zero
            weight = (held - rest * (np.arange(count) < j)) / rest
            yield weight, (held * count - rest * j) / rest

    def _apart(self, high: float, low: float) -> float:
        """Difference of two forces, rounded up, in units of force."""
        return (high - low + _ROUNDING * (abs(high) + abs(low))) / self.force

    def bounds(self, resting: Resting, more: int) -> list[Bounds]:
        """`forms` with what they say of velocities; cached.

        `more` others may rest as well.
        """
        if (resting, more) not in self._known:
            self._known[resting, more] = [
                Bounds(
                    form,
                    *self.span(form.alpha, resting),
                    *self.slopes(form, resting),
                    self.courses(form, resting),
                )
                for form in self.forms(resting, more)
            ]
        return self._known[resting, more]

    @cached_property
    def _known(self) -> dict[tuple[Resting, int], list[Bounds]]:
        return {}

    def slopes(self, form: Form, resting: Resting) -> tuple[float, float]:
        """Largest fall and rise per time of alpha v, a form's weighted sum of velocities.

        Not negative; infinite where velocities may jump and nothing holds them.
        """
        implied, slow, fast = self._implied(form, resting)
        fall, rise = min(form.below + fast, implied), min(form.above - slow, implied)
        # A form that must fall, or rise, all the time does not rise, or fall, at all.
        return max(fall, 0.0), max(rise, 0.0)

    def courses(self, form: Form, resting: Resting) -> list[tuple[Slope, Slope]]:
        """Pairs of laws for the fall and rise of alpha v: constant, or decaying with drag.

        Laws that another one always beats are left out.
        """
        fall, rise = self.slopes(form, resting)
        falls, rises = [Slope(fall)], [Slope(rise)]
        some = (form.alpha != 0.0) & (self.fastest(resting) > 0.0)
        alpha, drags = form.alpha[some], self.drag * form.beta[some]
        positive, negative = bool(np.all(alpha > 0.0)), bool(np.all(alpha < 0.0))
        if (positive or negative) and drags.any():
            # k beta v lies between the least and the largest ratio times alpha v
            ratio, top = drags / alpha, np.max(np.abs(self.span(form.alpha, resting)))
            slow, fast = (float(ratio.min()), False), (float(ratio.max()), True)
            for laws, most, rate, helped in (
                (falls, fall, max(form.below, 0.0), negative),
                (rises, rise, max(form.above, 0.0), positive),
            ):
                decay, longest = slow if helped else fast
                if rate - helped * decay * top < most:
                    laws.append(Slope(rate, decay, longest))
        return list(product(falls, rises))

    def span(self, alpha: np.ndarray, resting: Resting) -> tuple[float, float]:
        """Least and largest velocity sum weighted by `alpha` (n + 1,), by the link rates."""
        contraction, extension = self.rates
        fastest = self.fastest(resting)
        alpha = np.where(fastest > 0.0, alpha, 0.0)
        least, largest = [np.minimum(alpha, 0.0) @ fastest], [np.maximum(alpha, 0.0) @ fastest]
        for m in resting:  # velocities are sums of rates v_j - v_{j+1}, counted from this mass
            inner = np.cumsum(alpha)[:-1] - (np.arange(self.links) >= m) * alpha.sum()
            into, out = np.maximum(inner, 0.0), np.maximum(-inner, 0.0)
            largest.append(into @ extension + out @ contraction)
            least.append(-(into @ contraction + out @ extension))
        return float(max(least)), float(min(largest))


@lru_cache(maxsize=64)
def scaled(task: GaitProblem) -> ScaledLimits:
    """Give the limits of a task in units of size 1; those of the last few tasks are kept."""
    return ScaledLimits(task)


def _spread(limit: float | Sequence[float] | None, count: int) -> np.ndarray:
    """A limit as one number each; infinite where there is none."""
    return np.broadcast_to(np.inf if limit is None else limit, count)
