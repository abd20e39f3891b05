"""The worm with spikes under a known gait (eq. 7) as a Model, to fit its masses, drag and load.

While any mass rests, the gait alone determines which ones do; this is a schedule. The only state
left is the common velocity w of a glide, on one spike for all masses.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from wormopt.control.loop import gait_reference
from wormopt.errors import ArgumentError
from wormopt.model.friction import Spike
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.schedule import Schedule
from wormopt.systems.shared.parameters import parameter
from wormopt.systems.spiked.stretches import Drive, at_breaks, kinematic_stretches

# A smaller jump of a rate, as a share of the largest rate, is rounding.
_NO_CORNER = 1e-9


def driven_worm(gait: Gait, mass: float | Sequence[float], drag: float, load: float) -> Model:
    """Build the bimodal system of a gait that repeats from time 0, where the worm is at rest.

    Parameters
    ----------
    gait : Gait
        Link lengths over a period, without corners.
    mass : float or sequence of float, shape (n+1,)
        Point masses, head first.
    drag, load : float
        Viscous drag k and load Gamma on every mass.

    Returns
    -------
    Model
        States are ``position`` of the head and ``glide`` w; parameters are ``mass``, ``drag`` and
        ``load``. Outputs are ``velocity`` (n+1), ``spike_load`` (sum of all spikes),
        ``actuator_force`` (n) and ``length`` (n). Resting masses share the load equally.

    Raises
    ------
    ArgumentError
        If the gait has a corner, where forces are impulses, or if a mass is not positive.
    """
    n = gait.links
    drive = Drive(gait, np.ones(n + 1), 0.0, 0.0, "equal")
    after, before = at_breaks(gait, 1)
    if np.abs(after - before).max() > _NO_CORNER * drive.rate_scale:
        raise ArgumentError("the gait has corners, where forces are impulses; round the corners")
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
    """Shares of the load of all masses while the worm does not glide, as a schedule (n+1)."""
    gait, masses = drive.gait, len(drive.mass)
    stretches = kinematic_stretches(drive)
    shares = np.zeros((len(stretches), masses))
    for row, stretch in zip(shares, stretches, strict=True):
        row[list(stretch.resting)] = 1 / len(stretch.resting)
    begins = [gait.breaks[stretch.piece] + stretch.start for stretch in stretches]
    symbol, begin = ca.SX.sym("resting", masses), ca.SX.sym("resting_begin")
    breaks = np.append(begins, gait.period)
    return Schedule("resting", symbol, begin, breaks, shares, periodic=True)
