"""The closed-form crawl of a worm with spikes, (1)-(7): formulas, hand-solved cases, invariants."""

import math

import numpy as np
import pytest
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from smooth_gaits import glide_by_hand, hermite_gait, safe_load, smooth_gaits

from wormopt.errors import SolveError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.systems.spiked.bimodal import BimodalMotion, integrate
from wormopt.systems.spiked.construct import (
    Profile,
    accordion,
    block_wave,
    fast_gait,
    travelling_sine,
)
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.limits import Sharing

PROFILES: tuple[Profile, ...] = ("cosine", "quintic", "trapezoid")
RULES: tuple[Sharing, ...] = ("equal", "least_actuation")


def mean_load(motion: Crawl) -> float:
    """Mean of lambda over the period, impulses included."""
    pushes = sum(size for _, size in motion.impulses) / (motion.gait.links + 1)
    return (float(motion.integral("reaction_mean")[0]) + pushes) / motion.gait.period


def closed_glides(motion: Crawl) -> list[tuple[float, float]]:
    """Glides with one that passes the end of the period joined, its end before its start."""
    glides, period = list(motion.glides), motion.gait.period
    if len(glides) > 1 and glides[0][0] == 0 and abs(glides[-1][1] - period) < 1e-12 * period:
        glides = [*glides[1:-1], (glides[-1][0], glides[0][1])]
    return glides


def assert_as_stepped(motion: Crawl, stepped: BimodalMotion, longer: float = 0.0) -> None:
    """Of glides those that last longer."""
    assert motion.advance == pytest.approx(stepped.advance, abs=1e-9)
    low, high = (float(end[0]) for end in motion.extremes("reaction_mean"))
    known = stepped.lambda_min, stepped.lambda_max
    assert (low, high) == pytest.approx(known, abs=1e-8 * stepped.lambda_max)
    found, expected = (
        np.array([g for g in glides if abs(g[1] - g[0]) > longer])
        for glides in (closed_glides(motion), stepped.glides)
    )
    assert found == pytest.approx(expected, abs=1e-7)


# --- Gait (15) ---------------------------------------------------------------------------


def test_gait_15_has_the_loads_of_theory():
    """Numbers of the corrected theory for m = 1, k = 1, Gamma = 20, T = 1, l0 = 2, e = 0.15."""
    motion = crawl(fast_gait(1.0), [1.0] * 3, 1.0, 20.0)
    low, high = motion.extremes("reaction_mean")
    assert motion.advance == pytest.approx(1.2, abs=1e-12)
    assert (low[0], high[0]) == pytest.approx((2.234712, 37.865008), abs=1e-6)
    assert mean_load(motion) == pytest.approx(21.2, abs=1e-12)
    assert motion.extremes("reaction")[1] == pytest.approx([113.595024] * 3, abs=1e-6)
    assert motion.integral("reaction").sum() == pytest.approx(63.6, abs=1e-11)
    sample = motion.sample()
    carried = sample["reaction"][sample["resting"] == 1]
    assert carried.min() == pytest.approx(6.704136, abs=1e-6)
    assert motion.resting_sequence == [[1], [0], [2]]
    assert (motion.resting_min, motion.glides) == (1, [])
    assert motion.smallest_load == pytest.approx(17.765288, abs=1e-6)


@settings(max_examples=examples(20))
@given(
    mass=st.floats(0.1, 5),
    drag=st.floats(0, 4),
    period=st.floats(0.2, 5),
    rest_length=st.floats(0.5, 3),
    elongation=st.floats(0.02, 0.4),
    excess=st.floats(0.001, 2),
)
def test_loads_of_gait_15_follow_their_formulas(
    mass: float, drag: float, period: float, rest_length: float, elongation: float, excess: float
):
    """lambda_min and lambda_max in general, and the thresholds of gliding that follow."""
    stroke = elongation * rest_length
    threshold = 6 * math.pi**2 * stroke * mass / period**2
    load = threshold * (1 + excess)
    motion = crawl(fast_gait(period, rest_length, elongation), [mass] * 3, drag, load)
    top = 2 * math.pi * stroke / period * math.hypot(3 * math.pi * mass / period, drag)
    low, high = motion.extremes("reaction_mean")
    assert low[0] == pytest.approx(load - threshold, abs=1e-10 * load)
    assert high[0] == pytest.approx(load + top, rel=1e-11)
    assert motion.advance == pytest.approx(4 * stroke, rel=1e-12)
    # Where W0 = 0 drag does nothing, and there lambda is smallest: k plays no part in either.
    assert motion.smallest_load == pytest.approx(threshold, rel=1e-10)
    shortest = math.pi * math.sqrt(6 * stroke * mass / load)
    assert motion.smallest_period == pytest.approx(shortest, rel=1e-10)


