"""Worms on linear drag: the Model, small gaits and their closed forms, large gaits two ways."""

import math

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals, value
from scipy.optimize import brentq

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.peristaltic.drag import displacement, drag_worm
from wormopt.systems.peristaltic.drag_gaits import (
    DragAim,
    best_gait,
    small_gaits,
    stationary,
)

SEEDS = st.integers(0, 2**32 - 1)
# Roots of tan(N phi / 2) = -(N / 3) tan(phi / 2), and generalised eigenvalues.
GAINS = {
    2: 1 / 4, 3: 1 / 2, 4: 0.7302024066, 5: 0.9503225176, 6: 1.1650864371, 7: 1.3767161490,
    8: 1.5863638020, 9: 1.7946811697, 10: 2.0020633963,
}  # fmt: skip
BY_DISSIPATION = {2: 3 / 2, 3: math.sqrt(3), 4: 1.6845500048, 5: 1.7001068722, 6: math.sqrt(3)}


def random_gait(seed: int, segments: int, *, keeps_length: bool = False) -> Gait:
    """A few harmonics at random, all lengths above a fifth, joined as polynomials would be."""
    noise = np.random.default_rng(seed)
    swing = noise.normal(size=(3, segments)) + 1j * noise.normal(size=(3, segments))
    if keeps_length:
        swing -= swing.mean(axis=1, keepdims=True)
    t = np.linspace(0, 1, 49)
    turns = np.exp(2j * np.pi * np.outer(np.arange(1, 4), t))
    strains = np.einsum("hj,ht->jt", swing, turns).real
    lengths = 1 + 0.8 * strains / np.abs(strains).max()
    slopes = np.diff(lengths, axis=1) * 48
    pieces = np.stack([lengths[:, :-1], slopes], axis=-1).transpose(1, 0, 2)
    return Gait(t, pieces)


def effort(gait: Gait) -> float:
    """Strain rates squared of a gait of straight pieces."""
    return float(np.sum(gait.polynomial[:, :, 1] ** 2 * np.diff(gait.breaks)[:, None]))


@pytest.mark.parametrize("segments", [2, 3, 5, 9])
def test_drag_that_does_not_hang_on_length_moves_nothing(segments: int):
    model = drag_worm(segments, 0.0)
    speed = ca.substitute(model["speed"], model["exponent"], 0)
    per_rate = ca.jacobian(speed, model["rate"])
    assert not ca.depends_on(per_rate, model["length"])
    assert np.abs(np.asarray(ca.evalf(per_rate))).max() < 1e-16


@settings(max_examples=examples(20))
@given(SEEDS, st.integers(2, 6))
def test_no_gait_goes_anywhere_with_exponent_0(seed: int, segments: int):
    assert abs(displacement(random_gait(seed, segments), 0.0)) < 1e-14


@settings(max_examples=examples(20))
@given(SEEDS, st.sampled_from([-2.0, -1.0, 1.0, 1.7]))
def test_symmetries(seed: int, exponent: float):
    gait = random_gait(seed, 3)
    way = displacement(gait, exponent)
    mirrored = Gait(gait.breaks, gait.polynomial[:, ::-1])
    assert displacement(mirrored, exponent) == pytest.approx(-way, abs=1e-13)
    slow = Gait(3 * gait.breaks, gait.polynomial / 3.0 ** np.arange(2))
    assert displacement(slow, exponent) == pytest.approx(way, abs=1e-13)
    long = Gait(gait.breaks, 5 * gait.polynomial)
    assert displacement(long, exponent) == pytest.approx(5 * way, abs=1e-12)


def test_a_worm_without_segments_or_size_is_refused():
    for given_ in ({"segments": 1}, {"segments": 3, "drag": 0.0}):
        with pytest.raises(ArgumentError, match="two or more segments"):
            drag_worm(**{"exponent": 1.0, **given_})  # pyright: ignore[reportArgumentType]


def strain_rate_gain(segments: int, *, fixed_total: bool = False) -> float:
    """Return the gain k for the cost of strain rates in closed form: cot(phi / 2) / 2.

    phi is 2 pi / N for a constant total length, which is a wave, else the root of
    tan(N phi / 2) = -(N / 3) tan(phi / 2) between pi / N and 2 pi / N.
    """
    N = segments

    def off(phi: float) -> float:
        return 3 * np.sin(N * phi / 2) * np.cos(phi / 2) + N * np.cos(N * phi / 2) * np.sin(phi / 2)

    whole = 2 * np.pi / N
    phi = whole if fixed_total else float(brentq(off, np.pi / N, whole, xtol=1e-16, rtol=1e-15))  # pyright: ignore[reportArgumentType]
    return float(1 / np.tan(phi / 2) / 2)


