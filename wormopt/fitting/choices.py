"""Chosen inputs of an experiment, constant or over time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.linalg import block_diag

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.model.schedule import ParameterPath, Schedule
from wormopt.model.values import numbers_of

Values = dict[str, np.ndarray]


class Choice(ABC):
    """Chosen input, as numbers between -1 and 1."""

    signal: str

    @property
    def moving(self) -> int:
        """Number of leading values proportional to the deviation of the input from its base."""
        return 0

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of chosen values."""

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw numbers (size,) at random; changes over time are as large as their limits allow.

        Parameters
        ----------
        rng : Generator
            Generator of random numbers.
        """
        chosen = rng.uniform(-1.0, 1.0, self.size)
        if not self.moving:
            return chosen
        shares = np.append(np.abs(chosen[: self.moving]), self.excess(chosen)[0] + 1)
        return self.shrunk(chosen, 1 / float(shares.max()))

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of the changes over time from the base, (size,); constant parts stay.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values, from -1 to 1.
        share : float
            Remaining share.
        """
        return np.append(share * chosen[: self.moving], chosen[self.moving :])

    @abstractmethod
    def put(self, model: Model) -> Model:
        """Return the model with its signal replaced by the choice.

        Parameters
        ----------
        model : Model
            With the signal among its inputs or parameters.
        """

    @abstractmethod
    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        """Values of the parameters and schedules of the model that `put` returns, by name.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values, from -1 to 1.

        Returns
        -------
        p, schedules : dict of str to ndarray
        """

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Relative excess over each limit, without the limits -1 and 1 of the chosen values.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values, from -1 to 1.

        Returns
        -------
        excess : ndarray, shape (m,)
        derivative : ndarray, shape (m, size)
        """
        return np.zeros(0), np.zeros((0, len(chosen)))

    @abstractmethod
    def over_time(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Evaluate the signal: (entries, m).

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values, from -1 to 1.
        time : ndarray, shape (m,)
            Times.
        """

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        """Chosen constants in their own units, by name; empty for signals over time.

        Parameters
        ----------
        chosen : ndarray, shape (size,)
            Chosen values, from -1 to 1.
        """
        return {}


@dataclass(frozen=True, eq=False)
class Constant(Choice):
    """A constant to choose, such as a load.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    lower, upper : float
        Limits.
    direction : sequence of float
        Factor of the constant for each entry of the signal; 1 by default.

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
            raise ArgumentError(f"{self.signal}: [{self.lower}, {self.upper}] is not a range")

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

    def over_time(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.outer(self._value(chosen) * np.array(self.direction), np.ones(len(time)))

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        return {self.signal: self._value(chosen)}


@dataclass(frozen=True, eq=False)
class Choices:
    """All choices of an experiment, as one vector of their numbers."""

    each: Sequence[Choice]

    @property
    def size(self) -> int:
        """Number of chosen values."""
        return sum(choice.size for choice in self.each)

    def parts(self, chosen: np.ndarray) -> list[tuple[Choice, np.ndarray]]:
        """Every choice with its numbers."""
        ends = np.cumsum([choice.size for choice in self.each])[:-1]
        return list(zip(self.each, np.split(np.asarray(chosen, float), ends), strict=True))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw all of them."""
        return np.concatenate([choice.draw(rng) for choice in self.each])

    def shrunk(self, chosen: np.ndarray, share: float) -> np.ndarray:
        """Take a share of all changes over time from their bases."""
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


def base_of(model: Model, signal: str) -> tuple[float, ...]:
    """Values of an input or parameter of a model; ArgumentError if it has none."""
    known = signal_of(model, signal, None)
    if known.value is None:
        raise ArgumentError(f"{signal} has no value; write one")
    return numbers_of(signal, known.value, known.size)


def signal_of(model: Model, name: str, size: int | None) -> Signal:
    """Find an input or parameter; ArgumentError if there is none of this size."""
    known = {signal.name: signal for signal in (*model.u, *model.p)}
    if name not in known:
        what = ", ".join(known) or "none"
        raise ArgumentError(f"{model.name} has no input or parameter {name!r}; there are {what}")
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
        raise ArgumentError(f"{name} cannot vary in time: {error}") from None


def check_positive(**given: float) -> None:
    """Raise ArgumentError unless all are positive, and finite except for `rate`."""
    for name, value in given.items():
        if not value > 0 or (name != "rate" and math.isinf(value)):
            raise ArgumentError(f"{name} must be positive, not {value!r}")


def check_whole(**given: int) -> None:
    """Raise ArgumentError unless all are whole numbers from 1 on."""
    for name, value in given.items():
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ArgumentError(f"{name} must be a whole number, 1 or above, not {value!r}")


