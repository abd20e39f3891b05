"""Conditions in a Model: jumps and kinks of its right-hand side, found in its expressions.

An integrator that steps over a jump loses its order, and one that steps over a pulse misses it.
Therefore conditions of time become a schedule, and conditions of states at which the right-hand
side jumps become switches: in between the value of each is constant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from wormopt.model.given import fields_of
from wormopt.model.model import Contact, Model, Signal, Switch, pack
from wormopt.model.schedule import Schedule
from wormopt.model.values import nominal_of, signal_values
from wormopt.numerics.expressions import Call, instructions_of

NAME = "held conditions"
"""Name of the schedule and of the state with the values of conditions."""

# What a result depends on.
_TIME, _FIXED, _PIECES, _STATE = 1, 2, 4, 8

# Distance, in nominal sizes, at which guards are searched, and at which they count as reached.
_TRIALS, _WIDEST, _NEAR, _NEWTON, _AT_GUARD = 24, 4, 3, 12, 1e-12
# With more conditions than this, neighbouring ones are not examined; with still more, as in
# averages, which are continuous, none are.
_FEW, _MOST = 8, 24
# Side of a guard that is 0 for a while.
_BARELY = 1e-280
# Share of the right-hand side that is no jump but rounding.
_JUMP, _ROUNDING = 1e-8, 1e-14
# How far beyond its guard, in nominal sizes, a held value must be defined.
_BEYOND = 1e-3


class _Kind(NamedTuple):
    """How a condition is decided, and its replacement."""

    says: Callable[..., ca.SX]  # its value
    guard: Callable[..., ca.SX]  # the value changes where this passes 0, or a bound
    instead: Callable[..., ca.SX]  # the operation, of the value held and its arguments
    # where the value is m it changes to m - 1 below the first bound, to m + 1 above the second;
    # then whether the bound itself belongs to the new value
    bounds: Callable[[ca.SX], tuple[ca.SX, ca.SX, ca.SX, ca.SX]] | None = None
    jumps: bool = True  # or has kinks only
    # without bounds: its value where the guard is negative, positive and 0
    sides: tuple[float, float, float] = (0.0, 1.0, 0.0)


def _difference(a: ca.SX, b: ca.SX) -> ca.SX:
    return b - a


def _same(a: ca.SX) -> ca.SX:
    return a


def _second(_: ca.SX, b: ca.SX) -> ca.SX:
    return b


def _held(m: ca.SX, *_: ca.SX) -> ca.SX:
    return m


def _sign_of(b: ca.SX) -> ca.SX:
    return 1 - 2 * (b < 0)


def _whole(a: ca.SX) -> ca.SX:
    return ca.if_else(a < 0, ca.ceil(a), ca.floor(a))


_NO, _YES = ca.SX(0), ca.SX(1)
_KINDS = {
    ca.OP_LT: _Kind(lambda a, b: a < b, _difference, _held),
    ca.OP_LE: _Kind(lambda a, b: a <= b, _difference, _held, sides=(0.0, 1.0, 1.0)),
    ca.OP_FLOOR: _Kind(ca.floor, _same, _held, lambda m: (m, m + 1, _NO, _YES)),
    ca.OP_CEIL: _Kind(ca.ceil, _same, _held, lambda m: (m - 1, m, _YES, _NO)),
    ca.OP_FMOD: _Kind(
        lambda a, b: _whole(a / b),
        lambda a, b: a / b,
        lambda m, a, b: a - m * b,
        lambda m: (m - (m <= 0), m + (m >= 0), m <= 0, m >= 0),
    ),
    ca.OP_COPYSIGN: _Kind(
        lambda _, b: _sign_of(b),
        _second,
        lambda m, a, _: m * ca.fabs(a),
        sides=(-1.0, 1.0, 1.0),
    ),
    ca.OP_FABS: _Kind(_sign_of, _same, lambda m, a: m * a, jumps=False),
    ca.OP_FMIN: _Kind(lambda a, b: a < b, _difference, ca.if_else, jumps=False),
    ca.OP_FMAX: _Kind(
        lambda a, b: a < b, _difference, lambda m, a, b: ca.if_else(m, b, a), jumps=False
    ),
}
_JUMPING = [operation for operation, kind in _KINDS.items() if kind.jumps]

# Functions of time that may be narrow. Polynomials are not; functions of narrow ones are.
_CURVED = (
    *(ca.OP_EXP, ca.OP_EXPM1, ca.OP_LOG, ca.OP_LOG1P, ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW),
    *(ca.OP_DIV, ca.OP_INV, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN),
    *(ca.OP_SINH, ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ACOSH, ca.OP_ATANH, ca.OP_ERF),
    *(ca.OP_ATAN2, ca.OP_HYPOT),
)
# Most of them that are examined.
_MOST_COURSES = 2000


@dataclass(frozen=True, eq=False)
class Timed:
    """Functions of time in a model's right-hand side, in terms of the symbols `inputs`."""

    inputs: ca.SX  # column of time, parameters, inputs and, of each schedule, begin and symbol
    n_fixed: int  # how many parameters and inputs there are
    values: ca.SX  # column, values of conditions
    guards: ca.SX  # column; values change where these pass 0 or a whole number
    sizes: ca.SX  # column, sizes of the terms of guards
    levels: np.ndarray  # (m,) whether at whole numbers
    jumps: np.ndarray  # (m,) whether a value jumps, or only has a kink
    nested: np.ndarray  # (m,) whether a guard may jump, by other conditions
    jumping: ca.SX  # column, guards of those that jump
    courses: ca.SX  # column of functions that may be narrow
    complete: bool  # whether these are all of them


