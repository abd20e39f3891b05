"""Limits held over all time: excess over every one, solved by hand."""

from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from smooth_gaits import safe_load, smooth_gaits

from wormopt.model.gait import Gait
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.verify import excess_of, speed_of, violations

# A link that differs by direction in all it does: rate from 1 down to -2 at acceleration -1, back
# up to 1 at acceleration 2, then on at rate 1 until its length repeats.
BREAKS = np.array([0.0, 3.0, 4.5, 6.75])
COURSE = np.array([[4.0, 1.0, -0.5], [2.5, -2.0, 1.0], [1.75, 1.0, 0.0]])
PERIOD = 6.75
# Mass 0 moves while the link extends, with velocity l' and acceleration l''; mass 1 while it
# contracts, with -l' and -l''. By (1)-(7), for masses 1 and 3, drag k = 0.5, load Gamma = 4:
#   mass 0 moves: a in {-1, 2, 0}, v <= 1:  load of spike 1 is 8 +   a + v/2, force -(4 +   a + v/2)
#   mass 1 moves: a in {1, -2},    v <= 2:  load of spike 0 is 8 + 3 a + v/2, force   4 + 3 a + v/2
SIGMA = 1.0  # half the load 8 - 6 of spike 0 where mass 1 comes to rest
FORCES = 4.0 + 2.0 * 2.0 + 0.5 * 2.0  # load, mean mass times acceleration, drag times rate
LIMITS = Limits(period=PERIOD, length=(1.0, 5.0), rate=3.0)


def one_link() -> Crawl:
    return crawl(Gait(BREAKS, COURSE[:, None]), [1.0, 3.0], 0.5, 4.0)


def two_links() -> Crawl:
    """The second link does half of what the first does, the other way round."""
    second = np.array([4.0, 0.0, 0.0]) - COURSE / 2
    gait = Gait(BREAKS, np.stack([COURSE, second], axis=1))
    return crawl(gait, [1.0, 2.0, 3.0], 0.1, 20.0)


ALWAYS = {
    "limits.length": -0.5 / 5,  # from 1.5 to 4.5
    "limits.rate": -1 / 3,  # from -2 to 1
    "sigma": -SIGMA / FORCES,
    "limits.resting": 0.0,
    "limits.period": 0.0,
    "closed": 0.0,
}


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, {}),
        ({"length": (1.8, 5.0)}, {"limits.length": 0.3 / 5}),
        ({"length": (1.0, 4.2)}, {"limits.length": 0.3 / 4.2}),
        ({"rate": Rates(1.6, 9.0)}, {"limits.rate": 0.4 / 9}),
        ({"rate": Rates(9.0, 0.4)}, {"limits.rate": 0.6 / 9}),
        ({"rate": Rates(2.5, 1.0)}, {"limits.rate": 0.0}),
        ({"rate": None, "acceleration": 4.0}, {"limits.rate": None, "limits.acceleration": -0.5}),
        ({"acceleration": 1.6}, {"limits.acceleration": 0.25}),
        ({"spike_load": 10.0}, {"limits.spike_load": 0.2}),
        ({"spike_load": (13.0, 7.0)}, {"limits.spike_load": 0.5}),
        ({"spike_load": (8.0, 21.0)}, {"limits.spike_load": 0.5}),
        ({"spike_load": 24.0}, {"limits.spike_load": -0.5}),
        ({"actuator_force": 10.0}, {"limits.actuator_force": -0.2}),
        ({"actuator_force": 6.4}, {"limits.actuator_force": 0.25}),
        ({"sigma_margin": 2.8}, {"limits.sigma_margin": 1.8 / FORCES}),
        ({"sigma_margin": 0.4}, {"limits.sigma_margin": -0.6 / FORCES}),
        ({"sigma_margin": 18.0}, {"limits.sigma_margin": 17.0 / 18.0}),
        ({"resting": 2}, {"limits.resting": 1.0}),
        ({"period": 6.0}, {"limits.period": 0.75 / 6.0}),
        ({"period": (5.0, 6.0)}, {"limits.period": 0.75 / 6.0}),
        ({"period": (14.0, 20.0)}, {"limits.period": 0.25 / 20.0}),  # three cycles
        ({"period": (7.0, 30.0)}, {"limits.period": -6.5 / 30.0}),  # two cycles
        ({"period": (6.5, 54.0)}, {"limits.period": -0.25 / 54.0}),
    ],
)
def test_excess_over_each_limit_is_that_solved_by_hand(changed: dict, expected: dict):
    found = violations(one_link(), LIMITS.vary(**changed))
    everything = {k: v for k, v in (ALWAYS | expected).items() if v is not None}
    assert found == pytest.approx(everything, abs=1e-12)


