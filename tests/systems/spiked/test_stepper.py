"""Stepping motors: step times, limits, tables, bristles that slip."""

import re
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from smooth_gaits import hermite_gait
from stepping import counted

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.stepper.bristles import ratchet
from wormopt.systems.spiked.stepper.stepper import Stepper, demand
from wormopt.systems.spiked.stepper.steps import (
    Steps,
    c_text,
    csv_text,
    in_ticks,
    quantisation_error,
    read_csv,
    step_times,
)


def motor(travel: float = 0.01, hysteresis: float = 0.05, **limits: Any) -> Stepper:
    return Stepper(lead=travel, steps_per_turn=1, hysteresis=hysteresis, **limits)


@st.composite
def gaits(draw: st.DrawFn) -> Gait:
    """Closed C1 gaits: cubics between random lengths and rates, some of them at rest."""
    links, pieces = draw(st.integers(1, 3)), draw(st.integers(2, 5))
    value = draw(arrays(float, (pieces, links), elements=st.floats(0.5, 1.5)))
    rate = draw(arrays(float, (pieces, links), elements=st.floats(-2, 2)))
    widths = draw(st.lists(st.floats(0.1, 1.0), min_size=pieces, max_size=pieces))
    if draw(st.booleans()):
        value[1 % pieces], rate[0], rate[1 % pieces] = value[0], 0.0, 0.0
    return hermite_gait(widths, value, rate)


# -- step times ----------------------------------------------------------------------------------


@settings(max_examples=examples(25))
@given(gaits(), st.sampled_from([0.003, 0.017, 0.11]), st.sampled_from([0.0, 0.05, 0.4]))
def test_a_replay_by_counting_stays_within_a_microstep(gait: Gait, travel: float, margin: float):
    stepper = motor(travel, margin)
    steps = step_times(gait, stepper)
    bound = 0.5 + margin + 1e-6
    assert counted(csv_text(steps), gait) <= bound
    assert quantisation_error(gait, steps).max() / travel <= bound
    # counts balance: as many steps out as back
    for j in range(gait.links):
        assert steps.of_motor(j)[1].sum() == 0


@settings(max_examples=examples(25))
@given(gaits(), st.sampled_from([0.004, 0.05]))
def test_lengths_are_at_their_levels_when_motors_step(gait: Gait, travel: float):
    steps = step_times(gait, motor(travel))
    for j in range(gait.links):
        time, direction = steps.of_motor(j)
        after = np.cumsum(direction)
        level = steps.start[j] + travel * (after - 0.5 * direction + 0.05 * direction)
        lengths = gait(np.minimum(time, np.nextafter(gait.period, 0)))[j]
        assert lengths == pytest.approx(level, abs=1e-11)


def test_step_times_of_a_parabola_and_a_cosine_are_closed_form():
    gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1, -0.5]], [[1.0, -1, 0.5]]]))
    steps = step_times(gait, motor(0.1, 0.0))
    rising = 1 - np.sqrt(1 - 2 * (np.arange(5) + 0.5) * 0.1)
    assert steps.time[:5] == pytest.approx(rising, abs=1e-14)
    assert steps.time[5:10] == pytest.approx(2 - rising[::-1], abs=1e-14)
    assert steps.direction.tolist() == ([1] * 5 + [-1] * 5) + ([-1] * 5 + [1] * 5)
    wave = step_times(fast_gait(3.0), motor(0.01, 0.0))
    time, direction = wave.of_motor(0)
    level = 0.01 * (np.arange(60) + 0.5) / 0.3
    assert time[:60] == pytest.approx(np.arccos(1 - level) / np.pi, abs=1e-13)
    assert direction.tolist() == [1] * 60 + [-1] * 60
    assert wave.counts.tolist() == [120, 120]


