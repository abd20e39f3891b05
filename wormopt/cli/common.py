"""Common parts of commands: exit codes, messages, options, tables on a terminal."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from wormopt.errors import ArgumentError
from wormopt.kinds import KINDS, near
from wormopt.shown import line, one_line, text

if TYPE_CHECKING:
    from wormopt.result import Check, Result

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def say(text: str) -> None:
    """Print a message that is not a result, on stderr."""
    print(text, file=sys.stderr)


def check_backend(hint: str = "") -> None:
    """Raise ArgumentError if Matplotlib refuses the backend that MPLBACKEND names.

    `hint` is another way out, for the message. Without MPLBACKEND nothing is loaded.
    """
    if os.environ.get("MPLBACKEND"):
        try:
            import matplotlib  # noqa: F401
        except (ValueError, ImportError) as error:
            raise ArgumentError(no_backend(error, hint)) from None


def no_backend(error: Exception, hint: str = "") -> str:
    """Write the message for a backend that Matplotlib refuses; "" for any other error."""
    name = os.environ.get("MPLBACKEND", "")
    if not name or "backend" not in str(error):
        return ""
    return (
        f"MPLBACKEND={name}: Matplotlib has no such backend, or it is not installed; write "
        f"MPLBACKEND=agg, or unset it{hint}"
    )


def kind_name(name: str) -> str:
    """Return a kind of scene from the command line; the error suggests a similar name."""
    if name in KINDS:
        return name
    close = near(name)
    hint = f"did you mean {close}? " if close else ""
    what = f"there is no kind of scene {name!r}; {hint}`wormopt list` shows all kinds"
    raise argparse.ArgumentTypeError(what)


def _some(text: str) -> int:
    """Return a positive whole number from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a positive whole number, such as 4")
    return int(text)


def add_changes(command: argparse.ArgumentParser) -> None:
    """Add the option for keys that differ from the scene."""
    command.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change a key of the scene, such as worm.load=12; may be repeated",
    )


def add_engine(command: argparse.ArgumentParser) -> None:
    """Add the options for parallel work."""
    engines = ("processes", "serial", "dask")
    command.add_argument(
        "--engine",
        choices=engines,
        default="processes",
        help="where parallel work runs: processes of this machine, this process alone, or a "
        "Dask cluster (default: %(default)s)",
    )
    command.add_argument(
        "--workers",
        metavar="N",
        type=_some,
        help="number of parallel workers (default: one per processor)",
    )
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        default="",
        help="address of a running Dask cluster, for --engine dask (default: start one)",
    )


def engine_of(options: argparse.Namespace) -> AbstractContextManager[None]:
    """Return a context in which parallel work runs on the engine asked for."""
    if options.engine == "processes" and options.workers is None:
        return nullcontext()  # the default needs no import
    from wormopt.numerics.workers import Engine, using

    return using(Engine(options.engine, options.workers, options.scheduler))


_SHORT_TABLE = 25  # lines


def print_result(result: Result) -> None:
    """Print the short form of a result: scalars by group, limits and the trust report."""
    from wormopt.digest import groups, trust

    print(line(result.title or result.scene))
    for heading, rows in groups(result):
        if rows:
            if heading:
                print(f"{heading}:")
            print_table([tuple(map(one_line, row)) for row in rows])
    table = result.attributes.get("table", "")
    if 0 < table.count("\n") < _SHORT_TABLE:
        print(table)
    print("Trust:")
    width = max(_columns() - 2, 40)
    for reason in trust(result):
        print(textwrap.indent(textwrap.fill(one_line(reason), width, subsequent_indent="  "), "  "))


def print_all(result: Result) -> None:
    """Print the whole result: all scalars, the trust report and its checks."""
    print(result.title or result.scene)
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


def _line_of(check: Check) -> tuple[str, ...]:
    verdict = f"accepted up to {check.limit:.3g}" if check.passed else f"FAILED: {check.advice}"
    return check.name, "unknown" if check.value is None else f"{check.value:.3g}", verdict


def _columns() -> int:
    return shutil.get_terminal_size((100, 24)).columns


def _print_values(values: Mapping[str, Any], units: Mapping[str, str]) -> None:
    width = max(_columns() - 4 - max(map(len, values), default=0), 40)
    rows = []
    for name, value in values.items():
        first, *others = _lines(value, width)
        rows += [(name, first, units.get(name, "")), *(("", part, "") for part in others)]
    print_table(rows)


def _lines(value: Any, width: int) -> list[str]:
    """Write a value on one line if it fits, otherwise and for lists of texts by entries."""
    if isinstance(value, str):
        return textwrap.wrap(value, width, subsequent_indent="  ") or [""]
    whole = text(value).strip("{}") or "none"
    if isinstance(value, list) and any(isinstance(item, str | dict) for item in value):
        return [part for item in value for part in _lines(item, width)]
    if len(whole) <= width:
        return [whole]
    if isinstance(value, dict):
        named = ((f"{key} ", _lines(item, width - len(key) - 1)) for key, item in value.items())
        return [part for name, lines in named for part in _hanging(name, lines)]
    if isinstance(value, list) and any(isinstance(item, list) for item in value):
        return [part for item in value for part in _lines(item, width)]
    return textwrap.wrap(whole, width, subsequent_indent=" ")


def _hanging(name: str, lines: Sequence[str]) -> list[str]:
    return [(" " * len(name) if k else name) + part for k, part in enumerate(lines)]


def print_table(rows: Sequence[tuple[str, ...]]) -> None:
    """Print rows of texts in columns."""
    widths = [max(map(len, column), default=0) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  " + "  ".join(cells).rstrip())
