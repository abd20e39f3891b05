"""Variational equations of a System: derivatives of its functions along directions.

With the columns S = dx/d(direction) and P = dp/d(direction), integrators have the state x followed
by S row by row: S' = f_x S + f_p P. At an event whose time t* changes, S jumps: D = S + x' dt* is
the change of the state at the event itself. D passes resets and impulses by their derivatives, and
S = D - x' dt* with the x' after the event.

Slopes that are 0/0 where the motion is smooth, such as those of v |v| at rest, are limits. They are
estimated from three points ever closer along the motion, or on both sides if nothing moves.
Compiled in `take_limits` of native/variation.c.

Source: M. A. Aizerman, F. R. Gantmakher, Quarterly Journal of Mechanics and Applied Mathematics
11 (1958) 225; P. C. Müller, Chaos, Solitons & Fractals 5 (1995) 1671.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.schedule import Schedule
from wormopt.model.values import nominal_of, numbers
from wormopt.simulation.functions import System

Sensitivities = Sequence[str] | Mapping[str, Mapping[str, ArrayLike]]
"""Names of parameters, inputs, states and schedules, or a direction for each label."""

_FAR_BELOW = 0.01
_ENTRY = re.compile(r"(.*)\[\s*(\d+)\s*(?:,\s*(\d+)\s*)?\]")


@dataclass(frozen=True, eq=False)
class Directions:
    """k directions in the values of a motion: its start, its parameters and its schedules."""

    labels: tuple[str, ...]
    x0: np.ndarray  # (model.n_x, k)
    p: np.ndarray  # (n_p, k) of `System.parameters`; 0 for scheduled entries
    schedules: tuple[np.ndarray, ...]  # (pieces, size, k) of each

    @property
    def k(self) -> int:
        """How many there are."""
        return len(self.labels)

    def sizes(
        self,
        nominal_x: np.ndarray,
        p: np.ndarray,
        nominal_p: np.ndarray,
        schedules: Sequence[Schedule],
    ) -> np.ndarray:
        """Largest relative changes (k,) of each direction."""
        # Values far below their nominal size may matter, and are taken to have that size.
        size_p = np.where(np.abs(p) < _FAR_BELOW * nominal_p, nominal_p, np.abs(p))
        found = [self.x0 / nominal_x[:, None], self.p / size_p[:, None]]
        for schedule, along in zip(schedules, self.schedules, strict=True):
            largest = np.abs(schedule.values).max(initial=0.0)
            found.append(along.reshape(-1, self.k) / (largest or 1.0))
        sizes = np.abs(np.concatenate(found)).max(axis=0)
        return np.where(sizes == 0, 1.0, sizes)

    def active(self, n_fixed: int) -> tuple[int, ...]:
        """Entries of p that change."""
        moved, at = np.any(self.p != 0, axis=1), n_fixed
        for values in self.schedules:
            end = at + 1 + values.shape[1]
            moved[at + 1 : end] = np.any(values != 0, axis=(0, 2))
            at = end
        return tuple(np.flatnonzero(moved).tolist())

    def scheduled(self, n_fixed: int, schedules: Sequence[Schedule], t: np.ndarray) -> np.ndarray:
        """Directions (n_p, k, m) of the parameters at the times `t` (m,)."""
        p, at = np.repeat(self.p[:, :, None], len(t), axis=2), n_fixed
        for schedule, values in zip(schedules, self.schedules, strict=True):
            end = at + 1 + values.shape[1]
            p[at + 1 : end] = np.moveaxis(values[schedule.locate(t)[1]], 0, 2)
            at = end
        return p


def directions(
    system: System, schedules: Sequence[Schedule], asked: Sensitivities | None
) -> Directions | None:
    """Requested directions; None if there are none."""
    if isinstance(asked, str) or not isinstance(asked, Collection | None):
        asked = [asked]
    if asked is None or len(asked) == 0:
        return None
    space = _Space(system, schedules)
    if isinstance(asked, Mapping):
        columns = [(label, space.column(label, parts)) for label, parts in asked.items()]
    else:
        columns = [pair for name in asked for pair in space.units(name)]
    labels = tuple(label for label, _ in columns)
    twice = [label for label in dict.fromkeys(labels) if labels.count(label) > 1]
    if twice:
        raise ArgumentError(f"sensitivities name {', '.join(twice)} twice")
    return space.directions(labels, np.column_stack([column for _, column in columns]))


class _Space:
    """All values of a motion as one column: start, parameters and inputs, schedules' values."""

    def __init__(self, system: System, schedules: Sequence[Schedule]) -> None:
        model = system.model
        self._system, self._schedules = system, schedules
        shapes: dict[str, tuple[int, ...]] = {}
        for signal in (*model.x, *model.p, *model.u):
            shapes[signal.name] = (signal.size,)
        # a schedule with the name of a signal is not accessible
        self._named = [schedule.name not in shapes for schedule in schedules]
        for schedule in schedules:
            shapes.setdefault(schedule.name, schedule.values.shape)
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()], dtype=int).tolist()
        self._shapes = shapes
        self._begin = dict(zip(shapes, [0, *ends[:-1]], strict=True)) if shapes else {}
        self._size = ends[-1] if ends else 0

    def _shape(self, name: object) -> tuple[int, ...]:
        if not isinstance(name, str):
            raise ArgumentError(f"sensitivities must be names, not {name!r:.60}")
        if name not in self._shapes:
            kinds = "state, parameter, input or schedule"
            raise UnknownNameError(self._system.model.name, kinds, [name], list(self._shapes))
        return self._shapes[name]

    def units(self, name: object) -> Iterator[tuple[str, np.ndarray]]:
        """Label and column for each entry of a signal, or for the named one."""
        found = _ENTRY.fullmatch(name) if isinstance(name, str) else None
        whole = name if found is None or name in self._shapes else found[1]
        shape = self._shape(whole)
        entries = list(np.ndindex(*shape))
        if found is not None and whole != name:
            entries = [self._entry(str(name), shape, found)]
        for entry in entries:
            column = np.zeros(self._size)
            flat = int(np.ravel_multi_index(entry, shape))
            column[self._begin[str(whole)] + flat] = 1.0
            single = len(shape) == 1 and shape[0] == 1 and whole == name
            yield (str(whole) if single else f"{whole}[{', '.join(map(str, entry))}]"), column

    @staticmethod
    def _entry(name: str, shape: tuple[int, ...], found: re.Match[str]) -> tuple[int, ...]:
        entry = tuple(int(number) for number in found.groups()[1:] if number is not None)
        inside = len(entry) == len(shape)
        if not (inside and all(i < size for i, size in zip(entry, shape, strict=True))):
            size = " x ".join(map(str, shape))
            raise ArgumentError(f"there is no {name}: {found[1]} has {size} entries")
        return entry

    def column(self, label: object, parts: object) -> np.ndarray:
        """Column of one direction, given for each signal that it moves."""
        if not isinstance(label, str):
            raise ArgumentError(f"labels of directions must be names, not {label!r:.60}")
        if not isinstance(parts, Mapping):
            raise ArgumentError(
                f"write direction {label} as {{name: entries}}, not {type(parts).__name__}"
            )
        column = np.zeros(self._size)
        for name, given in parts.items():
            shape, values = self._shape(name), numbers(f"direction {label} of {name}", given)
            if values.shape not in ((), shape):
                raise ArgumentError(
                    f"direction {label} of {name} must be one number or have the shape {shape}, "
                    f"not {values.shape}"
                )
            if not np.all(np.isfinite(values)):
                raise ArgumentError(f"direction {label} of {name} must be finite")
            begin = self._begin[name]
            column[begin : begin + int(np.prod(shape))] = np.broadcast_to(values, shape).ravel()
        return column

    def directions(self, labels: tuple[str, ...], columns: np.ndarray) -> Directions:
        """Split columns (numbers, k)."""
        model, n_x = self._system.model, self._system.model.n_x
        inner = sum(s.size for s in (*model.p, *model.u))
        p = np.zeros((self._system.symbols[2].numel(), len(labels)))
        p[:inner] = columns[n_x : n_x + inner]
        scheduled = []
        for schedule, named in zip(self._schedules, self._named, strict=True):
            shape, begin = schedule.values.shape, self._begin[schedule.name]
            rows = columns[begin : begin + schedule.values.size] if named else 0.0
            values = np.broadcast_to(rows, (schedule.values.size, len(labels)))
            scheduled.append(np.ascontiguousarray(values).reshape(*shape, len(labels)))
        return Directions(labels, columns[:n_x], p, tuple(scheduled))