def test_the_other_way_round_the_negative_force_is_the_large_one():
    """Extension and contraction change places, and so do the masses: force f becomes -f."""
    course = np.array([8.0, 0.0, 0.0]) - COURSE
    motion = crawl(Gait(BREAKS, course[:, None]), [3.0, 1.0], 0.5, 4.0)
    found = violations(motion, LIMITS.vary(length=(3.5, 6.5), actuator_force=6.4))
    assert found["limits.actuator_force"] == pytest.approx(0.25, abs=1e-12)
    assert found["limits.length"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("changed", "key", "excess"),
    [
        # the first link goes from 1.5 to 4.5, rates -2 to 1, accelerations -1 to 2;
        # the second from 1.75 to 3.25, rates -0.5 to 1, accelerations -1 to 0.5
        ({"length": ((1.8, 9.0), (0.1, 9.0))}, "limits.length", 0.3 / 9),
        ({"length": ((0.1, 9.0), (1.8, 9.0))}, "limits.length", 0.05 / 9),
        ({"length": ((0.1, 4.0), (0.1, 9.0))}, "limits.length", 0.5 / 4),
        ({"length": ((0.1, 9.0), (0.1, 3.0))}, "limits.length", 0.25 / 3),
        ({"rate": Rates((1.0, 9.0), (9.0, 9.0))}, "limits.rate", 1.0 / 9),
        ({"rate": Rates((9.0, 0.2), (9.0, 9.0))}, "limits.rate", 0.3 / 9),
        ({"rate": Rates((9.0, 9.0), (0.8, 9.0))}, "limits.rate", 0.2 / 9),
        ({"rate": Rates((9.0, 9.0), (9.0, 0.8))}, "limits.rate", 0.2 / 9),
        ({"acceleration": (1.0, 9.0)}, "limits.acceleration", 1.0),
        ({"acceleration": (9.0, 0.8)}, "limits.acceleration", 0.25),
    ],
)
def test_every_link_has_its_own_limits(changed: dict, key: str, excess: float):
    wide = LIMITS.vary(length=(0.1, 9.0), rate=9.0, acceleration=9.0)
    assert violations(two_links(), wide)[key] < 0
    assert violations(two_links(), wide.vary(**changed))[key] == pytest.approx(excess, abs=1e-12)


@pytest.mark.parametrize(("piece", "gap"), [(0, 0.0), (1, 0.1), (2, 0.3)])
def test_lengths_that_jump_do_not_close(piece: int, gap: float):
    """Wherever the jump, also at the end of the period."""
    course = COURSE.copy()
    course[piece, 0] += gap
    found = violations(crawl(Gait(BREAKS, course[:, None]), [1.0, 3.0], 0.5, 4.0), LIMITS)
    assert found["closed"] == pytest.approx(gap / 4.5, abs=1e-12)
    impulsive = LIMITS.vary(impulses=True)
    found = violations(crawl(Gait(BREAKS, course[:, None]), [1.0, 3.0], 0.5, 4.0), impulsive)
    assert found["closed"] == pytest.approx(gap / 4.5, abs=1e-12)


def test_jumps_are_measured_against_the_largest_of_all_links():
    course = np.stack([COURSE, [4.0, 0.0, 0.0] - COURSE / 2], axis=1)
    course[1, :, 0] += 0.09
    motion = crawl(Gait(BREAKS, course), [1.0, 2.0, 3.0], 0.1, 20.0)
    assert violations(motion, LIMITS)["closed"] == pytest.approx(0.09 / 4.5, abs=1e-12)


SAWTOOTH = Gait(np.array([0.0, 1.0, 3.0]), np.array([[[1.0, 0.5]], [[1.5, -0.25]]]))


def test_rates_that_jump_do_not_close_unless_impulses_are_allowed():
    motion = crawl(SAWTOOTH, [1.0, 1.0], 0.0, 1.0)
    limits = Limits(period=3.0, length=(1.0, 1.5), rate=0.5)
    assert violations(motion, limits)["closed"] == pytest.approx(0.75 / 0.5, abs=1e-12)
    assert violations(motion, limits.vary(impulses=True))["closed"] == 0.0


