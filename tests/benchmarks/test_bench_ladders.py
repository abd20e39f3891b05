"""Benchmarks of one shape, their page, the history of ratios, older versions."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import ROOT

from tests.benchmarks import against, history, ladder, page
from tests.benchmarks.__main__ import main
from tests.benchmarks.ladder import Target, Task, Way, _kept, lines, measure, ratios, task_of
from tests.benchmarks.memory import growth
from tests.benchmarks.run import OWN
from wormopt.errors import ArgumentError, OutputError
from wormopt.progress import silent


def missing() -> Any:
    raise ModuleNotFoundError("no peer", name="peer")


def unmade() -> Any:
    raise RuntimeError("gave up")


def failing(_: float) -> np.ndarray:
    raise RuntimeError("gave up")


def known(*ways: Way) -> dict[str, Any]:
    """What is found of a task whose answer is (2, 4), laid out as for JSON."""
    task = Task(
        "two numbers", "by hand", "numbers", "steps", 1e-3, np.array([2.0, 4.0]), ways, far=1e5
    )
    *_, records = measure(task, True, silent)
    return {"case": "two", "title": task.title, "source": task.source, "what": task.what,
            "setting": task.setting, "goal": task.goal, "targets": [],
            "solvers": [record.told for record in records]}  # fmt: skip


def good(setting: float) -> np.ndarray:
    return np.array([2.0, 4.0 + setting])


# -- one shape -----------------------------------------------------------------------------------


def test_wrong_answers_and_failures_are_told_and_do_not_count():
    found = known(
        Way(OWN, lambda: good, (1e-2, 1e-4)),
        Way("spoilt", lambda: lambda _: np.array([2.0, -4.0]), (1.0,)),
        Way("no number", lambda: lambda _: np.array([np.nan, 4.0]), (1.0,)),
        Way("far", lambda: lambda _: np.array([2.0, 4.01]), (1e-9,)),
        Way("rough", lambda: lambda _: np.array([2.0, 4.1]), (1.0,)),
        Way("failing", lambda: failing, (1.0,)),
        Way("unmade", unmade, (1.0,)),
        Way("absent", missing, (1.0,)),
        Way("other", lambda: good, (1e-5,)),
    )
    solvers = {s["solver"]: s for s in found["solvers"]}
    assert [p["error"] for p in solvers[OWN]["points"]] == pytest.approx([1e-2, 1e-4])
    assert "wrong without a word" in solvers["spoilt"]["failures"][0]
    assert "wrong without a word" in solvers["no number"]["failures"][0]
    assert "wrong without a word" in solvers["far"]["failures"][0]
    assert solvers["failing"]["failures"] == ["1: RuntimeError: gave up"]
    assert solvers["unmade"]["failures"] == ["1: RuntimeError: gave up"]
    assert solvers["absent"]["missing"] == "not installed: peer"
    assert set(ratios(found)) == {"other"}  # a rough answer has no time to compare
    told = "\n".join(lines(found))
    assert told.count("absent: not installed: peer") == 1
    assert "not reached" in told
    json.dumps(found, allow_nan=False)


def test_a_target_is_met_beside_the_fastest_of_its_solvers():
    times = {OWN: 0.2, "quick": 0.1, "slow": 0.4}
    solvers = [{"solver": name, "points": [{"error": 1e-9, "time_s": time}]}
               for name, time in times.items()]  # fmt: skip
    targets = [Target(("quick", "slow"), 1.5), Target(("slow",), 1.5), Target(("absent",), 1.5)]
    kept = [_kept(target, {"goal": 1e-6, "solvers": solvers}) for target in targets]
    assert [(k["ratio"], k["met"]) for k in kept] == [(2.0, False), (0.5, True), (None, None)]


def test_memory_is_what_work_makes_the_process_grow():
    total, grown = growth(lambda: np.ones(8_000_000).sum())
    _, little = growth(lambda: None)
    assert total == 8_000_000
    assert grown is not None
    assert little is not None
    assert little < 5e6 < 40e6 < grown < 200e6


@pytest.mark.parametrize(
    ("name", "coarse", "fine", "most"),
    [
        ("elastica", 6, 16, 1e-10), ("coils", 2, 12, 1e-12), ("rod_statics", 2, 8, 1e-7),
        ("rod_dynamics", 4, 8, 2e-5), ("certificate", 0.05, 0.02, 0.02),
    ],
)  # fmt: skip
def test_our_answers_come_to_the_known_one(name: str, coarse: float, fine: float, most: float):
    task = task_of(name, quick=True)
    run = next(way for way in task.ways if way.name == OWN).make()
    first, last = task.error(run(coarse)), task.error(run(fine))
    assert last <= most
    assert last < first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "most"),
    [("steady", 1e-9), ("sensitivities", 2e-6), ("coils", 1e-9), ("elastica", 1e-6)],
)
def test_all_who_are_there_agree_on_the_answer(name: str, most: float):
    task = task_of(name, quick=True)
    for way in task.ways:
        if "diffrax" in way.name:  # compiles for long
            continue
        try:
            run = way.make()
        except ModuleNotFoundError as error:  # a peer of the extra all-tests
            if error.name not in ("magpylib", "skfem"):
                raise
            continue
        assert task.error(run(way.settings[-1])) <= most, way.name


@pytest.mark.parametrize(("name", "other", "setting", "most"), [
    ("rod_statics", "scikit-fem, P2", 32, 1e-8), ("rod_statics", "SciPy solve_bvp", 1e7, 1e-8),
    ("rod_dynamics", "scikit-fem, P2, ARPACK", 64, 1e-6),
    ("rod_dynamics", "SciPy, differences", 1024, 1e-5),
    ("certificate", "HiGHS, equal steps", 6, 0.3),
])  # fmt: skip
def test_peers_are_given_their_due(name: str, other: str, setting: float, most: float):
    task = task_of(name, quick=True)
    try:
        run = next(way for way in task.ways if way.name == other).make()
    except ModuleNotFoundError as error:
        if error.name not in ("magpylib", "skfem"):
            raise
        pytest.skip(f"{error.name} is not installed")
    assert task.error(run(setting)) <= most


def test_a_bound_below_the_optimum_is_none():
    from tests.benchmarks import certificate

    assert np.isnan(certificate._proven(0.82)).all()
    assert certificate._proven(0.83)[0] == pytest.approx(0.83 / 0.82566665338, rel=1e-10)


# -- page and history ----------------------------------------------------------------------------


def entry(ratio: float, quick: bool = True, version: str = "0.1.0+a") -> history.Entry:
    ratios = {"coils": {"magpylib": ratio}}
    return {"version": version, "date": "2026-11-25", "processor": "one", "quick": quick,
            "ratios": ratios}  # fmt: skip


def test_a_loss_is_told_and_noise_is_not(tmp_path: Path):
    file = tmp_path / "history.json"
    for ratio in (0.4, 0.5, 0.45, 0.6):
        assert history.append(file, entry(ratio)) == []
    assert history.append(file, entry(2.0, quick=False)) == []  # measured otherwise
    (line,) = history.append(file, entry(1.0, version="0.1.0+b"))
    assert "lost: coils: 1 of the time of magpylib, 0.475 before (× 2.1)" in line
    assert [e["version"] for e in history.read(file)] == ["0.1.0+a"] * 5 + ["0.1.0+b"]


@pytest.mark.parametrize("content", ["{", "[1]", '{"a": 1}'])
def test_another_file_is_no_history(tmp_path: Path, content: str, capsys: Any):
    (tmp_path / page.HISTORY).write_text(content)
    with pytest.raises(OutputError, match="no history"):
        history.read(tmp_path / page.HISTORY)
    assert main(["coils", "--quick", "--quiet", "-o", str(tmp_path)]) == 2
    assert "is no history of benchmarks" in capsys.readouterr().err


def test_one_page_shows_every_case_of_a_folder(tmp_path: Path, monkeypatch: Any, capsys: Any):
    ways = [Way(OWN, lambda: good, (1e-4,)), Way("<peer>", lambda: good, (1e-4,))]
    small = Task("two numbers", "by hand", "numbers", "steps", 1e-3, np.array([2.0, 4.0]), ways)
    monkeypatch.setattr(ladder, "task_of", lambda name, quick: small)
    for case in ("coils", "elastica"):  # one after the other
        assert main([case, "--quick", "--json", "--quiet", "-o", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert set(found) == {"machine", "quick", "cases"}
    shown = (tmp_path / page.PAGE).read_text("utf-8")
    for case in ("coils", "elastica"):
        assert f'<section id="{case}">' in shown
    assert shown.count("data:image/png;base64,") == 2
    assert "<peer>" not in shown
    assert shown.count("&lt;peer&gt;") >= 4  # tables and history
    assert len(history.read(tmp_path / page.HISTORY)) == 2


# -- older versions ------------------------------------------------------------------------------


def test_what_is_no_version_is_refused(tmp_path: Path, capsys: Any):
    with pytest.raises(ArgumentError, match="neither a checkout"):
        against.installed(str(tmp_path / "no.whl"), tmp_path / "older")
    assert main(["ocp", "--against", str(ROOT)]) == 2
    told = capsys.readouterr().err
    assert "ocp: --against cannot run this case; write one of track13" in told


def test_a_checkout_is_taken_as_it_is(tmp_path: Path):
    assert against.installed(str(ROOT), tmp_path) == ROOT


@pytest.mark.slow
def test_a_version_beside_itself_is_as_fast(capsys: Any):
    assert main(["coils", "mag2", "--against", str(ROOT), "--json", "--quiet"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {row["case"] for row in rows} == {"coils", "mag2"}
    assert all(row["now_error"] == row["then_error"] for row in rows)
    assert 0.5 < np.median([row["ratio"] for row in rows]) < 2.0


SPOILT = """
_true = Coil.expression
def _spoilt(self, q, s, nodes):
    return tuple(1.001 * field for field in _true(self, q, s, 4 * nodes))
Coil.expression = _spoilt
"""


@pytest.mark.slow
def test_a_slower_version_and_a_wrong_one_are_seen(tmp_path: Path):
    """A version whose coils take twice the nodes, and then add a thousandth."""
    from shutil import copytree

    copytree(ROOT / "wormopt", tmp_path / "wormopt")
    with (tmp_path / "wormopt/magnetics/winding.py").open("a", encoding="utf-8") as file:
        file.write(SPOILT)
    *_, rows = against.against(str(tmp_path), ["coils"], quick=True, report=silent)
    last = rows[-1]
    assert last["ratio"] < 0.6
    assert last["now_error"] < 1e-12
    assert 1e-4 < last["then_error"] < 1e-2
