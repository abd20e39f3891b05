"""What tests read from results of scenes."""

import json
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
