"""Models that several files of this folder average."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.friction import Coulomb, Law
from wormopt.model.model import Contact, Model, Signal, pack
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values

EPS, OMEGA = 0.01, math.sqrt(2)

COULOMB = Coulomb(0.5 * EPS, 1.0 * EPS)


def rates_of(model: Model, **p: Any) -> Callable[[Sequence[float]], np.ndarray]:
    """Right-hand side of an averaged model as a function of its states."""
    assert not model.contacts
    assert not model.schedules
    function = ca.Function("rates", [pack(model.x), pack(model.p)], [model.ode])
    values = signal_values(model.p, p, "parameter")
    return lambda x: np.array(function(x, values)).ravel()


def steps(break_at: float, span: float) -> Schedule:
    """1, then -1."""
    c, begin = ca.SX.sym("c"), ca.SX.sym("begin")
    breaks, values = np.array([0.0, break_at, span]), np.array([[1.0], [-1.0]])
    return Schedule("push", c, begin, breaks, values, periodic=True)


def smooth(ode: Callable[..., Any], names: str, eps: float = EPS) -> Model:
    """A model without contacts, x' = eps f(x, t)."""
    t, *x = (ca.SX.sym(name) for name in ("t", *names.split()))
    rates = ca.vertcat(*ode(*x, t, ca))
    return Model("smooth", x=[Signal(str(s), s) for s in x], ode=eps * rates, t=t)


def slopes_of(model: Model) -> Callable[[Sequence[float]], np.ndarray]:
    x = pack(model.x)
    function = ca.Function("slopes", [x, pack(model.p)], [ca.jacobian(model.ode, x)])
    values = signal_values(model.p, None, "parameter")
    return lambda state: np.array(function(state, values))


def differences(rates: Callable[[Any], np.ndarray], x: np.ndarray, h: float = 1e-4) -> np.ndarray:
    """Derivatives by central differences of fourth order."""
    columns = []
    for k in range(len(x)):
        e = np.eye(len(x))[k] * h
        near, far = rates(x + e) - rates(x - e), rates(x + 2 * e) - rates(x - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


def block(law: Law = COULOMB, velocity: Any = None, ode: Any = None, **more: Any) -> Model:
    t, v, f = (ca.SX.sym(n) for n in ("t", "v", "f"))
    speed = v + ca.cos(t) if velocity is None else velocity(v, t)
    rate = f if ode is None else ode(v, t, f)
    contacts = [Contact("block", speed, f, law)]
    return Model("a block", x=[Signal("v", v)], ode=rate, t=t, contacts=contacts, **more)


def scheduled(velocity: bool, periodic: bool = True, span: float = 2 * np.pi) -> Model:
    push = replace(steps(0.4 * span, span), periodic=periodic)
    c = push.symbol
    if velocity:
        return block(velocity=lambda v, t: v + c * ca.cos(t), schedules=[push])
    return block(ode=lambda v, t, f: f + EPS * c, schedules=[push])
