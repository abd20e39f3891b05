"""Tutorials run, every assertion in them holds, and they print what stands on the page."""

from pathlib import Path
from typing import Any

import pytest
from places import DOCS

TUTORIALS = DOCS / "tutorials"


def printed(book: Any) -> list[str]:
    """What cells print."""
    shown = [output for cell in book.cells for output in cell.get("outputs", [])]
    return ["".join(output["text"]) for output in shown if output["output_type"] == "stream"]


def pictures(book: Any) -> int:
    shown = [output for cell in book.cells for output in cell.get("outputs", [])]
    return sum("image/png" in output.get("data", {}) for output in shown)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize(
    "name",
    [path.stem for path in sorted(TUTORIALS.glob("*.ipynb"))],
)
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
