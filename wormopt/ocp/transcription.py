"""Direct collocation: the nonlinear program of a Problem on a Mesh, for any Model.

Every phase is a row of arcs; on an arc the states are polynomials (collocation), the inputs
polynomials of lower degree. Durations of arcs are free, or have fixed shares of their phase, whose
duration may be free. Contact modes and levels are parameters, so that one nonlinear program serves
all mode sequences of as many phases, all widths of a smoothed law and all relaxations of a
complementarity. Bounds apply to Bernstein coefficients: they hold at every instant of the
polynomials, not only at nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.modes import ModeSequence
from wormopt.ocp.arc import Arc
from wormopt.ocp.bounds import ProgramBounds
from wormopt.ocp.contact import FixedModes, Treatment
from wormopt.ocp.mesh import Arcs, Mesh, interpolation
from wormopt.ocp.nlp import Bounds, NonlinearProgram
from wormopt.ocp.problem import Problem


class Transcription:
    """The nonlinear program of a problem on a mesh, with contacts treated in one of three ways.

    Variables of ``nlp``, in nominal sizes: arc after arc the rows of `Layout`, then design
    constants. Raises ArgumentError if impulses are requested without prescribed modes.
    """

    def __init__(self, problem: Problem, mesh: Mesh, treatment: Treatment | None = None) -> None:
        self.problem, self.mesh = problem, mesh
        self.treatment = treatment or FixedModes()
        self.arc = Arc(problem, mesh, self.treatment)
        self.nlp = self._assemble()

    # -- all arcs --------------------------------------------------------------------------

    def _assemble(self) -> NonlinearProgram:
        at, n, arc = self.arc.layout, self.mesh.total, self.arc.function
        n_integrals = self.problem.integrands.numel()
        n_x, n_design = self.problem.model.n_x, len(self.arc.design_nominal)
        sizes = [at.size * n, n_x, 1, n_integrals * n, n_design]
        w = ca.MX.sym("w", sum(sizes))
        arcs, last, total, tallies, design = ca.vertsplit(w, np.cumsum([0, *sizes]).tolist())
        own_levels, own_schedules, _, own_p = self.arc.constants
        levels = ca.MX.sym("levels", own_levels.numel(), n)
        schedules = ca.MX.sym("schedules", own_schedules.numel(), n)
        p = ca.MX.sym("p", own_p.numel())
        y = ca.reshape(arcs, at.size, n)
        equal, small, following, rows, before, end, integrals = arc.map(n)(
            y, levels, schedules, ca.repmat(design, 1, n), ca.repmat(p, 1, n)
        )
        # Ends, duration and integrals are variables: an objective that couples them would otherwise
        # couple all arcs, and fill the Hessian. Integrals are summed arc by arc: one row with all
        # arcs would make the derivatives of long meshes slow to find.
        tally = ca.reshape(tallies, n_integrals, n)
        running = ca.horzcat(ca.MX(n_integrals, 1), tally[:, : n - 1]) + integrals
        ends = ca.vertcat(end[:, n - 1], self._total_duration(y))
        joints = ca.vertcat(
            self._joints(y, before, end, last),
            ca.vertcat(last, total) - ends,
            ca.vec(tally - running),
        )
        rows_of_kinds = {
            "equal": equal.shape[0],
            "small": small.shape[0],
            "following": following.shape[0],
            "rows": rows.shape[0],
            "joints": joints.shape[0],
        }
        self._limits = ProgramBounds(self.arc, rows_of_kinds, n_x + 1 + n_integrals * n)
        constraints = ca.vertcat(
            ca.vec(equal),
            ca.vec(small),
            ca.vec(following),
            ca.vec(rows),
            joints,
        )
        objective, boundary = self._finish(before[:, 0], last, total, tally[:, n - 1], design, p)
        parameters = ca.vertcat(ca.vec(levels), ca.vec(schedules), p)
        sums = [ca.sum2(integrals[:, : k + 1]) for k in range(n)]
        self._totals = ca.Function("totals", [w, parameters], [ca.vertcat(ends, *sums)])
        return NonlinearProgram(w, parameters, objective, ca.vertcat(constraints, boundary))

    def _total_duration(self, y: ca.MX) -> ca.MX:
        """Sum of all durations; by those of the first arcs if shares give the others."""
        if self.mesh.shares is None:
            return ca.sum2(y[0, :])
        first = np.searchsorted(self.mesh.phase, np.arange(self.mesh.phases))
        whole = np.bincount(self.mesh.phase, weights=self.mesh.shares)
        return y[0, first.tolist()] @ (whole / np.array(self.mesh.shares)[first])

    def _joints(self, y: ca.MX, before: ca.MX, end: ca.MX, last: ca.MX) -> ca.MX:
        """Residuals where arcs join: states, clocks, shares of durations, the period."""
        n, at = self.mesh.total, self.arc.layout
        parts = [ca.vec(before[:, 1:] - end[:, : n - 1])]
        if self.arc.timed:
            parts.append((y[at.clock, 1:] - y[at.clock, : n - 1] - y[0, : n - 1]).T)
        if self.mesh.shares is not None and not self.arc.fixed_grid:
            first = np.searchsorted(self.mesh.phase, self.mesh.phase)
            share = np.array(self.mesh.shares)
            later = [k for k in range(n) if first[k] != k]
            parts += [y[0, k] * share[first[k]] - y[0, int(first[k])] * share[k] for k in later]
        change = last - before[:, 0]
        if self._periodic_rows:
            parts.append(change[self._periodic_rows])
        for rows in map(self.rows_of, self.problem.displaced):
            parts.append(change[rows[1:]] - change[rows[0]])
        return ca.vertcat(*parts)

    def _finish(
        self, first: ca.MX, last: ca.MX, total: ca.MX, tally: ca.MX, design: ca.MX, p: ca.MX
    ) -> tuple[ca.MX, ca.MX]:
        """Objective and bounds at the ends."""
        problem = self.problem
        bounded = (b.expression / b.nominal for b in problem.boundary_constraints)
        finish = ca.Function(
            "finish",
            [*vars(problem.ends).values(), *self.arc.constants[2:]],
            [problem.minimise / problem.nominal, ca.vertcat(*bounded)],
        )
        objective, boundary = finish(
            first * self.arc.x_nominal,
            last * self.arc.x_nominal,
            total * self.arc.time_nominal,
            tally,
            design * self.arc.design_nominal,
            p,
        )
        return objective, boundary

    def rows_of(self, name: str) -> list[int]:
        """Rows of the state called `name` among all scalar states; ArgumentError for no state."""
        first = 0
        for signal in self.problem.model.x:
            if signal.name == name:
                return list(range(first, first + signal.size))
            first += signal.size
        raise ArgumentError(f"{self.problem.model.name} has no state {name!r}")

    @cached_property
    def _periodic_rows(self) -> list[int]:
        return [row for name in self.problem.periodic for row in self.rows_of(name)]

    # -- bounds ----------------------------------------------------------------------------

    def bounds(
        self,
        level: ModeSequence | float,
        *,
        p: Mapping[str, ArrayLike] | None = None,
        pins: Mapping[int, float] | None = None,
        active: Sequence[Sequence[int]] | None = None,
    ) -> Bounds:
        """Bounds and parameters of the program for given modes, width or relaxation.

        `pins`: start times by phase, which select pieces of schedules. `active`, per phase and
        input: -1 lower limit, +1 upper, 0 free. ArgumentError if phases or schedules do not fit.
        """
        return self._limits.bounds(level, p, pins, active)

    def name_of(self, row: int) -> str:
        """Description of a row of the constraints."""
        return self._limits.name_of(row)

    def guarded(self, bounds: Bounds) -> Bounds:
        """Bound every arc's duration by 0 from below, even if its phase implies it.

        The stronger barrier keeps durations from collapsing in an interior point: more iterations,
        but motions are found from worse starts.
        """
        rows = self.arc.layout.size * np.arange(self.mesh.total)
        lower, upper = bounds.lbw.copy(), bounds.ubw.copy()
        lower[rows] = np.maximum(lower[rows], 0.0)
        upper[rows] = np.minimum(upper[rows], self.problem.duration[1] / self.arc.time_nominal)
        return replace(bounds, lbw=lower, ubw=upper)

    # -- variables in and out --------------------------------------------------------------

    def unpack(self, w: np.ndarray) -> Arcs:
        """Convert the program's variables (n_w,) to the model's units."""
        arc, at, n, d = self.arc, self.arc.layout, self.mesh.total, self.mesh.collocation.degree
        y = w[: at.size * n].reshape((at.size, n), order="F")

        def block(rows: slice, nominal: np.ndarray, columns: int) -> np.ndarray:
            shape = (len(nominal), columns, n)
            return y[rows].reshape(shape, order="F") * nominal[:, None, None]

        return Arcs(
            duration=y[0] * arc.time_nominal,
            start=y[at.start] * arc.x_nominal[:, None],
            points=block(at.points, arc.x_nominal, d),
            inputs=block(at.inputs, arc.u_nominal, self.mesh.input_degree + 1),
            slacks=block(at.slacks, arc.s_nominal, d),
            algebraic=block(at.algebraic, arc.z_nominal, d),
            unknowns=block(at.unknowns, arc.closure.nominal, d),
            jumps=y[at.jumps],
            design=w[len(w) - len(arc.design_nominal) :] * arc.design_nominal,
        )

    def pack(self, arcs: Arcs, bounds: Bounds | None = None) -> np.ndarray:
        """Convert a motion on this mesh to the program's variables (n_w,); inverse of `unpack`.

        Integrals are evaluated with the parameters of `bounds`, and zero without it.
        `on_finer_mesh` converts a motion from a coarser mesh.
        """

        def block(values: np.ndarray, nominal: np.ndarray) -> np.ndarray:
            scaled = values / nominal[:, None, None]
            return scaled.reshape((len(nominal) * values.shape[1], self.mesh.total), order="F")

        arc = self.arc
        duration = arcs.duration / arc.time_nominal
        clock = np.concatenate([[0.0], np.cumsum(duration)[:-1]])
        y = np.vstack(
            [
                duration,
                *([clock] if arc.timed else []),
                arcs.start / arc.x_nominal[:, None],
                block(arcs.points, arc.x_nominal),
                block(arcs.inputs, arc.u_nominal),
                block(arcs.slacks, arc.s_nominal),
                block(arcs.algebraic, arc.z_nominal),
                block(arcs.unknowns, arc.closure.nominal),
                arcs.jumps,
            ]
        )
        return self._with_totals(y, arcs.design / arc.design_nominal, bounds)

    def _with_totals(self, y: np.ndarray, design: np.ndarray, bounds: Bounds | None) -> np.ndarray:
        """Variables of the program: those of the arcs, their totals, design constants."""
        n_x, n_totals = self.problem.model.n_x, self._totals.size1_out(0)
        w = np.concatenate([y.ravel(order="F"), np.zeros(n_totals), design])
        totals = slice(y.size, y.size + n_totals)
        if bounds is not None:
            w[totals] = np.asarray(self._totals(w, bounds.p)).ravel()
            return w
        nodes, at = self.mesh.collocation.nodes, self.arc.layout
        points = y[at.points, -1].reshape((n_x, self.mesh.collocation.degree), order="F")
        values = np.column_stack([y[at.start, -1], points])
        ends = values @ interpolation(nodes, np.ones(1)).T
        w[totals.start : totals.start + n_x] = ends.ravel()
        w[totals.start + n_x] = y[0].sum()
        return w

    def rest(self, durations: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Variables (n_w,) of a worm at rest at `start` (n_x,), on arcs of durations (arcs,).

        From there `NonlinearProgram.linear_step` finds the best motion with these durations,
        where the model is linear.
        """
        at, n = self.arc.layout, self.mesh.total
        y = np.zeros((at.size, n))
        y[0] = durations / self.arc.time_nominal
        y[at.clock] = np.cumsum(y[0]) - y[0]
        y[at.start] = (start / self.arc.x_nominal)[:, None]
        y[at.points] = np.tile(start / self.arc.x_nominal, self.mesh.collocation.degree)[:, None]
        return self._with_totals(y, np.zeros(len(self.arc.design_nominal)), None)

    def nominal_extras(self) -> dict[str, np.ndarray]:
        """Slacks and design constants at their nominal sizes, which a motion does not contain.

        ``slacks`` (n_s, degree, arcs) and ``design`` (n_p,), to put into `Arcs`.
        """
        shape = (1, self.mesh.collocation.degree, self.mesh.total)
        return {
            "slacks": np.tile(self.arc.s_nominal[:, None, None], shape),
            "design": self.arc.design_nominal.copy(),
        }

    def hold_durations(self, free: float = np.inf) -> np.ndarray:
        """Radius (n_w,) of `NonlinearProgram.linear_step` that fixes all durations.

        0 for durations, `free`, scaled, for all other variables.
        """
        radius = np.full((self.arc.layout.size, self.mesh.total), free)
        radius[0] = 0.0
        rest = self._totals.size1_out(0) + len(self.arc.design_nominal)
        return np.concatenate([radius.ravel(order="F"), np.full(rest, free)])
