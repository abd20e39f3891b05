"""Tracking by a piecewise constant gain: each trial has its time and its bound."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.loop import (
    Actuator,
    FeedForward,
    Reference,
    TrackingError,
    actuated,
    check_sign,
    close,
)
from wormopt.errors import ArgumentError
from wormopt.model.given import check_number
from wormopt.model.model import TINY, Model, Output, Signal, Switch
from wormopt.model.values import numbers_of


def switching_tracker(
    plant: Model,
    reference: Reference,
    *,
    tube_radius: float,
    settling: float,
    overshoot: float,
    gain_start: float = 1.0,
    factor: float = 2.0,
    filter_start: ArrayLike | None = None,
    actuator: Actuator = "force",
    feedforward: FeedForward | None = None,
    output: str = "length",
    input: str = "input",  # noqa: A002
) -> Model:
    """Close the loop by a linear compensator whose gain jumps up until it is high enough.

    In the manner of Miller and Davison (IEEE Trans. Autom. Control 36(1), 68-81, 1991): a
    mechanism switches between linear compensators for minimum-phase plants, so that the error is
    within the tube after a prescribed time, with a prescribed overshoot, both as small as
    required. The paper was not available; this follows descriptions of it in other papers.

    Trial i = 0, 1, ... begins at t_i with k = gain_start factor^i and the compensator theta' = k^2
    (e - theta), u = -(k^2 theta + k theta'): in the limit of high gain e'' + k e' + k^2 e = 0
    times the high-frequency gain, which settles at a rate proportional to k. Its bound on |e| is
    b_i = max(|e(t_i)|, lambda) + delta_i until t_i + T_i, then lambda. Where |e| leaves the bound
    the next trial begins. With q = factor^(-1/2), T_i = settling (1 - q) q^i and delta_i =
    overshoot (1 - q) q^i sum to the prescribed values, and k_i T_i is unbounded. So |e|
    never exceeds max(|e(0)|, lambda) + overshoot, and is outside of the tube for no longer than
    ``settling`` in all.

    Parameters
    ----------
    plant : Model
        With an input and an output of relative degree two, of as many entries.
    reference : Reference
        Reference of the output.
    tube_radius : float
        Radius lambda of the tube, positive.
    settling : float
        Settling time of all trials together, positive.
    overshoot : float
        By how much |e| may exceed its start, or lambda, at most; positive.
    gain_start : float, optional
        Gain of the first trial, positive.
    factor : float, optional
        Ratio of each gain to the previous one, above 1.
    filter_start : array_like, shape (n,), optional
        The compensator's theta at the start; the error then, if left out.
    actuator : {"force", "rest_length"}, optional
        Whether u above is the force itself, or by (11) moves the rest lengths: the force is then
        c_j times u_j, with the plant's own ``stiffness`` c.
    feedforward : FeedForward, optional
        Force added to the tracker's.
    output, input : str, optional
        Names of the plant's output or state that follows the reference, and of the input.

    Returns
    -------
    Model
        States: the plant's, ``gain``, ``filter`` (n), and of the trial ``trial_bound``,
        ``trial_end``, ``trial_time`` and ``trial_margin``. Switches: "trial settles" and "trial
        fails". Parameters: the plant's, ``tube_radius``, ``gain_factor`` and those of the
        feed-forward. Outputs: the plant's, ``reference``, ``error``, ``error_norm`` and the input
        under its name.

    Raises
    ------
    ArgumentError
        If a number is out of range, the plant does not say where it starts, it has no such output
        or input, sizes of plant and reference differ, forces act on the output's rate at once, or
        the input accelerates the output in the wrong direction.

    Examples
    --------
    >>> from wormopt.model.gait import Gait
    >>> from wormopt.control.loop import gait_reference
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, drag=0.1,
    ...              position=(4.0, 2.0, 0.0))
    >>> still = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.5))
    >>> loop = switching_tracker(
    ...     worm, gait_reference(still, worm.t), tube_radius=0.2, settling=1.0, overshoot=0.1
    ... )
    >>> [switch.name for switch in loop.switches]
    ['trial settles', 'trial fails']
    """
    check_number("tube_radius", tube_radius, above=0.0)
    check_number("settling", settling, above=0.0)
    check_number("overshoot", overshoot, above=0.0)
    check_number("gain_start", gain_start, above=0.0)
    check_number("factor", factor, above=1.0)
    error = TrackingError.of(plant, reference, output)
    check_sign(plant, output, input)
    start = error.at_start(plant, reference)
    if start is None:
        raise ArgumentError(f"{plant.name} needs initial values, which determine the first bound")
    k, lam, more = ca.SX.sym("gain"), ca.SX.sym("tube_radius"), ca.SX.sym("gain_factor")
    theta = ca.SX.sym("filter", error.value.numel())
    rate = k**2 * (error.value - theta)
    states, switches = _trials(error, k, theta, lam, more, plant.t)
    share = 1 - factor**-0.5
    values = {
        "gain": gain_start,
        "filter": numbers_of(
            "filter_start", start[0] if filter_start is None else filter_start, theta.numel()
        ),
        "trial_bound": max(float(np.linalg.norm(start[0])), tube_radius) + share * overshoot,
        "trial_end": share * settling,
        "trial_time": share * settling,
        "trial_margin": share * overshoot,
    }
    command = -(k**2 * theta + k * rate)
    force, believed = actuated(plant, reference, command, actuator, feedforward)
    return close(
        plant,
        reference,
        error,
        force,
        name="a switching tracker",
        input=input,
        states=[Signal(s.name, s.symbol, s.unit, value=values[s.name]) for s in states],
        rates=[ca.SX(1, 1), rate, ca.SX(4, 1)],
        parameters=[
            Signal("tube_radius", lam, error.unit, lower=TINY, value=tube_radius),
            Signal("gain_factor", more, lower=1.0, value=factor),
            *believed,
        ],
        outputs=[Output("gain_rate", ca.SX(1, 1))],
        switches=switches,
    )


def _trials(
    error: TrackingError,
    k: ca.SX,
    theta: ca.SX,
    lam: ca.SX,
    factor: ca.SX,
    t: ca.SX,
) -> tuple[list[Signal], list[Switch]]:
    """States of the controller, and the switches between trials."""
    names = ("trial_bound", "trial_end", "trial_time", "trial_margin")
    units = (error.unit, "time", "time", error.unit)
    bound, end, time, margin = own = [ca.SX.sym(name) for name in names]
    shrunk = 1 / ca.sqrt(factor)
    size = ca.fmax(ca.sqrt(error.square), lam)
    # the bound that was left, not the error a rounding error beyond it
    again = ca.vertcat(size + shrunk * margin, t + shrunk * time, shrunk * time, shrunk * margin)
    states = [Signal("gain", k), Signal("filter", theta, error.unit)]
    states += [Signal(n, s, u) for n, s, u in zip(names, own, units, strict=True)]
    switches = [
        Switch("trial settles", t - end, ca.vertcat(k, theta, lam, end, time, margin)),
        Switch("trial fails", error.square - bound**2, ca.vertcat(factor * k, theta, again)),
    ]
    return states, switches
