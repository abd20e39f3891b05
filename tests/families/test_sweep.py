"""Sweeps: their points, their dataset, and that nothing done is lost or done twice."""

import ast
import csv
import json
import math
import os
import pickle
import random
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from places import PROBLEMS

import wormopt as wo
from wormopt.cli import main
from wormopt.cli.common import print_result
from wormopt.families import store
from wormopt.families.axes import plan
from wormopt.families.gathered import as_csv
from wormopt.families.pictures import shown
from wormopt.families.points import Job, compute
from wormopt.families.store import Store, key_of
from wormopt.kinds import KINDS
from wormopt.numerics.workers import Engine
from wormopt.study import load_scene
from wormopt.study.reference import quantity_of
from wormopt.study.swept import Swept

SERIAL = Engine("serial")


def small(over, **kwargs):
    return wo.sweep("fast_gait", over, engine=SERIAL, **kwargs)


@cache
def grid() -> wo.Result:
    """Loads under which the masses rest as the links want it: the advance is 1.2 (theory)."""
    return small({"worm.load": [40, 50], "gait.period": [1.0, 1.5, 2.0]})


# -- which points --------------------------------------------------------------------------------


def test_a_grid_has_every_combination_the_last_key_first():
    asked = plan(Swept(over={"a.b": "1:2:2", "c": [5, "x", [1, 2]]}))
    assert asked.shape == (2, 3)
    assert asked.dims == ("a_b", "c")
    assert [tuple(point.values()) for point in asked.points] == [
        (1.0, 5), (1.0, "x"), (1.0, [1, 2]), (2.0, 5), (2.0, "x"), (2.0, [1, 2]),
    ]  # fmt: skip


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.integers(1, 50))
def test_equidistant_values_begin_and_end_as_written(low, high, count):
    (axis,) = [[p["a"] for p in plan(Swept(over={"a": f"{low!r}:{high!r}:{count}"})).points]]
    assert len(axis) == count
    assert axis[0] == pytest.approx(low, rel=1e-14)
    if count > 1:
        assert axis[-1] == pytest.approx(high, rel=1e-14)
        assert np.diff(axis) == pytest.approx((high - low) / (count - 1), rel=1e-6, abs=1e-8)


def test_equal_ratios_units_and_digits():
    asked = plan(Swept(over={"a": "1:1000:4:log"}))
    assert [p["a"] for p in asked.points] == pytest.approx([1, 10, 100, 1000])
    asked = plan(Swept(over={"a": "0.1:0.3:3 mm"}))
    assert [p["a"] for p in asked.points] == ["0.1 mm", "0.2 mm", "0.3 mm"]


def test_first_with_first():
    asked = plan(Swept(over={"a": [1, 2], "b": [3, 4]}, method="zip"))
    assert [tuple(p.values()) for p in asked.points] == [(1, 3), (2, 4)]
    assert asked.dims == ("point",)


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_drawn_points_fill_the_ranges_and_repeat_with_their_seed(method):
    over = {"a": "-1:3", "b": "1:100:log"}
    found = plan(Swept(over=over, method=method, points=64, seed=3)).points
    assert found == plan(Swept(over=over, method=method, points=64, seed=3)).points
    assert found != plan(Swept(over=over, method=method, points=64, seed=4)).points
    a = (np.array([p["a"] for p in found]) + 1) / 4
    b = np.log10([p["b"] for p in found]) / 2
    for share in (a, b):  # one in each of 64 equal intervals, by construction of both
        assert sorted(np.floor(share * 64).astype(int)) == list(range(64))


