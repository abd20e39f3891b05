"""``wormopt show``: what saved results say."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.cli.printing import print_all, print_result
from wormopt.errors import ArgumentError
from wormopt.files import RESULT_FILE

if TYPE_CHECKING:
    from wormopt.result import Result


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
            result = _load(Path(name))
        except ArgumentError as error:
            say(f"{name}: {error}")
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


def _load(path: Path) -> Result:
    """Read a result; ArgumentError with what to write instead where there is none."""
    from wormopt.result import Result

    try:
        why = _missing(path)
        if not why:
            return Result.load(path)
    except OSError as error:
        why = f"cannot be read: {error.strerror or error}"
    except ValueError:
        why = "is no result of wormopt, or a damaged one; name another, or run its scene again"
    raise ArgumentError(why)


def _missing(path: Path) -> str:
    """Why there can be no result; empty where there may be one."""
    if path.is_dir() and not (path / RESULT_FILE).exists():
        return f"holds no {RESULT_FILE}; name a folder that `wormopt run` wrote"
    if path.exists():
        return ""
    usual = Path("results") / path
    if (usual / RESULT_FILE).exists():
        return f"there is no such folder or file; did you mean {usual}?"
    return f"there is no such folder or file; name a folder of results, or its {RESULT_FILE}"