def test_a_touch_of_a_level_is_no_step_and_a_crossing_at_a_break_is_one():
    # up by 2.5 microsteps exactly and back: the third level is touched only
    touch = Gait(np.array([0.0, 2.0]), np.array([[[1.0, 1.0, -0.5]]]))
    steps = step_times(touch, motor(0.5 / 2.5, 0.0))
    assert steps.direction.tolist() == [1, 1, -1, -1]
    # the level 1.1 lies at the break at t = 0.1 (travel 0.2)
    lines = np.array([[[1.0, 1.0, 0.0]], [[1.1, 1.0, 0.0]], [[1.2, 0.0, 0.0]], [[1.2, -1.0, 0.0]]])
    gait = Gait(np.array([0.0, 0.1, 0.2, 0.3, 0.5]), lines)
    steps = step_times(gait, motor(0.2, 0.0))
    assert steps.time == pytest.approx([0.1, 0.4], abs=1e-9)


def test_lengths_that_linger_at_a_level_chatter_only_without_hysteresis():
    ripple = Gait(
        np.array([0.0, 1.0, 2.0, 3.0]),
        np.array([[[1.0, 0, 0.15, -0.1]], [[1.05, 0, 0, 0]], [[1.05, 0, -0.15, 0.1]]]),
        np.array([0.0, 20 * np.pi, 0.0]),
        np.zeros((3, 1)),
        np.array([[0.0], [1e-4], [0.0]]),
    )
    assert step_times(ripple, motor(0.1, 0.0)).counts[0] == 20
    assert step_times(ripple, motor(0.1, 0.05)).counts[0] == 0


def test_gaits_that_rest_and_gaits_with_too_many_steps():
    still = Gait(np.array([0.0, 1.0]), np.array([[[1.0]]]))
    assert len(step_times(still, motor()).time) == 0
    with pytest.raises(ArgumentError, match="more than 2000000 steps"):
        step_times(fast_gait(1.0), motor(1e-7))
    jump = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[1.0]], [[1.5]]]))
    with pytest.raises(ArgumentError, match=r"jumps by 0\.5 at t = 0"):
        step_times(jump, motor())


def test_a_zigzag_is_answered_at_its_turns_by_pulses_twice_the_hysteresis_apart():
    for over, margin in ((0.002, 0.05), (0.02, 0.05), (0.01, 0.2)):
        peak = 10.5 + margin + over  # in microsteps: just past where the motor steps
        gait = Gait(
            np.array([0.0, 1.0, 2.0]),
            np.array([[[1.0, 0.01 * peak]], [[1 + 0.01 * peak, -0.01 * peak]]]),
        )
        steps = step_times(gait, motor(0.01, margin))
        assert steps.interval_min * peak == pytest.approx(2 * (margin + over), rel=1e-9)


def test_the_first_step_follows_the_last_a_period_later():
    steps = Steps(
        1.0, 0.1, np.ones(3), np.array([0.02, 0.3, 0.5, 0.95]), np.array([0, 1, 1, 0]),
        np.array([1, 1, -1, -1]),
    )  # fmt: skip
    assert steps.intervals_min == pytest.approx([0.07, 0.2, np.inf])
    assert steps.interval_min == pytest.approx(0.07)
    assert in_ticks(steps, 0.01)[1][0].tolist() == [2, 93, 5]
    # rounded to ticks of a quarter, motor 0 would step twice at once where periods meet
    with pytest.raises(ArgumentError, match=r"motor 0 are on one tick; write a tick below 0\.07"):
        in_ticks(steps, 0.25)
    assert Steps(1.0, 0.1, np.ones(1), *np.zeros((3, 0), int)).interval_min == np.inf


# -- what motors can do --------------------------------------------------------------------------


