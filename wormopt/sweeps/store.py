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
from collections.abc import Iterator, Mapping
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
from filelock import FileLock, Timeout

from wormopt.errors import OutputError, SceneError
from wormopt.files import hash_of
from wormopt.fingerprint import code_key
from wormopt.numerics.workers import alone
from wormopt.quantities import Scalar
from wormopt.result import Result, write_netcdf
from wormopt.runner import attempt
from wormopt.study import Scene

Keep = Literal["results", "scalars"]
Status = Literal["ok", "failed", "refused", "not computed", "unchecked"]
_JOURNAL = "journal.txt"
_HEAD = "made by wormopt: time, machine, process, point, seconds\n"
# Number of processes of one sweep that may die at a point before it fails.
_TRIES = 3


@dataclass(frozen=True)
class Record:
    """Record of a point in memory."""

    status: Status
    reason: str = ""
    scalars: Mapping[str, Scalar] = field(default_factory=dict)
    trust: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Job:
    """A requested point."""

    scene: Scene[Any]
    file: Path
    keep: Keep
    sweep: str  # that requests it
    code: str  # hash of the code to compute it


def key_of(scene: Scene[Any], seen: dict[str, bytes] | None = None) -> str:
    """Hash of everything that the result of a scene depends on: keys, code and named files.

    `seen` contains known hashes of these files, by the names in the scene.
    """
    seen = {} if seen is None else seen
    asked = msgspec.to_builtins(scene.table)
    del asked["title"]
    asked["want"] = [word for word in scene.table.wanted if word in asked["want"]]
    key = hashlib.sha256(json.dumps(asked, sort_keys=True).encode())
    key.update(code_of(scene).encode())
    for text in _texts(asked):
        if text not in seen:
            seen[text] = b"".join(hash_of(file).encode() for file in _named(text, scene.folder))
        key.update(seen[text])
    return key.hexdigest()[:32]


def code_of(scene: Scene[Any]) -> str:
    """Hash of the code that computes a scene."""
    return code_key(type(scene.table).__module__)


def faults_of(error: SceneError) -> str:
    """Describe the faults of a scene on one line."""
    return "; ".join(f"{key}: {what}" if key else what for key, what in error.faults)


def open_store(folder: Path) -> None:
    """Make or open a store; OutputError if that is impossible, or the folder is no store."""
    journal = folder / _JOURNAL
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.path.lexists(journal):
            with journal.open("x", encoding="utf-8") as file:
                file.write(_HEAD)
        elif not (journal.is_file() and journal.read_bytes().startswith(_HEAD.encode())):
            what = "is not of a store of points; choose another folder with --store"
            raise OutputError(f"{journal}: {what}")
    except FileExistsError:  # another sweep was faster, or it is a file
        if not folder.is_dir():
            raise OutputError(f"{folder}: is a file, no folder for points") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: points cannot be kept there: {why}") from error


def read(file: Path, keep: Keep) -> Record | None:
    """Read the result of a point; None if it is missing or damaged."""
    try:
        result = Result.load(file)
    except (OSError, ValueError):
        return None
    lacks_arrays = result.attributes.get("kept") == "scalars"
    return None if lacks_arrays and keep == "results" else _record(result)


def compute(job: Job) -> Record | None:
    """Compute a point, unless it is known; None if another process is computing it."""
    found = read(job.file, job.keep)
    if found is not None:
        return found
    lock, tries = job.file.with_suffix(".lock"), job.file.with_suffix(".tries")
    try:
        with FileLock(lock, timeout=0):
            found = read(job.file, job.keep) or _compute(job, tries)
            tries.unlink(missing_ok=True)
            if sys.platform != "win32":  # where open files cannot be removed
                lock.unlink(missing_ok=True)  # the process with the old lock finds the result
            return found
    except Timeout:
        return None


def _compute(job: Job, tries: Path) -> Record:
    if code_of(job.scene) != job.code:
        what = "this worker runs another version of wormopt; install the same everywhere"
        return Record("failed", what)
    start, times = time.perf_counter(), _tried(job, tries)
    if times > _TRIES:
        return Record("failed", f"the process that computes it died, {_TRIES} times")
    try:
        result = attempt(job.scene) if times == 1 else alone(attempt, job.scene)
    except BrokenExecutor:
        return Record("failed", "the process that computes it died")
    except SceneError as error:  # faults that only the study detects
        found = job.scene.table.unfinished(faults_of(error))
        result = replace(found, attributes={"refused": True})
    except Exception as error:  # a defect in one point must not cost the others
        return Record("failed", f"{type(error).__name__}: {error}; please report this")
    seconds = time.perf_counter() - start
    return _kept(job, replace(result, timings_s={**result.timings_s, "study": seconds}))


def _kept(job: Job, result: Result) -> Record:
    if key_of(job.scene) != job.file.stem:
        return Record("failed", "a file that the scene names was changed meanwhile; run it again")
    if job.keep == "scalars":
        attributes = {**result.attributes, "kept": "scalars"}
        result = replace(result, variables=(), attributes=attributes)
    unfinished = job.file.with_suffix(".part")
    write_netcdf(result, unfinished)
    unfinished.replace(job.file)
    found = _record(result)
    when = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    line = f"{when} {socket.gethostname()} {os.getpid()} {job.file.stem} {found.seconds:.3f} s\n"
    with (job.file.parent / _JOURNAL).open("a", encoding="utf-8") as journal:
        journal.write(line)
    return found


def _tried(job: Job, tries: Path) -> int:
    """How often this sweep has started the point, including now."""
    with tries.open("a+", encoding="utf-8", errors="replace") as file:
        file.write(f"{job.sweep}\n")
        file.seek(0)
        return file.read().split().count(job.sweep)


def _record(result: Result) -> Record:
    seconds = result.timings_s.get("study", 0.0)
    trust = {name: result.trust[name] for name in ("checks", "warnings") if name in result.trust}
    status = "refused" if result.attributes.get("refused") else result.status
    return Record(status, result.reason, result.scalars, trust, seconds)


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
