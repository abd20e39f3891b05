"""Exit codes, and how the command line speaks and understands."""

import argparse
import sys

from wormopt.kinds import KINDS, near

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def say(text: str) -> None:
    """Tell the user something that is no result."""
    print(text, file=sys.stderr)


def kind_name(name: str) -> str:
    """Take a kind of scene from the command line; what is close to one is told."""
    if name in KINDS:
        return name
    close = near(name)
    hint = f"did you mean {close}? " if close else ""
    what = f"no kind of scene is called {name!r}; {hint}`wormopt list` names them"
    raise argparse.ArgumentTypeError(what)
