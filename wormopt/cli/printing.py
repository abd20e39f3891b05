"""Results and tables as text on a terminal."""

from __future__ import annotations

import json
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wormopt.result import Check, Result


def print_result(result: Result, folder: Path) -> None:
    """Print scalars, trust report and checks, and where all of it is saved."""
    print(result.title)
    units = {name: s.unit for name, s in result.scalars.items() if s.unit != "1"}
    _print_values({name: s.value for name, s in result.scalars.items()}, units)
    if "table" in result.attributes:
        print(result.attributes["table"])
    facts = {name: value for name, value in result.trust.items() if name != "checks"}
    if facts:
        print("Trust:")
        _print_values(facts, {})
    if result.checks:
        print("Checks:")
        print_table([_line_of(check) for check in result.checks])
    print(f"Saved in {folder}")


def _line_of(check: Check) -> tuple[str, ...]:
    verdict = f"accepted up to {check.limit:.3g}" if check.passed else f"FAILED: {check.advice}"
    return check.name, "unknown" if check.value is None else f"{check.value:.3g}", verdict


def _print_values(values: Mapping[str, Any], units: Mapping[str, str]) -> None:
    width = shutil.get_terminal_size((100, 24)).columns
    width = max(width - 4 - max(map(len, values), default=0), 40)
    rows = []
    for name, value in values.items():
        first, *others = _lines(value, width)
        rows += [(name, first, units.get(name, "")), *(("", line, "") for line in others)]
    print_table(rows)


def _lines(value: Any, width: int) -> list[str]:
    """Write a value whole where it fits and is no list of texts, else entry by entry."""
    if isinstance(value, str):
        return textwrap.wrap(value, width, subsequent_indent="  ") or [""]
    whole = _text(value).strip("{}") or "none"
    if isinstance(value, list) and any(isinstance(item, str | dict) for item in value):
        return [line for item in value for line in _lines(item, width)]
    if len(whole) <= width:
        return [whole]
    if isinstance(value, dict):
        named = ((f"{key} ", _lines(item, width - len(key) - 1)) for key, item in value.items())
        return [line for name, lines in named for line in _hanging(name, lines)]
    if isinstance(value, list) and any(isinstance(item, list) for item in value):
        return [line for item in value for line in _lines(item, width)]
    return textwrap.wrap(whole, width, subsequent_indent=" ")


def _hanging(name: str, lines: Sequence[str]) -> list[str]:
    return [(" " * len(name) if k else name) + line for k, line in enumerate(lines)]


def _text(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} {_text(item)}' for key, item in value.items())}}}"
    return value if isinstance(value, str) else json.dumps(value)


def print_table(rows: Sequence[tuple[str, ...]]) -> None:
    """Print rows of texts in columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  " + "  ".join(cells).rstrip())