@dataclass(frozen=True, eq=False)
class Lifted:
    """A model whose conditions are held between the instants at which they change.

    Those of time are the last schedule of the model, whose breaks are not known yet; those of
    states are its last state.
    """

    model: Model
    timed: Timed
    start: ca.SX  # initial values of the last state, in terms of all before it and the schedules

    @property
    def held(self) -> int:
        """Number of held conditions of states."""
        return self.start.numel()


@lru_cache(maxsize=64)
def lifted(model: Model, states: bool, *, moving: bool) -> Lifted | None:
    """Hold the conditions of a model; None if there are none.

    `states`: also those of states, for integrators with switches. `moving`: jumps at instants of
    time are switches too, so that derivatives include the motion of the instants.
    """
    graph = _Graph(model)
    return graph.lifted(states, moving) if graph.may_hold(states=states) else None


def may_have(model: Model, operations: np.ndarray) -> bool:
    """Whether a model may have conditions, or narrow functions of time.

    `operations`: those of a function that contains its ode.
    """
    if np.isin(operations, [ca.OP_SIGN, *_KINDS]).any() or any(
        _composed(c) for c in model.contacts
    ):
        return True
    curved = np.isin(operations, _CURVED).any()
    return bool(curved and ca.depends_on(expressions_of(model), model.t))


def expressions_of(model: Model) -> ca.SX:
    """Column of all expressions of a model's right-hand side, then delayed signals."""
    laws = [s for c in model.contacts for s in _composed(c).values()]
    guards = [switch.guard for switch in model.switches]
    past = [delay.signal for delay in model.delays]
    return ca.vertcat(model.ode, model.alg, model.contact_velocities, *laws, *guards, *past)


def _composed(contact: Contact) -> dict[str, ca.SX]:
    """Expressions of a contact's law other than single symbols."""
    fields = fields_of(contact.law).items()
    return {k: v for k, v in fields if isinstance(v, ca.SX) and not v.is_valid_input()}


@dataclass(frozen=True, eq=False)
class _Condition:
    kind: _Kind
    depends: int
    at: int  # instruction
    arguments: list[ca.SX]  # as they are
    symbol: ca.SX

    @property
    def of_time(self) -> bool:
        return not self.depends & _STATE

    @property
    def guard(self) -> ca.SX:
        return self.kind.guard(*self.arguments)

    @property
    def size(self) -> ca.SX:
        if self.kind.guard is not _difference:
            return ca.fabs(self.guard)
        return ca.fabs(self.arguments[0]) + ca.fabs(self.arguments[1])

    @property
    def value(self) -> ca.SX:
        return self.kind.says(*self.arguments)

    @property
    def is_nested(self) -> bool:
        """Whether its guard may jump."""
        symbols = ca.vertcat(*ca.symvar(self.guard))
        operations = instructions_of(ca.Function("guard", [symbols], [ca.densify(self.guard)]))[0]
        return bool(np.isin(operations, _JUMPING).any())


