"""Draws of the posterior: its density in closed form, and what the sampler makes of it."""

import builtins
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tests.oracles.by_formula import fit_at, formula, noisy
from wormopt.errors import ArgumentError, Interrupted, UnknownNameError
from wormopt.fitting.estimate import Fit
from wormopt.fitting.fit import fit
from wormopt.fitting.posterior import Density, Posterior, Unbounded, posterior
from wormopt.fitting.profile import profile
from wormopt.fitting.recording import Recording
from wormopt.fitting.task import FitTask
from wormopt.fitting.unknowns import Unknown
from wormopt.model.friction import Coulomb
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain

T = np.linspace(0.0, 5.0, 9)
SD = 0.3
FEW: dict[str, Any] = {"draws": 400, "tune": 200, "chains": 2}
sampled = pytest.mark.skipif(find_spec("nutpie") is None, reason="nutpie is not installed")


def line(noise: float | None, *unknowns: Unknown) -> Fit:
    """Fit of a line by hand, with the noise as it is or as it scatters."""
    model = formula(lambda t, p: {"y": p["a"] + p["b"] * t}, a=1.0, b=-0.5)
    y = noisy(3, 1.0 - 0.5 * T, SD)
    X = np.column_stack([np.ones_like(T), T])
    best, (left,), *_ = np.linalg.lstsq(X, y, rcond=None)
    sd = noise or float(np.sqrt(left / (len(T) - 2)))
    task = FitTask(
        model, [Recording(T, {"y": y})], unknowns or (Unknown("a"), Unknown("b")), noise={"y": sd}
    )
    found = fit_at(task, a=best[0], b=best[1])
    return found if noise else replace(found, estimated=("y",))