# Distance, in nominal sizes, at which limits are estimated; share of the difference of a pair that
# remains at a quarter of the distance, and negligible share of the value; growth that excludes a
# limit.
_NEARBY, _LEFT, _NOTHING, _GROWS = 1e-10, 0.6, 1e-4, 1.5


def with_limits(
    slopes: ca.Function,
    nominal: np.ndarray,
    t: ca.MX,
    x: ca.MX,
    p: ca.MX,
    s: ca.MX,
    dx: ca.MX,
    entries: Sequence[ca.MX],
) -> list[ca.MX]:
    """Entries of Jacobians, by `slopes` at (t, x, p, s), with limits in place of NaN.

    `nominal` sizes are those of the model's states, which come first in x; dx is their rate.
    """
    sizes = [entry.numel() for entry in entries]
    given = [t, x, p, s, dx, ca.vertcat(*entries)]
    symbols = [ca.MX.sym(f"a{i}", part.numel()) for i, part in enumerate(given)]
    same = ca.Function("same", symbols, [symbols[-1]])
    limits = ca.Function("limits", symbols, [_limits(slopes, nominal, *symbols)])
    broken = ca.logic_not(ca.sum1(_numbers(*given[-1:])) == sum(sizes))
    found = ca.Function.if_else("found", limits, same)(broken, *given)
    return ca.vertsplit(found, np.cumsum([0, *sizes]).tolist())