@pytest.mark.parametrize("period", [1e-30, 1e-3, 1e3])
def test_the_smallest_period_is_that_of_the_shape(period: float):
    """However far from it the period is that the gait was given."""
    drive = ([1.0, 2.0, 1.0], 0.5, 20.0)
    far, near = (crawl(fast_gait(t), *drive).smallest_period for t in (period, 1.0))
    assert far == pytest.approx(near, rel=1e-12)


@pytest.mark.parametrize(
    ("drag", "load"),
    [(1.0, 17.0), (0.2, 17.5), (2.0, 12.0), (120.0, 16.0), (900.0, 16.0), (4e3, 9.0)],
)
def test_glides_of_gait_15_agree_with_two_independent_solutions(drag: float, load: float):
    motion = crawl(fast_gait(1.0), [1.0] * 3, drag, load)
    start, end, gain = glide_by_hand(drag, load)
    by_hand = [(start + q / 3, (end + q / 3) % 1.0) for q in range(3)]
    stepped = integrate(fast_gait(1.0), [1.0] * 3, drag, load)
    found = np.array(closed_glides(motion))
    assert found == pytest.approx(np.array(by_hand), abs=1e-9)
    assert found == pytest.approx(np.array(stepped.glides), abs=1e-9)
    assert motion.advance == pytest.approx(1.2 + 3 * gain, abs=1e-11)
    assert stepped.advance == pytest.approx(1.2 + 3 * gain, abs=1e-10)
    assert mean_load(motion) == pytest.approx(drag * motion.speed + load, abs=1e-11)
    assert motion.resting_min == 0
    assert motion.extremes("reaction_mean")[0][0] >= -1e-9


@pytest.mark.parametrize("drag", [1e4, 1e12, 3e16, 1e20])
def test_where_drag_is_all_the_worm_glides_by_the_pull_over_the_drag(drag: float):
    # without inertia all slip at V = 0.3, pull over drag; spikes hold where W0 is more
    top, omega, pull = 0.6 * math.pi, 3 * math.pi, 0.3
    phase = math.asin(pull / top)
    motion = crawl(fast_gait(1.0), [1.0] * 3, drag, -pull * drag)
    known = 3 * (2 * phase / omega * pull + 2 * top / omega * math.cos(phase))
    assert motion.advance == pytest.approx(known, abs=3 / drag + 1e-10)
    assert motion.extremes("velocity")[0].min() >= -1e-9


# --- Constructed gaits -------------------------------------------------------------------


@pytest.mark.parametrize("profile", PROFILES)
def test_block_waves_and_accordions_have_their_speed(profile: Profile):
    """Speed (n + 1 - a) D / T and a masses at rest; n D / T for the accordion."""
    period, short, long = 1.3, 1.0, 1.35
    unit = (long - short) / period
    for links in range(1, 6):
        mass = [1.0] * (links + 1)
        for resting in range(1, links + 1):
            gait = block_wave(links, resting, period, (short, long), profile)
            motion = crawl(gait, mass, 0.4, safe_load_of_wave(links, unit / period))
            assert motion.speed == pytest.approx((links + 1 - resting) * unit, rel=1e-12)
            assert motion.resting_min == resting
            assert {len(s) for s in motion.resting_sequence} == {resting}
            assert len(motion.resting_sequence) == links + 1
        gait = accordion(links, period, (short, long), profile)
        motion = crawl(gait, mass, 0.4, safe_load_of_wave(links, unit / period))
        assert motion.speed == pytest.approx(links * unit, rel=1e-12)
        assert motion.resting_sequence == [[0], [links]]


def safe_load_of_wave(links: int, acceleration: float) -> float:
    """No profile's link acceleration exceeds 6 D / (phase duration)^2 by any means."""
    return 6 * (links + 1) ** 2 * acceleration * links


# --- Invariants of any smooth gait -------------------------------------------------------


