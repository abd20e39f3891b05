"""A magneto-elastic pair in a given periodic field: its periodic motion, and the best cosine field.

All results are exact simulations; only the two parameters of a harmonic field are optimised.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.simulation.options import Exact
from wormopt.simulation.simulate import Values, simulate
from wormopt.simulation.trajectory import Trajectory

FADED = 0.5
"""Largest share of a small push that may remain."""

MOST_PERIODS = 1200
"""Periods after which the push must have decayed."""

# Size of the push, relative to the motion, its direction, and periods between two checks.
_PUSH, _DIRECTION, _LOOK = 1e-3, np.array([1.0, -0.7, 0.4]), 20
# Periods of the first block of a simulation, and of all blocks together; the last during a search.
_BLOCK, _MOST, _MOST_SOON = 20, 20_000, 5000
# Change over a block, relative to the motion, below which it counts as periodic.
_SETTLED = 1e-10
# A swing that exceeds the allowed strain by this factor does not return.
_LOST = 3.0
# Number of amplitudes, until a limit is met to this share; during a search the tolerance is larger.
_TRIALS, _MET, _SOON = 14, 1e-6, 1e-8
# Number of frequencies, then number of refinements and frequencies in each.
_FREQUENCIES, _ROUNDS, _NEARER = 9, 4, 4


@dataclass(frozen=True)
class FieldLimits:
    """Limits of a waveform."""

    field: tuple[float, float]  # least and largest G
    frequency: tuple[float, float]  # least and largest angular frequency; alike where given
    slope: float | None = None  # largest |G'|; None: the field may jump
    strain: float | None = None  # largest |x_2 - x_1|

    def __post_init__(self) -> None:
        if not self.field[0] < self.field[1]:
            raise ArgumentError(f"field must be a range [least, largest], not {self.field}")
        if not 0 < self.frequency[0] <= self.frequency[1]:
            raise ArgumentError(f"frequency must be a positive range, not {self.frequency}")
        for name in ("slope", "strain"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ArgumentError(f"{name} must be positive, not {value!r}")

    @property
    def period(self) -> tuple[float, float]:
        """Shortest and longest period."""
        return 2 * math.pi / self.frequency[1], 2 * math.pi / self.frequency[0]


@dataclass(frozen=True)
class FieldAim:
    """Objective of a waveform.

    Least work without a least speed raises ArgumentError, since a pair at rest needs no work.
    """

    # mean speed; None: least work of the field per distance
    maximise: Literal["speed"] | None = "speed"
    speed: float | None = None  # least mean speed

    def __post_init__(self) -> None:
        if self.maximise is None and not (self.speed or 0.0) > 0:
            raise ArgumentError(
                "speed is missing, and without it the cheapest motion is rest; give a least speed "
                "above 0"
            )


@dataclass(frozen=True, eq=False)
class Orbit:
    """One period of a motion, from exact simulation."""

    start: np.ndarray  # (4,) positions and velocities; mass 0 is at 0
    speed: float  # advance over period
    strain: float  # largest |x_2 - x_1|
    work: float  # net work of the field
    drift: float  # largest change of stretch and velocities over the last block of periods
    periods: int  # simulated before
    motion: Trajectory  # the period

    @property
    def settled(self) -> bool:
        """Whether the motion has become periodic."""
        return self.drift <= _SETTLED

    @property
    def moves(self) -> bool:
        """Whether any mass moves at all."""
        dense = self.motion.dense
        assert dense is not None
        return bool(np.max(np.abs(dense(dense.time)[2:])) > 0)

    @property
    def work_per_distance(self) -> float | None:
        """Work over advance, None without advance."""
        advance = self.speed * self.motion.end_time
        return self.work / advance if advance > 1e-9 * self.strain else None


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A field mean + amplitude cos(frequency t), and the motion of the pair in it."""

    frequency: float
    mean: float
    amplitude: float
    orbit: Orbit  # the motion
    reached: bool = True  # whether it has the required speed, if any
    kept: bool = True  # within the strain; if not, its mean alone exceeds it

    @property
    def course(self) -> Gait:
        """Field over one period."""
        breaks = np.array([0.0, 2 * math.pi / self.frequency])
        mean, wave = np.array([[[self.mean]]]), np.array([[self.amplitude]])
        return Gait(breaks, mean, np.array([self.frequency]), wave, 0 * wave)


