"""Estimates from measurements, in the form of results."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from wormopt.quantities import Scalar, unit_of_signal
from wormopt.result import Check
from wormopt.study import on_use, signal

with on_use():
    import numpy as np
    from scipy.special import ndtri

    from wormopt.fitting.estimate import Fit
    from wormopt.fitting.noise import excess
    from wormopt.fitting.task import FitTask
    from wormopt.model.model import Model
    from wormopt.systems.recorded.numbers_task import NumbersTask


# Residuals this many times the noise given are not of a model that describes its data.
_GROSS = 3.0


@dataclass(frozen=True, eq=False)
class Found:
    """Estimates of n parameters, their errors and intervals."""

    names: Sequence[str]
    units: Sequence[str]
    began: np.ndarray = signal("count", "unknown", "initial values of the search")
    estimate: np.ndarray = signal("count", "unknown", "estimates, each in its own unit")
    standard_error: np.ndarray = signal("count", "unknown", "standard errors of the estimates")
    interval: np.ndarray = signal(
        "count", "unknown end", "confidence intervals, lower and upper end"
    )
    correlation: np.ndarray = signal("count", "unknown other_unknown", "correlation of the errors")

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        units: Sequence[str],
        began: Sequence[float],
        coordinates: FitTask | NumbersTask,
        theta: np.ndarray,
        covariance: np.ndarray,
        level: float,
    ) -> Found:
        """Make estimates and intervals from coordinates and their covariance (n, n)."""
        spread = np.sqrt(np.diag(covariance))
        reach = float(ndtri((1 + level) / 2)) * spread
        ends = [coordinates.values(theta + side * reach) for side in (-1, 1)]
        with np.errstate(all="ignore"):
            correlation = covariance / np.outer(spread, spread)
        error = spread * np.abs(coordinates.slopes(theta))
        return cls(
            names, units, np.array(began), coordinates.values(theta), error,
            np.stack(ends, axis=1), correlation,
        )  # fmt: skip

    @property
    def scalars(self) -> dict[str, Scalar]:
        """Scalars of every estimate, its standard error (None if infinite) and its interval."""
        labels, found = [*map(label_of, self.names)], dict[str, Scalar]()
        for label, unit, value in zip(labels, self.units, self.estimate.tolist(), strict=True):
            found[label] = Scalar(value, unit)
        for k, (label, unit) in enumerate(zip(labels, self.units, strict=True)):
            error = float(self.standard_error[k])
            found[f"{label}_error"] = Scalar(error if np.isfinite(error) else None, unit)
            found[f"{label}_interval"] = Scalar(self.interval[k].tolist(), unit)
        return found

    def markdown(self, level: float) -> str:
        """Table of estimates with intervals of a confidence in Markdown."""
        rows = [
            "| unknown | unit | initial | estimate | standard error "
            f"| {100 * level:g} % interval |",
            "| --- | --- | ---: | ---: | ---: | --- |",
        ]
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            error, (low, high) = self.standard_error[k], self.interval[k]
            known = f"{error:.2g}" if np.isfinite(error) else "not identifiable"
            ends = f"{low:.5g} to {high:.5g}" if np.isfinite([low, high]).all() else "unbounded"
            rows.append(
                f"| {name} | {unit} | {self.began[k]:.5g} | {self.estimate[k]:.6g} | {known} "
                f"| {ends} |"
            )
        return "\n".join(rows) + "\n"


def label_of(name: str) -> str:
    """Convert a parameter's name to the name of a scalar: letters, digits and _."""
    label = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return label if label[:1].isalpha() else f"number_{label}"


def unit_of_directions(model: Model, directions: Mapping[str, np.ndarray], units: str) -> str:
    """Unit of a parameter from the signals that depend on it, "1" if their units differ."""
    signals = {s.name: s.unit for s in (*model.x, *model.p, *model.u)}
    found = {unit_of_signal(signals.get(name, "1"), units) for name in directions}
    return found.pop() if len(found) == 1 else "1"


def checks_of_noise(found: Fit) -> Iterator[Check]:
    """Yield the check that residuals are not far above the noise given, if any is."""
    if size := excess(found):
        advice = (
            f"residuals are {size:.2g} times the noise given: the model, a clock, a unit, a column "
            "or the noise is wrong; correct it, or leave noise out to estimate it"
        )
        yield Check("residuals over the noise given", size, _GROSS, advice)
