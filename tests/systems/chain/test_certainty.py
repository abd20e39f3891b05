"""Exact intervals over plants drawn at random."""

import numpy as np
import pytest
import scipy.stats
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wormopt.systems.chain.drawn import LEVEL, less, median_interval, share_interval


@pytest.mark.parametrize("members", [1, 6, 20, 100])
def test_shares_of_none_and_all_have_the_interval_of_the_closed_form(members: int):
    least = ((1 - LEVEL) / 2) ** (1 / members)
    np.testing.assert_allclose(share_interval(0, members), (0, 1 - least), rtol=1e-10)
    np.testing.assert_allclose(share_interval(members, members), (least, 1), rtol=1e-10)


@pytest.mark.parametrize(("count", "members"), [(1, 2), (7, 20), (99, 100)])
def test_at_the_ends_of_an_interval_the_observed_share_is_as_rare_as_its_level_says(
    count: int, members: int
):
    low, high = share_interval(count, members)
    as_many = scipy.stats.binom.sf(count - 1, members, low)
    as_few = scipy.stats.binom.cdf(count, members, high)
    np.testing.assert_allclose([as_many, as_few], (1 - LEVEL) / 2, rtol=1e-10)


def test_six_plants_are_the_fewest_that_bound_a_median():
    """All six lie on one side of the median with probability 2/64 < 5 %, five with 2/32."""
    assert median_interval(np.array([3.0, 1.0, 2.0, 6.0, 5.0, 4.0])) == (1.0, 6.0)
    assert np.isnan(median_interval(np.arange(5.0))).all()


@pytest.mark.parametrize("members", [6, 20, 21, 40])
def test_intervals_of_medians_hold_them_as_often_as_they_say_and_are_no_wider(members: int):
    """Between the values of rank r and n + 1 - r lies the median unless fewer than r are below."""
    low, high = median_interval(np.arange(1.0, members + 1))
    assert low + high == members + 1
    missed = [2 * scipy.stats.binom.cdf(rank - 1, members, 0.5) for rank in (low, low + 1)]
    assert missed[0] <= 1 - LEVEL < missed[1]


def test_plants_that_failed_count_as_worst():
    values = np.array([1.0, 2.0, 3.0, 4.0, np.nan, np.nan])
    low, high = median_interval(values)
    assert low == 1.0
    assert np.isnan(high)
    assert less(np.array([[1.0, np.nan, np.nan], [2.0, 2.0, np.nan]])).tolist() == [[0, 1], [1, 0]]


@given(arrays(float, (3, 7), elements=st.one_of(st.floats(-5, 5), st.just(np.nan))))
@settings(max_examples=examples(60))
def test_of_two_one_has_less_or_both_have_as_much(rows: np.ndarray):
    found = less(rows)
    known = np.nan_to_num(rows, nan=np.inf)
    ties = (known[:, None] == known[None]).sum(axis=2)
    assert (found + found.T + ties == rows.shape[1]).all()
