"""Energy and effort in the bilinear program of a gait, as sums of columns that are costs.

What the actuators spend is their net work and what they absorb: nothing is recovered. The net
work is that against load and drag, so what is absorbed is what tells gaits apart. On an arc where
forces and rates are polynomials it is bounded by the positive parts of the Bernstein coefficients
of their product, which is exact where neither changes its sign. The effort of an arc is the
square of the step of a rate over the duration.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from wormopt.numerics.bilinear_rows import BilinearRows
from wormopt.numerics.linearised import Excess
from wormopt.systems.spiked.programs.scaled_limits import Form, ScaledLimits
from wormopt.systems.spiked.task import Task

# A cost of an arc is less than this, in units of force times way or of rate squared over time.
_MOST = 1e6
# Accelerations, as shares of the limit, whose tangents bound the effort from below.
_TANGENTS = (0.03, 0.07, 0.13, 0.22, 0.35, 0.5, 0.75, 1.0)


class _Motion(Protocol):
    """What costs need to know of a gait program: its columns of durations and velocities."""

    task: Task
    limits: ScaledLimits
    degree: int
    rows: BilinearRows
    h: np.ndarray
    v: np.ndarray


def has_cost_columns(task: Task) -> bool:
    """Whether the cost of a task is part of its bilinear program."""
    return task.objective.is_smooth and task.limits.acceleration is not None


def is_energy(task: Task) -> bool:
    """Whether the cost of a task is what actuators absorb."""
    return has_cost_columns(task) and task.objective.minimise == "energy_per_distance"


@dataclass(eq=False)
class CostColumns:
    """Columns and rows of the cost of a gait program, added phase by phase."""

    program: _Motion  # has its own columns already
    columns: list[np.ndarray] = field(default_factory=list, init=False)  # of costs
    # that bound the costs from below
    rows: list[np.ndarray] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        program = self.program
        self.energy = program.task.objective.minimise == "energy_per_distance"
        if program.degree != 1:
            raise ValueError("costs need velocities that are linear on an arc")
        self.dragged = self.energy and program.limits.drag > 0
        # the way that a mass would go at each coefficient of its velocity, a factor of drag's work
        self.ways = np.full(program.v.shape, -1)
        if self.dragged:
            upper = np.where(program.v >= 0, np.array(program.rows.upper)[program.v], 0.0)
            self.ways = program.rows.columns(upper)
            h = np.broadcast_to(program.h[:, None, None], program.v.shape)
            there = program.v >= 0
            product = (h[there], program.v[there], -1.0)
            program.rows.add([(self.ways[there], 1.0)], [product], 0.0, 0.0)

    def add_phase(self, resting: tuple[int, ...], at: slice) -> None:
        """Add the cost of the arcs `at` of a phase."""
        if not self.energy:
            self._add_effort(at)
            return
        for j, (weight, at_rest) in enumerate(self.program.limits.actuators(resting)):
            self._add_absorbed(j, weight, at_rest, at)

    def _add_absorbed(self, j: int, weight: np.ndarray, at_rest: float, at: slice) -> None:
        """Bernstein coefficients of the power that actuator j absorbs, times the duration."""
        limits, v = self.program.limits, self.program.v[at]
        load = at_rest * self.program.task.worm.load_range[1] / limits.force
        form = Form(weight * limits.mass, weight, 0.0, 0.0)
        steps = [(v[:, end, i], s * form.alpha[i]) for end, s in ((1, 1.0), (0, -1.0))
                 for i in np.flatnonzero(form.alpha)]  # fmt: skip
        push = [(self.program.h[at], load), *steps]
        pushes = [push, push]
        if self.dragged:
            drag = limits.drag * form.beta
            pushes = [
                [*push, *((self.ways[at, k, i], drag[i]) for i in np.flatnonzero(drag))]
                for k in (0, 1)
            ]
        rates = [[(v[:, k, j], 1.0), (v[:, k, j + 1], -1.0)] for k in (0, 1)]

        def power(k: int, m: int, share: float) -> list[tuple]:
            return [(a, b, -share * p * q) for a, p in pushes[k] for b, q in rates[m]]

        if self.dragged:
            self._add(power(0, 0, 1 / 3), at)
            self._add([*power(0, 1, 1 / 6), *power(1, 0, 1 / 6)], at)
            self._add(power(1, 1, 1 / 3), at)
        else:
            self._add(power(0, 0, 0.5), at)
            self._add(power(0, 1, 0.5), at)

    def _add_effort(self, at: slice) -> None:
        program = self.program
        h, v, most = program.h[at], program.v[at], program.limits.acceleration
        assert most is not None
        for j in range(program.limits.links):
            step = [(v[:, 1, j], 1.0), (v[:, 0, j], -1.0),
                    (v[:, 1, j + 1], -1.0), (v[:, 0, j + 1], 1.0)]  # fmt: skip
            square = [(a, b, -p * q) for a, p in step for b, q in step]
            column = self._add(square, at, times=h)
            for slope in (sign * share * most[j] for share in _TANGENTS for sign in (1.0, -1.0)):
                tangent = [(columns, -2 * slope * sign) for columns, sign in step]
                program.rows.add([(column, 1.0), (h, slope**2), *tangent], [], 0.0, np.inf)

    def _add(self, products: list[tuple], at: slice, times: np.ndarray | None = None) -> np.ndarray:
        """Cost columns c, one per arc, with the row c (times h) + products >= 0."""
        rows, count = self.program.rows, at.stop - at.start
        column = rows.columns(np.full(count, _MOST))
        own = [(column, 1.0)] if times is None else []
        twice = [] if times is None else [(column, times, 1.0)]
        self.columns.append(column)
        self.rows.append(rows.add(own, [*twice, *products], 0.0, np.inf))
        return column

    def add_gain(self) -> int:
        """Add the row of the cost with its sign changed; give its number."""
        total = [(int(c), -1.0) for c in np.concatenate(self.columns)]
        work: list[tuple] = []
        if self.dragged:
            share = self.program.limits.drag / 3
            for q, v in zip(self.ways, self.program.v, strict=True):
                for i in range(len(v[0])):
                    work += [(int(q[k, i]), int(v[m, i]), -share * w)
                             for k, m, w in ((0, 0, 1.0), (0, 1, 1.0), (1, 1, 1.0))]  # fmt: skip
        return int(self.program.rows.add(total, work, -np.inf, np.inf)[0])

    def complete(self, x: np.ndarray) -> None:
        """Set the distances in a point `x` from its durations and velocities, in place."""
        there = self.ways >= 0
        h = np.broadcast_to(self.program.h[:, None, None], self.ways.shape)
        x[self.ways[there]] = x[h[there]] * x[self.program.v[there]]

    def excess(self) -> Excess:
        """The cost columns, as the bilinear program takes them."""
        factors = np.unique(self.program.v[self.program.v >= 0])
        return Excess(np.concatenate(self.columns), np.concatenate(self.rows), factors)
