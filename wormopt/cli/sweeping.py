"""``wormopt sweep``: compute a scene at many values of some of its keys, as one dataset."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from wormopt.cli.codes import DONE, INTERRUPTED, NOT_SOLVED, check_backend, say
from wormopt.cli.running import NO_PLOTS, add_options, finish
from wormopt.errors import Interrupted, OutputError, SceneError
from wormopt.files import POINTS, RESULT_FILE, SUMMARY_FILE, picture_file
from wormopt.progress import shown_on_stderr
from wormopt.study import load_scene
from wormopt.study.output import Output, check_output, default_folder
from wormopt.study.swept import Swept

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


def add(commands: Any) -> None:
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
        help="what is saved of each point (default: %(default)s)",
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

    code = DONE
    try:
        with shown_on_stderr(options.quiet) as report:
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
        names = [name.strip() for name in options.show.split(",")]
        there = [*result.attributes["numbers"], *result.attributes["series"]]
        unknown = [name for name in names if name not in there]
        if unknown:
            missing = f"--show: there is no scalar {', '.join(unknown)}; it is left out"
            say(f"{missing}; write some of {', '.join(there)}")
        names = [name for name in names if name not in unknown]
        result = replace(result, attributes={**result.attributes, "shown": names})
    finish(result, {} if options.no_plots else {"sweep": picture}, output, options)
    return code


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
            what = f"{text!r} is not of the form key=values; write worm.load=1:10:10, say"
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
