"""``wormopt report``: write results as one HTML page."""

from __future__ import annotations

import argparse
from typing import Any

from wormopt.cli.codes import DONE, check_backend


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "report",
        help="write saved results as one HTML page",
        description="Write saved results as one HTML page: numbers, pictures, animation, checks, "
        "warnings, and the scene to run again. The page is self-contained.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_report)
    command.add_argument(
        "results", metavar="RESULT", nargs="+", help="folder of a result, or its .nc file"
    )
    command.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default="report.html",
        help="file to write (default: %(default)s)",
    )
    command.add_argument("--title", metavar="TEXT", default="", help="title of the page")
    command.add_argument("--force", action="store_true", help="replace an earlier report")


def _report(options: argparse.Namespace) -> int:
    check_backend()
    from wormopt.reports.report import report

    report(options.results, options.output, title=options.title, force=options.force)
    print(f"Saved in {options.output}")
    return DONE
