"""One arc of a phase: its variables, residuals, bounded rows and integrals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Signal, pack
from wormopt.model.values import nominal_of
from wormopt.numerics.collocation import bernstein_matrix
from wormopt.ocp.contact import FixedModes, Treatment, never_rests
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.problem import Constraint, Problem


def limits_of(signals: Sequence[Signal]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of all scalars of the signals, scaled by their nominal sizes."""
    lower = [np.full(s.size, s.lower / s.nominal) for s in signals]
    upper = [np.full(s.size, s.upper / s.nominal) for s in signals]
    return np.concatenate([np.zeros(0), *lower]), np.concatenate([np.zeros(0), *upper])


@dataclass(frozen=True)
class Layout:
    """Rows of one arc's column of variables, in order, all scaled by their nominal sizes.

    Row 0 is the duration.
    """

    clock: slice  # time at the start, if the model depends on it
    start: slice  # state at the start, after its impulses
    points: slice  # states at the collocation points
    inputs: slice  # Bernstein coefficients of the inputs
    slacks: slice  # at the collocation points
    algebraic: slice  # variables at the collocation points
    unknowns: slice  # unknowns of contacts, at collocation points
    jumps: slice  # impulses of inputs and contacts at the start
    size: int  # number of rows

    @classmethod
    def of(cls, sizes: dict[str, int]) -> Layout:
        """Stack blocks of the given sizes, by field name, below the duration, in order."""
        edges = np.cumsum([1, *sizes.values()])  # row 0 is the duration
        rows = {k: slice(int(a), int(b)) for k, a, b in zip(sizes, edges, edges[1:], strict=False)}
        return cls(**rows, size=int(edges[-1]))