@settings(max_examples=examples(25))
@given(
    gait=smooth_gaits(),
    drag=st.sampled_from([0.0, 0.3, 2.0]),
    share=st.floats(0.02, 1.1),
    rule=st.sampled_from(RULES),
    data=st.data(),
)
def test_laws_of_motion_hold_for_any_smooth_gait(
    gait: Gait, drag: float, share: float, rule: Sharing, data: st.DataObject
):
    """Impulse balance, spikes' law, actuator recursion and work; with and without glides."""
    count = gait.links + 1
    mass = data.draw(st.lists(st.floats(0.3, 3), min_size=count, max_size=count))
    enough = safe_load(gait, mass)
    load = share * enough
    motion = crawl(gait, mass, drag, load, rule)
    assert (motion.impulses, motion.drops) == ((), ())
    if share > 1:
        assert motion.glides == []
        assert motion.smallest_load <= enough
    scale = enough + load + drag
    assert mean_load(motion) == pytest.approx(drag * motion.speed + load, abs=1e-9 * scale)
    low, high = motion.extremes("closure")
    assert max(-low[0], high[0]) < 1e-9 * scale
    assert motion.net_work == pytest.approx(motion.dissipation, abs=1e-9 * scale)
    assert motion.energy >= motion.net_work - 1e-12 * scale
    assert motion.extremes("velocity")[0].min() >= -1e-9
    assert motion.extremes("reaction")[0].min() >= -1e-8 * scale
    signals = motion.sample(200)
    assert np.abs(signals["velocity"] * signals["reaction"]).max() < 1e-8 * scale
    x = signals["position"]
    assert x[:, -1] - x[:, 0] == pytest.approx(np.full(count, motion.advance), abs=1e-12)
    assert np.diff(x, axis=1).min() >= -1e-12
    assert x[:-1] - x[1:] == pytest.approx(gait(signals["time"] - 1e-300), abs=1e-12)


@settings(max_examples=examples(20))
@given(
    gait=smooth_gaits(3), drag=st.floats(0, 3), share=st.floats(0.05, 0.9), ratio=st.floats(0.2, 5)
)
def test_time_stepping_over_events_finds_the_same_motion(
    gait: Gait, drag: float, share: float, ratio: float
):
    """Unequal masses, gliding and not, against the event-located integration."""
    mass = np.geomspace(1.0, ratio, gait.links + 1).tolist()
    load = share * safe_load(gait, mass)
    motion, stepped = crawl(gait, mass, drag, load), integrate(gait, mass, drag, load)
    assert_as_stepped(motion, stepped, 1e-3)


@pytest.mark.parametrize("share", [0.3, 0.7, 1.1])
@pytest.mark.parametrize(("links", "lag"), [(4, 0.2), (5, 0.13)])
def test_a_wave_of_one_piece_moves_as_stepped_over_events(links: int, lag: float, share: float):
    """Whose resting masses change many times within the piece."""
    gait = travelling_sine(links, 0.9, 1.0, 0.2, lag=lag)
    mass, load = np.linspace(1.0, 2.0, links + 1).tolist(), share * safe_load(gait, [1.5])
    motion = crawl(gait, mass, 0.8, load)
    assert len(motion.resting_sequence) >= links
    assert_as_stepped(motion, integrate(gait, mass, 0.8, load))


@settings(max_examples=examples(15))
@given(gait=smooth_gaits(3), factor=st.floats(0.1, 10), share=st.floats(0.05, 1))
def test_a_slower_clock_with_weaker_forces_gives_the_same_motion(
    gait: Gait, factor: float, share: float
):
    """With t -> c t, k -> k / c, Gamma -> Gamma / c^2 every force falls by c^2."""
    mass, drag = [1.0] * (gait.links + 1), 0.7
    load = share * safe_load(gait, mass)
    one = crawl(gait, mass, drag, load)
    slow = gait.with_period(factor * gait.period)
    two = crawl(slow, mass, drag / factor, load / factor**2)
    assert two.advance == pytest.approx(one.advance, rel=1e-10)
    assert two.speed * factor == pytest.approx(one.speed, rel=1e-10)
    assert np.array(two.glides) == pytest.approx(factor * np.array(one.glides), abs=1e-8 * factor)
    assert two.energy * factor**2 == pytest.approx(one.energy, rel=1e-9)
    assert two.effort * factor**4 == pytest.approx(one.effort, rel=1e-10)
    assert two.smallest_load * factor**2 == pytest.approx(one.smallest_load, rel=1e-9)
    assert two.smallest_period == pytest.approx(factor * one.smallest_period, rel=1e-9)


