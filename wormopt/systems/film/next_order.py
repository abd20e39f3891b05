"""Correction of the lubrication flow in a wave: the next order, eps², with an error estimate.

Slow flow (Stokes) depends on eps = depth times wave number only by its square. The stream function
of `lubrication` is corrected by eps² times another polynomial in z, which follows from the ground,
the surface without shear and a periodic pressure. Inertia, of relative size eps Re, is not
included.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.result import Unchecked, left_out
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import Expression
from wormopt.systems.film.shapes import Wave, grid

REACH = 3.0
"""Largest eps times highest harmonic with an error estimate; for low waves the limit is 6.5."""


@dataclass(frozen=True)
class Corrected:
    """A value corrected to the next order, and its error estimate for slow flow."""

    value: float
    bar: float | None  # None where eps is too large to know


def surface_correction(
    h: Expression, slope: Expression, bend: Expression, constant: Expression, change: Expression
) -> Expression:
    """Coefficient of eps² in the velocity along the surface.

    `slope`, `bend`: derivatives of h with respect to xi; `constant`: C; `change`: coefficient of
    eps² in C.
    """
    turned = bend * h * (h + 4 * constant) + slope * slope * (2 * h + 9 * constant)
    return (15 * change - turned) / (10 * h)


def flow_terms(wave: Wave) -> tuple[float, float]:
    """Two terms, of either sign, whose sum is the coefficient of eps² in C and in the mean flow.

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
    """Mean flow of a wave, corrected to the next order of the film's thinness.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    eps : float
        Mean thickness times wave number, 0 or above.

    Returns
    -------
    Corrected
        ``value`` has a relative error of order eps⁴. ``bar`` estimates the error against slow flow
        of any thickness: the sum of the sizes of both terms of the correction. It is not a proven
        bound, but was compared with flow in two dimensions. It is None where eps times the highest
        harmonic of the wave is above 3.

    Raises
    ------
    ArgumentError
        If eps is not a number, or negative.

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
    """Whether the error estimate is known to hold for that eps."""
    return eps * _highest(wave) <= REACH


def _highest(wave: Wave) -> int:
    if isinstance(wave, CosineWave):
        return 1
    return 1 + int(np.flatnonzero(np.abs(wave.cosines) + np.abs(wave.sines))[-1])


def check_eps(value: object) -> float:
    """Convert a number of 0 or above to float; raises ArgumentError."""
    try:
        eps = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        eps = math.nan
    if not 0 <= eps < math.inf:
        raise ArgumentError(f"eps must be a finite number, 0 or above, not {value!r}")
    return eps


def reach_warnings(wave: Wave, eps: float | None) -> Iterator[str]:
    """Warn where the next order in eps does not estimate the error."""
    if eps is None:
        return
    if within_reach(wave, eps):
        bar, flow = corrected_flow(wave, eps).bar, abs(wave.mean_flow)
        if bar is not None and bar > flow:
            yield left_out(
                bar / flow if flow else math.inf,
                f"eps = {eps:.3g}: lubrication theory may have an error of {bar:.2g} in a mean "
                f"flow of {flow:.2g}",
            )
    else:
        yield Unchecked(
            f"eps = {eps:.3g} times the highest harmonic is above {REACH:g}: the error of "
            "lubrication theory is unknown"
        )
