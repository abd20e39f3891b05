"""``wormopt new`` and ``schema``: scenes to begin with, and what editors know of their keys."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from wormopt.cli.codes import DONE, kind_name
from wormopt.errors import OutputError
from wormopt.files import is_there, write_files

_MADE_BY = b'"$comment": "made by wormopt schema '  # see wormopt.scene.reference


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
    command.add_argument("kind", metavar="KIND", type=kind_name, help="see `wormopt list`")
    command.add_argument("-o", "--output", metavar="FILE", help="what to write")


def _new(options: argparse.Namespace) -> int:
    from wormopt.scene.template import template

    path = Path(options.output or f"{options.kind}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"{path}: a scene is a TOML file; let its name end in .toml")
    schema = path.with_name(f"{options.kind}.schema.json")
    texts = {path: template(options.kind, f"./{schema.name}"), schema: _text(options.kind)}
    files = {file: text.encode() for file, text in texts.items()}
    write_files(files, force=None, own=[schema] if _is_ours(schema) else [])
    print(f"{path}: written, and {schema.name} for editors; run it with: wormopt run {path}")
    return DONE


def _is_ours(schema: Path) -> bool:
    """Whether there is such a schema, made by this version of wormopt or another."""
    return is_there(schema) and _MADE_BY in schema.read_bytes()


def _schema(options: argparse.Namespace) -> int:
    text = _text(options.kind)
    if options.output:
        write_files({Path(options.output): text.encode()}, force=None)
    else:
        print(text, end="")
    return DONE


def _text(kind: str) -> str:
    from wormopt.scene.reference import schema

    return json.dumps(schema(kind), indent=1, ensure_ascii=False) + "\n"
