"""Coordinates between bounds as numbers without bounds, for samplers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import expit, log_expit, logit

_INSIDE = 1e-3  # share of the interval by which a point at a bound is moved inside


@dataclass(frozen=True, eq=False)
class Unbounded:
    """theta (n,) as a function of u (n,): logistic between two bounds, exponential from one."""

    lower: np.ndarray
    upper: np.ndarray
    nominal: np.ndarray

    def theta(self, u: np.ndarray) -> np.ndarray:
        """Coordinates within bounds."""
        grown = self.nominal * np.exp(u)
        return self._choose(u, self.lower + grown, self.upper - grown, self._between(expit(u)))

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """d(theta) / d(u)."""
        grown = self.nominal * np.exp(u)
        return self._choose(np.ones_like(u), grown, -grown, self._room * expit(u) * expit(-u))

    def log_slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Logarithms of the slopes' sizes up to constants, with first and second derivatives."""
        one, none = np.ones_like(u), np.zeros_like(u)
        return (
            self._choose(none, u, u, log_expit(u) + log_expit(-u)),
            self._choose(none, one, one, expit(-u) - expit(u)),
            self._choose(none, none, none, -2 * expit(u) * expit(-u)),
        )

    def u(self, theta: np.ndarray) -> np.ndarray:
        """Numbers without bounds; coordinates at a bound are moved a little inside."""
        below = np.maximum(theta - self.lower, _INSIDE * np.minimum(self.nominal, self._room))
        above = np.maximum(self.upper - theta, _INSIDE * np.minimum(self.nominal, self._room))
        share = np.clip((theta - self._from) / self._room, _INSIDE, 1 - _INSIDE)
        grown = np.log(below / self.nominal), np.log(above / self.nominal)
        return self._choose(theta, *grown, logit(share))

    @cached_property
    def _kind(self) -> np.ndarray:
        return np.isfinite(self.lower) + 2 * np.isfinite(self.upper)

    @cached_property
    def _room(self) -> np.ndarray:
        return np.where(self._kind == 3, self.upper - self._from, 1.0)

    @cached_property
    def _from(self) -> np.ndarray:
        return np.where(self._kind == 3, self.lower, 0.0)

    def _between(self, share: np.ndarray) -> np.ndarray:
        return self._from + self._room * share

    def _choose(self, *forms: np.ndarray) -> np.ndarray:
        return np.choose(self._kind, forms)
