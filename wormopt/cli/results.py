"""Commands for saved results: ``wormopt show``, ``verify``, ``plot``, ``report``, ``export``."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from wormopt.cli.common import (
    BAD_INPUT,
    DONE,
    NOT_SOLVED,
    check_backend,
    print_all,
    print_result,
    say,
)
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.files import MOVING, RESULT_FILE, STILL, picture_file, refuse_obstacle, write_files
from wormopt.runner import result_at
from wormopt.shown import line
from wormopt.study.output import earlier_result, enlist

if TYPE_CHECKING:
    from wormopt.result import Result


def add_show(commands: Any) -> None:
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


def add_verify(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "verify",
        help="verify the certificate of a gait in exact arithmetic",
        description="Check every inequality of a certificate in rational arithmetic. A verified "
        "certificate proves that no gait within the limits it states is faster than its bound. "
        "Exit codes: 0 verified, 3 an inequality does not hold, 2 not a certificate.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_verify)
    command.add_argument("file", metavar="FILE", help="folder of a result, or its certificate.json")


def _verify(options: argparse.Namespace) -> int:
    from wormopt.systems.spiked.certify.certificate import verify

    found = verify(options.file)
    if not found.holds:
        say(f"{options.file}: not verified: {found.reason}")
        return NOT_SOLVED
    print(
        f"{options.file}: verified: no gait within the limits of its `problem` is faster than "
        f"{found.bound} = {float(found.bound):.9g}, in the units of the scene "
        f"({found.inequalities} inequalities hold)"
    )
    return DONE


_INTO_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "": 1.0}


def add_plot(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "plot",
        help="draw pictures of a saved result",
        description="Draw pictures of a saved result. Nothing is computed again.",
        epilog="widths for journals: 85mm fits one column, 180mm a page",
        allow_abbrev=False,
    )
    command.set_defaults(command=_plot)
    command.add_argument("result", metavar="RESULT", help="folder of a result, or its .nc file")
    command.add_argument(
        "pictures", metavar="PICTURE", nargs="*",
        help="pictures to draw, words of the key `want` (default: those the scene wants, or all)",
    )  # fmt: skip
    command.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        help="file or folder to write (default: the folder of the result)",
    )
    command.add_argument(
        "--width",
        type=_millimetres,
        metavar="SIZE",
        help="width in mm, cm or in, such as 85mm (default: 180mm)",
    )
    command.add_argument(
        "--height",
        type=_millimetres,
        metavar="SIZE",
        help="height in mm, cm or in (default: as the picture needs)",
    )
    command.add_argument("--no-title", action="store_true", help="draw neither title nor facts")
    command.add_argument(
        "--format",
        choices=(*STILL, *MOVING),
        help="file format (default: png); mp4 and gif are for the animation",
    )
    command.add_argument(
        "--force", action="store_true", help="replace other pictures made by wormopt"
    )


def _millimetres(text: str) -> float:
    found = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(mm|cm|in|)\s*", text)
    if not found or not 30 <= (size := float(found[1]) * _INTO_MM[found[2]]) <= 2000:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a size from 30mm to 2000mm; write for example 85mm"
        )
    return size


def _plot(options: argparse.Namespace) -> int:
    check_backend()
    result, source = result_at(options.result), Path(options.result)
    source = source / RESULT_FILE if source.is_dir() else source
    from wormopt.pictures import no_picture, pictures_of

    there = pictures_of(result)
    if unknown := [name for name in options.pictures if name not in there]:
        raise ArgumentError("\n".join(no_picture(result, name) for name in unknown))
    files = _files(options, source, options.pictures or _wanted(result, there))
    own = _listed(files.values(), source)
    for file in files.values():
        refuse_obstacle(file, force=options.force, own=own)
    drawn: list[Path] = []
    try:
        for name, file in files.items():
            if _draw(result, name, file, source, options):
                drawn.append(file)
                print(file)
    finally:
        _enlist(drawn, source)
    if not drawn:
        raise ArgumentError(f"{source}: the result has no data for a picture")
    return DONE


def _draw(result: Result, name: str, file: Path, source: Path, options: argparse.Namespace) -> bool:
    """Draw a picture and return True; skip one without data unless the user named it."""
    from wormopt.pictures import draw

    try:
        with TemporaryDirectory() as folder:
            drawn = Path(folder) / file.name
            draw(result, name, drawn, width=options.width, height=options.height,
                 title=not options.no_title)  # fmt: skip
            own = _listed([file], source)  # again, because files may have changed meanwhile
            write_files({file: drawn.read_bytes()}, force=options.force, own=own)
    except UnknownNameError as error:
        lacks = f"{name} cannot be drawn: {str(error).partition(';')[0]}"
        if options.pictures:
            raise ArgumentError(f"{lacks}; the run did not compute it") from error
        say(f"{lacks}; left out")
        return False
    return True


def _wanted(result: Result, there: Mapping[str, str]) -> Sequence[str]:
    """Return the pictures that the scene of a result wants, or all pictures."""
    wants = json.loads(result.scene_text or "{}").get("want", [])
    return [name for name in wants if name in there] or list(there)


def _files(options: argparse.Namespace, source: Path, names: Sequence[str]) -> dict[str, Path]:
    names = list(dict.fromkeys(names))
    path = Path(options.output) if options.output else source.parent
    if options.output is None or path.is_dir() or not path.suffix:
        return {name: path / picture_file(name, options.format) for name in names}
    if len(names) > 1:
        raise ArgumentError(
            f"{path}: one file cannot hold {len(names)} pictures ({', '.join(names)}); "
            "name one picture, or give a folder"
        )
    if options.format and path.suffix != f".{options.format}":
        raise ArgumentError(f"{path}: does not end in .{options.format}; leave --format out")
    return {names[0]: path}


def _listed(files: Iterable[Path], source: Path) -> set[Path]:
    """Return the files that the result lists as its own and that are unchanged."""
    beside = earlier_result(source.parent)
    own = beside.own if source.name in beside.own else frozenset()
    folder = source.parent.resolve()
    return {file for file in files if file.name in own and file.parent.resolve() == folder}


def _enlist(files: Iterable[Path], source: Path) -> None:
    """Add new pictures to the files that a result lists as its own."""
    beside = [f.name for f in files if f.parent.resolve() == source.parent.resolve()]
    if beside and source.name in earlier_result(source.parent).own:
        enlist(source.parent, beside)


def add_report(commands: Any) -> None:
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


_FORMATS = {
    "csv": "write CSV tables, the signals over time first",
    "parquet": "write the same tables as Parquet (extra: parquet)",
    "mat": "write a MATLAB file with the whole result",
    "hdf5": "write an HDF5 file with the whole result (extra: hdf5)",
    "c": "write C99 source that evaluates the gait exactly, with a test program",
    "arduino": "write an Arduino sketch that plays the gait on servos, in single precision",
    "ros": "write the gait as a ROS message trajectory_msgs/JointTrajectory, in YAML",
    "mjcf": "write the worm for MuJoCo, with keyframes of its gait",
    "urdf": "write the worm as URDF, with a CSV table of its joints",
    "fmu": "write the model as an FMI 3.0 unit, with smooth friction",
    "fmu2": "write the same unit for FMI 2.0",
}


def add_export(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "export",
        help="export a saved result to tables, MATLAB, C, Arduino, ROS, MuJoCo, FMI and others",
        description="Export a saved result in one or more formats. If one file cannot be "
        "written, none is.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_export)
    command.add_argument("result", metavar="RESULT", help="folder of a result, or its .nc file")
    for name, what in _FORMATS.items():
        command.add_argument(
            f"--{name}", action="append_const", const=name, dest="formats", help=what
        )
    command.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        help="folder to write to, or a file for a single format (default: files named after the "
        "scene, in the current folder)",
    )
    command.add_argument(
        "--step",
        metavar="TIME",
        help="time between rows of --csv and --parquet (default: the result's samples), points of "
        "--ros and rows of --urdf (default: 0.01), or largest time step of --mjcf (default: "
        "0.001), such as 0.01 or '10 ms'",
    )
    command.add_argument(
        "--cycles",
        metavar="N",
        type=int,
        default=1,
        help="number of cycles of the gait in --ros (default: %(default)s)",
    )
    command.add_argument(
        "--columns",
        metavar="NAMES",
        default="",
        help="signals in --csv and --parquet besides time, such as 'length,rate_0' (default: all)",
    )
    command.add_argument(
        "--whole-steps",
        action="store_true",
        help="slow the gait of --csv, --parquet, --c, --arduino and --ros down to a cycle of "
        "whole steps",
    )
    command.add_argument(
        "--rest",
        action="store_true",
        help="let --ros start and end at rest by slowing the motion down there",
    )
    command.add_argument(
        "--force", action="store_true", help="replace earlier exports with the same names"
    )
    command.add_argument("--quiet", action="store_true", help="do not print the files written")


def _export(options: argparse.Namespace) -> int:
    if not options.formats:
        say(f"no format is given; write one or more of --{', --'.join(_FORMATS)}")
        return BAD_INPUT
    result = result_at(options.result)
    from wormopt.exports.export import SUFFIXES, export
    from wormopt.exports.robot import DIFFERS
    from wormopt.exports.ros import ENDS_AT

    files = export(
        result,
        options.formats,
        options.output,
        step=options.step,
        cycles=options.cycles,
        columns=[name.strip() for name in options.columns.split(",") if name.strip()],
        whole_steps=options.whole_steps,
        rest=options.rest,
        force=options.force,
    )
    if result.status != "ok":
        state = "failed" if result.status == "failed" else "is unchecked"
        say(f"{result.scene}: warning: the result {state}; the files state it: {result.reason}")
    for file in files:
        if file.suffix in (SUFFIXES["ros"], SUFFIXES["mjcf"], SUFFIXES["urdf"]):
            head = re.split("header:|-->", file.read_text(encoding="utf-8"), maxsplit=1)[0]
            for line in (line.removeprefix("# ") for line in head.splitlines()):
                if line.startswith((ENDS_AT, DIFFERS)):
                    say(f"{file.name}: {line}")
    if not options.quiet:
        for file in files:
            print(file)
    return DONE
