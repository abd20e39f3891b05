"""Tables in text files: what spreadsheets, loggers and programs write is read back."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from effort import examples
from hints import Folders
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.systems.film.given_field import _read_table
from wormopt.systems.film.shapes import grid
from wormopt.systems.recorded.recordings import RecordingFile, runs_of
from wormopt.tables import TextTable, Wrong, parse_table, read_table


def read(content: str | bytes, folder: Path, **how: str) -> tuple[TextTable | None, list[Wrong]]:
    path, wrong = folder / "table.csv", list[Wrong]()
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_table(path, wrong, **how), wrong  # pyright: ignore[reportArgumentType]


def parsed(text: str, **how: Any) -> TextTable:
    """A table in which nothing is wrong."""
    wrong: list[Wrong] = []
    found = parse_table(text, wrong, **how)
    assert not wrong
    assert found is not None
    return found


# -- negative numbers of servos --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "meant", "bits"),
    [
        # what a bus servo reports of its position, velocity and current
        (["4092", "4089", "4075"], [4092, 4089, 4075], 0),
        (["0", "4294967292", "", "4294967271", "20"], [0, -4, math.nan, -25, 20], 32),
        (["3", "65535", "65531", "7"], [3, -1, -5, 7], 16),
        (["1", "18446744073709551615", "18446744073709551614"], [1, -1, -2], 64),
        (["12", "4294967295.0"], [12, -1], 32),
        # not wrapped: readings in between, no small ones, fractions, negative numbers beside
        (["12", "30000", "65535"], [12, 30000, 65535], 0),
        (["4294967290", "4294967295"], [4294967290, 4294967295], 0),
        (["0.5", "4294967295"], [0.5, 4294967295], 0),
        (["-3", "4294967295"], [-3, 4294967295], 0),
        (["100", "50000"], [100, 50000], 0),
    ],
)
def test_negative_numbers_written_as_unsigned_ones(
    written: list[str], meant: list[float], bits: int
):
    rows = "\n".join(f"{k},{cell}" for k, cell in enumerate(written))
    table = parsed(f"time,x\n{rows}\n", time="time")
    np.testing.assert_array_equal(table.values["x"], meant)
    assert table.wrapped == ({"x": bits} if bits else {})


def test_negative_velocities_of_a_servo_are_read_with_a_warning(tmp_path: Path):
    """A file as a logger of bus servos writes it: 32 bits of velocity, 16 of current."""
    rows = [(0, 0, 65535), (-4, 4294967292, 65531), (-11, 4294967285, 2), (-8, 20, 0)]
    text = "".join(f"{1e-1 * k:.1f},{x},{v},{i}\n" for k, (x, v, i) in enumerate(rows))
    (tmp_path / "servo.csv").write_text(f"time,servoPos,servoVel,servoCur\n{text}")
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    model = wo.Model(
        "servo", [wo.Signal("position", x, value=0.0)], v, u=[wo.Signal("velocity", v)],
        outputs=[wo.Output("current", 0.1 * v)],
    )  # fmt: skip
    columns = {"servoPos": "position", "servoVel": "velocity", "servoCur": "current"}
    (run,) = runs_of(
        [RecordingFile(file="servo.csv", columns=columns)], tmp_path, model, "1", {}, ""
    )
    np.testing.assert_array_equal(run.recording.readings["current"], [[-1, -5, 2, 0]])
    driven = run.recording.model
    assert driven is not None
    moved = wo.simulate(driven, 0.3)["position"][0, -1]  # straight between 0, -4, -11 and 20
    assert moved == pytest.approx(-0.2 - 0.75 + 0.45, rel=1e-9)
    assert [said.split(": ")[1] for said in run.warnings] == [
        f"negative numbers of column {name} are written as unsigned ones of {bits} bits"
        for name, bits in (("servoVel", 32), ("servoCur", 16))
    ]


def test_a_clock_is_never_taken_for_negative_numbers():
    table = parsed("time,x\n1,0\n4294967295,1\n", time="time")
    assert table.values["time"] == (1.0, 4294967295.0)


# -- dialects --------------------------------------------------------------------------------------

DIALECTS = {
    "plain": {},
    "spreadsheet in Germany": {"separator": ";", "comma": True, "end": "\r\n", "tail": ";"},
    "spreadsheet as Unicode text": {"separator": "\t", "comma": True, "encoding": "utf-16"},
    "decimal commas in quotes": {"comma": True, "quoted": True},
    "byte order mark": {"encoding": "utf-8-sig", "end": "\r\n"},
    "NumPy": {"separator": " ", "remark": True, "gap": "nan"},
    "logger": {"separator": "\t", "above": ["Logger 3.2", "run 7; 50 Hz"], "units": "below"},
    "Windows": {"separator": ";", "encoding": "cp1252", "gap": "#NV", "units": "round"},
    "UTF-16 without a mark": {"encoding": "utf-16-le", "gap": "#N/A"},
    "old Macintosh": {"end": "\r", "gap": "NULL", "units": "quotient"},
    "blanks in line": {"separator": "  ", "gap": "--", "comma": True},
}


def written(
    table: np.ndarray, *, separator: str = ",", comma: bool = False, quoted: bool = False,
    encoding: str = "utf-8", end: str = "\n", tail: str = "", gap: str = "",
    remark: bool = False, units: str = "square", above: Sequence[str] = (),
) -> bytes:  # fmt: skip
    """Three columns t in ms, x in µm, and n without a unit."""
    names, their = ["t", "x", "n"], ["ms", "µm", ""]
    form = {"square": "{} [{}]", "round": "{} ({})", "quotient": "{} / {}", "below": "{}"}[units]
    heads = [form.format(n, u) if u else n for n, u in zip(names, their, strict=True)]
    rows = [heads] + [their] * (units == "below")
    for row in table.tolist():
        cells = [gap if math.isnan(v) else repr(v) for v in row]
        rows.append([c.replace(".", ",") for c in cells] if comma else cells)
    if quoted:
        rows = [[f'"{cell}"' for cell in row] for row in rows]
    lines = [separator.join(row) + tail for row in rows]
    lines[0] = f"# {lines[0]}" if remark else lines[0]
    middle = len(lines) // 2 + 1
    lines = [*above, "# made by hand; 1, 2", *lines[:middle], "", "# a remark", *lines[middle:]]
    return end.join([*lines, ""]).encode(encoding)


def assert_written(found: TextTable | None, wrong: list[Wrong], table: np.ndarray) -> None:
    assert wrong == []
    assert found is not None
    assert found.units == {"t": "ms", "x": "µm"}
    assert list(found.values) == ["t", "x", "n"]
    assert np.array_equal(np.array([*found.values.values()]).T, table, equal_nan=True)


NUMBERS = st.one_of(st.floats(-1e9, 1e9), st.integers(-1000, 1000).map(float), st.just(math.nan))


@pytest.mark.parametrize("dialect", DIALECTS)
@settings(max_examples=examples(20))
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=4, max_size=12),
    step=st.floats(0.01, 1000.0),
)
@example(rows=[(0.0, math.nan)] * 4, step=0.5)
def test_ten_dialects_hold_the_same_numbers(
    tmp_path_factory: Folders, dialect: str, rows: list[tuple[float, float]], step: float
):
    table = np.array([[step * k, *row] for k, row in enumerate(rows)])
    table[0, 1:] = [0.5, -2.0]  # so that no column is all gaps
    content = written(table, **DIALECTS[dialect])
    assert_written(*read(content, tmp_path_factory.mktemp("table"), time="t"), table)


def test_names_are_found_without_a_column_that_is_known(tmp_path: Path):
    table = np.array([[0.0, 1.5, 2.0], [1.0, -2.5, 3.0], [2.0, math.nan, 4.0]])
    for how in DIALECTS.values():
        assert_written(*read(written(table, **how), tmp_path), table)


@pytest.mark.parametrize("separator", [";", "\t", ",", " "])
@pytest.mark.parametrize(
    "head",
    [
        "Messung vom Montag\n# t [s]|x [mm]|y [mm]\n",
        "Messung\n# t [s]|x [mm]|y [mm]\n",
        "# t|x|y\ns|mm|mm\n",
        "t|x|y\n# s|mm|mm\n",
        "# t|x|y\n# s|mm|mm\n",
        "t [s]|x [mm]|y [mm]|\n",
        "t|x|y|\ns|mm|mm|\n",
        "# recorded (on) Monday\nt [s]|x [mm]|y [mm]\n# filtered (twice) slowly\n",
    ],
)
def test_names_and_units_are_found_above_and_below_each_other_and_in_remarks(
    head: str, separator: str
):
    end = separator if "|\n" in head else ""
    body = "".join(f"0.{k}|1{k}|2{k}{end}\n" for k in range(5))
    table = parsed((head + body).replace("|", separator))
    assert list(table.values) == ["t", "x", "y"]
    assert table.units == {"t": "s", "x": "mm", "y": "mm"}


def test_a_gap_at_the_start_of_a_line_is_no_remark():
    found = parsed("x,time\n#N/A,0\n#DIV/0!,1\n3,2\n# 4,3\n", time="time")
    assert found.values["time"] == (0.0, 1.0, 2.0)
    assert np.isnan(found.values["x"][:2]).all()


def test_a_name_may_go_on_in_the_next_line():
    found = parsed('time,"head\n[mm]",tail\n0,1,2\n1,2,3\n', time="time")
    assert found.units == {"head": "mm"}
    assert found.lines == (3, 4)


def test_rows_and_cells_of_a_spreadsheet_that_are_empty_are_left_out():
    found = parsed("time;x;;\n0;1;;\n;;;\n1;2;;\n;;;\n", time="time")
    assert found.values == {"time": (0.0, 1.0), "x": (1.0, 2.0)}


def test_a_typesetters_minus_is_a_minus():
    found = parsed("time;x\n0;\u22121,5\n1;2\n", time="time")
    assert found.values["x"] == (-1.5, 2.0)


@settings(max_examples=examples(100))
@given(content=st.binary(max_size=60))
def test_whatever_bytes_a_file_holds_they_are_read_or_refused(
    tmp_path_factory: Folders, content: bytes
):
    found, wrong = read(content, tmp_path_factory.mktemp("table"))
    assert found is not None or wrong


# -- recordings ------------------------------------------------------------------------------------


def spring(k: float = 0.4) -> wo.Model:
    """x' = -k x, whose rate is to be found."""
    x, rate = ca.SX.sym("x"), ca.SX.sym("k")
    known = [wo.Signal("k", rate, value=1.0)]
    return wo.Model("decay", x=[wo.Signal("x", x)], p=known, ode=-rate * x)


