"""Exported files in their place: nothing of others replaced, nothing half-written."""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from wormopt.errors import OutputError


def target(output: str | Path | None, name: str, suffixes: Sequence[str]) -> tuple[Path, str]:
    """Folder to write to, and the name, without suffix, that files there begin with.

    `name` is used where `output` names a folder only; `suffixes` are those of the formats asked
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
    """Name as C and FMI allow it: ASCII letters, digits and _, a letter first."""
    found = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_")
    return found if re.match("[A-Za-z]", found) else f"gait_{found}".rstrip("_")


def publish(files: Mapping[str, bytes], folder: Path, force: bool) -> tuple[Path, ...]:
    """Write files, all or none; gives their paths. Raises OutputError as `refuse_obstacles`."""
    token = secrets.token_hex(4)
    paths = {folder / name: folder / f".{name}-{token}" for name in files}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        refuse_obstacles(paths, force)
        try:
            for content, unfinished in zip(files.values(), paths.values(), strict=True):
                unfinished.write_bytes(content)
            for path, unfinished in paths.items():
                unfinished.replace(path)
        finally:
            for unfinished in paths.values():
                with suppress(OSError):
                    unfinished.unlink(missing_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a null character
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: cannot be written: {why}; choose another with -o") from error
    return tuple(paths)


def refuse_obstacles(paths: Sequence[Path] | Mapping[Path, Path], force: bool) -> None:
    """Raise OutputError where something is in the way; with `force`, where it is no plain file."""
    for path in paths:
        if not os.path.lexists(path):
            continue
        if not stat.S_ISREG(path.lstat().st_mode):
            raise OutputError(f"{path}: is in the way and no plain file; choose another with -o")
        if not force:
            raise OutputError(f"{path}: is there already; choose another with -o, or --force")


def _plain(name: str) -> str:
    """Part of a file name, whatever a result is called."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "result"
