"""Gaits: printed formulas, derivatives, profiles, and the way through files and back."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.model.gait import Gait
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.shared.sequences import block_wave_sequence
from wormopt.systems.spiked.construct import (
    Profile,
    accordion,
    block_wave,
    fast_gait,
    gait_of_result,
    load_gait,
)

# How many derivatives of the lengths are continuous.
SMOOTHNESS: dict[Profile, int] = {"cosine": 1, "quintic": 2, "trapezoid": 1}
# Largest rate and acceleration of a unit stroke in unit time, from the profile's definition:
# (1 - cos pi s)/2, 10 s^3 - 15 s^4 + 6 s^5, and a rate that rises and falls for a quarter each.
PEAKS: dict[Profile, tuple[float, float]] = {
    "cosine": (math.pi / 2, math.pi**2 / 2),
    "quintic": (15 / 8, 10 / math.sqrt(3)),
    "trapezoid": (4 / 3, 16 / 3),
}


def printed_gait(t: float, l0: float, e: float) -> tuple[float, float]:
    """Gait (15) as printed, its components parted, t in periods."""
    t = t % 1.0
    c = math.cos(3 * math.pi * t)
    first = l0 * (1 - e * (-1 + c)) if t < 2 / 3 else l0
    if t < 1 / 3:
        return first, l0 * (1 - e * (1 - c))
    return first, l0 * (1 - 2 * e) if t < 2 / 3 else l0 * (1 - e * (1 + c))


@given(t=st.floats(-20, 20), period=st.floats(0.1, 10))
def test_gait_15_repeats(t: float, period: float):
    """Three half turns of 3 pi t fill a period, an odd number: t itself must be wrapped."""
    found = fast_gait(period)(np.array([t * period]))[:, 0]
    assert found == pytest.approx(printed_gait(t, 2.0, 0.15), abs=1e-12)


def jumps(gait: Gait, derivative: int) -> np.ndarray:
    """Jumps of a derivative at all breaks, the period's end with its start among them."""
    widths = np.diff(gait.breaks)
    ends = [gait.on_piece(q, widths[q : q + 1], derivative) for q in range(gait.pieces)]
    starts = [gait.on_piece(q, np.zeros(1), derivative) for q in range(gait.pieces)]
    return np.array([e - s for e, s in zip(ends, starts[1:] + starts[:1], strict=True)])


@pytest.mark.parametrize("profile", SMOOTHNESS)
@pytest.mark.parametrize(("links", "resting"), [(1, 1), (2, 1), (2, 2), (5, 1), (5, 3), (5, 5)])
def test_profiles_join_smoothly_and_keep_their_peaks(profile: Profile, links: int, resting: int):
    period, short, long = 1.7, 0.8, 1.3
    gaits = [(links + 1, block_wave(links, resting, period, (short, long), profile))]
    if resting == 1:
        gaits.append((2, accordion(links, period, (short, long), profile)))
    for phases, gait in gaits:
        for derivative in range(SMOOTHNESS[profile] + 1):
            assert np.abs(jumps(gait, derivative)).max() < 1e-11
        if profile != "cosine" or phases > 2:  # two half swings make one whole harmonic
            assert np.abs(jumps(gait, SMOOTHNESS[profile] + 1)).max() > 1
        t = np.union1d(np.linspace(0, period, 20_001), gait.breaks)
        lengths = gait(t)
        assert lengths.min(axis=1) == pytest.approx([short] * links, abs=1e-12)
        assert lengths.max(axis=1) == pytest.approx([long] * links, abs=1e-12)
        for derivative, peak in enumerate(PEAKS[profile], start=1):
            size = (long - short) * (phases / period) ** derivative
            assert np.abs(gait(t, derivative)).max() == pytest.approx(peak * size, rel=1e-3)


