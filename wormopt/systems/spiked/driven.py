"""The worm with spikes under a known gait, (7), as a Model of which masses, drag, load are fitted.

The gait alone decides which masses rest while any does: it is a schedule. What is left to move is
the common velocity w of a glide, on one spike that stands for all.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from wormopt.control.reference import gait_reference
from wormopt.errors import ArgumentError
from wormopt.model.friction import Spike
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.schedule import Schedule
from wormopt.systems.shared.parameters import parameter
from wormopt.systems.spiked.stretches import Drive, at_breaks, kinematic_stretches

# A rate that jumps by less, as a share of the largest one, does not jump.
_NO_CORNER = 1e-9


def driven_worm(gait: Gait, mass: float | Sequence[float], drag: float, load: float) -> Model:
    """Build the bimodal system (7) of a gait that repeats from time 0 on, at rest there.

    Parameters
    ----------
    gait : Gait
        Link lengths over a period, without corners.
    mass : float or sequence of float, shape (n+1,)
        Point masses.
    drag, load : float
        Viscous drag k and load Gamma on every mass.

    Returns
    -------
    Model
        States ``position`` of the head and ``glide`` w; parameters ``mass``, ``drag``, ``load``;
        outputs ``velocity`` (n+1), ``spike_load`` (of all spikes together), and
        ``actuator_force`` and ``length`` (n each). Masses that rest together share the load
        equally.

    Raises
    ------
    ArgumentError
        If the gait has a corner, where forces are impulses, or a mass is not positive.
    """
    n = gait.links
    drive = Drive(gait, np.ones(n + 1), 0.0, 0.0, "equal")
    after, before = at_breaks(gait, 1)
    if np.abs(after - before).max() > _NO_CORNER * drive.rate_scale:
        raise ArgumentError("the gait has corners, where forces are impulses; round them")
    t = ca.SX.sym("t")
    course, resting = gait_reference(gait, t), _resting(drive)
    m, k, gamma = (
        parameter("mass", mass, n + 1, "mass"),
        parameter("drag", drag, 1, "drag"),
        parameter("load", load, 1, "force"),
    )
    position, w, spikes = ca.SX.sym("position"), ca.SX.sym("glide"), ca.SX.sym("spikes")

    rate = ca.vertcat(0, ca.cumsum(course.rate))  # S_i', (2)
    bend = ca.vertcat(0, ca.cumsum(course.acceleration))
    held = ca.dot(resting.symbol, rate) - rate
    velocity = held + w
    turning = ca.dot(resting.symbol, bend) - bend
    needed = ca.dot(m.symbol, turning) + k.symbol * ca.sum1(velocity) + (n + 1) * gamma.symbol
    slope = (spikes - needed) / ca.sum1(m.symbol)
    # from the head down, (3): mu_{i+1} = mu_i + lambda_i - k v_i - Gamma - m_i v_i'
    surplus = (
        spikes * resting.symbol - k.symbol * velocity - gamma.symbol - m.symbol * (turning + slope)
    )
    force = (n + 1) * (float(np.mean(mass)) * drive.force_scale + load)
    return Model(
        name=f"worm of {n} links under a gait",
        x=[
            Signal("position", position, "length", drive.rate_scale * gait.period, value=0.0),
            Signal("glide", w, "speed", drive.rate_scale, value=0.0),
        ],
        ode=ca.vertcat(velocity[0], slope),
        p=[m, k, gamma],
        t=t,
        outputs=[
            Output("velocity", velocity, "speed"),
            Output("spike_load", spikes, "force"),
            Output("actuator_force", ca.cumsum(surplus)[:n], "force"),
            Output("length", course.value, "length"),
        ],
        contacts=[Contact("worm", w, spikes, Spike(scale=force), force, drive.rate_scale)],
        schedules=[*course.schedules, resting],
    )


def _resting(drive: Drive) -> Schedule:
    """How the masses share the load while the worm does not glide, (n+1) shares at a time."""
    gait, masses = drive.gait, len(drive.mass)
    stretches = kinematic_stretches(drive)
    shares = np.zeros((len(stretches), masses))
    for row, stretch in zip(shares, stretches, strict=True):
        row[list(stretch.resting)] = 1 / len(stretch.resting)
    begins = [gait.breaks[stretch.piece] + stretch.start for stretch in stretches]
    symbol, begin = ca.SX.sym("resting", masses), ca.SX.sym("resting_begin")
    breaks = np.append(begins, gait.period)
    return Schedule("resting", symbol, begin, breaks, shares, periodic=True)
