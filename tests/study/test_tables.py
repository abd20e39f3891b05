"""Tables in text files: what spreadsheets, loggers and programs write is read back."""

import contextlib
import csv
import io
import math
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SceneError
from wormopt.model.gait import Gait
from wormopt.systems.film.given_field import _read_table
from wormopt.systems.film.shapes import grid
from wormopt.systems.recorded.recording_file import RecordingFile
from wormopt.systems.recorded.recordings import runs_of
from wormopt.tables import TextTable, Wrong, parse_table, read_table


def read(content: str | bytes, folder: Path, **how: str) -> tuple[TextTable | None, list[Wrong]]:
    path, wrong = folder / "table.csv", list[Wrong]()
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_table(path, wrong, **how), wrong  # pyright: ignore[reportArgumentType]


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
    table: np.ndarray,
    *,
    separator: str = ",",
    comma: bool = False,
    quoted: bool = False,
    encoding: str = "utf-8",
    end: str = "\n",
    tail: str = "",
    gap: str = "",
    remark: bool = False,
    units: str = "square",
    above: tuple[str, ...] | list[str] = (),
) -> bytes:
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


NUMBERS = st.one_of(st.floats(-1e9, 1e9), st.integers(-1000, 1000).map(float), st.just(math.nan))


@pytest.mark.parametrize("dialect", DIALECTS)
@settings(max_examples=examples(20))
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=4, max_size=12),
    step=st.floats(0.01, 1000.0),
)
def test_ten_dialects_hold_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory,
    dialect: str,
    rows: list[tuple[float, float]],
    step: float,
):
    table = np.array([[step * k, *row] for k, row in enumerate(rows)])
    table[0, 1:] = [0.5, -2.0]  # so that no column is all gaps
    content = written(table, **DIALECTS[dialect])
    found, wrong = read(content, tmp_path_factory.mktemp("table"), time="t")
    assert wrong == []
    assert found is not None
    assert found.units == {"t": "ms", "x": "µm"}
    assert list(found.values) == ["t", "x", "n"]
    assert np.array_equal(np.array([*found.values.values()]).T, table, equal_nan=True)


def test_names_are_found_without_a_column_that_is_known(tmp_path: Path):
    table = np.array([[0.0, 1.5, 2.0], [1.0, -2.5, 3.0], [2.0, math.nan, 4.0]])
    for how in DIALECTS.values():
        found, wrong = read(written(table, **how), tmp_path)
        assert wrong == []
        assert found is not None
        assert found.units == {"t": "ms", "x": "µm"}
        assert np.array_equal(np.array([*found.values.values()]).T, table, equal_nan=True)


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
    wrong = list[Wrong]()
    table = parse_table((head + body).replace("|", separator), wrong)
    assert table is not None
    assert not wrong
    assert list(table.values) == ["t", "x", "y"]
    assert table.units == {"t": "s", "x": "mm", "y": "mm"}


def test_a_gap_at_the_start_of_a_line_is_no_remark():
    wrong: list[Wrong] = []
    found = parse_table("x,time\n#N/A,0\n#DIV/0!,1\n3,2\n# 4,3\n", wrong, time="time")
    assert found is not None
    assert found.values["time"] == (0.0, 1.0, 2.0)
    assert np.isnan(found.values["x"][:2]).all()


def test_a_name_may_go_on_in_the_next_line():
    wrong: list[Wrong] = []
    found = parse_table('time,"head\n[mm]",tail\n0,1,2\n1,2,3\n', wrong, time="time")
    assert found is not None
    assert found.units == {"head": "mm"}
    assert found.lines == (3, 4)


def test_rows_and_cells_of_a_spreadsheet_that_are_empty_are_left_out():
    wrong: list[Wrong] = []
    found = parse_table("time;x;;\n0;1;;\n;;;\n1;2;;\n;;;\n", wrong, time="time")
    assert wrong == []
    assert found is not None
    assert found.values == {"time": (0.0, 1.0), "x": (1.0, 2.0)}


def test_a_typesetters_minus_is_a_minus():
    wrong: list[Wrong] = []
    found = parse_table("time;x\n0;\u22121,5\n1;2\n", wrong, time="time")
    assert found is not None
    assert found.values["x"] == (-1.5, 2.0)


PIECES = st.sampled_from(
    [
        *("0", "1.5", "2,5", "-3e-1", "1_0", "inf", "nan", "", "#N/A", "\u2212", "\ufeff"),
        *("t", "time", "l_0 [mm]", "x\n", "# ", "%", "[", "]", "(", ")", "/"),
        *('"', ";", ",", "\t", " ", "\n", "\n", "\r\n"),
    ]
)