def test_a_trapezoid_with_steep_or_full_ramps():
    """No ramp leaves a constant rate with corners, ramps of a half a triangle of twice that."""
    t = np.linspace(0, 1, 1001)[:-1] + 5e-4
    rates = {
        ramp: block_wave(1, 1, 1.0, (1.0, 1.5), "trapezoid", ramp)(t, 1) for ramp in (0.0, 0.5)
    }
    assert np.abs(rates[0.0]) == pytest.approx(np.ones((1, 1000)))
    assert np.abs(rates[0.5]).max() == pytest.approx(2.0, rel=3e-3)
    assert rates[0.5].sum() / 1000 == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("links", range(1, 9))
def test_a_block_of_neighbours_runs_from_tail_to_head(links: int):
    for resting in range(1, links + 1):
        sequence = block_wave_sequence(links, resting)
        assert len(set(sequence)) == links + 1
        assert all(len(phase) == resting for phase in sequence)
        for phase, following in zip(sequence, sequence[1:] + sequence[:1], strict=True):
            assert {(i - 1) % (links + 1) for i in phase} == set(following)
    assert block_wave_sequence(2, 1) == [(2,), (1,), (0,)]


def sample_gait(seed: int = 0, links: int = 3) -> Gait:
    """Three pieces of degree 4 with harmonics; not continuous, which derivatives do not need."""
    random = np.random.default_rng(seed)
    return Gait(
        np.array([0.0, 0.4, 1.0, 1.5]),
        random.normal(size=(3, links, 5)),
        random.uniform(1, 7, 3),
        random.normal(size=(3, links)),
        random.normal(size=(3, links)),
    )


@pytest.mark.parametrize("derivative", range(4))
def test_each_derivative_is_the_slope_of_the_one_before(derivative: int):
    """Central differences of step h are wrong by h^2: slope 2 between two steps."""
    gait = sample_gait()
    errors = []
    for h in (2e-2, 1e-2):
        worst = size = 0.0
        for piece in range(3):
            s = np.linspace(0, 0.5, 23)
            ahead, behind = (gait.on_piece(piece, s + d, derivative) for d in (h, -h))
            slope = gait.on_piece(piece, s, derivative + 1)
            worst = max(worst, float(np.abs((ahead - behind) / (2 * h) - slope).max()))
            size = max(size, float(np.abs(slope).max()))
        errors.append(worst / size)
    assert 1.9 < math.log2(errors[0] / errors[1]) < 2.1
    assert errors[1] < 0.1


@given(t=st.floats(0, 1.49), factor=st.floats(0.05, 20), derivative=st.integers(0, 3))
def test_another_period_runs_through_the_same_shape(t: float, factor: float, derivative: int):
    gait = sample_gait()
    slow = gait.with_period(1.5 * factor)
    assert slow.period == 1.5 * factor
    piece = int(np.searchsorted(gait.breaks, t, side="right")) - 1
    s = np.array([t - gait.breaks[piece]])
    expected = gait.on_piece(piece, s, derivative) / factor**derivative
    found = slow.on_piece(piece, s * factor, derivative)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-11 / factor**derivative)


def test_at_a_break_the_later_piece_counts():
    gait = sample_gait()
    for piece, t in enumerate(gait.breaks[:-1]):
        assert np.array_equal(gait(np.array([t])), gait.on_piece(piece, np.zeros(1)))
    assert np.array_equal(gait(np.array([1.5])), gait.on_piece(0, np.zeros(1)))


@pytest.mark.parametrize(
    ("breaks", "extra", "message"),
    [
        ([0.0, 1.0, 2.0], {}, "one more than there are pieces"),
        ([0.5, 1.0], {}, "ascend from 0"),
        ([0.0, 0.0], {}, "ascend from 0"),
        ([0.0, -1.0], {}, "ascend from 0"),
        ([0.0, float("nan")], {}, "finite numbers"),
        ([0.0, [1.0]], {}, "finite numbers"),
        ([0.0, 1.0], {"omega": np.ones(1)}, "go together"),
        (
            [0.0, 1.0],
            {"omega": np.ones(1), "cosine": np.ones((1, 3)), "sine": np.ones((1, 2))},
            "shape",
        ),
    ],
)
def test_gaits_that_make_no_sense_are_refused(breaks: Any, extra: dict, message: str):
    with pytest.raises(ValueError, match=message):
        Gait(breaks, np.ones((1, 2, 1)), **extra)


