"""Markdown tables of a result, on a page."""

from __future__ import annotations

import re

from wormopt.reports.parts import scrolled, table
from wormopt.reports.words import marked


def markdown_html(text: str) -> str:
    """Convert the headings, paragraphs and tables of a text."""
    return "".join(_block(block) for block in re.split(r"\n\s*\n", text.strip()) if block)


def _block(block: str) -> str:
    if block.startswith("#"):
        return f'<p class="name">{marked(block.lstrip("# "))}</p>'
    if not block.startswith("|"):
        return f'<p class="note">{marked(block)}</p>'
    heads, _, *rows = (
        [marked(cell.strip()) for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])]
        for line in block.splitlines()
    )
    return scrolled("Table", table("figures", heads, rows))