class _Sides(NamedTuple):
    """Functions of the symbols to examine conditions of states."""

    look: Call  # values of conditions, and their guards
    slopes: Call  # of the guards, by states
    right: Call  # results and guards, also in terms of held values
    results: int  # and guards
    nested: list[bool]  # whether a guard depends on other conditions
    two: np.ndarray  # conditions with two values


class _Graph:
    """Instructions of a model's right-hand side."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._states = ca.vertcat(pack(model.x), pack(model.z), model.forces, pack(model.delays))
        pieces = ca.vertcat(*(ca.vertcat(s.begin, s.symbol) for s in model.schedules))
        fixed = ca.vertcat(pack(model.p), pack(model.u))
        kinds = ((model.t, _TIME), (fixed, _FIXED), (pieces, _PIECES), (self._states, _STATE))
        self._symbols = ca.vertcat(*(symbols for symbols, _ in kinds))
        self._kinds = np.repeat([kind for _, kind in kinds], [s.numel() for s, _ in kinds]).tolist()
        self._read(ca.densify(expressions_of(model)))

    def _read(self, expression: ca.SX) -> None:
        self._function = ca.Function("f", [self._symbols], [expression])
        self._operations, self._places = (part.tolist() for part in instructions_of(self._function))

    def may_hold(self, *, states: bool) -> bool:
        """Whether there may be anything to hold, without conditions of states unless asked for."""
        work = [0] * self._function.sz_w()
        for operation, (target, *source) in zip(self._operations, self._places, strict=True):
            if operation == ca.OP_OUTPUT:
                continue
            if operation == ca.OP_INPUT:
                work[target] = self._kinds[source[1]]
                continue
            depends = 0
            for i in source:
                if i >= 0:
                    depends |= work[i]
            work[target] = depends
            if depends & _STATE:
                if states and (operation in _KINDS or operation == ca.OP_SIGN):
                    return True
            elif depends & _TIME and (
                operation in _KINDS or operation == ca.OP_SIGN or operation in _CURVED
            ):
                return True
        return False

    def _sides(self, k: int, arguments: list[ca.SX], _: int) -> ca.SX | None:
        """Two comparisons for a sign, which has three values."""
        if self._operations[k] != ca.OP_SIGN:
            return None
        (a,) = arguments
        return (a > 0) - (a < 0)

    def _walk(
        self,
        instead: Callable[[int, list[ca.SX], int], ca.SX | None],
        until: int = _TIME | _FIXED | _PIECES | _STATE,
    ) -> ca.SX:
        """Rebuild the expressions; `instead` may replace an operation."""
        # It is given the instruction, its arguments and their dependence. Expressions that depend
        # on more than `until` are left out.
        nothing = ca.SX(0)
        work = [(nothing, 0)] * self._function.sz_w()
        result = [nothing] * self._function.nnz_out(0)
        for k, (operation, place) in enumerate(zip(self._operations, self._places, strict=True)):
            target, *source = place
            if operation == ca.OP_INPUT:
                work[target] = self._symbols[source[1]], self._kinds[source[1]]
            elif operation == ca.OP_OUTPUT:
                result[place[1]] = work[place[2]][0]
            elif operation == ca.OP_CONST:
                work[target] = ca.SX(self._function.instruction_constant(k)), 0
            else:
                parts = [work[i] for i in source if i >= 0]
                depends = 0
                for _, each in parts:
                    depends |= each
                if depends | until != until:
                    work[target] = nothing, depends
                    continue
                arguments = [part for part, _ in parts]
                found = instead(k, arguments, depends)
                if found is None:
                    apply = ca.SX.unary if len(arguments) == 1 else ca.SX.binary
                    found = apply(operation, *arguments)
                work[target] = found, depends
        return ca.vertcat(*result)

    def _conditions(self) -> list[_Condition]:
        """Conditions that change with time or states."""
        found = list[_Condition]()

        def note(k: int, arguments: list[ca.SX], depends: int) -> None:
            kind = _KINDS.get(self._operations[k])
            if kind is None or not depends & (_TIME | _STATE):
                return
            if kind.jumps or not depends & _STATE:
                symbol = ca.SX.sym(f"condition_{len(found)}")
                found.append(_Condition(kind, depends, k, arguments, symbol))

        if not np.isin(self._operations, list(_KINDS)).any():
            return []
        self._walk(note)
        return found

    def _courses(self) -> ca.SX:
        """Functions of time that may be narrow, without duplicates."""
        found = dict[int, ca.SX]()

        def note(k: int, arguments: list[ca.SX], depends: int) -> ca.SX | None:
            operation = self._operations[k]
            if operation in (ca.OP_DIV, ca.OP_INV) and not ca.depends_on(
                arguments[-1], self._model.t
            ):
                return None  # depends on no symbol
            if operation in _CURVED and depends & _TIME:
                apply = ca.SX.unary if len(arguments) == 1 else ca.SX.binary
                course = apply(operation, *arguments)
                return found.setdefault(course.element_hash(), course)
            return None

        if ca.depends_on(self._function(self._symbols), self._model.t):
            self._walk(note, until=_TIME | _FIXED | _PIECES)
        return ca.vertcat(ca.SX(0, 1), *found.values())

    def _holding(self, chosen: Sequence[_Condition]) -> tuple[ca.SX, dict[int, list[ca.SX]]]:
        """Expressions with held conditions, and the arguments of these."""
        at, arguments_of = {c.at: c for c in chosen}, dict[int, list[ca.SX]]()

        def hold(k: int, arguments: list[ca.SX], _: int) -> ca.SX | None:
            if k not in at:
                return None
            arguments_of[k] = arguments
            return at[k].kind.instead(at[k].symbol, *arguments)

        return self._walk(hold), arguments_of

    def lifted(self, states: bool, moving: bool) -> Lifted | None:
        """The model with held conditions; None if there are none."""
        if ca.OP_SIGN in self._operations:
            self._read(self._walk(self._sides))
        conditions = self._conditions()
        timed = [c for c in conditions if c.of_time]
        jumps = self._jumping([c for c in conditions if not c.of_time]) if states else []
        switched = [*jumps, *(c for c in timed if c.kind.jumps)] if moving else jumps
        courses = self._courses()
        if not (timed or jumps or courses.numel()):
            return None
        model = self._model
        inputs = self._symbols[: self._symbols.numel() - self._states.numel()]
        found = Timed(
            inputs,
            n_fixed=sum(s.size for s in (*model.p, *model.u)),
            values=ca.vertcat(ca.SX(0, 1), *(c.value for c in timed)),
            guards=ca.vertcat(ca.SX(0, 1), *(c.guard for c in timed)),
            sizes=ca.vertcat(ca.SX(0, 1), *(c.size for c in timed)),
            levels=np.array([c.kind.bounds is not None for c in timed], dtype=bool),
            jumps=np.array([c.kind.jumps for c in timed], dtype=bool),
            nested=np.array([c.is_nested for c in timed], dtype=bool),
            jumping=ca.vertcat(ca.SX(0, 1), *(c.guard for c in timed if c.kind.jumps)),
            courses=ca.vertcat(ca.SX(0, 1), *ca.vertsplit(courses)[:_MOST_COURSES]),
            complete=courses.numel() <= _MOST_COURSES,
        )
        scheduled = [c for c in timed if c not in switched]
        arguments, changes = dict[int, list[ca.SX]](), dict[str, Any]()
        if timed or jumps:
            expressions, arguments = self._holding([*timed, *jumps])
            changes = _with(model, expressions)
            if switched:
                changes |= _switched(model, changes, switched, arguments)
        # for switches the schedule has the instants only
        symbols = [c.symbol if c in scheduled else ca.SX.sym("unused") for c in timed]
        symbols = ca.vertcat(ca.SX(0, 1), *symbols)
        pieces = Schedule(
            NAME,
            symbols,
            ca.SX.sym("begin"),
            np.array([0.0, 1.0]),
            np.zeros((1, len(timed))),
        )
        start = ca.SX(0, 1)
        for k, c in enumerate(switched):  # a condition depends on no later one
            before = ca.vertcat(ca.SX(0, 1), *(other.symbol for other in switched[:k]))
            start = ca.vertcat(start, ca.substitute(c.kind.says(*arguments[c.at]), before, start))
        changes["schedules"] = [*model.schedules, pieces]
        return Lifted(replace(model, **changes), found, start)

    def _jumping(self, candidates: list[_Condition]) -> list[_Condition]:
        """Conditions of states at which the right-hand side jumps."""
        model = self._model
        out_of_reach = ca.vertcat(pack(model.z), model.forces, pack(model.delays))
        reached = _depend([c.guard for c in candidates], out_of_reach)
        known = [c for c, lost in zip(candidates, reached, strict=True) if not lost]
        if not known or len(known) > _MOST:
            return []
        expressions, arguments = self._holding(known)
        held = ca.vertcat(*(c.symbol for c in known))
        values = ca.vertcat(*(c.value for c in known))
        guards = ca.vertcat(*(c.kind.guard(*arguments[c.at]) for c in known))
        nested = _depend(ca.vertsplit(guards), held)
        results, count = ca.densify(ca.vertcat(expressions, guards)), expressions.numel()
        right = ca.Function("right", [self._symbols, held], [results])
        guards = ca.substitute(guards, held, values)
        look, slopes = [ca.densify(values), ca.densify(guards)], ca.jacobian(guards, self._states)
        sides = _Sides(
            Call(ca.Function("look", [self._symbols], look)),
            Call(ca.Function("slopes", [self._symbols], [ca.densify(slopes)])),
            Call(right),
            results.numel(),
            nested,
            np.flatnonzero([c.kind.bounds is None for c in known]),
        )
        jumps = np.array([self._jumps(k, c.kind, sides) for k, c in enumerate(known)])
        chosen = jumps[:, :count].any(axis=1)
        for _ in known:  # their guards must not jump either
            chosen = chosen | jumps[:, count:][:, chosen].any(axis=1)
        return [known[k] for k in np.flatnonzero(chosen).tolist()]

    @np.errstate(all="ignore")  # values that are not finite are detected where they matter
    def _jumps(self, k: int, kind: _Kind, of: _Sides) -> np.ndarray:
        """Which results differ on both sides of a change of a condition."""
        random, (size, own) = np.random.default_rng(k), self._sizes()
        first, found = len(size) - self._states.numel(), np.zeros(of.results, dtype=bool)
        many = len(of.nested) > _FEW  # each look is slow then
        for trial in range(2 if many else _TRIALS):
            at = size * random.normal(size=len(size)) * 3.0 ** (trial % _WIDEST)
            at[1 : 1 + len(own)] = own
            # near other changes too: some conditions may be constant in a small region only
            near = random.permutation(np.setdiff1d(of.two, [k]))
            near = near[:0] if many or not trial else near[: random.integers(0, _NEAR + 1)]
            rows = np.append(k, near)
            off = random.choice([-1.0, 1.0], len(near)) * 10.0 ** random.uniform(-4, 0, len(near))
            targets = np.append(_target(kind, trial), off)
            steep, lacks = np.zeros((1, 1)), np.ones(1, dtype=bool)
            for _ in range(_NEWTON):
                levels = of.look(at)[1][rows]
                slopes = of.slopes(at)[0].reshape(len(of.nested), -1, order="F")
                steep = slopes[rows] * size[first:]
                lacks = np.abs(levels - targets) > _AT_GUARD * np.linalg.norm(steep, axis=1)
                if not lacks.any() or not np.all(np.isfinite(steep)):
                    break
                at[first:] -= size[first:] * (np.linalg.pinv(steep) @ (levels - targets))
            found_there = not lacks[0] and np.any(steep[0])
            if not found_there and not of.nested[k]:
                continue  # not found from here; a nested one may change where its guard jumps
            direction = np.zeros(len(at))
            if found_there:
                direction[first:] = size[first:] * steep[0] / np.linalg.norm(steep[0])
            sides, values = [], of.look(at)[0].copy()
            for values[k] in _around(kind, float(targets[0])):
                sides.append(of.right(at, values)[0].copy())
                for off in (-_BEYOND, _BEYOND):
                    # a held value may be undefined where a step may look
                    if not np.isfinite(of.right(at + off * direction, values)[0]).all():
                        return np.zeros_like(found)
            largest = np.maximum(*map(np.abs, sides))
            rounding = _ROUNDING * largest.max(initial=0.0)
            found |= np.abs(sides[1] - sides[0]) > np.maximum(_JUMP * largest, rounding)
        return found

    def _sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Nominal sizes of all symbols, and values of parameters and inputs."""
        model = self._model
        signals = (*model.p, *model.u)
        values = [replace(s, value=1.0 if s.value is None else s.value) for s in signals]
        size, usual = np.ones(self._symbols.numel()), nominal_of((*model.x, *model.z))
        first = len(size) - self._states.numel()
        size[first : first + len(usual)] = usual
        return size, signal_values(values, None, "parameter")


