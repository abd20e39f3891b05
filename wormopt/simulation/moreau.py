"""Time stepping of Moreau and Jean: motions between walls, with impacts and dry friction.

Unilateral contact and friction hold as set-valued laws, at the level of velocities: over each step
of fixed length, walls that are touched at its middle give impulses by which nothing moves into
them, and friction holds or slides by the law's own numbers. Impacts need not be located, however
many there are. Without contact and damping the steps are those of the leapfrog: symplectic, of
second order, their energy oscillates and does not drift.

Contacts must not act on one another within a step, as is so where masses are lumped and every mass
touches at most one wall at a time. Then impulses are a closed expression of the state.

Sources: J. J. Moreau, in Nonsmooth Mechanics and Applications (1988) 1; M. Jean, Comput. Methods
Appl. Mech. Eng. 177 (1999) 235; E. Hairer, C. Lubich, G. Wanner, Acta Numerica 12 (2003) 399.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.core.model import Model, Schedule, pack
from wormopt.core.values import signal_values
from wormopt.errors import ArgumentError, Interrupted, SolveError, interruptible
from wormopt.progress import Report, silent
from wormopt.simulation.native.build import CompilerError
from wormopt.simulation.native.function import compiled

__all__ = ["Marcher", "Steps"]

# Steps that are taken between two looks at the state, and looks between two reports.
_STRIDE, _SPAN = 10, 500
# Share of the longest stable step that is taken.
_SAFE = 0.8


@dataclass(frozen=True, eq=False)
class Steps:
    """A motion, looked at every few steps.

    Parameters
    ----------
    time : ndarray, shape (m,)
        When.
    states : ndarray, shape (n_x, m)
        States.
    pressed, rubbed : ndarray, shape (contacts, m - 1)
        Mean normal and tangential force of each contact from one look to the next.
    work : dict of str to ndarray, shape (m,)
        What has been done until then: by "walls" (impacts), by "friction", and the integrals of
        the outputs that were asked for.
    n_steps : int
        Steps taken.
    """

    time: np.ndarray
    states: np.ndarray
    pressed: np.ndarray
    rubbed: np.ndarray
    work: dict[str, np.ndarray]
    n_steps: int


@dataclass(frozen=True, eq=False)
class Marcher:
    """The steps of one model, compiled once for all its parameters.

    Parameters
    ----------
    model : Model
        Its states are places and then their rates, and so many of each. All contacts have gaps
        and normal forces.
    integrals : sequence of str, optional
        Outputs to integrate over time.
    inputs : casadi.Function, optional
        From the places and a column of scheduled values to the model's inputs, which are 0 without
        it. Unlike an expression in the model it is not unrolled, and loops stay loops.

    Raises
    ------
    ArgumentError
        If the model is not of this form.
    """

    model: Model
    integrals: Sequence[str] = ()
    inputs: ca.Function | None = None

    def __post_init__(self) -> None:
        x, ode = pack(self.model.x), self.model.ode
        half = self.n_q
        if x.numel() != 2 * half or not ca.is_equal(ca.densify(ode[:half]), x[half:]):
            raise ArgumentError(f"{self.model.name}: states must be places, then their rates")
        if any(c.gap is None or c.normal_force is None for c in self.model.contacts):
            raise ArgumentError(f"{self.model.name}: all contacts must have gaps, normal forces")

    @property
    def n_q(self) -> int:
        """Number of places."""
        return self.model.n_x // 2

    def march(
        self,
        end: float,
        x0: np.ndarray,
        *,
        p: dict[str, float] | None = None,
        schedule: Schedule | None = None,
        step: float | None = None,
        report: Report = silent,
    ) -> Steps:
        """Follow the motion.

        Parameters
        ----------
        end : float
            Last time; the first is 0.
        x0 : ndarray, shape (n_x,)
            State at time 0.
        p : dict, optional
            Parameters by name, where they are not the model's own.
        schedule : Schedule, optional
            The values that ``inputs`` takes.
        step : float, optional
            Longest step; 0.8 of the longest stable one at the start if left out.
        report : callable, optional
            Told how far it is.

        Returns
        -------
        Steps

        Raises
        ------
        ArgumentError
            If contacts act on one another.
        SolveError
            If the motion is no longer a number; ``partial`` holds it up to there.
        Interrupted
            If the user stopped it; likewise.
        """
        numbers = signal_values(tuple(self.model.p), p, "parameter")
        self._check_contacts(x0, numbers)
        longest = _SAFE * self.stable_step(x0, numbers) if step is None else step
        times = _looks(schedule, end, longest)
        sizes = np.diff(times) / _STRIDE
        scheduled = self._scheduled(schedule, times)
        columns = [np.append(x0, np.zeros(self._n_gathered))[:, None]]
        last = len(sizes)
        for first in range(0, last, _SPAN):
            report("stepping", first / last)
            part = slice(first, min(first + _SPAN, last))
            try:
                with interruptible():
                    found = self._advance(
                        columns[-1][:, -1], scheduled[:, part], numbers, sizes[part]
                    )
            except KeyboardInterrupt:
                raise Interrupted(self._steps(times, columns)) from None
            columns.append(found)
            if not np.all(np.isfinite(found[:, -1])):
                reason = f"the motion is no longer a number before t = {times[part.stop]:.6g}"
                partial = self._steps(times, columns[:-1])
                raise SolveError(reason, "take a shorter step", partial, "not_finite")
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
            Infinite where nothing resists.
        """
        half = self.n_q
        J = np.array(self._linear(x0, numbers))[half:]
        stiffness = np.abs(np.linalg.eigvals(J[:, :half])).max(initial=0.0)
        damping = np.abs(np.linalg.eigvals(J[:, half:])).max(initial=0.0)
        if not stiffness and not damping:
            return math.inf
        # the leapfrog with damping taken where the step begins: 2 c h + k h² < 4, both at most so
        return float(4 / (damping + math.sqrt(damping**2 + 4 * stiffness)))

    def _scheduled(self, schedule: Schedule | None, times: np.ndarray) -> np.ndarray:
        """Values of the schedule between the looks."""
        middle = (times[:-1] + times[1:]) / 2
        if schedule is None:
            return np.zeros((self._n_scheduled, len(middle)))
        return schedule.values[schedule.locate(middle)[1]].T

    def _advance(
        self, x: np.ndarray, scheduled: np.ndarray, numbers: np.ndarray, sizes: np.ndarray
    ) -> np.ndarray:
        count = len(sizes)
        many = self._stride.mapaccum("march", count)
        return np.array(many(x, scheduled, np.tile(numbers[:, None], count), sizes[None, :]))

    def _steps(self, times: np.ndarray, columns: list[np.ndarray]) -> Steps:
        found = np.hstack(columns)
        count, n_c = found.shape[1], len(self.model.contacts)
        states, gathered = found[: self.model.n_x], found[self.model.n_x :]
        work, impulses = gathered[: -2 * n_c or None], gathered[len(gathered) - 2 * n_c :]
        forces = np.diff(impulses, axis=1) / np.diff(times[:count])
        names = ("walls", "friction", *self.integrals)
        return Steps(
            time=times[:count],
            states=states,
            pressed=forces[:n_c],
            rubbed=forces[n_c:],
            work=dict(zip(names, work, strict=True)),
            n_steps=(count - 1) * _STRIDE,
        )

    @property
    def _n_gathered(self) -> int:
        return 2 + len(self.integrals) + 2 * len(self.model.contacts)

    @cached_property
    def _stride(self) -> ca.Function:
        """A few steps: state with what is gathered, scheduled values, parameters, step size."""
        sizes = [self.model.n_x + self._n_gathered, self._n_scheduled, self._n_p, 1]
        given = [ca.MX.sym(name, size) for name, size in zip("xcph", sizes, strict=True)]
        x, c, p, h = given
        half, n_x = self.n_q, self.model.n_x
        q, v, gathered = x[:half], x[half:n_x], x[n_x:]
        middle = q + h / 2 * v
        u = ca.DM.zeros(self._n_u) if self.inputs is None else self.inputs(middle, c)
        after, more = self._kick(middle, v, u, p, h)
        one = ca.Function(
            "step", given, [ca.vertcat(middle + h / 2 * after, after, gathered + more)]
        )
        several = one.fold(_STRIDE)
        rest = [ca.repmat(part, 1, _STRIDE) for part in (c, p, h)]
        function = ca.Function("stride", given, [several(x, *rest)])
        try:
            return compiled(function)
        except CompilerError:
            return function

    @cached_property
    def _kick(self) -> ca.Function:
        """Rates after a step by the forces at its middle, and what is gathered over it."""
        q, v, u, p, h = symbols = self._symbols
        half, contacts = self.n_q, self.model.contacts
        push = self._pushes[half:, :]
        free = v + h * self._free[half:]
        n_c = len(contacts)
        moved = ca.substitute(self._contact_rates, v, free)
        response = self._response
        normal = ca.fmax(0, -moved[:n_c] / ca.diag(response)[:n_c])
        gaps = ca.vertcat(ca.SX(0, 1), *(contact.gap for contact in contacts))
        normal = ca.if_else(gaps <= 0, normal, 0)
        hold = -moved[n_c:] / ca.diag(response)[n_c:]
        rubbed = [
            _rub(contact, normal[i], hold[i], moved[n_c + i], h)
            for i, contact in enumerate(contacts)
        ]
        impulses = ca.vertcat(normal, *rubbed)
        after = free + push @ impulses
        mean = (v + after) / 2
        rates = ca.substitute(self._contact_rates, v, mean)
        outputs = [self.model.output(name) for name in self.integrals]
        powers = ca.substitute(self._without_contacts(ca.vertcat(ca.SX(0, 1), *outputs)), v, mean)
        work = [ca.dot(rates[part], impulses[part]) for part in (slice(n_c), slice(n_c, None))]
        gathered = ca.densify(ca.vertcat(*work, h * powers, impulses))
        return ca.Function("kick", list(symbols), [ca.densify(after), gathered], {"cse": True})

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ...]:
        """Places, rates, inputs, parameters, step size."""
        model, x = self.model, pack(self.model.x)
        h = ca.SX.sym("h")
        return x[: self.n_q], x[self.n_q :], pack(model.u), pack(model.p), h

    @cached_property
    def _impulse_symbols(self) -> ca.SX:
        pressed = [c.normal_force for c in self.model.contacts]
        return ca.vertcat(ca.SX(0, 1), *pressed, *(c.force for c in self.model.contacts))

    def _without_contacts(self, expression: ca.SX) -> ca.SX:
        forces = self._impulse_symbols
        return ca.substitute(expression, forces, ca.SX.zeros(forces.numel()))

    @cached_property
    def _free(self) -> ca.SX:
        return self._without_contacts(self.model.ode)

    @cached_property
    def _pushes(self) -> ca.SX:
        """d(ode) / d(normal and tangential forces)."""
        return ca.jacobian(self.model.ode, self._impulse_symbols)

    @cached_property
    def _contact_rates(self) -> ca.SX:
        """Rates of the gaps, then velocities along the walls."""
        q, v = self._symbols[:2]
        gaps = ca.vertcat(ca.SX(0, 1), *(contact.gap for contact in self.model.contacts))
        return ca.vertcat(ca.jtimes(gaps, q, v), self.model.contact_velocities)

    @cached_property
    def _response(self) -> ca.SX:
        """Rates of all contacts by unit impulses of all contacts."""
        return ca.jacobian(self._contact_rates, self._symbols[1]) @ self._pushes[self.n_q :, :]

    @property
    def _n_scheduled(self) -> int:
        return 0 if self.inputs is None else int(self.inputs.size1_in(1))

    @property
    def _n_u(self) -> int:
        return int(self._symbols[2].numel())

    @property
    def _n_p(self) -> int:
        return int(self._symbols[3].numel())

    @cached_property
    def _linear(self) -> ca.Function:
        """Jacobian of the ode without contacts and inputs, of state and parameters."""
        x, (_, _, u, p, _) = pack(self.model.x), self._symbols
        J = ca.substitute(ca.jacobian(self._free, x), u, ca.SX.zeros(u.numel()))
        return ca.Function("linear", [x, p], [ca.densify(J)])

    def _check_contacts(self, x0: np.ndarray, numbers: np.ndarray) -> None:
        """Refuse contacts that act on one another and may be closed at the same time."""
        contacts = self.model.contacts
        n_c, x = len(contacts), pack(self.model.x)
        if not n_c:
            return
        gaps = ca.vertcat(*(contact.gap for contact in contacts))
        probe = ca.Function(
            "probe", [x, self._symbols[3]], [self._response, gaps, ca.jacobian(gaps, x)]
        )
        response, gap, slope = (np.array(part) for part in probe(x0, numbers))
        size = np.sqrt(np.diag(response))
        apart = np.abs(response) > 1e-12 * size[:, None] * size[None, :]
        np.fill_diagonal(apart, val=False)
        for i, j in np.argwhere(apart):
            a, b = i % n_c, j % n_c
            opposite = a != b and not np.any(slope[a] + slope[b]) and gap[a, 0] + gap[b, 0] > 0
            if not opposite:
                raise ArgumentError(
                    f"contacts {contacts[a].name} and {contacts[b].name} act on one another; "
                    "lump the masses"
                )


