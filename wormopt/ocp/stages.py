"""A transcribed problem as stages: arcs linearised one by one, solved as quadratic programs.

Inner unknowns are eliminated: an arc becomes its end as a function of its start and inputs, with a
quadratic cost: the form of receding and moving horizons, with the same equations as those of the
nonlinear program. HPIPM solves the quadratic programs, through CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.expressions import Call
from wormopt.ocp.arc import limits_of
from wormopt.ocp.nlp import Bounds
from wormopt.ocp.transcription import Transcription


@dataclass(frozen=True, eq=False)
class Given:
    """Inputs of arcs, a row for each: durations and clocks are part of their variables."""

    levels: np.ndarray  # (N, n_level) width of the smooth law
    schedules: np.ndarray  # (N, n_schedules)
    p: np.ndarray  # (n_p,) parameters of the model, equal for all arcs

    def part(self, arcs: slice) -> Given:
        """Inputs of a subset of arcs."""
        return Given(self.levels[arcs], self.schedules[arcs], self.p)


@dataclass(frozen=True, eq=False)
class Linearised:
    """N linearised arcs; v is start and inputs of an arc, all scaled.

    Everything is a change: of v, of the end of the arc, of its inner variables.
    """

    end: np.ndarray  # (N, n_x) end of the arc that satisfies its equations, v unchanged
    dynamics: np.ndarray  # (N, n_x, n_v) end by v
    cost: np.ndarray  # (N,) before any change
    gradient: np.ndarray  # (N, n_v) of the cost by v
    hessian: np.ndarray  # (N, n_v, n_v) of the cost by v
    inner: np.ndarray  # (N, n_z) change of inner variables by which the equations hold, v unchanged
    inner_by: np.ndarray  # (N, n_z, n_v) inner variables by v
    defect: float  # largest residual of the arcs' equations


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of N arcs by chosen parameters."""

    end: np.ndarray  # (N, n_x, n_chosen) by the logarithm of each
    inner: np.ndarray  # (N, n_z, n_chosen)


