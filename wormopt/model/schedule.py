"""Schedule: symbols of a Model that are constant on pieces of time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.given import check_flag, check_kind, check_name, check_number, make_plain
from wormopt.model.values import numbers


@dataclass(frozen=True, eq=False)
class Schedule:
    """Symbols that are constant on pieces of time: coefficients of a reference, a random stiffness.

    On piece k, from ``start + breaks[k]`` until the next break, ``symbol`` is ``values[k]`` and
    ``begin`` the time at which the piece began. Solvers stop at every break, so that formulas of
    t - begin and symbol may differ from piece to piece without any branch in them.

    Parameters
    ----------
    name : str
        What is scheduled, for instance ``"reference"``.
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
        since = t - self.start + 4 * np.finfo(float).eps * np.maximum(np.abs(t), self.breaks[-1])
        turn = np.floor(since / self.breaks[-1]) * self.breaks[-1] if self.periodic else 0.0
        piece = np.searchsorted(self.breaks, since - turn, side="right") - 1
        piece = np.clip(piece, 0, self.pieces - 1)
        return self.start + turn + self.breaks[piece], piece

    def next_break(self, t: float) -> float:
        """End of the piece at time t; infinity for the last piece without an end.

        Parameters
        ----------
        t : float
            Time.

        Returns
        -------
        float
        """
        begin, piece = self.locate(np.array([t]))
        if not self.periodic and piece[0] + 1 == self.pieces:
            return math.inf
        return float(begin[0] - self.breaks[piece[0]] + self.breaks[piece[0] + 1])
