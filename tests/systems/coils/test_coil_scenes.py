"""Scenes of the kinds "coil-row" and "coil-inverse": results, trust, refusals, pictures."""

import dataclasses
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outcomes import failed_checks, refusals, value

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SceneError, SolveError
from wormopt.magnetics.coils import Coil, CoilRow, field_by_quadrature
from wormopt.magnetics.material import MU0
from wormopt.magnetics.travelling import MovingProfile
from wormopt.ocp.nlp import Ipopt
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.coils import coil_inverse, coil_row, row_currents
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.courses import carried_film

ROW, INVERSE = "travelling_field", "coil_row_inverse"
SMALL = ("coils.count=12", "line.margin=2", "search.nodes=16", "search.places=2")
QUICK = (*SMALL, "coils.count=8", "line.margin=1", "search.starts=1")
EVEN = "coils.gap=15e-3"


def solved(name: str, *changes: str) -> Result:
    return wo.run(load_scene(name, list(changes)))


def wrong_field(*given: Any) -> np.ndarray:
    return 1.001 * field_by_quadrature(*given)


@pytest.fixture(scope="module")
def row() -> Result:
    return solved(ROW)


@pytest.fixture(scope="module")
def inverse() -> Result:
    return solved(INVERSE, *SMALL, EVEN, "search.starts=3", "coils.ampere_turns=8000")


def test_a_row_of_another_size_has_the_same_ripple(row: Result):
    """Many instants of the analysis are those of switches, which rounding must not divide."""
    small = ("pitch=1e-8", "inner_radius=2e-9", "outer_radius=4.5e-9", "length=20e-9")
    sizes = [f"coils.{size}" for size in small]
    height, gap = (row.scalars[name].value for name in ("line_height", "coil_gap"))
    sizes += [f"line.height={1e-6 * height}", *([] if gap is None else [f"coils.gap={1e-6 * gap}"])]
    assert value(solved(ROW, *sizes), "ripple") == pytest.approx(value(row, "ripple"), rel=1e-9)


def test_the_travelling_field(row: Result):
    assert row.status == "ok"
    assert value(row, "wave_speed") == pytest.approx(10e-3 * 50)
    assert value(row, "wavelength") == pytest.approx(0.2)
    assert value(row, "frequency") == pytest.approx(2.5)
    assert row.trust["recheck"]["error"] < 1e-12
    # three coils in the middle of the row, on the axis of the middle one, by quadrature
    coils = CoilRow(Coil(2e-3, 4.5e-3, 20e-3), 20, 10e-3, gap=11e-3)
    currents = np.zeros((20, 1))
    currents[9:12] = 3000.0
    second = field_by_quadrature(coils, np.array([0.1]), 0.0, currents)
    assert value(row, "field_max") == pytest.approx(float(np.linalg.norm(second)), rel=2e-3)
    assert row["field"].values.max() == value(row, "field_max")
    assert row["current"].values.sum(axis=0).tolist() == [9000.0] * 20


def test_the_field_moves_by_a_pitch_a_step(row: Result):
    x, field = row["place"].values, row["field"].values
    steps = np.round(10e-3 / (x[1] - x[0])).astype(int)
    inside = (x > 30e-3) & (x < 150e-3)
    for step in range(4, 12):
        moved = np.roll(field[step], steps)
        near = inside & (np.abs(x - 10e-3 * (step + 2)) < 30e-3)
        # the ends of the row are far, and the rest of it is the same
        assert field[step + 1][near] == pytest.approx(moved[near], rel=1e-9)


def test_shares_of_harmonics_are_those_of_the_field_shown(row: Result):
    x, field = row["place"].values, row["field"].values
    shares = np.array(value(row, "harmonic_shares"))
    # coils 8 to 10 on, coil 9 in the middle: one wavelength about it, by the trapezoidal rule
    points = 0.09 + 0.2 * (np.arange(4096) / 4096 - 0.5)
    profile = np.interp(points, x, field[8])
    power = np.abs(np.fft.rfft(profile - profile.mean())[1:]) ** 2
    assert shares == pytest.approx(power[:8] / power.sum(), abs=2e-3)
    assert value(row, "first_harmonic_share") == shares[0]


def test_a_wider_gap_evens_the_field_out(row: Result):
    even = solved(ROW, "coils.gap=20e-3", "coils.count=12")
    assert value(even, "field_max") < 0.5 * value(row, "field_max")
    assert value(even, "ripple") < value(row, "ripple")


def test_a_row_without_current_and_one_all_on_have_no_wave():
    none = solved(ROW, "switching.ampere_turns=0", "coils.count=8", "line.margin=1")
    assert (value(none, "field_max"), value(none, "ripple")) == (0.0, None)
    assert any("no wave" in text for text in none.trust["warnings"])
    still = solved(ROW, "switching.on=4", "switching.every=4", "coils.count=8", "line.margin=1")
    assert value(still, "field_max") > 0
    assert value(still, "ripple") is None  # its variation is that of rounding
    assert any("does not travel" in text for text in still.trust["warnings"])


