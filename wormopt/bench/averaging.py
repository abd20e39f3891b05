"""Averages of the magneto-elastic pair: time against error, and what a resonance curve costs."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import IntegrationWarning, quad

from wormopt.analysis.average import average
from wormopt.analysis.continuation import follow_branch
from wormopt.analysis.steady import steady_states
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, pack
from wormopt.model.values import signal_values
from wormopt.progress import Report
from wormopt.systems.pair.averaged_pair import averaged_pair, steady_pair
from wormopt.systems.pair.slow_pair import slow_pair
from wormopt.systems.shared.signals import symbol

_EPS, _NATURAL = 0.0355, math.sqrt(2)
_NODES, _SAMPLES = (2, 4, 6, 8, 12, 16), (32, 128, 512, 2048, 8192)
_STATES = 60
_COLOURS = ("#0072B2", "#E69F00", "#009E73")

Rates = Callable[[np.ndarray], np.ndarray]


@dataclass
class Timed:
    """Cost and error of one way to average."""

    method: str
    effort: float  # its nodes, samples or tolerance
    error: float  # largest difference of mean rates from (18), over eps
    seconds: float  # median of one evaluation


@dataclass(frozen=True)
class Curve:
    """What a steady state and a resonance curve through it cost."""

    points: int  # of the curve
    build: float  # s, to average
    first: float  # s, for steady states and curve the first time
    warm: float  # s, for steady states and curve again
    error: float  # largest relative difference of velocities from (19)


def _pair() -> Model:
    law = Coulomb(0.5 * _EPS, _EPS)
    return slow_pair(law=law, push=_EPS, frequency=_NATURAL + 0.5 * _EPS)


def _rates(model: Model) -> Rates:
    function = ca.Function("rates", [pack(model.x), pack(model.p)], [model.ode])
    p = signal_values(model.p, None, "parameter")
    return lambda x: np.array(function(x, p)).ravel()


def _period(model: Model) -> ca.SX:
    return 2 * ca.pi / symbol(model, "frequency")


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
    t = np.arange(count) / count * 2 * np.pi / (_NATURAL + 0.5 * _EPS)
    return lambda x: rates(x, t).mean(axis=1)


def _adaptive(model: Model, tolerance: float) -> Rates:
    rates, period = _instant(model), 2 * np.pi / (_NATURAL + 0.5 * _EPS)

    def mean(x: np.ndarray) -> np.ndarray:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IntegrationWarning)  # the error is measured here
            found = [
                quad(
                    lambda t, k=k: rates(x, np.array([t]))[k, 0],
                    0.0,
                    period,
                    epsabs=tolerance * _EPS * period,
                    epsrel=0.0,
                    limit=500,
                )[0]
                for k in range(len(x))
            ]
        return np.array(found) / period

    return mean


def measure_averages(quick: bool, report: Report) -> Iterator[Timed]:
    """Average at random states in several ways, beside the closed form.

    `quick`: fewer states, and less effort for the slow ways.
    """
    model, random = _pair(), np.random.default_rng(0)
    states = random.uniform(-1.0, 1.0, (10 if quick else _STATES, 3))
    law = Coulomb(0.5 * _EPS, _EPS)
    closed = averaged_pair(law=law, push=_EPS, frequency=_NATURAL + 0.5 * _EPS)
    exact = [_rates(closed)(x) for x in states]
    ways: list[tuple[str, float, Callable[[], Rates]]] = [
        ("wormopt, nodes", n, partial(lambda n: _rates(average(model, _period(model), nodes=n)), n))
        for n in _NODES
    ]
    ways += [("samples, CasADi", n, partial(_sampled, model, n)) for n in _SAMPLES]
    tolerances = (1e-2, 1e-4) if quick else (1e-2, 1e-4, 1e-6)
    ways += [
        ("SciPy quad", tolerance, partial(_adaptive, model, tolerance)) for tolerance in tolerances
    ]
    for k, (method, effort, build) in enumerate(ways):
        report(f"averaging: {method} {effort:g}", k / len(ways))
        rates = build()
        rates(states[0])
        spent, worst = [], 0.0
        for x, known in zip(states, exact, strict=True):
            begin = time.perf_counter()
            found = rates(x)
            spent.append(time.perf_counter() - begin)
            worst = max(worst, float(np.abs(found - known).max()) / _EPS)
        yield Timed(method, effort, worst, median(spent))


def measure_curve(points: int = 400) -> Curve:
    """Time the steady states at one detuning and the curve of `points` through them."""
    begin, slow = time.perf_counter(), _pair()
    model = average(slow, _period(slow))
    build = time.perf_counter() - begin
    times, error = [], 0.0
    for _ in range(4):
        begin = time.perf_counter()
        error = _curve(model, points)
        times.append(time.perf_counter() - begin)
    return Curve(points, build, times[0], median(times[1:]), error)


def _curve(model: Model, points: int) -> float:
    box = {"center_velocity": (-2.0, 2.0), "swing": (-2.0, 2.0)}
    (state,) = steady_states(model, box)
    span = (_NATURAL + 0.01 * _EPS, _NATURAL + 2 * _EPS)
    frequency = _NATURAL + _EPS * np.linspace(0.02, 2.0, points)
    branch = follow_branch(state, "frequency", span).at(frequency)
    if len(branch.parameter) != points:
        return math.nan
    exact = [steady_pair(0.5, 1.0, (nu - _NATURAL) / _EPS).velocity for nu in branch.parameter]
    return float(np.abs(branch.x[:, 0] / exact - 1).max())


def draw_averages(known: Sequence[Timed], path: Path) -> None:
    """Draw time against error to a PNG file."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.add_subplot(
        111, xscale="log", yscale="log", xlabel="error of the mean rates, over eps",
        ylabel="time of one evaluation (s)",
    )  # fmt: skip
    for k, method in enumerate(dict.fromkeys(t.method for t in known)):
        own = [t for t in known if t.method == method]
        axes.plot([t.error for t in own], [t.seconds for t in own], "os^"[k] + "-", markersize=4,
                  color=_COLOURS[k], label=method)  # fmt: skip
    axes.grid(visible=True, color="#E6E6E6", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)
