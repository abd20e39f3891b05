"""Tutorials run, every assertion in them holds, and they print what stands on the page."""

import ast
import json
from pathlib import Path
from typing import Any

import pytest
from places import DOCS

from wormopt.study import load_scene

TUTORIALS = DOCS / "tutorials"


def scenes_of(name: str) -> list[Any]:
    """Scenes that a tutorial writes as mappings."""
    cells = json.loads((TUTORIALS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    nodes = [node for text in code for node in ast.walk(ast.parse(text))]
    tables = [node for node in nodes if isinstance(node, ast.Dict)]
    keys = [[key.value for key in node.keys if isinstance(key, ast.Constant)] for node in tables]
    return [ast.literal_eval(n) for n, names in zip(tables, keys, strict=True) if "schema" in names]


@pytest.mark.parametrize("name", ["controllers", "robot_gait"])
def test_scenes_in_tutorials_have_keys_of_today(name: str):
    scenes = scenes_of(name)
    assert scenes
    for scene in scenes:
        load_scene(scene)


def printed(book: Any) -> list[str]:
    """What cells print."""
    shown = [output for cell in book.cells for output in cell.get("outputs", [])]
    return ["".join(output["text"]) for output in shown if output["output_type"] == "stream"]


def pictures(book: Any) -> int:
    shown = [output for cell in book.cells for output in cell.get("outputs", [])]
    return sum("image/png" in output.get("data", {}) for output in shown)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize("name", [path.stem for path in sorted(TUTORIALS.glob("*.ipynb"))])
def test_a_tutorial_runs_and_shows_what_its_page_says(name: str, tmp_path: Path):
    nbformat, nbclient = (pytest.importorskip(name) for name in ("nbformat", "nbclient"))
    kept, book = (nbformat.read(TUTORIALS / f"{name}.ipynb", as_version=4) for _ in range(2))
    for cell in book.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    resources = {"metadata": {"path": str(tmp_path)}}
    client = nbclient.NotebookClient(book, timeout=900, kernel_name="python3", resources=resources)
    client.execute()
    assert printed(book) == printed(kept)
    assert pictures(book) == pictures(kept) > 0
