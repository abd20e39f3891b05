"""`wormopt new`, `schema`, `list` with filters, `completion`: on real files and a real bash."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from hints import Capture, Folders, Patch

import wormopt as wo
from wormopt.cli import main
from wormopt.cli.scenes import SYNONYMS, has_all
from wormopt.kinds import GROUPS, KINDS
from wormopt.study import packaged_scenes
from wormopt.study.reference import schema
from wormopt.study.scene import times_of_scenes

BASH = shutil.which("bash")


def made(kind: str, folder: Path) -> Path:
    path = folder / f"{kind}.toml"
    assert main(["new", kind, "-o", str(path)]) == 0
    return path


def on(text: str) -> str:
    """The same with every key behind a # that shows its value, but in tables behind a #."""
    lines, hidden = [], False
    for line in text.splitlines():
        hidden = (hidden or line.startswith("#[")) and bool(line)
        shown = re.match(r"#(?=\w+ = (?!\.\.\.))", line) and not hidden
        lines.append(line[1:] if shown else line)
    return "\n".join(lines)


@cache
def packaged_texts() -> set[str]:
    return {wo.load_scene(name, title="").text for name in packaged_scenes()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_scene_is_right_and_says_all(kind: str, tmp_path: Path):
    path = made(kind, tmp_path)
    assert main(["check", str(path)]) == 0
    scene, text = wo.load_scene(path), path.read_text(encoding="utf-8")
    assert scene.text in packaged_texts()
    keys = schema(kind)
    jsonschema.Draft202012Validator(keys).validate(tomllib.loads(text))
    # keys behind a # show the value they have when left out
    whole = tmp_path / "whole.toml"
    whole.write_text(on(text), encoding="utf-8")
    assert len(on(text)) < len(text)
    assert wo.load_scene(whole).text == scene.text
    # and all keys of the scene are there
    for key in keys["$defs"][type(scene.table).__name__]["properties"]:
        assert re.search(rf"^#?({key} = |\[+{key}\])", text, re.MULTILINE), key
    assert max(len(line) for line in text.splitlines() if line.startswith("# ")) <= 100


@pytest.mark.parametrize("kind", ["gait", "stepper", "film-flow", "material", "slide"])
def test_a_new_scene_runs(kind: str, tmp_path: Path, capsys: Capture):
    path = made(kind, tmp_path)
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--no-plots", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["status"] == "ok"


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_new_scene_runs(kind: str, tmp_path: Path):
    path = made(kind, tmp_path)
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--no-plots", "--quiet"]) == 0


def test_a_new_scene_names_the_schema_beside_it(tmp_path: Path):
    path, again = made("gait", tmp_path), tmp_path / "again.toml"
    file = tmp_path / "gait.schema.json"
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first == f"#:schema ./{file.name}"
    text = file.read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(schema("gait")))
    # that of an older version is brought up to date
    file.write_text(text.replace("point masses", "masses"), encoding="utf-8")
    assert main(["new", "gait", "-o", str(again)]) == 0
    assert file.read_text(encoding="utf-8") == text


def test_a_file_that_is_no_schema_of_ours_is_kept(tmp_path: Path, capsys: Capture):
    (tmp_path / "gait.schema.json").write_text("{}")
    assert main(["new", "gait", "-o", str(tmp_path / "mine.toml")]) == 2
    assert "gait.schema.json: is there already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["gait.schema.json"]
    assert (tmp_path / "gait.schema.json").read_text() == "{}"


def test_nothing_is_written_over(tmp_path: Path, monkeypatch: Patch, capsys: Capture):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "gait"]) == 0
    kept = Path("gait.toml").read_text(encoding="utf-8") + "# mine\n"
    Path("gait.toml").write_text(kept, encoding="utf-8")
    assert main(["new", "gait"]) == 2
    assert "gait.toml: is there already" in capsys.readouterr().err
    assert Path("gait.toml").read_text(encoding="utf-8") == kept
    Path("folder.toml").mkdir()
    Path("link.toml").symlink_to("gait.toml")
    for name in ("folder.toml", "link.toml", "gait.txt", "gait.toml/a.toml", "a\0.toml"):
        assert main(["new", "stepper", "-o", name]) == 2
    assert wo.load_scene("gait.toml").table.kind == "gait"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "folder.toml", "gait.schema.json", "gait.toml", "link.toml",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "arguments", [["new", "gate"], ["schema", "gate"], ["list", "--kind", "gate"]]
)
def test_a_kind_that_is_none_is_hinted_at(arguments: list[str], capsys: Capture):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "did you mean gait?" in capsys.readouterr().err


def test_a_schema_is_written_once(tmp_path: Path, capsys: Capture):
    command = ["schema", "gait", "-o", str(tmp_path / "gait.json")]
    assert main(command) == 0
    assert main(command) == 0  # what is the same already is no obstacle
    (tmp_path / "gait.json").write_text("mine")
    assert main(command) == 2
    assert "gait.json: is there already" in capsys.readouterr().err


