"""Robust losses, as residuals whose squares are the loss."""

from __future__ import annotations

from typing import Literal

import numpy as np

Loss = Literal["linear", "soft_l1", "huber", "cauchy"]

# Residuals, in standard deviations, from which a loss differs from squares: the estimated mean of
# normal noise has 95 % of the efficiency of least squares.
SCALES: dict[Loss, float] = {"soft_l1": 1.287, "huber": 1.345, "cauchy": 2.385}
_TINY = 1e-30


def robust(r: np.ndarray, loss: Loss) -> tuple[np.ndarray, np.ndarray]:
    """Residuals s with s² = loss(r²) and the sign of r, and ds/dr."""
    if loss == "linear":
        return r, np.ones_like(r)
    scale = SCALES[loss]
    z = np.maximum((r / scale) ** 2, _TINY)  # so small that it is the square to all digits
    if loss == "soft_l1":
        root = np.sqrt(1 + z)
        value, slope = 2 * z / (1 + root), 1 / root
    elif loss == "huber":
        far = z > 1
        root = np.sqrt(np.where(far, z, 1.0))
        value, slope = np.where(far, 2 * root - 1, z), 1 / root
    else:
        value, slope = np.log1p(z), 1 / (1 + z)
    size = np.sqrt(value)
    steep = slope * np.sqrt(z) / size
    return np.where(z > _TINY, np.copysign(scale * size, r), r), steep
