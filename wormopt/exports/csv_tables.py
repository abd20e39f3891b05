"""CSV tables: signals over time, one row for each instant; others over their dimensions."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.exports.common import ExportedGait, remarks, times
from wormopt.families.gathered import columns_of
from wormopt.model.gait import Gait
from wormopt.model.gait_table import remark_of_gait, signal_of
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.systems.spiked.construct import gait_of_result

# Dimensions of time, and signals that may be those of a gait, with the order of derivative.
_AXES = ("time", "instant")
_OF_GAIT = {"length": 0, "reference": 0, "rate": 1, "acceleration": 2}
_SAME = 1e-9


def make(
    result: Result,
    stem: str,
    step: float | None = None,
    columns: Sequence[str] = (),
    *,
    whole_steps: bool = False,
) -> dict[str, bytes]:
    """Tables of a result: ``STEM.csv`` over time, ``STEM_point.csv`` and so on over the rest.

    A single table without time is ``STEM.csv``; a sweep has a row for each point. With `columns`,
    only signals of these names; with `whole_steps`, one closed cycle of the gait, slowed down to
    whole steps.
    """
    made = tables(result, stem, step, columns, whole_steps=whole_steps)
    return {f"{name}.csv": _text(*table) for name, table in made.items()}


Column = tuple[str, str, np.ndarray | list[Any]]
"""Name, unit, and one value for each row."""
Table = tuple[list[str], list[Column]]
"""Remarks, and columns."""


def tables(
    result: Result,
    stem: str,
    step: float | None,
    columns: Sequence[str],
    *,
    whole_steps: bool,
) -> dict[str, Table]:
    """Tables of a result by name, see `make`."""
    if result.kind == "sweep" and step is None and not columns:
        points = columns_of(result).items()
        return {stem: (remarks(result), [(name, *column) for name, column in points])}
    if whole_steps and step is not None:
        about, found = _cycle(result, step)
        found = _chosen({stem: found}, columns)[stem]
        return {stem: (_kept(about, found), found)}
    head = remarks(result)
    own = [v.name for v in result.variables if v.dims == (v.name,)]
    axis = next((a for a in _AXES if a in own), None)
    by_dimension: dict[str, list[Variable]] = {}
    for variable in result.variables:
        if not variable.name.startswith("gait_"):
            over = axis if axis in variable.dims else "_".join(variable.dims)
            by_dimension.setdefault(str(over), []).append(variable)
    if not by_dimension:
        raise ArgumentError(f"{result.scene}: the result holds no signals; export it to mat")
    if step is not None and axis is None:
        raise ArgumentError(f"{result.scene}: the result has no time; leave out the step")
    made: dict[str, list[Column]] = {}
    notes: dict[str, list[str]] = {}
    for over, variables in by_dimension.items():
        name = stem if over == axis or len(by_dimension) == 1 else f"{stem}_{over}"
        if axis is not None and over == axis:
            notes[name], made[name] = _over_time(result, axis, variables, step)
        else:
            made[name] = list(_long(result, variables))
    return {
        name: ([*head, *_kept(notes.get(name, []), found)], found)
        for name, found in _chosen(made, columns).items()
    }


def _chosen(tables: dict[str, list[Column]], names: Sequence[str]) -> dict[str, list[Column]]:
    """Tables with columns of these names, "length" for all of its entries; all without names."""
    if not names:
        return tables
    there = dict.fromkeys(name for found in tables.values() for name, _, _ in found)
    for name in names:
        if not any(_is_of(column, name) for column in there):
            raise UnknownNameError("the result", "column", [name], there)
    chosen = {
        table: [c for c in found if any(_is_of(c[0], name) for name in names)]
        for table, found in tables.items()
    }
    return {  # the first column is time, or the index
        table: [*found[:1], *(c for c in chosen[table] if c is not found[0])]
        for table, found in tables.items()
        if chosen[table]
    }


def _is_of(column: str, name: str) -> bool:
    return column == name or re.fullmatch(re.escape(name) + r"(_\d+)+", column) is not None


def _kept(remarks: list[str], columns: Sequence[Column]) -> list[str]:
    """Remarks on a table; that for reading back a gait requires the gait's columns."""
    names = [name for name, _, _ in columns]
    return [
        line
        for line in remarks
        if not (signal := signal_of(line)) or any(_is_of(name, signal) for name in names)
    ]


