"""Scenes: what is read, and that nothing wrong gets through or ends in a traceback."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from effort import examples
from hypothesis import given, settings
from places import SAVED

from wormopt.cli import main
from wormopt.errors import ArgumentError, SceneError
from wormopt.study import Scene, load_scene, packaged_scenes
from wormopt.systems.spiked.gait_design import GaitDesign
from wormopt.systems.spiked.gait_problem import Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.shapes import BlockWave, FastGait
from wormopt.systems.spiked.stepper.stepper import Stepper

DESIGN = """
schema = 1
kind = "gait-design"
[worm]
links = 2
mass = 1.0
[gait]
period = 1.0
length = [0.7, 1.3]
rate = 1.0
acceleration = 20.0
[objective]
maximise = "speed"
"""
GAIT = """
schema = 1
kind = "gait"
[worm]
links = 2
mass = 1.0
[gait]
shape = "block_wave"
period = 1.0
length = [0.7, 1.3]
"""
FAST = GAIT.replace("block_wave", "fast").replace("length = [0.7, 1.3]", "")
FILE = FAST.replace('"fast"', '"file"').replace("period = 1.0", "")
PARETO = DESIGN.replace("gait-design", "gait-pareto").replace(
    '[objective]\nmaximise = "speed"', '[pareto]\nagainst = "peak_spike_load"'
)

SWINGING = """
schema = 1
kind = "harmonic-masses"
[worm]
masses = 2
friction = { kind = "coulomb", forward = 0.1, backward = 0.2 }
[[worm.harmonic]]
amplitude = 1.0
phase = [0, 180]
"""

MATERIAL = """
schema = 1
kind = "material"
units = "SI"
[material]
field = 1.5e5
u0 = 0.071
youngs_modulus_eff = 1.6e4
"""
FLOAT = """
schema = 1
kind = "float"
[film]
delta = 0.5
[floats]
length = [0.0, 0.5]
"""

# Base scene, change (as for --set; a bare key is taken out), key path and part of the message.
HOSTILE = [
    # unknown keys and values
    (DESIGN, "worm.lode=1", "worm.lode", "did you mean load"),
    (DESIGN, "gait.zzz=1", "gait.zzz", "allowed here: period"),
    (DESIGN, "nonsense=1", "nonsense", "unknown key"),
    (DESIGN, "pareto.points=3", "pareto", "unknown key"),
    (DESIGN, "schema=2", "schema", "write 1"),
    (DESIGN, "schema=true", "schema", "write 1"),
    (DESIGN, "schema", "schema", "missing"),
    (DESIGN, 'kind="gait-desing"', "kind", '"gait-design"'),
    (DESIGN, "kind=3", "kind", '"gait-design"'),
    (DESIGN, "kind=[]", "kind", '"gait-design"'),
    (DESIGN, "kind", "kind", "missing"),
    (DESIGN, 'units="cgs"', "units", '"SI"'),
    (DESIGN, 'want=["gaits"]', "want[0]", '"motion"'),
    (DESIGN, 'want="gait"', "want", "a list"),
    (DESIGN, 'want=["gait", "gait"]', "want", "twice"),
    (PARETO, 'want=["animation"]', "want[0]", '"front"'),
    (DESIGN, "title=1", "title", "text in quotes"),
    (DESIGN, 'title="a\\nb"', "title", "one line"),
    # wrong types and numbers
    (DESIGN, "worm=3", "worm", "a table"),
    (DESIGN, "gait=[]", "gait", "a table"),
    (DESIGN, "worm.links=2.0", "worm.links", "a whole number"),
    (DESIGN, "worm.links=true", "worm.links", "a whole number"),
    (DESIGN, "worm.links=0", "worm.links", "1 to 32"),
    (DESIGN, "worm.links=33", "worm.links", "1 to 32"),
    (DESIGN, f"worm.links={10**30}", "worm.links", "1 to 32"),
    (DESIGN, "worm.links", "worm.links", "missing"),
    (DESIGN, "worm.mass=-1", "worm.mass", "above 0"),
    (DESIGN, "worm.mass=0", "worm.mass", "above 0"),
    (DESIGN, "worm.mass=true", "worm.mass", "above 0"),
    (DESIGN, "worm.mass=nan", "worm.mass", "finite"),
    (DESIGN, "worm.mass=inf", "worm.mass", "finite"),
    (DESIGN, "worm.mass=1e999", "worm.mass", "finite"),
    (DESIGN, f"worm.mass={10**400}", "worm.mass", "finite"),
    (DESIGN, "worm.mass=1979-05-27", "worm.mass", "finite"),
    (DESIGN, "worm.mass=[1, 1]", "worm.mass", "2 entries for 3 masses"),
    (DESIGN, "worm.mass=[1, -1, 1]", "worm.mass[1]", "-1 is not allowed"),
    (DESIGN, "worm.mass=[1, nan, 1]", "worm.mass[1]", "nan is not allowed"),
    (DESIGN, "worm.mass=[]", "worm.mass", "0 entries for 3 masses"),
    (DESIGN, "worm.mass={a=1}", "worm.mass", "a table is not allowed"),
    (DESIGN, "worm.drag=-0.1", "worm.drag", "0 or above"),
    (DESIGN, "worm.load=-inf", "worm.load", "0 or above"),
    # gait limits
    (DESIGN, "gait.period=0", "gait.period", "above 0"),
    (DESIGN, "gait.period=[2, 1]", "gait.period", "empty"),
    (DESIGN, "gait.period=[1, 2, 3]", "gait.period", "[smallest, largest]"),
    (DESIGN, "gait.length=[1.3, 0.7]", "gait.length", "empty"),
    (DESIGN, "gait.length=[1, 1]", "gait.length", "empty"),
    (DESIGN, "gait.length=[0, 1]", "gait.length[0]", "above 0"),
    (DESIGN, "gait.length=[1]", "gait.length", "2 such pairs"),
    (DESIGN, "gait.length=1", "gait.length", "such pairs"),
    (DESIGN, "gait.length=[]", "gait.length", "2 such pairs"),
    (DESIGN, "gait.length=[[1, 2]]", "gait.length", "2 such pairs"),
    (DESIGN, "gait.length=[1, [1, 2]]", "gait.length", "2 such pairs"),
    (DESIGN, "gait.length=[[1, 2], [2, 1]]", "gait.length[1]", "empty"),
    (DESIGN, "gait.length=[[1, 2], [1, 2, 3]]", "gait.length[1]", "such pairs"),
    (DESIGN, "gait.resting=3", "gait.resting", "at most 2"),
    (DESIGN, "gait.resting=0", "gait.resting", "1 or above"),
    (DESIGN, "gait.rate=[1]", "gait.rate", "1 entry for 2 links"),
    (DESIGN, "gait.rate={contraction=1}", "gait.rate.extension", "missing"),
    (DESIGN, "gait.rate={contraction=-1, extension=1}", "gait.rate.contraction", "above 0"),
    (
        DESIGN,
        "gait.rate={contraction=1, extension=[1, 2, 3]}",
        "gait.rate.extension",
        "3 entries for 2 links",
    ),
    (DESIGN, "gait.acceleration=[1, 2, 3]", "gait.acceleration", "3 entries for 2 links"),
    (DESIGN, "gait.spike_load=[1, 2]", "gait.spike_load", "2 entries for 3 masses"),
    (DESIGN, "gait.actuator_force=[1]", "gait.actuator_force", "1 entry for 2 links"),
    (DESIGN, "gait.sigma_margin=-1", "gait.sigma_margin", "0 or above"),
    (DESIGN, 'gait.sharing="fair"', "gait.sharing", '"least_actuation"'),
    (DESIGN, "gait.impulses=1", "gait.impulses", "true or false"),
    (DESIGN, "gait.acceleration", "gait.acceleration", "velocities may jump"),
    (DESIGN, "gait.impulses=true", "gait.impulses", "remove one of them"),
    # objective and search
    (DESIGN, "objective={}", "objective", "no objective"),
    (DESIGN, "objective", "objective", "missing"),
    (DESIGN, 'objective.maximise="load"', "objective.maximise", '"speed"'),
    (DESIGN, 'objective.minimise="peak_spike_load"', "objective", "maximise and minimise"),
    (DESIGN, 'objective={minimise="peak_spike_load"}', "objective.speed", "missing"),
    (DESIGN, "objective.speed=0.5", "objective.speed", "remove one of them"),
    (DESIGN, 'objective={minimise="energy_per_distance", speed=0}', "objective.speed", "above 0"),
    (DESIGN, "search.seed=-1", "search.seed", "a whole number from 0"),
    (DESIGN, 'search.effort="max"', "search.effort", '"thorough"'),
    (DESIGN, "search.phases=1", "search.phases", "2 to 64"),
    (DESIGN, "search.workers=0", "search.workers", "1 to 1024"),
    (DESIGN, "search.sequence=[[0]]", "search.sequence", "two"),
    (DESIGN, "search.sequence=[[0], [3]]", "search.sequence[1]", "indices 0 to 2"),
    (DESIGN, "search.sequence=[[0], [-1]]", "search.sequence[1][0]", "-1 is not allowed"),
    (DESIGN, "search.sequence=[[0], [0]]", "search.sequence[0]", "the same masses"),
    (DESIGN, "search.sequence=[[0], [1], [0]]", "search.sequence[0]", "the same masses"),
    (DESIGN, "search.sequence=[[0], [1, 1]]", "search.sequence[1]", "twice"),
    (DESIGN, "search.sequence=[[0], []]", "search.sequence[1]", "fewer resting masses"),
    (DESIGN, "search={phases=2, sequence=[[0], [1], [2]]}", "search.sequence", "search.phases = 2"),
    (PARETO, "pareto.points=2", "pareto.points", "3 to 50"),
    (PARETO, 'pareto.against="speed"', "pareto.against", '"energy_per_distance"'),
    # given gaits
    (GAIT, 'gait.shape="wave"', "gait.shape", '"block_wave"'),
    (GAIT, "gait.shape", "gait.shape", "missing"),
    (GAIT, "gait.shape=[1]", "gait.shape", "not allowed"),
    (GAIT, "gait.elongation=0.1", "gait.elongation", 'with shape = "block_wave"'),
    (GAIT, "gait.resting=3", "gait.resting", "at most 2"),
    (GAIT, "gait.length=[2, 1]", "gait.length", "empty"),
    (GAIT, "gait.length", "gait.length", "missing"),
    (GAIT, 'gait.profile="trapezoid"', "gait.ramp", "missing"),
    (GAIT, "gait.ramp=0.1", "gait.ramp", "no ramp"),
    (GAIT, 'gait={shape="accordion", period=1, length=[1, 2], resting=1}', "gait.resting", "shape"),
    (
        GAIT,
        'gait={shape="accordion", period=1, length=[1, 2], profile="trapezoid", ramp=0.6}',
        "gait.ramp",
        "0 to 0.5",
    ),
    (FAST, "gait.elongation=0.5", "gait.elongation", "below 0.5"),
    (FAST, "worm.links=3", "gait.shape", "2 links"),
    (FAST, "gait.length=[1, 2]", "gait.length", 'with shape = "fast"'),
    (FAST, "gait.period", "gait.period", "missing"),
    (FILE, 'gait.file="no.csv"', "gait.file", "cannot be read"),
    (FILE, 'gait.file="scene.toml"', "gait.file", "no known suffix"),
    (FILE, 'gait.file="sub.csv"', "gait.file", "cannot be read"),
    (FILE, 'gait.file="a\\u0000.csv"', "gait.file", "cannot be read"),
    (FILE, 'gait.file=""', "gait.file", "name of a .csv or .nc file"),
    (FILE, "schema=1", "gait.file", "missing"),
    # materials
    (MATERIAL, "units", "units", 'units = "SI"'),
    (MATERIAL, "material.u0=-0.1", "material.u0", "above 0"),
    (MATERIAL, "material.u0", "material.u0", "missing"),
    (MATERIAL, "material.field", "material.field", "missing"),
    (MATERIAL, "material.mu_r=2.0", "material", "not both"),
    (MATERIAL, "material", "material", "missing"),
    # the changes themselves
    (DESIGN, "worm.links=three", "worm.links", "whole number"),
    (DESIGN, "worm.links=", "worm.links", "in quotes"),
    (DESIGN, "worm.links=3\nb=4", "worm.links", "in quotes"),
    (DESIGN, "worm..links=3", "worm..links", "key=value"),
    (DESIGN, "=3", "--set", "key=value"),
    (DESIGN, "kind.name=3", "kind.name", "not a table"),
    (DESIGN, 'title="\udcff"', "title", "in quotes"),
    (DESIGN, "worm.mass=" + "[" * 5000 + "]" * 5000, "worm.mass", ""),
]

HOSTILE_FILES = [
    (b"schema = ", "not valid TOML"),
    (b"schema = 1\nschema = 1", "not valid TOML"),
    (b"[worm]\n[worm]", "not valid TOML"),
    (b"\xff\xfe", "not UTF-8"),
    (b"a = " + b"[" * 20000, "nested too deeply"),
    (b"a = " + b"9" * 5000, "not valid TOML"),
    (b"\x00", "not valid TOML"),
    (b"", "kind: missing"),
    (b"[[kind]]", "kind: "),
]


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "sub.csv").mkdir(exist_ok=True)
    return path


def changed(text: str, change: str) -> tuple[str, list[str]]:
    """Scene text and overrides for one entry of HOSTILE."""
    if "=" in change:
        return text, [change]
    last = change.split(".")[-1]
    if f"[{last}]" in text:
        return text[: text.index(f"[{last}]")], []
    return "\n".join(line for line in text.splitlines() if not line.startswith(f"{last} =")), []


def load(folder: Path, text: str, *overrides: str) -> Scene[Any]:
    return load_scene(write(folder, text), overrides)


@pytest.mark.parametrize(("text", "change", "key", "message"), HOSTILE)
def test_a_wrong_scene_is_refused_with_file_and_key(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    change: str,
    key: str,
    message: str,
):
    text, overrides = changed(text, change)
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    assert any(key == found and message in said for found, said in caught.value.faults), caught
    sets = [word for override in overrides for word in ("--set", override)]
    assert main(["run", str(path), "-o", str(tmp_path / "out"), *sets]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert f"{path}: {key}: " in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("content", "message"), HOSTILE_FILES)
def test_a_wrong_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes, message: str
):
    path = write(tmp_path, content)
    assert main(["check", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{path}: ")
    assert message in err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such.toml", "no such file"),
        ("design_fast_gate", "did you mean design_fast_gait"),
        ("", "not a file"),
        (".", "not a file"),
        ("a\0b", "no such file"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_a_missing_file_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    message: str,
):
    monkeypatch.chdir(tmp_path)
    assert main(["run", name]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root reads every file")
def test_an_unreadable_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write(tmp_path, DESIGN)
    path.chmod(0)
    assert main(["check", str(path)]) == 2
    assert "cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content", [b"schema = ", b'schema = 1\nkind = "gait"\n[worm]\nmass = nan']
)
def test_a_process_ends_with_two_and_no_traceback(tmp_path: Path, content: bytes):
    path = write(tmp_path, content)
    command = [sys.executable, "-m", "wormopt", "run", str(path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert str(path) in done.stderr
    assert "Traceback" not in done.stderr


def test_all_faults_are_found_at_once(tmp_path: Path):
    text = DESIGN.replace("mass = 1.0", "mass = -1\nlode = 3").replace("[0.7, 1.3]", "true")
    with pytest.raises(SceneError) as caught:
        load(tmp_path, text + "speed = nan\n[search]\nseed = 0.5")
    assert {key for key, _ in caught.value.faults} == {
        "worm.mass",
        "worm.lode",
        "gait.length",
        "objective.speed",
        "search.seed",
    }
    assert len(str(caught.value).splitlines()) == 5


@pytest.mark.parametrize(
    "changes",
    [  # within tables, and, once each table is right, between them
        {"worm.mass": "[1]", "objective.speed": "1", "gait.period": "[2, 1]"},
        {"gait.resting": "3", "gait.length": "[2, 1]"},
    ],
)
def test_all_faults_across_keys_are_found_at_once(changes: dict[str, str], tmp_path: Path):
    with pytest.raises(SceneError) as caught:
        load(tmp_path, DESIGN, *(f"{key}={value}" for key, value in changes.items()))
    assert {key for key, _ in caught.value.faults} == set(changes)


@pytest.mark.parametrize(
    "change",
    [
        'objective={minimise="peak_spike_load", speed=0.1}',
        'objective={minimise="peak_actuator_force", speed=0.1}',
        'objective={minimise="energy_per_distance", speed=0.1}',
        'objective={minimise="acceleration_effort", speed=0.1}',
        "gait.actuator_force=10",
        "gait.spike_load=30",
    ],
)
def test_impulses_exclude_what_they_make_infinite(tmp_path: Path, change: str):
    text = DESIGN.replace("acceleration = 20.0", "impulses = true")
    load(tmp_path, text)
    with pytest.raises(SceneError, match="impulse"):
        load(tmp_path, text, change)


def test_a_front_over_a_cost_needs_finite_forces(tmp_path: Path):
    with pytest.raises(SceneError, match="no finite value"):
        load(tmp_path, PARETO.replace("acceleration = 20.0", "impulses = true"))


@pytest.mark.parametrize("cost", ["energy_per_distance", "acceleration_effort"])
def test_a_smooth_cost_needs_one_load(tmp_path: Path, cost: str):
    said = f"{cost} depends on the load, and worm.load is a range"
    own = f'objective={{minimise="{cost}", speed=0.1}}'
    with pytest.raises(SceneError, match=f"objective.minimise: {said}"):
        load(tmp_path, DESIGN, own, "worm.load=[1, 2]")
    with pytest.raises(SceneError, match=f"pareto.against: {said}"):
        load(tmp_path, PARETO, f'pareto.against="{cost}"', "worm.load=[1, 2]")


def test_a_mass_that_never_moves_is_refused(tmp_path: Path):
    with pytest.raises(SceneError, match="mass 0 rests in every phase"):
        load(tmp_path, DESIGN, "search.sequence=[[0,1],[0,2]]")


def test_links_of_no_limit_are_refused(tmp_path: Path):
    text = DESIGN.replace("acceleration = 20.0", "").replace("rate = 1.0", "impulses = true")
    with pytest.raises(SceneError, match=r"neither gait\.rate nor gait\.acceleration"):
        load(tmp_path, text)


# What a scene may hold anywhere, the worst included.
VALUES = st.recursive(
    st.sampled_from(
        'nan inf -inf true "" "speed" "λ" "\\u0000" 1e308 1e-308 -0.0 0 1 -1 2.5 [] {} 1979-05-27 '
        "1180591620717411303424".split()
    ),
    lambda inner: st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=6,
)
KEYS = st.sampled_from(
    "schema kind title units want worm gait search objective pareto worm.links worm.mass worm.drag "
    "worm.load gait.period gait.length gait.resting gait.rate gait.rate.contraction "
    "gait.acceleration gait.spike_load gait.impulses gait.shape gait.profile gait.ramp gait.file "
    "objective.minimise objective.speed search.sequence search.seed search.phases "
    "pareto.points material material.field material.mu_r material.lame_eta material.u0 "
    "material.youngs_modulus_eff sample strain worm.masses worm.harmonic worm.harmonic.0.phase "
    "worm.harmonic.0.amplitude worm.harmonic.0.order worm.friction worm.frequency "
    "time.periods".split()
)


@settings(max_examples=examples(300))
@given(
    text=st.sampled_from([DESIGN, GAIT, FAST, FILE, PARETO, MATERIAL, SWINGING]),
    changes=st.lists(st.tuples(KEYS, VALUES), max_size=3),
)
def test_any_scene_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, changes: list[tuple[str, str]]
):
    folder = tmp_path_factory.mktemp("scene")
    try:
        scene = load(folder, text, *(f"{key}={value}" for key, value in changes))
    except SceneError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{folder / 'scene.toml'}: ")
    else:
        assert "NaN" not in scene.text
        assert "Infinity" not in scene.text


@given(content=st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_file_is_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes):
    path = write(tmp_path_factory.mktemp("scene"), content)
    with pytest.raises(SceneError, match=r"scene\.toml"):
        load_scene(path)


@pytest.mark.parametrize("name", packaged_scenes())
def test_packaged_scenes_are_right_and_say_all(name: str):
    scene = load_scene(name)
    assert scene.name == name
    assert scene.title != name


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


def test_a_result_is_told_from_a_scene():
    with pytest.raises(SceneError, match=r"is a result, not a scene; `wormopt show`"):
        load_scene(SAVED / "fit_pair.nc")
