"""A membrane cylinder under a given inner pressure with free closed ends: fluid may come in.

This holds for segments that share their fluid, or have a pump. With the energy w of `rubber`, the
pressure kappa in G h / R and the hoop stretch th, w - kappa th² lam / 2 is stationary: free ends
satisfy w_lam = kappa th² / 2, the wall w_th = kappa th lam. Without kappa this is quadratic in
lam². kappa increases with th up to the limit of inflation, where the determinant of the second
derivatives vanishes; beyond it the tube is unstable and keeps swelling.
Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment.rubber import curvatures, slopes

WIDEST = 8.0
"""Hoop stretch up to which a limit is searched; rubber tears before."""


class Inflated(NamedTuple):
    """A cylinder in equilibrium under a pressure."""

    loading: float  # kappa
    hoop: float  # over its unstressed radius
    stretch: float  # over its unstressed length


def free_stretch(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the axial stretch with free ends, by the hoop stretch; closed form."""
    y, a, b = hoop**2, neo_hookean, 1 - neo_hookean
    square, linear, rest = a + b * y / 2, (a * y - b / y) / 2, a / (2 * y) + b
    return ((linear + (linear**2 + 4 * square * rest) ** 0.5) / (2 * square)) ** 0.5


def loading_at(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the pressure over G h / R for a hoop stretch with free ends; closed form."""
    stretch = free_stretch(hoop, neo_hookean)
    return slopes(stretch, hoop, neo_hookean)[1] / (hoop * stretch)


def determinant(hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the determinant of second derivatives of energy less work, in equilibrium.

    It is positive if the equilibrium is stable at its pressure.
    """
    stretch, loading = free_stretch(hoop, neo_hookean), loading_at(hoop, neo_hookean)
    along, both, around = curvatures(stretch, hoop, neo_hookean)
    return along * (around - loading * stretch) - (both - loading * hoop) ** 2


def limit_of_inflation(neo_hookean: float = 1.0) -> Inflated | None:
    """Return the state of largest pressure, or None if it always rises with the hoop stretch."""
    hoops = np.linspace(1.0, WIDEST, 701)
    beyond = np.flatnonzero(determinant(hoops, neo_hookean) < 0)
    if not beyond.size:
        return None
    low, high = hoops[beyond[0] - 1 : beyond[0] + 1]
    return _at(root(lambda hoop: determinant(hoop, neo_hookean), low, high), neo_hookean)


def inflated(loading: float, neo_hookean: float = 1.0) -> Inflated:
    """Return the equilibrium at a pressure over G h / R, on the branch from the unstressed state.

    Raises ArgumentError if the loading is below 0 or above its limit.
    """
    limit = limit_of_inflation(neo_hookean)
    widest, most = limit.hoop if limit else WIDEST, largest_loading(neo_hookean)
    if not 0 <= loading <= most:
        end = "the limit of inflation" if limit else f"a hoop stretch of {WIDEST:g}"
        raise ArgumentError(
            f"the pressure is {loading:.6g} G h / R; equilibria exist from 0 to {end}, "
            f"{most:.6g} G h / R"
        )
    rest = root(lambda hoop: loading_at(hoop, neo_hookean) - loading, 1.0, widest)
    return _at(rest, neo_hookean)


def largest_loading(neo_hookean: float = 1.0) -> float:
    """Return the largest pressure over G h / R: limit of inflation, or the value at `WIDEST`."""
    limit = limit_of_inflation(neo_hookean)
    return limit.loading if limit else float(loading_at(WIDEST, neo_hookean))


def _at(hoop: float, neo_hookean: float) -> Inflated:
    return Inflated(
        float(loading_at(hoop, neo_hookean)), hoop, float(free_stretch(hoop, neo_hookean))
    )
