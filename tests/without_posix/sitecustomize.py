"""Python as it is on Windows, as seen by wormopt; every process of a test begins with it.

What wormopt imports lacks what only POSIX has, its `sys.platform` is that of Windows, and it can
neither replace nor remove what this process has open. All else is left alone: loky and the standard
library themselves take the ways of the system that this is.
"""

import builtins
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

_LACKING = {
    os: "fork forkpty register_at_fork getuid geteuid getgid getegid getpgid killpg setsid chown "
    "fchmod mkfifo nice getloadavg sched_getaffinity sched_setaffinity uname wait waitid",
    signal: "SIGKILL SIGHUP SIGUSR1 SIGUSR2 SIGALRM SIGPIPE SIGCHLD SIG_BLOCK SIG_UNBLOCK "
    "SIG_SETMASK pthread_sigmask pthread_kill alarm setitimer sigwait siginterrupt",
    time: "tzset clock_gettime clock_settime pthread_getcpuclockid",
    multiprocessing: "",
    sys: "",
}
_ABSENT = "fcntl grp pwd resource termios tty pty syslog curses readline".split()


class _Seen(ModuleType):
    """A module as on Windows."""

    def __init__(self, module: ModuleType, lacking: str, own: Mapping[str, Any]) -> None:
        super().__init__(module.__name__)
        self.__dict__.update(own, _module=module, _lacking=lacking.split())

    def __getattr__(self, name: str) -> Any:
        if name in self._lacking:
            raise AttributeError(f"{self.__name__}.{name}: Windows has no such thing")
        return getattr(self._module, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._module, name, value)


class _Parent:
    """The process that began this one; loky tells of it on Windows only."""

    def join(self) -> None:
        parent = os.getppid()
        while os.getppid() == parent:
            time.sleep(0.1)


def _kill(process: int, number: int) -> None:
    """End a process, whatever the signal."""
    os.kill(process, signal.SIGKILL)


def _is_wormopt(names: Mapping[str, Any]) -> bool:
    return (names.get("__package__") or "").partition(".")[0] == "wormopt"


def _is_open(path: Path) -> bool:
    """Whether this process has a file open, or one in a folder."""
    there = str(path.resolve())
    known = [os.path.realpath(link) for link in Path("/proc/self/fd").iterdir()]
    maps = os.fsdecode(Path("/proc/self/maps").read_bytes())
    known += [line.split(maxsplit=5)[-1] for line in maps.splitlines()]
    return any(name == there or name.startswith(f"{there}/") for name in known)


def _asks(frame: FrameType | None) -> bool:
    """Whether wormopt asks, through the standard library or not."""
    while frame and frame.f_globals.get("__name__", "").partition(".")[0] in ("pathlib", "shutil"):
        frame = frame.f_back
    return frame is not None and _is_wormopt(frame.f_globals)


def _refusing(call: Callable[..., Any]) -> Callable[..., Any]:
    def refusing(*paths: Any, dir_fd: int | None = None, **others: Any) -> Any:
        if dir_fd is not None:
            others["dir_fd"] = dir_fd
        elif _asks(sys._getframe(1)):
            for path in paths:
                if _is_open(Path(path)):
                    raise PermissionError(13, "The process cannot access the file", str(path))
        return call(*paths, **others)

    return refusing


if sys.platform != "win32":
    _own = {os: {"kill": _kill}, sys: {"platform": "win32"}}
    _own[multiprocessing] = {"parent_process": _Parent}
    _seen = {m.__name__: _Seen(m, names, _own.get(m, {})) for m, names in _LACKING.items()}
    _import = builtins.__import__

    def _imported(name: str, names: Any = None, *others: Any, **named: Any) -> ModuleType:
        if _is_wormopt(names or {}):
            if name in _ABSENT:
                raise ModuleNotFoundError(f"{name}: Windows has no such module")
            if name in _seen:
                return _seen[name]
        return _import(name, names, *others, **named)

    builtins.__import__ = _imported
    for _name in ("replace", "rename", "unlink", "remove"):
        setattr(os, _name, _refusing(getattr(os, _name)))
