"""Certificates in scenes: what a result says, what is refused, what file is written."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from g1_worm import G1
from outcomes import told_by_a_run, value

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import Interrupted, SceneError
from wormopt.progress import silent
from wormopt.systems.spiked import gait_design
from wormopt.systems.spiked.certify.program import Program
from wormopt.systems.spiked.design.optimize import designed

OWN = [
    "search.sequence=[[0],[1],[2]]", 'search.effort="quick"', "search.workers=1",
    "search.certify.gap=2e-2",
]  # fmt: skip


def run(*changes: str):
    return wo.run(wo.load_scene("certified_gait", [*OWN, *changes]))


@cache
def designed_once(task, settings):
    return designed(task, settings, silent)


@pytest.fixture(autouse=True)
def one_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is designed does not depend on the certificate: once is enough."""

    def again(task, settings, report):
        return designed_once(task, settings)

    monkeypatch.setattr(gait_design, "designed", again)


def test_the_packaged_scene_is_certified(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    changes = [*OWN, 'want=["certificate"]']
    code, told = told_by_a_run(capsys, "certified_gait", tmp_path / "o", *changes, plots=True)
    scalars = {name: entry["value"] for name, entry in told["scalars"].items()}
    assert code == 0
    assert G1 <= scalars["bound"] <= G1 * 1.02
    assert scalars["gap_certified"] == pytest.approx(scalars["bound"] / G1 - 1, abs=1e-9)
    assert told["trust"]["certificate"]["ended"] == "gap reached"
    assert told["trust"]["certificate"]["verified_inequalities"] > 1000
    assert (tmp_path / "o" / "certificate.png").is_file()
    file = tmp_path / "o" / "certificate.json"
    assert main(["verify", str(file)]) == 0
    assert float(wo.verify(file).bound) == pytest.approx(scalars["bound"], rel=1e-12)


def test_the_course_of_a_bound():
    result = run()
    bound = result["proof_bound"].values
    assert np.all(np.diff(bound) < 0)
    assert bound[0] == pytest.approx(1.0, abs=1e-5)  # the ceiling
    assert bound[1] == pytest.approx(0.9, rel=1e-6)  # mean rates: strokes of 0.45 in half of 1
    assert bound[-1] == value(result, "bound")
    assert np.all(np.diff(result["proof_time"].values) >= 0)
    assert value(result, "certified_seconds") >= result["proof_time"].values[-1]
    assert "every gait with any resting sequence" in result.trust["certificate"]["holds_for"]


def test_a_range_of_periods_is_certified():
    result = run("gait.period=[0.5, 20.0]", "search.sequence=[[0],[2],[1]]")
    assert result.status == "ok", result.reason
    assert value(result, "speed") <= value(result, "bound") <= 0.869449 * 1.02


def test_an_interrupted_proof_leaves_the_gait_and_its_bound(monkeypatch):
    solve, calls = Program.solve, []

    def stopped(*given):
        calls.append(given)
        if len(calls) > 1:
            raise KeyboardInterrupt
        return solve(*given)

    monkeypatch.setattr(Program, "solve", stopped)
    with pytest.raises(Interrupted) as told:
        run("search.certify.gap=1e-3")
    partial = told.value.partial
    assert partial.status == "failed"
    assert "its bound is not tight" in partial.reason
    assert value(partial, "speed") == pytest.approx(G1, abs=1e-9)
    assert G1 < value(partial, "bound") < 0.9


@pytest.mark.parametrize(
    "objective",
    [
        '{maximise="speed"}',
        pytest.param('{minimise="peak_spike_load", speed=0.5}', marks=pytest.mark.slow),
    ],
)
def test_a_proof_without_time_still_gives_a_result_with_its_picture(
    objective: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    changes = [*OWN, f"objective={objective}", "search.certify.time_limit=1e-9"]
    changes += ['want=["certificate"]']
    code, told = told_by_a_run(capsys, "certified_gait", tmp_path / "o", *changes, plots=True)
    assert code == 0
    assert told["trust"]["certificate"]["ended"] == "time limit"
    assert "increase search.certify.time_limit" in " ".join(told["trust"]["warnings"])
    assert (tmp_path / "o" / "certificate.png").is_file()


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        ("bounded", {"bound": 0.9 * G1}, "better than its proven bound"),
        (
            "verify",
            {"holds": False, "reason": "a gap"},
            "verification of the certificate failed: a gap",
        ),
    ],
)
def test_a_wrong_certificate_is_a_failure(monkeypatch, name: str, wrong: Any, said: str):
    from dataclasses import replace

    true = getattr(gait_design, name)
    monkeypatch.setattr(gait_design, name, lambda *given: replace(true(*given), **wrong))
    result = run()
    assert result.status == "failed"
    assert said in result.reason
    assert len([check for check in result.checks if not check.passed]) == 1


def test_python_proves_what_a_scene_proves():
    scene = wo.load_scene("certified_gait", OWN)
    task = scene.table.task(scene.table.objective)
    found = designed_once(task, scene.table.search)
    told = wo.certify(found, gap=2e-2)
    result = wo.run(scene)
    assert told.bound == pytest.approx(value(result, "bound"), rel=1e-9)
    assert told.gap == pytest.approx(value(result, "gap_certified"), rel=1e-7)
    assert told.certificate is not None
    assert wo.verify(told.certificate).holds


def test_proofs_that_cannot_be_had_are_refused():
    with pytest.raises(SceneError, match="a proof is not available for minimise = 'energy_per_d"):
        wo.load_scene("certified_gait", ['objective={minimise="energy_per_distance", speed=0.5}'])
    with pytest.raises(SceneError, match=r"\[search.certify\]"):
        wo.load_scene("design_fast_gait", ['want=["certificate"]'])
    with pytest.raises(SceneError, match="a front has no certificate"):
        wo.load_scene("pareto_speed_load", ["search.certify={}"])


def test_every_design_of_a_speed_has_a_bound_and_a_proof(tmp_path: Path):
    result = wo.run(wo.load_scene("design_fast_gait", OWN[:3]))
    assert value(result, "speed") < value(result, "bound") < 1.02 * value(result, "speed")
    file = tmp_path / "certificate.json"
    file.write_text(result.attributes["certificate"], encoding="utf-8")
    proof = wo.verify(file)
    assert proof.holds
    assert float(proof.bound) == pytest.approx(value(result, "bound"), rel=1e-12)
    assert result.trust["certificate"]["verified_inequalities"] == proof.inequalities
    assert "proof_time" not in result.variables


def test_a_cost_has_no_bound_unless_it_is_asked_for():
    cost = 'objective={minimise="peak_spike_load", speed=0.5}'
    result = wo.run(wo.load_scene("design_fast_gait", [*OWN[:3], cost]))
    assert result.status == "ok", result.reason
    assert not {"bound", "gap_certified"} & set(result.scalars)
    assert "certificate" not in result.attributes
