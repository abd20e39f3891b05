"""Waves of coil currents along a worm: inputs over one cycle."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from wormopt.model.gait import Gait
from wormopt.model.schedule import Schedule
from wormopt.systems.peristaltic.anchored.gait import running_block


def switched_wave(segments: int, on: int, *, step: float, size: float, retrograde: bool) -> Gait:
    """Return a block of coils that are on, which moves by one segment after each step.

    In the first step the block is at the end from which it runs. Beyond the other end it starts
    again.

    Parameters
    ----------
    segments, on : int
        Number of segments, and of coils that are on at a time.
    step, size : float
        Duration of a step, s; input of a coil that is on.
    retrograde : bool
        Whether the wave runs from head to tail.

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
    """Return inputs size (1 + cos(2 pi (t / period - lag j))) / 2 of segment j; -lag if direct.

    Parameters
    ----------
    segments : int
        Number of segments.
    lag : float
        Lag of a segment behind the one ahead of it, in periods.
    period, size : float
        Duration of a cycle, s; largest input.
    retrograde : bool
        Whether the wave runs from head to tail.

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
    """Return a periodic gait as piecewise constant values, from the middles of equal parts.

    Each piece has `parts` parts. One part is exact if the gait is constant between its breaks.
    """
    counted = np.arange(parts * course.pieces + 1) / parts
    breaks = np.interp(counted, np.arange(course.pieces + 1), course.breaks)
    values = course((breaks[:-1] + breaks[1:]) / 2).T
    symbol = ca.SX.sym("course", course.links)
    return Schedule("course", symbol, ca.SX.sym("begin"), breaks, values, periodic=True)
