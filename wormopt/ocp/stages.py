"""A transcribed problem as stages: arcs linearised one by one, their inner unknowns eliminated.

An arc becomes its end as a function of its start and inputs, with a quadratic cost: the form of
receding and moving horizons, with the same equations as those of the nonlinear program.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.ocp.arc import limits_of
from wormopt.ocp.nlp import Bounds
from wormopt.ocp.transcription import Transcription
from wormopt.simulation.call import Call


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
            "stages are of a problem of given duration on a mesh with shares, whose objective is "
            "a weighted sum of integrals"
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
            "stages take smooth contact, Regularised(v_reg), and no limits along the way but "
            "those of inputs"
        )
    if equal != inner or mesh.input_degree:
        raise ArgumentError("stages take inputs that are constant on each arc")
    return np.asarray(ca.DM(slope)).ravel()
