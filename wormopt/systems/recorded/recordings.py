"""Recordings: files of signals in columns, assigned to signals of a Model, measured or driving.

Files are checked by line and column.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NoReturn, TypeVar

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.files import is_there
from wormopt.quantities import parsed, scale, unit_of_signal
from wormopt.study import Given, Study, entry, on_use
from wormopt.study.scene import packaged_folder
from wormopt.study.types import Title
from wormopt.systems.recorded.tables import FiniteOrList, Span, near, scene_of
from wormopt.tables import Wrong, read_table

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.control.loop import feed, gait_reference
    from wormopt.fitting.recording import Recording, guesses, unwrapped
    from wormopt.model.gait import Gait
    from wormopt.model.given import fields_of
    from wormopt.model.model import Model, Output, Signal

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
    wrapped: Mapping[str, int] = field(default_factory=dict)  # see TextTable


def read_columns(path: Path, time: str) -> Columns:
    """Read a text file with a time column `time`; SceneError lists what is wrong in it."""
    wrong: list[Wrong] = []
    try:
        found = _read(path, time, wrong)
    except OSError as error:
        raise _unusable(path, f" cannot be read: {error.strerror}; name a readable file") from None
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
    units[""] = units.pop(time, "")
    return Columns(instants, values, units, table.texts, table.wrapped)


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

    def faults_in(
        self, folder: Path, units: str, declared: Mapping[str, tuple[str, tuple[str, ...], str]]
    ) -> Iterator[Fault]:
        """Yield faults of units in a scene with `units`, and of a text file in its folder."""
        quantities = {name: quantity for name, (quantity, *_) in declared.items()}
        for column, unit in self.units.items():
            quantity = self._quantity(column, quantities)
            yield from _faults_of_unit(f"units.{column}", unit, units, quantity)
        try:
            if self.is_text or not is_there(self.path(folder)):
                yield from self._faults_of_columns(self.read(folder), units, quantities)
        except SceneError as error:
            yield from error.faults

    def _quantity(self, column: str, quantities: Mapping[str, str]) -> str:
        """Quantity of a column, "" if it is not known."""
        signal, _ = entry_of(self.columns.get(column, column))
        return "time" if column == self.time else quantities.get(signal, "")

    def _faults_of_columns(
        self, columns: Columns, units: str, quantities: Mapping[str, str]
    ) -> Iterator[Fault]:
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
                quantity = self._quantity(named, quantities)
                for _, what in _faults_of_unit("", unit, units, quantity):
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


def _faults_of_unit(key: str, unit: str, units: str, quantity: str) -> Iterator[Fault]:
    if not unit or unit == "1":
        return
    if units != "SI":
        yield key, f'"{unit}" is a unit, but the scene has none; write units = "SI", or remove it'
        return
    try:
        _, dimension = scale(unit)
    except ValueError as error:
        yield (
            key,
            f'"{unit}" {error}; write for example "mm", "m/s" or "mN", or the size of 1: "20 ms"',
        )
        return
    if quantity and dimension != parsed(unit_of_signal(quantity, "SI"))[1]:
        yield key, _other_quantity(unit, quantity)


def _other_quantity(unit: str, quantity: str) -> str:
    wanted = unit_of_signal(quantity, "SI")
    what = quantity.replace("_", " ")
    return f'"{unit}" is not a unit of {what}; write {wanted}, or a multiple of it'


def entry_of(signal: str) -> tuple[str, int | None]:
    """Split a signal, for example "position[0]", into name and entry; None means all entries."""
    found = _ENTRY.fullmatch(signal)
    if found is None:
        return signal, None
    return found[1], None if found[2] is None else int(found[2])


_DRIVE = "recorded"
FileT = TypeVar("FileT", bound=RecordingFile)


def model_of(tables: dict[str, Any], which: str, study: Study, key: str = "model") -> Model:
    """Build the Model of the scene at `key` of a study, by its label; SceneError if it has none."""
    inner = scene_of(tables, study.folder, study.units, key)
    try:
        models = inner.table.models()
    except SceneError as error:
        faults = [(f"{key}.{where}" if where else key, what) for where, what in error.faults]
        raise SceneError(study.name, faults) from None
    if models is None:
        what = f'scenes of kind "{inner.table.kind}" have no Model to compare recordings with'
        hint = 'use a scene of kind "simulate", "track" or "magnetic-pair"'
        raise SceneError(study.name, [(f"{key}.kind", f"{what}; {hint}")])
    if which not in models and (which or len(models) > 1):
        there = near(which, models)
        raise SceneError(study.name, [("which", f'"{which}" is not a model of the scene; {there}')])
    return models[which] if which in models else next(iter(models.values()))


@dataclass(frozen=True, eq=False)
class Run:
    """A recording with the Model that its recorded inputs drive."""

    recording: Recording
    use: str  # "fit" or "predict"
    left_out: tuple[str, ...]  # columns that are not signals
    drives: tuple[str, ...]  # inputs and parameters that were recorded
    warnings: tuple[str, ...] = ()

    @property
    def fitted(self) -> bool:
        """Whether the run is fitted, not held out."""
        return self.use == "fit"


def runs_of(
    tables: Sequence[RecordingFile],
    folder: Path,
    model: Model,
    units: str,
    noise: Mapping[str, float],
    file: str,
) -> list[Run]:
    """Read all recordings of a scene; SceneError for `file` lists all faults."""
    found, faults = read_all(tables, lambda table: run_of(table, folder, model, units, noise))
    seen = {name for run in found for name in run.recording.values}
    if not faults:
        faults += (
            (f"noise.{name}", f"{name} has no readings; {near(name, seen)}")
            for name in noise
            if name not in seen
        )
    if faults:
        raise SceneError(file, faults)
    return found


def read_all(
    tables: Sequence[FileT], read: Callable[[FileT], Run]
) -> tuple[list[Run], list[Fault]]:
    """Read the recordings of a scene one by one; returns runs, and the faults of all recordings."""
    found, faults = list[Run](), list[Fault]()
    for k, table in enumerate(tables):
        try:
            found.append(read(table))
        except SceneError as error:
            faults += [(f"recording[{k}].{key}", what) for key, what in error.faults]
        except ArgumentError as error:
            faults.append((f"recording[{k}]", str(error)))
    return found, faults


def run_of(
    table: RecordingFile,
    folder: Path,
    model: Model,
    units: str,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> Run:
    """Read the recording of a run of a model; SceneError has keys of the table."""
    _check_counts(model, table)
    columns = table.read(folder)
    places = _Places(model, table, units)
    seen, driven, left = places.sorted(columns)
    pace = places.factor("time", places.unit_of("", columns), table.time)
    if pace < 0:
        what = "is negative; write a positive unit of time"
        raise SceneError(table.file, [(f"units.{table.time}", what)])
    time = np.asarray(columns.time) * pace
    first, last = table.window or (-np.inf, np.inf)
    kept = (first <= np.asarray(columns.time)) & (np.asarray(columns.time) <= last)
    values = {name: rows[:, kept] for name, rows in places.rows(seen, columns).items()}
    if not any(np.isfinite(rows).any() for rows in values.values()):
        what = "contains no reading of a state or output; name its columns"
        raise SceneError(table.file, [("file", what)])
    own, warnings = model, places.guesses(seen, time[kept], values)
    warnings += (
        f"negative numbers of column {column} are written as unsigned ones of {bits} bits: "
        f"2^{bits} is subtracted from them"
        for column, bits in columns.wrapped.items()
        if column in seen or column in driven
    )
    if driven:
        courses = places.rows(driven, columns)
        warnings += places.guesses(driven, time, courses)
        own = _driven(model, courses, time, table.between == "held", warnings)
    warnings = [f"{table.label}: {what}" for what in warnings]
    recording = Recording(
        time[kept],
        values,
        noise={name: sd for name, sd in noise.items() if name in values} or None,
        x0=table.start,
        p=table.parameters,
        model=own if driven else None,
        name=table.label,
    )
    drives = tuple(sorted({name for name, _ in driven.values()}))
    return Run(recording, table.use, tuple(left), drives, tuple(warnings))


def _check_counts(model: Model, table: RecordingFile) -> None:
    """Raise SceneError for lists of another length than their signals, also for those of one."""
    sizes = {signal.name: signal.size for signal in (*model.x, *model.p, *model.u)}
    faults = [
        (
            f"{key}.{name}",
            f"has {len(value)} entr{'y' if len(value) == 1 else 'ies'} for {sizes[name]}; write "
            f"one number for all, or a list of {sizes[name]}",
        )
        for key, given in (("start", table.start), ("parameters", table.parameters))
        for name, value in (given or {}).items()
        if isinstance(value, list | tuple) and len(value) != sizes.get(name, len(value))
    ]
    if faults:
        raise SceneError(table.file, faults)


# -- assignment of columns -------------------------------------------------------------------------

_Place = tuple[str, int]
"""Name and entry of a signal."""


class _Places:
    """Assignment of columns of a recording to signals of a Model."""

    def __init__(self, model: Model, table: RecordingFile, units: str) -> None:
        self._table, self._units = table, units
        outputs = {o.name: (o.expression.numel(), o.unit) for o in model.outputs}
        states = {s.name: (s.size, s.unit) for s in model.x}
        self._drives = {s.name: (s.size, s.unit) for s in (*model.u, *model.p)}
        self._seen = outputs | states

    def sorted(self, columns: Columns) -> tuple[dict[str, _Place], dict[str, _Place], list[str]]:
        """Split columns into measured ones, driving ones, and others."""
        seen: dict[str, _Place] = {}
        driven: dict[str, _Place] = {}
        left: list[str] = []
        for column in columns.values:
            named = self._table.columns.get(column)
            place = self._place(column) if named is None else self._place(named)
            if place and column in columns.texts:
                self._refuse(
                    "file", f"column {column} contains text, not numbers; rename or fix it"
                )
            if place is None and named is None:
                left.append(column)
            elif place is None:
                self._refuse(f"columns.{column}", self._why_none(named or ""))
            else:
                (driven if place[0] in self._drives else seen)[column] = place
        for places in (seen, driven):
            for place in places.values():
                if list(places.values()).count(place) > 1:
                    self._refuse(
                        "columns", f"two columns are named {place[0]}[{place[1]}]; keep one"
                    )
        if not seen:
            there = ", ".join([*self._seen])
            what = "no column is a state or output of the model; name one, for example columns = "
            example = f'{{{next(iter(columns.values), "x0")} = "{next(iter(self._seen))}"}}'
            self._refuse("columns", f"{what}{example}; the signals are {there}")
        return seen, driven, left

    def _place(self, signal: str) -> _Place | None:
        """Name and entry of a signal, written as x[0], x_0 or x."""
        known = self._seen | self._drives
        name, entry = entry_of(signal)
        head, _, tail = signal.rpartition("_")
        if name not in known and head in known and tail.isdecimal():
            name, entry = head, int(tail)
        if name not in known or (entry is None and known[name][0] > 1):
            return None
        return (name, entry or 0) if (entry or 0) < known[name][0] else None

    def _why_none(self, signal: str) -> str:
        known = self._seen | self._drives
        name, entry = entry_of(signal)
        if name not in known:
            entries = (
                f"{n}[{k}]" if size > 1 else n
                for n, (size, _) in known.items()
                for k in range(size)
            )
            return f"the model has no signal {signal}; {near(signal, entries)}"
        size = known[name][0]
        one = f"{name}[0]" if size == 2 else f"{name}[0] to {name}[{size - 1}]"
        if entry is None:
            return f"{name} has {size} entries; write one of {one}"
        return f"{name} has {size} entries, counted from 0; write at most {name}[{size - 1}]"

    def rows(self, places: Mapping[str, _Place], columns: Columns) -> dict[str, np.ndarray]:
        """Readings (size, m) of every signal, in the scene's units; NaN if missing."""
        known, found = self._seen | self._drives, dict[str, np.ndarray]()
        for column, (name, which) in places.items():
            size, quantity = known[name]
            rows = found.setdefault(name, np.full((size, len(columns.time)), np.nan))
            factor = self.factor(quantity, self.unit_of(column, columns), column)
            rows[which] = factor * np.asarray(columns.values[column])
            if self._turns(column, name, which):
                rows[which] = unwrapped(rows[which])
        return found

    def guesses(
        self, places: Mapping[str, _Place], time: np.ndarray, rows: Mapping[str, np.ndarray]
    ) -> list[str]:
        """Warnings of angles that were unwrapped across pauses."""
        return [
            f"column {column} {what}"
            for column, (name, entry) in places.items()
            if self._turns(column, name, entry)
            for what in guesses(time, rows[name][entry])
        ]

    def _turns(self, column: str, name: str, entry: int) -> bool:
        """Whether a column is an angle modulo one turn."""
        return bool({column, name, f"{name}[{entry}]"} & set(self._table.unwrap))

    def unit_of(self, column: str, columns: Columns) -> str:
        """Unit of a column, "" if unknown; the time column is "" in the file."""
        named = column or self._table.time
        return self._table.units.get(named, columns.units.get(column, ""))

    def factor(self, quantity: str, unit: str, column: str) -> float:
        """Conversion factor for readings of a column."""
        if not unit or self._units != "SI":
            return 1.0
        wanted = unit_of_signal(quantity, "SI")
        try:
            (size, dimension), (one, needed) = scale(unit), parsed(wanted)
        except ValueError as error:
            self._refuse(f"units.{column}", f'"{unit}" {error}; write for example {wanted}')
        if dimension != needed:
            self._refuse(f"units.{column}", _other_quantity(unit, quantity))
        return float(size / one)

    def _refuse(self, key: str, what: str) -> NoReturn:
        raise SceneError(self._table.file, [(key, what)])


