"""Errors, whose messages say what to change.

All errors that a user can cause or must act on derive from `WormoptError`; any other exception is
a defect of the package.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from _thread import start_new_thread
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import StringIO
from threading import current_thread, main_thread
from types import FrameType
from typing import Any

Fault = tuple[str, str]
"""Key path in the scene ("gait.period", or "" for the whole file) and its fault."""


class WormoptError(Exception):
    """Base of every error the package raises on purpose.

    Examples
    --------
    >>> import wormopt as wo
    >>> try:
    ...     wo.load_scene("no_such_scene")
    ... except wo.WormoptError as error:
    ...     print(type(error).__name__)
    SceneError
    """


class ArgumentError(WormoptError, ValueError, TypeError):
    """A Python argument with an unusable value or type.

    Examples
    --------
    >>> isinstance(ArgumentError("mass must be positive, not -1"), ValueError)
    True
    """


class UnknownNameError(ArgumentError, KeyError):
    """A name that is not there; the message suggests one that may be meant, and lists all.

    Parameters
    ----------
    where : str
        Object without this name.
    what : str
        Type of the named thing, for example "state".
    unknown : iterable of str
        The unknown names.
    known : iterable of str
        Existing names.
    hint : str, optional
        Further advice at the end of the message.

    Examples
    --------
    >>> print(UnknownNameError("the motion", "state", ["speed"], ["position", "velocity"]))
    the motion has no state 'speed'; it has 'position', 'velocity'
    """

    def __init__(
        self,
        where: str,
        what: str,
        unknown: Iterable[object],
        known: Iterable[object],
        hint: str = "",
    ) -> None:
        unknown, known = list(unknown), list(known)
        asked, there = (", ".join(map(repr, names)) for names in (unknown, known))
        meant = _meant(unknown, known)
        listed = f"did you mean {meant!r}? It has" if meant else "it has"
        self.message = f"{where} has no {what} {asked}; {listed} {there or 'none'}"
        self.message += f"; {hint}" if hint else ""
        super().__init__(self.message)

    # KeyError would put the message in quotes.
    def __str__(self) -> str:
        return self.message


def _meant(unknown: list[object], known: list[object]) -> object:
    """Name that is similar to the first unknown one; None if there is none."""
    from difflib import get_close_matches  # not imported unless needed

    names = {str(name): name for name in known}
    close = get_close_matches(str(unknown[0]), names, n=1) if unknown else []
    return names[close[0]] if close else None


class SceneError(WormoptError):
    """A scene that cannot be used, with everything that is wrong with it.

    Parameters
    ----------
    file : str
        The scene as the user named it.
    faults : iterable of (str, str)
        Key path and message of each fault; the key path is "" where the file as a whole is meant.

    Examples
    --------
    >>> print(SceneError("a.toml", [("worm.mass", "-1 is not allowed; write a positive number")]))
    a.toml: worm.mass: -1 is not allowed; write a positive number
    """

    def __init__(self, file: str, faults: Iterable[Fault]) -> None:
        self.file = file
        self.faults: tuple[Fault, ...] = tuple(faults)
        super().__init__(file, self.faults)

    def __str__(self) -> str:
        return "\n".join(
            _printable(f"{self.file}: {key}: {message}" if key else f"{self.file}: {message}")
            for key, message in self.faults
        )


def _printable(text: str) -> str:
    """Escape letters of file texts that terminals mangle or interpret."""
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in text)


class OutputError(WormoptError):
    """The output folder cannot be used; the message says why."""


class SolveError(WormoptError):
    """The solver did not reach an accepted result.

    Parameters
    ----------
    reason : str
        Cause, in terms of the scene (never a bare solver message).
    suggestion : str
        Remedy.
    partial : Result or Trajectory, optional
        Results so far; a Result is saved, marked as failed.
    code : str, optional
        The reason in one word for programs, "step_too_small" say.

    Examples
    --------
    >>> print(SolveError("no gait meets gait.spike_load", "allow at least 15.2"))
    no gait meets gait.spike_load; allow at least 15.2
    """

    # `Any`, because errors are the lowest layer and may not import Result.
    def __init__(
        self, reason: str, suggestion: str = "", partial: Any = None, code: str = ""
    ) -> None:
        self.reason = reason
        self.suggestion = suggestion
        self.partial = partial
        self.code = code
        super().__init__(reason, suggestion, partial, code)

    def __str__(self) -> str:
        return f"{self.reason}; {self.suggestion}" if self.suggestion else self.reason


class Interrupted(KeyboardInterrupt):
    """The user stopped a study or a simulation that has partial results.

    A KeyboardInterrupt, so handlers of errors do not catch it.

    Parameters
    ----------
    partial : Result, Trajectory or Ensemble, optional
        Results so far; a Result is saved, marked as failed.

    Examples
    --------
    A long run can be stopped with Ctrl-C; what was found so far is kept:

    >>> import wormopt as wo
    >>> try:
    ...     result = wo.run("design_fast_gait")  # doctest: +SKIP
    ... except wo.Interrupted as stopped:
    ...     result = stopped.partial
    """

    def __init__(self, partial: Any = None) -> None:
        self.partial = partial
        super().__init__(partial)

    def __str__(self) -> str:
        return "interrupted"


@contextmanager
def interruptible() -> Iterator[None]:
    """Let the user's interrupt pass code that would swallow it or convert it to another error."""
    before = signal.getsignal(signal.SIGINT)
    if current_thread() is not main_thread() or not callable(before):
        yield
        return
    heard: list[int] = []
    stderr = sys.stderr

    def hear(number: int, frame: FrameType | None) -> None:
        if _is_swallowed(frame):
            start_new_thread(_send_again, (number,))
            return
        heard.append(number)
        try:
            before(number, frame)
        except KeyboardInterrupt:
            if frame and _is_casadi(frame):
                sys.stderr = StringIO()  # suppresses CasADi's messages about failed integrators
            raise

    signal.signal(signal.SIGINT, hear)
    try:
        yield
    except RuntimeError:
        if heard:
            raise KeyboardInterrupt from None
        raise
    finally:
        signal.signal(signal.SIGINT, before)
        if heard:
            sys.stderr = stderr


def _is_swallowed(frame: FrameType | None) -> bool:
    """Whether an error raised now may be lost."""
    # Imports of compiled modules lose it, and so does CasADi while it checks arguments in Python,
    # but not during computations, which may take long.
    if frame and all(_is_casadi(f) for f in (frame, frame.f_back) if f):
        return frame.f_code.co_name != "call"
    while frame and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    return frame is not None


def _is_casadi(frame: FrameType) -> bool:
    return frame.f_code.co_filename.endswith("casadi.py")


def _send_again(number: int) -> None:
    time.sleep(0.005)
    if sys.platform == "win32":  # os.kill would end the process for any signal
        signal.raise_signal(number)
    else:
        os.kill(os.getpid(), number)  # raise_signal would wake no other thread
