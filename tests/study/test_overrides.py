"""Changes of scenes from Python and from the command line, and hints for what may be meant."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effort import examples
from hints import Capture, Patch
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SceneError
from wormopt.study import packaged_scenes
from wormopt.study.reference import page
from wormopt.study.template import template

SAME: list[tuple[Any, dict[str, Any]]] = [
    ("worm.load=3", {}),
    (["worm.load=3"], {}),
    ({"worm.load": 3}, {}),
    ({"worm": {"load": 3}}, {}),
    ([{"worm.load": 7}, "worm.load=3"], {}),
    ({"worm.load": np.float64(3)}, {}),
    ((), {"worm": {"load": 3}}),
    ({"worm.load": 7}, {"worm": {"load": 3}}),  # keywords come last
]


@pytest.mark.parametrize(("overrides", "tables"), SAME)
def test_all_ways_to_change_a_key_are_one(overrides: Any, tables: dict[str, Any], tmp_path: Path):
    text = packaged_scenes()["fast_gait"].read_text(encoding="utf-8")
    path = tmp_path / "fast_gait.toml"
    path.write_text(text.replace("load = 20.0", "load = 3.0"), encoding="utf-8")
    scene = wo.load_scene("fast_gait", overrides, **tables)
    assert scene.text == wo.load_scene(path).text
    assert scene.table.worm.load == 3.0


def test_lists_arrays_and_entries_are_given():
    for pair in ([0.8, 1.2], (0.8, 1.2), np.array([0.8, 1.2])):
        scene = wo.load_scene("design_fast_gait", {"gait.length": pair})
        assert scene.table.gait.length == (0.8, 1.2)
    scene = wo.load_scene("design_fast_gait", {"gait.length[1]": 1.4, "gait": {"length.0": 0.9}})
    assert scene.table.gait.length == (0.9, 1.4)


@pytest.mark.parametrize("name", packaged_scenes())
def test_a_scene_may_be_loaded_again(name: str):
    scene = wo.load_scene(name)
    assert wo.load_scene(scene) == scene
    assert wo.load_scene(scene, title="Other").title == "Other"


def test_a_dict_is_a_scene():
    whole = {
        "schema": 1,
        "kind": "gait",
        "worm": {"links": 2, "mass": (1, 1, 1), "load": 20.0},
        "gait": {"shape": "fast", "period": 1, "rest_length": 2, "elongation": 0.15},
    }
    scene = wo.load_scene(whole, {"worm.load": 25})
    changes = {"worm": {"load": 25, "mass": [1, 1, 1], "drag": 0}, "title": "", "want": []}
    assert scene.table == wo.load_scene("fast_gait", changes).table
    assert whole["worm"] == {"links": 2, "mass": (1, 1, 1), "load": 20.0}  # as it was given
    assert wo.run(whole).scalars["speed"].value == pytest.approx(1.2)
    assert (scene.name, wo.load_scene(whole, name="quick").name) == ("scene", "quick")
    with pytest.raises(SceneError, match="scene: kind: missing"):
        wo.load_scene({})


def test_run_takes_overrides():
    slow = wo.run("fast_gait", {"gait.period": 2, "want": []})
    assert slow.scalars["speed"].value == pytest.approx(0.6)  # 4 e l0 / T
    again = wo.run(wo.load_scene("fast_gait"), "gait.period=2")
    assert again.scalars["speed"] == slow.scalars["speed"]


@pytest.mark.parametrize("wrong", [5, [5], [None]])
def test_what_is_no_override_is_refused(wrong: Any):
    with pytest.raises((ArgumentError, TypeError)):
        wo.load_scene("fast_gait", wrong)


@settings(max_examples=examples(40))
@given(st.dictionaries(st.text(max_size=6), st.none() | st.integers() | st.text(max_size=3)))
def test_any_dict_changes_a_scene_or_is_refused(changes: dict[str, Any]):
    try:
        assert wo.load_scene("fast_gait", changes).table.kind == "gait"
    except SceneError as error:
        assert error.faults  # noqa: PT017  both are right


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["run", "robot"], "did you mean robot.toml?"),
        (["run", "mine/robot"], "did you mean mine/robot.toml?"),
        (["sweep", "steep.toml", "--over", "worm.load=3"], "steep.toml: sweep.over.worm.load: '3'"),
        (["check", "robto.toml"], "did you mean robot.toml?"),
        (["run", "fast_gaits"], "did you mean fast_gait?"),
        (["run", "fast_gait", "--set", 'kind="gate"'], 'did you mean "gait"?'),
        (["run", "fast_gait", "--set", 'want=["motoin"]'], 'did you mean "motion"?'),
        (["check", "fast_gait", "--set", "want=motion"], 'did you mean ["motion"]?'),
        (["check", "fast_gait", "--set", "units=si"], 'did you mean "SI"?'),
        (
            ["check", "design_fast_gait", "--set", "objective.maximise=sped"],
            '"sped" is not allowed; write "speed"\n',
        ),
        (["run", "fast_gait", "--set", "worm.lod=3"], "worm.lod: unknown key; did you mean load?"),
        (["run", "fast_gait", "--set", "load=3"], "load: unknown key; did you mean worm.load?"),
        (["run", "fast_gait", "--set", "wrom.load=3"], "wrom: unknown key; did you mean worm?"),
        (["run", "fast_gait", "--set", 'gait.shape="fats"'], '"fast"'),
    ],
)
def test_what_may_be_meant_is_said(
    arguments: list[str], hint: str, tmp_path: Path, monkeypatch: Patch, capsys: Capture
):
    monkeypatch.chdir(tmp_path)
    for file in (Path("robot.toml"), Path("mine/robot.toml")):
        file.parent.mkdir(exist_ok=True)
        file.touch()
    shutil.copy(packaged_scenes()["fast_gait"], "steep.toml")
    assert main(arguments) == 2
    assert hint in capsys.readouterr().err


def test_a_table_in_part_keeps_the_other_defaults_of_its_key():
    mesh = wo.load_scene("peristaltic_drag").table.mesh
    changed = wo.load_scene("peristaltic_drag", "mesh.tolerance=1e-5").table.mesh
    assert (mesh.arcs, mesh.degree, mesh.scheme) == (12, 8, "legendre")
    assert changed == mesh.vary(tolerance=1e-5)
    shown = template("peristaltic-drag", "schema.json").partition("#[mesh]")[2]
    assert all(text in shown for text in ("#arcs = 12 ", "#degree = 8 ", '#scheme = "legendre" '))
    assert "| `degree` | a whole number from 1 to 9 | count | `8` |" in page("peristaltic-drag")
