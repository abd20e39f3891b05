"""A Model and a treatment of its contacts as CasADi functions of (t, x, p, s), ready to integrate.

p holds the model's parameters, its inputs, the width ``v_reg`` of the smooth law, and of every
schedule the beginning and the values of the current piece. s holds the contacts' modes: +1 and -1
for sliding forward and backward, 0 at rest; then of every contact in the plane its onset, see
`wormopt.simulation.grip`. Velocities and forces of a contact in the plane are two rows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import symbols_of
from wormopt.model.given import fields_of
from wormopt.model.model import Contact, Model, Signal, pack
from wormopt.model.schedule import Memory, Schedule, recalled
from wormopt.model.values import signal_values
from wormopt.numerics.expressions import identically_zero, without_zeros
from wormopt.simulation.grip import (
    ENTRIES,
    RESTING,
    TURNING,
    Equations,
    Grips,
    determined,
    never_rests,
    solver,
)
from wormopt.simulation.options import Smooth, Treatment

_HUGE = 1e100


@dataclass(frozen=True, eq=False)
class _Alike:
    """Contacts whose laws differ in values only."""

    names: list[str]  # fields that are determined
    contacts: list[int]
    entries: list[list[int]]  # for each contact and field the index of its value


@dataclass(frozen=True, eq=False)
class LawNumbers:
    """Laws of a model's contacts with fields that are symbols."""

    model: Model
    fixed: ca.SX  # symbols of parameters and inputs

    def check(self, fixed: np.ndarray) -> None:
        """Let each law check its values together, such as stiction against sliding friction.

        `fixed` are values of the symbols. Laws with equal values are checked once.
        """
        if not self._alike:
            return
        values = self._values(fixed).full().ravel()
        for alike in self._alike:
            rows = map(tuple, values[alike.entries].tolist())
            first: dict[tuple[float, ...], int] = {}
            for numbers, contact in zip(rows, alike.contacts, strict=True):
                first.setdefault(numbers, contact)
            for numbers, contact in first.items():
                self._ask(contact, dict(zip(alike.names, numbers, strict=True)))

    def finite(self, fixed: np.ndarray) -> np.ndarray:
        """Values with infinity replaced by a huge number, since 0 times infinity is NaN."""
        column = self._column(self._decided[0])[0]
        used = np.array(ca.which_depends(column, self.fixed, 1, False), dtype=bool)
        return np.where(np.isinf(fixed) & used, np.copysign(_HUGE, fixed), fixed)

    def _ask(self, i: int, numbers: dict[str, float]) -> None:
        contact = self.model.contacts[i]
        try:
            replace(contact.law, **numbers)
        except ValueError as error:
            shown = ", ".join(f"{name} = {value:g}" for name, value in numbers.items())
            raise ArgumentError(f"{contact.name} with {shown}: {error}") from None

    @cached_property
    def _alike(self) -> list[_Alike]:
        """Contacts with fields of their laws that parameters and inputs alone determine."""
        own = defaultdict[int, dict[str, int]](dict)
        for entry, (i, name) in enumerate(self._decided[0]):
            own[i][name] = entry
        groups = defaultdict[tuple[object, ...], list[int]](list)
        for i, entries in own.items():
            groups[_kind(self.model.contacts[i].law, list(entries))].append(i)
        return [
            _Alike(list(own[group[0]]), group, [list(own[i].values()) for i in group])
            for group in groups.values()
        ]

    @property
    def _values(self) -> ca.Function:
        return self._decided[1]

    @cached_property
    def _decided(self) -> tuple[list[tuple[int, str]], ca.Function]:
        """Contacts and fields, and their values by parameters and inputs."""
        laws = enumerate(contact.law for contact in self.model.contacts)
        places = [(i, name) for i, law in laws for name in symbols_of(law)]
        column, function = self._column(places)
        others = function.free_sx()
        if others:
            open_ = ca.which_depends(column, ca.vertcat(*others), 1, True)
            places = [place for place, other in zip(places, open_, strict=True) if not other]
            _, function = self._column(places)
        return places, function

    def _column(self, places: list[tuple[int, str]]) -> tuple[ca.SX, ca.Function]:
        values = [getattr(self.model.contacts[i].law, name) for i, name in places]
        column = ca.densify(ca.vertcat(ca.SX(0, 1), *values))
        return column, ca.Function("law_numbers", [self.fixed], [column], {"allow_free": True})


