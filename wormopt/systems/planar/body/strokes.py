"""Strokes: closed curves of the shape of a body over a phase, independent of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError


@runtime_checkable
class Stroke(Protocol):
    """A closed curve of the shape variables over a phase tau from 0 to 1."""

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        ...

    @property
    def breaks(self) -> np.ndarray:
        """Phases between which the curve is smooth, including 0 and 1."""
        ...

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes (m, n_s) at phases (m,), and their derivatives by the phase.

        At a break the derivative is the right one, at 1 the left one.
        """
        ...


@dataclass(frozen=True, eq=False)
class Harmonics:
    """A stroke of harmonic shape variables.

    s(tau) = mean + sum over h of cosine_h cos(2 pi h tau) + sine_h sin(2 pi h tau), h = 1, 2, ...

    Parameters
    ----------
    mean : array_like, shape (n_s,)
        Mean shape: link lengths, if they vary, then joint angles in rad.
    cosine, sine : array_like, shape (H, n_s)
        Coefficients of the harmonics.

    Raises
    ------
    ArgumentError
        If the shapes of the tables differ.

    Examples
    --------
    >>> circle = Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])
    >>> circle.at(0.25)[0].round(12).tolist()
    [[0.0, 1.0]]
    """

    mean: Any  # stored as arrays
    cosine: Any
    sine: Any

    def __post_init__(self) -> None:
        for name in ("mean", "cosine", "sine"):
            value = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, value)
        if self.cosine.shape != self.sine.shape or self.cosine.shape[1:] != self.mean.shape:
            raise ArgumentError(
                f"{len(self.mean)} shape variables need tables of shape (H, {len(self.mean)}), "
                f"not {self.cosine.shape} and {self.sine.shape}"
            )

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return len(self.mean)

    @property
    def breaks(self) -> np.ndarray:
        """Phases 0 and 1: the curve is smooth everywhere."""
        return np.array([0.0, 1.0])

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes and their derivatives at phases.

        Parameters
        ----------
        tau : array_like, shape (m,)
            Phases.

        Returns
        -------
        s, ds : ndarray, shape (m, n_s)
            Shapes, and their derivatives by the phase.
        """
        orders = 2 * np.pi * np.arange(1, len(self.cosine) + 1)
        angle = np.atleast_1d(np.asarray(tau, dtype=float))[:, None] * orders
        c, s = np.cos(angle), np.sin(angle)
        shape = self.mean + c @ self.cosine + s @ self.sine
        return shape, (c * orders) @ self.sine - (s * orders) @ self.cosine


@dataclass(frozen=True, eq=False)
class Polygon:
    """A stroke that is linear from corner to corner, with equal durations of all sides.

    Parameters
    ----------
    corners : array_like, shape (m, n_s)
        Shapes in order (link lengths, if they vary, then joint angles in rad); the last side
        returns to the first corner.

    Raises
    ------
    ArgumentError
        If the corners are no table.

    Examples
    --------
    >>> Polygon([[0.0], [1.0]]).at([0.25, 0.75])[1].tolist()
    [[2.0], [-2.0]]
    """

    corners: Any  # stored as an array

    def __post_init__(self) -> None:
        corners = np.array(self.corners, dtype=float)
        object.__setattr__(self, "corners", corners)
        if corners.ndim != 2 or len(corners) < 2:
            raise ArgumentError(f"corners must have the shape (m, n_s), not {corners.shape}")

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return int(self.corners.shape[1])

    @property
    def breaks(self) -> np.ndarray:
        """Phases of the corners."""
        return np.linspace(0.0, 1.0, len(self.corners) + 1)

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes and their derivatives at phases.

        Parameters
        ----------
        tau : array_like, shape (m,)
            Phases from 0 to 1.

        Returns
        -------
        s, ds : ndarray, shape (m, n_s)
            Shapes, and their derivatives by the phase.
        """
        phase = np.atleast_1d(np.asarray(tau, dtype=float))
        m, closed = len(self.corners), np.vstack([self.corners, self.corners[:1]])
        side = np.clip(np.searchsorted(self.breaks, phase, side="right") - 1, 0, m - 1)
        way = np.diff(closed, axis=0)[side]
        return closed[side] + (phase * m - side)[:, None] * way, m * way
