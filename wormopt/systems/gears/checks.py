"""Checks of the trust report of a scene of kind ``gait-shift``, with round trips through two gears.

A round trip is one periodic gait, integrated independently of gears.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.model.gait import Gait
from wormopt.result import Check
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Gear, Limits, Stroke
from wormopt.systems.gears.hindsight import Schedule
from wormopt.systems.gears.walk import Walk
from wormopt.systems.spiked import integrate

# Intervals of rest, and gaps in them, of a smaller share of the trip are ignored.
_NOTHING = 1e-7


@dataclass(frozen=True, eq=False)
class Trip:
    """A cycle in a gear, the transition up, a cycle in the next gear, and the transition down."""

    gait: Gait
    spells: tuple[tuple[float, float, tuple[int, ...]], ...]  # start, end, masses that must rest
    advance: float  # distance of the trip, from its strokes


@dataclass(frozen=True)
class Trial:
    """Transitions of a trip, as integrated."""

    moved: float  # share of the trip in which a mass moves that must rest
    glides: int
    impulses: int  # a corner of the lengths gives one
    advance: float  # relative difference of the distance


def round_trip(box: GearBox, lower: int) -> Trip:
    """Make the trip from gear `lower` to the next and back."""
    first, second = box.gears[lower : lower + 2]
    up, down = box.up[lower], box.down[lower]
    parts = [
        *((stroke, False) for stroke in _around(first, down.enters, up.leaves)),
        *((stroke, True) for stroke in up.strokes),
        *((stroke, False) for stroke in _around(second, up.enters, down.leaves)),
        *((stroke, True) for stroke in down.strokes),
    ]
    breaks = np.cumsum([0.0, *(stroke.duration for stroke, _ in parts)])
    spells = tuple(
        (float(a), float(b), stroke.resting)
        for (stroke, shifting), a, b in zip(parts, breaks, breaks[1:], strict=False)
        if shifting
    )
    gait = _gait(first.lengths[down.enters % len(first.strokes)], [s for s, _ in parts], breaks)
    return Trip(gait, spells, float(sum(stroke.way[0] for stroke, _ in parts)))


def _around(gear: Gear, begin: int, end: int) -> tuple[Stroke, ...]:
    """Strokes from one phase to another, at least once around."""
    count = len(gear.strokes)
    return tuple(gear.strokes[(begin + k) % count] for k in range(count + (end - begin) % count))


def _gait(length: np.ndarray, strokes: list[Stroke], breaks: np.ndarray) -> Gait:
    degree = max(stroke.velocity.shape[1] for stroke in strokes)
    polynomial = np.zeros((len(strokes), len(length), degree + 1))
    for piece, stroke in zip(polynomial, strokes, strict=True):
        powers = np.arange(1, 1 + stroke.velocity.shape[1])
        piece[:, 0] = length
        piece[:, 1 : 1 + len(powers)] = -np.diff(stroke.velocity, axis=0) / powers
        length = length - np.diff(stroke.way)
    return Gait(breaks, polynomial)


def tried(box: GearBox, trip: Trip, load: float) -> Trial:
    """Integrate eq. 7 along a trip under a load on each mass, and compare the resting masses."""
    period, drag = trip.gait.period, box.gears[0].drag
    found = integrate(trip.gait, box.mass.tolist(), drag, load)
    times = [time for time, _ in found.switches] + [period]
    moved = 0.0
    for begin, end, resting in trip.spells:
        for (_, at_rest), a, b in zip(found.switches, times, times[1:], strict=False):
            common = min(b, end) - max(a, begin)
            if common > _NOTHING * period and not at_rest >= set(resting):
                moved += common
    return Trial(
        moved / period,
        len(found.glides),
        len(found.impulses),
        abs(found.advance / trip.advance - 1),
    )


# Accepted excess of loads over limits by rounding, difference of the routes in time, and error of a
# peak between the samples of the second route.
KEPT, _AGREED, _PEAKS = 1e-9, 1e-7, 1e-4


def loads_by_limits(
    limits: Limits, spike: float, actuator: float, whose: str = ""
) -> Iterator[Check]:
    """Check the largest loads against their limits."""
    for name, reached, limit, key in (
        ("spike load", spike, limits.spike, "spike_load"),
        ("actuator force", actuator, limits.actuator, "actuator_force"),
    ):
        if math.isinf(limit):
            continue
        load = f"{name} {whose}".rstrip()
        advice = (
            f"the {load} reaches {reached / limit:.4g} of limits.{key}: decrease supervisor.down, "
            "or give a ground that rises less steeply"
        )
        yield Check(f"{load} relative to its limit", reached / limit, 1 + KEPT, advice)


def agreement(motion: Trajectory, again: Walk) -> Iterator[Check]:
    """Compare with the motion computed stroke by stroke, and check that the worm never glides."""
    off = abs(motion.end_time / again.arrival - 1)
    advice = f"computed stroke by stroke, the worm arrives at {again.arrival:.9g}"
    yield Check("arrival, second route", off, _AGREED, advice)
    for name, signal, peak in (
        ("spike load", "spike_load", again.spike.max()),
        ("actuator force", "actuator_force", again.actuator.max()),
    ):
        off = abs(motion.largest(signal) / float(peak) - 1)
        yield Check(f"largest {name}, second route", off, _PEAKS, f"it finds {peak:.6g}")
    low = float(again.total.min())
    advice = f"spikes would have to pull by {-low:.4g}, so the worm glides: slow down that gear"
    yield Check("gliding", max(0.0, -low), 0.0, advice)


def transitions(box: GearBox, limits: Limits) -> Iterator[Check]:
    """Integrate round trips through neighbouring gears by eq. 7, independently of gears."""
    moved, wrong, way = 0.0, 0, 0.0
    for lower, (slow, fast) in enumerate(zip(box.gears, box.gears[1:], strict=False)):
        trip = round_trip(box, lower)
        low = max(slow.least, fast.least)
        high = min(*slow.bears(limits), *fast.bears(limits))
        for load in (low, high):
            trial = tried(box, trip, load)
            moved, way = max(moved, trial.moved), max(way, trial.advance)
            wrong += trial.glides + trial.impulses
    advice = "a mass that should rest through a transition moves"
    yield Check("resting masses that move in transitions", moved, 0.0, advice)
    advice = "transitions have corners, or the worm glides in them"
    yield Check("glides and impulses in transitions", float(wrong), 0.0, advice)
    advice = "the second route finds a different advance through a transition"
    yield Check("advance through transitions, second route", way, KEPT, advice)


def hindsight(limits: Limits, best: Schedule, walked: Walk, again: Walk) -> Iterator[Check]:
    """Check that the best schedule is feasible, within the limits, and the best."""
    off = abs(walked.arrival / best.time - 1)
    advice = f"computed stroke by stroke, the best schedule arrives at {walked.arrival:.9g}"
    yield Check("best schedule, second route", off, _AGREED, advice)
    over = max(
        float(walked.spike.max()) / limits.spike,
        float(walked.actuator.max()) / limits.actuator,
    )
    advice = "the best schedule violates a limit between its samples"
    yield Check("best schedule, loads relative to limits", over, 1 + _PEAKS, advice)
    kept = again.spike.max() <= limits.spike and again.total.min() >= 0
    if kept and again.actuator.max() <= limits.actuator:
        faster = best.time / again.arrival
        advice = "the supervised worm is faster than the best schedule, which is not the best"
        yield Check("best schedule, time relative to supervisor", faster, 1 + _AGREED, advice)
