"""Fits of eight numbers from ten seconds at 100 Hz, on recordings made by scipy alone.

`tests.stress.judge_fit` does the same for 200 draws; docs/verification.md has its figures.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import wormopt as wo
from tests.stress.judge_fit import SOUGHT, Draw, draw, judge, task_of, told, wrong_start

pytestmark = pytest.mark.slow


def test_intervals_hold_the_truth_and_wrong_starts_end_at_the_best_fit():
    lines = [judge(seed) for seed in range(16)]
    found = told(lines)
    assert found["or said that they did not"] == 1.0
    assert found["ended at the best fit"] >= 0.9
    assert found["better than begun at the truth"] == []
    squares = sum(float(np.square(line["score_of_best"]).sum()) for line in lines)
    count = 8 * len(lines)  # correlated within a draw, so that the spread is wider than chi2's
    low, high = chi2.ppf([1e-6, 1 - 1e-6], count)
    assert low < squares < high
    assert found["processor seconds"][1] < 20
    noise = found["noise found over true"]
    assert 0.94 < noise[0] < noise[1] < noise[2] < 1.06


def test_without_noise_numbers_are_exact():
    drawn = draw(5, end=4.0, noise=1e-8)
    found = wo.fit(task_of(drawn, wrong_start(drawn, 3.0, 5)))
    assert found.converged
    assert all(end.agrees for end in found.starts)
    assert found.values == pytest.approx([drawn.truth[name] for name in SOUGHT], rel=1e-6)


@cache
def first_draw() -> Draw:
    return draw(0)


def changed(change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Draw:
    values = change(first_draw().seen.values["position"].copy(), np.random.default_rng(5))
    return replace(first_draw(), seen=replace(first_draw().seen, values={"position": values}))


def fitted(drawn: Draw, **more: Any) -> tuple[wo.Fit, np.ndarray]:
    """Fit begun within a factor of two, and by how many standard errors the truth is off."""
    found = wo.fit(task_of(drawn, wrong_start(drawn, 2.0, 0), **more))
    true = np.log([drawn.truth[name] for name in SOUGHT])
    errors = np.sqrt(np.diag(found.covariance))
    return found, np.abs(true - found.theta) / np.where(errors > 0, errors, np.inf)


def with_gaps(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.where(rng.random(x.shape) < 0.3, np.nan, x)


def with_outliers(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    wild = rng.random(x.shape) < 0.05
    return np.where(wild, x + 50 * first_draw().noise * rng.uniform(-1, 1, x.shape), x)


def few(x: np.ndarray, _: np.random.Generator) -> np.ndarray:
    x[:, np.arange(x.shape[1]) % 111 > 0] = np.nan
    return x


@pytest.mark.parametrize(
    ("change", "more", "noise"),
    [
        (with_gaps, {}, 0.04),
        (with_outliers, {"loss": "huber"}, 0.15),
        (with_outliers, {"loss": "cauchy"}, 0.15),
        (few, {}, 0.5),
    ],
)
def test_poor_recordings_still_tell_the_truth(change: Any, more: dict, noise: float):
    found, off = fitted(changed(change), **more)
    assert found.converged
    assert off.max() < 4
    assert found.noise["position"] == pytest.approx(first_draw().noise, rel=noise)


def test_outliers_make_least_squares_worse_not_wrong():
    found, off = fitted(changed(with_outliers))
    robust, _ = fitted(changed(with_outliers), loss="huber")
    assert off.max() < 4
    assert found.noise["position"] > 4 * first_draw().noise
    assert np.all(np.diag(found.covariance) > 4 * np.diag(robust.covariance))


def test_what_no_worm_does_is_no_good_fit():
    """Signs or columns mixed up: the bottom is not reached, or noise is far beyond the camera's."""
    for change in (lambda x, _: -x, lambda x, _: x[[1, 0, 2]]):
        found, _ = fitted(changed(change))
        assert not found.converged or found.noise["position"] > 100 * first_draw().noise
        assert found.warnings or found.at_bound or found.reason


def test_a_worm_that_does_not_move_tells_nothing():
    """Noise alone: no number may have a small error."""
    start = np.array([3.0, 1.5, 0.0])[:, None]
    found, _ = fitted(changed(lambda x, rng: start + 0.01 * rng.standard_normal(x.shape)))
    assert not found.converged or np.sqrt(np.diag(found.covariance)).max() > 0.5
