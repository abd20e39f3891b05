"""``wormopt run`` computes a scene, ``sweep`` it at many values of its keys; results are saved."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wormopt.cli.common import (
    DONE,
    INTERRUPTED,
    NOT_SOLVED,
    add_changes,
    add_engine,
    check_backend,
    engine_of,
    print_all,
    print_result,
    print_table,
    say,
)
from wormopt.errors import Interrupted, OutputError, SceneError
from wormopt.files import POINTS, RESULT_FILE, SUMMARY_FILE, TABLE_FILE, picture_file
from wormopt.progress import Report, shown_on_stderr
from wormopt.runner import attempt
from wormopt.study import Scene, load_scene
from wormopt.study.output import (
    Earlier,
    Output,
    changed,
    check_output,
    default_folder,
    earlier_result,
    output_folder,
)
from wormopt.study.swept import Swept

if TYPE_CHECKING:
    from wormopt.result import Result

NO_PLOTS = ", or draw no pictures with --no-plots"
# Largest number of changed keys that a message names.
_MOST_KEYS = 5


def add_run(commands: Any) -> None:
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
    add_changes(command)
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
    earlier = earlier_result(output.folder)
    with shown_on_stderr(options.quiet) as report, engine_of(options):
        try:
            result = attempt(scene, report, only)
            code = NOT_SOLVED if result.status == "failed" else DONE
        except Interrupted as stop:
            result, code = stop.partial, INTERRUPTED
        code = code if _saved(result, pictures, output, report) else INTERRUPTED
    if scene.sweep is not None:
        say(f"{scene.name}: computed without its table [sweep]; `wormopt sweep` uses it")
    _finish(result, earlier, output, options)
    return code


def _pictures(scene: Scene[Any]) -> dict[str, str]:
    """Return the pictures that the scene wants, with their file names."""
    drawable = scene.table.pictures
    return {name: picture_file(name) for name in scene.table.want if name in drawable}


def _saved(result: Result, pictures: dict[str, str], output: Output, report: Report) -> bool:
    """Save a result with its pictures; False if the user stopped the drawing."""
    with output_folder(output) as staging:
        report("saving", None)
        result.save(staging, tuple(pictures.values()))
        try:
            _draw_all(result, pictures, staging, report)
        except KeyboardInterrupt:
            say("interrupted; the result is saved, some pictures are not")
            return False
    return True


def _finish(result: Result, earlier: Earlier, output: Output, options: argparse.Namespace) -> None:
    """Print a saved result; report an earlier one that it replaced."""
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


def _draw_all(result: Result, pictures: dict[str, str], folder: Path, report: Report) -> None:
    """Draw pictures into files of a folder; report and skip one that fails."""
    if not pictures or not result.variables:
        return
    from wormopt.pictures import draw

    for name, file in pictures.items():
        report(f"drawing {file}", None)
        try:
            draw(result, name, folder / file)
        except Exception as error:  # a failed picture must not lose the result
            why = f"drawing failed ({type(error).__name__}: {error}); please report this"
            if isinstance(error, KeyError):
                why = f"{str(error).partition(';')[0]}, see its trust report"
            elif result.status == "failed":
                why = "the result is incomplete, see its trust report"
            say(f"{file} left out: {why}")


_DESCRIPTION = """\
Compute a scene at many values of some of its keys. The table [sweep] of the scene or
--over gives the values. Each point is saved when it is done: an interrupted sweep
continues where it stopped, and an enlarged sweep computes only the new points.
The exit code is 3 if no point succeeds and 2 if every point is refused."""
_EXAMPLES = """\
examples:
  wormopt sweep design_fast_gait --over worm.load=1:10:10 --over gait.spike_load=[20,30]
  wormopt sweep fast_gait --over worm.load=1:100:5:log --over gait.period=1:2:5 --zip
  wormopt sweep robot.toml --over worm.load=1:10 --sobol 64 --engine dask"""


def add_sweep(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "sweep",
        help="compute a scene at many values of some of its keys",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_sweep)
    command.add_argument(
        "--over",
        metavar="KEY=VALUES",
        action="append",
        default=[],
        help="values of a key: first:last:count, first:last:count:log or a list; first:last for "
        "random points; may be repeated",
    )
    method = command.add_mutually_exclusive_group()
    method.add_argument(
        "--zip",
        action="store_true",
        help="combine the first values of all keys, the second ones, and so on (default: a grid)",
    )
    method.add_argument(
        "--latin-hypercube",
        metavar="N",
        type=int,
        help="draw N points by Latin hypercube sampling within the ranges",
    )
    method.add_argument(
        "--sobol", metavar="N", type=int, help="draw N points of a Sobol sequence within the ranges"
    )
    command.add_argument(
        "--seed", metavar="N", type=int, help="seed of the random points (default: 0)"
    )
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="folder for the dataset (default: results/<scene>-sweep)",
    )
    command.add_argument(
        "--store",
        metavar="DIR",
        help="folder in which points are saved; several sweeps may share it (default: "
        f"{POINTS} in the folder of the scene's sweep)",
    )
    command.add_argument(
        "--keep",
        choices=("results", "scalars"),
        default="results",
        help="data to save for each point (default: %(default)s)",
    )
    command.add_argument("--show", metavar="NAME,...", help="scalars that the picture shows")
    add_options(command)


def _sweep(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene, options.set)
    over = _over(scene.name, options.over)
    picture = picture_file("sweep")
    if not options.no_plots:
        check_backend(NO_PLOTS)
    files = [RESULT_FILE, SUMMARY_FILE, *Swept.exports, *([] if options.no_plots else [picture])]
    folder = Path(options.output or default_folder(f"{scene.name}-sweep", options.set))
    usual = Path(options.output or default_folder(f"{scene.name}-sweep"))  # with --set too
    store = Path(options.store or usual / POINTS)
    kept = _first_below(folder, store)
    output = Output(folder, scene.name, "sweep", kept=(POINTS, kept), force=options.force)
    output = check_output(output, files)
    from wormopt.families.sweep import sweep
    from wormopt.numerics.workers import Engine

    earlier = earlier_result(output.folder)
    with shown_on_stderr(options.quiet) as report:
        try:
            result = sweep(
                scene,
                over,
                **_method(options),
                store=store,
                keep=options.keep,
                engine=Engine(options.engine, options.workers, options.scheduler),
                report=report,
            )
            code = NOT_SOLVED if result.status == "failed" else DONE
        except Interrupted as stop:
            result, code = stop.partial, INTERRUPTED
        if options.show:
            result = _showing(result, options.show)
        pictures = {} if options.no_plots else {"sweep": picture}
        code = code if _saved(result, pictures, output, report) else INTERRUPTED
    _finish(result, earlier, output, options)
    return code


def _showing(result: Result, asked: str) -> Result:
    """Choose the scalars that the picture of a sweep shows; report and skip unknown ones."""
    names = [name.strip() for name in asked.split(",")]
    there = [*result.attributes["numbers"], *result.attributes["series"]]
    unknown = [name for name in names if name not in there]
    if unknown:
        missing = f"--show: there is no scalar {', '.join(unknown)}; it is left out"
        say(f"{missing}; write some of {', '.join(there)}")
    names = [name for name in names if name not in unknown]
    return replace(result, attributes={**result.attributes, "shown": names})


def _first_below(folder: Path, store: Path) -> str:
    """Return the first part of the store's path below a folder, "" if it is elsewhere."""
    folder, store = folder.resolve(), store.resolve()
    if store == folder:
        raise OutputError(f"{store}: is the folder of the dataset; give another --store")
    return store.relative_to(folder).parts[0] if store.is_relative_to(folder) else ""


