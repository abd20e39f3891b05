# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false
"""Studies computed in parallel, each once; a point without a solution is data with a reason."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from filelock import Timeout

from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.families.store import Store, key_of
from wormopt.numerics.workers import alone, each
from wormopt.progress import Report
from wormopt.quantities import Scalar
from wormopt.result import Result
from wormopt.study import Study

Status = Literal["ok", "failed", "refused", "not computed", "unchecked"]
Work = Callable[[Any], Result]
"""Computes a study; it is sent to other processes."""
# Number of processes of one run that may die at a point before it fails.
_TRIES = 3
# Seconds between checks of points that another process computes.
_PATIENCE = 1.0
# For fast steps, number of points between reports.
_SELDOM = 1000
_CHANGED = (
    "a file named in the scene has changed during the sweep, or this worker has another version of "
    "wormopt; install the same version everywhere, and run the sweep again"
)
T = TypeVar("T")


@dataclass(frozen=True)
class Point:
    """Outcome of a study without arrays, with a reason if it failed."""

    status: Status
    reason: str = ""
    scalars: Mapping[str, Scalar] = field(default_factory=dict)
    trust: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    key: str = ""  # in the store; empty if the point is not one of it
    is_new: bool = False  # computed now, not read from the store

    @property
    def is_poor(self) -> bool:
        """Whether its numbers do not count."""
        return self.status not in ("ok", "unchecked")

    @classmethod
    def of(cls, key: str, result: Result, *, is_new: bool = True) -> Point:
        """Point of a result."""
        seconds = result.timings_s.get("study", 0.0)
        trust = {n: result.trust[n] for n in ("checks", "warnings") if n in result.trust}
        status = "refused" if result.attributes.get("refused") else result.status
        return cls(status, result.reason, result.scalars, trust, seconds, key, is_new)


def points(
    studies: Sequence[Study], work: Work, store: Store, report: Report, text: str = ""
) -> list[Point]:
    """Points of studies, in their order; those in the store are read, the others computed.

    They are computed in rounds, because another process may be computing a point. `text` names the
    purpose in reports.
    """
    store.open()
    seen: dict[str, bytes] = {}
    keys = [key_of(study, seen=seen) for study in followed(studies, report, "prepared")]
    by_key = dict(zip(keys, studies, strict=True))
    found = _known(by_key, store, report)
    run, poor = secrets.token_hex(8), sum(point.is_poor for point in found.values())

    def partly() -> list[Point]:
        # processes may have kept points without returning them
        known = _known(by_key.keys() - found.keys(), store, report) | found
        return [known.get(key) or Point("not computed", key=key) for key in keys]

    try:
        while todo := [key for key in by_key if key not in found]:
            jobs = [Job(by_key[key], key, work, store, run) for key in todo]
            for k, point in each(compute, jobs):
                if point is not None:
                    found[todo[k]] = point
                    poor += point.is_poor
                done = f"{text}{len(found)} of {len(by_key)} points"
                report(f"{done}, {poor} failed" if poor else done, len(found) / len(by_key))
            if len(found) < len(by_key):
                time.sleep(_PATIENCE)
    except KeyboardInterrupt:
        raise Interrupted(partly()) from None
    except SolveError as error:  # the cluster is gone
        raise SolveError(error.reason, error.suggestion, partly(), error.code) from None
    return [found[key] for key in keys]


def followed(items: Sequence[T], report: Report, what: str) -> Iterator[T]:
    """Report progress after every so many items."""
    for k, item in enumerate(items):
        if k % _SELDOM == 0:
            report(f"{k} of {len(items)} points {what}", k / len(items))
        yield item


def _known(keys: Iterable[str], store: Store, report: Report) -> dict[str, Point]:
    """Points in the store."""
    there = {file.stem for file in store.folder.glob("*.nc")}
    there = [key for key in keys if key in there]
    read = ((key, store.read(key)) for key in followed(there, report, "looked up"))
    return {key: Point.of(key, result, is_new=False) for key, result in read if result}


@dataclass(frozen=True)
class Job:
    """A requested point."""

    study: Study
    key: str
    work: Work
    store: Store
    run: str  # that requests it


def compute(job: Job) -> Point | None:
    """Compute a point, unless it is known; None if another process is computing it."""
    store, tries = job.store, job.store.file(job.key).with_suffix(".tries")
    try:
        with store.held(job.key, wait=0):
            found = store.read(job.key)
            point = Point.of(job.key, found) if found else _computed(job, tries)
            tries.unlink(missing_ok=True)
            return point
    except Timeout:
        return None
    except OSError as error:
        why = f"{store.folder}: points cannot be stored there: {error.strerror}"
        return Point("failed", why, key=job.key, is_new=True)


def _computed(job: Job, tries: Path) -> Point:
    lost, start = partial(Point, "failed", key=job.key, is_new=True), time.perf_counter()
    if key_of(job.study) != job.key:
        return lost(_CHANGED)
    times = _tried(job, tries)
    if times > _TRIES:
        return lost(f"the process that computes it died, {_TRIES} times")
    try:
        result = _attempt(job) if times == 1 else alone(_attempt, job)
    except BrokenExecutor:
        return lost("the process that computes it died")
    except Exception as error:  # a defect in one point must not cost the others
        return lost(f"{type(error).__name__}: {error}; please report this")
    if key_of(job.study) != job.key:
        return lost(_CHANGED)
    seconds = time.perf_counter() - start
    result = replace(result, timings_s={**result.timings_s, "study": seconds})
    return Point.of(job.key, job.store.write(job.key, result, seconds))


def _attempt(job: Job) -> Result:
    """Do the work; a study without a solution, or a refused one, gives a result too."""
    try:
        return job.work(job.study)
    except SolveError as error:
        return job.study.unfinished(str(error))
    except SceneError as error:
        found = job.study.unfinished(faults_of(error))
        return replace(found, attributes={"refused": True})


def faults_of(error: SceneError) -> str:
    """Describe the faults of a scene on one line."""
    return "; ".join(f"{key}: {what}" if key else what for key, what in error.faults)


def _tried(job: Job, tries: Path) -> int:
    """Count the starts of the point by this run, including this one."""
    with tries.open("a+", encoding="utf-8", errors="replace") as file:
        file.write(f"{job.run}\n")
        file.seek(0)
        return file.read().split().count(job.run)
