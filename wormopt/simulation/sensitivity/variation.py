"""Variational equations of a System: derivatives of its functions along directions.

With the columns S = dx/d(direction) and P = dp/d(direction), integrators have the state x followed
by S row by row: S' = f_x S + f_p P. At an event whose time t* changes, S jumps: D = S + x' dt* is
the change of the state at the event itself. D passes resets and impulses by their derivatives, and
S = D - x' dt* with the x' after the event.

Source: M. A. Aizerman, F. R. Gantmakher, Quarterly Journal of Mechanics and Applied Mathematics
11 (1958) 225; P. C. Müller, Chaos, Solitons & Fractals 5 (1995) 1671.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.values import nominal_of
from wormopt.simulation.functions import System
from wormopt.simulation.sensitivity.limits import with_limits


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
    """Variational equations of a system along directions that move some entries of p.

    Raises ArgumentError if its motions have no exact ones.
    """
    if system.exact and (len(system.planar) or system.shares):
        raise ArgumentError(
            f"contacts of {system.model.name} slide in the plane or share loads, where exact "
            "treatment has no derivatives; write contact=Smooth(v_reg) for sensitivities"
        )
    return Variation(system, active)
