"""The command line: ``wormopt run``, ``check``, ``list``, ``bench`` and ``stress``.

Exit codes: 0 done; 2 bad input; 3 the solver did not reach an accepted result; 130 interrupted.
Results go to stdout, everything else to stderr.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wormopt.bench import CASES
from wormopt.errors import Interrupted, OutputError, SceneError, SolveError
from wormopt.files import RESULT_FILE, SUMMARY_FILE, TABLE_FILE, picture_file
from wormopt.kinds import KINDS
from wormopt.progress import Report, shown_on_stderr
from wormopt.runner import run
from wormopt.scene import Scene, load_scene, packaged_scenes
from wormopt.scene.output import check_output, output_folder
from wormopt.version import VERSION

if TYPE_CHECKING:
    from wormopt.result import Check, Result

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (by default of the process) and return the exit code.

    Raises SystemExit after ``--help`` and on arguments that cannot be understood.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that knows no λ shall show its code instead of ending the program.
        sys.stdout.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    try:
        return options.command(options)
    except (SceneError, OutputError) as error:
        _say(str(error))
        return BAD_INPUT
    except KeyboardInterrupt:
        _say("interrupted; nothing saved")
        return INTERRUPTED
    except BrokenPipeError:  # whoever read our output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wormopt",
        description="Design, simulation and optimal control of worm-like locomotion systems.",
        epilog="exit codes: 0 done, 2 bad input, 3 no accepted result, 130 interrupted",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"wormopt {VERSION}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    command = commands.add_parser("run", help="compute a scene", allow_abbrev=False)
    command.set_defaults(command=_run)
    command.add_argument("scene", metavar="SCENE", help="a TOML file, or the name of a scene")
    command.add_argument("-o", "--output", metavar="DIR", help="where results go (results/<scene>)")
    command.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change a key of the scene"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    command.add_argument("--no-plots", action="store_true", help="draw no pictures")
    command.add_argument("--quiet", action="store_true", help="show no progress")
    command.add_argument("--force", action="store_true", help="write over what is in the way")

    command = commands.add_parser("list", help="list the scenes that come with the package")
    command.set_defaults(command=_list)

    command = commands.add_parser("check", help="check scenes without computing them")
    command.set_defaults(command=_check)
    command.add_argument("scenes", metavar="SCENE", nargs="+")

    command = commands.add_parser(
        "schema",
        help="print the keys of a kind of scene as JSON Schema",
        description="Print the keys of a kind of scene as JSON Schema, for editors and scripts.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_schema)
    command.add_argument("kind", metavar="KIND", choices=KINDS, help="see `wormopt list`")
    command.add_argument(
        "--markdown", action="store_true", help="as a page to read, with scalars and variables"
    )

    command = commands.add_parser(
        "bench",
        help="measure the simulation against others",
        description=_BENCH + "".join(f"\n  {name:14}{what}" for name, what in CASES.items()),
        epilog=_BENCH_COLUMNS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_bench)
    command.add_argument(
        "cases", metavar="CASE", nargs="*", help="in any letter case; all if left out"
    )
    command.add_argument(
        "-o", "--output", metavar="DIR", default="results/bench", help="for pictures (%(default)s)"
    )
    _add_measuring(command, "fewer tolerances, rounds and lengths")

    command = commands.add_parser(
        "stress",
        help="compare the simulation with a second route",
        description=_STRESS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_stress)
    _add_measuring(command, "a few cells of each group only")
    return parser


_BENCH = """\
Run each case with several integrators at several tolerances and compare the times
they need for the same error. A case takes minutes; with --quick, all of them take
about one and a half.

cases:"""
_BENCH_COLUMNS = """\
columns of the table:
  first run      time of the first run, compilation included
  time at 1e-09  median time of later runs with errors of 1e-9 in positions and
                 velocities, interpolated between tolerances
  ours/theirs    wormopt's time over that of the solver: below 1 wormopt is faster
  best error     smallest error of all runs
  failed         runs that failed, or ended with success on a wrong answer"""
_STRESS = """\
Run some 450 seeded worms, many of them extreme, and compare each motion with a
second route that shares no code with the simulator. Takes some minutes, with
--quick under one.