def test_demands_of_the_fast_gait_in_closed_form():
    # l = l0 e (1 - cos(3 pi t / T)): rate 3 pi l0 e / T, acceleration its square over l0 e
    period, size = 4.0, 2.0 * 0.15
    stepper = Stepper(lead=0.5, steps_per_turn=200, rate_max=1.0, acceleration_max=2.0)
    found = demand(fast_gait(period), stepper)
    omega = 3 * np.pi / period
    assert found.turn_rate_max == pytest.approx(omega * size / 0.5, rel=1e-12)
    assert found.acceleration_max == pytest.approx(omega**2 * size / 0.5, rel=1e-12)
    by_rate = period * omega * size / 0.5
    by_acceleration = period * np.sqrt(omega**2 * size / 0.5 / 2.0)
    limits = {limit.name: limit.period_min for limit in found.limits}
    assert limits["rate_max"] == pytest.approx(by_rate, rel=1e-12)
    assert limits["acceleration_max"] == pytest.approx(by_acceleration, rel=1e-12)
    assert found.period_min == max(limits.values())
    # with a start rate: sin and cos of one angle, min(sqrt(a |cos|), b sin) at its largest
    a, b = omega**2 * size / 0.5 / 2.0, omega * size / 0.5 / 0.8
    # b² sin² = a cos
    cosine = (-a + np.sqrt(a**2 + 4 * b**4)) / (2 * b**2)
    eased = demand(fast_gait(period), Stepper(0.5, 200, 1, 1.0, 2.0, start_rate=0.8))
    limits = {limit.name: limit.period_min for limit in eased.limits}
    assert limits["acceleration_max"] == pytest.approx(period * np.sqrt(a * cosine), rel=1e-10)


@settings(max_examples=examples(20))
@given(gaits(), st.floats(0.5, 3), st.floats(1, 30), st.sampled_from([0.0, 0.1, 0.5]))
def test_the_smallest_period_is_where_sampled_demands_just_fit(
    gait: Gait, rate: float, acceleration: float, share: float
):
    stepper = Stepper(0.7, 10, 1, rate, acceleration, start_rate=share * rate)
    least = demand(gait, stepper).period_min
    assume(least > 1e-3)

    def fits(period: float) -> bool:
        slow = gait.with_period(period)
        t = np.concatenate(
            [np.linspace(a, b, 400, endpoint=False) for a, b in pairwise(slow.breaks)]
        )
        turns, change = np.abs(slow(t, 1)) / 0.7, np.abs(slow(t, 2)) / 0.7
        return bool(
            np.all(turns <= rate * (1 + 1e-9))
            and np.all((change <= acceleration * (1 + 1e-9)) | (turns <= stepper.start_rate))
        )

    assert fits(least * (1 + 1e-9))
    # sampling misses extremes by little: a period a little shorter does not fit
    assert not fits(least * 0.97)
    assert demand(gait.with_period(2 * least), stepper).period_min == pytest.approx(least, rel=1e-9)


def test_gaits_that_are_too_fast_are_refused_with_the_period_that_is_not():
    with pytest.raises(SolveError) as caught:
        step_times(fast_gait(1.0), motor(0.01, rate_max=100.0))
    assert caught.value.code == "too_fast"
    assert "turns/s from the motor of link 0 at t = 0.166667, but motor.rate_max is 100" in str(
        caught.value
    )
    period = float(re.findall(r"gait\.period = ([\d.]+)", caught.value.suggestion)[0])
    assert period == pytest.approx(3 * np.pi * 0.3 / 0.01 / 100, rel=2e-3)
    assert step_times(fast_gait(period), motor(0.01, rate_max=100.0)).counts[0] == 120
    corners = block_wave(2, 1, 1.0, (0.8, 1.2), "trapezoid", 0.0)
    ramped = {"acceleration_max": 1e6}
    assert step_times(corners, motor()).counts.tolist() == [80, 80]
    with pytest.raises(SolveError, match="a gait without corners"):
        step_times(corners, motor(**ramped))
    with pytest.raises(SolveError, match=r"start_rate is 50 turns/s; write gait\.period = 2\.4"):
        step_times(corners, motor(start_rate=50.0, **ramped))
    assert np.isinf(demand(corners, motor(start_rate=50.0, **ramped)).acceleration_max).all()
    fast = demand(corners, motor(start_rate=120.0, **ramped))
    assert fast.acceleration_max.tolist() == [0.0, 0.0]
    just = motor(start_rate=120.0 * (1 + 1e-12), **ramped)
    assert step_times(corners, just).counts.tolist() == [80, 80]


