"""Files of recordings: measured signals over time in columns, checked by line and column."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from wormopt.errors import Fault, SceneError
from wormopt.files import is_there
from wormopt.quantities import scale
from wormopt.study import Given, entry, on_use
from wormopt.study.scene import packaged_folder
from wormopt.study.types import Title
from wormopt.systems.recorded.tables import FiniteOrList, Span, near
from wormopt.tables import Wrong, read_table

with on_use():
    import numpy as np

_ENTRY = re.compile(r"([A-Za-z][A-Za-z0-9_]*?)(?:\[(\d+)\])?")
_REPORTED = 5  # faults of one file that are reported
_FILL = 9.969209968386869e36  # of NetCDF for missing numbers, unless a file gives another


@dataclass(frozen=True)
class Columns:
    """Readings (NaN if missing) by column, over ascending times."""

    time: Sequence[float]
    values: dict[str, Sequence[float]]
    units: dict[str, str] = field(default_factory=dict)  # of columns that have one, of time as ""
    texts: frozenset[str] = frozenset()  # columns of text, whose values are all NaN


def read_columns(path: Path, time: str) -> Columns:
    """Read a text file with a time column `time`; SceneError lists what is wrong in it."""
    wrong: list[Wrong] = []
    try:
        found = _read(path, time, wrong)
    except OSError as error:
        raise _unusable(path, f" cannot be read: {error.strerror}") from None
    if found is None or wrong:
        more = len(wrong) - _REPORTED
        rest = [f": and {more} more such faults"] if more > 0 else []
        raise _unusable(path, *(what for _, what in wrong[:_REPORTED]), *rest)
    return found


def _unusable(path: Path, *what: str) -> SceneError:
    return SceneError(path.name, [("file", f"{path.name}{one}") for one in what])


def _read(path: Path, time: str, wrong: list[Wrong]) -> Columns | None:
    table = read_table(path, wrong, time=time)
    if table is None:
        return None
    if time not in table.values:
        there = ", ".join(table.values)
        what = (
            f' line {table.head}: there is no column {time}; write time = "..." with one of {there}'
        )
        wrong.insert(0, ("", what))
        return None
    if not wrong and len(table.lines) < 2:
        count = "one" if table.lines else "no"
        wrong.append(("", f" has {count} line of readings; at least two are needed"))
        return None
    values, units = dict(table.values), dict(table.units)
    instants = values.pop(time)
    if not wrong:
        _check_times(table.lines, instants, time, wrong)
    return Columns(instants, values, units | {"": units.pop(time, "")}, table.texts)


def _check_times(
    lines: Sequence[int], times: Sequence[float], name: str, wrong: list[Wrong]
) -> None:
    for k, (line, t) in enumerate(zip(lines, times, strict=True)):
        if math.isnan(t):
            wrong.append((name, f" line {line}, column {name}: the time is missing; write it"))
        elif k and t == times[k - 1]:
            what = f" line {line}: time {t:g} appears twice; keep one of these lines"
            wrong.append((name, what))
        elif k and t < times[k - 1]:
            what = f"time decreases from {times[k - 1]:g} to {t:g}; sort the lines by time"
            wrong.append((name, f" line {line}: {what}, or split the file into several runs"))


def _read_netcdf(path: Path, time: str) -> Columns:
    """Columns of a NetCDF-3 file: variables along the dimension of `time`, entry by entry."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(path, "r", mmap=False, maskandscale=True) as file:
            stored = {
                name: (one.dimensions, _with_gaps(one[:]), _unit(one))
                for name, one in file.variables.items()
                if one.dimensions and one.data.dtype.kind in "fiu"
            }
    except Exception as error:  # the reader raises almost any error on other files
        hint = 'rewrite it, in xarray with to_netcdf(..., format="NETCDF3_64BIT")'
        what = f" is not a NetCDF-3 file ({error}); {hint}, or as CSV"
        raise _unusable(path, what) from None
    if time not in stored or len(stored[time][0]) != 1:
        there = near(time, (name for name, (dims, _, _) in stored.items() if len(dims) == 1))
        raise _unusable(path, f" has no time variable {time}; {there}")
    (along,), instants, unit = stored.pop(time)
    wrong = np.flatnonzero(~(np.isfinite(instants[1:]) & (np.diff(instants) > 0)))
    if wrong.size or not np.isfinite(instants[:1]).all():
        k = int(wrong[0]) + 1 if wrong.size else 0
        what = f": times do not increase at index {k}, {instants[k]:g}; keep each time once"
        raise _unusable(path, what)
    values, units = {}, {"": unit}
    for name, (dims, array, unit) in stored.items():
        if along not in dims or len(dims) > 2:
            continue
        rows = np.atleast_2d(np.moveaxis(array, dims.index(along), -1))
        for k, row in enumerate(rows):
            column = f"{name}[{k}]" if len(dims) > 1 else name
            values[column], units[column] = row.tolist(), unit
    return Columns(instants.tolist(), values, units)


def _with_gaps(values: np.ndarray) -> np.ndarray:
    """Numbers of a NetCDF file, with NaN for its fill value."""
    found = np.ma.filled(np.ma.array(values, dtype=float), np.nan)
    return np.where(np.isclose(found, _FILL, rtol=1e-6), np.nan, found)


def _unit(variable: object) -> str:
    unit = getattr(variable, "units", b"")
    return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)


