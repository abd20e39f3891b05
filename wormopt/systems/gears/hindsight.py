"""The best schedule in hindsight: gears by place, found by who knows the whole way.

Time passes from node to node: begins of strokes at which a gear may be left or is entered. What
an edge between two of them loads is a function of the place alone, since the worm's shape at a
node is always the same. The search goes by time (Dijkstra), every node apart in bins of place; of
what falls into one bin only that counts which is further than all that came earlier, at its own
place and not the bin's. So what is found can be walked as it stands, and is the best as the bins
become narrow: within a bin it is taken for granted that being ahead does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report, silent
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Limits
from wormopt.systems.gears.ground import Ground

# Instants of a stroke at which forces are looked at.
_LOOKS = np.linspace(0.0, 1.0, 9)
# Limits may be exceeded by this share between the looks.
_EXCEEDED = 1e-9
# Places that differ by less, in bins, are one.
_ROUNDING = 1e-6
# Places in a bin at which it is known what an edge loads.
_KNOWN = 2


@dataclass(frozen=True, eq=False)
class Edge:
    """Strokes from one node on to another."""

    rows: tuple[int, ...]
    end: int  # row that begins there
    duration: float
    way: float  # of the mean of the masses
    allowed: np.ndarray  # (places,) whether it keeps the limits if it begins there


@dataclass(frozen=True, eq=False)
class Schedule:
    """Rows one after another, and when the goal is reached by them."""

    rows: tuple[int, ...]
    time: float
    labels: int  # that were looked at


def best_schedule(
    box: GearBox,
    ground: Ground,
    limits: Limits,
    start: float,
    goal: float,
    gear: int,
    *,
    fineness: int = 3,
    report: Report = silent,
) -> Schedule:
    """Find the schedule that brings the mean of the masses from `start` to `goal` first.

    It begins with a cycle of `gear`. Bins are so narrow that a cycle crosses `fineness` of them at
    least. Raises SolveError if none keeps the limits.
    """
    least = min(gear.advance for gear in box.gears)  # from one visit of a node to the next
    bins = int(np.ceil(fineness * (goal - start) / least))
    places = np.linspace(start, goal, _KNOWN * bins + 1)
    edges = _edges(box, ground, limits, places)
    step = (goal - start) / bins
    begin = box.first_row(gear)
    queue: list[tuple[float, int, int, float]] = [(0.0, 0, begin, start)]
    came: list[tuple[int, Edge | None]] = [(-1, None)]
    reached: dict[tuple[int, int], float] = {}
    looked, furthest = 0, start
    while queue:
        time, label, node, place = heappop(queue)
        if node < 0:
            return Schedule(_rows(came, label), time, looked)
        key = node, int((place - start) / step)
        if place <= reached.get(key, -np.inf) + _ROUNDING * step:
            continue
        reached[key] = place
        looked += 1
        if place > furthest and looked % 1000 == 0:
            furthest = place
            report("looking back", (place - start) / (goal - start))
        near = min(int(_KNOWN * (place - start) / step), len(places) - 2)
        for edge in edges[node]:
            # allowed at both neighbours: forces vary by little from one to the other
            if not edge.allowed[near : near + 2].all():
                continue
            came.append((label, edge))
            there, then = place + edge.way, time + edge.duration
            if there >= goal:
                then = time + _until(box, edge, goal - place)
                heappush(queue, (then, len(came) - 1, -1, goal))
            else:
                heappush(queue, (then, len(came) - 1, edge.end, there))
    raise SolveError(
        "no schedule of the gears passes within the limits",
        "give spikes and actuators more load, or add a gear in which more masses rest",
    )


def _edge_rows(box: GearBox, first: int, nodes: set[int]) -> tuple[int, ...]:
    """Rows from one on to the next node."""
    rows = [first]
    while box.rows[rows[-1]].follows not in nodes:
        rows.append(box.rows[rows[-1]].follows)
    return tuple(rows)


def _rows(came: list[tuple[int, Edge | None]], label: int) -> tuple[int, ...]:
    found: list[int] = []
    while label >= 0:
        label, edge = came[label]
        found[:0] = edge.rows if edge else ()
    return tuple(found)


def _until(box: GearBox, edge: Edge, way: float) -> float:
    """Time within an edge at which the mean of the masses has gone some way."""
    gone = 0.0
    for number in edge.rows:
        stroke = box.rows[number].stroke
        step = float(stroke.way.mean())
        if step >= way:
            return gone + stroke.until(way)
        way, gone = way - step, gone + stroke.duration
    return gone


def _nodes(box: GearBox) -> set[int]:
    """Rows that begin where a gear is left or entered, or a cycle begins."""
    found = {box.first_row(k) for k in range(len(box.gears))}
    for row in box.rows:
        if row.slower is not None or row.faster is not None:
            found.add(row.follows)
        for other in (row.slower, row.faster):
            if other is not None and not box.rows[other].shifting:
                found.add(other)
        if row.shifting and not box.rows[row.follows].shifting:
            found.add(row.follows)
    return found


def _edges(
    box: GearBox, ground: Ground, limits: Limits, places: np.ndarray
) -> dict[int, list[Edge]]:
    """Edges by the row with which they begin.

    A node is a row; a gear is left from the end of the row before it.
    """
    nodes = _nodes(box)
    before = {row.follows: row for row in box.rows if not row.shifting}
    shapes = _shapes(box)
    found: dict[int, list[Edge]] = {}
    for node in nodes:
        ways = [node]
        ways += [w for w in (before[node].slower, before[node].faster) if w is not None]
        found[node] = [
            edge for first in ways
            for edge in [_edge(box, ground, limits, places, shapes[node], first, nodes)]
        ]  # fmt: skip
    return found


def _edge(
    box: GearBox,
    ground: Ground,
    limits: Limits,
    places: np.ndarray,
    shape: np.ndarray,
    first: int,
    nodes: set[int],
) -> Edge:
    rows = _edge_rows(box, first, nodes)
    allowed = np.ones(len(places), dtype=bool)
    now = shape.copy()
    for number in rows:
        spike, force, least = _peaks(box, ground, number, now, places)
        allowed &= spike <= limits.spike * (1 + _EXCEEDED)
        allowed &= force <= limits.actuator * (1 + _EXCEEDED)
        allowed &= least >= 0
        now = now + box.rows[number].stroke.way
    duration = sum(box.rows[number].stroke.duration for number in rows)
    way = float(now.mean() - shape.mean())
    return Edge(rows, box.rows[rows[-1]].follows, float(duration), way, allowed)


def _peaks(
    box: GearBox, ground: Ground, number: int, shape: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest loads of a spike and an actuator in a stroke, and least of all spikes, by place."""
    stroke = box.rows[number].stroke
    s = stroke.duration * _LOOKS
    begin = (shape[:, None] + places)[:, :, None]  # (masses, places, 1)
    at = begin + stroke.at(s, -1)[:, None, :]
    need = ground.pull(at) + ground.at("drag", at) * stroke.at(s)[:, None, :]
    need += (box.mass[:, None] * stroke.at(s, 1))[:, None, :]
    total = need.sum(axis=0)
    share = total / len(stroke.resting)
    carried = np.zeros(len(shape))
    carried[list(stroke.resting)] = 1.0
    force = np.cumsum(carried[:, None, None] * share - need, axis=0)[:-1]
    return share.max(axis=1), np.abs(force).max(axis=(0, 2)), total.min(axis=1)


