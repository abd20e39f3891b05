"""A Result comes back from its files as it was, and other programs can read them."""

import json
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
import xarray
from hypothesis import given
from scipy.io import netcdf_file

from wormopt.netcdf import DOUBLE, INT, Stored, netcdf
from wormopt.quantities import UNITS, Scalar, Variable, unit_of
from wormopt.result import Result

TITLE = "Größe λ — 1"


def example() -> Result:
    return Result(
        scene="walk",
        kind="gait",
        title=TITLE,
        scalars={
            "speed": Scalar(0.1, "m s-1"),
            "resting_min": Scalar(1),
            "gap": Scalar(float("nan")),
            "mode_sequence": Scalar([[0], [1, 2]]),
            "rule": Scalar("gleich verteilt — λ"),
        },
        variables=(
            Variable("time", "s", ("time",), np.linspace(0, 1, 5), "time"),
            Variable("link_length", "m", ("time", "link"), np.arange(10.0).reshape(5, 2), "Länge"),
            Variable("resting", "1", ("time", "mass"), np.eye(5, 3, dtype=bool), "mass rests"),
            Variable("far", "1", ("link",), np.array([2**40, -1]), "too large for 32 bits"),
        ),
        trust={"solver": "Solve_Succeeded", "passed": True, "residual": 1e-12, "warnings": []},
        timings_s={"load": 0.25, "solve": 1.5},
        scene_text='{"title": "Größe λ — 1"}',
        attributes={"arcs": [[1, 2], [3], []]},
    )


def contents(result: Result) -> dict[str, Any]:
    """All of a result in a form that can be compared."""
    parts = dict(vars(result))
    parts["variables"] = [
        (v.name, v.unit, v.dims, v.values.dtype, v.values.tolist(), v.long_name)
        for v in result.variables
    ]
    return parts


@pytest.mark.parametrize("name", ["", "result.nc"])
def test_a_result_loads_as_it_was_saved(tmp_path: Path, name: str):
    example().save(tmp_path)
    assert contents(Result.load(tmp_path / name)) == contents(example())


def test_files_are_those_that_scipy_writes(tmp_path: Path):
    lengths, lines = {"time": 3, "link": 2}, {"title": TITLE, "reason": ""}
    values = {  # SciPy writes those with more rows first
        "length": (("time", "link"), np.linspace(0, 1, 6).reshape(3, 2)),
        "count": (("link",), np.array([-1, 2**31 - 1], np.int32)),
        "gap": ((), np.array(np.nan)),
    }
    with netcdf_file(tmp_path / "scipy.nc", "w", version=2) as file:
        for name, text in lines.items():
            setattr(file, name, text.encode())
        for name, length in lengths.items():
            file.createDimension(name, length)
        for name, (dims, array) in values.items():
            stored = file.createVariable(name, array.dtype.char, dims)
            stored.data[...], stored.units = array, b"m"
    ours = [
        Stored(
            name,
            dims,
            DOUBLE if array.dtype == float else INT,
            array.astype(array.dtype.newbyteorder(">")).tobytes(),
            {"units": "m"},
        )
        for name, (dims, array) in values.items()
    ]
    assert netcdf(lines, lengths, ours) == (tmp_path / "scipy.nc").read_bytes()


@given(
    values=hnp.arrays(
        st.sampled_from([np.float64, np.float32, np.int32, np.int64, np.bool_, np.uint8]),
        hnp.array_shapes(max_dims=3, max_side=4),
    ),
    text=st.text(st.characters(exclude_categories=["Cs", "Cc"])),
    number=st.none() | st.integers(-(2**60), 2**60) | st.floats(),
)
def test_any_result_loads_as_it_was_saved(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray, text: str, number: Any
):
    dims = ("a", "b", "c")[: values.ndim]
    result = Result(
        scene=text,
        kind="gait",
        title=text,
        reason=text,
        scalars={"number": Scalar(number, text), "text": Scalar(text)},
        variables=(Variable("values", "1", dims, values, text),),
        attributes={"text": text, "number": number},
    )
    folder = tmp_path_factory.mktemp("result")
    result.save(folder)
    loaded = Result.load(folder)
    np.testing.assert_array_equal(loaded["values"].values, result["values"].values)
    assert {**contents(loaded), "variables": 0} == {**contents(result), "variables": 0}