class RecordingFile(Given):
    """A recording of one run of the worm: a file with columns over time.

    A text file has a line with the names of its columns, optionally with units, `x0 [mm]`. Lines
    above the line that contains the time column are skipped. Separators, decimal commas and the
    encoding are recognised. Empty cells and `#N/A` are gaps. A NetCDF-3 file, for example the
    `result.nc` of a scene, has a dimension `time`.
    """

    file: str = entry(
        "CSV or NetCDF-3 file, relative to the scene's folder, or one packaged with wormopt"
    )
    name: Title = entry("name of the run in results; default: name of the file", default="")
    use: Literal["fit", "predict"] = entry(
        "`fit`: used in the fit; `predict`: held out and predicted by the fit", default="fit"
    )
    time: str = entry("name of the time column", default="time")
    columns: dict[str, str] = entry(
        'signal of each column, `{x0 = "position[0]"}`. Columns named like a signal need no '
        "entry; other columns are ignored. States and outputs are fitted; recorded inputs and "
        "parameters drive the model",
        default=dict,
    )
    units: dict[str, str] = entry(
        'unit of each column, `{x0 = "mm"}`, if the header line gives none, or the size of a '
        'frame or pixel: `{frame = "20 ms", x0 = "-0.21 mm"}`, negative if an axis points '
        "backwards",
        default=dict,
    )
    unwrap: tuple[str, ...] = entry(
        "columns or signals with angles recorded modulo one turn; they are unwrapped", default=()
    )
    window: Span | None = entry(
        "time interval that is used, [first, last], in the file's times; default: all", default=None
    )
    start: dict[str, FiniteOrList] = entry(
        "known initial states that differ from those of `[model]`", default=dict
    )
    parameters: dict[str, FiniteOrList] = entry(
        "parameters and inputs of this run that differ from those of `[model]`", default=dict
    )
    between: Literal["linear", "held"] = entry(
        "recorded inputs between readings: linear, or held until the next reading", default="linear"
    )

    @property
    def label(self) -> str:
        """Name of the run."""
        return self.name or Path(self.file).stem

    def path(self, folder: Path) -> Path:
        """Path of the file, in the scene's folder or among the packaged recordings."""
        beside, packaged = folder / self.file, packaged_folder() / self.file
        return packaged if is_there(packaged) and not is_there(beside) else beside

    @property
    def is_text(self) -> bool:
        """Whether the file is text, not NetCDF."""
        return Path(self.file).suffix.lower() != ".nc"

    def read(self, folder: Path) -> Columns:
        """Columns of the file; SceneError lists what is wrong with it."""
        path = self.path(folder)
        if not is_there(path):
            beside = sorted(p.name for p in path.parent.glob(f"*{path.suffix}"))
            hint = near(path.name, beside) if beside else "write its path"
            what = f'there is no file "{self.file}" in {folder}; {hint}'
            raise SceneError(self.file, [("file", what)])
        return read_columns(path, self.time) if self.is_text else _read_netcdf(path, self.time)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a reversed window, and names that no signal has."""
        if self.window and not self.window[0] < self.window[1]:
            yield "window", "the first time is not before the last; write [first, last]"
        for column, signal in self.columns.items():
            if not _ENTRY.fullmatch(signal):
                yield (
                    f"columns.{column}",
                    f'"{signal}" is not the name of a signal; write for example "position[0]"',
                )

    def faults_in(self, folder: Path, units: str) -> Iterator[Fault]:
        """Yield faults of units in a scene with `units`, and of a text file in its folder."""
        for column, unit in self.units.items():
            yield from _faults_of_unit(f"units.{column}", unit, units)
        try:
            if self.is_text or not is_there(self.path(folder)):
                yield from self._faults_of_columns(self.read(folder), units)
        except SceneError as error:
            yield from error.faults

    def _faults_of_columns(self, columns: Columns, units: str) -> Iterator[Fault]:
        for name in ("columns", "units"):
            for column in getattr(self, name):
                if column not in columns.values and column != self.time:
                    what = f"the file has no column {column}; {near(column, columns.values)}"
                    yield f"{name}.{column}", what
        signals = {*self.columns.values(), *columns.values}
        known = signals | {entry_of(signal)[0] for signal in signals}
        for name in self.unwrap:
            if name not in known:
                what = f"the file has no column {name}; {near(name, columns.values)}"
                yield "unwrap", what
        for column in columns.texts & self.columns.keys():
            yield f"columns.{column}", "the column contains text, not numbers; remove the key"
        for column, unit in columns.units.items():
            named = column or self.time
            if named not in self.units and (column == "" or named in self.columns):
                for _, what in _faults_of_unit("", unit, units):
                    yield "file", f"{Path(self.file).name}, column {named}: {what}"
        if self.window:
            first, last = self.window
            inside = sum(first <= t <= last for t in columns.time)
            if inside < 2:
                ends = f"from {columns.time[0]:g} to {columns.time[-1]:g}"
                yield (
                    "window",
                    f"contains {inside} times of the file, but at least 2 are needed; its times "
                    f"are {ends}",
                )


def _faults_of_unit(key: str, unit: str, units: str) -> Iterator[Fault]:
    if not unit or unit == "1":
        return
    if units != "SI":
        yield key, f'"{unit}" is a unit in a scene without; write units = "SI", or remove it'
        return
    try:
        scale(unit)
    except ValueError as error:
        yield (
            key,
            f'"{unit}" {error}; write for example "mm", "m/s" or "mN", or the size of 1: "20 ms"',
        )


def entry_of(signal: str) -> tuple[str, int | None]:
    """Split a signal, for example "position[0]", into name and entry; None means all entries."""
    found = _ENTRY.fullmatch(signal)
    if found is None:
        return signal, None
    return found[1], None if found[2] is None else int(found[2])