# -- the worm on its bristles --------------------------------------------------------------------


def from_rest(steps: Steps, backslip: float, periods: int, finer: int = 1) -> float:
    """Mean speed after a transient, by small moves from rest: the law applied literally."""
    count = np.zeros(steps.links)
    place = -np.concatenate([[0.0], np.cumsum(steps.start)])
    foremost, heads = place.copy(), []
    for _ in range(periods):
        for motor_, direction in zip(steps.motor, steps.direction, strict=True):
            for _ in range(finer):
                count[motor_] += direction / finer
                lengths = steps.start + steps.travel * count
                shape = -np.concatenate([[0.0], np.cumsum(lengths)])
                place = shape + (foremost - backslip - shape).max()
                foremost = np.maximum(foremost, place)
        heads.append(place[0])
    half = periods // 2
    return (heads[-1] - heads[half - 1]) / (steps.period * (periods - half))


@settings(max_examples=examples(15))
@given(gaits(), st.sampled_from([0.0, 0.02, 0.05, 0.13]))
def test_the_cycle_mean_is_the_speed_of_the_law_applied_from_rest(gait: Gait, slip: float):
    steps = step_times(gait, motor(0.05, 0.05))
    # steps of two motors at one instant have no order for the literal law
    assume(len(steps.time) and np.diff(steps.time).min(initial=1.0) > 1e-8)
    moved = ratchet(steps, slip)
    transient = 2 * (np.abs(moved.position).max() + slip) / gait.period
    assert moved.speed == pytest.approx(from_rest(steps, slip, 40), abs=transient / 20 + 1e-9)
    assert moved.period_error <= 1e-9
    assert moved.advance == pytest.approx(moved.speed * gait.period, abs=1e-9)
    # a straight move may be taken in one: smaller ones give the same
    assert from_rest(steps, slip, 8, 7) == pytest.approx(from_rest(steps, slip, 8), abs=1e-9)


@settings(max_examples=examples(20))
@given(gaits(), st.sampled_from([0.0, 0.02, 0.13]), st.sampled_from([0.0, 0.03]))
def test_laws_of_the_bristles_hold(gait: Gait, slip: float, settle: float):
    steps = step_times(gait, motor(0.02))
    moved = ratchet(steps, slip, settle)
    twice = np.hstack([moved.position, moved.position + moved.advance])
    foremost = np.maximum.accumulate(twice, axis=1)
    assert (foremost - twice).max() <= slip + 1e-9
    if moved.speed > 1e-9:  # some bristle holds at any time
        back = (foremost - twice)[:, moved.time.size :].max(axis=0)
        assert back == pytest.approx(np.full(moved.time.size, slip), abs=1e-9)
    if slip == 0:
        assert np.diff(twice, axis=1).min() >= -1e-9
    assert moved.speed >= -1e-12


@pytest.mark.parametrize("stroke", [0.2, 0.1234])
def test_two_masses_lose_a_backslip_at_each_of_two_handovers(stroke: float):
    gait = accordion(1, 1.0, (1.0, 1.0 + stroke))
    steps = step_times(gait, motor(1e-3))
    whole = 1e-3 * steps.counts[0] / 2
    for slip in (0.0, 0.0137, 0.05, 0.4):
        assert ratchet(steps, slip).speed == pytest.approx(max(0, whole - 2 * slip), abs=1e-12)


@pytest.mark.parametrize(("links", "resting"), [(2, 1), (2, 2), (3, 2), (4, 1), (4, 3)])
def test_block_waves_lose_a_backslip_at_every_handover(links: int, resting: int):
    """n + 1 handovers a period, of which one in a stands in the way of the last."""
    stroke = 0.2
    gait = block_wave(links, resting, 1.0, (1.0, 1.0 + stroke), "quintic")
    steps = step_times(gait, motor(1e-3))
    for slip in (1e-3, 0.004, 0.0133):
        lost = (links + 1) / resting * slip
        expected = (links + 1 - resting) * stroke - lost
        assert ratchet(steps, slip).speed == pytest.approx(expected, abs=1e-11)


