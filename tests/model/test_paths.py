"""Random paths of parameters: moments and correlations from theory, positivity, continuity."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wormopt.model.schedule import ParameterPath, ornstein_uhlenbeck, piecewise_constant

LARGE = 200_000  # samples; standard errors below are of this order


def test_piecewise_constant_is_uniform_and_independent():
    """Mean m, variance spread^2 / 3, no correlation from piece to piece or link to link."""
    path = piecewise_constant(np.random.default_rng(5), [10.0, 4.0], [3.0, 1.0], 0.5, LARGE * 0.5)
    values = path.coefficients[:, :, 0]
    assert values.shape == (LARGE, 2)
    error = 5 / np.sqrt(LARGE)  # five standard errors of a mean with unit deviation
    spread = np.array([3.0, 1.0])
    scaled = (values - [10.0, 4.0]) / (spread / np.sqrt(3))
    assert np.abs(scaled.mean(axis=0)).max() < error
    assert np.abs((scaled**2).mean(axis=0) - 1).max() < error
    assert np.abs((scaled[1:] * scaled[:-1]).mean(axis=0)).max() < error
    assert abs((scaled[:, 0] * scaled[:, 1]).mean()) < error
    assert np.all(np.abs(values - [10.0, 4.0]) <= spread)
    # Both ends of the range are reached, which a narrower law would not do.
    assert np.abs(np.abs(values - [10.0, 4.0]).max(axis=0) / spread - 1).max() < 1e-3


def test_ornstein_uhlenbeck_has_the_moments_and_correlation_of_theory():
    """Over many links at fixed times: mean, variance and covariance at three lags.

    With s^2 = log(1 + (deviation/mean)^2) the covariance over a time h is
    mean^2 (exp(s^2 exp(-h/tau)) - 1), at h = 0 deviation^2.
    """
    mean, deviation, tau, step = 10.0, 4.0, 0.8, 0.25
    path = ornstein_uhlenbeck(
        np.random.default_rng(8), np.full(LARGE, mean), deviation, tau, step, horizon=2.0
    )
    values = path.coefficients[:, :, 0]
    assert values.shape == (9, LARGE)
    s2 = np.log(1 + 0.4**2)
    for k in (0, 3, 8):  # stationary: from the first instant on
        assert values[k].mean() == pytest.approx(mean, abs=5 * deviation / np.sqrt(LARGE))
        assert values[k].var() == pytest.approx(deviation**2, rel=0.03)
        assert np.log(values[k]).var() == pytest.approx(s2, rel=5 * np.sqrt(2 / LARGE))
        assert np.log(values[k]).mean() == pytest.approx(np.log(mean) - s2 / 2, abs=5e-3)
    for lag in (1, 3, 8):
        product = (values[0] - mean) * (values[lag] - mean)
        theory = mean**2 * (np.exp(s2 * np.exp(-lag * step / tau)) - 1)
        assert product.mean() == pytest.approx(theory, abs=6 * product.std() / np.sqrt(LARGE))


def test_ornstein_uhlenbeck_along_one_long_path():
    """The logarithm's autocorrelation along time is exp(-h / tau): it is the same process."""
    tau, step = 1.0, 0.2
    path = ornstein_uhlenbeck(np.random.default_rng(2), 1.0, 0.5, tau, step, LARGE * step)
    z = np.log(path.coefficients[:, 0, 0])
    z = (z - z.mean()) / z.std()
    for lag in (1, 5, 10):
        assert (z[lag:] * z[:-lag]).mean() == pytest.approx(np.exp(-lag * step / tau), abs=0.02)


@given(
    seed=st.integers(0, 10**6),
    step=st.floats(0.01, 1.0),
    horizon=st.floats(0.1, 5.0),
    ratio=st.floats(0.0, 3.0),
)
def test_ornstein_uhlenbeck_is_positive_and_continuous(
    seed: int, step: float, horizon: float, ratio: float
):
    mean = np.array([10.0, 0.1])
    path = ornstein_uhlenbeck(np.random.default_rng(seed), mean, ratio * mean, 0.5, step, horizon)
    ends = path.coefficients[:, :, 0] + path.coefficients[:, :, 1] * np.diff(path.breaks)[:, None]
    starts = path.coefficients[1:, :, 0]
    assert np.all(np.abs(ends[:-1] - starts) <= 1e-12 * np.maximum(ends[:-1], starts) + 1e-15)
    times = np.linspace(0, 2 * horizon + step, 301)  # beyond the horizon it stays as it is
    assert np.all(path(times) > 0)
    assert path.breaks[-2] >= horizon * (1 - 1e-9)
    assert np.all(path.coefficients[-1, :, 1] == 0)