def test_of_a_line_the_density_is_a_unit_normal_about_the_fit():
    density = Density(line(SD))
    top = density.log(np.zeros(2))[0]
    for y in np.random.default_rng(0).normal(size=(5, 2)):
        value, slope = density.log(y)
        assert value - top == pytest.approx(-y @ y / 2, rel=1e-6)
        assert slope == pytest.approx(-y, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("loss", ["cauchy", pytest.param("linear", marks=pytest.mark.slow)])
def test_gradients_are_those_of_the_density(loss: str):
    """With every kind of bound, logarithms, priors, a loss and noise to be estimated."""
    model = formula(
        lambda t, p: {"y": p["a"] * ca.exp(-p["k"] * t) + p["b"] - p["d"] * t, "z": p["d"] * t},
        a=2.0, k=0.8, b=0.1, d=0.2,
    )  # fmt: skip
    run = Recording(T, {"y": noisy(1, 2 * np.exp(-0.8 * T), SD), "z": 0.2 * T}, noise={"z": 0.1})
    unknowns = [
        Unknown("a", lower=0.0, upper=3.0),
        Unknown("k", log=True, upper=9.0),
        Unknown("b", prior=(0.0, 0.2)),
        Unknown("d", lower=0.0),
    ]
    task = FitTask(model, [run], unknowns, noise={"y": 0.2}, loss=loss)  # type: ignore[arg-type]
    density = Density(replace(fit_at(task, a=2.0, k=0.8, b=0.1, d=0.2), estimated=("y",)))
    assert density.names[-1] == "noise of y"
    y, h = np.random.default_rng(2).normal(size=5), 1e-4
    slopes = [(density.log(y + e)[0] - density.log(y - e)[0]) / (2 * h) for e in h * np.eye(5)]
    assert density.log(y)[1] == pytest.approx(slopes, rel=1e-4, abs=1e-5)


@settings(max_examples=examples(60))
@given(
    st.sampled_from([(-np.inf, np.inf), (1.0, np.inf), (-np.inf, 4.0), (1.0, 4.0)]),
    st.floats(-20, 20),
)
def test_coordinates_without_bounds_go_there_and_back(bounds: tuple[float, float], u: float):
    lower, upper = (np.array([b]) for b in bounds)
    free, at = Unbounded(lower, upper, np.array([2.0])), np.array([u])
    theta, h = free.theta(at), 1e-5
    assert lower <= theta <= upper
    if abs(u) < 5:  # and not so near to a bound that it is moved away
        assert free.u(theta) == pytest.approx(at, abs=1e-9)
    rise = (free.theta(at + h) - free.theta(at - h)) / (2 * h)
    assert free.slopes(at) == pytest.approx(rise, rel=1e-6, abs=1e-8)
    value, slope, bend = (
        np.array([free.log_slopes(at + k * h)[j] for k in (-1, 0, 1)]) for j in range(3)
    )
    known = np.log(np.abs(free.slopes(np.array([u, 0.3]))))
    assert value[1] - free.log_slopes(np.array([0.3]))[0] == pytest.approx(
        known[:1] - known[1:], rel=1e-6, abs=1e-9
    )
    assert slope[1] == pytest.approx((value[2] - value[0]) / (2 * h), rel=1e-4, abs=1e-5)
    assert bend[1] == pytest.approx((slope[2] - slope[0]) / (2 * h), rel=1e-4, abs=1e-5)


def test_what_is_no_probability_is_refused():
    model = formula(lambda t, p: {"y": (p["a"] + p["b"]) * t}, a=1.0, b=2.0)
    run = Recording(T, {"y": 3 * T}, noise={"y": SD})
    free = fit_at(FitTask(model, [run], [Unknown("a"), Unknown("b")]), a=1.0, b=2.0)
    with pytest.raises(ArgumentError, match="the readings do not determine a, b"):
        Density(free).log(np.zeros(2))
    between = [Unknown(name, lower=-9.0, upper=9.0) for name in "ab"]
    held = fit_at(FitTask(model, [run], between), a=1.0, b=2.0)
    assert np.isfinite(Density(held).log(np.zeros(2))[0])


def test_what_cannot_be_drawn_is_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ArgumentError, match="chains must be a whole number, 2 or more"):
        posterior(line(SD), chains=1)

    def without(name: str, *rest: object, whole=builtins.__import__):
        raise ImportError(name)

    monkeypatch.setattr("wormopt.fitting.posterior.import_module", without)
    with pytest.raises(ArgumentError, match=r"wormopt\[bayes\]"):
        posterior(line(SD))


def test_doubts_are_told():
    draws = np.random.default_rng(0).normal(size=(2, 200, 1))
    sure = Posterior(("a",), draws, 0, np.array([1.001]), np.array([900.0]))
    assert sure.doubts == ()
    assert sure["a"].shape == (2, 200)
    assert sure.interval(0.5) == pytest.approx(np.quantile(draws, [0.25, 0.75])[None])
    with pytest.raises(UnknownNameError, match="'b'"):
        sure["b"]
    told = replace(sure, divergences=3, r_hat=np.array([1.2]), effective=np.array([np.nan])).doubts
    assert [word in text for word, text in zip(("astray", "differ", "depend"), told, strict=True)]
    assert len(told) == 3


# -- the sampler -----------------------------------------------------------------------------------


def thinned(found: Posterior, name: str) -> np.ndarray:
    """Draws that hardly depend on each other."""
    every = int(np.ceil(found.draws.shape[0] * found.draws.shape[1] / found.effective.min()))
    return found[name][:, :: max(every, 1)].ravel()


@sampled
@pytest.mark.slow
def test_draws_of_a_line_are_normal_and_repeat_with_their_seed():
    found = line(SD)
    drawn = posterior(found, **FEW, seed=4)
    assert drawn.doubts == ()
    for k, name in enumerate("ab"):
        sd = float(np.sqrt(found.covariance[k, k]))
        exact = stats.norm(found.theta[k], sd).cdf
        assert stats.kstest(thinned(drawn, name), exact).pvalue > 1e-3
    # profiles of a line are symmetric and the same
    interval = profile(found, ["a"])["a"].interval
    assert drawn.interval()[0] == pytest.approx(interval, abs=0.1 * np.diff(interval)[0])
    short = [posterior(found, draws=20, tune=50, chains=2, seed=4).draws for _ in range(2)]
    assert np.array_equal(short[0], short[1])


