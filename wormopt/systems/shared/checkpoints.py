"""Where long work keeps what it has, so that another run of the same can go on."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["checkpoints", "forget", "keep"]


@cache
def checkpoints(what: str) -> Path:
    """Folder for what this very code has found: changed code has another one.

    Parameters
    ----------
    what : str
        The kind of work.

    Returns
    -------
    Path
        In the user's cache folder; it need not exist.
    """
    code = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(file.read_bytes())
    return user_cache_path("wormopt") / "checkpoints" / f"{what}-{code.hexdigest()[:16]}"


def keep(file: Path, content: bytes) -> None:
    """Write a file as a whole or not at all.

    Parameters
    ----------
    file : Path
        In a folder that need not exist; another process may write the same.
    content : bytes
        What to keep.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)


def forget(file: Path) -> None:
    """Remove what was kept, and its folder if nothing else is in it.

    Parameters
    ----------
    file : Path
        The file, which need not exist.
    """
    with suppress(OSError):
        file.unlink()
    with suppress(OSError):
        file.parent.rmdir()