def test_xarray_opens_a_result(tmp_path: Path):
    example().save(tmp_path)
    with xarray.open_dataset(tmp_path / "result.nc", engine="scipy") as data:
        assert data.attrs["title"] == TITLE
        assert data.attrs["Conventions"] == "CF-1.11"
        assert data.link_length.dims == ("time", "link")
        assert data.link_length.attrs["units"] == "m"
        assert data.link_length.attrs["long_name"] == "Länge"
        assert data.indexes["time"].tolist() == [0, 0.25, 0.5, 0.75, 1]
        assert float(data.speed) == 0.1
        assert data.speed.attrs["units"] == "m s-1"


def test_the_summary_holds_what_is_printed_and_the_scene(tmp_path: Path):
    example().save(tmp_path, ("gait.png",))
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary.items() >= example().summary().items()
    assert summary["scalars"]["gap"] == {"value": None, "unit": "1"}
    assert summary["title"] == TITLE
    assert summary["table"] == {"title": TITLE}
    assert summary["files"] == ["result.nc", "summary.json", "gait.png"]
    assert "reason" not in summary


@pytest.mark.parametrize(
    ("name", "dims", "values", "message"),
    [
        ("Länge", ("time",), [1.0], "ASCII"),
        ("length", ("2nd",), [1.0], "ASCII"),
        ("length", ("time",), [[1.0]], "2 axes"),
        ("length", (), 1.0, "0 axes"),
        ("length", ("time",), [], "empty"),
        ("length", ("time",), [1j], "real"),
        ("length", ("time",), ["a"], "real"),
    ],
)
def test_a_variable_that_cannot_be_stored_is_refused(
    name: str, dims: tuple[str, ...], values: Any, message: str
):
    with pytest.raises(ValueError, match=message):
        Variable(name, "1", dims, values)


def test_names_and_dimensions_must_agree():
    time = Variable("time", "1", ("time",), np.zeros(2))
    with pytest.raises(ValueError, match="time is 3 and 2 long"):
        Result("a", "gait", variables=(time, Variable("x", "1", ("time",), np.zeros(3))))
    with pytest.raises(ValueError, match="more than one thing: time"):
        Result("a", "gait", variables=(time, time))
    with pytest.raises(ValueError, match="more than one thing: time"):
        Result("a", "gait", variables=(time,), scalars={"time": Scalar(1.0)})


def test_scalars_and_variables_are_found_by_name():
    result = example()
    assert "time" in result
    assert "speed" in result
    assert result["speed"] is result.scalars["speed"]
    assert result["time"].unit == "s"
    with pytest.raises(KeyError, match=r"no scalar or variable 'pace'; it has 'speed', .*'time'"):
        result["pace"]


@pytest.mark.parametrize("content", [b"", b"no netcdf", b"CDF\x02" + bytes(40)])
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "result.nc").write_bytes(content)
    with pytest.raises(ValueError, match="not a result of wormopt"):
        Result.load(tmp_path)


def test_a_missing_file_is_an_os_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        Result.load(tmp_path)


def test_units_are_ascii_and_vanish_in_dimensionless_scenes():
    for quantity, unit in UNITS.items():
        assert unit.isascii()
        assert unit_of(quantity, "SI") == unit
        assert unit_of(quantity, "dimensionless") == "1"


def test_a_result_as_a_dataset(tmp_path: Path):
    time = Variable("time", "s", ("time",), np.array([0.0, 1.0, 2.0]), "time")
    place = Variable("place", "m", ("mass", "time"), np.arange(6.0).reshape(2, 3), "place")
    scalars = {"speed": Scalar(0.5, "m s-1"), "words": Scalar(["a", "b"]), "lost": Scalar(None)}
    result = Result("walk", "gait", "A walk", scalars=scalars, variables=(time, place))
    data = result.to_xarray()
    assert data["place"].sel(time=1.0).values.tolist() == [1.0, 4.0]
    assert data["place"].attrs == {"units": "m", "long_name": "place"}
    assert float(data["speed"]) == 0.5
    assert "words" not in data
    assert data.attrs["title"] == "A walk"
    result.save(tmp_path)
    assert Result.load(tmp_path).to_xarray().identical(data)
