"""Poses in the plane: x, y and the angle of the heading, composed as rigid motions are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


def compose(first: ArrayLike, then: ArrayLike) -> np.ndarray:
    """Pose reached by one displacement after another, each told in the frame it starts from.

    Parameters
    ----------
    first, then : array_like, shape (..., 3)
        x, y and angle; any but the last dimension is broadcast.

    Returns
    -------
    ndarray, shape (..., 3)

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
    """Displacement that takes a pose back.

    Parameters
    ----------
    pose : array_like, shape (..., 3)
        x, y and angle.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    g = np.asarray(pose, dtype=float)
    back = -rotate(-g[..., 2], g[..., :2])
    return np.concatenate([back, -g[..., 2:]], axis=-1)


def rotate(angle: ArrayLike, vectors: ArrayLike) -> np.ndarray:
    """Turn vectors to the left.

    Parameters
    ----------
    angle : array_like, shape (...,)
        Angles.
    vectors : array_like, shape (..., 2)
        What is turned.

    Returns
    -------
    ndarray, shape (..., 2)
    """
    c, s = np.cos(angle), np.sin(angle)
    x, y = np.moveaxis(np.asarray(vectors, dtype=float), -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


@dataclass(frozen=True)
class Circle:
    """Circle on which a body comes to lie that repeats one displacement."""

    centre: tuple[float, float]  # in the frame it starts from
    radius: float


def circle_of(displacement: ArrayLike) -> Circle | None:
    """Circle of a displacement that is repeated; None where it does not turn.

    Parameters
    ----------
    displacement : array_like, shape (3,)
        x, y and angle of one repetition.

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