def ideal_speed(gait: Gait) -> float:
    return crawl(gait, [1.0] * (gait.links + 1), 0.0, 1e4).speed


def test_without_backslip_the_speed_is_of_first_order_in_the_step():
    gait = fast_gait(1.0, 2.0, 0.15)
    exact, travels = ideal_speed(gait), np.geomspace(0.05, 0.0005, 25)
    errors = np.array(
        [abs(ratchet(step_times(gait, motor(q)), 0.0).speed - exact) for q in travels]
    )
    # of two strokes each the last part of a microstep is lost, half a one on average
    assert np.all(errors <= 2 * (0.5 + 0.05) * travels * (1 + 1e-9))
    assert errors.max() > 1e-2
    slope = np.polyfit(np.log(travels), np.log(np.maximum(errors, 1e-9)), 1)[0]
    assert 0.5 < slope < 1.6
    # strokes of whole microsteps lose nothing
    assert ratchet(step_times(gait, motor(0.6 / 77)), 0.0).speed == pytest.approx(exact, abs=1e-12)


@settings(max_examples=examples(10))
@given(gaits())
def test_a_backslip_of_a_step_keeps_steps_in_turns_from_making_way(gait: Gait):
    """Links that shorten and lengthen together step in turns; that must not carry the worm."""
    exact = ideal_speed(gait)
    errors = []
    for travel in (0.02, 0.005, 0.00125):
        speed = ratchet(step_times(gait, motor(travel)), 2 * travel).speed
        errors.append(abs(speed - exact) * gait.period)
    runs = 8 * gait.pieces * gait.links
    assert errors[1] <= 2 * runs * 0.005
    assert errors[2] <= 2 * runs * 0.00125


def test_steps_in_turns_carry_bristles_that_hold_at_once():
    # link 0 shortens while link 1 lengthens: ideally masses 0 and 2 rest; strokes are no whole
    # number of steps, so that the motors step at different instants
    lines = np.array([[[1.3, -0.3], [1.0, 0.3001]], [[1.0, 0.3], [1.3001, -0.3001]]])
    gait = Gait(np.array([0.0, 1.0, 2.0]), lines)
    exact = ideal_speed(gait)
    steps = step_times(gait, motor(0.001))
    assert ratchet(steps, 0.0).speed > 1.5 * exact
    # any backslip of a step or more, and steps that take their time, end that
    assert ratchet(steps, 0.001).speed == pytest.approx(exact, rel=0.03)
    assert ratchet(steps, 0.0, 0.05).speed == pytest.approx(exact, rel=0.03)


def test_slow_steps_converge_to_held_ones_and_to_the_gait():
    gait = fast_gait(1.0)
    steps = step_times(gait, motor(0.6 / 100))
    held = ratchet(steps, 0.02)
    for settle in (1e-4, 1e-8):
        slow = ratchet(steps, 0.02, settle)
        assert slow.speed == pytest.approx(held.speed, abs=1e-9)
    errors = [
        abs(ratchet(step_times(gait, motor(0.6 / k)), 0.0, 0.02).speed - ideal_speed(gait))
        for k in (50, 200, 800)
    ]
    # the lag that is left is of the order of the settling time, squared: turns are rounded off
    assert errors[-1] < 0.01
    assert ratchet(steps, 0.0, 0.5).period_error < 1e-12


