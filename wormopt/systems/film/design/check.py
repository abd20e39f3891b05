"""Check an optimal wave by quadrature of its shape alone, and compare it with a cosine wave."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.result import Check
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.design.search import DesignedWave
from wormopt.systems.film.design.wave import (
    WaveAim,
    WaveLimits,
    carrying_cosine,
    field_needs,
    highest,
)
from wormopt.systems.film.float import CAPTURE_DELTA, cosine_drift
from wormopt.systems.film.shapes import field_function, flow_constant, grid

# Number of phases of the thickness. Where the field jumps, differences smooth it over two.
_NODES = 16384
# Slopes of the field use this many phases: they are third differences of the thickness.
_APART = 16
# A wave that just holds a float may miss it by round-off and quadrature only.
HELD = 1e-6
"""Accepted deficit, by rounding, of the margin with which a float is held."""
# Accepted errors: of quantities of order 1; of the field over its range; of its slope over the
# largest.
_NUMBER, _FIELD, _SLOPE = 1e-6, 1e-3, 1e-2


@dataclass(frozen=True, eq=False)
class Sampled:
    """Results of a wave from values of its thickness alone."""

    thickness: np.ndarray  # (nodes,) on `grid`
    constant: float  # C, by quadrature
    # (nodes,) (mu - 1) H² / (8 pi), least 0, by quadrature of (30) and second differences
    field: np.ndarray
    mean: float  # mean thickness
    margin: float  # largest thickness + 3 C; a small float is held if ≥ 0
    drift: float  # of a small float over the wave's speed; 1 if held


def sampled(h: np.ndarray, tension: float) -> Sampled:
    """Evaluate a wave from its thickness `h` (nodes,) on `grid`; its slope may have corners.

    Second differences smooth a jump of the curvature over two points, without overshoot.
    """
    C, apart = float(flow_constant(h)), 2 * np.pi / len(h)
    bend = (np.roll(h, 1) - 2 * h + np.roll(h, -1)) / apart**2
    field = -(np.asarray(field_function(h)) + tension * bend)
    margin = highest(h) + 3 * C
    # the surface is slower than the wave by (-3 C - h) / (2 h)
    held = margin >= -HELD
    drift = 1.0 if held else float(1 - 1 / np.mean(2 * h / (-3 * C - h)))
    return Sampled(h, C, field - field.min(), float(h.mean()), margin, drift)


def check_wave(wave: DesignedWave, aim: WaveAim) -> tuple[Sampled, tuple[Check, ...]]:
    """Compute flow, field and float of a wave again, from values of its thickness alone.

    Checks compare the optimiser's results and limits with accepted errors.
    """
    xi, limits = grid(_NODES), wave.limits
    h = wave.thickness(xi)
    shape = sampled(h, limits.tension)
    return shape, tuple(_checks(wave, aim, shape, shape.field - wave.field(xi)))


def _checks(wave: DesignedWave, aim: WaveAim, shape: Sampled, apart: np.ndarray) -> Iterator[Check]:
    h, (least, most), limits = shape.thickness, wave.limits.thickness, wave.limits
    needed = float(np.ptp(shape.field)) / wave.field_range
    mean = float(np.mean(np.abs(apart - np.median(apart)))) / wave.field_range
    yield _check("C by quadrature", abs(shape.constant + 1 - wave.mean_flow), _NUMBER)
    yield _check("mean thickness", abs(shape.mean - 1), _NUMBER)
    beyond = max(least - h.min(), h.max() - most, 0.0)
    yield _check("thickness beyond its bounds", beyond, _NUMBER)
    yield _check("range of the field", max(0.0, needed - 1), _FIELD)
    yield _check("field by (30), mean difference", mean, _FIELD)
    if limits.gradient is not None:
        rise = np.roll(shape.field, -_APART) - shape.field
        steepest = np.abs(rise).max() * _NODES / (2 * np.pi * _APART)
        yield _check("slope of the field", max(0.0, steepest / limits.gradient - 1), _SLOPE)
    if aim.mean_flow is not None:
        yield _check("aim.mean_flow", max(0.0, aim.mean_flow - 1 - shape.constant), _NUMBER)
    if aim.capture:
        yield _check("aim.capture", max(0.0, -shape.margin), _NUMBER)


def _check(name: str, off: float, accepted: float) -> Check:
    advice = f"{name} differs by {off:.2g} where {accepted:g} is accepted"
    return Check(name, float(off), accepted, advice)


@dataclass(frozen=True)
class CosineBeside:
    """The cosine wave within the same limits; all NaN where none meets the requirements."""

    delta: float = math.nan  # amplitude
    mean_flow: float = math.nan
    field_range: float = math.nan
    drift: float = math.nan  # of a small float over the speed of the wave


def cosine_beside(limits: WaveLimits, aim: WaveAim) -> CosineBeside:
    """Find the largest cosine wave within limits, or the smallest that meets the requirements."""
    if limits.field is not None:
        delta = limits.cosine()
    else:
        delta = carrying_cosine(aim.mean_flow or 0.0)
        delta = max(delta, CAPTURE_DELTA if aim.capture else 0.0)
        a, b = limits.thickness
        steep = field_needs(delta, limits.tension)[1] > (limits.gradient or math.inf)
        if delta > min(1 - a, b - 1) or steep:
            return CosineBeside()
    needed, _ = field_needs(delta, limits.tension)
    drift = 1.0 if delta >= CAPTURE_DELTA else float(cosine_drift(delta))
    return CosineBeside(delta, CosineWave(delta).mean_flow, needed, drift)
