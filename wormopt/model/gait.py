"""Gait: the link lengths of one period, piece by piece, with exact derivatives."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wormopt.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class Gait:
    """Periodic link lengths l_0..l_{n-1}, on each piece a polynomial plus one harmonic.

    On piece q, with s the time since it began,
    l_j(s) = sum_k polynomial[q, j, k] s^k
             + cosine[q, j] cos(omega[q] s) + sine[q, j] sin(omega[q] s).

    Parameters
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Times at which pieces begin, from 0 to the period, ascending.
    polynomial : ndarray, shape (pieces, n, degree + 1)
        Coefficients by ascending power of s.
    omega : ndarray, shape (pieces,), optional
        Angular frequency of the harmonic.
    cosine, sine : ndarray, shape (pieces, n), optional
        Its amplitudes.

    Raises
    ------
    ArgumentError
        If shapes disagree or the breaks do not ascend from 0.

    Examples
    --------
    >>> import numpy as np
    >>> gait = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[1.0, 0.5]], [[1.5, -0.5]]]))
    >>> gait(np.array([0.5, 1.5, 2.5]))
    array([[1.25, 1.25, 1.25]])
    """

    breaks: np.ndarray
    polynomial: np.ndarray
    omega: np.ndarray | None = None
    cosine: np.ndarray | None = None
    sine: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.polynomial.ndim != 3:
            raise ArgumentError("polynomial must have the shape (pieces, n, degree + 1)")
        breaks, (pieces, links, _) = self.breaks, self.polynomial.shape
        ascending = np.all(np.isfinite(breaks)) and np.all(np.diff(breaks) > 0)
        if breaks.shape != (pieces + 1,) or breaks[0] != 0 or not ascending:
            raise ArgumentError("breaks must ascend from 0, one more than there are pieces")
        harmonic = (self.omega, self.cosine, self.sine)
        if any(h is None for h in harmonic) and any(h is not None for h in harmonic):
            raise ArgumentError("omega, cosine and sine go together")
        shapes = [h.shape for h in harmonic if h is not None]
        if shapes and shapes != [(pieces,), (pieces, links), (pieces, links)]:
            raise ArgumentError("omega must have the shape (pieces,), cosine and sine (pieces, n)")

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
        """Evaluate one piece's formula; it may be continued beyond the piece.

        Parameters
        ----------
        piece : int
            Which piece.
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
        # exact quarter turns keep cos(pi/2) from leaving 6e-17 behind
        c, n = np.round(np.cos(turn)), np.round(np.sin(turn))
        cos_d = c * np.cos(angle) - n * np.sin(angle)
        sin_d = c * np.sin(angle) + n * np.cos(angle)
        return values + factor * (cosine * cos_d + sine * sin_d)

    def __call__(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Evaluate at times (m,), periodically; at a break the later piece counts.

        Gives lengths, rates, accelerations, ... (n, m), by the order of the time derivative.
        """
        t = np.mod(np.asarray(t, dtype=float), self.period)
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
        return Gait(breaks, self.polynomial * powers, omega, self.cosine, self.sine)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays that define the gait, by their parameter names."""
        names = ("breaks", "polynomial", "omega", "cosine", "sine")
        return {k: getattr(self, k) for k in names if getattr(self, k) is not None}

    def to_csv(self, path: Path, samples: int = 1001) -> None:
        """Write a table t, l_0..l_{n-1} over one closed period.

        Parameters
        ----------
        path : Path
            Where to write.
        samples : int, optional
            Rows, equidistant in time.
        """
        t = np.linspace(0.0, self.period, samples)
        with Path(path).open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(["t", *(f"l_{j}" for j in range(self.links))])
            writer.writerows([repr(float(v)) for v in row] for row in np.vstack([t, self(t)]).T)

    @classmethod
    def from_csv(cls, path: Path) -> Gait:
        """Read a table t, l_0..l_{n-1} over one closed period; a periodic cubic spline joins rows.

        Parameters
        ----------
        path : Path
            File with one header line.

        Returns
        -------
        Gait
            Twice continuously differentiable.

        Raises
        ------
        ArgumentError
            If the table is not text in UTF-8, has no header, is not numeric, has fewer than 4
            rows or rows of different lengths, its times do not ascend from 0, a length is not
            positive, or the last row does not repeat the first.
        """
        try:
            with Path(path).open(newline="", encoding="utf-8-sig") as stream:
                rows = [row for row in csv.reader(stream) if row]
        except (UnicodeDecodeError, csv.Error) as error:
            raise ArgumentError(f"a gait table must be CSV text in UTF-8 ({error})") from None
        needs = "a gait table needs a header t,l_0,l_1,... and at least 4 rows"
        if len(rows) < 5 or len(rows[0]) < 2 or _is_number(rows[0][0]):
            raise ArgumentError(needs)
        for number, row in enumerate(rows[1:], start=1):
            if len(row) != len(rows[0]):
                raise ArgumentError(
                    f"row {number} has {len(row)} entries, the header {len(rows[0])}"
                )
        try:
            table = np.array([[float(v) for v in row] for row in rows[1:]])
        except ValueError as error:
            raise ArgumentError(f"every row after the header must hold numbers ({error})") from None
        t, lengths = table[:, 0], table[:, 1:]
        if not np.all(np.isfinite(table)) or t[0] != 0 or np.any(np.diff(t) <= 0):
            raise ArgumentError("times must be finite and ascend from 0")
        if np.any(lengths <= 0):
            raise ArgumentError("link lengths must be positive")
        if np.abs(lengths[-1] - lengths[0]).max() > 1e-9 * np.abs(lengths).max():
            raise ArgumentError("the last row must repeat the first: one closed period")
        lengths[-1] = lengths[0]
        from scipy.interpolate import CubicSpline  # loads for half a second, for tables only

        spline = CubicSpline(t, lengths, bc_type="periodic")
        return cls(t.copy(), np.transpose(spline.c[::-1], (1, 2, 0)))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
