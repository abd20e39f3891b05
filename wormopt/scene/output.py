"""Where results go: refused before the work starts, or whole when it is done.

Files are written into a temporary folder and renamed into place. In a folder that is there
already, only files that wormopt itself wrote are replaced or removed.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from wormopt.errors import OutputError
from wormopt.files import MOVING, STILL, SUMMARY_FILE

_SUFFIXES = (".nc", ".json", ".md", ".csv", ".c", *(f".{form}" for form in (*STILL, *MOVING)))


def check_output(folder: Path, scene: str, files: Sequence[str], force: bool) -> Path:
    """Make sure that results can be written, so that no work is done in vain.

    Gives the folder, absolute and free of links. An earlier result of the same scene may be
    replaced; else OutputError if something is in the way (unless `force`) or not writable.
    """
    try:
        folder = folder.resolve()
        _refuse_obstacles(folder, scene, files, force)
        with _staging(folder):
            return folder
    except (OSError, RuntimeError, ValueError) as error:  # links in a ring; a null character
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: cannot be written: {why}; choose another with -o") from error


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Give a temporary folder whose files appear in `folder` when the context ends.

    Even by an error: a picture that fails must not cost the numbers.
    `folder` is from `check_output`. Raises OutputError if files cannot be written after all.
    """
    try:
        with _staging(folder) as staging:
            try:
                yield staging
            finally:
                if (staging / SUMMARY_FILE).is_file():
                    _publish(staging, folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _refuse_obstacles(folder: Path, scene: str, files: Sequence[str], force: bool) -> None:
    hint = "choose another folder with -o, or --force"
    if folder.exists() and not folder.is_dir():
        if not force:
            raise OutputError(f"{folder}: is a file, not a folder; {hint}")
        return
    if not folder.is_dir():
        return
    for name in files:
        if (folder / name).is_dir():
            raise OutputError(f"{folder / name}: is a folder where a file must go; rename it")
    if force or not any(folder.iterdir()):
        return
    earlier, own = earlier_result(folder)
    if earlier is None:
        raise OutputError(f"{folder}: holds other files and no result of wormopt; {hint}")
    if earlier != scene:
        raise OutputError(f"{folder}: holds the result of another scene, {earlier}; {hint}")
    for name in files:
        if name not in own and os.path.lexists(folder / name):
            raise OutputError(f"{folder / name}: was not written by wormopt; {hint}")


def earlier_result(folder: Path) -> tuple[str | None, set[str]]:
    """Find the scene and the files of the result in a folder; None where there is no result."""
    try:
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
        scene, names = summary["scene"], summary["files"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None, set()
    if not isinstance(scene, str) or not isinstance(names, list) or "wormopt" not in summary:
        return None, set()
    return scene, {name for name in names if isinstance(name, str) and _is_plain(name)}


def _is_plain(name: str) -> bool:
    """Whether a name can be one that wormopt wrote: nothing else is ever removed."""
    return Path(name).name == name and name.endswith(_SUFFIXES)


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    # Inside a folder that is there: it may be writable where its parent is not, and a file
    # can only be renamed within one file system.
    where = folder if folder.is_dir() else folder.parent
    where.mkdir(parents=True, exist_ok=True)
    staging = where / f".wormopt-{secrets.token_hex(4)}"
    staging.mkdir()
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _publish(staging: Path, folder: Path) -> None:
    if folder.is_file():
        folder.unlink()
    if not folder.exists():
        staging.rename(folder)
        return
    _, stale = earlier_result(folder)
    new = sorted(staging.iterdir(), key=lambda path: path.name == SUMMARY_FILE)
    for path in new:
        path.replace(folder / path.name)
    for name in stale - {path.name for path in new}:
        with suppress(FileNotFoundError):
            (folder / name).unlink()
