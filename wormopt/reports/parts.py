"""Building blocks of pages: HTML, with numbers, units and names as words."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def details(summary: str, inner: str, *, opened: bool = False) -> str:
    """Content that the reader can open."""
    state = ' open=""' if opened else ""
    return f"<details{state}><summary>{summary}</summary>{inner}</details>"


def scrolled(label: str, inner: str, kind: str = "wide") -> str:
    """Content that may be wider than the page."""
    return f'<div class="{kind}" tabindex="0" role="region" aria-label="{label}">{inner}</div>'


def table(kind: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names the rows; empty columns are left out."""
    lines = list(rows)
    kept = [0, *(k for k in range(1, len(heads)) if any(line[k] for line in lines))]
    heads, lines = [heads[k] for k in kept], [[line[k] or "–" for k in kept] for line in lines]
    head = "".join(f'<th scope="col">{h}</th>' if h else "<td></td>" for h in heads)
    body = "".join(
        f'<tr><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in others)}</tr>'
        for first, *others in lines
    )
    return f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def controls(last: int) -> str:
    """Button and slider over frames 0 to `last`, which the page's script shows."""
    return (
        '<div class="controls"><button type="button" class="play" aria-pressed="false">Play'
        '</button><input type="range" class="slider" min="0" '
        f'max="{last}" value="0" step="1" aria-label="Time"><output class="now"></output></div>'
    )


def code(text: str) -> str:
    """Lines to type or save."""
    return scrolled("Text of code", f"<pre><code>{text}</code></pre>")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_THIN = "\u202f"  # narrow no-break space
_NAMED = {"n_events": "number of events", "n_steps": "number of steps", "x_end": "positions at end",
          "v_end": "velocities at end", "k_end": "gains at end"}  # fmt: skip
# An absolute path of any system, not preceded by part of a word or a unit.
_PATH = re.compile(
    r"(?<![\w.<:/\\])(?:file://)?(?:~[\w.-]*/|/(?=[^\s/'\"]+/)|[A-Za-z]:[\\/]|\\\\)[^\s'\",;:()]*"
)


def escaped(text: object) -> str:
    """Escape a text for HTML, also for attributes."""
    return html.escape(public(str(text)), quote=True)


def public(text: str) -> str:
    """Shorten every absolute path to the name of the file, for privacy."""
    return _PATH.sub(lambda found: re.split(r"[\\/]", found[0].rstrip("\\/"))[-1], text)


def number(value: float | None, digits: int = 6) -> str:
    """Format a number with this many significant digits, powers of ten raised; NaN: unknown."""
    if value is None or not math.isfinite(value):
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value == int(value) and abs(value) < 1e7:
        whole = f"{int(value):,}" if abs(value) >= 1e4 else str(int(value))
        return whole.replace(",", _THIN).replace("-", "−")
    if 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits}g}".replace("-", "−")
    mantissa, power = f"{value:.{min(digits, 4) - 1}e}".split("e")
    mantissa = mantissa.rstrip("0").rstrip(".").replace("-", "−")
    return f"{mantissa}{_THIN}×{_THIN}10{str(int(power)).translate(_RAISED)}"


def unit_text(unit: str) -> str:
    """Format a UDUNITS unit with raised powers, without line breaks, and '1' as nothing."""
    unit = unit.replace(" ", "\N{NO-BREAK SPACE}")
    raised = re.sub(r"(?<=[A-Za-z])-?\d+", lambda power: power[0].translate(_RAISED), unit)
    return "" if unit == "1" else raised


def value_text(value: Any, unit: str = "1", digits: int = 6) -> str:
    """Format a value of a scalar, an attribute or a key, with its unit."""
    if value is None or value == [] or value == {}:
        return "unknown" if value is None else "none"
    return f"{_bare(value, digits)}{_THIN}{unit_text(unit)}".rstrip(_THIN)


def _bare(value: Any, digits: int) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return ", ".join(f"{name_text(k)} {_bare(v, digits)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        inner = [_bare(item, digits) for item in value]
        nested = any(isinstance(item, list | tuple) for item in value)
        return " ".join(f"[{item}]" for item in inner) if nested else ", ".join(inner)
    return number(value, digits)


def name_text(name: str) -> str:
    """Format the name of a scalar, a check or a key as words."""
    return _NAMED.get(name, name.replace("_", " "))


def sentence(text: str) -> str:
    """Capitalise, except the key of a scene, and end with a full stop."""
    text = text.strip()
    end = "" if text.endswith((".", "!", "?")) else "."
    first = text[:1] if re.match(r"\w+[._]\w", text) else text[:1].upper()
    return f"{first}{text[1:]}{end}" if text else ""


def marked(text: str) -> str:
    """Convert the simple Markdown of meanings into HTML."""
    text = escaped(text.replace("\\|", "|"))
    text = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    text = re.sub(r"\*([^*\s][^*]*)\*", r"<em>\1</em>", text)
    return re.sub(r"&lt;(/?su[bp])&gt;", r"<\1>", text)
