"""Unknowns: their positions in a model, bounds and priors."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.model import Model
from wormopt.model.values import numbers


@dataclass(frozen=True, eq=False)
class Unknown:
    """An unknown number, or one for every entry of a signal.

    Where targets are given, it is one number c, and every entry of a target is c times its
    direction, summed over all unknowns that have it as a target; entries of direction 0 keep
    their values. Without targets its name is that of a parameter, an input, a state (then its
    start is meant) or a schedule, or of one entry, ``"stiffness[0]"``; every entry is a number of
    its own then.

    Parameters
    ----------
    name : str
        What it is called.
    targets : str, sequence of str or mapping of str to array_like, optional
        Names of signals and entries that are equal to it, or signal -> direction.
    lower, upper : float or array_like, optional
        Bounds; the model's own if left out.
    start : float or array_like, optional
        Where to begin; the value that the model or the recording brings if left out.
    prior : (float, float) or pair of array_like, optional
        Mean and standard deviation of what is known before, of the logarithm with ``log``.
    per_run : bool, optional
        Whether every run has its own.
    log : bool, optional
        Whether its logarithm is what is sought: for what is positive and known by order of
        magnitude.

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
            raise ArgumentError(f"{self.name}: start {start} must lie within its bounds")
        if self.log and (np.any(start <= 0) or np.any(most <= 0)):
            raise ArgumentError(f"{self.name}: only what is positive has a logarithm")
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
        """Positions of its numbers in the model.

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
        raise ArgumentError(f"{signal} has {math.prod(shapes[signal])} entries, no {name}")
    return signal, entry


def _unit(shape: tuple[int, ...], entry: int) -> np.ndarray:
    direction = np.zeros(math.prod(shape))
    direction[entry] = 1.0
    return direction.reshape(shape)
