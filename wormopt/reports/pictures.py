"""Pictures of a result as SVG for use with others in one page."""

from __future__ import annotations

import inspect
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from wormopt.kinds import KINDS
from wormopt.reports.parts import controls, escaped
from wormopt.result import Result


@dataclass(frozen=True)
class Picture:
    """A picture, or the reason why there is none."""

    caption: str
    svg: str
    missing: str = ""

    def html(self) -> str:
        """The picture as an HTML figure."""
        if not self.svg:
            return f'<p class="note">{escaped(self.missing)}</p>' if self.missing else ""
        return (
            f'<figure class="picture"><div class="card">{self.svg}</div>'
            f"<figcaption>{escaped(self.caption)}</figcaption></figure>"
        )


def pictures(result: Result, prefix: str, room: float, most: int = 12) -> Iterator[Picture]:
    """Draw the pictures of a result, as long as there is room for this many letters.

    `prefix` begins every id, so that ids are unique on a page.
    """
    names = KINDS[result.kind].pictures if result.kind in KINDS else {}
    for name in [name for name in names if name != "animation"][:most]:
        made = _picture(result, name, f"{prefix}-{name}-")
        if len(made.svg) > room:
            made = Picture("", "", f"The picture “{name}” is left out for want of room.")
        room -= len(made.svg)
        yield made


def _picture(result: Result, name: str, prefix: str) -> Picture:
    from wormopt.pictures import figure
    from wormopt.pictures.style import styled

    caption = _caption(KINDS[result.kind].pictures[name])
    try:
        drawn = figure(result, name, title=False)  # the page contains it
        into = io.StringIO()
        with styled({"svg.hashsalt": prefix, "path.simplify_threshold": 0.4}):
            drawn.savefig(into, format="svg")
    except KeyError:  # results for this picture were not requested
        return Picture(caption, "")
    except Exception as error:  # a failed picture must not cost the page
        what = f"{type(error).__name__}: {error}"
        return Picture(caption, "", f"The picture “{name}” could not be drawn ({what}).")
    return Picture(caption, _embedded(into.getvalue(), prefix, caption))


_MOST_FRAMES = 80


def animation(result: Result, ident: str, room: float) -> str:
    """The animation of a result as a figure for the page's script, empty if it has none.

    `room`: largest number of letters.
    """
    names = KINDS[result.kind].pictures if result.kind in KINDS else {}
    if "animation" not in names:
        return ""
    from wormopt.pictures import all_frames, figure

    try:
        drawn: Any = figure(result, "animation", title=False)
        every = -(-drawn.moves.frames // _MOST_FRAMES)
        svg = all_frames(drawn.moves, drawn, every)
    except KeyError:  # results for this picture were not requested
        return ""
    except Exception as error:  # a failed picture must not cost the page
        what = f"The animation could not be drawn ({type(error).__name__}: {error})."
        return f'<p class="note">{escaped(what)}</p>'
    svg = _embedded(svg, f"{ident}-", "The motion at the chosen time")
    if len(svg) > room:
        return '<p class="note">The animation is left out for want of room.</p>'
    last = -(-drawn.moves.frames // every) - 1
    return (
        f'<figure class="film" id="{ident}"><div class="card">{svg}</div>{controls(last)}</figure>'
    )


def _caption(source: str) -> str:
    module, _, function = source.partition(":")
    doc = inspect.getdoc(getattr(import_module(module), function)) or ""
    return " ".join(doc.split("\n\n")[0].split())


def _embedded(svg: str, prefix: str, caption: str) -> str:
    """Embed a file's SVG in a page, with unique ids, only visible parts, and short numbers."""
    from wormopt.pictures import shortened

    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.S)
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda m: f' id="{prefix}{m[1]}"' if m[1] in used else "", svg)
    svg = re.sub(r'(url\(#|href="#)', rf"\g<1>{prefix}", svg)
    svg = shortened(svg)
    head = re.search(r'viewBox="[^"]*"', svg)
    whole = (
        f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" {head[0] if head else ""} role="img" '
        f'aria-label="{escaped(caption)}">'
    )
    return re.sub(r"\s*\n\s*", "\n", whole + svg[svg.index(">") + 1 :].strip())
