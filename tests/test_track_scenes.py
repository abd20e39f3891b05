"""Scenes of the kinds "track" and "simulate": what they refuse, find and prove."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any, get_args

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from by_hand import Chain, commanded, thirds, tracked
from hypothesis import given, settings

import wormopt as wo
from wormopt.cli import main
from wormopt.core.friction import Coulomb
from wormopt.errors import SceneError, SolveError
from wormopt.gaits.construct import fast_gait
from wormopt.result import Result
from wormopt.scenes import load_scene, packaged_scenes
from wormopt.scenes.simulate import SimulateScene
from wormopt.scenes.track import TrackScene
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.studies import proof, signals
from wormopt.studies.chains import draw_links
from wormopt.studies.loops import build_loop
from wormopt.studies.proof import warnings_of_contact

TRACK = """
schema = 1
kind = "track"
[worm]
links = 2
mass = 1.0
stiffness = 10.0
damping = 5.0
rest_length = 2.0
friction = { kind = "coulomb", forward = 1.0, backward = 10.0 }
[start]
position = [4.0, 2.0, 0.0]
[reference.gait]
shape = "fast"
period = 1.0
[tracker]
feedback = "derivative"
tube_radius = 0.2
growth = 1e4
[time]
end = 2.0
"""
SIMULATE = """
schema = 1
kind = "simulate"
[worm]
links = 2
mass = 1.0
stiffness = 10.0
damping = 0.5
rest_length = 2.0
friction = { kind = "coulomb", forward = 1.0, backward = 3.0 }
[time]
end = 2.0
"""
MODEL = """
schema = 1
kind = "simulate"
model = "own.py:build"
[time]
end = 1.0
"""
OWN = """
import casadi as ca
from wormopt import Model, Signal
def build(rate=1.0):
    x = ca.SX.sym("x")
    return Model("decay", x=[Signal("x", x, value=1.0)], ode=-rate * x)
