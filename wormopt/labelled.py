"""Signals by name, as tables of xarray and pandas with a coordinate for every dimension.

Dimensions are numbered from 0 if their entries have no names. At a jump an instant occurs twice,
before and after; since an index must be unique, the earlier one is moved back by the last digit: at
the instant itself a table shows the later value.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import product
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wormopt.errors import UnknownNameError
from wormopt.lazy import above
from wormopt.quantities import Variable
from wormopt.shown import SHORT, Part, html, lines, text

if TYPE_CHECKING:
    import pandas
    import xarray


class Samples(NamedTuple):
    """A named array like a Variable, of any name; it may have an empty unit."""

    name: str
    dims: tuple[str, ...]
    values: np.ndarray
    unit: str = ""
    long_name: str = ""


Array = Variable | Samples

Names = Mapping[str, Sequence[str]]
"""Dimension: names of its entries."""
# Preferred dimensions of the rows of a table.
_ROWS = ("time", "instant")
_NONE: Mapping[str, Any] = MappingProxyType({})


def optional(package: str) -> ModuleType:
    """Import pandas or xarray; the ImportError names the extra `data`."""
    try:
        return import_module(package)
    except ImportError as error:
        what = f"{package} cannot be imported ({error})"
        advice = "install it with: pip install 'wormopt[data]'"
        raise ImportError(f"{what}; {advice}", name=package) from error


def labels(dims: Iterable[str], held: Mapping[str, Any]) -> dict[str, list[str]]:
    """Names along dimensions, from lists of texts of the same names: trackers, rivals."""
    found: dict[str, list[str]] = {}
    for dim in dims:
        names = held.get(f"{dim.removeprefix('other_')}s")
        names = names.get("name") if isinstance(names, Mapping) else names
        if isinstance(names, list) and all(isinstance(name, str) for name in names):
            found[dim] = names
    return found


def apart(instants: np.ndarray) -> np.ndarray:
    """Move all but the last of equal ascending instants back, by the last digit of the largest."""
    steps = np.diff(instants)
    if not np.any(steps == 0) or np.any(steps < 0):
        return instants
    moved, digit = np.array(instants, dtype=float), np.spacing(np.abs(instants).max())
    for k in range(len(moved) - 2, -1, -1):
        if moved[k] >= moved[k + 1]:
            moved[k] = moved[k + 1] - digit
    return moved


def dataset(
    variables: Iterable[Array], names: Names = _NONE, attributes: Mapping[str, Any] = _NONE
) -> xarray.Dataset:
    """Make an xarray.Dataset with units, long names and a coordinate for each dimension."""
    xarray = optional("xarray")
    variables = tuple(variables)
    own = coordinates(variables, names)
    units = {v.name: _attributes(v) for v in variables}
    return xarray.Dataset(
        {v.name: (v.dims, v.values, _attributes(v)) for v in variables if v.name not in own},
        coords={dim: (dim, values, units.get(dim, {})) for dim, values in own.items()},
        attrs=dict(attributes),
    )


def dataframe(
    variables: Iterable[Array], names: Names = _NONE, over: str | None = None
) -> pandas.DataFrame:
    """Make a pandas.DataFrame along one dimension: time, or that of most variables.

    Columns are named after the entries of the other dimensions, ``length_0``; their units are in
    ``attrs["units"]``. UnknownNameError if no variable has the requested dimension.
    """
    pandas = optional("pandas")
    variables = tuple(variables)
    own = coordinates(variables, names)
    row = over or _most(variables)
    if row not in own:
        raise UnknownNameError("the table", "dimension", [row], own)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for v in variables:
        if row not in v.dims or v.name in own:
            continue
        values = np.moveaxis(v.values, v.dims.index(row), 0)
        entries = product(*(own[dim] for dim in v.dims if dim != row))
        for entry, column in zip(entries, values.reshape(len(values), -1).T, strict=True):
            name = "_".join((v.name, *map(str, entry)))
            columns[name], units[name] = column, v.unit
    units |= {v.name: v.unit for v in variables if v.name == row}
    frame = pandas.DataFrame(columns, index=pandas.Index(own[row], name=row))
    known = {name: unit for name, unit in units.items() if unit}
    frame.attrs |= {"units": known} if known else {}
    return frame


def coordinates(variables: Sequence[Array], names: Names) -> dict[str, np.ndarray]:
    """Coordinate of each dimension: a variable of its name, names, or numbers from 0."""
    lengths = {dim: n for v in variables for dim, n in zip(v.dims, v.values.shape, strict=True)}
    own = {v.name: apart(v.values) for v in variables if v.dims == (v.name,)}
    named = {
        dim: np.array(names[dim]) for dim in lengths if len(names.get(dim, ())) == lengths[dim]
    }
    return {dim: np.arange(n) for dim, n in lengths.items()} | named | own


def _most(variables: Sequence[Array]) -> str:
    dims = [dim for v in variables for dim in v.dims]
    timed = [dim for dim in _ROWS if dim in dims]
    return timed[0] if timed else max(dict.fromkeys(dims), key=dims.count, default="time")


def _attributes(variable: Array) -> dict[str, str]:
    attributes = {"units": variable.unit, "long_name": variable.long_name}
    return attributes if variable.unit else {}


# Panels of a picture and rows of a table that are shown by default.
_MOST_PANELS, _MOST_ROWS = 8, 24

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure


class SampledMotion(ABC):
    """Motion known at instants: simulated, optimal, or a crawl in closed form."""

    time: np.ndarray  # (m,) instants, ascending; duplicated at jumps

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of its signals."""

    @abstractmethod
    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (entries, m) of a signal."""

    def dimension(self, name: str) -> str:
        """Name of the dimension of a signal's entries."""
        return f"{name}_entry"

    @property
    def _title(self) -> str:
        return type(self).__name__

    def __repr__(self) -> str:
        span = f"time {self.time[0]:.6g} to {self.time[-1]:.6g}, " if len(self.time) else ""
        of = f"{self._title}: {span}{len(self.time)} instants"
        return lines(of, ", ".join(self.names))

    def overview(self) -> Part:
        """Rows of a table: each entry of a signal at both ends, its smallest and largest value."""
        rows = [("signal", "first", "last", "smallest", "largest")]
        for name in self.names if len(self.time) else ():
            values = np.atleast_2d(self[name])
            for j, row in enumerate(values):
                label = f"{name}_{j}" if len(values) > 1 else name
                first, last, least, most = (
                    text(float(number), SHORT) for number in (row[0], row[-1], row.min(), row.max())
                )
                rows.append((label, first, last, least, most))
        left = len(rows) - 1 - _MOST_ROWS
        cut = f"; {left} more rows are left out" if left > 0 else ""
        return Part(f"{len(self.time)} instants{cut}", rows[: _MOST_ROWS + 1])

    def _repr_html_(self) -> str:
        return html(self._title, [self.overview()])

    def _samples(self) -> Iterator[Samples]:
        yield Samples("time", ("time",), self.time)
        for name in self.names:
            values = np.atleast_2d(self[name])
            single = len(values) == 1
            dims = ("time",) if single else (self.dimension(name), "time")
            yield Samples(name, dims, values[0] if single else values)

    def to_xarray(self) -> xarray.Dataset:
        """Make an xarray.Dataset of all signals over the coordinate ``time``.

        Returns
        -------
        xarray.Dataset
            Signals of several entries have a dimension of their own, ``<name>_entry``, that counts
            from 0; with ``mass`` and ``link`` instead in a crawl. At a jump, the time of the
            earlier value is smaller by the last digit, so labels are unique.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        return dataset(self._samples())

    def to_dataframe(self) -> pandas.DataFrame:
        """Make a pandas.DataFrame: a row for each instant, columns ``position_0`` and so on.

        Returns
        -------
        pandas.DataFrame
            Its index is ``time``, the same as that of `to_xarray`.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return dataframe(self._samples(), over="time")

    def plot(self, *names: str) -> Figure:
        """Draw signals over time, one below the other.

        Parameters
        ----------
        *names : str
            Names of signals; the first eight if left out.

        Returns
        -------
        matplotlib.figure.Figure
            Bound to no window; a notebook shows it.

        Raises
        ------
        UnknownNameError
            If there is no such signal.
        """
        return above("wormopt.pictures.motion:signals")(self, names or self.names[:_MOST_PANELS])
