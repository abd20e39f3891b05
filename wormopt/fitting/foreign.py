"""Readings of pandas and xarray as plain arrays: entries of signals, units, orders of axes.

Neither package is imported: objects are recognised by their attributes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers
from wormopt.tables import name_and_unit
from wormopt.units import scale

_ENTRY = re.compile(r"(?P<name>.+?)(?:\[(?P<index>\d+)\]|_(?P<count>\d+))")


def instants(run: str, given: Any) -> np.ndarray:
    """Times in s: dates count from the first one, units of xarray are converted."""
    array = np.asarray(getattr(given, "values", given))
    if array.dtype.kind == "M":
        if not array.size or np.isnat(array).any():
            raise ArgumentError(f"{run}: a time is missing; remove its readings")
        return (array - array.flat[0]) / np.timedelta64(1, "s")
    found = numbers(f"{run}: time", given)
    return np.atleast_1d(found if array.dtype.kind == "m" else found * _factor(run, "time", given))


def signals(run: str, given: Any, time: Any) -> Mapping[str, Any]:
    """Readings by signal: columns of a pandas table, arrays of an xarray Dataset or a mapping.

    Columns ``position_0`` and ``position[1]`` of a table are entries of one signal.
    """
    if hasattr(given, "columns") and hasattr(given, "items"):
        return _of_table(run, given)
    if not isinstance(given, Mapping) or not given:
        raise ArgumentError(
            f'{run}: write readings by name, {{"position": [...]}}, not {type(given).__name__}'
        )
    along = getattr(time, "dims", ())
    return {name: _plain(run, str(name), each, along) for name, each in given.items()}


def _plain(run: str, name: str, given: Any, along: tuple[str, ...]) -> Any:
    dims = getattr(given, "dims", ())
    factor = _factor(run, name, given)
    if len(dims) == 2 and len(along) == 1 and dims[0] == along[0]:  # of xarray, time first
        given = given.transpose()
    return given if factor == 1.0 else factor * numbers(f"{run}: {name}", given)


def _of_table(run: str, table: Any) -> dict[str, Any]:
    """Readings by signal of the columns of a pandas table."""
    known = dict(getattr(table, "attrs", {})).get("units", {})
    columns: dict[str, np.ndarray] = {}
    for head, column in table.items():
        name, unit = name_and_unit(str(head))
        unit = unit or (known.get(str(head), "") if isinstance(known, Mapping) else "")
        columns[name] = _size(run, name, unit) * numbers(f"{run}: {name}", column)
    entries: dict[str, dict[int, str]] = {}
    for name in columns:
        found = _ENTRY.fullmatch(name)
        if found:
            entries.setdefault(found["name"], {})[int(found["index"] or found["count"])] = name
    joined = {
        name: rows
        for name, rows in entries.items()
        if sorted(rows) == [*range(len(rows))] and name not in columns
    }
    parts = {part for rows in joined.values() for part in rows.values()}
    return {
        **{name: column for name, column in columns.items() if name not in parts},
        **{
            name: np.array([columns[rows[k]] for k in sorted(rows)])
            for name, rows in joined.items()
        },
    }


def _factor(run: str, name: str, given: Any) -> float:
    """Factor that converts an array of xarray to SI units."""
    attributes = getattr(given, "attrs", None)
    unit = attributes.get("units", "") if isinstance(attributes, Mapping) else ""
    return _size(run, name, unit if isinstance(unit, str) else "")


def _size(run: str, name: str, unit: str) -> float:
    if not unit:
        return 1.0
    try:
        return float(scale(unit)[0])
    except ValueError as error:
        raise ArgumentError(
            f'{run}: units of {name}: "{unit}" {error}; write "mm", "m s-1" or the like, or "1"'
        ) from None
