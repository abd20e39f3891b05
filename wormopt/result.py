"""What a study found: named signals with units, scalars, a trust report; saved and loaded.

A Result lives in two files. ``result.nc`` (NetCDF-3, opens in xarray) holds everything and
loads back to an equal Result; ``summary.json`` holds what a person or a script reads first.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from wormopt.errors import UnknownNameError
from wormopt.files import RESULT_FILE, SUMMARY_FILE, TABLE_FILE
from wormopt.kinds import KINDS
from wormopt.version import VERSION

Status = Literal["ok", "failed"]

# Quantity -> unit of a scene with units = "SI"; in a dimensionless scene every unit is "1".
UNITS = {
    "length": "m",
    "time": "s",
    "speed": "m s-1",
    "acceleration": "m s-2",
    "acceleration_squared": "m2 s-4",
    "angle": "rad",
    "angular_frequency": "rad s-1",
    "rate": "s-1",
    "rate_change": "s-2",
    "mass": "kg",
    "density": "kg m-3",
    "force": "N",
    "impulse": "N s",
    "energy": "J",
    "effort": "N2 s",
    "power": "W",
    "energy_per_distance": "J m-1",
    "drag": "N s m-1",
    "stiffness": "N m-1",
    "stress": "Pa",
    "magnetic_field": "A m-1",
    "current": "A",
    "induction": "T",
    "force_per_length": "N m-1",
    "mass_rate_per_length": "kg s-1 m-1",
    "bending_stiffness": "N m2",
    "curvature": "m-1",
    "curvature_squared": "m-2",
    "magnetic_field_squared": "A2 m-2",
    "ampere_turns": "A",
    "ampere_turn_rate": "A s-1",
    "current_density": "A m-2",
    "length_squared_time": "m2 s",
    "flow_per_width": "m2 s-1",
    "share": "1",
    "count": "1",
}

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_JSON_PARTS = ("scalars", "trust", "timings_s", "attributes")


def unit_of(quantity: str, units: str) -> str:
    """Unit of a quantity, a key of `UNITS`, in a scene's system of units.

    `units` is "dimensionless" or "SI".
    """
    unit = UNITS[quantity]
    return unit if units == "SI" else "1"


def unit_ratio(quantity: str, per: str, units: str) -> str:
    """Unit of a derivative: of one quantity by another, both keys of `UNITS`.

    `units` is "dimensionless" or "SI".
    """
    powers: dict[str, int] = {}
    for name, sign in ((quantity, 1), (per, -1)):
        for symbol, power in re.findall(r"([A-Za-z]+)(-?\d*)", unit_of(name, units)):
            powers[symbol] = powers.get(symbol, 0) + sign * int(power or 1)
    parts = [f"{s}{p if p != 1 else ''}" for s, p in powers.items() if p]
    return " ".join(parts) or "1"


def plain(value: Any) -> Any:
    """Turn a value into what JSON can say: arrays into lists, NaN and infinity into None.

    Raises TypeError for what is no number, text, None, array, or list or mapping of these.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    raise TypeError(f"a Result cannot hold {type(value).__name__} {value!r}")


@dataclass(frozen=True)
class Scalar:
    """One number, text or (ragged) list with its unit.

    Parameters
    ----------
    value : number, text, list or None
        NaN and infinities become None: unknown.
    unit : str
        UDUNITS text, "1" where there is none.

    Examples
    --------
    >>> Scalar(float("nan"), "m s-1")
    Scalar(value=None, unit='m s-1')
    """

    value: Any
    unit: str = "1"

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", plain(self.value))


@dataclass(frozen=True, eq=False)
class Variable:
    """A named array with a unit and named dimensions.

    A variable named like its only dimension is the coordinate of that dimension.

    Parameters
    ----------
    name : str
        ASCII letters, digits and underscores.
    unit : str
        UDUNITS text, "1" where there is none.
    dims : tuple of str
        One name per axis, at least one.
    values : array_like
        Real numbers, not empty. Kept as float64, or int32 for integers and truth values
        (the file format knows no others).
    long_name : str
        What it is, for axis labels.

    Raises
    ------
    ValueError
        If name, dims and values do not fit together or the file format cannot hold them.

    Examples
    --------
    >>> Variable("time", "s", ("time",), [0.0, 0.5, 1.0], "time").values
    array([0. , 0.5, 1. ])
    """

    name: str
    unit: str
    dims: tuple[str, ...]
    values: np.ndarray
    long_name: str = ""

    def __post_init__(self) -> None:
        values = _storable(self.name, self.values)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "dims", tuple(self.dims))
        for name in (self.name, *self.dims):
            if not _NAME.fullmatch(name):
                raise ValueError(f"{name!r} is no name of ASCII letters, digits and _")
        if len(self.dims) != values.ndim or not self.dims:
            raise ValueError(f"{self.name} has {values.ndim} axes but dimensions {self.dims}")
        if values.size == 0:
            raise ValueError(f"{self.name} is empty; leave it out of the Result")