class Arc:
    """Basis of a `Transcription`: one arc, any mode, all scaled.

    Raises ArgumentError if impulses are requested without prescribed modes.
    """

    def __init__(self, problem: Problem, mesh: Mesh, treatment: Treatment) -> None:
        model = problem.model
        model.refuse_delays("optimisation")
        model.check_laws()
        self.problem, self.mesh = problem, mesh
        self.closure = treatment.close(model)
        self.modal = isinstance(treatment, FixedModes)
        if problem.impulses and not self.modal:
            raise ArgumentError("impulses need prescribed contact modes")
        self.timed = bool(model.schedules) or ca.depends_on(
            ca.vertcat(
                model.ode,
                model.alg,
                problem.integrands,
                *(b.expression for b in problem.path_constraints),
            ),
            model.t,
        )
        self.x_nominal = nominal_of(model.x)
        self.z_nominal = nominal_of(model.z)
        self.u_nominal = nominal_of(model.u)
        self.s_nominal = nominal_of(problem.slacks)
        self.design_nominal = nominal_of(problem.design)
        self.f_nominal = np.array([c.nominal_force for c in model.contacts])
        self.v_nominal = np.array([c.nominal_speed for c in model.contacts])
        self.time_nominal = problem.duration[1]
        d, n_c, n_u = mesh.collocation.degree, len(model.contacts), len(self.u_nominal)
        self.layout = Layout.of(
            {
                "clock": int(self.timed),
                "start": model.n_x,
                "points": model.n_x * d,
                "inputs": n_u * (mesh.input_degree + 1),
                "slacks": len(self.s_nominal) * d,
                "algebraic": len(self.z_nominal) * d,
                "unknowns": len(self.closure.nominal) * d,
                "jumps": (n_u + n_c) if problem.impulses else 0,
            }
        )

    @cached_property
    def fixed_grid(self) -> bool:
        """Whether the durations of all arcs are known beforehand."""
        shortest, longest = self.problem.duration
        return self.mesh.shares is not None and self.mesh.phases == 1 and shortest == longest

    # -- symbols ---------------------------------------------------------------------------

    @cached_property
    def _varying(self) -> list[ca.SX]:
        """Variables that differ from point to point: time, states, inputs, slacks, z, unknowns."""
        model = self.problem.model
        return [
            model.t,
            pack(model.x),
            pack(model.u),
            pack(self.problem.slacks),
            pack(model.z),
            self.closure.unknowns,
        ]

    @cached_property
    def constants(self) -> list[ca.SX]:
        """Constants of an arc: level and schedules; design and the model's parameters."""
        model = self.problem.model
        scheduled = [part for s in model.schedules for part in (s.begin, s.symbol)]
        return [
            self.closure.level,
            ca.vertcat(ca.SX(0, 1), *scheduled),
            pack(self.problem.design),
            pack(self.problem.parameters),
        ]

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """Time, states, inputs, slacks, z, unknowns; level, schedules, design, parameters."""
        return [*self._varying, *self.constants]

    @property
    def nominals(self) -> list[np.ndarray]:
        """Usual sizes of states, inputs, slacks, z and unknowns."""
        sizes = [self.x_nominal, self.u_nominal, self.s_nominal, self.z_nominal]
        return [*sizes, self.closure.nominal]

    def at_forces(self, expression: ca.SX) -> ca.SX:
        """Replace contact forces in an expression by those of the treatment."""
        forces = self.problem.model.forces
        return (
            ca.substitute(expression, forces, self.closure.forces) if forces.numel() else expression
        )

    def unknown_limits(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scaled lower and upper bounds (n_unknowns,) of the unknowns of contacts."""
        closure = self.closure
        box = ca.Function("box", [self.constants[3]], [closure.lower, closure.upper])(p)
        low, high = (np.asarray(side, dtype=float).ravel() for side in box)
        return low / closure.nominal, high / closure.nominal

    def rests(self, p: np.ndarray) -> np.ndarray:
        """Least and largest force of each contact at rest, (n_c, 2), scaled."""
        ends = [ca.SX(e) for c in self.problem.model.contacts for e in c.law.stick_interval]
        values = ca.Function("rests", [self.constants[3]], [ca.vertcat(ca.SX(0, 1), *ends)])(p)
        return np.asarray(values, dtype=float).reshape(-1, 2) / self.f_nominal[:, None]

    @cached_property
    def along(self) -> list[Constraint]:
        """Bounds at every instant: the problem's, and those of the model's states."""
        own = [
            Constraint(s.name, s.symbol, s.lower, s.upper, s.nominal)
            for s in self.problem.model.x
            if np.isfinite(s.lower) or np.isfinite(s.upper)
        ]
        return [*own, *self.problem.path_constraints]

    @cached_property
    def _bounds(self) -> list[ca.SX]:
        return [self.at_forces(b.expression / b.nominal) for b in self.along]

    @cached_property
    def state_only(self) -> list[bool]:
        """Which of the path bounds depend on states only."""
        others = ca.vertcat(*self._varying[2:])
        return [not ca.depends_on(b, others) for b in self._bounds]

    @cached_property
    def keeps_ends(self) -> bool:
        """Whether an arc's end needs its own bounds: else those of the next arc's start suffice."""
        problem = self.problem
        open_states = [s.symbol for s in problem.model.x if s.name not in problem.periodic]
        state_only = [b for b, yes in zip(self._bounds, self.state_only, strict=True) if yes]
        speeds = problem.model.contact_velocities if self.modal else ca.SX(0, 1)
        bounded = ca.vertcat(speeds, *state_only)
        model = problem.model  # values that depend on time do not return with the states
        timed = [model.t, *(p for s in model.schedules for p in (s.begin, s.symbol))]
        return problem.impulses or any(ca.depends_on(bounded, s) for s in (*open_states, *timed))

    def closure_start(self, points: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Guess unknowns of contacts from states and forces; bounds are ignored.

        From (n_x, degree, N) and (n_c, degree, N) at the collocation points to
        (n_unknowns, degree, N): forces, then each velocity's parts.
        """
        n, shape = len(self.closure.nominal), points.shape[1:]
        if n == 0:
            return np.zeros((0, *shape))
        model = self.problem.model
        speeds = ca.Function("speeds", [pack(model.x)], [model.contact_velocities])
        v = np.array(speeds(points.reshape(len(points), -1))).reshape(-1, *shape)
        parts = [
            np.maximum(d * v[i], 0.0)
            for i, c in enumerate(model.contacts)
            for d in (() if never_rests(c.law) else c.law.directions)
        ]
        return np.concatenate([forces, np.array(parts).reshape(-1, *shape)])[:n]

    @cached_property
    def lawful_ode(self) -> ca.SX:
        """Rates of the states; sliding prescribed contacts have the force of their law."""
        model = self.problem.model
        n = len(model.contacts)
        if not (self.modal and n):
            return model.ode
        stick, direction = self.closure.level[:n], self.closure.level[n : 2 * n]
        slide = ca.vertcat(*(self._slide_force(i, direction) for i in range(n)))
        forces = stick * model.forces + (1 - stick) * slide
        return ca.substitute(model.ode, model.forces, forces)

    # -- the arc ---------------------------------------------------------------------------

    @cached_property
    def _point(self) -> ca.Function:
        """Rates of the states, residuals, relaxed residuals, accelerations, integrands."""
        model, closure = self.problem.model, self.closure
        ode, alg, integrands = (
            self.at_forces(e) for e in (model.ode, model.alg, self.problem.integrands)
        )
        equal, held = closure.equal, ca.SX(0, 1)
        if self.modal:
            equal, held = self._modal_conditions()
        return ca.Function(
            "point",
            self.symbols,
            [
                ode,
                ca.vertcat(alg, equal),
                closure.small,
                held,
                integrands,
                closure.speeds,
                closure.gaps,
            ],
        )

    def _modal_conditions(self) -> tuple[ca.SX, ca.SX]:
        """Residuals by each contact's mode, and contact accelerations, scaled."""
        model, problem = self.problem.model, self.problem
        n = len(model.contacts)
        stick, direction, follow = (self.closure.level[k * n : (k + 1) * n] for k in range(3))
        acceleration = model.contact_accelerations
        slide = ca.vertcat(ca.SX(0, 1), *(self._slide_force(i, direction) for i in range(n)))
        scaled = acceleration / self.v_nominal * self.time_nominal
        sharing = scaled if problem.sharing is None else problem.sharing(stick) / self.f_nominal
        closure = (1 - stick) * (model.forces - slide) / self.f_nominal + stick * (
            (1 - follow) * scaled + follow * sharing
        )
        return closure, scaled

    @cached_property
    def function(self) -> ca.Function:
        """Map one arc's variables, level, schedules, design and parameters to results."""
        # Results: residuals; relaxed residuals; accelerations that following contacts must not
        # have; bounded rows; state before the arc and at its end, scaled; integrals.
        mesh, at = self.mesh, self.layout
        d = mesh.collocation.degree
        y = ca.SX.sym("y", at.size)
        level, schedules, design, p = (
            ca.SX.sym(f"c{k}", s.shape) for k, s in enumerate(self.constants)
        )
        fixed = [level, schedules, design * ca.DM(self.design_nominal), p]
        h = y[0] * self.time_nominal
        start = y[at.start] * self.x_nominal
        varying = self._at_points(y, h)
        x = varying[1]
        repeated = [ca.repmat(c, 1, d) for c in fixed]
        ode, equal, small, held, integrands, speeds, gaps = self._point.map(d)(*varying, *repeated)
        if mesh.collocation.scheme == "radau":  # the last point is the end
            end = x[:, d - 1]
        else:
            end = start + h * ca.mtimes(ode, ca.DM(mesh.collocation.B))
        defect = (x - ca.repmat(start, 1, d)) - h * ca.mtimes(ode, ca.DM(mesh.collocation.A.T))
        defect = defect / ca.repmat(ca.DM(self.x_nominal), 1, d)
        shared = self.problem.sharing is not None
        following = ca.vec(held[:, : mesh.input_degree + 1]) if shared else ca.SX(0, 1)
        rows = ca.vertcat(ca.SX(0, 1), *self._bounded_rows(self._begin(y), start, varying, fixed))
        jump = self._jump(y[at.jumps], start, fixed)
        return ca.Function(
            "arc",
            [y, level, schedules, design, p],
            [
                ca.vertcat(ca.vec(defect), ca.vec(equal)),
                ca.vertcat(ca.vec(small), self._crossed(start, speeds, gaps, fixed)),
                following,
                rows,
                (start - jump) / self.x_nominal,
                end / self.x_nominal,
                h * ca.mtimes(integrands, ca.DM(mesh.collocation.B)),
            ],
        )

    def _crossed(self, start: ca.SX, speeds: ca.SX, gaps: ca.SX, fixed: list[ca.SX]) -> ca.SX:
        """Products of every speed on an arc with the sum of the distances from sliding on it."""
        model, closure = self.problem.model, self.closure
        if not closure.gaps.numel():
            return ca.SX(0, 1)
        at_start = ca.Function("speeds", [pack(model.x), *self.constants], [closure.speeds])
        every = ca.horzcat(at_start(start, *fixed), speeds)
        return ca.vec(every * ca.repmat(ca.sum2(gaps), 1, every.shape[1]))

    def _at_points(self, y: ca.SX, h: ca.SX) -> list[ca.SX]:
        """Time, states, inputs, slacks, z and unknowns at the collocation points, one a column."""
        mesh, at, d = self.mesh, self.layout, self.mesh.collocation.degree

        def block(rows: slice, nominal: np.ndarray, columns: int) -> ca.SX:
            values = ca.reshape(y[rows], len(nominal), columns)
            return values * ca.repmat(ca.DM(nominal), 1, columns)

        t = self._begin(y) + h * ca.DM(mesh.collocation.tau).T
        coefficients = block(at.inputs, self.u_nominal, mesh.input_degree + 1)
        return [
            t,
            block(at.points, self.x_nominal, d),
            ca.mtimes(coefficients, ca.DM(mesh.inputs_at_points.T)),
            block(at.slacks, self.s_nominal, d),
            block(at.algebraic, self.z_nominal, d),
            block(at.unknowns, self.closure.nominal, d),
        ]

    def _begin(self, y: ca.SX) -> ca.SX:
        return y[self.layout.clock] * self.time_nominal if self.timed else ca.SX(0)

    def _slide_force(self, i: int, direction: ca.SX) -> ca.SX:
        contact = self.problem.model.contacts[i]
        forces = {k: contact.law.slip_force(contact.velocity, k) for k in contact.law.directions}
        if len(forces) == 1:
            return ca.SX(next(iter(forces.values())))
        return (1 + direction[i]) / 2 * forces[1] + (1 - direction[i]) / 2 * forces[-1]

    def _jump(self, impulses: ca.SX, start: ca.SX, fixed: list[ca.SX]) -> ca.SX:
        """State jump by impulses of inputs and contacts, through the affine ode."""
        model = self.problem.model
        if not self.problem.impulses:
            return ca.SX.zeros(model.n_x)
        actions = ca.vertcat(pack(model.u), model.forces)
        effect = ca.Function("effect", self.symbols, [ca.jacobian(model.ode, actions)])
        others = [ca.SX.zeros(v.shape) for v in self._varying[2:]]
        nominal = np.concatenate([self.u_nominal, self.f_nominal]) * self.time_nominal
        return ca.mtimes(effect(ca.SX(0), start, *others, *fixed), impulses * nominal)

    def _bounded_rows(
        self, begin: ca.SX, start: ca.SX, varying: list[ca.SX], fixed: list[ca.SX]
    ) -> list[ca.SX]:
        """Bernstein coefficients of contact velocities or forces, and of bounds along the arc."""
        model, d = self.problem.model, self.mesh.collocation.degree
        tau = self.mesh.collocation.tau
        to_coefficients = ca.DM(bernstein_matrix(tau).T)
        with_start = ca.DM(bernstein_matrix(self.mesh.collocation.nodes).T)
        repeated = [ca.repmat(c, 1, d) for c in fixed]

        def coefficients(expression: ca.SX, state_only: bool) -> ca.SX:
            function = ca.Function("row", self.symbols, [expression])
            values = function.map(d)(*varying, *repeated)
            if not state_only:
                return ca.mtimes(values, to_coefficients)
            others = [v[:, 0] for v in varying[2:]]  # without effect
            first = function(begin, start, *others, *fixed)
            return ca.mtimes(ca.horzcat(first, values), with_start)

        rows = []
        if self.modal:
            speeds = coefficients(model.contact_velocities / self.v_nominal, True)
            forces = coefficients(model.forces / self.f_nominal, False)
            # The speed of a sliding contact is bounded, or the force of a sticking one: one row for
            # both.
            stuck = ca.repmat(fixed[0][: len(model.contacts)], 1, d)
            rows += [speeds[:, 0], ca.vec((1 - stuck) * speeds[:, :d] + stuck * forces)]
            if self.keeps_ends:
                rows.append(speeds[:, d])
        for bound, state_only in zip(self._bounds, self.state_only, strict=True):
            row = coefficients(bound, state_only)
            rows.append(ca.vec(row[:, :d] if state_only and not self.keeps_ends else row))
        return rows
