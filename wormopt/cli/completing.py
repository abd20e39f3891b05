"""``wormopt completion``: a script by which a shell completes commands, scenes and kinds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from wormopt.cli.codes import DONE
from wormopt.kinds import KINDS
from wormopt.scene import packaged_scenes

_SHELLS = ("bash", "zsh", "tcsh")
# What stands for SCENE: a packaged one, a file, or a folder on the way to one.
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


def add(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "completion",
        help="print a script by which a shell completes commands, scenes and kinds",
        description='In bash, for example: eval "$(wormopt completion bash)"',
        allow_abbrev=False,
    )
    command.set_defaults(command=_completion)
    command.add_argument("shell", choices=_SHELLS)


def _completion(options: argparse.Namespace) -> int:
    import shtab  # no other command needs it

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
            }
        elif name in files:
            action.complete = files[name]  # pyright: ignore[reportAttributeAccessIssue]
    functions = {"bash": _BASH, "zsh": _ZSH}.get(options.shell, "").format(scenes=scenes)
    print(shtab.complete(found, options.shell, preamble=functions))
    return DONE


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of those below it."""
    for action in parser._actions:  # noqa: SLF001  argparse lists them nowhere else
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for below in action.choices.values():
                yield from _actions(below)
        else:
            yield action