@settings(max_examples=examples(200))
@given(text=st.lists(PIECES, max_size=30).map("".join), time=st.sampled_from(["", "time"]))
def test_whatever_a_text_holds_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, time: str
):
    for named in (True, False):
        wrong: list[Wrong] = []
        found = parse_table(text, wrong, time=time, named=named)
        assert found is not None or wrong
        if found is not None:
            assert {len(column) for column in found.values.values()} == {len(found.lines)}
    path = gait_file(tmp_path_factory.mktemp("gait"), text)
    with contextlib.suppress(ArgumentError):
        assert wo.load_gait(path).period > 0


@settings(max_examples=examples(100))
@given(content=st.binary(max_size=60))
def test_whatever_bytes_a_file_holds_they_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
):
    found, wrong = read(content, tmp_path_factory.mktemp("table"))
    assert found is not None or wrong


# -- gait tables -----------------------------------------------------------------------------------


def gait_file(folder: Path, text: str | bytes) -> Path:
    path = folder / "gait.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


SMOOTH = "0;60;60\n400;75;50\n800;65;70\n1200;60;60\n"


@pytest.mark.parametrize(
    "head", ["t [ms];l_0 [mm];l_1 [mm]", "t (ms);l_0 (mm);l_1 (mm)", "t / ms;l_0/mm;l_1/mm",
             "t;l_0;l_1\nms;mm;mm", "time [ms];length_0 [mm];length_1 [mm]",
             "t in ms;l_0 in mm;l_1 (in mm)", "t in [ms];l_0 IN [mm];l_1 in mm"]
)  # fmt: skip
def test_units_of_a_gait_table_are_converted(tmp_path: Path, head: str):
    gait = wo.load_gait(gait_file(tmp_path, f"{head}\n{SMOOTH}"))
    assert gait.period == pytest.approx(1.2, rel=1e-15)
    assert gait(np.array([0.0, 0.4, 0.8])) == pytest.approx(
        np.array([[0.06, 0.075, 0.065], [0.06, 0.05, 0.07]]), rel=1e-14
    )


@pytest.mark.parametrize(
    ("head", "units", "said"),
    [
        ("t [ms];l_0 [mm];l_1 [mm]", "dimensionless", 'column t: a unit, "ms", in a scene without'),
        ("t [mm];l_0 [mm];l_1 [mm]", "SI", 'column t: "mm" is no unit of time; write "s" or "ms"'),
        ("t [ms];l_0 [mm];l_1 [N]", "SI", 'column l_1: "N" is no unit of length; write "m" or'),
        ("t [ms];l_0 [furlong];l_1", "SI", 'column l_0: "furlong" has a unit that is not known'),
        ("t_ms;l_0_mm;l_1_mm", "SI", r'column t_ms: "ms" seems to be its unit; write t \[ms\]'),
        ("t [ms];l_0 mm;l_1 [mm]", "SI", r'column l_0 mm: "mm" seems to be .* write l_0 \[mm\]'),
        ("t [ms];l_0 {mm};l_1 [mm]", "SI", r'"mm" seems to be its unit; write l_0 \[mm\]'),
        ("t [ms];l0mm;l1mm", "SI", r'"mm" seems to be its unit; write l0 \[mm\]'),
        ("t [ms];l_0 [mm] left;l_1 [mm]", "SI", r'"mm" seems to be its unit; write l_0 \[mm\]'),
        ("t [ms];l_0 in millimetres;l_1 [mm]", "SI", r'"mm" seems to be .* write l_0 \[mm\]'),
        ("t in ms;l_0;l_1", "dimensionless", 'column t: a unit, "ms", in a scene without'),
        (
            "t;l_0 mm;l_1 mm",
            "dimensionless",
            'column l_0 mm: "mm" seems to be its unit; write l_0$',
        ),
    ],
)
def test_units_that_cannot_be_converted_are_refused(
    tmp_path: Path, head: str, units: str, said: str
):
    path = gait_file(tmp_path, f"{head}\n{SMOOTH}")
    with pytest.raises(ArgumentError, match=rf"gait\.csv.*{said}"):
        wo.load_gait(path, units=units)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ('0,"1,234.5"\n1,"2,345.6"', '"1,234.5" has separators of thousands; write 1234.5'),
        ('0,"1,234"\n1,"2,345"', '"1,234" may be 1234 or 1.234'),
        ("0;1,234\n1;2,345", '"1,234" may be 1234 or 1.234'),
        ("0;999\n1;1,234", '"1,234" may be 1234 or 1.234'),
        ("0;1,234,567\n1;7", '"1,234,567" has separators of thousands; write 1234567'),
        ("0;1.234,5\n1;2.345,6", '"1.234,5" has separators of thousands; write 1234.5'),
        ("0;1.234.567\n1;1.234.567", '"1.234.567" has separators of thousands; write 1234567'),
        ("0;1'234\n1;2'345", '"1\'234" has separators of thousands; write 1234'),
        ("0;1 234\n1;2 345", '"1 234" has separators of thousands; write 1234'),
        ("0;1_234.5\n1;2_345.5", '"1_234.5" has separators of thousands; write 1234.5'),
        ("0,1,234.5\n1,2,345.6", "and numbers without separators of thousands"),
        ("0 1,234.5\n1 2,345.6", "and numbers without separators of thousands"),
    ],
)
def test_separators_of_thousands_are_refused(cells: str, said: str):
    wrong: list[Wrong] = []
    head = "t;x" if ";" in cells else "t,x" if "," in cells.split()[0] else "t x"
    parse_table(f"{head}\n{cells}\n", wrong)
    assert said in wrong[0][1]
    assert "line " in wrong[0][1]


