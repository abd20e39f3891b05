"""Scenes of kind film-forward: where films go, maps, branches, fields of one's own, refusals."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from outcomes import refusals, run_text, value

import wormopt as wo
from wormopt.errors import SceneError, SolveError
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.shapes import grid

SCENE = """schema = 1
kind = "film-forward"
[film]
delta = 0.5
tension = 0.1
[time]
periods = 20
[grid]
points = 64
most = 64
[tolerance]
recheck = false
"""
FLUID = (
    "fluid={mu_r=1.05, viscosity=0.05, density=1100.0, surface_tension=0.028, depth=1e-4, "
    "wavelength=1e-2, frequency=10.0}"
)


def run(folder: Path, *changes: str, text: str = SCENE) -> Result:
    return run_text(folder, text, *changes)


@cache
def packaged() -> Result:
    return wo.run(load_scene("film_forward", ["time.periods=20"]))


@pytest.mark.slow
def test_the_packaged_film_takes_the_wave():
    result = packaged()
    assert result.status == "ok"
    assert value(result, "outcome") == "wave"
    assert value(result, "distance_to_wave") < 1e-9
    assert value(result, "volume_error") < 1e-12
    assert value(result, "mean_flow") == pytest.approx(1 / 3, abs=1e-9)
    assert value(result, "growth_rate_max") == pytest.approx(-0.36195857, abs=1e-7)
    assert value(result, "branches") == 1
    assert result.trust["resolution_difference"] < 1e-9
    assert result.trust["closed_form_difference"] < 1e-10
    assert result.trust["warnings"] == []
    assert len(result.checks) == 6
    assert all(check.passed for check in result.checks)


def test_signals_of_a_course():
    result = packaged()
    h, end = result["thickness"].values, result["thickness_end"].values
    assert h.shape == (len(result["time"].values), len(result["xi"].values))
    assert np.all(h[0] == pytest.approx(1.0))
    assert np.array_equal(h[-1], end)
    assert result["flow_end"].values == pytest.approx(end + CosineWave(0.5).constant, abs=1e-8)
    assert result["field_pressure"].values.min() == pytest.approx(0.0, abs=1e-3)
    delta, crest = result["branch_delta"].values, result["branch_thickness_max"].values
    assert crest == pytest.approx(1 + delta, abs=1e-6)
    flow = 3 * delta**2 / (2 + delta**2)
    assert result["branch_mean_flow"].values == pytest.approx(flow, abs=1e-6)


def test_a_flat_film_goes_elsewhere_though_the_wave_is_stable(tmp_path: Path):
    result = run(tmp_path, "film.tension=0.01", "grid.points=128", "grid.most=128")
    assert value(result, "outcome") == "other"
    assert value(result, "growth_rate_max") < 0
    assert value(result, "growth_rate_end") < 0
    assert value(result, "distance_to_steady") < 1e-9
    assert value(result, "thickness_max") == pytest.approx(3.256, abs=2e-3)
    assert any("does not reach it" in text for text in result.trust["warnings"])


def test_from_near_the_wave_the_same_film_stays(tmp_path: Path):
    start = 'start={shape="wave", nudge=0.05, harmonic=2}'
    result = run(tmp_path, "film.tension=0.01", start)
    assert value(result, "outcome") == "wave"


def test_an_unstable_wave_is_left(tmp_path: Path):
    start = 'start={shape="wave", nudge=1e-4}'
    changes = ("film.delta=0.9", "film.tension=1.0", "grid.points=128", "grid.most=128", start)
    result = run(tmp_path, *changes)
    assert value(result, "outcome") == "other"
    assert value(result, "growth_rate_max") == pytest.approx(0.50024, abs=1e-4)
    assert value(result, "distance_to_wave") > 0.1
    assert any("wave is unstable" in text for text in result.trust["warnings"])
    time = result["time"].values
    apart = np.abs(result["thickness"].values - result["thickness_wave"].values).max(axis=1)
    early = (apart > 1e-3) & (apart < 1e-2)
    rate = np.polyfit(time[early], np.log(apart[early]), 1)[0]
    assert rate == pytest.approx(0.50, abs=0.05)


def test_a_film_that_breaks_is_located(tmp_path: Path):
    changes = ("time.rupture=0.5", "film.tension=0.03", "time.periods=10")
    result = run(tmp_path, *changes)
    assert result.status == "unchecked"
    assert value(result, "outcome") == "breaks"
    last = result["thickness_end"].values
    assert last.min() == pytest.approx(0.5, abs=5e-3)
    assert last.min() < 0.5
    assert value(result, "broke_xi") == result["xi"].values[np.argmin(last)]
    assert result["time"].values[-1] == value(result, "broke_time")
    assert (result["thickness"].values[:-1].min(axis=1) >= 0.5).all()


def test_a_film_the_points_cannot_hold_fails_with_the_place(tmp_path: Path):
    result = run(
        tmp_path, "film.delta=0.9", "film.tension=0.01", "grid.points=32", "grid.most=32",
        "time.rupture=1e-6", "time.periods=2",
    )  # fmt: skip
    assert result.status == "failed"
    assert "32 points do not resolve the film" in result.reason
    assert "grid.most" in result.reason
    (lost,) = (check for check in result.checks if not check.passed)
    assert (lost.name, lost.advice) == ("points hold the film", result.reason)


def test_too_few_steps_are_told(tmp_path: Path):
    with pytest.raises(SolveError, match="steps was reached"):
        run(tmp_path, "tolerance.max_steps=20")


@pytest.mark.slow
def test_a_map_has_all_outcomes(tmp_path: Path):
    """Flat films take the wave, go to a drop, break; each with the spectrum that explains it."""
    table = "map={delta=[0.5, 0.9, 0.98], tension=[0.01, 0.1, 1.0]}"
    grid_ = ("grid.points=128", "grid.most=256", "time.periods=100")
    result = run(tmp_path, table, *grid_, 'want=["basins"]')
    outcome, growth = result["map_outcome"].values, result["map_growth"].values
    names = [["wave", "other", "moving", "breaks", "unresolved"][k] for k in outcome.ravel()]
    found = np.reshape(names, outcome.shape)
    assert found[0].tolist() == ["other", "wave", "wave"]
    assert found[1, 2] == "other"
    assert found[2, 2] == "breaks"
    assert (growth[0] < 0).all()
    assert growth[1, 2] == pytest.approx(0.50024, abs=1e-4)
    assert value(result, "map_wave") == int(np.sum(found == "wave")) == 2
    assert value(result, "map_breaks") == int(np.sum(found == "breaks"))
    assert value(result, "map_wave_stable_not_reached") >= 1


def test_a_small_map(tmp_path: Path):
    result = run(tmp_path, "map={delta=[0.3, 0.5], tension=[0.01, 0.1]}", "time.rupture=0.48")
    outcome = result["map_outcome"].values
    assert outcome.tolist() == [[0, 0], [3, 0]]  # the drop's film is thinner than 0.48
    assert result["map_growth"].values[1] == pytest.approx([-0.6310779, -0.3619586], abs=1e-5)
    assert value(result, "map_wave") == 3
    assert value(result, "map_wave_stable_not_reached") == 1


def samples(points: int = 48) -> np.ndarray:
    wave = CosineWave(0.5)
    return wave.peak(0.1).value - wave.field_function(grid(points), 0.1)


def with_field(field: str) -> str:
    return SCENE + f"[field]\n{field}\n"


@pytest.mark.parametrize("form", ["list", "squared", "field", "csv", "two columns", "result"])
def test_a_field_of_samples_makes_the_same_film(tmp_path: Path, form: str):
    pressure = samples()
    square = 8 * math.pi * pressure / (1.2 - 1)
    text = {
        "list": f"samples = {pressure.tolist()}",
        "squared": f'samples = {square.tolist()}\nquantity = "field_squared"\nmu_r = 1.2',
        "field": f'samples = {np.sqrt(square).tolist()}\nquantity = "field"\nmu_r = 1.2',
        "csv": 'file = "field.csv"',
        "two columns": 'file = "both.csv"',
        "result": 'file = "earlier"\nvariable = "field_pressure"',
    }[form]
    np.savetxt(tmp_path / "field.csv", pressure)
    both = np.column_stack([grid(len(pressure)), pressure])
    np.savetxt(tmp_path / "both.csv", both, delimiter=",", header="xi,field", comments="")
    (tmp_path / "earlier").mkdir()
    earlier = Variable("field_pressure", "1", ("xi",), pressure)
    Result("row", "film-forward", variables=(earlier,)).save(tmp_path / "earlier")
    # H of 48 samples has a kink where it is 0, its square has none: both are squared at samples
    result = run(tmp_path, text=with_field(text))
    assert value(result, "outcome") == "wave"
    assert value(result, "distance_to_wave") < 1e-6
    assert result["field_pressure"].values[::4] == pytest.approx(samples(16), abs=1e-5)


def test_si_fields_are_those_of_the_fluid(tmp_path: Path):
    oil = wo.run("film_field")
    assert oil["field"].unit == "A m-1"
    H = oil["field"].values
    H = H[:-1] if len(H) % 2 else H
    field = f'field={{quantity="field", samples={H.tolist()}}}'
    changes = ('units="SI"', f"film={{delta=0.5, {FLUID}}}", field, 'start={shape="wave"}')
    result = run(tmp_path, *changes)
    assert value(result, "tension_number") == pytest.approx(
        oil.scalars["tension_number"].value, rel=1e-12
    )
    assert value(result, "distance_to_wave") < 1e-4


def test_a_field_that_is_off_makes_a_film_that_is_off(tmp_path: Path):
    """The steady film next to the wave is reached; its distance is that from the wave itself."""
    off = samples() + 0.02 * np.cos(2 * grid(48))
    result = run(tmp_path, text=with_field(f"samples = {off.tolist()}"))
    assert value(result, "outcome") == "wave"
    assert value(result, "distance_to_steady") < 1e-9
    wave = CosineWave(0.5).height(result["xi"].values)
    apart = np.abs(result["thickness_end"].values - wave).max()
    assert value(result, "distance_to_wave") == pytest.approx(apart)
    assert 1e-3 < apart < 0.1
    assert any("compared with that wave" in text for text in result.trust["warnings"])


def test_a_field_needs_no_wave(tmp_path: Path):
    field = "[field]\nsamples = [0.0, 0.3, 0.5, 0.5, 0.3, 0.1, 0.0, 0.0]\n"
    text = SCENE.replace("delta = 0.5\n", "") + field
    result = run(tmp_path, "time.periods=40", text=text)  # it settles slowly
    assert value(result, "outcome") == "other"
    assert value(result, "distance_to_wave") is None
    assert "thickness_wave" not in result
    assert value(result, "mean_flow") > 0


def test_a_start_of_samples(tmp_path: Path):
    h = CosineWave(0.5).height(grid(20))
    start = f'start={{shape="samples", samples={h.tolist()}}}'
    result = run(tmp_path, start, "time.periods=1")
    assert value(result, "distance_to_wave") < 1e-9


test_bad_films_are_refused = refusals(
    SCENE,
    """
    film.tension=0.0 | film.tension | first order
    film={delta=0.5} | film.tension | missing
    film={tension=0.1} | film.delta | missing
    grid.most=40 | grid.most | at least 64
    field={samples=[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]} | field.samples | is not periodic
    field={samples=[0.0, 1.0, 2.0]} | field.samples | 4 to 100000
    field={} | field.samples | missing
    field={file="none.csv"} | field.file | cannot be read
    field={file="scene.toml"} | field.variable | missing
    field={samples=[0, 1, 1, 0], quantity="field", mu_r=1.0} | field.mu_r | above 1
    field={samples=[0, 1, 1, 0], quantity="field"} | field.mu_r | missing
    field={samples=[0, 1, 1, 0], mu_r=1.1} | field.mu_r | leave it out
    field={samples=[-1,1,1,0], quantity="field_squared", mu_r=1.1} | field.samples | -1 at its least
    start={shape="samples"} | start.samples | missing
    start={samples=[1, 1, 1, 1]} | start.samples | applies to shape
    start={shape="samples", samples=[2, 2, 2, 2]} | start.samples | mean thickness
    start.nudge=1.5 | start.nudge | above 0 everywhere
    map={delta=[0.5, 0.3], tension=[0.1]} | map.delta | ascend
    map={delta=[0.5], tension=[0.0]} | map.tension | above 0
    want=["basins"] | map | missing
    branch.delta=[0.6, 0.9] | branch.delta | does not contain
    branch.delta=[0.9, 0.1] | branch.delta | smaller number first
    units="SI" | film.fluid | missing
    """,
)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("far.csv", "0,1\n1,2\n2,1\n3,0\n", "phases in far"),
        ("words.csv", "a\nb\nc\n", "contains text"),
        ("text.toml", "schema = 1\n", "not a result"),
    ],
)
def test_a_file_that_holds_no_field_is_refused(tmp_path: Path, name: str, text: str, said: str):
    (tmp_path / name).write_text(text)
    variable = ', variable="field"' if "toml" in name else ""
    with pytest.raises(SceneError, match=said):
        run(tmp_path, f'field={{file="{name}"{variable}}}')


@pytest.mark.parametrize("tension", [1e3, 1e12])
def test_a_film_of_large_tension_is_its_wave(tension: float) -> None:
    """Deviations decay at W / 5 or so: rates of change by round-off are then no error."""
    change = [f"film.tension={tension}", "time.periods=1", "grid.points=32", "grid.most=64"]
    result = wo.run(load_scene("film_forward", change, branch=None))
    assert result.status == "ok"
    assert result.scalars["outcome"].value == "wave"
    assert result.scalars["distance_to_wave"].value < 1e-10


def test_a_film_on_its_way_is_not_said_to_miss_the_wave() -> None:
    change = ["time.periods=3", "grid.most=64", "grid.points=32"]
    warnings = wo.run(load_scene("film_forward", change, branch=None)).trust["warnings"]
    assert any("still moves" in warning for warning in warnings)
    assert not any("does not reach it" in warning for warning in warnings)