def _kind(law: Any, decided: list[str]) -> tuple[object, ...]:
    """Key of laws that differ only in the fields `decided`."""
    others = [(name, id(v)) for name, v in fields_of(law).items() if name not in decided]
    return type(law), *decided, *others


# Random states in search of one with finite values; relative singular value below which contacts
# are redundant.
_DRAWS, _SINGULAR = 3, 1e-12


def _zeros(column: ca.SX) -> np.ndarray:
    """Mask of entries that are 0 for all values of their symbols."""
    entries = ca.densify(column)
    drawn = ca.Function("entries", [ca.vertcat(*ca.symvar(entries))], [entries])
    random = np.random.default_rng(0)
    found = np.abs(drawn(random.uniform(0.5, 1.5, drawn.numel_in(0))).full().ravel()) < _SINGULAR
    suspects = np.flatnonzero(found).tolist()
    if suspects:
        own = entries[suspects]
        found[suspects] = identically_zero(own, ca.vertcat(*ca.symvar(own))).ravel()
    return found


@dataclass(frozen=True, eq=False)
class System:
    """The functions that integrate a Model."""

    model: Model
    treatment: Treatment  # of contacts; those that never rest are plain forces in both treatments

    def __post_init__(self) -> None:
        self.model.check_laws()

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts that may rest."""
        plain = {id(contact) for contact in self._plain}
        return tuple(c for c in self.model.contacts if id(c) not in plain)

    @cached_property
    def _plain(self) -> tuple[Contact, ...]:
        """Contacts that never rest."""
        return tuple(c for c in self.model.contacts if never_rests(c))

    @cached_property
    def exact(self) -> bool:
        """Whether events decide contact."""
        return not isinstance(self.treatment, Smooth) and len(self.contacts) > 0

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """t, x, p and s."""
        model = self.model
        schedules = [ca.vertcat(s.begin, s.symbol) for s in (*model.schedules, *self.memories)]
        given = (signal.symbol for signal in (*model.p, *model.u))
        p = ca.vertcat(*given, self._v_reg, *schedules)
        return model.t, ca.vertcat(pack(model.x), self._pushes), p, self._modes

    @cached_property
    def memories(self) -> tuple[Memory, ...]:
        """Schedules that replace the model's delays, after the model's own schedules."""
        return tuple(Memory(delay) for delay in self.model.delays)

    @cached_property
    def _pushes(self) -> ca.SX:
        """States in addition to the model's: time integrals of forces on resting contacts."""
        # They exist if the forces depend on time. While everything rests, step control would not
        # otherwise see that forces change.
        driven = self.exact and ca.depends_on(self._free_acceleration, self.model.t)
        return ca.SX.sym("push", len(self.row_contact) if driven else 0)  # type: ignore[no-any-return]

    @property
    def n_pushes(self) -> int:
        """How many there are."""
        return self._pushes.numel()

    @cached_property
    def _v_reg(self) -> ca.SX:
        return ca.SX.sym("v_reg")  # type: ignore[no-any-return]

    @cached_property
    def _modes(self) -> ca.SX:
        return ca.SX.sym("s", self._n_modes if self.exact else 0)  # type: ignore[no-any-return]

    @property
    def _n_modes(self) -> int:
        return len(self.contacts) + ENTRIES * len(self.planar)

    @cached_property
    def _grips(self) -> Grips:
        # smooth forces have no modes
        modes = self._modes if self.exact else ca.SX(self._n_modes, 1)
        return Grips.of(
            self.contacts,
            self.model.t,
            modes,
            self.prescribed if self.exact else (),
            self.geared if self.exact else (),
        )

    @cached_property
    def planar(self) -> np.ndarray:
        """Indices of the contacts that move in the plane."""
        return np.flatnonzero([contact.planar for contact in self.contacts])

    @cached_property
    def row_contact(self) -> np.ndarray:
        """Contact of every row."""
        sizes = [contact.force.numel() for contact in self.contacts]
        return np.repeat(np.arange(len(sizes)), sizes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about ambiguous laws of contacts, a line for each law."""
        open_ = [c.law for c in self.contacts if c.planar and not c.law.associated]
        names = dict.fromkeys(type(law).__name__ for law in open_)
        return tuple(
            f"the law {name} does not maximise dissipation: a state may have several motions, "
            "and the one found may be unstable"
            for name in names
        )

    @property
    def sliding(self) -> np.ndarray:
        """Modes s before any decision: a new array, to be rewritten."""
        return np.repeat([1.0, 0.0], [len(self.contacts), ENTRIES * len(self.planar)])[: self.n_s]

    @cached_property
    def happening(self) -> list[str]:
        """Names for events: contacts, then switches."""
        return [c.name for c in self.contacts] + [s.name for s in self.model.switches]

    @property
    def n_s(self) -> int:
        """Entries of s."""
        return self._modes.numel()

    @cached_property
    def n_fixed(self) -> int:
        """Number of entries of p before those of the schedules."""
        return sum(s.size for s in (*self.model.p, *self.model.u)) + 1

    # -- contact forces --------------------------------------------------------------------

    @cached_property
    def _velocity(self) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *(c.velocity for c in self.contacts))

    @cached_property
    def _plain_forces(self) -> tuple[ca.SX, ca.SX]:
        """Symbols and expressions of the forces of contacts that never rest."""
        forces = [c.law.slip_force(c.velocity, 1) for c in self._plain]
        symbols = [c.force for c in self._plain]
        return ca.vertcat(ca.SX(0, 1), *symbols), ca.vertcat(ca.SX(0, 1), *forces)

    @cached_property
    def _free_ode(self) -> ca.SX:
        """Ode with the plain forces inserted."""
        model = self.model
        if any(c.gap is not None or c.normal_force is not None for c in model.contacts):
            raise ArgumentError(
                "walls with a gap or a normal force cannot be simulated; make them elastic "
                "with smooth_walls"
            )
        ode = ca.substitute(model.ode, *self._plain_forces) if self._plain else model.ode
        return recalled(ode, self.memories, model.t)

    @cached_property
    def _free_acceleration(self) -> ca.SX:
        """Accelerations of contacts with the plain forces inserted."""
        velocity, model = self._velocity, self.model
        if ca.depends_on(ca.jacobian(model.ode, model.forces), model.forces):
            raise ArgumentError(f"the ode of {model.name} must be affine in the contact forces")
        rate = ca.jtimes(velocity, pack(model.x), self._free_ode)
        return rate + ca.jacobian(velocity, model.t)

    @cached_property
    def _force_symbols(self) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *(c.force for c in self.contacts))

    @cached_property
    def delassus(self) -> ca.SX:
        """Matrix d(contact accelerations) / d(contact forces) of the contacts that may rest."""
        return without_zeros(ca.jacobian(self._free_acceleration, self._force_symbols))

    @cached_property
    def coupled(self) -> bool:
        """Whether the force of one contact accelerates another."""
        rows, columns = self.delassus.sparsity().get_triplet()
        if any(row != column for row, column in zip(rows, columns, strict=True)):
            return True
        planar = set(self.planar.tolist())
        return any(i in planar for i in np.delete(self.row_contact, rows).tolist())

    @cached_property
    def prescribed(self) -> tuple[int, ...]:
        """Contacts on lines whose velocity no contact force changes, such as on a driven belt."""
        # In the plane the equations for undetermined forces include such contacts.
        rows, columns = self.delassus.sparsity().get_triplet()
        acted_on = {i for i, j in zip(rows, columns, strict=True) if i != j}
        acted_on |= set(np.flatnonzero(~_zeros(ca.diag(self.delassus))).tolist())
        free = [i for i in range(len(self.row_contact)) if i not in acted_on]
        found = tuple(np.setdiff1d(self.row_contact[free], self.planar).tolist())
        for contact in (self.contacts[i] for i in found):
            if not contact.law.directions:
                raise ArgumentError(
                    f"no contact force acts on the velocity of {contact.name}, so it cannot be "
                    "held; add its force to the ode, or write contact=Smooth(v_reg)"
                )
        return found

    @cached_property
    def geared(self) -> tuple[int, ...]:
        """Contacts on lines whose response to their own force depends on time or place."""
        # Where it is 0 so is their velocity, and yet no force stops them there: the foot of a
        # turning leg moves along the ground by the cosine of its angle.
        t, x, _, _ = self.symbols
        response, changes = ca.diag(self.delassus), ca.vertcat(t, x)
        if not ca.depends_on(response, changes):
            return ()
        rows = [i for i in range(response.numel()) if ca.depends_on(response[i], changes)]
        found = np.setdiff1d(self.row_contact[rows], self.planar).tolist()
        return tuple(i for i in found if self.contacts[i].law.directions)

    @cached_property
    def forces(self) -> ca.SX:
        """Contact forces as expressions of t, x, p and s."""
        if not self.exact:
            return self._grips.smooth(self._v_reg)
        if not self.coupled:
            return self._grips.alone(self.pulled, self.delassus)
        # if loads are shared, loops solve for the forces, which are symbols here
        return self._force_symbols if self.shares else ca.solve(*self._equations)

    @cached_property
    def _equations(self) -> tuple[ca.SX, ca.SX]:
        """Matrix and right-hand side of the forces of contacts that act on one another."""
        return self._grips.equations(self.pulled, self.delassus)

    @cached_property
    def shares(self) -> bool:
        """Whether resting contacts may share a load, as two on one rigid body do."""
        # The split is undetermined, see `wormopt.simulation.sharing`.
        if not self.coupled:
            return False
        return len(self.planar) > 0 or self._grips.bilateral or self._redundant

    @property
    def _redundant(self) -> bool:
        """Whether contacts on lines have fewer degrees of freedom than forces in every state."""
        # Forces without effect count only if they do no work either: contacts with different
        # velocities, such as prescribed ones, do not rest at once.
        acted_on = np.delete(np.arange(len(self.contacts)), self.prescribed).tolist()
        matrix, velocity = self.delassus[acted_on, acted_on], self._velocity[acted_on]
        held = ca.vertcat(*ca.symvar(matrix))
        drawn = ca.vertcat(*(s for s in ca.symvar(velocity) if not ca.depends_on(held, s)))
        both = ca.Function("both", [held, drawn], [ca.densify(matrix), ca.densify(velocity)])
        random = np.random.default_rng(0)
        for _ in range(_DRAWS):
            at = random.uniform(0.5, 1.5, held.numel())
            states = random.uniform(-1, 1, (len(acted_on) + 1, drawn.numel()))
            found = [[part.full() for part in both(at, state)] for state in states]
            rows = np.vstack([found[0][0], *(v.T / (np.abs(v).max() or 1.0) for _, v in found)])
            size = np.sqrt(np.abs(np.diag(rows)))
            if np.all(np.isfinite(rows)) and size.all():
                rows[: len(size)] /= size[:, None]
                return bool(np.linalg.matrix_rank(rows / size, _SINGULAR * len(rows)) < len(size))
        return False

    @cached_property
    def _solved(self) -> ca.SX:
        """If contacts share loads, symbols for their forces and for `_determined`."""
        return ca.vertcat(self._force_symbols, ca.SX.sym("determined"))

    @cached_property
    def _shared_forces(self) -> ca.Function:
        """Forces if contacts share loads, and how well resting ones determine theirs."""
        gives = self._grips.gives(RESTING, TURNING)
        equations = Equations(*self._equations, gives, self._grips.begun, self._size)
        return solver("forces", self.symbols, equations)

    @property
    def _size(self) -> ca.SX:
        return ca.trace(self.delassus) / self.delassus.size1()

    @cached_property
    def pulled(self) -> ca.SX:
        """Accelerations of the contacts without contact forces."""
        return self._at_forces(self._free_acceleration, ca.SX.zeros(len(self.row_contact)))

    @property
    def _determined(self) -> ca.SX:
        """Determinant of the equations for forces of resting contacts, relative to its rows."""
        if not self.coupled:
            return ca.SX(1)
        if self.shares:
            return self._solved[-1]
        return determined(self._equations[0])

    def _at_forces(self, expression: ca.SX, forces: ca.SX) -> ca.SX:
        return ca.substitute(expression, self._force_symbols, forces)

    @cached_property
    def ode(self) -> ca.SX:
        """X' as an expression of t, x, p and s."""
        ode = self._at_forces(self._free_ode, self.forces)
        if not self.exact:
            return ode
        if self.n_pushes:
            ode = ca.vertcat(ode, self._grips.rests * self.pulled)
        if self.coupled:
            return ode
        # a velocity that is a state remains exactly constant while its contact rests
        rows = np.flatnonzero(self.row_state >= 0)
        if not rows.size:
            return ode
        moving = self._at_forces(self._free_ode, self._grips.slip(self.forces))
        states = self.row_state[rows].tolist()
        modes = self._modes[self.row_contact[rows].tolist()]
        ode[states] = modes**2 * moving[states]
        return ode

    @cached_property
    def row_state(self) -> np.ndarray:
        """Per row the state that is this velocity, -1 where it is none."""
        x, velocity = (
            ca.vertsplit(ca.densify(column)) for column in (pack(self.model.x), self._velocity)
        )
        rows = {state.element_hash(): i for i, state in enumerate(x)}
        found = [rows.get(v.element_hash(), -1) for v in velocity]
        return np.array(found, dtype=np.int64)

    @cached_property
    def velocity_state(self) -> np.ndarray:
        """Per contact the state that is its velocity, -1 where it is none or two."""
        first = np.searchsorted(self.row_contact, np.arange(len(self.contacts)))
        found = self.row_state[first]
        found[self.planar] = -1
        return found

    # -- functions -------------------------------------------------------------------------

    def function(self, name: str, result: ca.SX, *more: ca.SX) -> ca.Function:
        """Function of t, x, p, s and more; the result may contain contact forces."""
        names = ["t", "x", "p", "s", *(symbol[0].name().split("_")[0] for symbol in more)]
        return self._closed(name, [*self.symbols, *more], names, result)

    def _closed(
        self, name: str, symbols: list[ca.SX], names: list[str], result: ca.SX
    ) -> ca.Function:
        """Insert forces that are symbols in the result."""
        result = ca.densify(result)
        if not (self.exact and self.shares and ca.depends_on(result, self._solved)):
            return ca.Function(name, symbols, [result], names, [name])
        inner = ca.Function(f"{name}_by_forces", [*symbols, self._solved], [result])
        arguments = inner.mx_in()[:-1]
        t, x, p, s = arguments[:4]
        pushes = ca.MX.zeros(self.symbols[1].numel() - x.numel())
        solved = self._shared_forces(t, ca.vertcat(x, pushes), p, s)
        return ca.Function(name, arguments, [inner(*arguments, solved)], names, [name])

    @cached_property
    def rhs(self) -> ca.Function:
        """X'."""
        return self.function("rhs", self.ode)

    @cached_property
    def velocities(self) -> ca.Function:
        """Velocities of the contacts that may rest; speeds in the plane."""
        speeds = [ca.norm_2(v) if v.numel() > 1 else v for v in (c.velocity for c in self.contacts)]
        return self.function("velocities", ca.vertcat(*speeds))

    @cached_property
    def probe(self) -> ca.Function:
        """Values that decide modes.

        Velocities, accelerations, forces, least and largest holding force of the contacts that may
        rest; then how well resting ones determine their forces, 1 well, 0 not at all.
        """
        acceleration = self._at_forces(self._free_acceleration, self.forces)
        values = self._grips.deciding(acceleration, self.forces, self.delassus)
        return self.function("probe", ca.vertcat(values, self._determined))

    @cached_property
    def aims(self) -> ca.Function:
        """`PlaneGrip.aims` of every contact in the plane."""
        return self.function("aims", self._grips.aims(self.forces))

    @cached_property
    def bends(self) -> ca.Function:
        """`PlaneGrip.bends` of every contact in the plane."""
        return self.function("bends", self._grips.bends)

    @cached_property
    def project(self) -> ca.Function:
        """X after the impulses that stop the contacts with s = 0."""
        x, velocity = self.symbols[1], self._velocity
        push = ca.jacobian(self._free_ode, self._force_symbols)
        push = ca.vertcat(push, ca.SX.zeros(self.n_pushes, push.size2()))
        rests = self._grips.rests
        if not self.coupled:
            own = ca.diag(self.delassus)
            own[list(self.prescribed)] = 1  # they never rest
            impulses = rests * velocity / own
            for i in np.flatnonzero(np.isin(self.row_contact, self.geared)).tolist():
                impulses[i] = ca.if_else(rests[i], velocity[i] / own[i], 0)
            return self.function("project", x - push @ impulses)
        matrix, right = ca.diag(1 - rests) + ca.diag(rests) @ self.delassus, -rests * velocity
        if not self.shares:
            return self.function("project", x + push @ ca.solve(matrix, right))
        gives, near = ca.diag(RESTING * rests), ca.SX.zeros(rests.numel())
        equations = Equations(matrix, right, gives, near, self._size)
        pushed = ca.Function("pushed", list(self.symbols), [x, ca.densify(push)])
        arguments = pushed.mx_in()
        x, push = pushed(*arguments)
        names = ["t", "x", "p", "s"]
        found = x + push @ solver("impulses", self.symbols, equations)(*arguments)[:-1]
        return ca.Function("project", arguments, [found], names, ["project"])

    @cached_property
    def guards(self) -> ca.Function:
        """Guards of the model's switches, then their time derivatives along the motion."""
        guards = self._put(ca.vertcat(*(s.guard for s in self.model.switches)))
        if self.exact and self.shares and ca.depends_on(guards, self._solved):
            raise ArgumentError(
                f"a switch of {self.model.name} depends on a contact force that other contacts "
                "share; use another guard, or treat contact as smooth"
            )
        rates = ca.jtimes(guards, self.symbols[1], self.ode) + ca.jacobian(guards, self.model.t)
        return self.function("guards", ca.vertcat(guards, rates))

    @cached_property
    def resets(self) -> ca.Function:
        """States after each switch, one column each."""
        columns = [ca.vertcat(ca.densify(s.reset), self._pushes) for s in self.model.switches]
        return self.function("resets", self._put(ca.horzcat(*columns)))

    def _put(self, expression: ca.SX) -> ca.SX:
        """Express the model's expressions by t, x, p and s alone."""
        plain, forces = self._plain_forces
        expression = recalled(expression, self.memories, self.model.t)
        old, new = ca.vertcat(plain, self._force_symbols), ca.vertcat(forces, self.forces)
        return ca.substitute(expression, old, new)

    def observe(self, expression: ca.SX) -> ca.Function:
        """Function of (t, x, p, s) for an expression of the model's symbols and contact forces.

        Its x omits the states counted by `n_pushes`.
        """
        t, _, p, s = self.symbols
        symbols = [t, pack(self.model.x), p, s]
        return self._closed("observed", symbols, ["t", "x", "p", "s"], self._put(expression))

    def named(self, name: str) -> ca.Function:
        """`observe` of what the model knows by this name, made once."""
        if name not in self._named:
            self._named[name] = self.observe(self.model[name])
        return self._named[name]

    @cached_property
    def _named(self) -> dict[str, ca.Function]:
        return {}

    @cached_property
    def dae(self) -> dict[str, ca.SX]:
        """Expressions of the smooth treatment by CasADi's names: t, x, z, p, ode, alg."""
        t, x, p, _ = self.symbols
        z, alg = pack(self.model.z), self._put(self.model.alg)
        return {"t": t, "x": x, "z": z, "p": p, "ode": self.ode, "alg": alg}

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The functions that this model and treatment need, by name."""
        names = ["rhs"]
        if self.exact:
            names += ["probe", "project"]
        elif np.any(self.velocity_state < 0):
            names += ["velocities"]
        if self.exact and len(self.planar):
            names += ["aims", "bends"]
        if self.model.switches:
            names += ["guards", "resets"]
        return {name: getattr(self, name) for name in names}

    # -- numbers ---------------------------------------------------------------------------

    @cached_property
    def _laws(self) -> LawNumbers:
        return LawNumbers(self.model, self.symbols[2][: self.n_fixed - 1])

    def parameters(self, given: Mapping[str, object] | None) -> np.ndarray:
        """Values of p: those given by name, else the model's own; 0 for scheduled entries."""
        signals = (*self.model.p, *(self._input(u) for u in self.model.u))
        fixed = signal_values(signals, given, "parameter or input")
        self._laws.check(fixed)
        if np.isinf(fixed).any():
            fixed = self._laws.finite(fixed)
        v_reg = self.treatment.v_reg if isinstance(self.treatment, Smooth) else 0.0
        schedules = (*self.model.schedules, *self.memories)
        scheduled = sum(1 + s.symbol.numel() for s in schedules)
        return np.concatenate([fixed, [v_reg], np.zeros(scheduled)])

    @staticmethod
    def _input(u: Signal) -> Signal:
        return u if u.value is not None else replace(u, value=0.0)

    def scheduled(self, p: np.ndarray, schedules: Sequence[Schedule], t: np.ndarray) -> np.ndarray:
        """Parameters (n_p, m) with the values that schedules have at the times `t` (m,)."""
        # At a break the later piece applies.
        p, at = np.repeat(p[:, None], len(t), axis=1), self.n_fixed
        for schedule in schedules:
            end = at + 1 + schedule.values.shape[1]
            p[at], piece = schedule.locate(t)
            p[at + 1 : end] = schedule.values[piece].T
            at = end
        return p
