"""Models that several files of this folder simulate on all routes, and how motions are compared."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.friction import Law
from wormopt.model.model import Model, Signal, Switch
from wormopt.simulation.options import Route, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.build import chain

SHARP = Tolerance(1e-12, 1e-13)

STEPPING: list[Route] = ["native", "python"]

ALL: list[Route] = ["native", "python", "cvodes"]


def shaken(worm: Model, force: ca.SX) -> Model:
    """A chain under given actuator forces, expressions of time."""
    ode = ca.substitute(worm.ode, worm.u[0].symbol, force)
    return replace(worm, ode=ode, u=(), outputs=())


def sine_worm(law: Law | list[Law], size: float = 6.0) -> Model:
    worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=law)
    return shaken(worm, size * ca.sin(2 * np.pi * worm.t / 3 - ca.DM([0.0, 2.0])))


def listed(motion: Trajectory) -> list[tuple[str, str, int]]:
    return [(event.name, event.kind, event.mode) for event in motion.events]


def event_times(motion: Trajectory) -> np.ndarray:
    return np.array([event.time for event in motion.events])


def attempted(
    model: Model, span: float | tuple[float, float], **options: Any
) -> tuple[Trajectory, str]:
    """A motion as far as it goes, and why it ends early if it does."""
    try:
        return simulate(model, span, **options), ""
    except SolveError as error:
        return error.partial, error.code


def scalar(rate: str) -> Model:
    x = ca.SX.sym("x")
    ode = {"x^2": x**2, "-1/sqrt x": -1 / ca.sqrt(x), "x": x}[rate]
    return Model(rate, x=[Signal("x", x, value=1.0)], ode=ode)


def bouncing_ball() -> Model:
    y, v = ca.SX.sym("y"), ca.SX.sym("v")
    bounce = Switch("bounce", -y, ca.vertcat(0, -0.8 * v))
    states = [Signal("height", y, value=1.0), Signal("velocity", v, value=0.0)]
    return Model("ball", x=states, ode=ca.vertcat(v, -2.0), switches=[bounce])
