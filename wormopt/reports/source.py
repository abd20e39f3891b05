"""Results of a page, and their origin."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from wormopt.files import RESULT_FILE, SUMMARY_FILE
from wormopt.result import Result
from wormopt.runner import result_at
from wormopt.version import VERSION


@dataclass(frozen=True, eq=False)
class Source:
    """A result. folder: that of its further files, None for a result without files."""

    result: Result
    version: str = VERSION
    computed: str = ""
    folder: Path | None = None


def source_of(given: Result | str | Path) -> Source:
    """Find a result; ArgumentError, which names the file, if there is none."""
    if isinstance(given, Result):
        return Source(given)
    path = Path(given)
    result, file = result_at(path), path / RESULT_FILE if path.is_dir() else path
    computed = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    return Source(result, _version(file), f"{computed:%Y-%m-%d %H:%M} UTC", file.parent)


def _version(file: Path) -> str:
    """Version that computed a result, from the file or the summary beside it."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(file, "r", mmap=False) as stored:
            return getattr(stored, "source", b"").decode().removeprefix("wormopt ")
    except (OSError, ValueError):
        summary = json.loads((file.parent / SUMMARY_FILE).read_text("utf-8"))
        return str(summary.get("wormopt", ""))
