"""Limits of a design task in scaled units, as linear forms of accelerations and velocities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from wormopt.systems.shared.sequences import Resting
from wormopt.systems.spiked.gait_problem import GaitProblem

# Acceleration from rest to the largest rate within 1e-7 of a longest period.
_ABRUPT = 1e7
# Limits are widened by this share of the numbers whose difference they are.
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class Form:
    """A limit -below ≤ alpha a + k beta v ≤ above on accelerations a and velocities v.

    Either all masses have drag or none: beta is 0, or vanishes where alpha does and else has its
    sign.
    """

    alpha: np.ndarray  # (n+1,) weights of the masses' accelerations
    beta: np.ndarray  # (n+1,) weights of the masses' drags k v
    below: float = np.inf  # left below the value at rest; infinite: no limit
    above: float = np.inf  # left above the value at rest; infinite: no limit

    @cached_property
    def moving(self) -> list[int]:
        """Masses whose accelerations count."""
        return np.flatnonzero(self.alpha).tolist()

    @cached_property
    def dragged(self) -> list[int]:
        """Masses whose drags count."""
        return np.flatnonzero(self.beta).tolist()


@dataclass(frozen=True, eq=False)
class ScaledLimits:
    """A task in units of its largest link rate, longest period and mean mass."""

    task: GaitProblem
    like: ScaledLimits | None = None  # limits whose units are used instead, to compare the two

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
        """Largest link accelerations, shape (n,); None where velocities may jump."""
        # They are capped: programs lose digits if numbers differ too much, and a larger
        # acceleration gains almost nothing.
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
        """Form of a weighted sum of the forces (n + 1,) m a + k v on the masses, without limits."""
        return Form(weights * self.mass, weights)

    def fastest(self, resting: Resting) -> np.ndarray:
        """Largest velocity (n + 1,) of each mass, by the rates of the links to resting masses."""
        contraction, extension = self.rates
        masses = range(self.links + 1)
        return np.array(
            [min(contraction[m:i].sum() + extension[i:m].sum() for m in resting) for i in masses]
        )

    def forms(self, resting: Resting) -> list[Form]:
        """All limits on link accelerations, the sum of the spike loads, and actuator forces."""
        given = self.acceleration
        most_of_each = np.full(self.links, np.inf) if given is None else given
        links = [
            Form(-step, 0.0 * step, most, most)
            for step, most in zip(
                np.diff(np.eye(self.links + 1), axis=0), most_of_each, strict=True
            )
        ]
        return [*links, self._momentum(resting), *self._actuators(resting)]

    def binding(self, resting: Resting) -> list[Form]:
        """`forms` without limits on forces that cannot be reached."""
        if resting not in self._known:  # programs of a search ask again and again
            forms = self.forms(resting)
            links, forces = forms[: self.links], forms[self.links :]
            self._known[resting] = [*links, *(self._binding(form, resting) for form in forces)]
        return self._known[resting]

    @cached_property
    def _known(self) -> dict[Resting, list[Form]]:
        return {}

    def _binding(self, form: Form, resting: Resting) -> Form:
        """The form without the side that accelerations and drag cannot reach."""
        implied, slow, fast = self._implied(form, resting)
        below = form.below if form.below < implied - slow else np.inf
        return replace(
            form, below=below, above=form.above if form.above < implied + fast else np.inf
        )

    def _implied(self, form: Form, resting: Resting) -> tuple[float, float, float]:
        """Largest |alpha a| under the links' limits, smallest and largest k beta v."""
        v_max = self.fastest(resting)
        slow = self.drag * float(np.minimum(form.beta, 0.0) @ v_max)
        fast = self.drag * float(np.maximum(form.beta, 0.0) @ v_max)
        if self.acceleration is None:
            return np.inf, slow, fast
        a, masses = self.acceleration, range(self.links + 1)
        between = [min(a[min(m, i) : max(m, i)].sum() for m in resting) for i in masses]
        return float(np.abs(form.alpha) @ between), slow, fast

    def _momentum(self, resting: Resting) -> Form:
        """Sum of the reactions (7): change of momentum, drag and load."""
        limits, count = self.task.limits, self.links + 1
        spikes = _spread(limits.spike_load, count)[list(resting)]
        # For any split, the sum is at most the sum of the spikes' limits.
        most = len(spikes) * spikes.min() if limits.sharing == "equal" else spikes.sum()
        lightest, heaviest = self.task.worm.load_range  # limits hold under every load
        below = self._apart(count * lightest, count * limits.sigma_margin)
        above = self._apart(float(most), count * heaviest)
        return Form(self.mass, np.ones(count), below, above)

    def _actuators(self, resting: Resting) -> Iterator[Form]:
        """Actuator forces by recursion (3), where the loads of the spikes are known."""
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
        """For each actuator: weights (n + 1,) of the forces on masses, force at rest per load."""
        # All loads are equal, and the resting masses share them equally.
        count, rest = self.links + 1, len(resting)
        for j in range(1, count):
            # whole numbers, so that cancelling terms give exactly 0
            held = sum(i < j for i in resting)
            weight = (held - rest * (np.arange(count) < j)) / rest
            yield weight, (held * count - rest * j) / rest

    def _apart(self, high: float, low: float) -> float:
        """Difference of two forces, rounded up, in units of force."""
        return (high - low + _ROUNDING * (abs(high) + abs(low))) / self.force


@lru_cache(maxsize=64)
def scaled(task: GaitProblem) -> ScaledLimits:
    """Scale the limits of a task; the results of the last few tasks are cached."""
    return ScaledLimits(task)


def _spread(limit: float | Sequence[float] | None, count: int) -> np.ndarray:
    """A limit as one number for each; infinite if not given."""
    return np.broadcast_to(np.inf if limit is None else limit, count)