class Stages:
    """Arcs of a transcription on a fixed grid, with smooth contact or none, as stages.

    The objective is a weighted sum of the problem's integrals. The Hessian of an arc excludes the
    curvature of the equations: it is that of Gauss-Newton for integrands that are sums of squares.
    Raises ArgumentError for problems of another form.
    """

    def __init__(self, program: Transcription) -> None:
        self.program, self.arc = program, program.arc
        self.weights = _weights(program)
        at = self.arc.layout
        blocks = (at.start, at.inputs, at.points, at.algebraic, at.unknowns)
        self.start, self.inputs, *inner = ([*range(b.start, b.stop)] for b in blocks)
        self.inner = [row for block in inner for row in block]
        self.v = [*self.start, *self.inputs]
        self.n_x, self.n_u, self.n_v = len(self.start), len(self.inputs), len(self.v)
        self._maps: dict[tuple[str, int], Call] = {}
        self._programs: dict[int, StageProgram] = {}

    def quadratic(self, arcs: int) -> StageProgram:
        """Quadratic program of so many arcs, which all controllers of a plan share."""
        if arcs not in self._programs:
            self._programs[arcs] = StageProgram(arcs, self.n_x, self.n_u)
        return self._programs[arcs]

    @property
    def input_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all inputs, scaled."""
        return limits_of(self.program.problem.model.u)

    def given(self, bounds: Bounds) -> Given:
        """Split the parameters of the nonlinear program arc by arc."""
        n, function = self.program.mesh.total, self.arc.function
        sizes = [function.size1_in(k) for k in (1, 2)]
        levels, schedules, p = np.split(bounds.p, np.cumsum([n * size for size in sizes]))
        return Given(levels.reshape(n, sizes[0]), schedules.reshape(n, sizes[1]), p)

    def rows(self, w: np.ndarray) -> np.ndarray:
        """Variables of the nonlinear program (n_w,) as one row for each arc, (N, n_y)."""
        n, size = self.program.mesh.total, self.arc.layout.size
        return w[: n * size].reshape(n, size).copy()

    # -- functions of one arc ----------------------------------------------------------------

    @cached_property
    def _symbols(self) -> tuple[list[ca.SX], list[ca.SX]]:
        """Variables, level, schedules and p; residuals, the arc's end, its cost."""
        function = self.arc.function
        y, level, schedules, p = (ca.SX.sym(f"arc_{k}", function.size1_in(k)) for k in (0, 1, 2, 4))
        equal, _, _, _, _, end, integrals = function(y, level, schedules, ca.SX(0, 1), p)
        cost = ca.dot(ca.DM(self.weights), integrals)
        return [y, level, schedules, p], [equal, end, cost]

    @cached_property
    def _linear(self) -> ca.Function:
        symbols, (equal, end, cost) = self._symbols
        rows = [*self.v, *self.inner]
        hessian, gradient = ca.hessian(cost, symbols[0])
        found = [equal, end, cost, gradient[rows], hessian[rows, rows]]
        found += [ca.jacobian(e, symbols[0])[:, rows] for e in (equal, end)]
        return ca.Function("arc_linear", symbols, [ca.densify(e) for e in found], {"cse": True})

    @cached_property
    def _by_parameters(self) -> ca.Function:
        symbols, (equal, end, _) = self._symbols
        found = [ca.jacobian(e, symbols[0])[:, self.inner] for e in (equal, end)]
        found += [ca.jacobian(e, symbols[3]) for e in (equal, end)]
        return ca.Function("arc_by_p", symbols, [ca.densify(e) for e in found], {"cse": True})

    def _at(self, function: ca.Function, rows: np.ndarray, given: Given) -> list[np.ndarray]:
        """Results of a function of one arc for all rows, the arc first: (N, rows, columns)."""
        n = len(rows)
        key = function.name(), n
        if key not in self._maps:
            self._maps[key] = Call(function.map(n))
        p = np.tile(given.p, n)
        found = self._maps[key](rows.ravel(), given.levels.ravel(), given.schedules.ravel(), p)
        shapes = [(n, function.size2_out(k), function.size1_out(k)) for k in range(len(found))]
        return [
            part.reshape(shape).transpose(0, 2, 1).copy()
            for part, shape in zip(found, shapes, strict=True)
        ]

    # -- many arcs ---------------------------------------------------------------------------

    def linearise(self, rows: np.ndarray, given: Given) -> Linearised:
        """Linearise arcs at their variables (N, n_y)."""
        equal, end, cost, q, H, G, E = self._at(self._linear, rows, given)
        n, n_v = len(rows), self.n_v
        solved = np.linalg.solve(G[:, :, n_v:], np.concatenate([equal, G[:, :, :n_v]], axis=2))
        inner, inner_by = -solved[:, :, :1], -solved[:, :, 1:]
        whole = np.concatenate([np.broadcast_to(np.eye(n_v), (n, n_v, n_v)), inner_by], axis=1)
        across = whole.transpose(0, 2, 1)
        return Linearised(
            end=(end + E[:, :, n_v:] @ inner)[:, :, 0],
            dynamics=E @ whole,
            cost=cost[:, 0, 0],
            gradient=(across @ (q + H[:, :, n_v:] @ inner))[:, :, 0],
            hessian=across @ H @ whole,
            inner=inner[:, :, 0],
            inner_by=inner_by,
            defect=float(np.abs(equal).max()),
        )

    def sensitivity(self, rows: np.ndarray, given: Given, chosen: np.ndarray) -> Sensitivity:
        """Derivatives of arcs by the logarithms of chosen parameters, given by indices in p."""
        G, E, Gp, Ep = self._at(self._by_parameters, rows, given)
        size = given.p[chosen]
        inner = -np.linalg.solve(G, Gp[:, :, chosen] * size)
        return Sensitivity(Ep[:, :, chosen] * size + E @ inner, inner)


def _weights(program: Transcription) -> np.ndarray:
    """Weights of the integrals in the objective, which contains nothing else."""
    problem, arc, mesh = program.problem, program.arc, program.mesh
    ends = problem.ends
    slope = ca.gradient(problem.minimise / problem.nominal, ends.integrals)
    others = ca.vertcat(ends.start, ends.end, ends.duration, problem.model.t)
    plain = not (ca.symvar(slope) or ca.depends_on(problem.minimise, others) or len(problem.design))
    if not (plain and arc.fixed_grid):
        raise ArgumentError(
            "predictive control needs a fixed duration, a mesh with shares, and an objective that "
            "is a weighted sum of integrals"
        )
    equal, small, _, rows = (arc.function.size1_out(k) for k in range(4))
    inner = arc.layout.unknowns.stop - arc.layout.points.start
    inner -= arc.layout.inputs.stop - arc.layout.inputs.start
    if (
        (arc.modal and problem.model.contacts)
        or small
        or rows
        or arc.layout.slacks.stop > (arc.layout.slacks.start)
    ):
        raise ArgumentError(
            "predictive control needs smooth contact, Regularised(v_reg), and supports only limits "
            "of inputs along the motion"
        )
    if equal != inner or mesh.input_degree:
        raise ArgumentError("predictive control needs inputs that are constant on each arc")
    return np.asarray(ca.DM(slope)).ravel()