@pytest.mark.parametrize(
    ("text", "key", "part"),
    [
        ("sweep=3", "sweep", "a table"),
        ("sweep={over={}}", "sweep.over", "no key is varied"),
        ('sweep={over={"worm.load"="1:10"}}', "sweep.over.worm.load", "number of values"),
        ('sweep={over={"worm.load"="one"}}', "sweep.over.worm.load", "first:last:count"),
        ('sweep={over={"worm.load"=3}}', "sweep.over.worm.load", "not a list or range"),
        ('sweep={over={"worm.load"=[]}}', "sweep.over.worm.load", "empty list"),
        ('sweep={over={"worm.load"="0:10:3:log"}}', "sweep.over.worm.load", "above 0"),
        ('sweep={over={"a"=[1], "b"=[1, 2]}, method="zip"}', "sweep.over", "1 of a, 2 of b"),
        ('sweep={over={"a"="1:2:3"}, method="sobol", points=2}', "sweep.over.a", '"1:2"'),
        ('sweep={over={"a"="2:1"}, method="sobol", points=2}', "sweep.over.a", "empty"),
        ('sweep={over={"a"="1:2"}, method="sobol"}', "sweep.points", "missing"),
        ('sweep={over={"a"=[1]}, points=4}', "sweep.points", "latin-hypercube"),
        ('sweep={over={"a"="1:2:2000000"}}', "sweep.over.a", "not allowed"),
        ('sweep={over={"a"="1:9:2000", "b"="1:9:2000"}}', "sweep.over", "too many"),
    ],
)
def test_what_a_sweep_refuses(text, key, part):
    with pytest.raises(wo.SceneError) as caught:
        load_scene("fast_gait", text)
    assert [k for k, _ in caught.value.faults] == [key]
    assert part in caught.value.faults[0][1]


def test_quantities_of_keys():
    table = type(load_scene("design_fast_gait").table)
    assert quantity_of(table, "worm.mass") == "mass"
    assert quantity_of(table, "gait.length[0]") == quantity_of(table, "gait.length.1") == "length"
    assert quantity_of(table, "search.effort") == quantity_of(table, "no.such") == ""


# -- what is found -------------------------------------------------------------------------------


def test_a_sweep_says_what_single_runs_say():
    found = small({"worm.load": [25.0, 40.0], "gait.period": "1:2:2"})
    assert found.status == "ok"
    assert found["speed"].dims == ("worm_load", "gait_period")
    for i, load in enumerate(found["worm_load"].values):
        for j, period in enumerate(found["gait_period"].values):
            alone = wo.run("fast_gait", {"worm.load": load, "gait.period": period})
            ok = alone.status == "ok"
            assert found["status"].values[i, j] == (not ok)
            for name in ("speed", "lambda_max", "spike_load_max"):
                assert found[name].values[i, j] == alone.scalars[name].value
                assert found[name].unit == alone.scalars[name].unit


def test_points_without_solution_are_data():
    found = wo.sweep(
        "design_fast_gait",
        {"gait.actuator_force": [1.0, 2.0, 40.0]},
        overrides=["worm.links=1", "search.effort='quick'", "search.sequence=[[0],[1]]"],
        engine=SERIAL,
    )
    assert found.status == "ok"
    assert found["status"].values.tolist() == [1, 1, 0]
    assert np.isnan(found["speed"].values[:2]).all()
    reasons = found.attributes["reasons"]
    assert all("gait.actuator_force" in reason for reason in reasons[:2])
    assert reasons[0] != reasons[1]
    assert reasons[2] == ""
    assert list(found.trust["reasons"].values()) == [2]  # they differ by numbers alone


def test_scenes_that_are_refused_are_data_unless_all_are():
    found = small({"worm.load": [40.0, -1.0]}, overrides='units="SI"')
    reasons = found.attributes["reasons"]
    refused = found["status"].values.tolist()
    assert (refused == [0, 2]) == bool(reasons[1]) == ("worm.load" in reasons[1])
    with pytest.raises(wo.SceneError, match="did you mean load"):
        small({"worm.laod": [1, 2]})
    with pytest.raises(wo.SceneError, match=r"sweep: missing; write for example \[sweep\]"):
        wo.sweep("fast_gait", engine=SERIAL)


def test_texts_and_lists_can_be_varied():
    found = small({"worm.mass": [1.0, [1.0, 1.0, 1.0]], "title": ["a", "b"]})
    assert found["worm_mass"].values.tolist() == [0, 1]
    assert found.attributes["axes"][0]["values"] == [1.0, [1.0, 1.0, 1.0]]
    assert found["speed"].values.ravel() == pytest.approx(1.2, rel=1e-12)


def test_the_dataset_opens_in_xarray(tmp_path: Path):
    import xarray

    grid().save(tmp_path)
    with xarray.open_dataset(tmp_path / "result.nc", engine="scipy") as data:
        assert data.speed.dims == ("worm_load", "gait_period")
        assert float(data.speed.sel(worm_load=50, gait_period=1.5)) == pytest.approx(0.8)
        assert data.gait_period.values.tolist() == [1.0, 1.5, 2.0]
    with (tmp_path / "points.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(r["worm.load"], r["gait.period"], r["status"]) for r in rows[:2]] == [
        ("40.0", "1.0", "ok"),
        ("40.0", "1.5", "ok"),
    ]
    assert float(rows[4]["speed"]) == pytest.approx(1.2 / 1.5)


