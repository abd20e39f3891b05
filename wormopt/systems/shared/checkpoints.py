"""Where long work keeps what it has, so that another run of the same can go on."""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

_ROOT = Path(__file__).parents[2]
# What is kept is read back as of this form; a new number for a new form.
_FORM = 1
# Rooms that compute nothing. What scenes say is part of the names of the files.
_SHOWS = {"scene", "scenes", "plotting", "plots", "quantities", "result", "saving", "errors",
          "files", "kinds", "progress", "version"}  # fmt: skip


@cache
def checkpoints(what: str, made_by: str) -> Path:
    """Folder for what the module `made_by` has found: code that computes otherwise has another.

    Comments and docstrings do not count, nor does what the module does not import. It is in the
    user's cache folder and need not exist; `what`: the kind of work.
    """
    key = hashlib.sha256(f"{_FORM}".encode())
    for name in sorted(_imported(made_by, _files(_ROOT))):
        key.update(fingerprint(_files(_ROOT)[name].read_text(encoding="utf-8")).encode())
    return user_cache_path("wormopt") / "checkpoints" / f"{what}-{key.hexdigest()[:16]}"


def fingerprint(source: str) -> str:
    """Syntax tree of Python code as text, without comments and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]  # pyright: ignore
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _imported(start: str, files: dict[str, Path]) -> set[str]:
    """A module of the package, and all that it imports, directly or not."""
    found, todo = set[str](), [start]
    while todo:
        name = todo.pop()
        if name in files and name not in found and _SHOWS.isdisjoint(name.split(".")):
            found.add(name)
            todo += _imports(ast.parse(files[name].read_text(encoding="utf-8")))
    return found


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names of what may be modules, wherever they are imported."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def _files(root: Path) -> dict[str, Path]:
    """Files of the package by the names of their modules, and of the names that stubs declare."""

    def name(path: Path) -> str:
        parts = path.relative_to(root.parent).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    found = {name(path): path for path in root.rglob("*.py")}
    for stub in root.rglob("__init__.pyi"):
        for node in ast.parse(stub.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module in found:
                home = found[node.module]
                found |= {f"{name(stub)}.{alias.name}": home for alias in node.names}
    return found


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
