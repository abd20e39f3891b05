"""Steady motions of the pair, averaged and exact, over the frequency of its field."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from wormopt.analysis.average import average
from wormopt.analysis.continuation import Branch, continue_branch
from wormopt.analysis.steady import SteadyState, rates_of, steady_states
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law
from wormopt.model.model import Model
from wormopt.numerics.newton import newton
from wormopt.progress import Report
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Tolerance
from wormopt.systems.pair.exact import magnetic_pair, scaled_law
from wormopt.systems.pair.slow import SteadyPair, from_slow, slow_pair, steady_pair
from wormopt.systems.pair.tables import NATURAL

# Swings beyond which averages are not evaluated.
_LARGEST = 100.0
# Averages of second order hold where the swing exceeds eps by this factor; below, a reversal shifts
# by as much as the swing itself.
_SWUNG = 4.0
# Detunings at which steady states are searched as starts of branches, as shares of the sweep.
_BEGINNINGS = (0.0, 0.13, 0.37, 0.63, 0.87, 1.0)
# Steady states that differ by less from those of a branch belong to it.
_ALIKE = 1e-6
_MOST = 30  # branches
# Largest difference of means over consecutive periods after convergence.
_SETTLED = 1e-3


@dataclass(frozen=True, eq=False)
class Pair:
    """The dimensionless pair: exact, slow, averaged."""

    eps: float  # push over stiffness times length
    laws: tuple[Law, Law]  # friction of both masses over the push
    cosines: tuple[float, ...]  # field, the mean first
    nodes: int  # points of quadrature

    @property
    def drive(self) -> float:
        """First harmonic of the field, which drives the swing."""
        return self.cosines[1]

    def _build(self, builder: Any) -> Model:
        laws = [scaled_law(law, self.eps) for law in self.laws]
        return builder(law=laws, push=self.eps, frequency=NATURAL, cosines=self.cosines)

    @cached_property
    def exact(self) -> Model:
        """Model of eq. 16."""
        return self._build(magnetic_pair)

    @cached_property
    def slow(self) -> Model:
        """Model of eq. 17."""
        return self._build(slow_pair)

    @cached_property
    def averages(self) -> tuple[Model, Model]:
        """Averages of first and second order."""
        return self._average(1, self.nodes), self._average(2, self.nodes)

    def _average(self, order: Literal[1, 2], nodes: int) -> Model:
        period = 2 * ca.pi / self.slow["frequency"]
        return average(self.slow, period, order=order, nodes=nodes)

    def frequency(self, detuning: Any) -> Any:
        """Frequency of the field, in natural frequencies, at detuning Delta or several."""
        return NATURAL + self.eps * detuning

    def detuning(self, frequency: Any) -> Any:
        """Detuning at a frequency, or at several."""
        return (frequency - NATURAL) / self.eps

    def steady(self, detuning: float) -> tuple[SteadyState, ...]:
        """Steady states of the first average at detuning Delta, the stable ones first.

        Their swing is at most the frictionless |G_1| / (2 sqrt(2) |Delta|), since friction has no
        component in phase with it.
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
        """Steady state of the second average closest to one of the first.

        None if there is none, or the swing is too small for a second order.
        """
        if not self.swung(state.states["swing"]):
            return None
        rates = rates_of(self.averages[1])
        (x,), (found,) = newton(rates, state.x[None], state.p)
        return rates.steady(x, state.p) if found else None

    def swung(self, swing: np.ndarray) -> np.ndarray:
        """Whether (m,) swings (2, m) of the first average are large enough for second order."""
        return np.hypot(*swing) >= _SWUNG * self.eps

    def start(self, x: np.ndarray, frequency: float) -> dict[str, np.ndarray]:
        """Positions and velocities at time 0 of a state (3,) of an average.

        `frequency`: of the field, in natural frequencies.
        """
        return from_slow(0.0, x[0], x[1:], frequency=frequency)

    def closed_form(self, detuning: float) -> SteadyPair | None:
        """Steady motion by eq. 19; None unless the friction is dry and equal for both."""
        first, second = self.laws
        if not (isinstance(first, Coulomb) and isinstance(second, Coulomb)):
            return None
        forward, backward = float(first.forward), float(first.backward)
        if (forward, backward) != (second.forward, second.backward):
            return None
        size = abs(self.drive)
        closed = steady_pair(forward / size, backward / size, detuning / size)
        return closed if self.drive > 0 else replace(closed, lag=closed.lag - math.pi)

    def closed_form_difference(self, x: np.ndarray, detuning: float) -> float | None:
        """Distance of a steady state (3,) of the first average from eq. 19; None if inapplicable.

        In velocity and swing, over the larger of both; infinite if eq. 19 has no such state.
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

    def why_none(self, detuning: float, largest: float) -> str:
        """Reason why there is no steady motion with a swing up to `largest` at detuning Delta."""
        try:
            self.closed_form(detuning)
        except ArgumentError as error:
            return str(error)
        size = f"{min(largest, _LARGEST):g} lengths of the link"
        return f"the averaged pair has no steady motion with a swing up to {size}"

    def quadrature_error(self, state: SteadyState) -> float:
        """Change of the mean rates at a state with twice the points of quadrature, over eps."""
        finer = rates_of(self._average(1, 2 * self.nodes))
        rates = rates_of(self.averages[0])
        change = finer(state.x[None], state.p) - rates(state.x[None], state.p)
        return float(np.abs(change).max() / self.eps)


# -- branches along the frequency ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Points:
    """Steady states at the values of the sweep, all branches one after the other."""

    detuning: np.ndarray
    x: np.ndarray
    stable: np.ndarray
    branch: np.ndarray
    second: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of the centre."""
        return self.x[:, 0]

    @property
    def amplitude(self) -> np.ndarray:
        """Amplitude of half the stretch."""
        return np.hypot(self.x[:, 1], self.x[:, 2])