# --- Files -------------------------------------------------------------------------------


def wave_of_harmonics() -> Gait:
    """Smooth in all derivatives: two links swing a third of a turn apart."""
    cosine = np.array([[0.3, -0.15]])
    sine = np.array([[0.0, 0.3 * math.sqrt(3) / 2]])
    return Gait(
        np.array([0.0, 1.6]), np.ones((1, 2, 1)), np.array([2 * math.pi / 1.6]), cosine, sine
    )


def test_the_rows_of_a_table_come_back_exactly(tmp_path: Path):
    gait = block_wave(3, 2, 0.7, (1.0, 1.4), "quintic")
    gait.to_csv(tmp_path / "gait.csv", 29)
    t = np.linspace(0, 0.7, 29)[:-1]
    assert Gait.from_csv(tmp_path / "gait.csv")(t) == pytest.approx(gait(t), abs=1e-15)


def test_a_table_of_a_result_is_read_by_its_lengths(tmp_path: Path):
    gait, path = fast_gait(1.0), tmp_path / "gait.csv"
    gait.to_csv(path, samples=21, units="SI")
    header, *rows = path.read_text("utf-8").splitlines()
    told = [f"{row},{k},-1,nan,none" for k, row in enumerate(rows)]
    remarks = ["# a gait, (1, 2)", "  # made by hand"]
    lines = [*remarks, f"{header},position_0 [m],sigma [N],length_small [m],note", *told, ""]
    (tmp_path / "more.csv").write_text("\n".join(lines), "utf-8")
    t = np.linspace(0, 1, 97)
    assert np.array_equal(Gait.from_csv(tmp_path / "more.csv")(t), Gait.from_csv(path)(t))


@pytest.mark.parametrize("header", ["t,l_0,l_1", "t,length_0,l_1", "time,a,b"])
@pytest.mark.parametrize("remark", ["", "# "])
def test_names_of_columns_are_free_and_numpy_writes_them_as_a_remark(
    tmp_path: Path, header: str, remark: str
):
    t = np.linspace(0, 1, 21)
    table = np.column_stack([t, *fast_gait(1.0)(t)])
    path = tmp_path / "table.csv"
    np.savetxt(path, table, delimiter=",", header=header, comments=remark)
    assert np.array_equal(Gait.from_csv(path)(t), table[:, 1:].T)


@settings(max_examples=examples(40))
@given(
    omega=st.floats(0.1, 10),
    sizes=st.lists(st.floats(0.01, 0.45), min_size=1, max_size=3),
    samples=st.integers(4, 200),
)
def test_what_a_table_loses_is_at_most_what_theory_says(
    tmp_path_factory: pytest.TempPathFactory, omega: float, sizes: list[float], samples: int
):
    """The error of a periodic cubic spline is at most 5/384 h⁴ max|f⁗| (Hall, Meyer)."""
    n, period = len(sizes), 2 * math.pi / omega
    amplitudes = [np.array([sizes]), np.zeros((1, n))]
    gait = Gait(np.array([0.0, period]), np.ones((1, n, 1)), np.array([omega]), *amplitudes)
    path = tmp_path_factory.mktemp("table") / "gait.csv"
    gait.to_csv(path, samples, derivatives=2, units="SI")
    back, t = Gait.from_csv(path), np.linspace(0, period, 997)
    assert (back.period, back.links) == (period, n)
    for derivative in range(3):
        scale = max(np.abs(back(t, derivative)).max(), 1)
        assert np.abs(jumps(back, derivative)).max() < 1e-9 * scale
    bound = 5 / 384 * (omega * period / (samples - 1)) ** 4 * np.array(sizes)
    assert np.all(np.abs(back(t) - gait(t)).max(axis=1) <= bound + 1e-14)


def table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a file, as texts."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    return head.split(","), [row.split(",") for row in rows]


def test_times_of_a_table_are_the_decimals_one_would_write(tmp_path: Path):
    gait = wave_of_harmonics()
    gait.to_csv(tmp_path / "gait.csv", step=0.01)
    _, rows = table(tmp_path / "gait.csv")
    assert [row[0] for row in rows] == [str(k / 100) for k in range(161)]
    gait.to_csv(tmp_path / "gait.csv", 161)
    assert table(tmp_path / "gait.csv")[1] == rows


