"""What tests read from results of scenes."""

from pathlib import Path
from typing import Any

import wormopt as wo


def run_text(folder: Path, text: str, *changes: str) -> wo.Result:
    """Result of a scene that is given as TOML."""
    path = folder / "scene.toml"
    path.write_text(text)
    return wo.run(wo.load_scene(path, list(changes)))


def value(result: wo.Result, name: str) -> Any:
    """Value of a scalar."""
    return result.scalars[name].value


def failed_checks(result: wo.Result) -> list[str]:
    return [check.name for check in result.checks if not check.passed]