def relative(state: np.ndarray) -> np.ndarray:
    """Stretch and velocities (3, ...), which are periodic, of states (4, ...)."""
    return np.array([state[1] - state[0], state[2], state[3]])


def from_origin(state: np.ndarray) -> np.ndarray:
    """The state (4,) shifted so that mass 0 is at 0."""
    return np.concatenate([state[:2] - state[0], state[2:]])


def named(state: np.ndarray) -> dict[str, np.ndarray]:
    """Positions and velocities of a state (4,) by name."""
    return {"position": state[:2], "velocity": state[2:]}


def orbit_from(
    plant: Model,
    period: float,
    start: np.ndarray,
    *,
    p: Values | None = None,
    drift: float = 0.0,
    periods: int = 0,
) -> Orbit:
    """Simulate one period of a driven `magnetic_pair` from `start` (4,), and measure it.

    `p`: parameters that differ from the model's; `drift`, `periods`: results of the previous
    blocks.
    """
    motion = simulate(plant, period, contact=Exact(), x0=named(start), p=p, dense=True)
    assert motion.dense is not None
    edges = motion.dense.time
    s, weights = np.polynomial.legendre.leggauss(8)
    spans = np.diff(edges)[:, None] / 2
    t = (edges[:-1, None] + spans * (s + 1)).ravel()
    power = motion.at(t).observe(plant["power"]).reshape(spans.size, -1)
    return Orbit(
        start,
        float(motion.end[0] - start[0]) / period,
        motion.largest(plant["stretch"]),
        float(np.sum(power * weights * spans)),
        drift,
        periods,
        motion,
    )


def settle(
    plant: Model,
    period: float,
    start: np.ndarray,
    *,
    p: Values | None = None,
    strain: float | None = None,
    soon: bool = False,
) -> Orbit:
    """Simulate a driven `magnetic_pair` until the ``drift`` of its orbit is small.

    `strain`: stop where the stretch is far beyond it; `soon`: use a larger tolerance.
    """
    total, block, drift = 0, _BLOCK, math.inf
    enough, most = (_SOON, _MOST_SOON) if soon else (_SETTLED, _MOST)
    while drift > enough and total < most:
        run = simulate(plant, block * period, contact=Exact(), x0=named(start), p=p, times=[])
        before, after = relative(start), relative(run.end)
        size = max(float(np.max(np.abs(after))), 1e-300)
        drift = float(np.max(np.abs(after - before))) / size
        start = from_origin(run.end)
        total, block = total + block, min(2 * block, most - total - block)
        if strain is not None and size > _LOST * strain:
            break
    return orbit_from(plant, period, start, p=p, drift=drift, periods=total)


