"""Averages of the magneto-elastic pair, beside sums over instants and adaptive quadrature."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import IntegrationWarning, quad

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.analysis.average import average
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, pack
from wormopt.model.values import signal_values
from wormopt.systems.pair.slow import averaged_pair, slow_pair

_EPS, _NATURAL = 0.0355, math.sqrt(2)
_NUMBERS: Any = {
    "law": Coulomb(0.5 * _EPS, _EPS), "push": _EPS, "frequency": _NATURAL + 0.5 * _EPS
}  # fmt: skip
_PERIOD = 2 * np.pi / _NUMBERS["frequency"]
_NODES, _SAMPLES = (4, 6, 8, 12, 16), (32, 128, 512, 2048, 8192)
_TOLERANCES = (1e-2, 1e-4, 1e-6)

Rates = Callable[[np.ndarray], np.ndarray]


def task(_name: str, quick: bool) -> Task:
    """Mean rates at random states; `quick`: fewer states, and less accuracy of quadrature."""
    model, random = slow_pair(**_NUMBERS), np.random.default_rng(0)
    states = random.uniform(-1.0, 1.0, (10 if quick else 60, 3))
    closed = _rates(averaged_pair(**_NUMBERS))
    ways = {
        OWN: (_by_nodes, _NODES),
        "samples, CasADi": (_sampled, _SAMPLES),
        "SciPy quad": (_adaptive, _TOLERANCES[: 2 if quick else None]),
    }
    return Task(
        f"mean rates of the pair at {len(states)} states",
        "closed form (18)",
        "rates, over eps",
        "nodes on each piece, samples, tolerance",
        1e-3,
        np.array([closed(x) for x in states]),
        [
            Way(name, partial(_at, states, partial(build, model)), settings)
            for name, (build, settings) in ways.items()
        ],
        _EPS,
    )


def _at(states: np.ndarray, build: Callable[[float], Rates]) -> Run:
    built = cache(build)

    def run(setting: float) -> np.ndarray:
        rates = built(setting)
        return np.array([rates(x) for x in states])

    return run


def _rates(model: Model) -> Rates:
    function = ca.Function("rates", [pack(model.x), pack(model.p)], [model.ode])
    p = signal_values(model.p, None, "parameter")
    return lambda x: np.array(function(x, p)).ravel()


def _by_nodes(model: Model, count: float) -> Rates:
    return _rates(average(model, 2 * ca.pi / model["frequency"], nodes=int(count)))


def _instant(model: Model) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Rates at instants, friction by the sign of the velocity: (x, t) to columns."""
    sliding = []
    for contact in model.contacts:
        ahead, behind = (contact.law.slip_force(contact.velocity, side) for side in (1, -1))
        sliding.append(ca.if_else(contact.velocity > 0, ahead, behind))
    ode = ca.substitute(model.ode, model.forces, ca.vertcat(*sliding))
    function = ca.Function("rates", [pack(model.x), model.t, pack(model.p)], [ode])
    p = signal_values(model.p, None, "parameter")
    return lambda x, t: np.array(function(x, t[None], p))


def _sampled(model: Model, count: float) -> Rates:
    rates = _instant(model)
    t = np.arange(count) / count * _PERIOD
    return lambda x: rates(x, t).mean(axis=1)


def _adaptive(model: Model, tolerance: float) -> Rates:
    rates = _instant(model)

    def mean(x: np.ndarray) -> np.ndarray:
        def integral(k: int) -> float:
            asked = {"epsabs": tolerance * _EPS * _PERIOD, "epsrel": 0.0, "limit": 500}
            return quad(lambda t: rates(x, np.array([t]))[k, 0], 0.0, _PERIOD, **asked)[0]

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IntegrationWarning)  # the error is measured here
            return np.array([integral(k) for k in range(len(x))]) / _PERIOD

    return mean