def _over(name: str, texts: list[str]) -> dict[str, Any] | None:
    """Return the values of each key from --over, or None if the scene gives them."""
    found = {}
    for text in texts:
        key, equals, values = text.partition("=")
        if not equals or not key.strip():
            what = f"{text!r} is not of the form key=values; write for example worm.load=1:10:10"
            raise SceneError(name, [("--over", what)])
        if key.strip() in found:
            raise SceneError(name, [("--over", f"{key.strip()} is given twice; give it once")])
        found[key.strip()] = _values(name, key.strip(), values.strip())
    return found or None


def _values(name: str, key: str, text: str) -> Any:
    if not text.startswith("["):
        return text
    import tomllib

    try:
        return tomllib.loads(f"values = {text}")["values"]
    except ValueError:
        what = f"{text!r} is not a list; write {key}=[1, 2, 5], with texts in quotes"
        raise SceneError(name, [("--over", what)]) from None


def _method(options: argparse.Namespace) -> dict[str, Any]:
    found: dict[str, Any] = {"method": "zip"} if options.zip else {}
    for name in ("latin_hypercube", "sobol"):
        points = getattr(options, name)
        if points is not None:
            found = {"method": name.replace("_", "-"), "points": points}
    return found | ({} if options.seed is None else {"seed": options.seed})
