"""Scenes of the kinds "track" and "simulate": what they find."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outcomes import value
from worms import TRACKED

import wormopt as wo
from tests.oracles.by_hand import Chain, commanded, thirds, tracked
from tests.oracles.by_text import CHANCE, MODEL, OWN, SIMULATE, TRACK, write
from wormopt.cli import main
from wormopt.errors import SceneError, SolveError
from wormopt.result import Result
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study import load_scene
from wormopt.systems.chain import measured, track
from wormopt.systems.chain.loops import draw_links
from wormopt.systems.shared import proof
from wormopt.systems.spiked.construct import fast_gait

# -- the chapter's benchmark ---------------------------------------------------------------------


def test_both_trackers_end_where_the_theory_says(fig05: Result):
    assert fig05.status == "ok"
    for row, known in enumerate(TRACKED.values()):
        for name, part in (("x_end", slice(3)), ("v_end", slice(3, 6)), ("k_end", 6)):
            assert value(fig05, name)[row] == pytest.approx(known[part], abs=1e-9)
    assert value(fig05, "filter_end")[0] == pytest.approx(TRACKED["filter"][7:], abs=1e-9)
    assert value(fig05, "filter_end")[1] is None
    assert value(fig05, "time_outside_tube") == [10.0, 10.0]
    assert value(fig05, "capture_time") == [None, None]
    assert value(fig05, "n_events") == [0, 0]
    assert max(value(fig05, "recheck_error")) < 1e-8


@pytest.mark.compiled
def test_the_trust_report_says_how_it_was_found(fig05: Result):
    trust = fig05.trust
    assert trust["treatment"] == "smooth, v_reg = 0.025"
    assert trust["route"] == ["native", "native"]
    assert [each["route"] for each in trust["recheck"]] == ["cvodes", "cvodes"]
    assert all(abs(each["residual"]) < 1e-10 for each in trust["energy_balance"])
    # the smooth law at rest: -(5.5 tanh(0) - 4.5), and the speed artanh(9/11)/40
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
        loop = scene.table.loop(k, draw_links(scene.table.worm, 10.0))
        whole = simulate(loop, 10.0, contact=Smooth(), dense=True)
        assert whole.dense is not None
        ends = whole.dense.time
        nodes, weights = np.polynomial.legendre.leggauss(4)
        t = (ends[:-1, None] + np.diff(ends)[:, None] * (nodes + 1) / 2).ravel()
        square = (whole.at(t)["input"] ** 2).sum(axis=0).reshape(-1, 4) @ weights / 2
        rms = np.sqrt(square @ np.diff(ends) / 10)
        assert value(fig05, "input_rms")[k] == pytest.approx(rms, rel=1e-9)
        peak = np.abs(whole.at(np.linspace(0, 0.5, 5001))["input"]).max()
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["stiction", "spiked_chain", "keep_spikes", "track_meaningful_start"]
)
def test_packaged_scenes_end_where_a_chain_by_hand_does(name: str):
    column = 1 if name == "track_meaningful_start" else None
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


@pytest.mark.slow
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
    result = wo.run(load_scene("track_sine", ["tolerance.recheck=false"]))
    assert result.status == "unchecked"
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
    loop = scene.table.loop(0, draw_links(scene.table.worm, 6.0))
    t = np.linspace(0, 6, 30_001)
    excess = simulate(loop, 6.0, times=t)["error_norm"][0] - 0.2
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


@pytest.mark.slow
def test_trackers_of_all_kinds_side_by_side(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, TRACK), [FUNNELS]))
    assert result.status == "ok", result.reason
    assert result.attributes["trackers"] == ["funnel controller", "tracker (14)", "mine"]
    funnel = result["funnel"].values
    t = result["time"].values
    assert funnel[0] == pytest.approx(0.15 + 0.85 * np.exp(-2 * t), abs=1e-12)
    assert np.isnan(funnel[1:]).all()
    assert np.all(result["error_norm"].values[0] < funnel[0])
    assert result["tube"].values[:, 0] == pytest.approx([0.15, 0.1, 0.1], rel=1e-12)
    assert value(result, "k_end")[0] > 20
    assert value(result, "filter_end")[0] is None
    gain = result["gain"].values[2]
    assert np.diff(gain).min() < 0  # the third gain decays after a while in the tube
    assert [each["route"] for each in result.trust["recheck"]] == ["python"] * 3


def test_energies_that_do_not_balance_and_errors_out_of_their_funnel_make_the_result_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    honest = measured.chain_checks

    def unbalanced(second: Any, energies: measured.Balance, *given: Any) -> Any:
        return honest(second, dataclasses.replace(energies, residual=0.1), *given)

    monkeypatch.setattr(Trajectory, "largest", lambda *_: 1.5)
    monkeypatch.setattr(track, "chain_checks", unbalanced)
    change = [FUNNELS, "time.end=0.2", "tolerance.recheck=false"]
    result = wo.run(load_scene(write(tmp_path, TRACK), change))
    assert result.status == "failed"
    who = "funnel controller"
    assert f"{who}: energies do not balance, by 0.1 of their size; {who}: error_norm leaves" in (
        result.reason
    )
    assert [check.name for check in result.checks if not check.passed] == [
        f"{who}: energy balance",
        f"{who}: error_norm in its funnel",
        f"{who}: rate_error_norm in its rate_funnel",
        "tracker (14): energy balance",
        "mine: energy balance",
    ]


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
@pytest.mark.parametrize("treatment", ["exact", pytest.param("smooth", marks=pytest.mark.slow)])
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


# -- models of one's own -------------------------------------------------------------------------


def test_a_model_of_ones_own_runs_with_its_parameters(tmp_path: Path):
    path = write(tmp_path, MODEL.replace("[time]", "[model.parameters]\nrate = 2.0\n[time]"))
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


def test_names_that_meet_in_the_result_are_refused(tmp_path: Path):
    own = """
