"""Scenes of the kinds "track" and "simulate": trust reports, saved files, documentation."""

import dataclasses
import json
import re
import signal
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hints import Capture, Patch
from outcomes import failed_checks, value
from places import DOCS

import wormopt as wo
from tests.oracles.by_text import CHANCE, SIMULATE, TRACK, write
from wormopt.cli import main
from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import NOT_RECHECKED, Result
from wormopt.simulation.options import Route, Smooth
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene, packaged_scenes
from wormopt.systems.shared import proof, signals
from wormopt.systems.shared.proof import warnings_of_contact


@pytest.mark.compiled
def test_a_second_route_that_disagrees_makes_the_result_fail(tmp_path: Path, monkeypatch: Patch):
    def elsewhere(*given: Any, **options: Any) -> Any:
        motion = simulate(*given, **options)
        return dataclasses.replace(motion, end=motion.end + 1e-6)

    monkeypatch.setattr(proof, "simulate", elsewhere)
    result = wo.run(write(tmp_path, TRACK))
    assert result.status == "failed"
    assert "the second route (python) ends in other states" in result.reason
    assert failed_checks(result) == ["second route"]
    assert value(result, "recheck_error") == pytest.approx(1e-6, rel=1)


@pytest.mark.parametrize("relative", [1e-4, pytest.param(1e-6, marks=pytest.mark.slow), 1e-8])
def test_loose_tolerances_are_judged_by_themselves(tmp_path: Path, relative: float):
    change = [f"tolerance.relative={relative}", f"tolerance.absolute={relative / 10}"]
    loose = wo.run(load_scene(write(tmp_path, TRACK), change))
    exact = wo.run(load_scene(write(tmp_path, TRACK), ["tolerance.recheck=false"]))
    assert loose.status == "ok", loose.reason
    accepted = loose.trust["recheck"]["accepted"]
    assert accepted == pytest.approx(min(1e3 * relative, 0.01))
    # what is accepted bounds the true error too
    assert value(loose, "x_end") == pytest.approx(value(exact, "x_end"), abs=4 * accepted)


def test_a_second_route_that_gives_up_makes_the_result_fail(tmp_path: Path, monkeypatch: Patch):
    def gives_up(*given: Any, **options: Any) -> Any:
        raise SolveError("too hard", code="stiff")

    monkeypatch.setattr(proof, "simulate", gives_up)
    result = wo.run(write(tmp_path, TRACK))
    assert result.status == "failed"
    assert "failed: too hard; set tolerance.recheck = false" in result.reason
    (failed,) = [check for check in result.checks if not check.passed]
    assert (failed.name, failed.value) == ("second route", None)
    assert value(result, "recheck_error") is None
    result = wo.run(load_scene(write(tmp_path, TRACK), ["tolerance.recheck=false"]))
    assert (result.status, result.reason) == ("unchecked", NOT_RECHECKED)
    assert NOT_RECHECKED in result.trust["warnings"]


@pytest.mark.parametrize("unseen", [False, True])
def test_a_long_swing_is_compared_over_its_first_steps(
    unseen: bool, tmp_path: Path, monkeypatch: Patch
):
    """By CVODES, and by steps in Python where that passes a layer unseen."""
    monkeypatch.setattr(proof, "_LONG", 30)
    routes: list[Route] = []

    def followed(*given: Any, route: Route, **options: Any) -> Any:
        routes.append(route)
        if unseen and route == "cvodes":
            raise SolveError("velocities pass unseen", code="layer_not_resolved")
        return simulate(*given, route=route, **options)

    monkeypatch.setattr(proof, "simulate", followed)
    smooth = ['contact={treatment="smooth", v_reg=0.1}', "want=[]"]
    result = wo.run(load_scene(write(tmp_path, TRACK), smooth))
    assert result.status == "ok"
    second = result.trust["recheck"]
    assert second["route"] == ("python" if unseen else "cvodes")
    assert routes == ["auto", "cvodes", *(["python"] if unseen else [])]
    assert 0 < second["until"] < 2
    assert second["error"] < 1e-7
    assert any("was compared at t = " in text for text in result.trust["warnings"])


def test_a_check_that_would_take_for_ever_ends_where_it_is_and_still_sees_what_is_wrong(
    tmp_path: Path, monkeypatch: Patch
):
    monkeypatch.setattr(proof, "_STIFF", 20)
    monkeypatch.setattr(proof, "_SPENT_IN_PYTHON", 500)
    monkeypatch.setattr(proof, "_IMPLICIT", 50)
    scene = load_scene(write(tmp_path, TRACK), ["want=[]"])
    result = wo.run(scene)
    assert result.status == "ok"
    second = result.trust["recheck"]
    assert second["route"] == "radau"
    assert 0 < second["until"] < 2
    assert second["error"] < 1e-7
    assert any("was compared at t = " in text for text in result.trust["warnings"])

    def heavier(model: Model, *given: Any, route: Route, **options: Any) -> Any:
        wrong = replace(model, ode=1.001 * model.ode) if route == "radau" else model
        return simulate(wrong, *given, route=route, **options)

    monkeypatch.setattr(proof, "simulate", heavier)
    wrong = wo.run(load_scene(scene))
    assert "ends in other states" in wrong.reason, wrong.trust


