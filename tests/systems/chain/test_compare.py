"""Controllers of a plant of the user's own, compared from Python and by scenes."""

import inspect
import re
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import wormopt as wo
from wormopt.errors import ArgumentError, SceneError
from wormopt.systems.chain.drawn import median_interval, share_interval

MASS, SPRING, DRAG, WHEEL = 1.3, 4.0, 0.7, 0.4
RADIUS = 0.1


def cart() -> wo.Model:
    """A cart on a spring, with a wheel that a damper drags along: three states."""
    x, v, w, u, m = (ca.SX.sym(name) for name in ("x", "v", "w", "u", "m"))
    return wo.Model(
        "cart",
        x=[
            wo.Signal("place", x, "length", value=0.1),
            wo.Signal("v", v, "speed", value=0.0),
            wo.Signal("w", w, "speed", value=0.0),
        ],
        ode=ca.vertcat(v, (u - SPRING * x - DRAG * (v - w)) / m, DRAG * (v - w) / WHEEL),
        u=[wo.Signal("push", u, "force")],
        p=[wo.Signal("m", m, "mass", value=MASS, lower=0.1)],
    )


def compared() -> wo.Result:
    plant = cart()
    aim = wo.gait_reference(wo.travelling_sine(1, 2.0, 0.0, 0.3, 0.0), plant.t)
    tracker = partial(wo.lambda_tracker, tube_radius=RADIUS, adaptation=wo.Quadratic(30.0))
    funnel = partial(
        wo.funnel_tracker, funnel=wo.Funnel(1, RADIUS, 1), rate_funnel=wo.Funnel(9, 9, 1)
    )
    rivals = {
        "(13)": tracker,
        "(14)": partial(tracker, feedback="filter", filter_start=0.0),
        "backstepping": partial(tracker, feedback="backstepping", adaptation=wo.Quadratic(1.0)),
        "funnel": funnel,
        "two gains": partial(funnel, law="two gains"),
        "LQR": partial(wo.lqr, error_weight=400.0),
        "push": wo.Gait([0.0, 1.0], [[[0.5]]]),
    }  # fmt: skip
    hardware = wo.Hardware(period=0.01, input_limit=3.0)
    return wo.compare(
        plant, aim, rivals, end=2.0, tube_radius=RADIUS, capture=1.0, hardware=hardware,
        members=8, output="place", input="push",
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> wo.Result:
    return compared()


def by_steps(mass: float) -> np.ndarray:
    """Error of the cart under the tracker (13) at the samples of the clock, by SciPy."""
    omega = np.pi
    z, gain, errors = np.array([0.1, 0.0, 0.0]), 1.0, []
    for k in range(200):
        t = k * 0.01
        e = z[0] - 0.3 * np.sin(omega * t)
        slope = z[1] - 0.3 * omega * np.cos(omega * t)
        growth = 30 * max(abs(e) - RADIUS, 0.0) ** 2
        u = float(np.clip(-(gain * e + growth * e + gain * slope), -3, 3))
        errors.append(abs(e))
        seen = z[0]

        def rhs(t: float, y: np.ndarray, u: float = u, seen: float = seen) -> list[float]:
            drag = DRAG * (y[1] - y[2])
            off = abs(seen - 0.3 * np.sin(omega * t))
            growth = 30 * max(off - RADIUS, 0.0) ** 2
            return [y[1], (u - SPRING * y[0] - drag) / mass, drag / WHEEL, growth]

        step = solve_ivp(rhs, (t, t + 0.01), [*z, gain], method="DOP853", rtol=1e-12, atol=1e-13)
        z, gain = step.y[:3, -1], step.y[3, -1]
    return np.array(errors)


def test_a_sampled_loop_in_a_comparison_is_that_of_steps(found: wo.Result):
    times = found["time"].values
    at = np.isclose(np.mod(times + 1e-9, 0.01), 0.0, atol=2e-9) & (times < 2 - 1e-9)
    samples = np.round(times[at] / 0.01).astype(int)
    assert len(samples) > 90
    np.testing.assert_allclose(
        found["error_norm"].values[0, 0, at], by_steps(MASS)[samples], atol=1e-8
    )


def test_seven_rivals_have_numbers_intervals_a_table_and_pictures(found: wo.Result):
    names = found.attributes["rivals"]
    assert names == ["(13)", "(14)", "backstepping", "funnel", "two gains", "LQR", "push"]
    assert found.status == "ok", found.reason
    peaks = found["drawn_error_peak"].values[0]
    assert peaks.shape == (7, 8)
    assert np.ptp(peaks, axis=1).min() > 1e-4  # plants differ
    outside = found["draws_outside"].value[0]
    for k in range(7):
        np.testing.assert_allclose(
            found["median_error_peak"].values[0, k], median_interval(peaks[k])
        )
        np.testing.assert_allclose(
            found["outside_share"].values[0, k], share_interval(outside[k], 8)
        )
    assert np.abs(found["input"].values).max() == pytest.approx(3.0)
    assert all(f"| {name} |" in found.attributes["table"] for name in names)
    assert "distance" not in found.attributes["table"]
    # the open loop has its own push, whatever the plant does
    np.testing.assert_allclose(found["input"].values[0, 6, :, 1:], 0.5, atol=1e-12)


# -- scenes ----------------------------------------------------------------------------------------

OWN = f"""
import casadi as ca
import wormopt as wo
MASS, SPRING, DRAG, WHEEL = {MASS}, {SPRING}, {DRAG}, {WHEEL}
{inspect.getsource(cart)}
"""
MODEL = """
schema = 1
[model]
file = "plant.py:cart"
output = "place"
input = "push"
"""
COMPARE = (
    f"kind = 'compare-tracking'{MODEL}"
    """
[[reference]]
name = "reference"
gait = { shape = "sine", period = 2.0, rest_length = 0.0, amplitude = 0.3, lag = 0.0 }
[tube]
radius = 0.1
capture = 1.0
[[tracker]]
name = "(13)"
feedback = "derivative"
tube_radius = 0.1
growth = 30.0
[lqr]
error_weight = 400.0
[hardware]
period = 0.01
input_limit = 3.0
[draws]
members = 8
spread = 0.2
[time]
end = 2.0
samples = 501
"""
)


def scene(folder: Path, text: str, *changes: str, own: str = OWN) -> wo.Scene:
    (folder / "plant.py").write_text(own, encoding="utf-8")
    (folder / "own.toml").write_text(text, encoding="utf-8")
    return wo.load_scene(folder / "own.toml", list(changes))


def test_a_scene_compares_as_python_does(found: wo.Result, tmp_path: Path):
    by_scene = wo.run(scene(tmp_path, COMPARE))
    assert by_scene.attributes["rivals"] == ["(13)", "LQR, feed-forward"]
    for name in ("error_norm", "drawn_error_peak", "median_input_integral", "outside_share"):
        theirs = found[name].values[:, [0, 5]]
        np.testing.assert_allclose(by_scene[name].values, theirs, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        (["model.output='plaec'"], "model.output", "has no output 'plaec'"),
        (["model.input='pull'"], "model.input", "has no input 'pull'"),
        (["model.output='v'"], "model.output", "relative degree below two"),
        (["model.output='w'"], "model.output", "does not act on its acceleration"),
        (["model.parameters.m=1"], "model.parameters.m", "has no parameters"),
        (["reference.0.gait={shape='fast', period=2}"], "reference[0].gait.shape", "for all ent"),
        (["draws.parameters=['mass']"], "draws.parameters", "no parameter 'mass' to draw"),
        (["tracker.0.feedforward={}"], "tracker[0]", "feedforward has no stiffness"),
        (["tracker.0.input='rest_length'"], "tracker[0]", "actuator='force'"),
        (["crawl={period=1, length=[1, 2], force=1}"], "crawl", "needs a chain"),
        (["start.velocity=1"], "start", "value= of the states"),
        (["hardware={input_rate=3}"], "hardware.input_rate", "write a period too"),
        (["hardware={noise=0.1}"], "hardware.noise_interval", "missing"),
    ],
)
def test_what_does_not_fit_an_own_plant_is_refused(
    tmp_path: Path, change: list[str], key: str, message: str
):
    with pytest.raises(SceneError) as caught:
        wo.run(scene(tmp_path, COMPARE, *change))
    assert [key] == [where for where, _ in caught.value.faults]
    assert message in caught.value.faults[0][1]


