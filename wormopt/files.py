"""Names of the files a result is kept in, known without loading what reads and writes them."""

import hashlib
from pathlib import Path

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"
MARK = b"made by wormopt"
STILL, MOVING = ("png", "pdf", "svg"), ("gif", "mp4")
"""Formats of pictures, as suffixes; the second of animations only."""


def picture_file(picture: str, form: str | None = None) -> str:
    """Name of the file for a picture, a word of ``want``, in the usual format or another."""
    return f"{picture}.{form or ('gif' if picture == 'animation' else 'png')}"


def is_marked(file: Path) -> bool:
    """Whether a file says in itself that wormopt made it: nothing else is ever replaced."""
    return file.is_file() and not file.is_symlink() and MARK in file.read_bytes()


def hash_of(file: Path) -> str:
    """SHA-256 of a file's bytes, by which it is known to be as it was written."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
