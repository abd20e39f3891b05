"""Columns of measured signals over time from text files, checked by line and column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from wormopt.errors import Fault
from wormopt.tables import Wrong, read_table

# Faults of one file that are reported.
_REPORTED = 5


@dataclass(frozen=True)
class Columns:
    """Readings (NaN if missing) by column, over ascending times."""

    time: Sequence[float]
    values: dict[str, Sequence[float]]
    units: dict[str, str] = field(default_factory=dict)  # of columns that have one, of time as ""
    texts: frozenset[str] = frozenset()  # columns of text, whose values are all NaN


def read_columns(path: Path, time: str, faults: list[Fault], key: str) -> Columns | None:
    """Read a text file; returns None after a fault, and adds every fault to `faults` at `key`.

    `time` is the name of the time column.
    """
    wrong: list[Wrong] = []
    try:
        found = _read(path, time, wrong)
    except OSError as error:
        faults.append((key, f"{path.name} cannot be read: {error.strerror}"))
        return None
    faults += ((key, f"{path.name}{what}") for _, what in wrong[:_REPORTED])
    if len(wrong) > _REPORTED:
        faults.append((key, f"{path.name}: and {len(wrong) - _REPORTED} more such faults"))
    return None if wrong else found


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