def test_a_plant_whose_input_acts_backward_is_refused(tmp_path: Path):
    turned = OWN.replace("(u - SPRING", "(-u - SPRING")
    with pytest.raises(SceneError, match="turn the sign of the input"):
        wo.run(scene(tmp_path, COMPARE, own=turned))


def wrong(rival: Any, **changes: Any) -> Any:
    plant = cart()
    aim = wo.gait_reference(wo.travelling_sine(1, 2.0, 0.0, 0.3, 0.0), plant.t)
    given = {"end": 1.0, "tube_radius": RADIUS, "output": "place", "input": "push"} | changes
    return wo.compare(plant, aim, {"mine": rival}, **given)


@pytest.mark.parametrize(
    ("rival", "changes", "message"),
    [
        (partial(wo.lambda_tracker, tube_radius=0.2), {}, "'mine': tube_radius=0.2 differs"),
        (lambda plant, aim: plant, {}, "'mine': cart has inputs left, input"),
        (lambda plant, aim: None, {}, "'mine': what it returns"),
        (lambda plant, aim: cart(), {}, "'mine': cart is no loop around this cart"),
        (partial(wo.lqr, error_weight=-1.0), {}, "'mine': error_weight must be positive"),
        (partial(wo.lqr, error_weight=1.0), {"spread": {"m": 1.0}}, "spread of m must be"),
        (partial(wo.lqr, error_weight=1.0), {"spread": {"c": 0.1}}, "no parameter 'c' to draw"),
        (partial(wo.lqr, error_weight=1.0), {"capture": 2.0}, "tube.capture"),
        (partial(wo.lqr, error_weight=1.0), {"output": "v"}, "relative degree below two"),
    ],
)
def test_wrong_rivals_are_refused_by_name(rival: Any, changes: dict[str, Any], message: str):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        wrong(rival, **changes)
