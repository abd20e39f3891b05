"""The command line: its modules add commands to the parser and run them.

Exit codes: 0 done; 2 bad input; 3 the solver did not reach an accepted result; 130 interrupted.
Results go to stdout, everything else to stderr. There is no ``--verbose`` for all commands: ``run
--all`` prints the whole result, and ``run --verbose`` the time of each stage.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import current_thread, main_thread
from types import FrameType

from wormopt.cli import results, running, scenes
from wormopt.cli.common import BAD_INPUT, DONE, INTERRUPTED, no_backend, say
from wormopt.errors import ArgumentError, OutputError, SceneError, interruptible
from wormopt.version import VERSION


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (by default of the process) and return the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal whose encoding has no λ shows its code, and the program does not end.
        sys.stdout.reconfigure(errors="backslashreplace")
    options = None
    try:
        with _asked_to_end(), interruptible():
            options, stray = parser().parse_known_args(arguments)
            if stray:
                options.own.error(_stray(options, stray))
            return options.command(options)
    except SceneError as error:
        typed = getattr(options, "scene", "")  # name the file as the user wrote it
        say(str(SceneError(typed, error.faults) if Path(typed).stem == error.file else error))
        return BAD_INPUT
    except (OutputError, ArgumentError) as error:
        say(str(error))
        return BAD_INPUT
    except KeyboardInterrupt:
        say("interrupted; nothing saved")
        return INTERRUPTED
    except (ValueError, ImportError) as error:
        if not (message := no_backend(error)):
            raise
        say(message)
        return BAD_INPUT
    except OSError as error:  # a name too long, a full disk
        if _nobody_reads(error):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return DONE
        say(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        return BAD_INPUT


def _nobody_reads(error: OSError) -> bool:
    """Return whether the reader closed our output; Windows reports this as EINVAL."""
    if sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None:
        return True
    return isinstance(error, BrokenPipeError)


def _stray(options: argparse.Namespace, words: list[str]) -> str:
    """Write the message about unknown arguments, with a hint if one is a key of a scene."""
    message = f"unrecognized arguments: {' '.join(words)}"
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or word.startswith("-"):
            continue
        if hasattr(options, "over"):
            values = f"[{value}]" if "," in value and not value.startswith("[") else value
            return f"{message}; --over gives the values of a key: write --over '{key}={values}'"
        if hasattr(options, "set"):
            return f"{message}; --set changes a key: write --set '{word}'"
    return message


@contextmanager
def _asked_to_end() -> Iterator[None]:
    """Let SIGTERM end like Ctrl-C: results are kept, and no processes are left behind."""
    if current_thread() is not main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def end(_number: int, frame: FrameType | None) -> None:
        interrupt = signal.getsignal(signal.SIGINT)
        if not callable(interrupt):  # a background process ignores SIGINT
            raise KeyboardInterrupt
        interrupt(signal.SIGINT, frame)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def parser() -> argparse.ArgumentParser:
    """Make the parser of all commands."""
    found = argparse.ArgumentParser(
        prog="wormopt",
        description="Design, simulation and optimal control of worm-like locomotion systems.",
        epilog="exit codes: 0 done, 2 bad input, 3 no accepted result, 130 interrupted",
        allow_abbrev=False,
    )
    found.add_argument("--version", action="version", version=f"wormopt {VERSION}")
    found.set_defaults(parser=found)  # `wormopt completion` reads all commands from it
    commands = found.add_subparsers(title="commands", metavar="COMMAND", required=True)
    adding = (
        *(running.add_run, running.add_sweep),
        *(results.add_show, results.add_verify, results.add_plot),
        *(results.add_report, results.add_export),
        *(scenes.add_list, scenes.add_help, scenes.add_completion),
    )
    for add in adding:
        add(commands)
    for command in commands.choices.values():
        command.set_defaults(own=command)
    return found
