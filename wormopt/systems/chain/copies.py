"""Several copies of one model that share their inputs, each with numbers of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law, symbols_of
from wormopt.model.model import Contact, Model, Output, pack
from wormopt.model.values import signal_values

Draw = Mapping[str, np.ndarray]
"""Parameters of a plant by name."""


def scenario_model(model: Model, draws: Sequence[Mapping[str, ArrayLike]]) -> Model:
    """Put copies of a model side by side, driven by the same inputs.

    An input that is good for all of them is good for a worm of which the numbers are not known
    well.

    Parameters
    ----------
    model : Model
        Without switches, schedules and algebraic variables.
    draws : sequence of mapping of str to array_like
        Parameters of each copy by name, where they are not the model's own.

    Returns
    -------
    Model
        States, outputs and contacts are named "position [0]", "position [1]" and so on; inputs
        have the model's names; numbers are built in.

    Raises
    ------
    ArgumentError
        If there is no draw, a parameter does not fit, or the model has what cannot be copied.

    Examples
    --------
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(1, mass=1.0, stiffness=9.0, damping=1.0, rest_length=2.0)
    >>> [s.name for s in scenario_model(worm, [{}, {"stiffness": 11.0}]).x]
    ['position [0]', 'velocity [0]', 'position [1]', 'velocity [1]']
    """
    if not draws:
        raise ArgumentError("copies need at least one draw of the parameters")
    model.refuse_delays("a copy")
    if model.switches or model.schedules or model.z:
        raise ArgumentError(f"{model.name} has switches, schedules or algebraic variables")
    made = [_copy(model, draw, k) for k, draw in enumerate(draws)]
    return Model(
        name=f"{len(draws)} copies of {model.name}",
        x=[s for copy in made for s in copy.x],
        ode=ca.vertcat(*(copy.ode for copy in made)),
        u=model.u,
        t=model.t,
        outputs=[o for copy in made for o in copy.outputs],
        contacts=[c for copy in made for c in copy.contacts],
    )


def _copy(model: Model, draw: Mapping[str, ArrayLike], k: int) -> Model:
    """One copy: symbols of its own for states and forces, numbers for parameters."""
    numbers = signal_values(model.p, draw, "parameter")
    old = ca.vertcat(pack(model.p), pack(model.x), model.forces)
    x = [replace(s, name=f"{s.name} [{k}]", symbol=_fresh(s.symbol)) for s in model.x]
    forces = [_fresh(c.force) for c in model.contacts]
    new = ca.vertcat(ca.DM(numbers), pack(x), *forces)

    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, old, new)

    contacts = [
        Contact(
            f"{c.name} [{k}]",
            put(c.velocity),
            force,
            _numbered(c.law, put),
            c.nominal_force,
            c.nominal_speed,
        )
        for c, force in zip(model.contacts, forces, strict=True)
    ]
    outputs = [Output(f"{o.name} [{k}]", put(o.expression), o.unit) for o in model.outputs]
    name = f"{model.name} [{k}]"
    ode = put(model.ode)
    return Model(name, x=x, ode=ode, u=model.u, t=model.t, outputs=outputs, contacts=contacts)


def _numbered(law: Law, put: Callable[[ca.SX], ca.SX]) -> Law:
    """The same law, its symbols replaced by numbers."""
    numbers = {name: float(ca.DM(put(v))) for name, v in symbols_of(law).items()}
    return replace(cast(Any, law), **numbers)


def _fresh(symbol: ca.SX) -> ca.SX:
    return ca.SX.sym("copy", symbol.numel())


def numbers_of(model: Model) -> dict[str, np.ndarray]:
    """Own values of a model's parameters by name."""
    return {s.name: np.array(s.value, dtype=float) for s in model.p}


def draw_factors(
    own: Mapping[str, np.ndarray], spread: float, random: np.random.Generator
) -> dict[str, np.ndarray]:
    """Factors by which each number of another worm differs, uniform within ± `spread` of 1."""
    return {
        name: random.uniform(1 - spread, 1 + spread, own[name].shape)
        for name in ("mass", "stiffness", "damping", "friction_forward", "friction_backward")
        if name in own
    }


def drawn_plants(plant: Model, spread: float, seed: int, members: int) -> list[Draw]:
    """Parameters of plants that are not as believed, one draw per member.

    They do not depend on how many there are. Stiction varies with the sliding force of its
    direction.
    """
    own, found = numbers_of(plant), []
    for member in range(members):
        factors = draw_factors(own, spread, np.random.default_rng([seed, member]))
        factors |= {
            f"friction_stick_{side}": factors[f"friction_{side}"]
            for side in ("forward", "backward")
            if f"friction_stick_{side}" in own
        }
        found.append({name: own[name] * factor for name, factor in factors.items()})
    return found
