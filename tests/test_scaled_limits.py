"""Limits of a design task as linear forms: what is left of each, against the forces themselves."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.programs.scaled_limits import Form, ScaledLimits, Slope
from wormopt.systems.spiked.sharing import share_load
from wormopt.systems.spiked.task import GaitProblem, Objective, Worm

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


@pytest.mark.parametrize(
    ("sharing", "resting", "more", "most"),
    [
        # alike: together as much as the weakest allows
        ("equal", (0, 2), 0, 2 * 10),
        ("equal", (1, 2, 3), 0, 3 * 20),
        ("equal", (2,), 0, 40),
        ("equal", (1, 2), 1, 3 * 20),
        # as they like: together as much as each can; others that rest may be the strongest
        ("least_actuation", (0, 2), 0, 10 + 40),
        ("least_actuation", (0,), 1, 10 + 40),
        ("least_actuation", (0,), 2, 10 + 40 + 30),
        ("least_actuation", (2,), 1, 40 + 30),
    ],
)
def test_spikes_together_carry_what_their_sharing_allows(
    sharing: Sharing, resting: tuple[int, ...], more: int, most: float
):
    limits = scaled(sharing)
    (form,) = [f for f in limits.forms(resting, more) if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(most - 4 * LOAD, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (LOAD - 0.5), rel=1e-12)
    known = len(resting) * min(STRENGTHS[i] for i in resting)
    if sharing == "least_actuation":
        known = sum(STRENGTHS[i] for i in resting)
    assert form.shared * limits.force == pytest.approx(most - known, rel=1e-12)


def test_every_load_of_a_range_is_kept_to():
    limits = scaled(load=(1.0, 3.0))
    (form,) = [f for f in limits.forms((1,)) if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(20 - 4 * 3, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (1 - 0.5), rel=1e-12)


@settings(max_examples=examples(60), deadline=None)
@given(st.sets(st.integers(0, 3), min_size=1, max_size=3), st.integers(0, 2**32 - 1))
def test_what_forms_leave_is_what_the_recursion_of_forces_leaves(rest: set[int], seed: int):
    """Of links' accelerations, the weakest spike's load and every actuator's force, both ways."""
    limits, resting = scaled(), tuple(sorted(rest))
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
    forms = limits.forms(resting)
    assert len(forms) == len(upper) == 7
    scale_a = limits.time / limits.speed
    values = [f.alpha @ a * scale_a + limits.drag * f.beta @ v / limits.speed for f in forms]
    units = np.array([1 / scale_a] * 3 + [limits.force] * 4)
    left = np.array([(f.above, f.below) for f in forms]).T + np.array([-1, 1])[:, None] * values
    assert left * units == pytest.approx(np.array([upper, lower]), abs=1e-9)


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
    assert (limits.shortest_period, limits.longest_period) == (0.5, 1.0)
    assert limits.strokes == pytest.approx(np.array([0.6, 0.3, 0.8]) / 12, rel=1e-12)
    assert limits.force == pytest.approx(1.25 * 3 / 4, rel=1e-12)
    assert limits.drag == pytest.approx(0.3 * 4 / 1.25, rel=1e-12)
    assert limits.spikes * limits.force == pytest.approx(STRENGTHS, rel=1e-12)
    double = replace(limits.task.limits, period=8.0, rate=6.0)
    other = ScaledLimits(replace(limits.task, limits=double), like=limits)
    assert (other.speed, other.time, other.longest_period) == (3.0, 4.0, 2.0)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("more", "helps"), [(1.5, True), (1.7, False)])
def test_drag_takes_from_a_rise_the_least_and_gives_a_fall_the_most(
    sign: int, more: float, helps: bool
):
    """Of s = v0 + v2 under -below <= s' + k (2 v0 + 4 v2) <= above, with mass 1 at rest.

    As 2 s <= 2 v0 + 4 v2 <= 4 s, s rises at most at above - 2 k s and falls at below + 4 k s. The
    first says more than the accelerations of the two masses do if it does at the largest s. Of -s
    the two change places.
    """
    limits = scaled()
    k, most = 0.3 * 4 / 1.25, np.array([0.5, 2.0]) / 3
    by_links = 2 * 20.0 * 4 / 3
    rise = [Slope(by_links)] + [Slope(by_links + more, 2 * k)] * helps
    fall = [Slope(1 + k * np.dot([2, 4], most)), Slope(1.0, 4 * k, longest=True)]
    sides, expected = (1.0, by_links + more), product(fall, rise)
    if sign < 0:
        sides, expected = sides[::-1], product(rise, fall)
    form = Form(sign * np.array([1.0, 0, 1, 0]), sign * np.array([2.0, 0, 4, 0]), *sides)
    courses = limits.courses(form, (1,))
    assert np.array(courses) == pytest.approx(np.array(list(expected)), rel=1e-12)
