"""Static rest of a Model between walls: the least total energy within the walls.

Without friction, rest minimises locally the sum of elastic energy and potential of loads. An
interior point finds the minimum and the touched walls; Newton's method on the Kuhn-Tucker
conditions with these walls refines it to rounding. The multipliers of the gaps are the wall
forces. The forces of the Model itself, from its equations of motion and not from the energy,
must then balance.

Source: J. Nocedal, S. J. Wright, Numerical Optimization (2006), 12.5 for second-order conditions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, pack
from wormopt.model.values import nominal_of, signal_values
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram

# Rounds of touching or leaving walls, and steps of Newton's method in each.
_ROUNDS, _STEPS = 40, 30
# Scaled residuals at which Newton's method may end and by which walls are distinguished; relative
# stiffness that is rounding.
_SMALL, _APART, _NEUTRAL = 1e-9, 1e-12, 1e-13


@dataclass(frozen=True, eq=False)
class Rest:
    """Rest of a Model: a local minimum of the energy; there may be others."""

    places: np.ndarray  # (n_q,) first half of the Model's states
    pressed: np.ndarray  # (contacts,) wall forces: energy over distance
    gaps: np.ndarray  # (contacts,) distance from each wall
    energy: float
    # largest gradient part walls do not balance, over what they do, else the stiffness
    residual: float
    imbalance: float  # largest acceleration over that of own forces, loads or walls alone
    violation: float  # deepest penetration of a wall
    complementarity: float  # max gap * force, over max gap and max force
    softest: float  # least stiffness along touched walls, energy per squared nominal size
    stiffest: float  # greatest such stiffness
    iterations: int  # of the interior point method

    @property
    def stable(self) -> bool:
        """Whether every small motion within the walls takes energy."""
        return self.softest > _NEUTRAL * self.stiffest


@dataclass(frozen=True, eq=False)
class Loaded:
    """A Model under loads that have a potential; friction is left out.

    Its states are places, then as many rates; all contacts have gaps that depend on places,
    and normal forces. Raises ArgumentError for other forms.
    """

    model: Model
    # (places, numbers) -> potential of the loads; with `inputs` or not at all
    potential: ca.Function | None = None
    # (places, numbers) -> model inputs, as a Marcher's; used to check only
    inputs: ca.Function | None = None
    stored: str = "strain_energy"  # output that is the elastic energy
    p: Mapping[str, ArrayLike] | None = None  # parameters that differ from the model's own
    size: float = 1.0  # usual energy, by which it is scaled

    _numbers: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        model = self.model
        model.places()  # refuses other states
        if any(c.gap is None or c.normal_force is None for c in model.contacts):
            raise ArgumentError(f"{model.name}: all contacts must have gaps and normal forces")
        if (self.potential is None) != (self.inputs is None):
            raise ArgumentError("potential and inputs belong together; give both or none")
        if not 0 < self.size < np.inf:
            raise ArgumentError(f"size must be positive, not {self.size!r}")
        numbers = signal_values(tuple(model.p), self.p, "parameter")
        object.__setattr__(self, "_numbers", numbers)

    @property
    def n_q(self) -> int:
        """Number of places."""
        return self.model.n_x // 2

    def rest(self, start: ArrayLike, numbers: ArrayLike = ()) -> Rest:
        """Find the rest by lowering the energy from the places `start` (n_q,).

        `numbers` are passed to `potential` and `inputs`.
        Raises SolveError "no_rest" (no minimum found) or "not_balanced" (forces there).
        """
        begin, given = (np.asarray(part, dtype=float).ravel() for part in (start, numbers))
        if begin.shape != (self.n_q,) or not np.all(np.isfinite(begin)):
            raise ArgumentError(f"{self.model.name}: start must have {self.n_q} finite entries")
        if given.shape != (self._n_given,) or not np.all(np.isfinite(given)):
            raise ArgumentError(f"loads must be {self._n_given} finite numbers, not {numbers!r}")
        n_c = len(self.model.contacts)
        free = np.full(self.n_q, np.inf)
        bounds = Bounds(-free, free, np.zeros(n_c), np.full(n_c, np.inf), given)
        options = Ipopt(tolerance=1e-9, mu_init=1e-2)
        found = self._program.solve(begin / self._sizes, bounds, options)
        try:
            w, force = self._polished(found.w, np.maximum(-found.multipliers, 0.0), given)
        except SolveError:
            if found.success:
                raise
            # the interior point's status does not matter if Newton's method converges
            raise SolveError(
                f"{self.model.name}: no state of rest was found ({found.status})",
                "use a start closer to it, or smaller loads", code="no_rest",
            ) from None  # fmt: skip
        return self._rest(w, force, given, found.iterations)

    def _polished(
        self, w: np.ndarray, force: np.ndarray, given: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Point and scaled forces to rounding, with the set of touched walls corrected."""
        gaps = self._gaps(w)
        touched = force > gaps
        for _ in range(_ROUNDS):
            w, force = self._newton(w, np.where(touched, force, 0.0), touched, given)
            large = max(float(force.max(initial=0.0)), _APART)
            pulls = touched & (force < -_APART * large)
            entered = ~touched & (self._gaps(w) < -_APART)
            if not (pulls.any() or entered.any()):
                return w, np.maximum(force, 0.0)
            # one pulling wall at a time: others may no longer pull then
            if pulls.any():
                pulls = force == force[pulls].min()
            touched = (touched & ~pulls) | entered
        raise SolveError(
            f"{self.model.name}: the search for the touched walls did not end",
            "use a finer mesh, or another start", code="not_balanced",
        )  # fmt: skip

    def _newton(
        self, w: np.ndarray, force: np.ndarray, touched: np.ndarray, given: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method with the touched walls."""
        n, on, last = len(w), np.flatnonzero(touched), np.inf
        zero = np.zeros((len(on), len(on)))
        for _ in range(_STEPS):
            slope, curve, gaps, jacobian = self._conditions(w, force, given)
            J = jacobian[on]
            left = np.concatenate([slope - J.T @ force[on], gaps[on]])
            if not np.all(np.isfinite(left)):
                break
            step = _solved(np.block([[curve, -J.T], [J, zero]]), -left)
            w, force = w + step[:n], force.copy()
            force[on] += step[n:]
            size = float(np.abs(step[:n]).max(initial=0.0))
            if size < _APART or (size < _SMALL and size > last / 2):  # rounding
                return w, force
            last = size
        raise SolveError(
            f"{self.model.name}: forces do not balance where the energy is least",
            "use a finer mesh, or smaller loads", code="not_balanced",
        )  # fmt: skip

    def _rest(self, w: np.ndarray, force: np.ndarray, given: np.ndarray, iterations: int) -> Rest:
        slope, curve, gaps, jacobian = self._conditions(w, force, given)
        on = force > _APART * max(float(force.max(initial=0.0)), _APART)
        along = _null_space(jacobian[on], len(w))
        stiffness = np.linalg.eigvalsh(along.T @ curve @ along) if along.size else np.ones(1)
        walls = jacobian.T @ force
        scale = np.abs(walls).max(initial=0.0) or float(stiffness[-1])
        q, pressed = w * self._sizes, force * self.size / self._reaches
        largest = max(float(force.max(initial=0.0)), _APART) * float(gaps.max(initial=_APART))
        return Rest(
            places=q,
            pressed=pressed,
            gaps=gaps * self._reaches,
            energy=float(self._energy(w, given)) * self.size,
            residual=float(np.abs(slope - walls).max() / scale),
            imbalance=self._imbalance(q, pressed, given),
            violation=float(np.maximum(-gaps * self._reaches, 0.0).max(initial=0.0)),
            complementarity=float(np.abs(gaps * force).max(initial=0.0) / largest),
            softest=float(stiffness[0]) * self.size,
            stiffest=float(stiffness[-1]) * self.size,
            iterations=iterations,
        )

    def _imbalance(self, q: np.ndarray, pressed: np.ndarray, given: np.ndarray) -> float:
        """Accelerations by the equations of motion, relative to those of each kind of force."""
        loads = np.zeros(sum(s.size for s in self.model.u))
        if self.inputs is not None:
            loads = np.array(self.inputs(q, given)).ravel()
        none = np.zeros(len(pressed))
        whole, own, pulled, walled = (
            np.array(self._motion(q, u, force)).ravel()
            for u, force in (
                (loads, pressed), (0 * loads, none), (loads, none), (0 * loads, pressed)
            )
        )  # fmt: skip
        parts = (own, pulled - own, walled - own)
        largest = max(float(np.abs(part).max(initial=0.0)) for part in parts)
        return float(np.abs(whole).max(initial=0.0)) / largest if largest else 0.0

    @property
    def _n_given(self) -> int:
        return 0 if self.potential is None else int(self.potential.size1_in(1))

    @cached_property
    def _sizes(self) -> np.ndarray:
        """Nominal sizes of the places."""
        return nominal_of(self.model.x)[: self.n_q]

    @cached_property
    def _own(self) -> ca.Function:
        """Elastic energy and gaps by places."""
        model = self.model
        gaps = [c.gap for c in model.contacts if c.gap is not None]
        found = [model[self.stored], ca.vertcat(ca.SX(0, 1), *gaps)]
        found = ca.substitute(found, [pack(model.p)], [ca.SX(ca.DM(self._numbers))])
        return ca.Function("own", [pack(model.x)[: self.n_q]], found)

    @cached_property
    def _reaches(self) -> np.ndarray:
        """Change of a gap over nominal sizes of the places."""
        slopes = np.array(ca.densify(self._own.jacobian()(np.zeros(self.n_q), 0, 0)[1]))
        found = np.linalg.norm(slopes * self._sizes, axis=1)
        return np.where(found > 0, found, 1.0)

    @cached_property
    def _parts(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Scaled places, numbers, scaled energy, scaled gaps."""
        w, given = ca.MX.sym("w", self.n_q), ca.MX.sym("given", self._n_given)
        places = w * ca.DM(self._sizes)
        energy, gaps = self._own(places)
        if self.potential is not None:
            energy += self.potential(places, given)
        return w, given, energy / self.size, gaps / ca.DM(self._reaches)

    @cached_property
    def _program(self) -> NonlinearProgram:
        return NonlinearProgram(*self._parts)

    @cached_property
    def _energy(self) -> ca.Function:
        return ca.Function("energy", [*self._parts[:2]], [self._parts[2]])

    @cached_property
    def _derivatives(self) -> ca.Function:
        w, given, energy, gaps = self._parts
        force = ca.MX.sym("force", gaps.numel())
        slope = ca.gradient(energy, w)
        curve = ca.hessian(energy - ca.dot(force, gaps), w)[0]
        return ca.Function(
            "conditions", [w, force, given], [slope, curve, gaps, ca.jacobian(gaps, w)]
        ).expand()

    @cached_property
    def _motion(self) -> ca.Function:
        """Accelerations at rest without friction, by places, inputs and forces of the walls."""
        model, half = self.model, self.n_q
        x, u = pack(model.x), pack(model.u)
        pressed = [c.normal_force for c in model.contacts if c.normal_force is not None]
        force = ca.vertcat(ca.SX(0, 1), *pressed)
        gone = ca.vertcat(x[half:], *(c.force for c in model.contacts))
        still = ca.substitute(model.ode[half:], gone, ca.DM.zeros(gone.numel()))
        accelerations = ca.substitute(still, pack(model.p), ca.DM(self._numbers))
        return ca.Function("motion", [x[:half], u, force], [accelerations])

    def _conditions(self, w: np.ndarray, force: np.ndarray, given: np.ndarray) -> Any:
        """Slope and second derivatives of the energy, gaps and their slopes, all scaled."""
        slope, curve, gaps, jacobian = (
            np.array(ca.densify(part)) for part in self._derivatives(w, force, given)
        )
        return slope.ravel(), curve, gaps.ravel(), jacobian

    def _gaps(self, w: np.ndarray) -> np.ndarray:
        bounds = Bounds(w, w, np.zeros(0), np.zeros(0), np.zeros(self._n_given))
        return self._program.constraints(w, bounds)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution; the shortest one if places are neutral."""
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        found = np.full(len(right), np.nan)
    if not np.all(np.isfinite(found)):
        found = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return found


def _null_space(jacobian: np.ndarray, n: int) -> np.ndarray:
    """Columns: motions of length 1 along the walls."""
    return null_space(jacobian, rcond=_APART) if len(jacobian) else np.eye(n)