@settings(max_examples=examples(5))
@given(gait=smooth_gaits(3), drag=st.floats(0.1, 3), load=st.floats(0.5, 20))
def test_thresholds_part_gliding_from_crawling(gait: Gait, drag: float, load: float):
    mass = [1.0] * (gait.links + 1)
    motion = crawl(gait, mass, drag, load)
    least = motion.smallest_load
    assume(least > 0)
    for factor, glides in ((1 + 1e-6, False), (1 - 1e-4, True)):
        assert bool(crawl(gait, mass, drag, least * factor).glides) is glides
        paced = gait.with_period(motion.smallest_period * factor)
        assert bool(crawl(paced, mass, drag, load).glides) is glides


# --- Sharing rules -----------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["cosine", "quintic"])
@pytest.mark.parametrize("drag", [0.0, 3.0])
def test_series_follow_their_quantities_over_kinks(profile: Profile, drag: float):
    """Two spikes of four share by least actuation, and one of them is idle for a while."""
    gait = block_wave(3, 2, 1.0, (0.9, 1.2), profile)
    motion = crawl(gait, [1.0] * 4, drag, 15.0, "least_actuation")
    assert len(motion.parts) > len(motion.stretches)
    for stretch, series in motion.parts:
        s = np.random.default_rng(1).uniform(stretch.start, stretch.stop, 9)
        off = np.abs(series(s) - motion.quantities(stretch, s)).max()
        assert off < 1e-8 * motion.force_scale


# --- Samples -----------------------------------------------------------------------------


@settings(max_examples=examples(5))
@given(gait=smooth_gaits(3), share=st.floats(0.2, 1.1), points=st.integers(1, 300))
def test_samples_are_as_dense_as_asked_and_no_denser(gait: Gait, share: float, points: int):
    mass = [1.0] * (gait.links + 1)
    motion = crawl(gait, mass, 0.5, share * safe_load(gait, mass))
    sample = motion.sample(points)
    time = sample["time"]
    assert np.diff(time).max() <= gait.period / points * (1 + 1e-9)
    assert points < len(time) <= points + 2 * len(motion.parts)
    assert (time[0], sample["position"][0, 0]) == (0.0, 0.0)
    assert len(motion.sample(1)["time"]) == 2 * len(motion.parts)  # only ends


def test_a_motion_shows_its_signals_by_name():
    motion = crawl(fast_gait(1.0), [1.0] * 3, 1.0, 20.0)
    assert 600 < len(motion.time) <= 600 + 2 * len(motion.parts)
    dims = motion.to_xarray()["rate"].dims, motion.to_xarray()["velocity"].dims
    assert dims == (("link", "time"), ("mass", "time"))
    with pytest.raises(UnknownNameError, match="signal"):
        motion["speeds"]


# --- Work --------------------------------------------------------------------------------


def test_energy_of_a_gait_solved_by_hand():
    """One link with rate 1 - s, then s - 1, each for two time units.

    The mass that speeds up needs the power (k v + Gamma + m) v, the one that slows down
    (k v + Gamma - m) v, which is negative for v < (m - Gamma) / k; dt = dv in both.
    """
    mass, drag, load = 1.0, 0.8, 0.7
    gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1, -0.5]], [[1.0, -1, 0.5]]]))
    motion = crawl(gait, [mass, mass], drag, load)
    turn = (mass - load) / drag
    braking = drag * (1 - turn**3) / 3 + (load - mass) * (1 - turn**2) / 2
    assert motion.energy == pytest.approx(2 * (drag / 3 + (load + mass) / 2 + braking), rel=1e-13)
    assert motion.net_work == pytest.approx(4 * drag / 3 + 2 * load, rel=1e-13)
    assert motion.dissipation == pytest.approx(4 * drag / 3 + 2 * load, rel=1e-13)
    assert motion.energy > motion.net_work * 1.005
    assert motion.effort == pytest.approx(1.0, rel=1e-13)
    low, high = motion.extremes("actuator_force")
    top = drag + load + mass
    assert (low[0], high[0]) == pytest.approx((-top, top), rel=1e-13)