@pytest.mark.parametrize("build", [piecewise_constant, ornstein_uhlenbeck])
def test_alike_arguments_give_alike_shapes_and_a_seed_gives_one_path(build: Callable):
    def draw(seed: int) -> ParameterPath:
        times = (0.3, 0.1, 1.0) if build is ornstein_uhlenbeck else (0.1, 1.0)
        return build(np.random.default_rng(seed), [10.0, 9.0, 8.0], 1.0, *times)

    first, again, other = draw(1), draw(1), draw(2)
    assert np.array_equal(first.values, again.values)
    assert not np.array_equal(first.values, other.values)
    assert np.array_equal(first.breaks, other.breaks)
    assert first.values.shape == other.values.shape
    pieces = 11 if build is ornstein_uhlenbeck else 10  # 1.0 / 0.1 is ten, not eleven, pieces
    assert first.coefficients.shape[:2] == (pieces, 3)


def test_the_schedule_gives_the_path_back():
    rng = np.random.default_rng(4)
    path = ParameterPath(np.array([0.0, 0.5, 1.5, 2.0]), rng.normal(size=(3, 2, 3)))
    t = ca.SX.sym("t")
    expression, schedule = path.schedule("stiffness", t)
    assert (schedule.name, schedule.periodic, schedule.start) == ("stiffness", False, 0.0)
    assert np.array_equal(schedule.breaks, path.breaks)
    function = ca.Function("f", [t, schedule.symbol, schedule.begin], [expression])
    times = np.array([-0.2, 0.0, 0.3, 0.5, 1.2, 1.5, 1.9, 2.6])
    pieces = [0, 0, 0, 1, 1, 2, 2, 2]
    for time, piece, by_call in zip(times, pieces, path(times).T, strict=True):
        s = time - path.breaks[piece]
        by_hand = path.coefficients[piece] @ [1.0, s, s**2]
        assert by_call == pytest.approx(by_hand, abs=1e-14)
        found = function(time, schedule.values[piece], path.breaks[piece])
        assert np.array(found).ravel() == pytest.approx(by_hand, abs=1e-14)


RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: piecewise_constant(RNG, 1.0, 1.0, 0.1, 1.0), "0 <= spread < mean"),
        (lambda: piecewise_constant(RNG, 1.0, -0.1, 0.1, 1.0), "0 <= spread < mean"),
        (lambda: piecewise_constant(RNG, 1.0, 0.1, 0.0, 1.0), "interval and horizon"),
        (lambda: piecewise_constant(RNG, 1.0, 0.1, 0.1, np.inf), "interval and horizon"),
        (lambda: ornstein_uhlenbeck(RNG, 0.0, 0.1, 1.0, 0.1, 1.0), "mean > 0"),
        (lambda: ornstein_uhlenbeck(RNG, 1.0, -0.1, 1.0, 0.1, 1.0), "deviation >= 0"),
        (lambda: ornstein_uhlenbeck(RNG, 1.0, 0.1, 0.0, 0.1, 1.0), "correlation_time"),
        (lambda: ornstein_uhlenbeck(RNG, 1.0, 0.1, 1.0, -0.1, 1.0), "step and horizon"),
        (lambda: ParameterPath(np.array([0.0, 1.0]), np.ones((2, 1, 1))), "shape"),
        (lambda: ParameterPath(np.array([0.0, 1.0]), np.ones((1, 1))), "shape"),
        (lambda: ParameterPath(np.array([0.5, 1.0]), np.ones((1, 1, 1))), "ascend from 0"),
        (lambda: ParameterPath(np.array([0.0, 0.0]), np.ones((1, 1, 1))), "ascend from 0"),
    ],
)
def test_paths_that_make_no_sense_are_refused(build: Callable[[], object], message: str):
    with pytest.raises(ValueError, match=message):
        build()
