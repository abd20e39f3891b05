"""Controllers of a plant of the user's own, compared from Python and by scenes."""

import inspect
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import wormopt as wo
from tests.oracles.by_samples import Sampled
from wormopt.errors import ArgumentError, SceneError
from wormopt.systems.chain.drawn import median_interval, share_interval

MASS, SPRING, DRAG, WHEEL = 1.3, 4.0, 0.7, 0.4
STATES = np.array(
    [[0, 1, 0], [-SPRING / MASS, -DRAG / MASS, DRAG / MASS], [0, DRAG / WHEEL, -DRAG / WHEEL]]
)
RADIUS, MEMBERS = 0.1, 6


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


def compared(*names: str) -> wo.Result:
    """Rivals on a plant of three states, with saturation and a hold, in a few lines."""
    plant, wide, narrow = cart(), wo.Funnel(9.0, 9.0, 1.0), wo.Funnel(1.0, RADIUS, 1.0)
    aim = wo.gait_reference(wo.travelling_sine(1, 2.0, 0.0, 0.3, 0.0), plant.t)
    tracker = partial(wo.lambda_tracker, tube_radius=RADIUS, adaptation=wo.Quadratic(30.0))
    funnel = partial(wo.funnel_tracker, funnel=narrow, rate_funnel=wide)
    rivals = {
        "(13)": tracker,
        "(14)": partial(tracker, feedback="filter", filter_start=0.0),
        "backstepping": partial(tracker, feedback="backstepping", adaptation=wo.Quadratic(1.0)),
        "funnel": funnel,
        "two gains": partial(funnel, law="two gains"),
        "LQR": partial(wo.lqr, error_weight=400.0),
        "push": wo.Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 0.5)),
    }
    tube: Any = {"tube_radius": RADIUS, "capture": 0.5, "end": 1.0, "members": MEMBERS}
    ports: Any = {"output": "place", "input": "push"}
    hardware = wo.Hardware(period=0.01, input_limit=3.0)
    rivals = {name: rivals[name] for name in names or rivals}
    return wo.compare(plant, aim, rivals, hardware=hardware, **tube, **ports)


@pytest.fixture(scope="module")
def found() -> wo.Result:
    return compared()


def by_steps() -> np.ndarray:
    """Error of the cart under the tracker (13) at the samples of the clock, by SciPy."""

    def growth(t: float, y: np.ndarray, gain: float) -> float:
        return 30 * max(abs(y[0] - 0.3 * np.sin(np.pi * t)) - RADIUS, 0.0) ** 2

    def force(t: float, y: np.ndarray, gain: float) -> float:
        e, slope = y[0] - 0.3 * np.sin(np.pi * t), y[1] - 0.3 * np.pi * np.cos(np.pi * t)
        return -((gain + growth(t, y, gain)) * e + gain * slope)

    push, start = np.array([0.0, 1 / MASS, 0.0]), np.array([0.1, 0.0, 0.0])
    place = Sampled(STATES, push, start, force, growth, 0.01, bound=3.0).run(1.0)[0]
    return np.abs(place - 0.3 * np.sin(np.pi * np.linspace(0.0, 1.0, 101)))


@pytest.mark.slow
def test_a_sampled_loop_in_a_comparison_is_that_of_steps(found: wo.Result):
    at = 5 * np.arange(101)
    np.testing.assert_allclose(found["time"].values[at], np.linspace(0.0, 1.0, 101), atol=1e-12)
    np.testing.assert_allclose(found["error_norm"].values[0, 0, at], by_steps(), atol=1e-8)


@pytest.mark.slow
def test_seven_rivals_have_numbers_intervals_a_table_and_pictures(found: wo.Result):
    names = found.attributes["rivals"]
    assert names == ["(13)", "(14)", "backstepping", "funnel", "two gains", "LQR", "push"]
    assert found.status == "ok", found.reason
    peaks = found["drawn_error_peak"].values[0]
    assert peaks.shape == (7, MEMBERS)
    assert np.ptp(peaks, axis=1).min() > 1e-4  # plants differ
    outside = found["draws_outside"].value[0]
    for k in range(7):
        np.testing.assert_allclose(
            found["median_error_peak"].values[0, k], median_interval(peaks[k])
        )
        np.testing.assert_allclose(
            found["outside_share"].values[0, k], share_interval(outside[k], MEMBERS)
        )
    assert np.abs(found["input"].values).max() == pytest.approx(3.0)
    assert all(f"| {name} |" in found.attributes["table"] for name in names)
    assert "| distance |" not in found.attributes["table"]
    # the open loop has its own push, whatever the plant does
    np.testing.assert_allclose(found["input"].values[0, 6, :, 1:], 0.5, atol=1e-12)