def test_gains_in_closed_form_are_the_eigenvalues():
    for segments, gain in GAINS.items():
        assert strain_rate_gain(segments) == pytest.approx(gain, abs=6e-11)
    for segments in range(2, 25):
        assert small_gaits(segments, -1.0)[0].gain == pytest.approx(strain_rate_gain(segments))
    for segments in range(3, 25):
        wave = small_gaits(segments, 1.0, fixed_total=True)[0]
        assert wave.gain == pytest.approx(strain_rate_gain(segments, fixed_total=True))
        assert wave.amplitudes == pytest.approx(np.ones(segments))
        assert wave.steps == pytest.approx(np.full(segments - 1, 2 * np.pi / segments))
    for segments, gain in BY_DISSIPATION.items():
        assert small_gaits(segments, 1.0, "dissipation")[0].gain == pytest.approx(gain, abs=6e-11)


def test_free_ends_swing_less():
    three, four = (small_gaits(n, 1.0)[0] for n in (3, 4))
    assert three.amplitudes == pytest.approx([0.790569, 1, 0.790569], abs=6e-7)
    assert three.steps == pytest.approx([math.atan(3)] * 2)
    assert four.amplitudes == pytest.approx([0.776193, 1, 1, 0.776193], abs=6e-7)
    assert four.steps == pytest.approx([1.033113, 0.931928, 1.033113], abs=6e-7)
    backward = small_gaits(3, -1.0)[0]  # the sign of the exponent turns the wave
    assert backward.steps == pytest.approx(-three.steps)


def test_the_cost_decides_the_wavelength():
    steps = {c: abs(small_gaits(12, 1.0, c)[0].steps) for c in ("strain_rate", "dissipation")}
    assert 2 * np.pi / steps["strain_rate"].mean() > 12
    assert 2 * np.pi / steps["dissipation"].mean() == pytest.approx(3, abs=0.05)


def test_long_worms_are_continuous_to_second_order():
    # tan(z / 2) = -z / 6 between pi and 2 pi
    z = float(brentq(lambda z: math.tan(z / 2) + z / 6, 1.01 * np.pi, 1.99 * np.pi))  # pyright: ignore[reportArgumentType]
    sizes = np.array([8, 16, 32, 64])
    off = [abs(strain_rate_gain(int(n)) / n - 1 / z) for n in sizes]
    slope = np.polyfit(np.log(sizes), np.log(off), 1)[0]
    assert -2.1 < slope < -1.9
    assert off[-1] < 1e-4
    free, fixed = strain_rate_gain(1000), strain_rate_gain(1000, fixed_total=True)
    assert free / fixed == pytest.approx(1.279, abs=5e-4)


@pytest.mark.parametrize("exponent", [-1.5, 1.0])
def test_small_gaits_go_as_predicted_to_first_order_in_the_effort(exponent: float):
    best, efforts = small_gaits(4, exponent)[0], np.array([0.4, 0.2, 0.1])
    off = [
        abs(displacement(best.gait(E), exponent) / best.displacement(exponent, E) - 1)
        for E in efforts
    ]
    slope = np.polyfit(np.log(efforts), np.log(off), 1)[0]
    assert 0.95 < slope < 1.05
    assert max(off) < 0.01


def test_a_wave_of_fixed_length_is_quadratic_at_any_amplitude():
    for segments, size in ((3, 0.3), (3, 0.9), (5, 0.7), (8, 0.99)):
        wave = small_gaits(segments, 1.0, fixed_total=True)[0]
        cost = 2 * np.pi**2 * size**2 * segments
        assert wave.gait(cost)(np.linspace(0, 1, 2001)).max() == pytest.approx(1 + size, rel=1e-5)
        exact = np.pi * size**2 / 2 / math.tan(np.pi / segments)
        assert displacement(wave.gait(cost), 1.0) == pytest.approx(exact, rel=1e-12)
        assert wave.displacement(1.0, cost) == pytest.approx(exact, rel=1e-12)


@settings(max_examples=examples(20))
@given(SEEDS, st.integers(3, 7))
def test_no_gait_of_fixed_length_outdoes_the_wave(seed: int, segments: int):
    gait = random_gait(seed, segments, keeps_length=True)
    bound = strain_rate_gain(segments, fixed_total=True) * effort(gait) / (2 * np.pi * segments)
    assert abs(displacement(gait, 1.0)) < bound


def test_small_gaits_that_go_nowhere_are_refused():
    for segments, exponent, fixed in ((3, 0.0, False), (2, 1.0, True)):
        with pytest.raises(ArgumentError, match="no gait has a net displacement"):
            small_gaits(segments, exponent, fixed_total=fixed)


def solved(*changes: str) -> Result:
    return wo.run(load_scene("peristaltic_drag", ["want=[]", *changes]))


