"""Limits of a design task as linear forms: what is left of each, against the forces themselves."""

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp

from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Worm
from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.programs.scaled_limits import ScaledLimits
from wormopt.systems.spiked.sharing import share_load

LOAD = 2.0
STRENGTHS = (10.0, 20.0, 40.0, 30.0)


def scaled(sharing: Sharing = "equal", load: tuple[float, float] | float = LOAD) -> ScaledLimits:
    limits = Limits(
        period=(2.0, 4.0),
        length=((0.7, 1.3), (0.7, 1.0), (0.5, 1.3)),
        rate=Rates((1.0, 2.0, 1.5), (0.5, 1.0, 3.0)),
        acceleration=(20.0, 20.0, 30.0),
        spike_load=STRENGTHS,
        actuator_force=(15.0, 25.0, 18.0),
        sigma_margin=0.5,
        sharing=sharing,
    )
    worm = Worm(links=3, mass=(1.0, 2.0, 0.5, 1.5), drag=0.3, load=load)
    return ScaledLimits(GaitProblem(worm, limits, Objective()))


def test_forces_as_such_have_no_limits():
    """Weights 1 to 4 of masses 1, 2, 0.5, 1.5 with a mean of 1.25."""
    form = scaled().weighted(np.arange(1.0, 5.0))
    assert (form.below, form.above) == (np.inf, np.inf)
    assert form.alpha == pytest.approx(np.array([1, 4, 1.5, 6]) / 1.25)
    assert form.beta == pytest.approx([1, 2, 3, 4])


