"""Coils on or off, in a tube where short segments are anchored: found twice, followed alone."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from outcomes import refusals
from scipy.integrate import solve_ivp
from scipy.optimize import differential_evolution, root_scalar

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.study import load_scene
from wormopt.systems.peristaltic.anchored import anchored_wave
from wormopt.systems.peristaltic.anchored_fastest import mode_bound
from wormopt.systems.peristaltic.switched import (
    DragGround,
    Limits,
    Objective,
    SwitchedWorm,
    TubeGround,
)
from wormopt.systems.peristaltic.switching import Switched, walk
from wormopt.systems.peristaltic.switching_orders import search

SPEED, THRIFT = Objective(maximise="speed"), Objective(minimise="energy_per_distance")
LIMITS = Limits((0.1, 20.0), 1.0, 0.2)
THREE = SwitchedWorm(
    segments=3, length_on=0.6, length_off=1.4, time_on=1.0, time_off=1.0,
    ground=TubeGround(0.8),
)  # fmt: skip
FOUR = replace(THREE, segments=4)


def by_ode(worm: SwitchedWorm, found: Switched) -> np.ndarray:
    """Lengths and way of ring 0 after a period: Runge-Kutta, touches as events, coils alone."""
    n, wall = worm.segments, worm.ground.contact
    assert wall is not None
    y, rest = np.append(found.start, 0.0), (found.order[0] == 2)
    for on, duration in zip(found.coils == 1, found.durations, strict=True):
        t, rest = 0.0, rest & on
        while t < duration:

            def rates(_: float, y: np.ndarray, on: np.ndarray = on, rest: np.ndarray = rest):
                l_dot = np.where(on, worm.length_on - y[:n], worm.length_off - y[:n]) * ~rest
                k = int(np.argmax(rest))  # ring 0 is ahead of it by all before
                return np.append(l_dot, l_dot[:k].sum())

            free = np.flatnonzero(on & ~rest)
            events = [lambda _, y, j=j: y[j] - wall for j in free]
            for event in events:
                event.__dict__.update(terminal=True, direction=-1)
            run = solve_ivp(rates, (t, duration), y, rtol=1e-11, atol=1e-13, events=events)
            t, y = run.t[-1], run.y[:, -1]
            if run.status == 1:
                rest = rest | (on & (np.abs(y[:n] - wall) < 1e-9))
    return y


@pytest.mark.slow
def test_the_fastest_of_three_is_found_again_by_evolution():
    found = search(THREE, SPEED, LIMITS).best

    def accordion(w: np.ndarray) -> float:
        """Ends at rest in turn; segment 1 goes on and off at any time, here by its own period."""
        off_0, off_2, begin, share = w
        flights = [off + math.log((0.8 - 0.6 * math.exp(-off)) / 0.2) for off in (off_0, off_2)]
        period = sum(flights)
        f = share * period
        fade, fall = math.exp(-f), math.exp(f - period)
        trough = (0.6 * (1 - fall) + 1.4 * (1 - fade) * fall) / (1 - fade * fall)
        top = 1.4 + (trough - 1.4) * fade

        def middle(t: float) -> float:
            s = (t - begin * period) % period  # since its coil went off
            off = 1.4 + (trough - 1.4) * math.exp(-s)
            return off if s < f else 0.6 + (top - 0.6) * math.exp(f - s)

        # the tail rests while the head is off the wall, and the other way round
        way = middle(flights[0]) - middle(0.0)
        return -way / period + 100 * max(0.0, 0.8 - trough)

    again = differential_evolution(
        accordion, [(0.2, 2), (0.2, 2), (0, 1), (0.05, 0.95)], rng=1, tol=1e-12, popsize=10
    )
    assert found.worth == pytest.approx(0.193554568587168, abs=1e-14)
    assert -again.fun == pytest.approx(found.worth, abs=1e-9)


def test_a_worm_that_is_followed_by_its_coils_alone_goes_as_far():
    found = search(THREE, SPEED, LIMITS, starts=3).best
    walked = walk(THREE, found.coils, found.durations, found.start)
    assert walked.displacement == pytest.approx(found.displacement, abs=1e-9)
    assert max(walked.slip, walked.loose) < 1e-8
    end = by_ode(THREE, found)
    assert end[:3] == pytest.approx(found.start, abs=1e-8)
    assert end[3] == pytest.approx(found.displacement, abs=1e-8)
    late = found.durations * np.where(np.arange(len(found.durations)) == 0, 0.5, 1.0)
    worse = walk(THREE, found.coils, late, found.start)
    assert worse.loose > 1e-2  # the tail goes off before the head has touched


@pytest.mark.slow
def test_two_coils_at_a_time_make_the_wave():
    limits = replace(LIMITS, together=2)
    found = search(FOUR, SPEED, limits, starts=2).best
    # even steps h: on for two, off for two; short again as the next one goes off
    h = root_scalar(
        lambda h: math.log((0.8 - 0.6 * math.exp(-2 * h)) / 0.2) - h, bracket=(0.5, 5), xtol=1e-14
    ).root
    wave = (1.2 - 0.6 * (math.exp(-h) + math.exp(-2 * h))) / (4 * h)
    assert found.worth == pytest.approx(wave, abs=1e-10)
    assert found.order[found.durations > 0.1].sum(axis=0).tolist() == [3] * 4
    assert found.lasting[1] == pytest.approx([h] * 4, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("worm", "together"), [(THREE, None), (THREE, 2), (FOUR, 2)])
def test_it_is_never_slower_than_the_wave_of_constant_rates(worm: SwitchedWorm, together: int):
    found = search(worm, SPEED, replace(LIMITS, together=together), starts=3).best
    for stroke in (0.05, 0.2, 0.4, 0.5):
        rate = min(1.4 - 0.8 - stroke, 0.8 - 0.6)  # what relaxation has at its slowest
        wave = anchored_wave(worm.segments, 2, stroke, stroke / rate)
        assert found.worth > wave.speed


@pytest.mark.slow
def test_short_periods_come_near_the_ceiling_to_second_order():
    # rates are (1.4 - l) and (l - 0.6): the same, and together fastest, at l = 1
    ceiling = mode_bound(3, 1, (0.4, 0.4)).speed
    gaps = [ceiling - search(THREE, SPEED, Limits((t, t)), starts=3).best.worth for t in (0.2, 0.1)]
    assert 0 < gaps[1] < 1e-4
    assert 1.97 < math.log2(gaps[0] / gaps[1]) < 2.03


def test_who_may_rest():
    states = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 1]])
    assert TubeGround(0.8).holds(states).tolist() == [False, True, True, False, True]
    assert DragGround(1.0).holds(states).all()
    with pytest.raises(ArgumentError, match=r"above 0\.6 and below 1\.4"):
        THREE.vary({"ground.contact": 0.5})
    with pytest.raises(ArgumentError, match="only a worm in a tube"):
        walk(replace(THREE, ground=DragGround(1.0)), np.ones((1, 3)), np.ones(1), np.ones(3))


@pytest.mark.slow
def test_limits():
    free, duty = (search(THREE, SPEED, replace(LIMITS, duty=d)).best for d in (1.0, 0.6))
    assert (duty.durations @ duty.coils).max() <= 0.6 * duty.period + 1e-8
    assert 0.4 * free.worth < duty.worth < 0.6 * free.worth
    cheap = search(THREE, THRIFT, LIMITS).best
    assert cheap.worth > free.displacement / (free.durations @ free.coils).sum() * 1.0001
    # one coil cannot hand over to another
    with pytest.raises(SolveError, match=r"a larger limits\.duty or limits\.together"):
        search(THREE, SPEED, replace(LIMITS, together=1), starts=2)


@pytest.mark.parametrize(
    "longest", [pytest.param("20.0", marks=pytest.mark.slow), "9223372036854775808"]
)
def test_the_scene_in_a_tube(longest: str):
    changes = ["want=[]", "worm.segments=3", f"limits.period=[0.1, {longest}]"]
    found = wo.run(load_scene("peristaltic_tube_switching", changes))
    assert found.status == "ok"
    assert found.scalars["speed"].value == pytest.approx(0.193554568587168, abs=1e-11)
    assert found.checks[-1].name == "walk by the coils alone"
    anchored, lengths = found["anchored"].values > 0.5, found["length"].values
    assert anchored.any(axis=0).all()
    assert lengths[anchored] == pytest.approx(0.8, abs=1e-9)
    places, t = found["position"].values, found["instant"].values
    for j, at in enumerate(anchored):
        both = at[1:] & at[:-1] & (np.diff(t) > 0)
        assert np.abs(np.diff(places[j]))[both].max(initial=0.0) < 1e-9


@pytest.mark.slow
def test_periods_too_short_to_be_resolved_name_those_to_write():
    changes = ["want=[]", "worm.segments=3", "search.starts=1", "worm.time_on=2e3"]
    found = wo.run(load_scene("peristaltic_tube_switching", changes))
    assert found.status == "failed"
    assert "; write limits.period within [2000, 18000], where" in found.reason


test_what_is_refused_in_a_tube = refusals(
    "peristaltic_tube_switching",
    """
    ground.contact=0.5 | ground.contact | above 0.6 and below 1.4
    worm.segments=2 | worm.segments | write 3
    """,
)
