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
from wormopt.model.values import signal_values
from wormopt.ocp.arc import Arc, limits_of
from wormopt.ocp.contact import FixedModes, Treatment
from wormopt.ocp.mesh import Arcs, Mesh, interpolation
from wormopt.ocp.nlp import Bounds, NonlinearProgram
from wormopt.ocp.problem import Problem

# Distance inside an arc, as a share of it, at which schedules are evaluated: sums of durations
# miss breaks by round-off.
_WITHIN = 1e-9
# Weight of differences between neighbouring arcs of free duration within spans.
_EVEN = 1e-6

Prices = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Derivatives by lower and by upper bounds, one for each entry, by the names of the bounds."""


class ProgramBounds:
    """Bounds of the nonlinear program of a `Transcription`, for any modes or level.

    `sizes`: rows per arc of each kind of constraint, of joints in all; `n_totals`: number of
    variables for ends, duration and integrals.
    """

    def __init__(self, arc: Arc, sizes: Mapping[str, int], n_totals: int) -> None:
        self.arc, self.problem, self.mesh = arc, arc.problem, arc.mesh
        self._sizes, self._n_totals = sizes, n_totals

    def bounds(
        self,
        level: ModeSequence | float,
        p: Mapping[str, ArrayLike] | None,
        pins: Mapping[int, float] | None,
        active: Sequence[Sequence[int]] | None,
    ) -> Bounds:
        """Bounds and parameters, see `Transcription.bounds`."""
        n, at = self.mesh.total, self.arc.layout
        fixed = signal_values(self.problem.parameters, p, "parameter")
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
            (-np.inf * small if self.arc.closure.gaps.numel() else -small, small),
            (-following, following),
            rows,
            (np.zeros(self._sizes["joints"]), np.zeros(self._sizes["joints"])),
            *(b.scaled for b in self.problem.boundary_constraints),
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
        spans = self.mesh.spans or (0.0, self.problem.duration[1])
        lower[0], upper[0] = np.array(spans) / arc.time_nominal
        if self.mesh.shares is not None:  # the first arc of a phase bounds the others
            later = np.diff(self.mesh.phase, prepend=-1) == 0
            lower[0, later], upper[0, later] = -np.inf, np.inf
        d = self.mesh.collocation.degree
        blocks = [
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
        """Bounds of ends, duration and integrals: only the duration has its own."""
        high = np.full(self._n_totals, np.inf)
        low = -high
        if not self.arc.fixed_grid:
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
        """Fix known durations and clocks; returns the times at which schedules are evaluated."""
        n, at, nominal = self.mesh.total, self.arc.layout, self.arc.time_nominal
        if self.arc.fixed_grid:
            if pins:
                raise ArgumentError("a fixed grid has no phases to pin; leave out pins")
            duration = np.array(self.mesh.shares) * self.problem.duration[1]
            begin = np.concatenate([[0.0], np.cumsum(duration)[:-1]])
            lower[0] = upper[0] = duration / nominal
            if self.arc.timed:
                lower[at.clock] = upper[at.clock] = begin / nominal
            self._check_breaks(begin, duration)
            return begin + _WITHIN * duration
        times = self._checked_pins(pins)
        first = np.searchsorted(self.mesh.phase, np.arange(self.mesh.phases))
        if self.arc.timed:
            for phase, time in times.items():
                lower[at.clock, first[phase]] = upper[at.clock, first[phase]] = time / nominal
        known = np.array(sorted(times))
        last = np.searchsorted(known, self.mesh.phase, side="right") - 1
        assert len(last) == n
        return np.array([times[k] for k in known])[last]

    def _checked_pins(self, pins: Mapping[int, float] | None) -> dict[int, float]:
        """Times at which phases begin; schedules must not break at others."""
        times = {0: 0.0, **(pins or {})}
        if times[0] != 0.0:
            raise ArgumentError("the first phase begins at 0; pin later phases only")
        if pins and not self.arc.timed:
            raise ArgumentError("the model does not depend on time; leave out pins")
        breaks = self.problem.model.breaks(self.problem.duration[1])[1:-1]
        loose = [t for t in breaks if not any(np.isclose(t, pin) for pin in times.values())]
        if loose:
            raise ArgumentError(
                f"a schedule breaks at t = {loose[0]:.6g} within a phase of free duration; "
                "pin the phase that begins there (pins)"
            )
        return times

    def _check_breaks(self, begin: np.ndarray, duration: np.ndarray) -> None:
        slack = _WITHIN * duration
        for schedule in self.problem.model.schedules:
            _, there = schedule.locate(begin + slack)
            since, piece = schedule.locate(begin + duration - slack)
            if np.any(there != piece) or np.any(since > begin + slack):
                raise ArgumentError(
                    f"the {schedule.name} breaks within an arc; put its breaks between arcs "
                    "(Mesh.over)"
                )

    def _schedules(self, starts: np.ndarray) -> np.ndarray:
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
            raise ArgumentError("prescribed contacts need a ModeSequence")
        if len(modes.phases) != self.mesh.phases:
            raise ArgumentError(
                f"modes has {len(modes.phases)} phases, but the mesh has {self.mesh.phases}"
            )
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
        fixed = signal_values(self.problem.parameters, {}, "parameter", fill=1.0)
        return np.asarray(function(0.0, *arc.nominals, *constants, arc.design_nominal, fixed))

    def _followers(self, stick: np.ndarray) -> np.ndarray:
        """Sticking contacts whose force has no independent effect on the worm."""
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
        """Bounds of all bounded rows, arc after arc, without duplicates."""
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
        """Bounds on speeds and forces of the contacts in arc k, where no equality sets them."""
        if states is None:
            return []
        d = self.mesh.collocation.degree
        now, before = states[k], states[k - 1]
        begins = (k == 0) & ~self._returns
        ends = self.problem.impulses or k == self.mesh.total - 1
        always = (states == 0).all(axis=0) & (k == 0)
        # without impulses a velocity that turns passes through 0
        turns = (now * before == -1) & ~begins & (not self.problem.impulses)
        fresh = (now == 0) & ((before != 0) | begins | always | self.problem.impulses) | turns
        start = np.where(fresh, 0.0, np.inf)
        low = np.repeat(
            np.where(now == 0, hold[:, 0], np.where(now > 0, 0, -np.inf))[:, None], d, 1
        )
        high = np.repeat(
            np.where(now == 0, hold[:, 1], np.where(now > 0, np.inf, 0))[:, None], d, 1
        )
        if not self.problem.impulses:  # an equality sets its initial speed to 0
            settled = (now != 0) & ((before == 0) | turns) & ~begins
            low[settled, 0], high[settled, 0] = -np.inf, np.inf
        rows = [(-start, start), (low, high)]
        if self.arc.keeps_ends:
            last = np.where((now > 0) & ends, 0.0, -np.inf), np.where((now < 0) & ends, 0.0, np.inf)
            rows.append(last)
        return rows

    def _along_rows(self, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
        d = self.mesh.collocation.degree
        ends = self.problem.impulses or k == self.mesh.total - 1
        rows = []
        for bound, state_only in zip(self.arc.along, self.arc.state_only, strict=True):
            columns = d + (state_only and self.arc.keeps_ends)
            boxes = []
            for value, free in zip(bound.scaled, (-np.inf, np.inf), strict=True):
                box = np.repeat(value[:, None], columns, axis=1)
                if columns > d and not ends:
                    box[:, d] = free
                boxes.append(box)
            rows.append((boxes[0], boxes[1]))
        return rows

    @cached_property
    def _returns(self) -> np.ndarray:
        """Contacts whose velocity at the end is that of the start, shape (n_c,)."""
        model, back = self.problem.model, self.problem.periodic
        others = [s.symbol for s in model.x if s.name not in back]
        open_states = ca.vertcat(ca.SX(0, 1), *others)
        return np.array(
            [not ca.depends_on(c.velocity, open_states) for c in model.contacts], dtype=bool
        )

    @cached_property
    def labels(self) -> list[tuple[str, int]]:
        """Name and entry of every row of the constraints."""
        n = self.mesh.total
        kinds = ("the equations of motion or of contact", "complementarity", "sharing of load")
        sizes = [n * self._sizes[k] for k in ("equal", "small", "following")]
        rows = [(name, 0) for name, size in zip(kinds, sizes, strict=True) for _ in range(size)]
        boxes = [box[0].size for box in self._along_rows(0)]
        an_arc = [("a contact's mode", 0)] * (self._sizes["rows"] - sum(boxes))
        for bound, size in zip(self.arc.along, boxes, strict=True):
            an_arc += [(bound.name, k % bound.expression.numel()) for k in range(size)]
        rows += an_arc * n + [("continuity or the period", 0)] * self._sizes["joints"]
        ends = self.problem.boundary_constraints
        return rows + [(b.name, k) for b in ends for k in range(b.expression.numel())]


class Transcription:
    """The nonlinear program of a problem on a mesh, with contacts treated in one of four ways.

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
        if self.mesh.spans is not None:  # else nothing determines arcs between switches
            uneven = ca.diff(y[0, :].T) * self.arc.time_nominal / sum(self.mesh.spans)
            objective += _EVEN * ca.sumsqr(uneven)
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
        return self._limits.labels[row][0]

    def prices(self, w: np.ndarray, bounds: Bounds, multipliers: np.ndarray) -> Prices:
        """Derivatives of the scaled objective by lower and upper bounds, by their names.

        One number for each entry of a constraint, an input, or ``duration``. Multipliers of the
        variables follow from those of the constraints: the gradient vanishes.
        """
        bounded = (*self.arc.along, *self.problem.boundary_constraints)
        found = {b.name: np.zeros((2, b.expression.numel())) for b in bounded}
        nominal = {b.name: b.nominal for b in bounded}
        for (name, entry), value in zip(self._limits.labels, multipliers, strict=True):
            if name in found:
                found[name][int(value > 0), entry] -= value / nominal[name]
        at, n, arc = self.arc.layout, self.mesh.total, self.arc
        slopes = self.nlp.slopes(w, bounds, multipliers)

        def inputs(values: np.ndarray) -> np.ndarray:
            block = values[: at.size * n].reshape((at.size, n), order="F")[at.inputs]
            return block.reshape(self.mesh.input_degree + 1, len(arc.u_nominal), n)

        first = 0
        for signal in self.problem.model.u:
            own = slice(first, first + signal.size)
            first += signal.size
            middle = (signal.lower + signal.upper) / 2 / signal.nominal
            above, slope = inputs(w)[:, own] > middle, inputs(slopes)[:, own] / signal.nominal
            sides = [np.where(side, slope, 0.0).sum(axis=(0, 2)) for side in (~above, above)]
            found[signal.name] = np.array(sides)
        row = at.size * n + self.problem.model.n_x
        upper = bool(2 * w[row] >= bounds.lbw[row] + bounds.ubw[row])
        found["duration"] = np.zeros((2, 1))
        found["duration"][int(upper)] = slopes[row] / arc.time_nominal
        return {name: (low, high) for name, (low, high) in found.items()}

    def guarded(self, bounds: Bounds) -> Bounds:
        """Bound every arc's duration by 0 from below, even if its phase implies it."""
        # The stronger barrier keeps durations from collapsing in an interior point: more
        # iterations, but motions are found from worse starts.
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
        """Variables (n_w,) of a worm at rest at `start` (n_x,), on arcs of durations (arcs,)."""
        # From there `NonlinearProgram.linear_step` finds the best motion with these durations,
        # where the model is linear.
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
