"""The event-located integration of (7): docs/theory-kinematic.md, motions solved by hand."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from smooth_gaits import glide_by_hand

from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.systems.spiked import bimodal
from wormopt.systems.spiked.bimodal import BimodalMotion, integrate
from wormopt.systems.spiked.construct import fast_gait
from wormopt.systems.spiked.crawl import crawl

# Gait (15) with l0 = 2, e = 0.15, T = 1: W0 = AMPLITUDE |sin(3 pi t)|
AMPLITUDE = 0.6 * math.pi
THRESHOLD = 17.765288


def sawtooth(rate: float, period: float) -> Gait:
    """One link that grows for half a period and shrinks for the other, with corners."""
    half = period / 2
    lengths = [[[1.0, rate]], [[1.0 + rate * half, -rate]]]
    return Gait(np.array([0.0, half, period]), np.array(lengths))


def trapezoid(acceleration: float, ramp: float) -> Gait:
    """One link speeds up, slows down, and the same backwards, each for a time `ramp`."""
    a, stroke = acceleration / 2, acceleration * ramp**2
    rate = acceleration * ramp
    pieces = [
        [1.0, 0.0, a],
        [1.0 + stroke / 2, rate, -a],
        [1.0 + stroke, 0.0, -a],
        [1.0 + stroke / 2, -rate, a],
    ]
    return Gait(np.arange(5) * ramp, np.array(pieces)[:, None, :])


def harmonics(amplitudes: Sequence[complex], period: float = 1.0) -> Gait:
    """Every link swings about 3 with one phasor each."""
    phasors = np.array([amplitudes])
    omega = np.array([2 * np.pi / period])
    lengths = np.full((1, len(amplitudes), 1), 3.0)
    return Gait(np.array([0.0, period]), lengths, omega, np.real(phasors), np.imag(phasors))


def test_gait_15_is_ruled_by_kinematics():
    motion = integrate(fast_gait(1.0), [1.0] * 3, drag=1.0, load=20.0)
    assert motion.advance == pytest.approx(1.2, abs=1e-12)
    assert motion.lambda_min == pytest.approx(20 - 1.8 * math.pi**2, abs=1e-9)
    assert motion.lambda_min == pytest.approx(2.234712, abs=1e-6)
    assert motion.lambda_max == pytest.approx(37.865008, abs=1e-6)
    assert motion.lambda_mean == pytest.approx(21.2, abs=1e-12)
    assert motion.glides == ()
    assert motion.impulses == ()
    assert motion.resting_min == 1
    assert [resting for _, resting in motion.switches] == [{1}, {0}, {2}]
    assert [time for time, _ in motion.switches] == pytest.approx([0, 1 / 3, 2 / 3])


@pytest.mark.parametrize("drag", [0.0, 1.0])
@pytest.mark.parametrize(("mass", "period"), [(1.0, 1.0), (2.5, 0.7)])
def test_threshold_of_gliding(drag: float, mass: float, period: float):
    threshold = THRESHOLD * mass / period**2
    above, below = (
        integrate(fast_gait(period), [mass] * 3, drag, threshold * factor)
        for factor in (1 + 1e-6, 1 - 1e-4)
    )
    assert above.glides == ()
    assert above.lambda_min >= 0
    assert len(below.glides) == 3
    assert below.lambda_min == pytest.approx(0, abs=1e-12)


def test_the_end_of_a_glide_converges_with_the_tolerance():
    end = glide_by_hand(1.0, 9.0)[1]
    errors = [
        abs(integrate(fast_gait(1.0), [1.0] * 3, 1.0, 9.0, rtol=rtol).glides[0][1] - end)
        for rtol in (1e-5, 1e-8, 1e-11)
    ]
    assert errors[0] < 1e-4
    assert errors[1] < 1e-7
    assert errors[2] < 1e-10
    assert errors[2] <= errors[1] <= errors[0]


@pytest.mark.parametrize("drag", [0.0, 0.8])
def test_corners_give_an_impulse_and_a_glide(drag: float):
    """Masses 1 and 3: their mean momentum jumps up at T/2 and down at T."""
    rate, period, load = 1.2, 2.0, 1.5
    light, heavy = 1.0, 3.0
    motion = integrate(sawtooth(rate, period), [light, heavy], drag, load)
    mass, w = (light + heavy) / 2, (heavy - light) * rate / (light + heavy)
    pull = drag * rate / 2 + load
    if drag:
        end = mass / drag * math.log(1 + drag * w / pull)
        slide = (w * mass - pull * end) / drag
    else:
        end = mass * w / load
        slide = w * end / 2
    assert motion.impulses == ((1.0, pytest.approx((heavy - light) * rate, abs=1e-12)),)
    assert motion.glides == (pytest.approx((0.0, end), abs=1e-11),)
    assert motion.advance == pytest.approx(rate * period / 2 + slide, abs=1e-11)
    assert motion.lambda_mean == pytest.approx(drag * motion.speed + load, abs=1e-11)
    assert [resting for _, resting in motion.switches] == [set(), {1}, {0}]


def test_corners_without_a_jump_of_momentum_leave_the_worm_on_its_spikes():
    motion = integrate(sawtooth(1.0, 2.0), [1.0, 1.0], 0.0, 0.0)
    assert (motion.glides, motion.impulses) == ((), ())
    assert motion.advance == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("noise", [0.0, 1e-13])
def test_a_gait_that_rides_on_sigma_0_does_not_flicker(
    noise: float, monkeypatch: pytest.MonkeyPatch
):
    """While the link slows down at 2 Gamma / m, sigma = Gamma - m l''/2 is 0 up to round-off."""
    spells = list[bimodal.Spell]()
    merged = bimodal._switches

    def seen(found: list[bimodal.Spell], shortest: float) -> Any:
        spells[:] = found
        return merged(found, shortest)

    monkeypatch.setattr(bimodal, "_switches", seen)
    load, ramp = 0.3, 0.7
    gait = trapezoid(2 * load, ramp)
    wobble = np.random.default_rng(0).normal(0.0, noise, (4, 1, 3))
    gait = Gait(gait.breaks, gait.polynomial * (1 + wobble))
    motion = integrate(gait, [1.0, 1.0], 0.0, load)
    assert motion.glides == ()
    assert len(spells) <= 5  # short ones too, which `switches` leaves out
    assert motion.lambda_min == pytest.approx(0, abs=1e-9)
    assert motion.advance == pytest.approx(2 * load * ramp**2, abs=1e-11)


def test_a_short_dip_of_sigma_is_not_missed():
    """A millionth below the threshold sigma is negative for 1/2000 of the period."""
    gait = harmonics([0.3], 1.0)
    depth = 0.15 * 4 * math.pi**2
    assert integrate(gait, [1.0, 1.0], 0.0, depth * (1 + 1e-7)).glides == ()
    for shortfall in (1e-2, 1e-4, 1e-6):
        glides = integrate(gait, [1.0, 1.0], 0.0, depth * (1 - shortfall)).glides
        assert len(glides) == 2
        start = math.acos(1 - shortfall) / (2 * math.pi)
        assert glides[-1][0] == pytest.approx(1 - start, abs=1e-7)


def test_masses_that_move_alike_rest_together():
    """The middle of three links keeps its length: masses 1 and 2 always move alike."""
    motion = integrate(harmonics([0.2, 0.0, 0.2j]), [1.0] * 4, 0.0, 30.0)
    sets = {resting for _, resting in motion.switches}
    assert sets == {frozenset({0}), frozenset({1, 2}), frozenset({3})}
    assert motion.resting_min == 1


def by_time_stepping(
    gait: Gait, masses: Sequence[float], drag: float, load: float, steps: int = 40_000
) -> tuple[float, float]:
    """Advance and mean lambda by Moreau's time stepping, first order, no events at all."""
    t = np.linspace(0, gait.period, steps + 1)
    spans = np.vstack([np.zeros(len(t)), np.cumsum(gait(t, 1), axis=0)])
    velocities, mass = spans.max(axis=0) - spans, np.array(masses)
    momentum, mean = mass @ velocities / len(mass), velocities.mean(axis=0)
    dt, m, w = t[1], mass.mean(), 0.0
    advance = impulse = 0.0
    for _ in range(3):
        advance, impulse = 0.0, 0.0
        for k in range(steps):
            free = m * w + momentum[k] - momentum[k + 1] - dt * (load + drag * mean[k + 1])
            push = max(0.0, -free)
            w = (free + push) / (m + drag * dt)
            impulse += push
            advance += dt * (spans[:, k + 1].max() + w)
    return advance, impulse / gait.period


