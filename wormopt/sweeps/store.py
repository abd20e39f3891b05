"""Results of single points, each kept in a file that is named by what was asked for.

A file appears when its point is done, and not before. Whoever is at work on a point holds a lock,
which the system takes away when the process dies: several processes, and machines that share the
folder, never compute a point twice.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import current_process
from pathlib import Path
from typing import Any, Literal

from filelock import FileLock, Timeout
from msgspec import Struct

from wormopt.errors import OutputError, SceneError
from wormopt.files import MARK, is_marked
from wormopt.fingerprint import code_key
from wormopt.kinds import KINDS
from wormopt.quantities import Scalar
from wormopt.result import Result
from wormopt.runner import attempt
from wormopt.saving import write_netcdf
from wormopt.scene import Scene

Keep = Literal["results", "scalars"]
Status = Literal["ok", "failed", "refused", "not computed"]
_JOURNAL = "journal.txt"
# A point at which so many processes of one sweep died is not tried again.
_TRIES = 3


@dataclass(frozen=True)
class Record:
    """What a sweep keeps in mind of a point."""

    status: Status
    reason: str = ""
    scalars: Mapping[str, Scalar] = field(default_factory=dict)
    trust: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Job:
    """A point that is asked for."""

    scene: Scene[Any]
    file: Path
    keep: Keep
    sweep: str  # which one asks


def key_of(scene: Scene[Any], keep: Keep) -> str:
    """Hash of all that the result of a scene hangs on: its keys, the code, files that it names."""
    asked = {name: value for name, value in json.loads(scene.text).items() if name != "title"}
    key = hashlib.sha256(f"{keep} {json.dumps(asked)}".encode())
    key.update(code_key(KINDS[scene.table.kind].study).encode())
    for file in _files(scene.table, scene.folder):
        key.update(file.read_bytes())
    return key.hexdigest()[:32]


def open_store(folder: Path) -> None:
    """Have a store there; OutputError if it cannot be, or if what stands there is none."""
    journal = folder / _JOURNAL
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.path.lexists(journal):
            with journal.open("x", encoding="utf-8") as file:
                file.write(f"{MARK.decode()}: time, machine, process, point, seconds\n")
        elif not is_marked(journal):
            what = "is not of a store of points; choose another folder with --store"
            raise OutputError(f"{journal}: {what}")
    except FileExistsError:  # another sweep was faster, or it is a file
        if not folder.is_dir():
            raise OutputError(f"{folder}: is a file, no folder for points") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: points cannot be kept there: {why}") from error


def read(file: Path) -> Record | None:
    """Read back what is known of a point; None where there is no result, or a damaged one."""
    try:
        return _record(Result.load(file))
    except (OSError, ValueError):
        return None


def compute(job: Job) -> Record | None:
    """Compute a point, unless it is known; None where another process is at it."""
    found = read(job.file)
    if found is not None:
        return found
    lock, tries = job.file.with_suffix(".lock"), job.file.with_suffix(".tries")
    try:
        with FileLock(lock, timeout=0):
            found = read(job.file) or _compute(job, tries)
            tries.unlink(missing_ok=True)
            lock.unlink(missing_ok=True)  # whoever holds the old one finds the result
            return found
    except Timeout:
        return None


def _compute(job: Job, tries: Path) -> Record:
    start, times = time.perf_counter(), _tried(job, tries)
    if times > _TRIES:
        return Record("failed", f"the process that computes it died, {_TRIES} times")
    try:
        result = attempt(job.scene) if times == 1 else _alone(job.scene)
    except BrokenExecutor:
        return Record("failed", "the process that computes it died")
    except SceneError as error:  # what only the study sees
        return Record("refused", "; ".join(f"{key}: {what}" for key, what in error.faults))
    except Exception as error:  # a defect in one point must not cost the others
        return Record("failed", f"{type(error).__name__}: {error}; please report this")
    seconds = time.perf_counter() - start
    return _kept(job, replace(result, timings_s={**result.timings_s, "study": seconds}))


def _alone(scene: Scene[Any]) -> Result:
    """Run a scene in a process of its own: whether it is this point that processes die at."""
    if current_process().daemon:  # may have no processes
        return attempt(scene)
    from loky import ProcessPoolExecutor

    with ProcessPoolExecutor(1) as process:
        return process.submit(attempt, scene).result()


def _kept(job: Job, result: Result) -> Record:
    if key_of(job.scene, job.keep) != job.file.stem:
        return Record("failed", "a file that the scene names was changed meanwhile; run it again")
    if job.keep == "scalars":
        result = replace(result, variables=())
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
    """How often this sweep has begun the point, this time included."""
    with tries.open("a+", encoding="utf-8", errors="replace") as file:
        file.write(f"{job.sweep}\n")
        file.seek(0)
        return file.read().split().count(job.sweep)


def _record(result: Result) -> Record:
    seconds = result.timings_s.get("study", 0.0)
    trust = {name: result.trust[name] for name in ("checks", "warnings") if name in result.trust}
    return Record(result.status, result.reason, result.scalars, trust, seconds)


def _files(value: Any, folder: Path) -> Iterator[Path]:
    """Files that a table names, relative to its scene's folder."""
    if isinstance(value, Struct):
        for name in value.__struct_fields__:
            yield from _files(getattr(value, name), folder)
    elif isinstance(value, tuple):
        for item in value:
            yield from _files(item, folder)
    elif isinstance(value, str) and value:
        try:
            named = folder / value
            own = folder / value.rpartition(":")[0]  # of "model.py:function"
            yield from (path for path in (named, named / "result.nc", own) if path.is_file())
        except (OSError, ValueError):  # no name that a file could have
            return
