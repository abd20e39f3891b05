"""``wormopt plot``: draw pictures of a saved result without computing it again."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from wormopt.cli.codes import DONE, check_backend, say
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.files import MOVING, RESULT_FILE, STILL, picture_file, refuse_obstacle, write_files
from wormopt.runner import result_at
from wormopt.study.output import earlier_result, enlist

if TYPE_CHECKING:
    from wormopt.result import Result

_INTO_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "": 1.0}


def add(commands: Any) -> None:
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
            f"{text!r} is not a size from 30mm to 2000mm; write 85mm, say"
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
