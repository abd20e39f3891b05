"""Values as text, short or complete, and tables in HTML for notebooks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, Context, Decimal
from html import escape
from typing import Any, NamedTuple

WHOLE, SHORT = 12, 6
"""Significant digits."""
# Characters of a line of a repr, and of a value in a short list.
_LINE, _VALUE = 100, 60
# Colours are those of the page, so that dark ones stay dark.
_RULE = "border-bottom:1px solid rgba(128,128,128,0.4)"
_CELL = "text-align:left;padding:0.1em 1.2em 0.1em 0"


def text(value: Any, digits: int = WHOLE) -> str:
    """Write a value of a Result completely."""
    if value is None:
        return "unknown"
    if isinstance(value, float):
        return f"{value + 0.0:.{digits}g}"  # no -0
    if isinstance(value, list | tuple):
        words = [text(item, digits) for item in value]
        if any(isinstance(item, str) and "," in item for item in value):
            words = [json.dumps(word, ensure_ascii=False) for word in words]
        return f"[{', '.join(words)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} {text(item, digits)}' for key, item in value.items())}}}"
    return value if isinstance(value, str) else json.dumps(value)


def enough(value: float, digits: int, slack: float = 1e-9) -> float:
    """Round up to this many digits, ignoring a negligible excess."""
    return float(
        Context(prec=digits, rounding=ROUND_CEILING).plus(Decimal(value - slack * abs(value)))
    )


def brief(value: Any, width: int = _VALUE) -> str:
    """Write a value with few digits; of a long list its first entries, and its length."""
    whole = text(value, SHORT)
    if not isinstance(value, list) or len(whole) <= width:
        return line(whole, width) if value != [] else "none"
    rows = [row for row in value if isinstance(row, list)]
    counted = all(isinstance(item, int) for row in rows for item in row)  # masses at rest, say
    if not counted and len(rows) == len(value) and len({len(row) for row in rows}) == 1:
        known = [item for row in rows for item in row if isinstance(item, int | float)]
        ends = dict.fromkeys(text(end, SHORT) for end in (min(known), max(known))) if known else ()
        return f"{len(rows)} × {len(rows[0])} entries, {' to '.join(ends)}".rstrip(", ")
    end = "], " if rows else ", "
    kept, at, _ = whole[: width - 15].rpartition(end)
    return f"{kept}{at or '['}…], {len(value)} in all"


def whole_lists(names: Iterable[str], all_names: Iterable[str]) -> list[str]:
    """Name a list once of which all entries are among the names, `worm.load` for `worm.load[0]`."""

    def whole(name: str) -> str:
        return re.sub(r"\[\d+\]", "", name)

    names = list(names)
    partly = {whole(name) for name in {*all_names} - {*names}}
    return [*dict.fromkeys(name if whole(name) in partly else whole(name) for name in names)]


def one_line(words: str) -> str:
    """Write on one line of printable letters."""
    return " ".join("".join(c if c.isprintable() else " " for c in words).split())


def line(words: str, width: int = _LINE) -> str:
    """Write on one line, cut if it is too long."""
    words = one_line(words)
    return words if len(words) <= width else f"{words[: width - 1]}…"


def lines(*each: str) -> str:
    """Write a repr of several lines."""
    return "\n".join(map(line, filter(None, each)))


def listed(signals: Iterable[Any]) -> str:
    """Names of signals, with sizes other than 1."""
    return ", ".join(s.name if s.size == 1 else f"{s.name}[{s.size}]" for s in signals)


class Part(NamedTuple):
    """Rows of a table under a heading."""

    heading: str
    rows: Sequence[Sequence[str]]


def html(title: str, parts: Iterable[Part], notes: Iterable[str] = ()) -> str:
    """Make a table in HTML; all texts are escaped."""
    parts = [part for part in parts if part.rows]
    width = max((len(row) for part in parts for row in part.rows), default=1)
    rows = [f'<table style="border-collapse:collapse"><caption style="{_CELL};caption-side:top">'
            f"<b>{escape(title)}</b></caption>"]  # fmt: skip
    for heading, body in parts:
        if heading:
            head = f'<th colspan="{width}" style="{_CELL}">{escape(heading)}</th>'
            rows.append(f'<tr style="{_RULE}">{head}</tr>')
        for row in body:
            cells = "".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in row)
            rows.append(f"<tr>{cells}</tr>")
    rows += [
        f'<tr><td colspan="{width}" style="{_CELL}"><i>{escape(note)}</i></td></tr>'
        for note in notes
    ]
    return "\n".join([*rows, "</table>"])