def _looks(schedule: Schedule | None, end: float, longest: float) -> np.ndarray:
    """Times of the looks: even between breaks of the schedule."""
    breaks = np.array([0.0, end])
    if schedule is not None:
        clock = Model("clock", x=(), ode=ca.SX(0, 1), schedules=[schedule])
        breaks = clock.breaks(end)
    counts = np.maximum(np.ceil(np.diff(breaks) / (_STRIDE * longest) - 1e-9), 1).astype(int)
    parts = [
        np.linspace(a, b, k, endpoint=False)
        for a, b, k in zip(breaks[:-1], breaks[1:], counts, strict=True)
    ]
    return np.append(np.concatenate(parts), end)


def _rub(contact, normal: ca.SX, hold: ca.SX, velocity: ca.SX, h: ca.SX) -> ca.SX:  # noqa: ANN001
    """Impulse of friction: what holds the contact if the law can, else what it slides with."""
    pressed, law = contact.normal_force, contact.law
    least, most = law.stick_interval
    ahead, behind = law.slip_force(velocity, 1), law.slip_force(velocity, -1)
    slides = ca.vertcat(*(h * ca.SX(part) for part in (least, most, ahead, behind)))
    low, high, ahead, behind = ca.vertsplit(ca.substitute(slides, pressed, normal / h))
    return ca.if_else(hold < low, ahead, ca.if_else(hold > high, behind, hold))
