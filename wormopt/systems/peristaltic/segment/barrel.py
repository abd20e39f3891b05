"""A sealed segment with ends held at its radius by rings: a barrel with a parabolic meridian.

Its fluid has the volume of the unstressed cylinder. The shape is an assumption; `membrane` computes
the true one. In a tube it touches in the middle only.
"""

from __future__ import annotations

from typing import Any

from wormopt.errors import ArgumentError


def barrel_swelling(stretch: Any) -> Any:
    """Return the largest radius over that of the rings at a stretch lam.

    1 + (5/4)(sqrt(1 + 6 s / 5) - 1) with s = 1 / lam - 1: a growth of 3 s / 4 for small s, against
    s / 2 of a cylinder.
    """
    return 1 + 1.25 * ((1 + 1.2 * (1 / stretch - 1)) ** 0.5 - 1)


def barrel_stretch(swelling: Any) -> Any:
    """Return the stretch at a largest radius: the inverse of `barrel_swelling`."""
    wider = swelling - 1
    return 1 / (1 + wider * (4 / 3 + 8 * wider / 15))


def barrel_meridian(stretch: float, share: Any) -> Any:
    """Return the radius over that of the rings at shares -1 to 1 of the half length."""
    if not 0 < stretch < 6:
        raise ArgumentError(f"stretch must be between 0 and 6 for a barrel, not {stretch:g}")
    return 1 + (barrel_swelling(stretch) - 1) * (1 - share**2)
