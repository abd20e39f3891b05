"""Convergence of relaxed contact to exact contact: narrower laws, and finer grids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.progress import Report
from wormopt.systems.shared.optimum import modes_of

# Widths of the smoothed law, in usual speeds; the last ones show its order.
_WIDTHS, _SHOWN_WIDTHS = Regularised(v_reg=0.4**6, first=1.0, ratio=0.4), 5
# Relaxation of complementarity, in usual speeds times usual forces, small against the grid error.
_TIGHT = Complementarity(1e-5, first=1.0)


@dataclass(frozen=True, eq=False)
class Convergence:
    """Objectives with relaxed contact, and the objective with exact contact."""

    exact: float  # objective with prescribed modes
    widths: np.ndarray  # of the smoothed law
    smoothed: np.ndarray  # objective at each width
    arcs: np.ndarray  # numbers of arcs
    relaxed: np.ndarray  # objective with complementarity on each grid
    alike: bool  # both show the contact modes of the exact one

    @property
    def orders(self) -> tuple[float, float]:
        """Slopes of the errors against the width and against the length of an arc."""
        by_width = np.polyfit(np.log(self.widths), np.log(np.abs(self.smoothed - self.exact)), 1)
        by_arc = np.polyfit(-np.log(self.arcs), np.log(np.abs(self.relaxed - self.exact)), 1)
        return float(by_width[0]), float(by_arc[0])

    @property
    def bars(self) -> tuple[float, float]:
        """Error estimate of each sequence without the exact answer: twice its last step."""
        smoothed, relaxed = (2 * float(abs(v[-1] - v[-2])) for v in (self.smoothed, self.relaxed))
        return smoothed, relaxed

    @property
    def scalars(self) -> dict[str, Any]:
        """Orders, last objectives, and their error bars."""
        return {
            "order_smoothed": self.orders[0],
            "order_complementarity": self.orders[1],
            "objective_smoothed": float(self.smoothed[-1]),
            "objective_smoothed_error_bar": self.bars[0],
            "objective_complementarity": float(self.relaxed[-1]),
            "objective_complementarity_error_bar": self.bars[1],
            "same_modes": self.alike,
        }

    @property
    def variables(self) -> dict[str, np.ndarray]:
        """Errors over widths and over grids."""
        return {
            "width": self.widths,
            "smoothed_error": self.smoothed - self.exact,
            "arcs": self.arcs,
            "complementarity_error": self.relaxed - self.exact,
        }

    def warnings(self) -> Iterator[str]:
        """Warn of an error estimate that is too small."""
        last = (self.smoothed[-1], self.relaxed[-1])
        for name, value, bar in zip(("smoothed", "complementarity"), last, self.bars, strict=True):
            if abs(value - self.exact) > bar:
                yield f"the estimated error with {name} contact does not cover the exact objective"


def converge(stages: Mapping[str, Optimum], report: Report) -> Convergence:
    """Solve again with narrower laws and on finer grids, from the same local optimum."""
    relaxed, exact = stages["complementarity"], stages["phases"]
    problem, arcs = exact.motion.program.problem, relaxed.motion.mesh.total
    speed = problem.model.contacts[0].nominal_speed
    widths = replace(_WIDTHS, v_reg=_WIDTHS.v_reg * speed, first=_WIDTHS.first * speed)
    report("smoothed contact", 0.7)
    fine = Mesh.even(1, 2 * arcs, Collocation(3, "radau"))
    smoothed = optimise(problem, fine, widths, relaxed.motion.guess)
    found = []
    for k, n in enumerate((arcs // 2, arcs, 2 * arcs, 4 * arcs)):
        report("complementarity on finer grids", 0.8 + k / 20)
        grid = Mesh.even(1, n, Collocation(2, "radau"))
        found.append(optimise(problem, grid, _TIGHT, relaxed.motion.guess))
    return Convergence(
        exact.objective,
        np.array([level.level for level in smoothed.levels[-_SHOWN_WIDTHS:]]),
        np.array([level.objective for level in smoothed.levels[-_SHOWN_WIDTHS:]]),
        np.array([o.motion.mesh.total for o in found]),
        np.array([o.objective for o in found]),
        len({_cycle_of(o) for o in (exact, smoothed, found[-1])}) == 1,
    )


def _cycle_of(optimum: Optimum) -> tuple[tuple[int, ...], ...]:
    """Contact modes of a period without repetitions, independent of where it begins."""
    modes, _ = modes_of(optimum)
    cycle = [tuple(m) for k, m in enumerate(modes) if m != modes[k - 1]] or [tuple(modes[0])]
    return min(tuple(cycle[k:] + cycle[:k]) for k in range(len(cycle)))
