"""Time stepping of Moreau and Jean: motions between walls, with impacts and dry friction.

Unilateral contact and friction hold as set-valued laws, at the level of velocities: over each step
of fixed length, walls that are touched at its middle give impulses by which nothing moves into
them (restitution 0), and friction holds or slides by the law's own numbers. Impacts need not be
located, however many there are. Without contact and damping the steps are those of the leapfrog:
symplectic, of second order, their energy oscillates and does not drift.

Walls must not act on one another within a step, as is so where masses are lumped and every mass
touches at most one wall at a time. Then impulses are a closed expression of the motion without
contact. Friction whose limits do not depend on a wall's impulse needs no gap, and may couple
contacts: projected over-relaxation is repeated until the impulses of a chain are accurate to 1e-10.
In the plane its impulse is the nearest of those of the law to the one that would stop the contact.

Sources: J. J. Moreau, in Nonsmooth Mechanics and Applications (1988) 1; M. Jean, Comput. Methods
Appl. Mech. Eng. 177 (1999) 235; E. Hairer, C. Lubich, G. Wanner, Acta Numerica 12 (2003) 399;
D. M. Young, Iterative Solution of Large Linear Systems (1971), 6.2 for the factor of relaxation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SolveError, interruptible
from wormopt.model.friction import Law
from wormopt.model.given import check_kind
from wormopt.model.model import Contact, Model, pack
from wormopt.model.planar_friction import Elliptic, PlanarLaw
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.numerics.expressions import AtPlaces, Call, identically_zero
from wormopt.progress import Report, silent
from wormopt.simulation.native.build import CompilerError, folded
from wormopt.simulation.native.marcher import Marcher

# Sweeps for each contact of a chain: errors decrease by 2 pi / (n + 1) in each.
_SWEEPS = 4


@dataclass(frozen=True, eq=False)
class Impulses:
    """Change of a model's rates in one step.

    States of the model: places, then their rates, as many of each. Contacts have a gap and a normal
    force, or neither; no time, schedules or algebraic variables. Else raises ArgumentError.
    """

    model: Model
    integrals: Sequence[str] = ()  # outputs to integrate over the step

    def __post_init__(self) -> None:
        model = self.model
        model.places()  # refuses other states
        if any((c.gap is None) != (c.normal_force is None) for c in model.contacts):
            self._refuse("contacts must have a gap and a normal force, or neither")
        for contact in model.contacts:
            if isinstance(contact.law, PlanarLaw):
                if not isinstance(contact.law, Elliptic):
                    self._refuse("contacts in the plane must have the law Elliptic")
            elif len(contact.law.directions) != 2:
                self._refuse("contacts must be free to slide both ways")
        model.refuse_delays("the scheme of Moreau and Jean")
        if model.z or model.switches:
            self._refuse("algebraic variables and switches are not supported")
        timed = [model.t, *(s for part in model.schedules for s in (part.symbol, part.begin))]
        if ca.depends_on(
            ca.vertcat(model.ode, *map(model.__getitem__, self.integrals)), ca.vertcat(*timed)
        ):
            self._refuse("only inputs may depend on time")
        if ca.depends_on(self._pushes, self._impulse_symbols):
            self._refuse("the ode must be affine in the contact forces")

    def _refuse(self, why: str) -> None:
        raise ArgumentError(f"{self.model.name}: {why}")

    @property
    def n_q(self) -> int:
        """Number of places."""
        return self.model.n_x // 2

    @property
    def n_gathered(self) -> int:
        """Number of accumulated values: work of walls and friction, integrals, impulses."""
        return 2 + len(self.integrals) + len(self.model.contacts) + len(self._row_contact)

    @cached_property
    def _row_contact(self) -> list[int]:
        """Contact of every component of velocity along the ground."""
        return [i for i, c in enumerate(self.model.contacts) for _ in range(c.force.numel())]

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        """Places, rates, inputs, parameters, step size."""
        model, x = self.model, pack(self.model.x)
        h: ca.SX = ca.SX.sym("h")
        return x[: self.n_q], x[self.n_q :], pack(model.u), pack(model.p), h

    @cached_property
    def kick(self) -> ca.Function:
        """Rates after a step by the forces at its middle, and values accumulated over it."""
        # Function of the places in the middle, rates before, inputs, parameters and step size.
        v, h, n_c = self.symbols[1], self.symbols[4], len(self.model.contacts)
        given: ca.SX = ca.SX.sym("impulses", n_c + len(self._row_contact))
        loose = v + h * self._free[self.n_q :]
        after = loose + self._pushes[self.n_q :, :] @ given
        # with mean rates, kinetic energy changes by exactly the work of all impulses
        rates, powers = ca.substitute([self._contact_rates, self._powers], [v], [(v + after) / 2])
        work = ca.vertcat(ca.dot(rates[:n_c], given[:n_c]), ca.dot(rates[n_c:], given[n_c:]))
        found = [ca.densify(after), ca.densify(ca.vertcat(work, h * powers, given))]
        free = ca.substitute(self._contact_rates, v, loose)
        alone = self._given(free)
        if not self._swept:
            found = ca.substitute(found, [given], [alone])
            return ca.Function("kick", list(self.symbols), found, {"cse": True})
        begin = ca.Function("begin", list(self.symbols), [ca.densify(alone), ca.densify(free)])
        kicked = ca.Function("kicked", [*self.symbols, given], found, {"cse": True})
        symbols = begin.mx_in()
        impulses, rates = begin(*symbols)
        for _ in range(_SWEEPS * (len(self._swept) + 1)):
            impulses = self._sweep(impulses, rates, *symbols)
        return ca.Function("kick", symbols, kicked.call([*symbols, impulses]))

    def _given(self, free: ca.SX) -> ca.SX:
        """Normal and tangential impulses, from the rates that contacts would have without them."""
        contacts, h = self.model.contacts, self.symbols[4]
        stops, n_c = -free / ca.diag(self._response), len(contacts)
        normal = ca.if_else(self._gaps <= 0, ca.fmax(0, stops[:n_c]), 0)
        rubbed = []
        for i, contact in enumerate(contacts):
            rows = self._rows(i)
            rubbed.append(_rub(contact, normal[i], stops[rows], free[rows], h))
        return ca.vertcat(normal, *rubbed)

    @cached_property
    def _sweep(self) -> ca.Function:
        """Impulses after another sweep, from those before and the rates without any."""
        contacts, h, n_c = self.model.contacts, self.symbols[4], len(self.model.contacts)
        size = n_c + len(self._row_contact)
        impulses, free = ca.SX.sym("impulses", size), ca.SX.sym("free", size)
        response, swept = self._response, ca.SX(impulses)
        factor = 2 / (1 + math.sin(math.pi / (len(self._swept) + 1)))  # the best factor for a chain
        for i in sorted({self._row_contact[row - n_c] for row in self._swept}):
            rows = self._rows(i)
            own = largest(response[rows, rows])
            hold = swept[rows] - factor * (free[rows] + response[rows, :] @ swept) / own
            swept[rows] = _rub(contacts[i], ca.SX(0), hold, free[rows], h)
        return ca.Function("sweep", [impulses, free, *self.symbols], [swept])

    @cached_property
    def _swept(self) -> list[int]:
        """Rows of friction without walls, if its contacts act on one another; else none."""
        n_c, free = len(self.model.contacts), set(self._without_walls)
        alone = [n_c + row for row, i in enumerate(self._row_contact) if i in free]
        among = self._response[alone, alone]
        sides = ca.vertcat(ca.SX(0, 1), *(e for e in _off_diagonal(among)))
        try:  # ignores sin cos - cos sin
            acts = not identically_zero(sides, ca.vertcat(ca.SX(0, 1), *ca.symvar(sides))).all()
        except ZeroDivisionError:
            acts = True
        return alone if acts else []

    def _rows(self, contact: int) -> slice:
        """Rows of a contact's velocity along the ground among all rates."""
        first = len(self.model.contacts) + self._row_contact.index(contact)
        return slice(first, first + self.model.contacts[contact].force.numel())

    @property
    def _without_walls(self) -> list[int]:
        return [i for i, contact in enumerate(self.model.contacts) if contact.gap is None]

    @cached_property
    def linear(self) -> ca.Function:
        """Jacobian of the ode without contacts and inputs, of state and parameters."""
        x, (_, _, u, p, _) = pack(self.model.x), self.symbols
        J = ca.substitute(ca.jacobian(self._free, x), u, ca.SX.zeros(u.numel()))
        return ca.Function("linear", [x, p], [ca.densify(J)])

    def check(self, x0: np.ndarray, numbers: np.ndarray) -> None:
        """Refuse walls that act on one another and may be closed at the same time."""
        contacts, x = self.model.contacts, pack(self.model.x)
        n_c, gaps = len(contacts), self._gaps
        asked = [self._response, gaps, ca.jacobian(gaps, x)]
        probe = ca.Function("probe", [x, self.symbols[3]], asked)
        response, gap, slope = (np.array(part) for part in probe(x0, numbers))
        size = np.sqrt(np.diag(response))
        apart = np.abs(response) > 1e-12 * size[:, None] * size[None, :]
        np.fill_diagonal(apart, val=False)
        free = set(self._without_walls)
        alone = [n_c + row for row, i in enumerate(self._row_contact) if i in free]
        apart[np.ix_(alone, alone)] = False  # sweeps compute their impulses
        contact_of = np.array([*range(n_c), *self._row_contact], dtype=int)
        for a, b in contact_of[np.argwhere(apart)]:
            # two sides of one channel: the sum of the gaps is its constant width
            opposite = a != b and not np.any(slope[a] + slope[b]) and gap[a, 0] + gap[b, 0] > 0
            if not opposite:
                self._refuse(
                    f"contacts {contacts[a].name} and {contacts[b].name} interact through the mass "
                    "matrix; lump the masses"
                )

    @cached_property
    def _gaps(self) -> ca.SX:
        gaps = [1.0 if contact.gap is None else contact.gap for contact in self.model.contacts]
        return ca.vertcat(ca.SX(0, 1), *gaps)

    @cached_property
    def _impulse_symbols(self) -> ca.SX:
        pressed = [
            ca.SX.sym("none") if c.normal_force is None else c.normal_force
            for c in self.model.contacts
        ]
        return ca.vertcat(ca.SX(0, 1), *pressed, self.model.forces)

    def _without_contacts(self, expression: ca.SX) -> ca.SX:
        forces = self._impulse_symbols
        return ca.substitute(expression, forces, ca.SX.zeros(forces.numel()))

    @cached_property
    def _free(self) -> ca.SX:
        return self._without_contacts(self.model.ode)

    @cached_property
    def _powers(self) -> ca.SX:
        outputs = [self.model[name] for name in self.integrals]
        return self._without_contacts(ca.vertcat(ca.SX(0, 1), *outputs))

    @cached_property
    def _pushes(self) -> ca.SX:
        """d(ode) / d(normal and tangential forces)."""
        return ca.jacobian(self.model.ode, self._impulse_symbols)

    @cached_property
    def _contact_rates(self) -> ca.SX:
        """Rates of the gaps, then velocities along the walls."""
        q, v = self.symbols[:2]
        return ca.vertcat(ca.jtimes(self._gaps, q, v), self.model.contact_velocities)

    @cached_property
    def _response(self) -> ca.SX:
        """Rates of all contacts by unit impulses of all contacts."""
        return ca.jacobian(self._contact_rates, self.symbols[1]) @ self._pushes[self.n_q :, :]