def _numbers(values: ca.MX) -> ca.MX:
    """Whether each value is a number; CasADi would simplify a comparison with itself."""
    a, b = (ca.MX.sym(name, values.numel()) for name in "ab")
    return ca.Function("equal", [a, b], [a == b])(values, values)


def _limits(
    slopes: ca.Function,
    nominal: np.ndarray,
    t: ca.MX,
    x: ca.MX,
    p: ca.MX,
    s: ca.MX,
    dx: ca.MX,
    known: ca.MX,
) -> ca.MX:
    rate = ca.mmax(ca.fabs(dx[: len(nominal)]) / nominal)
    after = ca.if_else(rate > 0, _NEARBY / rate, 0)
    way = np.zeros(x.numel())
    way[: len(nominal)] = nominal * (1 + 0.618 * (np.arange(len(nominal)) % 7))

    def near(distance: ca.MX | float, direction: ca.MX | np.ndarray, later: ca.MX | float) -> ca.MX:
        return ca.vertcat(*slopes(t + later, x + distance * direction, p, s)[1:])

    ahead = [near(after / 4**i, dx, after / 4**i) for i in range(3)]
    found = _adopted(known, ahead[0], ahead[1], ahead[1], ahead[2])
    sides = [near(sign * _NEARBY / scale, way, 0.0) for scale in (1, 4) for sign in (1, -1)]
    return _adopted(found, *sides)


def _adopted(known: ca.MX, a: ca.MX, b: ca.MX, near_a: ca.MX, near_b: ca.MX) -> ca.MX:
    """Values with NaN replaced by limits, if a pair of points has any."""
    apart, near = ca.fabs(a - b), ca.fabs(near_a - near_b)
    size = ca.fmax(ca.fabs(near_a), ca.fabs(near_b))
    good = (size <= _GROWS * ca.fmax(ca.fabs(a), ca.fabs(b))) * (
        near <= ca.fmax(_LEFT * apart, _NOTHING * size)
    )
    limit = ca.if_else(good, (near_a + near_b) / 2, known)
    return ca.if_else(_numbers(known), known, limit)


