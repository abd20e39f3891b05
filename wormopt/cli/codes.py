"""Exit codes, messages and common options of the command line."""

import argparse
import os
import sys
from contextlib import AbstractContextManager, nullcontext

from wormopt.errors import ArgumentError
from wormopt.kinds import KINDS, near

DONE, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 2, 3, 130


def say(text: str) -> None:
    """Print a message that is not a result, on stderr."""
    print(text, file=sys.stderr)


def check_backend(hint: str = "") -> None:
    """Raise ArgumentError if Matplotlib refuses the backend that MPLBACKEND names.

    `hint` is another way out, for the message. Without MPLBACKEND nothing is loaded.
    """
    if os.environ.get("MPLBACKEND"):
        try:
            import matplotlib  # noqa: F401
        except (ValueError, ImportError) as error:
            raise ArgumentError(no_backend(error, hint)) from None


def no_backend(error: Exception, hint: str = "") -> str:
    """Write the message for a backend that Matplotlib refuses; "" for any other error."""
    name = os.environ.get("MPLBACKEND", "")
    if not name or "backend" not in str(error):
        return ""
    return (
        f"MPLBACKEND={name}: Matplotlib has no such backend, or it is not installed; write "
        f"MPLBACKEND=agg, or unset it{hint}"
    )


def kind_name(name: str) -> str:
    """Return a kind of scene from the command line; the error suggests a similar name."""
    if name in KINDS:
        return name
    close = near(name)
    hint = f"did you mean {close}? " if close else ""
    what = f"there is no kind of scene {name!r}; {hint}`wormopt list` shows all kinds"
    raise argparse.ArgumentTypeError(what)


def _some(text: str) -> int:
    """Return a positive whole number from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive whole number; write 4, say")
    return int(text)


def add_changes(command: argparse.ArgumentParser) -> None:
    """Add the option for keys that differ from the scene."""
    command.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change a key of the scene, such as worm.load=12; may be repeated",
    )


def add_engine(command: argparse.ArgumentParser) -> None:
    """Add the options for parallel work."""
    engines = ("processes", "serial", "dask")
    command.add_argument(
        "--engine",
        choices=engines,
        default="processes",
        help="where parallel work runs: processes of this machine, this process alone, or a "
        "Dask cluster (default: %(default)s)",
    )
    command.add_argument(
        "--workers",
        metavar="N",
        type=_some,
        help="number of parallel workers (default: one per processor)",
    )
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        default="",
        help="address of a running Dask cluster, for --engine dask (default: start one)",
    )


def engine_of(options: argparse.Namespace) -> AbstractContextManager[None]:
    """Return a context in which parallel work runs on the engine asked for."""
    if options.engine == "processes" and options.workers is None:
        return nullcontext()  # the default needs no import
    from wormopt.numerics.workers import Engine, using

    return using(Engine(options.engine, options.workers, options.scheduler))
