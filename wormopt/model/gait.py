"""Gait: the link lengths of one period, piece by piece, with exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers
from wormopt.quantities import unit_of
from wormopt.shown import Part, html

_ARRAYS = ("breaks", "polynomial", "omega", "cosine", "sine")
# Columns of a table, by the number of derivatives.
_COLUMNS = ("length", "rate", "acceleration")
# Fewest rows of a table for a periodic cubic spline.
_FEWEST_ROWS = 4
# Times within this distance of a break, in periods, are at the break; shorter steps are none.
_AT_BREAK, _NO_STEP = 1e-13, Fraction(1, 10**6)


@dataclass(frozen=True, eq=False)
class Gait:
    """Periodic link lengths l_0..l_(n-1), on each piece a polynomial plus one harmonic.

    On piece q, with s the time since it began,
    l_j(s) = sum_k polynomial[q, j, k] s^k
             + cosine[q, j] cos(omega[q] s) + sine[q, j] sin(omega[q] s).

    Parameters
    ----------
    breaks : array_like, shape (pieces + 1,)
        Times at which pieces begin, from 0 to the period, ascending.
    polynomial : array_like, shape (pieces, n, degree + 1)
        Coefficients by ascending power of s.
    omega : array_like, shape (pieces,), optional
        Angular frequency of the harmonic.
    cosine, sine : array_like, shape (pieces, n), optional
        Its amplitudes.
    warnings : tuple of str, optional
        Warnings about the file that the gait was read from.

    Raises
    ------
    ArgumentError
        If shapes disagree, the breaks do not ascend from 0, or something is no finite number.

    Examples
    --------
    >>> gait = Gait([0, 1, 2], [[[1, 0.5]], [[1.5, -0.5]]])
    >>> gait([0.5, 1.5, 2.5])
    array([[1.25, 1.25, 1.25]])
    """

    breaks: np.ndarray
    polynomial: np.ndarray
    omega: np.ndarray | None = None
    cosine: np.ndarray | None = None
    sine: np.ndarray | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if self.polynomial.ndim != 3:
            raise ArgumentError("polynomial must have the shape (pieces, n, degree + 1)")
        breaks, (pieces, links, _) = self.breaks, self.polynomial.shape
        if breaks.shape != (pieces + 1,) or breaks[0] != 0 or np.any(np.diff(breaks) <= 0):
            raise ArgumentError("breaks must ascend from 0, one more than there are pieces")
        harmonic = (self.omega, self.cosine, self.sine)
        if any(h is None for h in harmonic) and any(h is not None for h in harmonic):
            raise ArgumentError("omega, cosine and sine go together")
        shapes = [h.shape for h in harmonic if h is not None]
        if shapes and shapes != [(pieces,), (pieces, links), (pieces, links)]:
            raise ArgumentError("omega must have the shape (pieces,), cosine and sine (pieces, n)")

    def __repr__(self) -> str:
        return f"Gait: period {self.period:.6g}, links {self.links}, pieces {self.pieces}"

    def _repr_html_(self) -> str:
        length = self(np.linspace(0.0, self.period, 257))
        rows = [("link", "shortest", "longest")]
        rows += [(str(j), f"{row.min():.6g}", f"{row.max():.6g}") for j, row in enumerate(length)]
        return html(repr(self), [Part("Lengths, at 257 instants", rows)])

    @property
    def period(self) -> float:
        """Period T."""
        return float(self.breaks[-1])

    @property
    def links(self) -> int:
        """Number of links n."""
        return self.polynomial.shape[1]

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return self.polynomial.shape[0]

    @property
    def degree(self) -> int | None:
        """Degree of all pieces, None where there are harmonics."""
        return self.polynomial.shape[2] - 1 if self.omega is None else None

    def on_piece(self, piece: int, s: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Evaluate the formula of one piece; it may be continued beyond the piece.

        Parameters
        ----------
        piece : int
            Index of the piece.
        s : ndarray, shape (m,)
            Times since the piece began.
        derivative : int, optional
            Order of the time derivative.

        Returns
        -------
        ndarray, shape (n, m)
            Lengths, rates, accelerations, ...
        """
        s = np.asarray(s, dtype=float)
        coefficients = self.polynomial[piece]
        for _ in range(derivative):
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
        values = np.zeros((self.links, len(s)))
        for column in coefficients.T[::-1]:
            values = values * s + column[:, None]
        if self.omega is None or self.cosine is None or self.sine is None:
            return values
        angle, factor = self.omega[piece] * s, self.omega[piece] ** derivative
        turn = derivative * np.pi / 2  # each derivative turns the phase by a quarter
        cosine, sine = self.cosine[piece][:, None], self.sine[piece][:, None]
        # exact quarter turns avoid the 6e-17 of cos(pi/2)
        c, n = np.round(np.cos(turn)), np.round(np.sin(turn))
        cos_d = c * np.cos(angle) - n * np.sin(angle)
        sin_d = c * np.sin(angle) + n * np.cos(angle)
        return values + factor * (cosine * cos_d + sine * sin_d)

    def __call__(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Evaluate at times (m,), periodically; at a break the later piece applies.

        Returns lengths, rates, accelerations, ... (n, m), by the order of the time derivative.
        """
        t = np.mod(np.atleast_1d(np.asarray(t, dtype=float)), self.period)
        which = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, self.pieces - 1)
        values = np.empty((self.links, len(t)))
        for piece in np.unique(which):
            here = which == piece
            values[:, here] = self.on_piece(piece, t[here] - self.breaks[piece], derivative)
        return values

    def with_period(self, period: float) -> Gait:
        """Return the same shape run through in another period.

        Parameters
        ----------
        period : float
            New period, positive.

        Returns
        -------
        Gait
            Rates change by the factor old period / new period, accelerations by its square.
        """
        factor = period / self.period
        powers = factor ** -np.arange(self.polynomial.shape[2], dtype=float)
        omega = None if self.omega is None else self.omega / factor
        breaks = self.breaks * factor
        breaks[-1] = period
        arrays = (self.polynomial * powers, omega, self.cosine, self.sine)
        return Gait(breaks, *arrays, warnings=self.warnings)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays that define the gait, by their parameter names."""
        return {k: getattr(self, k) for k in _ARRAYS if getattr(self, k) is not None}

    def to_csv(
        self,
        path: str | Path,
        samples: int = 1001,
        *,
        step: float | None = None,
        derivatives: int = 0,
        units: Literal["dimensionless", "SI"] = "dimensionless",
    ) -> None:
        """Write a table over one closed period: time, length_0, length_1, ...

        Every number is the shortest that reads back as the same, and a row at a multiple of 0.01
        reads 0.07. At a break the later piece counts; the last row repeats the first.

        Parameters
        ----------
        path : path
            Where to write.
        samples : int, optional
            Rows, equidistant in time; at least 4.
        step : float, optional
            Time from row to row, instead of `samples`; the last row is at the period, after a
            shorter step if the period is no multiple.
        derivatives : {0, 1, 2}, optional
            Lengths only, rates too (rate_0, ...), or accelerations as well.
        units : {"dimensionless", "SI"}, optional
            Names of the units in the header, "length_0 [m]"; nothing is converted.

        Raises
        ------
        ArgumentError
            If there would be fewer than 4 rows, or `derivatives` is none of the three.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> gait = Gait(np.array([0.0, 0.5, 1.0]), np.array([[[1.0, 0.5]], [[1.25, -0.5]]]))
        >>> with TemporaryDirectory() as folder:
        ...     gait.to_csv(Path(folder) / "gait.csv", step=0.3, derivatives=1, units="SI")
        ...     print((Path(folder) / "gait.csv").read_text())
        time [s],length_0 [m],rate_0 [m s-1]
        0.0,1.0,0.5
        0.3,1.15,0.5
        0.6,1.2,-0.5
        0.9,1.05,-0.5
        1.0,1.0,0.5
        <BLANKLINE>
        """
        if derivatives not in range(len(_COLUMNS)):
            raise ArgumentError(f"derivatives must be 0, 1 or 2, not {derivatives!r}")
        t = _instants(self.period, samples, step)
        # a time rounded otherwise than its break would give the piece before
        nearest = self.breaks[np.abs(t[:, None] - self.breaks).argmin(axis=1)]
        at = np.where(np.abs(t - nearest) <= _AT_BREAK * self.period, nearest, t)
        columns = np.vstack([t, *(self(at, k) for k in range(derivatives + 1))])
        rows = [",".join(repr(float(value)) for value in row) for row in columns.T]
        text = "\n".join([",".join(self._header(derivatives, units)), *rows, ""])
        Path(path).write_text(text, encoding="utf-8", newline="\n")

    def _header(self, derivatives: int, units: Literal["dimensionless", "SI"]) -> Iterator[str]:
        kinds = ("length", "speed", "acceleration")
        unit = [unit_of(quantity, units) for quantity in ("time", *kinds)]
        suffixes = ["" if u == "1" else f" [{u}]" for u in unit]
        yield f"time{suffixes[0]}"
        for name, its in zip(_COLUMNS[: derivatives + 1], suffixes[1:], strict=False):
            yield from (f"{name}_{j}{its}" for j in range(self.links))

    @classmethod
    def from_csv(cls, path: str | Path, *, units: Literal["dimensionless", "SI"] = "SI") -> Gait:
        """Read a table t, l_0, l_1, ... over one closed period.

        Lengths between the rows are those of a periodic cubic spline or, where it would leave the
        lengths of the table, of a shape-preserving one (PCHIP). An instant with two rows is a
        break, where rates may jump.

        Parameters
        ----------
        path : path
            Text file with a line of names; see `wormopt.tables` for what it may look like. Names
            are free, but columns that begin with `rate` or `acceleration` are skipped. In tables
            that `to_csv` or an export of a result made, the gait's columns are read.
        units : {"dimensionless", "SI"}, optional
            Units in the names, ``t [ms]``, are converted to s and m, or refused.

        Returns
        -------
        Gait
            Twice continuously differentiable but for breaks and steep tables; its `warnings` name
            gaps, steep rows, and where the spline adds more than 1 % to the lengths of the table.

        Raises
        ------
        ArgumentError
            If the file holds no such table: the message names line and column.
        OSError
            If the file cannot be read.
        """
        from wormopt.model.gait_table import read_gait  # which loads SciPy

        breaks, polynomial, warnings = read_gait(Path(path), units)
        return cls(breaks, polynomial, warnings=warnings)


def _instants(period: float, samples: int, step: float | None) -> np.ndarray:
    """Times of a table from 0 to the period: rational multiples, each rounded once."""
    if step is not None and not (step > 0 and math.isfinite(step)):
        raise ArgumentError(f"step must be a positive number, not {step!r}")
    whole = Fraction(repr(float(period)))
    if step is None and samples < _FEWEST_ROWS:
        raise ArgumentError(f"a gait table needs at least {_FEWEST_ROWS} samples, not {samples}")
    part = whole / (samples - 1) if step is None else Fraction(repr(float(step)))
    steps = math.ceil(whole / part - _NO_STEP)
    if steps < _FEWEST_ROWS - 1:
        raise ArgumentError(f"step = {step!r} is too large; write at most {period / 3:.6g}")
    return np.array([*(float(k * part) for k in range(steps)), period])


def _numbers(name: str, value: Any) -> np.ndarray:
    try:
        found = numbers(name, value)
    except ArgumentError:
        found = np.array(np.nan)
    if not np.all(np.isfinite(found)):
        raise ArgumentError(f"{name} must hold finite numbers, as many in each row")
    return found
