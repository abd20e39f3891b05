"""``wormopt run``: compute a scene and save its results in a folder."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wormopt.cli.codes import (
    DONE,
    INTERRUPTED,
    NOT_SOLVED,
    add_engine,
    check_backend,
    engine_of,
    say,
)
from wormopt.cli.printing import print_all, print_result, print_table
from wormopt.errors import Interrupted
from wormopt.files import RESULT_FILE, SUMMARY_FILE, TABLE_FILE, picture_file
from wormopt.progress import shown_on_stderr
from wormopt.runner import attempt
from wormopt.study import Scene, load_scene
from wormopt.study.output import (
    Output,
    changed,
    check_output,
    default_folder,
    earlier_result,
    output_folder,
)  # fmt: skip

if TYPE_CHECKING:
    from wormopt.result import Result

NO_PLOTS = ", or draw no pictures with --no-plots"
# Largest number of changed keys that a message names.
_MOST_KEYS = 5


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "run",
        help="compute a scene",
        description="Compute a scene, save its results and pictures in a folder, and print them.",
        epilog="examples: wormopt run fast_gait; wormopt run fast_gait --set worm.load=12",
        allow_abbrev=False,
    )
    command.set_defaults(command=_run)
    command.add_argument(
        "-o", "--output", metavar="DIR", help="folder for results (default: results/<scene>)"
    )
    add_options(command)
    command.add_argument(
        "--only",
        metavar="NAME,...",
        help="compute these scalars, variables or checks alone, and draw no pictures",
    )


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the scene, its changes, and the options for computing, printing and saving."""
    command.add_argument(
        "scene", metavar="SCENE", help="a TOML file, or the name of a packaged scene"
    )
    command.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change a key of the scene, such as worm.load=12; may be repeated",
    )
    add_engine(command)
    command.add_argument(
        "--all", action="store_true", help="print all scalars, facts and checks, not the short form"
    )
    command.add_argument(
        "-v", "--verbose", action="store_true", help="print the time of each stage as well"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    command.add_argument("--no-plots", action="store_true", help="draw no pictures")
    command.add_argument("--quiet", action="store_true", help="show no progress")
    command.add_argument(
        "--force",
        action="store_true",
        help="replace the result of another scene; files that wormopt did not write are kept",
    )


def _run(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene, options.set)
    only = [] if options.only is None else [name.strip() for name in options.only.split(",")]
    if only:
        scene.table.check_names(only)
    pictures = {} if options.no_plots or only else _pictures(scene)
    if pictures:
        check_backend(NO_PLOTS)
    trial = [*options.set, *([f"only={options.only}"] if only else [])]
    folder = Path(options.output or default_folder(scene.name, trial))
    study = scene.table
    tables = [TABLE_FILE] * study.table_file
    files = [RESULT_FILE, SUMMARY_FILE, *tables, *study.exports, *pictures.values()]
    output = Output(folder, scene.name, scene.table.kind, force=options.force)
    output = check_output(output, files)
    with shown_on_stderr(options.quiet) as report, engine_of(options):
        try:
            result = attempt(scene, report, only)
            code = NOT_SOLVED if result.status == "failed" else DONE
        except Interrupted as stop:
            result, code = stop.partial, INTERRUPTED
    if scene.sweep is not None:
        say(f"{scene.name}: computed without its table [sweep]; `wormopt sweep` uses it")
    finish(result, pictures, output, options)
    return code


def _pictures(scene: Scene[Any]) -> dict[str, str]:
    """Return the pictures that the scene wants, with their file names."""
    drawable = scene.table.pictures
    return {name: picture_file(name) for name in scene.table.want if name in drawable}


def finish(
    result: Result, pictures: dict[str, str], output: Output, options: argparse.Namespace
) -> None:
    """Save a result with its pictures and print it; report an earlier one that it replaces."""
    earlier = earlier_result(output.folder)
    with output_folder(output) as staging:
        result.save(staging, tuple(pictures.values()))
        _draw_all(result, pictures, staging)
    if options.json:
        print(json.dumps(result.summary(), allow_nan=False))
    else:
        (print_all if options.all else print_result)(result)
        if options.verbose and result.timings_s:
            print("Time:")
            print_table([(stage, f"{spent:.3g} s") for stage, spent in result.timings_s.items()])
        print(f"Saved in {output.folder}")
    keys = [*changed(earlier.table, json.loads(result.scene_text))] if earlier.table else []
    if keys and (earlier.scene, earlier.kind) == (result.scene, result.kind):
        names = ", ".join(keys[:_MOST_KEYS]) + ", …" * (len(keys) > _MOST_KEYS)
        say(f"{output.folder}: replaced the earlier result, which had other values of {names}")
    if result.status != "ok":
        say(f"{result.scene}: {result.status}: {result.reason}")


def _draw_all(result: Result, pictures: dict[str, str], folder: Path) -> None:
    """Draw pictures into files of a folder; report and skip one that fails."""
    if not pictures or not result.variables:
        return
    from wormopt.pictures import draw

    for name, file in pictures.items():
        try:
            draw(result, name, folder / file)
        except Exception as error:  # a failed picture must not lose the result
            why = f"drawing failed ({type(error).__name__}: {error}); please report this"
            if isinstance(error, KeyError):
                why = f"{str(error).partition(';')[0]}, see its trust report"
            elif result.status == "failed":
                why = "the result is incomplete, see its trust report"
            say(f"{file} left out: {why}")
