"""Rows of points in the plane."""

import numpy as np


def rotated(rows: np.ndarray, angle: float) -> np.ndarray:
    """Rows turned to the left."""
    c, s = np.cos(angle), np.sin(angle)
    return rows @ np.array([[c, s], [-s, c]])
