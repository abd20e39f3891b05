"""Results as Parquet and HDF5, read back by their own libraries."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from exported import by_formula, gait_in, made
from hints import Capture, Patch
from places import SAVED

import wormopt as wo
from tests.oracles.by_sweep import make_sweep
from wormopt.cli import main
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result


def test_parquet_holds_the_signals_with_their_units(walk: Result, tmp_path: Path):
    parquet = pytest.importorskip("pyarrow.parquet")
    (file,) = wo.export(walk, "parquet", tmp_path, step="10 ms", columns=["length", "resting"])
    table = parquet.read_table(file)
    assert table.column_names == ["time", "length_0", "length_1", "resting_0", "resting_1",
                                  "resting_2"]  # fmt: skip
    assert table.field("length_0").metadata == {b"units": b"m"}
    assert str(table.field("resting_0").type).startswith("int")
    assert "from the gait's formulas: length" in table.schema.metadata[b"remarks"].decode()
    found = table.to_pydict()
    gait = gait_in(walk)
    for j in range(2):
        expected = [by_formula(gait, t, 0)[j] for t in found["time"]]
        assert np.abs(np.array(found[f"length_{j}"]) - expected).max() < 1e-12


@pytest.mark.slow
def test_parquet_of_a_sweep_has_a_row_for_each_point(tmp_path: Path):
    parquet = pytest.importorskip("pyarrow.parquet")
    result = Result.load(make_sweep(tmp_path))
    (file,) = wo.export(result, "parquet", tmp_path / "a.parquet")
    found = parquet.read_table(file).to_pydict()
    assert found["worm.load"] == [5.0] * 3 + [10.0] * 3 + [20.0] * 3
    assert found["status"][2] == "refused"
    assert np.array_equal(found["speed"], result["speed"].values.ravel(), equal_nan=True)


@pytest.mark.parametrize("name", ["certified_gait", "film_basins", "coil_cargo"])
def test_hdf5_holds_everything(name: str, tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    result = Result.load(SAVED / f"{name}.nc")
    (file,) = wo.export(result, "hdf5", tmp_path)
    with h5py.File(file) as found:
        assert found["kind"].asstr()[()] == result.kind
        assert json.loads(found["trust"].asstr()[()]) == result.trust
        for variable in result.variables:
            stored = found[f"variables/{variable.name}"]
            assert np.array_equal(stored[()], variable.values, equal_nan=True)
            assert stored.attrs["units"] == variable.unit
            assert [axis.label for axis in stored.dims] == [*variable.dims]
            for axis, dim in zip(stored.dims, variable.dims, strict=True):
                if dim in result and dim != variable.name:
                    assert np.array_equal(axis[0][()], result[dim].values)
        for scalar, value in result.scalars.items():
            if isinstance(value.value, int | float):
                stored = found[f"scalars/{scalar}"]
                assert (stored[()], stored.attrs["units"]) == (value.value, value.unit)


def test_hdf5_of_odd_values(tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    scalars = {"gap": Scalar(None, "m"), "sets": Scalar([[1], [2, 3]]), "word": Scalar("λ")}
    still = (Variable("at", "1", ("place",), np.arange(3)),)
    result = Result("leer", "gait", title="größer", scalars=scalars, variables=still)
    (file,) = wo.export(result, "hdf5", tmp_path / "a.h5")
    with h5py.File(file) as found:
        assert np.isnan(found["scalars/gap"][()])
        assert found["scalars/sets"].asstr()[()] == "[[1], [2, 3]]"
        assert found["scalars/word"].asstr()[()] == "λ"
        assert found["title"].asstr()[()] == "größer"


@pytest.mark.parametrize(("form", "package"), [("parquet", "pyarrow"), ("hdf5", "h5py")])
def test_unedited_files_are_replaced_and_edited_ones_kept(
    fast: Result, form: str, package: str, tmp_path: Path, capsys: Capture
):
    pytest.importorskip(package)
    fast.save(made(tmp_path / "fast"))
    asked = ["export", str(tmp_path / "fast"), f"--{form}", "-o", str(tmp_path)]
    assert main(asked) == main(asked) == 0
    (file,) = tmp_path.glob("fast_gait.*")
    whole = file.read_bytes()
    fast.failed("it stopped").save(tmp_path / "fast")
    assert main(asked) == 2
    assert main([*asked, "--force"]) == 0
    assert file.read_bytes() != whole
    file.write_bytes(whole[:-20] + bytes(20))
    capsys.readouterr()
    assert main([*asked, "--force"]) == 2
    assert "was not made by wormopt, or changed since" in capsys.readouterr().err


@pytest.mark.parametrize(("form", "package"), [("parquet", "pyarrow"), ("hdf5", "h5py")])
def test_a_missing_package_is_named_with_its_extra(
    fast: Result, form: str, package: str, tmp_path: Path, monkeypatch: Patch, capsys: Capture
):
    monkeypatch.setitem(sys.modules, package, None)
    fast.save(made(tmp_path / "fast"))
    assert main(["export", str(tmp_path / "fast"), f"--{form}", "--csv", "-o", str(tmp_path)]) == 2
    assert f"pip install 'wormopt[{form}]'" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["fast"]
