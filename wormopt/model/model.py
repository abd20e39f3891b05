"""Model: a worm and its contacts with the ground as CasADi expressions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.given import (
    check_flag,
    check_kinds,
    check_name,
    fields_of,
    is_number,
    make_plain,
)
from wormopt.model.schedule import Delay, Schedule
from wormopt.model.values import column, numbers
from wormopt.quantities import check_quantity
from wormopt.shown import lines, listed

TINY = math.ulp(0.0)
"""Smallest number above 0: the lower bound of positive values."""


def _symbolic(whose: str, what: str, given: object, *, pure: bool = False) -> None:
    """Refuse names and numbers in place of expressions; `pure`: expressions in place of symbols."""
    if not isinstance(given, ca.SX):
        raise ArgumentError(
            f"{whose}: {what} must be an expression of CasADi's SX symbols, for example "
            f"ca.SX.sym({what!r}), not {given!r}"
        )
    if pure and not (given.is_valid_input() and given.is_column()):
        raise ArgumentError(
            f"{whose}: {what} must be a column of symbols, not the expression {given!s:.60}"
        )


def _check_column(whose: str, what: str, given: ca.SX, size: int, things: str) -> None:
    """Refuse an expression that is no column of `size`; an empty one may have any shape."""
    if given.shape != (size, 1) and not given.numel() == size == 0:
        raise ArgumentError(
            f"{whose}: {what} must be a column of {size}, one for each {things}, not of the shape "
            f"{given.shape}; stack it with ca.vertcat"
        )


def _check_names(whose: str, what: str, names: Sequence[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ArgumentError(
            f"{whose}: two {what} share the name {twice[0]!r}; write another name for one of them"
        )


def _check_quantity(whose: str, unit: object) -> None:
    if not isinstance(unit, str):
        raise ArgumentError(f'the unit of {whose!r} is {unit!r}; write for example "length"')
    check_quantity(whose, unit)


def _check_nominal(whose: str, what: str, size: object) -> None:
    if not is_number(size, TINY):
        raise ArgumentError(f"{whose}: {what} must be positive and finite, not {size!r:.60}")


@dataclass(frozen=True, eq=False)
class Signal:
    """A named vector of symbols: a state, an input, an algebraic variable or a parameter.

    Parameters
    ----------
    name : str
        Field's standard name, for instance ``"length"``.
    symbol : casadi.SX
        Column of symbols.
    unit : str, optional
        Quantity it measures, for instance ``"length"`` or ``"speed"``; a unit, ``"kg m2"`` say,
        where no quantity has it.
    nominal : float, optional
        Usual size, by which solvers scale it, positive.
    lower, upper : float, optional
        Bounds of valid values; `TINY` is the lower bound of positive values. Values
        beyond them are refused.
    value : float or sequence of float, optional
        Start of a state, or value of a parameter or input, unless a solver gets another.

    Raises
    ------
    ArgumentError
        If the symbol is no column of casadi.SX symbols, the unit is unknown, the nominal size is
        not positive, the lower bound exceeds the upper one, or the value has another size.

    Examples
    --------
    >>> import casadi as ca
    >>> Signal("length", ca.SX.sym("l", 2), unit="length").size
    2
    """

    name: str
    symbol: ca.SX
    unit: str = "1"
    nominal: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    value: float | Sequence[float] | None = None

    def __post_init__(self) -> None:
        check_name("signal", self.name)
        whose = f"signal {self.name}"
        _symbolic(whose, "symbol", self.symbol, pure=True)
        _check_quantity(self.name, self.unit)
        make_plain(self, "nominal", "lower", "upper")
        _check_nominal(whose, "nominal", self.nominal)
        for what in ("lower", "upper"):
            bound = getattr(self, what)
            if not is_number(bound, -math.inf, math.inf):
                raise ArgumentError(
                    f"{whose}: {what} must be a number, one for all entries, not {bound!r:.60}; "
                    "leave it out if there is no bound"
                )
        if not self.lower <= self.upper:
            raise ArgumentError(
                f"{whose}: lower {self.lower!r} is above upper {self.upper!r}; write the smaller "
                "number as lower"
            )
        if self.value is not None:
            values = column(f"value of {self.name}", self.value, self.size)
            self.check(values)
            if numbers("value", self.value).ndim > 1:  # a matrix of one column
                object.__setattr__(self, "value", tuple(values.tolist()))

    @cached_property
    def size(self) -> int:
        """Number of scalars."""
        return self.symbol.numel()

    def check(self, values: np.ndarray) -> None:
        """Refuse values beyond the bounds.

        Parameters
        ----------
        values : ndarray
            Numbers that shall take the symbols' place.

        Raises
        ------
        ArgumentError
            If one is too small, too large or, where there are bounds, not a number.
        """
        if self.lower == -math.inf and self.upper == math.inf:
            return  # NaN may pass: a simulation reports it
        outside = values[~((self.lower <= values) & (values <= self.upper))]
        if outside.size:
            raise ArgumentError(f"{self.name} must be {self._range}, not {outside.flat[0]:g}")

    @property
    def _range(self) -> str:
        least = {TINY: "positive", 0.0: "0 or above"}.get(self.lower, f"at least {self.lower:g}")
        bounds = ((self.lower, least), (self.upper, f"at most {self.upper:g}"))
        return " and ".join(words for bound, words in bounds if math.isfinite(bound))


@dataclass(frozen=True, eq=False)
class Output:
    """A named expression of the model's symbols.

    Parameters
    ----------
    name : str
        For instance ``"actuator_force"``.
    expression : casadi.SX
        Column of the model's symbols.
    unit : str, optional
        Quantity it measures, for instance ``"force"``; see `Signal`.

    Raises
    ------
    ArgumentError
        If the expression is no casadi.SX or the unit is unknown.

    Examples
    --------
    >>> import casadi as ca
    >>> v = ca.SX.sym("v")
    >>> block = Model("block", [Signal("velocity", v)], -v, outputs=[Output("energy", v**2 / 2)])
    >>> block.outputs[0].name
    'energy'
    """

    name: str
    expression: ca.SX
    unit: str = "1"

    def __post_init__(self) -> None:
        check_name("output", self.name)
        _symbolic(f"output {self.name}", "expression", self.expression)
        if self.expression.numel() and not self.expression.is_column():
            raise ArgumentError(
                f"output {self.name}: expression must be a column, not of the shape "
                f"{self.expression.shape}; use ca.vec"
            )
        _check_quantity(self.name, self.unit)


@dataclass(frozen=True, eq=False)
class Contact:
    """One point where the worm touches the ground.

    It moves along a line, or in the plane where its law is one of `wormopt.model.planar_friction`:
    velocity and force have two components then, along the heading and to the left of it.

    Parameters
    ----------
    name : str
        Which point, for instance ``"mass 0"``.
    velocity : casadi.SX
        Tangential velocity, an expression of the states: a scalar, in the plane a column of 2.
    force : casadi.SX
        Symbol of the tangential force, of the same size; the model's ``ode`` is affine in it.
    law : Law or PlanarLaw
        Friction law.
    nominal_force, nominal_speed : float, optional
        Usual sizes, by which solvers scale force and velocity.
    gap, normal_force : casadi.SX, optional
        Distance to a wall and the symbol of the normal force, for unilateral walls.

    Raises
    ------
    ArgumentError
        If there is no law, velocity, force or walls do not fit it or are no casadi.SX, or a
        nominal size is not positive.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> v, force = ca.SX.sym("v"), ca.SX.sym("force")
    >>> sole = Contact("sole", v, force, wo.Coulomb(1.0, 2.0))
    >>> sole.planar, sole.law.stick_interval
    (False, (-1.0, 2.0))
    """

    name: str
    velocity: ca.SX
    force: ca.SX
    law: Any  # Law, or PlanarLaw in the plane: code that supports only one refuses the other
    nominal_force: float = 1.0
    nominal_speed: float = 1.0
    gap: ca.SX | None = None
    normal_force: ca.SX | None = None

    def __post_init__(self) -> None:
        check_name("contact", self.name)
        whose, law = f"contact {self.name}", self.law
        if isinstance(law, type) or not hasattr(law, "slip_force"):  # both kinds of laws have it
            given = f"the class {law.__name__}" if isinstance(law, type) else f"{law!r:.60}"
            raise ArgumentError(
                f"{whose}: law must be a friction law such as Coulomb(1.0, 10.0), not {given}"
            )
        _symbolic(whose, "velocity", self.velocity)
        _symbolic(whose, "force", self.force, pure=True)
        make_plain(self, "nominal_force", "nominal_speed")
        for what in ("nominal_force", "nominal_speed"):
            _check_nominal(whose, what, getattr(self, what))
        for what in ("gap", "normal_force"):
            if (given := getattr(self, what)) is not None:
                _symbolic(whose, what, given, pure=what == "normal_force")
                if not given.is_scalar():
                    raise ArgumentError(f"{whose}: {what} must be a scalar, not {given!s:.60}")
        shape = (2, 1) if self.planar else (1, 1)
        if self.velocity.size() != shape or self.force.size() != shape:
            be = "columns of 2, because its law is planar" if self.planar else "scalars"
            raise ArgumentError(f"contact {self.name}: velocity and force must be {be}")
        if self.planar and (self.gap is not None or self.normal_force is not None):
            raise ArgumentError(f"contact {self.name}: a wall needs a law along a line")

    @property
    def planar(self) -> bool:
        """Whether it moves in the plane: only a PlanarLaw has a gauge."""
        return hasattr(self.law, "gauge")  # checking the protocol takes a hundred times as long


@dataclass(frozen=True, eq=False)
class Switch:
    """A discrete event of the model itself: when ``guard`` rises through 0, x becomes ``reset``.

    Parameters
    ----------
    name : str
        Name of the event.
    guard : casadi.SX
        Scalar expression that rises through 0 at the event; continuous, except at jumps by
        schedules, impulses and other switches.
    reset : casadi.SX
        Column of the states after it.
    terminal : bool, optional
        Whether the motion ends with it.
    crosses : bool, optional
        Whether the motion must leave the guard after it; one that is led back to it at once is
        refused.

    Raises
    ------
    ArgumentError
        If the guard is no scalar, or guard or reset are no casadi.SX.

    Examples
    --------
    A ball that bounces: its velocity turns round when its height falls through 0.

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> y, v = ca.SX.sym("y"), ca.SX.sym("v")
    >>> states = [wo.Signal("height", y, value=0.5), wo.Signal("velocity", v, value=0.0)]
    >>> bounce = wo.Switch("bounce", guard=-y, reset=ca.vertcat(0, -v))
    >>> ball = wo.Model("ball", states, ca.vertcat(v, -1), switches=[bounce])
    >>> motion = wo.simulate(ball, 2.0)
    >>> motion.end.round(9), [round(event.time, 9) for event in motion.events]
    (array([0.5, 0. ]), [1.0])
    """

    name: str
    guard: ca.SX
    reset: ca.SX
    terminal: bool = False
    crosses: bool = False

    def __post_init__(self) -> None:
        check_name("switch", self.name)
        for what in ("terminal", "crosses"):
            check_flag(f"switch {self.name}: {what}", getattr(self, what))
        for what in ("guard", "reset"):
            _symbolic(f"switch {self.name}", what, getattr(self, what))
        if self.guard.numel() != 1:
            raise ArgumentError(
                f"switch {self.name}: guard must be a scalar, not of {self.guard.numel()} entries"
            )


@dataclass(frozen=True, eq=False)
class Model:
    """A worm as a differential(-algebraic) system with contacts.

    x' = ode(t, x, z, u, p, contact forces), 0 = alg(t, x, z, u, p). The ode is affine in the
    contact forces. The solver chooses the treatment of contacts, not the model.

    Parameters
    ----------
    name : str
        Name of the model.
    x : sequence of Signal
        States.
    ode : casadi.SX
        Column of the states' time derivatives, in the order of ``x``.
    u, z, p : sequence of Signal, optional
        Inputs, algebraic variables, parameters.
    alg : casadi.SX, optional
        Column of algebraic equations for ``z``.
    t : casadi.SX, optional
        Symbol of time, if the model depends on it.
    outputs : sequence of Output, optional
        Expressions that users see or bound.
    contacts : sequence of Contact, optional
        Contacts with the ground.
    switches : sequence of Switch, optional
        Discrete events.
    schedules : sequence of Schedule, optional
        Symbols that are constant on pieces of time.
    delays : sequence of Delay, optional
        Symbols that are past values of signals; methods without delays refuse them.

    Raises
    ------
    ArgumentError
        If a part is no list of its kind, equations are no casadi.SX, the ode's length is not the
        number of states, a switch has not the right size, two signals share a name, a symbol
        belongs to two parts, or an expression holds a symbol that belongs to none.

    Examples
    --------
    >>> import casadi as ca
    >>> v, f = ca.SX.sym("v"), ca.SX.sym("f")
    >>> block = Model("block", x=[Signal("velocity", v)], ode=f - 1, u=[Signal("force", f)])
    >>> block.n_x
    1
    """

    name: str
    x: Sequence[Signal]
    ode: ca.SX
    u: Sequence[Signal] = ()
    z: Sequence[Signal] = ()
    p: Sequence[Signal] = ()
    alg: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    t: ca.SX = field(default_factory=lambda: ca.SX.sym("t"))  # type: ignore[no-any-return]
    outputs: Sequence[Output] = ()
    contacts: Sequence[Contact] = ()
    switches: Sequence[Switch] = ()
    schedules: Sequence[Schedule] = ()
    delays: Sequence[Delay] = ()

    def __post_init__(self) -> None:
        check_name("model", self.name)
        whose = f"model {self.name}"
        for what, kind in _PARTS.items():
            check_kinds(f"{whose}: {what}", getattr(self, what), kind)
        for what in ("ode", "alg"):
            _symbolic(whose, what, getattr(self, what))
        _symbolic(whose, "t", self.t, pure=True)
        if not self.t.is_scalar():
            raise ArgumentError(f"{whose}: t must be a scalar symbol, not {self.t!s:.60}")
        self._check_names()
        _check_column(whose, "ode", self.ode, self.n_x, "state")
        _check_column(whose, "alg", self.alg, sum(s.size for s in self.z), "entry of z")
        for switch in self.switches:
            _check_column(f"switch {switch.name}", "reset", switch.reset, self.n_x, "state")
        check_symbols(whose, self.symbols, self._expressions, _OWNERS, self._of_laws)
        self._check_velocities()

    @property
    def symbols(self) -> list[ca.SX]:
        """Columns of all symbols allowed in its expressions."""
        walls = [c.normal_force for c in self.contacts if c.normal_force is not None]
        schedules = [column for s in self.schedules for column in (s.symbol, s.begin)]
        signals = [*self.x, *self.z, *self.u, *self.p, *self.delays]
        forces = [c.force for c in self.contacts]
        return [self.t, *(s.symbol for s in signals), *forces, *walls, *schedules]

    def _expressions(self) -> Iterator[tuple[str, ca.SX]]:
        yield "ode", self.ode
        yield "alg", self.alg
        for output in self.outputs:
            yield f"output {output.name}", output.expression
        for contact in self.contacts:
            yield f"velocity of contact {contact.name}", contact.velocity
            if contact.gap is not None:
                yield f"gap of contact {contact.name}", contact.gap
        for switch in self.switches:
            yield f"guard of switch {switch.name}", switch.guard
            yield f"reset of switch {switch.name}", switch.reset
        for delay in self.delays:
            for what in ("signal", "lag", "before"):
                if isinstance(part := getattr(delay, what), ca.SX):
                    yield f"{what} of delay {delay.name}", part

    def _check_names(self) -> None:
        whose = f"model {self.name}"
        others = (*self.z, *self.u, *self.p, *self.delays)
        _check_names(whose, "signals", [signal.name for signal in (*self.x, *others)])
        # an output may have the name of an input or an algebraic variable and show it
        _check_names(whose, "states or outputs", [part.name for part in (*self.x, *self.outputs)])
        for what in ("contacts", "switches", "schedules"):
            _check_names(whose, what, [part.name for part in getattr(self, what)])

    def _check_velocities(self) -> None:
        """Refuse contact forces in contact velocities: laws could not determine the forces."""
        walls = (c.normal_force for c in self.contacts if c.normal_force is not None)
        forces = ca.vertcat(self.forces, *walls)
        if not ca.depends_on(self.contact_velocities, forces):
            return
        name = next(c.name for c in self.contacts if ca.depends_on(c.velocity, forces))
        raise ArgumentError(
            f"contact {name}: velocity depends on contact forces; write it in terms of the states"
        )

    def check_laws(self) -> None:
        """Refuse friction laws with symbols that belong to no part of the model.

        A Model may lack them, as builders take laws before a Model takes their symbols.

        Raises
        ------
        ArgumentError
            If there are any.
        """
        if not self._of_laws().numel():
            return
        known = ca.vertcat(*map(ca.vec, self.symbols))
        for contact in self.contacts:
            for name, number in fields_of(contact.law).items():
                if not isinstance(number, ca.SX):
                    continue
                own = ca.Function("own", [known], [number], {"allow_free": True})
                if free := own.free_sx():
                    raise ArgumentError(
                        f"model {self.name}: {name} of the law of contact {contact.name} holds "
                        f"symbols that belong to none of its parts: {free[0]}; add "
                        f"Signal({str(free[0])!r}, {free[0]}, value=...) to p"
                    )

    def _of_laws(self) -> ca.SX:
        """Symbols in the laws: builders use them before the Model declares them as parameters."""
        numbers = (fields_of(contact.law).values() for contact in self.contacts)
        own = [ca.vec(one) for each in numbers for one in each if isinstance(one, ca.SX)]
        return ca.vertcat(_NONE, *own)

    def __repr__(self) -> str:
        parts = {"states": self.x, "algebraic": self.z, "inputs": self.u, "parameters": self.p}
        known = [f"{what} {listed(signals)}" for what, signals in parts.items() if signals]
        touching = ", ".join(contact.name for contact in self.contacts)
        contacts = f"contacts {touching}" if touching else "no contacts"
        return lines(f"Model {self.name}: {'; '.join(known[:1])}; {contacts}", "; ".join(known[1:]))

    @property
    def n_x(self) -> int:
        """Number of scalar states."""
        return sum(s.size for s in self.x)

    def refuse_delays(self, what: str) -> None:
        """Refuse a model with delays in a method that does not support them.

        Parameters
        ----------
        what : str
            Method that does not support delays.

        Raises
        ------
        ArgumentError
            If there are any.
        """
        if self.delays:
            names = ", ".join(delay.name for delay in self.delays)
            raise ArgumentError(f"{what} does not support delays, and {self.name} has {names}")

    @property
    def forces(self) -> ca.SX:
        """Column of the contacts' force symbols, two for a contact in the plane."""
        return ca.vertcat(ca.SX(0, 1), *(c.force for c in self.contacts))

    @property
    def contact_velocities(self) -> ca.SX:
        """Column of the contacts' velocities, two for a contact in the plane."""
        return ca.vertcat(ca.SX(0, 1), *(c.velocity for c in self.contacts))

    @property
    def contact_accelerations(self) -> ca.SX:
        """Column of the time derivatives of the contact velocities along the ode."""
        return lie(self, self.contact_velocities)

    @property
    def delassus(self) -> ca.SX:
        """Matrix d(contact accelerations) / d(contact forces), which decides modes of contacts."""
        return ca.jacobian(self.contact_accelerations, self.forces)

    def places(self) -> tuple[Signal, ...]:
        """Signals of the positions, if the states are positions followed by their rates.

        Returns
        -------
        tuple of Signal
            The first half of the states, whose time derivatives are the second half.

        Raises
        ------
        ArgumentError
            If the model is not of this form.

        Examples
        --------
        >>> import casadi as ca
        >>> y, v = ca.SX.sym("y", 2), ca.SX.sym("v", 2)
        >>> pair = Model("pair", [Signal("height", y), Signal("rate", v)], ca.vertcat(v, -y))
        >>> [place.name for place in pair.places()]
        ['height']
        """
        half, x = self.n_x // 2, pack(self.x)
        ends = np.cumsum([0, *(s.size for s in self.x)]).tolist()
        even = half in ends and 2 * half == self.n_x
        if not even or not ca.is_equal(ca.densify(self.ode[:half]), x[half:]):
            raise ArgumentError(f"{self.name}: states must be coordinates, followed by their rates")
        return tuple(self.x[: ends.index(half)])

    def breaks(self, end: float) -> np.ndarray:
        """Times at which a schedule changes to its next piece.

        Parameters
        ----------
        end : float
            Last time.

        Returns
        -------
        ndarray, shape (m,)
            From 0 to ``end``, both included; without those equal up to round-off.
        """
        inner = [one.breaks_between(0.0, end * (1 - 1e-12)) for one in self.schedules]
        times = np.unique(np.concatenate([[0.0, end], *inner]))
        return times[np.diff(times, prepend=-np.inf) > 1e-12 * end]

    def __getitem__(self, name: str) -> ca.SX:
        """Symbol of a state, algebraic variable, input, parameter or delay, or an output.

        UnknownNameError, a KeyError, where there is none; the message lists those there are.
        """
        found = {signal.name: signal.symbol for signal in self.x}
        for output in self.outputs:
            found.setdefault(output.name, output.expression)
        for signal in (*self.z, *self.u, *self.p, *self.delays):
            found.setdefault(signal.name, signal.symbol)
        if name not in found:
            raise UnknownNameError(self.name, "signal", [name], list(found))
        return found[name]

    def to_control(
        self,
        *,
        output: str | Sequence[str],
        v_reg: float = 1 / 40,
        p: Mapping[str, ArrayLike] | None = None,
    ) -> Any:
        """Make a control.NonlinearIOSystem of it, for the tools of python-control.

        Contacts follow the smooth law. Schedules are followed, but python-control's integrators
        do not know where they break.

        Parameters
        ----------
        output : str or sequence of str
            Names of its outputs.
        v_reg : float, optional
            Width of the smooth law, positive.
        p : mapping of str to array_like, optional
            Parameters by name, where they are not the model's own.

        Returns
        -------
        control.NonlinearIOSystem
            Signals are called ``position[0]``, ``input[1]`` and so on; ``params`` holds the
            parameters by name, ``v_reg`` among them.

        Raises
        ------
        ArgumentError
            If names or sizes do not fit, or the model has switches or algebraic variables.
        UnknownNameError
            If there is no such output.
        """
        # imported only when needed
        from wormopt.model.explicit import Explicit

        return Explicit(self, output).to_control(v_reg, p or {})