def test_points_that_go_along_no_key_are_counted(tmp_path: Path):
    over = {"worm.load": [40, 50], "gait.period": [1.0, 1.5]}
    data = small(over, method="zip", store=tmp_path).to_xarray()
    assert data.point.values.tolist() == [0, 1]
    assert float(data.speed.sel(point=1)) == pytest.approx(0.8)  # 1.2 per period


def test_a_table_of_a_sweep_has_a_row_for_each_point(tmp_path: Path):
    found = grid()
    frame = found.to_dataframe()
    assert list(frame.columns[:4]) == ["worm.load", "gait.period", "status", "reason"]
    assert frame["gait.period"].tolist() == [1.0, 1.5, 2.0] * 2
    assert frame["speed"].tolist() == pytest.approx([1.2, 0.8, 0.6] * 2)
    assert found.to_dataframe("worm_load").shape[0] == 2
    (file,) = wo.export(found, "csv", tmp_path)
    text = file.read_text("utf-8")
    assert text.endswith(as_csv(found))
    assert text.startswith("# fast_gait")


def test_what_a_sweep_says_in_short(capsys: pytest.CaptureFixture[str]):
    print_result(small({"worm.load": [40, -1, 50], "gait.period": [1.5, 1.0]}))
    told = capsys.readouterr().out
    assert re.search(r"best speed +1.2 +worm.load 40, gait.period 1\n", told)
    assert "2 × worm.load: -1" in told
    drawn = small({"worm.load": "40:50", "gait.period": "1:2"}, method="sobol", points=4)
    best = drawn.to_dataframe().sort_values("gait.period").iloc[0]
    print_result(drawn)
    assert f"gait.period {best['gait.period']:.6g}" in capsys.readouterr().out


# -- what is kept --------------------------------------------------------------------------------


def computed(store: Path) -> Counter:
    """How often each point was computed, by the journal."""
    journal = store / "journal.txt"
    lines = journal.read_text().splitlines()[1:] if journal.exists() else []
    return Counter(line.split()[3] for line in lines)


def job_of(scene: wo.Scene, folder: Path) -> Job:
    return Job(scene.table, key_of(scene.table), type(scene.table).result, Store(folder), "one")


def test_what_is_known_is_not_computed_again(tmp_path: Path):
    one = small({"worm.load": [41, 42, 42]}, store=tmp_path)
    assert one.scalars["computed_now"].value == 2  # equal points once
    more = small({"worm.load": [41, 42, 43]}, store=tmp_path)
    assert more.scalars["computed_now"].value == 1
    assert more["speed"].values.tolist()[:2] == one["speed"].values.tolist()[:2]
    assert set(computed(tmp_path).values()) == {1}
    point = wo.Result.load(tmp_path / more.attributes["files"][2])
    assert (point.scene, point.kind) == ("fast_gait", "gait")
    assert "length" in point


def test_scalars_alone_may_be_kept(tmp_path: Path):
    found = small({"worm.load": [40]}, store=tmp_path, keep="scalars")
    point = wo.Result.load(tmp_path / found.attributes["files"][0])
    assert point.variables == ()
    assert point.scalars["speed"].value == found["speed"].values[0]
    whole = small({"worm.load": [40]}, store=tmp_path)
    assert whole.scalars["computed_now"].value == 1
    again = small({"worm.load": [40]}, store=tmp_path, keep="scalars")
    assert again.scalars["computed_now"].value == 0
    assert "length" in wo.Result.load(tmp_path / again.attributes["files"][0])


def test_a_damaged_point_is_computed_again(tmp_path: Path):
    found = small({"worm.load": [40]}, store=tmp_path)
    file = tmp_path / found.attributes["files"][0]
    file.write_bytes(file.read_bytes()[:100])
    assert small({"worm.load": [40]}, store=tmp_path).scalars["computed_now"].value == 1