# Samples of a wave per period of its highest harmonic; between samples, it exceeds the largest by
# at most the factor 1/cos(pi / _LOOKS), half a hundredth more.
_LOOKS = 32


@dataclass(frozen=True, eq=False)
class Ramps(Choice):
    """A piecewise linear signal with equidistant knots that starts at the model's value.

    Limits hold exactly at all times.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    base : sequence of float
        Value of each entry at time 0.
    duration : float
        Time of the last knot, whose value is held afterwards.
    pieces : int
        Pieces between knots.
    change : float
        Largest change from the base, in both directions.
    rate : float, optional
        Largest rate of change.

    Raises
    ------
    ArgumentError
        If an argument is not positive, or `pieces` is not an integer.

    Examples
    --------
    Two ramps that lead from 2 to 2.5 and back:

    >>> ramps = Ramps("rest_length", (2.0,), duration=4.0, pieces=2, change=0.5)
    >>> ramps.size
    2
    >>> ramps.over_time(np.array([1.0, 0.0]), np.array([0.0, 1.0, 2.0, 4.0]))
    array([[2.  , 2.25, 2.5 , 2.  ]])
    """

    signal: str
    base: tuple[float, ...]
    duration: float
    pieces: int
    change: float
    rate: float = math.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", tuple(map(float, self.base)))
        check_positive(duration=self.duration, change=self.change, rate=self.rate)
        check_whole(pieces=self.pieces)

    @property
    def size(self) -> int:
        """Knots after the first, for every entry."""
        return len(self.base) * self.pieces

    @property
    def moving(self) -> int:
        """All numbers."""
        return self.size

    def put(self, model: Model) -> Model:
        path = self._path(np.zeros(self.size))
        expression, schedule = path.schedule(self.signal, model.t)
        return replaced(model, self.signal, len(self.base), expression, [schedule])

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        return {}, {self.signal: self._path(chosen).values}

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = self.duration / self.pieces
        if self.rate * step >= 2 * self.change:
            return np.zeros(0), np.zeros((0, self.size))
        once = (np.eye(self.pieces) - np.eye(self.pieces, k=-1)) * self.change / step / self.rate
        steps = np.kron(np.eye(len(self.base)), once)
        rates = steps @ chosen
        return np.concatenate([rates, -rates]) - 1, np.vstack([steps, -steps])

    def over_time(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        knots = np.linspace(0.0, self.duration, self.pieces + 1)
        return np.array([np.interp(time, knots, row) for row in self._knots(chosen)])

    def _knots(self, chosen: np.ndarray) -> np.ndarray:
        base = np.array(self.base)[:, None]
        moved = base + self.change * np.reshape(chosen, (len(self.base), self.pieces))
        return np.hstack([base, moved])

    def _path(self, chosen: np.ndarray) -> ParameterPath:
        knots = self._knots(chosen)
        slopes = np.diff(knots) * self.pieces / self.duration
        # a last constant piece: a path continues as its last piece does
        values = np.stack([knots, np.pad(slopes, ((0, 0), (0, 1)))], axis=2).transpose(1, 0, 2)
        step = self.duration / self.pieces
        return ParameterPath(step * np.arange(self.pieces + 2), values)


@dataclass(frozen=True, eq=False)
class Waves(Choice):
    """A signal of a few harmonics that starts at the model's value.

    Entry j is base_j + sum_k a_jk (cos k w t - 1) + b_jk sin k w t. Limits hold at all times; for
    this they are tightened by 0.5 %.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    base : sequence of float
        Value of each entry at time 0.
    frequency : float or (float, float)
        Frequency of the first harmonic, in turns per time, or a range for it.
    harmonics : int
        Number of harmonics.
    change : float
        Largest change from the base, in both directions.
    rate : float, optional
        Largest rate of change.

    Raises
    ------
    ArgumentError
        If an argument is not positive, a range is empty, or `harmonics` is not an integer.

    Examples
    --------
    One harmonic of 0.5 Hz:

    >>> waves = Waves("rest_length", (2.0,), frequency=0.5, harmonics=1, change=0.5)
    >>> waves.size
    2
    >>> waves.over_time(np.array([0.0, 1.0]), np.array([0.0, 0.5, 1.0]))
    array([[2. , 2.5, 2. ]])
    """

    signal: str
    base: tuple[float, ...]
    frequency: float | tuple[float, float]
    harmonics: int
    change: float
    rate: float = math.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", tuple(map(float, self.base)))
        low, high = self._range
        check_positive(frequency=low, change=self.change, rate=self.rate)
        check_whole(harmonics=self.harmonics)
        if not low <= high < math.inf:
            raise ArgumentError(f"the range of frequencies [{low:g}, {high:g}] is empty")

    @property
    def size(self) -> int:
        """Two for each harmonic of each entry, and one for a chosen frequency."""
        low, high = self._range
        return self.moving + (low < high)

    @property
    def moving(self) -> int:
        """The amplitudes."""
        return 2 * self.harmonics * len(self.base)

    @property
    def _range(self) -> tuple[float, float]:
        low, high = np.broadcast_to(self.frequency, 2).tolist()
        return low, high

    def put(self, model: Model) -> Model:
        entries = len(self.base)
        parts = {name: ca.SX.sym(name, entries * self.harmonics) for name in self._names[:2]}
        cosine, sine = (ca.reshape(part, entries, self.harmonics) for part in parts.values())
        turns, base = ca.SX.sym(self._names[2]), ca.SX.sym(self._names[3], entries)
        angle = 2 * ca.pi * turns * model.t * ca.DM(range(1, self.harmonics + 1))
        # cos a - 1 without cancellation
        value = base + cosine @ (-2 * ca.sin(angle / 2) ** 2) + sine @ ca.sin(angle)
        zero = (0.0,) * (entries * self.harmonics)
        new = [Signal(name, symbol, value=zero) for name, symbol in parts.items()]
        new.append(Signal(self._names[2], turns, value=self._range[0]))
        new.append(Signal(self._names[3], base, value=self.base))
        return replaced(model, self.signal, entries, value, parameters=new)

    @property
    def _names(self) -> tuple[str, str, str, str]:
        parts = ("cosine", "sine", "frequency", "base")
        return tuple(f"{self.signal}_{part}" for part in parts)  # type: ignore[return-value]

    def values(self, chosen: np.ndarray) -> tuple[Values, Values]:
        # columns of entries by harmonic
        cosine, sine = self._amplitudes(chosen)
        numbers = (cosine.ravel("F"), sine.ravel("F"), np.array(self._turns(chosen)[0]))
        return dict(zip(self._names[:3], numbers, strict=True)), {}

    def _amplitudes(self, chosen: np.ndarray) -> np.ndarray:
        """Amplitudes of cosines and sines (2, entries, harmonics)."""
        return self.change * np.reshape(chosen[: self.moving], (2, len(self.base), self.harmonics))

    def _turns(self, chosen: np.ndarray) -> tuple[float, float]:
        """Frequency, and its derivative by the number that chooses it."""
        low, high = self._range
        if low == high:
            return low, 0.0
        turns = low * (high / low) ** ((chosen[-1] + 1) / 2)
        return turns, turns * math.log(high / low) / 2

    def excess(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # A trigonometric polynomial of degree N exceeds its largest of M equidistant values by at
        # most the factor 1/cos(pi N/M): H. Ehlich, K. Zeller, Math. Z. 86 (1964) 41.
        looks, sure = _LOOKS * self.harmonics, math.cos(math.pi / _LOOKS)
        order = np.arange(1, self.harmonics + 1)
        angle = 2 * math.pi * np.arange(looks)[:, None] / looks * order
        change = np.hstack([np.cos(angle) - 1, np.sin(angle)])
        turns, by_chosen = self._turns(chosen)
        slope = np.hstack([-order * np.sin(angle), order * np.cos(angle)]) * 2 * math.pi
        values, rows = [], []
        for j in range(len(self.base)):
            pick = self._pick(j)
            values.append(change @ (pick @ chosen) / sure)
            rows.append(change @ pick / sure)
            if self.rate < math.inf:
                rate = slope * self.change / self.rate / sure
                values.append(turns * (rate @ (pick @ chosen)))
                by = turns * (rate @ pick)
                if self.size % 2:
                    by[:, -1] += by_chosen * (rate @ (pick @ chosen))
                rows.append(by)
        value, row = np.concatenate(values), np.vstack(rows)
        return np.concatenate([value, -value]) - 1, np.vstack([row, -row])

    def _pick(self, entry: int) -> np.ndarray:
        """Rows (2 harmonics, size) that select the cosines and sines of an entry."""
        at = np.arange(self.moving).reshape(2, len(self.base), self.harmonics)[:, entry]
        return np.eye(self.size)[at.ravel()]

    def over_time(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
        cosine, sine = self._amplitudes(chosen)
        order = np.arange(1, self.harmonics + 1)[:, None]
        angle = 2 * math.pi * self._turns(chosen)[0] * order * time
        moved = cosine @ (np.cos(angle) - 1) + sine @ np.sin(angle)
        return np.array(self.base)[:, None] + moved

    def explained(self, chosen: np.ndarray) -> dict[str, float]:
        cosine, sine = self._amplitudes(chosen)
        named = {self._names[2]: float(self._turns(chosen)[0])}
        for name, part in zip(self._names[:2], (cosine, sine), strict=True):
            named |= {
                f"{name}_{j}_{k + 1}": float(part[j, k])
                for j in range(part.shape[0])
                for k in range(part.shape[1])
            }
        return named