@pytest.mark.parametrize("cells", ["0,5;1,234\n1,0;2,345", "0;0,123\n1;2,345", "0;1,2345\n1;2,345"])
def test_decimal_commas_with_three_digits_are_read(cells: str):
    wrong: list[Wrong] = []
    table = parse_table(f"t;x\n{cells}\n", wrong)
    assert table is not None
    assert not wrong
    assert table.values["x"][1] == 2.345


def scene_of(folder: Path, units: str) -> dict:
    return {
        "schema": 1, "kind": "gait", "units": units,
        "worm": {"links": 2, "mass": 1.0, "load": 20.0},
        "want": ["gait"],
        "gait": {"shape": "file", "file": str(folder / "gait.csv")},
    }  # fmt: skip


def test_a_scene_in_si_converts_the_units_of_its_gait(tmp_path: Path):
    gait_file(tmp_path, f"t [ms];l_0 [mm];l_1 [mm]\n{SMOOTH}")
    result = wo.run(scene_of(tmp_path, "SI"))
    assert result["length"].values.max() < 0.08
    assert result["time"].values[-1] == pytest.approx(1.2)
    with pytest.raises(SceneError, match=r'gait\.file: gait\.csv line 1, column t: a unit, "ms"'):
        wo.run(scene_of(tmp_path, "dimensionless"))


def test_a_result_in_si_is_no_gait_of_a_scene_without_units(tmp_path: Path):
    gait_file(tmp_path, f"t [ms];l_0 [mm];l_1 [mm]\n{SMOOTH}")
    (tmp_path / "si").mkdir()
    wo.run(scene_of(tmp_path, "SI")).save(tmp_path / "si")
    scene = scene_of(tmp_path, "dimensionless")
    scene["gait"]["file"] = str(tmp_path / "si" / "result.nc")
    with pytest.raises(SceneError, match=r'gait\.file: .*the gait is in m, .* write units = "SI"'):
        wo.run(scene)


STEPS = [(0.0, 1.0), (0.2, 1.0), (0.201, 1.2), (0.4, 1.2), (0.401, 1.0), (0.6, 1.0), (0.601, 1.1),
         (0.8, 1.1), (0.801, 1.0), (1.0, 1.0)]  # fmt: skip


def test_a_steep_table_keeps_within_its_own_lengths(tmp_path: Path):
    rows = "".join(f"{t},{a},{2.2 - a}\n" for t, a in STEPS)
    gait = wo.load_gait(gait_file(tmp_path, f"t,l_0,l_1\n{rows}"))
    t = np.linspace(0.0, 1.0, 100_001)
    lengths = gait(t)
    assert lengths[0].min() >= 1.0 - 1e-12
    assert lengths.max() <= 1.2 + 1e-12
    # between two rows it is never outside them, either
    a = np.array([a for _, a in STEPS])
    k = np.clip(np.searchsorted([t for t, _ in STEPS], t, side="right") - 1, 0, len(a) - 2)
    low, high = np.minimum(a[k], a[k + 1]), np.maximum(a[k], a[k + 1])
    assert np.all((lengths[0] >= low - 1e-12) & (lengths[0] <= high + 1e-12))
    assert len(gait.warnings) == 2
    assert "column l_0 is steep (after line 2, 4, 6, ...)" in gait.warnings[0]
    widths = np.diff(gait.breaks)
    before = [gait.on_piece(p - 1, widths[[p - 1]], 1)[:, 0] for p in range(gait.pieces)]
    jumps = gait(gait.breaks[:-1], 1) - np.transpose(before)
    assert np.abs(jumps).max() < 1e-9 * np.abs(gait(t, 1)).max()