@pytest.mark.parametrize(
    ("sharing", "resting", "most"),
    [
        # alike: together as much as the weakest allows
        ("equal", (0, 2), 2 * 10),
        ("equal", (1, 2, 3), 3 * 20),
        ("equal", (2,), 40),
        # as they like: together as much as each can
        ("least_actuation", (0, 2), 10 + 40),
        ("least_actuation", (0,), 10),
    ],
)
def test_spikes_together_carry_what_their_sharing_allows(
    sharing: Sharing, resting: tuple[int, ...], most: float
):
    limits = scaled(sharing)
    (form,) = [f for f in limits.forms(resting) if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(most - 4 * LOAD, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (LOAD - 0.5), rel=1e-12)


def test_what_is_not_limited_has_no_form():
    """Without limits on actuators there are the links and the sum of the reactions."""
    limits = scaled()
    free = limits.task.limits.vary(spike_load=None, actuator_force=None)
    *links, whole = ScaledLimits(limits.task.vary(limits=free)).forms((0, 2))
    assert whole.above == np.inf
    assert len(links) == 3
    free = free.vary(acceleration=None, impulses=True)
    nothing = ScaledLimits(limits.task.vary(limits=free))
    *links, _ = nothing.binding((0, 2))
    assert [(f.below, f.above) for f in links] == [(np.inf, np.inf)] * 3
    assert [*nothing.spikes, *nothing.actuator_most] == [np.inf] * 7


def test_limits_are_widened_by_a_rounding_of_what_they_are_the_difference_of():
    limits = scaled(load=(1.0, 3.0))
    above = [(20, 12), (15, -1), (25, 6), (18, 3)]  # what is borne at most, and what at rest
    below = [(4, 2), (-3, -15), (2, -25), (1, -18)]  # what at rest, and what at least
    for form, *pairs in zip(limits.forms((1,))[3:], above, below, strict=True):
        for side, (high, low) in zip((form.above, form.below), pairs, strict=True):
            with mp.workdps(40):
                wider = mp.mpf(side) * mp.mpf(limits.force) - (high - low)
            assert 5e-15 < wider / (abs(high) + abs(low)) < 1.5e-14


def test_every_load_of_a_range_is_kept_to():
    limits = scaled(load=(1.0, 3.0))
    (form,) = [f for f in limits.forms((1,)) if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(20 - 4 * 3, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (1 - 0.5), rel=1e-12)


@settings(max_examples=examples(60))
@given(
    st.sets(st.integers(0, 3), min_size=1, max_size=3),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["equal", "least_actuation"]),
)
def test_what_forms_leave_is_what_the_recursion_of_forces_leaves(
    rest: set[int], seed: int, sharing: Sharing
):
    """Of links' accelerations, the weakest spike's load and every actuator's force, both ways.

    Where several spikes share the load as they like, only all they bear together is known.
    """
    limits, resting = scaled(sharing), tuple(sorted(rest))
    given_, worm = limits.task.limits, limits.task.worm
    random = np.random.default_rng(seed)
    moves = np.isin(np.arange(4), resting, invert=True)
    a, v = random.normal(0, 5, 4) * moves, random.uniform(0, 1, 4) * moves
    mass = np.array(worm.masses)
    unloaded = -np.cumsum(mass * a + worm.drag * v + LOAD)
    total = -unloaded[-1]
    loads = share_load(np.array([total]), unloaded[:, None], resting, "equal")[:, 0]
    force = (unloaded + np.cumsum(loads))[:-1]
    links = a[:-1] - a[1:]
    upper = np.concatenate(
        [
            np.array(given_.acceleration, float) - links,
            [len(resting) * (min(STRENGTHS[i] for i in resting) - loads[list(resting)].max())],
            np.array(given_.actuator_force, float) - force,
        ]
    )
    lower = np.concatenate(
        [
            np.array(given_.acceleration, float) + links,
            [total - 4 * 0.5],
            np.array(given_.actuator_force, float) + force,
        ]
    )
    if sharing == "least_actuation":
        upper[3] = sum(STRENGTHS[i] for i in resting) - total
    forms, known = limits.forms(resting), 7 if sharing == "equal" or len(resting) == 1 else 4
    upper, lower = upper[:known], lower[:known]
    assert len(forms) == known
    scale_a = limits.time / limits.speed
    values = [f.alpha @ a * scale_a + limits.drag * f.beta @ v / limits.speed for f in forms]
    units = np.array([1 / scale_a] * 3 + [limits.force] * (known - 3))
    left = np.array([(f.above, f.below) for f in forms]).T + np.array([-1, 1])[:, None] * values
    assert left * units == pytest.approx(np.array([upper, lower]), abs=1e-9)
    whole = limits.weighted(weights := random.normal(size=4))
    scaled_force = whole.alpha @ a * scale_a + limits.drag * whole.beta @ v / limits.speed
    assert scaled_force * limits.force == pytest.approx(weights @ (mass * a + worm.drag * v))
    assert (whole.below, whole.above) == (np.inf, np.inf)


def test_velocities_are_those_that_rates_allow_from_the_nearest_at_rest():
    limits = scaled()
    speeds = limits.fastest((1,)) * limits.speed
    # ahead: the first link extends; behind: the second contracts, then the third too
    assert speeds == pytest.approx([0.5, 0.0, 2.0, 3.5], rel=1e-12)
    speeds = limits.fastest((0, 3)) * limits.speed
    assert speeds == pytest.approx([0.0, 1.0, 3.0, 0.0], rel=1e-12)


def test_units_are_the_largest_rate_the_longest_period_and_the_mean_mass():
    limits = scaled()
    assert (limits.speed, limits.time, limits.mean_mass) == (3.0, 4.0, 1.25)
    assert limits.periods == (0.5, 1.0)
    assert limits.strokes == pytest.approx(np.array([0.6, 0.3, 0.8]) / 12, rel=1e-12)
    assert limits.force == pytest.approx(1.25 * 3 / 4, rel=1e-12)
    assert limits.drag == pytest.approx(0.3 * 4 / 1.25, rel=1e-12)
    assert limits.spikes * limits.force == pytest.approx(STRENGTHS, rel=1e-12)
    assert limits.actuator_most * limits.force == pytest.approx([15.0, 25.0, 18.0], rel=1e-12)
    double = limits.task.limits.vary(period=8.0, rate=6.0)
    other = ScaledLimits(limits.task.vary(limits=double), like=limits)
    assert (other.speed, other.time, other.periods) == (3.0, 4.0, (2.0, 2.0))