TIME = np.linspace(0.0, 4.0, 41)

DECAY = np.exp(-0.4 * TIME)


def masked(values: np.ndarray) -> np.ma.MaskedArray:
    """Readings of which every third is masked, and wrong below the mask."""
    off = np.arange(len(values)) % 3 == 1
    return np.ma.array(np.where(off, 50.0, values), mask=off)


@pytest.mark.parametrize(
    "readings",
    [
        masked(DECAY),
        [masked(DECAY)],
        pd.Series(np.where(np.arange(41) % 3 == 1, np.nan, DECAY)),
        pd.Series(masked(DECAY).filled(np.nan)).astype("Float64"),
        xr.DataArray(masked(1000 * DECAY).filled(np.nan), dims="time", attrs={"units": "mm"}),
    ],
    ids=["masked", "list of masked", "pandas", "pandas with NA", "xarray in mm"],
)
def test_what_is_masked_or_missing_is_a_gap(readings: Any):
    run = wo.Recording(TIME, {"x": readings}, x0={"x": 1.0})
    assert run.count == 27
    kept = np.where(np.arange(41) % 3 == 1, np.nan, DECAY)
    np.testing.assert_allclose(run.readings["x"][0], kept, rtol=1e-14)


def test_a_mask_is_not_dropped_anywhere():
    time = np.ma.array([0.0, 1.0, 2.0], mask=[False, True, False])
    with pytest.raises(ArgumentError, match="time 1 is nan"):
        wo.Recording(time, {"x": [1.0, 2.0, 3.0]})
    assert np.isnan(wo.Variable("x", "1", ("n",), masked(DECAY)).values[1])
    with pytest.raises(ArgumentError, match="breaks must hold finite numbers"):
        wo.Gait(np.ma.array([0.0, 1.0], mask=[False, True]), np.ones((1, 1, 1)))


