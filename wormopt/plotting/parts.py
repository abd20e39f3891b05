"""What the pictures share: colours, style, labels, legends and limits.

Limits are scalars of a result, or attributes, that may be missing: ``length_limits`` ([low, high]
or one such pair per link), ``rate_limit`` (a number, one per link, or [contraction, extension]
with one list each), ``spike_load_limit`` (a number or one per mass) and ``actuator_force_limit``
(a number or one per link).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.typing import RcKeyType

from wormopt.result import Result

# Colour-blind-safe: masses by Tol ("muted"), links by Okabe and Ito, dashed from the fifth on.
MASSES = ("#332288", "#CC6677", "#117733", "#DDAA33", "#4BA3D3",
           "#882255", "#44AA99", "#999933", "#AA4499")  # fmt: skip
LINKS = ("#0072B2", "#E69F00", "#009E73", "#D55E00") * 2
GREY, RED, GLIDE = "#666666", "#B22222", "#F3E3C3"
STYLE: dict[RcKeyType, Any] = {
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.titlesize": 10,
    "axes.titlecolor": GREY,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.solid_capstyle": "butt",
    "mathtext.fontset": "dejavusans",
}


def draw_limits(
    axes: Axes, limits: Sequence[tuple[float, ...]], colours: Sequence[str] = LINKS
) -> None:
    """Thin dashed lines: grey where all curves share them, in their own colours otherwise.

    `limits`: levels, one tuple per curve; empty draws nothing.
    """
    shared = len(set(limits)) == 1
    for values, colour in zip(limits[:1] if shared else limits, colours, strict=False):
        for value in values:
            axes.axhline(value, color=GREY if shared else colour, linestyle=(0, (5, 3)),
                         linewidth=1, zorder=1.5)  # fmt: skip


def ranges(limits: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of a length as one pair per link; empty without limits.

    `limits`: [low, high] for all, or one such pair per link.
    """
    if limits is None:
        return []
    pairs = limits if isinstance(limits[0], list) else [limits] * count
    return [(low, high) for low, high in pairs]


def rate_ranges(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of a rate as one pair per link.

    `limit`: as for `symmetric`, or [contractions, extensions] with one list each.
    """
    if isinstance(limit, list) and isinstance(limit[0], list):
        return [(-contraction, extension) for contraction, extension in zip(*limit, strict=True)]
    return symmetric(limit, count)


def symmetric(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of an absolute value, one for all or one per curve, as one pair each."""
    return [(-value, value) for (value,) in ceilings(limit, count)]


def ceilings(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give upper limits, one for all or one per curve, as 1-tuples; empty without a limit."""
    if limit is None:
        return []
    return [(value,) for value in (limit if isinstance(limit, list) else [limit] * count)]


def stretches(time: np.ndarray, holds: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of time throughout which something holds; single instants are left out.

    `time` (m,) ascends; a time may stand twice, before and after a jump.
    """
    steps = np.concatenate([[False], holds[:-1] & holds[1:], [False]])
    edges = np.flatnonzero(steps[:-1] != steps[1:])
    return [(float(time[a]), float(time[b])) for a, b in edges.reshape(-1, 2) if time[b] > time[a]]


def shades(palette: Sequence[str], count: int) -> Sequence[str]:
    """Colours of a palette, or a ramp where there are not enough."""
    if count <= len(palette):
        return palette[:count]
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, count))]


def link_lines(count: int) -> list[Line2D]:
    """How each link is drawn, dashed from the fifth on; a ramp of colours where there are many."""
    solid = 4 if count <= len(LINKS) else count
    return [
        Line2D([], [], color=colour, linestyle="-" if j < solid else (0, (2, 1)), linewidth=1.8,
               label=f"link {j + 1}")
        for j, colour in enumerate(shades(LINKS, count))
    ]  # fmt: skip


def link_handles(count: int) -> list[Line2D]:
    """Lines for a legend of links; of many the ends and the middle only."""
    return _few(link_lines(count), len(LINKS))


def mass_handles(count: int) -> list[Line2D]:
    """Lines for a legend of masses, 0 the head; of many the ends and the middle only."""
    ends = {0: " (head)", count - 1: " (tail)"}
    lines = [
        Line2D([], [], color=colour, linewidth=1.8, label=f"mass {i}{ends.get(i, '')}")
        for i, colour in enumerate(shades(MASSES, count))
    ]
    return _few(lines, len(MASSES))


def _few(lines: list[Line2D], most: int) -> list[Line2D]:
    return lines if len(lines) <= most else [lines[0], lines[len(lines) // 2], lines[-1]]


def legend(axes: Axes, handles: list[Line2D]) -> None:
    """Put a legend beside the axes, where it covers nothing."""
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5))


def label(text: str, unit: str) -> str:
    """Axis label with a UDUNITS unit; 'm s-1' appears as m s with a raised -1, '1' not at all."""
    return text if unit == "1" else f"{text} ({raised(unit)})"


def raised(unit: str) -> str:
    """Write a UDUNITS unit with its powers raised, and '1' as nothing."""
    return re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"$^{\1}$", "" if unit == "1" else unit)


def scalar(result: Result, name: str) -> Any:
    """Value of a scalar or attribute, None where the result has neither."""
    if name in result.scalars:
        return result.scalars[name].value
    return result.attributes.get(name)


def facts(result: Result, *names: str) -> str:
    """Give the named scalars as one line; those missing or no numbers are left out."""
    found = [(name.replace("_", " "), result.scalars.get(name)) for name in names]
    return "    ".join(
        f"{name} {number.value:.6g} {raised(number.unit)}".rstrip()
        for name, number in found
        if number and isinstance(number.value, int | float)
    )


class Sheet(Figure):
    """A figure that notebooks show, though it is bound to no window."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        with rc_context(STYLE), warnings.catch_warnings():
            # a title may hold letters that the font lacks; the picture is good all the same
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            self.savefig(file, format="png")
        return file.getvalue()


def sheet(width: float, height: float) -> Figure:
    """Give an empty figure, in inches, with some room at its edges, bound to no window."""
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1)
    return Sheet(figsize=(width, height), layout=layout)
