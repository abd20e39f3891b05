"""Unknowns of a fit: positions in a model, bounds, priors, and their order in one vector."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.fitting.recording import Recording
from wormopt.model.model import Model
from wormopt.model.values import by_name, numbers, signal_values


@dataclass(frozen=True, eq=False)
class Unknown:
    """An unknown parameter, input or start value, or each entry of a signal.

    With targets, it is one value c, and each entry of a target is c times its direction, summed
    over all unknowns with this target; entries of direction 0 keep their values. Without targets,
    its name is that of a parameter, an input, a state (for its start value) or a schedule, or of
    one entry, ``"stiffness[0]"``; each entry is then estimated separately.

    Parameters
    ----------
    name : str
        Name of the unknown.
    targets : str, sequence of str or mapping of str to array_like, optional
        Names of signals and entries that are equal to it, or signal -> direction.
    lower, upper : float or array_like, optional
        Bounds; the model's own if left out.
    start : float or array_like, optional
        Start of the search; by default the value in the recording or the model.
    prior : (float, float) or pair of array_like, optional
        Mean and standard deviation of the prior, of the logarithm with ``log``.
    per_run : bool, optional
        Whether each run has its own value.
    log : bool, optional
        Whether the logarithm is estimated, for positive values known only by order of magnitude.

    Raises
    ------
    ArgumentError
        If bounds exclude each other or the start, a prior is no pair with a positive deviation,
        or a bound, start or target of a logarithm is not positive.

    Examples
    --------
    Both links have one stiffness:

    >>> Unknown("spring", {"stiffness": [1.0, 1.0]}, lower=0.0, start=5.0).name
    'spring'
    """

    name: str
    targets: str | Sequence[str] | Mapping[str, ArrayLike] | None = None
    lower: ArrayLike | None = None
    upper: ArrayLike | None = None
    start: ArrayLike | None = None
    prior: tuple[ArrayLike, ArrayLike] | None = None
    per_run: bool = False
    log: bool = False

    def __post_init__(self) -> None:
        least, most = self._number("lower", -math.inf), self._number("upper", math.inf)
        if not np.all(least < most):
            raise ArgumentError(f"{self.name}: lower must be below upper, not {least} and {most}")
        start = self._number("start", np.nan)
        if np.any(np.isinf(start)) or np.any((start < least) | (start > most)):
            raise ArgumentError(f"{self.name}: start {start} must be within its bounds")
        if self.log and (np.any(start <= 0) or np.any(most <= 0)):
            raise ArgumentError(f"{self.name}: log needs a positive start and upper bound")
        if self.prior is not None:
            self._check_prior()

    def _number(self, what: str, default: float) -> np.ndarray:
        given = getattr(self, what)
        return np.asarray(default if given is None else numbers(f"{self.name}: {what}", given))

    def _check_prior(self) -> None:
        if not isinstance(self.prior, Sequence) or len(self.prior) != 2:
            raise ArgumentError(f"{self.name}: prior must be (mean, deviation), not {self.prior!r}")
        mean, deviation = (numbers(f"{self.name}: prior", part) for part in self.prior)
        if not (np.isfinite(mean).all() and np.all((deviation > 0) & np.isfinite(deviation))):
            raise ArgumentError(f"{self.name}: prior needs a finite mean and a positive deviation")

    def directions(self, model: Model) -> list[tuple[str, dict[str, np.ndarray]]]:
        """Directions of the unknown in the signals of the model.

        Parameters
        ----------
        model : Model
            In which.

        Returns
        -------
        list of (str, dict of str to ndarray)
            Name of each, and its directions: signal -> array of its values' shape.

        Raises
        ------
        ArgumentError
            If a direction does not fit its signal, or is 0.
        UnknownNameError
            If the model has no such signal.
        """
        shapes = shapes_of(model)
        if self.targets is None:
            signal, entry = _entry(self.name, shapes)
            size = math.prod(shapes[signal])
            entries = range(size) if entry is None else (entry,)
            single = size == 1 or entry is not None
            return [
                (self.name if single else f"{signal}[{k}]", {signal: _unit(shapes[signal], k)})
                for k in entries
            ]
        if isinstance(self.targets, Mapping):
            return [(self.name, {s: self._shaped(s, d, shapes) for s, d in self.targets.items()})]
        names = [self.targets] if isinstance(self.targets, str) else list(self.targets)
        found: dict[str, np.ndarray] = {}
        for name in names:
            signal, entry = _entry(name, shapes)
            whole = np.ones(shapes[signal]) if entry is None else _unit(shapes[signal], entry)
            found[signal] = found.get(signal, 0.0) + whole
        return [(self.name, found)]

    def _shaped(
        self, signal: str, given: ArrayLike, shapes: Mapping[str, tuple[int, ...]]
    ) -> np.ndarray:
        signal, _ = _entry(signal, shapes)
        direction = numbers(f"{self.name}: direction of {signal}", given)
        shape = shapes[signal]
        if direction.size != math.prod(shape) or not np.isfinite(direction).all():
            raise ArgumentError(
                f"{self.name}: the direction of {signal} has the shape {direction.shape}, not "
                f"{shape}"
            )
        if not direction.any():
            raise ArgumentError(f"{self.name}: the direction of {signal} is 0")
        return direction.reshape(shape)


def shapes_of(model: Model) -> dict[str, tuple[int, ...]]:
    """Shape of the values of all possible unknowns."""
    signals = {s.name: (s.size,) for s in (*model.x, *model.p, *model.u)}
    return {s.name: s.values.shape for s in model.schedules} | signals


def _entry(name: str, shapes: Mapping[str, tuple[int, ...]]) -> tuple[str, int | None]:
    """Split "friction_forward[0]"."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", name)
    signal, entry = (match[1], int(match[2])) if match and name not in shapes else (name, None)
    if signal not in shapes:
        what = "parameter, input, state or schedule"
        raise UnknownNameError("the model", what, [signal], list(shapes))
    if entry is not None and entry >= math.prod(shapes[signal]):
        raise ArgumentError(f"{signal} has {math.prod(shapes[signal])} entries; there is no {name}")
    return signal, entry


def _unit(shape: tuple[int, ...], entry: int) -> np.ndarray:
    direction = np.zeros(math.prod(shape))
    direction[entry] = 1.0
    return direction.reshape(shape)


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
            raise ArgumentError(f"two unknowns have the name {label}; write different names")
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
        raise ArgumentError(f"{name} is entry {index}, but only {values.size} numbers are given")
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