def push_left(driven: Model, period: float, start: np.ndarray, size: float) -> float:
    """Perturb a periodic motion, and return the least share of the perturbation that remains.

    Ends once that is below `FADED`; `size`: of the motion's stretch and velocities.
    """
    push = _PUSH * size * _DIRECTION
    state, least = start + np.concatenate([[0.0], push]), math.inf
    for _ in range(MOST_PERIODS // _LOOK):
        state = simulate(driven, _LOOK * period, contact=Exact(), x0=named(state), times=[]).end
        left = np.linalg.norm(relative(state) - relative(start)) / np.linalg.norm(push)
        least = min(least, float(left))
        if least < FADED or left > 1 / _PUSH:
            break
    return least


def best_harmonic(pair: Model, limits: FieldLimits, aim: FieldAim, report: Report) -> Harmonic:
    """Find the best harmonic field within the limits of a waveform.

    Mean: the middle of the range; amplitude: the largest allowed, or the smallest with the required
    speed; frequency: the best. Not ``kept``, with amplitude 0, if the mean alone, applied at rest,
    exceeds the strain.
    """
    least, most = limits.frequency
    grid = np.linspace(least, most, 1 if least == most else _FREQUENCIES)
    found = [_at(pair, limits, aim, float(nu)) for nu in grid]
    if least < most:
        step = (most - least) / (_FREQUENCIES - 1)
        for k in range(_ROUNDS):
            report("the best harmonic field", k / _ROUNDS)
            best = max(found, key=lambda h: _merit(h, aim))
            near = best.frequency + step * np.linspace(-1, 1, _NEARER + 2)[1:-1]
            step *= 2 / (_NEARER + 1)
            found += [_at(pair, limits, aim, float(nu)) for nu in near if least <= nu <= most]
    best = max(found, key=lambda h: _merit(h, aim))
    p = {"frequency": best.frequency, "cosines": [best.mean, best.amplitude]}
    last = settle(pair, best.course.period, best.orbit.start, p=p)
    return replace(best, orbit=replace(last, periods=last.periods + best.orbit.periods))


def _at(pair: Model, limits: FieldLimits, aim: FieldAim, frequency: float) -> Harmonic:
    """The best amplitude at one frequency."""
    low, high = limits.field
    mean, whole = (low + high) / 2, (high - low) / 2
    if limits.slope is not None:
        whole = min(whole, limits.slope / frequency)

    def moved(amplitude: float) -> Harmonic:
        p = {"frequency": frequency, "cosines": [mean, amplitude]}
        period, strain = 2 * math.pi / frequency, limits.strain
        orbit = settle(pair, period, np.zeros(4), p=p, strain=strain, soon=True)
        fast = aim.speed is None or orbit.speed >= aim.speed
        return Harmonic(frequency, mean, amplitude, orbit, fast)

    def too_wide(harmonic: Harmonic) -> float:
        if limits.strain is None:
            return -1.0
        excess = harmonic.orbit.strain / limits.strain - 1
        return excess if harmonic.orbit.drift <= _SOON else max(excess, 1.0)

    def too_slow(harmonic: Harmonic) -> float:
        return 1 - harmonic.orbit.speed / (aim.speed or math.inf)

    best = moved(whole)
    if too_wide(best) > 0:
        still = moved(0.0)
        if too_wide(still) > 0:
            return replace(still, reached=False, kept=False)
        best = _edge(moved, too_wide, still, best)
    if aim.maximise or not best.reached:
        return best
    return _edge(moved, too_slow, best, moved(0.0))


def _edge(
    moved: Callable[[float], Harmonic],
    excess: Callable[[Harmonic], float],
    holds: Harmonic,
    fails: Harmonic,
) -> Harmonic:
    """Amplitude at which a limit is just kept, by false position between kept and exceeded."""
    kept, inside, outside, before = excess(holds), excess(holds), excess(fails), 0
    for _ in range(_TRIALS):
        if kept >= -_MET:
            break
        share = float(np.clip(inside / (inside - outside), 0.02, 0.98))
        middle = moved(holds.amplitude + share * (fails.amplitude - holds.amplitude))
        found = excess(middle)
        side = 1 if found > 0 else -1
        if side > 0:
            fails, outside = middle, found
        else:
            holds, kept, inside = middle, found, found
        if side == before:  # an end that stays for long would slow the search down
            inside, outside = (inside / 2, outside) if side > 0 else (inside, outside / 2)
        before = side
    return holds


def _merit(harmonic: Harmonic, aim: FieldAim) -> float:
    if not harmonic.kept:
        return -math.inf
    if aim.maximise:
        return harmonic.orbit.speed
    work = harmonic.orbit.work_per_distance
    return -work if harmonic.reached and work is not None else harmonic.orbit.speed - 1e9