"""

RANDOM = (
    TRACK.replace("[start]", 'random = { stiffness = { process = "fixed", spread = 1 } }\n[start]')
    + "[ensemble]\nmembers = 5\n"
)

# Base scene, change as for --set, key path and part of the message.
HOSTILE = [
    (TRACK, "worm.links=0", "worm.links", "from 1 to 100"),
    (TRACK, "worm.links=101", "worm.links", "from 1 to 100"),
    (TRACK, "worm.links=3", "reference.gait.shape", "2 links"),
    (TRACK, "worm.mass=0", "worm.mass", "above 0"),
    (TRACK, "worm.mass=[1, 1]", "worm.mass", "2 entries for 3 masses"),
    (TRACK, "worm.stiffness=-1", "worm.stiffness", "0 or above"),
    (TRACK, "worm.damping=[1, 2, 3]", "worm.damping", "3 entries for 2 links"),
    (TRACK, "worm.rest_length=nan", "worm.rest_length", "finite"),
    (TRACK, "worm.drag=[1, 2]", "worm.drag", "2 entries for 3 masses"),
    (TRACK, "worm.load=inf", "worm.load", "finite"),
    (TRACK, "worm.frction=3", "worm.frction", "did you mean friction"),
    (TRACK, "worm.mass=1e40", "worm.mass", "choose units"),
    (TRACK, "worm.mass=[1, 1e-40, 1]", "worm.mass[1]", "choose units"),
    (SIMULATE, "worm.friction.forward=1e300", "worm.friction.forward", "choose units"),
    # friction
    (TRACK, "worm.friction=3", "worm.friction", "a table"),
    (TRACK, 'worm.friction={kind="dry"}', "worm.friction.kind", '"coulomb", "stribeck"'),
    (TRACK, "worm.friction={forward=1}", "worm.friction.kind", "missing"),
    (TRACK, "worm.friction.forward=-1", "worm.friction.forward", "0 or above"),
    (TRACK, "worm.friction.forward=[1, 1]", "worm.friction.forward", "2 entries for 3 masses"),
    (TRACK, "worm.friction.stick_forward=0.5", "worm.friction.stick_forward", "below the sliding"),
    (TRACK, "worm.friction.drag=1", "worm.friction.drag", 'with kind = "coulomb"'),
    (TRACK, 'worm.friction={kind="viscous"}', "worm.friction.drag", "missing"),
    (
        TRACK,
        'worm.friction={kind="stribeck", forward=1, backward=1, stick_forward=2, stick_backward=2,'
        " v_stribeck=0}",
        "worm.friction.v_stribeck",
        "above 0",
    ),
    (TRACK, 'worm.friction={kind="spike", scale=0}', "worm.friction.scale", "above 0"),
    (TRACK, 'worm.friction=[{kind="spike"}]', "worm.friction", "1 entry for 3 masses"),
    (
        TRACK,
        'worm.friction=[{kind="spike"}, {kind="spike"}, {kind="spikes"}]',
        "worm.friction[2].kind",
        '"spikes" is not allowed',
    ),
    (
        TRACK,
        'worm.friction=[{kind="spike"}, {kind="spike"}, {kind="viscous", drag=[1, 1, 1]}]',
        "worm.friction[2].drag",
        "of one mass",
    ),
    # chance
    (TRACK, "worm.random={}", "worm.random", "nothing is random"),
    (TRACK, "worm.random.seed=-1", "worm.random.seed", "a whole number from 0"),
    (TRACK, "worm.random.stiffness=3", "worm.random.stiffness", "a table"),
    (
        TRACK,
        'worm.random.stiffness={process="noise"}',
        "worm.random.stiffness.process",
        '"fixed", "steps" or "ornstein_uhlenbeck"',
    ),
    (
        TRACK,
        'worm.random.stiffness={process="fixed", spread=10}',
        "worm.random.stiffness.spread",
        "not below worm.stiffness",
    ),
    (
        TRACK,
        'worm.random.damping={process="fixed", spread=[1, 1, 1]}',
        "worm.random.damping.spread",
        "3 entries for 2 links",
    ),
    (
        TRACK,
        'worm.random.damping={process="steps", spread=1, interval=1e-9}',
        "worm.random.damping.interval",
        "more than 1000000 pieces",
    ),
    # start, reference
    (TRACK, "start.position=[1, 2]", "start.position", "2 entries for 3 masses"),
    (TRACK, "start.velocity=[1, 2]", "start.velocity", "2 entries for 3 masses"),
    (TRACK, "reference=3", "reference", "a table"),
    (TRACK, "reference={}", "reference.gait", "missing"),
    (TRACK, "reference.shift=nan", "reference.shift", "finite"),
    (TRACK, 'reference.gait.shape="cosine"', "reference.gait.shape", '"sine"'),
    (TRACK, 'reference.gait.sharing="equal"', "reference.gait.sharing", "unknown key"),
    (TRACK, 'reference.gait={shape="sine", period=1, amplitude=0}', "reference.gait.amplitude", ""),
    (TRACK, 'reference.gait={shape="file", file="no.csv"}', "reference.gait.file", "cannot be"),
    (
        TRACK,
        'reference.gait={shape="block_wave", period=1, length=[2, 1]}',
        "reference.gait.length",
        "empty",
    ),
    # trackers
    (TRACK, "tracker=[]", "tracker", "at least one"),
    (TRACK, "tracker=3", "tracker", "a table"),
    (TRACK, "tracker=[3]", "tracker[0]", "a table"),
    (TRACK, 'tracker.feedback="pid"', "tracker.feedback", '"filter", "derivative"'),
    (TRACK, 'tracker=[{feedback="pid"}]', "tracker[0].feedback", '"pid" is not allowed'),
    (TRACK, 'tracker=[{feedback="filter"}]', "tracker[0].tube_radius", "missing"),
    (TRACK, "tracker.tube_radius=0", "tracker.tube_radius", "above 0"),
    (TRACK, "tracker.gain_start=0", "tracker.gain_start", "above 0"),
    (TRACK, "tracker.growth=0", "tracker.growth", "above 0"),
    (TRACK, "tracker.filter_start=1", "tracker.filter_start", 'with feedback = "derivative"'),
    (
        TRACK,
        'tracker={feedback="filter", tube_radius=1, filter_start=[1, 2, 3]}',
        "tracker.filter_start",
        "3 entries for 2 links",
    ),
    (TRACK, "tracker.adaptation={}", "tracker.adaptation.law", "missing"),
    (
        TRACK,
        'tracker.adaptation={law="exponent", exponent=0}',
        "tracker.adaptation.exponent",
        "from 1 to 100",
    ),
    (TRACK, "tracker.feedforward=true", "tracker.feedforward", "a table"),
    (
        TRACK,
        "tracker.feedforward.stiffness=[1]",
        "tracker.feedforward.stiffness",
        "1 entry for 2 links",
    ),
    (TRACK, 'tracker={feedback="funnel"}', "tracker.funnel", "missing"),
    # the rest
    (TRACK, 'contact.treatment="rough"', "contact.treatment", '"smooth" or "exact"'),
    (TRACK, 'contact={treatment="smooth", v_reg=0}', "contact.v_reg", "above 0"),
    (TRACK, 'contact={treatment="exact", v_reg=1}', "contact.v_reg", "unknown key"),
    (TRACK, "time.end=0", "time.end", "above 0"),
    (TRACK, "time.samples=1", "time.samples", "from 2"),
    (TRACK, "tolerance.relative=1e-15", "tolerance.relative", "1e-14"),
    (TRACK, "tolerance.absolute=0", "tolerance.absolute", "above 0"),
    (TRACK, "tolerance.max_steps=0", "tolerance.max_steps", "1 or above"),
    (TRACK, "tolerance.recheck=1", "tolerance.recheck", "true or false"),
    (TRACK, "ensemble.members=1", "ensemble.members", "from 2"),
    (TRACK, "ensemble.members=5", "ensemble", "all members would be alike"),
    (TRACK, 'want=["bands"]', "want", "shows an ensemble"),
    (RANDOM, 'want=["motion"]', "want", 'write "bands"'),
    (TRACK, 'want=["spikes"]', "want[0]", '"trackers"'),
    # kind simulate
    (SIMULATE, 'model="a.py:build"', "model", "not both"),
    (SIMULATE, "parameters.a=1", "parameters", "those of a model"),
    (SIMULATE, 'actuation.law="step"', "actuation.law", '"constant", "harmonic" or "gait"'),
    (SIMULATE, 'actuation={law="constant", force=[1]}', "actuation.force", "1 entry for 2 links"),
    (SIMULATE, 'actuation={law="harmonic", amplitude=1}', "actuation.period", "missing"),
    (
        SIMULATE,
        'actuation={law="harmonic", amplitude=[1, 2, 3], period=1}',
        "actuation.amplitude",
        "3 entries for 2 links",
    ),
    (SIMULATE, 'actuation={law="gait"}', "actuation.gait", "missing"),
    (
        SIMULATE,
        'actuation={law="gait", gait={shape="file", file="no.csv"}}',
        "actuation.gait.file",
        "cannot be read",
    ),
    (SIMULATE, 'want=["trackers"]', "want[0]", '"motion"'),
    (SIMULATE, 'tracker={feedback="filter"}', "tracker", "unknown key"),
    (MODEL, 'model="own.py"', "model", '"file.py:function"'),
    (MODEL, 'model="own.txt:build"', "model", '"file.py:function"'),
    (MODEL, 'model="own.py:a b"', "model", '"file.py:function"'),
    (MODEL, 'model="none.py:build"', "model", "cannot be read"),
    (MODEL, 'model="folder.py:build"', "model", "cannot be read"),
    (MODEL, 'model="broken.py:build"', "model", "broken.py line 2"),
    (MODEL, 'model="null.py:build"', "model", "null.py"),
    (MODEL, "start.velocity=1", "start", "belongs to [worm]"),
    (MODEL, 'actuation={law="constant", force=1}', "actuation", "belongs to [worm]"),
    (MODEL, 'want=["motion"]', "want", '"signals"'),
    (MODEL, "parameters.rate=nan", "parameters.rate", "finite"),
    (MODEL, "parameters.rate=[1, inf]", "parameters.rate", "finite"),
    (MODEL, "parameters.rate=1979-05-27", "parameters.rate", "finite"),
    (MODEL, "parameters=3", "parameters", "a table"),
]

# What may be wrong with the user's file once it runs: text, key path, part of the message.
HOSTILE_MODELS = [
    ("x = 1 / 0", "model", "own.py line 1: ZeroDivisionError: division by zero"),
    ("import no_such_module_at_all", "model", "line 1: ModuleNotFoundError"),
    ("import sys\nsys.exit(3)", "model", "line 2: SystemExit: 3"),
    ("", "model", "no function build; define it"),
    ("def biuld(): pass", "model", 'write model = "own.py:biuld"'),
    ("build = 3", "model", "no function build"),
    ("def build():\n    return None", "model", "returns nothing, not a Model"),
    ("def build():\n    return {}", "model", "returns dict, not a Model"),
    (
        "def build():\n    pass\n    raise ValueError('no legs')",
        "model",
        "line 3: ValueError: no legs",
    ),
    ("def build(a):\n    return None", "parameters.a", "missing"),
    (OWN.replace("value=1.0", "value=(1.0, 2.0)"), "model", "cannot be simulated"),
    (OWN.replace('"x", x', '"time", x'), "model", "'time' is taken"),
    (OWN.replace('"x", x', '"x 1", x'), "model", "is no name"),
    (OWN.replace("ode=-rate * x", 'ode=-ca.SX.sym("c") * x'), "model", ": c; give them"),
    (OWN.replace("ca.SX", "ca.MX"), "model", "no casadi.SX"),
    (OWN.replace("ode=-rate * x", "ode=ca.SX(2, 1)"), "model", "line 6: ValueError"),
    (
        OWN.replace("[Signal", "[] and [Signal").replace("-rate * x", "ca.SX(0, 1)"),
        "model",
        "no st",
    ),
]


def write(folder: Path, text: str, own: str | None = None) -> Path:
    (folder / "folder.py").mkdir(exist_ok=True)
    (folder / "broken.py").write_text("x = 1\ndef build(:\n")
    (folder / "null.py").write_bytes(b"x = 1\0")
    (folder / "own.py").write_text(OWN if own is None else own)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def value(result: Result, name: str) -> Any:
    return result.scalars[name].value


@pytest.mark.parametrize(("text", "change", "key", "message"), HOSTILE)
def test_a_wrong_scene_is_refused_with_file_and_key(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    change: str,
    key: str,
    message: str,
):
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path, [change])
    assert any(key == found and message in said for found, said in caught.value.faults), caught
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--set", change]) == 2
    assert f"{path}: {key}: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("own", "key", "message"), HOSTILE_MODELS)
def test_a_wrong_model_is_refused_with_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], own: str, key: str, message: str
):
    path = write(tmp_path, MODEL, own)
    assert main(["check", str(path)]) == 0  # checking runs nothing
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"scene: {key}: ")
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_wrong_parameters_of_a_model_are_named(tmp_path: Path):
    path = write(tmp_path, MODEL)
    with pytest.raises(SceneError, match=r"parameters\.raet: .*did you mean rate"):
        wo.run(load_scene(path, ["parameters.raet=2"]))


def test_all_tables_of_a_list_are_checked_at_once(tmp_path: Path):
    text = 'tracker=[{feedback="filter", tube_radius=0}, {feedback="funnel", gain=-1}]'
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, TRACK), [text])
    assert {key for key, _ in caught.value.faults} == {
        "tracker[0].tube_radius",
        "tracker[1].gain",
        "tracker[1].funnel",
        "tracker[1].rate_funnel",
    }


# -- the chapter's benchmark ---------------------------------------------------------------------

# theory.md, "Benchmark TRACK14 / TRACK13", at t = 10
TRACK14 = {
    "x_end": [13.7293026425339, 12.5129899383629, 11.2234323017047],
    "v_end": [1.5442046082437, 1.2147444914821, 0.6496895012235],
    "filter_end": [-0.7848014274676, -0.7122939752036],
    "k_end": 17.0537482219161,
}
TRACK13 = {
    "x_end": [13.9905483956915, 12.7643770141827, 11.4656131519066],
    "v_end": [1.5265682540374, 1.2068425686835, 0.6714590289857],
    "filter_end": None,
    "k_end": 17.4065002539143,
}


@pytest.fixture(scope="module")
def fig05() -> Result:
    return wo.run("fig05_lambda_trackers")


def test_both_trackers_end_where_the_theory_says(fig05: Result):
    assert fig05.status == "ok"
    for name in TRACK14:
        first, second = value(fig05, name)
        assert first == pytest.approx(TRACK14[name], abs=1e-9)
        assert second == pytest.approx(TRACK13[name], abs=1e-9)
    assert value(fig05, "time_outside_tube") == [10.0, 10.0]
    assert value(fig05, "capture_time") == [None, None]
    assert value(fig05, "n_events") == [0, 0]
    assert max(value(fig05, "recheck_error")) < 1e-8


def test_the_trust_report_says_how_it_was_found(fig05: Result):
    trust = fig05.trust
    assert trust["treatment"] == "smooth, v_reg = 0.025"
    assert trust["route"] == ["native", "native"]
    assert [each["route"] for each in trust["recheck"]] == ["cvodes", "cvodes"]
    assert all(abs(each["residual"]) < 1e-10 for each in trust["energy_balance"])
    # the smooth law at rest: -(5.5 tanh(0) - 4.5), and the speed artanh(9/11)/40 of theory.md
    assert any("+4.5" in text and "+0.0287823" in text for text in trust["warnings"])
    assert sum("never reaches the tube" in text for text in trust["warnings"]) == 2


def test_signals_agree_with_the_scalars(fig05: Result):
    assert fig05["position"].dims == ("tracker", "mass", "time")
    assert fig05["position"].values[:, :, -1] == pytest.approx(np.array(value(fig05, "x_end")))
    lengths, reference = fig05["length"].values, fig05["reference"].values
    assert fig05["error_norm"].values == pytest.approx(
        np.linalg.norm(lengths - reference, axis=1), abs=1e-12
    )
    assert reference == pytest.approx(fast_gait(1.0)(fig05["time"].values), abs=1e-12)
    assert fig05.attributes["trackers"] == ["tracker (14)", "tracker (13)"]


def test_inputs_are_measured_along_the_whole_motion(fig05: Result):
    """Against Gauss quadrature and a fine grid over a motion without anything added to it."""
    scene = load_scene("fig05_lambda_trackers")
    for k in range(2):
        loop = build_loop(scene, k, fast_gait(1.0), draw_links(scene.table.worm, 10.0))
        whole = simulate(loop, 10.0, contact=Smooth(), dense=True)
        assert whole.dense is not None
        ends = whole.dense.time
        nodes, weights = np.polynomial.legendre.leggauss(4)
        t = (ends[:-1, None] + np.diff(ends)[:, None] * (nodes + 1) / 2).ravel()
        square = (whole.at(t).output("input") ** 2).sum(axis=0).reshape(-1, 4) @ weights / 2
        rms = np.sqrt(square @ np.diff(ends) / 10)
        assert value(fig05, "input_rms")[k] == pytest.approx(rms, rel=1e-9)
        peak = np.abs(whole.at(np.linspace(0, 0.5, 5001)).output("input")).max()
        assert value(fig05, "input_peak")[k] == pytest.approx(peak, rel=1e-6)
        assert value(fig05, "input_peak")[k] >= peak * (1 - 1e-12)


# -- the other scenes of the package, against a chain written out by hand ------------------------


def by_hand(name: str) -> tuple[np.ndarray, int]:
    start, gain = [4.0, 2.0, 0.0, 0.0, 0.0, 0.0], [1.0]
    if name == "stiction":
        chain = Chain(commanded(10, 4), c=10, d=0.5, l0=2, slips=(-1, 3), holds=(-2, 6))
        return chain.run(start, 20, thirds(4, 20))
    if name == "spiked_chain":
        chain = Chain(commanded(2000, 1), c=2000, d=40, l0=2, slips=(0, 0), holds=(0, np.inf),
                      drag=1, load=20)  # fmt: skip
        return chain.run(start, 5, thirds(1, 5))
    if name == "keep_spikes":
        control = tracked(1e4, 0.1, lambda length, rate: 10 * (length - 2) + 5 * rate)
        chain = Chain(control, c=10, d=5, l0=2, slips=(-1, 2), holds=(-1, 200))
    else:
        chain = Chain(tracked(1e4, 0.2), c=10, d=5, l0=2, slips=(-1, 10), holds=(-1, 10))
    return chain.run(start + gain, 10, thirds(1, 10))


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("stiction", None),
        ("spiked_chain", None),
        ("keep_spikes", None),
        ("track_meaningful_start", 1),
    ],
)
def test_packaged_scenes_end_where_a_chain_by_hand_does(name: str, column: int | None):
    result = wo.run(name)
    assert result.status == "ok"
    assert result.trust["treatment"] == "exact"
    end, _ = by_hand(name)
    x, v = (value(result, key) for key in ("x_end", "v_end"))
    if column is not None:
        x, v = x[column], v[column]
    assert [*x, *v] == pytest.approx(end[:6].tolist(), abs=1e-9)
    if len(end) == 7:
        k = value(result, "k_end")
        assert (k if column is None else k[column]) == pytest.approx(end[6], abs=1e-8)
    errors = np.atleast_1d(value(result, "recheck_error"))
    assert errors.max() < 1e-7
    balances = result.trust["energy_balance"]
    for balance in balances if isinstance(balances, list) else [balances]:
        assert abs(balance["residual"]) < 1e-9


def test_keeping_spikes_no_mass_slides_back():
    kept = wo.run(load_scene("keep_spikes", ["tolerance.recheck=false"]))
    assert kept["velocity"].values.min() >= 0
    change = ["tolerance.recheck=false", "worm.friction.stick_backward=2"]
    slipping = wo.run(load_scene("keep_spikes", change))
    assert slipping["velocity"].values.min() < -0.1
    assert value(slipping, "distance") < 1.1 < 16 < value(kept, "distance")


def test_the_gain_settles_and_the_error_comes_to_the_edge_of_the_tube():
    result = wo.run(load_scene("track_meaningful_start", ["tolerance.recheck=false"]))
    late = result["time"].values > 9
    peaks = result["error_norm"].values[:, late].max(axis=1)
    assert np.all(peaks < 0.2 * np.array([1.08, 1.08, 1.005]))
    gains = result["gain"].values
    assert np.all(gains[:, -1] - gains[:, np.argmax(late)] < 0.01 * gains[:, -1])
    # a mass that follows gait (15) by spikes advances 4 e l0 = 1.2 a period
    assert value(result, "distance")[:2] == pytest.approx([12.0, 12.0], abs=0.03)
    assert sum("may leave again" in text for text in result.trust["warnings"]) == 3


def test_a_spiked_chain_of_stiff_links_moves_as_kinematics_say():
    errors = []
    for stiffness, damping in ((2000, 40), (20000, 126)):
        change = [f"worm.stiffness={stiffness}", f"worm.damping={damping}"]
        result = wo.run(load_scene("spiked_chain", [*change, "tolerance.recheck=false"]))
        head = result["position"].values[0]
        period = (len(head) - 1) // 5
        errors.append(abs(head[-1] - head[-1 - period] - value(wo.run("fast_gait"), "advance")))
    assert errors[1] < 0.2 * errors[0] < 0.001


def test_a_shaken_capsule_against_closed_form():
    """The capsule slides while m_i a > F+, with a = s/2 w^2 sin(w t), and until v is 0 again."""
    from scipy.optimize import brentq

    result = wo.run("own_model")
    assert result.status == "ok"
    w, amplitude, total = 6.0, 0.3 * 0.25 * 36, 1.3
    t0 = np.arcsin(1 / amplitude) / w

    def v(t: float) -> float:
        return (amplitude / w * (np.cos(w * t0) - np.cos(w * t)) - (t - t0)) / total

    def way(t: float) -> float:
        s = t - t0
        push = amplitude / w * (np.cos(w * t0) * s - (np.sin(w * t) - np.sin(w * t0)) / w)
        return (push - s**2 / 2) / total

    t1 = brentq(v, t0 + 0.1, 2 * np.pi / w)
    assert isinstance(t1, float)
    period = 2 * np.pi / w
    whole, left = divmod(10.0, period)
    assert t0 < left < t1
    assert value(result, "position_end") == pytest.approx(whole * way(t1) + way(left), abs=1e-10)
    assert value(result, "velocity_end") == pytest.approx(v(left), abs=1e-10)
    assert result["rest_start"].values[1:] == pytest.approx(t1 + period * np.arange(whole))
    assert value(result, "n_events") == 2 * whole + 1


def test_tracking_a_sine_settles_at_once():
    result = wo.run("track_sine")
    assert result.status == "ok"
    # in the tube for good from the first entry on, and the gain constant from then
    for k in range(2):
        captured = value(result, "capture_time")[k]
        assert value(result, "time_outside_tube")[k] == pytest.approx(captured, abs=1e-12)
        after = result["time"].values >= captured
        assert np.ptp(result["gain"].values[k, after]) < 1e-9
    # l_j = 2 + 0.3 sin(2 pi (t - j/3)), typed in again
    t, j = result["time"].values, np.array([[1], [2]])
    expected = 2 + 0.3 * np.sin(2 * np.pi * (t - j / 3))
    assert result["reference"].values == pytest.approx(expected, abs=1e-12)


def test_the_reference_is_shifted_ahead(tmp_path: Path):
    change = ["reference.shift=0.25", "tolerance.recheck=false"]
    result = wo.run(load_scene(write(tmp_path, TRACK), change))
    expected = fast_gait(1.0)(result["time"].values + 0.25)
    assert result["reference"].values == pytest.approx(expected, abs=1e-12)


# -- the tube ------------------------------------------------------------------------------------


@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_time_in_the_tube_against_a_fine_grid(tmp_path: Path, feedback: str):
    change = [f'tracker.feedback="{feedback}"', "tracker.growth=100", "time.end=6"]
    scene = load_scene(write(tmp_path, TRACK), [*change, "tolerance.recheck=false"])
    result = wo.run(scene)
    loop = build_loop(scene, 0, fast_gait(1.0), draw_links(scene.table.worm, 6.0))
    t = np.linspace(0, 6, 30_001)
    excess = simulate(loop, 6.0, times=t).output("error_norm")[0] - 0.2
    change = np.flatnonzero(np.diff(np.sign(excess)))
    zeros = t[change] - excess[change] * (t[change + 1] - t[change]) / np.diff(excess)[change]
    assert excess[0] < 0
    assert len(zeros) > 6
    ends = np.append(zeros, 6.0) if len(zeros) % 2 else zeros
    outside = (ends[1::2] - ends[::2]).sum()
    assert value(result, "time_outside_tube") == pytest.approx(outside, abs=1e-6)
    captured = None if len(zeros) % 2 else pytest.approx(zeros[-1], abs=1e-6)
    assert value(result, "capture_time") == captured
    crossings = result["event_time"].values[result["event_kind"].values == 4]
    assert crossings == pytest.approx(zeros, abs=1e-6)
    counted = result.trust["events"]
    assert counted["leaves the tube"] + counted["enters the tube"] == len(zeros)


def test_an_error_that_never_leaves_the_tube_is_captured_from_the_start(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, TRACK), ["tracker.tube_radius=5"]))
    assert (value(result, "capture_time"), value(result, "time_outside_tube")) == (0.0, 0.0)
    assert value(result, "k_end") == 1.0


FUNNELS = (
    'tracker=[{feedback="funnel", funnel={start=1, end=0.15, time=0.5}, '
    "rate_funnel={start=4, end=3, time=0.5}, gain=20, feedforward={}},"
    '{feedback="filter", tube_radius=0.1, growth=100, adaptation={law="exponent", exponent=2}},'
    '{feedback="derivative", tube_radius=0.1, name="mine", adaptation={law="decay", dwell=0.1,'
    " decay=1}, growth=100, feedforward={stiffness=8}}]"
)


def test_trackers_of_all_kinds_side_by_side(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, TRACK), [FUNNELS]))
    assert result.status == "ok", result.reason
    assert result.attributes["trackers"] == ["funnel controller", "tracker (14)", "mine"]
    funnel = result["funnel"].values
    t = result["time"].values
    assert funnel[0] == pytest.approx(0.15 + 0.85 * np.exp(-2 * t), abs=1e-12)
    assert np.isnan(funnel[1:]).all()
    assert np.all(result["error_norm"].values[0] < funnel[0])
    assert result["tube"].values[:, 0].tolist() == [0.15, 0.1, 0.1]
    assert value(result, "k_end")[0] > 20
    assert value(result, "filter_end")[0] is None
    gain = result["gain"].values[2]
    assert np.diff(gain).min() < 0  # the third gain decays after a while in the tube
    assert [each["route"] for each in result.trust["recheck"]] == ["python"] * 3


def test_a_start_outside_of_its_funnel_is_refused(tmp_path: Path):
    change = 'tracker={feedback="funnel", funnel={start=1, end=0.1, time=1}, rate_funnel='
    change += "{start=4, end=2, time=1}}"
    with pytest.raises(SceneError, match=r"tracker: the error starts at .* write wider funnels"):
        wo.run(load_scene(write(tmp_path, TRACK), [change, "start.position=[9, 2, 0]"]))


# -- chains with given inputs --------------------------------------------------------------------


def test_a_chain_at_rest_stays_at_rest(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, SIMULATE), ['want=["motion", "signals"]']))
    assert (value(result, "distance"), value(result, "n_events")) == (0.0, 0)
    assert result["position"].values[:, -1].tolist() == [4.0, 2.0, 0.0]
    assert sorted(result["rest_contact"].values.tolist()) == [0, 1, 2]
    assert result["rest_end"].values.tolist() == [2.0] * 3


def test_constant_inputs_stretch_the_links(tmp_path: Path):
    """Without friction, head and tail part about the middle: equal forces, l = l0 + u/c."""
    text = SIMULATE.replace("friction =", "# ")
    change = ['actuation={law="constant", force=3}', "time.end=80", "worm.damping=5"]
    result = wo.run(load_scene(write(tmp_path, text), change))
    assert result["length"].values[:, -1] == pytest.approx([2.3, 2.3], abs=1e-9)
    assert value(result, "input_rms") == pytest.approx(3 * np.sqrt(2), rel=1e-12)
    assert value(result, "input_peak") == 3.0
    assert value(result, "distance") == pytest.approx(0.0, abs=1e-9)


def test_a_harmonic_change_of_rest_length_drives_as_a_sine_gait_does(tmp_path: Path):
    path = write(tmp_path, SIMULATE)
    harmonic = 'actuation={law="harmonic", amplitude=0.6, period=2, lag=0.3}'
    sine = 'shape="sine", period=2, rest_length=2, amplitude=0.6, lag=0.3'
    results = [
        wo.run(load_scene(path, [change, "time.end=6"]))
        for change in (harmonic, f'actuation={{law="gait", gait={{{sine}}}}}')
    ]
    first, second = (value(result, "x_end") for result in results)
    assert first == pytest.approx(second, abs=1e-10)
    t, j = results[0]["time"].values, np.array([[1], [2]])
    assert results[0]["command"].values == pytest.approx(
        2 + 0.6 * np.sin(2 * np.pi * (t / 2 - 0.3 * j)), abs=1e-12
    )
    assert results[0]["input"].values == pytest.approx(10 * (results[0]["command"].values - 2))


@pytest.mark.parametrize(
    "friction",
    [
        '{kind="stribeck", forward=0.5, backward=2, stick_forward=1, stick_backward=4, '
        "v_stribeck=0.2}",
        '{kind="viscous", drag=0.5}',
        '{kind="coulomb", forward=[0.5, 1, 1.5], backward=[5, 6, 7]}',
        '[{kind="spike"}, {kind="coulomb", forward=1, backward=9}, {kind="viscous", drag=1}]',
    ],
)
@pytest.mark.parametrize("treatment", ["exact", "smooth"])
def test_all_laws_of_friction(tmp_path: Path, friction: str, treatment: str):
    change = [
        f"worm.friction={friction}",
        f'contact.treatment="{treatment}"',
        'actuation={law="harmonic", amplitude=0.8, period=2, lag=0.3}',
        "worm.random.damping={process='steps', spread=0.2, interval=0.3}",
        "worm.load=[0, 0.1, -0.1]",
    ]
    result = wo.run(load_scene(write(tmp_path, SIMULATE), change))
    assert result.status == "ok", result.reason
    assert abs(result.trust["energy_balance"]["residual"]) < 1e-9


def test_a_load_can_only_slow_the_worm_down(tmp_path: Path):
    path = write(tmp_path, SIMULATE)
    drive = 'actuation={law="harmonic", amplitude=0.8, period=2, lag=0.3}'
    distances = [
        value(wo.run(load_scene(path, [drive, f"worm.load={load}", "time.end=10"])), "distance")
        for load in (-0.3, 0.0, 0.3)
    ]
    assert distances == sorted(distances, reverse=True)


# -- models of one's own -------------------------------------------------------------------------


def test_a_model_of_ones_own_runs_with_its_parameters(tmp_path: Path):
    path = write(tmp_path, MODEL.replace("[time]", "[parameters]\nrate = 2.0\n[time]"))
    result = wo.run(path)
    assert value(result, "x_end") == pytest.approx(np.exp(-2.0), rel=1e-10)
    assert result["x"].dims == ("time",)
    assert result.attributes["signals"] == ["x"]
    assert "energy_balance" not in result.trust


def test_what_the_file_prints_does_not_reach_stdout(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    own = OWN.replace("def build", "print('loading')\ndef build")
    path = write(tmp_path, MODEL, own)
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "ok"
    assert "loading" in err


def test_the_magnetic_pair_as_a_model_of_ones_own(tmp_path: Path):
    """MAG2 of theory.md: 369 events, 5 sticking phases."""
    own = """