@pytest.mark.parametrize(
    ("period", "step", "times"),
    [
        (1.0, 0.3, ["0.0", "0.3", "0.6", "0.9", "1.0"]),
        (0.1 + 0.2, 0.1, ["0.0", "0.1", "0.2", "0.30000000000000004"]),
        (0.9, 0.3, ["0.0", "0.3", "0.6", "0.9"]),
    ],
)
def test_a_table_ends_with_the_period(tmp_path: Path, period: float, step: float, times: list[str]):
    gait = fast_gait(period)
    gait.to_csv(tmp_path / "gait.csv", step=step, derivatives=2)
    _, rows = table(tmp_path / "gait.csv")
    assert [row[0] for row in rows] == times
    assert rows[0][1:] == rows[-1][1:]
    assert load_gait(tmp_path / "gait.csv").period == period


def test_a_table_holds_rates_and_accelerations_with_units(tmp_path: Path):
    gait, path, omega = wave_of_harmonics(), tmp_path / "gait.csv", 2 * math.pi / 1.6
    gait.to_csv(path, step=0.05, derivatives=2, units="SI")
    head, rows = table(path)
    units = {"length": "m", "rate": "m s-1", "acceleration": "m s-2"}
    assert head == ["time [s]", *(f"{k}_{j} [{u}]" for k, u in units.items() for j in range(2))]
    t, *columns = np.array(rows, dtype=float).T
    first = 0.3 * np.exp(1j * omega * t)
    second = 0.3 * np.exp(1j * omega * t - 2j * math.pi / 3)
    expected = [(1j * omega) ** k * link for k in range(3) for link in (first, second)]
    expected = np.real(expected) + np.array([1, 1, 0, 0, 0, 0])[:, None]
    assert np.array(columns) == pytest.approx(expected, abs=1e-13)
    assert Gait.from_csv(path).links == 2
    gait.to_csv(path, step=0.05)
    assert table(path)[0] == ["time", "length_0", "length_1"]


def test_a_row_at_a_break_shows_the_later_piece(tmp_path: Path):
    """0.1 + 0.2 is the break, 0.3 the row; the acceleration jumps from 1 to -1 there."""
    late = 0.1 + 0.2
    up, down = [[1.0, 0.0, 0.5]], [[1.0 + late**2 / 2, late, -0.5]]
    gait = Gait(np.array([0.0, late, 3 * late]), np.array([up, down]))
    gait.to_csv(tmp_path / "gait.csv", step=0.1, derivatives=2)
    rows = {row[0]: row for row in table(tmp_path / "gait.csv")[1]}
    assert float(rows["0.3"][3]) == -1.0
    assert float(rows["0.2"][3]) == 1.0


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"step": 0.0}, "step must be a positive number"),
        ({"step": math.nan}, "step must be a positive number"),
        ({"step": 0.9}, "write at most 0.533333"),
        ({"samples": 3}, "at least 4 samples, not 3"),
        ({"derivatives": 3}, "derivatives must be 0, 1 or 2"),
    ],
)
def test_tables_that_say_too_little_are_refused(tmp_path: Path, asked: dict, message: str):
    with pytest.raises(ValueError, match=message):
        wave_of_harmonics().to_csv(tmp_path / "gait.csv", **asked)
    assert not list(tmp_path.iterdir())


