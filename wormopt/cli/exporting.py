"""``wormopt export``: write a result in the formats of other tools."""

from __future__ import annotations

import argparse
import re
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.runner import result_at

_FORMATS = {
    "csv": "write CSV tables, the signals over time first",
    "mat": "write a MATLAB file with the whole result",
    "c": "write C99 source that evaluates the gait exactly, with a test program",
    "ros": "write the gait as a ROS message trajectory_msgs/JointTrajectory, in YAML",
    "mjcf": "write the worm for MuJoCo, with keyframes of its gait",
    "urdf": "write the worm as URDF, with a CSV table of its joints",
    "fmu": "write the model as an FMI 3.0 unit, with smooth friction",
}


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "export",
        help="export a saved result to CSV, MATLAB, C, ROS, MuJoCo, URDF or FMI",
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
        help="time between rows of --csv (default: the result's samples), points of --ros and rows "
        "of --urdf (default: 0.01), or largest time step of --mjcf (default: 0.001), such as 0.01 "
        "or '10 ms'",
    )
    command.add_argument(
        "--cycles",
        metavar="N",
        type=int,
        default=1,
        help="number of gait periods in --ros (default: %(default)s)",
    )
    command.add_argument(
        "--columns",
        metavar="NAMES",
        default="",
        help="signals in --csv besides time, such as 'length,rate_0' (default: all)",
    )
    command.add_argument(
        "--whole-steps",
        action="store_true",
        help="slow the gait down in --csv so that its period is a whole number of steps",
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
