"""What the trust report of a scene of kind ``gait-shift`` rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator

from wormopt.result import Check
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.gears.case import Case
from wormopt.systems.gears.gear import Limits
from wormopt.systems.gears.hindsight import Schedule
from wormopt.systems.gears.trip import round_trip, tried
from wormopt.systems.gears.walk import Walk

# Loads by limits may be above 1 by rounding; both routes agree to this in time; so much may be
# missed of a peak between the looks of the second route.
KEPT, _AGREED, _PEAKS = 1e-9, 1e-7, 1e-4


def loads_by_limits(
    limits: Limits, spike: float, actuator: float, whose: str = ""
) -> Iterator[Check]:
    """Largest loads that were reached, by their limits."""
    for name, reached, limit, key in (
        ("spike load", spike, limits.spike, "spike_load"),
        ("actuator force", actuator, limits.actuator, "actuator_force"),
    ):
        if math.isinf(limit):
            continue
        told = f"{name} {whose}".rstrip()
        advice = (
            f"the {told} reaches {reached / limit:.4g} of limits.{key}: write a smaller "
            "supervisor.down, or a ground that rises less steeply"
        )
        yield Check(f"{told} by its limit", reached / limit, 1 + KEPT, advice)


def agreement(motion: Trajectory, again: Walk) -> Iterator[Check]:
    """Whether the worm, walked stroke by stroke, does the same, and never glides."""
    off = abs(motion.end_time / again.arrival - 1)
    advice = f"walked stroke by stroke the worm arrives at {again.arrival:.9g}"
    yield Check("arrival, second route", off, _AGREED, advice)
    for name, signal, peak in (
        ("spike load", "spike_load", again.spike.max()),
        ("actuator force", "actuator_force", again.actuator.max()),
    ):
        off = abs(motion.largest(signal) / float(peak) - 1)
        yield Check(f"largest {name}, second route", off, _PEAKS, f"it finds {peak:.6g}")
    low = float(again.total.min())
    advice = f"spikes would have to pull by {-low:.4g}, so the worm glides: slow that gear down"
    yield Check("gliding", max(0.0, -low), 0.0, advice)


def transitions(case: Case) -> Iterator[Check]:
    """Integrate round trips through neighbouring gears by (7), which knows no gears."""
    box, moved, wrong, way = case.box, 0.0, 0, 0.0
    for lower, (slow, fast) in enumerate(zip(box.gears, box.gears[1:], strict=False)):
        trip = round_trip(box, lower)
        low = max(slow.least, fast.least)
        high = min(*slow.bears(case.limits), *fast.bears(case.limits))
        for load in (low, high):
            trial = tried(box, trip, load)
            moved, way = max(moved, trial.moved), max(way, trial.advance)
            wrong += trial.glides + trial.impulses
    advice = "a mass that is to rest through a transition moves"
    yield Check("masses that move in transitions", moved, 0.0, advice)
    advice = "transitions have corners, or let the worm glide"
    yield Check("glides and impulses in transitions", float(wrong), 0.0, advice)
    advice = "the way through a transition is another"
    yield Check("way through transitions, second route", way, KEPT, advice)


def hindsight(case: Case, best: Schedule, walked: Walk, again: Walk) -> Iterator[Check]:
    """Whether the best schedule can be walked as it stands, within the limits, and is the best.

    `walked` is the walk by the schedule, `again` that of the supervised worm.
    """
    off = abs(walked.arrival / best.time - 1)
    advice = f"the best schedule arrives at {walked.arrival:.9g} when it is walked"
    yield Check("best schedule, walked", off, _AGREED, advice)
    over = max(
        float(walked.spike.max()) / case.limits.spike,
        float(walked.actuator.max()) / case.limits.actuator,
    )
    advice = "the best schedule breaks a limit between the looks at it"
    yield Check("best schedule, loads by limits", over, 1 + _PEAKS, advice)
    kept = again.spike.max() <= case.limits.spike and again.total.min() >= 0
    if kept and again.actuator.max() <= case.limits.actuator:
        faster = best.time / again.arrival
        advice = "the supervised worm is faster than the best schedule, which thus is not the best"
        yield Check("best schedule, time by the supervisor's", faster, 1 + _AGREED, advice)
