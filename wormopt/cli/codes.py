"""Exit codes, and how the command line speaks and understands."""

import argparse
import sys
from contextlib import AbstractContextManager, nullcontext

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


def _some(text: str) -> int:
    """Take a whole number above 0 from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above 0")
    return int(text)


def add_engine(command: argparse.ArgumentParser) -> None:
    """Add the options that say where work goes."""
    engines = ("processes", "serial", "dask")
    command.add_argument("--engine", choices=engines, default="processes", help="(%(default)s)")
    command.add_argument("--workers", metavar="N", type=_some, help="one per processor if left out")
    command.add_argument("--scheduler", metavar="ADDRESS", default="", help="of a Dask cluster")


def engine_of(options: argparse.Namespace) -> AbstractContextManager[None]:
    """Have the engine that was asked for, while the context lasts."""
    if options.engine == "processes" and options.workers is None:
        return nullcontext()  # as it is: nothing to be loaded
    from wormopt.numerics.workers import Engine, using

    return using(Engine(options.engine, options.workers, options.scheduler))
