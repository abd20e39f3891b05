"""Strokes of slow crawls: symmetries, bounds, other ways to them, and scenes of both kinds."""

from __future__ import annotations

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals

import wormopt as wo
from tests.oracles.by_crawls import SNAKE, THREE
from wormopt.errors import SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.study import load_scene
from wormopt.systems.planar.crawling.recheck import (
    cross,
    even_displacement,
    most_resistance,
    quadrature,
    record,
)
from wormopt.systems.planar.crawling.velocity import Crawler
from wormopt.systems.planar.planar_turn import TurnInPlace
from wormopt.systems.planar.poses import compose, inverse

P = wo.planar
SEEDS = st.integers(0, 10**6)


def _worm(seed: int, *, straight: bool = False):
    """Three links on ground with scales, and a stroke; one without a turn if `straight`."""
    rng = np.random.default_rng(seed)
    shape = P.chain_shape(3, lengths=tuple(rng.uniform(0.7, 1.3, 3)))
    ahead, back, aside = rng.uniform([[1.0], [1.0], [2.0]], [[1.5], [1.5], [4.0]], (3, 4))
    laws = [Elliptic(*row) for row in zip(ahead, back, aside, strict=True)]
    mean = np.zeros(2) if straight else rng.uniform(-0.2, 0.2, 2)
    cosine, sine = rng.uniform(0.3, 0.8, (2, 1, 2))
    return shape, laws, P.Harmonics(mean, cosine * [1, -1], sine)


@pytest.mark.slow
@settings(max_examples=examples(2))
@given(SEEDS)
def test_bent_the_other_way_it_goes_the_mirrored_way(seed):
    shape, laws, stroke = _worm(seed)
    other = P.Harmonics(-stroke.mean, -stroke.cosine, -stroke.sine)
    found, mirrored = (P.crawl(shape, laws, each) for each in (stroke, other))
    assert mirrored.displacement == pytest.approx(found.displacement * [1, -1, -1], abs=1e-8)
    assert mirrored.work == pytest.approx(found.work, rel=1e-10)
    assert mirrored.breaks == pytest.approx(found.breaks, abs=1e-7)


@pytest.mark.slow
@settings(max_examples=examples(2))
@given(SEEDS)
def test_begun_later_a_stroke_is_the_same_one_seen_from_there(seed):
    shape, laws, stroke = _worm(seed)
    # a quarter later cos(x + pi/2) = -sin x, sin(x + pi/2) = cos x
    later = P.Harmonics(stroke.mean, stroke.sine, -stroke.cosine)
    found, moved = (P.crawl(shape, laws, each) for each in (stroke, later))
    there = quadrature(found, np.linspace(0, 1, 241)).poses[60]
    seen = compose(inverse(there), compose(found.displacement, there))
    assert moved.displacement == pytest.approx(seen, abs=1e-7)


@pytest.mark.slow
@settings(max_examples=examples(2))
@given(SEEDS)
def test_no_straight_stroke_is_cheaper_than_its_floor(seed):
    shape, laws, stroke = _worm(seed, straight=True)
    found = P.crawl(shape, laws, stroke)
    # the second half mirrors the first
    assert abs(found.displacement[2]) < 1e-8
    least = sum(min(law.forward, law.backward, law.sideways) for law in laws)
    assert found.work >= least * np.hypot(*found.displacement[:2])


@pytest.mark.slow
def test_corners_on_a_side_change_the_pace_alone():
    corners = np.array([[0.9, 0.2], [-0.4, 0.8], [-0.6, -0.5]])
    more = np.insert(corners, 1, corners[0] + 0.3 * (corners[1] - corners[0]), axis=0)
    plain, paced = (P.crawl(THREE, SNAKE, P.Polygon(each)) for each in (corners, more))
    assert paced.displacement == pytest.approx(plain.displacement, abs=1e-9)
    assert paced.work == pytest.approx(plain.work, rel=1e-11)


