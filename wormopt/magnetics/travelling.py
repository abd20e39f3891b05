"""Travelling fields: currents of a row over time, and the field in the frame of the wave.

Currents over time are a Gait with one row of ampere-turns per coil. The phase of a travelling wave
is xi = 2 pi (t / period - x / wavelength), as for the wave of a film.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.coils import CoilRow
from wormopt.model.gait import Gait

# Share of a period by which a field is looked at after its instant.
_AFTER = 1e-12


def switched_course(
    count: int, ampere_turns: float, rate: float, *, on: int = 3, every: int | None = None
) -> Gait:
    """Currents of blocks of coils that are switched along a row, one coil at a time.

    Parameters
    ----------
    count : int
        Number of coils.
    ampere_turns : float
        Ampere-turns of each coil that is on; all have the same sign.
    rate : float
        Switching frequency in Hz; the field travels one pitch in 1 / rate.
    on : int, optional
        Number of coils in a block.
    every : int, optional
        Number of coils after which the pattern repeats. Default: one block in the whole row. A
        block that leaves the row enters it again at its begin.

    Returns
    -------
    Gait
        ``every`` pieces with constant currents, and one row per coil.

    Raises
    ------
    ArgumentError
        If a value is not positive, or a block does not fit.

    Examples
    --------
    >>> course = switched_course(6, 3000.0, rate=50.0)
    >>> course.on_piece(0, np.zeros(1)).ravel().tolist()
    [3000.0, 3000.0, 3000.0, 0.0, 0.0, 0.0]
    >>> course(np.array([0.021])).ravel().tolist()
    [0.0, 3000.0, 3000.0, 3000.0, 0.0, 0.0]
    """
    every = count if every is None else every
    if not 0 < on <= every <= count:
        raise ArgumentError(f"{on} coils on of every {every} do not fit into a row of {count}")
    if not 0 < rate < math.inf or not math.isfinite(ampere_turns):
        raise ArgumentError("rate must be above 0, and ampere_turns finite")
    place = np.arange(count)[None, :] - np.arange(every)[:, None]
    values = np.where(place % every < on, float(ampere_turns), 0.0)
    return Gait(np.arange(every + 1) / rate, values[:, :, None])


def shifted_course(
    nodes: ArrayLike, period: float, shift: float, count: int, *, alternating: bool = False
) -> Gait:
    """Currents in which every coil follows its neighbour `shift` seconds later: a polyline in time.

    `nodes` (m,): ampere-turns of coil 0 at equidistant times over one `period`, from 0 on.
    `alternating`: currents change their sign each period; the gait's period doubles, that of H²
    does not.
    """
    values = np.asarray(nodes, dtype=float)
    if values.ndim != 1 or not values.size or not period > 0 or not shift > 0:
        raise ArgumentError("nodes must be a row of values, and period and shift above 0")
    if alternating:
        values, period = np.concatenate([values, -values]), 2 * period
    own = period * np.arange(len(values)) / len(values)
    delays = shift * np.arange(count)
    breaks = np.unique(np.mod(own[None, :] + delays[:, None], period))
    breaks = breaks[np.diff(breaks, prepend=-np.inf) > 1e-9 * period]
    if period - breaks[-1] <= 1e-9 * period:
        breaks = breaks[:-1]
    breaks = np.concatenate([[0.0], breaks[breaks > 1e-9 * period], [period]])
    at = np.vstack([np.interp(breaks - d, own, values, period=period) for d in delays])
    slopes = np.diff(at) / np.diff(breaks)
    return Gait(breaks, np.stack([at[:, :-1].T, slopes.T], axis=2))


@dataclass(frozen=True, eq=False)
class MovingProfile:
    """H² over the phase of a wave, at every place that it passes.

    Parameters
    ----------
    xi : ndarray, shape (n,)
        Equidistant phases in rad, from 0 on, without 2 pi.
    square : ndarray, shape (places, n)
        H² in A²/m² at each place when the phase passes it.
    places : ndarray, shape (places,)
        Positions of the places along x in m.

    Examples
    --------
    A wave 1 + cos(xi) that passes two places unchanged has no ripple:

    >>> xi = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    >>> square = np.stack([1 + np.cos(xi), 1 + np.cos(xi)])
    >>> profile = MovingProfile(xi, square, places=np.array([0.0, 1.0]))
    >>> round(profile.variation, 9), profile.ripple
    (0.707106781, 0.0)
    """

    xi: np.ndarray
    square: np.ndarray
    places: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean H² over the places, shape (n,): the field in the frame of the wave."""
        return self.square.mean(axis=0)

    @property
    def variation(self) -> float:
        """Root mean square of the mean H² minus its own mean."""
        return float(np.std(self.mean))

    @property
    def ripple(self) -> float:
        """Root mean square of the part that does not travel, over `variation`; inf if that is 0."""
        left = float(np.sqrt(np.mean((self.square - self.mean) ** 2)))
        rounding = 1e-13 * float(np.abs(self.square).max())
        return left / self.variation if self.variation > rounding else math.inf

    def residual(self, target: ArrayLike) -> float:
        """Root mean square of the difference from a target, over that of the target's variation.

        Parameters
        ----------
        target : array_like, shape (n,)
            Wanted H² in A²/m² at the phases.

        Returns
        -------
        float
            Residual, dimensionless; a constant field with the right mean has 1.
        """
        wanted = np.asarray(target, dtype=float)
        return float(np.sqrt(np.mean((self.square - wanted) ** 2)) / np.std(wanted))


