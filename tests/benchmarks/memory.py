"""Memory of this process: by how much some work made it grow at most."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

Answer = TypeVar("Answer")


def growth(work: Callable[[], Answer]) -> tuple[Answer, float | None]:
    """Do some work; its answer, and the bytes by which the process grew at most meanwhile.

    Memory that was free before counts for nothing, so that first runs tell most. Only on Linux
    can the mark of the most be set back; elsewhere what is below an earlier mark is 0. On
    Windows, where Python does not report memory, the value is None.
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before = _most()
    answer, after = work(), _most()
    return answer, None if before is None or after is None else after - before


def megabytes(size: float | None) -> str:
    """Lay a size out for a table."""
    return "" if size is None else f"{size / 1e6:.1f} MB"


def _most() -> float | None:
    """Most bytes since the mark was set back."""
    if sys.platform == "win32":
        return None
    import resource  # which Windows lacks

    with suppress(OSError, StopIteration):
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        most = next(line for line in status.splitlines() if line.startswith("VmHWM"))
        return 1024 * float(most.split()[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