@sampled
@pytest.mark.slow
def test_with_noise_to_be_estimated_numbers_follow_students_law(monkeypatch: pytest.MonkeyPatch):
    found = line(None)
    slopes = np.column_stack([np.ones_like(T), T]) / found.noise["y"]
    readings = found.task.recordings[0].readings["y"][0] / found.noise["y"]
    # in place of simulations, of which there would be 15000
    monkeypatch.setattr(FitTask, "plain", lambda _, theta: (slopes @ theta - readings, slopes))
    drawn = posterior(found, seed=1)
    assert drawn.doubts == ()
    freedom = len(T) - 2
    for k, name in enumerate("ab"):
        exact = stats.t(freedom, found.theta[k], np.sqrt(found.covariance[k, k])).cdf
        assert stats.kstest(thinned(drawn, name), exact).pvalue > 1e-3
    # squares over the variance are chi²: of the noise an inverse gamma law
    left = freedom * found.noise["y"] ** 2
    variances = thinned(drawn, "noise of y") ** 2
    assert stats.kstest(variances, stats.invgamma(freedom / 2, scale=left / 2).cdf).pvalue > 1e-3


@sampled
@pytest.mark.slow
def test_bounds_cut_the_law_off():
    found = line(SD, Unknown("a"), Unknown("b", lower=-0.5, upper=-0.3))
    at = np.clip(found.theta, *found.task.bounds)
    r, jacobian = found.task.residuals(at)
    drawn = posterior(replace(found, theta=at, residuals=r, jacobian=jacobian), **FEW, seed=2)
    free = line(SD)
    mean, sd = free.theta[1], float(np.sqrt(free.covariance[1, 1]))
    cut = stats.truncnorm((-0.5 - mean) / sd, (-0.3 - mean) / sd, mean, sd)
    assert stats.kstest(thinned(drawn, "b"), cut.cdf).pvalue > 1e-3


@sampled
@pytest.mark.slow
def test_an_interrupt_keeps_what_was_drawn():
    calls = 0

    def stop(text: str, fraction: float | None) -> None:
        nonlocal calls
        calls += 1
        if fraction and fraction > 0.8:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        posterior(line(SD), report=stop, draws=300, tune=50, chains=2)
    assert caught.value.partial is None or 4 <= caught.value.partial.draws.shape[1] < 300


@sampled
@pytest.mark.slow
def test_draws_of_a_chain_on_dry_ground_agree_with_its_profiles():
    """Two masses let go with their link stretched; they stop and start on the way."""
    law = Coulomb(1.0, 3.0)
    worm = chain(1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=2.0, law=law)
    times, start = np.linspace(0.0, 4.0, 81), {"position": [3.5, 0.0], "velocity": [0.0, 0.0]}
    true = simulate(worm, 4.0, x0=start, times=times)["position"]
    run = Recording(times, {"position": noisy(0, true, 0.05)}, noise={"position": 0.05}, x0=start)
    unknowns = [
        Unknown("stiffness"),
        Unknown("damping"),
        Unknown("forward", "friction_forward", lower=0.0),
    ]
    found = fit(FitTask(worm, [run], unknowns), seeds=1)
    drawn = posterior(found, draws=300, tune=200, chains=2, seed=0)
    assert (drawn.r_hat < 1.05).all()
    for name, made in profile(found).items():
        low, high = drawn.interval()[drawn.names.index(name)]
        width = made.interval[1] - made.interval[0]
        assert (low, high) == pytest.approx(made.interval, abs=0.15 * width)
