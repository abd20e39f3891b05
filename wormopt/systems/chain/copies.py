"""Several copies of one model with common inputs, each with its own parameters."""

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
    """Combine copies of a model that share their inputs and have different parameters.

    An input that is good for all copies is robust for a worm with uncertain parameters.

    Parameters
    ----------
    model : Model
        Model without switches, schedules, delays and algebraic variables.
    draws : sequence of mapping of str to array_like
        For each copy, the parameters by name that differ from the model's values.

    Returns
    -------
    Model
        States, outputs and contacts have the names "position [0]", "position [1]" and so on. Inputs
        keep the model's names. Parameter values are constants in the expressions.

    Raises
    ------
    ArgumentError
        If `draws` is empty, a parameter does not fit, or the model has parts that cannot be copied.

    Examples
    --------
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(1, mass=1.0, stiffness=9.0, damping=1.0, rest_length=2.0)
    >>> [s.name for s in scenario_model(worm, [{}, {"stiffness": 11.0}]).x]
    ['position [0]', 'velocity [0]', 'position [1]', 'velocity [1]']
    """
    if not draws:
        raise ArgumentError(
            "draws is empty; write at least one mapping of parameters, {} for the model's own "
            "values"
        )
    model.refuse_delays("a copy")
    if model.switches or model.schedules or model.z:
        raise ArgumentError(
            f"{model.name} has switches, schedules or algebraic variables, which cannot be copied"
        )
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
    """One copy: new symbols for states and forces, values for parameters."""
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
    """The law with its symbols replaced by values."""
    numbers = {name: float(ca.DM(put(v))) for name, v in symbols_of(law).items()}
    return replace(cast(Any, law), **numbers)


def _fresh(symbol: ca.SX) -> ca.SX:
    return ca.SX.sym("copy", symbol.numel())


def numbers_of(model: Model) -> dict[str, np.ndarray]:
    """Parameter values of a model by name."""
    return {s.name: np.array(s.value, dtype=float) for s in model.p}


VARIED = ("mass", "stiffness", "damping", "friction_forward", "friction_backward")
"""Parameters of a chain that are drawn."""


def draw_factors(
    own: Mapping[str, np.ndarray],
    spread: float | Mapping[str, float],
    random: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Factors for the parameters of another worm, uniform within ± `spread` of 1."""
    shares = spread if isinstance(spread, Mapping) else dict.fromkeys(VARIED, spread)
    return {
        name: random.uniform(1 - share, 1 + share, own[name].shape)
        for name, share in shares.items()
        if name in own
    }


def drawn_plants(
    plant: Model, spread: float | Mapping[str, float], seed: int, members: int
) -> list[Draw]:
    """Drawn parameters of plants, one draw per member.

    A draw does not depend on the number of members. Stiction varies with the sliding force of its
    direction. Raises ArgumentError if the plant lacks a parameter of `spread`, or its value.
    """
    own, found = numbers_of(plant), []
    for name in spread if isinstance(spread, Mapping) else ():
        if name not in own:
            raise ArgumentError(
                f"{plant.name} has no parameter {name!r} to draw; its parameters are "
                f"{', '.join(own) or 'none'}"
            )
        if not np.all(np.isfinite(own[name])):
            raise ArgumentError(f"the parameter {name} of {plant.name} has no value to draw around")
    for member in range(members):
        factors = draw_factors(own, spread, np.random.default_rng([seed, member]))
        factors |= {
            f"friction_stick_{side}": factors[f"friction_{side}"]
            for side in ("forward", "backward")
            if f"friction_stick_{side}" in own and f"friction_{side}" in factors
        }
        found.append({name: own[name] * factor for name, factor in factors.items()})
    return found
