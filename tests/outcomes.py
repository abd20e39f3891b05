"""What tests read from results of scenes."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import wormopt as wo
from wormopt.cli import main


def run_text(folder: Path, text: str, *changes: str) -> wo.Result:
    """Result of a scene that is given as TOML."""
    path = folder / "scene.toml"
    path.write_text(text)
    return wo.run(wo.load_scene(path, list(changes)))


def told_by_a_run(
    capsys: pytest.CaptureFixture[str],
    scene: str | Path,
    folder: Path,
    *changes: str,
    plots: bool = False,
) -> tuple[int, dict[str, Any]]:
    """Exit code of `wormopt run`, and what it prints."""
    more = [part for change in changes for part in ("--set", change)]
    more += [] if plots else ["--no-plots"]
    code = main(["run", str(scene), "--json", "-o", str(folder), *more])
    return code, json.loads(capsys.readouterr().out)


def value(result: wo.Result, name: str) -> Any:
    """Value of a scalar."""
    return result.scalars[name].value


def failed_checks(result: wo.Result) -> list[str]:
    return [check.name for check in result.checks if not check.passed]


def refused(scene: Any, change: Any, key: str, message: str) -> None:
    """Assert that a scene with this change is refused, with a message at a key."""
    with pytest.raises(wo.SceneError) as caught:
        wo.run(wo.load_scene(scene, change))
    faults = caught.value.faults
    assert any(where.startswith(key) and message in said for where, said in faults), faults


def refusals(scene: str, table: str) -> Callable[[str, str, str], None]:
    """Make a test of what a scene, by name or as TOML, refuses.

    A line of the table is a change (several are joined by " & "), a key, and a part of the message
    if it counts, parted by " | ".
    """
    given: Any = tomllib.loads(scene) if "\n" in scene else scene
    rows = [f"{line.strip()} | ".split(" | ")[:3] for line in table.splitlines() if line.strip()]

    @pytest.mark.parametrize(("changes", "key", "message"), rows)
    def refuses(changes: str, key: str, message: str) -> None:
        refused(given, changes.split(" & "), key, message)

    return refuses
