"""One arc of a phase: its variables, and the residuals, bounded rows and integrals they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.core.model import Signal, pack
from wormopt.optimal.collocation import bernstein_matrix
from wormopt.optimal.mesh import Mesh
from wormopt.optimal.problem import Problem

__all__ = ["Arc", "Layout", "limits_of"]


def _nominals(signals: Sequence[Signal]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *(np.full(s.size, s.nominal) for s in signals)])


def limits_of(signals: Sequence[Signal]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of all scalars of the signals, scaled by their nominal sizes.

    Parameters
    ----------
    signals : sequence of Signal
        Signals in order.

    Returns
    -------
    lower, upper : ndarray
    """
    lower = [np.full(s.size, s.lower / s.nominal) for s in signals]
    upper = [np.full(s.size, s.upper / s.nominal) for s in signals]
    return np.concatenate([np.zeros(0), *lower]), np.concatenate([np.zeros(0), *upper])


@dataclass(frozen=True)
class Layout:
    """Rows of one arc's column of variables, in order, all scaled by their nominal sizes.

    Row 0 is the duration.

    Parameters
    ----------
    start : slice
        State at the arc's start, after its impulses.
    points : slice
        States at the collocation points.
    inputs : slice
        Bernstein coefficients of the inputs.
    slacks, forces : slice
        Slacks and contact forces at the collocation points.
    jumps : slice
        Impulses of inputs and contacts at the arc's start.
    size : int
        Number of rows.
    """

    start: slice
    points: slice
    inputs: slice
    slacks: slice
    forces: slice
    jumps: slice
    size: int

    @classmethod
    def of(cls, sizes: dict[str, int]) -> Layout:
        """Put blocks of the given sizes below the duration, in their order.

        Parameters
        ----------
        sizes : dict of str to int
            Number of rows by the name of the field.
        """
        edges = np.cumsum([1, *sizes.values()])  # row 0 is the duration
        rows = {k: slice(int(a), int(b)) for k, a, b in zip(sizes, edges, edges[1:], strict=False)}
        return cls(**rows, size=int(edges[-1]))


