"""``wormopt list`` and ``check``: find and check scenes without computing them."""

from __future__ import annotations

import argparse
import json
import tomllib
from typing import Any, NamedTuple

from wormopt.cli.codes import BAD_INPUT, DONE, add_changes, kind_name, say
from wormopt.cli.synonyms import has_all
from wormopt.errors import SceneError
from wormopt.kinds import GROUPS, KINDS
from wormopt.study import load_scene, packaged_scenes
from wormopt.study.scene import times_of_scenes


def add(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "list",
        help="list packaged scenes and kinds of scene, or search them",
        description="List the kinds of scene by system, each with its packaged scenes and their "
        "approximate run times.",
        epilog="examples: wormopt list snake; wormopt list optimise film; wormopt list --kind gait",
        allow_abbrev=False,
    )
    command.set_defaults(command=_list)
    command.add_argument(
        "words",
        metavar="WORD",
        nargs="*",
        help="show only entries that contain each word or a synonym of it, in any letter case",
    )
    command.add_argument("--kind", metavar="KIND", type=kind_name, help="show only this kind")
    command.add_argument("--json", action="store_true", help="print one JSON object on stdout")

    command = commands.add_parser(
        "check",
        help="check scenes without computing them",
        description="Check scenes without computing them. Exit code 2: a scene has errors.",
        allow_abbrev=False,
    )
    command.set_defaults(command=_check)
    command.add_argument(
        "scenes", metavar="SCENE", nargs="+", help="a TOML file, or the name of a packaged scene"
    )
    add_changes(command)


def _list(options: argparse.Namespace) -> int:
    found, seconds = _found(options), times_of_scenes()
    if options.json:
        kinds = [
            {"name": kind, "group": group, "summary": KINDS[kind].summary}
            for group, shown in found.items()
            for kind in shown
        ]
        scenes = [
            {"name": s.name, "group": group, "kind": kind, "title": s.title}
            | {"seconds": seconds.get(s.name)}
            for group, shown in found.items()
            for kind, packaged in shown.items()
            for s in packaged
        ]
        print(json.dumps({"kinds": kinds, "scenes": scenes}))
        return DONE
    width = max(map(len, packaged_scenes()))
    for group, kinds in found.items():
        print(group)
        for kind, scenes in kinds.items():
            print(f"  {kind}: {KINDS[kind].summary}")
            for scene in scenes:
                about = _about(seconds.get(scene.name, 0))
                print(f"    {scene.name:{width}}  {about:>6}  {scene.title}".rstrip())
    if not found:
        say("no packaged scene and no kind contains all these words; `wormopt list` shows all")
    return DONE


class _Packaged(NamedTuple):
    """What is shown of a packaged scene; its tables are not read."""

    name: str
    title: str


def _found(options: argparse.Namespace) -> dict[str, dict[str, list[_Packaged]]]:
    """Return the scenes asked for, by group and kind.

    A kind that has all words brings all its scenes; another one brings those that have all words.
    """
    packaged: dict[str, list[_Packaged]] = {kind: [] for kind in KINDS}
    for name, path in packaged_scenes().items():
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        packaged[raw["kind"]].append(_Packaged(name, raw.get("title") or name))
    found: dict[str, dict[str, list[_Packaged]]] = {}
    for group, kinds in GROUPS.items():
        for kind in kinds:
            scenes = packaged[kind]
            text = f"{group} {kind} {KINDS[kind].summary}"
            matches = has_all(options.words, text)
            if not matches:
                scenes = [s for s in scenes if has_all(options.words, f"{text} {s.name} {s.title}")]
            if (matches or scenes) and options.kind in (None, kind):
                found.setdefault(group, {})[kind] = scenes
    return found


def _about(seconds: float) -> str:
    if not seconds:
        return ""
    return f"{seconds:g} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _check(options: argparse.Namespace) -> int:
    code = DONE
    for source in options.scenes:
        try:
            scene = load_scene(source, options.set)
            print(f"{source}: ok ({scene.table.kind})")
            for warning in scene.warnings:
                say(f"{source}: warning: {warning}")
        except SceneError as error:
            say(str(error))
            code = BAD_INPUT
    return code
