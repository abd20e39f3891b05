"""Results as tables for other tools, read back by tools that are not ours, and the command line."""

import csv
import io
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import by_formula, gait_in, made, rough, swing
from hints import Capture, Patch
from places import SAVED
from scipy.io import loadmat

import wormopt as wo
from wormopt.cli import main
from wormopt.exports.matlab import field_names
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.systems.chain import chain
from wormopt.systems.recorded.recordings import RecordingFile, runs_of


def columns(text: str) -> dict[str, np.ndarray]:
    """Columns of a table by their names with units."""
    rows = [*csv.reader(line for line in io.StringIO(text) if not line.startswith("#"))]
    values = np.array([[float(v) for v in row] for row in rows[1:]])
    return dict(zip(rows[0], values.T, strict=True))


# -- CSV -----------------------------------------------------------------------------------------


def test_signals_are_in_the_table_as_they_are_in_the_result(fast: Result, tmp_path: Path):
    (file,) = wo.export(fast, "csv", tmp_path)
    assert file == tmp_path / "fast_gait.csv"
    table = columns(file.read_text("utf-8"))
    assert next(iter(table)) == "time [1]"
    assert np.array_equal(table["time [1]"], fast["time"].values)
    for name in ("length", "rate", "acceleration", "position", "resting"):
        for k, row in enumerate(fast[name].values):
            assert np.array_equal(table[f"{name}_{k} [1]"], row)


def test_units_stand_in_the_head(tmp_path: Path):
    variables = (
        Variable("time", "s", ("time",), np.array([0.0, 1.0])),
        Variable("length", "m", ("link", "time"), np.array([[1.0, 2.0], [3.0, 4.0]])),
        Variable("force", "N s m-1", ("tracker", "link", "time"), np.ones((1, 2, 2))),
        Variable("event_time", "s", ("event",), np.array([0.25])),
    )
    wo.export(Result("walk", "gait", variables=variables), "csv", tmp_path)
    heads = {path.name: path.read_text("utf-8").splitlines()[2] for path in tmp_path.iterdir()}
    assert heads == {
        "walk.csv": "time [s],force_0_0 [N s m-1],force_0_1 [N s m-1],length_0 [m],length_1 [m]",
        "walk_event.csv": "event [1],event_time [s]",
    }


def test_a_gait_is_evaluated_and_not_interpolated(fast: Result, tmp_path: Path):
    (file,) = wo.export(fast, "csv", tmp_path / "a.csv", step=0.007)
    text = file.read_text("utf-8")
    assert "from the gait's formulas: length, rate, acceleration" in text
    table = columns(text)
    t = table["time [1]"]
    assert [repr(v) for v in t[:4].tolist()] == ["0.0", "0.007", "0.014", "0.021"]
    assert t[-1] == 0.994
    gait = gait_in(fast)
    for derivative, name in enumerate(("length", "rate", "acceleration")):
        expected = np.array([by_formula(gait, at, derivative) for at in t]).T
        found = np.array([table[f"{name}_{k} [1]"] for k in range(2)])
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    # the way of the head is between its samples
    assert np.allclose(
        table["position_0 [1]"], np.interp(t, fast["time"].values, fast["position"].values[0])
    )
    assert set(table["resting_0 [1]"]) <= {0.0, 1.0}


@pytest.fixture(scope="module")
def tracked() -> Result:
    """A worm whose lengths stray from their reference."""
    result = Result.load(SAVED / "random_links.nc")
    strays = result["reference"].values + 0.1 * np.sin(result["time"].values)
    strayed = Variable("length", "m", ("link", "time"), strays)
    return Result("walk", "track", variables=(*result.variables, strayed))


def test_a_reference_is_the_gait_and_a_length_beside_it_is_not(tracked: Result, tmp_path: Path):
    (file,) = (f for f in wo.export(tracked, "csv", tmp_path, step=0.013) if f.stem == "walk")
    table = columns(file.read_text("utf-8"))
    t, gait = table["time [s]"], gait_in(tracked)
    time, reference, length = (tracked[name].values for name in ("time", "reference", "length"))
    expected = np.array([by_formula(gait, at, 0) for at in t]).T
    for k in range(2):
        assert np.abs(table[f"reference_{k} [m]"] - expected[k]).max() < 1e-12
        assert np.abs(np.interp(t, time, reference[k]) - expected[k]).max() > 1e-3
        assert np.allclose(table[f"length_{k} [m]"], np.interp(t, time, length[k]))


