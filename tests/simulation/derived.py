"""Motions that several files of this folder differentiate."""

from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.simulation.trajectory import Event


def block(pull: Any = 0.0, *, speed: float = 2.0, stiction: float = 2.0) -> Model:
    """A mass on ground that lets go at `stiction` times its friction; `pull` of (t, load)."""
    t, x, v, f = (ca.SX.sym(name) for name in ("t", "x", "v", "f"))
    m, friction, load = (ca.SX.sym(name) for name in ("m", "F", "load"))
    law = Coulomb(friction, friction, stiction * friction, stiction * friction)
    force: Any = pull(t, load) if callable(pull) else pull
    return Model(
        "block",
        [Signal("position", x, value=0.0), Signal("velocity", v, value=speed)],
        ca.vertcat(v, (f + force) / m),
        t=t,
        p=[
            Signal("mass", m, value=3.0),
            Signal("friction", friction, value=1.5),
            Signal("load", load, value=0.25),
        ],
        outputs=[Output("energy", m * v**2 / 2), Output("force", f)],
        contacts=[Contact("block", v, f, law)],
    )


def changes(event: Event) -> np.ndarray:
    """Derivatives of an event's time."""
    assert event.derivative is not None
    return event.derivative
