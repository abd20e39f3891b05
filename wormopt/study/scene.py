# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""A scene, read from a TOML file."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec

from wormopt.errors import Fault, SceneError
from wormopt.kinds import KINDS, near
from wormopt.study.given import read_table, read_value
from wormopt.study.study import Scene, Study
from wormopt.study.swept import Swept
from wormopt.study.toml import Overrides, as_toml, override
from wormopt.study.types import FOLDER

_NO_SCHEMA = "missing; write 1"


def load_scene(
    source: Scene[Any] | Study | str | Path | Mapping[str, Any],
    overrides: Overrides = (),
    *,
    name: str = "",
    **tables: Any,
) -> Scene[Any]:
    """Read and check a scene.

    Parameters
    ----------
    source : str, path, mapping, Scene or study
        A TOML file, the bare name of a scene that comes with the package, the tables of a scene
        without a file, or a Scene or study that shall be changed.
    overrides : str, mapping, or iterable of them
        Changes. A text reads "dotted.key=value", with the value written as in TOML or a text
        without quotes, and replaces what is there. Keys of a mapping may be dotted too; tables in
        it are merged with those of the scene.
    name : str, optional
        Name of the scene in results; by default its own, that of its file, or "scene".
    **tables
        Further changes, by the names of keys: ``worm={"load": 3}``.

    Returns
    -------
    Scene
        The scene; its table is of the type that belongs to its kind.

    Raises
    ------
    SceneError
        If the scene cannot be read or is wrong, with all that is wrong.
    ArgumentError
        If an override is neither text nor mapping.

    Examples
    --------
    >>> load_scene("fast_gait", "worm.load=25").table.worm.load
    25.0
    >>> load_scene("fast_gait", {"gait.period": 2, "worm": {"load": 25}}).table.gait.period
    2.0
    >>> scene = load_scene("fast_gait", worm={"load": 25})
    >>> load_scene(scene, title="Loaded").table.worm.load
    25.0
    """
    given: Any = getattr(source, "scene", source)  # of a study
    file, known_as, folder, raw = _raw(given)
    wrong = [*override(raw, overrides), *override(raw, tables)]
    if wrong:
        raise SceneError(file, wrong)
    return _checked(file, name or known_as, folder, raw)


def scene_within(folder: Path, name: str, tables: Mapping[str, Any]) -> Scene[Any]:
    """Scene given as tables in another one; file names are relative to the folder of the latter."""
    return _checked(name, name, folder, as_toml(tables))


def _checked(file: str, name: str, folder: Path, raw: dict[str, Any]) -> Scene[Any]:
    table, sweep = _read_kind(file, raw, folder)
    if wrong := [(f"sweep.{key}", what) for key, what in (sweep.faults() if sweep else ())]:
        raise SceneError(file, wrong)
    table.placed(name, folder)
    return Scene(name, folder, table, sweep)


def scene_of_text(name: str, kind: str, text: str) -> Scene[Any]:
    """Read the output of `Scene.text` of a scene of that kind, as stored in a Result.

    File names are relative to the folder of the packaged scenes for one of these, else to the
    current folder. Raises SceneError as `load_scene`.
    """
    try:
        raw = json.loads(text)
    except ValueError:
        raw = None
    if not isinstance(raw, dict) or raw.get("kind") != kind:
        raise SceneError(name, [("", "the result does not contain its scene; run it again")])
    packaged = packaged_scenes().get(name)
    folder = packaged.parent if packaged else Path()
    table, _ = _read_kind(name, raw, folder)
    table.placed(name, folder)
    return Scene(name, folder, table)


def packaged_scenes() -> dict[str, Path]:
    """Name and file of each scene that comes with the package."""
    files = sorted(packaged_folder().glob("*.toml"), key=attrgetter("name"))
    return {path.stem: path for path in files}


def times_of_scenes() -> dict[str, float]:
    """Measured seconds of packaged scenes, approximately; 0 for less than one."""
    return json.loads((packaged_folder() / "times.json").read_text(encoding="utf-8"))


