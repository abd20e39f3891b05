"""Waves of coil currents along a worm: courses of its inputs, one cycle each."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from wormopt.model.gait import Gait
from wormopt.model.schedule import Schedule
from wormopt.systems.peristaltic.anchored.gait import running_block


def switched_wave(segments: int, on: int, *, step: float, size: float, retrograde: bool) -> Gait:
    """A block of coils that are on, which goes on by one segment after each step.

    In the first step it is at the end from which it runs; past the other it begins anew.

    Parameters
    ----------
    segments, on : int
        Number of segments, and of coils that are on at a time.
    step, size : float
        How long a step lasts, s; the input of a coil that is on.
    retrograde : bool
        Whether it runs from head to tail.

    Returns
    -------
    Gait
        Inputs over a cycle.

    Examples
    --------
    >>> switched_wave(3, 1, step=0.1, size=2.0, retrograde=True)(0.15).ravel()
    array([0., 2., 0.])

    """
    lit = running_block(segments, on)[:, :: 1 if retrograde else -1]
    return Gait(step * np.arange(segments + 1.0), size * lit[:, :, None].astype(float))


def harmonic_wave(
    segments: int, lag: float, *, period: float, size: float, retrograde: bool
) -> Gait:
    """Inputs size (1 + cos(2 pi (t / period - lag j))) / 2 in segment j; with -lag if direct.

    Parameters
    ----------
    segments : int
        Number of segments.
    lag : float
        Periods by which a segment is behind the one ahead of it.
    period, size : float
        How long a cycle lasts, s; the largest input.
    retrograde : bool
        Whether it runs from head to tail.

    Returns
    -------
    Gait
        Inputs over a cycle.

    Examples
    --------
    >>> harmonic_wave(2, 0.5, period=1.0, size=2.0, retrograde=True)(0.0).ravel()
    array([2., 0.])

    """
    phase = 2 * math.pi * lag * np.arange(segments) * (1 if retrograde else -1)
    return Gait(
        np.array([0.0, period]),
        np.full((1, segments, 1), size / 2),
        np.array([2 * math.pi / period]),
        size / 2 * np.cos(phase)[None],
        size / 2 * np.sin(phase)[None],
    )


def held(course: Gait, parts: int) -> Schedule:
    """A course as values that are held, those of the middles of so many parts of each piece.

    It repeats. One part each is exact where the course is constant between its breaks.
    """
    counted = np.arange(parts * course.pieces + 1) / parts
    breaks = np.interp(counted, np.arange(course.pieces + 1), course.breaks)
    values = course((breaks[:-1] + breaks[1:]) / 2).T
    symbol = ca.SX.sym("course", course.links)
    return Schedule("course", symbol, ca.SX.sym("begin"), breaks, values, periodic=True)