@pytest.mark.slow
def test_a_stiff_motion_is_rechecked_to_its_end_by_implicit_steps(tmp_path: Path):
    drive = 'actuation={law="harmonic", amplitude=0.8, period=2, lag=0.3}'
    change = ["worm.damping=1e6", drive, "time.end=0.5"]
    result = wo.run(load_scene(write(tmp_path, SIMULATE), change))
    assert result.status == "ok"
    assert result.trust["recheck"]["route"] == "radau"
    assert "until" not in result.trust["recheck"]


def test_a_motion_that_is_given_up_is_kept_as_far_as_it_came(tmp_path: Path, capsys: Capture):
    path = write(tmp_path, TRACK)
    out = tmp_path / "out"
    change = ["--set", "tolerance.max_steps=60", "--set", 'want=["trackers", "motion"]']
    assert main(["run", str(path), "-o", str(out), *change]) == 3
    assert "the limit of 60 steps was reached" in capsys.readouterr().err
    loaded = Result.load(out)
    assert loaded.status == "failed"
    assert 1 < len(loaded["time"].values) < 2001
    assert {p.name for p in out.iterdir()} >= {"trackers.png", "motion.png", "result.nc"}
    with pytest.raises(SolveError) as caught:
        wo.run(load_scene(write(tmp_path, SIMULATE), ["tolerance.max_steps=1", "worm.load=5"]))
    assert caught.value.code == "too_many_steps"
    assert caught.value.partial.status == "failed"


def stop_at(text: str, call: int = 1) -> Report:
    """Interrupt when so much is reported of what begins with a text."""
    heard: list[str] = []

    def report(what: str, fraction: float | None) -> None:
        heard.extend([what] * what.startswith(text))
        if len(heard) >= call:
            raise KeyboardInterrupt

    return report


@pytest.mark.compiled
@pytest.mark.parametrize("text", [TRACK, SIMULATE])
def test_a_motion_that_is_interrupted_is_kept_as_far_as_it_came(
    tmp_path: Path, monkeypatch: Patch, text: str
):
    from wormopt.simulation.native import kernel

    monkeypatch.setattr(kernel, "_WORK_PER_CALL", 1)
    drive = ["worm.load=[0.5, -0.5, 0.2]", "time.end=20"]
    scene = load_scene(write(tmp_path, text), drive)
    whole = wo.run(load_scene(write(tmp_path, text), [*drive, "tolerance.recheck=false"]))
    with pytest.raises(Interrupted) as caught:
        wo.run(scene, report=stop_at("simulating", 3))
    partial = caught.value.partial
    assert partial.status == "failed"
    assert "interrupted during motion" in partial.reason
    reached = len(partial["time"].values)
    assert 1 < reached < len(whole["time"].values)
    kept = partial["position"].values
    assert kept == pytest.approx(whole["position"].values[..., :reached], abs=1e-12)
    with pytest.raises(Interrupted) as caught:
        wo.run(scene, report=stop_at("rechecking"))
    assert "interrupted during recheck" in caught.value.partial.reason
    assert caught.value.partial["time"].values.tolist() == whole["time"].values.tolist()


def test_trackers_that_are_done_are_kept_when_interrupted():
    scene = load_scene("fig05_lambda_trackers", ["tolerance.recheck=false"])
    with pytest.raises(Interrupted) as caught:
        wo.run(scene, report=stop_at("simulating tracker (13)"))
    partial = caught.value.partial
    assert partial.reason == "interrupted during motions"
    assert partial.attributes["trackers"] == ["tracker (14)"]
    assert partial["time"].values[-1] == 10.0


def test_members_that_are_done_are_kept_when_interrupted(tmp_path: Path):
    change = [CHANCE, "ensemble.members=12", "time.samples=11"]
    scene = load_scene(write(tmp_path, TRACK), change)
    with pytest.raises(Interrupted) as caught:
        wo.run(scene, report=stop_at("simulating members", 4))
    partial = caught.value.partial
    done = np.isfinite(partial["member_distance"].values[0]).sum()
    assert 4 <= done <= 12
    assert partial.reason == "interrupted during motions"
    with pytest.raises(Interrupted) as caught:
        wo.run(scene, report=stop_at("rechecking"))
    assert np.isfinite(caught.value.partial["member_distance"].values).all()


