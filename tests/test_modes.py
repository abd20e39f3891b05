"""Mode sequences, and the ceiling of the mode linear program against values known exactly."""

from collections.abc import Iterable
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.core.modes import ModeSequence, ceiling
from wormopt.gaits.construct import block_wave
from wormopt.worms.crawl import crawl

# Ceiling over r by links and resting masses (theory of the corrected chapter, section 1).
TABLE = {
    1: ["1/2"],
    2: ["1", "1/3"],
    3: ["3/2", "2/3", "1/4"],
    4: ["2", "1", "1/2", "1/5"],
    5: ["5/2", "3/2", "5/6", "2/5", "1/6"],
}
CASES = [(n, a, Fraction(v)) for n, row in TABLE.items() for a, v in enumerate(row, start=1)]


@pytest.mark.parametrize(("links", "resting", "value"), CASES)
@pytest.mark.parametrize("rate", [1.0, 0.02, 350.0])
def test_the_ceiling_has_its_known_values(links: int, resting: int, value: Fraction, rate: float):
    limits = [rate] * links
    assert ceiling(limits, limits, resting) == pytest.approx(rate * value, rel=1e-9)


def test_eight_links_reach_four_times_the_rate():
    """For a = 1 the accordion's n r / 2 is the optimum; for a = n one mass hops at a time."""
    assert ceiling([1.0] * 8, [1.0] * 8, 1) == pytest.approx(4.0, rel=1e-9)
    assert ceiling([1.0] * 8, [1.0] * 8, 8) == pytest.approx(1 / 9, rel=1e-9)


@given(contraction=st.floats(0.01, 100), extension=st.floats(0.01, 100))
def test_one_link_with_two_rates(contraction: float, extension: float):
    """A stroke takes 1/c + 1/e, so the speed is c e / (c + e)."""
    exact = contraction * extension / (contraction + extension)
    assert ceiling([contraction], [extension], 1) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("links", [2, 3])
def test_the_accordion_with_two_rates_is_the_best(links: int):
    """All links alike and a = 1: n c e / (c + e), as for one link n times as long."""
    contraction, extension = 0.5, 2.0
    exact = links * contraction * extension / (contraction + extension)
    found = ceiling([contraction] * links, [extension] * links, 1)
    assert found == pytest.approx(exact, rel=1e-9)


def all_sets(links: int, least: int) -> list[tuple[int, ...]]:
    masses = range(links + 1)
    return [s for size in range(least, links + 2) for s in combinations(masses, size)]


@settings(max_examples=15, deadline=None)
@given(data=st.data(), links=st.integers(1, 4))
def test_limits_only_lower_the_ceiling(data: st.DataObject, links: int):
    """Fewer modes or slower links never raise it; more resting masses in a mode change nothing."""
    rates = st.lists(st.floats(0.1, 3), min_size=links, max_size=links)
    contraction, extension = data.draw(rates), data.draw(rates)
    resting = data.draw(st.integers(1, links))
    whole = ceiling(contraction, extension, resting)
    slack = 1e-9 * max(contraction + extension) * links
    larger = all_sets(links, resting)
    assert ceiling(contraction, extension, resting, larger) == pytest.approx(whole, abs=slack)
    subset = st.lists(st.sampled_from(larger), min_size=1, max_size=5, unique=True)
    part = ceiling(contraction, extension, resting, data.draw(subset))
    assert -slack <= part <= whole + slack
    slower = [c * data.draw(st.floats(0.1, 1)) for c in contraction]
    assert ceiling(slower, extension, resting) <= whole + slack
    # Run backwards and seen from behind, the worm crawls as well; what contracted now extends.
    mirrored = ceiling(extension[::-1], contraction[::-1], resting)
    assert mirrored == pytest.approx(whole, abs=slack)


@settings(max_examples=25, deadline=None)
@given(data=st.data(), links=st.integers(1, 5), stroke=st.floats(0.05, 1))
def test_no_block_wave_passes_the_ceiling_of_its_own_rates(
    data: st.DataObject, links: int, stroke: float
):
    resting = data.draw(st.integers(1, links))
    gait = block_wave(links, resting, 1.0, (1.0, 1.0 + stroke), "trapezoid", ramp=0.0)
    motion = crawl(gait, [1.0] * (links + 1), 0.0, 10.0)
    rate = stroke * (links + 1)
    bound = ceiling([rate] * links, [rate] * links, resting)
    assert motion.speed <= bound * (1 + 1e-9)
    if resting == links:  # one mass hops at a time: the wave is all there is
        assert motion.speed == pytest.approx(bound, rel=1e-9)


@pytest.mark.parametrize(
    "sets", [[[0]], [[0], [0]], [[0, 2]], [[0, 1, 2]]], ids=["head", "twice", "ends", "all"]
)
def test_a_mass_that_always_rests_forbids_to_advance(sets: list[Iterable[int]]):
    assert ceiling([1.0, 1.0], [1.0, 1.0], 1, sets) == pytest.approx(0, abs=1e-12)


def test_head_then_tail_alone_is_enough_under_rate_limits():
    """The accordion: limits beyond rates are what makes a third mode worth its while."""
    assert ceiling([1.0] * 2, [1.0] * 2, 1, [{0}, {2}]) == pytest.approx(1.0, rel=1e-9)
    assert ceiling([1.0] * 2, [1.0] * 2, 1, [{0}, {1}]) == pytest.approx(0.5, rel=1e-9)


@given(
    contacts=st.integers(1, 8),
    data=st.data(),
)
def test_resting_sets_come_back_from_a_sequence(contacts: int, data: st.DataObject):
    phase = st.frozensets(st.integers(0, contacts - 1))
    sets = data.draw(st.lists(phase, min_size=1, max_size=6))
    sequence = ModeSequence.of_resting(sets, contacts)
    assert sequence.resting == tuple(tuple(sorted(s)) for s in sets)
    assert sequence.states.shape == (len(sets), contacts)
    assert np.array_equal(sequence.states == 0, [[i in s for i in range(contacts)] for s in sets])
    assert sequence == ModeSequence(sequence.phases)


@pytest.mark.parametrize("phases", [(), ((0, 1), (0, 1, 1))])
def test_sequences_without_a_common_set_of_contacts_are_refused(phases: tuple):
    with pytest.raises(ValueError, match="one and the same set of contacts"):
        ModeSequence(phases)


@pytest.mark.parametrize("phase", [{3}, {-1}, {0, 7}])
def test_a_resting_contact_that_does_not_exist_is_refused(phase: set[int]):
    with pytest.raises(ValueError, match="contacts"):
        ModeSequence.of_resting([{0}, phase], 3)


@pytest.mark.parametrize("state", [2, -2])
def test_a_state_that_is_none_is_refused(state: int):
    with pytest.raises(ValueError, match="0, \\+1 or -1"):
        ModeSequence(((0, 1), (state, 0)))
