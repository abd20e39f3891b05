"""Round trips through two gears as one periodic gait, integrated independently of gears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.model.gait import Gait
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Gear
from wormopt.systems.gears.stroke import Stroke
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
