"""The reader of tables in text files: recordings, gait tables and fields.

It reads output of spreadsheets, loggers and programs: separators `;`, tab, `,` or blanks, decimal
points or commas, UTF-8 or UTF-16, lines above the names, remarks, units in the names or below
them, gaps. It imports no numerics, so that `wormopt check` reads files, too.
"""

from __future__ import annotations

import codecs
import csv
import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wormopt.quantities import scale

SUFFIXES = (".csv", ".txt", ".tsv", ".dat")
"""Suffixes of text files with tables that may be read."""
_SPREADSHEET_ERRORS = tuple(
    "#n/a #na #nv #n/d #null! #div/0! #value! #wert! #ref! #bezug! #name? #num! #zahl!".split()
)
# Cells of missing readings; NumPy prints masked values as --.
_GAPS = frozenset(
    (
        *("", "-", "--", "na", "n/a", "<na>", "null", "none", *_SPREADSHEET_ERRORS),
        *("nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "1.#ind", "-1.#ind"),
    )
)
_SIZES = (("", ""), ("milli", "m"), ("micro", "u"), ("nano", "n"), ("centi", "c"), ("deci", "d"))
_MOST_BYTES = 500_000_000
# Most lines above the names; number of last lines that determine the separator.
_MOST_ABOVE, _LOOKED_AT = 100, 30
# Most lines of a cell in quotation marks.
_MOST_LINES_OF_CELL = 5
_SEPARATORS = (";", "\t", ",", " ")
# Sizes of unsigned numbers in bits, and the share of their range next to each end for numbers that
# were negative. Short ones may be readings, too, unless they are very near the ends.
_BITS = {16: 1 / 16, 32: 1 / 4, 64: 1 / 4}
# "position[1]" is an entry, "position [1]" a number without a unit
_BRACKETS = re.compile(
    r"(?P<name>.*?)(?:\s+\[(?P<one>1)\]|\s*\[(?P<square>(?!\d+\])[^\]]+)\]"
    r"|\s*\((?P<round>[^)]*)\))\s*"
)
_QUOTIENT = re.compile(r"(?P<name>\S.*?)(?:\s*/\s*|\s+in\s+)(?P<unit>[^/]+)")
_IN = re.compile(r"\s+in$|^in\s+", re.IGNORECASE)
# apparent units in names
_MEANT = {
    **{unit: unit for unit in "ns us µs μs ms s min um µm μm mm cm dm m".split()},
    **{f"{size}second{s}": f"{short}s" for s in ("", "s") for size, short in _SIZES},
    **{
        f"{size}met{er}{s}": f"{short}m"
        for er in ("re", "er")
        for s in ("", "s")
        for size, short in _SIZES
    },
}
_BLANKS = re.compile(
    r'"[^"]*"|[^\s"\[(]+(?:[ \t]*\[[^\]]*\]|[ \t]*\([^)]*\))*|\[[^\]]*\]|\([^)]*\)'
)
_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
_SEPARATED = re.compile(r"[+-]?\d{1,3}(?:[., '’_\u2009\u202f]\d{3})+(?:[.,]\d*)?")
_CLOCK = re.compile(r"(\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{2,4})?[T ]*(\d\d?:\d\d.*)?")

Wrong = tuple[str, str]
"""Column with a fault, "" for the whole table, and the fault, with its line."""
Row = tuple[int, list[str]]
"""Number of a line, and its cells."""


@dataclass(frozen=True)
class TextTable:
    """Columns of numbers by name, NaN for gaps, as a file has them."""

    values: dict[str, Sequence[float]]  # columns, in the order of the file
    units: dict[str, str]  # units of the columns that have one
    texts: frozenset[str]  # columns without a number; all their values are NaN
    remarks: tuple[str, ...]  # lines that begin with # or %, without it
    head: int  # number of the line of names, 0 if there is none
    lines: tuple[int, ...]  # number of the line of each row
    # columns whose negative numbers the file has as unsigned ones, and the bits of these
    wrapped: dict[str, int]


def read_table(
    path: Path, wrong: list[Wrong], *, time: str = "", named: bool = True
) -> TextTable | None:
    """Read a table from a file; parameters and value are those of `parse_table`."""
    if path.stat().st_size > _MOST_BYTES:
        wrong.append(("", " is larger than 500 MB; keep fewer samples, for example 100 per period"))
        return None
    text = _decoded(path.read_bytes())
    if text is None:
        wrong.append(("", " is not text; save it as CSV text in UTF-8"))
        return None
    return parse_table(text, wrong, time=time, named=named)


def parse_table(
    text: str, wrong: list[Wrong], *, time: str = "", named: bool = True
) -> TextTable | None:
    """Read a table; faults are added to `wrong`, and None is returned if nothing can be read.

    A fault is the column, "" for the whole table, and what is wrong, to be written behind the name
    of the file. The line of names has the column `time`; without that it is the last one above the
    numbers. If it need not be there (`named`), columns are called "1", "2" and so on.
    """
    lines, remarks = _split(text)
    empty = " is empty; write a header with the names of its columns, then the numbers"
    if not lines:
        wrong.append(("", empty))
        return None
    try:
        separator = _separator(lines)
        first, separator = _line_of_names(lines, separator, time)
        rows = [(n, _cells(line, separator)) for n, line in lines[max(first, 0) :]]
    except csv.Error as error:
        wrong.append(("", f" is not CSV text ({error}); save it as CSV text in UTF-8"))
        return None
    rows = [row for row in rows if any(row[1])]
    if not rows:
        wrong.append(("", empty))
        return None
    head: Row | None = rows.pop(0) if first >= 0 else None
    head, below = _names_and_units(head, remarks, rows, time)
    if head is None and named:
        example = f"{time},position[0],position[1]" if time else "t,l_0,l_1"
        what = f" line {rows[0][0]}: names of columns are missing; write a header {example}"
        wrong.append(("", what))
        return None
    at, heads = head or (0, [str(k + 1) for k in range(len(rows[0][1]))])
    # a separator at the end of every line makes no column
    while not heads[-1] and not any(any(cells[len(heads) - 1 :]) for _, cells in rows):
        heads = heads[:-1]
    rows = [(n, cells if any(cells[len(heads) :]) else cells[: len(heads)]) for n, cells in rows]
    names, units = _names((at, heads), wrong)
    if wrong:
        return None
    if not units and below:
        units = _units(below[: len(names)], names)
    elif not units and rows and (found := _units(rows[0][1], names)):
        units, rows = found, rows[1:]
    rows = [row for row in rows if _fits(row, names, wrong)]
    comma = _has_decimal_commas(rows, names, wrong)
    values: dict[str, Sequence[float]] = {}
    texts, wrapped = set[str](), dict[str, int]()
    for k, name in enumerate(names):
        cells = [(n, row[k]) for n, row in rows]
        numbers = [_number(cell, comma) for _, cell in cells]
        written = [cell for (_, cell), v in zip(cells, numbers, strict=True) if v is None]
        words = written and not any(v is not None and v == v for v in numbers) and name != time
        if words and not all(map(_SEPARATED.fullmatch, written)):
            texts.add(name)
        else:
            for (n, cell), number in zip(cells, numbers, strict=True):
                if number is None:
                    wrong.append((name, f" line {n}, column {name}: {_why_none(cell)}"))
                elif math.isinf(number):
                    what = "is infinite; leave the cell empty if there is no number"
                    wrong.append((name, f" line {n}, column {name}: {cell} {what}"))
        values[name] = tuple(math.nan if v is None or name in texts else v for v in numbers)
        if name != time and (bits := _bits_of_wrapped(values[name])):
            wrapped[name] = bits
            values[name] = _signed(values[name], [cell for _, cell in cells], bits)
    wrong.sort(key=_line_of)
    kept, at_lines = tuple(text for _, text in remarks), tuple(n for n, _ in rows)
    return TextTable(values, units, frozenset(texts), kept, at, at_lines, wrapped)


def unit_meant(name: str) -> tuple[str, str]:
    """Name and apparent unit without brackets: ``t_ms``, ``t {ms}``."""
    for form in (r"[\[({<]\s*([^\W\d_]+)\s*[\])}>]", r"([^\W\d_]+)\W*$"):
        found = re.search(form, name)
        if found is None:
            continue
        word, before = found[1], name[: found.start(1)]
        unit = _MEANT.get(word, _MEANT.get(word.lower(), "") if len(word) > 1 else "")
        bare = _IN.sub("", re.sub(r"[\W_]+$", "", before))
        # one letter alone is a name, and one behind a digit is part of it
        if unit and (len(word) > 1 or (bare and not before[-1].isalnum())):
            return bare, unit
    return name, ""


# -- text and lines --------------------------------------------------------------------------------


def _decoded(content: bytes) -> str | None:
    """Text of a file, in UTF-8, UTF-16, UTF-32 or Windows-1252; None if it is none."""
    for mark, encoding in (
        (codecs.BOM_UTF32_LE, "utf-32"),  # begins like UTF-16
        (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if content.startswith(mark):
            return _as(content, encoding)
    if b"\0" in content:  # UTF-16 without a mark: every other byte of ASCII letters is 0
        return _as(content, "utf-16-le" if b"\0" in content[1::2] else "utf-16-be")
    found = _as(content, "utf-8")
    return _as(content, "cp1252") if found is None else found


def _as(content: bytes, encoding: str) -> str | None:
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        return None
    return None if re.search("[\0-\x08\x0e-\x1b]", text) else text


def _split(text: str) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """Lines of the table, and remarks, each with its number."""
    lines: list[tuple[int, str]] = []
    remarks: list[tuple[int, str]] = []
    text = text.replace("\u2212", "-")  # the minus sign of typesetters
    whole = [*enumerate(re.split(r"\r\n|\r|\n", text), 1)][::-1]
    while whole:
        number, line = whole.pop()
        bare = line.strip(" \ufeff\xa0")
        # "#N/A" at the start of a line is a gap in the first column
        if bare[:1] in ("#", "%") and not bare.lower().startswith(_SPREADSHEET_ERRORS):
            remarks.append((number, bare.lstrip("#% \t")))
            continue
        if line.count('"') % 2:  # a name in quotation marks that continues in the next lines
            more = [text for _, text in whole[: -_MOST_LINES_OF_CELL - 1 : -1]]
            ends = [k for k, text in enumerate(more, 1) if text.count('"') % 2]
            if ends:
                line = " ".join([line, *more[: ends[0]]])
                del whole[-ends[0] :]
        if bare:
            lines.append((number, line))
    return lines, remarks


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        found = [cell.strip('"') for cell in _BLANKS.findall(line)]
    elif separator:
        found = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    else:
        found = [line.strip().strip('"')]
    return [" ".join(cell.split()) if " " in cell or "\xa0" in cell else cell for cell in found]


def _separator(lines: list[tuple[int, str]]) -> str:
    """Separator of the cells of the last lines, "" if they have only one cell."""

    def share(separator: str) -> float:
        rows = [_cells(line, separator) for _, line in lines[-_LOOKED_AT:]]
        if separator != " " and not any(row[-1] for row in rows):  # every line ends with it
            rows = [row[:-1] for row in rows]
        width = Counter(map(len, rows)).most_common(1)[0][0]
        if width < 2:
            return 0.0
        good = sum(_filled(row) for row in rows if len(row) == width)
        return good / (width * len(rows))

    shares = {separator: share(separator) for separator in _SEPARATORS}
    best = max(shares, key=shares.__getitem__)  # the first of equally good ones
    return best if shares[best] else ""


def _line_of_names(lines: list[tuple[int, str]], separator: str, time: str) -> tuple[int, str]:
    """Index of the line that names the columns, and its separator."""
    for each in (separator, *_SEPARATORS) if time else ():
        for k, (_, line) in enumerate(lines[:_MOST_ABOVE]):
            cells = _cells(line, each)
            if len(cells) > 1 and time in (name_and_unit(cell)[0] for cell in cells):
                return k, each
    rows = [_cells(line, separator) for _, line in lines[:_MOST_ABOVE]]
    tail = [_cells(line, separator) for _, line in lines[-_LOOKED_AT:]]
    # cells of a usual row, and how many of them are numbers or empty
    width, usual = Counter((len(row), _filled(row)) for row in tail).most_common(1)[0][0]
    numbers = (k for k, row in enumerate(rows) if len(row) == width and _filled(row) >= usual)
    above = rows[: next(numbers, len(rows)) if usual else 1]
    words = [k for k, row in enumerate(above) if not _is_number(row[0])]
    wide = [k for k in words if len(rows[k]) == width] or words[-1:]
    if len(wide) > 1 and _units(rows[wide[-1]], rows[wide[-2]]):
        wide.pop()
    return (wide[-1] if wide else -1), separator


def _filled(row: list[str]) -> int:
    return sum(not cell or _is_number(cell) for cell in row)


def _names_and_units(
    head: Row | None, remarks: list[tuple[int, str]], rows: list[Row], time: str
) -> tuple[Row | None, list[str]]:
    """Names of the columns, and cells of a line that contains only their units, [] without one."""
    # `head` is the line of words above the numbers. A remark may contain the names, as written by
    # NumPy, if `head` is only a title or units; or the units of the names in `head`.
    found = [] if not rows else _remarks_of_cells(remarks, rows[0])
    names = [row for row in found if not _all_units(row[1]) and (not time or _has(row[1], time))]
    head = head or next(iter(names), None)
    if head is None:
        return None, []
    cells = head[1]
    if above := [row for row in names if row[0] < head[0]] if _all_units(cells) else []:
        return above[0], cells
    title = len(cells) < len(rows[0][1]) or (time and not _has(cells, time)) if rows else False
    for row in names:
        if row[0] > head[0] and (
            title or (any(map(_is_unit, _units_of(row[1]))) and not _units_of(cells))
        ):
            return row, []
    below = [row[1] for row in found if row[0] > head[0] and _all_units(row[1])]
    return head, below[0] if below and len(below[0]) == len(cells) else []


def _remarks_of_cells(remarks: list[tuple[int, str]], row: Row) -> list[Row]:
    """Remarks above a row that have a word for each of its cells, the last one first."""
    found = []
    for number, text in reversed(remarks):
        each = (_cells(text, separator) for separator in _SEPARATORS)
        fits = (c for c in each if len(c) == len(row[1]) and not any(map(_is_number, c)))
        if number < row[0] and (cells := next(fits, None)):
            found.append((number, cells))
    return found


def _all_units(cells: list[str]) -> bool:
    return bool(_units(cells, cells))


def _units_of(cells: list[str]) -> list[str]:
    """Units after the names, or their replacement."""
    return [unit for cell in cells if (unit := name_and_unit(cell)[1])]


def _has(cells: list[str], name: str) -> bool:
    return name in (name_and_unit(cell)[0] for cell in cells)


# -- names and units -------------------------------------------------------------------------------


def name_and_unit(cell: str) -> tuple[str, str]:
    """Name and unit, "" if there is none, of ``x [mm]``, ``x (mm)``, ``x / mm`` or ``x in mm``."""
    found = _BRACKETS.fullmatch(cell)
    if found is not None:
        unit = (found["one"] or found["square"] or found["round"] or "").strip()
        name = found["name"].strip("\"' ")
        return (_IN.sub("", name), _IN.sub("", unit)) if unit else (name, "")
    found = _QUOTIENT.fullmatch(cell)
    if found is not None and _is_unit(found["unit"]):
        return found["name"], found["unit"]
    return cell, ""


def _names(head: Row, wrong: list[Wrong]) -> tuple[list[str], dict[str, str]]:
    number, cells = head
    names, units = [], {}
    for k, cell in enumerate(cells):
        name, unit = name_and_unit(cell)
        if unit:
            units[name] = unit
        if not name:
            wrong.append(("", f" line {number}: column {k + 1} has no name; write one"))
        elif name in names:
            what = f" line {number}: two columns are called {name}; rename one of them"
            wrong.append(("", what))
        names.append(name)
    return names, units


def _units(cells: list[str], names: list[str]) -> dict[str, str]:
    """Units in a line below the names, if it contains nothing else."""
    bare = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell).strip() for cell in cells]
    if len(bare) != len(names) or not all(_is_unit(unit) or unit in ("", "-") for unit in bare):
        return {}
    return {name: unit for name, unit in zip(names, bare, strict=True) if unit not in ("", "-")}


def _is_unit(text: str) -> bool:
    try:
        scale(text)
    except ValueError:
        return False
    return not _is_number(text)


# -- cells -----------------------------------------------------------------------------------------


def _fits(row: Row, names: list[str], wrong: list[Wrong]) -> bool:
    number, cells = row
    if len(cells) != len(names):
        what = f" line {number}: {len(cells)} cells for {len(names)} columns; write one per column"
        what += ", empty where nothing was measured"
        if re.search(r"\b[1-9]\d{0,2}(,\d{3})*,\d{3}(\.|,|$)", ",".join(cells)):
            what += ", and numbers without separators of thousands"
        wrong.append(("", what))
    return len(cells) == len(names)


def _has_decimal_commas(rows: list[Row], names: list[str], wrong: list[Wrong]) -> bool:
    """Whether numbers have decimal commas; a table with commas and points is refused."""

    def those(form: Callable[[str], object]) -> list[tuple[int, str, str]]:
        return [
            (number, name, cell)
            for number, cells in rows
            for name, cell in zip(names, cells, strict=True)
            if form(cell)
        ]

    commas = those(lambda cell: "," in cell and _COMMA.fullmatch(cell))
    points = commas and those(lambda c: "." in c and _number(c, comma=False) is not None)
    if commas and points:
        few, many = sorted((commas, points), key=len)
        (number, name, cell), (other, _, usual) = few[0], many[0]
        what = f'"{cell}" and, in line {other}, "{usual}" have different decimal signs; use one'
        wrong.append((name, f" line {number}, column {name}: {what} in all cells"))
    elif commas and all(_THOUSANDS.fullmatch(cell) for _, _, cell in commas):
        number, name, cell = commas[0]
        what = f'"{cell}" may be {cell.replace(",", "")} or {cell.replace(",", ".", 1)}; write one'
        wrong.append((name, f" line {number}, column {name}: {what} of these"))
    return bool(commas)


def _number(cell: str, comma: bool) -> float | None:
    """Value of a cell, NaN for a gap, None if it is no number."""
    if comma and _COMMA.fullmatch(cell):
        cell = cell.replace(",", ".")
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return math.nan if cell.lower() in _GAPS else None


def _bits_of_wrapped(numbers: Sequence[float]) -> int:
    """Bits of unsigned numbers in which a column has negative ones, 0 if it has none."""
    there = [v for v in numbers if v == v]
    if not there or min(there) < 0 or not all(v.is_integer() for v in there):
        return 0
    bits = next((bits for bits in _BITS if max(there) < 2.0**bits), 64)
    size = 2.0**bits
    below = [v >= size * (1 - _BITS[bits]) for v in there]
    small = (v < size * _BITS[bits] for v in there)
    return bits if any(below) and all(map(operator.or_, below, small)) and not all(below) else 0


def _signed(numbers: Sequence[float], cells: Sequence[str], bits: int) -> Sequence[float]:
    """Numbers below 0 where unsigned ones stand for them; cells keep digits that floats lose."""
    return tuple(
        float(int(cell if cell.isdecimal() else v) - 2**bits) if v > 2.0**bits / 2 else v
        for v, cell in zip(numbers, cells, strict=True)
    )


def _is_number(cell: str) -> bool:
    """Whether a cell is a number with a point or a comma, or the mark of a gap."""
    return bool(cell) and _number(cell, comma=True) is not None


def _why_none(cell: str) -> str:
    shown = cell if len(cell) <= 30 else cell[:27] + "..."
    if _SEPARATED.fullmatch(cell):
        groups = re.split(r"[^\d+-]", cell)
        rest = len(groups[-1]) != 3 or len(set(re.findall(r"[^\d+-]", cell))) > 1
        plain = "".join(groups[:-1]) + "." + groups[-1] if rest else "".join(groups)
        return f'"{shown}" has separators of thousands; write {plain}'
    if cell and _CLOCK.fullmatch(cell):
        return f'"{shown}" is a date or a time of day; write seconds from the start'
    return f'"{shown}" is not a number; write one, or leave the cell empty'


def _line_of(fault: Wrong) -> int:
    found = re.match(r" line (\d+)", fault[1])
    return int(found[1]) if found else 0
