"""Changes of Models: integrals as states, and drag as an ordinary force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from wormopt.model.friction import Viscous
from wormopt.model.model import Model, Signal, pack

_POWER = "_power"


def with_integrals(model: Model, states: Sequence[Signal], rates: Sequence[ca.SX]) -> Model:
    """Add states with given rates, which switches do not change."""
    own = pack(states)
    return replace(
        model,
        x=[*model.x, *states],
        ode=ca.vertcat(model.ode, *rates),
        switches=[replace(s, reset=ca.vertcat(s.reset, own)) for s in model.switches],
    )


def measure_works(model: Model, nominal: float) -> Model:
    """Add states ``<name>_work`` that integrate the outputs ``<name>_power``."""
    powers = {o.name: o.expression for o in model.outputs if o.name.endswith(_POWER)}
    names = [name.removesuffix(_POWER) + "_work" for name in powers]
    states = [Signal(name, ca.SX.sym(name), "energy", nominal, value=0.0) for name in names]
    return with_integrals(model, states, [*powers.values()])


def drags_in_ode(model: Model) -> Model:
    """Return the worm with linear drag as an ordinary force, and then without outputs of it."""
    drags = [c for c in model.contacts if isinstance(c.law, Viscous)]
    if not drags:
        return model
    forces = [c.law.slip_force(c.velocity, 1) for c in drags]  # type: ignore[union-attr,call-arg]
    symbols = ca.vertcat(*(c.force for c in drags))
    ode = ca.substitute(model.ode, symbols, ca.vertcat(*forces))
    kept = [c for c in model.contacts if not isinstance(c.law, Viscous)]
    return replace(model, ode=ode, contacts=kept, outputs=())
