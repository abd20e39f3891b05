"""Frequencies for responses of a linear system."""

from __future__ import annotations

import numpy as np

from wormopt.analysis.linearise import LinearModel


def frequencies(linear: LinearModel) -> np.ndarray:
    """Choose frequencies that show the effect of poles and zeros, with resonances resolved.

    Ascending, from a decade below to a decade above all poles and zeros but those at 0.
    """
    corners = np.append(linear.poles, linear.zeros)
    sizes = np.abs(corners)
    corners = corners[sizes > 1e-9 * max(sizes, default=0.0)]
    scales = np.log10(np.abs(corners)) if len(corners) else np.zeros(1)
    even = np.logspace(np.floor(min(scales)) - 1, np.ceil(max(scales)) + 1, 400)
    return np.unique(np.concatenate([even, *map(_around, corners)]))


def _around(corner: complex) -> np.ndarray:
    """Frequencies across the peak or dip of a corner, in the width of its damping."""
    width = max(abs(corner.real) / abs(corner), 1e-6)
    if width > 0.3:  # broad: the even grid resolves it
        return np.zeros(0)
    return abs(corner) * (1 + width * np.linspace(-5, 5, 40)[:, None] / [1, 5]).ravel()