@pytest.mark.parametrize("drag", [0.0, 1.5])
def test_gait_15_spends_its_net_work_on_drag_and_height(drag: float):
    """In each third two masses move; the swing of one link, or of both together, moves them.

    Rests 1: mass 0 leaves it by l_1' and mass 2 follows by -l_2', each an arch r sin over a
    third with r = 3 pi e l0 (T = 1). The other thirds, rests 0 and rests 2, are such arches of
    two masses as well, so that the integral of sum v_i^2 is 3 * 2 * r^2 / 6.
    """
    rate = 3 * math.pi * 0.15 * 2
    net = drag * rate**2 + 3 * 20.0 * 1.2
    motion = crawl(fast_gait(1.0), [1.0] * 3, drag, 20.0)
    assert motion.net_work == pytest.approx(net, rel=1e-12)
    assert motion.dissipation == pytest.approx(net, rel=1e-12)


# --- Corners -----------------------------------------------------------------------------


@pytest.mark.parametrize("drag", [0.0, 0.9])
@pytest.mark.parametrize("mass", [1.0, 2.5])
def test_corners_solved_by_hand(drag: float, mass: float):
    """One link waits, grows at rate r, shrinks at rate r, each for one time unit.

    W0 jumps from 0 to r/2 at 1: an impulse 2 m r/2. At 2 the masses swap their velocities, W0
    stays. At 3 = 0 it falls to 0, so the worm is thrown forward with w = r/2, and
    m w' + k w + Gamma = 0 brings it to rest.
    """
    rate, load = 0.8, 3.0
    gait = Gait(
        np.array([0.0, 1.0, 1.5, 2.0, 3.0]),
        np.array([[[1.0, 0.0]], [[1.0, rate]], [[1.0 + rate / 2, rate]], [[1.0 + rate, -rate]]]),
    )
    motion = crawl(gait, [mass, mass], drag, load)
    assert motion.corners == [0.0, 1.0, 2.0]  # none at 1.5
    w = rate / 2
    if drag:
        stop = mass / drag * math.log1p(drag * w / load)
        slide = (mass * w - load * stop) / drag
    else:
        stop = mass * w / load
        slide = w * stop / 2
    assert motion.impulses == (pytest.approx((1.0, mass * rate), abs=1e-12),)
    assert motion.drops == (0.0,)
    assert motion.glides == [pytest.approx((0.0, stop), abs=1e-11)]
    assert motion.advance == pytest.approx(rate + slide, abs=1e-12)
    assert mean_load(motion) == pytest.approx(drag * motion.speed + load, abs=1e-12)
    assert motion.resting_sequence == [[], [0, 1], [1], [0]]
    assert (motion.smallest_load, motion.smallest_period) == (math.inf, math.inf)


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_corners_and_the_order_of_rest_are_those_of_the_shape(factor: float):
    """One of two links grows at rate 1, shrinks at rate 1, grows again: whatever the clock."""
    course = np.array([[2.0, 1.0], [3.0, -1.0], [1.0, 1.0]])
    gait = Gait(np.array([0.0, 1.0, 3.0, 4.0]), np.stack([course, 0 * course + [2, 0]], axis=1))
    motion = crawl(gait.with_period(4 * factor), [1.0] * 3, 0.0, 1e3 / factor**2)
    assert motion.corners == pytest.approx([factor, 3 * factor])
    assert motion.resting_sequence == [[1, 2], [0], []]  # W0 falls at the end


def test_the_size_of_forces_is_that_of_load_inertia_and_drag():
    """Of a link with rates up to 3 and accelerations up to 12 at first, masses 1 and 2."""
    gait = Gait(np.array([0.0, 1.0]), np.array([[[1.0, 3.0, -6.0, 4.0, -1.0]]]))
    assert crawl(gait, [1.0, 2.0], 0.5, 4.0).force_scale == pytest.approx(4 + 1.5 * 12 + 0.5 * 3)


def test_a_worm_glides_twice_while_the_same_mass_leads():
    """W0 = 1 + sin(4 pi s) / 2 on the way there, 1 on the way back, under a small load.

    Glides begin where 2 pi cos(phi) = -load, phi = 4 pi s, and end where what w has gained is lost;
    w by the same equation, from the end of the first on, would be above 0 in the second.
    """
    omega, there = 4 * np.pi, 1.1
    longest = 1 + 2 * there - math.cos(omega * there) / omega
    gait = Gait(
        np.array([0.0, there, there + (longest - 1 + 1 / omega) / 2]),
        np.array([[[1.0, 2.0]], [[longest, -2.0]]]),
        np.full(2, omega),
        np.array([[-1 / omega], [0.0]]),
        np.zeros((2, 1)),
    )
    motion = crawl(gait, [1.0, 1.0], 0.0, 0.2 * np.pi)
    begin = math.acos(-0.1)
    end = brentq(lambda phi: math.sin(begin) - math.sin(phi) - 0.1 * (phi - begin), 5.0, 7.5)
    first = np.array([begin, end]) / omega
    assert np.array(motion.glides[:2]) == pytest.approx(np.array([first, first + 0.5]), abs=1e-9)