def _storable(name: str, values: Any) -> np.ndarray:
    array = np.asarray(values)
    if array.dtype.kind == "f":
        return array.astype(np.float64)
    if array.dtype.kind not in "biu":
        raise ValueError(f"{name} holds {array.dtype}, not real numbers")
    fits = array.size == 0 or (array.min() >= -(2**31) and array.max() < 2**31)
    return array.astype(np.int32 if fits else np.float64)


@dataclass(frozen=True, eq=False)
class Result:
    """What a study found, and how far to trust it.

    Parameters
    ----------
    scene : str
        Name of the scene.
    kind : str
        Kind of the scene.
    title : str
        Title of the scene, any text.
    status : {"ok", "failed"}
        "failed" where the trust report fails or the study was not finished.
    scalars : mapping of str to Scalar
        The numbers asked for.
    variables : tuple of Variable
        The signals, kept sorted by name; `result["name"]` finds one.
    trust : mapping of str to JSON data
        Trust report: solver status, residuals, rechecks, warnings.
    timings_s : mapping of str to float
        Seconds spent per stage.
    reason : str
        Why the result failed; empty otherwise.
    scene_text : str
        The resolved scene as JSON text, enough to compute the result again.
    attributes : mapping of str to JSON data
        Ragged data that fits no array.

    Raises
    ------
    ValueError
        If a name is used twice or a dimension has two lengths.

    Examples
    --------
    >>> time = Variable("time", "1", ("time",), [0.0, 1.0])
    >>> result = Result("walk", "gait", scalars={"speed": Scalar(0.5)}, variables=(time,))
    >>> result.scalars["speed"].value, result["time"].values.tolist()
    (0.5, [0.0, 1.0])
    """

    scene: str
    kind: str
    title: str = ""
    status: Status = "ok"
    scalars: Mapping[str, Scalar] = field(default_factory=dict)
    variables: tuple[Variable, ...] = ()
    trust: Mapping[str, Any] = field(default_factory=dict)
    timings_s: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    scene_text: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "scalars", dict(self.scalars))
        in_order = sorted(self.variables, key=lambda variable: variable.name)
        object.__setattr__(self, "variables", tuple(in_order))
        for part in ("trust", "timings_s", "attributes"):
            object.__setattr__(self, part, plain(getattr(self, part)))
        self._check_names()

    def _check_names(self) -> None:
        names = [variable.name for variable in self.variables]
        twice = {name for name in names if names.count(name) > 1}
        twice |= self.scalars.keys() & {*names, *self._lengths()}
        if twice:
            raise ValueError(f"used for more than one thing: {', '.join(sorted(twice))}")

    def _lengths(self) -> dict[str, int]:
        lengths: dict[str, int] = {}
        for variable in self.variables:
            for dim, length in zip(variable.dims, variable.values.shape, strict=True):
                if lengths.setdefault(dim, length) != length:
                    raise ValueError(f"{variable.name}: {dim} is {length} and {lengths[dim]} long")
        return lengths

    def __getitem__(self, name: str) -> Variable:
        """Variable of that name; UnknownNameError, a KeyError, where the result has none."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise UnknownNameError("the result", "variable", [name], [v.name for v in self.variables])

    def __contains__(self, name: str) -> bool:
        """Whether there is a variable of that name."""
        return any(variable.name == name for variable in self.variables)

    def summary(self) -> dict[str, Any]:
        """What `wormopt run --json` prints: names, status, scalars, trust and timings.

        Examples
        --------
        >>> Result("walk", "gait", scalars={"speed": Scalar(0.5)}).summary()["scalars"]
        {'speed': {'value': 0.5, 'unit': '1'}}
        """
        summary: dict[str, Any] = {
            "scene": self.scene,
            "kind": self.kind,
            "status": self.status,
            "scalars": {
                name: {"value": scalar.value, "unit": scalar.unit}
                for name, scalar in self.scalars.items()
            },
            "trust": self.trust,
            "timings_s": self.timings_s,
        }
        if self.reason:
            summary["reason"] = self.reason
        return summary

    def save(self, folder: str | Path, pictures: tuple[str, ...] = ()) -> None:
        """Write ``result.nc`` and ``summary.json`` into a folder that exists.

        An attribute ``table``, text in Markdown, goes to ``table.md`` too, and what the kind of
        scene exports to files of its own.

        Parameters
        ----------
        folder : path
            Where to write; files of these names are overwritten.
        pictures : tuple of str
            Names of the picture files that will lie beside them, to be listed as wormopt's own.

        Raises
        ------
        OSError
            If the files cannot be written.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     Result("walk", "gait", title="Größe λ — 1").save(folder)
        ...     Result.load(folder).title
        'Größe λ — 1'
        """
        folder = Path(folder)
        self._write_netcdf(folder / RESULT_FILE)
        if "table" in self.attributes:
            (folder / TABLE_FILE).write_text(self.attributes["table"], encoding="utf-8")
            pictures = (TABLE_FILE, *pictures)
        for name, text in self._exports().items():
            (folder / name).write_text(text, encoding="utf-8")
            pictures = (name, *pictures)
        summary = self.summary() | {
            "title": self.title,
            "table": json.loads(self.scene_text) if self.scene_text else {},
            "wormopt": VERSION,
            "files": [RESULT_FILE, SUMMARY_FILE, *pictures],
        }
        text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / SUMMARY_FILE).write_text(text + "\n", encoding="utf-8")

    def _exports(self) -> dict[str, str]:
        makers = KINDS[self.kind].load_exports() if self.kind in KINDS else {}
        made = {name: make(self) for name, make in makers.items()}
        return {name: text for name, text in made.items() if text is not None}

    def _write_netcdf(self, path: Path) -> None:
        from scipy.io import netcdf_file

        with netcdf_file(path, "w", version=2) as file:
            for name, text in self._texts().items():
                setattr(file, name, text.encode())
            for dim, length in self._lengths().items():
                file.createDimension(dim, length)
            for variable in self.variables:
                _write_variable(file, variable)
            for name, scalar in self.scalars.items():
                _write_number(file, name, scalar)

    def _texts(self) -> dict[str, str]:
        parts = {part: getattr(self, part) for part in _JSON_PARTS}
        parts["scalars"] = {
            name: [scalar.value, scalar.unit] for name, scalar in self.scalars.items()
        }
        return {
            "Conventions": "CF-1.11",
            "source": f"wormopt {VERSION}",
            "scene": self.scene,
            "kind": self.kind,
            "title": self.title,
            "status": self.status,
            "reason": self.reason,
            "scene_text": self.scene_text,
        } | {part: json.dumps(value, ensure_ascii=False) for part, value in parts.items()}

    @classmethod
    def load(cls, path: str | Path) -> Result:
        """Read a saved result.

        Parameters
        ----------
        path : path
            The folder, or the ``result.nc`` in it.

        Returns
        -------
        Result
            Equal to the one saved.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is no result of wormopt.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     Result("walk", "gait", scalars={"speed": Scalar(0.1)}).save(folder)
        ...     Result.load(folder).scalars["speed"].value
        0.1
        """
        path = Path(path)
        if path.is_dir():
            path = path / RESULT_FILE
        try:
            return cls(**_read_netcdf(path))
        except OSError:
            raise
        except Exception as error:  # the reader raises nearly anything on a damaged file
            raise ValueError(f"{path} is no result of wormopt ({error})") from error


def _write_variable(file: Any, variable: Variable) -> None:
    kind = "d" if variable.values.dtype.kind == "f" else "i"
    stored = file.createVariable(variable.name, kind, variable.dims)
    stored[:] = variable.values
    stored.units = variable.unit.encode()
    stored.long_name = variable.long_name.encode()


def _write_number(file: Any, name: str, scalar: Scalar) -> None:
    """Write a single number as a variable too, for readers that know no JSON attributes."""
    if isinstance(scalar.value, int | float) and _NAME.fullmatch(name):
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
