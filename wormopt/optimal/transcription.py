"""Direct collocation: the nonlinear program of a Problem on a Mesh, for any Model.

Every phase is a row of arcs; on an arc the states are polynomials (collocation), the inputs
polynomials of lower degree. Arcs are free in duration, or have fixed shares of their phase, whose
duration may be free. What contacts do enters by parameters, so that one nonlinear program serves
all mode sequences of as many phases, all widths of a smoothed law, all relaxations of a
complementarity. Bounds are put on Bernstein coefficients: they hold at every instant of the
polynomials, not only at nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.core.modes import ModeSequence
from wormopt.core.values import signal_values
from wormopt.optimal.arc import Arc, limits_of
from wormopt.optimal.contact import Prescribed, Treatment
from wormopt.optimal.mesh import Arcs, Mesh, interpolation
from wormopt.optimal.nlp import Bounds, NonlinearProgram
from wormopt.optimal.problem import Problem

__all__ = ["Transcription"]


class Transcription:
    """The nonlinear program of a problem on a mesh, with contacts treated in one of three ways.

    Parameters
    ----------
    problem : Problem
        What to optimise.
    mesh : Mesh
        Phases, arcs and polynomials.
    treatment : Treatment, optional
        How contacts are treated: prescribed modes where nothing is said.

    Raises
    ------
    ValueError
        If impulses are asked for without prescribed modes.

    Notes
    -----
    Attributes ``problem`` and ``mesh`` are those given, ``nlp`` is the NonlinearProgram. Its
    variables are scaled by nominal sizes: arc after arc the rows of `Layout`, then the design
    constants.

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
    >>> program = Transcription(problem, Mesh(phases=1, arcs=2, collocation=Collocation(2)))
    >>> bounds = program.bounds(ModeSequence(((),)))  # one phase, no contacts
    >>> start = program.rest(np.ones(2), np.zeros(2))
    >>> arcs = program.unpack(program.nlp.solve(start, bounds, Ipopt()).w)
    >>> arcs.duration.round(6), arcs.inputs.ravel().round(6)
    (array([1., 1.]), array([ 1., -1.]))
    """

    def __init__(self, problem: Problem, mesh: Mesh, treatment: Treatment | None = None) -> None:
        self.problem, self.mesh = problem, mesh
        self.treatment = treatment or Prescribed()
        self.arc = Arc(problem, mesh, self.treatment)
        self.nlp = self._assemble()

    # -- all arcs --------------------------------------------------------------------------

    def _assemble(self) -> NonlinearProgram:
        at, n, arc = self.arc.layout, self.mesh.total, self.arc.function
        n_integrals = self.problem.integrands.numel()
        sizes = [at.size * n, self.problem.model.n_x, 1, n_integrals, len(self.arc.design_nominal)]
        w = ca.MX.sym("w", sum(sizes))
        arcs, last, total, tally, design = ca.vertsplit(w, np.cumsum([0, *sizes]).tolist())
        levels, schedules, _, p = (
            ca.MX.sym(name, c.numel() * (n if k < 2 else 1))
            for k, (name, c) in enumerate(
                zip(("levels", "schedules", "design", "p"), self.arc.constants, strict=True)
            )
        )
        y = ca.reshape(arcs, at.size, n)
        equal, small, following, rows, before, end, integrals = arc.map(n)(
            y,
            ca.reshape(levels, -1, n),
            ca.reshape(schedules, -1, n),
            ca.repmat(design, 1, n),
            ca.repmat(p, 1, n),
        )
        # Ends, duration and integrals are variables of their own: an objective that couples them
        # would otherwise couple all arcs, and fill the Hessian.
        totals = ca.vertcat(end[:, n - 1], ca.sum2(y[0, :]), ca.sum2(integrals))
        joints = ca.vertcat(
            self._joints(y, before, end, last), ca.vertcat(last, total, tally) - totals
        )
        self._sizes = {
            "joints": joints.shape[0],
            "equal": equal.shape[0],
            "small": small.shape[0],
            "following": following.shape[0],
            "rows": rows.shape[0],
        }
        constraints = ca.vertcat(
            ca.vec(equal),
            ca.vec(small),
            ca.vec(following),
            ca.vec(rows),
            joints,
        )
        objective, at_ends = self._finish(before[:, 0], last, total, tally, design, p)
        parameters = ca.vertcat(levels, schedules, p)
        self._totals = ca.Function("totals", [w, parameters], [totals])
        return NonlinearProgram(w, parameters, objective, ca.vertcat(constraints, at_ends))

    def _joints(self, y: ca.MX, before: ca.MX, end: ca.MX, last: ca.MX) -> ca.MX:
        """What vanishes where arcs join: states, clocks, shares of durations, the period."""
        n, at = self.mesh.total, self.arc.layout
        parts = [ca.vec(before[:, 1:] - end[:, : n - 1])]
        if self.arc.timed:
            parts.append((y[at.clock, 1:] - y[at.clock, : n - 1] - y[0, : n - 1]).T)
        if self.mesh.shares is not None and not self._fixed_grid:
            first = np.searchsorted(self.mesh.phase, self.mesh.phase)
            share = np.array(self.mesh.shares)
            later = [k for k in range(n) if first[k] != k]
            parts += [y[0, k] * share[first[k]] - y[0, int(first[k])] * share[k] for k in later]
        change = last - before[:, 0]
        if self._periodic_rows:
            parts.append(change[self._periodic_rows])
        for rows in self._displaced_rows:
            parts.append(change[rows[1:]] - change[rows[0]])
        return ca.vertcat(*parts)

    def _finish(
        self, first: ca.MX, last: ca.MX, total: ca.MX, tally: ca.MX, design: ca.MX, p: ca.MX
    ) -> tuple[ca.MX, ca.MX]:
        """Objective and bounds at the ends."""
        problem = self.problem
        bounded = (b.expression / b.nominal for b in problem.at_ends)
        finish = ca.Function(
            "finish",
            [*vars(problem.ends).values(), *self.arc.constants[2:]],
            [problem.minimise, ca.vertcat(ca.SX(0, 1), *bounded)],
        )
        objective, at_ends = finish(
            first * self.arc.x_nominal,
            last * self.arc.x_nominal,
            total * self.arc.time_nominal,
            tally,
            design * self.arc.design_nominal,
            p,
        )
        return objective, at_ends

    @cached_property
    def _fixed_grid(self) -> bool:
        """Whether the durations of all arcs are known beforehand."""
        shortest, longest = self.problem.duration
        return self.mesh.shares is not None and self.mesh.phases == 1 and shortest == longest

    def rows_of(self, name: str) -> list[int]:
        """Rows of the state called ``name`` among all scalar states.

        Parameters
        ----------
        name : str
            Name of a state.

        Returns
        -------
        list of int

        Raises
        ------
        ValueError
            If there is no such state.
        """
        first = 0
        for signal in self.problem.model.x:
            if signal.name == name:
                return list(range(first, first + signal.size))
            first += signal.size
        raise ValueError(f"{self.problem.model.name} has no state {name!r}")

    @cached_property
    def _periodic_rows(self) -> list[int]:
        return [row for name in self.problem.periodic for row in self.rows_of(name)]

    @cached_property
    def _displaced_rows(self) -> list[list[int]]:
        rows = [self.rows_of(name) for name in self.problem.displaced]
        return [r for r in rows if len(r) > 1]

    # -- bounds ----------------------------------------------------------------------------

    def bounds(
        self,
        level: ModeSequence | float = 0.0,
        *,
        p: Mapping[str, ArrayLike] | None = None,
        pins: Mapping[int, float] | None = None,
        active: Sequence[Sequence[int]] | None = None,
    ) -> Bounds:
        """Bounds and parameters of the program for given modes, width or relaxation.

        Parameters
        ----------
        level : ModeSequence or float, optional
            What the treatment of contacts takes: modes, ``v_reg``, or the relaxation of
            complementarity.
        p : mapping of str to array_like, optional
            Parameters of the model by name, where they are not its own.
        pins : mapping of int to float, optional
            Times at which phases begin, by their number. Each phase takes of the model's
            schedules the piece that holds at the last of these times up to it; on a fixed grid
            each arc takes its own.
        active : sequence of sequences of int, optional
            Per phase and input: -1 holds it at its lower limit, +1 at its upper one, 0 leaves it
            free.

        Returns
        -------
        Bounds
            For ``nlp.solve``. With prescribed modes a contact that sticks keeps its force in the
            law's interval, one that slides keeps its speed from changing sign.

        Raises
        ------
        ValueError
            If the number of phases differs from the mesh's, or a schedule breaks within an arc.
        """
        n, at = self.mesh.total, self.arc.layout
        fixed = signal_values(self.problem.model.p, p, "parameter")
        lower, upper = self._variable_bounds(fixed)
        starts = self._pin_times(lower, upper, pins)
        if active is not None:
            self._hold_inputs(lower, upper, np.array(active)[self.mesh.phase].T)
        if self.arc.modal:
            levels, following, rows = self._modal(level, fixed, lower, upper)
        else:
            levels = np.full(n * self.arc.closure.level.numel(), level)
            following, rows = np.zeros(0), self._row_bounds(None, fixed)
        small = np.full(self._sizes["small"] * n, levels[0] if len(levels) else 0.0)
        parts = [
            (np.zeros(self._sizes["equal"] * n), np.zeros(self._sizes["equal"] * n)),
            (-small, small),
            (-following, following),
            rows,
            (np.zeros(self._sizes["joints"]), np.zeros(self._sizes["joints"])),
            *(b.scaled for b in self.problem.at_ends),
        ]
        lbg, ubg = (np.concatenate([part[k] for part in parts]) for k in range(2))
        design = limits_of(self.problem.design)
        totals = self._total_bounds()
        lbw, ubw = (
            np.concatenate([box.ravel(order="F"), total, d])
            for box, total, d in zip((lower, upper), totals, design, strict=True)
        )
        assert lower.shape == (at.size, n)
        parameters = np.concatenate([levels, self._schedules(starts), fixed])
        return Bounds(lbw, ubw, lbg, ubg, parameters)

    def _variable_bounds(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boxes of all arcs' variables, shape (size, n)."""
        arc, at, n = self.arc, self.arc.layout, self.mesh.total
        lower, upper = np.full((at.size, n), -np.inf), np.full((at.size, n), np.inf)
        lower[0], upper[0] = 0.0, self.problem.duration[1] / arc.time_nominal
        d = self.mesh.collocation.degree
        blocks = [
            (at.start, limits_of(self.problem.model.x), 1),
            (at.inputs, limits_of(self.problem.model.u), self.mesh.input_degree + 1),
            (at.slacks, limits_of(self.problem.slacks), d),
            (at.algebraic, limits_of(self.problem.model.z), d),
            (at.unknowns, arc.unknown_limits(p), d),
        ]
        for rows, (low, high), repeats in blocks:
            lower[rows] = np.tile(low, repeats)[:, None]
            upper[rows] = np.tile(high, repeats)[:, None]
        return lower, upper

    def _total_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of ends, duration and integrals: only the duration has some of its own."""
        high = np.full(self._totals.size1_out(0), np.inf)
        low = -high
        if not self._fixed_grid:
            row = self.problem.model.n_x
            low[row], high[row] = np.array(self.problem.duration) / self.arc.time_nominal
        return low, high

    def _hold_inputs(self, lower: np.ndarray, upper: np.ndarray, active: np.ndarray) -> None:
        """Hold inputs at their limits where ``active``, shape (n_u, N), says so."""
        rows = self.arc.layout.inputs
        held = np.tile(active, (self.mesh.input_degree + 1, 1))
        lower[rows] = np.where(held > 0, upper[rows], lower[rows])
        upper[rows] = np.where(held < 0, lower[rows], upper[rows])

    def _pin_times(
        self, lower: np.ndarray, upper: np.ndarray, pins: Mapping[int, float] | None
    ) -> np.ndarray:
        """Fix durations and clocks that are known; times by which schedules are looked up."""
        n, at, nominal = self.mesh.total, self.arc.layout, self.arc.time_nominal
        if self._fixed_grid:
            duration = np.array(self.mesh.shares) * self.problem.duration[1]
            begin = np.concatenate([[0.0], np.cumsum(duration)[:-1]])
            lower[0] = upper[0] = duration / nominal
            if self.arc.timed:
                lower[at.clock] = upper[at.clock] = begin / nominal
            self._check_breaks(begin, duration)
            return begin
        times = {0: 0.0, **(pins or {})}
        first = np.searchsorted(self.mesh.phase, np.arange(self.mesh.phases))
        if self.arc.timed:
            for phase, time in times.items():
                lower[at.clock, first[phase]] = upper[at.clock, first[phase]] = time / nominal
        known = np.array(sorted(times))
        last = np.searchsorted(known, self.mesh.phase, side="right") - 1
        assert len(last) == n
        return np.array([times[k] for k in known])[last]

    def _check_breaks(self, begin: np.ndarray, duration: np.ndarray) -> None:
        slack = 1e-9 * duration
        for schedule in self.problem.model.schedules:
            _, there = schedule.locate(begin + slack)
            since, piece = schedule.locate(begin + duration - slack)
            if np.any(there != piece) or np.any(since > begin + slack):
                raise ValueError(
                    f"the {schedule.name} breaks within an arc; put its breaks between arcs "
                    "(Mesh.over)"
                )

    def _schedules(self, starts: np.ndarray) -> np.ndarray:
        """Values of schedules, arc after arc."""
        columns = []
        for schedule in self.problem.model.schedules:
            begin, piece = schedule.locate(starts)
            columns += [begin[:, None], schedule.values[piece]]
        return np.hstack(columns).ravel() if columns else np.zeros(0)

    # -- bounds of prescribed modes ----------------------------------------------------------

    def _modal(
        self, modes: ModeSequence | float, p: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Levels, slack of followers and bounded rows of a mode sequence; impulses' bounds."""
        if not isinstance(modes, ModeSequence):
            raise TypeError("prescribed contacts need a ModeSequence")
        if len(modes.phases) != self.mesh.phases:
            raise ValueError(f"{len(modes.phases)} phases given, the mesh has {self.mesh.phases}")
        states = modes.states[self.mesh.phase]  # (arcs, contacts)
        stick = states == 0
        follow = np.array([self._followers(row) for row in stick]).reshape(stick.shape)
        if self.problem.impulses:
            jumps = self.arc.layout.jumps
            contacts = slice(jumps.stop - states.shape[1], jumps.stop)
            lower[contacts], upper[contacts] = 0.0, np.where(stick.T, np.inf, 0.0)
        levels = np.concatenate([stick, np.where(stick, 1, states), follow], axis=1)
        held = np.where(np.tile(follow, (1, self.mesh.input_degree + 1)), 0.0, np.inf)
        held = held if self._sizes["following"] else np.zeros((len(states), 0))
        return levels.astype(float).ravel(), held.ravel(), self._row_bounds(states, p)

    @cached_property
    def _delassus(self) -> np.ndarray:
        function = ca.Function("delassus", self.arc.symbols, [self.problem.model.delassus])
        arc = self.arc
        constants = [np.ones(c.shape) for c in arc.constants[:2]]
        fixed = signal_values(self.problem.model.p, {}, "parameter", fill=1.0)
        return np.asarray(function(0.0, *arc.nominals, *constants, arc.design_nominal, fixed))

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

    def _row_bounds(
        self, states: np.ndarray | None, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of all bounded rows, arc after arc; nothing is stated twice."""
        lows, highs = [np.zeros(0)], [np.zeros(0)]
        hold = self.arc.rests(p)
        for k in range(self.mesh.total):
            for box in [*self._contact_rows(states, hold, k), *self._along_rows(k)]:
                lows.append(box[0].ravel(order="F"))
                highs.append(box[1].ravel(order="F"))
        return np.concatenate(lows), np.concatenate(highs)

    def _contact_rows(
        self, states: np.ndarray | None, hold: np.ndarray, k: int
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Bounds on speeds and forces of the contacts in arc k, none beside an equality."""
        if states is None:
            return []
        d = self.mesh.collocation.degree
        now, before = states[k], states[k - 1]
        begins = k == 0 and not self._returns
        ends = self.problem.impulses or k == self.mesh.total - 1
        always = (states == 0).all(axis=0) & (k == 0)
        # without impulses a velocity that turns passes through 0
        turns = (now * before == -1) & (not begins) & (not self.problem.impulses)
        fresh = (now == 0) & ((before != 0) | begins | always | self.problem.impulses) | turns
        start = np.where(fresh, 0.0, np.inf)
        low = np.repeat(
            np.where(now == 0, hold[:, 0], np.where(now > 0, 0, -np.inf))[:, None], d, 1
        )
        high = np.repeat(
            np.where(now == 0, hold[:, 1], np.where(now > 0, np.inf, 0))[:, None], d, 1
        )
        if not (begins or self.problem.impulses):  # its speed starts at 0 by an equality
            settled = (now != 0) & ((before == 0) | turns)
            low[settled, 0], high[settled, 0] = -np.inf, np.inf
        rows = [(-start, start), (low, high)]
        if self.arc.keeps_ends:
            last = np.where((now > 0) & ends, 0.0, -np.inf), np.where((now < 0) & ends, 0.0, np.inf)
            rows.append(last)
        return rows

    def _along_rows(self, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Bounds along arc k."""
        d = self.mesh.collocation.degree
        ends = self.problem.impulses or k == self.mesh.total - 1
        rows = []
        for bound, state_only in zip(self.problem.along, self.arc.state_only, strict=True):
            columns = d + (state_only and self.arc.keeps_ends)
            boxes = []
            for value, free in zip(bound.scaled, (-np.inf, np.inf), strict=True):
                box = np.repeat(value[:, None], columns, axis=1)
                if columns > d and not ends:
                    box[:, d] = free
                boxes.append(box)
            rows.append((boxes[0], boxes[1]))
        return rows

    @property
    def _returns(self) -> bool:
        """Whether the end of the motion is its start again, at least for the contacts' speeds."""
        return bool(self.problem.periodic)

    def name_of(self, row: int) -> str:
        """What a row of the constraints is about, in words.

        Parameters
        ----------
        row : int
            Row of the program's constraints.

        Returns
        -------
        str
        """
        n = self.mesh.total
        names = ["the equations of motion or of contact", "complementarity", "sharing of load"]
        sizes = [n * self._sizes[k] for k in ("equal", "small", "following")]
        per_arc: list[str] = []
        along = sum(box[0].size for box in self._along_rows(0))
        per_arc += ["a contact's mode"] * (self._sizes["rows"] - along)
        for bound, box in zip(self.problem.along, self._along_rows(0), strict=True):
            per_arc += [bound.name] * box[0].size
        if row < sum(sizes):
            return names[int(np.searchsorted(np.cumsum(sizes), row, side="right"))]
        row -= sum(sizes)
        if row < n * len(per_arc):
            return per_arc[row % len(per_arc)]
        row -= n * len(per_arc)
        ends = [b.name for b in self.problem.at_ends for _ in range(b.expression.numel())]
        rest = ["continuity or the period"] * self._sizes["joints"] + ends
        return rest[row]

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
        """Write a motion on this mesh into the program's variables; the inverse of `unpack`.

        Parameters
        ----------
        arcs : Arcs
            Motion on this program's mesh; `on_finer_mesh` brings it there from a coarser one.
        bounds : Bounds, optional
            With whose parameters integrals are evaluated; they are zero where nothing is said.

        Returns
        -------
        ndarray, shape (n_w,)
        """

        def block(values: np.ndarray, nominal: np.ndarray) -> np.ndarray:
            scaled = values / nominal[:, None, None]
            return scaled.reshape((-1, self.mesh.total), order="F")

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
        """Variables of the program: those of the arcs, what they amount to, design constants."""
        n_x, n_totals = self.problem.model.n_x, self._totals.size1_out(0)
        w = np.concatenate([y.ravel(order="F"), np.zeros(n_totals), design])
        totals = slice(y.size, y.size + n_totals)
        if bounds is not None:
            w[totals] = np.asarray(self._totals(w, bounds.p)).ravel()
            return w
        points = y[self.arc.layout.points, -1].reshape((n_x, -1), order="F")
        values = np.column_stack([y[self.arc.layout.start, -1], points])
        nodes = np.concatenate([[0.0], self.mesh.collocation.tau])
        w[totals.start : totals.start + n_x] = values @ interpolation(nodes, np.ones(1))[0]
        w[totals.start + n_x] = y[0].sum()
        return w

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
        y[at.clock] = np.cumsum(y[0]) - y[0]
        y[at.start] = (start / self.arc.x_nominal)[:, None]
        y[at.points] = np.tile(start / self.arc.x_nominal, self.mesh.collocation.degree)[:, None]
        return self._with_totals(y, np.zeros(len(self.arc.design_nominal)), None)

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
            "design": self.arc.design_nominal.copy(),
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
        rest = self._totals.size1_out(0) + len(self.arc.design_nominal)
        return np.concatenate([radius.ravel(order="F"), np.full(rest, free)])
