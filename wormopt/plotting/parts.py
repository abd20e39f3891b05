"""What the pictures share: colours, style, labels, legends and limits.

Limits are scalars of a result, or attributes, that may be missing: ``length_limits`` ([low, high]
or one such pair per link), ``rate_limit`` (a number, one per link, or [contraction, extension]
with one list each), ``spike_load_limit`` (a number or one per mass) and ``actuator_force_limit``
(a number or one per link).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
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
    """Thin dashed lines: grey where all share them, in their own colours otherwise.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    limits : sequence of tuple of float
        Levels, one tuple per curve; empty draws nothing.
    colours : sequence of str, optional
        Colours of the curves.
    """
    shared = len(set(limits)) == 1
    for values, colour in zip(limits[:1] if shared else limits, colours, strict=False):
        for value in values:
            axes.axhline(value, color=GREY if shared else colour, linestyle=(0, (5, 3)),
                         linewidth=1, zorder=1.5)  # fmt: skip


def ranges(limits: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of a length as one pair per link.

    Parameters
    ----------
    limits : list or None
        [low, high] for all, or one such pair per link.
    count : int
        Number of links.

    Returns
    -------
    list of (float, float)
        Empty without limits.

    Examples
    --------
    >>> ranges([0.7, 1.3], 2)
    [(0.7, 1.3), (0.7, 1.3)]
    """
    if limits is None:
        return []
    pairs = limits if isinstance(limits[0], list) else [limits] * count
    return [(low, high) for low, high in pairs]


def rate_ranges(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of a rate as one pair per link.

    Parameters
    ----------
    limit : number, list or None
        As for `symmetric`, or [contractions, extensions] with one list each.
    count : int
        Number of links.

    Returns
    -------
    list of (float, float)

    Examples
    --------
    >>> rate_ranges([[1.0, 2.0], [3.0, 4.0]], 2)
    [(-1.0, 3.0), (-2.0, 4.0)]
    """
    if isinstance(limit, list) and isinstance(limit[0], list):
        return [(-contraction, extension) for contraction, extension in zip(*limit, strict=True)]
    return symmetric(limit, count)


def symmetric(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give the limits of an absolute value as one pair each.

    Parameters
    ----------
    limit : number, list or None
        One for all, or one per curve.
    count : int
        Number of curves.

    Returns
    -------
    list of (float, float)
    """
    return [(-value, value) for (value,) in ceilings(limit, count)]


def ceilings(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Give upper limits as one tuple each.

    Parameters
    ----------
    limit : number, list or None
        One for all, or one per curve.
    count : int
        Number of curves.

    Returns
    -------
    list of (float,)
        Empty without a limit.
    """
    if limit is None:
        return []
    return [(value,) for value in (limit if isinstance(limit, list) else [limit] * count)]


def stretches(time: np.ndarray, holds: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of time throughout which something holds.

    Parameters
    ----------
    time : ndarray, shape (m,)
        Ascending; a time may stand twice, before and after a jump.
    holds : ndarray of bool, shape (m,)
        Whether it holds at each of them.

    Returns
    -------
    list of (float, float)
        Between neighbours at which it holds; single instants are left out.

    Examples
    --------
    >>> stretches(np.array([0.0, 1.0, 1.0, 2.0]), np.array([True, True, False, False]))
    [(0.0, 1.0)]
    """
    steps = np.concatenate([[False], holds[:-1] & holds[1:], [False]])
    edges = np.flatnonzero(steps[:-1] != steps[1:])
    return [(float(time[a]), float(time[b])) for a, b in edges.reshape(-1, 2) if time[b] > time[a]]


def shades(palette: Sequence[str], count: int) -> Sequence[str]:
    """Colours of a palette, or a ramp where there are not enough.

    Parameters
    ----------
    palette : sequence of str
        Colours that can be told apart.
    count : int
        How many are wanted.

    Examples
    --------
    >>> shades(["red", "blue"], 1), len(shades(["red", "blue"], 5))
    (['red'], 5)
    """
    if count <= len(palette):
        return palette[:count]
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, count))]