def _off_diagonal(matrix: ca.SX) -> list[ca.SX]:
    rows, columns = matrix.sparsity().get_triplet()
    return [matrix[i, j] for i, j in zip(rows, columns, strict=True) if i != j]


def largest(matrix: ca.SX) -> ca.SX:
    """Largest eigenvalue of a symmetric matrix of at most two rows."""
    if matrix.numel() == 1:
        return matrix
    half = (matrix[0, 0] - matrix[1, 1]) / 2
    return ca.trace(matrix) / 2 + ca.sqrt(half**2 + matrix[0, 1] ** 2)


def friction(law: Law | PlanarLaw, hold: ca.SX, velocity: ca.SX) -> ca.SX:
    """Force of a law: the holding force if the contact can hold, else that of sliding."""
    if isinstance(law, PlanarLaw):
        assert isinstance(law, Elliptic)
        return law.nearest(hold)
    low, high = law.stick_interval
    found = hold
    for direction, beyond in ((-1, hold > high), (1, hold < low)):
        if direction in law.directions:
            found = ca.if_else(beyond, law.slip_force(velocity, direction), found)
    return found


def _rub(contact: Contact, normal: ca.SX, hold: ca.SX, velocity: ca.SX, h: ca.SX) -> ca.SX:
    """Impulse of friction, from the holding impulse."""
    found, pressed = h * friction(contact.law, hold / h, velocity), contact.normal_force
    return found if pressed is None else ca.substitute(found, pressed, normal / h)