import casadi as ca
from wormopt import Model, Signal
def build():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return Model("two", x=[Signal("x", x), Signal("x_end", y)], ode=ca.vertcat(y, x))
"""
    with pytest.raises(SceneError, match="'x_end' is already used"):
        wo.run(write(tmp_path, MODEL, own))


# -- chance and ensembles ------------------------------------------------------------------------


def test_the_first_member_is_the_worm_without_an_ensemble(tmp_path: Path):
    path = write(tmp_path, TRACK)
    change = [CHANCE, "tolerance.recheck=false"]
    alone = wo.run(load_scene(path, change))
    herd = wo.run(load_scene(path, [*change, "ensemble.members=3", "time.samples=41"]))
    more = wo.run(load_scene(path, [*change, "ensemble.members=4", "time.samples=41"]))
    assert herd["member_distance"].values[0, 0] == pytest.approx(value(alone, "distance"), abs=1e-9)
    assert herd["member_k_end"].values == pytest.approx(more["member_k_end"].values[:, :3])
    other = wo.run(load_scene(path, [*change, "ensemble.members=3", "worm.random.seed=4"]))
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
    assert result.status == "unchecked"
    # the kinematic speed 4 e l0 / T = 1.2, within what chance makes of it
    assert value(result, "mean_speed") == pytest.approx(1.2, abs=0.2)
    assert value(result, "captured_share") == np.mean(
        ~np.isnan(result["member_capture_time"].values)
    )


def test_members_that_are_given_up_make_the_result_fail(tmp_path: Path):
    change = [CHANCE, "ensemble.members=3", "time.samples=11", "tolerance.max_steps=20"]
    with pytest.raises(SolveError, match=r"no member was completed \(too_many_steps\)"):
        wo.run(load_scene(write(tmp_path, TRACK), change))
    change += ["ensemble.members=40", "tolerance.max_steps=200", "time.end=100"]
    told = r"none of the first 3 members was completed \(too_many_steps\)"
    with pytest.raises(SolveError, match=told):
        wo.run(load_scene(write(tmp_path, TRACK), change))


# -- the second route ------------------------------------------------------------------------------


@pytest.mark.parametrize(("rough", "tolerances"), [(1e-2, [1e-9]), (1e4, [1e-3, 1e-11])])
def test_implicit_steps_are_repeated_where_they_are_too_rough(
    monkeypatch: pytest.MonkeyPatch, rough: float, tolerances: list[float]
):
    taken = []

    def observed(*args: Any, **how: Any) -> Trajectory:
        taken.append(how["tolerance"].relative)
        return simulate(*args, **how)

    monkeypatch.setattr(proof, "simulate", observed)
    monkeypatch.setattr(proof, "_STIFF", 10)
    monkeypatch.setattr(proof, "_ROUGH", rough)
    result = wo.run(load_scene("keep_spikes", ["time.end=0.4"]))
    second = result.trust["recheck"]
    assert (result.status, second["route"], "until" in second) == ("ok", "radau", False)
    assert second["error"] < 1e-7
    assert taken == pytest.approx(tolerances)