def test_tables_of_pandas_are_taken_as_they_are():
    """Entries are columns, as `to_dataframe` and files have them; dates are times."""
    place = np.array([np.sin(TIME), np.cos(TIME)])
    start = pd.Timestamp("2024-05-01 12:00")
    for frame in (
        pd.DataFrame({"position_0": place[0], "position_1": place[1], "load": TIME**2}),
        pd.DataFrame({"position[1] [mm]": 1e3 * place[1], "position[0] [mm]": 1e3 * place[0],
                      "load": TIME**2}),
    ):  # fmt: skip
        spans = pd.to_timedelta(TIME, unit="s")
        for time in (TIME, pd.Index(TIME), start + spans, pd.Series(spans), spans.to_numpy()):
            run = wo.Recording(time, frame)
            assert run.times == pytest.approx(TIME, abs=1e-9)
            assert list(run.readings) == ["load", "position"]
            assert run.readings["position"] == pytest.approx(place, abs=1e-15)
    frame = pd.DataFrame({"x": DECAY})
    frame.attrs["units"] = {"x": "cm"}
    assert wo.Recording(TIME, frame).readings["x"] == pytest.approx(DECAY[None] / 100, rel=1e-14)


def test_datasets_of_xarray_are_taken_as_they_are():
    place = np.array([np.sin(TIME), np.cos(TIME)])
    time = xr.DataArray(1e3 * TIME, dims="time", attrs={"units": "ms"})
    positions = ("time", "mass"), place.T, {"units": "m"}
    data = xr.Dataset({"position": positions, "x": ("time", DECAY)})
    run = wo.Recording(time, data)
    assert run.times == pytest.approx(TIME, abs=1e-12)
    assert np.array_equal(run.readings["position"], place)
    bad = xr.DataArray(DECAY, dims="time", attrs={"units": "pixel"})
    with pytest.raises(ArgumentError, match=r'units of x: "pixel" has a unit that is not known'):
        wo.Recording(TIME, {"x": bad})


