"""Folders and names of exported files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from wormopt.errors import OutputError


def target(output: str | Path | None, name: str, suffixes: Sequence[str]) -> tuple[Path, str]:
    """Folder to write to, and the stem of the names of files.

    `name` is used if `output` is only a folder; `suffixes` are those of the requested formats.
    for. Raises OutputError if `output` has another one.
    """
    if output is None:
        return Path(), _plain(name)
    path = Path(output)
    if path.is_dir() or not path.suffix:
        return path, _plain(name)
    if [path.suffix] != [*suffixes]:
        ending = f"a name that ends in {suffixes[0]}, or " if len(suffixes) == 1 else ""
        raise OutputError(f"{path}: write {ending}a folder with -o")
    return path.parent, path.stem


def identifier(name: str) -> str:
    """Name valid in C and FMI: ASCII letters, digits and _, a letter first."""
    found = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_")
    return found if re.match("[A-Za-z]", found) else f"gait_{found}".rstrip("_")


def _plain(name: str) -> str:
    """Part of a file name, for any name of a result."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "result"