def test_a_step_within_one_of_many_rows_is_steep_too(tmp_path: Path):
    """A spline would leave the two levels by an eighth of the step, on both sides of it."""
    rows = "".join(f"{k / 100},{1.0 + 0.1 * (20 <= k < 60)}\n" for k in range(101))
    gait = wo.load_gait(gait_file(tmp_path, f"t,l_0\n{rows}"))
    lengths = gait(np.linspace(0.0, 1.0, 10_001))
    assert (lengths.min(), lengths.max()) == pytest.approx((1.0, 1.1), abs=1e-12)


def test_the_scene_says_that_its_table_is_steep(tmp_path: Path):
    rows = "".join(f"{t},{a},{2.2 - a}\n" for t, a in STEPS)
    gait_file(tmp_path, f"t,l_0,l_1\n{rows}")
    result = wo.run(scene_of(tmp_path, "dimensionless"))
    said = [w for w in result.trust["warnings"] if "is steep" in w]
    assert len(said) == 2
    assert "interpolated by PCHIP" in said[0]


@pytest.mark.parametrize(("rows", "told"), [(12, True), (40, False)])
def test_a_spline_that_adds_more_than_one_percent_is_told(tmp_path: Path, rows: int, told: bool):
    """Rows of a sine that has its extremes in the middle between two of them."""
    t = np.linspace(0.0, 1.0, rows + 1)
    lengths = 1.0 + 0.1 * np.sin(2 * math.pi * t + math.pi / rows + math.pi / 2)
    text = "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), lengths.tolist(), strict=True))
    gait = wo.load_gait(gait_file(tmp_path, f"t,l_0\n{text}"))
    assert gait(np.linspace(0, 1, 2001)).max() == pytest.approx(1.1, abs=1e-3 if told else 1e-6)
    found = [re.search(r"l_0: the spline adds up to (\S+) % ", text) for text in gait.warnings]
    added = 100 * (1 - math.cos(math.pi / rows)) / (2 * math.cos(math.pi / rows))
    assert [float(m[1]) for m in found if m] == [pytest.approx(added, rel=0.05)] * told


def test_gaps_of_a_gait_table_are_bridged_and_told(tmp_path: Path):
    t = np.linspace(0.0, 1.0, 41)
    lengths = 1.0 + 0.1 * np.cos(2 * math.pi * t)
    cells = [repr(v) for v in lengths.tolist()]
    cells[7], cells[30] = "#N/A", ""
    text = "".join(f"{a!r},{b},1\n" for a, b in zip(t.tolist(), cells, strict=True))
    gait = wo.load_gait(gait_file(tmp_path, f"t,l_0,l_1\n{text}"))
    assert gait(t)[0] == pytest.approx(lengths, abs=1e-5)
    assert gait.warnings == ("column l_0: 2 gaps are bridged by interpolation",)


def test_a_gait_table_of_a_spreadsheet_is_read(tmp_path: Path):
    text = "\r\n".join(["Zeit;;", "t;l_0;l_1", "0;1;1", "0,3;1,2;1", "0,6;1,1;0,9", "1;1;1"])
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "cp1252"):
        gait = wo.load_gait(gait_file(tmp_path, text.encode(encoding)))
        assert gait(np.array([0.3, 0.6])) == pytest.approx(
            np.array([[1.2, 1.1], [1.0, 0.9]]), rel=1e-15
        )


@pytest.mark.parametrize("suffix", [".txt", ".TSV", ".dat"])
def test_text_of_other_names_is_a_table_too(tmp_path: Path, suffix: str):
    """Spreadsheets call what is parted by tabs .txt."""
    gait_file(tmp_path, f"t [ms];l_0 [mm];l_1 [mm]\n{SMOOTH}".replace(";", "\t").encode("utf-16"))
    (tmp_path / "gait.csv").rename(tmp_path / f"gait{suffix}")
    scene = scene_of(tmp_path, "SI")
    scene["gait"]["file"] = f"{tmp_path}/gait{suffix}"
    assert wo.run(scene).scalars["period"].value == pytest.approx(1.2)