class Arc:
    """The piece from which a `PhaseProgram` is built: one arc, any mode, all scaled.

    Parameters
    ----------
    problem : Problem
        What to optimise.
    mesh : Mesh
        Polynomials on each arc.

    Raises
    ------
    NotImplementedError
        If the model depends on time explicitly or has algebraic equations.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        model = problem.model
        if ca.depends_on(model.ode, model.t) or model.alg.numel() or model.schedules:
            raise NotImplementedError("phases take autonomous models without algebraic equations")
        self.problem, self.mesh = problem, mesh
        self.x_nominal = _nominals(model.x)
        self.u_nominal = _nominals(model.u)
        self.s_nominal = _nominals(problem.slacks)
        self.p_nominal = _nominals(problem.design)
        self.f_nominal = np.array([c.nominal_force for c in model.contacts])
        self.v_nominal = np.array([c.nominal_speed for c in model.contacts])
        self.time_nominal = problem.duration[1]
        d, n_c, n_u = mesh.collocation.degree, len(model.contacts), len(self.u_nominal)
        self.layout = Layout.of(
            {
                "start": model.n_x,
                "points": model.n_x * d,
                "inputs": n_u * (mesh.input_degree + 1),
                "slacks": len(self.s_nominal) * d,
                "forces": n_c * d,
                "jumps": (n_u + n_c) if problem.impulses else 0,
            }
        )

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """States, inputs, slacks, contact forces and design constants, as columns."""
        problem, model = self.problem, self.problem.model
        return [
            pack(model.x),
            pack(model.u),
            pack(problem.slacks),
            model.forces,
            ca.vertcat(ca.SX(0, 1), *(s.symbol for s in problem.design)),
        ]

    @cached_property
    def state_only(self) -> list[bool]:
        """Which of the bounds along the way hang on states alone."""
        others = ca.vertcat(*self.symbols[1:4])
        return [not ca.depends_on(b.expression, others) for b in self.problem.along]

    @cached_property
    def keeps_ends(self) -> bool:
        """Whether an arc's end must be bounded by itself: else the next arc's start says it all."""
        problem = self.problem
        open_states = [s.symbol for s in problem.model.x if s.name not in problem.periodic]
        state_only = [
            bound.expression
            for bound, yes in zip(problem.along, self.state_only, strict=True)
            if yes
        ]
        bounded = ca.vertcat(problem.model.contact_velocities, *state_only)
        return problem.impulses or any(ca.depends_on(bounded, s) for s in open_states)

    @cached_property
    def function(self) -> ca.Function:
        """Map one arc's variables, modes and the design to residuals, bounded rows, end, integrals.

        Modes of one contact: sticks (0/1), direction of sliding, follows (0/1: sticks, but its
        force is left open by the motion and given by the sharing rule).
        """
        problem, model, mesh, at = self.problem, self.problem.model, self.mesh, self.layout
        d, n_c, n_x = mesh.collocation.degree, len(model.contacts), model.n_x
        y, design = ca.SX.sym("y", at.size), ca.SX.sym("design", len(self.p_nominal))
        modes = ca.SX.sym("modes", 3 * n_c)
        stick, direction, follow = modes[:n_c], modes[n_c : 2 * n_c], modes[2 * n_c :]

        h = y[0] * self.time_nominal
        start = y[at.start] * self.x_nominal
        x = ca.reshape(y[at.points], n_x, d) * ca.repmat(ca.DM(self.x_nominal), 1, d)
        n_u, n_k = len(self.u_nominal), mesh.input_degree + 1
        coefficients = ca.reshape(y[at.inputs], n_u, n_k) * ca.repmat(ca.DM(self.u_nominal), 1, n_k)
        u = ca.mtimes(coefficients, ca.DM(mesh.inputs_at_points.T))
        s = ca.reshape(y[at.slacks], -1, d) * ca.repmat(ca.DM(self.s_nominal), 1, d)
        f = ca.reshape(y[at.forces], n_c, d) * ca.repmat(ca.DM(self.f_nominal), 1, d)
        p = design * self.p_nominal

        symbols = self.symbols
        acceleration = model.contact_accelerations
        slide = ca.vertcat(ca.SX(0, 1), *(self._slide_force(i, direction) for i in range(n_c)))
        sharing = problem.sharing(stick) if problem.sharing is not None else acceleration
        scaled = acceleration / self.v_nominal * self.time_nominal
        closure = (1 - stick) * (model.forces - slide) / self.f_nominal + stick * (
            (1 - follow) * scaled + follow * sharing / self.f_nominal
        )
        point = ca.Function(
            "point",
            [*symbols, modes],
            [model.ode, closure, scaled, problem.integrands],
        )
        ode, closures, held, integrands = point.map(d)(
            x, u, s, f, ca.repmat(p, 1, d), ca.repmat(modes, 1, d)
        )
        end = start + h * ca.mtimes(ode, ca.DM(mesh.collocation.B))
        defect = (x - ca.repmat(start, 1, d)) - h * ca.mtimes(ode, ca.DM(mesh.collocation.A.T))
        defect = defect / ca.repmat(ca.DM(self.x_nominal), 1, d)
        following = ca.vec(held[:, :n_k]) if problem.sharing is not None else ca.SX(0, 1)
        rows = ca.vertcat(*self._bounded_rows(start, x, u, s, f, p, stick))
        jump = self._jump(y[at.jumps], start, p)
        return ca.Function(
            "arc",
            [y, modes, design],
            [
                ca.vertcat(ca.vec(defect), ca.vec(closures)),
                following,
                rows,
                (start - jump) / self.x_nominal,
                end / self.x_nominal,
                h * ca.mtimes(integrands, ca.DM(mesh.collocation.B)),
            ],
        )

    def _slide_force(self, i: int, direction: ca.SX) -> ca.SX:
        contact = self.problem.model.contacts[i]
        forces = {k: contact.law.slip_force(contact.velocity, k) for k in contact.law.directions}
        if len(forces) == 1:
            return ca.SX(next(iter(forces.values())))
        return (1 + direction[i]) / 2 * forces[1] + (1 - direction[i]) / 2 * forces[-1]

    def _jump(self, impulses: ca.SX, start: ca.SX, p: ca.SX) -> ca.SX:
        """State jump by impulses of inputs and contacts, through the affine ode."""
        model = self.problem.model
        if not self.problem.impulses:
            return ca.SX.zeros(model.n_x)
        actions = ca.vertcat(pack(model.u), model.forces)
        effect = ca.Function("effect", self.symbols, [ca.jacobian(model.ode, actions)])
        zero = [ca.SX.zeros(v.shape) for v in self.symbols[1:4]]
        nominal = np.concatenate([self.u_nominal, self.f_nominal]) * self.time_nominal
        return ca.mtimes(effect(start, *zero, p), impulses * nominal)

    def _bounded_rows(
        self, start: ca.SX, x: ca.SX, u: ca.SX, s: ca.SX, f: ca.SX, p: ca.SX, stick: ca.SX
    ) -> list[ca.SX]:
        """Bernstein coefficients of contact velocities or forces, and of bounds along the arc."""
        model, d = self.problem.model, self.mesh.collocation.degree
        tau = self.mesh.collocation.tau
        to_coefficients = ca.DM(bernstein_matrix(tau).T)
        with_start = ca.DM(bernstein_matrix(np.concatenate([[0.0], tau])).T)

        def coefficients(expression: ca.SX, state_only: bool) -> ca.SX:
            function = ca.Function("row", self.symbols, [expression])
            values = function.map(d)(x, u, s, f, ca.repmat(p, 1, d))
            if not state_only:
                return ca.mtimes(values, to_coefficients)
            first = function(start, u[:, 0], s[:, 0], f[:, 0], p)
            return ca.mtimes(ca.horzcat(first, values), with_start)

        speeds = coefficients(model.contact_velocities / self.v_nominal, True)
        forces = coefficients(model.forces / self.f_nominal, False)
        # A sliding contact has a bounded speed, a sticking one a bounded force: one row for both.
        stuck = ca.repmat(stick, 1, d)
        rows = [speeds[:, 0], ca.vec((1 - stuck) * speeds[:, :d] + stuck * forces)]
        if self.keeps_ends:
            rows.append(speeds[:, d])
        for bound, state_only in zip(self.problem.along, self.state_only, strict=True):
            row = coefficients(bound.expression / bound.nominal, state_only)
            rows.append(ca.vec(row[:, :d] if state_only and not self.keeps_ends else row))
        return rows
