"""Models that several files of this folder simulate."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, Signal
from wormopt.simulation.options import Route
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain


def actuated(worm: Model, command: ca.SX) -> Model:
    """The chain with u_j = c_j times a commanded change of rest length, (11)."""
    u, (c,) = worm.u[0].symbol, [s.symbol for s in worm.p if s.name == "stiffness"]

    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, u, c * command)

    outputs = [replace(o, expression=put(o.expression)) for o in worm.outputs]
    return replace(worm, ode=put(worm.ode), u=(), outputs=outputs)


def crawler(stiffness: float = 20.0, **options: float) -> Model:
    """Three masses whose links swing a third of a period apart; masses rest for a while."""
    law = Coulomb(1.0, 10.0)
    worm = chain(2, mass=1.0, stiffness=stiffness, damping=2.0, rest_length=2.0, law=law)
    t = worm.t
    phases = ca.DM([0.0, 2 * np.pi / 3])
    return actuated(worm, options.get("stroke", 0.5) * ca.sin(2 * np.pi * t / 3 - phases))


def oscillator() -> Model:
    x = ca.SX.sym("x", 2)
    return Model("circle", x=[Signal("x", x, value=(1.0, 0.0))], ode=ca.vertcat(x[1], -x[0]))


def refused(model: Model, span: float, route: Route = "auto", **options: Any) -> SolveError:
    with pytest.raises(SolveError) as caught:
        simulate(model, span, route=route, **options)
    assert caught.value.suggestion
    return caught.value