import casadi as ca
import numpy as np
from wormopt import Contact, Model, Signal
from wormopt.core.friction import Coulomb

def build(eps=0.036, delta=0.5):
    t, x, v, f = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    g = 1 + ca.cos((np.sqrt(2) + eps * delta) * t)
    ode = ca.vertcat(v, x[1] - x[0] - eps * g + f[0], x[0] - x[1] + eps * g + f[1])
    law = Coulomb(0.5 * eps, eps)
    contacts = [Contact(f"mass {i}", v[i], f[i], law) for i in range(2)]
    states = [Signal("x", x, "length", value=0.0), Signal("v", v, "speed", value=0.0)]
    return Model("pair", x=states, ode=ode, t=t, contacts=contacts)
"""
    path = write(tmp_path, MODEL.replace("end = 1.0", "end = 400.0"), own)
    change = ["tolerance.relative=1e-13", "tolerance.absolute=1e-14", "tolerance.recheck=false"]
    result = wo.run(load_scene(path, [*change, 'units="SI"']))
    assert result.scalars["x_end"].value == pytest.approx([68.6821179593, 69.108214664], abs=1e-9)
    assert result.scalars["v_end"].value == pytest.approx([-0.193705222, 0.7347495453], abs=1e-9)
    assert (result.scalars["x_end"].unit, result.scalars["v_end"].unit) == ("m", "m s-1")
    assert value(result, "n_events") == 369
    assert result.trust["events"]["stick"] == 5
    first = result["rest_contact"].values == 0
    assert result["rest_start"].values[first][-1] == pytest.approx(9.562752, abs=1e-6)


def test_names_that_meet_in_the_result_are_refused(tmp_path: Path):
    own = """