def test_an_instant_with_two_rows_is_a_break_of_the_rates(tmp_path: Path):
    """A triangle: the rate is 1, then -1, and no spline rounds its corners."""
    text = "t,l_0\n0,1\n0.25,1.25\n0.5,1.5\n0.5,1.5\n0.75,1.25\n1,1\n"
    gait = wo.load_gait(gait_file(tmp_path, text))
    t = np.array([0.1, 0.4999, 0.5, 0.9])
    assert gait(t)[0] == pytest.approx([1.1, 1.4999, 1.5, 1.1], rel=1e-14)
    assert gait(t, 1)[0] == pytest.approx([1.0, 1.0, -1.0, -1.0], rel=1e-12)


def test_lengths_that_jump_are_refused_by_their_line(tmp_path: Path):
    text = "t,l_0\n0,1\n0.25,1.25\n0.5,1.5\n0.5,1.4\n0.75,1.25\n1,1\n"
    with pytest.raises(ArgumentError, match=r"line 5: time 0\.5 stands twice, and the lengths"):
        wo.load_gait(gait_file(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# gait: length, cycle 1,2\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", '"1,2" in a remark'),
        ("# gait: length, cycle 9\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", r"line 5: rows end"),
        ("# gait: length, cycle 0.5\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", "has 2 rows of numbers"),
        ("t,l_0 [1e999 m]\n0,1\n0.4,1\n0.8,1\n1,1\n", "is too large or too small a size"),
        ("t,l_0\n0,1\n0.4,1e40\n0.8,1\n1,1\n", r"line 3, column l_0: 1e\+40 is no size of a worm"),
    ],
)  # fmt: skip
def test_cycles_and_sizes_that_cannot_be_are_refused(tmp_path: Path, text: str, said: str):
    with pytest.raises(ArgumentError, match=rf"^gait\.csv.*{said}"):
        wo.load_gait(gait_file(tmp_path, text))


@settings(max_examples=examples(30))
@given(
    cuts=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=4),
    knots=st.lists(st.floats(0.5, 2.0), min_size=8, max_size=8),
)
def test_a_piecewise_cubic_with_its_breaks_is_read_to_the_last_digits(
    tmp_path_factory: pytest.TempPathFactory, cuts: list[float], knots: list[float]
):
    breaks = np.concatenate([[0.0], np.cumsum([0.5, *cuts])])
    lengths = np.array([*knots[: len(breaks) - 1], knots[0]])
    slope = np.diff(lengths) / np.diff(breaks)
    bend = np.array(knots[: len(slope)]) / 10  # a parabola that is 0 at both ends of a piece
    pieces = np.stack([lengths[:-1], slope - bend * np.diff(breaks), bend], axis=1)
    gait = Gait(breaks, pieces[:, None, :])
    stream = io.StringIO()
    writer = csv.writer(stream)
    writer.writerow(["t", "l_0"])
    for piece, (a, b) in enumerate(pairwise(breaks.tolist())):
        for t in (a, (2 * a + b) / 3, (a + 2 * b) / 3, b):
            writer.writerow([t, *gait.on_piece(piece, np.array([t - a])).ravel().tolist()])
    path = gait_file(tmp_path_factory.mktemp("gait"), stream.getvalue())
    back, t = wo.load_gait(path), np.linspace(0.0, float(breaks[-1]), 501)
    assert back(t) == pytest.approx(gait(t), abs=1e-9)


# -- recordings ------------------------------------------------------------------------------------


def spring(k: float = 0.4) -> wo.Model:
    """x' = -k x, whose rate is to be found."""
    x, rate = ca.SX.sym("x"), ca.SX.sym("k")
    return wo.Model(
        "decay", x=[wo.Signal("x", x)], p=[wo.Signal("k", rate, value=1.0)], ode=-rate * x
    )


TIME = np.linspace(0.0, 4.0, 41)
DECAY = np.exp(-0.4 * TIME)


def found_of(run: wo.Recording) -> float:
    task = wo.FitTask(spring(), [run], [wo.Unknown("k", lower=0.01, upper=5.0)])
    fit = wo.fit(task, seeds=1)
    assert fit.converged
    return float(fit.values[0])


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
    assert found_of(run) == pytest.approx(0.4, rel=1e-6)