def _depend(each: list[ca.SX], on: ca.SX) -> list[bool]:
    """Which scalars depend on any of the symbols, found for all at once."""
    if not (each and on.numel()):
        return [False] * len(each)
    return list(ca.which_depends(ca.vertcat(*each), on, 1, True))


def _target(kind: _Kind, trial: int) -> float:
    """Values at which a guard is searched: 0, or successive whole numbers."""
    return (1.0, 2.0, -1.0, 3.0)[trial % 4] if kind.bounds else 0.0


def _around(kind: _Kind, level: float) -> tuple[float, float]:
    """Values on both sides of the change of a condition."""
    if kind.bounds is None:
        return kind.sides[:2]
    below = next(m for m in (level - 1, level) if float(kind.bounds(ca.SX(m))[1]) == level)
    return below, below + 1


def _with(model: Model, expressions: ca.SX) -> dict[str, Any]:
    """Parts of the model with other expressions, in the order of `expressions_of`."""
    # Delayed signals stay as they are: their memory is split at ends of steps.
    rest = iter(ca.vertsplit(expressions))

    def take(old: ca.SX) -> ca.SX:
        entries = [next(rest) for _ in range(old.numel())]
        return ca.reshape(ca.vertcat(ca.SX(0, 1), *entries), *old.shape)

    ode, alg = take(model.ode), take(model.alg)
    velocities = [take(c.velocity) for c in model.contacts]
    contacts = []
    for contact, velocity in zip(model.contacts, velocities, strict=True):
        fields = {name: take(old) for name, old in _composed(contact).items()}
        law = replace(contact.law, **fields) if fields else contact.law  # type: ignore[type-var]
        contacts.append(replace(contact, velocity=velocity, law=law))
    switches = [replace(switch, guard=take(switch.guard)) for switch in model.switches]
    return {"ode": ode, "alg": alg, "contacts": contacts, "switches": switches}