def test_a_result_without_time_is_written_over_its_own_dimensions(tmp_path: Path):
    result = Result.load(SAVED / "film_basins.nc")
    files = wo.export(result, "csv", tmp_path)
    assert tmp_path / "film_basins_map_delta_map_tension.csv" in files
    table = columns((tmp_path / "film_basins_map_delta_map_tension.csv").read_text("utf-8"))
    (delta,) = (v for k, v in table.items() if k.startswith("map_delta "))
    (tension,) = (v for k, v in table.items() if k.startswith("map_tension "))
    (growth,) = (v for k, v in table.items() if k.startswith("map_growth "))
    for d, s, g in zip(delta, tension, growth, strict=True):
        i = result["map_delta"].values.tolist().index(d)
        k = result["map_tension"].values.tolist().index(s)
        assert np.array_equal(result["map_growth"].values[i, k], g, equal_nan=True)


@pytest.mark.parametrize("path", sorted(SAVED.glob("*.nc")), ids=lambda path: path.stem)
def test_every_result_is_written_whole(path: Path, tmp_path: Path):
    result = Result.load(path)
    files = wo.export(result, ["csv", "mat"], tmp_path)
    heads = [
        next(line for line in file.read_text("utf-8").splitlines() if line[0] != "#")
        for file in files
        if file.suffix == ".csv"
    ]
    names = re.findall(r"(?:^|,)(\w+) \[", "\n".join(heads), flags=re.MULTILINE)
    for variable in result.variables:
        own = re.compile(rf"{variable.name}(_\d+)*")
        kept = variable.name.startswith("gait_") or variable.name in ("time", "instant")
        assert kept or any(own.fullmatch(name) for name in names), variable.name
    found = loadmat(tmp_path / f"{result.scene}.mat", simplify_cells=True)
    for variable in result.variables:
        there = found["variables"][variable.name]
        assert np.array_equal(np.ravel(there["value"]), variable.values.ravel(), equal_nan=True)
        assert there["units"] == variable.unit
        assert np.atleast_1d(there["dims"]).tolist() == [*variable.dims]
    fields = field_names([*result.scalars])
    for name, scalar in result.scalars.items():
        there = found["scalars"][fields[name]]
        if isinstance(scalar.value, int | float):
            assert there == {"value": scalar.value, "units": scalar.unit}
    assert found["kind"] == result.kind


def test_the_step_is_checked(fast: Result, tmp_path: Path):
    for step in (0.0, -1.0, np.nan, np.inf, 1e-12):
        with pytest.raises(wo.ArgumentError, match="more than" if step == 1e-12 else "positive"):
            wo.export(fast, "csv", tmp_path, step=step)
    still = Result.load(SAVED / "segment_shapes.nc")
    with pytest.raises(wo.ArgumentError, match="no time"):
        wo.export(still, "csv", tmp_path, step=0.1)
    assert not [*tmp_path.iterdir()]


def test_tenths_are_tenths(tmp_path: Path):
    time = Variable("time", "s", ("time",), np.array([0.0, 0.25, 1.0]))
    way = Variable("x", "m", ("time",), np.array([0, 2, 5]))
    result = Result("walk", "gait", variables=(time, way))
    (file,) = wo.export(result, "csv", tmp_path, step=0.1)
    table = columns(file.read_text("utf-8"))
    assert table["time [s]"].tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    # whole numbers are kept until the next
    assert table["x [m]"].tolist() == [0, 0, 0, 2, 2, 2, 2, 2, 2, 2, 5]


# -- read back -------------------------------------------------------------------------------------


def test_a_gait_is_read_back_from_its_table(designed: Result, walk: Result, tmp_path: Path):
    """With its breaks it is the same to the last digits where it is polynomial."""
    for result, error in ((designed, 1e-13), (walk, 1e-9)):
        (file, *_) = wo.export(result, "csv", tmp_path)
        back, gait = wo.load_gait(file), gait_in(result)
        t = np.linspace(0.0, gait.period, 1999)
        assert back.period == gait.period
        assert back.warnings == ()
        assert np.abs(back(t) - gait(t)).max() < error * gait(t).max()


@pytest.mark.parametrize("chosen", [(), ("length",)])
def test_a_gait_is_read_back_from_rows_at_ticks(
    walk: Result, chosen: tuple[str, ...], tmp_path: Path
):
    (file, *_) = wo.export(walk, "csv", tmp_path, step="10 ms", columns=chosen)
    table = columns(file.read_text("utf-8"))
    assert ([*table] == ["time [s]", "length_0 [m]", "length_1 [m]"]) == bool(chosen)
    back, gait = wo.load_gait(file), gait_in(walk)
    assert f"# gait: length, cycle {gait.period!r} s" in file.read_text("utf-8").splitlines()
    assert back.period == gait.period
    rows = np.arange(124) / 100
    assert np.abs(back(rows) - gait(rows)).max() < 1e-15
    t = np.linspace(0.0, gait.period, 1999)
    # where the acceleration jumps within a step, a spline is off by a part of jump * step²
    jump = 2 * np.abs(gait(t, 2)).max()
    assert np.abs(back(t) - gait(t)).max() < 0.05 * jump * 0.01**2


