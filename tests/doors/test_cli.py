"""The command line: what it prints, what it writes, what it refuses. The study is a stand-in."""

import dataclasses
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from threading import Timer
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hints import Capture, Patch

from wormopt import progress
from wormopt.__main__ import start
from wormopt.cli import main
from wormopt.errors import Interrupted, SceneError, SolveError, interruptible
from wormopt.kinds import KINDS
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.study import Scene
from wormopt.study.output import default_folder

Study = Callable[[Scene[Any], Report], Result]
Install = Callable[[Study], None]

PICTURES = {"gait.png", "motion.png", "spikes.png"}
NUMBERS = {"result.nc", "summary.json"}
SWALLOWS = """
import contextlib, signal
with contextlib.suppress(BaseException):
    signal.raise_signal(signal.SIGINT)
"""


def found(scene: Scene[Any], **changes: Any) -> Result:
    result = Result(
        scene=scene.name,
        kind=scene.table.kind,
        title=scene.title,
        scalars={
            "speed": Scalar(scene.table.worm.load / 10, "m s-1"),
            "gap": Scalar(float("nan")),
            "mode_sequence": Scalar([[0], [1, 2]]),
        },
        variables=(Variable("time", "s", ("time",), np.linspace(0, 1, 3)),),
        trust={"passed": True},
        timings_s={"solve": 0.5},
        scene_text=scene.text,
    )
    return dataclasses.replace(result, **changes)


def solve(scene: Scene[Any], report: Report) -> Result:
    report("solving", None)
    report("solving", 0.5)
    return found(scene)


def never(scene: Scene[Any], report: Report) -> Result:
    raise AssertionError("the study was started")


