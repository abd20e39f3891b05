"""Where long work keeps what it has, so that another run of the same can go on."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["checkpoints"]


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
