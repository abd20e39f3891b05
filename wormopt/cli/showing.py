"""``wormopt show``: what saved results say."""

from __future__ import annotations

import argparse
import json
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.cli.printing import print_all, print_result
from wormopt.errors import ArgumentError
from wormopt.files import RESULT_FILE
from wormopt.runner import result_at


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "show",
        help="print what saved results say",
        description="Print the numbers of saved results, what limits them, and how far to trust "
        "them.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_show)
    command.add_argument(
        "results", metavar="RESULT", nargs="+", help=f"a folder of results, or the {RESULT_FILE}"
    )
    command.add_argument("--all", action="store_true", help="all scalars, facts and checks")
    command.add_argument(
        "--json", action="store_true", help="print one JSON object per result and line on stdout"
    )


def _show(options: argparse.Namespace) -> int:
    code, shown = DONE, 0
    for name in options.results:
        try:
            result = result_at(name)
        except ArgumentError as error:
            say(str(error))
            code = BAD_INPUT
            continue
        if options.json:
            print(json.dumps(result.summary(), allow_nan=False))
            continue
        if shown:
            print()
        (print_all if options.all else print_result)(result)
        shown += 1
    return code
