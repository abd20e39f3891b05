"""Tables of gaits: units, steep steps, gaps, breaks, refusals."""

import contextlib
import csv
import io
import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from effort import examples
from hints import Folders
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.errors import ArgumentError, SceneError
from wormopt.model.gait import Gait
from wormopt.tables import Wrong, parse_table


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
        ("t [ms];l_0 [mm];l_1 [mm]", "dimensionless", 'column t: the unit "ms" needs an SI scene'),
        ("t [mm];l_0 [mm];l_1 [mm]", "SI", 'column t: "mm" is not a unit of time; write "s"'),
        ("t [ms];l_0 [mm];l_1 [N]", "SI", 'column l_1: "N" is not a unit of length; write "m" or'),
        ("t [ms];l_0 [furlong];l_1", "SI", 'column l_0: "furlong" has a unit that is not known'),
        ("t_ms;l_0_mm;l_1_mm", "SI", r'column t_ms: "ms" seems to be its unit; write t \[ms\]'),
        ("t [ms];l_0 mm;l_1 [mm]", "SI", r'column l_0 mm: "mm" seems to be .* write l_0 \[mm\]'),
        ("t [ms];l_0 {mm};l_1 [mm]", "SI", r'"mm" seems to be its unit; write l_0 \[mm\]'),
        ("t [ms];l0mm;l1mm", "SI", r'"mm" seems to be its unit; write l0 \[mm\]'),
        ("t [ms];l_0 [mm] left;l_1 [mm]", "SI", r'"mm" seems to be its unit; write l_0 \[mm\]'),
        ("t [ms];l_0 in millimetres;l_1 [mm]", "SI", r'"mm" seems to be .* write l_0 \[mm\]'),
        ("t in ms;l_0;l_1", "dimensionless", 'column t: the unit "ms" needs an SI scene'),
        ("t;l_0 mm;l_1 mm", "dimensionless", 'column l_0 mm: "mm" seems to be .*; write l_0$'),
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
    assert (wrong, table.values["x"][1]) == ([], 2.345)


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
    with pytest.raises(SceneError, match=r'gait\.file: gait\.csv line 1, column t: the unit "ms"'):
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
    with pytest.raises(ArgumentError, match=r"line 5: time 0\.5 occurs twice with different"):
        wo.load_gait(gait_file(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# gait: length, cycle 1,2\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", '"1,2" in a remark'),
        ("# gait: length, cycle 9\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", r"line 5: rows end"),
        ("# gait: length, cycle 0.5\ntime,length_0\n0,1\n0.4,1\n0.8,1\n", "has 2 rows of numbers"),
        ("t,l_0 [1e999 m]\n0,1\n0.4,1\n0.8,1\n1,1\n", "is too large or too small"),
        ("t,l_0\n0,1\n0.4,1e40\n0.8,1\n1,1\n", r"column l_0: 1e\+40 is too small or too large"),
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
    tmp_path_factory: Folders, cuts: list[float], knots: list[float]
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


PIECES = st.sampled_from(
    [
        *("0", "1.5", "2,5", "-3e-1", "1_0", "inf", "nan", "", "#N/A", "\u2212", "\ufeff"),
        *("t", "time", "l_0 [mm]", "x\n", "# ", "%", "[", "]", "(", ")", "/"),
        *('"', ";", ",", "\t", " ", "\n", "\n", "\r\n"),
    ]
)


@settings(max_examples=examples(200))
@given(text=st.lists(PIECES, max_size=30).map("".join), time=st.sampled_from(["", "time"]))
def test_whatever_a_text_holds_is_read_or_refused(tmp_path_factory: Folders, text: str, time: str):
    for named in (True, False):
        wrong: list[Wrong] = []
        found = parse_table(text, wrong, time=time, named=named)
        assert found is not None or wrong
        if found is not None:
            assert {len(column) for column in found.values.values()} == {len(found.lines)}
    path = gait_file(tmp_path_factory.mktemp("gait"), text)
    with contextlib.suppress(ArgumentError):
        assert wo.load_gait(path).period > 0
