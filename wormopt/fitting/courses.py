"""Inputs over time that an experiment may choose, within limits at all times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.fitting.choices import Choice, Values, check_positive, check_whole, replaced
from wormopt.model.model import Model, Signal
from wormopt.model.schedule import ParameterPath

# Samples of a wave per period of its highest harmonic; between samples, it exceeds the largest by
# at most the factor 1/cos(pi / _LOOKS), half a hundredth more.
_LOOKS = 32


@dataclass(frozen=True, eq=False)
class Ramps(Choice):
    """A course that is linear between equidistant knots, and begins at the signal's own value.

    Limits hold exactly at all times.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    base : sequence of float
        Value of each entry at time 0, about which it changes.
    duration : float
        Until the last knot; the value of that is held afterwards.
    pieces : int
        Pieces between knots.
    change : float
        Largest change from the base, either way.
    rate : float, optional
        Largest rate of change.

    Raises
    ------
    ArgumentError
        If a number is not positive, or pieces not whole.

    Examples
    --------
    Two ramps that lead from 2 to 2.5 and back:

    >>> ramps = Ramps("rest_length", (2.0,), duration=4.0, pieces=2, change=0.5)
    >>> ramps.size
    2
    >>> ramps.course(np.array([1.0, 0.0]), np.array([0.0, 1.0, 2.0, 4.0]))
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

    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
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
    """A course of a few harmonics that begins at the signal's own value.

    Entry j is base_j + sum_k a_jk (cos k w t - 1) + b_jk sin k w t. Limits hold at all times,
    half a hundredth of them is given away for it.

    Parameters
    ----------
    signal : str
        Input or parameter of the model.
    base : sequence of float
        Value of each entry at time 0, about which it changes.
    frequency : float or (float, float)
        Of the first harmonic, in turns per time; a range is chosen from.
    harmonics : int
        How many.
    change : float
        Largest change from the base, either way.
    rate : float, optional
        Largest rate of change.

    Raises
    ------
    ArgumentError
        If a number is not positive, a range empty, or harmonics not whole.

    Examples
    --------
    One harmonic of 0.5 Hz:

    >>> waves = Waves("rest_length", (2.0,), frequency=0.5, harmonics=1, change=0.5)
    >>> waves.size
    2
    >>> waves.course(np.array([0.0, 1.0]), np.array([0.0, 0.5, 1.0]))
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

    def course(self, chosen: np.ndarray, time: np.ndarray) -> np.ndarray:
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
