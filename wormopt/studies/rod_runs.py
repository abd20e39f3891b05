"""Many motions of rods side by side, each kept as soon as it is done, so that nothing is lost."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.studies.rod_parts import RodCase, follow, segment_length

__all__ = ["RodPoint", "kept", "rod_points"]


@dataclass(frozen=True)
class RodPoint:
    """What one motion comes to.

    Parameters
    ----------
    rate : float
        Switches per second.
    velocity, error : float
        Mean velocity, positive with the field, and its standard error, in m/s; NaN where the
        motion was lost.
    energy_error : float
        Of the balance, over the work of the field.
    penetration : float
        Into the walls, in m.
    arc_length : float
        Of a segment just before coils change, in m; NaN where the rod never lay over a block.
    seconds : float
        Spent.
    reason : str
        Why the motion was lost; empty otherwise.
    """

    rate: float
    velocity: float
    error: float
    energy_error: float
    penetration: float
    arc_length: float
    seconds: float
    reason: str = ""


def rod_points(cases: Sequence[RodCase], folder: Path, report: Report, text: str) -> list[RodPoint]:
    """Follow several rods, on all cores, and keep what is done.

    Parameters
    ----------
    cases : sequence of RodCase
        What moves.
    folder : Path
        Where to keep what is done, and where it may be already.
    report : callable
        Told how far it is.
    text : str
        What it is for.

    Returns
    -------
    list of RodPoint
        In the order of the cases.

    Raises
    ------
    KeyboardInterrupt
        If the user stops it; what is done is in the folder.
    """
    todo = sorted({case for case in cases if kept(case, folder) is None}, key=lambda c: c.rate)
    # CasADi holds the interpreter's lock, so threads would not help.
    from loky import get_reusable_executor

    if todo:
        workers = min(len(todo), os.cpu_count() or 1)
        executor = get_reusable_executor(max_workers=workers, timeout=60)
        report(text, 0.0)
        try:
            futures = [executor.submit(_follow_and_keep, case, folder) for case in todo]
            for done, future in enumerate(as_completed(futures), start=1):
                future.result()
                report(text, done / len(todo))
        except KeyboardInterrupt:
            executor.shutdown(wait=False, kill_workers=True)
            raise
    found = [kept(case, folder) for case in cases]
    return [point for point in found if point is not None]


def kept(case: RodCase, folder: Path) -> RodPoint | None:
    """Read what a motion came to.

    Parameters
    ----------
    case : RodCase
        What moved.
    folder : Path
        Where motions are kept.

    Returns
    -------
    RodPoint or None
        None where it is not there, or damaged.
    """
    with suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode(_file(case, folder).read_bytes(), type=RodPoint)
    return None


def _file(case: RodCase, folder: Path) -> Path:
    return folder / f"{hashlib.sha256(case.key.encode()).hexdigest()[:32]}.json"


def _follow_and_keep(case: RodCase, folder: Path) -> None:
    try:
        course = follow(case)
        point = RodPoint(
            case.rate, course.velocity, course.velocity_error, course.energy_error,
            course.penetration, segment_length(case, course), course.seconds,
        )  # fmt: skip
    except SolveError as lost:
        unknown = float("nan")
        point = RodPoint(case.rate, unknown, unknown, unknown, unknown, unknown, 0.0, str(lost))
    file = _file(case, folder)
    folder.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(f".{os.getpid()}")
    unfinished.write_bytes(msgspec.json.encode(point))
    unfinished.replace(file)