def proportional(plant: wo.Model, aim: wo.Reference) -> wo.Model:
    """A loop of one's own that commands more than any limit."""
    push = -400.0 * (plant["length"] - aim.value) - 20.0 * (plant["rate"] - aim.rate)
    names = [output.name for output in plant.outputs]
    parts = [plant.ode, *(plant[name] for name in names)]
    ode, *shown = ca.substitute(parts, [plant.u[0].symbol], [push])
    pairs = zip([*names, "input"], [*shown, push], strict=True)
    return replace(
        plant,
        u=[],
        ode=ode,
        outputs=[wo.Output(*pair) for pair in pairs],
        schedules=[*plant.schedules, *aim.schedules],
    )


@pytest.mark.parametrize("period", [None, 0.01])
def test_hardware_limits_a_loop_of_ones_own(period: float | None):
    """The cart at 0.1 shall go to 0.8 with at most 3, so its first push is 3 for a while."""
    plant = cart()
    aim = wo.gait_reference(wo.Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 0.8)), plant.t)
    found = wo.compare(
        plant, aim, {"mine": proportional}, end=0.2, tube_radius=RADIUS, members=2,
        hardware=wo.Hardware(period=period, input_limit=3.0), output="place", input="push",
    )  # fmt: skip

    def moves(_t: float, y: np.ndarray) -> list[float]:
        drag = DRAG * (y[1] - y[2])
        return [y[1], (3.0 - SPRING * y[0] - drag) / MASS, drag / WHEEL]

    pushed = solve_ivp(
        moves, (0.0, 0.2), [0.1, 0.0, 0.0], method="DOP853",
        t_eval=found["time"].values, rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    assert (400 * (0.8 - pushed.y[0]) - 20 * pushed.y[1]).min() > 3.0  # cut all the time
    np.testing.assert_allclose(found["input"].values[0, 0, 0], 3.0, atol=1e-12)
    np.testing.assert_allclose(found["error_norm"].values[0, 0], 0.8 - pushed.y[0], atol=1e-7)


# -- scenes ----------------------------------------------------------------------------------------

OWN = f"""
import casadi as ca
import wormopt as wo
MASS, SPRING, DRAG, WHEEL = {MASS}, {SPRING}, {DRAG}, {WHEEL}
{inspect.getsource(cart)}
"""
MODEL = """
schema = 1
model = { file = "plant.py:cart", output = "place", input = "push" }
"""
SINE = '{ shape = "sine", period = 2.0, rest_length = 0.0, amplitude = 0.3, lag = 0.0 }'
TRACKER = 'feedback = "derivative", tube_radius = 0.1, growth = 30.0'
COMPARE = f"""kind = "compare-tracking" {MODEL}
reference = [{{ name = "reference", gait = {SINE} }}]
tube = {{ radius = 0.1, capture = 0.5 }}
tracker = [{{ name = "(13)", {TRACKER} }}]
lqr.error_weight = 400.0
hardware = {{ period = 0.01, input_limit = 3.0 }}
draws = {{ members = 6, spread = 0.2 }}
time = {{ end = 1.0, samples = 501 }}
"""


def scene(folder: Path, text: str, *changes: str, own: str = OWN) -> wo.Scene:
    (folder / "plant.py").write_text(own, encoding="utf-8")
    (folder / "own.toml").write_text(text, encoding="utf-8")
    return wo.load_scene(folder / "own.toml", list(changes))


TRACK = f"""kind = "track" {MODEL}
reference.gait = {SINE}
tracker = [{{ {TRACKER} }}, {{ {TRACKER.replace("derivative", "filter")}, filter_start = 0.0 }}]
time = {{ end = 2.0, samples = 101 }}
"""


def test_an_own_plant_is_tracked(tmp_path: Path):
    result = wo.run(scene(tmp_path, TRACK, "want=['trackers']", 'units="SI"'))
    assert result.status == "ok", result.reason
    plant = cart()
    aim = wo.gait_reference(wo.travelling_sine(1, 2.0, 0.0, 0.3, 0.0), plant.t)
    for k, feedback in enumerate(("derivative", "filter")):
        loop = wo.lambda_tracker(
            plant, aim, tube_radius=RADIUS, adaptation=wo.Quadratic(30.0), filter_start=0.0,
            feedback=feedback, output="place", input="push",
        )  # fmt: skip
        motion = wo.simulate(loop, 2.0, times=np.linspace(0.0, 2.0, 101))
        for name, own in (("length", "place"), ("w", "w"), ("gain", "gain"), ("input", "push")):
            values = result[name].values[k].reshape(101)
            np.testing.assert_allclose(values, motion[own][0], rtol=1e-7, atol=1e-9)
    assert result["w"].dims == ("tracker", "time")
    assert result["place"].unit == "m"
    assert "distance" not in result
    assert result.plot("trackers").axes


OPTIMAL = f"""kind = "track-optimal" {MODEL}
reference.gait = {SINE}
tube = {{ radius = 0.1, capture = 0.5 }}
objective = {{ minimise = "error", input_weight = 1e-3 }}
mesh.arcs = 60
time = {{ end = 1.0, samples = 101 }}
"""
PREDICTIVE = f"""kind = "track-predictive" {MODEL}
reference.gait = {SINE}
tube = {{ radius = 0.1, capture = 0.5 }}
predictive = {{ period = 0.02, horizon = 0.2, input_weight = 1e-3, v_reg = 0.1, force = 6.0 }}
plants = {{ members = 2, spread = 0.2 }}
time = {{ end = 1.0, samples = 101 }}
"""


def least_cost(weight: float, arcs: int, end: float) -> float:
    """Least integral of |e|^2 + weight |u|^2 with forces held on arcs, by linear least squares."""
    h, whole = end / arcs, np.zeros((4, 4))
    whole[:3, :3] = STATES
    whole[1, 3] = 1 / MASS
    fine, rows, right = 40, [], []
    step = expm(whole * h / fine)
    free, forced = np.array([0.1, 0.0, 0.0]), np.zeros((3, arcs))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    inside = [expm(whole * h / fine * (s + 1) / 2) for s in nodes]
    for k in range(arcs):
        for j in range(fine):
            unit = np.eye(arcs)[k]
            for s, g, map_ in zip(nodes, weights, inside, strict=True):
                t = h * (k + (j + (s + 1) / 2) / fine)
                size = np.sqrt(g * h / fine / 2)
                own = map_[:3, :3] @ forced + np.outer(map_[:3, 3], unit)
                rows.append(size * own[0])
                right.append(size * (0.3 * np.sin(np.pi * t) - (map_[:3, :3] @ free)[0]))
            free = step[:3, :3] @ free
            forced = step[:3, :3] @ forced + np.outer(step[:3, 3], unit)
    rows += [*(np.sqrt(weight * h) * np.eye(arcs))]
    right += [0.0] * arcs
    matrix, wanted = np.array(rows), np.array(right)
    u = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    return float(np.sum((matrix @ u - wanted) ** 2))


def test_the_optimal_input_of_an_own_plant_is_that_of_least_squares(tmp_path: Path):
    result = wo.run(scene(tmp_path, OPTIMAL, "want=['trackers']"))
    assert result.status == "ok", result.reason
    assert result["objective"].value == pytest.approx(least_cost(1e-3, 30, 1.0), rel=1e-4)
    assert result["w"].dims == ("tracker", "time")
    assert result.plot("trackers").axes


@pytest.mark.slow
def test_predictive_control_of_an_own_plant_repeats_the_optimum(tmp_path: Path):
    result = wo.run(scene(tmp_path, PREDICTIVE, "want=['predictive']"))
    assert result.status == "ok", result.reason
    assert result["cost"].value[0] == pytest.approx(least_cost(1e-3, 50, 1.0), rel=1e-3)
    assert result["drawn_cost"].values.shape == (4, 2)


LINEAR = f"""kind = "linear" {MODEL}
reference.gait = {SINE}
tracker = {{ {TRACKER.replace("30", "100")} }}
gains.count = 7
time = {{ end = 12.0, samples = 101 }}
"""


def test_linear_theory_of_an_own_plant(tmp_path: Path):
    result = wo.run(scene(tmp_path, LINEAR, "want=['margins', 'poles', 'bode']"))
    assert result.status == "ok", result.reason
    poles = result["pole_real"].values + 1j * result["pole_imag"].values
    np.testing.assert_allclose(np.sort(poles), np.sort(np.linalg.eigvals(STATES)), atol=1e-9)
    assert result["common_zero"].value == pytest.approx(
        -DRAG / WHEEL
    )  # the wheel, if the cart rests
    gain = result["gain_learned"].value
    closed = STATES - gain / MASS * np.outer([0, 1, 0], [1, 1, 0])
    assert result["pole_slowest"].value == pytest.approx(np.linalg.eigvals(closed).real.max())

    def error(gain: float) -> float:
        s = 1j * np.pi
        response = np.linalg.solve(s * np.eye(3) - STATES, [0, 1 / MASS, 0])[0]
        return 0.3 / abs(1 + gain * (1 + s) * response) - RADIUS

    assert result["gain_linear"].value == pytest.approx(brentq(error, 1.0, 100.0), rel=1e-6)
    assert result["gain_simulated"].value == pytest.approx(result["gain_linear"].value, rel=0.01)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("SPRING * x", "SPRING * ca.sin(x)", "is not linear"),
        ("SPRING * x", "SPRING * 0.0 * x + 1", "no state of rest"),
    ],
)
def test_linear_theory_refuses_other_plants(tmp_path: Path, old: str, new: str, message: str):
    with pytest.raises(SceneError, match=message):
        wo.load(scene(tmp_path, LINEAR, own=OWN.replace(old, new))).task  # noqa: B018


