"""A sealed segment whose ends are held at its radius by rings: a barrel with a parabolic meridian.

Its fluid has the volume of the unstressed cylinder. A guess of the shape, not the membrane's own:
that is `membrane`. In a tube it touches in the middle only.
"""

from __future__ import annotations

from typing import Any

from wormopt.errors import ArgumentError


def barrel_swelling(stretch: Any) -> Any:
    """Largest radius over that of the rings: 1 + (5/4)(sqrt(1 + 6 s / 5) - 1), s = 1 / lam - 1.

    3 s / 4 wider where s is small; a cylinder is s / 2 wider.
    """
    return 1 + 1.25 * ((1 + 1.2 * (1 / stretch - 1)) ** 0.5 - 1)


def barrel_stretch(swelling: Any) -> Any:
    """Stretch at which the barrel is so wide: the inverse of `barrel_swelling`."""
    wider = swelling - 1
    return 1 / (1 + wider * (4 / 3 + 8 * wider / 15))


def barrel_meridian(stretch: float, share: Any) -> Any:
    """Radius over that of the rings at shares -1 to 1 of the half length."""
    if not 0 < stretch < 6:
        raise ArgumentError(f"a barrel has a stretch between 0 and 6, not {stretch:g}")
    return 1 + (barrel_swelling(stretch) - 1) * (1 - share**2)