@pytest.mark.parametrize("load", [0.5, pytest.param(8.0, marks=pytest.mark.slow), 60.0])
def test_unequal_masses_against_time_stepping(load: float):
    gait = harmonics([0.3, 0.2 + 0.1j, -0.2j, 0.1 - 0.2j])
    mass = [1.0, 0.4, 2.0, 0.7, 1.6]
    motion = integrate(gait, mass, 0.7, load)
    advance, mean = by_time_stepping(gait, mass, 0.7, load)
    assert motion.advance == pytest.approx(advance, rel=1e-3)
    assert motion.lambda_mean == pytest.approx(mean, rel=1e-3)


def resting_by_sampling(gait: Gait, motion: BimodalMotion) -> float:
    """Share of sample times at which the motion names another resting mass than argmax S_i'."""
    t = (np.arange(2000) + 0.5) / 2000 * gait.period
    spans = np.vstack([np.zeros(len(t)), np.cumsum(gait(t, 1), axis=0)])
    starts = [time for time, _ in motion.switches]
    which = np.searchsorted(starts, t, side="right") - 1
    wrong = [
        motion.switches[w][1] != {lead} for w, lead in zip(which, spans.argmax(0), strict=True)
    ]
    return float(np.mean(wrong))


parts = st.floats(-0.3, 0.3).map(lambda value: round(value, 3))


