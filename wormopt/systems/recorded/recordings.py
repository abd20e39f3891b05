"""Assigns the columns of recorded files to the signals of a Model: measured or driving."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

import casadi as ca
import numpy as np

from wormopt.control.loop import feed, gait_reference
from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.fitting.recording import Recording, guesses, unwrapped
from wormopt.model.gait import Gait
from wormopt.model.given import fields_of
from wormopt.model.model import Model, Output, Signal
from wormopt.quantities import UNITS, parsed, scale, unit_of
from wormopt.study import Study
from wormopt.systems.recorded.recording_file import Columns, RecordingFile, entry_of
from wormopt.systems.recorded.tables import near, scene_of

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
        raise SceneError(study.name, [("which", f'"{which}" is no model of the scene; {there}')])
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
        for column, (name, entry) in places.items():
            size, quantity = known[name]
            rows = found.setdefault(name, np.full((size, len(columns.time)), np.nan))
            factor = self.factor(quantity, self.unit_of(column, columns), column)
            rows[entry] = factor * np.asarray(columns.values[column])
            if self._turns(column, name, entry):
                rows[entry] = unwrapped(rows[entry])
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
        wanted = unit_of(quantity, "SI") if quantity in UNITS else quantity
        try:
            (size, dimension), (one, needed) = scale(unit), parsed(wanted)
        except ValueError as error:
            self._refuse(f"units.{column}", f'"{unit}" {error}; write for example {wanted}')
        if dimension != needed:
            what = f'"{unit}" is not a unit of {quantity.replace("_", " ")}; write {wanted}, or a'
            self._refuse(f"units.{column}", f"{what} multiple of it")
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
