"""Controllers that act by sensors with noise and delay, a clock, and actuators."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from tests.oracles.by_samples import Sampled
from wormopt.control.drive import drive
from wormopt.control.hardware import band_limited, through_hardware
from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import (
    Reference,
    TrackingError,
    close,
    gait_reference,
    with_reference,
)
from wormopt.control.lqr import lqr
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, pack
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


def motor() -> Model:
    """Speed and its rate are not states: they depend on the inertia, which is drawn, and a wind."""
    angle, speed, current, voltage, inertia = (ca.SX.sym(name) for name in "ascvj")
    return Model(
        "motor",
        x=[Signal("angle", angle), Signal("speed", speed), Signal("current", current)],
        ode=ca.vertcat(speed, (current - 0.1 * speed - 0.3) / inertia, voltage - current - speed),
        u=[Signal("input", voltage)],
        p=[Signal("inertia", inertia, value=0.2)],
        outputs=[Output("length", speed - 0.5)],
    )


@pytest.mark.parametrize("plant", [worm(), motor()], ids=lambda plant: plant.name)
def test_sensors_that_show_everything_as_it_is_change_nothing(plant: Model):
    ref = gait_reference(STILL, plant.t)
    loop = lambda_tracker(plant, ref, tube_radius=0.1, feedback="filter", watch=True)
    seen = through_hardware(plant, loop)
    for name in ("input", "error", "gain_rate"):
        there = [pack(loop.x), pack(loop.p), ca.vertcat(*(s.symbol for s in loop.schedules))]
        symbols = [*there, loop.t, *(s.begin for s in loop.schedules)]
        difference = ca.Function("d", symbols, [seen[name] - loop[name]])
        random = np.random.default_rng(0)
        at = [random.normal(size=s.shape) for s in symbols]
        assert np.abs(difference(*at).full()).max() < 1e-12  # type: ignore[union-attr]
    assert [s.name for s in seen.switches] == [f"{s.name}, as seen" for s in loop.switches]


def test_late_linear_feedback_is_that_of_a_matrix_exponential_until_the_delay_has_passed():
    """Until then the force is constant; afterwards it follows from what is known in closed form."""
    plant, delay = worm(), 0.3
    loop, k0, k1 = linear(plant)
    late = through_hardware(plant, loop, delay=delay)
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
    noisy = through_hardware(plant, loop, noise=noise)
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
    seen = through_hardware(plant, loop, noise=noise)
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
        through_hardware(plant, loop, delay=-1.0)
    with pytest.raises(ArgumentError, match="rows"):
        through_hardware(plant, loop, noise=band_limited(1.0, 0.1, 1.0, 2, 0))
    ref = gait_reference(STILL, plant.t)
    difference = lambda_tracker(plant, ref, tube_radius=0.1, feedback="difference")
    with pytest.raises(ArgumentError, match="already has delays"):
        through_hardware(plant, difference, delay=0.1)
    noisy = through_hardware(plant, difference, noise=band_limited(1.0, 0.1, 1.0, 1, 0))
    (past,) = noisy.delays
    assert ca.depends_on(past.signal, next(s.symbol for s in noisy.schedules if s.name == "noise"))


# -- a clock -------------------------------------------------------------------------------------

# A cart on a spring, with a wheel that a damper drags along: position, velocity, the wheel's speed.
CART, SPRING, DRAG, WHEEL = 1.3, 4.0, 0.7, 0.4
SWING, TURN = 0.4, 3.1
BOUND = 1.2
STEPS = np.array([[0, 1, 0], [-SPRING, -DRAG, DRAG], [0, DRAG, -DRAG]])
CART_A = STEPS / np.array([[1.0], [CART], [WHEEL]])
CART_B = np.array([0.0, 1 / CART, 0.0])
PERIOD, END = 0.01, 0.7


def cart(bound: float) -> Model:
    x, v, w, u = (ca.SX.sym(name) for name in ("x", "v", "w", "u"))
    states = [
        Signal("position", x, "length", value=0.1),
        Signal("velocity", v, "speed", value=-0.2),
        Signal("wheel", w, "speed", value=0.3),
    ]
    ode = ca.vertcat(v, (u - SPRING * x - DRAG * (v - w)) / CART, DRAG * (v - w) / WHEEL)
    force = Signal("input", u, "force", lower=-bound, upper=bound)
    return Model("cart", states, ode, u=[force], outputs=[Output("length", x, "length")])


def swing(plant: Model) -> Reference:
    value = SWING * ca.sin(TURN * plant.t)
    return Reference(value, ca.jacobian(value, plant.t), -(TURN**2) * value)


def aim(t: float) -> np.ndarray:
    return SWING * np.array(
        [np.sin(TURN * t), TURN * np.cos(TURN * t), -(TURN**2) * np.sin(TURN * t)]
    )


TUBE, GROWTH = 0.05, 30.0
HARDWARE: dict[str, dict[str, float]] = {
    "hold": {},
    "saturation": {"bound": BOUND},
    "rate": {"bound": BOUND, "rate": 60.0},
    "steps": {"bound": BOUND, "output_step": 1e-3, "input_step": 0.05},
    "delay": {"delay": 0.0137},
}


# fast tests have each part of the hardware once
EACH = [
    pytest.param(controller, name, marks=[pytest.mark.slow] * ((k + j) % 2))
    for k, controller in enumerate(("lqr", "tracker"))
    for j, name in enumerate(HARDWARE)
]


@pytest.mark.parametrize(("controller", "name"), EACH)
def test_a_sampled_loop_is_that_of_steps_from_sample_to_sample(controller: str, name: str):
    wanted: dict[str, Any] = dict(HARDWARE[name])
    bound = wanted.pop("bound", np.inf)
    plant = cart(bound)
    reference = swing(plant)
    if controller == "lqr":
        loop = lqr(plant, reference, error_weight=900.0)
        own = {s.name: np.asarray(s.value).item() for s in loop.p}
        k0, k1 = own["error_gain"], own["rate_gain"]
        m, d, c, f = (
            own[f"feedforward_{part}"] for part in ("inertia", "damping", "stiffness", "force")
        )

        def force(t: float, y: np.ndarray, gain: float) -> float:
            r = aim(t)
            return m * r[2] + d * r[1] + c * r[0] + f - k0 * (y[0] - r[0]) - k1 * (y[1] - r[1])

        def rate_of_gain(t: float, y: np.ndarray, gain: float) -> float:
            return 0.0

    else:
        loop = lambda_tracker(plant, reference, tube_radius=TUBE, adaptation=Quadratic(GROWTH))

        def rate_of_gain(t: float, y: np.ndarray, gain: float) -> float:
            return GROWTH * max(abs(y[0] - aim(t)[0]) - TUBE, 0.0) ** 2

        def force(t: float, y: np.ndarray, gain: float) -> float:
            r = aim(t)
            e, slope = y[0] - r[0], y[1] - r[1]
            return -(gain * e + rate_of_gain(t, y, gain) * e + gain * slope)

    held = through_hardware(plant, loop, period=PERIOD, **wanted)
    motion = simulate(held, END, times=np.linspace(0.0, END, 701), tolerance=FINE)
    if bound < np.inf:
        assert np.abs(motion["input"]).max() == pytest.approx(bound)
    start = np.array([0.1, -0.2, 0.3])
    by_steps = Sampled(CART_A, CART_B, start, force, rate_of_gain, PERIOD, bound, **wanted)
    last = by_steps.run(END)[:, -1]
    count = 3 if controller == "lqr" else 4
    np.testing.assert_allclose(motion.end[:count], last[:count], atol=1e-8, rtol=0)
    ends = simulate(loop, END, tolerance=FINE).end[:3]
    assert np.abs(ends - last[:3]).max() > 1e-5  # the clock matters


def test_an_open_loop_has_actuators_but_no_sensors():
    plant = cart(np.inf)
    ramp = Gait(np.array([0.0, 1.0]), np.array([[[0.0, 3.0]]]))
    driven = drive(with_reference(plant, swing(plant)), ramp)
    noise = band_limited(1.0, 0.1, 1.0, 1, 0)
    held = through_hardware(plant, driven, period=0.25, noise=noise, delay=0.1)
    motion = simulate(held, 1.0, times=np.linspace(0.0, 1.0, 9), tolerance=FINE)
    np.testing.assert_allclose(motion["input"][0, 1::2], 3 * 0.25 * np.arange(4), atol=1e-12)
    z = np.array([0.1, -0.2, 0.3])
    for k in range(4):
        whole = np.block([[CART_A, 0.75 * k * CART_B[:, None]], [np.zeros((1, 4))]])
        z = (scipy.linalg.expm(0.25 * whole) @ np.append(z, 1.0))[:3]
    np.testing.assert_allclose(motion.end[:3], z, atol=1e-9)


def test_what_needs_a_clock_is_refused_without():
    plant = worm()
    loop, _, _ = linear(plant)
    for name in ("rate", "output_step", "input_step"):
        given_: Any = {name: 0.1}
        with pytest.raises(ArgumentError, match="period="):
            through_hardware(plant, loop, **given_)
    with pytest.raises(ArgumentError, match="period must be"):
        through_hardware(plant, loop, period=0.0)


def test_a_controller_that_sees_more_than_sensors_show_is_refused():
    plant = cart(np.inf)
    reference = swing(plant)
    force = -3 * plant["position"] - 2 * plant["velocity"]
    for seen, refused in ((force, False), (force - plant["wheel"], True)):
        error = TrackingError.of(plant, reference)
        loop = close(plant, reference, error, seen, name="feedback of states")
        if refused:
            with pytest.raises(ArgumentError, match="more of the plant than length and its rate"):
                through_hardware(plant, loop, period=PERIOD)
        else:
            assert through_hardware(plant, loop, period=PERIOD).n_x == loop.n_x + 4


def test_outputs_that_show_the_same_twice_are_refused():
    plant = motor()
    angle, inertia = plant.x[0].symbol, plant.p[0].symbol
    twice = ca.vertcat(inertia * angle, 2 * inertia * angle)
    plant = replace(plant, outputs=[Output("length", twice)])
    both = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), AIM))
    reference = gait_reference(both, plant.t)
    error = TrackingError.of(plant, reference)
    loop = close(plant, reference, error, -error.value[0], name="proportional")
    with pytest.raises(ArgumentError, match="depend on each other"):
        through_hardware(plant, loop)


def test_a_rate_that_means_none_changes_nothing():
    """Sums of periods are rounded; 1e30 must not magnify what they differ from the time."""
    plant = worm()
    loop, _, _ = linear(plant)
    own = [
        simulate(through_hardware(plant, loop, period=0.01, rate=rate), 0.5, tolerance=FINE)
        for rate in (np.inf, 1e30)
    ]
    lengths = [motion["length"][0, -1] for motion in own]
    assert abs(lengths[1] - lengths[0]) < 1e-7 * abs(lengths[0] - AIM) + 1e-9
