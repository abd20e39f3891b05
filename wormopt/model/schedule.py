"""Symbols of a Model that time determines: constant on pieces, varying at random, or delayed.

A Model with delays is simulated as one with schedules: its memory contains signals of the past as
Chebyshev series, whose coefficients are constant on pieces of time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.given import check_flag, check_kind, check_name, check_number, make_plain
from wormopt.model.values import numbers

# A break this near, as a share of the times, counts as passed.
_ROUNDING = 4 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Schedule:
    """Symbols that are constant on pieces of time: coefficients of a reference, a random stiffness.

    On piece k, from ``start + breaks[k]`` until the next break, ``symbol`` is ``values[k]`` and
    ``begin`` the time at which the piece began. Solvers stop at every break, so that formulas of
    t - begin and symbol may differ from piece to piece without any branch in them.

    Parameters
    ----------
    name : str
        Name of the schedule, for instance ``"reference"``.
    symbol : casadi.SX
        Column of m symbols.
    begin : casadi.SX
        Scalar symbol.
    breaks : ndarray, shape (pieces + 1,)
        Times from 0 on, ascending; the last one is the end of the last piece, which is the
        period where there is one.
    values : ndarray, shape (pieces, m)
        Value of ``symbol`` on each piece.
    periodic : bool, optional
        Whether the pieces repeat, before and after. Otherwise the first and the last piece go on
        for ever.
    start : float, optional
        Time of the first break.

    Raises
    ------
    ArgumentError
        If symbols are no casadi.SX, shapes disagree or the breaks do not ascend from 0.

    Examples
    --------
    >>> import numpy as np
    >>> c, begin = ca.SX.sym("c"), ca.SX.sym("begin")
    >>> Schedule("stiffness", c, begin, np.array([0.0, 1.0, 2.0]), np.array([[9.0], [11.0]])).pieces
    2
    """

    name: str
    symbol: ca.SX
    begin: ca.SX
    breaks: np.ndarray
    values: np.ndarray
    periodic: bool = False
    start: float = 0.0

    def __post_init__(self) -> None:
        check_name("schedule", self.name)
        whose = f"schedule {self.name}"
        for what in ("symbol", "begin"):
            given = getattr(self, what)
            check_kind(f"{whose}: {what}", given, ca.SX)
            size = 1 if what == "begin" else given.numel()
            if not given.is_valid_input() or given.shape != (size, 1):
                wanted = "a scalar symbol" if what == "begin" else "a column of symbols"
                raise ArgumentError(f"{whose}: {what} must be {wanted}, not {given!s:.60}")
        make_plain(self, "periodic", "start")
        check_flag(f"{whose}: periodic", self.periodic)
        check_number(f"{whose}: start", self.start)
        for what in ("breaks", "values"):
            object.__setattr__(self, what, numbers(f"{whose}: {what}", getattr(self, what)))
        ascending = np.all(np.isfinite(self.breaks)) and np.all(np.diff(self.breaks) > 0)
        if self.breaks.ndim != 1 or self.breaks.size < 2 or self.breaks[0] != 0 or not ascending:
            raise ArgumentError(f"{whose}: breaks must ascend from 0")
        shape = (len(self.breaks) - 1, self.symbol.numel())
        if self.values.shape != shape:
            raise ArgumentError(f"{whose}: values have {self.values.shape}, not {shape}")

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.breaks) - 1

    def locate(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the pieces at given times; a break within round-off counts as passed.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times.

        Returns
        -------
        begin : ndarray, shape (m,)
            When the piece began.
        piece : ndarray of int, shape (m,)
            Its number.
        """
        t = np.asarray(t, dtype=float)
        size = np.maximum(np.abs(t), max(abs(self.start), self.breaks[-1]))
        since = t - self.start + _ROUNDING * size
        turn = np.floor(since / self.breaks[-1]) * self.breaks[-1] if self.periodic else 0.0
        piece = self.breaks.searchsorted(since - turn, side="right") - 1
        piece = np.minimum(np.maximum(piece, 0), self.pieces - 1)
        return self.start + turn + self.breaks[piece], piece

    def next_break(self, t: float) -> float:
        """End of the piece at time t; infinity for the last piece without an end.

        Parameters
        ----------
        t : float
            Time.
        """
        (begin,), (piece,) = self.locate(np.array([t]))
        return self.end(begin, piece)

    def end(self, begin: float, piece: int) -> float:
        """End of a piece; infinity for the last one without an end.

        Parameters
        ----------
        begin : float
            When it began, as `locate` gives it.
        piece : int
            Its number.
        """
        if not self.periodic and piece + 1 == self.pieces:
            return math.inf
        return float(begin - self.breaks[piece] + self.breaks[piece + 1])

    def breaks_between(self, begin: float, end: float) -> np.ndarray:
        """Ends of pieces after one time and before another, as `next_break` gives them.

        Parameters
        ----------
        begin, end : float
            Times.

        Returns
        -------
        ndarray, shape (m,)
            Ascending.
        """
        first, period = self.next_break(begin), self.breaks[-1]
        if not first < end:
            return np.zeros(0)
        turns = np.zeros(1)
        if self.periodic:
            last = math.floor((end - self.start) / period)
            turns = np.arange(math.floor((begin - self.start) / period) - 1, last + 2) * period
        starts = self.start + turns[:, None] + self.breaks[:-1]
        ends = (starts - self.breaks[:-1] + self.breaks[1:]).ravel()
        ends = ends if self.periodic else ends[:-1]
        return ends[(first <= ends) & (ends < end)]


