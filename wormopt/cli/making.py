"""``wormopt help``, ``new`` and ``schema``: the keys of a kind of scene, for users and editors."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from wormopt.cli.codes import DONE, kind_name
from wormopt.errors import OutputError
from wormopt.files import is_there, write_files

_MADE_BY = b'"$comment": "made by wormopt schema '  # see wormopt.study.reference


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "help",
        help="show the keys of a kind of scene and what its results hold",
        description="Show the reference page of a kind of scene: keys, scalars and variables. "
        "Output to a pipe or file is Markdown.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_help)
    command.add_argument(
        "kind",
        metavar="KIND",
        nargs="?",
        type=kind_name,
        help="kind of scene, see `wormopt list` (default: list the commands)",
    )

    command = commands.add_parser(
        "new",
        help="write a scene to start from",
        description="Write a scene of a kind. It runs as written, and comments explain each key. "
        "Its JSON Schema, KIND.schema.json, is written beside it for editors.",
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
        "kind", metavar="KIND", type=kind_name, help="kind of scene, see `wormopt list`"
    )
    command.add_argument("-o", "--output", metavar="FILE", help="file to write (default: stdout)")


def _help(options: argparse.Namespace) -> int:
    if not options.kind:
        options.parser.print_help()
        return DONE
    from wormopt.study.reference import page

    text = page(options.kind)
    if not sys.stdout.isatty():
        print(text, end="")
        return DONE
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(_for_terminals(text)))
    return DONE


def _for_terminals(page: str) -> str:
    """Replace HTML indices and powers by _ and ^, and links by the names of pages in docs/."""
    page = re.sub(r"<sub>(.*?)</sub>", r"_\1", page)
    page = re.sub(r"<sup>(.*?)</sup>", r"^\1", page)
    page = re.sub(r"\[([\w.-]+\.md)\]\(\.\./[^)]*\)", r"docs/\1", page)
    return re.sub(r"\[([^\]]*)\]\(\.\./([^)#]*)[^)]*\)", r"\1 (docs/\2)", page)


def _new(options: argparse.Namespace) -> int:
    from wormopt.study.template import template

    path = Path(options.output or f"{options.kind}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"{path}: does not end in .toml; a scene is a TOML file")
    schema = path.with_name(f"{options.kind}.schema.json")
    texts = {path: template(options.kind, f"./{schema.name}"), schema: _text(options.kind)}
    files = {file: text.encode() for file, text in texts.items()}
    write_files(files, force=None, own=[schema] if _is_ours(schema) else [])
    print(f"{path}: written, and {schema.name} for editors; run it with: wormopt run {path}")
    return DONE


def _is_ours(schema: Path) -> bool:
    """Whether the file exists and wormopt, of any version, made it."""
    return is_there(schema) and _MADE_BY in schema.read_bytes()


def _schema(options: argparse.Namespace) -> int:
    text = _text(options.kind)
    if options.output:
        write_files({Path(options.output): text.encode()}, force=None)
    else:
        print(text, end="")
    return DONE


def _text(kind: str) -> str:
    from wormopt.study.reference import schema

    return json.dumps(schema(kind), indent=1, ensure_ascii=False) + "\n"
