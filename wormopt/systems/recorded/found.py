"""Estimates from measurements, in the form of results."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.stats import norm

from wormopt.model.model import Model
from wormopt.quantities import UNITS, Scalar, unit_of


class Coordinates(Protocol):
    """Transformation from coordinates of a search, for example logarithms, to parameters."""

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Parameters (n,) of coordinates (n,)."""
        ...

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        """Derivatives (n,) of the parameters by the coordinates."""
        ...


@dataclass(frozen=True)
class Number:
    """An estimated parameter."""

    name: str
    unit: str
    began: float  # initial value of the search


@dataclass(frozen=True, eq=False)
class Found:
    """Estimates, their errors and intervals."""

    numbers: Sequence[Number]
    value: np.ndarray  # (n,)
    error: np.ndarray  # (n,) standard errors, infinite if not identifiable
    interval: np.ndarray  # (n, 2)
    correlation: np.ndarray  # (n, n)

    @classmethod
    def of(
        cls,
        numbers: Sequence[Number],
        coordinates: Coordinates,
        theta: np.ndarray,
        covariance: np.ndarray,
        level: float,
    ) -> Found:
        """Make estimates and intervals from coordinates and their covariance (n, n)."""
        spread = np.sqrt(np.diag(covariance))
        reach = float(norm.ppf((1 + level) / 2)) * spread
        ends = [coordinates.values(theta + side * reach) for side in (-1, 1)]
        with np.errstate(all="ignore"):
            correlation = covariance / np.outer(spread, spread)
        value = coordinates.values(theta)
        error = spread * np.abs(coordinates.slopes(theta))
        return cls(numbers, value, error, np.stack(ends, axis=1), correlation)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(number.name for number in self.numbers)

    @property
    def scalars(self) -> dict[str, Any]:
        """Scalars of every estimate, its standard error and its interval."""
        found: dict[str, Any] = {}
        for k, number in enumerate(self.numbers):
            found[label_of(number.name)] = Scalar(float(self.value[k]), number.unit)
        for k, number in enumerate(self.numbers):
            label = label_of(number.name)
            error = float(self.error[k]) if np.isfinite(self.error[k]) else None
            found[f"{label}_error"] = Scalar(error, number.unit)
            found[f"{label}_interval"] = Scalar(self.interval[k].tolist(), number.unit)
        return found

    @property
    def variables(self) -> dict[str, np.ndarray]:
        """Arrays of the estimates, each in its parameter's own unit."""
        return {
            "estimate": self.value,
            "standard_error": self.error,
            "interval": self.interval,
            "began": np.array([number.began for number in self.numbers]),
            "correlation": self.correlation,
        }


def label_of(name: str) -> str:
    """Convert a parameter's name to the name of a scalar: letters, digits and _."""
    label = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return label if label[:1].isalpha() else f"number_{label}"


def markdown(found: Found, level: float) -> str:
    """Table of estimates in Markdown."""
    rows = [
        f"| unknown | unit | initial | estimate | standard error | {100 * level:g} % interval |",
        "| --- | --- | ---: | ---: | ---: | --- |",
    ]
    for k, number in enumerate(found.numbers):
        error = f"{found.error[k]:.2g}" if np.isfinite(found.error[k]) else "not identifiable"
        low, high = found.interval[k]
        told = f"{low:.5g} to {high:.5g}" if np.isfinite([low, high]).all() else "unbounded"
        rows.append(
            f"| {number.name} | {number.unit} | {number.began:.5g} | {found.value[k]:.6g} | "
            f"{error} | {told} |"
        )
    return "\n".join(rows) + "\n"


def unit_of_directions(model: Model, directions: Mapping[str, np.ndarray], units: str) -> str:
    """Unit of a parameter from the signals that depend on it, "1" if their units differ."""
    signals = {s.name: s.unit for s in (*model.x, *model.p, *model.u)}
    found = {unit_of_signal(signals.get(name, "1"), units) for name in directions}
    return found.pop() if len(found) == 1 else "1"


def unit_of_signal(unit: str, units: str) -> str:
    """Unit of a signal: that of its quantity, or its own."""
    if unit in UNITS:
        return unit_of(unit, units)
    return unit if units == "SI" else "1"