def test_a_motion_goes_through_a_table_of_pandas_and_back():
    motion = wo.simulate(spring(), 2.0, x0={"x": 1.0}, times=np.linspace(0, 2, 11))
    frame = motion.to_dataframe()
    run = wo.Recording(frame.index, frame[["x"]])
    assert np.array_equal(run.readings["x"], motion["x"])


def test_angles_within_a_turn_are_unwrapped_on_request():
    """An angle that grows by 0.4 per time, recorded modulo 2π."""
    phi, rate = ca.SX.sym("phi"), ca.SX.sym("rate")
    known = [wo.Signal("rate", rate, value=1.0)]
    model = wo.Model("turn", x=[wo.Signal("phi", phi, unit="angle")], p=known, ode=rate)
    time = np.linspace(0.0, 40.0, 81)
    seen = np.mod(0.4 * time + 0.3 + np.pi, 2 * np.pi) - np.pi
    seen[[7, 31]] = np.nan
    run = wo.Recording(time, {"phi": seen}, x0={"phi": 0.3})
    (said,) = run.warnings
    assert "phi[0] jumps by about 2π" in said
    assert 'unwrap = ["phi"]' in said
    (said,) = wo.Recording(time, {"phi": np.rad2deg(seen)}).warnings
    assert "phi[0] jumps by about 360" in said
    assert wo.Recording(time, {"phi": np.cos(0.4 * time)}).warnings == ()
    drawn = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, 81))
    assert all(wo.Recording(time, {"phi": row}).warnings == () for row in drawn)
    run = wo.Recording(time, {"phi": seen}, x0={"phi": 0.3}, unwrap=["phi"])
    assert run.warnings == ()
    there = np.isfinite(seen)
    assert run.readings["phi"][0, there] == pytest.approx(0.4 * time[there] + 0.3, abs=1e-12)
    fit = wo.fit(wo.FitTask(model, [run], [wo.Unknown("rate", lower=0.0, upper=5.0)]), seeds=1)
    assert fit.values[0] == pytest.approx(0.4, rel=1e-9)
    with pytest.raises(ArgumentError, match="unwrap must name recorded signals, a list of phi"):
        wo.Recording(time, {"phi": seen}, unwrap=["psi"])


