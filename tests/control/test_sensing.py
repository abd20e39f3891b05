"""Controllers that see a plant with noise, and late."""

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from wormopt.control.lambda_tracker import lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.control.lqr import lqr
from wormopt.control.sensing import Sensors, band_limited, through_sensors
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, pack
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain

FINE = Tolerance(relative=1e-11, absolute=1e-12)
M, C, D, L0, AIM = 0.5, 9.0, 1.0, 2.0, 2.5  # one link between unit masses, and its reference
STILL = Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), AIM))


def worm() -> Model:
    return chain(1, mass=1.0, stiffness=C, damping=D, rest_length=L0)


def linear(plant: Model) -> tuple[Model, float, float]:
    loop = lqr(plant, gait_reference(STILL, plant.t), error_weight=400.0)
    own = {s.name: np.asarray(s.value).item() for s in loop.p if s.name.endswith("_gain")}
    return loop, own["error_gain"], own["rate_gain"]


def test_sensors_that_show_everything_as_it_is_change_nothing():
    plant = worm()
    ref = gait_reference(STILL, plant.t)
    loop = lambda_tracker(plant, ref, tube_radius=0.1, feedback="filter", watch=True)
    seen = through_sensors(plant, loop, Sensors())
    for name in ("input", "error", "gain_rate"):
        there = [pack(loop.x), pack(loop.p), ca.vertcat(*(s.symbol for s in loop.schedules))]
        symbols = [*there, loop.t, *(s.begin for s in loop.schedules)]
        difference = ca.Function("d", symbols, [seen[name] - loop[name]])
        random = np.random.default_rng(0)
        at = [random.normal(size=s.shape) for s in symbols]
        assert np.abs(difference(*at).full()).max() < 1e-12  # type: ignore[union-attr]
    assert [s.name for s in seen.switches] == [f"{s.name}, as seen" for s in loop.switches]


def test_late_linear_feedback_is_that_of_a_matrix_exponential_until_the_delay_has_passed():
    """Until then the force is constant; afterwards it hangs on what is known in closed form."""
    plant, delay = worm(), 0.3
    loop, k0, k1 = linear(plant)
    late = through_sensors(plant, loop, Sensors(delay=delay))
    x0 = {"position": [2.2, 0.0], "velocity": [0.4, 0.0]}
    motion = simulate(late, 2 * delay, x0=x0, times=[0.0, delay, 2 * delay], tolerance=FINE)
    # M e'' + D e' + C e = -k0 e(t - delay) - k1 e'(t - delay)
    A = np.array([[0.0, 1.0], [-C / M, -D / M]])
    past = np.array([2.2 - AIM, 0.4])
    push = np.array([0.0, -(k0 * past[0] + k1 * past[1]) / M])
    whole = np.block([[A, push[:, None]], [np.zeros((1, 3))]])

    def first(t: float) -> np.ndarray:
        return (scipy.linalg.expm(whole * t) @ np.append(past, 1.0))[:2]

    def second(t: float, e: np.ndarray) -> np.ndarray:
        known = first(t)
        return A @ e - np.array([0.0, (k0 * known[0] + k1 * known[1]) / M])

    after = solve_ivp(second, (0, delay), first(delay), method="DOP853", rtol=1e-11, atol=1e-12)
    error = motion["error"][0]
    np.testing.assert_allclose(error[:2], [past[0], first(delay)[0]], atol=1e-9)
    assert abs(error[2] - after.y[0, -1]) < 1e-9