def test_no_spike_bears_an_impulse():
    limits = Limits(period=3.0, length=(1.0, 1.5), rate=0.5, impulses=True)
    motion = crawl(SAWTOOTH, [1.0, 1.0], 0.0, 1.0)
    assert motion.impulses
    assert violations(motion, limits.vary(spike_load=1e9))["limits.spike_load"] == np.inf
    assert "limits.spike_load" not in violations(motion, limits)
    # where both rates give the whole worm the same momentum there is none
    calm = crawl(SAWTOOTH, [1.0, 2.0], 0.0, 1.0)
    assert not calm.impulses
    found = violations(calm, limits.vary(spike_load=4.0))
    assert found["limits.spike_load"] == pytest.approx(-0.5, abs=1e-12)  # two loads of 1


def test_a_worm_that_stands_still_keeps_to_everything():
    motion = crawl(Gait(np.array([0.0, 1.0]), np.array([[[1.0]]])), [1.0, 1.0], 0.0, 1.0)
    found = violations(motion, Limits(period=1.0, length=(0.5, 2.0), rate=1.0, resting=2))
    assert found == pytest.approx(
        {"limits.length": -0.25, "limits.rate": -1.0, "sigma": -1.0 / 2.0}
        | dict.fromkeys(("limits.resting", "limits.period", "closed"), 0.0),
        abs=1e-12,
    )


@settings(max_examples=examples(8))
@given(smooth_gaits(), st.integers(0, 10**6), st.floats(0.0, 2.0))
def test_a_limit_drawn_around_samples_holds_and_one_drawn_within_does_not(
    gait: Gait, seed: int, drag: float
):
    """Of every mass and actuator by itself, as dense sampling sees its load or force."""
    random = np.random.default_rng(seed)
    mass = random.uniform(0.5, 2.0, gait.links + 1).tolist()
    motion = crawl(gait, mass, drag, 1.2 * safe_load(gait, mass))
    sample = motion.sample(4000)
    wide = Limits(period=gait.period, length=(0.01, 1e3), rate=1e6)
    for name, signal in (("spike_load", "reaction"), ("actuator_force", "actuator_force")):
        tops = np.abs(sample[signal]).max(axis=1)
        for row in np.flatnonzero(tops > 0):  # what never rests bears nothing
            for share, excess in ((1.01, -0.01 / 1.01), (0.9, 0.1 / 0.9)):
                each = np.full(len(tops), 1e3 * tops.max())
                each[row] = share * tops[row]
                found = violations(motion, wide.vary(**{name: tuple(each)}))
                assert found[f"limits.{name}"] == pytest.approx(excess, abs=1e-3)


# Two links at ticks of 0.5, and what closes the table. Rates: 0.4, 0, -0.4 and 0.6, -0.8, 0.2.
TABLE = np.array([[1.0, 1.2, 1.2, 1.0], [2.0, 2.3, 1.9, 2.0]])


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"rate": Rates((0.5, 0.5), (0.2, 0.4))}, {"limits.rate": 0.4 / 0.2 - 1}),
        ({"rate": Rates((0.5, 0.2), (0.2, 0.4))}, {"limits.rate": 0.8 / 0.2 - 1}),
        # the first rate follows the last: link 0 turns by 0.8
        ({"rate": None, "acceleration": (1.0, 4.0)}, {"limits.acceleration": 0.8 / 0.5 - 1}),
        ({"rate": None, "acceleration": 1.4}, {"limits.acceleration": 1.4 / 0.5 / 1.4 - 1}),
    ],
)
def test_what_a_table_exceeds(changed: dict[str, Any], expected: dict[str, float]):
    found = excess_of(TABLE, 0.5, LIMITS.vary(**changed))
    assert found == pytest.approx(expected, abs=1e-12)


def test_a_table_is_as_fast_as_the_head_must_go():
    """Mass 1 rests in the first tick, mass 2 in the second, the head in the third."""
    table = np.array([[1.0, 1.3, 1.2, 1.0], [2.0, 1.9, 2.1, 2.0]])
    assert speed_of(table, 1.5) == pytest.approx((0.3 + 0.1 + 0.0) / 1.5, rel=1e-12)
