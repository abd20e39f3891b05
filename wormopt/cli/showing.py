"""``wormopt show``: print saved results."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.cli.printing import print_all, print_result
from wormopt.errors import ArgumentError
from wormopt.files import RESULT_FILE
from wormopt.runner import result_at
from wormopt.shown import line


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "show",
        help="print saved results",
        description="Print saved results: their numbers, the active limits and the trust report.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_show)
    command.add_argument(
        "results",
        metavar="RESULT",
        nargs="+",
        help=f"folder of a result, its {RESULT_FILE}, or a folder whose results are listed",
    )
    command.add_argument(
        "--all", action="store_true", help="print all scalars, facts and checks, not the short form"
    )
    command.add_argument(
        "--json", action="store_true", help="print one JSON object per result, one on each line"
    )


def _show(options: argparse.Namespace) -> int:
    from wormopt.digest import headline

    code, shown = DONE, 0
    for name in [each for given in options.results for each in _in_folder(given)]:
        try:
            result = result_at(name)
        except ArgumentError as error:
            say(str(error))
            code = BAD_INPUT
            continue
        if options.json:
            print(json.dumps(result.summary(), allow_nan=False))
            continue
        if name not in options.results:
            print(line(f"{name}: {result.kind}, {result.status}; {headline(result)}"))
            continue
        if shown:
            print()
        (print_all if options.all else print_result)(result)
        shown += 1
    return code


def _in_folder(given: str) -> list[str]:
    """Return the results in a folder; a folder that is a result itself is returned alone."""
    path = Path(given)
    if not path.is_dir() or (path / RESULT_FILE).exists():
        return [given]
    return [str(file.parent) for file in sorted(path.glob(f"*/{RESULT_FILE}"))] or [given]
