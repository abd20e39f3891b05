"""Many motions of rods side by side, each kept as soon as it is done, so that nothing is lost."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from concurrent.futures import as_completed
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.systems.channel.runs.rod_case import RodCase
from wormopt.systems.channel.runs.rod_course import RodPoint, follow
from wormopt.systems.shared.checkpoints import forget as forget_file
from wormopt.systems.shared.checkpoints import keep


def rod_points(cases: Sequence[RodCase], folder: Path, report: Report, text: str) -> list[RodPoint]:
    """Follow several rods on all cores, in the order of `cases`; `text` says what for.

    Motions in `folder` are reused and new ones kept there, also on KeyboardInterrupt.
    """
    found = {case: point for case in cases if (point := kept(case, folder))}
    # the slowest switching takes longest
    todo = sorted({case for case in cases if case not in found}, key=lambda case: case.rate)
    if todo:
        # CasADi holds the interpreter's lock, so threads would not help.
        from loky import get_reusable_executor

        workers = min(len(todo), os.cpu_count() or 1)
        executor = get_reusable_executor(max_workers=workers, timeout=60)
        already = len(set(cases)) - len(todo)
        report(text, already / (already + len(todo)))
        try:
            futures = {executor.submit(_follow_and_keep, case, folder): case for case in todo}
            for done, future in enumerate(as_completed(futures), start=1):
                found[futures[future]] = future.result()
                report(text, (already + done) / (already + len(todo)))
        except KeyboardInterrupt:
            executor.shutdown(wait=False, kill_workers=True)
            raise
    return [found[case] for case in cases]


def kept(case: RodCase, folder: Path) -> RodPoint | None:
    """Read the outcome of a motion from `folder`; None if missing or damaged."""
    with suppress(OSError, ValueError, TypeError):
        return RodPoint(**json.loads(_file(case, folder).read_text(encoding="utf-8")))
    return None


def forget(cases: Sequence[RodCase], folder: Path) -> None:
    """Remove kept motions from `folder`, because they stand in a result now."""
    for case in cases:
        forget_file(_file(case, folder))


def _file(case: RodCase, folder: Path) -> Path:
    return folder / f"{hashlib.sha256(case.key.encode()).hexdigest()[:32]}.json"


def _follow_and_keep(case: RodCase, folder: Path) -> RodPoint:
    try:
        point = follow(case).point
    except SolveError as lost:
        point = RodPoint.lost(case.rate, str(lost))
    # Python's JSON knows NaN, which lost motions are full of
    keep(_file(case, folder), json.dumps(asdict(point)).encode())
    return point
