"""Bodies with a mass on a given wave: limits without mass, capture, friction, balances."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from outcomes import refusals, refused
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import wormopt as wo
from wormopt.errors import ArgumentError, SceneError
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.film.body import HeavyFloat, LyingBody, carried_body
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import float_drift
from wormopt.systems.film.shapes import FourierWave

TIGHT = Tolerance(1e-12, 1e-13)


def floating(delta: float, mass: float, weight: float = 0.0, length: float = 0.0) -> Model:
    return carried_body(HeavyFloat(CosineWave(delta), length, weight), mass=mass)


def turn_of(delta: float, mass: float, end: float) -> float:
    """Time from trough to trough once the start is forgotten."""
    motion = simulate(floating(delta, mass), end, tolerance=TIGHT)
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
    below = simulate(floating(threshold - 1e-4, 0.01), 2500.0)
    above = simulate(floating(threshold + 1e-4, 0.01), 2500.0)
    assert below.events[-1].time > 1000
    assert below["velocity"][0, -1] < 1 - 1e-6
    assert all(event.time < 1000 for event in above.events)
    assert above["velocity"][0, -1] == pytest.approx(1.0, abs=1e-6)
    C = -2 * (1 - (threshold + 1e-4) ** 2) / (2 + (threshold + 1e-4) ** 2)
    h = 1 + (threshold + 1e-4) * math.cos(above["phase"][0, -1])
    assert h == pytest.approx(-3 * C, abs=1e-5)


def test_the_threshold_is_the_root_of_13_less_3_to_its_last_digits() -> None:
    """Without weight a wave holds a float of any mass where its surface is as fast as it goes."""
    crest = lambda delta: float(HeavyFloat(CosineWave(delta)).velocity(0.0)) - 1.0  # noqa: E731
    assert brentq(crest, 0.1, 0.9, xtol=1e-14) == pytest.approx(math.sqrt(13) - 3, abs=1e-13)


def test_weight_helps_the_front_face_to_hold_it() -> None:
    free = simulate(floating(0.55, 0.01), 300.0)
    held = simulate(floating(0.55, 0.01, 0.3), 300.0)
    assert free.events[-1].time > 200
    assert held["velocity"][0, -1] == pytest.approx(1.0, abs=1e-9)
    assert math.sin(held["phase"][0, -1]) < 0  # where the surface at a fixed place rises


@given(st.floats(0.02, 0.95))
def test_a_thin_plate_without_friction_goes_with_the_mean_flow(delta: float) -> None:
    """x' = Q / h = 1 + C / h, so that the wave overtakes it in int -h / C = 2 pi / -C."""
    body = LyingBody(CosineWave(delta))
    xi = np.linspace(0, 2 * math.pi, 4097)[:-1]
    drift = 1 - 1 / np.mean(1 / (1 - body.velocity(xi)))
    assert drift == pytest.approx(3 * delta**2 / (2 + delta**2), abs=1e-12)


@pytest.mark.parametrize("delta", [0.2, pytest.param(0.5, marks=pytest.mark.slow), 0.8])
def test_the_least_friction_that_holds_it(delta: float) -> None:
    """The push 3 (h + C) / h² is largest at h = -2 C, or on the crest, and least in the trough."""
    C = -2 * (1 - delta**2) / (2 + delta**2)
    crest, trough = (3 * (h + C) / h**2 for h in (1 + delta, 1 - delta))
    forward = 3 / (4 * -C) if 1 + delta > -2 * C else crest
    for law, limit in (("forward", forward), ("backward", -trough)):
        other = {"forward": 1e3, "backward": 1e3}
        for share, moves in ((0.99, True), (1.01, False)):
            friction = other | {law: share * limit}
            model = carried_body(LyingBody(CosineWave(delta)), mass=0.05, **friction)
            motion = simulate(model, 7.0, times=np.linspace(0.0, 7.0, 400))
            assert bool(np.any(motion["velocity"][0] != 0)) == moves


def test_between_the_two_it_creeps_against_the_wave() -> None:
    body = LyingBody(CosineWave(0.5))
    ahead, back = (
        simulate(carried_body(body, mass=0.2, forward=force, backward=force), 50)
        for force in (0.5, 1.2)
    )
    assert ahead["position"][0, -1] > 1
    assert back["position"][0, -1] < -0.1
    assert back["velocity"].max() == 0


@pytest.mark.parametrize(("gap", "length"), [(0.13, 1.1), (0.05, 3.6)])
def test_forces_over_a_thin_gap_are_those_by_quadrature(gap: float, length: float) -> None:
    wave = FourierWave([0.25, 0.29, 0.02, -0.19], [0.03, 0.01, -0.13, 0.23])
    height = float(wave.height(np.linspace(0, 2 * math.pi, 20001)).min()) - gap
    body = LyingBody(wave, height, length)

    def mean(xi: float, of: Callable[[float], float]) -> float:
        thin = [xi - length / 2 + k * length / 16 for k in range(17)]
        parts = (quad(of, a, b, epsabs=0, epsrel=1e-12)[0] for a, b in pairwise(thin))
        return sum(parts) / length

    h = wave.height
    for xi in np.linspace(0.1, 6.3, 7):
        push = mean(xi, lambda s: 3 * (h(s) + wave.constant) / (h(s) - height) ** 2)
        drag = mean(xi, lambda s: 3 * h(s) / (h(s) - height) ** 2)
        assert body.push(xi) == pytest.approx(push, abs=1e-10 * drag)
        assert body.drag(xi) == pytest.approx(drag, rel=1e-10)


