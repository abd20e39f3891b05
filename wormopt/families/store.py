# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false
"""Results of single points, each in a file named by a hash of its input.

A file appears when its point is done. The process that computes a point holds a lock, which the
system releases when the process dies: several processes, and machines that share the folder,
never compute a point twice.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
from filelock import FileLock
from platformdirs import user_cache_path

from wormopt.errors import OutputError
from wormopt.files import hash_of
from wormopt.fingerprint import code_key
from wormopt.result import Result, write_netcdf
from wormopt.study import Study

Keep = Literal["results", "scalars"]
_JOURNAL = "journal.txt"
_BEGUN = 2.0  # seconds for which a begun journal may lack its head
_HEAD = "made by wormopt: time, machine, process, point, seconds\n"
_ELSEWHERE = "choose another folder with --store, or with XDG_CACHE_HOME for the user's cache"


def key_of(study: Study, more: str = "", seen: dict[str, bytes] | None = None) -> str:
    """Hash of everything that a point depends on: keys, code, named files, and `more`.

    `seen` contains known hashes of these files, by the names in the scene.
    """
    seen = {} if seen is None else seen
    asked = msgspec.to_builtins(study)
    del asked["title"]
    asked["want"] = [word for word in study.wanted if word in asked["want"]]
    key = hashlib.sha256(json.dumps(asked, sort_keys=True).encode())
    key.update(f"{code_key(type(study).__module__)}{more}".encode())
    for text in _texts(asked):
        if text not in seen:
            seen[text] = b"".join(hash_of(file).encode() for file in _named(text, study.folder))
        key.update(seen[text])
    return key.hexdigest()[:32]


def _is_journal(file: Path) -> bool:
    """Whether a file begins as a journal does; another process may just be writing its head."""
    head, until = _HEAD.encode(), time.monotonic() + _BEGUN
    while (begin := file.read_bytes()[: len(head)]) != head:
        if not head.startswith(begin) or time.monotonic() > until:
            return False
        time.sleep(_BEGUN / 100)
    return True


@dataclass(frozen=True)
class Store:
    """Folder of points, which several processes and machines may share."""

    folder: Path
    keep: Keep = "results"

    def open(self) -> None:
        """Make or open it; OutputError if that is impossible, or the folder is no store."""
        folder, journal = self.folder, self.folder / _JOURNAL
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not os.path.lexists(journal):
                with journal.open("x", encoding="utf-8") as file:
                    file.write(_HEAD)
            elif not (journal.is_file() and _is_journal(journal)):
                raise OutputError(f"{journal}: does not belong to a store of points; {_ELSEWHERE}")
        except FileExistsError:  # another process was faster, or it is a file
            if not folder.is_dir():
                what = f"{folder}: is a file, not a folder for points; {_ELSEWHERE}"
                raise OutputError(what) from None
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            what = f"{folder}: points cannot be stored there: {why}; {_ELSEWHERE}"
            raise OutputError(what) from error

    def file(self, key: str) -> Path:
        """File of a point."""
        return self.folder / f"{key}.nc"

    def read(self, key: str) -> Result | None:
        """Read a point; None if it is missing, damaged, or without the arrays that are kept."""
        try:
            result = Result.load(self.file(key))
        except (OSError, ValueError):
            return None
        lacks_arrays = result.attributes.get("kept") == "scalars"
        return None if lacks_arrays and self.keep == "results" else result

    @contextmanager
    def held(self, key: str, wait: float = -1) -> Generator[None]:
        """Hold the lock of a point; filelock.Timeout after `wait` seconds, never if negative."""
        lock = self.file(key).with_suffix(".lock")
        with FileLock(lock, timeout=wait):
            try:
                yield
            finally:
                if sys.platform != "win32":  # where open files cannot be removed
                    lock.unlink(missing_ok=True)  # the process with the old lock finds the result

    def write(self, key: str, result: Result, seconds: float) -> Result:
        """Keep a point, whole or not at all, and record it in the journal."""
        if self.keep == "scalars":
            attributes = {**result.attributes, "kept": "scalars"}
            result = replace(result, variables=(), attributes=attributes)
        unfinished = self.file(key).with_suffix(".part")
        write_netcdf(result, unfinished)
        unfinished.replace(self.file(key))
        when = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        line = f"{when} {socket.gethostname()} {os.getpid()} {key} {seconds:.3f} s\n"
        with (self.folder / _JOURNAL).open("a", encoding="utf-8") as journal:
            journal.write(line)
        return result

    def result(self, key: str, work: Callable[[], Result]) -> Result:
        """Read a point, or compute it here; an error of the work keeps nothing."""
        self.open()
        with self.held(key):
            found, start = self.read(key), time.perf_counter()
            return found or self.write(key, work(), time.perf_counter() - start)

    def forget(self, keys: Iterable[str]) -> None:
        """Remove points."""
        for key in keys:
            with suppress(OSError):
                self.file(key).unlink()


def checkpoints() -> Store:
    """Store in the user's cache folder, for points of studies that are not finished."""
    return Store(user_cache_path("wormopt") / "checkpoints")


def _texts(value: Any) -> Iterator[str]:
    """Texts in plain data."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _named(text: str, folder: Path) -> list[Path]:
    """Files named by a text, relative to a folder."""
    try:
        named = folder / text
        own = folder / text.rpartition(":")[0]  # of "model.py:function"
        return [path for path in (named, named / "result.nc", own) if path.is_file()]
    except (OSError, ValueError):  # not a valid file name
        return []