def test_a_field_that_is_not_confirmed_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(coil_row, "field_by_quadrature", wrong_field)
    result = solved(ROW, "coils.count=8", "line.margin=1")
    assert result.status == "failed"
    assert "by quadrature differs" in result.reason
    assert failed_checks(result) == ["field by quadrature"]


def test_the_field_that_a_wave_needs(inverse: Result):
    assert inverse.status == "ok"
    xi = inverse["phase"].values
    # (31) by hand, the pressure mu0 (mu_r - 1) H^2 / 2 in units of P = eta omega / eps^2
    delta, eps = 0.15, 0.2e-3 * 2 * math.pi / 0.1
    P = 0.01 * 0.4 / eps**2
    W = 0.03 * 0.2e-3 * (2 * math.pi / 0.1) ** 2 / P
    s, c = np.sin(xi), np.cos(xi)
    D = -W * delta * c + 3 * delta * s * (2 + delta * c) / ((2 + delta**2) * (1 + delta * c) ** 2)
    reference = value(inverse, "H0") ** 2 - 2 * P / (MU0 * 0.09) * D
    assert inverse["square_target"].values == pytest.approx(reference, rel=1e-9, abs=1.0)
    assert value(inverse, "H0") >= value(inverse, "H0_least") * (1 - 1e-9)
    assert value(inverse, "mean_flow") == pytest.approx(3 * delta**2 / (2 + delta**2))


def test_the_row_comes_near_to_it(inverse: Result):
    assert value(inverse, "field_residual") < 0.12
    assert value(inverse, "field_residual_mean") < value(inverse, "field_residual")
    assert value(inverse, "field_residual") == pytest.approx(
        value(inverse, "field_residual_program"), rel=0.1
    )
    mean, wanted = inverse["square_mean"].values, inverse["square_target"].values
    off = np.sqrt(np.mean((mean - wanted) ** 2)) / np.std(wanted)
    assert value(inverse, "field_residual_mean") == pytest.approx(off)
    unit = 2 * value(inverse, "pressure_unit") / (MU0 * 0.09)
    assert inverse["pressure_mean"].values == pytest.approx(mean / unit, rel=1e-9)


def test_the_film_that_results_is_steady_under_the_rows_field(inverse: Result):
    """C = -int h^-2 / int h^-3 holds for the shapes of steady films only."""
    h = inverse["film_thickness"].values
    assert h.mean() == pytest.approx(1.0, abs=1e-9)
    flow = 1 - np.mean(h**-2.0) / np.mean(h**-3.0)
    assert inverse.scalars["film_mean_flow"].value == pytest.approx(flow, abs=1e-9)
    wave = 1 + inverse_delta(inverse) * np.cos(inverse["film_phase"].values)
    assert inverse.scalars["film_distance"].value == pytest.approx(
        np.abs(h - wave).max(), abs=1e-12
    )
    assert inverse.scalars["film_distance"].value < 0.5 * inverse_delta(inverse)
    assert inverse.scalars["film_growth_rate"].value < 0
    assert inverse.trust["film_residual"] < 1e-8


def inverse_delta(result: Result) -> float:
    return json.loads(result.scene_text)["wave"]["delta"]


def test_the_trust_report_of_currents(inverse: Result):
    trust = inverse.trust
    assert trust["violation"] < 1e-9
    assert trust["bound_violation"] == 0
    assert trust["recheck"]["error"] < 1e-11
    found = [start["residual"] for start in trust["starts"]]
    assert min(found) == pytest.approx(value(inverse, "field_residual_program"), rel=1e-5)
    assert len(found) == 3


def test_currents_are_read_back_as_a_gait(inverse: Result, tmp_path: Path):
    inverse.save(tmp_path)
    course = wo.load_gait(tmp_path)
    t = inverse["time"].values[:-1]
    assert course(t) == pytest.approx(inverse["current"].values[:, :-1], abs=1e-6)
    assert course.period == pytest.approx(value(inverse, "period"))


def test_too_little_current_is_told():
    weak = solved(INVERSE, *QUICK, "coils.ampere_turns=1000")
    assert value(weak, "currents_max") == pytest.approx(1000, rel=1e-6)
    assert value(weak, "currents_share") <= 1
    assert any("at the limit of 1000 ampere-turns" in text for text in weak.trust["warnings"])
    assert weak.status == "ok"
    assert value(weak, "field_residual") > 0.5
    words = "worse than a constant" if value(weak, "field_residual") >= 1 else "far from the wanted"
    assert any(words in text and "ampere-turns" in text for text in weak.trust["warnings"])


