"""Names of the files of a result, and writing of files, whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import zlib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from wormopt.errors import OutputError

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"
POINTS = "points"
"""Subfolder of a sweep's folder for its points."""
MARK = f"made by wormopt, sha256 {'0' * 16}"
"""Mark in files that wormopt writes under names of the user; `sealed` inserts their hash."""
_SEAL = re.compile(rb"made by wormopt, sha256 ([0-9a-f]{16})")
STILL, MOVING = ("png", "pdf", "svg"), ("gif", "mp4")
"""Formats of pictures, as suffixes; the second for animations only."""


def is_there(file: Path) -> bool:
    """Whether there is such a file; False for invalid names."""
    return os.path.isfile(file)  # noqa: PTH113  Path.is_file raises for too long names


def picture_file(picture: str, form: str | None = None) -> str:
    """Name of the file for a picture, a word of ``want``, in the default format or another."""
    return f"{picture}.{form or ('gif' if picture == 'animation' else 'png')}"


def hash_of(file: Path) -> str:
    """SHA-256 of a file's bytes, by which changes are detected."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def digest_of(summary: Mapping[str, Any]) -> str:
    """SHA-256 of a summary's content, by which changes are detected."""
    rest = {name: value for name, value in summary.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def write_summary(folder: Path, summary: Mapping[str, Any], names: Iterable[str]) -> None:
    """Write a summary with hashes of files beside it, its own, and those of the earlier summary."""
    hashes = summary.get("sha256", {}) | {name: hash_of(folder / name) for name in names}
    hashes[SUMMARY_FILE] = digest_of(summary)
    whole = {**summary, "sha256": hashes}
    text = json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
    unfinished = folder / f".unfinished-{SUMMARY_FILE}"
    unfinished.write_text(text + "\n", encoding="utf-8", newline="\n")
    unfinished.replace(folder / SUMMARY_FILE)


def sealed(content: bytes) -> bytes:
    """Insert the hash of a file into its mark; idempotent for unchanged files."""
    digest = hashlib.sha256(_marked(content, b"0" * 16)).hexdigest()
    return _marked(content, digest[:16].encode())


def _marked(content: bytes, digits: bytes) -> bytes:
    found = _SEAL.search(content)
    if not found:
        return content
    start, end = found.span(1)
    content = content[:start] + digits + content[end:]
    text = content.rfind(b"tEXt", 0, start)
    if content.startswith(b"\x89PNG") and text >= 0:  # its checksum follows
        end = found.end()
        crc = zlib.crc32(content[text:end]).to_bytes(4, "big")
        content = content[:end] + crc + content[end + 4 :]
    return content


def write_files(
    files: Mapping[Path, bytes], *, force: bool | None = False, own: Collection[Path] = ()
) -> None:
    """Write files, all or none, each whole; an equal file is left."""
    files = {path: sealed(content) for path, content in files.items()}
    token = secrets.token_hex(4)
    path = next(iter(files), Path())
    try:
        parts = enumerate(files)
        unfinished = {path: path.with_name(f".wormopt-{token}-{k}") for k, path in parts}
        for path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            refuse_obstacle(path, files[path], force=force, own=own)
        try:
            for path, part in unfinished.items():
                part.write_bytes(files[path])
            for path, part in unfinished.items():
                refuse_obstacle(path, files[path], force=force, own=own)  # files written meanwhile
                part.replace(path)
        finally:
            for part in unfinished.values():
                part.unlink(missing_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a null character
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be written: {why}; choose another with -o") from error


def refuse_obstacle(
    path: Path, content: bytes = b"", *, force: bool | None, own: Collection[Path] = ()
) -> None:
    """Raise OutputError if something else than this content is in the way.

    Files in `own` may be replaced, and with `force` unchanged files of wormopt; None if the user
    has no such choice.
    """
    if not os.path.lexists(path):
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; name a file with -o")
    there = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
    if path in own or (there and there == content):
        return
    if not force:
        other = "remove it" if force is None else "replace a file of wormopt with --force"
        raise OutputError(f"{path}: is there already; choose another with -o, or {other}")
    if not _SEAL.search(there) or sealed(there) != there:
        what = "was not made by wormopt, or changed since; it is never replaced"
        raise OutputError(f"{path}: {what}; choose another with -o")