_SOLVER = "hpipm"
_EXACT = dict.fromkeys(("res_g_max", "res_b_max", "res_d_max"), 1e-9) | {"res_m_max": 1e-11}
_OPTIONS = {"mode": "balance", "iter_max": 50, **_EXACT}
# HPIPM needs all bounds: changes, in nominal sizes, are limited by this instead. The usual 1e8
# would cost all its iterations.
_FAR = 1e4
# Tolerance of dynamics and box, relative to the largest change.
_HOLDS = 1e-6
# Least slope relative to its terms, and remaining distance down the slope.
_STILL = 1e-4
# Slopes with smaller terms are 0: multipliers times distance are exact to 1e-11.
_SLOPE = 1e-3


@dataclass(frozen=True, eq=False)
class Tail:
    """Quadratic cost of the last state, as a function of its change."""

    gradient: np.ndarray  # (n_x,)
    hessian: np.ndarray  # (n_x, n_x)

    @classmethod
    def none(cls, n_x: int) -> Tail:
        """Zero cost of the last state."""
        return cls(np.zeros(n_x), np.zeros((n_x, n_x)))


class StageProgram:
    """min sum of quadratic costs of v = (x, u), x_{k+1} = end_k + dynamics_k v_k, u in a box.

    Made once for a number of stages. Raises ArgumentError if this CasADi has no HPIPM.
    """

    def __init__(self, stages: int, n_x: int, n_u: int) -> None:
        if not ca.has_conic(_SOLVER):
            raise ArgumentError(f"this CasADi has no QP solver {_SOLVER!r}; install that of PyPI")
        # BLASFEO 0.1.4 solves n of n + 1 triangular equations wrongly where n is 3, 7, 11 ...
        # (dtrsv_ltn_mn): such stages get an idle input.
        self._idle = int(n_x == 1 and n_u % 4 == 3)
        n_u += self._idle
        self.stages, self.n_x, self.n_u = stages, n_x, n_u
        n_v = n_x + n_u
        # The first state is known and no variable: equal bounds would slow HPIPM down.
        self._costs, self._rows = (m.sparsity() for m in self._patterns())
        # positions of the nonzeros among those of the stages
        i, j = (np.array(p) + n_x for p in (self._costs.row(), self._costs.get_col()))
        k = np.minimum(i // n_v, stages)
        self._cost_places = k, i - k * n_v, j - k * n_v
        i, j = np.array(self._rows.row()), np.array(self._rows.get_col()) + n_x
        k = i // n_x
        self._row_places = k, i - k * n_x, j - k * n_v
        self._solver = ca.conic(
            "stages",
            _SOLVER,
            {"h": self._costs, "a": self._rows},
            {
                "N": stages,
                "nx": [0] + [n_x] * stages,
                "nu": [n_u] * stages + [0],
                "ng": [0] * (stages + 1),
                "inf": _FAR,
                "error_on_fail": False,
                "hpipm": _OPTIONS,
            },
        )

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
        """Find changes (N, n_v) of all stages and (n_x,) of the last state, and whether they fit.

        `first` (n_x,): change of the first state; `gaps` (N, n_x): differences between the end of
        each arc and the next start; `box`: least and largest change of inputs, (N, n_u) each.
        """
        box = np.clip(box[0], -_FAR, None), np.clip(box[1], None, _FAR)
        parts = (first, arcs.hessian, arcs.dynamics, arcs.gradient, gaps)
        if not (all(np.isfinite(part).all() for part in parts) and np.all(box[0] <= box[1])):
            return np.zeros(arcs.gradient.shape), np.zeros(self.n_x), False
        if self._idle:
            one = np.ones((self.stages, 1))
            arcs = _with_idle_input(arcs)
            box = np.hstack([box[0], -one]), np.hstack([box[1], one])
        v, end, multipliers = self._solve(first, arcs, gaps, tail, box)
        solved = _holds(v, end, arcs, gaps, box) and _still(v, end, arcs, tail, box, multipliers)
        return v[:, : v.shape[1] - self._idle], end, solved

    def _solve(
        self,
        first: np.ndarray,
        arcs: Linearised,
        gaps: np.ndarray,
        tail: Tail,
        box: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Both changes, and multipliers (N, n_x) of the dynamics."""
        n, n_x, n_v = self.stages, self.n_x, self.n_x + self.n_u
        slopes, ahead = arcs.gradient.copy(), gaps.copy()
        slopes[0, n_x:] += arcs.hessian[0, n_x:, :n_x] @ first
        ahead[0] += arcs.dynamics[0, :, :n_x] @ first
        low, high = np.full((2, n * n_v + n_x), np.inf)
        low *= -1
        for side, given in ((low, box[0]), (high, box[1])):
            side[: n * n_v].reshape(n, n_v)[:, n_x:] = given
        answer = self._solver(
            h=self._hessian(arcs, tail),
            a=self._dynamics(arcs),
            g=np.append(slopes, tail.gradient)[n_x:],
            lba=-ahead.ravel(),
            uba=-ahead.ravel(),
            lbx=low[n_x:],
            ubx=high[n_x:],
        )
        found = np.append(first, np.asarray(answer["x"]).ravel())
        v, end = found[: n * n_v].reshape(n, n_v), found[n * n_v :]
        v[:, n_x:] = np.clip(v[:, n_x:], *box)  # exactly
        return v, end, np.asarray(answer["lam_a"]).reshape(n, n_x)

    def _hessian(self, arcs: Linearised, tail: Tail) -> ca.DM:
        last = np.zeros((1, self.n_x + self.n_u, self.n_x + self.n_u))
        last[0, : self.n_x, : self.n_x] = tail.hessian
        return ca.DM(self._costs, np.concatenate([arcs.hessian, last])[self._cost_places])

    def _dynamics(self, arcs: Linearised) -> ca.DM:
        minus = np.broadcast_to(-np.eye(self.n_x), (self.stages, self.n_x, self.n_x))
        rows = np.concatenate([arcs.dynamics, minus], axis=2)
        return ca.DM(self._rows, rows[self._row_places])


def _with_idle_input(arcs: Linearised) -> Linearised:
    """Add an input of cost u^2 / 2 without effect."""
    n, n_x, n_v = arcs.dynamics.shape
    hessian = np.zeros((n, n_v + 1, n_v + 1))
    hessian[:, :n_v, :n_v], hessian[:, n_v, n_v] = arcs.hessian, 1.0
    return replace(
        arcs,
        dynamics=np.concatenate([arcs.dynamics, np.zeros((n, n_x, 1))], axis=2),
        gradient=np.column_stack([arcs.gradient, np.zeros(n)]),
        hessian=hessian,
    )


def _holds(
    v: np.ndarray,
    end: np.ndarray,
    arcs: Linearised,
    gaps: np.ndarray,
    box: tuple[np.ndarray, np.ndarray],
) -> bool:
    """Whether changes satisfy dynamics and box, recomputed here."""
    n_x = len(end)
    missed = (arcs.dynamics @ v[:, :, None])[:, :, 0] + gaps
    missed -= np.concatenate([v[1:, :n_x], end[None]])
    beyond = np.maximum(box[0] - v[:, n_x:], v[:, n_x:] - box[1])
    return bool(max(np.abs(missed).max(), beyond.max()) <= _HOLDS * max(1.0, np.abs(v).max()))


def _still(
    v: np.ndarray,
    end: np.ndarray,
    arcs: Linearised,
    tail: Tail,
    box: tuple[np.ndarray, np.ndarray],
    multipliers: np.ndarray,
) -> bool:
    """Whether no descent is left, recomputed: the solver may give up silently."""
    # Each slope of the Lagrangian is negligible relative to its terms, or the distance down it is.
    n_x = len(end)
    parts = np.zeros((4, len(v) + 1, v.shape[1]))
    parts[0, :-1] = arcs.gradient
    parts[1, :-1] = (arcs.hessian @ v[:, :, None])[:, :, 0]
    parts[2, :-1] = (multipliers[:, None, :] @ arcs.dynamics)[:, 0, :]
    parts[3, 1:, :n_x] = -multipliers
    parts[0, -1, :n_x], parts[1, -1, :n_x] = tail.gradient, tail.hessian @ end
    parts[:, 0, :n_x] = 0.0  # the first state is given
    slope = parts.sum(axis=0)
    off = np.abs(slope) / (np.abs(parts).sum(axis=0) + _SLOPE)
    inputs = v[:, n_x:]
    room = np.where(slope[:-1, n_x:] > 0, inputs - box[0], box[1] - inputs)
    off[:-1, n_x:] = np.minimum(off[:-1, n_x:], room / max(1.0, np.abs(v).max()))
    return bool(off.max() <= _STILL)
