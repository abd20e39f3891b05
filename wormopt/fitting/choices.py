"""Chosen inputs of an experiment: the interface of all choices, and constant numbers."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.model.schedule import Schedule
from wormopt.model.values import numbers_of

Values = dict[str, np.ndarray]


class Choice(ABC):
    """Chosen input, as numbers between -1 and 1."""

    signal: str

    @property
    def moving(self) -> int:
        """How many first numbers are proportional to the deviation of the input from its base."""
        return 0

    @property
    @abstractmethod
    def size(self) -> int:
        """How many numbers are chosen."""

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw numbers at random, a course as large as its limits allow.

        Parameters
        ----------
        rng : Generator
            Of random numbers.

        Returns
        -------
        ndarray, shape (size,)
        """
        chosen = rng.uniform(-1.0, 1.0, self.size)
        if not self.moving:
            return chosen
        shares = np.append(np.abs(chosen[: self.moving]), self.excess(chosen)[0] + 1)
        return self.shrunk(chosen, 1 / float(shares.max()))

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of the course's changes from its base; what is held stays.

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
        return np.append(share * chosen[: self.moving], chosen[self.moving :])

    @abstractmethod
    def put(self, model: Model) -> Model:
        """Put the choice for the signal of a model; the model's own value is where it starts.

        Parameters
        ----------
        model : Model
            With the signal among its inputs or parameters.

        Returns
        -------
        Model
        """

    @abstractmethod
    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        """Parameters and schedules by name, of the model that `put` made.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        p, schedules : dict of str to ndarray
        """

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much limits are exceeded, as a share of each; those from -1 to 1 are left out.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        excess : ndarray, shape (m,)
        derivative : ndarray, shape (m, size)
        """
        return np.zeros(0), np.zeros((0, len(chosen)))

    @abstractmethod
    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Evaluate the signal.

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

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        """The chosen numbers in their own units, by name; none where the course says it all.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            What is chosen, from -1 to 1.

        Returns
        -------
        dict of str to float
        """
        return {}


@dataclass(frozen=True, eq=False)
class Constant(Choice):
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

    Examples
    --------
    A rest length that an experiment may choose between 1.5 and 2.5:

    >>> import numpy as np
    >>> choice = Constant("rest_length", 1.5, 2.5)
    >>> choice.size, choice.explained(np.array([-1.0])), choice.explained(np.array([1.0]))
    (1, {'rest_length': 1.5}, {'rest_length': 2.5})
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

    def put(self, model: Model) -> Model:
        signal_of(model, self.signal, len(self.direction))
        return model

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        return {self.signal: self._value(chosen) * np.array(self.direction)}, {}

    def _value(self, chosen: np.ndarray) -> float:
        share = (float(chosen[0]) + 1) / 2
        return self.lower * (1 - share) + self.upper * share

    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.outer(self._value(chosen) * np.array(self.direction), np.ones(len(time)))

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        return {self.signal: self._value(chosen)}


@dataclass(frozen=True, eq=False)
class Choices:
    """All choices of an experiment, as one vector of their numbers."""

    each: Sequence[Choice]

    @property
    def size(self) -> int:
        """How many numbers are chosen."""
        return sum(choice.size for choice in self.each)

    def parts(self, chosen: np.ndarray) -> list[tuple[Choice, np.ndarray]]:
        """Every choice with its numbers."""
        ends = np.cumsum([choice.size for choice in self.each])[:-1]
        return list(zip(self.each, np.split(np.asarray(chosen, float), ends), strict=True))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw all of them."""
        return np.concatenate([choice.draw(rng) for choice in self.each])

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of all courses' changes from their bases."""
        parts = self.parts(chosen)
        return np.concatenate([choice.shrunk(part, share) for choice, part in parts])

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        """Parameters and schedules by name, for the model with all choices."""
        p, schedules = {}, {}
        for choice, part in self.parts(chosen):
            one, other = choice.values(part)
            p, schedules = p | one, schedules | other
        return p, schedules

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Excess over own limits of the inputs (m,), and derivatives (m, size)."""
        values, rows = zip(*(c.excess(part) for c, part in self.parts(chosen)), strict=True)
        return np.concatenate(values), np.asarray(block_diag(*rows))


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


def replaced(
    model: Model,
    name: str,
    size: int,
    expression: ca.SX,
    schedules: Sequence[Schedule] = (),
    parameters: Sequence[Signal] = (),
) -> Model:
    """Replace an input or a parameter by an expression of time; it becomes an output.

    The symbols in the expression have their values from `schedules` and `parameters`.
    """
    signal = signal_of(model, name, size)
    fed = feed(model, [signal], expression)
    shown = Output(name, expression, signal.unit)
    left = [other for other in fed.p if other is not signal]
    try:
        return replace(
            fed,
            p=[*left, *parameters],
            outputs=[*fed.outputs, shown],
            schedules=[*fed.schedules, *schedules],
        )
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
