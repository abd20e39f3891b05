"""A gear box: gears from slow to fast, ways between neighbours, all strokes in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.gears.gear import Gear, Limits
from wormopt.systems.gears.stroke import Stroke
from wormopt.systems.gears.transition import Transition, shortest_transition


@dataclass(frozen=True, eq=False)
class Row:
    """A stroke in the table of a gear box, and what may follow it; rows are told by number."""

    stroke: Stroke
    gear: int  # that is on, or into which it leads
    shifting: bool  # whether it belongs to a transition
    ends_cycle: bool  # whether a cycle of the gear ends with it
    follows: int  # row after it while the gear is kept
    slower: int | None = None  # row after it on the way into the next slower gear
    faster: int | None = None  # and into the next faster one


@dataclass(frozen=True, eq=False)
class GearBox:
    """Gears from the slowest to the fastest, with transitions between neighbours both ways."""

    gears: tuple[Gear, ...]
    up: tuple[Transition, ...]  # from gear k to k + 1
    down: tuple[Transition, ...]  # from gear k + 1 to k

    @property
    def mass(self) -> np.ndarray:
        """Point masses (n+1,)."""
        return self.gears[0].mass

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """All strokes: the cycles of all gears in order, then the transitions."""
        starts = np.cumsum([0, *(len(gear.strokes) for gear in self.gears)]).tolist()
        after = {("up", k): starts[k + 1] + t.enters for k, t in enumerate(self.up)}
        after |= {("down", k): starts[k] + t.enters for k, t in enumerate(self.down)}
        begins, count = {}, starts[-1]
        for name, transitions in (("up", self.up), ("down", self.down)):
            for k, transition in enumerate(transitions):
                none = not transition.strokes
                begins[name, k] = after[name, k] if none else count
                count += len(transition.strokes)
        rows = []
        for k, gear in enumerate(self.gears):
            length = len(gear.strokes)
            for q, stroke in enumerate(gear.strokes):
                then = (q + 1) % length
                slower = k > 0 and self.down[k - 1].leaves == then
                faster = k + 1 < len(self.gears) and self.up[k].leaves == then
                rows.append(
                    Row(
                        stroke,
                        k,
                        shifting=False,
                        ends_cycle=then == 0,
                        follows=starts[k] + then,
                        slower=begins["down", k - 1] if slower else None,
                        faster=begins["up", k] if faster else None,
                    )
                )
        for name, transitions in (("up", self.up), ("down", self.down)):
            for k, transition in enumerate(transitions):
                into = k + 1 if name == "up" else k
                for q, stroke in enumerate(transition.strokes):
                    last = q + 1 == len(transition.strokes)
                    follows = after[name, k] if last else len(rows) + 1
                    rows.append(Row(stroke, into, shifting=True, ends_cycle=False, follows=follows))
        return tuple(rows)

    def first_row(self, gear: int) -> int:
        """Row with which the cycle of a gear begins."""
        return sum(len(each.strokes) for each in self.gears[:gear])

    @property
    def degree(self) -> int:
        """Largest degree of a velocity."""
        return max(row.stroke.velocity.shape[1] for row in self.rows) - 1


def gear_box(gears: Sequence[Gear], limits: Limits, *, resting: int = 1, arcs: int = 12) -> GearBox:
    """Put gears in the order of their speeds, and design the transitions between neighbours.

    A transition keeps the limits at all loads that both gears bear. Raises ArgumentError if two
    gears are equally fast or bear no load together, SolveError if there is no transition.
    """
    ordered = tuple(sorted(gears, key=lambda gear: gear.speed))
    up, down = [], []
    for slow, fast in pairwise(ordered):
        if fast.speed <= slow.speed * (1 + 1e-9):
            raise ArgumentError(f"{slow.name} and {fast.name} are equally fast; leave one out")
        load = max(slow.least, fast.least), min(*slow.bears(limits), *fast.bears(limits))
        if not load[0] < load[1]:
            raise ArgumentError(
                f"{slow.name} and {fast.name} bear no load together: one needs at least "
                f"{load[0]:.4g} on each mass lest it glides, they bear {load[1]:.4g}; give one a "
                "longer period"
            )
        up.append(shortest_transition(slow, fast, limits, load, resting=resting, arcs=arcs))
        down.append(shortest_transition(fast, slow, limits, load, resting=resting, arcs=arcs))
    return GearBox(ordered, tuple(up), tuple(down))