@dataclass(frozen=True, eq=False)
class ParameterPath:
    """A column of parameters as polynomials in the time since each piece began.

    The first and last piece go on for ever. Raises ArgumentError if shapes disagree or
    breaks do not ascend from 0.
    """

    breaks: np.ndarray  # (pieces + 1,) from 0, ascending, with the last end
    coefficients: np.ndarray  # (pieces, n, degree + 1) by ascending power

    def __post_init__(self) -> None:
        if self.coefficients.ndim != 3 or self.breaks.shape != (len(self.coefficients) + 1,):
            raise ArgumentError("coefficients must have the shape (pieces, n, degree + 1)")
        ascending = np.all(np.isfinite(self.breaks)) and np.all(np.diff(self.breaks) > 0)
        if self.breaks[0] != 0 or not ascending:
            raise ArgumentError("breaks must ascend from 0, one more than there are pieces")

    @property
    def size(self) -> int:
        """Number of parameters n."""
        return self.coefficients.shape[1]

    @property
    def values(self) -> np.ndarray:
        """Coefficients as the `Schedule` wants them, shape (pieces, n (degree + 1))."""
        # Paths drawn alike share one compiled model: only these numbers differ.
        return self.coefficients.transpose(0, 2, 1).reshape(len(self.coefficients), -1)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Evaluate at times (m,), giving (n, m); at a break the later piece applies."""
        t = np.asarray(t, dtype=float)
        last = len(self.coefficients) - 1
        piece = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, last)
        s, values = t - self.breaks[piece], np.zeros((self.size, len(t)))
        for column in self.coefficients[piece].T[::-1]:
            values = values * s + column
        return values

    def schedule(self, name: str, time: ca.SX) -> tuple[ca.SX, Schedule]:
        """Convert the path for use in a Model.

        Returns the parameters (n, 1) and the Schedule of their symbols. `name`: the scheduled
        quantity, such as "stiffness"; `time`: the model's symbol of time.
        """
        symbol, begin = ca.SX.sym(name, self.values.shape[1]), ca.SX.sym(f"{name}_begin")
        powers = ca.vertsplit(symbol, self.size)
        expression = powers[-1]
        for power in powers[-2::-1]:
            expression = expression * (time - begin) + power
        return expression, Schedule(name, symbol, begin, self.breaks, self.values)


def piecewise_constant(
    rng: np.random.Generator,
    mean: ArrayLike,
    spread: ArrayLike,
    interval: float,
    horizon: float,
) -> ParameterPath:
    """Draw parameters that take new, independent values after every interval.

    Uniform on mean ± spread, (n,), 0 <= spread < mean, so positive; the last stays after `horizon`.
    """
    mean, spread = _columns(mean, spread)
    if not np.all((spread >= 0) & (spread < mean) & np.isfinite(mean)):
        raise ArgumentError("a random parameter needs 0 <= spread < mean, to stay positive")
    breaks = _grid(interval, horizon, "interval")
    values = rng.uniform(mean - spread, mean + spread, (len(breaks) - 1, len(mean)))
    return ParameterPath(breaks, values[:, :, None])


def ornstein_uhlenbeck(
    rng: np.random.Generator,
    mean: ArrayLike,
    deviation: ArrayLike,
    correlation_time: float,
    step: float,
    horizon: float,
) -> ParameterPath:
    """Draw mean exp(s z - s²/2), s² = log(1 + (deviation/mean)²), z a unit-variance OU process.

    Covariance over a time h is mean² (exp(s² exp(-h/correlation_time)) - 1), exact on the
    grid (Gillespie, Phys. Rev. E 54, 2084, 1996); linear between, constant after `horizon`.
    """
    mean, deviation = _columns(mean, deviation)
    if not np.all((mean > 0) & (deviation >= 0) & np.isfinite(mean + deviation)):
        raise ArgumentError("a random parameter needs mean > 0 and deviation >= 0")
    if not 0 < correlation_time < math.inf:
        raise ArgumentError("correlation_time must be positive and finite")
    breaks = _grid(step, horizon, "step")
    breaks = np.append(breaks, breaks[-1] + step)
    kept = math.exp(-step / correlation_time)
    fresh = math.sqrt(-math.expm1(-2 * step / correlation_time))
    z = rng.standard_normal((len(breaks) - 1, len(mean)))
    for k in range(1, len(z)):
        z[k] = kept * z[k - 1] + fresh * z[k]
    s = np.sqrt(np.log1p((deviation / mean) ** 2))
    values = mean * np.exp(s * z - s**2 / 2)
    slopes = np.diff(values, axis=0, append=values[-1:]) / np.diff(breaks)[:, None]
    return ParameterPath(breaks, np.stack([values, slopes], axis=2))


def _columns(mean: ArrayLike, spread: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    mean, spread = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(a, float)) for a in (mean, spread))
    )
    return mean, spread


def _grid(step: float, horizon: float, name: str) -> np.ndarray:
    """Multiples of ``step`` up to the first that reaches the horizon."""
    if not (0 < step < math.inf and 0 < horizon < math.inf):
        raise ArgumentError(f"{name} and horizon must be positive and finite")
    # rounding must not add a step to a horizon of whole steps
    return step * np.arange(math.ceil(horizon / step * (1 - 1e-12)) + 1)


@dataclass(frozen=True, eq=False)
class Delay:
    """Signal some time ago: ``symbol(t) = signal(t - lag)``.

    Parameters
    ----------
    name : str
        Name of the delayed signal, for instance ``"past_error"``.
    symbol : casadi.SX
        Column of m symbols for the past in the model's equations.
    signal : casadi.SX
        Column of m expressions of time, states, parameters and schedules, without contact forces
        and without other delays.
    lag : float or casadi.SX
        Lag, positive: a number, or an expression of the model's parameters.
    before : casadi.SX, optional
        Values of the signal before the start: a column of m expressions of time and parameters.
        By default the value at the start.

    Raises
    ------
    ArgumentError
        If sizes disagree, an expression is no casadi.SX, or the lag is not positive and finite.

    Examples
    --------
    >>> x, past = ca.SX.sym("x"), ca.SX.sym("past")
    >>> Delay("past", past, x, lag=0.1).symbol
    SX(past)
    """

    name: str
    symbol: ca.SX
    signal: ca.SX
    lag: float | ca.SX
    before: ca.SX | None = None

    def __post_init__(self) -> None:
        check_kind("name of a delay", self.name, str)
        for name in ("symbol", "signal", "before"):
            value = getattr(self, name)
            if name != "before" or value is not None:
                check_kind(f"delay {self.name}: {name}", value, ca.SX)
        columns = [self.signal] if self.before is None else [self.signal, self.before]
        shape = (self.symbol.numel(), 1)
        if not self.symbol.is_valid_input() or any(c.shape != shape for c in columns):
            raise ArgumentError(f"delay {self.name}: signal and symbol must be columns of one size")
        if not isinstance(self.lag, ca.SX):
            check_number(f"delay {self.name}: lag", self.lag, above=0.0)


DEGREE = 11
"""Of the polynomials; their local error is far below that of steps of order 8."""
_NODES = chebyshev.chebpts1(DEGREE + 1)
_FIT = np.linalg.inv(chebyshev.chebvander(_NODES, DEGREE)).T
# Points between the nodes at which a fit is checked.
_TRIED = np.array([-0.998, -0.93, -0.7, -0.37, 0.06, 0.43, 0.76, 0.95, 0.999])
_TRIAL = chebyshev.chebvander(_TRIED, DEGREE).T
_PLACES = (np.append(_NODES, _TRIED) + 1) / 2
# For a single step.
_HALVINGS = 4
# Jumps of a derivative that have passed this often through the equations are beyond the order of
# the steps: every pass smooths them at least once.
GENERATIONS = 8

Course = Callable[[np.ndarray], np.ndarray]
"""Values (m, k) of a signal at times (k,)."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A signal on a piece of time."""

    begin: float
    end: float
    values: np.ndarray  # (1 + m (DEGREE + 1),) as `Memory.symbol`
    # how often the jump of a derivative at `begin` has passed through the equations
    generation: int