@pytest.mark.parametrize(
    ("breaks", "courses", "expected"),
    [
        # the rate s (1/2 - s): mass 1 rests first, though all are alike where the piece begins
        (
            [0, 1, 2],
            [[1, 0, 1 / 4, -1 / 3], [11 / 12, 1 / 12, 0, 0]],
            [(0, 1, 0.5), (0, 0, 1), (1, 1, 1)],
        ),
        # the rate t (t - 2e-6) (1 - t), below 0 by 1e-12 at most until 2e-6, and from 1 on
        (
            [0, 2, 4],
            [[1, 0, -1e-6, (1 + 2e-6) / 3, -1 / 4], [-1 / 3 + 4e-6 / 3, 2 / 3 - 2e-6 / 3, 0, 0, 0]],
            [(0, 1, 1), (0, 0, 2), (1, 1, 2)],
        ),
    ],
)
def test_a_mass_that_leads_from_a_tie_on_has_a_stretch_of_its_own(
    breaks: list[float], courses: list[list[float]], expected: list[tuple[int, int, float]]
):
    gait = Gait(np.array(breaks, float), np.array(courses)[:, None])
    held = [stretch for stretch in crawl(gait, [1.0, 1.0], 0.0, 1e3).stretches if stretch.resting]
    found = [(stretch.piece, *stretch.resting, stretch.stop) for stretch in held]
    assert np.array(found) == pytest.approx(np.array(expected))


def test_a_mass_that_only_comes_up_to_those_at_rest_parts_no_stretch():
    """The rates s - 1/4 and -(s - 3/4)^2: mass 1 rests from 1/4 on, mass 2 all but does at 3/4."""
    there = [[1.0, -1 / 4, 1 / 2, 0.0], [1.0, -9 / 16, 3 / 4, -1 / 3]]
    ends = np.sum(there, axis=1)
    back = np.column_stack([ends, 1 - ends, np.zeros((2, 2))])
    gait = Gait(np.array([0.0, 1.0, 2.0]), np.array([there, back]))
    first, second, *_ = crawl(gait, [1.0] * 3, 0.0, 1e3).stretches
    assert (first.resting, second.resting) == ((0,), (1,))
    assert [first.start, first.stop, second.start, second.stop] == pytest.approx([0, 0.25, 0.25, 1])


def test_stretches_follow_each_other_where_a_mass_leads_by_a_rounding_error_at_first():
    """The rate t (t - 2e-6) is below 0 until 2e-6 s, by 1e-12 at most."""
    gait = hermite_gait(
        [1.0, 1.0], np.array([[1.0], [4 / 3 - 1e-6]]), np.array([[0.0], [1 - 2e-6]])
    )
    stretches = crawl(gait, [1.0, 1.0], 0.0, 50.0).stretches
    begins = [gait.breaks[s.piece] + s.start for s in stretches]
    ends = [gait.breaks[s.piece] + s.stop for s in stretches]
    assert begins[0] == 0.0
    assert begins[1:] == pytest.approx(ends[:-1], abs=1e-15)
    assert ends[-1] == 2.0


@pytest.mark.parametrize("factor", [1e-4, 1e8])
def test_a_glide_over_the_end_of_the_period_goes_on_whatever_the_clock(factor: float):
    """One of two links grows, shrinks, grows; the worm is thrown forward as it begins to again."""
    course = np.array([[1.25, 0.5], [1.5, -0.5], [1.0, 0.5]])
    gait = Gait(np.array([0.0, 0.5, 1.5, 2.0]), np.stack([course, 0 * course + [1, 0]], axis=1))
    one = crawl(gait, [1.0] * 3, 0.05, 1e-3)
    assert one.glides == [pytest.approx((0.0, 0.5)), pytest.approx((1.5, 2.0))]
    other = crawl(gait.with_period(2 * factor), [1.0] * 3, 0.05 / factor, 1e-3 / factor**2)
    assert other.advance == pytest.approx(one.advance, rel=1e-11)


