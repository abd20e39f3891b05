"""Compliant walls: turns a Model with gaps into one for implicit integrators.

The normal force N of a contact with the gap g is tied to it by an algebraic equation,

    N (N / k + g + tau g') = epsilon,  N > 0,

a smoothed complementarity: N (g + tau g') = 0 in the limit of great stiffness k and small epsilon.
Walls do not pull. They give way by N / k. What comes near is braked from the distance tau |g'| on,
and what has entered leaves with the time constant tau; a mass m does not come back from an impact
where k tau² > 4 m. So tau must be short against the vibrations of what hits; then impacts tend to
those of restitution 0, which are those of `wormopt.simulation.moreau`. A wall that is far pushes
with epsilon / g.

Sources: A. Fischer, Optimization 24 (1992) 269 for smoothed complementarity; B. Brogliato,
Nonsmooth Mechanics (2016), 2.1 for walls that give way.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import TINY, Contact, Model, Output, Signal, pack


def smooth_walls(model: Model, stiffness: float, *, smoothing: float, relaxation: float) -> Model:
    """Replace the rigid walls of a model by elastic ones.

    Parameters
    ----------
    model : Model
        Its contacts with gaps have normal forces; gaps depend on states alone.
    stiffness : float
        k, force per depth in the wall.
    smoothing : float
        epsilon, force times gap of a wall that is not touched.
    relaxation : float
        tau, time constant with which gaps close and open again; 0 for walls that take no energy.

    Returns
    -------
    Model
        Without gaps: normal forces are the algebraic variables ``wall_force``, friction laws are
        unchanged. The three values are the parameters ``wall_stiffness``, ``wall_smoothing`` and
        ``wall_relaxation``. Simulate it with smooth friction.

    Raises
    ------
    ArgumentError
        If a number is out of range, there is no gap, or a gap has no normal force or depends on
        more than states.

    Examples
    --------
    A block of mass 1 falls from 0.1 and stays down; its weight is 1 and the wall gives way by it:

    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.simulation.options import Smooth, Tolerance
    >>> from wormopt.simulation.simulate import simulate
    >>> y, v, force, N = (ca.SX.sym(name) for name in ("y", "v", "force", "N"))
    >>> floor = Contact("floor", ca.SX(0), force, Coulomb(N, N), gap=y, normal_force=N)
    >>> states = [Signal("height", y, value=0.1), Signal("speed", v, value=0.0)]
    >>> block = Model("block", states, ca.vertcat(v, N - 1), contacts=[floor])
    >>> soft = smooth_walls(block, 1e4, smoothing=1e-8, relaxation=0.1)
    >>> motion = simulate(soft, 3.0, contact=Smooth(1e-3), tolerance=Tolerance(1e-8, 1e-10))
    >>> float(motion.end[0].round(6)), motion.route
    (-0.0001, 'idas')
    """
    numbers = _numbers({"stiffness": stiffness, "smoothing": smoothing, "relaxation": relaxation})
    walls = [contact for contact in model.contacts if contact.gap is not None]
    if not walls:
        raise ArgumentError(f"{model.name} has no walls: no contact has a gap")
    pressed = ca.vertcat(*(_pressed(contact) for contact in walls))
    force = _force(model, walls, *(signal.symbol for signal in numbers))
    size = max(contact.nominal_force for contact in walls)
    return replace(
        model,
        name=f"{model.name} between elastic walls",
        z=[*model.z, Signal("wall_force", pressed, "force", size, value=0.0)],
        alg=ca.vertcat(model.alg, pressed - force),
        p=[*model.p, *numbers],
        outputs=[*model.outputs, Output("wall_force", force, "force")],
        contacts=[replace(contact, gap=None, normal_force=None) for contact in model.contacts],
    )


def _numbers(values: dict[str, float]) -> list[Signal]:
    kinds = {
        "stiffness": ("stiffness", TINY),
        "smoothing": ("energy", TINY),
        "relaxation": ("time", 0.0),
    }
    found = []
    for name, value in values.items():
        unit, lower = kinds[name]
        label = f"wall_{name}"
        if not value < math.inf:
            raise ArgumentError(f"{label} must be finite, not {value!r}")
        signal = Signal(label, ca.SX.sym(label), unit, lower=lower, value=value)
        signal.check(np.array([value]))
        found.append(signal)
    return found


def _pressed(contact: Contact) -> ca.SX:
    if contact.normal_force is None:
        raise ArgumentError(f"contact {contact.name} has a gap; write its normal_force")
    return contact.normal_force


def _force(model: Model, walls: list[Contact], k: ca.SX, epsilon: ca.SX, tau: ca.SX) -> ca.SX:
    """Positive root of the equation for the normal forces."""
    x = pack(model.x)
    gaps = ca.vertcat(*(contact.gap for contact in walls if contact.gap is not None))
    rates = ca.jtimes(gaps, x, model.ode)
    others = [model.t, pack(model.u), model.forces, pack(model.z)]
    pressed = [_pressed(contact) for contact in walls]
    if ca.depends_on(ca.vertcat(gaps, rates), ca.vertcat(*others, *pressed)):
        raise ArgumentError(f"{model.name}: gaps and their rates must depend on states alone")
    near = -(gaps + tau * rates)
    root = ca.sqrt(near**2 + 4 * epsilon / k)
    larger = k * (root + ca.fabs(near)) / 2
    # the product of both roots is -k epsilon: no digits are lost
    return ca.if_else(near > 0, larger, k * epsilon / larger)
