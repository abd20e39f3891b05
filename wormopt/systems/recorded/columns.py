"""Tables of measured signals: columns by name over time, with units, out of CSV files.

Read without numerics, so that `wormopt check` tells what is wrong in a file, by line and column.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from wormopt.errors import Fault

_UNIT = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>(?!\d+\])[^\]]+)\]|\((?P<round>[^)]*)\))\s*")
# Faults of one file that are told; cells that stand for a reading that is not there.
_TOLD, _GAPS = 5, frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_MOST_BYTES = 500_000_000
# Semicolons and tabs first: a comma may be a decimal one. Lines that may stand above the names.
_DELIMITERS, _MOST_ABOVE = ";\t,", 100


@dataclass(frozen=True)
class Columns:
    """Readings (NaN where there is none) by column, over times that ascend."""

    time: Sequence[float]
    values: dict[str, Sequence[float]]
    units: dict[str, str] = field(default_factory=dict)  # of columns that tell one, of time as ""
    texts: frozenset[str] = frozenset()  # columns of words, whose values are all NaN


def read_csv(path: Path, time: str, faults: list[Fault], key: str) -> Columns | None:
    """Read a CSV file; every fault is added to `faults` under `key`, and gives None.

    `time` is the name of the column of times. The line that holds it names the columns, with units
    in brackets: ``x0 [mm]``; what stands above is skipped, and lines that begin with # are. Empty
    cells and NaN are gaps.
    """
    wrong: list[str] = []
    found = _read(path, time, wrong)
    faults += ((key, f"{path.name}{what}") for what in wrong[:_TOLD])
    if len(wrong) > _TOLD:
        faults.append((key, f"{path.name}: and {len(wrong) - _TOLD} more such faults"))
    return None if wrong else found


def _read(path: Path, time: str, wrong: list[str]) -> Columns | None:
    try:
        if path.stat().st_size > _MOST_BYTES:
            wrong.append(" is larger than 500 MB; keep fewer samples, a hundred per period say")
            return None
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        wrong.append(f" cannot be read: {error.strerror}")
        return None
    except UnicodeDecodeError as error:
        wrong.append(f" is no UTF-8 text (byte {error.start}); save it as CSV in UTF-8")
        return None
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if _counts(line)]
    if not lines:
        wrong.append(" is empty; write a line with the names of its columns, then the readings")
        return None
    first, delimiter = _line_of_names(lines, time)
    rows = [(n, _cells(line, delimiter)) for n, line in lines[first:]]
    names, units = _header(rows[0], time, wrong)
    if not wrong and len(rows) < 3:
        count = "no" if len(rows) == 1 else "one"
        wrong.append(f" has {count} line of readings; at least two instants are needed")
    if wrong:
        return None
    texts = _texts(rows[1:], names, time)
    table = list(_numbers(rows[1:], names, texts, delimiter, wrong))
    if wrong:
        return None
    at = names.index(time)
    _check_times([n for n, _ in rows[1:]], [row[at] for row in table], time, wrong)
    values: dict[str, Sequence[float]] = dict(zip(names, zip(*table, strict=True), strict=True))
    units[""] = units.pop(time, "")
    return Columns(values.pop(time), values, units, texts)


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _cells(line: str, delimiter: str) -> list[str]:
    row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in row]


def _line_of_names(lines: list[tuple[int, str]], time: str) -> tuple[int, str]:
    """Index of the line that names the columns, below what a program has written about itself.

    And what stands between its cells. It is the line with the column of times; where none has it,
    the first one of as many cells as the last.
    """
    for k, (_, line) in enumerate(lines[:_MOST_ABOVE]):
        for delimiter in _DELIMITERS:
            cells = _cells(line, delimiter)
            if len(cells) > 1 and time in (_named(cell)[0] for cell in cells):
                return k, delimiter
    for delimiter in _DELIMITERS:
        counts = [len(_cells(line, delimiter)) for _, line in (*lines[:_MOST_ABOVE], lines[-1])]
        if counts[-1] > 1:
            return counts.index(counts[-1]), delimiter
    return 0, ","


def _named(cell: str) -> tuple[str, str]:
    """Name and unit, if any, of a column."""
    found = _UNIT.fullmatch(cell)
    if found is None:
        return cell, ""
    return found["name"].strip("\"' "), (found["square"] or found["round"] or "").strip()


def _texts(rows: list[tuple[int, list[str]]], names: list[str], time: str) -> frozenset[str]:
    """Columns without any number, remarks say; numbers with decimal commas are none of them."""
    found = set()
    for k, name in enumerate(names):
        cells = [row[k] for _, row in rows if len(row) == len(names)]
        values = [_number(cell.replace(",", ".", 1)) for cell in cells]
        if name != time and None in values and not any(v == v for v in values if v is not None):
            found.add(name)
    return frozenset(found)


def _header(
    row: tuple[int, list[str]], time: str, wrong: list[str]
) -> tuple[list[str], dict[str, str]]:
    number, cells = row
    if all(_number(cell) is not None for cell in cells):
        example = f"{time},position[0],position[1]"
        wrong.append(f" line {number}: names of columns are missing; write a first line {example}")
        return [], {}
    names, units = [], {}
    for k, cell in enumerate(cells):
        name, unit = _named(cell)
        if unit:
            units[name] = unit
        if not name:
            wrong.append(f" line {number}: column {k + 1} has no name; write one")
        elif name in names:
            wrong.append(f" line {number}: two columns are called {name}; rename one of them")
        names.append(name)
    if time not in names and not wrong:
        there = ", ".join(names)
        what = f' line {number}: there is no column {time}; write time = "..." with one of {there}'
        wrong.append(what)
    return names, units


def _numbers(
    rows: list[tuple[int, list[str]]],
    names: list[str],
    texts: frozenset[str],
    delimiter: str,
    wrong: list[str],
) -> Iterator[list[float]]:
    for number, cells in rows:
        if len(cells) != len(names):
            what = f" line {number}: {len(cells)} cells for {len(names)} columns; write one per"
            wrong.append(f"{what} column, empty where nothing was measured")
            continue
        row = []
        for name, cell in zip(names, cells, strict=True):
            value = math.nan if name in texts else _number(cell)
            if value is None:
                wrong.append(f" line {number}, column {name}: {_hint(cell, delimiter)}")
            elif math.isinf(value):
                what = "is infinite; leave the cell empty where nothing was measured"
                wrong.append(f" line {number}, column {name}: {cell} {what}")
            row.append(math.nan if value is None else value)
        yield row


def _number(cell: str) -> float | None:
    """Value of a cell, NaN for a gap, None where it is no number."""
    if cell.lower() in _GAPS:
        return math.nan
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None


def _hint(cell: str, delimiter: str) -> str:
    shown = cell if len(cell) <= 30 else cell[:27] + "..."
    if delimiter != "," and _number(cell.replace(",", ".", 1)) is not None:
        return f'"{shown}" has a decimal comma; write {cell.replace(",", ".", 1)}'
    return f'"{shown}" is no number; write one, or leave the cell empty'


def _check_times(lines: list[int], times: list[float], name: str, wrong: list[str]) -> None:
    for k, (line, t) in enumerate(zip(lines, times, strict=True)):
        if math.isnan(t):
            wrong.append(f" line {line}, column {name}: the time is missing; write it")
        elif k and t == times[k - 1]:
            wrong.append(f" line {line}: time {t:g} stands twice; keep one of these lines")
        elif k and t < times[k - 1]:
            what = f"time goes back from {times[k - 1]:g} to {t:g}; put lines in order of time"
            wrong.append(f" line {line}: {what}, or make runs of their own of them")