def _barely(at_guard: ca.SX) -> ca.SX:
    """Small shift of a guard: positive if the condition changes at the guard itself."""
    return _BARELY * (2 * at_guard - 1)


def _switched(
    model: Model,
    changes: Mapping[str, Any],
    jumps: list[_Condition],
    arguments: dict[int, list[ca.SX]],
) -> dict[str, Any]:
    """Parts of the model with a last state for its conditions, and switches that set it."""
    symbols, x = [c.symbol for c in jumps], pack(model.x)
    held = ca.vertcat(*symbols)
    switches = [replace(s, reset=ca.vertcat(s.reset, held)) for s in changes["switches"]]
    for k, c in enumerate(jumps):
        guard, m = c.kind.guard(*arguments[c.at]), c.symbol
        if c.kind.bounds:
            low, high, down, up = c.kind.bounds(m)
            passed = low - guard + _barely(down), guard - high + _barely(up)
            after = m + ca.if_else(passed[1] >= passed[0], 1, -1)
            guard = ca.fmax(*passed)
        else:
            least, most, at = c.kind.sides
            below = m < (least + most) / 2  # its value where the guard is negative
            up, down = _barely(ca.SX(at == most)), _barely(ca.SX(at == least))
            guard = ca.if_else(below, guard + up, down - guard)
            after = least + most - m
        column = [*symbols[:k], after, *symbols[k + 1 :]]
        name = f"{NAME} {k}"
        switches.append(Switch(name, guard, ca.vertcat(x, *column), crosses=True))
    ode = ca.vertcat(changes["ode"], ca.SX.zeros(len(jumps)))
    return {"x": [*model.x, Signal(NAME, held)], "ode": ode, "switches": switches}
