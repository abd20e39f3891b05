"""Poses in the plane, (x, y, heading), and their composition as rigid motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


def compose(first: ArrayLike, then: ArrayLike) -> np.ndarray:
    """Return the pose after two successive displacements, each in the frame it starts from.

    Parameters
    ----------
    first, then : array_like, shape (..., 3)
        x, y (in units of length) and angle (in rad); leading dimensions broadcast.

    Returns
    -------
    ndarray, shape (..., 3)
        x, y and angle of the pose.

    Examples
    --------
    >>> import numpy as np
    >>> compose([1.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0]).round(12).tolist()
    [1.0, 1.0, 1.570796326795]
    """
    a, b = np.asarray(first, dtype=float), np.asarray(then, dtype=float)
    return np.concatenate(
        [a[..., :2] + rotate(a[..., 2], b[..., :2]), (a[..., 2] + b[..., 2])[..., None]], axis=-1
    )


def inverse(pose: ArrayLike) -> np.ndarray:
    """Return the inverse of a displacement.

    Parameters
    ----------
    pose : array_like, shape (..., 3)
        x, y and angle (in rad).

    Returns
    -------
    ndarray, shape (..., 3)
    """
    g = np.asarray(pose, dtype=float)
    back = -rotate(-g[..., 2], g[..., :2])
    return np.concatenate([back, -g[..., 2:]], axis=-1)


def rotate(angle: ArrayLike, vectors: ArrayLike) -> np.ndarray:
    """Rotate vectors to the left.

    Parameters
    ----------
    angle : array_like, shape (...,)
        Angles in rad.
    vectors : array_like, shape (..., 2)
        Vectors.

    Returns
    -------
    ndarray, shape (..., 2)
    """
    c, s = np.cos(angle), np.sin(angle)
    x, y = np.moveaxis(np.asarray(vectors, dtype=float), -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


@dataclass(frozen=True)
class Circle:
    """Circle of a body that repeats one displacement."""

    centre: tuple[float, float]  # in the frame it starts from
    radius: float


def circle_of(displacement: ArrayLike) -> Circle | None:
    """Return the circle of a repeated displacement; None if it does not turn.

    Parameters
    ----------
    displacement : array_like, shape (3,)
        x, y and angle (in rad) of one repetition.

    Returns
    -------
    Circle or None
        Its radius is |d| / (2 |sin(angle / 2)|).

    Examples
    --------
    >>> import numpy as np
    >>> round(circle_of([1.0, 1.0, np.pi / 2]).radius, 12)
    1.0
    """
    x, y, angle = np.asarray(displacement, dtype=float).tolist()
    half = np.sin(angle / 2)
    if abs(half) < 1e-12:
        return None
    cot = np.cos(angle / 2) / half
    centre = ((x - cot * y) / 2, (y + cot * x) / 2)
    return Circle((float(centre[0]), float(centre[1])), float(np.hypot(x, y) / (2 * abs(half))))
