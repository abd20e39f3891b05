"""Collocation over contact phases with free durations: any Model, any mode sequence.

Every phase is a row of arcs; on an arc the states are polynomials (collocation), the inputs
polynomials of lower degree. The contact modes enter as parameters, so one nonlinear program
serves all sequences of as many phases. Bounds are put on Bernstein coefficients: they hold at
every instant of the polynomials, not only at nodes.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.core.modes import ModeSequence
from wormopt.optimal.arc import Arc, limits_of
from wormopt.optimal.mesh import Arcs, Mesh
from wormopt.optimal.nlp import Bounds, NonlinearProgram
from wormopt.optimal.problem import Problem

__all__ = ["PhaseProgram"]


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

    >>> from wormopt.core.model import Model, Signal
    >>> from wormopt.optimal.collocation import Collocation
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
        self.problem, self.mesh = problem, mesh
        self.arc = Arc(problem, mesh)
        self.nlp = self._assemble()

    # -- all arcs --------------------------------------------------------------------------

    def _assemble(self) -> NonlinearProgram:
        problem, mesh, n_x = self.problem, self.mesh, self.problem.model.n_x
        n, n_p, n_c = mesh.total, len(self.arc.p_nominal), len(problem.model.contacts)
        arc = self.arc.function
        w = ca.MX.sym("w", self.arc.layout.size * n + n_p)
        modes = ca.MX.sym("modes", 3 * n_c, n)
        y = ca.reshape(w[: self.arc.layout.size * n], self.arc.layout.size, n)
        design = w[self.arc.layout.size * n :]
        equal, following, rows, before, end, integrals = arc.map(n)(
            y, modes, ca.repmat(design, 1, n)
        )
        self._sizes = (equal.shape[0], following.shape[0], rows.shape[0])
        periodic = self._periodic_rows()
        finish = ca.Function(
            "finish",
            [*vars(problem.ends).values(), self.arc.symbols[4]],
            [
                problem.minimise,
                ca.vertcat(ca.SX(0, 1), *(b.expression / b.nominal for b in problem.at_ends)),
            ],
        )
        total = ca.sum2(y[0, :]) * self.arc.time_nominal
        objective, at_ends = finish(
            before[:, 0] * self.arc.x_nominal,
            end[:, n - 1] * self.arc.x_nominal,
            total,
            ca.sum2(integrals),
            design * self.arc.p_nominal,
        )
        constraints = ca.vertcat(
            ca.vec(equal),
            ca.vec(following),
            ca.vec(rows),
            ca.vec(before[:, 1:] - end[:, : n - 1]),
            (end[:, n - 1] - before[:, 0])[periodic] if periodic else ca.MX(0, 1),
            total / self.arc.time_nominal,
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
        function = ca.Function("delassus", self.arc.symbols, [model.delassus])
        nominal = [
            self.arc.x_nominal,
            self.arc.u_nominal,
            self.arc.s_nominal,
            self.arc.f_nominal,
            self.arc.p_nominal,
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
        at, n = self.arc.layout, self.mesh.total
        lower = np.full((at.size, n), -np.inf)
        upper = np.full((at.size, n), np.inf)
        lower[0] = 0.0
        upper[0] = self.problem.duration[1] / self.arc.time_nominal
        x_low, x_high = limits_of(self.problem.model.x)
        lower[at.start], upper[at.start] = x_low[:, None], x_high[:, None]
        n_u = len(self.arc.u_nominal)
        u_low, u_high = limits_of(self.problem.model.u)
        repeats = self.mesh.input_degree + 1
        lower[at.inputs], upper[at.inputs] = (np.tile(v, repeats)[:, None] for v in (u_low, u_high))
        d = self.mesh.collocation.degree
        if self.problem.impulses:
            contact_rows = slice(at.jumps.start + n_u, at.jumps.stop)
            lower[contact_rows] = 0.0
            upper[contact_rows] = np.where(stick.T, np.inf, 0.0)
        s_low, s_high = limits_of(self.problem.slacks)
        lower[at.slacks], upper[at.slacks] = np.tile(s_low, d)[:, None], np.tile(s_high, d)[:, None]
        p_low, p_high = limits_of(self.problem.design)
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
            [shortest / self.arc.time_nominal],
            *(low for low, _ in ends),
        ]
        parts_high = [
            np.zeros(n_equal * n),
            held.ravel(),
            *(high for _, high in rows),
            np.zeros(n_exact),
            [longest / self.arc.time_nominal],
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
        hold = intervals / self.arc.f_nominal[:, None]
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
        if self.arc.keeps_ends:
            lows.append(np.where((now > 0) & ends, 0.0, -np.inf))
            highs.append(np.where((now < 0) & ends, 0.0, np.inf))
        for bound, state_only in zip(self.problem.along, self.arc.state_only, strict=True):
            columns = d + (state_only and self.arc.keeps_ends)
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
        at, n, d = self.arc.layout, self.mesh.total, self.mesh.collocation.degree
        y = w[: at.size * n].reshape((at.size, n), order="F")

        def block(rows: slice, nominal: np.ndarray, columns: int) -> np.ndarray:
            shape = (len(nominal), columns, n)
            return y[rows].reshape(shape, order="F") * nominal[:, None, None]

        return Arcs(
            duration=y[0] * self.arc.time_nominal,
            start=y[at.start] * self.arc.x_nominal[:, None],
            points=block(at.points, self.arc.x_nominal, d),
            inputs=block(at.inputs, self.arc.u_nominal, self.mesh.input_degree + 1),
            slacks=block(at.slacks, self.arc.s_nominal, d),
            forces=block(at.forces, self.arc.f_nominal, d),
            jumps=y[at.jumps],
            design=w[at.size * n :] * self.arc.p_nominal,
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
                arcs.duration / self.arc.time_nominal,
                arcs.start / self.arc.x_nominal[:, None],
                block(arcs.points, self.arc.x_nominal),
                block(arcs.inputs, self.arc.u_nominal),
                block(arcs.slacks, self.arc.s_nominal),
                block(arcs.forces, self.arc.f_nominal),
                arcs.jumps,
            ]
        )
        return np.concatenate([y.ravel(order="F"), arcs.design / self.arc.p_nominal])

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
        at, n = self.arc.layout, self.mesh.total
        y = np.zeros((at.size, n))
        y[0] = durations / self.arc.time_nominal
        y[at.start] = (start / self.arc.x_nominal)[:, None]
        y[at.points] = np.tile(start / self.arc.x_nominal, self.mesh.collocation.degree)[:, None]
        return np.concatenate([y.ravel(order="F"), np.zeros(len(self.arc.p_nominal))])

    def nominal_extras(self) -> dict[str, np.ndarray]:
        """Slacks and design constants at their nominal sizes: what a motion does not tell.

        Returns
        -------
        dict of str to ndarray
            ``slacks`` (n_s, degree, arcs) and ``design`` (n_p,), to put into `Arcs`.
        """
        shape = (1, self.mesh.collocation.degree, self.mesh.total)
        return {
            "slacks": np.tile(self.arc.s_nominal[:, None, None], shape),
            "design": self.arc.p_nominal.copy(),
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
        radius = np.full((self.arc.layout.size, self.mesh.total), free)
        radius[0] = 0.0
        return np.concatenate([radius.ravel(order="F"), np.full(len(self.arc.p_nominal), free)])
