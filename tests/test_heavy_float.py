"""Floats of finite mass on a given wave: the limit without mass, capture, balances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from wormopt.errors import ArgumentError
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import float_drift
from wormopt.systems.film.heavy import heavy_float

TIGHT = Tolerance(1e-12, 1e-13)


def turn_of(delta: float, mass: float, end: float) -> float:
    """Time from trough to trough once the start is forgotten."""
    motion = simulate(heavy_float(CosineWave(delta), mass=mass), end, tolerance=TIGHT)
    return float(np.diff([event.time for event in motion.events])[-1])


@pytest.mark.parametrize("delta", [0.3, 0.5])
def test_without_mass_it_is_the_drift_of_a_light_float(delta: float) -> None:
    known = float_drift(CosineWave(delta)).turn
    turns = np.array([turn_of(delta, 0.016 / 2**k, 3.2 * known) for k in range(5)])
    orders = np.log2((turns[:-1] - known) / (turns[1:] - known))
    assert orders[-1] == pytest.approx(round(orders[-1]), abs=0.05)
    table = turns
    for k in range(1, 5):  # a power series in the mass
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    assert 2 * math.pi / table[0] == pytest.approx(2 * math.pi / known, abs=1e-9)


def test_waves_hold_it_from_the_root_of_13_less_3_on() -> None:
    """Far above it any mass; without weight the phase at which it rests does not know the mass."""
    threshold = math.sqrt(13) - 3
    below = simulate(heavy_float(CosineWave(threshold - 1e-4), mass=0.01), 2500.0)
    above = simulate(heavy_float(CosineWave(threshold + 1e-4), mass=0.01), 2500.0)
    assert below.events[-1].time > 1000
    assert below["velocity"][0, -1] < 1 - 1e-6
    assert all(event.time < 1000 for event in above.events)
    assert above["velocity"][0, -1] == pytest.approx(1.0, abs=1e-6)
    C = -2 * (1 - (threshold + 1e-4) ** 2) / (2 + (threshold + 1e-4) ** 2)
    h = 1 + (threshold + 1e-4) * math.cos(above["phase"][0, -1])
    assert h == pytest.approx(-3 * C, abs=1e-5)


def test_weight_helps_the_front_face_to_hold_it() -> None:
    free = simulate(heavy_float(CosineWave(0.55), mass=0.01), 300.0)
    held = simulate(heavy_float(CosineWave(0.55), mass=0.01, weight=0.3), 300.0)
    assert free.events[-1].time > 200
    assert held["velocity"][0, -1] == pytest.approx(1.0, abs=1e-9)
    assert math.sin(held["phase"][0, -1]) < 0  # where the surface at a fixed place rises


@given(
    delta=st.floats(0.05, 0.9),
    mass=st.floats(0.05, 5.0),
    weight=st.floats(0.0, 1.0),
    length=st.sampled_from([0.0, 1.3]),
)
def test_balances_close_and_another_integrator_agrees(
    delta: float, mass: float, weight: float, length: float
) -> None:
    motion = simulate(
        heavy_float(CosineWave(delta), mass=mass, weight=weight, length=length, position=0.4),
        6.0,
        tolerance=TIGHT,
    )
    x, v = motion["position"][0, -1], motion["velocity"][0, -1]
    assert mass * v == pytest.approx(motion["impulse"][0, -1], abs=1e-9 * (1 + mass))
    assert mass * v * v / 2 == pytest.approx(motion["work"][0, -1], abs=1e-9 * (1 + mass))
    C = -2 * (1 - delta**2) / (2 + delta**2)

    def mean_inverse(xi: float) -> float:
        if not length:
            return 1 / (1 + delta * math.cos(xi))
        ends = xi - length / 2, xi + length / 2
        return quad(lambda s: 1 / (1 + delta * math.cos(s)), *ends)[0] / length

    def rise(xi: float) -> float:
        if not length:
            return -delta * math.sin(xi)
        return delta * (math.cos(xi + length / 2) - math.cos(xi - length / 2)) / length

    def rates(t: float, y: np.ndarray) -> list[float]:
        inverse = mean_inverse(t - y[0])
        drag = (1.5 * (1 + C * inverse) - y[1]) * inverse
        return [y[1], (drag + weight * rise(t - y[0])) / mass]

    known = solve_ivp(rates, (0, 6.0), [0.4, 0.0], rtol=1e-9, atol=1e-10).y[:, -1]
    assert [x, v] == pytest.approx(known, abs=1e-6)


def test_hostile_floats_are_refused() -> None:
    for given_ in ({"mass": 0.0}, {"mass": math.nan}, {"mass": 1.0, "weight": -1.0}):
        with pytest.raises(ArgumentError, match="mass must be above 0"):
            heavy_float(CosineWave(0.5), **given_)