@pytest.mark.slow
def test_hardly_any_drag_of_length_fails_and_says_what_to_write():
    found = solved("drag.exponent=-1e-4", "worm.segments=2")
    assert found.status == "failed"
    assert "not resolve the solution; write a drag.exponent farther from 0" in found.reason


@pytest.mark.slow
def test_steep_drag_agrees_with_its_equations():
    """Its lengths need polynomials of a higher degree."""
    found = solved("drag.exponent=-3", "worm.segments=2")
    assert found.status == "ok", found.reason


def test_ways_as_small_as_efforts_are_found_as_sharply():
    aim = DragAim(2, 0.1, "strain_rate", 1e-4, mean=1.0)
    motion = best_gait(aim, Mesh.even(1, 12, Collocation(8, "legendre"), 7), 1e-9)[0].motion
    begin, end = motion.state("position", np.array([0.0, motion.duration]))[0]
    assert stationary(motion, aim).displacement == pytest.approx(end - begin, rel=1e-10)
    assert end - begin == pytest.approx(aim.small_displacement, rel=1e-5)


@pytest.mark.slow
def test_the_best_gait_of_two_segments():
    found = solved("worm.segments=2", "drag.exponent=1.0")
    assert found.status == "ok"
    # Fourier coefficients by another program; shooting of the equations of Euler and Lagrange
    assert value(found, "distance") == pytest.approx(0.2097539041498, abs=6e-13)
    assert value(found, "distance_stationary") == pytest.approx(0.2097539041498, abs=6e-13)
    assert value(found, "distance_small") == pytest.approx(10 / (16 * np.pi))
    assert value(found, "wave_step") > 0
    # by Stokes the way is the area weighted by 1 / (2 (l_0 + l_1)): thin triangles about (1, 1)
    a = found["length"].values.T - 1
    b = np.roll(a, -1, axis=0)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    s = (nodes + 1) / 2
    sums = 2 + np.multiply.outer((a + b).sum(axis=1) / 2, s)
    areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    way = abs(areas @ (weights / 2 * s / (2 * sums)).sum(axis=1))
    assert way == pytest.approx(0.20975, rel=1e-3)


@pytest.mark.slow
def test_the_best_gait_of_three_segments_and_the_price_of_more():
    found, more = (solved("drag.exponent=1.0", f"effort.strain_rate={E}") for E in (10.0, 10.01))
    assert value(found, "distance") == pytest.approx(0.2735140559645, abs=6e-13)
    rise = (value(more, "distance") - value(found, "distance")) / 1e-3
    assert value(found, "price") == pytest.approx(rise, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("segments", "limit", "excess"),
    [(2, 1 / (16 * np.pi), 0.00475), (3, 1 / (12 * np.pi), 0.00284), (4, 0.0290538306, 0.00195)],
)
def test_the_gain_of_large_gaits_grows_with_the_effort(segments: int, limit: float, excess: float):
    for E in (0.5, 1.0):
        found = solved(f"worm.segments={segments}", "drag.exponent=1.0", f"effort.strain_rate={E}")
        assert value(found, "distance_small") == pytest.approx(limit * E, rel=1e-9)
        over = value(found, "distance") / (limit * E) - 1
        assert over / E == pytest.approx(excess, rel=0.02)


@pytest.mark.slow
def test_three_segments_a_wave_where_drag_is_paid():
    found = solved("worm.segments=6", "effort={dissipation=0.5}")
    assert value(found, "segments_per_wave") == pytest.approx(3, abs=0.01)
    assert value(found, "effort_dissipation") == pytest.approx(0.5, rel=1e-9)
    assert value(found, "wave_step") < 0  # thick segments grip: the wave runs backward


@pytest.mark.slow
def test_at_limits_of_the_lengths_a_gait_has_no_second_route():
    found = solved("limits={length=[0.6, 1.4]}", "mesh.tolerance=1e-6")
    assert found.status == "ok"
    assert found.scalars["distance_stationary"].value is None
    assert any("reaches a limit" in warning for warning in found.trust["warnings"])
    spread = found["length"].values
    assert spread.min() > 0.6 - 1e-9
    assert spread.max() < 1.4 + 1e-9


test_what_is_refused = refusals(
    "peristaltic_drag",
    """
    drag.exponent=0.0 | drag.exponent | write 1.0, or -1.0
    limits={} | limits | write mean_length = 1
    limits={length=[1.2, 1.4], mean_length=1.0} | limits.mean_length | write 1.3
    limits={keeps_length=true, length=[0.5, 2.0]} | limits.mean_length | missing
    effort={} | effort | write either
    effort={strain_rate=1.0, dissipation=1.0} | effort | write either
    search.starts=3 | search.starts | write 1
    limits.length=[-0.5, 1.5] | limits.length
    worm.segments=2 & limits.keeps_length=true | worm.segments | write 3
    """,
)
