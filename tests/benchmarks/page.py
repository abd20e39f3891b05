"""One page with the tables and pictures of all benchmarks of a folder, and their history.

Every case leaves its picture and what was found as ``NAME.json`` in the folder; the page shows all
that are there, so that cases measured one by one come together.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from tests.benchmarks import CASES
from tests.benchmarks.history import Entry, table
from tests.benchmarks.run import table as laid_out

PAGE, HISTORY = "index.html", "history.json"
"""Names in the folder."""
_MOST = 8  # entries of the history that are shown

_WHOLE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Benchmarks of wormopt</title><style>{style}
body {{ max-width: 64rem; }} img {{ max-width: 100%; background: #fff; }}</style></head><body>
<h1>Benchmarks of wormopt</h1>
<nav><ul>{contents}</ul></nav>
{sections}
</body></html>
"""


def keep(folder: Path, found: Mapping[str, Any], machine: Mapping[str, str]) -> None:
    """Leave what was found of a case for the page."""
    file = folder / f"{found['case']}.json"
    file.write_text(json.dumps({"machine": machine, "found": found}) + "\n", encoding="utf-8")


def write(folder: Path, entries: Sequence[Entry]) -> Path:
    """Write the page of all cases in a folder; its place."""
    known = [name for name in CASES if (folder / f"{name}.json").is_file()]
    contents = "".join(f'<li><a href="#{n}">{n}</a>: {html.escape(CASES[n])}</li>' for n in known)
    sections = "\n".join("".join(_section(folder, name, entries)) for name in known)
    style = (files("wormopt.reports") / "page.css").read_text("utf-8")
    page = _WHOLE.format(style=style, contents=contents, sections=sections)
    (folder / PAGE).write_text(page, encoding="utf-8")
    return folder / PAGE


def _section(folder: Path, name: str, entries: Sequence[Entry]) -> Iterator[str]:
    kept = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    yield f'<section id="{name}"><h2>{name}</h2>'
    picture = folder / f"{name}.png"
    if picture.is_file():
        coded = base64.b64encode(picture.read_bytes()).decode()
        shown = html.escape(CASES[name])
        yield f'<figure><img alt="{shown}" src="data:image/png;base64,{coded}"></figure>'
    yield f"<pre>{html.escape(laid_out(kept['found']))}</pre>"
    machine = ", ".join(f"{key} {value}" for key, value in kept["machine"].items())
    yield f'<p class="note">{html.escape(machine)}</p>'
    rows = table(entries[-_MOST:], name)
    if rows:
        yield "<h3>History</h3><table>"
        for row in rows:
            yield "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
        yield "</table>"
    yield "</section>"
