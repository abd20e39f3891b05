"""Hashes of the code that computes: of syntax trees, without comments."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parent
# Version of this form of hashes; increase it for a new form.
_FORM = 1
# Packages that compute nothing. Contents of scenes are part of the names of the files.
_SHOWS = {"study", "families", "scenes", "pictures", "quantities", "result", "saving",
          "errors", "files", "kinds", "progress", "version"}  # fmt: skip


@cache
def code_key(module: str) -> str:
    """Hash of the code of a module and of all its imports."""
    # Comments, docstrings and modules that are not imported have no effect.
    key = hashlib.sha256(f"{_FORM}".encode())
    for _, tree in sorted(_imported(module, _files(_ROOT)).items()):
        key.update(_text_of(tree).encode())
    return key.hexdigest()[:16]


def fingerprint(source: str) -> str:
    """Syntax tree of Python code as text, without comments and docstrings."""
    return _text_of(ast.parse(source))


def _text_of(tree: ast.Module) -> str:
    for node in (tree, *_statements(tree)):
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


def _imported(start: str, files: dict[str, Path]) -> dict[str, ast.Module]:
    """A module of the package, and all its imports, direct or not, with their syntax trees."""
    found, todo = dict[str, ast.Module](), [start]
    while todo:
        name = todo.pop()
        if name in files and name not in found and _SHOWS.isdisjoint(name.split(".")):
            found[name] = ast.parse(files[name].read_text(encoding="utf-8"))
            todo += _imports(found[name])
    return found


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names of possible modules, wherever they are imported."""
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Statements in a node, direct or not: an eighth of its nodes."""
    for name in ("body", "orelse", "handlers", "finalbody", "cases"):
        inner = getattr(node, name, ())
        for part in inner if isinstance(inner, list) else ():
            yield part
            yield from _statements(part)


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
