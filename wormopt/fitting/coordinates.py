"""The unknowns of a fit, entry by entry and run by run, as one vector."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.fitting.recording import Recording
from wormopt.fitting.unknowns import Unknown
from wormopt.model.model import Model
from wormopt.model.values import by_name, signal_values

# Largest change of logarithms from their starts: a factor of 1e12.
_REACH = 12 * math.log(10)


@dataclass(frozen=True, eq=False)
class Coordinate:
    """One number of a fit."""

    name: str
    run: int | None  # None: of all
    directions: dict[str, np.ndarray]  # signal -> array of its values' shape
    lower: float  # bounds, start and prior in the coordinate itself
    upper: float
    start: float
    nominal: float  # usual size of a change
    prior: tuple[float, float] | None
    log: bool

    def value(self, theta: float) -> float:
        """The number itself."""
        return math.exp(theta) if self.log else theta

    def slope(self, theta: float) -> float:
        """d(number) / d(coordinate)."""
        return math.exp(theta) if self.log else 1.0


def known_values(model: Model, run: Recording) -> dict[str, np.ndarray]:
    """Values of all possible unknowns, from run and model."""
    fixed = signal_values((*model.p, *model.u), run.p, "parameter or input", fill=np.nan)
    start = signal_values(model.x, run.x0, "state", fill=np.nan)
    found = by_name((*model.p, *model.u), fixed) | by_name(model.x, start)
    given = run.schedules or {}
    return {s.name: np.asarray(given.get(s.name, s.values), float) for s in model.schedules} | found


def coordinates_of(
    model: Model, runs: Sequence[Recording], unknowns: Sequence[Unknown]
) -> tuple[Coordinate, ...]:
    """Expand unknowns in order, entry by entry, each for all runs or run by run."""
    known = [first_guess(run.model or model, run) for run in runs]
    found = [
        _coordinate(unknown, index, run, model, runs, known)
        for unknown, run in product(unknowns, (None, *range(len(runs))))
        if (run is None) != unknown.per_run
        for index in range(len(unknown.directions(model)))
    ]
    labels = [c.name for c in found]
    for label in labels:
        if labels.count(label) > 1:
            raise ArgumentError(f"two unknowns are called {label}; give them other names")
    return tuple(found)


def first_guess(model: Model, run: Recording) -> dict[str, np.ndarray]:
    """Known values; starts of measured states are taken from their readings."""
    known = known_values(model, run)
    for state in model.x:
        if state.name in run.readings and state.name not in (run.x0 or {}):
            rows = run.readings[state.name]
            for k, row in enumerate(rows):
                there = row[np.isfinite(row)]
                known[state.name][k] = there[0] if there.size else known[state.name][k]
    return known


def _coordinate(
    unknown: Unknown,
    index: int,
    run: int | None,
    model: Model,
    runs: Sequence[Recording],
    known: Sequence[dict[str, np.ndarray]],
) -> Coordinate:
    name, directions = unknown.directions(model)[index]
    name = name if run is None else f"{name}, {runs[run].name}"
    if unknown.start is None:
        begins = along(directions, known[run or 0])
    else:
        begins = _pick(unknown.start, index, name)
    lower, upper = _natural(model, directions)
    lower = lower if unknown.lower is None else max(lower, _pick(unknown.lower, index, name))
    upper = upper if unknown.upper is None else min(upper, _pick(unknown.upper, index, name))
    if not math.isfinite(begins):
        raise ArgumentError(f"{name} has no value to start from; write start = ...")
    usual = _nominal(model, directions)
    moves = any(state.name in directions for state in model.x)
    nominal = max(abs(begins), usual) if moves else abs(begins) or usual
    prior = None
    if unknown.prior is not None:
        mean, deviation = (_pick(part, index, name) for part in unknown.prior)
        prior = (mean, deviation)
    if unknown.log:
        if not begins > 0:
            raise ArgumentError(f"{name} starts from {begins:g}, which has no logarithm")
        lower, upper = (math.log(b) if b > 0 else -math.inf for b in (lower, upper))
        begins, nominal = math.log(begins), 1.0
        lower, upper = max(lower, begins - _REACH), min(upper, begins + _REACH)
    begins = min(max(begins, lower), upper)
    return Coordinate(name, run, directions, lower, upper, begins, nominal, prior, unknown.log)


def _pick(given: object, index: int, name: str) -> float:
    values = np.ravel(np.asarray(given, dtype=float))
    if values.size > 1 and index >= values.size:
        raise ArgumentError(f"{name} is entry {index}, and only {values.size} numbers are given")
    return float(values[index if values.size > 1 else 0])


def along(directions: Mapping[str, np.ndarray], known: Mapping[str, np.ndarray]) -> float:
    """Number nearest to the known values of its targets."""
    up = sum(float(np.sum(d * known[s], where=d != 0)) for s, d in directions.items())
    return up / sum(float(np.sum(d * d)) for d in directions.values())


def _natural(model: Model, directions: dict[str, np.ndarray]) -> tuple[float, float]:
    """Bounds from the model."""
    lower, upper = -math.inf, math.inf
    for signal in (*model.x, *model.p, *model.u):
        for d in np.ravel(directions.get(signal.name, ())):
            if d:
                ends = sorted((signal.lower / d, signal.upper / d))
                lower, upper = max(lower, ends[0]), min(upper, ends[1])
    return lower, upper


def _nominal(model: Model, directions: dict[str, np.ndarray]) -> float:
    """Nominal size, from those of its signals."""
    sizes = {s.name: s.nominal for s in (*model.x, *model.p, *model.u)}
    reach = {s: float(np.abs(d).max()) for s, d in directions.items()}
    return min(sizes.get(s, 1.0) / most for s, most in reach.items())