@pytest.mark.parametrize("unwrap", ["head", "angle", "angle[0]"])
def test_angles_of_a_file_are_unwrapped_in_their_own_unit(tmp_path: Path, unwrap: str):
    rows = "".join(f"{k};{(50 * k) % 360};{k}\n" for k in range(20))
    (tmp_path / "run.csv").write_text(f"time;head [deg];x\n{rows}")
    angle, x = ca.SX.sym("angle", 1), ca.SX.sym("x")
    states = [wo.Signal("angle", angle, unit="angle"), wo.Signal("x", x)]
    model = wo.Model("turn", x=states, ode=ca.SX([1, 1]))
    table = RecordingFile(file="run.csv", columns={"head": "angle[0]"}, unwrap=(unwrap,))
    assert list(table.faults_in(tmp_path, "SI", {})) == []
    (run,) = runs_of([table], tmp_path, model, "SI", {}, "scene")
    expected = np.deg2rad(50.0) * np.arange(20)
    assert run.recording.readings["angle"][0] == pytest.approx(expected, abs=1e-12)
    wrong = RecordingFile(file="run.csv", columns={"head": "angle[0]"}, unwrap=("haed",))
    ((key, said),) = wrong.faults_in(tmp_path, "SI", {})
    assert (key, said) == ("unwrap", "the file has no column haed; did you mean head?")


@pytest.mark.parametrize(
    ("rate", "pause", "guessed"), [(0.4, 5.0, False), (0.4, 9.0, True), (-3.0, 1.5, True)]
)
def test_turns_over_a_pause_are_a_guess(tmp_path: Path, rate: float, pause: float, guessed: bool):
    """Half a turn takes pi / |rate|; gaps of readings and of times are pauses alike."""
    time = np.arange(0.0, 20.0, 0.5)
    seen = np.mod(rate * time, 2 * np.pi)
    during = (time > 4) & (time < 4 + pause)
    gap, less = np.where(during, np.nan, seen), ~during
    for t, row in ((time, gap), (time[less], seen[less])):
        said = wo.Recording(t, {"phi": row}, unwrap=["phi"]).warnings
        assert bool(said) == guessed
        assert all("phi[0] has no reading from t = 4 to" in one for one in said)
    phi = ca.SX.sym("phi")
    model = wo.Model("turn", x=[wo.Signal("phi", phi, unit="angle")], ode=ca.SX(1))
    rows = zip(time[less].tolist(), seen[less].tolist(), strict=True)
    text = "".join(f"{t},{value!r}\n" for t, value in rows)
    (tmp_path / "run.csv").write_text(f"time,phi\n{text}")
    table = RecordingFile(file="run.csv", unwrap=("phi",))
    (run,) = runs_of([table], tmp_path, model, "SI", {}, "scene")
    assert bool(run.warnings) == guessed
    assert all("run: column phi has no reading from t = 4" in one for one in run.warnings)


@pytest.mark.parametrize("fill", [None, -999.0])
def test_fill_values_of_netcdf_are_gaps(tmp_path: Path, fill: float | None):
    given = DECAY.copy()
    given[5] = 9.969209968386869e36 if fill is None else fill
    with netcdf_file(tmp_path / "run.nc", "w") as file:
        file.createDimension("time", len(TIME))
        for name, values in (("time", TIME), ("x", given)):
            variable = file.createVariable(name, "d", ("time",))
            variable[:] = values
            if fill is not None:
                variable._FillValue = fill
    table = RecordingFile(file="run.nc")
    (run,) = runs_of([table], tmp_path, spring(), "dimensionless", {}, "scene")
    assert run.recording.count == len(TIME) - 1
    assert np.isnan(run.recording.readings["x"][0, 5])


# -- fields ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["{}", "xi;H [kA/m]\r\n{}", "# xi H\n{}"])
def test_a_field_is_read_in_any_dialect(tmp_path: Path, text: str):
    values = 1.0 + 0.5 * np.cos(grid(16))
    comma, factor = ";" in text, 1e3 if "kA" in text else 1.0
    mark = ";" if comma else " "
    rows = [f"{t!r}{mark}{v!r}" for t, v in zip(grid(16).tolist(), values.tolist(), strict=True)]
    body = "\n".join(rows)
    path = tmp_path / "field.csv"
    path.write_text(text.format(body.replace(".", ",") if comma else body))
    assert _read_table(path, "field", "SI") == pytest.approx(factor * values, rel=1e-15)


def test_a_field_in_another_unit_is_refused(tmp_path: Path):
    path = tmp_path / "field.csv"
    path.write_text("H [mT]\n1\n2\n3\n4\n")
    with pytest.raises(ArgumentError, match=r'field\.csv: "mT" is not a unit of field here; '):
        _read_table(path, "field", "SI")
    path.write_text("H\n1\n2\n\n#N/A\n4\n")
    with pytest.raises(ArgumentError, match=r"field\.csv line 5, column H: a number is missing"):
        _read_table(path, "field", "SI")