def _cycle(result: Result, step: float) -> tuple[list[str], list[Column]]:
    """Remarks and columns of one closed cycle of a gait in whole steps."""
    exported = ExportedGait.of(result).in_whole_steps(step)
    cycle, gait = exported.gait.period, exported.gait
    t = np.append(times(step, 0.0, cycle)[:-1], cycle)
    columns: list[Column] = [("time", exported.units[0], t)]
    for derivative, name in enumerate(("length", "rate", "acceleration")):
        unit = exported.units[derivative + 1]
        rows = gait(t, derivative) if derivative else exported.rounded(gait(t))
        columns += [(f"{name}_{j}", unit, row) for j, row in enumerate(rows)]
    return [
        *exported.remarks,
        *exported.rounding,
        remark_of_gait("length", cycle, exported.units[0]),
    ], columns


def plain(values: np.ndarray | list[Any]) -> list[Any]:
    """Values of a column as numbers, texts and lists of Python."""
    return values if isinstance(values, list) else values.tolist()


def _text(remarks: Sequence[str], columns: Sequence[Column]) -> bytes:
    stream = io.StringIO()
    stream.writelines(f"# {line}\n" for line in remarks)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([f"{name} [{unit}]" if unit else name for name, unit, _ in columns])
    writer.writerows(zip(*(plain(values) for _, _, values in columns), strict=True))
    return stream.getvalue().encode()


def _over_time(
    result: Result, axis: str, variables: Sequence[Variable], step: float | None
) -> tuple[list[str], list[Column]]:
    """Remarks and columns of the signals over time, at the result's own instants or at others."""
    own = result[axis].values.astype(float)
    at = own if step is None else times(step, own[0], own[-1])
    if len(at) == 1 < len(own):
        length = f"{own[-1] - own[0]:g} {result[axis].unit}".removesuffix(" 1")
        raise ArgumentError(f"the step {step:g} gives one row only; write less than {length}")
    columns: list[Column] = [("time", result[axis].unit, at)]
    exact = _of_gait(result, axis)
    for variable in variables:
        if variable.name == axis:
            continue
        values = np.moveaxis(variable.values, variable.dims.index(axis), -1)
        if step is not None and variable.name in exact:
            values = exact[variable.name](at, _OF_GAIT[variable.name])
            if variable.name == "length":
                values = ExportedGait.of(result).rounded(values)
        elif step is not None:
            values = _between(at, own, values)
        for place in np.ndindex(values.shape[:-1]):
            name = "_".join([variable.name, *map(str, place)])
            columns.append((name, variable.unit, values[place]))
    back = []
    if exact:
        cycle = next(iter(exact.values())).period
        if own[0] == 0 and own[-1] >= cycle * (1 - _SAME):  # a table of the whole gait
            back = [remark_of_gait(next(iter(exact)), cycle, result[axis].unit)]
    if step is None:
        return back, columns
    every = f"{step!r} {result[axis].unit}".removesuffix(" 1")
    remark = f"every {every}; interpolated linearly, whole numbers keep the last value"
    if exact:
        remark += f"; from the gait's formulas: {', '.join(exact)}"
        back = [*ExportedGait.of(result).rounding, *back]
    return [remark, *back], columns


def _between(at: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    rows = values.reshape(-1, len(own))
    if values.dtype.kind == "f":
        found = np.array([np.interp(at, own, row) for row in rows])
    else:
        found = rows[:, np.clip(np.searchsorted(own, at, side="right") - 1, 0, None)]
    return found.reshape(*values.shape[:-1], len(at))


def _of_gait(result: Result, axis: str) -> dict[str, Gait]:
    """The gait, and the names of signals that are its lengths, rates and accelerations."""
    if "gait_polynomial" not in result:
        return {}
    gait, t = gait_of_result(result), result[axis].values

    def follows(name: str) -> bool:
        if name not in result or result[name].dims != ("link", axis):
            return False
        values = result[name].values
        if len(values) != gait.links:
            return False
        return bool(np.abs(values - gait(t)).max() <= _SAME * np.abs(values).max())

    found = [name for name in ("length", "reference") if follows(name)]
    if "length" in found:
        found += [n for n in ("rate", "acceleration") if n in result]
    return dict.fromkeys(found, gait)


def _long(result: Result, variables: Sequence[Variable]) -> Iterator[Column]:
    """One row for each entry: its coordinate, name or number, then the variables there."""
    dims, shape, labels = variables[0].dims, variables[0].values.shape, result.labels
    for place, dim, count in zip(np.indices(shape), dims, shape, strict=True):
        known = dim in result and result[dim].dims == (dim,)
        values = np.array(labels[dim])[place] if len(labels.get(dim, ())) == count else place
        values = result[dim].values[place] if known else values
        yield dim, result[dim].unit if known else "1", values.ravel()
    for variable in variables:
        if variable.name not in dims:
            yield variable.name, variable.unit, variable.values.ravel()
