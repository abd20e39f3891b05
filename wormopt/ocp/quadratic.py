"""Quadratic programs of stages in a row, solved by HPIPM through CasADi."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.ocp.stages import Linearised

_SOLVER, _SECOND = "hpipm", "qrqp"
_EXACT = dict.fromkeys(("res_g_max", "res_b_max", "res_d_max", "res_m_max"), 1e-9)
_OPTIONS = {"mode": "balance", "iter_max": 50, **_EXACT}
# HPIPM knows no missing bound: changes, in nominal sizes, are kept within so much instead. The
# usual 1e8 would cost it all its iterations.
_FAR = 1e4
# What dynamics and box may miss, against the largest change, and a projected step down may change,
# against the largest slope or change.
_HOLDS = 1e-6


@dataclass(frozen=True, eq=False)
class Tail:
    """Quadratic cost of the last state, as a function of its change."""

    gradient: np.ndarray  # (n_x,)
    hessian: np.ndarray  # (n_x, n_x)

    @classmethod
    def none(cls, n_x: int) -> Tail:
        """The last state costs nothing."""
        return cls(np.zeros(n_x), np.zeros((n_x, n_x)))


class StageProgram:
    """min sum of quadratic costs of v = (x, u), x_{k+1} = end_k + dynamics_k v_k, u in a box.

    Made once for a number of stages. Raises ArgumentError where this CasADi has no HPIPM.
    """

    def __init__(self, stages: int, n_x: int, n_u: int) -> None:
        if not ca.has_conic(_SOLVER):
            raise ArgumentError(f"this CasADi has no QP solver {_SOLVER!r}; take that of PyPI")
        self.stages, self.n_x, self.n_u = stages, n_x, n_u
        n_v = n_x + n_u
        # The first state is known and no variable: bounds that are equal would slow HPIPM down.
        self._costs, self._rows = (m.sparsity() for m in self._patterns())
        # where the nonzeros stand among those of the stages
        i, j = (np.array(p) + n_x for p in (self._costs.row(), self._costs.get_col()))
        k = np.minimum(i // n_v, stages)
        self._cost_places = k, i - k * n_v, j - k * n_v
        i, j = np.array(self._rows.row()), np.array(self._rows.get_col()) + n_x
        k = i // n_x
        self._row_places = k, i - k * n_x, j - k * n_v
        stages_of = {
            "N": stages,
            "nx": [0] + [n_x] * stages,
            "nu": [n_u] * stages + [0],
            "ng": [0] * (stages + 1),
            "inf": _FAR,
            "hpipm": _OPTIONS,
        }
        self._solver = self._by(_SOLVER, stages_of)

    @cached_property
    def _second(self) -> ca.Function:
        """Active sets, for the few programs that HPIPM's interior points leave unsolved."""
        told = "iter", "header", "info", "lincomb"
        return self._by(_SECOND, {f"print_{what}": False for what in told})

    def _by(self, solver: str, options: dict[str, Any]) -> ca.Function:
        shapes = {"h": self._costs, "a": self._rows}
        return ca.conic("stages", solver, shapes, {"error_on_fail": False, **options})

    def _patterns(self) -> tuple[ca.DM, ca.DM]:
        """Ones where the Hessian and the rows of the dynamics may have entries."""
        n_x, n_v = self.n_x, self.n_x + self.n_u
        blocks = [ca.DM.ones(n_v, n_v)] * self.stages
        costs = ca.diagcat(*blocks, ca.DM.ones(n_x, n_x))
        now = ca.diagcat(*[ca.DM.ones(n_x, n_v)] * self.stages)
        then = ca.diagcat(*[ca.horzcat(ca.DM(n_x, self.n_u), ca.DM.eye(n_x))] * self.stages)
        rows = ca.horzcat(now, ca.DM(now.shape[0], n_x))
        rows += ca.horzcat(ca.DM(then.shape[0], n_x), then)
        return costs[n_x:, n_x:], rows[:, n_x:]

    def solve(
        self,
        first: np.ndarray,
        arcs: Linearised,
        gaps: np.ndarray,
        tail: Tail,
        box: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray, bool]:
        """Find changes (N, n_v) of all stages and (n_x,) of the last state, and whether it did.

        `first` (n_x,): change of the first state; `gaps` (N, n_x): by how much the end of each
        arc is ahead of the next start; `box`: least and largest change of inputs, (N, n_u) each.
        """
        n, n_x, n_v = self.stages, self.n_x, self.n_x + self.n_u
        last = np.zeros((1, n_v, n_v))
        last[0, :n_x, :n_x] = tail.hessian
        costs = np.concatenate([arcs.hessian, last])[self._cost_places]
        minus = np.broadcast_to(-np.eye(n_x), (n, n_x, n_x))
        rows = np.concatenate([arcs.dynamics, minus], axis=2)[self._row_places]
        slopes, ahead = arcs.gradient.copy(), gaps.copy()
        slopes[0, n_x:] += arcs.hessian[0, n_x:, :n_x] @ first
        ahead[0] += arcs.dynamics[0, :, :n_x] @ first
        low, high = np.full((2, n * n_v + n_x), np.inf)
        low *= -1
        for side, given in ((low, box[0]), (high, box[1])):
            side[: n * n_v].reshape(n, n_v)[:, n_x:] = given
        told = {
            "h": ca.DM(self._costs, costs),
            "a": ca.DM(self._rows, rows),
            "g": np.append(slopes, tail.gradient)[n_x:],
            "lba": -ahead.ravel(),
            "uba": -ahead.ravel(),
            "lbx": low[n_x:],
            "ubx": high[n_x:],
        }
        v, end = self._changes(self._solver(**told), first, box)
        holds = _holds(v, end, arcs, gaps, box) and is_least(v, end, arcs, tail, box)
        if not holds:
            v, end = self._changes(self._second(**told), first, box)
            holds = _holds(v, end, arcs, gaps, box) and is_least(v, end, arcs, tail, box)
        return v, end, holds

    def _changes(
        self, answer: dict[str, ca.DM], first: np.ndarray, box: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Changes of all stages and of the last state, inputs within the box to the last digit."""
        n, n_x, n_v = self.stages, self.n_x, self.n_x + self.n_u
        found = np.append(first, np.asarray(answer["x"]).ravel())
        v, end = found[: n * n_v].reshape(n, n_v), found[n * n_v :]
        v[:, n_x:] = np.clip(v[:, n_x:], *box)
        return v, end


def _holds(
    v: np.ndarray,
    end: np.ndarray,
    arcs: Linearised,
    gaps: np.ndarray,
    box: tuple[np.ndarray, np.ndarray],
) -> bool:
    """Whether changes obey dynamics and box, found anew: never the solver's word."""
    n_x = len(end)
    missed = (arcs.dynamics @ v[:, :, None])[:, :, 0] + gaps
    missed -= np.concatenate([v[1:, :n_x], end[None]])
    beyond = np.maximum(box[0] - v[:, n_x:], v[:, n_x:] - box[1])
    return bool(max(np.abs(missed).max(), beyond.max()) <= _HOLDS * max(1.0, np.abs(v).max()))


def is_least(
    v: np.ndarray,
    end: np.ndarray,
    arcs: Linearised,
    tail: Tail,
    box: tuple[np.ndarray, np.ndarray],
) -> bool:
    """Whether a step of the inputs against the slope of the cost leads nowhere within the box."""
    n_x = len(end)
    ahead = tail.gradient + tail.hessian @ end  # slope of the cost by the end of an arc
    largest = float(max(1.0, np.abs(v).max(), np.abs(ahead).max()))
    slopes = arcs.gradient + (arcs.hessian @ v[:, :, None])[:, :, 0]
    across = arcs.dynamics.transpose(0, 2, 1)
    for k in reversed(range(len(v))):
        slopes[k] += across[k] @ ahead
        ahead = slopes[k, :n_x]
    inputs = v[:, n_x:]
    stepped = np.clip(inputs - slopes[:, n_x:], *box)
    return bool(np.abs(stepped - inputs).max() <= _HOLDS * max(largest, np.abs(slopes).max()))
