"""Files: names of those that a result is kept in, and how any are written, whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wormopt.errors import OutputError

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"
MARK = b"made by wormopt"
"""What files say that wormopt writes by a name of the user's."""
STILL, MOVING = ("png", "pdf", "svg"), ("gif", "mp4")
"""Formats of pictures, as suffixes; the second of animations only."""


def picture_file(picture: str, form: str | None = None) -> str:
    """Name of the file for a picture, a word of ``want``, in the usual format or another."""
    return f"{picture}.{form or ('gif' if picture == 'animation' else 'png')}"


def hash_of(file: Path) -> str:
    """SHA-256 of a file's bytes, by which it is known to be as it was written."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def digest_of(summary: Mapping[str, Any]) -> str:
    """SHA-256 of what a summary says, by which it is known to be as it was written."""
    rest = {name: value for name, value in summary.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def is_marked(file: Path) -> bool:
    """Whether a file says in itself that wormopt made it: no other is ever replaced."""
    return file.is_file() and not file.is_symlink() and MARK in file.read_bytes()


def write_files(files: Mapping[Path, bytes], *, force: bool = False) -> None:
    """Write files, all or none, each whole; one that is there and the same is left.

    With `force` such are replaced that wormopt made. Raises OutputError where anything else is
    in the way, or if they cannot be written.
    """
    token = secrets.token_hex(4)
    path = next(iter(files), Path())
    try:
        parts = enumerate(files)
        unfinished = {path: path.with_name(f".wormopt-{token}-{k}") for k, path in parts}
        for path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            _refuse_obstacle(path, files[path], force)
        try:
            for path, part in unfinished.items():
                part.write_bytes(files[path])
            for path, part in unfinished.items():
                _refuse_obstacle(path, files[path], force)  # what came meanwhile
                part.replace(path)
        finally:
            for part in unfinished.values():
                part.unlink(missing_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a null character
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be written: {why}; choose another with -o") from error


def _refuse_obstacle(path: Path, content: bytes, force: bool) -> None:
    if not os.path.lexists(path):
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; name a file with -o")
    if not path.is_symlink() and path.is_file() and path.read_bytes() == content:
        return
    if not force:
        hint = "choose another with -o, or replace a file of wormopt with --force"
        raise OutputError(f"{path}: is there already; {hint}")
    if not (is_marked(path) or _same_table(path, content)):
        what = "was not made by wormopt, it is never replaced"
        raise OutputError(f"{path}: {what}; choose another with -o")


def _same_table(path: Path, content: bytes) -> bool:
    """Whether a table in CSV, which has no place for a mark, has the columns of another."""
    if path.suffix != ".csv" or path.is_symlink() or not path.is_file():
        return False
    return path.read_bytes().split(b"\n", 1)[0] == content.split(b"\n", 1)[0]