def test_a_cycle_of_whole_ticks(walk: Result, tmp_path: Path):
    """At 100 Hz a cycle of 37/30 s takes 1.24 s: slower, so that its limits hold."""
    (file,) = wo.export(walk, "csv", tmp_path / "a.csv", step="10 ms", whole_steps=True)
    text = file.read_text("utf-8")
    assert "# gait: length, cycle 1.24 s" in text
    assert "# cycle of 1.24 s, a multiple of the step, instead of 1.23333333333333" in text
    table = columns(text)
    assert table["time [s]"].tolist() == [k / 100 for k in range(125)]
    slow = gait_in(walk).with_period(1.24)
    heads = ("length_{} [m]", "rate_{} [m s-1]", "acceleration_{} [m s-2]")
    for derivative, head in enumerate(heads):
        found = np.array([table[head.format(j)] for j in range(2)])
        assert np.array_equal(found, slow(table["time [s]"], derivative))
        assert np.array_equal(found[:, 0], found[:, -1])
    assert wo.load_gait(file).period == 1.24


def test_a_cycle_that_is_a_multiple_stays_as_it_is(fast: Result, tmp_path: Path):
    (file,) = wo.export(fast, "csv", tmp_path / "a.csv", step=0.1, whole_steps=True)
    text = file.read_text("utf-8")
    assert "multiple of the step" not in text
    assert columns(text)["time [1]"].tolist() == [k / 10 for k in range(11)]


def test_columns_that_are_not_there_are_refused(
    walk: Result, fast: Result, tmp_path: Path, capsys: Capture
):
    with pytest.raises(ValueError, match=r"has no column 'lenght'; .* It has 'time', .*'length_0'"):
        wo.export(walk, "csv", tmp_path, columns=["lenght"])
    with pytest.raises(ValueError, match="whole_steps needs a step"):
        wo.export(walk, "csv", tmp_path, whole_steps=True)
    with pytest.raises(ValueError, match=r"fewer than 3 steps of 0\.7; .* at most 0\.411"):
        wo.export(walk, "csv", tmp_path, step=0.7, whole_steps=True)
    fast.save(made(tmp_path / "fast"))
    folder = str(tmp_path / "fast")
    assert main(["export", folder, "--csv", "--columns", "lenght", "-o", str(tmp_path)]) == 2
    assert "has no column 'lenght'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("formats", "options", "what"),
    [
        (["mat", "c"], {"step": 0.1}, "step has no effect on mat, c, only on csv, parquet, ros"),
        ("mjcf", {"columns": ["length"]}, "columns has no effect on mjcf, only on csv"),
        ("csv", {"rest": True}, "rest has no effect on csv, only on ros"),
        ("csv", {"cycles": 2}, "cycles has no effect on csv, only on ros"),
        ("urdf", {"step": 0.1, "whole_steps": True}, "whole_steps has no effect on urdf"),
        ("csv", {"step": 2.0}, "the step 2 gives one row only; write less than 1"),
    ],
)
def test_options_without_effect_are_refused(
    fast: Result, formats: Any, options: dict[str, Any], what: str, tmp_path: Path
):
    with pytest.raises(wo.ArgumentError, match=what):
        wo.export(fast, formats, tmp_path, **options)
    assert not [*tmp_path.iterdir()]


def test_limits_have_their_names_in_the_table(designed: Result, tmp_path: Path):
    wo.export(designed, "csv", tmp_path / "a.csv")
    text = (tmp_path / "a_limit.csv").read_text("utf-8").splitlines()
    (head, *rows) = csv.reader(line for line in text if not line.startswith("#"))
    assert head == ["limit [1]", "limit_elasticity [1]"]
    assert [name for name, _ in rows] == designed.attributes["limits"]["name"]
    assert [float(x) for _, x in rows] == designed["limit_elasticity"].values.tolist()