def test_little_mass_leaves_the_drift_by_quadrature() -> None:
    body = LyingBody(CosineWave(0.5), 0.2, 0.6, 0.1)
    xi = 2 * math.pi * np.arange(1 << 16) / (1 << 16)
    known = 1 - 1 / np.mean(1 / (1 - body.velocity(xi, 0.6, 0.6)))
    errors = []
    for mass in (0.4, 0.2, 0.0125):
        motion = simulate(carried_body(body, mass=mass, forward=0.6, backward=0.6), 60.0)
        times = [event.time for event in motion.events if event.name == "body 0 overtaken"]
        errors.append(abs(1 - 2 * math.pi / (times[-1] - times[-2]) - known))
    assert errors[0] > 4 * errors[1] > 8 * errors[2]
    assert errors[2] < 2e-6


FILM: dict[str, Any] = {"schema": 1, "kind": "film-body", "film": {"delta": 0.5}}
FLUID = {
    "mu_r": 1.05, "viscosity": 0.02, "density": 1200.0, "surface_tension": 0.03, "depth": 1e-4,
    "wavelength": 0.02, "frequency": 5.0,
}  # fmt: skip
SI = FILM | {"units": "SI", "film": {"delta": 0.5, "fluid": FLUID}}
SINKER = {"on": "ground", "height": 0.3, "density": 2700.0, "friction_coefficient": 0.4}


def test_the_packaged_body_creeps_backward() -> None:
    result = wo.run(load_scene("body_in_film", ["time.periods=6"]))
    assert result.status == "ok"
    assert result.scalars["drift"].value < 0
    assert result.scalars["speed_max"].value == 0
    assert 1.1 < result.scalars["friction_forward"].value < 1.125


@pytest.mark.slow
def test_si_bodies_have_the_numbers_of_their_scales() -> None:
    result = wo.run(SI | {"body": SINKER, "time": {"periods": 1.0}})
    assert result.status == "ok"
    assert result.scalars["mass"].value == pytest.approx(2700 * 3e-5 * 5 * 1e-4 / 0.02)
    assert result.scalars["friction"].value == pytest.approx(0.4 * 1500 * 3e-5 * 9.80665)
    assert result.scalars["friction"].unit == "Pa"


test_bad_bodies_are_refused = refusals(
    'schema = 1\nkind = "film-body"\nfilm = {delta = 0.5}\n',
    """
    body={on="ground", mass=1.0} | body.friction_forward | missing
    body={on="surface"} | body.mass | missing
    body={on="surface", mass=1.0, friction_forward=1.0} | body.friction_forward | leave it
    body={on="surface", mass=1.0, density=900.0} | body.density | units = "SI"
    body={on="ground", mass=1.0, friction_forward=1.0, height=0.6} | body.height | 0.5
    body={on="ground", mass=1.0, friction_forward=1.0, weight=0.6} | body.weight | leave
    body={on="surface", mass=0.2, weight=1e9} | body.weight | write 5.6e+05 at most
    body={on="surface", mass=0.2, position=1e15} | body.position | write 0
    body={on="surface", mass=0.2, position=-2000001.25} | body.position | write -0.25
    """,
)


@pytest.mark.slow
def test_of_a_heavy_float_what_is_written_instead_is_followed() -> None:
    heavy = FILM | {"body": {"on": "surface", "mass": 0.2, "weight": 1e9}}
    with pytest.raises(
        SceneError, match=r"about 2e\+06 times .* often to be simulated.*periods = 0.95 at most"
    ):
        wo.run(heavy)
    result = wo.run(heavy, ["body.weight=5.6e5", "tolerance.recheck=false"])
    assert result.status == "unchecked"
    assert result.scalars["held"].value  # by the trough


def test_a_body_that_would_rise_does_not_lie_on_the_ground() -> None:
    refused(SI | {"body": SINKER}, "body.density=200.0", "body", "a body of this density rises")


def test_bodies_that_cannot_be_are_refused() -> None:
    with pytest.raises(ArgumentError, match="a float does not have"):
        carried_body(HeavyFloat(CosineWave(0.5)), mass=1.0, forward=1.0)
    with pytest.raises(ArgumentError, match="nodes along it"):
        LyingBody(CosineWave(0.9), 0.0999999, 3.0)


def test_a_body_may_overtake_the_wave() -> None:
    """It is faster than the wave everywhere: 1 + 1 / mean(1 / (v - 1)) without mass."""
    change = ["film.delta=0.97", "tolerance.recheck=false"]
    change.append('body={on="surface",length=0.75,mass=1e-3,weight=0.0}')
    result = wo.run(load_scene("body_in_film", change))
    assert result.scalars["drift"].value == pytest.approx(1.2252745, abs=1e-6)
    assert result.scalars["drift_massless"].value == pytest.approx(1.2252745, abs=1e-6)


def test_a_float_that_swings_in_a_trough_has_the_speed_of_the_wave() -> None:
    """By SciPy the trough never leaves it, although it passes back and forth."""
    wave, mass, weight, end = CosineWave(0.5), 20.0, 50.0, 12 * math.pi

    def rates(t: float, y: np.ndarray) -> list[float]:
        h, slope = 1 + 0.5 * math.cos(t - y[0]), -0.5 * math.sin(t - y[0])
        return [y[1], ((1.5 * (1 + wave.constant / h) - y[1]) / h + weight * slope) / mass]

    phases = np.linspace(0, end, 500)
    phases -= solve_ivp(rates, (0, end), [math.pi, 0.0], t_eval=phases, rtol=1e-8).y[0]
    assert np.all(np.abs(phases - phases.mean()) < math.pi)
    assert np.sum(np.diff(np.sign(np.sin(phases))) != 0) > 6
    change = ['body={on="surface",mass=20.0,weight=50.0,position=0.5}', "time.periods=6"]
    result = wo.run(load_scene("body_in_film", change))
    assert result.scalars["held"].value
    assert result.scalars["drift"].value == 1.0
