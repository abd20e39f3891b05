"""What the studies of the magneto-elastic pair share: its scales, its averages, what is stated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from wormopt.analysis.average import average
from wormopt.analysis.steady import SteadyState, rates_of, steady_states
from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.model.friction import Law
from wormopt.model.model import Model
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.systems.chain.runs.chains import law_of
from wormopt.systems.chain.scenes.chain import CoulombFriction
from wormopt.systems.pair.averaged_pair import SteadyPair, steady_pair
from wormopt.systems.pair.magnetic_pair import magnetic_pair
from wormopt.systems.pair.scenes.magnetic_pair import MagneticPairTable
from wormopt.systems.pair.scenes.pair_waveform import NATURAL
from wormopt.systems.pair.slow_pair import from_slow, slow_pair
from wormopt.systems.shared.signals import symbol

# Swings beyond which averages are not asked for, and friction forces per push from which a small
# parameter is none.
_LARGEST, _SMALL = 100.0, 0.1
# Averages of second order hold where the swing is so many times eps: below, a reversal shifts by
# as much as the swing itself.
_SWUNG = 4.0


@dataclass(frozen=True)
class Scales:
    """Units of the dimensionless pair, in units of the scene."""

    length: float = 1.0  # l0 of the link
    time: float = 1.0  # natural time sqrt(m / c)

    @classmethod
    def of(cls, table: MagneticPairTable) -> Scales:
        """Take them from a sample; 1 without."""
        return cls(table.sample.length if table.sample else 1.0, table.natural_time)

    @property
    def speed(self) -> float:
        """Unit of velocities."""
        return self.length / self.time


@dataclass(frozen=True, eq=False)
class Pair:
    """The dimensionless pair of a scene: exact, slow, averaged."""

    table: MagneticPairTable
    nodes: int  # points of quadrature

    @property
    def eps(self) -> float:
        """Push over stiffness times length."""
        return self.table.smallness

    @property
    def drive(self) -> float:
        """First harmonic of the field: the one that swings the pair."""
        return self.table.cosines[1]

    @cached_property
    def laws(self) -> tuple[Law, Law]:
        """Friction of both masses over the push."""
        return law_of(self.table.friction, 0), law_of(self.table.friction, 1)

    def _build(self, builder: Any) -> Model:
        scaled = [_scaled(law, self.eps) for law in self.laws]
        return builder(law=scaled, push=self.eps, frequency=NATURAL, cosines=self.table.cosines)

    @cached_property
    def exact(self) -> Model:
        """(16)."""
        return self._build(magnetic_pair)

    @cached_property
    def slow(self) -> Model:
        """(17)."""
        return self._build(slow_pair)

    @cached_property
    def averages(self) -> tuple[Model, Model]:
        """Averages of first and second order."""
        return self._average(1, self.nodes), self._average(2, self.nodes)

    def _average(self, order: Literal[1, 2], nodes: int) -> Model:
        period = 2 * ca.pi / symbol(self.slow, "frequency")
        return average(self.slow, period, order=order, nodes=nodes)

    def frequency(self, detuning: float) -> float:
        """Frequency of the field at detuning Delta, in natural rates."""
        return NATURAL + self.eps * detuning

    def steady(self, detuning: float) -> tuple[SteadyState, ...]:
        """Steady states of the first average at detuning Delta, the stable ones first.

        Their swing is at most the frictionless |G_1| / (2 sqrt(2) |Delta|), since friction
        has no part in phase with it.
        """
        bound = abs(self.drive) / (2 * NATURAL * max(abs(detuning), 1e-12))
        size = 1.05 * min(bound, _LARGEST)
        found = steady_states(
            self.averages[0],
            {"center_velocity": (-NATURAL * size, NATURAL * size), "swing": (-size, size)},
            p={"frequency": self.frequency(detuning)},
        )
        return tuple(sorted(found, key=lambda state: not state.stable))

    def refined(self, state: SteadyState) -> SteadyState | None:
        """Steady state of the second average next to one of the first.

        None without one, or where the swing is too small for a second order.
        """
        if np.hypot(*state.states["swing"]) < _SWUNG * self.eps:
            return None
        rates = rates_of(self.averages[1])
        (x,), (found,) = rates.newton(state.x[None], state.p)
        return rates.steady(x, state.p) if found else None

    def swung(self, swing: np.ndarray) -> np.ndarray:
        """Whether (m,) swings (2, m) of the first average are large enough for second order."""
        return np.hypot(*swing) >= _SWUNG * self.eps

    def start(self, x: np.ndarray, frequency: float) -> dict[str, np.ndarray]:
        """Positions and velocities at time 0 of a state (3,) of an average.

        `frequency`: of the field, in natural rates.
        """
        return from_slow(0.0, x[0], x[1:], frequency=frequency)

    def closed_form(self, detuning: float) -> SteadyPair | None:
        """Steady motion by (19); None unless the friction is dry and alike for both.

        Raises ArgumentError if there is no steady motion; `detuning`: Delta.
        """
        law = self.table.friction
        if not isinstance(law, CoulombFriction):
            return None
        (f0, f1), (b0, b1) = per(law.forward, 2), per(law.backward, 2)
        if (f0, b0) != (f1, b1):
            return None
        size = abs(self.drive)
        closed = steady_pair(f0 / size, b0 / size, detuning / size)
        return closed if self.drive > 0 else replace(closed, lag=closed.lag - math.pi)

    def closed_form_difference(self, x: np.ndarray, detuning: float) -> float | None:
        """Distance of a steady state (3,) of the first average from (19); None if inapplicable.

        In velocity and swing, over the larger of both; infinite if (19) has no such state.
        """
        try:
            closed = self.closed_form(detuning)
        except ArgumentError:
            return math.inf
        if closed is None:
            return None
        turn = np.array([math.cos(closed.lag), math.sin(closed.lag)])
        known = np.array([closed.velocity, *(closed.amplitude * turn)])
        return float(np.abs(x - known).max() / np.abs(known).max())

    def why_none(self, detuning: float) -> str:
        """Say why there is no steady motion at detuning Delta."""
        try:
            self.closed_form(detuning)
        except ArgumentError as error:
            return str(error)
        return "the averaged pair has no steady motion with a swing up to 100 lengths of the link"

    def quadrature_error(self, state: SteadyState) -> float:
        """Change of the mean rates at a state with twice the points of quadrature, over eps."""
        finer = rates_of(self._average(1, 2 * self.nodes))
        rates = rates_of(self.averages[0])
        change = finer(state.x[None], state.p) - rates(state.x[None], state.p)
        return float(np.abs(change).max() / self.eps)


def no_steady_motion(scene: Scene[Any], reason: str) -> SolveError:
    """Error, to be raised, for a pair that never moves steadily; it has a failed Result."""
    partial = Result(
        scene=scene.name,
        kind=scene.table.kind,
        title=scene.title,
        status="failed",
        reason=reason,
        scene_text=scene.text,
    )
    suggestion = "change detuning, pair.friction or pair.cosines"
    return SolveError(reason, suggestion, partial, "no_steady_motion")


def _scaled(law: Law, eps: float) -> Law:
    """Friction in units of force: all numbers but the width of a Stribeck law."""
    numbers = {
        item.name: eps * getattr(law, item.name)
        for item in fields(law)  # type: ignore[arg-type]
        if item.name != "v_stribeck" and getattr(law, item.name) is not None
    }
    return replace(law, **numbers)  # type: ignore[type-var]


def warnings_of_pair(pair: Pair, state: SteadyState | None) -> Iterator[str]:
    """Say where the pair, settled at `state`, leaves what its theory assumes."""
    if pair.eps > _SMALL:
        yield (
            f"eps = {pair.eps:.4g} is not small: averages are right to about eps in first and "
            "eps^2 in second order; trust the exact motion"
        )
    if state is None:
        return
    strain = 2 * float(np.hypot(*state.states["swing"]))
    if strain > SMALL_STRAIN:
        yield (
            f"the stretch swings by {strain:.3g} of the length: the law of the material assumes "
            f"small strains, up to about {SMALL_STRAIN:g}"
        )
    if float(state.states["center_velocity"][0]) < 0:
        yield "the pair goes backward: friction is weaker that way"
