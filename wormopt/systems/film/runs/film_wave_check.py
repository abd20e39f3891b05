"""What an optimal wave does by its shape alone, and the cosine wave beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.design.search import DesignedWave
from wormopt.systems.film.design.wave import WaveAim, WaveLimits
from wormopt.systems.film.drift import CAPTURE_DELTA, cosine_drift
from wormopt.systems.film.limits import Sampled, field_needs, fitting_cosine, sampled
from wormopt.systems.film.shapes import grid

# Phases at which the thickness is taken. Where the field jumps, differences blur it over two.
_NODES = 16384
# Slopes of the field are taken over so many of them: they are third differences of the thickness.
_APART = 16
# Accepted: of numbers of order 1; of the field over its range; of its slope over the largest.
_NUMBER, _FIELD, _SLOPE = 1e-6, 1e-3, 1e-2


def check_wave(wave: DesignedWave, aim: WaveAim) -> tuple[Sampled, dict[str, tuple[float, float]]]:
    """Find flow, field and float of a wave again, from values of its thickness alone.

    Returns that, and by check name how far the optimiser's numbers and limits are missed and
    how far is accepted.
    """
    xi, limits = grid(_NODES), wave.limits
    h = wave.thickness(xi)
    shape = sampled(h, limits.tension)
    least, most = limits.thickness
    apart = shape.field - wave.field(xi)
    needed = float(np.ptp(shape.field))
    checks = {
        "C by quadrature": (abs(shape.constant + 1 - wave.mean_flow), _NUMBER),
        "mean thickness": (abs(shape.mean - 1), _NUMBER),
        "thickness beyond its bounds": (max(least - h.min(), h.max() - most, 0.0), _NUMBER),
        "range of the field": (max(0.0, needed / wave.field_range - 1), _FIELD),
        "field by (30), mean difference": (
            float(np.mean(np.abs(apart - np.median(apart)))) / wave.field_range,
            _FIELD,
        ),
    }
    if limits.gradient is not None:
        rise = np.roll(shape.field, -_APART) - shape.field
        steepest = np.abs(rise).max() * _NODES / (2 * np.pi * _APART)
        checks["slope of the field"] = (max(0.0, steepest / limits.gradient - 1), _SLOPE)
    if aim.mean_flow is not None:
        checks["aim.mean_flow"] = (max(0.0, aim.mean_flow - 1 - shape.constant), _NUMBER)
    if aim.capture:
        checks["aim.capture"] = (max(0.0, -shape.margin), _NUMBER)
    return shape, {name: (float(value), accepted) for name, (value, accepted) in checks.items()}


def faults_of_checks(checks: Mapping[str, tuple[float, float]]) -> list[str]:
    """Say which checks of `check_wave` do not hold."""
    return [
        f"{name} is off by {value:.2g} where {accepted:g} is accepted"
        for name, (value, accepted) in checks.items()
        if not value <= accepted
    ]


@dataclass(frozen=True)
class CosineBeside:
    """The cosine wave within the same limits; all NaN where none does what is asked."""

    delta: float = math.nan  # amplitude
    mean_flow: float = math.nan
    field_range: float = math.nan
    drift: float = math.nan  # of a small float over the speed of the wave


def cosine_beside(limits: WaveLimits, aim: WaveAim) -> CosineBeside:
    """Find the largest cosine wave within the limits, or the smallest that does what is asked."""
    gradient = math.inf if limits.gradient is None else limits.gradient
    if limits.field is not None:
        delta = fitting_cosine(limits.tension, limits.thickness, limits.field, gradient)
    else:
        flow = aim.mean_flow or 0.0
        delta = max(math.sqrt(2 * flow / (3 - flow)), CAPTURE_DELTA if aim.capture else 0.0)
        a, b = limits.thickness
        if delta > min(1 - a, b - 1) or field_needs(delta, limits.tension)[1] > gradient:
            return CosineBeside()
    needed, _ = field_needs(delta, limits.tension)
    drift = 1.0 if delta >= CAPTURE_DELTA else float(cosine_drift(delta))
    return CosineBeside(delta, CosineWave(delta).mean_flow, needed, drift)