@settings(max_examples=examples(12))
@given(SEEDS)
def test_straight_chains_move_as_in_one_dimension(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    laws = [Elliptic(*rng.uniform(0.5, 3.0, 3)) for _ in range(n + 1)]
    rates = rng.uniform(-1, 1, n)
    s = np.concatenate([rng.uniform(0.5, 1.5, n), np.zeros(n - 1)])
    motion = P.crawl_velocity(P.chain_shape(n), laws, s, np.append(rates, np.zeros(n - 1)))
    # in a line one mass rests: the power is piecewise linear in the head's velocity
    behind = -np.concatenate([[0.0], np.cumsum(rates)])
    forward, backward = (np.array([getattr(a, k) for a in laws]) for k in ("forward", "backward"))
    v = behind - behind[:, None]
    powers = np.where(v >= 0, forward * v, -backward * v).sum(axis=1)
    assert motion.power[0] == pytest.approx(powers.min(), rel=1e-12)
    head = v[powers.argmin(), 0]
    assert motion.twist[0] == pytest.approx([head, 0.0, 0.0], abs=1e-9)


@settings(max_examples=examples(7))
@given(SEEDS)
def test_forces_of_most_resistance_are_those_of_least_power(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    shape = P.chain_shape(n, lengths=tuple(rng.uniform(0.5, 1.5, n)))
    laws = [Elliptic(*rng.uniform(0.5, 3.0, 3)) for _ in range(n + 1)]
    load = rng.uniform(-0.1, 0.1, 3)
    s, ds = rng.uniform(-0.8, 0.8, (1, n - 1)), rng.uniform(-1, 1, (1, n - 1))
    motion = P.crawl_velocity(shape, laws, s, ds, load=load)
    dual = most_resistance(Crawler.of(shape, laws, load), s, ds)
    assert dual.violation[0] <= 1e-11  # as asked of the interior point
    assert motion.power[0] - motion.twist[0] @ load == pytest.approx(dual.power[0], rel=1e-9)
    assert motion.twist[0] == pytest.approx(dual.twist[0], abs=1e-5)


def test_even_phases_lead_to_the_same_place_at_their_order(cycle):
    off = [
        np.abs(even_displacement(cycle.course, count) - cycle.displacement).max()
        for count in (128, 1024)
    ]
    assert off[1] < 1e-5
    assert np.log(off[0] / off[1]) / np.log(8) > 1.5


def test_loads_of_the_actuators_are_those_of_virtual_work(cycle):
    told = record(cycle, np.linspace(0.003, 0.997, 37))
    B = np.array([np.array(THREE.kinematics(s)[3]) for s in told.shapes])
    forces = told.motion.forces.reshape(len(B), -1)
    virtual = -np.einsum("gr,grk->gk", forces, B)
    assert told.actuators == pytest.approx(virtual, abs=1e-8)
    power = (told.actuators * told.rates).sum(axis=1)
    assert power == pytest.approx(told.motion.power, rel=1e-9)


@pytest.mark.slow
@settings(max_examples=examples(6))
@given(SEEDS)
def test_no_gait_with_a_link_at_rest_turns_faster_than_the_bound(seed):
    rng = np.random.default_rng(seed)
    corners = [np.array([1.0, 0.6, 0.1])]
    turn, swung = 0.0, 0.0
    for _ in range(int(rng.integers(1, 4))):
        a, b, phi = corners[-1]
        new = rng.uniform(-2.5, 2.5)
        turn += (new - phi) * (a < b)  # the shorter link swings, and the first one is the frame
        swung += abs(new - phi)
        corners += [np.array([a, b, new]), np.array([b, a, new])]
    a, b, phi = corners[-1]
    corners.append(np.array([a, b, 0.1]))
    turn, swung = turn + (0.1 - phi) * (a < b), swung + abs(0.1 - phi)
    laws = [Elliptic(f, f, f) for f in (1.0, 2.0, 1.0)]
    found = P.crawl(P.chain_shape(2), laws, P.Polygon(np.array(corners)))
    assert found.displacement[2] == pytest.approx(turn, abs=1e-9)
    assert abs(found.displacement[2]) <= 0.5 * swung + 1e-9


def test_the_bound_is_approached_as_swaps_get_short():
    shares = []
    for short in (0.5, 0.9, 0.99):
        gait = TurnInPlace(1.0, 2.0, short=short, long=1.0, straight=-1.0, bent=1.0)
        assert gait.holds
        shares.append(abs(gait.turn) / (2 * (2.0 + 1.0 - short)) / 0.5)
    assert shares == sorted(shares)
    assert 0.99 < shares[-1] < 1


@pytest.mark.slow
def test_a_phase_that_all_but_meets_a_stop_leaves_no_sliver_between(cycle):
    # in a sliver a mass goes at 1e-12, its direction is rounding: moments were off by 5.8e-5
    even = quadrature(cycle, np.linspace(0, 1, 18))
    beside = np.union1d(np.linspace(0, 1, 18), cycle.breaks[1:-1] - 3e-13)
    rule = quadrature(cycle, beside)
    assert rule.poses[-1] == pytest.approx(even.poses[-1], abs=1e-9)
    told = record(cycle, rule.nodes)
    assert np.abs(told.forces.sum(axis=1)).max() < 1e-9
    assert np.abs(cross(told.points, told.forces).sum(axis=1)).max() < 1e-9


def _solved(name: str, *changes: str):
    result = wo.run(load_scene(name, ["want=[]", *changes]))
    return result, {key: told.value for key, told in result.scalars.items()}


@pytest.mark.slow
def test_the_scene_of_three_links_has_their_numbers():
    # as `crawl` of them, by other programs: tests/systems/planar/test_planar_crawl.py
    result, found = _solved("planar_three_link", "cycles=3")
    assert result.status == "ok"
    assert found["distance"] == pytest.approx(1.14837049, abs=6e-9)
    assert found["work"] == pytest.approx(17.0144757, abs=6e-8)
    assert found["speed"] == pytest.approx(found["distance"] / (2 * np.pi), rel=1e-12)
    assert found["work_per_distance"] > found["work_per_distance_floor"] == 4.0
    assert len(result["stage_start"].values) == found["stages"] == 11
    x, y = result["x"].values[0], result["y"].values[0]
    assert np.hypot(x[-1], y[-1]) == pytest.approx(3 * found["distance"], rel=1e-9)
    time, phase = result["time"].values, result["phase"].values
    velocity = np.gradient(x[: len(phase)], time[: len(phase)])
    heading = result["heading"].values[: len(phase)]
    ahead, left = result["head_velocity"].values
    told = np.cos(heading) * ahead - np.sin(heading) * left
    assert np.median(np.abs(velocity - told)) < 1e-3


@pytest.mark.slow
def test_the_scene_of_turning_in_place_is_near_its_bound():
    result, found = _solved("planar_turn_in_place")
    assert result.status == "ok"
    assert found["heading_rate"] == pytest.approx(2.4 / 4.82, rel=1e-12)
    assert (found["heading_rate_bound"], found["turn"]) == (0.5, pytest.approx(-2.4, abs=1e-12))
    assert 0 < found["gap"] < 0.01
    assert found["drift"] < 1e-12


@pytest.mark.slow
def test_a_worm_that_slips_is_warned_of_and_has_no_promise():
    result, found = _solved("planar_turn_in_place", "worm.middle_friction=1.0", "worm.short=0.5")
    assert result.status == "ok"
    assert found["swing_hold"] > 1
    assert found["gap"] is None
    assert "slip" in result.trust["warnings"][0]


test_bodies_that_make_no_sense_are_refused = refusals(
    "planar_three_link",
    """
    ground.law=unit | ground.law | elliptic
    ground.forward=[1.0,2.0] | ground.forward | list of 4
    stroke.mean=[0.0] | stroke.mean | 2 shape variables
    stroke.cosine=[[4.0,0.0]] | stroke | within ±π
    stroke={course="polygon",corners=[[1,1],[1,1]]} | stroke | never changes
    body.links=1 | body.links | write 3
    """,
)
test_worms_that_make_no_sense_are_refused = refusals(
    "planar_turn_in_place",
    """
    worm.short=1.0 | worm.short | swinging link is not determined
    worm.short=0.9999999 | worm.short | 0.999
    worm.bent=4.0 | worm.bent | within ±π
    worm.bent=-1.2 | worm.bent | does not swing
    """,
)


def test_a_load_that_outruns_the_ground_is_refused():
    with pytest.raises(SolveError, match="largest that the ground can hold"):
        _solved("planar_three_link", "load.ahead=50.0")
