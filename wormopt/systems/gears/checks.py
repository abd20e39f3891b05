"""Checks of the trust report of a scene of kind ``gait-shift``."""

from __future__ import annotations

import math
from collections.abc import Iterator

from wormopt.result import Check
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Limits
from wormopt.systems.gears.hindsight import Schedule
from wormopt.systems.gears.trip import round_trip, tried
from wormopt.systems.gears.walk import Walk

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
    """Check that the best schedule is feasible, within the limits, and the best.

    `walked` is the motion with the schedule, `again` that of the supervised worm.
    """
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
