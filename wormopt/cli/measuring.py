"""``wormopt bench`` and ``stress``: benchmarks against other solvers, and stress tests."""

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
        help="benchmark speed and accuracy against other solvers",
        description=_BENCH + "".join(f"\n  {name:17}{what}" for name, what in CASES.items()),
        epilog=_BENCH_COLUMNS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_bench)
    command.add_argument(
        "cases", metavar="CASE", nargs="*", help="cases to run, in any letter case (default: all)"
    )
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        default="results/bench",
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
    _add_measuring(command, "use fewer tolerances, repetitions and sizes")

    command = commands.add_parser(
        "stress",
        help="compare answers to hard cases with an independent method",
        description=_STRESS + "".join(f"\n  {name:14}{by}" for name, by in GROUPS.items()),
        epilog=_STRESS_COLUMNS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_stress)
    command.add_argument(
        "groups",
        metavar="GROUP",
        nargs="*",
        help="groups to run, in any letter case (default: all)",
    )
    _add_measuring(command, "run only a few cases of each group")


_BENCH = """\
Run each case with several solvers at several tolerances and compare their times at
equal error. A case takes minutes; with --quick, all cases take a few minutes.
DIR/index.html shows all cases measured so far. DIR/history.json keeps the ratios of
times by version, and the command reports ratios that have become worse.

cases:"""
_BENCH_COLUMNS = """\
columns of the table:
  first run      time of the first run, compilation included
  time at 1e-09  median time of later runs with errors of 1e-9 in positions and
                 velocities, interpolated between tolerances
  ours/theirs    wormopt's time over that of the solver: below 1 wormopt is faster
  best error     smallest error of all runs
  memory         largest growth of the process in the first run
  failed         runs that failed, or reported success with a wrong answer"""
_STRESS = """\
Compute about 2,000 random cases with fixed seeds, many of them extreme, and compare each
answer with a method that shares no code with it. All cases take about seven minutes on
two idle processors; --quick runs a few of each group.

groups, and the method that each is compared with:"""
_STRESS_COLUMNS = """\
columns of the table, by kind of case:
  right      as accurate as the floating-point precision allows
  refused    ended with an error that says what to change
  undecided  the other method fails, or no answer can be established
  wrong      any other answer; the exit code is 3 if there is one, if an ordinary case
             is not right, or if fewer than nine tenths are right"""


def _add_measuring(command: argparse.ArgumentParser, quick: str) -> None:
    command.add_argument("--quick", action="store_true", help=quick)
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    command.add_argument("--quiet", action="store_true", help="show no progress")


def _bench(options: argparse.Namespace) -> int:
    cases = [name.lower() for name in options.cases]
    unknown = [name for name in cases if name not in CASES]
    if unknown:
        say(f"there is no benchmark {', '.join(unknown)}; write one of {', '.join(CASES)}")
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
        say(
            f"{', '.join(unable)}: --against cannot run this case; write one of "
            f"{', '.join(ALTERNATED)}"
        )
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
        say(f"there is no group {', '.join(unknown)}; write one of {', '.join(GROUPS)}")
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