columns of the table, by group of cells:
  right      as near as any computation of that precision can be
  refused    given up by simulate, with a reason
  undecided  the second route fails, or nothing can be known
  wrong      none of these; exit code 3 if there is any, or if an ordinary cell is
             not right"""


def _add_measuring(command: argparse.ArgumentParser, quick: str) -> None:
    command.add_argument("--quick", action="store_true", help=quick)
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    command.add_argument("--quiet", action="store_true", help="show no progress")


def _list(_: argparse.Namespace) -> int:
    scenes = [load_scene(name) for name in packaged_scenes()]
    print("Scenes, to run by name:")
    _print_table([(scene.name, scene.table.kind, scene.title) for scene in scenes])
    print("\nKinds of scene:")
    _print_table([(name, kind.summary) for name, kind in KINDS.items()])
    return DONE


def _check(options: argparse.Namespace) -> int:
    code = DONE
    for source in options.scenes:
        try:
            print(f"{source}: ok ({load_scene(source).table.kind})")
        except SceneError as error:
            _say(str(error))
            code = BAD_INPUT
    return code


def _schema(options: argparse.Namespace) -> int:
    from wormopt.scene.reference import page, schema

    kind = options.kind
    print(page(kind).rstrip() if options.markdown else json.dumps(schema(kind), indent=2))
    return DONE


def _run(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene, options.set)
    pictures = {} if options.no_plots else _pictures(scene)
    folder = Path(options.output) if options.output else Path("results") / scene.name
    kind = KINDS[scene.table.kind]
    tables = [TABLE_FILE] * kind.table_file
    files = [RESULT_FILE, SUMMARY_FILE, *tables, *kind.exports, *pictures.values()]
    folder = check_output(folder, scene.name, files, options.force)
    with shown_on_stderr(options.quiet) as report:
        result, code = _attempt(scene, report)
    with output_folder(folder) as staging:
        result.save(staging, tuple(pictures.values()))
        _draw(result, pictures, staging)
    if options.json:
        print(json.dumps(result.summary(), allow_nan=False))
    else:
        _print_result(result, folder)
    if result.status == "failed":
        _say(f"{scene.name}: failed: {result.reason}")
    return code


def _bench(options: argparse.Namespace) -> int:
    cases = [name.lower() for name in options.cases]
    unknown = [name for name in cases if name not in CASES]
    if unknown:
        _say(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(CASES)}")
        return BAD_INPUT
    from wormopt.bench.run import bench, machine, table

    folder, known, code = Path(options.output), {}, DONE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in cases or CASES:
            with shown_on_stderr(options.quiet) as report:
                for found in bench(name, quick=options.quick, folder=folder, report=report):
                    known[name] = found
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
        print(json.dumps({"machine": machine(), "quick": options.quick, "cases": known}))
    return code


def _stress(options: argparse.Namespace) -> int:
    from wormopt.bench.stress import stress, summary, table

    verdicts, code = [], DONE
    try:
        with shown_on_stderr(options.quiet) as report:
            for verdict in stress(quick=options.quick, report=report):
                verdicts.append(verdict)  # noqa: PERF402  one by one: it may be interrupted
    except KeyboardInterrupt:
        code = INTERRUPTED
    complete = code == DONE
    found = summary(verdicts, complete=complete)
    print(json.dumps(found) if options.json else table(verdicts, complete=complete))
    return NOT_SOLVED if complete and not found["passed"] else code


def _attempt(scene: Scene[Any], report: Report) -> tuple[Result, int]:
    """Run a scene; what it found before it failed or was stopped is a result too."""
    try:
        result = run(scene, report)
    except SolveError as error:
        return _failed(scene, error.partial, str(error)), NOT_SOLVED
    except Interrupted as stop:
        reason = stop.partial.reason if stop.partial else ""
        return _failed(scene, stop.partial, reason or "interrupted"), INTERRUPTED
    return result, DONE if result.status == "ok" else NOT_SOLVED


def _failed(scene: Scene[Any], partial: Result | None, reason: str) -> Result:
    from wormopt.result import conclude

    return (partial or conclude(scene, {})).failed(reason)


def _pictures(scene: Scene[Any]) -> dict[str, str]:
    """Wanted pictures and the files they go to."""
    drawable = KINDS[scene.table.kind].pictures
    return {name: picture_file(name) for name in scene.table.want if name in drawable}


def _draw(result: Result, pictures: dict[str, str], folder: Path) -> None:
    if not pictures or not result.variables:
        return
    from wormopt.plotting import draw

    for name, file in pictures.items():
        try:
            draw(result, name, folder / file)
        except Exception as error:  # a picture must not cost the result
            why = f"it could not be drawn ({type(error).__name__}: {error}); please report this"
            if isinstance(error, KeyError):
                why = f"{str(error).partition(';')[0]}, see its trust report"
            _say(f"{file} left out: {why}")


def _print_result(result: Result, folder: Path) -> None:
    print(result.title)
    units = {name: s.unit for name, s in result.scalars.items() if s.unit != "1"}
    _print_values({name: s.value for name, s in result.scalars.items()}, units)
    facts = {name: value for name, value in result.trust.items() if name != "checks"}
    if facts:
        print("Trust:")
        _print_values(facts, {})
    if result.checks:
        print("Checks:")
        _print_table([_line_of(check) for check in result.checks])
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
    _print_table(rows)


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


def _print_table(rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  " + "  ".join(cells).rstrip())


def _say(text: str) -> None:
    print(text, file=sys.stderr)