def test_a_mask_is_not_dropped_anywhere():
    with pytest.raises(ArgumentError, match="time 1 is nan"):
        wo.Recording(
            np.ma.array([0.0, 1.0, 2.0], mask=[False, True, False]), {"x": [1.0, 2.0, 3.0]}
        )
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
    data = xr.Dataset(
        {"position": (("time", "mass"), place.T, {"units": "m"}), "x": ("time", DECAY)}
    )
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
    model = wo.Model(
        "turn",
        x=[wo.Signal("phi", phi, unit="angle")],
        p=[wo.Signal("rate", rate, value=1.0)],
        ode=rate,
    )
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
    with pytest.raises(ArgumentError, match="unwrap names signals that were read, a list of phi"):
        wo.Recording(time, {"phi": seen}, unwrap=["psi"])


@pytest.mark.parametrize("unwrap", ["head", "angle", "angle[0]"])
def test_angles_of_a_file_are_unwrapped_in_their_own_unit(tmp_path: Path, unwrap: str):
    rows = "".join(f"{k};{(50 * k) % 360};{k}\n" for k in range(20))
    (tmp_path / "run.csv").write_text(f"time;head [deg];x\n{rows}")
    angle, x = ca.SX.sym("angle", 1), ca.SX.sym("x")
    model = wo.Model(
        "turn", x=[wo.Signal("angle", angle, unit="angle"), wo.Signal("x", x)], ode=ca.SX([1, 1])
    )
    table = RecordingFile(file="run.csv", columns={"head": "angle[0]"}, unwrap=(unwrap,))
    assert list(table.faults_in(tmp_path, "SI")) == []
    (run,) = runs_of([table], tmp_path, model, "SI", {}, "scene")
    expected = np.deg2rad(50.0) * np.arange(20)
    assert run.recording.readings["angle"][0] == pytest.approx(expected, abs=1e-12)
    wrong = RecordingFile(file="run.csv", columns={"head": "angle[0]"}, unwrap=("haed",))
    ((key, said),) = wrong.faults_in(tmp_path, "SI")
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


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_recording_of_a_spreadsheet_with_decimal_commas_is_fitted(tmp_path: Path, encoding: str):
    cells = [f"{v:.12f}".replace(".", ",") for v in DECAY]
    cells[3], cells[9], cells[11] = "#N/A", "", "#DIV/0!"
    times = [f"{1000 * t:.1f}".replace(".", ",") for t in TIME]
    rows = [f"{t};{x}" for t, x in zip(times, cells, strict=True)]
    text = "\r\n".join(["Messung 7 (µm)", "time [ms];x", *rows, ";"])
    (tmp_path / "run.csv").write_bytes(text.encode(encoding))
    table = RecordingFile(file="run.csv", start={"x": 1.0})
    assert list(table.faults_in(tmp_path, "SI")) == []
    (run,) = runs_of([table], tmp_path, spring(), "SI", {}, "scene")
    assert run.recording.count == len(TIME) - 3
    assert found_of(run.recording) == pytest.approx(0.4, rel=1e-6)


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
    with pytest.raises(
        ArgumentError, match=r'field\.csv: "mT" is not a unit of field here; write A'
    ):
        _read_table(path, "field", "SI")
    path.write_text("H\n1\n2\n\n#N/A\n4\n")
    with pytest.raises(ArgumentError, match=r"field\.csv line 5, column H: a number is missing"):
        _read_table(path, "field", "SI")


# -- pictures without a backend --------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        "run",
        "plot",
        pytest.param("sweep", marks=pytest.mark.slow),
        pytest.param("report", marks=pytest.mark.slow),
    ],
)
def test_a_backend_that_is_not_there_is_refused_before_the_work(command: str, tmp_path: Path):
    """In a process of its own, as Matplotlib takes the backend when it is loaded."""
    wo.Result("walk", "gait").save(tmp_path)
    words = {
        "run": ["run", "fast_gait", "-o", "out"],
        "sweep": ["sweep", "fast_gait", "--over", "worm.load=[1,2]", "-o", "out"],
        "plot": ["plot", str(tmp_path)],
        "report": ["report", str(tmp_path), "-o", "out.html"],
    }[command]
    done = subprocess.run(
        [sys.executable, "-m", "wormopt", *words], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "MPLBACKEND": "nonsense"},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("MPLBACKEND=nonsense: Matplotlib has no such backend, or it is not in")
    assert ("--no-plots" in line) == (command in ("run", "sweep"))
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "result.nc").exists()


def test_without_pictures_no_backend_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    asked = ["run", "fast_gait", "--no-plots", "--quiet", "-o", str(tmp_path / "out")]
    assert main(asked) == 0