_NONE = ca.SX(0, 1)
_OWNERS = (
    "add them to the Model in x, z, u, p or t, or with their schedules, delays or contacts; "
    "in dataclasses.replace, replace them and the expressions together"
)
# Symbols named in a message.
_NAMED = 5


def check_symbols(
    whose: str,
    known: Sequence[ca.SX],
    expressions: Callable[[], Iterable[tuple[str, ca.SX]]],
    remedy: str,
    others: Callable[[], ca.SX] = lambda: _NONE,
) -> None:
    """Refuse symbols that occur twice among the known ones, or in expressions but not there.

    `expressions`: what each is called, and itself; `remedy` ends the message of ArgumentError;
    symbols in `others` pass.
    """
    held = [one if one.is_column() else ca.vec(one) for _, one in expressions()]
    # CasADi checks long columns; scalars, which may be thousands of forces, are looked up
    columns = [column for column in known if column.numel() > 1]
    scalars = [column for column in known if column.numel() == 1]
    own = {symbol.element_hash() for symbol in scalars}
    try:
        inner = ca.Function("own", columns, [ca.vertcat(ca.SX(0, 1), *held)], {"allow_free": True})
    except RuntimeError:  # a symbol occurs twice
        inner = None
    if inner is None or len(own) < len(scalars):
        each = Counter(str(symbol) for column in known for symbol in ca.vertsplit(column))
        twice = each.most_common(1)[0][0]
        raise ArgumentError(f"{whose}: the symbol {twice} belongs to two of its parts")
    stray = [symbol for symbol in inner.free_sx() if symbol.element_hash() not in own]
    if stray:
        passed = {symbol.element_hash() for symbol in ca.symvar(others())}
        stray = [symbol for symbol in stray if symbol.element_hash() not in passed]
    if stray:
        where = next(what for what, one in expressions() if ca.depends_on(one, stray[0]))
        listed_there = ", ".join(str(s) for s in stray[:_NAMED]) + ", ..." * (len(stray) > _NAMED)
        raise ArgumentError(
            f"{whose}: {where} holds symbols that belong to none of its parts: {listed_there}; "
            f"{remedy}"
        )


_PARTS = dict.fromkeys("xuzp", Signal) | {
    "outputs": Output,
    "contacts": Contact,
    "switches": Switch,
    "schedules": Schedule,
    "delays": Delay,
}


def pack(signals: Sequence[Signal | Delay]) -> ca.SX:
    """Stack the signals' symbols, in order, into one column; empty for no signals."""
    return ca.vertcat(ca.SX(0, 1), *(s.symbol for s in signals))


def lie(model: Model, expression: ca.SX) -> ca.SX:
    """Time derivative along a model's ode of a column of its states and time."""
    if ca.depends_on(expression, pack(model.delays)):
        raise ArgumentError(f"{model.name}: rates of delayed signals are unknown")
    return ca.jtimes(expression, pack(model.x), model.ode) + ca.jacobian(expression, model.t)
