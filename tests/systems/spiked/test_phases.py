"""Phases that count: those that last, of a cycle that does not repeat itself."""

from fractions import Fraction

import numpy as np
import pytest

from wormopt.progress import silent
from wormopt.systems.shared.sequences import lasting, repetition
from wormopt.systems.spiked.certify.certified import certify
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.search.orders import ceiling

QUICK = Search(effort="quick", workers=1)


def test_phases_of_no_length_are_none_and_their_neighbours_one():
    word, times = ((0,), (1,), (0,), (2,), (0, 1), (2,)), (0.0, 0.2, 0.3, 0.1, 0.0, 0.4)
    assert lasting(word, times) == (((1,), (0,), (2,)), (0.2, 0.3, 0.5))
    round_the_end = lasting(((0,), (1,), (0,), (2,)), (0.3, 0.3, 0.4, 0.0))
    assert round_the_end == (((0,), (1,)), (0.7, 0.3))


def test_words_that_repeat_themselves():
    assert repetition(((0,), (1,), (2,), (0,), (1,), (2,))) == 3
    assert repetition(((0,), (1,), (0,), (2,))) == 4


def test_a_design_has_no_phases_of_next_to_no_length():
    """Phases of 5e-8 and 8e-9 of the cycle stood before and after a rest of mass 0."""
    limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=60.0)
    cost = Objective("peak_actuator_force", 0.509423768)
    found = designed(GaitProblem(Worm(2, load=(1.0, 5.0)), limits, cost), QUICK, silent)
    assert sorted(found.sequence) == [(0,), (2,)]
    assert min(found.durations) > 0.4
    assert found.value < 17.09982  # as with them
    assert found.phases == 2


@pytest.mark.slow
def test_a_gap_is_not_withheld_where_a_cycle_repeats_itself():
    """Two cycles alike of three phases were taken for one of six; and one is enough."""
    limits = Limits(period=(0.3, 2.0), length=(0.7, 1.3), acceleration=20.0, spike_load=16.6353)
    order = ((0,), (1,), (2,))
    search = Search(effort="quick", sequence=order * 2)
    found = designed(GaitProblem(Worm(2, load=5.0), limits, Objective()), search, silent)
    assert found.sequence == order
    assert found.cycles == 1
    assert found.speed > 1.0430309  # as of both together


def test_the_ceiling_is_not_below_its_exact_value():
    """Of one link c e/(c + e), in exact arithmetic."""
    for contraction, extension in np.random.default_rng(0).uniform(0.05, 3.0, (300, 2)).tolist():
        c, e = Fraction(contraction), Fraction(extension)
        found = Fraction(ceiling([contraction], [extension], 1))
        assert c * e / (c + e) <= found <= c * e / (c + e) * (1 + Fraction(1, 10**12))


def test_a_bound_is_never_above_the_ceiling():
    limits = Limits(period=(1.0, 20.0), length=(0.7, 1.3), rate=0.08, acceleration=20.0)
    found = designed(GaitProblem(Worm(2, load=5.0), limits, Objective()), QUICK, silent)
    told = certify(found, time_limit=1e-9)
    assert found.ceiling == pytest.approx(0.08, rel=1e-12)
    assert found.speed < told.bound <= found.ceiling
