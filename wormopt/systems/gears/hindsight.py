"""The best schedule in hindsight: the sequence of gears by position with the whole route known.

Nodes are starts of strokes at which a gear may be left or entered. The loads on an edge between two
nodes depend on the position alone, because the worm's shape at a node is always the same. The
search proceeds by time (Dijkstra's algorithm), with bins of position at every node. In a bin only
those states are kept that are further ahead than all earlier ones, with their own position, not
that of the bin. The schedule found can therefore be executed, and it is optimal in the limit of
narrow bins: within a bin, being ahead is assumed to do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report, silent
from wormopt.systems.gears.box import GearBox
from wormopt.systems.gears.gear import Ground, Limits

# Times in a stroke at which forces are sampled.
_LOOKS = np.linspace(0.0, 1.0, 9)
# Accepted relative excess of limits.
_EXCEEDED = 1e-9
# Positions that differ by less, in bins, are equal.
_ROUNDING = 1e-6
# Positions in a bin at which the loads of an edge are known.
_KNOWN = 2


@dataclass(frozen=True, eq=False)
class Edge:
    """Strokes from one node to another."""

    rows: tuple[int, ...]
    end: int  # row that begins at its end
    duration: float
    way: float  # displacement of the mean of the masses
    allowed: np.ndarray  # (places,) whether it meets the limits if it starts there


@dataclass(frozen=True, eq=False)
class Schedule:
    """A sequence of rows, and the time at which it reaches the goal."""

    rows: tuple[int, ...]
    time: float
    labels: int  # number of search states


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
    """Find the schedule that moves the mean of the masses from `start` to `goal` first.

    It starts with a cycle of `gear`. A cycle crosses at least `fineness` bins.
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
            report("optimising in hindsight", (place - start) / (goal - start))
        near = min(int(_KNOWN * (place - start) / step), len(places) - 2)
        for edge in edges[node]:
            # allowed at both neighbours: forces vary little between them
            if not edge.allowed[near : near + 2].all():
                continue
            came.append((label, edge))
            there, then = place + edge.way, time + edge.duration
            if there >= goal:
                then = time + _until(box, edge, goal - place)
                heappush(queue, (then, len(came) - 1, -1, goal))
            else:
                heappush(queue, (then, len(came) - 1, edge.end, there))
    lightest = float((ground.at("load", places) + ground.at("towed", places) / len(box.mass)).min())
    glides = [f"{each.name} below {each.least:.4g}" for each in box.gears if each.least > lightest]
    reason = "no schedule of the gears meets the limits on this route"
    forces = " and limits.actuator_force" if np.isfinite(limits.actuator) else ""
    advice = f"increase limits.spike_load{forces}, or add a gear with more resting masses"
    if glides:
        reason += (
            f", with a load of {lightest:.4g} on each mass at the lightest place; gears glide: "
            f"{', '.join(glides)}"
        )
        advice = f"give these gears longer periods; or {advice}"
    raise SolveError(reason, advice)


def _edge_rows(box: GearBox, first: int, nodes: set[int]) -> tuple[int, ...]:
    """Rows from one row to the next node."""
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
    """Time within an edge at which the mean of the masses has moved by `way`."""
    gone = 0.0
    for number in edge.rows:
        stroke = box.rows[number].stroke
        step = float(stroke.way.mean())
        if step >= way:
            return gone + stroke.until(way)
        way, gone = way - step, gone + stroke.duration
    return gone


def _nodes(box: GearBox) -> set[int]:
    """Rows at whose start a gear is left or entered, or a cycle begins."""
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
    """Edges by their first row. A node is a row; a gear is left at the end of the row before it."""
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
    """Largest spike load and actuator force in a stroke, and smallest total load, by position."""
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
    """Positions of the masses about their mean at the start of every row of a gear's cycle."""
    found = {}
    for k, gear in enumerate(box.gears):
        for q, lengths in enumerate(gear.lengths):
            place = -np.concatenate([[0.0], np.cumsum(lengths)])
            found[box.first_row(k) + q] = place - place.mean()
    return found


def ideal_time(box: GearBox, ground: Ground, limits: Limits, start: float, goal: float) -> float:
    """Travel time with free shifts, if the lightest load nearby selects the gear.

    Nearby is within a worm's length and a cycle; infinite if no gear carries even that load. The
    difference to a schedule is the loss by shifting. It is a lower bound up to parts of cycles.
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
