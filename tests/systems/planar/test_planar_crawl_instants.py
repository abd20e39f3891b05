"""Slow crawls at single instants: a velocity of least power is always found, near ties included."""

from __future__ import annotations

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.crawling.balance import Line
from wormopt.systems.planar.crawling.velocity import Crawler, least_power, near

P = wo.planar
THREE = P.chain_shape(3, lengths=(1.0, 1.0, 1.0))
SNAKE = Elliptic(1.0, 1.0, sideways=3.0)


def _worm(seed: int):
    """A worm with or without a load, and instants: any, round ones and almost round ones."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    shape = P.chain_shape(n, lengths=tuple(np.ones(n) if seed % 2 else rng.uniform(0.3, 1.5, n)))
    numbers = rng.uniform(0.5, 3.0, (3, n + 1))
    numbers[:, :] = numbers if seed % 3 else numbers[:, :1]
    load = (seed % 5 == 0) * rng.uniform(-0.1, 0.1, 3)
    crawler = Crawler.of(shape, [Elliptic(*row) for row in numbers.T.tolist()], load)
    s, ds = rng.uniform(-1, 1, (2, 12, n - 1))
    s[4:], ds[4:] = np.round(2 * s[4:]) / 2, np.round(ds[4:])
    s[8:] += 1e-8 * rng.normal(size=s[8:].shape)
    ds[8:] += 10 ** rng.uniform(-16, -3, ds[8:].shape) * rng.normal(size=ds[8:].shape)
    return crawler.bodies(s, ds).body


@settings(max_examples=examples(15))
@given(st.integers(0, 10**6))
def test_what_is_found_takes_the_least_power_and_the_ground_can_hold_it(seed):
    body = _worm(seed)
    found = least_power(body)
    assert (body.ground.gauge(found.push) <= 1 + 1e-9).all()
    # no other velocity takes less: none that smoothed friction leads to, none beside it
    value = body.smooth_value(found.x, 0.0)
    assert (value <= body.smooth_value(body.smoothed(), 0.0) + 1e-12).all()
    rng = np.random.default_rng(seed)
    for width in (1e-7, 1e-4, 1e-1):
        aside = found.x + width * rng.normal(size=found.x.shape)
        assert (value <= body.smooth_value(aside, 0.0) + 1e-12).all()


@settings(max_examples=examples(6))
@given(st.integers(0, 10**6))
def test_wrong_guesses_lead_to_the_same_power(seed):
    body = _worm(seed)
    found = least_power(body)
    guessed = near(body, np.roll(found.x, 1, axis=0), np.roll(found.rest, 1, axis=0))
    powers = [body.smooth_value(one.x, 0.0) for one in (found, guessed)]
    assert powers[0] == pytest.approx(powers[1], abs=1e-12)


def test_a_joint_that_hardly_turns_is_no_trouble():
    # the front link turns 1e8 times as slowly as the other: both its masses rest
    motion = P.crawl_velocity(THREE, SNAKE, (1.49999998, 1.458), (-1.3e-7, 12.18))
    assert motion.rest[0].tolist()[:1] == [True]
    assert motion.hold[0] < 1
    assert np.abs(motion.twist).max() < 1e-6


@settings(max_examples=examples(20))
@given(st.integers(0, 10**6))
def test_the_least_on_a_line_is_that_of_its_slopes(seed):
    rng = np.random.default_rng(seed)
    v, v_n, a, a_n = rng.normal(size=(4, 5, 7))
    v[0], v_n[0] = -0.3 * a[0], -0.3 * a_n[0]  # one stops exactly
    ahead, back = rng.uniform(0.5, 2, (2, 5, 7))
    line = Line(v, v_n, a, a_n, ahead, back, rng.uniform(-0.1, 0.1, 7))
    w = line.least()
    assert (line.slope(w - 1e-9) <= 1e-12).all()
    assert (line.slope(w + 1e-9) >= -1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("ahead", [-1.0, 0.5])
def test_three_links_crawl_under_a_load(ahead):
    circle = P.Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])
    found = P.crawl(THREE, SNAKE, circle, load=(ahead, 0.0, 0.0))
    # half a stroke mirrors the other: no turn; and even phases, each without a guess, agree
    assert abs(found.displacement[2]) < 1e-8  # what random crawls are held to
    twist = found.course.at((np.arange(2000) + 0.5) / 2000).twist
    assert twist[:, 2].mean() == pytest.approx(0.0, abs=1e-6)
    turn = np.cumsum(twist[:, 2]) / 2000 - twist[:, 2] / 4000
    way = ((twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * turn)).mean()
    assert [way.real, way.imag] == pytest.approx(found.displacement[:2], abs=1e-5)


@pytest.mark.parametrize("bend", 10.0 ** -np.arange(2, 13))
def test_forces_balance_however_slow_a_mass_is(bend):
    # the tail hardly moves; its direction is lost where its velocity is a small difference
    laws = [Elliptic(1.0, 2.0, 3.0), Elliptic(2.0, 1.0, 1.5), Elliptic(0.5, 1.0, 2.0)]
    shape = P.chain_shape(2, lengths=(1.0, 0.8))
    motion = P.crawl_velocity(shape, laws, [bend], [1.0])
    J = np.array(shape.kinematics([bend])[2])
    assert J.T @ motion.forces[0].ravel() == pytest.approx(np.zeros(3), abs=1e-10)
    slow = np.linalg.norm(motion.velocities[0, 2])
    assert motion.rest[0, 2] or slow == pytest.approx(0.447352763 * bend, rel=2 * bend + 1e-7)


@pytest.mark.slow
def test_what_rests_does_not_flicker_where_the_ground_just_holds():
    # links change places at a quarter and at half; ever less is left of what holds before
    circle = P.Harmonics([0.0, 0.0], cosine=[[0.43, 0.0]], sine=[[0.0, 0.43]])
    found = P.crawl(THREE, Elliptic(1.0, 1.0, sideways=0.5), circle)
    assert len(found.phases) == 10
    assert found.breaks[[3, 5, 8]] == pytest.approx([0.1852, 0.5, 0.6852], abs=1e-3)
    assert found.breaks[6:] - 0.5 == pytest.approx(found.breaks[1:6], abs=1e-8)
    assert found.displacement[2] == pytest.approx(0.0, abs=1e-10)  # the second half mirrors
