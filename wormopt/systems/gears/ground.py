"""Ground that changes along the route: load, drag and towed load by position."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class Ground:
    """Loads of the ground by position: linear between knots, constant beyond the ends.

    `load` and `drag` act on every mass at its position, `towed` on the tail at its position.
    Raises ArgumentError if places do not increase or shapes differ.
    """

    place: np.ndarray  # (k,) knots, ascending
    load: np.ndarray  # (k,) force against forward motion on each mass
    drag: np.ndarray  # (k,) viscous drag of each mass
    towed: np.ndarray  # (k,) force against forward motion on the tail alone

    def __post_init__(self) -> None:
        for name in ("place", "load", "drag", "towed"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        if self.place.ndim != 1 or not len(self.place) or np.any(np.diff(self.place) <= 0):
            raise ArgumentError("places are missing or do not increase; write increasing numbers")
        if any(len(getattr(self, name)) != len(self.place) for name in ("load", "drag", "towed")):
            raise ArgumentError("load, drag and towed need one number for each place")

    def at(self, name: str, place: np.ndarray) -> np.ndarray:
        """Value of "load", "drag" or "towed" at positions of any shape."""
        return np.interp(place, self.place, getattr(self, name))

    def expression(self, name: str, place: ca.SX) -> ca.SX:
        """Value of "load", "drag" or "towed" as an expression of a column of symbols."""
        values = getattr(self, name)
        slopes = np.diff(values) / np.diff(self.place) if len(values) > 1 else np.zeros(0)
        changes = np.diff(slopes, prepend=0.0, append=0.0)
        found = ca.SX(place.shape[0], 1) + float(values[0])
        for knot, change in zip(self.place.tolist(), changes.tolist(), strict=True):
            if change:
                found += change * ca.fmax(place - knot, 0)
        return found

    def pull(self, place: np.ndarray) -> np.ndarray:
        """Force against forward motion on masses at positions (n+1, ...), with the towed load."""
        found = self.at("load", place)
        found[-1] += self.at("towed", place[-1])
        return found

    def pull_expression(self, place: ca.SX) -> ca.SX:
        """Force against forward motion as an expression of a column of symbols (n+1, 1)."""
        found = self.expression("load", place)
        found[-1] += self.expression("towed", place[-1])
        return found