def test_the_reference_of_a_tracked_worm_is_read_back(designed: Result, tmp_path: Path):
    """Its links follow it within a tube only; they are no gait."""
    length, time = designed["length"], designed["time"].values
    kept = [v for v in designed.variables if v.name == "time" or v.name.startswith("gait_")]
    strayed = replace(length, values=length.values + 0.01 * np.sin(7 * time))
    variables = (*kept, strayed, replace(length, name="reference"))
    (file, *_) = wo.export(Result("walk", "track", variables=variables), "csv", tmp_path)
    back, gait = wo.load_gait(file), gait_in(designed)
    t = np.linspace(0.0, gait.period, 997)
    assert back.period == gait.period
    assert np.abs(back(t) - gait(t)).max() < 1e-7


def test_signals_without_units_are_read_back_as_a_recording(tmp_path: Path):
    worm = chain(2, mass=1.0, stiffness=8.0, damping=2.0, rest_length=2.0)
    motion = wo.simulate(worm, 1.0, x0={"velocity": [1.0, 0.0, 0.0]}, times=np.linspace(0, 1, 21))
    variables = (
        Variable("time", "1", ("time",), motion.time),
        Variable("position", "1", ("mass", "time"), motion["position"]),
    )
    (file,) = wo.export(Result("walk", "simulate", variables=variables), "csv", tmp_path)
    (run,) = runs_of([RecordingFile(file=str(file))], tmp_path, worm, "dimensionless", {}, "scene")
    assert np.array_equal(run.recording.times, motion.time)
    assert np.array_equal(run.recording.readings["position"], motion["position"])


# -- MATLAB --------------------------------------------------------------------------------------


def test_fields_have_names_that_matlab_allows():
    long = "a" * 70
    names = ["end", "speed", "2nd", "über λ", long, long + "b", "x_end", ""]
    found = field_names(names)
    assert found["speed"] == "speed"
    assert found["end"] == "x_end"
    assert len(set(found.values())) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", name, re.ASCII) for name in found.values())


def test_a_result_with_nearly_nothing_goes_to_matlab(tmp_path: Path):
    scalars = {"gap": Scalar(None, "m"), "sets": Scalar([[1], [2, 3]]), "word": Scalar("λ")}
    result = Result("leer", "gait", title="größer", scalars=scalars, trust={"warnings": ["naïve"]})
    (file,) = wo.export(result, "mat", tmp_path)
    found = loadmat(file, simplify_cells=True)
    assert np.isnan(found["scalars"]["gap"]["value"])
    assert found["scalars"]["sets"]["value"] == "[[1], [2, 3]]"
    assert found["scalars"]["word"]["value"] == "λ"
    assert found["title"] == "größer"
    assert "naïve" in found["trust"]


# -- the command line ----------------------------------------------------------------------------


@pytest.fixture
def saved(fast: Result, tmp_path: Path) -> Path:
    folder = made(tmp_path / "result")
    fast.save(folder)
    return folder