def test_a_point_hangs_on_the_files_that_it_names(tmp_path: Path):
    gait = wo.fast_gait(1.0)
    gait.to_csv(tmp_path / "gait.csv", samples=101)
    scene = tmp_path / "mine.toml"
    text = 'schema = 1\nkind = "gait"\n[worm]\nlinks = 2\nmass = 1.0\nload = 5.0\n[gait]\n'
    scene.write_text(f'{text}shape = "file"\nfile = "gait.csv"\nperiod = 1.0\n')
    before = key_of(load_scene(scene).table)
    assert key_of(load_scene(scene).table) == before
    wo.fast_gait(2.0).to_csv(tmp_path / "gait.csv", samples=101)
    assert key_of(load_scene(scene).table) != before


def test_who_finds_a_point_in_hand_leaves_it(tmp_path: Path):
    from filelock import FileLock

    scene = load_scene("fast_gait")
    job = job_of(scene, tmp_path)
    with FileLock(job.store.file(job.key).with_suffix(".lock")):
        script = "import pickle, sys; from wormopt.families.points import compute;" + (
            "print(compute(pickle.load(sys.stdin.buffer)))"
        )
        done = subprocess.run(
            [sys.executable, "-c", script], input=pickle.dumps(job), capture_output=True, check=True
        )
        assert done.stdout.strip() == b"None"
    record = compute(job)
    assert record is not None
    assert record.status == "ok"
    assert {path.suffix for path in tmp_path.iterdir()} == {".nc", ".txt"}


def test_a_point_at_which_processes_die_is_given_up(tmp_path: Path):
    scene = load_scene("fast_gait")
    job = job_of(scene, tmp_path)
    tries = job.store.file(job.key).with_suffix(".tries")
    tries.write_text("another\n" * 9 + "one\n" * 3)
    record = compute(job)
    assert record is not None
    assert (record.status, "died" in record.reason) == ("failed", True)
    tries.write_text("another\n" * 9)  # killed with their sweeps
    record = compute(job)
    assert record is not None
    assert record.status == "ok"


@pytest.mark.slow
def test_points_depend_on_pictures_for_which_more_is_computed():
    """Only studies that say so look at the wanted pictures, but to check what was given."""
    systems = Path(wo.__file__).parent / "systems"
    kinds = [kind.load() for kind in KINDS.values() if kind.load().wanted]
    said = {systems.parents[1] / f"{kind.__module__.replace('.', '/')}.py" for kind in kinds}
    said.add(systems / "spiked" / "design_results.py")  # of designs
    looking = {path for path in systems.rglob("*.py") if looks_at_pictures(path)}
    assert looking <= said
    assert all(set(kind.wanted) <= set(kind.pictures) for kind in kinds)


