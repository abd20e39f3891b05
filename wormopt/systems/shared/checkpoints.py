"""Where long work keeps what it has, so that another run of the same can go on."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path

from wormopt.fingerprint import code_key


def checkpoints(what: str, made_by: str) -> Path:
    """Folder for what the module `made_by` has found: code that computes otherwise has another.

    It is in the user's cache folder and need not exist; `what`: the kind of work.
    """
    return user_cache_path("wormopt") / "checkpoints" / f"{what}-{code_key(made_by)}"


def keep(file: Path, content: bytes) -> None:
    """Write a file as a whole or not at all, even if another process writes the same.

    Its folder need not exist; raises OSError if it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)


def forget(file: Path) -> None:
    """Remove what was kept, if it exists, and its folder if nothing else is in it."""
    with suppress(OSError):
        file.unlink()
    with suppress(OSError):
        file.parent.rmdir()