@dataclass(frozen=True, eq=False)
class Memory:
    """The past of one Delay as a schedule."""

    delay: Delay

    @cached_property
    def symbol(self) -> ca.SX:
        """Length of the piece, then the coefficients of the first row, of the second, ..."""
        m = self.delay.symbol.numel()
        return ca.SX.sym(self.delay.name, 1 + m * (DEGREE + 1))  # type: ignore[no-any-return]

    @cached_property
    def begin(self) -> ca.SX:
        """When the piece begins."""
        return ca.SX.sym(f"{self.delay.name}_begin")  # type: ignore[no-any-return]

    def value(self, t: ca.SX) -> ca.SX:
        """The past as an expression of time and `symbol` (Clenshaw's sum)."""
        m = self.delay.symbol.numel()
        s = 2 * (t - self.begin) / self.symbol[0] - 1
        rows = ca.reshape(self.symbol[1:], DEGREE + 1, m).T
        above, sums = ca.SX(m, 1), rows[:, DEGREE]
        for k in range(DEGREE - 1, 0, -1):
            above, sums = sums, rows[:, k] + 2 * s * sums - above
        return rows[:, 0] + s * sums - above

    def schedule(self, pieces: list[Piece], lag: float) -> Schedule:
        """Schedule of these pieces, delayed by `lag`."""
        start = pieces[0].begin
        breaks = np.array([0.0, *(piece.end - start for piece in pieces)])
        values = np.array([piece.values for piece in pieces])
        return Schedule(self.delay.name, self.symbol, self.begin, breaks, values, start=start + lag)


