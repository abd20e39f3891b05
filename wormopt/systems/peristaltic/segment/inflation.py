"""A cylinder of membrane under a given pressure inside, its closed ends free: fluid may come in.

Segments that share their fluid, or a pump. With w the energy of `rubber`, kappa the pressure times
R / (G h) and th the hoop stretch, what is stationary is w - kappa th² lam / 2. The ends are free
where w_lam = kappa th² / 2, the wall is at rest where w_th = kappa th lam; without kappa that is
quadratic in lam². kappa rises with th up to the limit of inflation, where the determinant of the
second derivatives vanishes; beyond it the tube goes on to swell by itself.
Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment.rubber import curvatures, slopes

WIDEST = 8.0
"""Hoop stretch up to which a limit is looked for; rubber tears before."""


class Inflated(NamedTuple):
    """A cylinder at rest under a pressure."""

    loading: float  # kappa
    hoop: float  # over its unstressed radius
    stretch: float  # over its unstressed length


def free_stretch(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Stretch along the axis at which ends are free, by the hoop stretch; closed form."""
    y, a, b = hoop**2, neo_hookean, 1 - neo_hookean
    square, linear, rest = a + b * y / 2, (a * y - b / y) / 2, a / (2 * y) + b
    return ((linear + (linear**2 + 4 * square * rest) ** 0.5) / (2 * square)) ** 0.5


def loading_at(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Pressure over G h / R that holds a hoop stretch, the ends free; closed form."""
    stretch = free_stretch(hoop, neo_hookean)
    return slopes(stretch, hoop, neo_hookean)[1] / (hoop * stretch)


def determinant(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Determinant of the second derivatives of energy less work, at rest at a hoop stretch.

    Above 0 where the rest is stable under its pressure.
    """
    stretch, loading = free_stretch(hoop, neo_hookean), loading_at(hoop, neo_hookean)
    along, both, around = curvatures(stretch, hoop, neo_hookean)
    return along * (around - loading * stretch) - (both - loading * hoop) ** 2


def limit_of_inflation(neo_hookean: float = 1.0) -> Inflated | None:
    """Where the pressure is largest, None if it rises with the hoop stretch throughout."""
    hoops = np.linspace(1.0, WIDEST, 701)
    beyond = np.flatnonzero(determinant(hoops, neo_hookean) < 0)
    if not beyond.size:
        return None
    low, high = hoops[beyond[0] - 1 : beyond[0] + 1]
    return _at(root(lambda hoop: determinant(hoop, neo_hookean), low, high), neo_hookean)


def inflated(loading: float, neo_hookean: float = 1.0) -> Inflated:
    """Rest under a pressure over G h / R, on the branch that begins unstressed.

    Raises ArgumentError if the loading is below 0 or above its limit.
    """
    limit = limit_of_inflation(neo_hookean)
    widest, most = limit.hoop if limit else WIDEST, largest_loading(neo_hookean)
    if not 0 <= loading <= most:
        end = "the limit of inflation" if limit else f"a hoop stretch of {WIDEST:g}"
        raise ArgumentError(
            f"the pressure is {loading:.6g} G h / R; a tube rests from 0 to {end}, "
            f"{most:.6g} G h / R"
        )
    rest = root(lambda hoop: loading_at(hoop, neo_hookean) - loading, 1.0, widest)
    return _at(rest, neo_hookean)


def largest_loading(neo_hookean: float = 1.0) -> float:
    """Largest pressure over G h / R: at the limit of inflation, or at `WIDEST` without one."""
    limit = limit_of_inflation(neo_hookean)
    return limit.loading if limit else float(loading_at(WIDEST, neo_hookean))


def _at(hoop: float, neo_hookean: float) -> Inflated:
    return Inflated(
        float(loading_at(hoop, neo_hookean)), hoop, float(free_stretch(hoop, neo_hookean))
    )