@dataclass(frozen=True, eq=False)
class Exact:
    """Mean velocities of exact motions from the stable points, NaN for others."""

    velocity: np.ndarray
    before: np.ndarray
    gave_up: int

    @property
    def settled(self) -> np.ndarray:
        """Whether the mean has converged."""
        size = np.maximum(np.abs(self.velocity), np.abs(self.before))
        return np.abs(self.velocity - self.before) <= _SETTLED * size


def branches_of(pair: Pair, detuning: tuple[float, float], largest: float) -> list[Branch]:
    """Branches through the steady states found at some detunings of a range, each once.

    `largest`: amplitude above which a branch counts as unbounded.
    """
    low, high = detuning
    span = (pair.frequency(low), pair.frequency(high))
    found: list[Branch] = []
    places, seen = [low + share * (high - low) for share in _BEGINNINGS], 0
    while places:
        for state in pair.steady(places.pop(0)):
            # a state beyond `largest` is on the unbounded part of a branch
            known = np.hypot(*state.states["swing"]) > largest or any(_on(b, state) for b in found)
            if not known and len(found) < _MOST:
                found.append(continue_branch(state, "frequency", span, largest=largest))
        for branch in found[seen:]:
            crossings = map(pair.detuning, _crossings(branch))
            places += [detuning for detuning in crossings if low <= detuning <= high]
        seen = len(found)
    return found


def _crossings(branch: Branch) -> Iterator[float]:
    """Points where stability changes without a fold, from which other branches may start."""
    folds = np.array([fold.parameter for fold in branch.folds])
    for k in np.flatnonzero(np.diff(branch.stable)):
        ends = branch.parameter[k : k + 2]
        if np.any(np.abs(folds - ends[:, None]) < 1e-9):
            continue
        reach = max(abs(ends[1] - ends[0]), 1e-3 * np.ptp(branch.parameter))
        yield from (float(ends.min() - reach), float(ends.max() + reach))


def _on(branch: Branch, state: SteadyState) -> bool:
    place = rates_of(state.model).place("frequency")
    same = branch.at([state.p[place]])
    return any(np.abs(x - state.x).max() < _ALIKE for x in same.x)


def points_of(pair: Pair, branches: Sequence[Branch], detuning: np.ndarray) -> Points:
    """States of all branches at some detunings, where they exist."""
    sampled = [branch.at(pair.frequency(detuning)) for branch in branches]
    frequency = np.concatenate([branch.parameter for branch in sampled])
    x = np.concatenate([branch.x for branch in sampled])
    return Points(
        pair.detuning(frequency),
        x,
        np.concatenate([branch.stable for branch in sampled]),
        np.concatenate([np.full(len(b.parameter), k) for k, b in enumerate(sampled)]),
        _second(pair, x, frequency),
    )


def _second(pair: Pair, x: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Velocities of the second average closest to states of the first; NaN where none exist."""
    velocity = np.full(len(x), np.nan)
    large = pair.swung(x[:, 1:].T)
    if not large.any():
        return velocity
    rates = rates_of(pair.averages[1])
    p = np.tile(rates.parameters(None), (int(large.sum()), 1))
    p[:, rates.place("frequency")] = frequency[large]
    refined, found = newton(rates, x[large], p)
    velocity[large] = np.where(found, refined[:, 0], np.nan)
    return velocity


def confirm(
    pair: Pair, points: Points, end: float, periods: int, tolerance: Tolerance, report: Report
) -> Exact:
    """Simulate from every stable point, and average the last periods of the field."""
    which = np.flatnonzero(points.stable)
    means = np.full((2, len(points.detuning)), np.nan)
    if not which.size:
        return Exact(means[1], means[0], 0)
    members, marks = [], []
    for k in which:
        nu = pair.frequency(points.detuning[k])
        members.append(Scenario(x0=pair.start(points.x[k], nu), p={"frequency": nu}))
        length = 2 * np.pi / nu * periods
        marks.append([end - 2 * length, end - length, end])
    motions = simulate_ensemble(
        pair.exact, end, members, times=np.unique(marks), tolerance=tolerance, report=report
    )
    # Displacement over time between the marks of every member.
    columns = np.searchsorted(motions.time, marks)
    places = np.take_along_axis(motions.states[:, :2].mean(axis=1), columns, axis=1)
    means[:, which] = (np.diff(places, axis=1) / np.diff(marks, axis=1)).T
    return Exact(means[1], means[0], sum(code != "" for code in motions.codes))