def recalled(expression: ca.SX, memories: Sequence[Memory], t: ca.SX) -> ca.SX:
    """Replace signals of the past by their polynomials."""
    if not memories:
        return expression
    past = ca.vertcat(*(memory.delay.symbol for memory in memories))
    return ca.substitute(expression, past, ca.vertcat(*(memory.value(t) for memory in memories)))


def fitted(
    course: Course,
    begin: float,
    end: float,
    knots: np.ndarray,
    allowed: float,
    generation: int,
    halvings: int = _HALVINGS,
) -> list[Piece]:
    """Pieces of a signal that is smooth, up to rounding, except at `knots`, the ends of steps.

    Their error is at most `allowed`, if halving a step so often suffices. Each step is examined:
    steps are short where the signal is narrow.
    """
    length = end - begin
    inner = knots[(knots > begin + 1e-9 * length) & (knots < end - 1e-9 * length)]
    edges = np.concatenate([[begin], inner, [end]])
    middles = (edges[:-1] + edges[1:]) / 2
    values = course(np.append(begin + _PLACES * length, middles))
    coefficients = values[:, : DEGREE + 1] @ _FIT
    trial = np.hstack([_TRIAL, chebyshev.chebvander(2 * (middles - begin) / length - 1, DEGREE).T])
    error = np.abs(coefficients @ trial - values[:, DEGREE + 1 :]).max(initial=0.0)
    if not error > allowed or (halvings == 0 and not len(inner)):
        return [Piece(begin, end, np.append(length, coefficients.ravel()), generation)]
    middle = (begin + end) / 2
    cut = float(inner[np.argmin(np.abs(inner - middle))]) if len(inner) else middle
    left = halvings - (len(inner) == 0)
    first = fitted(course, begin, cut, inner, allowed, generation, left)
    return first + fitted(course, cut, end, inner, allowed, GENERATIONS, left)
