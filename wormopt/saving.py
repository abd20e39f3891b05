"""Files of results: ``result.nc`` (NetCDF-3) contains everything, ``summary.json`` the summary."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

from wormopt.files import RESULT_FILE, SUMMARY_FILE, TABLE_FILE, write_summary
from wormopt.kinds import kind_of
from wormopt.quantities import NAME, Scalar, Variable
from wormopt.version import VERSION

_JSON_PARTS = ("scalars", "trust", "timings_s", "attributes")


def save(result: Any, folder: Path, pictures: tuple[str, ...]) -> None:
    """Write the files of a Result into a folder that exists, see `Result.save`."""
    write_netcdf(result, folder / RESULT_FILE)
    texts = _exports(result)
    if "table" in result.attributes:
        texts[TABLE_FILE] = result.attributes["table"]
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    summary = result.summary() | {
        "title": result.title,
        "table": json.loads(result.scene_text) if result.scene_text else {},
        "wormopt": VERSION,
        "files": [RESULT_FILE, SUMMARY_FILE, *reversed(texts), *pictures],
    }
    write_summary(folder, summary, (RESULT_FILE, *texts))


def load(path: Path) -> dict[str, Any]:
    """Read the fields of a Result, see `Result.load`."""
    if path.is_dir():
        path = path / RESULT_FILE
    try:
        return _read_netcdf(path)
    except OSError:
        raise
    except Exception as error:  # the reader raises nearly anything on a damaged file
        raise ValueError(f"{path} is no result of wormopt ({error})") from error


def _exports(result: Any) -> dict[str, str]:
    kind = kind_of(result)
    made: dict[str, str] = {}
    for name, maker in (kind.load().exports if kind else {}).items():
        module, function = maker.split(":")
        try:
            text = getattr(import_module(module), function)(result)
        except KeyError:  # a partial result need not hold what the file needs
            if result.status != "failed":
                raise
            continue
        if text is not None:
            made[name] = text
    return made


def write_netcdf(result: Any, path: Path) -> None:
    """Write all of a Result into one file, see `Result.load`."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "w", version=2) as file:
        for name, text in _texts(result).items():
            setattr(file, name, text.encode())
        lengths = {
            dim: length
            for variable in result.variables
            for dim, length in zip(variable.dims, variable.values.shape, strict=True)
        }
        for dim, length in lengths.items():
            file.createDimension(dim, length)
        for variable in result.variables:
            _write_variable(file, variable)
        for name, scalar in result.scalars.items():
            _write_number(file, name, scalar)


def _texts(result: Any) -> dict[str, str]:
    parts = {part: getattr(result, part) for part in _JSON_PARTS}
    parts["scalars"] = {name: [s.value, s.unit] for name, s in result.scalars.items()}
    own = ("scene", "kind", "title", "status", "reason", "scene_text")
    return {
        "Conventions": "CF-1.11",
        "source": f"wormopt {VERSION}",
        **{name: getattr(result, name) for name in own},
        **{part: json.dumps(value, ensure_ascii=False) for part, value in parts.items()},
    }


def _write_variable(file: Any, variable: Variable) -> None:
    kind = "d" if variable.values.dtype.kind == "f" else "i"
    stored = file.createVariable(variable.name, kind, variable.dims)
    stored[:] = variable.values
    stored.units = variable.unit.encode()
    stored.long_name = variable.long_name.encode()


def _write_number(file: Any, name: str, scalar: Scalar) -> None:
    """Write a single number as a variable too, for readers without JSON attributes."""
    if isinstance(scalar.value, int | float) and NAME.fullmatch(name):
        stored = file.createVariable(name, "d", ())
        stored.data[...] = scalar.value
        stored.units = scalar.unit.encode()


def _read_netcdf(path: Path) -> dict[str, Any]:
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=False) as file:
        parts: dict[str, Any] = {
            name: getattr(file, name).decode()
            for name in ("scene", "kind", "title", "status", "reason", "scene_text")
        }
        parts |= {part: json.loads(getattr(file, part).decode()) for part in _JSON_PARTS}
        parts["scalars"] = {name: Scalar(*pair) for name, pair in parts["scalars"].items()}
        parts["variables"] = tuple(
            Variable(
                name,
                stored.units.decode(),
                stored.dimensions,
                stored[:].astype(stored.data.dtype.newbyteorder("=")),
                stored.long_name.decode(),
            )
            for name, stored in file.variables.items()
            if stored.dimensions
        )
    return parts
