"""Results and motions as tables of xarray and pandas: every instant and entry can be selected."""

import re
import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slides import LINE, slide

import wormopt as wo
from wormopt.families.gathered import dataframe as dataframe_of_sweep
from wormopt.labelled import apart
from wormopt.model.gait import Gait
from wormopt.quantities import Variable
from wormopt.result import Result

# One link that extends and contracts at rate 1: the rate jumps at 0.4 and at the period's end.
CORNERED = Gait(np.array([0.0, 0.4, 0.8]), np.array([[[1.0, 1.0]], [[1.4, -1.0]]]))


def length(t: np.ndarray) -> np.ndarray:
    return 1.4 - np.abs(0.4 - t)


def rate(t: np.ndarray) -> np.ndarray:
    return np.where(t < 0.4, 1.0, -1.0)


@pytest.fixture(scope="module")
def crawl():
    return wo.crawl(CORNERED, [1.0, 1.0], drag=1.0, load=1.0)


@pytest.fixture(scope="module")
def result() -> Result:
    return wo.run("fast_gait")


@given(st.lists(st.integers(0, 20), min_size=1, max_size=40).map(sorted))
def test_instants_ascend_and_the_last_of_equal_ones_stays(places: list[int]):
    instants = np.array(places) / 10
    moved = apart(instants)
    assert np.all(np.diff(moved) > 0)
    assert np.abs(moved - instants).max() <= 40 * np.spacing(2.0)
    last = np.append(np.diff(instants) > 0, True)
    assert np.array_equal(moved[last], instants[last])


@pytest.mark.parametrize("values", [[2.0, 1.0, 1.0], [1.0, 2.0, 4.0], [3.0], []])
def test_what_does_not_stand_twice_is_left_alone(values: list[float]):
    assert apart(np.array(values)).tolist() == values


def test_a_gait_with_jumps_is_its_closed_form_wherever_one_looks(crawl: wo.Trajectory):
    assert np.any(np.diff(crawl.time) == 0)
    data = crawl.to_xarray()
    assert data.indexes["time"].is_unique
    assert data.indexes["time"].is_monotonic_increasing
    assert float(data["rate"].sel(time=0.4)) == -1.0
    assert float(data["rate"].sel(time=0.4, method="nearest")) == -1.0
    before = data["rate"].sel(time=0.4 - 1e-12, method="pad")
    assert float(before) == 1.0
    t = np.linspace(0, 0.8, 1237)
    assert data["length"].interp(time=t).values.squeeze() == pytest.approx(length(t), abs=1e-14)
    assert data["rate"].interp(time=t).values.squeeze() == pytest.approx(rate(t), abs=1e-14)


def test_a_dataset_draws_itself(crawl: wo.Trajectory):
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    (line,) = crawl.to_xarray()["rate"].plot(ax=axes)  # pyright: ignore[reportCallIssue]
    t = np.asarray(line.get_xdata(), dtype=float)
    assert np.asarray(line.get_ydata(), dtype=float) == pytest.approx(np.where(t < 0.4, 1.0, -1.0))


def test_links_and_masses_count_from_0(result: Result, crawl: wo.Trajectory):
    data = result.to_xarray()
    assert data["length"].dims == ("link", "time")
    assert data["link"].values.tolist() == [0, 1]
    assert data["mass"].values.tolist() == [0, 1, 2]
    assert np.array_equal(data["length"].sel(link=1), result["length"].values[1])
    assert crawl.to_xarray()["mass"].values.tolist() == [0, 1]


def test_the_jumps_of_a_result_can_be_selected(result: Result):
    """The rates of gait (15) jump at T/3 and 2T/3 when its third third begins."""
    data = result.to_xarray()
    for name in ("time", "link", "mass"):
        assert data.indexes[name].is_unique
    gait = wo.fast_gait(1.0)
    for t in (0.0, 0.25, 1 / 3, 0.5, 2 / 3, 0.9):
        for name, order in (("length", 0), ("rate", 1), ("acceleration", 2)):
            found = data[name].interp(time=t).values
            size = (3 * np.pi) ** order
            assert found == pytest.approx(gait(np.array([t]), order)[:, 0], abs=2e-4 * size)
    assert data["time"].attrs == {"units": "1", "long_name": "time"}