def _shapes(box: GearBox) -> dict[int, np.ndarray]:
    """Places of the masses about their mean at the begin of every row of a gear's cycle."""
    found = {}
    for k, gear in enumerate(box.gears):
        for q, lengths in enumerate(gear.lengths):
            place = -np.concatenate([[0.0], np.cumsum(lengths)])
            found[box.first_row(k) + q] = place - place.mean()
    return found


def ideal_time(box: GearBox, ground: Ground, limits: Limits, start: float, goal: float) -> float:
    """Time if shifts were free, and the lightest place nearby told which gear is fast enough.

    Nearby is within a worm's length and a cycle; infinite where no gear bears even that. What a
    schedule loses by shifting shows against it; a bound it is up to parts of cycles.
    """
    places = np.linspace(start, goal, 4001)
    reach = max(float(np.ptp(shape)) for shape in _shapes(box).values())
    reach += max(gear.advance for gear in box.gears)
    masses = len(box.mass)
    lightest = np.full(len(places), np.inf)
    for knot in np.linspace(-reach, reach, 201):
        at = places + knot
        lightest = np.minimum(lightest, ground.at("load", at) + ground.at("towed", at) / masses)
    speed = np.zeros(len(places))
    for gear in box.gears:
        most = min(gear.bears(limits))
        speed = np.where(lightest <= most, np.maximum(speed, gear.speed), speed)
    if np.any(speed == 0):
        return np.inf
    return float(sum((b - a) / max(u, v) for (a, b), (u, v) in zip(
        pairwise(places), pairwise(speed), strict=True)))  # fmt: skip