def test_several_formats_at_once(saved: Path, tmp_path: Path, capsys: Capture, monkeypatch: Patch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "result", "--csv", "--mat", "--c", "--ros", "--cycles", "2"]) == 0
    names = [f"fast_gait{end}" for end in (".csv", ".mat", ".h", ".c", "_replay.c", ".yaml")]
    assert capsys.readouterr().out.split() == names
    assert {path.name for path in tmp_path.iterdir()} == {*names, "result"}
    assert main(["export", "result/result.nc", "--mat", "-o", "new/place", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "new" / "place" / "fast_gait.mat").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["result"], "--csv, --parquet, --mat, --hdf5, --c, --arduino, --ros, --mjcf"),
        (["nothing", "--csv"], "nothing"),
        (["mine.txt", "--csv"], "not a result of wormopt"),
        (["result", "--fmu"], "kind simulate or track"),
        (["result", "--csv", "--fmu"], "kind simulate or track"),
        (["result", "--csv", "-o", "mine.txt"], "ends in .csv"),
        (["result", "--csv", "-o", "mine.txt", "--force"], "ends in .csv"),
        (["result", "--csv", "--mat", "-o", "a.csv"], "folder"),
        (["result", "--csv", "-o", "there.csv"], "--force"),
        (["result", "--csv", "-o", "linked.csv", "--force"], "never replaced"),
        (["result", "--mat", "-o", "mine"], "cannot be written"),
        (["result", "--mat", "-o", "mine", "--force"], "cannot be written"),
        (["result", "--mat", "-o", "/dev/null/x"], "cannot be written"),
        (["result", "--mat", "-o", "a\0b"], "cannot be written"),
        (["result", "--mat", "-o", "a" * 300 + ".mat"], "File name too long"),
        (["result", "--csv", "--step", "0"], "positive"),
        (["result", "--csv", "--step", "10 mm"], "'10 mm'"),
        (["result", "--csv", "--step", "often"], "write for example 0.01"),
        (["result", "--ros", "--cycles", "0"], "cycles"),
    ],
)
def test_what_is_refused_leaves_all_as_it_was(
    saved: Path, tmp_path: Path, capsys: Capture, monkeypatch: Patch, arguments: list, said: str
):
    monkeypatch.chdir(tmp_path)
    for name in ("mine.txt", "there.csv", "mine"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "linked.csv").symlink_to("mine.txt")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert main(["export", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_what_is_written_does_not_hang_on_when(fast: Result, tmp_path: Path, monkeypatch: Patch):
    def written(folder: str) -> dict[str, bytes]:
        paths = wo.export(fast, ["csv", "mat", "c", "ros"], tmp_path / folder)
        return {path.name: path.read_bytes() for path in paths}

    first = written("a")
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("time.asctime", lambda *_: "Wed May 18 03:33:20 2033")
    assert written("b") == first


def test_force_replaces_files_and_never_folders(saved: Path, tmp_path: Path, capsys: Capture):
    into = ["export", str(saved), "--csv", "--mat", "--c", "--ros", "-o", str(tmp_path / "all")]
    assert main(into) == 0
    assert main(into) == 0  # they are the same
    assert main([*into, "--step", "0.1"]) == 2
    assert main([*into, "--step", "0.1", "--force"]) == 0
    for name in ("fast_gait.csv", "fast_gait.mat", "fast_gait.c", "fast_gait.yaml"):
        edited = tmp_path / "all" / name
        written = edited.read_bytes()
        edited.write_bytes(written.replace(b"1", b"2", 1) + b"# mine")
        kept = edited.read_bytes()
        assert main([*into, "--force"]) == 2
        assert edited.read_bytes() == kept
        edited.write_bytes(written)
    assert main([*into, "--force"]) == 0
    capsys.readouterr()
    (tmp_path / "there.csv").write_text("old, not made by wormopt")
    assert main(["export", str(saved), "--csv", "-o", str(tmp_path / "there.csv"), "--force"]) == 2
    assert "was not made by wormopt" in capsys.readouterr().err
    assert (tmp_path / "there.csv").read_text("utf-8") == "old, not made by wormopt"
    folder = tmp_path / "out"
    (folder / "fast_gait.c").mkdir(parents=True)
    assert main(["export", str(saved), "--c", "-o", str(folder), "--force"]) == 2
    assert "is a folder" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["fast_gait.c"]


@pytest.mark.skipif(getattr(os, "geteuid", int)() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to(saved: Path, tmp_path: Path):
    (tmp_path / "locked").mkdir(mode=0o500)
    assert main(["export", str(saved), "--csv", "-o", str(tmp_path / "locked")]) == 2


def test_a_disk_that_fails_leaves_nothing_behind(saved: Path, tmp_path: Path, monkeypatch: Patch):
    write = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if b"int main" in content:
            raise OSError(28, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["export", str(saved), "--c", "-o", str(tmp_path / "out")]) == 2
    assert not [*(tmp_path / "out").iterdir()]


def test_a_failed_result_says_so(fast: Result, tmp_path: Path, capsys: Capture):
    folder = made(tmp_path / "failed")
    fast.failed("it stopped short").save(folder)
    assert main(["export", str(folder), "--csv", "--c", "--ros", "-o", str(tmp_path)]) == 0
    assert "the result failed; the files state it: it stopped short" in capsys.readouterr().err
    for name in ("fast_gait.csv", "fast_gait.h", "fast_gait.c", "fast_gait.yaml"):
        assert "the result failed: it stopped short" in (tmp_path / name).read_text("utf-8")


def test_a_result_of_a_strange_name_stays_in_the_folder(fast: Result, tmp_path: Path):
    for name in ("../../evil", "/tmp/evil", "..", ""):
        strange = Result(name, "gait", variables=fast.variables)
        (file,) = wo.export(strange, "mat", tmp_path, force=True)
        assert file.parent == tmp_path


def test_only_known_formats(fast: Result, tmp_path: Path):
    for formats in ("docx", [], ["csv", "exe"]):
        with pytest.raises(wo.ArgumentError, match="formats are csv, parquet, mat, hdf5, c"):
            wo.export(fast, formats, tmp_path)  # type: ignore[arg-type]
    for what, into in ((rough(), "csv"), (rough(), "fmu"), (swing(), "c"), (swing(), "mat")):
        with pytest.raises(wo.ArgumentError, match="takes a Result"):
            wo.export(what, into, tmp_path)  # type: ignore[arg-type]