@dataclass(frozen=True, eq=False)
class Variation:
    """The functions that derivatives of a System's motions need."""

    system: System
    active: tuple[int, ...] = ()  # entries of p that directions move: others need no derivatives

    @cached_property
    def _along(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Changes of t, x and p."""
        t, x, p, _ = self.system.symbols
        pairs = zip(("dt", "dx", "dp"), (t, x, p), strict=True)
        return tuple(ca.SX.sym(name, symbol.numel()) for name, symbol in pairs)  # type: ignore[return-value]

    def _derivative(self, name: str, result: ca.SX) -> ca.Function:
        """Change of a result by those of t, x and p."""
        t, x, p, s = self.system.symbols
        dt, dx, dp = self._along
        change = ca.jtimes(ca.densify(result), ca.vertcat(t, x, p), ca.vertcat(dt, dx, dp))
        names = ["t", "x", "p", "s", "dt", "dx", "dp"]
        return ca.Function(name, [t, x, p, s, dt, dx, dp], [ca.densify(change)], names, [name])

    def _called(self, function: ca.Function) -> ca.SX:
        return function(*self.system.symbols)  # type: ignore[no-any-return]

    @cached_property
    def _slopes(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """X', and its derivatives by the model's states and by p."""
        _, x, p, _ = self.system.symbols
        ode, active = self.system.ode, list(self.active)
        own = ode[: self.system.model.n_x]
        by_p = ca.SX(own.numel(), p.numel())
        by_p[:, active] = ca.jacobian(own, p[active])
        ode, by_x, by_p = ca.cse([ode, ca.jacobian(own, x[: own.numel()]), ca.sparsify(by_p)])
        return ca.densify(ode), by_x, by_p

    @property
    def entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of the entries of df/dx and of df/dp, in the order of `slopes`."""
        found = (np.array(j.sparsity().get_triplet(), dtype=np.int64) for j in self._slopes[1:])
        in_x, in_p = (entries.reshape(2, -1) for entries in found)
        return in_x, in_p

    @cached_property
    def slopes(self) -> ca.Function:
        """X', and the entries of its derivatives by the model's states and by p."""
        dx, *jacobians = self._slopes
        results = [dx, *(ca.vec(j.nz[:]) for j in jacobians)]
        arguments = list(self.system.symbols)
        names = ["t", "x", "p", "s"]
        return ca.Function("slopes", arguments, results, names, ["rhs", "in_x", "in_p"])

    @cached_property
    def contacts_along(self) -> ca.Function:
        """Velocities of contacts, then distances of forces from the least and the largest."""
        velocity, _, force, low, high = ca.vertsplit(
            self._called(self.system.probe)[:-1], len(self.system.contacts)
        )
        return self._derivative("contacts_along", ca.vertcat(velocity, force - low, high - force))

    @cached_property
    def contact_parts(self) -> ca.Function:
        """Sizes of the terms in the rates of `contacts_along`."""
        system = self.system
        _, acceleration, force, low, high = ca.vertsplit(
            self._called(system.probe)[:-1], len(system.contacts)
        )
        pulled = ca.fabs(system.pulled)
        margins = ca.vertcat(force - low, high - force)
        parts = ca.vertcat(pulled + ca.fabs(acceleration - system.pulled), self._parts(margins))
        return system.function("contact_parts", parts)

    @cached_property
    def guard_parts(self) -> ca.Function:
        """Sizes of the terms in the rates of guards."""
        guards = self._called(self.system.guards)[: len(self.system.model.switches)]
        return self.system.function("guard_parts", self._parts(guards))

    def _parts(self, values: ca.SX) -> ca.SX:
        t, x, _, _ = self.system.symbols
        gradient = ca.fabs(ca.jacobian(values, x))
        return gradient @ ca.fabs(self.system.ode) + ca.fabs(ca.jacobian(values, t))

    @cached_property
    def project_along(self) -> ca.Function:
        """Derivative of the impulses that stop the contacts with s = 0."""
        return self._derivative("project_along", self._called(self.system.project))

    @cached_property
    def guards_along(self) -> ca.Function:
        """Derivative of the guards of switches."""
        guards = self._called(self.system.guards)[: len(self.system.model.switches)]
        return self._derivative("guards_along", guards)

    @cached_property
    def resets_along(self) -> ca.Function:
        """Derivative of the states after switches, one after the other."""
        return self._derivative("resets_along", ca.vec(self._called(self.system.resets)))

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The functions that this system needs, by name."""
        names = ["slopes"]
        if self.system.exact:
            names += ["contacts_along", "project_along", "contact_parts"]
        if self.system.model.switches:
            names += ["guards_along", "resets_along", "guard_parts"]
        return {name: getattr(self, name) for name in names}

    def rhs(self, k: int, limits: bool) -> ca.Function:
        """X' and S' of k columns, of (t, x and S, p and P, s).

        With `limits`, slopes that are 0/0 where the motion is smooth are their limits.
        """
        t, x, p, s = self.slopes.mx_in()
        n, n_x, n_p = self.system.model.n_x, x.numel(), p.numel()
        all_x, all_p = ca.MX.sym("x", n_x + n * k), ca.MX.sym("p", n_p * (1 + k))
        x, columns = ca.vertsplit(all_x, [0, n_x, n_x + n * k])
        p, along = ca.vertsplit(all_p, [0, n_p, n_p * (1 + k)])
        dx, *entries = self.slopes(t, x, p, s)
        if limits:
            entries = with_limits(
                self.slopes, nominal_of(self.system.model.x), t, x, p, s, dx, entries
            )
        in_x, in_p = (
            ca.MX(jacobian.sparsity(), values)
            for jacobian, values in zip(self._slopes[1:], entries, strict=True)
        )
        # rows are matrices of k rows to CasADi
        rows = ca.reshape(columns, k, n) @ in_x.T + ca.reshape(along, k, n_p) @ in_p.T
        result = ca.vertcat(dx, ca.vec(ca.densify(rows)))
        return ca.Function("rhs", [t, all_x, all_p, s], [result], ["t", "x", "p", "s"], ["rhs"])

    def observed(self, expression: ca.SX) -> tuple[ca.Function, np.ndarray]:
        """Entries of the Jacobian of an expression by the model's states and by p.

        Returns a function of (t, x, p, s), and the rows and columns (2, entries) of its results.
        The expression may contain contact forces; only entries of p in `active` matter.
        """
        system, (t, _, p, s) = self.system, self.system.symbols
        function, active = system.observe(expression), list(self.active)
        x = ca.SX.sym("x", system.model.n_x)
        by = ca.jacobian(function(t, x, p, s), ca.vertcat(x, p[active]))
        rows, columns = np.array(by.sparsity().get_triplet(), dtype=int).reshape(2, -1)
        entries = ca.Function("observed_along", [t, x, p, s], [ca.vec(by.nz[:])])
        places = np.append(np.arange(x.numel()), x.numel() + np.array(active, dtype=int))
        return entries, np.array([rows, places[columns]])


@lru_cache(maxsize=64)
def rhs_of(variation: Variation, k: int, limits: bool) -> ca.Function:
    """X', followed by S' of k columns; see `Variation.rhs`."""
    return variation.rhs(k, limits)


def has_derivatives(system: System) -> bool:
    """Whether motions have derivatives: not if contacts slide in the plane or share loads."""
    return not (system.model.delays or (system.exact and (len(system.planar) or system.shares)))


@lru_cache(maxsize=64)
def variation(system: System, active: tuple[int, ...]) -> Variation:
    """Variational equations of a system along directions that move some entries of p."""
    if system.exact and (len(system.planar) or system.shares):
        raise ArgumentError(
            f"contacts of {system.model.name} slide in the plane or share loads, where exact "
            "treatment has no derivatives; write contact=Smooth(v_reg) for sensitivities"
        )
    return Variation(system, active)
