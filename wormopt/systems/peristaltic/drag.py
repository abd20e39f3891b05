"""A peristaltic worm on linear drag: its law, its Model, and the displacement of a gait.

Segment j of N lies behind segment j - 1. The drag on it is c(l_j) times the velocity of its centre,
c(l) = c0 (l / L)^a. There is no other force and no mass, so the drags of all segments sum to zero
at every instant, and the velocity is linear in the rates of the lengths.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import TINY, Model, Output, Signal

# Gauss points on each part of a piece, and number of parts of polynomial and harmonic pieces.
_POINTS, _PARTS, _HARMONIC = 16, 2, 16


def centres(segments: int) -> np.ndarray:
    """Return the matrix S (N, N) from lengths, head first, to places of centres less their mean."""
    behind = _behind(segments)
    return behind - behind.mean(axis=0)


def rings(position: ca.SX, lengths: ca.SX) -> ca.SX:
    """Return places (N + 1, 1) of the rings, head first, from mean centre and lengths."""
    head = position - ca.dot(ca.DM(_behind(lengths.numel()).mean(axis=0)), lengths)
    return ca.vertcat(head, head - ca.cumsum(lengths))


def _behind(segments: int) -> np.ndarray:
    """Return the matrix (N, N) from lengths to places of centres relative to the head's."""
    return -np.tril(np.ones((segments, segments)), -1) - np.eye(segments) / 2


def drift(coefficients: ca.SX, rates: ca.SX) -> ca.SX:
    """Return the velocity of the mean centre at which the drags of all segments sum to zero."""
    swing = ca.mtimes(ca.DM(centres(rates.numel())), rates)
    return -ca.dot(coefficients, swing) / ca.sum1(coefficients)


def drag_worm(
    segments: int,
    exponent: float,
    *,
    length: float = 1.0,
    drag: float = 1.0,
    total: float | None = None,
    least: float = TINY,
    most: float = float("inf"),
    time_nominal: float = 1.0,
    strain: float = 1.0,
) -> Model:
    """Build the Model of a worm on drag, with the rates of its lengths as inputs.

    States are ``length`` (of all segments, or all but the last if the `total` length is constant)
    and ``position``, the mean of all centres. The input is ``rate``, of the same segments. Outputs
    are ``lengths`` and ``rates`` of all segments, ``strain_power`` sum (l' / L)^2, and
    ``dissipation`` with the drag of a segment spread along it: sum c (v^2 + l'^2 / 12). The
    parameter ``exponent`` is a.

    Theory: docs/theory-peristaltic.md, section 4.

    Parameters
    ----------
    segments : int
        Number of segments N.
    exponent : float
        Exponent a of the drag law c0 (l / L)^a.
    length, drag : float, optional
        L and c0.
    total : float, optional
        Constant length of the whole worm; free if left out.
    least, most : float, optional
        Bounds of the lengths.
    time_nominal, strain : float, optional
        Usual time and usual strain, by which solvers scale.

    Returns
    -------
    Model
        With one state less if the total length is constant.

    Raises
    ------
    ArgumentError
        If there are fewer than two segments, or a length or drag is not positive.

    Examples
    --------
    >>> model = drag_worm(3, exponent=1.0, total=3.0)
    >>> [signal.size for signal in model.x], model["lengths"].numel()
    ([2, 1], 3)
    """
    if segments < 2 or not min(length, drag, total or 1.0) > 0:
        raise ArgumentError("a worm on drag needs two or more segments, length and drag above 0")
    free = segments - (total is not None)
    own, rate = ca.SX.sym("length", free), ca.SX.sym("rate", free)
    a, x = ca.SX.sym("exponent"), ca.SX.sym("position")
    lengths, rates = own, rate
    if total is not None:
        lengths = ca.vertcat(own, total - ca.sum1(own))
        rates = ca.vertcat(rate, -ca.sum1(rate))
    coefficients = drag * (lengths / length) ** a
    speed = drift(coefficients, rates)
    velocities = speed + ca.mtimes(ca.DM(centres(segments)), rates)
    lost = ca.dot(coefficients, velocities**2 + rates**2 / 12)
    return Model(
        f"worm of {segments} segments on drag",
        x=[
            Signal("length", own, "length", strain * length, least, most, value=length),
            Signal("position", x, "length", strain**2 * length, value=0.0),
        ],
        ode=ca.vertcat(rate, speed),
        u=[Signal("rate", rate, "speed", strain * length / time_nominal, value=0.0)],
        p=[Signal("exponent", a, "1", value=exponent)],
        outputs=[
            Output("lengths", lengths, "length"),
            Output("rates", rates, "speed"),
            Output("speed", speed, "speed"),
            Output("strain_power", ca.sumsqr(rates) / length**2, "rate_change"),
            Output("dissipation", lost, "power"),
        ],
    )


def displacement(gait: Gait, exponent: float) -> float:
    """Return the displacement of a gait per period, by Gauss' rule on its pieces.

    Parameters
    ----------
    gait : Gait
        Lengths of all segments, head first.
    exponent : float
        Exponent a, the only parameter of the drag law that matters.

    Returns
    -------
    float
        Displacement of the mean of all centres, forward positive.

    Examples
    --------
    >>> from wormopt.systems.peristaltic.drag_gaits import small_gaits
    >>> wave = small_gaits(3, 1.0, fixed_total=True)[0]
    >>> effort = 2 * np.pi**2 * 0.3**2 * 3
    >>> round(displacement(wave.gait(effort), 1.0), 10)
    0.0816209714
    """
    model = drag_worm(gait.links, exponent)
    symbols = [model["length"], model["rate"], model["exponent"]]
    velocity = ca.Function("velocity", symbols, [model["speed"]])
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    parts = _PARTS if gait.omega is None else _HARMONIC
    s = ((np.arange(parts)[:, None] + (nodes + 1) / 2) / parts).ravel()
    moved = 0.0
    for piece, begin, end in zip(range(gait.pieces), gait.breaks, gait.breaks[1:], strict=False):
        lengths, rates = (gait.on_piece(piece, s * (end - begin), order) for order in (0, 1))
        v = np.asarray(velocity(lengths, rates, exponent)).ravel()
        moved += (end - begin) / (2 * parts) * float(np.tile(weights, parts) @ v)
    return float(moved)