# -- recorded inputs -------------------------------------------------------------------------------


def _driven(
    model: Model,
    courses: Mapping[str, np.ndarray],
    time: np.ndarray,
    held: bool,
    warnings: list[str],
) -> Model:
    """Make a Model whose inputs and parameters of these names follow recorded values (size, m)."""
    signals = [s for s in (*model.u, *model.p) if s.name in courses]
    numbers = chain.from_iterable(fields_of(contact.law).values() for contact in model.contacts)
    friction = ca.vertcat(ca.SX(0, 1), *(v for v in numbers if isinstance(v, ca.SX)))
    for s in signals:
        if ca.depends_on(friction, s.symbol):
            raise ArgumentError(
                f"{s.name} is a friction parameter, which cannot vary in time; remove its column"
            )
    rows = np.vstack([_whole(s, courses[s.name], time, warnings) for s in signals])
    slope = np.zeros_like(rows[:, :-1]) if held else np.diff(rows) / np.diff(time)
    course = Gait(time - time[0], np.stack([rows[:, :-1].T, slope.T], axis=2))
    reference = gait_reference(course, model.t, shift=-time[0], periodic=False, name=_DRIVE)
    fed = feed(model, signals, reference.value)
    at, shown = 0, []
    for s in signals:
        shown.append(Output(s.name, reference.value[at : at + s.size], s.unit))
        at += s.size
    return replace(
        fed,
        p=[p for p in model.p if p not in signals],
        outputs=[*(o for o in fed.outputs if o.name not in courses), *shown],
        schedules=[*fed.schedules, *reference.schedules],
    )


def _whole(signal: Signal, rows: np.ndarray, time: np.ndarray, warnings: list[str]) -> np.ndarray:
    """Values of all entries of a signal without gaps; entries not recorded keep their value."""
    usual = np.broadcast_to(np.asarray(signal.value, dtype=float), signal.size)
    found = np.tile(usual[:, None], len(time))
    for k, row in enumerate(rows):
        there = np.isfinite(row)
        if not there.any():
            continue
        if not there.all():
            warnings.append(
                f"{np.sum(~there)} missing readings of {signal.name}[{k}] are interpolated linearly"
            )
        found[k] = np.interp(time, time[there], row[there])
    return found