def test_ctrl_c_while_the_second_route_runs_is_heard(tmp_path: Path):
    """CasADi takes the signal for a failure of the integrator."""
    drive = 'actuation={law="harmonic", amplitude=0.8, period=2, lag=0.3}'
    change = [drive, 'contact.treatment="smooth"', "time.end=500"]
    scene = load_scene(write(tmp_path, SIMULATE), change)

    def press(text: str, fraction: float | None) -> None:
        if text == "rechecking" and not pressed:
            pressed.append(threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]))
            pressed[0].start()

    pressed: list[threading.Timer] = []
    with pytest.raises(Interrupted, match="interrupted") as caught:
        wo.run(scene, report=press)
    assert "interrupted during recheck" in caught.value.partial.reason


@pytest.mark.compiled
def test_the_command_line_saves_what_was_interrupted(
    tmp_path: Path, capsys: Capture, monkeypatch: Patch
):
    def stop(*given: Any, report: Report, **options: Any) -> Any:
        return simulate(*given, report=stop_at("simulating"), **options)

    monkeypatch.setattr(signals, "simulate", stop)
    out = tmp_path / "out"
    assert main(["run", str(write(tmp_path, SIMULATE)), "-o", str(out), "--json"]) == 130
    printed, said = capsys.readouterr()
    assert json.loads(printed)["reason"] == "interrupted"
    assert "interrupted" in said
    assert Result.load(out).status == "failed"


def test_stiction_that_the_smooth_law_does_not_know_is_named():
    laws = [Coulomb(1.0, 3.0, 2.0, 6.0), Coulomb(1.0, 1.0)]
    said = list(warnings_of_contact(Smooth(), laws))
    assert len(said) == 2
    assert "+1" in said[0]
    assert "no stiction" in said[1]


def test_a_machine_without_a_compiler_says_so(tmp_path: Path, monkeypatch: Patch):
    from wormopt.simulation.native import build, kernel

    def missing(*_: Any) -> None:
        raise build.CompilerError("none")

    monkeypatch.setattr(build, "compiler", lambda: None)
    monkeypatch.setattr(kernel, "library", missing)
    kernel.driver.cache_clear()
    try:
        for text in (TRACK, SIMULATE + '[contact]\ntreatment = "smooth"\n'):
            result = wo.run(load_scene(write(tmp_path, text), ["time.end=0.5"]))
            assert result.status == "ok", result.reason
            assert result.trust["route"] in ("python", "cvodes")
            assert any("no C compiler" in said for said in result.trust["warnings"])
    finally:
        kernel.driver.cache_clear()


def test_a_motion_too_long_to_keep_is_sampled(tmp_path: Path, monkeypatch: Patch):
    whole = wo.run(write(tmp_path, TRACK))
    monkeypatch.setattr(signals, "_MEMORY", 64 * 100.0)
    result = wo.run(write(tmp_path, TRACK))
    assert any("too long to keep" in text for text in result.trust["warnings"])
    assert value(result, "x_end") == pytest.approx(value(whole, "x_end"), abs=1e-12)
    assert 0.9 < value(result, "input_peak") / value(whole, "input_peak") <= 1


def test_pictures_are_drawn_and_left_out(tmp_path: Path, capsys: Capture):
    path = write(tmp_path, TRACK)
    out = tmp_path / "out"
    arguments = ["run", str(path), "-o", str(out), "--set", 'want=["motion"]']
    arguments += ["--set", "time.end=0.5"]
    assert main([*arguments, "--no-plots"]) == 0
    assert {p.name for p in out.iterdir()} == {"result.nc", "summary.json"}
    assert main(arguments) == 0
    assert {p.name for p in out.iterdir()} >= {"motion.png"}
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
    with pytest.raises(SceneError, match=r"the file has 2 links, the worm 3; set worm\.links = 2"):
        wo.run(path)


def test_units_of_si_scenes(tmp_path: Path):
    result = wo.run(load_scene(write(tmp_path, TRACK), ['units="SI"', "time.end=0.5"]))
    units = {name: result.scalars[name].unit for name in ("x_end", "v_end", "k_end", "input_rms")}
    assert units == {"x_end": "m", "v_end": "m s-1", "k_end": "1", "input_rms": "N"}
    assert result["energy"].unit == "J"


@pytest.mark.parametrize("name", packaged_scenes())
def test_packaged_scenes_say_what_to_try(name: str):
    text = packaged_scenes()[name].read_text(encoding="utf-8")
    assert text.startswith("# ")
    for line in text.splitlines():
        if "--set" in line and line.startswith("#") and not line.rstrip().endswith("\\"):
            words = [w.strip("'") for w in line.split("--set ")[1:]]
            sets = [word.split("   ")[0].split(" (")[0].strip().strip("'") for word in words]
            load_scene(name, sets)


def test_the_page_on_simulation_runs(capsys: Capture):
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