def looks_at_pictures(file: Path) -> bool:
    """Whether a function that checks nothing reads the key `want`."""
    tree = ast.parse(file.read_text("utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return any(
        isinstance(node, ast.Attribute) and node.attr == "want"
        for function in functions
        if not function.name.lstrip("_").startswith("faults")
        for node in ast.walk(function)
    )


def test_other_pictures_make_no_other_point():
    scene = load_scene("fig13_magnetic_pair", "want=[]")
    assert key_of(load_scene("fig13_magnetic_pair").table) == key_of(scene.table)
    other = load_scene("fast_gait", "want=[]")
    assert key_of(load_scene("fast_gait").table) != key_of(other.table)


def test_a_worker_with_other_code_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    job = job_of(load_scene("fast_gait"), tmp_path)
    monkeypatch.setattr(store, "code_key", lambda _: "another")
    record = compute(job)
    assert record is not None
    assert (record.status, "another version of wormopt" in record.reason) == ("failed", True)
    assert not list(tmp_path.glob("*.nc"))


REFUSING = """
from wormopt.errors import ArgumentError

def build(tag=0.0):
    raise ArgumentError(f"no {tag}")
"""


def test_what_the_study_refuses_is_kept_with_its_reason(tmp_path: Path):
    scene = own_model(tmp_path, REFUSING)
    for now in (2, 0):
        found = wo.sweep(
            scene, {"model.parameters.tag": [1.0, 2.0]}, store=tmp_path / "s", engine=SERIAL
        )
        assert found.scalars["computed_now"].value == now
        assert found["status"].values.tolist() == [2, 2]
        assert "no 2.0" in found.attributes["reasons"][1]


CRASHING = """
import os, time
from wormopt.model.model import Model, Signal
import casadi as ca

def build(bad=0.0, tag=0.0):
    if bad:
        os._exit(1)
    time.sleep(tag)
    x = ca.SX.sym("x")
    return Model("slow", x=[Signal("x", x, value=1.0 + tag)], ode=-x)
"""


def own_model(folder: Path, code: str) -> Path:
    (folder / "own.py").write_text(code)
    scene = folder / "own.toml"
    text = 'schema = 1\nkind = "simulate"\nmodel.file = "own.py:build"\n[time]\nend = 1.0\n'
    scene.write_text(f"{text}[model.parameters]\ntag = 0.0\n")
    return scene


@pytest.mark.slow
def test_a_point_that_ends_its_process_costs_no_other(tmp_path: Path):
    scene = own_model(tmp_path, CRASHING)
    over = {"model.parameters.bad": [1.0, 0.0, 1.0], "model.parameters.tag": [0.0, 1.5, 0.1]}
    found = wo.sweep(scene, over, method="zip", store=tmp_path / "s", engine=Engine(workers=2))
    assert found["status"].values.tolist() == [1, 0, 1]
    assert all("died" in found.attributes["reasons"][k] for k in (0, 2))
    assert len(points_in(tmp_path / "s")) == 1  # that they died is not kept


def test_a_model_of_ones_own_that_changes_is_computed_again(tmp_path: Path):
    scene, over = own_model(tmp_path, CRASHING), {"model.parameters.tag": [0.0]}
    for now in (1, 0):
        found = wo.sweep(scene, over, store=tmp_path / "s", engine=SERIAL)
        assert found.scalars["computed_now"].value == now
    (tmp_path / "own.py").write_text(CRASHING.replace("-x)", "-2 * x)"))
    found = wo.sweep(scene, over, store=tmp_path / "s", engine=SERIAL)
    assert found.scalars["computed_now"].value == 1


def test_a_file_that_changes_meanwhile_spoils_no_store(tmp_path: Path):
    scene = own_model(tmp_path, CRASHING)

    def changing(study: Any) -> wo.Result:
        (tmp_path / "own.py").write_text(CRASHING + "# more\n")
        return study.result()

    record = compute(replace(job_of(load_scene(scene), tmp_path), work=changing))
    assert record is not None
    assert (record.status, "changed during the sweep" in record.reason) == ("failed", True)
    assert not list(tmp_path.glob("*.nc"))


def test_a_value_that_is_refused_keeps_the_coordinate():
    found = small({"gait.period": ["1000 ms", "-2 s", "3 s"]}, overrides='units="SI"')
    assert (found["gait_period"].values.tolist(), found["gait_period"].unit) == ([1, -2, 3], "s")
    assert found["status"].values.tolist() == [0, 2, 0]


def test_names_of_keys_and_of_numbers_may_be_the_same():
    found = wo.sweep("membrane", {"lifetime": [1e3, 2e3]}, engine=SERIAL)
    assert found["lifetime"].values.tolist() == [1e3, 2e3]
    assert "lifetime_found" in found


def test_a_scene_that_says_its_sweep_may_be_swept_otherwise():
    swept = Swept(over={"worm.load": [20, 30], "title": ["a", "b"]})
    base = replace(load_scene("fast_gait"), sweep=swept)
    assert wo.sweep(base, engine=SERIAL)["status"].values.shape == (2, 2)
    assert wo.sweep(base, method="zip", engine=SERIAL)["status"].values.shape == (2,)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--over", "worm.load=[1]", "--over", "worm.load=[2]"],
        ["--over", "units=['SI']"],
        ["--over", "gait.period=1e400:2:3"],
        ["--over", "worm.load=[1]", "--store", "."],
        ["--over", "worm.load=[1]", "--store", "file"],
        ["--over", "worm.load=[1]", "--store", "foreign"],
        ["--over", "worm.load=[1]", "--engine", "dask", "--scheduler", "nonsense://x"],
    ],
)
def test_what_the_command_refuses_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, arguments
):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("mine")
    Path("foreign").mkdir()
    Path("foreign/journal.txt").write_text("mine")
    assert main(["sweep", "fast_gait", *arguments, "-o", ".", "--force", "--no-plots"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert Path("foreign/journal.txt").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} <= {"file", "foreign", "points"}


# -- the command ---------------------------------------------------------------------------------

COMMAND = [sys.executable, "-m", "wormopt", "sweep"]


def test_one_command_gives_dataset_table_and_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    over = ["--over", "worm.load=20:30:2", "--over", "gait.period=[1, 2]"]
    assert main(["sweep", "fast_gait", *over, "--engine", "serial", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["kind"], summary["scalars"]["points"]["value"]) == ("sweep", 4)
    folder = tmp_path / "results" / "fast_gait-sweep"
    there = {path.name for path in folder.iterdir()}
    assert there == {"result.nc", "summary.json", "points.csv", "sweep.png", "points"}
    again = ["sweep", "fast_gait", *over, "--over", "worm.mass=[1.0, 2.0]", "--engine", "serial"]
    assert main([*again, "--no-plots"]) == 0
    assert wo.Result.load(folder).scalars["computed_now"].value == 4
    told = capsys.readouterr().err
    assert "replaced the earlier result, which had other values of sweep.over" in told
    # with --set the points are those of the scene
    changed = ["sweep", "fast_gait", "--set", "worm.load=20.0", "--over", "gait.period=[1, 2]"]
    assert main([*changed, "--engine", "serial", "--no-plots", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scalars"]["computed_now"]["value"] == 0
    assert (tmp_path / "results" / "fast_gait-sweep,worm.load=20.0" / "result.nc").is_file()
    assert main(["show", "results"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[2].split(";")[0] for line in listed] == [" sweep, ok"] * 2
    assert main(["sweep", "fast_gait", "--over", "worm.load=1"]) == 2
    assert main(["sweep", "fast_gait", "--over", "worm.load"]) == 2
    assert main(["sweep", "fast_gait", "--over", "worm.load=[1"]) == 2
    assert main(["sweep", "fast_gait"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_scene_may_say_its_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    scene = tmp_path / "mine.toml"
    text = (PROBLEMS / "fast_gait.toml").read_text(encoding="utf-8")
    scene.write_text(text + '\n[sweep]\nover."worm.load" = "20:30:2"\n', encoding="utf-8")
    out = str(tmp_path / "out")
    assert main(["sweep", str(scene), "--engine", "serial", "--no-plots", "-o", out]) == 0
    assert wo.Result.load(tmp_path / "out")["worm_load"].values.tolist() == [20, 30]
    assert main(["run", str(scene), "--no-plots", "-o", str(tmp_path / "one")]) == 0
    assert "`wormopt sweep` uses it" in capsys.readouterr().err
    assert load_scene(scene).key == load_scene("fast_gait").key


def started(folder: Path, engine: list[str], over: list[str]) -> subprocess.Popen:
    command = [*COMMAND, "fast_gait", *over, "--quiet", "--no-plots", *engine]
    return subprocess.Popen(
        [*command, "-o", str(folder.parent / "out"), "--store", str(folder)],
        start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def points_in(store: Path) -> set[str]:
    return {path.stem for path in store.glob("*.nc")}


OVER = ["--over", "worm.load=1:30:40", "--over", "gait.period=[1.0, 1.5]"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "loads"),
    [(1, 8), *(pytest.param(n, 40, marks=pytest.mark.slow) for n in (3, 20))],
)
def test_a_sweep_that_is_killed_loses_nothing_and_does_nothing_twice(
    tmp_path: Path, count: int, loads: int
):
    store, draw = tmp_path / "store", random.Random(count)
    over = ["--over", f"worm.load=1:30:{loads}", *OVER[2:]]
    killed = 0
    for _ in range(count):
        before = points_in(store)
        with started(store, ["--workers", "2"], over) as run:
            begin, delay = time.monotonic(), draw.uniform(0.2, 1.0)
            while points_in(store) == before and run.poll() is None:
                assert time.monotonic() - begin < 60
                time.sleep(0.01)
            time.sleep(delay * 0.3)
            if run.poll() is None:
                killed += 1
                os.kill(run.pid, signal.SIGKILL)
        assert before <= points_in(store)
    with started(store, ["--workers", "2"], over) as run:
        _, told = run.communicate(timeout=120)
    assert run.returncode == 0, told
    found = wo.Result.load(tmp_path / "out")
    assert found.scalars["not_computed"].value == 0
    assert len(points_in(store)) == 2 * loads
    assert max(computed(store).values()) == 1
    assert killed > 0
    assert not list(store.glob("*.part")) + list(store.glob("*.tries"))
    # a process that is killed after its point is written leaves a lock, which nobody holds
    assert {lock.stem for lock in store.glob("*.lock")} <= points_in(store)


@pytest.mark.slow
def test_an_interrupted_sweep_saves_what_it_has_and_leaves_nothing_running(tmp_path: Path):
    store = tmp_path / "store"
    over = ["--over", "worm.load=1:30:400"]
    with started(store, ["--workers", "2"], over) as run:
        while len(points_in(store)) < 5:
            time.sleep(0.02)
        os.killpg(run.pid, signal.SIGINT)
        _, told = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "Traceback" not in told
    assert "interrupted after" in told
    found = wo.Result.load(tmp_path / "out")
    assert found.status == "failed"
    assert 5 <= found.scalars["ok"].value + found.scalars["failed"].value < 400
    time.sleep(1.5)
    before = points_in(store)
    time.sleep(1.0)
    assert points_in(store) == before


@pytest.mark.slow
def test_two_sweeps_share_a_store(tmp_path: Path):
    store = tmp_path / "a" / "store"
    other = tmp_path / "b"
    other.mkdir()
    (other / "store").symlink_to(store)
    store.mkdir(parents=True)
    with (
        started(store, ["--engine", "serial"], OVER) as one,
        started(other / "store", ["--engine", "serial"], OVER) as two,
    ):
        for run in (one, two):
            _, told = run.communicate(timeout=120)
            assert run.returncode == 0, told
    found = [wo.Result.load(folder / "out") for folder in (tmp_path / "a", other)]
    assert [r.scalars["not_computed"].value for r in found] == [0, 0]
    assert np.array_equal(found[0]["speed"].values, found[1]["speed"].values, equal_nan=True)
    assert computed(store) == Counter(points_in(store))
    shares = [r.scalars["computed_now"].value for r in found]
    assert min(shares) > 0
    assert math.fsum(shares) >= 80


# -- Dask ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_dask_cluster_computes_the_same():
    pytest.importorskip("distributed")
    over = {"worm.load": [1.0, 2.0, 30.0]}
    here = small(over)
    there = wo.sweep("fast_gait", over, engine=Engine("dask", 2))
    assert there["speed"].values.tolist() == here["speed"].values.tolist()
    assert there["status"].values.tolist() == here["status"].values.tolist()


def test_a_cluster_that_is_not_there_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    pytest.importorskip("distributed")
    from wormopt.numerics import dask_cluster

    monkeypatch.setattr(dask_cluster, "_PATIENCE", 1)  # in vain, however long
    engine = ["--engine", "dask", "--scheduler", "tcp://127.0.0.1:9", "-o", str(tmp_path / "out")]
    assert main(["sweep", "fast_gait", "--over", "worm.load=[1]", *engine]) == 2
    assert "no Dask scheduler answers" in capsys.readouterr().err


def test_a_sweep_draws_itself_unasked():
    drawn = small({"worm.load": [42, 43]}).plot()
    assert drawn.axes[-1].get_xlabel().startswith("worm.load")


@pytest.mark.slow
def test_a_sweep_of_several_trackers_draws_a_line_for_each():
    base = {"tolerance.recheck": False, "time.samples": 11}
    scene = wo.load_scene("fig05_lambda_trackers", base)
    swept = wo.sweep(scene, {"time.end": [0.1, 0.2]}, engine=SERIAL)
    assert swept.attributes["numbers"] == []
    panel = swept.plot().axes[0]
    drawn = [np.asarray(line.get_ydata()).tolist() for line in panel.lines]
    assert drawn == swept["distance"].values.T.tolist()


def test_a_sweep_without_any_number_draws_where_points_are_lost():
    aim = {"minimise": "peak_spike_load", "speed": 1.2}  # above all gaits
    scene = wo.load_scene("design_fast_gait", {"objective.maximise": None, "objective": aim})
    swept = wo.sweep(scene, {"objective.speed": [1.2, 1.3]}, engine=SERIAL)
    assert swept.attributes["numbers"] == swept.attributes["series"] == []
    assert [line.get_marker() for line in swept.plot().axes[0].lines].count("x") == 2


def test_a_picture_of_a_sweep_does_not_show_a_key_over_itself(tmp_path: Path):
    over = {"worm.load": [1.0, 2.0], "gait.period": [1.0, 2.0]}
    result = wo.sweep("fast_gait", over, store=tmp_path)
    assert "period" in result.attributes["numbers"]
    names = shown(result)
    assert "speed" in names
    assert "period" not in names