def test_entries_are_called_by_the_names_the_result_holds():
    names = ["tracker (14)", "LQR"]
    time = Variable("time", "s", ("time",), np.array([0.0, 1.0]))
    error = Variable("error", "m", ("rival", "time"), np.arange(4.0).reshape(2, 2), "error")
    limit = Variable("elasticity", "1", ("limit",), np.array([0.5]))
    result = Result(
        "compare",
        "compare-tracking",
        variables=(time, error, limit),
        attributes={"rivals": names, "limits": {"name": ["rate"]}},
    )
    data = result.to_xarray()
    assert data["error"].sel(rival="LQR").values.tolist() == [2.0, 3.0]
    assert float(data["elasticity"].sel(limit="rate")) == 0.5
    frame = result.to_dataframe()
    assert list(frame.columns) == ["error_tracker (14)", "error_LQR"]
    assert frame.attrs["units"] == {"error_tracker (14)": "m", "error_LQR": "m", "time": "s"}


def test_rows_of_a_frame_are_those_of_the_dataset(result: Result):
    data, frame = result.to_xarray(), result.to_dataframe()
    assert frame.index.name == "time"
    assert np.array_equal(frame.index, data["time"])
    for name in ("length", "rate", "position", "velocity", "reaction"):
        for j, row in enumerate(data[name].values):
            assert np.array_equal(frame[f"{name}_{j}"], row), name
    assert np.array_equal(frame["sigma"], data["sigma"])
    assert not [name for name in frame.columns if name.startswith("gait_")]
    pieces = result.to_dataframe("gait_piece")
    assert pieces.index.tolist() == [0, 1, 2]
    assert np.array_equal(pieces["gait_sine_0"], result["gait_sine"].values[:, 0])


def test_a_dimension_that_is_not_there_is_refused(result: Result):
    with pytest.raises(wo.UnknownNameError, match=r"'mast'; did you mean 'mass'\? It has"):
        result.to_dataframe("mast")
    with pytest.raises(wo.UnknownNameError, match=re.escape("no dimension 'time'; it has none")):
        Result("nothing", "gait").to_dataframe()


def falling() -> wo.Trajectory:
    x = ca.SX.sym("x", 2)
    model = wo.Model("fall", [wo.Signal("my state", x, value=[0.0, 1.0])], ca.vertcat(x[1], -1.0))
    return wo.simulate(model, 2.0, times=np.linspace(0, 2, 21))


def test_a_trajectory_as_dataset_and_frame():
    """x = t - t²/2, v = 1 - t; names of signals are free."""
    motion = falling()
    data, frame = motion.to_xarray(), motion.to_dataframe()
    t = np.linspace(0, 2, 21)
    assert data["my state"].dims == ("my state_entry", "time")
    assert data["my state"].sel({"my state_entry": 0}).values == pytest.approx(t - t**2 / 2)
    assert list(frame.columns) == ["my state_0", "my state_1"]
    assert np.array_equal(frame["my state_1"], data["my state"][1])
    assert data["my state"].attrs == {} == frame.attrs


def test_an_optimal_motion_as_dataset_and_frame():
    """Thrust until 2 T/3, then brake."""
    relaxed = wo.Complementarity(residual=1e-3, first=1e-1)
    coarse = wo.optimise(slide(), wo.Mesh.even(1, 20, wo.Collocation(2)), relaxed, LINE)
    found = wo.optimise_switching_times(coarse)
    data, frame = found.motion.to_xarray(), found.motion.to_dataframe()
    assert data.indexes["time"].is_unique
    last = np.sqrt(1.5)
    for t, force in ((0.0, 3.0), (0.3, 3.0), (2 / 3 * last + 1e-6, -3.0), (last, -3.0)):
        assert float(data["force"].sel(time=t, method="nearest")) == pytest.approx(force)
    t = np.linspace(0, last, 31)
    speed = np.minimum(2 * t, 4 * (last - t))
    assert data["velocity"].interp(time=t).values == pytest.approx(speed, abs=1e-4)
    assert np.array_equal(frame["velocity"], data["velocity"])


@pytest.mark.parametrize(
    ("package", "table"),
    [
        ("xarray", lambda: falling().to_xarray()),
        ("pandas", lambda: falling().to_dataframe()),
        ("xarray", lambda: Result("walk", "gait").to_xarray()),
        ("pandas", lambda: Result("walk", "gait").to_dataframe()),
        ("pandas", lambda: dataframe_of_sweep(Result("walk", "sweep"))),
    ],
)
def test_where_a_package_is_missing_the_error_names_the_extra(
    package: str, table: Callable[[], object], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=re.escape("pip install 'wormopt[data]'")) as caught:
        table()
    assert caught.value.name == package
    assert str(caught.value).startswith(f"{package} cannot be imported")
