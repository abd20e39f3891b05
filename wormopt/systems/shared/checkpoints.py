"""Checkpoints of long runs, from which a later run of the same scene continues."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path

from wormopt.fingerprint import code_key


def checkpoints(what: str, made_by: str) -> Path:
    """Folder for checkpoints of module `made_by`; it changes with the module's code.

    It is in the user's cache folder and need not exist. `what` is the kind of work.
    """
    return user_cache_path("wormopt") / "checkpoints" / f"{what}-{code_key(made_by)}"


def keep(file: Path, content: bytes) -> None:
    """Write a file atomically, even if another process writes the same file.

    Its folder need not exist. Raises OSError if it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)


def forget(file: Path) -> None:
    """Remove a kept file, if it exists, and its folder if it is then empty."""
    with suppress(OSError):
        file.unlink()
    with suppress(OSError):
        file.parent.rmdir()
