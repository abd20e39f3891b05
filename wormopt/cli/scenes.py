"""Commands about scenes and kinds that compute nothing, from ``wormopt list`` to ``completion``."""

from __future__ import annotations

import argparse
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from wormopt.cli.common import BAD_INPUT, DONE, add_changes, kind_name, say
from wormopt.errors import OutputError, SceneError
from wormopt.files import is_there, write_files
from wormopt.kinds import GROUPS, KINDS
from wormopt.study import load_scene, packaged_scenes
from wormopt.study.scene import times_of_scenes

SYNONYMS: dict[str, str] = {
    "adaptive": "tracker",
    "bang-bang": "slide minimum",
    "calibrate": "fit estimate",
    "capsubot": "capsule",
    "caterpillar": "peristaltic",
    "certificate": "certified bound",
    "control": "track tracker LQR linear",
    "controller": "track tracker LQR linear",
    "conveyor": "cargo float",
    "data": "recording measured",
    "earthworm": "peristaltic",
    "elastomer": "elastic membrane rubber",
    "electromagnet": "coil",
    "endoscope": "capsule channel tube",
    "estimation": "estimate fit",
    "ferrofluid": "film fluid",
    "hardware": "stepper stepping",
    "hill": "uphill slope",
    "identification": "estimate fit identify identifies",
    "identify": "estimate fit identifies",
    "impact": "capsule",
    "inchworm": "spiked peristaltic",
    "incline": "slope uphill hill",
    "leech": "peristaltic",
    "limbless": "planar",
    "lqr": "predictive",
    "measurement": "measured recording",
    "motor": "stepper",
    "mpc": "predictive",
    "navigation": "path",
    "obstacle": "path",
    "optimal": "optimise design fastest best",
    "optimisation": "optimise optimal design fastest best",
    "optimise": "optimal design fastest best",
    "optimization": "optimise optimal design fastest best",
    "optimize": "optimise optimal design fastest best",
    "parameter": "fit",
    "peristalsis": "peristaltic",
    "pipe": "tube channel",
    "planning": "plan path",
    "power": "cheapest energy work",
    "pump": "flow",
    "robust": "random errors fitted",
    "rotate": "turn turning",
    "serpentine": "serpenoid planar",
    "setae": "spike spiked",
    "silicone": "membrane elastic rubber",
    "simulation": "simulate",
    "slope": "uphill hill",
    "snake": "planar serpenoid",
    "soft": "peristaltic membrane elastic",
    "solenoid": "coil",
    "steer": "turn turning",
    "swimming": "swim viscous",
    "time-optimal": "fastest minimum",
    "tracking": "track",
    "trade-off": "pareto",
    "transport": "cargo float",
    "undulation": "serpenoid swim",
    "vibration": "resonance oscillations capsule",
}
"""A word to search for, and the words of scenes and kinds that mean the same."""


def has_all(words: list[str], text: str) -> bool:
    """Return whether a text contains each of some words, or a synonym at the start of a word."""
    text = text.casefold()

    def has(word: str) -> bool:
        meant = "|".join(SYNONYMS.get(word, "").casefold().split())
        return word in text or bool(meant and re.search(rf"(?<![a-z])({meant})", text))

    return all(has(word.casefold()) for word in words)


def add_list(commands: Any) -> None:
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
    """Summary of a packaged scene; its tables are not read."""

    name: str
    title: str


def _found(options: argparse.Namespace) -> dict[str, dict[str, list[_Packaged]]]:
    """Return the scenes asked for, by group and kind."""
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


_MADE_BY = b'"$comment": "made by wormopt schema '  # see wormopt.study.reference


def add_help(commands: Any) -> None:
    """Add the commands to a parser's."""
    command = commands.add_parser(
        "help",
        help="show the keys of a kind of scene and the contents of its results",
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


_SHELLS = ("bash", "zsh", "tcsh", "fish", "powershell")
# Candidates for SCENE: packaged scenes, TOML files, and folders that may hold them.
_BASH = """
_wormopt_scenes() {{
  compgen -W "{scenes}" -- "$1"
  compgen -f -X '!*.toml' -- "$1"
  compgen -d -S '/' -- "$1"
}}
"""
_ZSH = """
_wormopt_scenes() {{
  local -a scenes=({scenes})
  _alternative 'scenes:packaged scene:compadd -a scenes' 'files:scene:_files -g "*.toml"'
}}
"""
_POWERSHELL = """
function _wormopt_scenes {{
  param([string]$WordToComplete)
  '{scenes}'.Split(' ') | Where-Object {{ $_ -like "$WordToComplete*" }}
  _shtab_powershell_compgen_files $WordToComplete |
    Where-Object {{ $_ -match '(\\.toml|[\\\\/])$' }}
}}
"""


def add_completion(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "completion",
        help="print a script for a shell that completes commands, scenes and kinds",
        description="Print a script that completes commands, scenes and kinds in a shell.",
        epilog="""\
bash, zsh:   eval "$(wormopt completion bash)"
tcsh:        wormopt completion tcsh > ~/.wormopt.tcsh; source ~/.wormopt.tcsh
fish:        wormopt completion fish > ~/.config/fish/completions/wormopt.fish
PowerShell:  wormopt completion powershell | Out-String | Invoke-Expression""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(command=_completion)
    command.add_argument("shell", choices=_SHELLS, help="shell that runs the script")


def _completion(options: argparse.Namespace) -> int:
    import shtab  # imported here because no other command needs it

    found, scenes = options.parser, " ".join(packaged_scenes())
    files = {"FILE": shtab.FILE, "PATH": shtab.FILE, "DIR": shtab.DIRECTORY}
    for action in _actions(found):
        name: Any = action.metavar
        if name == "KIND":
            action.choices = list(KINDS)
        elif name == "SCENE":
            action.complete = {  # pyright: ignore[reportAttributeAccessIssue]
                "bash": "_wormopt_scenes",
                "zsh": "_wormopt_scenes",
                "tcsh": f"({scenes})",
                "fish": f"{scenes} (__fish_complete_suffix .toml)",
                "powershell": "_wormopt_scenes",
            }
        elif name in files:
            action.complete = files[name]  # pyright: ignore[reportAttributeAccessIssue]
    functions = {"bash": _BASH, "zsh": _ZSH, "powershell": _POWERSHELL}.get(options.shell, "")
    print(shtab.complete(found, options.shell, preamble=functions.format(scenes=scenes)))
    return DONE


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of its subparsers."""
    for action in parser._actions:  # noqa: SLF001  argparse lists them nowhere else
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for below in action.choices.values():
                yield from _actions(below)
        else:
            yield action
