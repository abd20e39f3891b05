"""``wormopt new`` and ``schema``: scenes to start from, and JSON Schemas of their keys."""

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
        help="write a scene to start from",
        description="Write a scene of a kind. It runs as written, and comments explain each key.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_new)
    command.add_argument(
        "kind", metavar="KIND", type=kind_name, help="kind of scene, see `wormopt list`"
    )
    command.add_argument(
        "-o", "--output", metavar="FILE", help="file to write (default: KIND.toml)"
    )

    command = commands.add_parser(
        "schema",
        help="print the keys of a kind of scene as JSON Schema",
        description="Print the keys of a kind of scene as JSON Schema, for editors and scripts.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_schema)
    command.add_argument(
        "kind", metavar="KIND", nargs="?", type=kind_name, help="kind of scene, see `wormopt list`"
    )
    command.add_argument(
        "--all", action="store_true", help="write KIND.json for every kind to the folder -o"
    )
    command.add_argument(
        "--markdown",
        action="store_true",
        help="write a Markdown page instead, with the scalars and variables of results",
    )
    command.add_argument(
        "-o", "--output", metavar="PATH", help="file or folder to write (default: stdout)"
    )


def _new(options: argparse.Namespace) -> int:
    from wormopt.scene.scene import packaged_folder
    from wormopt.scene.template import template

    path = Path(options.output or f"{options.kind}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"{path}: does not end in .toml; a scene is a TOML file")
    schema = packaged_folder() / "schemas" / f"{options.kind}.json"
    write_files({path: template(options.kind, schema.resolve().as_uri()).encode()}, force=None)
    print(f"{path}: written; run it with: wormopt run {path}")
    return DONE


def _schema(options: argparse.Namespace) -> int:
    if options.all == bool(options.kind) or (options.all and not options.output):
        say("wormopt schema: no kind is given; write a KIND, or --all -o DIR")
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
