"""Exit codes, and how the command line speaks and understands."""

import argparse
import os
import sys
from contextlib import AbstractContextManager, nullcontext

from wormopt.errors import ArgumentError
from wormopt.kinds import KINDS, near

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def say(text: str) -> None:
    """Tell the user something that is no result."""
    print(text, file=sys.stderr)


def check_backend(hint: str = "") -> None:
    """Raise ArgumentError if Matplotlib refuses the backend that MPLBACKEND names.

    `hint` is what else can be written. Without MPLBACKEND nothing is loaded.
    """
    if os.environ.get("MPLBACKEND"):
        try:
            import matplotlib  # noqa: F401
        except (ValueError, ImportError) as error:
            raise ArgumentError(no_backend(error, hint)) from None


def no_backend(error: Exception, hint: str = "") -> str:
    """Say that Matplotlib refuses its backend; "" if the error is about something else."""
    name = os.environ.get("MPLBACKEND", "")
    if not name or "backend" not in str(error):
        return ""
    return (
        f"MPLBACKEND={name}: Matplotlib has no such backend, or it is not installed; write "
        f"MPLBACKEND=agg, or unset it{hint}"
    )


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
