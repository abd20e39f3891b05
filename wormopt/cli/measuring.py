"""``wormopt bench`` and ``stress``: time against error, and hard cases."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wormopt.bench import CASES
from wormopt.bench.stress import GROUPS
from wormopt.cli.codes import BAD_INPUT, DONE, INTERRUPTED, NOT_SOLVED, check_backend, say
from wormopt.errors import OutputError
from wormopt.progress import shown_on_stderr


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "bench",
        help="measure speed and precision beside others",
        description=_BENCH + "".join(f"\n  {name:17}{what}" for name, what in CASES.items()),
        epilog=_BENCH_COLUMNS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_bench)
    command.add_argument(
        "cases", metavar="CASE", nargs="*", help="in any letter case; all if left out"
    )
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        default="results/bench",
        help="for index.html with all pictures and tables, and the history (%(default)s)",
    )
    command.add_argument(
        "--against",
        metavar="VERSION",
        default="",
        help="run this version and another by turns instead, beside no others: a version on "
        "PyPI, a commit of this checkout, another checkout or a wheel",
    )
    _add_measuring(command, "fewer tolerances, rounds and lengths")

    command = commands.add_parser(
        "stress",
        help="compare hard cases of everything with a second route",
        description=_STRESS + "".join(f"\n  {name:14}{by}" for name, by in GROUPS.items()),
        epilog=_STRESS_COLUMNS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_stress)
    command.add_argument(
        "groups", metavar="GROUP", nargs="*", help="in any letter case; all if left out"
    )
    _add_measuring(command, "a few cells of each group only")


_BENCH = """\
Run each case with several solvers at several tolerances and compare the times they
need for the same error. A case takes minutes; with --quick, all of them take a few.
DIR/index.html shows all cases measured so far. DIR/history.json keeps ratios of
times by version; what has become slower beside others is told.

cases:"""
_BENCH_COLUMNS = """\
columns of the table:
  first run      time of the first run, compilation included
  time at 1e-09  median time of later runs with errors of 1e-9 in positions and
                 velocities, interpolated between tolerances
  ours/theirs    wormopt's time over that of the solver: below 1 wormopt is faster
  best error     smallest error of all runs
  memory         by how much the first run made the process grow at most
  failed         runs that failed, or ended with success on a wrong answer"""
_STRESS = """\
Put some 2,000 seeded questions to the package, many of them extreme, and compare each
answer with a second route that shares no code with it. All take about seven minutes on
two processors with little else to do; --quick asks a few of each group.

groups, and what judges them:"""
_STRESS_COLUMNS = """\
columns of the table, by kind of case:
  right      as near as any computation of that precision can be
  refused    given up with a reason that names what to change
  undecided  the second route fails, or nothing can be known
  wrong      none of these; exit code 3 if there is any, if an ordinary case is not
             right, or if fewer than nine tenths are right"""


def _add_measuring(command: argparse.ArgumentParser, quick: str) -> None:
    command.add_argument("--quick", action="store_true", help=quick)
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    command.add_argument("--quiet", action="store_true", help="show no progress")


def _bench(options: argparse.Namespace) -> int:
    cases = [name.lower() for name in options.cases]
    unknown = [name for name in cases if name not in CASES]
    if unknown:
        say(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(CASES)}")
        return BAD_INPUT
    if options.against:
        return _against(options, cases)
    check_backend()
    from wormopt.bench import history, page
    from wormopt.bench.run import bench, machine, ratios, table

    folder, known, code = Path(options.output), {}, DONE
    about, measured = machine(), {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        history.read(folder / page.HISTORY)  # before anything takes time
        for name in cases or CASES:
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


def _against(options: argparse.Namespace, cases: Sequence[str]) -> int:
    from wormopt.bench.against import ALTERNATED, against, table
    from wormopt.bench.run import machine

    unable = [name for name in cases if name not in ALTERNATED]
    if unable:
        say(f"{', '.join(unable)}: not to be run by turns; there are {', '.join(ALTERNATED)}")
        return BAD_INPUT
    rows, code, chosen = [], DONE, cases or ALTERNATED
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


def _stress(options: argparse.Namespace) -> int:
    groups = list(dict.fromkeys(name.lower() for name in options.groups))
    unknown = [name for name in groups if name not in GROUPS]
    if unknown:
        say(f"no group is called {', '.join(unknown)}; there are {', '.join(GROUPS)}")
        return BAD_INPUT
    from wormopt.bench.stress.matrix import stress, summary, table

    verdicts, code = [], DONE
    try:
        with shown_on_stderr(options.quiet) as report:
            for verdict in stress(groups, quick=options.quick, report=report):
                verdicts.append(verdict)  # noqa: PERF402  one by one: it may be interrupted
    except KeyboardInterrupt:
        code = INTERRUPTED
    complete = code == DONE
    found = summary(verdicts, complete=complete)
    print(json.dumps(found) if options.json else table(verdicts, complete=complete))
    return NOT_SOLVED if complete and not found["passed"] else code
