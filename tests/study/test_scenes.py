"""Scenes: what is read."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from tests.oracles.by_text import DESIGN, FILE, GAIT, TRACK, write
from wormopt.errors import ArgumentError
from wormopt.study import Scene, load_scene, packaged_scenes
from wormopt.systems.spiked.gait_design import GaitDesign
from wormopt.systems.spiked.gait_problem import Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.shapes import BlockWave, FastGait
from wormopt.systems.spiked.stepper.stepper import Stepper


def load(folder: Path, text: str, *overrides: str) -> Scene[Any]:
    return load_scene(write(folder, text), overrides)


@pytest.mark.parametrize("name", packaged_scenes())
def test_packaged_scenes_are_right_say_all_and_surprise_nobody(name: str):
    scene = load_scene(name)
    assert scene.warnings == ()
    assert scene.name == name
    assert scene.title != name
    assert "#:schema" not in packaged_scenes()[name].read_text(encoding="utf-8")  # none is there


def test_the_fast_gait_of_the_chapter():
    table = load_scene("fast_gait").table
    assert table.gait == FastGait(period=1.0, rest_length=2.0, elongation=0.15)
    assert (table.worm.drag, table.worm.load, table.worm.masses) == (1.0, 20.0, (1.0,) * 3)


def test_defaults_and_whole_numbers(tmp_path: Path):
    scene = load(tmp_path, GAIT, "gait.period=2")
    assert scene.title == "scene"
    assert scene.folder == tmp_path
    assert scene.table.gait == BlockWave(period=2.0, length=(0.7, 1.3), resting=1)
    assert isinstance(scene.table.gait.period, float)


def test_a_title_keeps_its_letters(tmp_path: Path):
    assert load(tmp_path, 'title = "Größe λ — 1"' + DESIGN).title == "Größe λ — 1"
    assert load_scene(write(tmp_path, b"\xef\xbb\xbf" + DESIGN.encode())).title == "scene"


def test_a_gait_file_is_found_beside_the_scene(tmp_path: Path):
    (tmp_path / "mine.csv").write_text("t,l_0,l_1\n")
    scene = load(tmp_path, FILE, 'gait.file="mine.csv"')
    assert scene.table.gait.file == "mine.csv"
    assert scene.table.gait.period is None


def test_limits_are_spread_over_links():
    limits = Limits(period=(1.0, 2.0), length=((1.0, 2.0), (2.0, 3.0)))
    assert limits.period_range == (1.0, 2.0)
    assert limits.length_ranges(2) == ((1.0, 2.0), (2.0, 3.0))
    assert limits.rate_limits(2) is None
    limits = Limits(
        period=1.0, length=(1.0, 2.0), rate=Rates(contraction=1.0, extension=(2.0, 3.0))
    )
    assert limits.period_range == (1.0, 1.0)
    assert limits.length_ranges(2) == ((1.0, 2.0), (1.0, 2.0))
    assert limits.rate_limits(2) == ((1.0, 1.0), (2.0, 3.0))


def test_tables_made_in_python_are_those_of_scenes():
    limits = Limits(1.0, (0.7, 1.3), rate=Rates(1.0, 0.5), acceleration=20.0)
    assert limits.rate == Rates(contraction=1.0, extension=0.5)
    worm, objective = Worm(2, load=5.0), Objective(maximise="speed")
    made: dict[str, Any] = {"worm": worm, "gait": limits, "objective": objective}
    study = GaitDesign(**made)
    assert study.task(study.objective).limits.rate_limits(2) == ((1.0, 1.0), (0.5, 0.5))
    with_units = Worm.made({"links": 2, "mass": "2 g"})
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"motor": Stepper(lead=0.5)}, "GaitDesign: motor.rate_max: missing"),
        ({"gait": Limits(1.0, (0.7, 1.3))}, "gait.acceleration: missing, so velocities may jump"),
        ({"gait": Objective()}, "gait: Objective.* is not allowed; write a table with period"),
        ({"worm": with_units}, 'worm: was made with units; write units = "SI"'),
    ]
    for changes, said in wrong:
        with pytest.raises(ArgumentError, match=said):
            GaitDesign(**made | changes)


def test_arguments_without_a_name_are_taken_once():
    twice: dict[str, Any] = {"period": 2.0}
    with pytest.raises(ArgumentError, match=r"Limits: name each argument once, as in period=...,"):
        Limits(1.0, (0.7, 1.3), **twice)
    search: Any = Search
    with pytest.raises(ArgumentError, match=r"Search: name each argument once, as in seed=...,"):
        search(0)


def test_the_key_follows_the_content_and_not_its_form(tmp_path: Path):
    scene = load(tmp_path, DESIGN)
    assert scene.key == load(tmp_path, "# a comment\n" + DESIGN, "worm.drag=0").key
    assert scene.key != load(tmp_path, DESIGN, "worm.drag=1").key


def test_a_scene_cannot_be_changed(tmp_path: Path):
    scene = load(tmp_path, DESIGN)
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.name = "other"  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(AttributeError):
        scene.table.worm.links = 3


def test_entries_of_lists_are_set_by_their_index(tmp_path: Path):
    changes = ["tracker.0.growth=7", "tracker[0].tube_radius=0.3", "start.position.1=2.5"]
    table = load(tmp_path, TRACK.replace("[tracker]", "[[tracker]]"), *changes).table
    assert (table.trackers[0].growth, table.trackers[0].tube_radius) == (7.0, 0.3)
    assert table.start.position == (4.0, 2.5, 0.0)
