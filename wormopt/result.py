"""Results: signals with units, scalars, a trust report; saved and loaded.

A Result has two files. ``result.nc`` (NetCDF-3, readable by xarray) contains everything and loads
as an equal Result; ``summary.json`` contains what a person or a script reads first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from struct import pack
from typing import TYPE_CHECKING, Any, Literal

from wormopt.errors import UnknownNameError
from wormopt.files import RESULT_FILE, SUMMARY_FILE, TABLE_FILE, write_summary
from wormopt.kinds import kind_of
from wormopt.lazy import above
from wormopt.netcdf import DOUBLE, INT, Stored, netcdf
from wormopt.quantities import NAME, Scalar, Variable, plain
from wormopt.shown import Part, brief, html, lines
from wormopt.version import VERSION

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

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
        raise ValueError(f"{path} is not a result of wormopt ({error})") from error


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
    lengths = {
        dim: length
        for variable in result.variables
        for dim, length in zip(variable.dims, variable.values.shape, strict=True)
    }
    stored = [_stored(variable) for variable in result.variables]
    # single numbers are variables too, for readers without JSON attributes
    stored += [
        Stored(name, (), DOUBLE, pack(">d", scalar.value), {"units": scalar.unit})
        for name, scalar in result.scalars.items()
        if isinstance(scalar.value, int | float) and NAME.fullmatch(name)
    ]
    path.write_bytes(netcdf(_texts(result), lengths, stored))


def _stored(variable: Variable) -> Stored:
    kind, form = (DOUBLE, ">f8") if variable.values.dtype.kind == "f" else (INT, ">i4")
    data = variable.values.astype(form).tobytes()
    texts = {"units": variable.unit, "long_name": variable.long_name}
    return Stored(variable.name, variable.dims, kind, data, texts)


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


Status = Literal["ok", "unchecked", "failed"]


class Unchecked(str):
    """A warning that leaves a result unchecked: its numbers are neither confirmed nor refuted.

    There is no second route, or the theory neglects effects that are not small here.
    """

    __slots__ = ()


NOT_RECHECKED = Unchecked("not rechecked by a second route: tolerance.recheck is false")


def left_out(share: float, text: str) -> str:
    """Return a warning about a neglected effect, as a share of those included.

    The warning is `Unchecked` if the share is above 1: the theory does not hold there.
    """
    return Unchecked(text) if share > 1 else text


@dataclass(frozen=True)
class Check:
    """One check of a trust report: a number, its accepted limit, and advice if it is larger.

    Parameters
    ----------
    name : str
        Name of the checked quantity.
    value : float or None
        Its value; None, or NaN, is not accepted.
    limit : float
        Largest size that is accepted.
    advice : str
        Message if the value is larger.
    passed : bool, optional
        Whether it is accepted; by default, whether the value is within the limit.

    Examples
    --------
    >>> Check("defect", 3e-12, 1e-9, "take a finer mesh").passed
    True
    """

    name: str
    value: float | None
    limit: float
    advice: str = ""
    passed: bool = None  # pyright: ignore[reportAssignmentType]  set from value and limit

    def __post_init__(self) -> None:
        if self.passed is None:
            within = self.value is not None and bool(abs(self.value) <= self.limit)
            object.__setattr__(self, "passed", within)

    def found(self) -> dict[str, Any]:
        """Entries of a trust report without the name; with advice if the check failed."""
        found = {"value": self.value, "limit": self.limit, "passed": self.passed}
        return found if self.passed else found | {"advice": self.advice}


class Scalars(dict[str, Scalar]):
    """Numbers by name; for other names UnknownNameError, a KeyError, lists them."""

    def __missing__(self, name: str) -> Scalar:
        raise UnknownNameError("the result", "scalar", [name], self)


class Trust(dict[str, Any]):
    """A trust report, which notebooks show as a table."""

    def _repr_html_(self) -> str:
        facts = [(name, brief(value), "") for name, value in self.items() if name != "checks"]
        checks = [
            (name, brief(check["value"]), f"accepted up to {check['limit']:.3g}")
            for name, check in self.get("checks", {}).items()
        ]
        return html("Trust report", [Part("", facts), Part("Checks", checks)])


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a study, with its trust report.

    Parameters
    ----------
    scene : str
        Name of the scene.
    kind : str
        Kind of the scene.
    title : str
        Title of the scene, any text.
    status : {"ok", "unchecked", "failed"}
        "failed": a check of the trust report fails, or the study was not finished. "unchecked": no
        check fails, but no second route confirms the values, or the theory is outside its range of
        validity.
    scalars : mapping of str to Scalar
        Scalar results by name.
    variables : tuple of Variable
        The signals, kept sorted by name; `result["name"]` finds one, or a scalar.
    trust : mapping of str to JSON data
        Trust report: solver status, residuals, rechecks, warnings.
    timings_s : mapping of str to float
        Seconds spent per stage.
    reason : str
        Reason why the result failed or is unchecked; empty otherwise.
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
    >>> result["speed"].value, result["time"].values.tolist()
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
        object.__setattr__(self, "scalars", Scalars(self.scalars))
        in_order = sorted(self.variables, key=lambda variable: variable.name)
        object.__setattr__(self, "variables", tuple(in_order))
        for part in ("trust", "timings_s", "attributes"):
            object.__setattr__(self, part, plain(getattr(self, part)))
        object.__setattr__(self, "trust", Trust(self.trust))
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

    def __getitem__(self, name: str) -> Any:
        """Scalar or Variable of that name; UnknownNameError, a KeyError, where there is none."""
        named = {**self.scalars, **{variable.name: variable for variable in self.variables}}
        if name not in named:
            raise UnknownNameError("the result", "scalar or variable", [name], named)
        return named[name]

    def __repr__(self) -> str:
        from wormopt.digest import headline

        found = f"Result of {self.scene} ({self.kind}): {self.status}"
        reason = f", {self.reason}" if self.reason else ""
        return lines(f"{found}{reason}; {len(self.variables)} variables", headline(self))

    def _repr_html_(self) -> str:
        from wormopt.digest import groups, trust

        return html(self.title or self.scene, groups(self), trust(self))

    def __contains__(self, name: str) -> bool:
        """Whether there is a scalar or variable of that name."""
        return name in self.scalars or any(variable.name == name for variable in self.variables)

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks of the trust report."""
        checks = self.trust.get("checks", {}).items()
        return tuple(Check(name, **found) for name, found in checks if isinstance(found, Mapping))

    def failed(self, reason: str) -> Result:
        """Return a copy of the result with status ``failed``.

        Parameters
        ----------
        reason : str
            Reason for the failure.
        """
        return replace(self, status="failed", reason=reason)

    @property
    def labels(self) -> dict[str, list[str]]:
        """Names of the entries along dimensions that do not just count, by dimension."""
        from wormopt.labelled import labels

        texts = {name: scalar.value for name, scalar in self.scalars.items()}
        return labels(self._lengths(), {**texts, **self.attributes})

    def to_xarray(self) -> xarray.Dataset:
        """Make an xarray.Dataset of variables and single numbers, with units and long names.

        Returns
        -------
        xarray.Dataset
            Every dimension has a coordinate: its own variable, the names of its entries, or
            numbers from 0. At a jump, the time of the earlier value is smaller by the last digit,
            so labels are unique. Attributes are scene, kind, title and status.

        Raises
        ------
        ImportError
            If xarray is not installed.

        Examples
        --------
        >>> time = Variable("time", "s", ("time",), [0.0, 1.0, 1.0, 2.0])
        >>> jump = Variable("rate", "m s-1", ("time",), [1.0, 1.0, -1.0, -1.0])
        >>> data = Result("walk", "gait", variables=(time, jump)).to_xarray()
        >>> float(data["rate"].sel(time=1.0))
        -1.0
        """
        from wormopt.labelled import dataset

        facts = {name: getattr(self, name) for name in ("scene", "kind", "title", "status")}
        found = dataset(self.variables, self.labels, facts)
        for name, scalar in self.scalars.items():
            if isinstance(scalar.value, int | float):
                found[name] = ((), scalar.value, {"units": scalar.unit})
        return found

    def to_dataframe(self, over: str | None = None) -> pandas.DataFrame:
        """Make a pandas.DataFrame of the variables along one dimension.

        Parameters
        ----------
        over : str, optional
            Dimension of the rows; by default time, or the dimension of most variables.

        Returns
        -------
        pandas.DataFrame
            A row for each entry, columns ``length_0``, ``length_1`` and so on; the index is the
            coordinate of `to_xarray`, units by column are in ``attrs["units"]``. Of a sweep
            a row for each point: the swept keys, status, reason, and the numbers found.

        Raises
        ------
        UnknownNameError
            If no variable goes along that dimension.
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> time = Variable("time", "s", ("time",), [0.0, 1.0])
        >>> length = Variable("length", "m", ("link", "time"), [[1.0, 2.0], [3.0, 4.0]])
        >>> frame = Result("walk", "gait", variables=(time, length)).to_dataframe()
        >>> list(frame.columns), float(frame["length_1"][1.0])
        (['length_0', 'length_1'], 4.0)
        """
        if self.kind == "sweep" and over is None:
            return above("wormopt.families.gathered:dataframe")(self)
        from wormopt.labelled import dataframe

        return dataframe(self.variables, self.labels, over)

    def plot(self, picture: str = "") -> Figure:
        """Draw a picture of the result.

        Parameters
        ----------
        picture : str, optional
            A picture of the result's kind; the first one its scene wants if left out.

        Returns
        -------
        matplotlib.figure.Figure
            Bound to no window; a notebook shows it.

        Raises
        ------
        ValueError
            If its kind has no such picture.
        UnknownNameError
            Naming the variables that the picture needs and the result lacks.
        """
        return above("wormopt.pictures:figure")(self, picture or self._picture())

    def _picture(self) -> str:
        """First picture that the scene wants, or that its kind has; empty if there is none."""
        there = above("wormopt.pictures:pictures_of")(self)
        wanted = json.loads(self.scene_text).get("want", []) if self.scene_text else []
        return next((name for name in (*wanted, *there) if name in there), "")

    def summary(self) -> dict[str, Any]:
        """Data that `wormopt run --json` prints: names, status, scalars, trust and timings.

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

        An attribute ``table``, text in Markdown, is also written to ``table.md``; some kinds write
        further files.

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
        save(self, Path(folder), pictures)

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
            The result, equal to the saved one.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If the file is not a result of wormopt.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     Result("walk", "gait", scalars={"speed": Scalar(0.1)}).save(folder)
        ...     Result.load(folder).scalars["speed"].value
        0.1
        """
        return cls(**load(Path(path)))
