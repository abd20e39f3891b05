"""``wormopt completion``: print a shell script that completes commands, scenes and kinds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from wormopt.cli.codes import DONE
from wormopt.kinds import KINDS
from wormopt.study import packaged_scenes

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


def add(commands: Any) -> None:
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
