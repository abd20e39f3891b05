"""A scene, read from a TOML file."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from wormopt.errors import Fault, SceneError
from wormopt.kinds import KINDS
from wormopt.scene.read import read_table
from wormopt.scene.types import SceneTable

TableT = TypeVar("TableT", bound=SceneTable, covariant=True)


@dataclass(frozen=True)
class Scene(Generic[TableT]):
    """What a user asks for: pure data.

    Parameters
    ----------
    name : str
        Stem of the file name.
    folder : Path
        Folder of the file; file names in the scene are relative to it.
    table : SceneTable
        The typed content, a table of the scene's kind.

    Examples
    --------
    >>> scene = load_scene("fast_gait")
    >>> scene.name, scene.table.kind, scene.table.worm.links
    ('fast_gait', 'gait', 2)
    """

    name: str
    folder: Path
    table: TableT

    @property
    def title(self) -> str:
        """Title given in the scene, its name otherwise."""
        return self.table.title or self.name

    @property
    def text(self) -> str:
        """Every key of the scene, defaults included, as JSON text."""
        table = _without_none(msgspec.to_builtins(self.table))
        return json.dumps(table, ensure_ascii=False, sort_keys=True)

    @property
    def key(self) -> str:
        """Hash of the content: scenes that ask for the same have the same key."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def load_scene(source: str | Path, overrides: Iterable[str] = ()) -> Scene[Any]:
    """Read and check a scene.

    Parameters
    ----------
    source : str or path
        A TOML file, or the bare name of a scene that comes with the package.
    overrides : iterable of str
        Changes, each "dotted.key=value" with the value written as in TOML.

    Returns
    -------
    Scene
        The scene; its table is of the type that belongs to its kind.

    Raises
    ------
    SceneError
        If the scene cannot be read or is wrong, with all that is wrong.

    Examples
    --------
    >>> load_scene("fast_gait", ["worm.load=25"]).table.worm.load
    25.0
    """
    file = str(source)
    path = _find(file)
    raw = _parse(file, path)
    _override(file, raw, overrides)
    table = _read_kind(file, raw)
    wrong = list(table.faults(path.parent))
    if wrong:
        raise SceneError(file, wrong)
    # A file name need not be valid text; results and reports must be.
    name = path.stem.encode(errors="replace").decode()
    return Scene(name, path.parent, table)


def scene_of_text(name: str, kind: str, text: str) -> Scene[Any]:
    """Read back what `Scene.text` gave of a scene of that kind, as a Result keeps it.

    File names are relative to the folder of the packaged scenes for one of these, else to the
    current folder. Raises SceneError as `load_scene`.
    """
    try:
        raw = json.loads(text)
    except ValueError:
        raw = None
    if not isinstance(raw, dict) or raw.get("kind") != kind:
        raise SceneError(name, [("", "the result does not say its scene; run it again")])
    table = _read_kind(name, raw)
    packaged = packaged_scenes().get(name)
    folder = packaged.parent if packaged else Path()
    wrong = list(table.faults(folder))
    if wrong:
        raise SceneError(name, wrong)
    return Scene(name, folder, table)


def packaged_scenes() -> dict[str, Path]:
    """Name and file of each scene that comes with the package."""
    package = Path(__file__).parents[1]
    inside = package / "problems"
    folder = inside if inside.is_dir() else package.parent / "problems"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _find(file: str) -> Path:
    path, packaged = Path(file), packaged_scenes()
    try:
        if path.is_file():
            return path
        if file in packaged:
            return packaged[file]
        if path.exists():
            raise SceneError(file, [("", "is not a file; name a .toml file")])
    except OSError as error:
        raise SceneError(file, [("", f"cannot be read: {error.strerror}")]) from error
    close = get_close_matches(file, packaged, n=1)
    hint = f"did you mean {close[0]}?" if close else "`wormopt list` names the packaged scenes"
    raise SceneError(file, [("", f"there is no such file or packaged scene; {hint}")])


def _parse(file: str, path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        message = f"cannot be read: {error.strerror}"
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
    except RecursionError:
        message = "is nested too deeply"
    except ValueError as error:
        message = f"is not valid TOML: {error}"
    raise SceneError(file, [("", message)])


def _override(file: str, raw: dict[str, Any], overrides: Iterable[str]) -> None:
    """Change raw tables in place."""
    faults = [fault for text in overrides for fault in _override_one(raw, text)]
    if faults:
        raise SceneError(file, faults)


def _override_one(raw: dict[str, Any], text: str) -> Iterator[Fault]:
    path, equals, value = text.partition("=")
    path = path.strip()
    keys = re.sub(r"\[(\d+)\]", r".\1", path).split(".")  # tracker[0].gain or tracker.0.gain
    if not equals or not all(keys):
        yield path or "--set", f"{text!r} does not read key=value, worm.links=3 say"
        return
    try:
        value.encode()  # arguments need not be text; what they are kept as cannot be saved
        parsed = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        parsed = {}
    if parsed.keys() != {"value"}:
        yield path, f"{value!r} is no TOML value; put text in quotes: --set '{path}=\"...\"'"
        return
    try:
        _set(raw, keys, parsed["value"])
    except ValueError as error:
        yield path, str(error)
    except RecursionError:
        yield path, "is nested too deeply"


def _set(inside: Any, keys: list[str], value: Any, name: str = "") -> None:
    """Set what a path of keys and, in lists, of indices leads to; tables on the way may be new."""
    key, *rest = keys
    place: Any = key
    if isinstance(inside, list):
        place = int(key) if key.isdecimal() else len(inside)
        if place >= len(inside):
            raise ValueError(f"{name} is a list; its entries are {name}.0 to {len(inside) - 1}")
    elif not isinstance(inside, dict):
        what = f"{name} is not a table or list; give all of it: {name}=[...]"
        raise ValueError(what)  # noqa: TRY004  a fault of the user's
    if not rest:
        inside[place] = value
        return
    if isinstance(inside, dict):
        inside.setdefault(place, {})
    _set(inside[place], rest, value, f"{name}.{key}" if name else key)


def _read_kind(file: str, raw: dict[str, Any]) -> SceneTable:
    kind = raw.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        what = f"{kind!r} is no kind of scene" if "kind" in raw else "missing"
        allowed = ", ".join(f'"{name}"' for name in KINDS)
        raise SceneError(file, [("kind", f"{what}; write one of {allowed}")])
    faults: list[Fault] = []
    table = read_table(raw, KINDS[kind].load_table(), "", faults)
    if table is None:
        raise SceneError(file, faults)
    return table


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return value