def packaged_folder() -> Path:
    """Folder of the packaged scenes: in the package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "problems"
    return inside if inside.is_dir() else package.parent / "problems"


def _raw(
    source: Scene[Any] | str | Path | Mapping[str, Any],
) -> tuple[str, str, Path, dict[str, Any]]:
    """Label in messages, name, folder and raw tables of a scene."""
    if isinstance(source, Scene):
        raw = json.loads(source.text)
        raw |= {"sweep": msgspec.to_builtins(source.sweep)} if source.sweep else {}
        return source.name, source.name, source.folder, raw
    if isinstance(source, Mapping):
        return "scene", "scene", Path(), as_toml(source)
    file = str(source)
    path = _find(file)
    # File names may contain invalid text; results and reports must not.
    return file, path.stem.encode(errors="replace").decode(), path.parent, _parse(file, path)


def _find(file: str) -> Path:
    path = Path(file)
    try:
        if path.is_file():
            return path
        packaged = packaged_scenes()
        if file in packaged:
            return packaged[file]
        if path.exists():
            raise SceneError(file, [("", "is not a file; write the name of a .toml file")])
    except OSError as error:
        raise SceneError(file, [("", f"cannot be read: {error.strerror}; name another")]) from error
    close = _near(path) or get_close_matches(file, packaged, n=1)
    hint = f"did you mean {close[0]}?" if close else "`wormopt list` names the packaged scenes"
    raise SceneError(file, [("", f"there is no such file or packaged scene; {hint}")])


def _near(path: Path) -> list[str]:
    """TOML files beside a missing path that may be meant."""
    beside = {str(path.parent / found.name): found for found in path.parent.glob("*.toml")}
    exact = f"{path}.toml"
    return [exact] if exact in beside else get_close_matches(str(path), beside, n=1, cutoff=0.8)


def _parse(file: str, path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        message = f"cannot be read: {error.strerror}; name a readable file"
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        if path.suffix == ".nc":
            message = "is a result, not a scene; `wormopt show` prints it"
    except RecursionError:
        message = "is nested too deeply"
    except ValueError as error:
        message = f"is not valid TOML: {error}{_quotes(path.read_bytes(), str(error))}"
    raise SceneError(file, [("", message)])


def _quotes(content: bytes, error: str) -> str:
    """Hint about a value with a unit but no quotes in the line that an error names."""
    place = re.search(r"at line (\d+)", error)
    row = content.decode("utf-8-sig").split("\n")[int(place[1]) - 1] if place else ""
    bare = re.search(r"[=\[,]\s*([-+]?\d[\d._]*(e[-+]?\d+)?\s*[A-Za-zµ°%][^\s,\]}#]*)", row)
    return f'; put a value with a unit in quotes: "{bare[1]}"' if bare else ""


def _read_kind(file: str, raw: dict[str, Any], folder: Path) -> tuple[Study, Swept | None]:
    kind = raw.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        close = near(kind) if isinstance(kind, str) else ""
        what = f"there is no kind of scene {kind!r}" if "kind" in raw else "missing"
        hint = f'did you mean "{close}"?' if close else 'write a kind such as "gait-design";'
        raise SceneError(file, [("kind", f"{what}; {hint} `wormopt list` shows all kinds")])
    faults: list[Fault] = []
    sweep = raw.pop("sweep", None)
    swept = None if sweep is None else read_value(sweep, Swept, "sweep", "", faults)
    before = FOLDER.set(folder)
    try:
        units = raw.get("units", "")  # wrong ones are one fault, not one of each number with a unit
        units = units if units in ("", "dimensionless") else "SI"
        table = read_table(raw, KINDS[kind].load(), "", units, faults)
    finally:
        FOLDER.reset(before)
    if "schema" not in raw and ("schema", _NO_SCHEMA) not in faults:
        faults.append(("schema", _NO_SCHEMA))
    if table is None or faults:
        raise SceneError(file, faults)
    return table, swept
