"""Memory of this process: by how much some work made it grow at most."""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Answer = TypeVar("Answer")


def growth(work: Callable[[], Answer]) -> tuple[Answer, float | None]:
    """Do some work; its answer, and the bytes by which the process grew at most meanwhile.

    Memory that was free before counts for nothing, so that first runs tell most. None where
    the system does not tell. On Linux the mark of the most is set back first.
    """
    before = _reset()
    answer = work()
    after = _most()
    return answer, None if before is None or after is None else max(after - before, 0.0)


def megabytes(size: float | None) -> str:
    """Lay a size out for a table."""
    return "" if size is None else f"{size / 1e6:.3g} MB"


def _reset() -> float | None:
    """Forget the most so far, where that can be done; bytes now."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        pass
    return _most()


def _most() -> float | None:
    """Most bytes so far."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        return 1024 * float(next(k for k in status.splitlines() if k.startswith("VmHWM")).split()[1])
    except (OSError, StopIteration):
        pass
    unit = 1 if sys.platform == "darwin" else 1024
    return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
