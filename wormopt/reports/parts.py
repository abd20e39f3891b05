"""Building blocks of pages. Arguments are HTML; texts must be escaped before."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def details(summary: str, inner: str, *, opened: bool = False) -> str:
    """Content that the reader can open."""
    state = ' open=""' if opened else ""
    return f"<details{state}><summary>{summary}</summary>{inner}</details>"


def scrolled(label: str, inner: str, kind: str = "wide") -> str:
    """Content that may be wider than the page."""
    return f'<div class="{kind}" tabindex="0" role="region" aria-label="{label}">{inner}</div>'


def table(kind: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names the rows; empty columns are left out.

    Empty cells have a dash.
    """
    lines = list(rows)
    kept = [0, *(k for k in range(1, len(heads)) if any(line[k] for line in lines))]
    heads, lines = [heads[k] for k in kept], [[line[k] or "–" for k in kept] for line in lines]
    head = "".join(f'<th scope="col">{h}</th>' if h else "<td></td>" for h in heads)
    body = "".join(
        f'<tr><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in others)}</tr>'
        for first, *others in lines
    )
    return f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def code(text: str) -> str:
    """Lines to type or save."""
    return scrolled("Text of code", f"<pre><code>{text}</code></pre>")