# Number of steps between two samples of the state, and of samples between two reports.
_STRIDE, _SPAN = 10, 500
# Share of the longest stable step that is taken by default.
_SAFE = 0.8


@dataclass(frozen=True, eq=False)
class StepRecord:
    """A motion, sampled every few steps."""

    time: np.ndarray  # (m,)
    states: np.ndarray  # (n_x, m)
    pressed: np.ndarray  # (contacts, m - 1) mean normal force between two samples
    rubbed: np.ndarray  # (components, m - 1) mean tangential force, likewise
    # (m,) each, work until then: by "walls" (impacts), by "friction", integrals of outputs
    work: dict[str, np.ndarray]
    n_steps: int


@dataclass(frozen=True, eq=False)
class MoreauJean:
    """Moreau-Jean time stepping of a model, compiled once for all parameters.

    Parameters
    ----------
    model : Model
        Its states are places and then their rates, and so many of each. Contacts have a gap and a
        normal force, or neither.
    integrals : sequence of str, optional
        Outputs to integrate over time.
    inputs : casadi.Function or AtPlaces, optional
        From the places and a column of scheduled values to the model's inputs, which are 0 without
        it. Unlike an expression in the model it is not unrolled, and loops stay loops.

    Raises
    ------
    ArgumentError
        If the model is not of this form.

    Examples
    --------
    A block of weight 1 falls from 0.5 to the floor, which then presses back with 1:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> y, v, force, N = (ca.SX.sym(name) for name in ("y", "v", "force", "N"))
    >>> floor = wo.Contact("floor", ca.SX(0), force, wo.Coulomb(N, N), gap=y, normal_force=N)
    >>> states = [wo.Signal("height", y, value=0.5), wo.Signal("speed", v, value=0.0)]
    >>> block = wo.Model("block", states, ca.vertcat(v, N - 1), contacts=[floor])
    >>> motion = MoreauJean(block).march(2.0, step=1e-3)
    >>> bool(abs(motion.states[0, -1]) < 1e-3), float(motion.pressed[0, -1].round(9))
    (True, 1.0)
    """

    model: Model
    integrals: Sequence[str] = ()
    inputs: ca.Function | AtPlaces | None = None

    _impulses: Impulses = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_kind("model", self.model, Model)
        object.__setattr__(self, "_impulses", Impulses(self.model, self.integrals))

    def march(
        self,
        end: float,
        x0: np.ndarray | None = None,
        *,
        p: dict[str, float] | None = None,
        schedule: Schedule | None = None,
        step: float | None = None,
        report: Report = silent,
    ) -> StepRecord:
        """Integrate the motion.

        Parameters
        ----------
        end : float
            Last time; the first is 0.
        x0 : ndarray, shape (n_x,), optional
            State at time 0; the model's own start if left out.
        p : dict, optional
            Parameters by name, where they are not the model's own.
        schedule : Schedule, optional
            The values that ``inputs`` takes.
        step : float, optional
            Longest step; 0.8 of the longest stable one at the start if left out.
        report : callable, optional
            Receives the progress.

        Raises
        ------
        ArgumentError
            If walls act on one another, or the model has no stiffness or damping and no `step` is
            given.
        SolveError
            If a value is not finite; ``partial`` contains the motion up to then.
        Interrupted
            If the user stopped it; likewise.
        """
        numbers = signal_values(tuple(self.model.p), p, "parameter")
        x0 = signal_values(self.model.x, None, "state", fill=0.0) if x0 is None else x0
        self._impulses.check(x0, numbers)
        longest = self.safe_step(x0, numbers) if step is None else step
        if not (0 < longest < math.inf and 0 < end < math.inf):
            raise ArgumentError(f"steps of {longest:g} do not reach t = {end:g}; write a step")
        times = _looks(schedule, end, longest)
        sizes = np.diff(times) / _STRIDE
        scheduled = self._scheduled(schedule, times)
        begin = np.append(x0, np.zeros(self._impulses.n_gathered))
        columns = np.empty((len(times), len(begin))).T  # a copy of a long motion is large
        columns[:, 0] = begin
        last, strides = len(sizes), self._strides
        for first in range(0, last, _SPAN):
            part = slice(first, min(first + _SPAN, last))
            try:
                report("stepping", first / last)
                with interruptible():
                    found = strides(columns[:, first], scheduled[:, part], numbers, sizes[part])
            except KeyboardInterrupt:
                raise Interrupted(self._steps(times, columns[:, : first + 1])) from None
            columns[:, first + 1 : part.stop + 1] = found
            if not np.all(np.isfinite(found[:, -1])):
                reason = f"the motion becomes infinite or NaN before t = {times[part.stop]:.6g}"
                partial = self._steps(times, columns[:, : first + 1])
                raise SolveError(reason, "write a shorter step", partial, "not_finite")
        return self._steps(times, columns)

    def stable_step(self, x0: np.ndarray, numbers: np.ndarray) -> float:
        """Longest step that keeps small vibrations about a state small.

        Parameters
        ----------
        x0 : ndarray, shape (n_x,)
            The state.
        numbers : ndarray
            Parameters.

        Returns
        -------
        float
            Infinite for a model without stiffness and damping.
        """
        half = self._impulses.n_q
        J = np.array(self._impulses.linear(x0, numbers))[half:]
        stiffness = np.abs(np.linalg.eigvals(J[:, :half])).max(initial=0.0)
        damping = np.abs(np.linalg.eigvals(J[:, half:])).max(initial=0.0)
        if not stiffness and not damping:
            return math.inf
        # the leapfrog with damping at the beginning of the step: 2 c h + k h² < 4, both at most so
        return float(4 / (damping + math.sqrt(damping**2 + 4 * stiffness)))

    def safe_step(self, x0: np.ndarray, numbers: np.ndarray) -> float:
        """Default step: 0.8 times the longest stable step.

        Parameters
        ----------
        x0, numbers : ndarray
            As for `stable_step`.
        """
        return _SAFE * self.stable_step(x0, numbers)

    def _scheduled(self, schedule: Schedule | None, times: np.ndarray) -> np.ndarray:
        """Values of the schedule between the samples."""
        middle = (times[:-1] + times[1:]) / 2
        if schedule is None:
            return np.zeros((self._n_scheduled, len(middle)))
        return schedule.values[schedule.locate(middle)[1]].T

    @cached_property
    def _strides(self) -> Callable[..., np.ndarray]:
        """Columns after each stride: of the first column, scheduled values, parameters, sizes."""
        try:
            return Marcher(self._impulses.kick, self.inputs, _STRIDE)
        except CompilerError:
            return self._interpreted

    def _steps(self, times: np.ndarray, found: np.ndarray) -> StepRecord:
        count, n_c = found.shape[1], len(self.model.contacts)
        states, gathered = found[: self.model.n_x], found[self.model.n_x :]
        n_work = 2 + len(self.integrals)
        work, impulses = gathered[:n_work], gathered[n_work:]
        forces = np.diff(impulses, axis=1)
        forces /= np.diff(times[:count])
        names = ("walls", "friction", *self.integrals)
        return StepRecord(
            time=times[:count],
            states=states,
            pressed=forces[:n_c],
            rubbed=forces[n_c:],
            work=dict(zip(names, work, strict=True)),
            n_steps=(count - 1) * _STRIDE,
        )

    def _interpreted(
        self, start: np.ndarray, scheduled: np.ndarray, numbers: np.ndarray, sizes: np.ndarray
    ) -> np.ndarray:
        """`_strides` without a compiler."""
        count = len(sizes)
        call = self._span if count == _SPAN else self._spanning(count)
        (found,) = call(start, scheduled.ravel(order="F"), np.tile(numbers, count), sizes)
        return found.reshape(-1, count, order="F").copy()

    @cached_property
    def _span(self) -> Call:
        return self._spanning(_SPAN)

    def _spanning(self, count: int) -> Call:
        return Call(folded(self._step, _STRIDE).mapaccum("march", count))

    @property
    def _step(self) -> ca.Function:
        impulses, n_x = self._impulses, self.model.n_x
        half, u, p = impulses.n_q, *impulses.symbols[2:4]
        sizes = [n_x + impulses.n_gathered, self._n_scheduled, p.numel(), 1]
        x, c, p, h = given = [
            ca.MX.sym(name, size) for name, size in zip("xcph", sizes, strict=True)
        ]
        q, v, gathered = x[:half], x[half:n_x], x[n_x:]
        middle = q + h / 2 * v
        if self.inputs is None:
            u = ca.DM.zeros(u.numel())
        elif isinstance(self.inputs, AtPlaces):
            u = self.inputs.function(middle[: self.inputs.function.size1_in(0)], c)
        else:
            u = self.inputs(middle, c)
        after, more = impulses.kick(middle, v, u, p, h)
        found = ca.vertcat(middle + h / 2 * after, after, gathered + more)
        return ca.Function("step", given, [found], [*"xcph"], ["found"])

    @property
    def _n_scheduled(self) -> int:
        if self.inputs is None:
            return 0
        one = self.inputs.one if isinstance(self.inputs, AtPlaces) else self.inputs
        return int(one.size1_in(1))


def _looks(schedule: Schedule | None, end: float, longest: float) -> np.ndarray:
    """Times of the samples: even between breaks of the schedule."""
    breaks = np.array([0.0, end])
    if schedule is not None:
        clock = Model("clock", x=(), ode=ca.SX(0, 1), schedules=[schedule])
        breaks = clock.breaks(end)
    counts = np.maximum(np.ceil(np.diff(breaks) / (_STRIDE * longest) - 1e-9), 1).astype(int)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    sizes = np.repeat(np.diff(breaks) / counts, counts)
    return np.append(np.repeat(breaks[:-1], counts) + within * sizes, end)