def link_lines(count: int) -> list[Line2D]:
    """How each link is drawn, dashed from the fifth on; a ramp of colours where there are many.

    Parameters
    ----------
    count : int
        Number of links.

    Returns
    -------
    list of Line2D
    """
    solid = 4 if count <= len(LINKS) else count
    return [
        Line2D([], [], color=colour, linestyle="-" if j < solid else (0, (2, 1)), linewidth=1.8,
               label=f"link {j + 1}")
        for j, colour in enumerate(shades(LINKS, count))
    ]  # fmt: skip


def link_handles(count: int) -> list[Line2D]:
    """Lines for a legend of links; of many the ends and the middle only.

    Parameters
    ----------
    count : int
        Number of links.

    Returns
    -------
    list of Line2D
    """
    return _few(link_lines(count), len(LINKS))


def mass_handles(count: int) -> list[Line2D]:
    """Lines for a legend of masses.

    Parameters
    ----------
    count : int
        Number of masses; 0 is the head.

    Returns
    -------
    list of Line2D
        Of many the ends and the middle only.
    """
    ends = {0: " (head)", count - 1: " (tail)"}
    lines = [
        Line2D([], [], color=colour, linewidth=1.8, label=f"mass {i}{ends.get(i, '')}")
        for i, colour in enumerate(shades(MASSES, count))
    ]
    return _few(lines, len(MASSES))


def _few(lines: list[Line2D], most: int) -> list[Line2D]:
    return lines if len(lines) <= most else [lines[0], lines[len(lines) // 2], lines[-1]]


def legend(axes: Axes, handles: list[Line2D]) -> None:
    """Put a legend beside the axes, where it covers nothing.

    Parameters
    ----------
    axes : Axes
        Whose legend it is.
    handles : list of Line2D
        Its entries.
    """
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5))


def label(text: str, unit: str) -> str:
    """Axis label; 'm s-1' appears as m s with a raised -1, and '1' not at all.

    Parameters
    ----------
    text : str
        What the axis shows.
    unit : str
        UDUNITS text.

    Returns
    -------
    str

    Examples
    --------
    >>> label("speed", "m s-1"), label("ratio", "1")
    ('speed (m s$^{-1}$)', 'ratio')
    """
    return text if unit == "1" else f"{text} ({raised(unit)})"


def raised(unit: str) -> str:
    """Write a unit with its powers raised, and '1' as nothing.

    Parameters
    ----------
    unit : str
        UDUNITS text.

    Returns
    -------
    str

    Examples
    --------
    >>> raised("m s-2"), raised("1")
    ('m s$^{-2}$', '')
    """
    return re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"$^{\1}$", "" if unit == "1" else unit)


def scalar(result: Result, name: str) -> Any:
    """Value of a scalar or attribute, None where the result has neither.

    Parameters
    ----------
    result : Result
        Where to look.
    name : str
        Its name.

    Returns
    -------
    number, text, list or None
    """
    if name in result.scalars:
        return result.scalars[name].value
    return result.attributes.get(name)


def facts(result: Result, *names: str) -> str:
    """Give the scalars of those names that the result has, as one line.

    Parameters
    ----------
    result : Result
        Where to look.
    *names : str
        Scalars; those that are missing or no numbers are left out.

    Returns
    -------
    str
    """
    found = [(name.replace("_", " "), result.scalars.get(name)) for name in names]
    return "    ".join(
        f"{name} {number.value:.6g} {raised(number.unit)}".rstrip()
        for name, number in found
        if number and isinstance(number.value, int | float)
    )


def sheet(width: float, height: float) -> Figure:
    """Give an empty figure with some room at its edges, bound to no window.

    Parameters
    ----------
    width, height : float
        Size in inches.

    Returns
    -------
    Figure
    """
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1)
    return Figure(figsize=(width, height), layout=layout)
