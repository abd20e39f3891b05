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

    Either all masses have drag or none: beta is 0, or has the sign of alpha and vanishes with it.
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


@dataclass(eq=False)
class ScaledLimits:
    """A task in units of its largest link rate, longest period and mean mass."""

    task: GaitProblem
    like: ScaledLimits | None = None  # limits whose units are used instead, to compare the two

    def __post_init__(self) -> None:
        task, worm, limits, like = self.task, self.task.worm, self.task.limits, self.like
        self.links = n = worm.links
        # units
        self.speed = like.speed if like else task.speed_nominal
        self.time = like.time if like else limits.period_range[1]
        self.mean_mass = like.mean_mass if like else float(np.mean(worm.masses))
        self.force = self.mean_mass * self.speed / self.time
        # of the worm: masses (n + 1,), load of each beyond the mean (n + 1,), drag k of each
        self.mass = np.array(worm.masses) / self.mean_mass
        self.beyond = np.array(worm.beyond) / self.force
        self.drag = worm.drag * self.speed / self.force
        # limits: shortest and longest period; largest contraction and extension rates (n,);
        # by how much lengths may change (n,)
        shortest, longest = limits.period_range
        self.periods = shortest / self.time, longest / self.time
        contraction, extension = map(np.array, limits.rate_bounds(n))
        self.rates = contraction / self.speed, extension / self.speed
        ranges = np.array(limits.length_ranges(n))
        self.strokes = np.ptp(ranges, axis=1) / (self.speed * self.time)
        # largest accelerations (n,), None where velocities may jump; they are capped: programs lose
        # digits if numbers differ too much, and a larger acceleration gains almost nothing
        self.acceleration: np.ndarray | None = None
        if limits.acceleration is not None:
            most = np.broadcast_to(limits.acceleration, n) * self.time / self.speed
            self.acceleration = np.minimum(most, _ABRUPT)
        # largest loads of spikes (n + 1,) and forces of actuators (n,), infinite without a limit
        self.spikes = _spread(limits.spike_load, n + 1) / self.force
        self.actuator_most = _spread(limits.actuator_force, n) / self.force

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
        given, steps = self.acceleration, np.diff(np.eye(self.links + 1), axis=0)
        most_of_each = np.full(self.links, np.inf) if given is None else given
        links = [Form(-s, 0.0 * s, most, most) for s, most in zip(steps, most_of_each, strict=True)]
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
        if (a := self.acceleration) is None:
            return form
        v_max, masses = self.fastest(resting), range(self.links + 1)
        between = [min(a[min(m, i) : max(m, i)].sum() for m in resting) for i in masses]
        most = float(np.abs(form.alpha) @ between)  # of |alpha a| under the links' limits
        slow = self.drag * float(np.minimum(form.beta, 0.0) @ v_max)
        fast = self.drag * float(np.maximum(form.beta, 0.0) @ v_max)
        below = form.below if form.below < most - slow else np.inf
        above = form.above if form.above < most + fast else np.inf
        return replace(form, below=below, above=above)

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
        """Yield `of_actuators` for each actuator."""
        return zip(*of_actuators(resting, self.links + 1), strict=True)

    def _apart(self, high: float, low: float) -> float:
        """Difference of two forces, rounded up, in units of force."""
        return (high - low + _ROUNDING * (abs(high) + abs(low))) / self.force


def of_actuators(resting: Resting, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n, n + 1) of the forces on `count` masses, and force at rest per load (n,).

    All loads are equal, and the resting masses share them equally.
    """
    # whole numbers, so that cancelling terms give exactly 0
    ahead = np.arange(count) < np.arange(1, count)[:, None]
    held, rest = ahead[:, list(resting)].sum(axis=1), len(resting)
    weights = (held[:, None] - rest * ahead) / rest
    return weights, (held * count - rest * ahead.sum(axis=1)) / rest


@lru_cache(maxsize=64)
def scaled(task: GaitProblem) -> ScaledLimits:
    """Scale the limits of a task; the results of the last few tasks are cached."""
    return ScaledLimits(task)


def _spread(limit: float | Sequence[float] | None, count: int) -> np.ndarray:
    """A limit as one number for each; infinite if not given."""
    return np.broadcast_to(np.inf if limit is None else limit, count)
