"""Where long work keeps what it has, so that another run of the same can go on."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path


@cache
def checkpoints(what: str) -> Path:
    """Folder for what this very code has found: changed code has another one.

    It is in the user's cache folder and need not exist; `what`: the kind of work.
    """
    code = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(file.read_bytes())
    return user_cache_path("wormopt") / "checkpoints" / f"{what}-{code.hexdigest()[:16]}"


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
