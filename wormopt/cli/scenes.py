"""``wormopt list`` and ``check``: scenes and kinds of scene, nothing computed."""

from __future__ import annotations

import argparse
from typing import Any

from wormopt.cli.codes import BAD_INPUT, DONE, kind_name, say
from wormopt.cli.printing import print_table
from wormopt.errors import SceneError
from wormopt.kinds import KINDS
from wormopt.scene import load_scene, packaged_scenes
from wormopt.scene.scene import times_of_scenes


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "list",
        help="list the scenes that come with the package",
        description="List packaged scenes, about how long they take, and the kinds of scene.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_list)
    command.add_argument(
        "words", metavar="WORD", nargs="*", help="only what has all these words, in any case"
    )
    command.add_argument("--kind", metavar="KIND", type=kind_name, help="only scenes of this kind")

    command = commands.add_parser("check", help="check scenes without computing them")
    command.set_defaults(command=_check)
    command.add_argument("scenes", metavar="SCENE", nargs="+")


def _list(options: argparse.Namespace) -> int:
    times = times_of_scenes()
    scenes = [load_scene(name) for name in packaged_scenes()]
    rows = [(s.name, s.table.kind, _about(times.get(s.name, 0)), s.title) for s in scenes]
    kinds = [(name, kind.summary) for name, kind in KINDS.items()]
    if options.kind:
        rows = [row for row in rows if row[1] == options.kind]
        kinds = [row for row in kinds if row[0] == options.kind]
    rows, kinds = _with(options.words, rows), _with(options.words, kinds)
    if rows:
        print("Scenes, to run by name, and about how long they take:")
        print_table(rows)
    if kinds:
        print("\nKinds of scene:" if rows else "Kinds of scene:")
        print_table(kinds)
    if not rows and not kinds:
        say("no packaged scene and no kind has all these words")
    return DONE


def _with(words: list[str], rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows in which all words stand."""
    asked = [word.casefold() for word in words]
    return [row for row in rows if all(word in " ".join(row).casefold() for word in asked)]


def _about(seconds: float) -> str:
    if not seconds:
        return ""
    return f"{seconds:g} s" if seconds < 100 else f"{seconds / 60:.0f} min"


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
