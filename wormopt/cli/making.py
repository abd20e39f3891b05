"""``wormopt new`` and ``schema``: scenes to begin with, and what editors know of their keys."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, kind_name, say
from wormopt.errors import OutputError
from wormopt.files import write_files
from wormopt.kinds import KINDS


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "new",
        help="write a scene to begin with",
        description="Write a scene of a kind that runs as it is, with what every key means.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_new)
    command.add_argument("kind", metavar="KIND", type=kind_name, help="see `wormopt list`")
    command.add_argument("-o", "--output", metavar="FILE", help="what to write (KIND.toml)")

    command = commands.add_parser(
        "schema",
        help="print the keys of a kind of scene as JSON Schema",
        description="Print the keys of a kind of scene as JSON Schema, for editors and scripts.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_schema)
    command.add_argument(
        "kind", metavar="KIND", nargs="?", type=kind_name, help="see `wormopt list`"
    )
    command.add_argument("--all", action="store_true", help="of every kind, KIND.json in a folder")
    command.add_argument(
        "--markdown", action="store_true", help="as a page to read, with scalars and variables"
    )
    command.add_argument("-o", "--output", metavar="PATH", help="the file or folder to write")


def _new(options: argparse.Namespace) -> int:
    from wormopt.scene.scene import packaged_folder
    from wormopt.scene.template import template

    path = Path(options.output or f"{options.kind}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"{path}: a scene is a TOML file; let its name end in .toml")
    schema = packaged_folder() / "schemas" / f"{options.kind}.json"
    write_files({path: template(options.kind, schema.resolve().as_uri()).encode()}, force=None)
    print(f"{path}: written; run it with: wormopt run {path}")
    return DONE


def _schema(options: argparse.Namespace) -> int:
    if options.all == bool(options.kind) or (options.all and not options.output):
        say("wormopt schema: name a KIND, or write --all -o DIR")
        return BAD_INPUT
    suffix = ".md" if options.markdown else ".json"
    if options.all:
        folder = Path(options.output)
        texts = {folder / f"{kind}{suffix}": _text(kind, suffix).encode() for kind in KINDS}
        write_files(texts, force=None)
    elif options.output:
        text = _text(options.kind, suffix).encode()
        write_files({Path(options.output): text}, force=None)
    else:
        print(_text(options.kind, suffix), end="")
    return DONE


def _text(kind: str, suffix: str) -> str:
    from wormopt.scene.reference import page, schema

    if suffix == ".md":
        return page(kind)
    return json.dumps(schema(kind), indent=1, ensure_ascii=False) + "\n"
