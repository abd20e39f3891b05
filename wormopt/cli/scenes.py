"""``wormopt list``, ``check`` and ``schema``: scenes and kinds of scene, nothing computed."""

from __future__ import annotations

import argparse
import json
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, say
from wormopt.cli.printing import print_table
from wormopt.errors import SceneError
from wormopt.kinds import KINDS
from wormopt.scene import load_scene, packaged_scenes


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser("list", help="list the scenes that come with the package")
    command.set_defaults(command=_list)

    command = commands.add_parser("check", help="check scenes without computing them")
    command.set_defaults(command=_check)
    command.add_argument("scenes", metavar="SCENE", nargs="+")

    command = commands.add_parser(
        "schema",
        help="print the keys of a kind of scene as JSON Schema",
        description="Print the keys of a kind of scene as JSON Schema, for editors and scripts.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_schema)
    command.add_argument("kind", metavar="KIND", choices=KINDS, help="see `wormopt list`")
    command.add_argument(
        "--markdown", action="store_true", help="as a page to read, with scalars and variables"
    )


def _list(_: argparse.Namespace) -> int:
    scenes = [load_scene(name) for name in packaged_scenes()]
    print("Scenes, to run by name:")
    print_table([(scene.name, scene.table.kind, scene.title) for scene in scenes])
    print("\nKinds of scene:")
    print_table([(name, kind.summary) for name, kind in KINDS.items()])
    return DONE


def _check(options: argparse.Namespace) -> int:
    code = DONE
    for source in options.scenes:
        try:
            scene = load_scene(source)
            print(f"{source}: ok ({scene.table.kind})")
            for warning in scene.warnings:
                say(f"{source}: warning: {warning}")
        except SceneError as error:
            say(str(error))
            code = BAD_INPUT
    return code


def _schema(options: argparse.Namespace) -> int:
    from wormopt.scene.reference import page, schema

    kind = options.kind
    print(page(kind).rstrip() if options.markdown else json.dumps(schema(kind), indent=2))
    return DONE
