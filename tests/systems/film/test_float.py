"""Floats on a travelling wave and tracers below it: drift, capture, paths."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from outcomes import refusals, refused, run_text, value
from scipy.integrate import quad

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study import load_scene
from wormopt.systems.film import floats as float_study
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import (
    CAPTURE_DELTA,
    body_velocity,
    capture_delta,
    cosine_drift,
    float_drift,
    floating,
    tracer_drift,
    tracers,
)
from wormopt.systems.film.lubrication import velocities
from wormopt.systems.film.shapes import FourierWave

TWO_PI = 2 * math.pi
LENGTHS = [0.0, 0.5, 2.0, 5.0]


def drift_of(motion: Trajectory, name: str) -> float:
    """From how often a trough has passed, and when."""
    times = [event.time for event in motion.events if event.name == f"{name} overtaken"]
    assert len(times) > 1
    return 1 - TWO_PI * (len(times) - 1) / (times[-1] - times[0])


# -- small floats ----------------------------------------------------------------------------------


def test_capture_begins_where_the_crest_is_as_fast_as_the_wave():
    """u_s is largest where h is, and 1 there for delta² + 6 delta = 4 only."""
    delta, h = sp.symbols("delta h", positive=True)
    C = -2 * (1 - delta**2) / (2 + delta**2)
    surface = sp.Rational(3, 2) * (1 + C / h)
    assert sp.simplify(sp.diff(surface, h) - 3 * (1 - delta**2) / (h**2 * (2 + delta**2))) == 0
    lag = sp.together(1 - surface.subs(h, 1 + delta))
    assert sp.rem(sp.numer(lag), delta**2 + 6 * delta - 4, delta) == 0
    roots = [root for root in sp.solve(lag, delta) if 0 < root < 1]
    assert roots == [sp.sqrt(13) - 3]
    assert pytest.approx(float(roots[0]), abs=1e-15) == CAPTURE_DELTA
    assert pytest.approx(0.605551275463989, abs=1e-12) == CAPTURE_DELTA


@pytest.mark.parametrize("delta", [0.01, 0.1, 0.3, 0.5, 0.6, 0.6055])
def test_the_closed_drift_is_that_of_quadrature(delta: float):
    with mp.workdps(30):
        delta_ = mp.mpf(delta)
        C = -2 * (1 - delta_**2) / (2 + delta_**2)

        def slowness(xi: Any) -> Any:
            return 1 / (1 - mp.mpf(3) / 2 * (1 + C / (1 + delta_ * mp.cos(xi))))

        turn: Any = 2 * mp.quad(slowness, [0, 0.02, 0.1, 0.5, 2, mp.pi])
        expected = float(1 - 2 * mp.pi / turn)
    drift = float_drift(CosineWave(delta))
    assert drift.velocity == pytest.approx(expected, rel=1e-12)
    assert drift.turn == pytest.approx(float(turn), rel=1e-10)
    assert not drift.captured


@pytest.mark.parametrize("delta", [0.05, 0.3, 0.5, 0.6])
def test_the_simulated_drift_is_the_closed_one(delta: float):
    drift = float_drift(CosineWave(delta))
    motion = simulate(floating(CosineWave(delta)), 5 * drift.turn)
    assert drift_of(motion, "float 0") == pytest.approx(drift.velocity, abs=1e-9)


def test_drift_grows_up_to_the_speed_of_the_wave():
    deltas = np.linspace(0.01, CAPTURE_DELTA, 50)
    drifts = cosine_drift(deltas)
    assert np.all(np.diff(drifts) > 0)
    assert drifts[-1] == pytest.approx(1, abs=1e-6)
    below = [1 - cosine_drift(CAPTURE_DELTA - gap) for gap in (1e-4, 1e-6)]
    assert below[0] / below[1] == pytest.approx(10, rel=0.05)  # a saddle-node: a square root


def test_floats_drift_faster_than_the_mean_flow_and_for_small_waves_by_21_to_8():
    for delta in (0.01, 0.1, 0.3, 0.5, 0.6):
        wave = CosineWave(delta)
        assert float_drift(wave).velocity > wave.mean_flow > 0
    assert cosine_drift(1e-4) / 1e-8 == pytest.approx(21 / 8, rel=1e-7)


@pytest.mark.parametrize("side", [-1e-3, 1e-3])
def test_both_sides_of_capture(side: float):
    wave = CosineWave(CAPTURE_DELTA + side)
    motion = simulate(floating(wave, position=[0.0, 2.0]), 800.0)
    passes = [event for event in motion.events if event.time > 50]
    drift = float_drift(wave)
    assert drift.captured == (side > 0)
    assert (len(passes) == 0) == (side > 0)
    if side > 0:
        phase = np.mod(800.0 - motion.end, TWO_PI)
        assert phase == pytest.approx([drift.rests[0]] * 2, abs=1e-6)


@pytest.mark.parametrize("length", LENGTHS[:3])
def test_a_captured_float_rests_on_the_front_face(length: float):
    wave = CosineWave(0.75)
    drift = float_drift(wave, length)
    (rest,) = drift.rests
    assert body_velocity(wave, rest, length) == pytest.approx(1, abs=1e-13)
    assert wave.height(rest, 1) > 0
    step = 1e-4
    assert body_velocity(wave, rest - step, length) < 1 < body_velocity(wave, rest + step, length)
    motion = simulate(floating(wave, length=length), 200.0)
    assert np.mod(200.0 - motion.end[0], TWO_PI) == pytest.approx(rest, abs=1e-7)
    assert drift.velocity == 1


# -- long floats -----------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [0.01, *LENGTHS[1:], 6.28])
def test_capture_of_long_floats_by_independent_quadrature(length: float):
    def lag(delta: Any) -> Any:
        C = -2 * (1 - delta**2) / (2 + delta**2)
        mean = 2 / mp.mpf(length) * mp.quad(lambda s: 1 / (1 + delta * mp.cos(s)), [0, length / 2])
        return 1 - 1.5 * (1 + C * mean)

    expected: Any = mp.findroot(lag, (0.55, 0.92), solver="anderson", tol=1e-25)
    assert capture_delta(length) == pytest.approx(float(expected), abs=1e-12)


def test_long_floats_need_higher_waves():
    lengths = np.linspace(0, TWO_PI * (1 - 1e-12), 20)
    found = [capture_delta(length) for length in lengths]
    assert found[0] == CAPTURE_DELTA
    assert np.all(np.diff(found) > 0)
    # As long as the wave: 6 y = 2 + delta² with y = sqrt(1 - delta²), so y = sqrt(12) - 3
    assert found[-1] == pytest.approx(math.sqrt(1 - (math.sqrt(12) - 3) ** 2), abs=1e-9)


def test_simulated_drifts_of_long_floats():
    wave = CosineWave(0.6)
    drifts = [float_drift(wave, length) for length in LENGTHS]
    motion = simulate(floating(wave, length=LENGTHS), 5 * max(d.turn for d in drifts))
    for i, drift in enumerate(drifts):
        assert drift_of(motion, f"float {i}") == pytest.approx(drift.velocity, abs=1e-9)
    assert np.all(np.diff([d.velocity for d in drifts]) < 0)


@pytest.mark.parametrize("length", [0.0, 1.0])
def test_floats_on_other_waves(length: float):
    same, other = FourierWave([0.0], [0.5]), FourierWave([0.3, 0.1], [0.0, 0.1, 0.05])
    closed = float_drift(CosineWave(0.5), length)
    assert float_drift(same, length).velocity == pytest.approx(closed.velocity, abs=1e-13)
    turn = quad(
        lambda s: 1 / (1 - body_velocity(other, s, length)), 0, TWO_PI, epsabs=1e-12, limit=200
    )[0]
    drift = float_drift(other, length)
    assert drift.turn == pytest.approx(turn, rel=1e-11)
    # compiling so long a mean would take longer than steps in Python
    motion = simulate(floating(other, length=length), 4 * turn, route="python")
    assert drift_of(motion, "float 0") == pytest.approx(drift.velocity, abs=1e-9)


def test_a_wave_with_two_crests_may_hold_floats_on_both():
    wave = FourierWave([0.02, 0.75])
    drift = float_drift(wave)
    assert drift.captured
    assert len(drift.rests) == 2
    for rest in drift.rests:
        assert body_velocity(wave, rest) == pytest.approx(1, abs=1e-12)
        assert wave.height(rest, 1) > 0


def test_the_amplitude_of_a_model_is_a_parameter():
    model = floating(CosineWave(0.2))
    other = float_drift(CosineWave(0.5))
    motion = simulate(model, 5 * other.turn, p={"amplitude": 0.5})
    assert drift_of(motion, "float 0") == pytest.approx(other.velocity, abs=1e-9)
    with pytest.raises(ArgumentError, match="amplitude"):
        simulate(model, 1.0, p={"amplitude": 1.0})


# -- tracers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("delta", [0.2, 0.5, 0.59])
def test_tracers_stay_in_the_film_on_lines_of_the_stream_function(delta: float):
    """What starts on the surface stays on it, and moves as a small float."""
    wave = CosineWave(delta)
    times, height = np.linspace(0, 100, 1001), (1 + delta) * np.array([0.1, 0.3, 0.6, 0.9, 1.0])
    motion = simulate(tracers(wave, height=height), 100.0, times=times)
    assert np.max(np.abs(motion["depth"][-1])) < 1e-8
    assert np.min(motion["depth"][:-1]) > 0
    assert np.min(motion["height"]) > 0
    assert np.max(np.ptp(motion["stream"], axis=1)) < 1e-9
    floats = simulate(floating(wave), 100.0, times=times)
    assert motion["position"][-1] == pytest.approx(floats["position"][0], abs=1e-8)


def test_simulated_drifts_of_tracers():
    wave = CosineWave(0.5)
    heights = 1.5 * np.array([0.2, 0.5, 0.8])
    drifts = [tracer_drift(wave, z) for z in heights]
    motion = simulate(tracers(wave, height=heights), 5 * max(d.turn for d in drifts))
    for i, drift in enumerate(drifts):
        assert drift_of(motion, f"tracer {i}") == pytest.approx(drift.velocity, abs=1e-9)


@pytest.mark.parametrize("delta", [0.2, 0.5])
def test_all_tracers_together_carry_the_mean_flow(delta: float):
    """Through a place that goes with the wave passes 1 - u of fluid at every height, and what
    passes there comes again after its turn: summed up, turns are the fluid of a wavelength, and
    what drifts is the mean flow."""
    wave = CosineWave(delta)
    top = wave.height(0.0)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    z = top * (nodes + 1) / 2
    u, _ = velocities(z, top, 0.0, wave.constant)
    passing = weights * top / 2 * (1 - u)
    drifts = [tracer_drift(wave, each) for each in z]
    turns = np.array([d.turn for d in drifts])
    assert passing.sum() == pytest.approx(-wave.constant, abs=1e-12)
    assert (passing * turns).sum() == pytest.approx(TWO_PI, abs=1e-9)
    carried = (passing * turns * [d.velocity for d in drifts]).sum() / TWO_PI
    assert carried == pytest.approx(wave.mean_flow, abs=1e-10)


def test_a_high_wave_holds_fluid_under_its_crest():
    wave = CosineWave(0.7)
    held = [tracer_drift(wave, share * 1.7).captured for share in (0.2, 0.35, 0.4, 0.8, 0.99)]
    assert held == [False, False, True, True, True]
    assert not any(tracer_drift(CosineWave(0.6), s * 1.6).captured for s in (0.2, 0.6, 0.99))
    model = tracers(wave, height=1.7 * np.array([0.2, 0.35, 0.4, 0.8]))
    motion = simulate(model, 200.0, times=np.linspace(0, 200, 400))
    phase = motion["phase"]
    assert np.max(np.abs(phase[2:])) < math.pi
    assert np.min(phase[:2, -1]) > 4 * math.pi
    assert np.max(np.ptp(motion["stream"], axis=1)) < 1e-8


# -- what cannot be --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"length": TWO_PI}, "below a wavelength"),
        ({"length": -0.1}, "from 0"),
        ({"length": math.nan}, "finite"),
        ({"length": []}, "finite"),
        ({"position": "here"}, "position"),
        ({"length": [0.0, 1.0], "position": [0.0, 1.0, 2.0]}, "write one number for all, or 3"),
    ],
)
def test_floats_that_cannot_be(given: dict[str, Any], message: str):
    with pytest.raises(ArgumentError, match=message):
        floating(CosineWave(0.5), **given)


@pytest.mark.parametrize("height", [1.51, -0.1, math.nan])
def test_tracers_outside_the_film_are_refused(height: float):
    with pytest.raises(ArgumentError, match="height"):
        tracers(CosineWave(0.5), height=height)


def test_a_wave_that_all_but_holds_a_body_is_refused():
    with pytest.raises(ArgumentError, match="nearly holds"):
        float_drift(FourierWave([CAPTURE_DELTA - 1e-13]))


# -- kind float ------------------------------------------------------------------------------------

FLOAT = """schema = 1
kind = "float"
[film]
delta = 0.5
[time]
samples = 101
"""


def test_packaged_floats():
    changes = ["film.delta=0.5", "tracers.height=[0.25, 0.5, 0.75, 1.0]"]
    result = wo.run(load_scene("fig27_float", changes))
    assert result.status == "ok"
    closed = [float_drift(CosineWave(0.5), TWO_PI * s).velocity for s in (0, 0.25, 0.5, 0.75)]
    assert value(result, "float_drift_closed") == pytest.approx(closed, abs=1e-13)
    assert value(result, "float_drift") == pytest.approx(closed, abs=1e-9)
    assert value(result, "tracer_drift")[-1] == pytest.approx(closed[0], abs=1e-9)
    assert value(result, "trapped") == [False] * 4
    assert value(result, "delta_capture")[0] == pytest.approx(math.sqrt(13) - 3, abs=1e-12)
    assert result["float_position"].values.shape == (4, 1001)
    assert any("bend with the surface" in text for text in result.trust["warnings"])


def test_a_captured_float_is_told(tmp_path: Path):
    result = run_text(tmp_path, FLOAT, "film.delta=0.7", "floats.length=[0.0, 0.8]")
    assert value(result, "trapped") == [True, False]
    assert value(result, "float_drift")[0] == pytest.approx(1, abs=1e-6)
    assert value(result, "float_drift")[1] == pytest.approx(
        value(result, "float_drift_closed")[1], abs=1e-9
    )
    (rest, none) = value(result, "phase_trapped")
    assert none is None
    assert rest == pytest.approx(float_drift(CosineWave(0.7)).rests[0])
    assert value(result, "float_turn")[0] is None


def test_the_crest_that_holds_a_float_is_told(tmp_path: Path):
    drift, crests = float_drift(FourierWave([0.02, 0.72])), set()
    for start in (0.0, 0.2, 0.45, 0.6, 0.8):
        crest = ("film={cosines=[0.02, 0.72]}", f"floats.position={start}")
        result = run_text(tmp_path, FLOAT, *crest)
        assert result.status == "ok"
        end = result["time"].values[-1] - result["float_position"].values[0, -1]
        trapped = value(result, "phase_trapped")
        assert abs(math.remainder(end - trapped, TWO_PI)) < 1e-6
        assert abs(value(result, "phase_trapped_error")) < 1e-6
        assert min(abs(trapped - rest) for rest in drift.rests) < 1e-12
        crests.add(trapped)
    assert len(crests) == len(drift.rests) == 2


def test_a_float_held_elsewhere_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def moved(*given: Any) -> Any:
        drift = float_drift(*given)
        return dataclasses.replace(drift, rests=tuple(rest + 1e-4 for rest in drift.rests))

    monkeypatch.setattr(float_study, "float_drift", moved)
    result = run_text(tmp_path, FLOAT, "film.delta=0.7")
    assert result.status == "failed"
    assert "away from its phase of rest" in result.reason
    (lost,) = (check for check in result.checks if not check.passed)
    assert (lost.name, lost.advice) == ("phase of float 0", result.reason)
    assert abs(lost.value or 0) == pytest.approx(1e-4, rel=1e-2)


def test_floats_in_si_units(tmp_path: Path):
    fluid = "film.fluid={mu_r=1.05, viscosity=0.05, density=1100.0, surface_tension=0.028, "
    fluid += "depth=1e-4, wavelength=1e-2, frequency=10.0}"
    tracer = "tracers={height=[0.5]}"
    si = run_text(tmp_path, FLOAT, 'units="SI"', fluid, tracer)
    plain = run_text(tmp_path, FLOAT, tracer)
    speed = 10 * 1e-2 / TWO_PI
    assert si.scalars["float_drift"].unit == "m s-1"
    assert value(si, "float_drift") == pytest.approx(speed * value(plain, "float_drift"), rel=1e-12)
    for name, size in (("float_position", 1e-2 / TWO_PI), ("tracer_height", 1e-4), ("time", 0.1)):
        assert si[name].values == pytest.approx(size * plain[name].values, rel=1e-12)


def test_too_short_a_course_is_told(tmp_path: Path):
    result = run_text(tmp_path, FLOAT, "time.periods=2.0")
    assert value(result, "float_drift") is None
    assert any("write time.periods = " in text for text in result.trust["warnings"])


test_bad_rides_are_refused = refusals(
    FLOAT,
    """
    film.tension=1.0 | film.tension | has no effect
    floats.length=[1.0] | floats.length | below 1
    floats.length=[-0.1] | floats.length | from 0
    floats.length=[] | floats.length | 1 to 8
    tracers.height=[1.2] | tracers.height | up to 1
    film={cosines=[1.2]} | film.cosines | falls to
    units="SI" | film.fluid | missing

    """,
)


def test_a_tracer_on_the_surface_of_a_wave_that_holds_it_is_refused():
    key, said = "tracers.height[1]", "is on the surface of a wave that holds floats"
    refused("fig27_float", {"film.delta": 0.7, "tracers.height": [0.5, 1.0]}, key, said)


@pytest.mark.parametrize("delta", [0.93, 0.95])
def test_a_long_float_may_overtake_the_wave(delta: float) -> None:
    """Where the surface under it is faster than the wave everywhere; by quadrature and motion."""
    wave, length = CosineWave(delta), 2 * np.pi * 0.75
    xi = np.linspace(0.0, 2 * np.pi, 20_001)[:-1]
    speed = np.array([float(body_velocity(wave, at, length)) for at in xi[::20]])
    assert speed.min() > 1
    found = float_drift(wave, length)
    assert found.velocity == pytest.approx(1 + 1 / np.mean(1 / (speed - 1)), rel=1e-9)
    assert found.turn == pytest.approx(2 * np.pi * np.mean(1 / (speed - 1)), rel=1e-9)
