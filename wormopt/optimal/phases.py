"""Collocation over contact phases with free durations: any Model, any mode sequence.

Every phase is a row of arcs; on an arc the states are polynomials (collocation), the inputs
polynomials of lower degree. The contact modes enter as parameters, so one nonlinear program
serves all sequences of as many phases. Bounds are put on Bernstein coefficients: they hold at
every instant of the polynomials, not only at nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.core.model import Signal, pack
from wormopt.core.modes import ModeSequence
from wormopt.optimal.collocation import Collocation, bernstein_matrix
from wormopt.optimal.nlp import Bounds, NonlinearProgram
from wormopt.optimal.problem import Problem

__all__ = ["Arcs", "Mesh", "PhaseProgram"]


@dataclass(frozen=True)
class Mesh:
    """How finely phases are resolved.

    Parameters
    ----------
    phases : int
        Number of contact phases.
    arcs : int
        Arcs of free duration per phase.
    collocation : Collocation
        Scheme and degree of the state polynomials on each arc.
    input_degree : int
        Degree of the input polynomials; 0 is piecewise constant. With ``collocation.degree - 2``
        a state two integrations behind the input is still represented exactly.
    """

    phases: int
    arcs: int
    collocation: Collocation
    input_degree: int = 0

    @property
    def total(self) -> int:
        """Number of arcs in all phases."""
        return self.phases * self.arcs

    @property
    def inputs_at_points(self) -> np.ndarray:
        """Matrix from an input's Bernstein coefficients to its values at collocation points."""
        nodes = self.input_nodes
        powers = np.arange(self.input_degree + 1)
        to_values = self.collocation.tau[:, None] ** powers
        return (
            to_values
            @ np.linalg.inv(nodes[:, None] ** powers)
            @ np.linalg.inv(bernstein_matrix(nodes))
        )

    @property
    def input_nodes(self) -> np.ndarray:
        """Equidistant nodes that define the input polynomials."""
        return np.linspace(0, 1, self.input_degree + 1) if self.input_degree else np.array([0.5])


@dataclass(frozen=True)
class Arcs:
    """A motion as it left the optimiser, arc by arc, in the model's own units.

    Shapes are in the number of arcs N, of scalars in each group of signals and of the mesh's
    degrees. Columns of points are the collocation points of an arc in order.

    Parameters
    ----------
    duration : ndarray, shape (N,)
        Duration of each arc, 0 allowed.
    start : ndarray, shape (n_x, N)
        States at the start of each arc, after its impulses.
    points : ndarray, shape (n_x, degree, N)
        States at the collocation points.
    inputs : ndarray, shape (n_u, input_degree + 1, N)
        Bernstein coefficients of the inputs.
    slacks : ndarray, shape (n_s, degree, N)
        Slacks at the collocation points.
    forces : ndarray, shape (contacts, degree, N)
        Contact forces at the collocation points.
    jumps : ndarray, shape (n_u + contacts, N)
        Impulses of inputs and contacts at the start of each arc, in nominal sizes times nominal
        time; no rows where the problem allows none.
    design : ndarray, shape (n_p,)
        Design constants.
    phase : ndarray of int, shape (N,)
        Phase of each arc.
    """

    duration: np.ndarray
    start: np.ndarray
    points: np.ndarray
    inputs: np.ndarray
    slacks: np.ndarray
    forces: np.ndarray
    jumps: np.ndarray
    design: np.ndarray
    phase: np.ndarray


def _nominals(signals: tuple[Signal, ...]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *(np.full(s.size, s.nominal) for s in signals)])


def _limits(signals: tuple[Signal, ...]) -> tuple[np.ndarray, np.ndarray]:
    lower = [np.full(s.size, s.lower / s.nominal) for s in signals]
    upper = [np.full(s.size, s.upper / s.nominal) for s in signals]
    return np.concatenate([np.zeros(0), *lower]), np.concatenate([np.zeros(0), *upper])