@pytest.mark.parametrize("given", [(-1.0, 0.0), (float("nan"), 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_bristles_that_cannot_be_are_refused(given: tuple[float, float]):
    with pytest.raises(ArgumentError):
        ratchet(step_times(fast_gait(1.0), motor()), *given)


# -- tables --------------------------------------------------------------------------------------


def test_the_table_reads_back_as_it_was():
    steps = step_times(fast_gait(18.0, 0.1), Stepper(2e-3, 200, 2))
    read = read_csv(csv_text(steps))
    for name in ("time", "motor", "direction", "start"):
        assert getattr(read, name).tolist() == getattr(steps, name).tolist()
    assert (read.period, read.travel) == (steps.period, steps.travel)


def test_a_table_of_steps_that_do_not_return_is_refused():
    steps = step_times(fast_gait(18.0, 0.1), Stepper(2e-3, 200, 2))
    lines = csv_text(steps).splitlines(keepends=True)
    with pytest.raises(ArgumentError, match="does not return"):
        read_csv("".join(lines[:-1]))


def test_rounding_to_ticks_does_not_add_up():
    steps = step_times(fast_gait(18.0, 0.1), Stepper(2e-3, 200, 2))
    whole, delays = in_ticks(steps, 1e-4)
    assert whole == 180_000
    for j, delay in enumerate(delays):
        assert delay.sum() == whole
        off = np.cumsum(delay[:-1]) * 1e-4 - steps.of_motor(j)[0]
        assert np.abs(off).max() <= 0.5e-4 * (1 + 1e-9)
        assert np.abs(off).max() > 0.4e-4
    with pytest.raises(ArgumentError, match=r"are on one tick; write a tick below 0\.000637"):
        in_ticks(steps, 1e-3)
    with pytest.raises(ArgumentError, match="more ticks than 32 bits"):
        in_ticks(steps, 1e-9)


REPLAY = """
#include <stdio.h>
#include "steps.c"
static void replay(int motor, const uint32_t *delay, const int8_t *direction, uint32_t count,
                   uint32_t rest) {
    uint32_t now = 0;
    for (uint32_t k = 0; k < count; k++) {
        now += delay[k];
        printf("%d %lu %d\\n", motor, (unsigned long)now, direction[k]);
    }
    printf("%d %lu 0\\n", motor, (unsigned long)(now + rest));
}
int main(void) {
    replay(0, motor_0_delay, motor_0_direction, motor_0_count, motor_0_rest);
    replay(1, motor_1_delay, motor_1_direction, motor_1_count, motor_1_rest);
    printf("%lu\\n", (unsigned long)period_ticks);
    return 0;
}
"""


@pytest.mark.compiled
@pytest.mark.parametrize("still", [False, True])
def test_the_c_table_compiles_and_replays_the_csv(tmp_path: Path, still: bool):
    gait = fast_gait(18.0, 0.1)
    if still:  # the second motor never steps
        rest = np.zeros(gait.polynomial.shape[:2])
        assert gait.cosine is not None
        gait = Gait(gait.breaks, gait.polynomial, gait.omega, gait.cosine * [1, 0], rest)
        gait.polynomial[:, 1] = 0.1
    steps = step_times(gait, Stepper(2e-3, 200, 2))
    (tmp_path / "steps.c").write_text(c_text(steps, 1e-6))
    (tmp_path / "replay.c").write_text(REPLAY)
    strict = ["cc", "-std=c99", "-Wall", "-Werror", "-Wpedantic"]
    subprocess.run([*strict, "-c", "steps.c"], cwd=tmp_path, check=True)
    subprocess.run([*strict, "replay.c", "-o", "replay"], cwd=tmp_path, check=True)
    printed = subprocess.run([tmp_path / "replay"], capture_output=True, text=True, check=True)
    *lines, whole = printed.stdout.split("\n")[:-1]
    assert int(whole) == 18_000_000
    said = np.array([[int(v) for v in line.split()] for line in lines])
    table = read_csv(csv_text(steps))
    for j in range(2):
        own = said[said[:, 0] == j]
        time, direction = table.of_motor(j)
        assert own[-1].tolist() == [j, 18_000_000, 0]
        assert own[:-1, 2].tolist() == direction.tolist()
        assert np.abs(own[:-1, 1] * 1e-6 - time).max(initial=0.0) <= 0.5e-6 * (1 + 1e-6)
