"""Results that a page is made of, and where they came from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from wormopt.errors import ArgumentError
from wormopt.files import RESULT_FILE, SUMMARY_FILE
from wormopt.result import Result
from wormopt.version import VERSION


@dataclass(frozen=True, eq=False)
class Source:
    """A result. folder: where further files of it lie, None where it came from no file."""

    result: Result
    version: str = VERSION
    computed: str = ""
    folder: Path | None = None


def source_of(given: Result | str | Path) -> Source:
    """Find a result; ArgumentError, which names the file, where there is none."""
    if isinstance(given, Result):
        return Source(given)
    path = Path(given)
    file = path / RESULT_FILE if path.is_dir() else path
    try:
        result = Result.load(file)
        computed = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    except OSError as error:
        why = "holds no result" if path.is_dir() else f"cannot be read: {error.strerror or error}"
        what = "name the folder of a result, as `wormopt run` writes it, or its result.nc"
        raise ArgumentError(f"{given}: {why}; {what}") from error
    except ValueError as error:
        raise ArgumentError(f"{error}; name the folder of a result, or its result.nc") from error
    return Source(result, _version(file), f"{computed:%Y-%m-%d %H:%M} UTC", file.parent)


def _version(file: Path) -> str:
    """Version that computed a result: it stands in the file, and in the summary beside it."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(file, "r", mmap=False) as stored:
            return getattr(stored, "source", b"").decode().removeprefix("wormopt ")
    except (OSError, ValueError):
        summary = json.loads((file.parent / SUMMARY_FILE).read_text("utf-8"))
        return str(summary.get("wormopt", ""))