@cache
def quick_fit() -> row_currents.RowFit:
    return load_scene(INVERSE, list(QUICK)).table.fit


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The currents of QUICK are found once: what follows does not change them."""
    found = quick_fit()
    monkeypatch.setattr(coil_inverse, "fit_currents", lambda *_, **__: found)


@pytest.mark.usefixtures("fitted")
@pytest.mark.parametrize(
    ("residual", "words"),
    [(1.0, "worse than a constant field"), (0.7, "far from the wanted"), (0.5, "")],
)
def test_a_poor_field_is_told(residual: float, words: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(MovingProfile, "residual", lambda self, wanted: residual)
    warnings = solved(INVERSE, *QUICK).trust["warnings"]
    told = [text for text in warnings if "field_residual is" in text]
    assert len(told) == bool(words)
    assert all(words in text and "a smaller wave" in text for text in told)


@pytest.mark.usefixtures("fitted")
def test_a_film_that_newton_did_not_solve_is_unknown(monkeypatch: pytest.MonkeyPatch):
    film = carried_film(CosineWave(0.1), np.zeros(64), 0.1)
    assert film is not None
    unsolved = dataclasses.replace(film, residual=2e-6)
    monkeypatch.setattr(coil_inverse, "carried_film", lambda *_: unsolved)
    result = solved(INVERSE, *QUICK)
    for name in ("film_distance", "film_mean_flow", "film_growth_rate"):
        assert value(result, name) is None
    assert "film_thickness" not in {variable.name for variable in result.variables}
    assert result.trust["film_residual"] == 2e-6
    assert any("the resulting film is unknown" in text for text in result.trust["warnings"])


def test_limits_of_the_currents_hold():
    slow = solved(INVERSE, *QUICK, "limits.slew=600", 'limits.polarity="one"')
    assert value(slow, "slew_max") == pytest.approx(600, rel=1e-6)
    assert slow["current"].values.min() >= 0
    turned = solved(INVERSE, *QUICK, EVEN, 'limits.polarity="alternating"')
    assert turned["time"].values[-1] == pytest.approx(2 * value(turned, "period"))


def test_a_field_given_is_kept():
    assert value(solved(INVERSE, *QUICK, "wave.field=16000"), "H0") == pytest.approx(16000)


def test_currents_not_found_are_a_failure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(row_currents, "Ipopt", lambda: Ipopt(iterations=1))
    with pytest.raises(SolveError, match="none of 1 starts") as caught:
        solved(INVERSE, *QUICK)
    assert caught.value.partial.status == "failed"
    arguments = ["run", INVERSE, "-o", str(tmp_path / "out"), "--quiet", "--no-plots"]
    assert main([*arguments, *(part for change in QUICK for part in ("--set", change))]) == 3


@pytest.mark.usefixtures("fitted")
def test_a_field_of_currents_that_is_not_confirmed_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(coil_inverse, "field_by_quadrature", wrong_field)
    result = solved(INVERSE, *QUICK)
    assert result.status == "failed"
    assert "by quadrature differs" in result.reason
    assert failed_checks(result) == ["field by quadrature"]


test_what_no_row_can_be_is_refused = refusals(
    ROW,
    """
    coils.inner_radius=5e-3 | coils.inner_radius | not below outer_radius
    coils.pitch=8e-3 | coils.pitch | overlap; write at least 0.009
    coils={axis="along", pitch=10e-3} | coils.pitch | coils.length
    coils={axis="along", length=8e-3, gap=1e-3} | coils.gap | leave it out
    coils.gap=1e-30 | coils.gap | write at least 2e-14
    coils={axis="across"} | line.height | a coil inside the fluid
    line.margin=10 | line.margin | write at most 9
    switching.on=21 | switching.on | do not fit
    switching.every=21 | switching.every | exceeds the 20 coils
    switching.ampere_turns=3001 | switching.ampere_turns | at most
    units="dimensionless" | units | units = "SI"
    want=["row_currents"] | want[0] | travelling_field
    coils.count=1 & line.margin=0 & switching.on=1 | coils.count | at least 2
    """,
)
test_what_no_inverse_can_be_is_refused = refusals(
    INVERSE,
    """
    coils.pitch=8e-3 | coils.pitch | overlap
    wave.wavelength=15e-3 | wave.wavelength | at least 0.02
    wave.field=1e4 | wave.field | H0 = 10000 A/m is below the least, 14301
    """,
)


@pytest.mark.parametrize(
    ("coils", "height", "fine"),
    [
        ("axis='along', length=8e-3", 1e-3, True),
        ("axis='along', length=8e-3, inner_radius=1e-3", 0.0, True),
        ("axis='along', length=8e-3", -3e-3, False),
        ("axis='along', length=8e-3", 5e-3, True),
        ("axis='across'", 4.5e-3, False),
        ("axis='across'", -4.6e-3, True),
        ("axis='across', gap=1e-3", 0.0, True),
        ("axis='vertical'", 10e-3, False),
        ("axis='vertical'", 10.1e-3, True),
        ("axis='vertical', gap=8e-3", 3.9e-3, True),
        ("axis='vertical', gap=8e-3", 4.1e-3, False),
        ("axis='vertical', gap=8e-3", 24.1e-3, True),
    ],
)
def test_coils_inside_the_fluid_are_those_that_the_line_meets(
    coils: str, height: float, fine: bool
):
    text = "coils={" + coils.replace("'", '"') + "}"
    changes = [text, f"line.height={height}"]
    if fine:
        made = load_scene(ROW, changes).table.coils.row
        assert made.clearance(np.linspace(-10e-3, 200e-3, 5001), height).min() > 0
        return
    with pytest.raises(SceneError, match="a coil inside the fluid"):
        load_scene(ROW, changes)
