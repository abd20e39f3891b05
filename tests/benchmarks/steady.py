"""Resonance curve of the magneto-elastic pair, beside SciPy's root finders point by point."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import fsolve, root

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.analysis.continuation import continue_branch
from wormopt.analysis.steady import steady_states
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, pack
from wormopt.model.values import signal_values
from wormopt.systems.pair.slow import averaged_pair, steady_pair

_EPS, _NATURAL = 0.0355, math.sqrt(2)
_DETUNING = np.linspace(0.5, 0.02, 200)  # from where friction and field are of one size
_BOX = {"center_velocity": (-2.0, 2.0), "swing": (-2.0, 2.0)}


def task(_name: str, quick: bool) -> Task:
    """Velocities along the curve; the average is in closed form for all."""
    detuning = _DETUNING[::10] if quick else _DETUNING
    exact = np.array([steady_pair(0.5, 1.0, each).velocity for each in detuning])
    finders = {"SciPy fsolve": _fsolve, "SciPy root (hybr), Jacobian": _hybr}
    return Task(
        f"resonance curve of the pair, {len(detuning)} points",
        "closed form (19)",
        "velocity, relative",
        "tolerance of SciPy's root finders; ours has none",
        1e-9,
        np.ones(len(detuning)),
        [
            Way(OWN, partial(_own, detuning, exact), (0.0,)),
            *(
                Way(name, partial(_by_points, finder, detuning, exact), (1e-3, 1e-6, 1e-9, 1e-12))
                for name, finder in finders.items()
            ),
        ],
    )


def _model() -> Model:
    law, frequency = Coulomb(0.5 * _EPS, _EPS), _NATURAL + float(_DETUNING[0]) * _EPS
    return averaged_pair(law=law, push=_EPS, frequency=frequency)


def _own(detuning: np.ndarray, exact: np.ndarray) -> Run:
    model, frequency = _model(), _NATURAL + _EPS * detuning
    span = (float(frequency.min()) - 1e-3 * _EPS, float(frequency.max()) + 1e-3 * _EPS)

    def run(_: float) -> np.ndarray:
        (state,) = steady_states(model, _BOX)
        branch = continue_branch(state, "frequency", span).at(np.sort(frequency))
        return branch.x[::-1, 0] / exact

    return run


def _compiled(model: Model) -> tuple[Any, Any, np.ndarray, int]:
    """Rates over eps and their Jacobian of (x, p), the parameters, and which is the frequency."""
    x, p = pack(model.x), pack(model.p)
    rates = ca.Function("rates", [x, p], [model.ode / _EPS])
    slopes = ca.Function("slopes", [x, p], [ca.densify(ca.jacobian(model.ode / _EPS, x))])
    values = signal_values(model.p, None, "parameter")
    names = [signal.name for signal in model.p for _ in range(signal.size)]
    return rates, slopes, values, names.index("frequency")


def _fsolve(rates: Any, _slopes: Any, x: np.ndarray, tolerance: float) -> np.ndarray:
    # what it says of its progress is measured here
    return np.asarray(fsolve(rates, x, xtol=tolerance, full_output=True)[0])


def _hybr(rates: Any, slopes: Any, x: np.ndarray, tolerance: float) -> np.ndarray:
    return np.asarray(root(rates, x, jac=slopes, method="hybr", tol=tolerance).x)


def _by_points(finder: Any, detuning: np.ndarray, exact: np.ndarray) -> Run:
    """From point to point, the first from the steady state that is known there."""
    model = _model()
    rates, slopes, p, where = _compiled(model)
    (state,) = steady_states(model, _BOX)

    def run(tolerance: float) -> np.ndarray:
        found, x = np.empty(len(detuning)), state.x
        for k, each in enumerate(detuning):
            p[where] = _NATURAL + _EPS * each
            x = finder(
                lambda y: np.asarray(rates(y, p)).ravel(),
                lambda y: np.asarray(slopes(y, p)),
                x,
                tolerance,
            )
            found[k] = x[0]
        return found / exact

    return run