@pytest.fixture(autouse=True)
def study(tmp_path: Path, monkeypatch: Patch) -> Install:
    """Stand-ins for the study of kind "gait" and for the drawing, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    plot = ModuleType("wormopt.pictures")
    plot.__dict__["draw"] = lambda result, name, path: path.write_text(name)
    monkeypatch.setitem(sys.modules, plot.__name__, plot)

    def install(function: Study) -> None:
        def result(study: Any, report: Report) -> Result:
            return function(study.scene, report)

        monkeypatch.setattr(KINDS["gait"].load(), "result", result)

    install(solve)
    return install


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def speed_in(folder: Path) -> float:
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert Result.load(folder).scalars["speed"].value == summary["scalars"]["speed"]["value"]
    return summary["scalars"]["speed"]["value"]


def test_run_writes_numbers_and_pictures(tmp_path: Path, capsys: Capture):
    assert main(["run", "fast_gait"]) == 0
    folder = tmp_path / "results" / "fast_gait"
    assert names(folder) == NUMBERS | PICTURES
    assert names(tmp_path / "results") == {"fast_gait"}
    out, err = capsys.readouterr()
    assert err == ""
    assert "Fast gait (15)" in out
    assert "  speed          2 m s-1\n" in out
    assert "gap  unknown" in out
    assert str(folder) in out
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["table"]["gait"]["elongation"] == pytest.approx(0.15, rel=1e-12)
    assert summary["title"] == "Fast gait (15) of a three-mass worm"


def test_json_prints_one_object_and_no_nan(capsys: Capture):
    assert main(["run", "fast_gait", "--json"]) == 0
    out, _ = capsys.readouterr()
    printed = json.loads(out)
    assert printed.keys() == {"scene", "kind", "status", "scalars", "trust", "timings_s"}
    assert (printed["scene"], printed["kind"], printed["status"]) == ("fast_gait", "gait", "ok")
    assert printed["scalars"] == {
        "speed": {"value": 2.0, "unit": "m s-1"},
        "gap": {"value": None, "unit": "1"},
        "mode_sequence": {"value": [[0], [1, 2]], "unit": "1"},
    }
    assert printed["timings_s"].keys() == {"solve", "study"}


def test_set_changes_the_scene_and_o_the_folder(tmp_path: Path):
    change = ["--set", "worm.load=30", "--set", 'want=["animation"]']
    assert main(["run", "fast_gait", "-o", "a/b", *change]) == 0
    assert names(tmp_path / "a" / "b") == NUMBERS | {"animation.gif"}
    assert speed_in(tmp_path / "a" / "b") == 3.0


def test_no_plots_draws_nothing(tmp_path: Path):
    assert main(["run", "fast_gait", "--no-plots"]) == 0
    assert names(tmp_path / "results" / "fast_gait") == NUMBERS


def test_a_rerun_replaces_its_own_files_and_keeps_others(tmp_path: Path):
    folder = tmp_path / "results" / "fast_gait"
    assert main(["run", "fast_gait"]) == 0
    (folder / "notes.txt").write_text("mine")
    (folder / "sub").mkdir()
    changes = ["--set", "worm.load=30", "--set", 'want=["gait"]']
    assert main(["run", "fast_gait", *changes, "-o", str(folder)]) == 0
    assert names(folder) == NUMBERS | {"gait.png", "notes.txt", "sub"}
    assert speed_in(folder) == 3.0


def run_to(path: Path, *more: str) -> None:
    main(["run", "fast_gait", "-o", str(path), *more])


def put(path: Path, text: str = "mine") -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)


OVER = ["--over", "worm.load=[2]", "--engine", "serial", "-o"]
FOREIGN: dict[str, Callable[[Path], object]] = {
    "file": put,
    "foreign summary": lambda path: put(path / "summary.json", '{"scene": "fast_gait"}'),
    "broken summary": lambda path: put(path / "summary.json", '[["scene"'),
    "own picture": lambda path: (run_to(path, "--no-plots"), put(path / "gait.png")),
    "changed result": lambda path: (run_to(path), put(path / "gait.png", "with remarks of mine")),
}
FORCED: dict[str, Callable[[Path], object]] = {
    "foreign folder": lambda path: put(path / "notes.txt"),
    "other result": lambda path: main(["run", "uphill_gait", "-o", str(path)]),
    "sweep": lambda path: main(["sweep", "fast_gait", *OVER, str(path)]),
}


def contents(path: Path) -> dict[str, bytes]:
    files = [path] if path.is_file() else path.rglob("*")
    return {str(file): file.read_bytes() for file in files if file.is_file()}


@pytest.mark.parametrize("there", [*FOREIGN, *FORCED])
def test_what_is_in_the_way_is_refused_before_the_work(
    tmp_path: Path, capsys: Capture, study: Install, there: str
):
    """And what is no result of ours is never replaced."""
    path = tmp_path / "out"
    (FOREIGN | FORCED)[there](path)
    capsys.readouterr()
    before = contents(path)
    study(never)
    assert main(["run", "fast_gait", "-o", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert str(path) in err
    assert ("--force" in err) == (there in FORCED)
    assert there in FORCED or main(["run", "fast_gait", "-o", str(path), "--force"]) == 2
    assert contents(path) == before
    assert names(tmp_path) == {"out"}


@pytest.mark.parametrize("there", FORCED)
def test_force_replaces_results_and_keeps_other_files(tmp_path: Path, there: str):
    path = tmp_path / "out"
    FORCED[there](path)
    run_to(path, "--force")
    assert speed_in(path) == 2.0
    assert names(path) - {"notes.txt", "points"} == NUMBERS | PICTURES
    assert there != "foreign folder" or (path / "notes.txt").read_text() == "mine"


def test_trials_with_other_keys_have_folders_of_their_own(tmp_path: Path):
    assert main(["run", "fast_gait", "--no-plots"]) == 0
    assert main(["run", "fast_gait", "--no-plots", "--set", "worm.load=30"]) == 0
    assert main(["run", "fast_gait", "--no-plots", "--set", f'title="{"x/" * 99}"']) == 0
    plain, loaded, titled = sorted((tmp_path / "results").iterdir(), key=lambda f: len(f.name))
    assert (plain.name, loaded.name) == ("fast_gait", "fast_gait,worm.load=30")
    assert titled.name.startswith("fast_gait,title=_x_x")
    assert (speed_in(plain), speed_in(loaded)) == (2.0, 3.0)


def test_what_appears_while_a_scene_runs_is_kept_and_so_is_the_result(
    tmp_path: Path, capsys: Capture, study: Install
):
    def meanwhile(scene: Scene, report: Report) -> Result:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "result.nc").write_text("mine")
        return Result(scene.name, "gait")

    study(meanwhile)
    assert main(["run", "fast_gait", "--no-plots", "-o", "out"]) == 2
    assert (tmp_path / "out" / "result.nc").read_text() == "mine"
    (spare,) = (path for path in tmp_path.iterdir() if path.name.startswith("out-"))
    assert f"the result is in {spare}" in capsys.readouterr().err
    assert Result.load(spare).scene == "fast_gait"


def test_what_another_program_holds_open_on_windows_is_refused_and_costs_no_result(
    tmp_path: Path, capsys: Capture, study: Install, monkeypatch
):
    assert main(["run", "fast_gait", "-o", "out"]) == 0
    before, replace = (tmp_path / "out" / "result.nc").read_bytes(), Path.replace

    def held(path: Path, to: Path) -> Path:
        if to.name == "spikes.png":
            raise PermissionError(13, "The process cannot access the file")
        return replace(path, to)

    def meanwhile(scene: Scene, report: Report) -> Result:
        monkeypatch.setattr(Path, "replace", held)
        return found(scene)

    study(meanwhile)
    assert main(["run", "fast_gait", "-o", "out", "--no-plots"]) == 2
    assert "spikes.png: cannot be replaced; close the program" in capsys.readouterr().err
    assert (tmp_path / "out" / "result.nc").read_bytes() == before
    (spare,) = (path for path in tmp_path.iterdir() if path.name.startswith("out-"))
    assert Result.load(spare).scene == "fast_gait"
    study(never)
    assert main(["run", "fast_gait", "-o", "out"]) == 2


def test_names_of_folders_do_not_end_in_dots_which_windows_drops():
    assert default_folder("fast_gait", ["title=etc."]).name == "fast_gait,title=etc"


FILES = ["result.nc", "summary.json", "gait.png", "motion.png", "spikes.png", "notes.txt", "a.csv"]


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(n, marks=pytest.mark.slow) for n in range(2, 20))]
)
def test_foreign_files_survive_fifty_random_runs_with_force(
    tmp_path: Path, study: Install, seed: int
):
    """A thousand in all: files come, go, and are changed between runs of several scenes."""
    study(lambda scene, _: Result(scene.name, scene.table.kind))
    draw, mine = random.Random(seed), {}
    for k in range(50):
        folder = tmp_path / draw.choice(["b"] if (tmp_path / "a").is_file() else ["a", "b", "a/b"])
        file = folder / draw.choice(FILES)
        if draw.random() < 0.5 and not folder.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            mine[file] = f"mine {k}"
            file.write_text(mine[file])
        elif draw.random() < 0.1 and not folder.exists():
            mine[folder] = "a file"
            folder.parent.mkdir(exist_ok=True)
            folder.write_text("a file")
        elif draw.random() < 0.2 and file in mine:
            file.unlink()
            del mine[file]
        scene = draw.choice(["fast_gait", "uphill_gait"])
        plots = draw.choice([["--no-plots"], []])
        main(["run", scene, *plots, "--force", "--quiet", "-o", str(folder)])
        for path, text in mine.items():
            assert path.read_text() == text, (k, path)


def test_nothing_is_removed_that_wormopt_cannot_have_written(tmp_path: Path):
    folder = tmp_path / "out"
    assert main(["run", "fast_gait", "-o", "out"]) == 0
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    (folder / "notes.txt").write_text("mine")
    (tmp_path / "outside.png").write_text("mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    summary["sha256"] |= {"../outside.png": digest, str(tmp_path / "outside.png"): digest}
    summary["sha256"] |= {"notes.txt": "of another text", "x": 3}
    (folder / "summary.json").write_text(json.dumps(summary))
    assert main(["run", "fast_gait", "-o", "out"]) == 0
    assert (folder / "notes.txt").exists()
    assert (tmp_path / "outside.png").exists()


def test_a_changed_summary_is_named_itself(tmp_path: Path, capsys: Capture):
    assert main(["run", "fast_gait", "-o", "out"]) == 0
    summary = tmp_path / "out" / "summary.json"
    summary.write_text(summary.read_text(encoding="utf-8") + "x", encoding="utf-8")
    assert main(["run", "fast_gait", "-o", "out"]) == 2
    assert f"{summary}: was not written by wormopt, or was changed" in capsys.readouterr().err


def test_a_folder_where_a_file_must_go_is_refused_even_by_force(
    tmp_path: Path, capsys: Capture, study: Install
):
    (tmp_path / "out" / "result.nc").mkdir(parents=True)
    study(never)
    assert main(["run", "fast_gait", "-o", "out", "--force"]) == 2
    assert "result.nc: is a folder" in capsys.readouterr().err


@pytest.mark.parametrize("output", ["file/out", "file/deeper/out", "loop", "a\0b", "x" * 300])
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, capsys: Capture, study: Install, output: str
):
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to("loop")
    study(never)
    assert main(["run", "fast_gait", "-o", output]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    # Python 3.13 resolves circular links
    assert "cannot be written" in err or "is a link to a folder that does not exist" in err
    assert names(tmp_path) == {"file", "loop"}


def test_a_link_to_a_folder_is_followed(tmp_path: Path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    assert main(["run", "fast_gait", "-o", "link"]) == 0
    assert (tmp_path / "link").is_symlink()
    assert names(tmp_path / "real") == NUMBERS | PICTURES


@pytest.mark.parametrize(
    ("error", "code", "reason"),
    [(SolveError("no gait keeps it", "allow 15"), 3, "keeps it; allow"),
     (Interrupted(), 130, "interrupted")],
)  # fmt: skip
@pytest.mark.parametrize("kept", ["result", "motion", "nothing"])
def test_what_was_found_before_a_failure_is_saved(
    tmp_path: Path, capsys: Capture, study: Install, error: Any, code: int, reason: str, kept: str
):
    def stop(scene: Scene[Any], report: Report) -> Result:
        # a study that was stopped while it simulated hands on a motion, which is no Result
        error.partial = {"result": found(scene), "motion": object(), "nothing": None}[kept]
        raise error

    study(stop)
    assert main(["run", "fast_gait", "--json"]) == code
    out, err = capsys.readouterr()
    printed = json.loads(out)
    assert printed["status"] == "failed"
    assert reason in printed["reason"]
    assert reason in err
    loaded = Result.load(tmp_path / "results" / "fast_gait")
    assert (loaded.status, loaded.reason) == ("failed", printed["reason"])
    assert ("speed" in loaded.scalars) == (kept == "result")


def test_a_failed_run_ends_with_three_and_may_be_run_again(
    tmp_path: Path, capsys: Capture, study: Install
):
    study(lambda scene, report: found(scene, status="failed", reason="recheck off by 1e-3"))
    assert main(["run", "fast_gait"]) == 3
    assert "failed: recheck off by 1e-3" in capsys.readouterr().err
    study(solve)
    assert main(["run", "fast_gait"]) == 0
    assert Result.load(tmp_path / "results" / "fast_gait").status == "ok"


def test_a_picture_without_data_is_left_out_of_a_failed_result(
    tmp_path: Path, capsys: Capture, monkeypatch: Patch, study: Install
):
    def draw(result: Result, name: str, path: Path) -> None:
        result["spike_load"]

    monkeypatch.setattr(sys.modules["wormopt.pictures"], "draw", draw)
    study(lambda scene, report: found(scene, status="failed", reason="no"))
    assert main(["run", "fast_gait"]) == 3
    assert "gait.png left out" in capsys.readouterr().err
    assert names(tmp_path / "results" / "fast_gait") == NUMBERS


def test_a_drawing_that_breaks_costs_no_numbers(
    tmp_path: Path, monkeypatch: Patch, capsys: Capture
):
    def draw(result: Result, name: str, path: Path) -> None:
        raise ZeroDivisionError("no width")

    monkeypatch.setattr(sys.modules["wormopt.pictures"], "draw", draw)
    assert main(["run", "fast_gait"]) == 0
    assert "drawing failed (ZeroDivisionError: no width)" in capsys.readouterr().err
    assert speed_in(tmp_path / "results" / "fast_gait") == 2.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_interrupts_the_drawing_reads_that_the_result_is_saved(
    tmp_path: Path, monkeypatch: Patch, capsys: Capture, number: int
):
    def draw(result: Result, name: str, path: Path) -> None:
        if path.name == "motion.png":
            signal.raise_signal(number)
        path.write_text("")

    monkeypatch.setattr(sys.modules["wormopt.pictures"], "draw", draw)
    assert main(["run", "fast_gait"]) == 130
    out, err = capsys.readouterr()
    assert "interrupted; the result is saved, some pictures are not" in err
    assert "nothing saved" not in err
    assert "Saved in" in out
    assert names(tmp_path / "results" / "fast_gait") == NUMBERS | {"gait.png"}
    assert Result.load(tmp_path / "results" / "fast_gait").status == "ok"


def test_progress_says_what_is_drawn(monkeypatch: Patch, capsys: Capture):
    monkeypatch.setattr(progress, "_FIRST_LINE", 0.0)
    assert main(["run", "fast_gait"]) == 0
    assert ": drawing gait.png\n" in capsys.readouterr().err


def test_ctrl_c_without_anything_to_keep(tmp_path: Path, capsys: Capture, study: Install):
    def stop(scene: Scene[Any], report: Report) -> Result:
        raise KeyboardInterrupt

    study(stop)
    assert main(["run", "fast_gait"]) == 130
    assert "nothing saved" in capsys.readouterr().err
    assert not names(tmp_path / "results")


def test_an_import_swallows_no_interrupt(tmp_path: Path, monkeypatch: Patch):
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    monkeypatch.syspath_prepend(tmp_path)

    @interruptible()
    def load() -> None:
        import_module("swallows")
        time.sleep(5)

    with pytest.raises(KeyboardInterrupt):
        load()


def test_casadi_swallows_no_interrupt():
    @interruptible()
    def compute(x: ca.SX, press: Timer) -> None:
        press.start()
        for _ in range(100_000):
            ca.plus(x, x)  # asks x for its shape, and drops what that raises

    for trial in range(12):
        press = Timer(0.002 + 1e-4 * trial, os.kill, (os.getpid(), signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            compute(ca.SX.sym("x"), press)


def test_casadi_says_nothing_of_an_interrupt(capsys: Capture):
    """Its integrators would write `rhs failed: KeyboardInterrupt`."""
    x, t = ca.SX.sym("x", 40), ca.SX.sym("t")
    dae = {"x": x, "t": t, "ode": 1e3 * (ca.sin(1e3 * t) - x)}
    endless = ca.integrator("endless", "cvodes", dae, 0.0, 1e4, {"max_num_steps": 10**9})

    @interruptible()
    def compute() -> None:
        Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        endless(x0=0.1)

    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            compute()
    assert capsys.readouterr().err == ""
    print("still heard", file=sys.stderr)
    assert capsys.readouterr().err == "still heard\n"


def test_bad_input_that_only_the_study_sees(tmp_path: Path, capsys: Capture, study: Install):
    def refuse(scene: Scene[Any], report: Report) -> Result:
        raise SceneError("scene.toml", [("gait.file", "has 3 columns; write 4")])

    study(refuse)
    assert main(["run", "fast_gait"]) == 2
    assert capsys.readouterr().err == "scene.toml: gait.file: has 3 columns; write 4\n"
    assert not names(tmp_path / "results")


def test_a_disk_that_fills_up_is_reported(capsys: Capture, monkeypatch: Patch):
    def save(self: Result, folder: Path, pictures: tuple[str, ...]) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Result, "save", save)
    assert main(["run", "fast_gait"]) == 2
    assert "No space left" in capsys.readouterr().err


def test_a_scene_of_ones_own(tmp_path: Path, capsys: Capture):
    from wormopt.study import packaged_scenes

    path = tmp_path / "mein λ.toml"
    shutil.copy(packaged_scenes()["fast_gait"], path)
    assert main(["run", str(path), "--set", 'title="Größe λ — 1"']) == 0
    assert "Größe λ — 1" in capsys.readouterr().out
    (folder,) = (tmp_path / "results").iterdir()
    loaded = Result.load(folder)
    assert (loaded.scene, loaded.title) == ("mein λ", "Größe λ — 1")


def test_check_looks_at_every_scene(capsys: Capture):
    assert main(["check", "no_such", "fast_gait"]) == 2
    out, err = capsys.readouterr()
    assert out == "fast_gait: ok (gait)\n"
    assert err.startswith("no_such: ")
    assert main(["check", "fast_gait", "--set", "worm.load=-1"]) == 2
    assert "worm.load" in capsys.readouterr().err


def test_long_runs_say_a_line_now_and_then_without_a_terminal(
    capsys: Capture, monkeypatch: Patch, study: Install
):
    clock = iter([0.0, *np.arange(1.0, 121.0)])
    monkeypatch.setattr(progress, "monotonic", lambda: next(clock))

    def patient(scene: Scene[Any], report: Report) -> Result:
        for k in range(100):
            report("solving", (k + 1) / 200)
        return found(scene)

    study(patient)
    assert main(["run", "fast_gait"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == ["10 s: solving, 5%", "20 s: solving, 10%", "30 s: solving, 15%"]
    assert 4 < len(lines) < 8
    clock = iter([])
    assert main(["run", "fast_gait", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_the_report_is_readable(capsys: Capture, monkeypatch: Patch, study: Install):
    monkeypatch.setenv("COLUMNS", "60")
    routes = [{"route": "cvodes", "error": 1.0e-9}, {"route": "python", "error": None}]
    ends = [[1 / 3, 2 / 3, 1.0], [0.25, 0.5, 0.75]]
    told = ["a warning that is much too long to stand in a line of sixty characters", "another"]
    trust = {"recheck": routes, "events": {}, "warnings": told}
    study(lambda scene, report: found(scene, scalars={"ends": Scalar(ends, "m")}, trust=trust))
    assert main(["run", "fast_gait", "--all"]) == 0
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()[1:-1]]
    assert lines == [
        "  ends  [0.333333333333, 0.666666666667, 1]  m",
        "        [0.25, 0.5, 0.75]",
        "Trust:",
        "  recheck   route cvodes, error 1e-09",
        "            route python, error unknown",
        "  events    none",
        "  warnings  a warning that is much too long to stand in a",
        "              line of sixty characters",
        "            another",
    ]


def test_libraries_of_linear_algebra_take_one_thread_unless_told(monkeypatch: Patch):
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    monkeypatch.setattr("wormopt.cli.main", lambda: 7)
    for name in (*names, "OMP_NUM_THREADS"):
        monkeypatch.setenv(name, "")  # so that it is as before afterwards
        monkeypatch.delenv(name)
    assert start() == 7
    assert [os.environ[name] for name in names] == ["1", "1"]
    monkeypatch.delenv(names[0])
    monkeypatch.setenv(names[1], "5")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    start()
    assert [os.environ[name] for name in names] == ["3", "5"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "usage: "),
        ("walk", "invalid choice"),
        ("run", "required: "),
        ("sweep fast_gait worm.load=1,2,3", "write --over 'worm.load=[1,2,3]'"),
        ("sweep fast_gait worm.load=1:2:3", "write --over 'worm.load=1:2:3'"),
        ("run fast_gait worm.load=1", "write --set 'worm.load=1'"),
        ("run fast_gait --load=1", "unrecognized arguments: --load=1\n"),
        ("list worm.load=1 --jso", "unrecognized arguments: --jso\n"),
    ],
)
def test_wrong_usage_ends_with_two(words: str, told: str, capsys: Capture):
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2
    err = capsys.readouterr().err
    assert told in err
    own = "" if words in ("", "walk") else words.split()[0]
    assert err.startswith(f"usage: wormopt {own}")