# --- Limits of the method ----------------------------------------------------------------


@pytest.mark.parametrize("count", [2, 4])
def test_a_wrong_number_of_masses_is_refused(count: int):
    with pytest.raises(ValueError, match=f"mass has {count} entries, but 2 links join 3 masses"):
        crawl(fast_gait(1.0), [1.0] * count, 0.0, 20.0)


@pytest.mark.parametrize("period", [1.0, 10.0])
def test_without_load_and_drag_the_worm_glides_on_at_the_top_of_w0(period: float):
    """Nothing stops it, and spikes push from rest until W is the largest W0 = 2 pi e l0 / T."""
    motion = crawl(fast_gait(period), [1.0] * 3, 0.0, 0.0)
    assert motion.speed == pytest.approx(0.6 * math.pi / period, rel=1e-8)
    assert motion.smallest_period == math.inf


def test_downhill_the_worm_glides_at_the_pace_that_drag_bears_or_never_settles():
    """No spike holds, and in the end k W = 1."""
    gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1, -0.5]], [[1.0, -1, 0.5]]]))
    motion = crawl(gait, [1.0, 1.0], 0.5, -1.0)
    assert motion.speed == pytest.approx(2.0, rel=1e-10)
    assert motion.resting_sequence == [[]]
    assert motion.glides == [(0.0, 4.0)]
    with pytest.raises(SolveError, match="does not become periodic"):
        crawl(gait, [1.0, 1.0], 0.0, -1.0)


def test_without_load_only_drag_can_hold_the_worm_and_gait_15_always_glides():
    """Where W0 returns to 0 with a slope nothing can hold the worm, however slow the gait."""
    motion = crawl(fast_gait(1.0), [1.0] * 3, 1.0, 0.0)
    assert motion.glides
    assert motion.smallest_period == math.inf


def test_without_load_drag_holds_a_worm_that_never_stops():
    """Two links swing a quarter period apart: with x, y the rates, W0 = max(0, x, x + y) - mean.

    W0 > 0 at all times, so sigma = m W0' q^2 + k W0 q has a threshold, found here by sampling.
    """
    amplitude, drag, mass = 0.2, 1.3, 0.7
    swing = np.array([[amplitude, 0.0]])
    gait = Gait(
        np.array([0.0, 1.0]), np.full((1, 2, 1), 2.0), np.array([2 * np.pi]), swing, swing[:, ::-1]
    )
    motion = crawl(gait, [mass] * 3, drag, 0.0)
    t = np.linspace(0, 1, 200_001)
    spans, bends = (np.vstack([0 * t, np.cumsum(gait(t, d), axis=0)]) for d in (1, 2))
    leader = spans.argmax(axis=0)
    speed = spans[leader, np.arange(len(t))] - spans.mean(axis=0)
    slope = bends[leader, np.arange(len(t))] - bends.mean(axis=0)
    assert speed.min() > 0
    assert motion.smallest_period == pytest.approx(float((-mass * slope / drag / speed).max()))
    for factor, glides in ((1 + 1e-6, False), (1 - 1e-4, True)):
        paced = gait.with_period(motion.smallest_period * factor)
        assert bool(crawl(paced, [mass] * 3, drag, 0.0).glides) is glides


@settings(max_examples=examples(10))
@given(gait=smooth_gaits(3), drag=st.floats(0.1, 50))
def test_the_smallest_load_is_0_where_drag_alone_holds_the_worm(gait: Gait, drag: float):
    """Without load kinematics rules where the smallest load is 0, above the smallest period."""
    motion = crawl(gait, [1.0] * (gait.links + 1), drag, 0.0)
    assume(not 0 < motion.smallest_load < 1e-6 * motion.force_scale)
    assert motion.smallest_load >= 0
    assert (motion.smallest_load == 0) == (not motion.glides)
    assert (motion.smallest_load == 0) == (motion.smallest_period <= gait.period)


def test_a_gait_that_stands_still_rests_on_all_masses():
    motion = crawl(Gait(np.array([0.0, 1.0]), np.ones((1, 2, 1))), [1.0] * 3, 1.0, 2.0)
    assert (motion.advance, motion.resting_min, motion.energy) == (0.0, 3, 0.0)
    assert motion.resting_sequence == [[0, 1, 2]]
    assert np.diff(motion.time) == pytest.approx(1 / 600)
    assert (motion.smallest_load, motion.smallest_period) == (0.0, 0.0)
