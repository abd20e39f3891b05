"""``python -m tests.benchmarks``: run benchmarks, print tables, write the page and the history."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks import CASES, LADDERS
from tests.benchmarks.command import parser
from wormopt.__main__ import one_thread
from wormopt.cli.common import BAD_INPUT, DONE, INTERRUPTED, say
from wormopt.errors import ArgumentError, OutputError
from wormopt.progress import shown_on_stderr

_TEXT = """\
Run each case with several solvers at several tolerances and compare their times at
equal error. A case takes minutes; with --quick, all cases take a few minutes.
DIR/index.html shows all cases measured so far. DIR/history.json keeps the ratios of
times by version, and the command reports ratios that have become worse.

cases:"""
_COLUMNS = """\
columns of the table:
  first run      time of the first run, compilation included
  time at 1e-09  median time of later runs with errors of 1e-9, interpolated between
                 settings
  ours/theirs    wormopt's time over that of the solver: below 1 wormopt is faster
  best error     smallest error of all runs, and its time
  memory         largest growth of the process in the first run
Runs that failed, or reported success with a wrong answer, are listed below the table."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (by default of the process) and return the exit code."""
    one_thread()
    command = parser(
        "tests.benchmarks", CASES, _TEXT, _COLUMNS, "use fewer tolerances, repetitions and sizes"
    )
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        default="results/benchmarks",
        help="folder for index.html, with all pictures and tables, and for the history "
        "(default: %(default)s)",
    )
    command.add_argument(
        "--against",
        metavar="VERSION",
        default="",
        help="compare this version only with another version, in alternating runs: a version on "
        "PyPI, a commit of this checkout, another checkout or a wheel",
    )
    options = command.parse_args(arguments)
    try:
        return _against(options) if options.against else _bench(options)
    except (OutputError, ArgumentError) as error:
        say(str(error))
        return BAD_INPUT


def _bench(options: argparse.Namespace) -> int:
    from tests.benchmarks import history, page
    from tests.benchmarks.run import bench, machine, ratios, table

    folder, known, code = Path(options.output), {}, DONE
    about, measured = machine(), {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        history.read(folder / page.HISTORY)  # before anything takes time
        for name in options.names or CASES:
            with shown_on_stderr(options.quiet) as report:
                for found in bench(name, quick=options.quick, folder=folder, report=report):
                    known[name] = found
            measured[name] = ratios(known[name])
            page.keep(folder, known[name], about)
            if not options.json:
                print(table(known[name]), end="\n\n", flush=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except KeyboardInterrupt:
        code = INTERRUPTED
        unfinished = [found for found in known.values() if not found["done"]]
        if not options.json:
            print("\n\n".join(map(table, unfinished)))
    if options.json:
        print(json.dumps({"machine": about, "quick": options.quick, "cases": known}))
    if measured:
        new = history.entry(about, options.quick, measured)
        for line in history.append(folder / page.HISTORY, new):
            (say if options.json else print)(line)
        written = page.write(folder, history.read(folder / page.HISTORY))
        say(f"all pictures and tables: {written}")
    return code


def _against(options: argparse.Namespace) -> int:
    from tests.benchmarks.against import against, table
    from tests.benchmarks.run import machine

    unable = [name for name in options.names if name not in LADDERS]
    if unable:
        raise ArgumentError(
            f"{', '.join(unable)}: --against cannot run this case; write one of "
            f"{', '.join(LADDERS)}"
        )
    rows, code, chosen = [], DONE, options.names or list(LADDERS)
    try:
        with shown_on_stderr(options.quiet) as report:
            for rows in against(options.against, chosen, quick=options.quick, report=report):  # noqa: B007
                pass
    except KeyboardInterrupt:
        code = INTERRUPTED
    if options.json:
        print(json.dumps({"machine": machine(), "against": options.against, "rows": rows}))
    else:
        print(table(options.against, rows))
    return code


if __name__ == "__main__":
    sys.exit(main())
