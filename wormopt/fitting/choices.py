"""What may be chosen in an experiment: what all choices answer, and numbers that are held."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.model.values import numbers_of

Values = dict[str, np.ndarray]


class Choice(Protocol):
    """Something that may be chosen, as numbers between -1 and 1."""

    @property
    def signal(self) -> str:
        """Name of the input or parameter."""
        ...

    @property
    def size(self) -> int:
        """How many numbers are chosen."""
        ...

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw numbers at random, a course as large as its limits allow."""
        ...

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of the course's changes from its base; what is held stays."""
        ...

    def put(self, model: Model) -> Model:
        """Put the choice for the signal of a model; the model's own value is where it starts."""
        ...

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        """Parameters and schedules by name, of the model that `put` made."""
        ...

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much limits are exceeded (m,), as a share of each, and derivatives (m, size)."""
        ...

    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Evaluate the signal, shape (entries, times)."""
        ...

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        """The chosen numbers in their own units, by name."""
        ...


@dataclass(frozen=True, eq=False)
class Constant:
    """A number that is chosen and held: a load, say.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    lower, upper : float
        Limits.
    direction : sequence of float
        What each entry of the signal is of the number; ones make all alike.

    Raises
    ------
    ArgumentError
        If the range is empty.
    """

    signal: str
    lower: float
    upper: float
    direction: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", tuple(map(float, self.direction)))
        if not -math.inf < self.lower < self.upper < math.inf:
            raise ArgumentError(f"{self.signal}: [{self.lower}, {self.upper}] is no range")

    @property
    def size(self) -> int:
        """One number."""
        return 1

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw from the range.

        Parameters
        ----------
        rng : Generator
            Of random numbers.

        Returns
        -------
        ndarray, shape (size,)
        """
        return rng.uniform(-1.0, 1.0, 1)

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Leave it.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.
        share : float
            How much is left.

        Returns
        -------
        ndarray, shape (size,)
        """
        return chosen

    def put(self, model: Model) -> Model:
        """Leave the model as it is.

        Parameters
        ----------
        model : Model
            With the signal among its inputs or parameters.

        Returns
        -------
        Model
        """
        signal_of(model, self.signal, len(self.direction))
        return model

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        """Value of the parameter or input.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        p, schedules : dict of str to ndarray
        """
        return {self.signal: self._value(chosen) * np.array(self.direction)}, {}

    def _value(self, chosen: np.ndarray) -> float:
        share = (float(chosen[0]) + 1) / 2
        return self.lower * (1 - share) + self.upper * share

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nothing but the range itself.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        excess : ndarray, shape (m,)
        derivative : ndarray, shape (m, size)
        """
        return np.zeros(0), np.zeros((0, 1))

    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Give the same at all times.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.
        time : ndarray, shape (m,)
            Times.

        Returns
        -------
        ndarray, shape (entries, m)
        """
        return np.outer(self._value(chosen) * np.array(self.direction), np.ones(len(time)))

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        """Tell the number itself.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        dict of str to float
        """
        return {self.signal: self._value(chosen)}


def base_of(model: Model, signal: str, given: ArrayLike | None = None) -> tuple[float, ...]:
    """Values of an input or parameter, the model's own or given; ArgumentError if it has none."""
    known = signal_of(model, signal, None)
    value = known.value if given is None else given
    if value is None:
        raise ArgumentError(f"{signal} has no value; give one")
    return numbers_of(signal, value, known.size)


def signal_of(model: Model, name: str, size: int | None) -> Signal:
    """Find an input or parameter; ArgumentError if there is none of this size."""
    known = {signal.name: signal for signal in (*model.u, *model.p)}
    if name not in known:
        what = ", ".join(known) or "none"
        raise ArgumentError(f"{model.name} has no input or parameter {name!r}, but {what}")
    if size not in (None, known[name].size):
        raise ArgumentError(f"{name} has {known[name].size} entries, not {size}")
    return known[name]


def replaced(model: Model, name: str, size: int, expression: ca.SX) -> Model:
    """Put an expression of time for an input or a parameter, which becomes an output."""
    signal = signal_of(model, name, size)
    fed = feed(model, [signal], expression)
    shown = Output(name, expression, signal.unit)
    left = [other for other in fed.p if other is not signal]
    try:
        return replace(fed, p=left, outputs=[*fed.outputs, shown])
    except ArgumentError as error:
        raise ArgumentError(f"{name} cannot be a course of time: {error}") from None


def check_positive(**given: float) -> None:
    """Refuse what is not positive, or infinite where it is no rate."""
    for name, value in given.items():
        if not value > 0 or (name != "rate" and math.isinf(value)):
            raise ArgumentError(f"{name} must be positive, not {value!r}")


def check_whole(**given: int) -> None:
    """Refuse what is no whole number from 1 on."""
    for name, value in given.items():
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ArgumentError(f"{name} must be a whole number from 1 on, not {value!r}")
