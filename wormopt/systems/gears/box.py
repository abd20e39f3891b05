"""A gear box: gears from slow to fast, transitions between neighbours, all strokes in a table."""

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
    """A stroke in the table of a gear box, and its possible successors, by row number."""

    stroke: Stroke
    gear: int  # current gear, or the gear that a transition leads to
    shifting: bool  # whether it belongs to a transition
    ends_cycle: bool  # whether a cycle of the gear ends with it
    follows: int  # next row while the gear is kept
    slower: int | None = None  # next row towards the next slower gear
    faster: int | None = None  # next row towards the next faster gear


@dataclass(frozen=True, eq=False)
class GearBox:
    """Gears from the slowest to the fastest, with transitions between neighbours."""

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
        """First row of the cycle of a gear."""
        return sum(len(each.strokes) for each in self.gears[:gear])

    @property
    def degree(self) -> int:
        """Largest degree of a velocity."""
        return max(row.stroke.velocity.shape[1] for row in self.rows) - 1


def gear_box(gears: Sequence[Gear], limits: Limits, *, resting: int = 1, arcs: int = 12) -> GearBox:
    """Sort gears by speed, and design the transitions between neighbours.

    A transition meets the limits at all loads that both gears carry. Raises ArgumentError if two
    gears are equally fast or have no common load, SolveError if there is no transition.
    """
    ordered = tuple(sorted(gears, key=lambda gear: gear.speed))
    up, down = [], []
    for slow, fast in pairwise(ordered):
        if fast.speed <= slow.speed * (1 + 1e-9):
            raise ArgumentError(f"{slow.name} and {fast.name} are equally fast; remove one")
        load = max(slow.least, fast.least), min(*slow.bears(limits), *fast.bears(limits))
        if not load[0] < load[1]:
            raise ArgumentError(
                f"{slow.name} and {fast.name} have no common load: one needs at least "
                f"{load[0]:.4g} on each mass to avoid gliding, but both carry only {load[1]:.4g}; "
                "give one a longer period"
            )
        up.append(shortest_transition(slow, fast, limits, load, resting=resting, arcs=arcs))
        down.append(shortest_transition(fast, slow, limits, load, resting=resting, arcs=arcs))
    return GearBox(ordered, tuple(up), tuple(down))
