"""Certificates in scenes: what a result says, what is refused, what is kept between runs."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_design import G1, G1_LIMITS

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, Interrupted, SceneError
from wormopt.progress import silent
from wormopt.systems.spiked.certify import proof
from wormopt.systems.spiked.certify.tree import Solver
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.runs import gait_certificate, gait_design
from wormopt.systems.spiked.search.orders import letters_of
from wormopt.systems.spiked.task import Certify, GaitProblem, Search, Worm

OWN = ["search.sequence=[[0],[1],[2]]", 'search.effort="quick"', "search.workers=1"]
QUICK = Search(sequence=((0,), (1,), (2,)), effort="quick", workers=1)


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


def value(result, name: str):
    return result.scalars[name].value


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(gait_certificate, "checkpoints", lambda what, _: tmp_path / what)
    return tmp_path / "certificates"


def test_the_packaged_scene_is_certified(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = ["-o", str(tmp_path / "o"), "--set", 'want=["certificate"]']
    code = main(["run", "certified_gait", *folder, "--json"])
    told = json.loads(capsys.readouterr().out)
    scalars = {name: entry["value"] for name, entry in told["scalars"].items()}
    assert code == 0
    assert G1 * (1 - 1e-12) <= scalars["bound"] <= G1 * (1 + 1e-3)
    assert 0 <= scalars["gap_certified"] <= 1e-3
    assert scalars["certified_phases"] == 4
    assert scalars["leaf_sequence"] == [[0], [1], [2]]
    assert sum(scalars["leaf_durations"]) == pytest.approx(1.0)
    assert told["trust"]["certificate"]["ended"] == "gap reached"
    assert told["trust"]["warnings"] == []
    assert (tmp_path / "o" / "certificate.png").is_file()
    assert not list((tmp_path / "certificates").glob("*"))  # nothing is kept that is done


def test_the_course_and_the_leaves_of_a_proof():
    result = run("search.certify.gap=1e-2")
    bound = result["proof_bound"].values
    assert np.all(np.diff(bound) <= 0)
    assert bound[0] == pytest.approx(1.0, abs=1e-5)  # the ceiling
    assert bound[-1] == value(result, "bound")
    assert np.all(np.diff(result["proof_time"].values) >= 0)
    low, high = result["leaf_shortest"].values, result["leaf_longest"].values
    own = np.array(value(result, "leaf_durations"))
    held = np.all((low <= own) & (own <= high), axis=1)
    assert held.any()  # the gait's own durations lie in a leaf, whose bound is above the gait
    assert result["leaf_bound"].values[held].max() >= value(result, "speed") * (1 - 1e-12)
    assert "its own sequence" in result.trust["certificate"]["holds_for"]


def test_what_is_proven_is_kept_and_another_run_goes_on(kept: Path):
    short = run("search.certify.time_limit=1e-9", "search.certify.gap=1e-3")
    assert short.status == "ok"
    assert value(short, "gap_certified") > 1e-3
    assert "run again" in " ".join(short.trust["warnings"])
    (file,) = kept.iterdir()
    longer = run("search.certify.gap=1e-3")
    assert value(longer, "gap_certified") <= 1e-3
    assert value(longer, "boxes_explored") > value(short, "boxes_explored")
    assert longer["proof_time"].values[0] == short["proof_time"].values[0]
    assert not kept.exists()
    kept.mkdir()
    file.write_bytes(b"not a checkpoint")
    again = run("search.certify.gap=1e-3")
    assert value(again, "gap_certified") <= 1e-3
    assert value(again, "boxes_explored") <= value(longer, "boxes_explored")


def test_an_interrupted_proof_leaves_the_gait_and_its_bound(monkeypatch, kept: Path):
    grow, calls = Solver.grow, []

    def stopped(*given):
        calls.append(given)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return grow(*given)

    monkeypatch.setattr(Solver, "grow", stopped)
    with pytest.raises(Interrupted) as told:
        run("search.certify.gap=1e-3")
    partial = told.value.partial
    assert partial.status == "failed"
    assert "certificate is not" in partial.reason
    assert value(partial, "speed") == pytest.approx(G1, abs=1e-9)
    assert value(partial, "bound") > G1
    assert len(list(kept.iterdir())) == 1


def test_a_gait_of_more_phases_than_are_certified_is_no_contradiction():
    own = wo.load_scene("certified_gait", ['search.effort="quick"', "search.certify.phases=2"])
    result = wo.run(own)
    assert result.status == "ok"
    assert value(result, "bound") < value(result, "speed")
    assert value(result, "gap_certified") is None
    assert "more than 2 phases" in " ".join(result.trust["warnings"])


@pytest.mark.parametrize(
    "objective", ['{maximise="speed"}', '{minimise="peak_spike_load", speed=0.5}']
)
def test_a_proof_without_time_still_gives_a_result_with_its_picture(
    objective: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    changes = [*OWN, f"objective={objective}", "search.certify.time_limit=1e-9"]
    sets = [part for change in [*changes, 'want=["certificate"]'] for part in ("--set", change)]
    code = main(["run", "certified_gait", "-o", str(tmp_path / "o"), "--json", *sets])
    assert code == 0
    assert json.loads(capsys.readouterr().out)["trust"]["certificate"]["ended"] == "time limit"
    assert (tmp_path / "o" / "certificate.png").is_file()


def test_a_bound_below_the_gait_is_a_failure(monkeypatch):
    def wrong(task, value, *_):
        return proof.Certificate(proof.Progress(0.9 * value), -0.1, 4, None, "gap reached")

    monkeypatch.setattr(proof, "prove", wrong)
    result = run()
    assert result.status == "failed"
    assert "better than its proven bound" in result.reason
    (fault,) = (check for check in result.checks if not check.passed)
    assert fault.name == "gait over its proven bound"
    assert fault.value == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["search.certify=true"], "search.certify: true is not allowed; write a table"),
        (["search.certify.gap=0"], "search.certify.gap: 0 is not allowed; write a number from"),
        (["search.certify.phases=9"], "search.certify.phases: 9 is not allowed"),
        (["search.certify.time_limit=-1"], "search.certify.time_limit"),
        (["search.certify.limit=3"], "search.certify.limit: unknown key"),
        (
            ['objective={minimise="energy_per_distance", speed=0.5}'],
            "there is no proof for energy_per_distance",
        ),
        (
            ["worm.links=6", "gait.spike_load=60.0", "search.certify.phases=4"],
            "write 2 at most",
        ),
    ],
)
def test_proofs_that_cannot_be_had_are_refused(changes: list[str], said: str):
    with pytest.raises(SceneError) as refused:
        wo.load_scene("certified_gait", changes)
    assert said in str(refused.value)


def test_a_scene_counts_the_sets_that_python_counts():
    """Of 4 masses 2 or 3 may rest: ten sets, whose words of six phases are just not too many."""
    own = ["worm.links=3", "gait.resting=2", "gait.spike_load=60.0"]
    scene = wo.load_scene("certified_gait", [*own, "search.certify.phases=6"])
    task = scene.table.task(scene.table.objective.objective)
    assert task.count_of_sets == len(letters_of(task)) == 10
    assert not list(Certify(phases=6).faults_of_orders(task))
    ((key, said),) = Certify(phases=7).faults_of_orders(task)
    with pytest.raises(SceneError) as refused:
        wo.load_scene("certified_gait", [*own, "search.certify.phases=7"])
    assert refused.value.faults == ((f"search.certify.{key}", said),)


def test_python_proves_what_a_scene_proves():
    scene = wo.load_scene("certified_gait", [*OWN, "search.certify.gap=1e-2"])
    task = scene.table.task(scene.table.objective.objective)
    found = designed_once(task, scene.table.search.search)
    told = wo.certify(found, gap=1e-2, sequence=[[0], [1], [2]], workers=1)
    result = wo.run(scene)
    assert told.bound == value(result, "bound")
    assert told.certificate.phases == value(result, "certified_phases") == 3
    history = told.certificate.progress.history
    assert history[0] == (0.0, pytest.approx(found.ceiling))
    assert len(history) + 1 == len(result["proof_bound"].values)


def test_a_proof_without_time_says_the_ceiling():
    found = designed_once(GaitProblem(Worm(2, load=5.0), G1_LIMITS), QUICK)
    assert wo.certify(found, time_limit=1e-9).bound <= found.ceiling


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"phases": "a"}, "phases: not 'a'; write a whole number from 2 to 8"),
        ({"phases": 1}, "phases: not 1; write a whole number from 2 to 8"),
        ({"gap": "a"}, "gap: not 'a'; write a number from 1e-5 to 0.5"),
        ({"gap": 0.6}, "gap: not 0.6; write a number"),
        ({"time_limit": 0}, "time_limit: not 0; write a finite number above 0"),
        ({"sequence": [0, 1]}, "sequence: not (0, 1); write a list of lists"),
        ({"sequence": [[0], [3]]}, "sequence[1]: names a mass there is not; write indices 0 to 2"),
        ({"workers": 0}, "workers: not 0; write a whole number from 1 to 1024"),
    ],
)
def test_a_proof_refuses_what_it_cannot_use(given: dict[str, Any], said: str):
    found = designed_once(GaitProblem(Worm(2, load=5.0), G1_LIMITS), QUICK)
    with pytest.raises(ArgumentError) as refused:
        wo.certify(found, **given)
    assert str(refused.value).startswith(said)


def test_pictures_and_fronts_need_what_they_draw():
    with pytest.raises(SceneError, match=r"\[search.certify\]"):
        wo.load_scene("design_fast_gait", ['want=["certificate"]'])
    with pytest.raises(SceneError, match="one design is certified at a time"):
        wo.load_scene("pareto_speed_load", ["search.certify={}"])


def test_a_design_without_a_certificate_has_none_of_it():
    result = wo.run(wo.load_scene("design_fast_gait", OWN))
    assert "bound" not in result.scalars
    assert "certificate" not in result.trust