@pytest.mark.parametrize("phasors", [[0.008 + 0.297j, 0.125j], [-0.125j, -0.008 - 0.297j]])
def test_a_mass_may_lead_until_it_ties_with_another_at_a_sample(phasors: list[complex]):
    """Mass 1 leads from 0.7457 to 3/4, where mass 2 takes over, which is a sample; and mirrored."""
    gait, mass = harmonics(phasors), [1.0] * 3
    motion = integrate(gait, mass, 0.0, 1.0)
    assert motion.lambda_mean == pytest.approx(1.0, abs=1e-10)
    assert motion.speed == pytest.approx(crawl(gait, mass, 0.0, 1.0).speed, abs=1e-10)


@settings(max_examples=examples(30))
@given(
    phasors=st.lists(st.builds(complex, parts, parts), min_size=1, max_size=4),
    data=st.data(),
    drag=st.floats(0, 3),
    load=st.floats(0.1, 40),
    period=st.floats(0.3, 3),
)
def test_impulse_balance_over_a_period(
    phasors: list[complex], data: st.DataObject, drag: float, load: float, period: float
):
    count = len(phasors) + 1
    mass = data.draw(st.lists(st.floats(0.2, 3), min_size=count, max_size=count))
    gait = harmonics(phasors, period)
    motion = integrate(gait, mass, drag, load)
    scale = motion.lambda_max + load
    assert motion.lambda_mean == pytest.approx(drag * motion.speed + load, abs=1e-10 * scale)
    assert motion.lambda_min >= -1e-9 * scale
    assert motion.speed >= 0
    if all(len(resting) == 1 for _, resting in motion.switches):
        assert resting_by_sampling(gait, motion) < 0.005


def test_without_load_and_drag_the_worm_glides_on():
    """Its momentum grows to the largest that the spikes can give: W = the maximum of W0."""
    motion = integrate(fast_gait(1.0), [1.0] * 3, 0.0, 0.0)
    assert motion.speed == pytest.approx(AMPLITUDE, abs=1e-8)


def test_a_gait_that_stands_still():
    motion = integrate(harmonics([0.0, 0.0]), [1.0] * 3, 1.0, 2.0)
    assert (motion.advance, motion.lambda_min, motion.resting_min) == (0.0, 2.0, 3)


@pytest.mark.parametrize("load", [11.4102564102564, 12.1538461538462, 14.0, 17.0])
def test_the_largest_load_may_stand_next_to_the_landing(load: float):
    """lambda = W0' + k W0 + Gamma is largest where tan(3 pi t) = 1 / (3 pi), for k = 1."""
    motion = integrate(fast_gait(1.0), [1.0] * 3, 1.0, load)
    landing = min(end for _, end in motion.glides)
    assert 0 < landing < math.atan(1 / (3 * math.pi)) / (3 * math.pi)
    largest = load + AMPLITUDE * math.hypot(3 * math.pi, 1.0)
    assert motion.lambda_max == pytest.approx(largest, rel=1e-12)


def test_refusals(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ValueError, match="2 masses for 2 links"):
        integrate(fast_gait(1.0), [1.0, 1.0], 0.0, 1.0)
    monkeypatch.setattr(bimodal, "_MOST_PERIODS", 1)
    with pytest.raises(SolveError, match=r"not periodic after 1 periods.*increase worm\.drag or"):
        integrate(fast_gait(1.0), [1.0] * 3, 1.0, 5.0)
