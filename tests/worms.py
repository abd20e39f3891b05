"""The worm of docs/verification.md that tests control, its benchmark, and its loops at a point."""

from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.lambda_tracker import Feedback
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.systems.chain.build import chain

# docs/verification.md, trackers: x, v, gain (and the filter) at t = 10
TRACKED: dict[Feedback, list[float]] = {
    "filter": [
        *(13.7293026425339, 12.5129899383629, 11.2234323017047),
        *(1.5442046082437, 1.2147444914821, 0.6496895012235),
        *(17.0537482219161, -0.7848014274676, -0.7122939752036),
    ],
    "derivative": [
        *(13.9905483956915, 12.7643770141827, 11.4656131519066),
        *(1.5265682540374, 1.2068425686835, 0.6714590289857),
        17.4065002539140,
    ],
}


def free_worm(links: int = 2, law: Any = None, **changed: Any) -> Model:
    """A chain on nothing, unless a law is given."""
    usual: dict[str, Any] = {"mass": 1.0, "stiffness": 10.0, "damping": 5.0, "rest_length": 2.0}
    return chain(links, law=law, **(usual | changed))


def worm(links: int = 2, **changed: Any) -> Model:
    """The chain on dry ground."""
    return free_worm(links, **({"law": Coulomb(1.0, 10.0)} | changed))


def point(loop: Model, x: dict[str, Any], reference: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs and ode at given states, the reference's schedule replaced by plain numbers."""
    symbols = [*(s.symbol for s in loop.x), *(p.symbol for p in loop.p), loop.t, loop.forces]
    numbers = [np.array(x[s.name]) for s in loop.x] + [np.array(p.value) for p in loop.p]
    (schedule,) = loop.schedules
    function = ca.Function(
        "f",
        [*symbols, schedule.symbol, schedule.begin],
        [loop.ode, *(o.expression for o in loop.outputs)],
    )
    found = function(*numbers, 0.4, np.zeros(len(loop.contacts)), np.hstack(reference), 0.0)
    names = ["ode", *(o.name for o in loop.outputs)]
    return dict(zip(names, (np.array(f).ravel() for f in found), strict=True))
