"""What a travelling wave carries: floats on the surface of a film, and tracers in it, as Models.

A float is thin and light: it does not change the film, bends with its surface and goes as fast as
the surface below it does on average, as viscous drag alone makes it. A tracer is a point of the
fluid. Lengths along the film are in units of 1/k, times in units of 1/omega: (25).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import TINY, Model, Output, Signal, Switch
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.drift import Wave, body_velocity, check_heights, check_lengths, finite
from wormopt.systems.film.lubrication import stream_function, velocities

_LARGEST_BELOW_1 = math.nextafter(1.0, 0.0)


def floating(wave: Wave, *, length: ArrayLike = 0.0, position: ArrayLike = 0.0) -> Model:
    """Build x' = mean surface velocity under each of some floats.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    length : float or array_like, shape (n,), optional
        Lengths of the floats, 0 for small ones, below 2 pi.
    position : float or array_like, shape (n,), optional
        Places of their middles at time 0.

    Returns
    -------
    Model
        State ``position`` (n,); outputs ``phase`` t - x and ``velocity``. It has a switch "float i
        overtaken" for when a trough of the cosine wave, phase pi, passes float i. The parameter
        ``amplitude`` of a CosineWave may be changed without a new compilation.

    Raises
    ------
    ArgumentError
        If lengths or places are no numbers, out of range, or of different counts.

    Examples
    --------
    >>> model = floating(CosineWave(0.5), length=[0.0, 1.0])
    >>> model.n_x, [switch.name for switch in model.switches]
    (2, ['float 0 overtaken', 'float 1 overtaken'])
    """
    lengths, places = _alike(check_lengths(length), finite("position", position))
    symbolic, parameters = _lifted(wave)
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(places))
    xi = t - x
    velocity = ca.vertcat(
        *(body_velocity(symbolic, xi[i], float(each)) for i, each in enumerate(lengths))
    )
    return Model(
        "floats on a film",
        x=[Signal("position", x, "length", value=tuple(places))],
        ode=velocity,
        p=parameters,
        t=t,
        outputs=[Output("phase", xi, "angle"), Output("velocity", velocity, "speed")],
        switches=_overtaken("float", xi, x),
    )


def tracers(wave: Wave, *, height: ArrayLike, position: ArrayLike = 0.0) -> Model:
    """Build x' = u, z' = w for each of some points of the fluid.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    height : float or array_like, shape (n,)
        Over the ground at time 0, from 0 to the surface.
    position : float or array_like, shape (n,), optional
        Places at time 0.

    Returns
    -------
    Model
        States ``position`` and ``height``, (n,) each; outputs ``phase``, ``depth`` below the
        surface and ``stream``, the stream function, which does not change. Switches and parameter
        as for `floating`.

    Raises
    ------
    ArgumentError
        If a height is not within the film, or as `floating`.

    Examples
    --------
    >>> model = tracers(CosineWave(0.5), height=[0.5, 1.5])
    >>> [signal.name for signal in model.x]
    ['position', 'height']
    """
    heights, places = _alike(finite("height", height), finite("position", position))
    heights = check_heights(wave, places, heights)
    symbolic, parameters = _lifted(wave)
    count = len(places)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", count), ca.SX.sym("z", count)
    xi, C = t - x, symbolic.constant
    h = symbolic.height(xi)
    u, w = velocities(z, h, symbolic.height(xi, 1), C)
    states = ca.vertcat(x, z)
    return Model(
        "tracers in a film",
        x=[
            Signal("position", x, "length", value=tuple(places)),
            Signal("height", z, "length", value=tuple(heights)),
        ],
        ode=ca.vertcat(u, w),
        p=parameters,
        t=t,
        outputs=[
            Output("phase", xi, "angle"),
            Output("depth", h - z, "length"),
            Output("stream", stream_function(z, h, C), "length"),
        ],
        switches=_overtaken("tracer", xi, states),
    )


def _overtaken(what: str, xi: ca.SX, states: ca.SX) -> list[Switch]:
    return [Switch(f"{what} {i} overtaken", -ca.sin(xi[i]), states) for i in range(xi.numel())]


def _lifted(wave: Wave) -> tuple[Any, Sequence[Signal]]:
    """The wave with its amplitude as a symbol, where it has one."""
    if not isinstance(wave, CosineWave):
        return wave, ()
    delta = ca.SX.sym("delta")
    amplitude = Signal(
        "amplitude", delta, "share", lower=TINY, upper=_LARGEST_BELOW_1, value=wave.delta
    )
    return CosineWave(delta), (amplitude,)


def _alike(*given: np.ndarray) -> tuple[np.ndarray, ...]:
    count = max(each.size for each in given)
    if any(each.size not in (1, count) for each in given):
        raise ArgumentError(f"give one number for all, or as many of each: {count}")
    return tuple(np.broadcast_to(each, count) for each in given)