GOOD = ["t,l_0,l_1", "0,1,1", "0.3,1.2,1", "0.6,1.1,0.9", "1,1,1"]


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(GOOD),
        "\r\n".join(GOOD) + "\r\n",
        "\ufeff" + "\n".join(GOOD) + "\n\n",
        "\n\n".join(GOOD).replace(",", ", "),
    ],
    ids=["plain", "crlf", "byte order mark", "blanks"],
)
def test_tables_from_any_editor_are_read(tmp_path: Path, text: str):
    path = tmp_path / "gait.CSV"
    path.write_bytes(text.encode())
    gait = load_gait(path)
    assert (gait.links, gait.period) == (2, 1.0)
    assert gait(np.array([0.3, 1.6])) == pytest.approx(np.array([[1.2, 1.1], [1.0, 0.9]]))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "header"),
        (GOOD[:1], "at least 4 rows"),
        (GOOD[:1] + GOOD[1:3] + GOOD[-1:], "at least 4 rows"),
        (["t", "0", "1", "2", "3"], "header"),
        ([*GOOD[1:], "2,1,1"], "header"),
        ([*GOOD[:2], "0.3,fast,1", *GOOD[3:]], 'line 3, column l_0: "fast" is not a number'),
        ([*GOOD[:2], "0.3,,1", *GOOD[3:]], "column l_0 has 3 numbers; write at least 4 rows"),
        ([*GOOD[:2], "0.3,1.2", *GOOD[3:]], "line 3: 2 cells for 3 columns"),
        ([*GOOD[:2], "0.3,nan,1", *GOOD[3:]], "column l_0 has 3 numbers"),
        (
            [*GOOD[:1], "0,#N/A,1", "0.1,1,1", *GOOD[2:]],
            "line 2, column l_0: the length is missing",
        ),
        ([*GOOD[:2], "0.3,inf,1", *GOOD[3:]], "finite"),
        ([*GOOD[:2], "nan,1.2,1", *GOOD[3:]], "finite"),
        ([*GOOD[:-1], "1,1,1.01"], "closed period"),
        (GOOD[:1] + GOOD[:0:-1], "ascend from 0"),
        ([*GOOD[:2], "0,1.2,1", *GOOD[3:]], "occurs twice"),
        (["t,l_0,l_1", "0.1,1,1", *GOOD[2:]], "ascend from 0"),
        ([*GOOD[:2], "0.3,-1.2,1", *GOOD[3:]], "positive"),
        ([*GOOD[:2], "0.3,0,1", *GOOD[3:]], "positive"),
        (["t;l_0;l_1", "0;1;1", "0.3;1.2;1", "0.6;1;1", "1;1"], "line 5: 2 cells for 3 columns"),
        (["t,rate_0", "0,0", "0.3,1", "0.6,-1", "1,0"], "header t,l_0"),
        ([*GOOD[:2], "0.3," + "1" * 200000 + ",1", *GOOD[3:]], "CSV text"),
    ],
)
def test_hostile_tables_are_refused_with_a_reason(tmp_path: Path, rows: list[str], message: str):
    path = tmp_path / "gait.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        load_gait(path)


@pytest.mark.parametrize(
    "content", [b"t,l_0\n0,\xff\xfe1\n", b"\x00\x01\x02" * 40, "t,l_0\n0,1".encode("utf-16")]
)
def test_a_file_that_is_no_text_is_refused(tmp_path: Path, content: bytes):
    path = tmp_path / "gait.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"CSV text in UTF-8|header|contains text|has 1 row"):
        load_gait(path)


def test_a_file_that_is_not_there_is_an_oserror(tmp_path: Path):
    for name in ("gait.csv", "result.nc", "folder"):
        with pytest.raises(OSError, match=name):
            load_gait(tmp_path / name)


@pytest.mark.parametrize("gait", [fast_gait(0.7), block_wave(3, 2, 1.1, (0.9, 1.3), "quintic")])
def test_a_gait_comes_back_from_a_saved_result_bit_by_bit(tmp_path: Path, gait: Gait):
    variables = tuple(
        Variable(f"gait_{name}", "1", GAIT[f"gait_{name}"][1], values)
        for name, values in gait.arrays().items()
    )
    Result("walk", "gait", variables=variables).save(tmp_path)
    for path in (tmp_path, tmp_path / "result.nc"):
        back = load_gait(path)
        assert back.arrays().keys() == gait.arrays().keys()
        for name, values in gait.arrays().items():
            assert np.array_equal(back.arrays()[name], values)


def test_a_result_without_a_gait_is_refused():
    with pytest.raises(ValueError, match="'walk' contains no gait"):
        gait_of_result(Result("walk", "gait"))
