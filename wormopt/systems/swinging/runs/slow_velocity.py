"""Steady velocities of a worm of which, on average over a period, nothing else is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import casadi as ca
import numpy as np
from scipy.optimize import root_scalar

from wormopt.analysis.average import average
from wormopt.model.model import Model, pack
from wormopt.model.values import signal_values

# Points between two velocities at which a mass begins or ceases to reverse, and the distance kept
# from these, of the largest velocity: the second order has poles there.
_POINTS, _AWAY = 200, 1e-7
# A root is where the rate is smaller than this, of its largest; at a pole it is not.
_ROOT = 1e-6


@dataclass(frozen=True)
class Steady:
    """A velocity at which mean friction vanishes."""

    velocity: float  # of the centre
    slope: float  # of the mean acceleration by it; negative: stable

    @property
    def stable(self) -> bool:
        """Whether small deviations die out."""
        return self.slope < 0


@dataclass(frozen=True, eq=False)
class SlowVelocity:
    """A model with one slow state, averaged."""

    model: Model  # with the state center_velocity alone
    period: ca.SX  # an expression of the model's parameters
    order: Literal[1, 2]  # of the average
    nodes: int  # points of quadrature on a piece

    @cached_property
    def averaged(self) -> Model:
        """The averaged Model."""
        return average(self.model, self.period, order=self.order, nodes=self.nodes)

    @cached_property
    def _function(self) -> ca.Function:
        V, p = pack(self.averaged.x), pack(self.averaged.p)
        ode = self.averaged.ode
        return ca.Function("mean", [V, p], [ode, ca.jacobian(ode, V)])

    @cached_property
    def _p(self) -> np.ndarray:
        return signal_values(self.averaged.p, None, "parameter")

    def rate(self, V: float) -> float:
        """Mean acceleration at velocity V of the centre."""
        return float(self._function(V, self._p)[0])

    def slope(self, V: float) -> float:
        """Derivative of the mean acceleration by the velocity V of the centre."""
        return float(self._function(V, self._p)[1])

    def steady(self, bends: Sequence[float]) -> list[Steady]:
        """Find all steady velocities, ascending.

        At `bends` a mass begins or ceases to reverse; none is steady beyond the outermost.
        """
        found = sign_changes(self.rate, _grid(bends))
        return [Steady(V, self.slope(V)) for V in found]


def sign_changes(rate: Callable[[float], float], grid: np.ndarray) -> list[float]:
    """Find where a function passes through 0, poles left out; ascending.

    Between two points of the ascending `grid` it is taken to have one zero at most.
    """
    values = np.array([rate(V) for V in grid])
    usual = np.median(np.abs(values[np.isfinite(values)]))
    found = [float(V) for V, value in zip(grid, values, strict=True) if value == 0]
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        low, high = grid[k : k + 2]
        V = root_scalar(rate, bracket=(low, high), method="brentq", xtol=1e-300, rtol=1e-15).root
        if abs(rate(V)) <= _ROOT * usual:
            found.append(V)
    return sorted(found)


def _grid(bends: Sequence[float]) -> np.ndarray:
    """Points around and between the bends, none of them on one."""
    places = np.unique(np.append(bends, 0.0))
    away = _AWAY * np.abs(places).max()
    edges = np.concatenate([[places[0] - 1e3 * away], places, [places[-1] + 1e3 * away]])
    parts = [
        np.linspace(low + away, high - away, _POINTS)
        for low, high in pairwise(edges)
        if high - low > 4 * away
    ]
    return np.concatenate(parts)