def test_noise_acts_on_a_linear_loop_by_superposition():
    plant = worm()
    loop, k0, k1 = linear(plant)
    noise = band_limited(0.01, 0.05, 2.0, 1, seed=3)
    noisy = through_sensors(plant, loop, Sensors(noise))
    x0 = {"position": [2.2, 0.0]}
    times = np.linspace(0, 2, 41)
    with_noise, without = (
        simulate(m, 2.0, x0=x0, times=times, tolerance=FINE)["error"][0] for m in (noisy, loop)
    )
    curve = PPoly(noise.polynomial[:, 0, ::-1].T, noise.breaks)
    slope = curve.derivative()

    def driven(t: float, e: np.ndarray) -> list[float]:
        push = -k0 * (e[0] + curve(t)) - k1 * (e[1] + slope(t))
        return [e[1], float(push - D * e[1] - C * e[0]) / M]

    found = solve_ivp(
        driven, (0, 2), [0.0, 0.0], method="LSODA", t_eval=times, rtol=1e-9, atol=1e-11,
        max_step=0.01,
    )  # fmt: skip
    np.testing.assert_allclose(with_noise - without, found.y[0], atol=2e-8)
    assert np.abs(found.y[0]).max() > 1e-3


def test_a_gain_grows_by_the_error_that_is_seen():
    """At rest on the reference, a tracker that sees noise beyond its tube learns from it."""
    plant = worm()
    loop = lambda_tracker(plant, gait_reference(STILL, plant.t), tube_radius=0.1)
    noise = Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 0.3))  # held: an offset
    seen = through_sensors(plant, loop, Sensors(noise))
    motion = simulate(seen, 1e-3, x0={"position": [AIM, 0.0]}, times=[0.0], tolerance=FINE)
    assert motion["gain_rate"][0, 0] == pytest.approx((0.3 - 0.1) ** 2, rel=1e-12)
    assert motion["error_norm"][0, 0] < 1e-14
    np.testing.assert_allclose(motion["seen"][:, 0], [AIM + 0.3, 0.0], atol=1e-14)


@given(st.floats(1e-4, 10), st.floats(1e-3, 1), st.integers(1, 40), st.integers(1, 4))
@settings(max_examples=examples(30))
def test_noise_passes_its_samples_with_a_continuous_rate(
    deviation: float, interval: float, count: int, entries: int
):
    noise = band_limited(deviation, interval, count * interval, entries, 7)
    assert noise.links == entries
    assert len(noise.breaks) == count + 1
    normal = np.random.default_rng(7).standard_normal((count + 1, entries))
    atol = 1e-12 * deviation
    np.testing.assert_allclose(noise.polynomial[:, :, 0], deviation * normal[:-1], atol=atol)
    c = noise.polynomial
    end = sum(k * c[:-1, :, k] * interval ** (k - 1) for k in range(1, c.shape[2]))
    size = deviation / interval
    np.testing.assert_allclose(end, c[1:, :, 1], atol=1e-9 * size)


def test_noise_has_its_deviation_and_hardly_anything_above_its_band():
    interval, per = 0.01, 16
    noise = band_limited(2.0, interval, 40.0, 1, 1)
    s = interval * np.arange(per) / per
    values = np.polynomial.polynomial.polyval(s, noise.polynomial[:, 0].T).ravel()
    assert np.std(values[::per]) == pytest.approx(2.0, rel=0.05)  # 4000 samples: 1.1 %
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    frequency = np.fft.rfftfreq(len(values), interval / per)
    above = power[frequency > 1.5 / (2 * interval)].sum() / power.sum()
    assert above < 0.01


def test_what_sensors_cannot_be_is_refused():
    plant = worm()
    loop, _, _ = linear(plant)
    with pytest.raises(ArgumentError, match="delay"):
        Sensors(delay=-1.0)
    with pytest.raises(ArgumentError, match="rows"):
        through_sensors(plant, loop, Sensors(band_limited(1.0, 0.1, 1.0, 2, 0)))
    ref = gait_reference(STILL, plant.t)
    difference = lambda_tracker(plant, ref, tube_radius=0.1, feedback="difference")
    with pytest.raises(ArgumentError, match="has delays already"):
        through_sensors(plant, difference, Sensors(delay=0.1))
    noisy = through_sensors(plant, difference, Sensors(band_limited(1.0, 0.1, 1.0, 1, 0)))
    (past,) = noisy.delays
    assert ca.depends_on(past.signal, next(s.symbol for s in noisy.schedules if s.name == "noise"))