def moving_profile(
    row: CoilRow,
    course: Gait,
    places: ArrayLike,
    z: float,
    *,
    wavelength: float,
    period: float,
    phases: int = 128,
) -> MovingProfile:
    """Field of a row of coils in the frame of a travelling wave.

    Parameters
    ----------
    row : CoilRow
        The coils.
    course : Gait
        Their ampere-turns over time.
    places : array_like, shape (m,)
        Positions along x in m, far enough from the ends of the row.
    z : float
        Height of the line in m; y is 0.
    wavelength : float
        Wavelength of the wave in m.
    period : float
        Period of the wave in s; it travels forward.
    phases : int, optional
        Number of equidistant phases.

    Returns
    -------
    MovingProfile
        H² over phase and place.

    Raises
    ------
    ArgumentError
        If a coil lies inside the fluid, or a current exceeds its limit.

    Examples
    --------
    >>> from wormopt.magnetics.coils import Coil
    >>> row = CoilRow(Coil(2e-3, 4.5e-3, 20e-3), count=20, pitch=10e-3, gap=11e-3)
    >>> course = switched_course(20, 3000.0, rate=50.0, every=5)
    >>> places = np.linspace(50e-3, 140e-3, 64, endpoint=False)
    >>> profile = moving_profile(row, course, places, 0.0, wavelength=50e-3, period=0.1)
    >>> profile.mean.shape, profile.ripple < 0.5
    ((128,), True)
    """
    x = np.asarray(places, dtype=float).ravel()
    influence = row.influence(x, z)
    xi = 2 * np.pi * np.arange(phases) / phases
    # many of these instants are those of switches, after which the later current counts
    t = period * (xi / (2 * np.pi) + x[:, None] / wavelength + _AFTER)
    currents = row.check_currents(course(t.ravel())).reshape(row.count, len(x), phases)
    field = np.einsum("cmk,kmn->cmn", influence, currents)
    return MovingProfile(xi, np.sum(field**2, axis=0), x)


def harmonic_shares(profile: ArrayLike, count: int = 8) -> np.ndarray:
    """Shares of harmonics 1, 2, ... in the variation of a periodic profile; 0 if constant.

    Squared amplitudes over their sum; `profile` (m,): equidistant over one wavelength, without its
    end.
    """
    values = np.asarray(profile, dtype=float)
    power = np.abs(np.fft.rfft(values - values.mean())[1:]) ** 2
    if len(values) % 2 == 0:
        power[-1] /= 2
    found = np.zeros(count)
    total = power.sum()
    if total > (1e-13 * len(values) * np.abs(values).max()) ** 2:
        found[: len(power)] = power[:count] / total
    return found
