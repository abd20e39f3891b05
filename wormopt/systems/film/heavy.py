"""Floats of finite mass on a given wave, which do not change it, as a Model."""

from __future__ import annotations

import math

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.film.float import body_velocity, checked_lengths, finite, lifted, overtaken
from wormopt.systems.film.shapes import Wave


def heavy_float(
    wave: Wave, *, mass: float, weight: float = 0.0, length: float = 0.0, position: float = 0.0
) -> Model:
    """Build the motion of a float of finite mass: m x'' = (mean u_s - x') mean(1/h) - w mean(h_x).

    The fluid's shear on a float that moves at x' is eta (x' - u_s) / h; its weight, which the film
    bears, pushes it down the slope. It bends with the surface, which it does not change.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    mass : float
        Mass per area times omega d / eta, above 0: the time in which it takes the fluid's velocity.
    weight : float, optional
        Weight per area times (k d)² / (eta omega), 0 or above.
    length : float, optional
        Of the float, 0 for a small one, below 2 pi.
    position : float, optional
        Place of its middle at time 0, where it rests.

    Returns
    -------
    Model
        States ``position``, ``velocity``, and since the start ``work`` and ``impulse`` of all
        forces, over the length; output ``phase`` t - x. Switches as in `floating`.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Examples
    --------
    >>> import wormopt as wo
    >>> wo.film.heavy_float(wo.film.CosineWave(0.5), mass=0.1, weight=0.2).n_x
    4
    """
    span, place = checked_lengths(length).item(), finite("position", position).item()
    if not (0 < mass < math.inf and 0 <= weight < math.inf):
        raise ArgumentError(f"mass must be above 0 and weight 0 or above, not {mass}, {weight}")
    symbolic, parameters = lifted(wave)
    t, x, v = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("v")
    xi = t - x
    if span:
        inverse = symbolic.inverse(xi, span)
        rise = symbolic.height(xi + span / 2) - symbolic.height(xi - span / 2)
        slope = -rise / span
    else:
        inverse, slope = 1 / symbolic.height(xi), -symbolic.height(xi, 1)
    shear = (body_velocity(symbolic, xi, span) - v) * inverse
    force = shear - weight * slope
    states = ca.vertcat(x, v, ca.SX.sym("work"), ca.SX.sym("impulse"))
    return Model(
        "heavy float on a film",
        x=[
            Signal("position", x, "length", value=place),
            Signal("velocity", v, "speed", value=0.0),
            Signal("work", states[2], "1", value=0.0),
            Signal("impulse", states[3], "1", value=0.0),
        ],
        ode=ca.vertcat(v, force / mass, force * v, force),
        p=parameters,
        t=t,
        outputs=[Output("phase", xi, "angle")],
        switches=overtaken("float", xi, states),
    )
