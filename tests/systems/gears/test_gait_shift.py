"""Gears, transitions, supervisor, hindsight: closed forms, other routes, all schedules."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from block_waves import DRAG, LIMITS, wave
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.control.lambda_tracker import lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, Switch
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.tables import CoulombFriction, SpikeFriction
from wormopt.systems.gears.box import GearBox, Transition, gear_box, shortest_transition
from wormopt.systems.gears.checks import round_trip, tried
from wormopt.systems.gears.gear import Gear, Ground, Limits
from wormopt.systems.gears.hindsight import best_schedule, ideal_time
from wormopt.systems.gears.model import geared_chain, geared_worm
from wormopt.systems.gears.tables import Adaptive
from wormopt.systems.gears.walk import (
    Done,
    Supervised,
    Supervisor,
    Walk,
    by_schedule,
    kept,
    supervise,
    walk,
)
from wormopt.systems.spiked.construct import accordion, block_wave
from wormopt.systems.spiked.crawl import crawl

FLAT, TOP = 1.3, 3.87


def squeeze(links: int = 4, period: float = 7.2) -> Gear:
    gait = accordion(links, period, (0.7, 1.3), "trapezoid")
    return Gear("accordion", gait, np.ones(links + 1), DRAG)


def one_link(length: tuple[float, float], period: float = 4.0) -> Gear:
    """A worm of one link, at rest where it is shortest and longest."""
    return Gear(str(length), accordion(1, period, length, "quintic"), np.ones(2), 0.0)


@cache
def box() -> GearBox:
    return gear_box([squeeze(), wave(4, 3), wave(4, 2)], LIMITS, arcs=8)


def hill(height: float = TOP, stretch: float = 1.0) -> Ground:
    place = stretch * np.array([60.0, 120.0, 150.0, 210.0])
    return Ground(place, np.array([FLAT, height, height, FLAT]), np.full(4, DRAG), np.zeros(4))


def even(load: float) -> Ground:
    return Ground(np.zeros(1), np.array([load]), np.array([DRAG]), np.zeros(1))


def begin(gears: GearBox, gear: int) -> np.ndarray:
    place = -np.concatenate([[0.0], np.cumsum(gears.gears[gear].lengths[0])])
    return place - place.mean()


def supervisor(down: float = 0.9, up: float = 0.85, dwell: float = 10.0) -> Supervisor:
    return supervise(box(), LIMITS, down=down, up=up, dwell=dwell)


def walked(ground: Ground, goal: float, gear: int = 2, choose: Any = None) -> Walk:
    choose = choose or Supervised(box(), supervisor())
    return walk(
        box(), ground, begin(box(), gear), box().first_row(gear), choose, goal, 100.0 * goal
    )


def gears_of(found: Walk) -> list[int]:
    """Gears one after another."""
    gear = np.array([box().rows[number].gear for number in found.row])
    return gear[np.append(True, np.diff(gear) != 0)].tolist()


# -- ground and gears ----------------------------------------------------------------------------


@settings(max_examples=examples(30))
@given(
    values=st.lists(st.floats(0, 10), min_size=1, max_size=5),
    place=st.lists(st.floats(-3, 8), min_size=1, max_size=4),
)
def test_ground_is_the_same_for_numbers_and_symbols(values: list[float], place: list[float]):
    knots = np.arange(len(values), dtype=float)
    ground = Ground(knots, np.array(values), 0 * knots, 0 * knots)
    x = ca.SX.sym("x", len(place))
    found = ca.Function("load", [x], [ground.expression("load", x)])(place)
    assert np.array(found).ravel() == pytest.approx(ground.at("load", np.array(place)), abs=1e-9)


@pytest.mark.parametrize("place", [[1.0, 1.0], [2.0, 1.0], []])
def test_places_ascend(place: list[float]):
    numbers = np.zeros(len(place))
    with pytest.raises(ArgumentError, match="do not increase"):
        Ground(np.array(place), numbers, numbers, numbers)


@settings(max_examples=examples(12))
@given(
    links=st.integers(1, 6),
    share=st.floats(0, 1),
    drag=st.floats(0, 2),
    extra=st.floats(0, 5),
    seed=st.integers(0, 99),
)
def test_a_gear_loads_as_the_crawl_says(
    links: int, share: float, drag: float, extra: float, seed: int
):
    mass = np.random.default_rng(seed).uniform(0.5, 2.0, links + 1)
    gait = block_wave(links, 1 + round(share * (links - 1)), 3.0, (0.8, 1.2), "trapezoid")
    gear = Gear("wave", gait, mass, drag)
    load = gear.least + extra + 1e-6
    motion = crawl(gait, mass.tolist(), drag, load)
    assert gear.speed == pytest.approx(motion.speed, rel=1e-12)
    assert gear.resting == motion.resting_min
    assert gear.least == pytest.approx(motion.smallest_load, rel=1e-9)
    assert gear.spike_peak(load) == pytest.approx(motion.extremes("reaction")[1].max(), rel=1e-9)
    force = max(np.abs(v).max() for v in motion.extremes("actuator_force"))
    assert gear.actuator_peak(load) == pytest.approx(force, rel=1e-9)
    mean = motion.integral("reaction").sum() / gear.period
    assert gear.spike_mean(load) == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("gear", [squeeze(), wave(4, 2), wave(3, 1, profile="quintic")])
def test_what_a_gear_bears_brings_it_to_its_limit(gear: Gear):
    spike, force = gear.bears(LIMITS)
    mass = gear.mass.tolist()
    assert crawl(gear.gait, mass, DRAG, spike).extremes("reaction")[1].max() == pytest.approx(12.0)
    actuator = crawl(gear.gait, mass, DRAG, force).extremes("actuator_force")
    assert max(np.abs(v).max() for v in actuator) == pytest.approx(20.0)
    assert gear.bears(replace(LIMITS, actuator=0.1))[1] == -math.inf


def test_more_at_rest_are_slower_and_bear_more():
    """Speed (n + 1 - a) D / T; the inertia of the masses that move is shared by a spikes."""
    found = [wave(5, a, 6.0) for a in range(1, 6)]
    speeds = [(6 - a) * 0.4 / 6.0 for a in range(1, 6)]
    assert [gear.speed for gear in found] == pytest.approx(speeds)
    borne = [gear.bears(LIMITS)[0] for gear in found]
    assert borne == sorted(borne)
    # peak acceleration of a trapezoid of ramps 1/4: D / (phase² (1 - 1/4) / 4)
    peak, top = 0.4 / (0.75 * 0.25), 0.4 / 0.75
    assert borne == pytest.approx(
        [(12.0 * a - (6 - a) * (peak + DRAG * top)) / 6 for a in range(1, 6)]
    )


def test_a_slow_gear_with_more_inertia_is_outdone():
    """The quintic's peak acceleration is 5.77 D / T² where the trapezoid's is 5.33 D / T²."""
    quick, slow = wave(4, 2, 5.0), wave(4, 2, 5.02, profile="quintic")
    assert slow.outdone(quick, LIMITS)
    assert not quick.outdone(slow, LIMITS)
    assert not wave(4, 3).outdone(quick, LIMITS)


def test_gaits_that_are_no_gears_are_refused():
    with pytest.raises(ArgumentError, match="has harmonics"):
        Gear("cosine", block_wave(2, 1, 1.0, (0.8, 1.2)), np.ones(3), 0.0)
    with pytest.raises(ArgumentError, match="rates jump"):
        Gear("corners", block_wave(2, 1, 1.0, (0.8, 1.2), "trapezoid", 0.0), np.ones(3), 0.0)


# -- transitions ---------------------------------------------------------------------------------


def test_the_shortest_transition_of_one_link_is_that_of_a_double_integrator():
    """From rest at 1.0 to rest at 1.2 with |l''| <= 2.5: 2 sqrt(0.2 / 2.5)."""
    free = Limits(100.0, math.inf, 10.0, 2.5, (0.5, 2.0))
    low, high = one_link((0.8, 1.0)), one_link((1.2, 1.5))
    load = (5.0, 10.0)
    for pair in ((low, high), (high, low)):
        found = shortest_transition(*pair, free, load, arcs=8)
        assert found.duration == pytest.approx(2 * math.sqrt(0.2 / 2.5), rel=2e-4)
    slow = replace(free, rate=0.3)  # 0.2 / 0.3 + 0.3 / 2.5
    errors = [
        shortest_transition(low, high, slow, load, arcs=arcs).duration - (0.2 / 0.3 + 0.3 / 2.5)
        for arcs in (5, 20, 40)
    ]
    assert min(errors) > -1e-12
    assert errors[-1] < 5e-3
    assert errors[-1] < errors[0] / 6


def test_more_load_than_inertia_lets_lengthens_a_transition():
    """Masses 1 and 1, one rests: m a <= limit - 2 load forward, m a >= -2 load backward."""
    low, high = one_link((0.8, 1.0)), one_link((1.2, 1.5))
    most, load = 4.0, 1.5
    limits = Limits(most, math.inf, 10.0, 50.0, (0.5, 2.0))
    up, down = most - 2 * load, 2 * load
    # speed up with `up`, slow down with `down`: way = v² / 2 (1 / up + 1 / down)
    top = math.sqrt(2 * 0.2 / (1 / up + 1 / down))
    exact = top / up + top / down
    found = shortest_transition(low, high, limits, (load, load), arcs=40)
    assert exact * (1 - 1e-9) <= found.duration <= 1.01 * exact


@pytest.mark.parametrize(
    ("links", "resting"), [(2, 1), (4, 1), (6, 3), pytest.param(9, 5, marks=pytest.mark.slow)]
)
def test_neighbouring_waves_meet_at_rest(links: int, resting: int):
    """Block waves of a and of a + 1 at rest with the same lengths share a shape at rest."""
    wide = Limits(1e3, math.inf, 10.0, 100.0, (0.8, 1.2))
    pair = wave(links, resting), wave(links, resting + 1)
    for before, after in (pair, pair[::-1]):
        found = shortest_transition(before, after, wide, (50.0, 60.0))
        assert found.strokes == ()
        leaves = before.lengths[found.leaves % len(before.strokes)]
        assert after.lengths[found.enters] == pytest.approx(leaves, abs=1e-12)


PAIRS = {
    "accordion to wave": (squeeze(), wave(4, 2)),
    "wave to accordion": (wave(4, 2), squeeze()),
    "far apart": (wave(4, 1), wave(4, 3)),
    "other lengths": (wave(3, 1, 4.0), wave(3, 2, 4.0, length=(0.75, 1.25))),
}


@cache
def found_transition(name: str) -> tuple[Gear, Gear, Transition]:
    before, after = PAIRS[name]
    load = max(before.least, after.least), min(*before.bears(LIMITS), *after.bears(LIMITS))
    return before, after, shortest_transition(before, after, LIMITS, load, arcs=8)


@pytest.mark.parametrize(
    "name", ["accordion to wave", *(pytest.param(n, marks=pytest.mark.slow) for n in [*PAIRS][1:])]
)
def test_transitions_join_smoothly_and_keep_the_links_limits(name: str):
    before, after, found = found_transition(name)
    lengths, rates = [before.lengths[found.leaves]], []
    velocity = before.strokes[found.leaves].velocity[:, 0]
    for stroke in found.strokes:
        s = np.linspace(0.0, stroke.duration, 41)
        assert stroke.at(np.zeros(1))[:, 0] == pytest.approx(velocity, abs=1e-9)
        velocity = stroke.at(s[-1:])[:, 0]
        lengths += [*(lengths[-1][:, None] - np.diff(stroke.at(s, -1), axis=0)).T]
        rates.append(np.diff(stroke.at(s), axis=0))
        assert np.abs(np.diff(stroke.at(s, 1), axis=0)).max() <= 2.5 * (1 + 1e-9)
        assert stroke.at(s).min() >= -1e-9
        assert np.all(stroke.velocity[list(found.resting)] == 0)
    assert velocity == pytest.approx(after.strokes[found.enters].velocity[:, 0], abs=1e-9)
    assert lengths[-1] == pytest.approx(after.lengths[found.enters], abs=1e-9)
    if found.strokes:
        assert np.abs(np.hstack(rates)).max() <= 0.6 * (1 + 1e-9)
    assert np.min(lengths) >= 0.7 - 1e-9
    assert np.max(lengths) <= 1.3 + 1e-9


@pytest.mark.parametrize("lower", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_masses_at_rest_stay_at_rest_where_gears_are_unknown(lower: int):
    """Independent integration of (7) along a round trip, at the least and the largest load."""
    slow, fast = box().gears[lower : lower + 2]
    trip = round_trip(box(), lower)
    load = max(slow.least, fast.least) + 1e-9, min(*slow.bears(LIMITS), *fast.bears(LIMITS))
    for each in load:
        found = tried(box(), trip, each)
        assert (found.moved, found.glides, found.impulses) == (0.0, 0, 0)
        assert found.advance < 1e-12
    motion = crawl(trip.gait, [1.0] * 5, DRAG, load[1])
    assert motion.extremes("reaction")[1].max() <= 12.0 * (1 + 1e-9)
    assert max(np.abs(v).max() for v in motion.extremes("actuator_force")) <= 20.0 * (1 + 1e-9)


def test_a_mass_that_moves_or_a_corner_would_be_seen():
    trip = round_trip(box(), 1)
    start, stop, resting = trip.spells[0]
    other = replace(trip, spells=((start, stop, (*resting, 2)),))
    assert tried(box(), other, 1.5).moved > 0.3 * (stop - start) / trip.gait.period
    bent = trip.gait.polynomial.copy()
    piece = int(np.argmin(np.abs(trip.gait.breaks - start)))
    bent[piece, 2, 1] += 0.05
    jerked = replace(trip, gait=Gait(trip.gait.breaks, bent))
    found = tried(box(), jerked, 1.5)
    assert found.glides + found.impulses > 0 or found.moved > 0


def test_transitions_that_cannot_be_are_refused():
    narrow = replace(LIMITS, spike=0.01)
    with pytest.raises(SolveError, match="no transition"):
        shortest_transition(wave(4, 1), wave(4, 3), narrow, (1.0, 2.0), arcs=4, most=9)
    with pytest.raises(SolveError, match="no transition"):
        shortest_transition(squeeze(), wave(4, 2), LIMITS, (1.3, 1.5), resting=3, arcs=4, most=9)
    with pytest.raises(ArgumentError, match="equally fast"):
        gear_box([wave(4, 2), wave(4, 2)], LIMITS)
    with pytest.raises(ArgumentError, match="no common load"):
        gear_box([wave(4, 1, 2.0), wave(4, 2, 5.0)], LIMITS)


# -- supervisor ----------------------------------------------------------------------------------


@settings(max_examples=examples(12))
@given(gear=st.integers(0, 2), share=st.floats(0.02, 0.98))
def test_measured_means_tell_the_load_exactly(gear: int, share: float):
    """On even ground sums over a cycle are those in closed form, so thresholds mean loads."""
    own = box().gears[gear]
    load = own.least + share * (min(own.bears(LIMITS)) - own.least)
    sums = np.zeros(2)

    def watched(done: Done) -> int:
        nonlocal sums
        sums += done.spike, done.actuator
        return done.row.follows if not done.row.ends_cycle else 10**6

    with pytest.raises(IndexError):
        walked(even(load), 100.0, gear, watched)
    expected = own.spike_mean(load), own.actuator_square(load)
    assert sums / own.period == pytest.approx(expected, rel=1e-9)


@settings(max_examples=examples(20))
@given(load=st.floats(1.3, 5.5), gear=st.integers(0, 2))
def test_on_even_ground_the_worm_settles_in_one_gear(load: float, gear: int):
    """No hunting: it shifts one way only, and ends in a gear whose peaks stay below `down`."""
    found = gears_of(walked(even(load), 30.0, gear))
    assert found in (sorted(set(found)), sorted(set(found), reverse=True))
    last = box().gears[found[-1]]
    assert last.spike_peak(load) <= 0.9 * 12.0 * (1 + 1e-9) or found[-1] == 0
    if found[-1] < 2:
        assert max(
            box().gears[found[-1] + 1].spike_peak(load) / 12.0,
            box().gears[found[-1] + 1].actuator_peak(load) / 20.0,
        ) >= 0.85 * (1 - 1e-9)


def test_dwell_delays_a_shift():
    steep = Ground(np.array([0.0, 1.0]), np.array([FLAT, TOP]), np.full(2, DRAG), np.zeros(2))
    times = []
    for dwell in (0.0, 40.0):
        choose = Supervised(box(), supervisor(dwell=dwell))
        found = walked(steep, 30.0, 2, choose)
        gear = np.array([box().rows[number].gear for number in found.row])
        times.append(found.time[1 + np.flatnonzero(np.diff(gear))])
        assert gears_of(found) == [2, 1, 0]
    assert np.diff(times[0])[0] < 40.0 <= np.diff(times[1])[0]


def test_an_alarm_is_raised_within_a_cycle_where_the_load_is_too_much():
    """Even ground on which gear 2 bears too little: after a stroke, not after a cycle."""
    for load, alarmed in ((1.5, False), (2.0, True)):
        raised: list[Done] = []

        def watched(done: Done, raised: list[Done] = raised) -> int:
            raised += [done] if done.spike > supervisor().alarm[done.number] else []
            return done.row.follows

        walked(even(load), 3.0, 2, watched)
        assert bool(raised) == alarmed
        assert not raised or raised[0].time < box().gears[2].period / 2


def test_the_tow_pulls_on_the_tail_alone():
    towed = Ground(np.zeros(1), np.array([1.0]), np.array([DRAG]), np.array([5.0]))
    alike = even(2.0)
    ends = [walked(ground, 4.0, 0, kept) for ground in (towed, alike)]
    assert ends[0].spike == pytest.approx(ends[1].spike)  # together they weigh as much
    assert ends[0].actuator.max() > 1.1 * ends[1].actuator.max()


# -- the way -------------------------------------------------------------------------------------


def test_the_supervised_worm_takes_the_hill_as_nobody_in_one_gear_can():
    """The numbers of the packaged scene, but for drag that varies."""
    goal, found = 270.0, walked(hill(), 270.0)
    best = best_schedule(box(), hill(), LIMITS, 0.0, goal, 2)
    assert gears_of(found) == [2, 1, 0, 1, 2]
    assert best.time / found.arrival >= 0.9
    assert found.spike.max() <= 12.0
    assert found.actuator.max() <= 20.0
    assert found.total.min() > 0


@pytest.mark.slow
def test_what_is_best_in_hindsight_can_be_walked_and_no_less_time_will_do():
    ground, goal = hill(TOP, 0.3), 80.0
    best = best_schedule(box(), ground, LIMITS, 0.0, goal, 2)
    again = walked(ground, goal, 2, by_schedule(best.rows))
    assert again.arrival == pytest.approx(best.time, rel=1e-7)
    assert again.spike.max() <= 12.0 * (1 + 1e-6)
    assert again.total.min() >= 0
    assert ideal_time(box(), ground, LIMITS, 0.0, goal) <= best.time
    finer = best_schedule(box(), ground, LIMITS, 0.0, goal, 2, fineness=8)
    assert finer.time == pytest.approx(best.time, rel=1e-3)
    assert finer.time <= walked(ground, goal).arrival


def all_schedules(ground: Ground, goal: float, gear: int) -> float:
    """Least time over all schedules, one stroke after another, that keep the limits."""
    rows, best = box().rows, math.inf
    stack = [(box().first_row(gear), 0.0, begin(box(), gear))]
    while stack:
        number, time, place = stack.pop()
        one = walk(box(), ground, place, number, kept, place.mean() + 1e-15, 1e9)
        if len(one.row) == 0 or one.spike[0] > 12 or one.actuator[0] > 20 or one.total[0] < 0:
            continue
        row, there = rows[number], place + rows[number].stroke.way
        if there.mean() >= goal:
            best = min(best, time + row.stroke.until(goal - place.mean()))
            continue
        for following in {row.follows, row.slower, row.faster} - {None}:
            assert following is not None
            stack.append((following, time + row.stroke.duration, there))
    return best


@pytest.mark.parametrize("height", [2.6, pytest.param(FLAT, marks=pytest.mark.slow), TOP])
def test_hindsight_is_as_good_as_trying_all_schedules(height: float):
    ground = Ground(np.array([1.0, 3.0]), np.array([FLAT, height]), np.full(2, DRAG), np.zeros(2))
    goal = 4.5
    exact = all_schedules(ground, goal, 2)
    if math.isinf(exact):
        with pytest.raises(SolveError, match="no schedule"):
            best_schedule(box(), ground, LIMITS, 0.0, goal, 2, fineness=200)
        return
    found = best_schedule(box(), ground, LIMITS, 0.0, goal, 2, fineness=200)
    assert found.time == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("links", "resting"), [(9, 4), (12, 6)])
def test_hindsight_does_not_hang_on_its_bins(links: int, resting: int):
    """Long cycles, of which few fill the way: who is later but further must not be dropped."""
    limits = replace(LIMITS, spike=16.0, actuator=math.inf)
    gears = [wave(links, a, links + 1.0) for a in (resting, resting + 1)]
    pair = gear_box(gears, limits)
    slow, fast = (gear.bears(limits)[0] for gear in pair.gears)
    load = np.array([0.6 * fast, fast + 0.4 * (slow - fast)])
    rising = Ground(np.array([5.0, 60.0]), load, np.full(2, DRAG), np.zeros(2))
    found = [
        best_schedule(pair, rising, limits, 0.0, 50.0, 1, fineness=fineness).time
        for fineness in (1, 3, 9)
    ]
    assert found == pytest.approx([found[0]] * 3, rel=1e-9)
    choose = Supervised(pair, supervise(pair, limits, down=0.9, up=0.8, dwell=0.0))
    own = walk(pair, rising, begin(pair, 1), pair.first_row(1), choose, 50.0, 1e4)
    assert own.spike.max() <= 16.0
    assert found[0] <= own.arrival


def test_a_hill_too_high_has_no_schedule():
    with pytest.raises(SolveError, match="no schedule"):
        best_schedule(box(), hill(9.0, 0.1), LIMITS, 0.0, 30.0, 2)
    assert ideal_time(box(), hill(9.0), LIMITS, 0.0, 270.0) == math.inf


def test_gears_that_glide_on_light_ground_are_named():
    with pytest.raises(SolveError, match=r"gears glide: .*accordion below") as refused:
        best_schedule(box(), even(0.0), LIMITS, 0.0, 5.0, 2)
    assert "longer periods" in refused.value.suggestion


def test_the_last_stroke_counts_until_the_goal():
    """An accordion that has not yet reached its greatest speed: by closed form of the ramp."""
    gear, goal = box().gears[2], 1e-6
    found = walked(even(FLAT), goal, choose=kept)
    stroke = gear.strokes[0]
    lift = stroke.velocity[:, 1].mean() / 2
    assert found.arrival == pytest.approx(math.sqrt(goal / lift), rel=1e-6)
    needed = 5 * FLAT + stroke.velocity[:, 1].sum()  # and the drag of the last instant
    needed += DRAG * stroke.velocity[:, 1].sum() * found.arrival
    assert found.spike.max() == pytest.approx(needed / len(stroke.resting), rel=1e-6)


def test_limits_that_mean_none_allow_every_transition_that_others_allow():
    slow, fast = wave(4, 2), squeeze()
    loose = replace(LIMITS, rate=1e9, acceleration=1e9)
    load = (1.3, 1.5)
    usual, free = (
        shortest_transition(slow, fast, limits, load, arcs=8) for limits in (LIMITS, loose)
    )
    assert 0 < free.duration <= usual.duration * (1 + 1e-3)


def test_a_far_start_takes_no_digits():
    near, far = (
        load_scene(
            "gait_shift",
            {
                "way": {"start": start, "goal": start + 12.0},
                "ground.place": [start + place for place in (0.0, 3.0, 6.0, 9.0)],
            },
        ).table
        for start in (0.0, 2.0**20)
    )
    assert near.fixed[0].arrival == far.fixed[0].arrival


# -- models --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("route", ["native", "python"])
def test_the_model_with_switches_does_what_the_walk_does(route: Any):
    ground, goal = hill(TOP, 0.3), 80.0
    model = geared_worm(box(), ground, supervisor(), gear=2, begin=begin(box(), 2), goal=goal)
    motion = simulate(model, 1e4, dense=True, route=route)
    again = walked(ground, goal)
    assert motion.end_time == pytest.approx(again.arrival, rel=1e-7)
    assert motion.largest("spike_load") == pytest.approx(again.spike.max(), rel=1e-5)
    assert motion.largest("actuator_force") == pytest.approx(again.actuator.max(), rel=1e-5)
    strokes = [event for event in motion.events if event.name == "a stroke ends"]
    assert len(strokes) == len(again.row) - 1


@pytest.mark.parametrize(("slides", "rel"), [(None, 1e-9), (0.4, 2e-4)])
def test_the_chain_shares_alike_and_measures_what_balances(slides: float | None, rel: float):
    """Forces of those that hold, summed over time, are momentum gained, load, drag and friction.

    With spikes the feed-forward is exact on even ground: none carries more than the gear's peak.
    """
    load, gear = 1.5, box().gears[0]
    place, strokes = begin(box(), 0), gear.strokes[:-1]
    end = sum(stroke.duration for stroke in strokes)
    friction = CoulombFriction(forward=slides, backward=50.0) if slides else SpikeFriction()
    links = Adaptive(
        stiffness=200.0, damping=10.0, friction=friction, tube_radius=0.02, gain_start=10.0,
        growth=10.0, memory=1.25,
    )  # fmt: skip
    loop = geared_chain(box(), even(load), supervisor(), links, gear=0, begin=place, goal=99.0)
    motion = simulate(loop, end, route="python", tolerance=Tolerance(1e-8, 1e-9), dense=True)
    balance = motion["velocity"][:, -1].sum() + 5 * load * end
    balance += DRAG * (motion["position"][:, -1] - place).sum()
    rubbing = sum(stroke.duration * (5 - len(stroke.resting)) for stroke in strokes)
    balance += (slides or 0.0) * rubbing
    assert motion["spike_sum"][0, -1] == pytest.approx(balance, rel=rel)
    if not slides:
        assert motion.largest(loop.forces) == pytest.approx(gear.spike_peak(load), rel=1e-6)
        assert motion.largest("link_force") == pytest.approx(gear.actuator_peak(load), rel=1e-6)


def test_the_largest_value_is_found_where_a_stroke_ends():
    """0.9999 throughout, but for one stroke in which it grows from 0 to 1 and then jumps."""
    clock, count = ca.SX.sym("clock"), ca.SX.sym("count")
    model = Model(
        name="strokes",
        x=[Signal("clock", clock, value=0.0), Signal("count", count, value=0.0)],
        ode=ca.SX([1.0, 0.0]),
        outputs=[Output("load", ca.if_else(ca.eq(count, 1), clock, 0.9999), "force")],
        switches=[Switch("a stroke ends", clock - 1, ca.vertcat(0, count + 1))],
    )
    motion = simulate(model, 2.5, dense=True, route="python")
    assert motion.largest("load") == pytest.approx(1.0, abs=1e-6)


def test_closing_a_loop_keeps_what_ends_the_motion():
    """A terminal switch of the plant is one of the loop too."""
    worm = chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=1.0, drag=0.5)
    own = ca.vertcat(*(signal.symbol for signal in worm.x))
    ends = Switch("arrives", worm["position"][0] - 9.0, own, terminal=True)
    still = Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 1.0))
    loop = lambda_tracker(
        replace(worm, switches=[ends]), gait_reference(still, worm.t), tube_radius=0.1
    )
    assert [switch.terminal for switch in loop.switches] == [True]


@pytest.mark.slow
def test_long_worms_shift_too():
    """32 masses: from 8 at rest to 12 and back, under the largest load that both bear."""
    limits = Limits(60.0, math.inf, 0.8, 3.5, (0.75, 1.25))
    slow, fast = wave(31, 12, 32.0), wave(31, 8, 32.0)
    load = max(slow.least, fast.least), min(*slow.bears(limits), *fast.bears(limits))
    up = shortest_transition(slow, fast, limits, load, arcs=6, most=40)
    down = shortest_transition(fast, slow, limits, load, arcs=6, most=40)
    trip = round_trip(GearBox((slow, fast), (up,), (down,)), 0)
    found = tried(GearBox((slow, fast), (up,), (down,)), trip, load[1])
    assert (found.moved, found.glides, found.impulses) == (0.0, 0, 0)
