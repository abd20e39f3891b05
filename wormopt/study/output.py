# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Output folders: rejected before the work starts, or complete when it is done.

Files are written into a temporary folder and renamed into place. ``summary.json`` contains the
hashes of the files written with it: wormopt replaces or removes only its own unchanged files.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from wormopt.errors import OutputError
from wormopt.files import SUMMARY_FILE, digest_of, hash_of, write_summary

_LONGEST_NAME = 100


@dataclass(frozen=True)
class Output:
    """Folder of a result, with its present content.

    `kept`: names in it that do not prevent writing, such as a store of points.
    """

    folder: Path
    scene: str
    kind: str
    kept: tuple[str, ...] = ()
    force: bool = False


def default_folder(scene: str, changes: Sequence[str] = ()) -> Path:
    """Folder for a scene; scenes with changed keys have their own folders."""
    name = ",".join([scene, *(re.sub(r"[^\w.=+-]+", "_", text) for text in changes)])
    if len(name) > _LONGEST_NAME:
        digest = hashlib.sha256("\n".join(changes).encode(errors="replace")).hexdigest()
        name = f"{name[: _LONGEST_NAME - 9]}-{digest[:8]}"
    return Path("results") / name.rstrip(".")  # which Windows drops


def check_output(output: Output, files: Sequence[str]) -> Output:
    """Check that results can be written, before the work starts.

    Returns it with an absolute folder without links. An earlier result of the same scene and kind
    may be replaced, with `force` any; else OutputError if something is in the way.
    """
    try:
        output = replace(output, folder=output.folder.resolve())
        _refuse_obstacles(output, files)
        with _staging(output.folder):
            return output
    except (OSError, RuntimeError, ValueError) as error:  # circular links; a null character
        why = getattr(error, "strerror", None) or error
        where = output.folder
        raise OutputError(f"{where}: cannot be written: {why}; choose another with -o") from error


@contextmanager
def output_folder(output: Output) -> Generator[Path]:
    """Yield a temporary folder whose files move to the output's when the context ends.

    Also after an error: a picture that fails must not cost the numbers.
    `output` is from `check_output`. Raises OutputError if files cannot be written after all.
    """
    folder = output.folder
    try:
        with _staging(folder) as staging:
            try:
                yield staging
            finally:
                if (staging / SUMMARY_FILE).is_file():
                    _publish(staging, output)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class Earlier:
    """The result in a folder, and which files are unchanged."""

    scene: str = ""
    kind: str = ""
    own: frozenset[str] = field(default_factory=frozenset)
    table: Mapping[str, Any] = field(default_factory=dict)


def _refuse_obstacles(output: Output, files: Sequence[str]) -> None:
    folder, elsewhere = output.folder, "choose another folder with -o"
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file, not a folder; {elsewhere}")
    if folder.is_symlink() and not folder.is_dir():
        raise OutputError(f"{folder}: is a link to a folder that does not exist; {elsewhere}")
    if not folder.is_dir():
        return
    earlier = earlier_result(folder)
    # the summary first: without it no file is known
    for name in sorted(files, key=SUMMARY_FILE.__ne__):
        if (folder / name).is_dir():
            raise OutputError(f"{folder / name}: is a folder where a file must go; rename it")
        if os.path.lexists(folder / name) and name not in earlier.own:
            what = "was not written by wormopt, or was changed since; it is never replaced"
            raise OutputError(f"{folder / name}: {what}: rename it, or {elsewhere}")
    _refuse_open(folder, earlier)
    if output.force or not {path.name for path in folder.iterdir()} - set(output.kept):
        return
    if not earlier.scene:
        what = "contains other files and no result of wormopt"
        raise OutputError(f"{folder}: {what}; {elsewhere}, or add the result to them with --force")
    if (earlier.scene, earlier.kind) != (output.scene, output.kind):
        what = f"contains the result of another scene, {earlier.scene} ({earlier.kind})"
        raise OutputError(f"{folder}: {what}; {elsewhere}, or replace it with --force")


def _refuse_open(folder: Path, earlier: Earlier) -> None:
    """Raise OutputError for a file that cannot be replaced: on Windows one that is open."""
    for path in (folder / name for name in earlier.own):
        try:
            path.replace(path)
        except PermissionError as error:
            what = "cannot be replaced; close the program using it, or choose a folder with -o"
            raise OutputError(f"{path}: {what}") from error


def earlier_result(folder: Path) -> Earlier:
    """The result written into a folder, if there is one."""
    try:
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
        scene, kind, hashes = (summary[key] for key in ("scene", "kind", "sha256"))
        same = {name for name, digest in hashes.items() if _is_as_written(folder, name, digest)}
        same -= {SUMMARY_FILE}
        same |= {SUMMARY_FILE} if hashes.get(SUMMARY_FILE) == digest_of(summary) else set()
        return Earlier(str(scene), str(kind), frozenset(same), dict(summary.get("table", {})))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return Earlier()


def changed(old: Mapping[str, Any], new: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Dotted keys at which two tables differ."""
    for key in {**old, **new}:
        was, is_now = old.get(key), new.get(key)
        if isinstance(was, Mapping) and isinstance(is_now, Mapping):
            yield from changed(was, is_now, f"{path}{key}.")
        elif was != is_now:
            yield f"{path}{key}"


def enlist(folder: Path, names: Sequence[str]) -> None:
    """Add new files beside a result to its own files, so that they are replaced with it."""
    summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    summary["files"] += [name for name in names if name not in summary["files"]]
    write_summary(folder, summary, names)


def _is_as_written(folder: Path, name: str, digest: object) -> bool:
    path = folder / name
    return Path(name).name == name and path.is_file() and digest == hash_of(path)


@contextmanager
def _staging(folder: Path) -> Generator[Path]:
    # Inside the folder if it exists: it may be writable where its parent is not, and files can only
    # be renamed within one file system.
    where = folder if folder.is_dir() else folder.parent
    where.mkdir(parents=True, exist_ok=True)
    staging = where / f".wormopt-{secrets.token_hex(4)}"
    staging.mkdir()
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _publish(staging: Path, output: Output) -> None:
    folder, new = output.folder, sorted(path.name for path in staging.iterdir())
    enlist(staging, [name for name in new if name != SUMMARY_FILE])  # pictures too
    try:
        # files written meanwhile
        _refuse_obstacles(replace(output, kept=(*output.kept, staging.name)), new)
    except OutputError as error:
        spare = folder.with_name(f"{folder.name}-{secrets.token_hex(4)}")
        staging.rename(spare)
        raise OutputError(f"{error}; the result is in {spare}") from None
    if not folder.exists():
        staging.rename(folder)
        return
    stale = earlier_result(folder).own - set(new)
    for name in sorted(new, key=SUMMARY_FILE.__eq__):  # the summary is last
        (staging / name).replace(folder / name)
    for name in stale:
        with suppress(FileNotFoundError):
            (folder / name).unlink()