import casadi as ca
from wormopt import Model, Signal
def build():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return Model("two", x=[Signal("x", x), Signal("x_end", y)], ode=ca.vertcat(y, x))
"""
    with pytest.raises(SceneError, match="'x_end' is taken"):
        wo.run(write(tmp_path, MODEL, own))


# -- chance and ensembles ------------------------------------------------------------------------

CHANCE = (
    'worm.random={seed=3, stiffness={process="ornstein_uhlenbeck", deviation=3, '
    'correlation_time=0.5, step=0.1}, damping={process="steps", spread=2, interval=0.5}, '
    'rest_length={process="fixed", spread=[0.1, 0.3]}}'
)


def test_the_first_member_is_the_worm_without_an_ensemble(tmp_path: Path):
    path = write(tmp_path, TRACK)
    change = [CHANCE, "tolerance.recheck=false"]
    alone = wo.run(load_scene(path, change))
    herd = wo.run(load_scene(path, [*change, "ensemble.members=5", "time.samples=41"]))
    more = wo.run(load_scene(path, [*change, "ensemble.members=8", "time.samples=41"]))
    assert herd["member_distance"].values[0, 0] == pytest.approx(value(alone, "distance"), abs=1e-9)
    assert herd["member_k_end"].values == pytest.approx(more["member_k_end"].values[:, :5])
    other = wo.run(load_scene(path, [*change, "ensemble.members=5", "worm.random.seed=4"]))
    assert not np.any(other["member_k_end"].values == herd["member_k_end"].values)


def test_bands_are_quantiles_of_the_members(tmp_path: Path):
    path = write(tmp_path, TRACK)
    change = [CHANCE, "ensemble.members=7", "time.samples=11"]
    result = wo.run(load_scene(path, change))
    assert result.status == "ok", result.reason
    each = result["member_distance"].values[0]
    assert value(result, "distance") == np.median(each)
    assert value(result, "distance_quantiles") == np.quantile(each, [0.05, 0.25, 0.5, 0.75, 0.95]
                                                              ).tolist()  # fmt: skip
    band = result["position_band"]
    assert band.dims == ("tracker", "quantile", "mass", "time")
    assert np.all(np.diff(band.values, axis=1) >= 0)
    assert value(result, "members") == 7
    assert value(result, "recheck_error") < 1e-7


def test_random_links_as_packaged():
    result = wo.run(load_scene("random_links", ["ensemble.members=12", "tolerance.recheck=false"]))
    assert result.status == "ok"
    # the kinematic speed 4 e l0 / T = 1.2, within what chance makes of it
    assert value(result, "mean_speed") == pytest.approx(1.2, abs=0.2)
    assert value(result, "captured_share") == np.mean(
        ~np.isnan(result["member_capture_time"].values)
    )


def test_members_that_are_given_up_make_the_result_fail(tmp_path: Path):
    change = [CHANCE, "ensemble.members=3", "time.samples=11", "tolerance.max_steps=20"]
    with pytest.raises(SolveError, match=r"no member came to its end \(too_many_steps\)"):
        wo.run(load_scene(write(tmp_path, TRACK), change))


# -- what is not trusted -------------------------------------------------------------------------


def test_a_second_route_that_disagrees_makes_the_result_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def elsewhere(*given: Any, **options: Any) -> Any:
        motion = simulate(*given, **options)
        return dataclasses.replace(motion, end=motion.end + 1e-6)

    monkeypatch.setattr(proof, "simulate", elsewhere)
    result = wo.run(write(tmp_path, TRACK))
    assert result.status == "failed"
    assert "the second route (python) ends elsewhere" in result.reason
    assert value(result, "recheck_error") == pytest.approx(1e-6, rel=1)


@pytest.mark.parametrize("relative", [1e-4, 1e-6, 1e-8])
def test_loose_tolerances_are_judged_by_themselves(tmp_path: Path, relative: float):
    change = [f"tolerance.relative={relative}", f"tolerance.absolute={relative / 10}"]
    loose = wo.run(load_scene(write(tmp_path, TRACK), change))
    exact = wo.run(load_scene(write(tmp_path, TRACK), ["tolerance.recheck=false"]))
    assert loose.status == "ok", loose.reason
    accepted = loose.trust["recheck"]["accepted"]
    assert accepted == pytest.approx(min(1e3 * relative, 0.01))
    # what is accepted bounds the true error too
    assert value(loose, "x_end") == pytest.approx(value(exact, "x_end"), abs=4 * accepted)


def test_a_second_route_that_gives_up_makes_the_result_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def gives_up(*given: Any, **options: Any) -> Any:
        raise SolveError("too hard", code="stiff")

    monkeypatch.setattr(proof, "simulate", gives_up)
    result = wo.run(write(tmp_path, TRACK))
    assert result.status == "failed"
    assert "gave up: too hard; tolerance.recheck = false" in result.reason
    assert value(result, "recheck_error") is None
    result = wo.run(load_scene(write(tmp_path, TRACK), ["tolerance.recheck=false"]))
    assert result.status == "ok"
    assert any("not rechecked" in text for text in result.trust["warnings"])


def test_a_motion_that_is_given_up_is_kept_as_far_as_it_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = write(tmp_path, TRACK)
    out = tmp_path / "out"
    change = ["--set", "tolerance.max_steps=60", "--set", 'want=["trackers", "motion"]']
    assert main(["run", str(path), "-o", str(out), *change]) == 3
    assert "60 steps were spent" in capsys.readouterr().err
    loaded = Result.load(out)
    assert loaded.status == "failed"
    assert 1 < len(loaded["time"].values) < 2001
    assert {p.name for p in out.iterdir()} >= {"trackers.png", "motion.png", "result.nc"}
    with pytest.raises(SolveError) as caught:
        wo.run(load_scene(write(tmp_path, SIMULATE), ["tolerance.max_steps=1", "worm.load=5"]))
    assert caught.value.code == "too_many_steps"
    assert caught.value.partial.status == "failed"


def test_stiction_that_the_smooth_law_does_not_know_is_named():
    laws = [Coulomb(1.0, 3.0, 2.0, 6.0), Coulomb(1.0, 1.0)]
    said = list(warnings_of_contact(Smooth(), laws))
    assert len(said) == 2
    assert "+1" in said[0]
    assert "no stiction" in said[1]


def test_a_machine_without_a_compiler_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from wormopt.simulation.native import build, kernel

    def none() -> None:
        return None

    monkeypatch.setattr(build, "compiler", none)
    monkeypatch.setattr(kernel, "library", missing)
    kernel._driver.cache_clear()
    try:
        for text in (TRACK, SIMULATE + '[contact]\ntreatment = "smooth"\n'):
            result = wo.run(load_scene(write(tmp_path, text), ["time.end=0.5"]))
            assert result.status == "ok", result.reason
            assert result.trust["route"] in ("python", "cvodes")
            assert any("no C compiler" in said for said in result.trust["warnings"])
    finally:
        kernel._driver.cache_clear()


def missing(*_: Any) -> None:
    from wormopt.simulation.native.build import CompilerError

    raise CompilerError("none")


def test_a_motion_too_long_to_keep_is_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    whole = wo.run(write(tmp_path, TRACK))
    monkeypatch.setattr(signals, "_MEMORY", 64 * 100.0)
    result = wo.run(write(tmp_path, TRACK))
    assert any("not kept whole" in text for text in result.trust["warnings"])
    assert value(result, "x_end") == pytest.approx(value(whole, "x_end"), abs=1e-12)
    assert 0.9 < value(result, "input_peak") / value(whole, "input_peak") <= 1


# -- the command line and the files --------------------------------------------------------------


def test_pictures_are_drawn_and_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write(tmp_path, TRACK)
    out = tmp_path / "out"
    arguments = ["run", str(path), "-o", str(out), "--set", 'want=["trackers", "motion"]']
    arguments += ["--set", "time.end=0.5"]
    assert main([*arguments, "--no-plots"]) == 0
    assert {p.name for p in out.iterdir()} == {"result.nc", "summary.json"}
    assert main(arguments) == 0
    assert {p.name for p in out.iterdir()} >= {"trackers.png", "motion.png"}
    assert "x_end" in capsys.readouterr().out


def test_results_are_saved_and_loaded(tmp_path: Path, fig05: Result):
    fig05.save(tmp_path)
    loaded = Result.load(tmp_path)
    assert value(loaded, "x_end") == value(fig05, "x_end")
    assert loaded["gain"].values.tolist() == fig05["gain"].values.tolist()
    assert loaded.trust == fig05.trust
    assert wo.load_gait(tmp_path).period == 1.0


def test_a_designed_gait_is_tracked_from_its_result(tmp_path: Path):
    change = ["tolerance.recheck=false", "time.end=0.5"]
    wo.run("fast_gait").save(tmp_path)
    text = TRACK.replace('shape = "fast"\nperiod = 1.0', 'shape = "file"\nfile = "result.nc"')
    result = wo.run(load_scene(write(tmp_path, text), change))
    same = wo.run(load_scene(write(tmp_path, TRACK), change))
    assert value(result, "x_end") == pytest.approx(value(same, "x_end"), abs=1e-12)
    path = write(tmp_path, text.replace("links = 2", "links = 3").replace("[4.0, ", "[6.0, 4.0, "))
    with pytest.raises(SceneError, match=r"the file has 2 links; set worm\.links = 2"):
        wo.run(path)


def test_units_of_si_scenes(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, TRACK), ['units="SI"', "time.end=0.5"]))
    units = {name: result.scalars[name].unit for name in ("x_end", "v_end", "k_end", "input_rms")}
    assert units == {"x_end": "m", "v_end": "m s-1", "k_end": "1", "input_rms": "N"}
    assert result["energy"].unit == "J"


@pytest.mark.parametrize(
    "name", [n for n in packaged_scenes() if load_scene(n).table.kind in ("track", "simulate")]
)
def test_packaged_scenes_say_what_to_try(name: str):
    text = packaged_scenes()[name].read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert "wormopt run" in text
    for line in text.splitlines():
        if "--set" in line and line.startswith("#") and not line.rstrip().endswith("\\"):
            words = [w.strip("'") for w in line.split("--set ")[1:]]
            sets = [word.split("   ")[0].split(" (")[0].strip().strip("'") for word in words]
            load_scene(name, sets)


# What a scene may hold anywhere, the worst included.
VALUES = st.recursive(
    st.sampled_from('nan inf -inf true "" "λ" "fast" 1e308 1e-308 -0.0 0 1 -1 2.5 [] {}'.split()),
    lambda inner: st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=6,
)
KEYS = st.sampled_from(
    "worm worm.links worm.mass worm.stiffness worm.friction worm.friction.kind worm.random "
    "worm.friction.forward worm.random.seed worm.random.stiffness start start.position reference "
    "reference.gait reference.gait.shape reference.shift tracker tracker.feedback tracker.growth "
    "tracker.adaptation tracker.feedforward tracker.tube_radius contact contact.treatment "
    "contact.v_reg time time.end time.samples tolerance tolerance.relative ensemble want "
    "ensemble.members actuation actuation.law model parameters parameters.rate".split()
)


@settings(deadline=None, max_examples=300)
@given(
    text=st.sampled_from([TRACK, RANDOM, SIMULATE, MODEL]),
    changes=st.lists(st.tuples(KEYS, VALUES), max_size=3),
)
def test_any_scene_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, changes: list[tuple[str, str]]
):
    path = write(tmp_path_factory.mktemp("scene"), text)
    try:
        scene = load_scene(path, [f"{key}={value}" for key, value in changes])
    except SceneError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{path}: ")
    else:
        assert "NaN" not in scene.text
        assert "Infinity" not in scene.text


# -- the documentation ---------------------------------------------------------------------------

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_on_simulation_runs(capsys: pytest.CaptureFixture[str]):
    text = (DOCS / "simulation.md").read_text(encoding="utf-8")
    program = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    scope: dict[str, Any] = {"__name__": "page"}
    exec(compile(program, "simulation.md", "exec"), scope)
    printed = capsys.readouterr().out
    assert "(20, 7, 101) {''}" in printed
    assert "too_many_steps" in printed
    assert np.abs(scope["exact"].end - scope["smooth"].end).max() < 1e-3
    # the model on the page is the one that comes with the package
    own = packaged_scenes()["own_model"].with_name("my_worm.py").read_text(encoding="utf-8")
    assert own.partition("def build(")[2].strip() in program


def test_every_key_of_the_scenes_is_documented():
    text = (DOCS / "scenes.md").read_text(encoding="utf-8")
    tables = [TrackScene, SimulateScene]
    seen = set()
    while tables:
        table = tables.pop()
        for item in msgspec.structs.fields(table):
            assert f"`{item.name}`" in text or f"[{item.name}]" in text, f"{table}: {item.name}"
            for kind in kinds_in(item.type):
                if kind not in seen:
                    seen.add(kind)
                    tables.append(kind)


def kinds_in(kind: Any) -> list[Any]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return [kind]
    return [found for part in get_args(kind) for found in kinds_in(part)]


def test_every_scalar_and_variable_is_documented(fig05: Result, tmp_path: Path):
    text = (DOCS / "scenes.md").read_text(encoding="utf-8")
    change = [CHANCE, "ensemble.members=3", "time.samples=11", "time.end=0.5"]
    herd = wo.run(load_scene(write(tmp_path, TRACK), change))
    for result in (fig05, herd, wo.run("stiction")):
        names = {*result.scalars, *(v.name for v in result.variables), *result.trust}
        for name in names:
            assert f"`{name}`" in text, name
