"""Averages of the magneto-elastic pair: time against error, and what a resonance curve costs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import IntegrationWarning, quad

from tests.benchmarks.memory import growth, megabytes
from tests.benchmarks.run import Found, aligned, axes, compared, curves, least, save, seconds, timed
from wormopt.analysis.average import average
from wormopt.analysis.continuation import continue_branch
from wormopt.analysis.steady import steady_states
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, pack
from wormopt.model.values import signal_values
from wormopt.progress import Report
from wormopt.systems.pair.averaged import averaged_pair, steady_pair
from wormopt.systems.pair.slow import slow_pair

_EPS, _NATURAL = 0.0355, math.sqrt(2)
_NUMBERS: Any = {
    "law": Coulomb(0.5 * _EPS, _EPS), "push": _EPS, "frequency": _NATURAL + 0.5 * _EPS
}  # fmt: skip
_PERIOD = 2 * np.pi / _NUMBERS["frequency"]
_NODES, _SAMPLES = (2, 4, 6, 8, 12, 16), (32, 128, 512, 2048, 8192)
_STATES, _POINTS = 60, 400  # random ones to average at, of the curve

_OURS, _GOAL = "wormopt, nodes", 1e-3  # error at which times are compared

Rates = Callable[[np.ndarray], np.ndarray]


def measured(_name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Average at random states in several ways, beside the closed form; then the curve.

    `quick`: fewer states, and less effort for the slow ways.
    """
    model, random = slow_pair(**_NUMBERS), np.random.default_rng(0)
    states = random.uniform(-1.0, 1.0, (10 if quick else _STATES, 3))
    closed = _rates(averaged_pair(**_NUMBERS))
    exact = [closed(x) for x in states]
    tolerances = (1e-2, 1e-4) if quick else (1e-2, 1e-4, 1e-6)
    ways: list[tuple[str, float, Callable[[], Rates]]] = [
        *((_OURS, n, partial(_by_nodes, model, n)) for n in _NODES),
        *(("samples, CasADi", n, partial(_sampled, model, n)) for n in _SAMPLES),
        *(("SciPy quad", accuracy, partial(_adaptive, model, accuracy)) for accuracy in tolerances),
    ]
    rows: list[Found] = []
    for k, (method, effort, build) in enumerate(ways):
        report(f"averaging: {method} {effort:g}", k / len(ways))
        rates, memory = growth(partial(_begun, build, states[0]))
        found = [timed(rates, x) for x in states]
        off = [np.abs(rate - known).max() for (_, rate), known in zip(found, exact, strict=True)]
        spent = median(time for time, _ in found)
        rows.append({"method": method, "effort": effort, "error": max(map(float, off)) / _EPS,
                     "seconds": spent, "memory": memory})  # fmt: skip
        yield {"averages": rows}
    report("averaging: resonance curve", 0.95)
    yield {"averages": rows, "curve": _curve()}


def _begun(build: Callable[[], Rates], x: np.ndarray) -> Rates:
    """Rates that have been called once."""
    rates = build()
    rates(x)
    return rates


def _rates(model: Model) -> Rates:
    function = ca.Function("rates", [pack(model.x), pack(model.p)], [model.ode])
    p = signal_values(model.p, None, "parameter")
    return lambda x: np.array(function(x, p)).ravel()


def _averaged(model: Model, **options: Any) -> Model:
    return average(model, 2 * ca.pi / model["frequency"], **options)


def _by_nodes(model: Model, count: int) -> Rates:
    return _rates(_averaged(model, nodes=count))


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


def _sampled(model: Model, count: int) -> Rates:
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


def _curve() -> Found:
    """What the steady states at one detuning and the curve through them cost.

    In seconds: to average, the first time, again. The error is the largest relative difference of
    velocities from (19).
    """
    build, model = timed(lambda: _averaged(slow_pair(**_NUMBERS)))
    (first, _), *again = (timed(_followed, model) for _ in range(4))
    warm, error = median(time for time, _ in again), again[-1][1]
    return {"points": _POINTS, "build": build, "first": first, "warm": warm, "error": error}


def _followed(model: Model) -> float:
    box = {"center_velocity": (-2.0, 2.0), "swing": (-2.0, 2.0)}
    (state,) = steady_states(model, box)
    span = (_NATURAL + 0.01 * _EPS, _NATURAL + 2 * _EPS)
    frequency = _NATURAL + _EPS * np.linspace(0.02, 2.0, _POINTS)
    branch = continue_branch(state, "frequency", span).at(frequency)
    if len(branch.parameter) != _POINTS:
        return math.nan
    exact = [steady_pair(0.5, 1.0, (nu - _NATURAL) / _EPS).velocity for nu in branch.parameter]
    return float(np.abs(branch.x[:, 0] / exact - 1).max())


# -- telling -------------------------------------------------------------------------------------


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our fastest average over that of every other way, of those that are good enough."""
    good = (a for a in found["averages"] if a["error"] <= _GOAL)
    return compared(least((a["method"], a["seconds"]) for a in good), _OURS)


def lines(found: Mapping[str, Any]) -> list[str]:
    """The ways in a table, and the curve."""
    rows = [
        (
            a["method"],
            f"{a['effort']:g}",
            f"{a['error']:.1e}",
            seconds(a["seconds"]),
            megabytes(a["memory"]),
        )
        for a in found["averages"]
    ]
    told = ["averaging: mean rates of the pair, error over eps against (18)"]
    told += aligned(("method", "effort", "error", "an evaluation", "memory"), *rows)
    if "curve" in found:
        c = found["curve"]
        told.append(
            f"  steady states and a curve of {c['points']} points: first {seconds(c['first'])}, "
            f"again {seconds(c['warm'])}; averaging {seconds(c['build'])}; error {c['error']:.0e}"
        )
    return told


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw time against error to a PNG file."""
    figure, left = axes("error of the mean rates, over eps", "time of one evaluation (s)")
    curves(left, found["averages"], "method", "error", "seconds")
    save(figure, path)
