"""What lubrication leaves out of the flow under a wave: the next order, eps², and an error bar.

Slow flow (Stokes) knows eps = depth times wave number only by its square. Next to the stream
function of `lubrication` comes eps² times another polynomial in z, which the ground, the surface
without shear and a pressure that repeats determine. Inertia, of the share eps Re, is not in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import Expression
from wormopt.systems.film.shapes import Wave, grid

REACH = 3.0
"""Largest eps times highest harmonic for which bars are told; those of low waves end at 6.5."""


@dataclass(frozen=True)
class Corrected:
    """A number with the next order, and how far slow flow may be from it."""

    value: float
    bar: float | None  # None where eps is too large to know


def surface_correction(
    h: Expression, slope: Expression, bend: Expression, constant: Expression, change: Expression
) -> Expression:
    """What eps² multiplies in the velocity along the surface.

    `slope`, `bend`: derivatives of h by xi; `constant`: C; `change`: what eps² multiplies in it.
    """
    turned = bend * h * (h + 4 * constant) + slope * slope * (2 * h + 9 * constant)
    return (15 * change - turned) / (10 * h)


def flow_terms(wave: Wave) -> tuple[float, float]:
    """Two terms, of either sign, whose sum eps² multiplies in C and in the mean flow.

    -4/5 mean(h'²/h²) / mean(h^-3) and -16/5 C mean(h'²/h³) / mean(h^-3).
    """
    if isinstance(wave, CosineWave):
        square = 1 - wave.delta**2
        y, below = math.sqrt(square), 3 - square
        less = wave.delta**2 / (1 + y)  # 1 - y, without cancellation
        return -1.6 * square**2 * less / below, 6.4 * square**2 * wave.delta**2 / below**2
    xi = grid(2 * wave.nodes)
    h, steep = wave.height(xi), wave.height(xi, 1) ** 2
    cubes = np.mean(h**-3)
    first, second = np.mean(steep / h**2) / cubes, np.mean(steep / h**3) / cubes
    return float(-0.8 * first), float(-3.2 * wave.constant * second)


def corrected_flow(wave: Wave, eps: float) -> Corrected:
    """Mean flow with the next order of the film's thinness.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    eps : float
        Mean thickness times wave number, 0 or above.

    Returns
    -------
    Corrected
        `value`, off by a share of eps⁴, and `bar`, by how much slow flow of any thickness may
        differ from it: the sizes of both terms of the correction, added up. It is no proven
        bound, but was held against flow in two dimensions; None where eps times the highest
        harmonic of the wave is above 3.

    Raises
    ------
    ArgumentError
        If eps is no number, or negative.

    Examples
    --------
    >>> found = corrected_flow(CosineWave(0.5), 0.4)
    >>> round(found.value, 6), round(found.bar, 6)  # in two dimensions 0.352153
    (0.353203, 0.037019)
    """
    terms, square = flow_terms(wave), check_eps(eps) ** 2
    bar = square * sum(map(abs, terms)) if within_reach(wave, eps) else None
    return Corrected(float(wave.mean_flow + square * sum(terms)), bar)


def within_reach(wave: Wave, eps: float) -> bool:
    """Whether the bar is known to hold for that eps."""
    return eps * _highest(wave) <= REACH


def _highest(wave: Wave) -> int:
    if isinstance(wave, CosineWave):
        return 1
    return 1 + int(np.flatnonzero(np.abs(wave.cosines) + np.abs(wave.sines))[-1])


def check_eps(value: object) -> float:
    """Float of a number that is 0 or above; raises ArgumentError."""
    try:
        eps = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        eps = math.nan
    if not 0 <= eps < math.inf:
        raise ArgumentError(f"eps must be a finite number, 0 or above, not {value!r}")
    return eps