@dataclass(frozen=True)
class _Layout:
    """Rows of one arc's column of variables, in order, all scaled by their nominal sizes."""

    start: slice
    points: slice
    inputs: slice
    slacks: slice
    forces: slice
    jumps: slice
    size: int

    @classmethod
    def of(cls, sizes: dict[str, int]) -> _Layout:
        edges = np.cumsum([1, *sizes.values()])  # row 0 is the duration
        rows = {k: slice(int(a), int(b)) for k, a, b in zip(sizes, edges, edges[1:], strict=False)}
        return cls(**rows, size=int(edges[-1]))


class PhaseProgram:
    """The nonlinear program of a problem on a mesh, for every mode sequence of its length.

    Parameters
    ----------
    problem : Problem
        What to optimise.
    mesh : Mesh
        Phases, arcs and polynomials.

    Raises
    ------
    NotImplementedError
        If the model depends on time explicitly or has algebraic equations.

    Notes
    -----
    Attributes ``problem`` and ``mesh`` are those given, ``nlp`` is the NonlinearProgram. Its
    variables are scaled by nominal sizes: arc after arc duration, start, points, inputs, slacks,
    forces and jumps, then the design constants.

    Examples
    --------
    A cart of unit mass travels a unit way from rest to rest with forces up to 1. The fastest way
    takes 2: full force forward, then full force back.

    >>> from wormopt.core.model import Model
    >>> from wormopt.optimal.nlp import Ipopt
    >>> from wormopt.optimal.problem import Bound, Ends
    >>> q, v, u = (ca.SX.sym(name) for name in "qvu")
    >>> x = [Signal("position", q), Signal("velocity", v)]
    >>> cart = Model("cart", x=x, ode=ca.vertcat(v, u), u=[Signal("force", u)])
    >>> ends = Ends.of(cart)
    >>> origin = Bound("start", ends.start, 0.0, 0.0)
    >>> target = Bound("target", ends.end, [1.0, 0.0], [1.0, 0.0])
    >>> force = Bound("force", u, -1.0, 1.0)
    >>> problem = Problem(
    ...     cart, ends, ends.duration, (0.1, 10.0), along=[force], at_ends=[origin, target]
    ... )
    >>> program = PhaseProgram(problem, Mesh(phases=1, arcs=2, collocation=Collocation(2)))
    >>> bounds = program.bounds(ModeSequence(((),)))  # one phase, no contacts
    >>> start = program.rest(np.ones(2), np.zeros(2))
    >>> arcs = program.unpack(program.nlp.solve(start, bounds, Ipopt()).w)
    >>> arcs.duration.round(6), arcs.inputs.ravel().round(6)
    (array([1., 1.]), array([ 1., -1.]))
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        model = problem.model
        if ca.depends_on(model.ode, model.t) or model.alg.numel():
            raise NotImplementedError("phases take autonomous models without algebraic equations")
        self.problem, self.mesh = problem, mesh
        self._x_nominal = _nominals(tuple(model.x))
        self._u_nominal = _nominals(tuple(model.u))
        self._s_nominal = _nominals(tuple(problem.slacks))
        self._p_nominal = _nominals(tuple(problem.design))
        self._f_nominal = np.array([c.nominal_force for c in model.contacts])
        self._v_nominal = np.array([c.nominal_speed for c in model.contacts])
        d, n_c = mesh.collocation.degree, len(model.contacts)
        n_u = len(self._u_nominal)
        self._layout = _Layout.of(
            {
                "start": model.n_x,
                "points": model.n_x * d,
                "inputs": n_u * (mesh.input_degree + 1),
                "slacks": len(self._s_nominal) * d,
                "forces": n_c * d,
                "jumps": (n_u + n_c) if problem.impulses else 0,
            }
        )
        self._groups: list[tuple[str, np.ndarray, np.ndarray]] = []
        self.nlp = self._assemble()

    @cached_property
    def time_nominal(self) -> float:
        """Usual duration of the whole motion, by which time is scaled: the longest allowed."""
        return self.problem.duration[1]

    # -- one arc ---------------------------------------------------------------------------

    def _symbols(self) -> list[ca.SX]:
        problem, model = self.problem, self.problem.model
        return [
            pack(model.x),
            pack(model.u),
            pack(problem.slacks),
            model.forces,
            ca.vertcat(ca.SX(0, 1), *(s.symbol for s in problem.design)),
        ]

    def _along_state_only(self) -> list[bool]:
        others = ca.vertcat(*self._symbols()[1:4])
        return [not ca.depends_on(b.expression, others) for b in self.problem.along]

    @cached_property
    def _keeps_ends(self) -> bool:
        """Whether an arc's end must be bounded by itself: else the next arc's start says it all."""
        problem = self.problem
        open_states = [s.symbol for s in problem.model.x if s.name not in problem.periodic]
        state_only = [
            bound.expression
            for bound, yes in zip(problem.along, self._along_state_only(), strict=True)
            if yes
        ]
        bounded = ca.vertcat(problem.model.contact_velocities, *state_only)
        return problem.impulses or any(ca.depends_on(bounded, s) for s in open_states)

    def _arc_function(self) -> ca.Function:
        """Map one arc's variables, modes and the design to residuals, bounded rows, end, integrals.

        Modes of one contact: sticks (0/1), direction of sliding, follows (0/1: sticks, but its
        force is left open by the motion and given by the sharing rule).
        """
        problem, model, mesh, at = self.problem, self.problem.model, self.mesh, self._layout
        d, n_c, n_x = mesh.collocation.degree, len(model.contacts), model.n_x
        y, design = ca.SX.sym("y", at.size), ca.SX.sym("design", len(self._p_nominal))
        modes = ca.SX.sym("modes", 3 * n_c)
        stick, direction, follow = modes[:n_c], modes[n_c : 2 * n_c], modes[2 * n_c :]

        h = y[0] * self.time_nominal
        start = y[at.start] * self._x_nominal
        x = ca.reshape(y[at.points], n_x, d) * ca.repmat(ca.DM(self._x_nominal), 1, d)
        n_u, n_k = len(self._u_nominal), mesh.input_degree + 1
        coefficients = ca.reshape(y[at.inputs], n_u, n_k) * ca.repmat(
            ca.DM(self._u_nominal), 1, n_k
        )
        u = ca.mtimes(coefficients, ca.DM(mesh.inputs_at_points.T))
        s = ca.reshape(y[at.slacks], -1, d) * ca.repmat(ca.DM(self._s_nominal), 1, d)
        f = ca.reshape(y[at.forces], n_c, d) * ca.repmat(ca.DM(self._f_nominal), 1, d)
        p = design * self._p_nominal

        symbols = self._symbols()
        acceleration = model.contact_accelerations
        slide = ca.vertcat(ca.SX(0, 1), *(self._slide_force(i, direction) for i in range(n_c)))
        sharing = problem.sharing(stick) if problem.sharing is not None else acceleration
        scaled = acceleration / self._v_nominal * self.time_nominal
        closure = (1 - stick) * (model.forces - slide) / self._f_nominal + stick * (
            (1 - follow) * scaled + follow * sharing / self._f_nominal
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
        defect = defect / ca.repmat(ca.DM(self._x_nominal), 1, d)
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
                (start - jump) / self._x_nominal,
                end / self._x_nominal,
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
        effect = ca.Function("effect", self._symbols(), [ca.jacobian(model.ode, actions)])
        zero = [ca.SX.zeros(v.shape) for v in self._symbols()[1:4]]
        nominal = np.concatenate([self._u_nominal, self._f_nominal]) * self.time_nominal
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
            function = ca.Function("row", self._symbols(), [expression])
            values = function.map(d)(x, u, s, f, ca.repmat(p, 1, d))
            if not state_only:
                return ca.mtimes(values, to_coefficients)
            first = function(start, u[:, 0], s[:, 0], f[:, 0], p)
            return ca.mtimes(ca.horzcat(first, values), with_start)

        speeds = coefficients(model.contact_velocities / self._v_nominal, True)
        forces = coefficients(model.forces / self._f_nominal, False)
        # A sliding contact has a bounded speed, a sticking one a bounded force: one row for both.
        stuck = ca.repmat(stick, 1, d)
        rows = [speeds[:, 0], ca.vec((1 - stuck) * speeds[:, :d] + stuck * forces)]
        if self._keeps_ends:
            rows.append(speeds[:, d])
        for bound, state_only in zip(self.problem.along, self._along_state_only(), strict=True):
            row = coefficients(bound.expression / bound.nominal, state_only)
            rows.append(ca.vec(row[:, :d] if state_only and not self._keeps_ends else row))
        return rows

    # -- all arcs --------------------------------------------------------------------------

    def _assemble(self) -> NonlinearProgram:
        problem, mesh, n_x = self.problem, self.mesh, self.problem.model.n_x
        n, n_p, n_c = mesh.total, len(self._p_nominal), len(problem.model.contacts)
        arc = self._arc_function()
        w = ca.MX.sym("w", self._layout.size * n + n_p)
        modes = ca.MX.sym("modes", 3 * n_c, n)
        y = ca.reshape(w[: self._layout.size * n], self._layout.size, n)
        design = w[self._layout.size * n :]
        equal, following, rows, before, end, integrals = arc.map(n)(
            y, modes, ca.repmat(design, 1, n)
        )
        self._sizes = (equal.shape[0], following.shape[0], rows.shape[0])
        periodic = self._periodic_rows()
        finish = ca.Function(
            "finish",
            [*vars(problem.ends).values(), self._symbols()[4]],
            [
                problem.minimise,
                ca.vertcat(ca.SX(0, 1), *(b.expression / b.nominal for b in problem.at_ends)),
            ],
        )
        total = ca.sum2(y[0, :]) * self.time_nominal
        objective, at_ends = finish(
            before[:, 0] * self._x_nominal,
            end[:, n - 1] * self._x_nominal,
            total,
            ca.sum2(integrals),
            design * self._p_nominal,
        )
        constraints = ca.vertcat(
            ca.vec(equal),
            ca.vec(following),
            ca.vec(rows),
            ca.vec(before[:, 1:] - end[:, : n - 1]),
            (end[:, n - 1] - before[:, 0])[periodic] if periodic else ca.MX(0, 1),
            total / self.time_nominal,
            at_ends,
        )
        assert before.shape[0] == n_x
        return NonlinearProgram(w, ca.vec(modes), objective, constraints)

    def _periodic_rows(self) -> list[int]:
        rows, first = [], 0
        for signal in self.problem.model.x:
            if signal.name in self.problem.periodic:
                rows += range(first, first + signal.size)
            first += signal.size
        return rows

    # -- bounds of a mode sequence ---------------------------------------------------------

    def bounds(self, modes: ModeSequence) -> Bounds:
        """Bounds and parameters that make the program one for ``modes``.

        Parameters
        ----------
        modes : ModeSequence
            As many phases as the mesh has.

        Returns
        -------
        Bounds
            For ``nlp.solve``. A contact that sticks keeps its force in the law's interval, one
            that slides keeps its speed from changing sign.

        Raises
        ------
        ValueError
            If the number of phases differs from the mesh's.
        """
        if len(modes.phases) != self.mesh.phases:
            raise ValueError(f"{len(modes.phases)} phases given, the mesh has {self.mesh.phases}")
        states = np.repeat(modes.states, self.mesh.arcs, axis=0)  # (arcs, contacts)
        stick = states == 0
        follow = np.array([self._followers(row) for row in stick]).reshape(stick.shape)
        lbw, ubw = self._variable_bounds(stick)
        lbg, ubg = self._constraint_bounds(states, follow)
        parameters = np.concatenate([stick, np.where(states == 0, 1, states), follow], axis=1)
        return Bounds(lbw, ubw, lbg, ubg, parameters.astype(float).ravel())

    @cached_property
    def _delassus(self) -> np.ndarray:
        model = self.problem.model
        function = ca.Function("delassus", self._symbols(), [model.delassus])
        nominal = [
            self._x_nominal,
            self._u_nominal,
            self._s_nominal,
            self._f_nominal,
            self._p_nominal,
        ]
        return np.asarray(function(*nominal))

    def _followers(self, stick: np.ndarray) -> np.ndarray:
        """Sticking contacts whose force does not move the worm in any new way."""
        follow = np.zeros(len(stick), dtype=bool)
        led: list[int] = []
        for i in np.flatnonzero(stick):
            rows = self._delassus[[*led, i]]
            if np.linalg.matrix_rank(rows, tol=1e-9 * np.abs(rows).max()) > len(led):
                led.append(int(i))
            else:
                follow[i] = True
        return follow

    def _variable_bounds(self, stick: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at, n = self._layout, self.mesh.total
        lower = np.full((at.size, n), -np.inf)
        upper = np.full((at.size, n), np.inf)
        lower[0] = 0.0
        upper[0] = self.problem.duration[1] / self.time_nominal
        x_low, x_high = _limits(tuple(self.problem.model.x))
        lower[at.start], upper[at.start] = x_low[:, None], x_high[:, None]
        n_u = len(self._u_nominal)
        u_low, u_high = _limits(tuple(self.problem.model.u))
        repeats = self.mesh.input_degree + 1
        lower[at.inputs], upper[at.inputs] = (np.tile(v, repeats)[:, None] for v in (u_low, u_high))
        d = self.mesh.collocation.degree
        if self.problem.impulses:
            contact_rows = slice(at.jumps.start + n_u, at.jumps.stop)
            lower[contact_rows] = 0.0
            upper[contact_rows] = np.where(stick.T, np.inf, 0.0)
        s_low, s_high = _limits(tuple(self.problem.slacks))
        lower[at.slacks], upper[at.slacks] = np.tile(s_low, d)[:, None], np.tile(s_high, d)[:, None]
        p_low, p_high = _limits(tuple(self.problem.design))
        return (
            np.concatenate([lower.ravel(order="F"), p_low]),
            np.concatenate([upper.ravel(order="F"), p_high]),
        )

    def _constraint_bounds(
        self, states: np.ndarray, follow: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        n, n_x = self.mesh.total, self.problem.model.n_x
        n_equal, n_following, n_rows = self._sizes
        rows = [self._row_bounds(states, k) for k in range(n)]
        held = np.where(np.tile(follow, (1, self.mesh.input_degree + 1)), 0.0, np.inf)
        held = held if n_following else np.zeros((n, 0))
        n_exact = n_x * (n - 1) + len(self._periodic_rows())
        shortest, longest = self.problem.duration
        ends = [b.scaled for b in self.problem.at_ends]
        parts_low = [
            np.zeros(n_equal * n),
            -held.ravel(),
            *(low for low, _ in rows),
            np.zeros(n_exact),
            [shortest / self.time_nominal],
            *(low for low, _ in ends),
        ]
        parts_high = [
            np.zeros(n_equal * n),
            held.ravel(),
            *(high for _, high in rows),
            np.zeros(n_exact),
            [longest / self.time_nominal],
            *(high for _, high in ends),
        ]
        assert sum(len(r[0]) for r in rows) == n_rows * n
        return np.concatenate(parts_low), np.concatenate(parts_high)

    def _row_bounds(self, states: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of arc k's bounded rows; nothing is stated twice, nor beside an equality."""
        model, d = self.problem.model, self.mesh.collocation.degree
        now, before = states[k], states[k - 1]
        begins = k == 0 and not self.problem.periodic
        ends = self.problem.impulses or k == self.mesh.total - 1
        always = (states == 0).all(axis=0) & (k == 0)
        turns = (now * before == -1) & (not begins)
        fresh = (now == 0) & ((before != 0) | begins | always | self.problem.impulses) | turns
        start = np.where(fresh, 0.0, np.inf)
        intervals = np.array([c.law.stick_interval for c in model.contacts]).reshape(-1, 2)
        hold = intervals / self._f_nominal[:, None]
        low = np.repeat(
            np.where(now == 0, hold[:, 0], np.where(now > 0, 0, -np.inf))[:, None], d, 1
        )
        high = np.repeat(
            np.where(now == 0, hold[:, 1], np.where(now > 0, np.inf, 0))[:, None], d, 1
        )
        if not (begins or self.problem.impulses):  # its speed starts at 0 by an equality
            settled = (now != 0) & ((before == 0) | turns)
            low[settled, 0], high[settled, 0] = -np.inf, np.inf
        lows, highs = [-start, low.ravel(order="F")], [start, high.ravel(order="F")]
        if self._keeps_ends:
            lows.append(np.where((now > 0) & ends, 0.0, -np.inf))
            highs.append(np.where((now < 0) & ends, 0.0, np.inf))
        for bound, state_only in zip(self.problem.along, self._along_state_only(), strict=True):
            columns = d + (state_only and self._keeps_ends)
            for value, out, free in zip(
                bound.scaled, (lows, highs), (-np.inf, np.inf), strict=True
            ):
                box = np.repeat(value[:, None], columns, axis=1)
                if columns > d and not ends:
                    box[:, d] = free
                out.append(box.ravel(order="F"))
        return np.concatenate(lows), np.concatenate(highs)

    # -- variables in and out --------------------------------------------------------------

    def unpack(self, w: np.ndarray) -> Arcs:
        """Read the program's variables back in the model's units.

        Parameters
        ----------
        w : ndarray, shape (n_w,)
            Variables of ``nlp``.

        Returns
        -------
        Arcs
        """
        at, n, d = self._layout, self.mesh.total, self.mesh.collocation.degree
        y = w[: at.size * n].reshape((at.size, n), order="F")

        def block(rows: slice, nominal: np.ndarray, columns: int) -> np.ndarray:
            shape = (len(nominal), columns, n)
            return y[rows].reshape(shape, order="F") * nominal[:, None, None]

        return Arcs(
            duration=y[0] * self.time_nominal,
            start=y[at.start] * self._x_nominal[:, None],
            points=block(at.points, self._x_nominal, d),
            inputs=block(at.inputs, self._u_nominal, self.mesh.input_degree + 1),
            slacks=block(at.slacks, self._s_nominal, d),
            forces=block(at.forces, self._f_nominal, d),
            jumps=y[at.jumps],
            design=w[at.size * n :] * self._p_nominal,
            phase=np.repeat(np.arange(self.mesh.phases), self.mesh.arcs),
        )

    def pack(self, arcs: Arcs) -> np.ndarray:
        """Write a motion on this mesh into the program's variables; the inverse of `unpack`.

        Parameters
        ----------
        arcs : Arcs
            Motion on this program's mesh; `refine` brings it there from a coarser one.

        Returns
        -------
        ndarray, shape (n_w,)
        """

        def block(values: np.ndarray, nominal: np.ndarray) -> np.ndarray:
            scaled = values / nominal[:, None, None]
            return scaled.reshape((-1, self.mesh.total), order="F")

        y = np.vstack(
            [
                arcs.duration / self.time_nominal,
                arcs.start / self._x_nominal[:, None],
                block(arcs.points, self._x_nominal),
                block(arcs.inputs, self._u_nominal),
                block(arcs.slacks, self._s_nominal),
                block(arcs.forces, self._f_nominal),
                arcs.jumps,
            ]
        )
        return np.concatenate([y.ravel(order="F"), arcs.design / self._p_nominal])

    def rest(self, durations: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Variables of a worm that does not move, on arcs of given durations.

        Parameters
        ----------
        durations : ndarray, shape (arcs,)
            Duration of every arc.
        start : ndarray, shape (n_x,)
            State at which it rests.

        Returns
        -------
        ndarray, shape (n_w,)
            A start from which `NonlinearProgram.linear_step` finds the best motion with these
            durations, where the model is linear.
        """
        at, n = self._layout, self.mesh.total
        y = np.zeros((at.size, n))
        y[0] = durations / self.time_nominal
        y[at.start] = (start / self._x_nominal)[:, None]
        y[at.points] = np.tile(start / self._x_nominal, self.mesh.collocation.degree)[:, None]
        return np.concatenate([y.ravel(order="F"), np.zeros(len(self._p_nominal))])

    def nominal_extras(self) -> dict[str, np.ndarray]:
        """Slacks and design constants at their nominal sizes: what a motion does not tell.

        Returns
        -------
        dict of str to ndarray
            ``slacks`` (n_s, degree, arcs) and ``design`` (n_p,), to put into `Arcs`.
        """
        shape = (1, self.mesh.collocation.degree, self.mesh.total)
        return {
            "slacks": np.tile(self._s_nominal[:, None, None], shape),
            "design": self._p_nominal.copy(),
        }

    def hold_durations(self, free: float = np.inf) -> np.ndarray:
        """Radius of `NonlinearProgram.linear_step` that fixes all durations.

        Parameters
        ----------
        free : float, optional
            Radius of all other variables, scaled.

        Returns
        -------
        ndarray, shape (n_w,)
            0 for durations, ``free`` elsewhere.
        """
        radius = np.full((self._layout.size, self.mesh.total), free)
        radius[0] = 0.0
        return np.concatenate([radius.ravel(order="F"), np.full(len(self._p_nominal), free)])

    def refine(self, arcs: Arcs, mesh: Mesh) -> Arcs:
        """Represent a motion of this mesh on a finer one: more arcs of equal parts, higher degrees.

        Parameters
        ----------
        arcs : Arcs
            Motion on this program's mesh.
        mesh : Mesh
            As many phases, a multiple of the arcs, no lower degrees.

        Returns
        -------
        Arcs
            The same motion; impulses stay at the start of the first part of their arc.
        """
        split = mesh.arcs // self.mesh.arcs
        with_start = np.concatenate([[0.0], self.mesh.collocation.tau])
        states = np.concatenate([arcs.start[:, None], arcs.points], axis=1)
        parts = [(np.arange(split) + offset) / split for offset in (0.0, 1.0)]

        def on(nodes: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
            """Values of the interpolant at targets within each part: (rows, targets, N split)."""
            at = parts[0][:, None] + (parts[1] - parts[0])[:, None] * targets
            matrix = _interpolation(nodes, at.ravel())
            fine = np.einsum("tk,rkn->rnt", matrix, values)
            shape = (values.shape[0], values.shape[2] * split, len(targets))
            return np.swapaxes(fine.reshape(shape), 1, 2)

        old, new = self.mesh.collocation.tau, mesh.collocation.tau
        inputs = np.einsum(
            "tk,rkn->rtn", np.linalg.inv(bernstein_matrix(self.mesh.input_nodes)), arcs.inputs
        )
        fine_inputs = on(self.mesh.input_nodes, inputs, mesh.input_nodes)
        jumps = np.zeros((arcs.jumps.shape[0], mesh.total))
        jumps[:, ::split] = arcs.jumps
        return Arcs(
            duration=np.repeat(arcs.duration / split, split),
            start=on(with_start, states, np.zeros(1))[:, 0],
            points=on(with_start, states, new),
            inputs=np.einsum("tk,rkn->rtn", bernstein_matrix(mesh.input_nodes), fine_inputs),
            slacks=on(old, arcs.slacks, new),
            forces=on(old, arcs.forces, new),
            jumps=jumps,
            design=arcs.design,
            phase=np.repeat(np.arange(mesh.phases), mesh.arcs),
        )


def _interpolation(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to values of the interpolating polynomial at targets."""
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    return np.linalg.solve(basis.T, np.polynomial.legendre.legvander(2 * targets - 1, degree).T).T
