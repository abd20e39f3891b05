"""``wormopt export``: a result, written for other tools."""

from __future__ import annotations

import argparse
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.runner import result_at

_FORMATS = {
    "csv": "tables, signals over time first",
    "mat": "a MATLAB file with everything",
    "c": "C99 source of the gait, exact, and a program that tests it",
    "ros": "the gait as a ROS message trajectory_msgs/JointTrajectory, in YAML",
    "fmu": "the model as an FMI 3.0 unit for model exchange, its friction smooth",
}


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "export",
        help="write a result for other tools",
        description="Write a result for other tools; all files, or none.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_export)
    command.add_argument("result", metavar="RESULT", help="folder of a result, or the .nc in it")
    for name, what in _FORMATS.items():
        command.add_argument(
            f"--{name}", action="append_const", const=name, dest="formats", help=what
        )
    command.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        help="a folder or, for one format, a file (files named by the scene, in this folder)",
    )
    command.add_argument(
        "--step",
        metavar="TIME",
        help="0.01 or '10 ms': between rows of --csv (the result's own), points of --ros (0.01)",
    )
    command.add_argument(
        "--cycles", metavar="N", type=int, default=1, help="periods in --ros (%(default)s)"
    )
    command.add_argument(
        "--columns",
        metavar="NAMES",
        default="",
        help="signals in --csv besides time, 'length,rate_0' say (all)",
    )
    command.add_argument(
        "--whole-steps",
        action="store_true",
        help="slow the gait down so that its cycle is a whole number of steps; --csv writes it",
    )
    command.add_argument(
        "--rest", action="store_true", help="let --ros begin and end at rest, time running slower"
    )
    command.add_argument(
        "--force", action="store_true", help="replace earlier exports of the same names"
    )
    command.add_argument("--quiet", action="store_true", help="do not name the files written")


def _export(options: argparse.Namespace) -> int:
    if not options.formats:
        say(f"nothing to export to; write one or more of --{', --'.join(_FORMATS)}")
        return BAD_INPUT
    result = result_at(options.result)
    from wormopt.exports.export import SUFFIXES, export
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
        say(f"{result.scene}: the result {state}, as the files say: {result.reason}")
    for file in files:
        if "ros" in options.formats and file.suffix == SUFFIXES["ros"]:
            head = file.read_text(encoding="utf-8").partition("header:")[0]
            for line in head.splitlines():
                if line.startswith(f"# {ENDS_AT}"):
                    say(f"{file.name}: {line[2:]}")
    if not options.quiet:
        for file in files:
            print(file)
    return DONE