def test_results_of_an_own_plant_have_its_units(tmp_path: Path):
    turned = OWN.replace('"length", value=0.1', '"angle", value=0.1').replace('"force"', '"torque"')
    one = f"tracker={{{TRACKER}}}"
    result = wo.run(scene(tmp_path, TRACK, one, "time.end=0.1", 'units="SI"', own=turned))
    assert result["error_norm"].unit == "rad"
    assert result["input"].unit == "N m"
    assert result["input_rms"].unit == "N m"
    compared = wo.run(scene(tmp_path, COMPARE, 'units="SI"', "time.end=0.6", own=turned))
    assert compared["error_integral"].unit == "rad2 s"
    assert compared["input_integral"].unit == "N2 m2 s"
    assert compared["work"].unit == "N m rad"


def test_a_scene_compares_as_python_does(tmp_path: Path):
    by_python, by_scene = compared("(13)", "LQR"), wo.run(scene(tmp_path, COMPARE))
    assert by_scene.attributes["rivals"] == ["(13)", "LQR, feed-forward"]
    for name in ("error_norm", "drawn_error_peak", "median_input_integral", "outside_share"):
        theirs = by_python[name].values
        np.testing.assert_allclose(by_scene[name].values, theirs, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        (["model.output='plaec'"], "model.output", "has no output 'plaec'"),
        (["model.input='pull'"], "model.input", "has no input 'pull'"),
        (["model.output='v'"], "model.output", "relative degree below two"),
        (["model.parameters.m=1"], "model.parameters.m", "has no parameters"),
        (["reference.0.gait={shape='fast', period=2}"], "reference[0].gait.shape", "for all ent"),
        (["reference.0.gait={shape='file', file='gait.csv'}"], "reference[0].gait.file", "output"),
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
    wo.fast_gait(1.0).to_csv(tmp_path / "gait.csv", step=0.1)
    with pytest.raises(SceneError) as caught:
        wo.run(scene(tmp_path, COMPARE, *change))
    assert [key] == [where for where, _ in caught.value.faults]
    assert message in caught.value.faults[0][1]


def test_a_plant_whose_input_acts_backward_is_refused(tmp_path: Path):
    turned = OWN.replace("(u - SPRING", "(-u - SPRING")
    with pytest.raises(SceneError, match="reverse the sign of the input"):
        wo.run(scene(tmp_path, COMPARE, own=turned))


def wrong(rival: Any, entries: int = 1, **changes: Any) -> Any:
    plant = cart()
    aim = wo.gait_reference(wo.travelling_sine(entries, 2.0, 0.0, 0.3, 0.0), plant.t)
    given = {"end": 1.0, "tube_radius": RADIUS, "output": "place", "input": "push"} | changes
    return wo.compare(plant, aim, {"mine": rival}, **given)


@pytest.mark.parametrize(
    ("rival", "changes", "message"),
    [
        (partial(wo.lambda_tracker, tube_radius=0.2), {}, "'mine': tube_radius=0.2 differs"),
        (lambda plant, aim: plant, {}, "'mine': cart has inputs left, input"),
        (lambda plant, aim: None, {}, "'mine': the returned loop"),
        (lambda plant, aim: cart(), {}, "'mine': cart is not a loop around this cart"),
        (partial(wo.lqr, error_weight=-1.0), {}, "'mine': error_weight must be positive"),
        (partial(wo.lqr, error_weight=1.0), {"spread": {"m": 1.0}}, "spread of m is 1.0; write"),
        (partial(wo.lqr, error_weight=1.0), {"spread": {"c": 0.1}}, "no parameter 'c' to draw"),
        (partial(wo.lqr, error_weight=1.0), {"capture": 2.0}, "tube.capture"),
        (partial(wo.lqr, error_weight=1.0), {"output": "v"}, "relative degree below two"),
        (partial(wo.lqr, error_weight=1.0), {"entries": 2}, "but place of cart has 1"),
    ],
)
def test_wrong_rivals_are_refused_by_name(rival: Any, changes: dict[str, Any], message: str):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        wrong(rival, **changes)


# -- fits and sweeps -------------------------------------------------------------------------------


def test_a_parameter_of_an_own_plant_is_fitted(tmp_path: Path):
    """The recording is the free motion by a matrix exponential, for another mass."""
    mass, times = 1.7, np.linspace(0.0, 3.0, 31)
    states = STATES * np.array([[1.0], [MASS / mass], [1.0]])
    place = [(expm(states * t) @ [0.1, 0.0, 0.0])[0] for t in times]
    rows = "".join(
        f"{t!r},{x!r},0\n" for t, x in zip(times.tolist(), map(float, place), strict=True)
    )
    (tmp_path / "run.csv").write_text(f"time,place,push\n{rows}")
    text = """
schema = 1
kind = "fit"
[model]
file = "plant.py:cart"
[[recording]]
file = "run.csv"
[[unknown]]
name = "m"
[search]
seeds = 1
"""
    result = wo.run(scene(tmp_path, text))
    assert result["m"].value == pytest.approx(mass, rel=1e-6)


@pytest.mark.slow
def test_parameters_of_an_own_plant_are_swept(tmp_path: Path):
    with_mass = OWN.replace("def cart()", "def cart(mass=MASS)").replace("value=MASS", "value=mass")
    own = scene(tmp_path, TRACK, "time.end=0.2", "tolerance.recheck=false", own=with_mass)
    found = wo.sweep(
        own,
        {"model.parameters.mass": [1.0, 2.0]},
        store=tmp_path / "s",
        engine=wo.Engine(workers=1),
    )
    plant = cart()
    aim = wo.gait_reference(wo.travelling_sine(1, 2.0, 0.0, 0.3, 0.0), plant.t)
    loop = wo.lambda_tracker(
        plant, aim, tube_radius=RADIUS, adaptation=wo.Quadratic(30.0), output="place", input="push"
    )
    for k, mass in enumerate((1.0, 2.0)):
        gain = wo.simulate(loop, 0.2, p={"m": mass})["gain"][0, -1]
        assert np.asarray(found["k_end"].values)[k].flat[0] == pytest.approx(gain, rel=1e-8)