def test_the_list_is_filtered(capsys: Capture):
    def listed(*words: str) -> str:
        assert main(["list", *words]) == 0
        return capsys.readouterr().out

    out = listed("--kind", "gait")
    assert re.findall(r"^    (\w+) ", out, re.M) == ["fast_gait", "gait_region", "uphill_gait"]
    assert re.findall(r"^  (\S+):", out, re.M) == ["gait"]
    out = listed("FLUID", "wave")
    assert "film-wave" in out
    assert "fast_gait" not in out
    assert re.findall(r"^\w.*", out, re.M) == ["Magnetic films", "Coils"]
    assert main(["list", "no_such_word"]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert "no packaged scene" in said.err


def test_every_packaged_scene_has_a_time(capsys: Capture):
    assert {*times_of_scenes()} == {*packaged_scenes()}, "measure it: .ci/gallery"
    assert main(["list", "fast_gait"]) == 0
    assert re.search(r"  gait: .*\n    fast_gait +1 s  ", capsys.readouterr().out)


def test_every_kind_is_in_one_group():
    assert sorted(kind for kinds in GROUPS.values() for kind in kinds) == sorted(KINDS)


def test_the_list_is_in_json_too(capsys: Capture):
    assert main(["list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {kind["name"] for kind in found["kinds"]} == {*KINDS}
    assert {scene["name"] for scene in found["scenes"]} == {*packaged_scenes()}
    (fast,) = (scene for scene in found["scenes"] if scene["name"] == "fast_gait")
    assert (fast["kind"], fast["group"]) == ("gait", "Spiked worms and gaits")
    assert fast["seconds"] == 1
    assert main(["list", "--json", "no_such_word"]) == 0
    assert json.loads(capsys.readouterr().out) == {"kinds": [], "scenes": []}


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("snake", "planar-serpenoid"),
        ("ferrofluid", "film-wave"),
        ("optimize", "optimal-crawl"),
        ("Earthworm", "peristaltic-worm"),
        ("mpc", "track-predictive"),
        ("identification", "fit"),
    ],
)
def test_the_list_is_searched_by_synonyms(word: str, kind: str, capsys: Capture):
    assert main(["list", word]) == 0
    assert f"\n  {kind}: " in capsys.readouterr().out


def test_every_synonym_is_a_word_of_the_list():
    summaries = (f"{name} {kind.summary}" for name, kind in KINDS.items())
    listed = " ".join([*GROUPS, *summaries, *packaged_scenes()])
    for word, meant in SYNONYMS.items():
        assert word == word.casefold()
        assert not [each for each in meant.split() if not has_all([each], listed)], word


@pytest.fixture(scope="module")
def script(tmp_path_factory: Folders) -> Path:
    path = tmp_path_factory.mktemp("completion") / "wormopt.bash"
    command = [sys.executable, "-m", "wormopt", "completion", "bash"]
    path.write_bytes(subprocess.run(command, capture_output=True, check=True).stdout)
    return path


@pytest.mark.skipif(not BASH, reason="there is no bash")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("ru", {"run"}),
        ("run fast_g", {"fast_gait"}),
        ("run fast_gait --no-p", {"--no-plots"}),
        ("run mine/wa", {"mine/walk.toml"}),
        ("check fast_gait uphill", {"uphill_gait"}),
        ("new gait-", {"gait-design", "gait-pareto", "gait-shift"}),
        ("schema film-fo", {"film-forward"}),
        ("list --kind coil-r", {"coil-row"}),
        ("completion z", {"zsh"}),
    ],
)
def test_bash_completes(script: Path, tmp_path: Path, words: str, offered: set[str]):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "walk.toml").touch()
    (tmp_path / "mine" / "water.txt").touch()
    asked = ["wormopt", *words.split()]
    program = f"""
        source {script}
        name=$(complete -p wormopt | sed 's/.*-F \\([^ ]*\\).*/\\1/')
        COMP_WORDS=({" ".join(asked)}) COMP_CWORD={len(asked) - 1}
        $name wormopt {asked[-1]} {asked[-2]}
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    assert BASH
    done = subprocess.run([BASH, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert set(done.stdout.split()) == offered, done.stderr


@pytest.mark.parametrize("shell", ["zsh", "tcsh", "fish"])
def test_scripts_of_other_shells_are_read_by_them(shell: str, tmp_path: Path):
    program = shutil.which(shell)
    if not program:
        pytest.skip(f"there is no {shell}")
    command = [sys.executable, "-m", "wormopt", "completion", shell]
    text = subprocess.run(command, capture_output=True, check=True, text=True).stdout
    (tmp_path / "script").write_text(text)
    assert "fast_gait" in text
    done = subprocess.run([program, "-n", str(tmp_path / "script")], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("shell", ["fish", "powershell"])
def test_scripts_complete_scenes_and_kinds(shell: str, capsys: Capture):
    assert main(["completion", shell]) == 0
    out = capsys.readouterr().out
    assert "fast_gait" in out
    assert "film-forward" in out
