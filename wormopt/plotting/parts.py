"""Common parts of pictures: sheet, colours, style, labels, facts, legends and limits.

Everything is numbered from 0: mass 0 is the head, link 0 joins masses 0 and 1.

Limits are scalars of a result, or attributes, that may be missing: ``length_limits`` ([low, high]
or one such pair per link), ``rate_limit`` (a number, one per link, or [contraction, extension]
with one list each), ``acceleration_limit`` and ``actuator_force_limit`` (a number or one per
link), ``spike_load_limit`` (a number or one per mass).
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, rc_context, rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from wormopt.errors import UnknownNameError
from wormopt.result import Result

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType  # since Matplotlib 3.11

# Safe for colour-blind readers: masses by Tol ("muted"), links by Okabe and Ito. Dashes distinguish
# links in grey, and where curves overlap.
MASSES = ("#332288", "#CC6677", "#117733", "#DDAA33", "#4BA3D3",
           "#882255", "#44AA99", "#999933", "#AA4499")  # fmt: skip
LINKS = ("#0072B2", "#E69F00", "#009E73", "#D55E00") * 2
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (6, 1.2, 1.2, 1.2)))
GREY, RED, GLIDE = "#5A5A5A", "#B22222", "#F3E3C3"
LIMIT: Any = (0, (5, 3))  # dashes of limits, thin and grey
COLUMN, PAGE = 85.0, 180.0  # widths of one column and of two in a journal, mm
_NARROW, _INCH = 120.0, 25.4
STYLE: dict[RcKeyType, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.titlepad": 4,
    "axes.labelsize": 8,
    "axes.labelpad": 3,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 7.5,
    "legend.handlelength": 1.9,
    "legend.columnspacing": 1.2,
    "legend.labelspacing": 0.35,
    "legend.borderaxespad": 0.3,
    "lines.linewidth": 1.3,
    "lines.markersize": 5,
    "lines.solid_capstyle": "butt",
    "patch.linewidth": 0.6,
    "mathtext.fontset": "dejavusans",
    # letters as outlines: independent of installed fonts, and the same bytes each time
    "svg.fonttype": "path",
    "svg.hashsalt": "wormopt",
    "pdf.fonttype": 42,
}


class Sheet(Figure):
    """A figure that notebooks show, without a window."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        with rc_context(STYLE), warnings.catch_warnings():
            # a title may have letters that the font lacks
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            self.savefig(file, format="png")
        return file.getvalue()


def sheet(width: float, height: float, narrow: float | None = None) -> Figure:
    """Make an empty figure of the requested width, without a window.

    `width` and `height` are its proportions, in inches if it fills a page; `narrow` its height in
    inches in one column, if that is not in proportion.
    """
    wanted = rcParams["figure.figsize"][0]
    tall = height * wanted / width
    if narrow is not None:
        share = np.clip((wanted * _INCH - COLUMN) / (PAGE - COLUMN), 0, None)
        tall = float(narrow + share * (height * PAGE / _INCH / width - narrow))
    return Sheet((wanted, tall), layout=ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.04))


def narrow() -> bool:
    """Whether pictures are one column wide: legends and panels are then below others."""
    return rcParams["figure.figsize"][0] * _INCH < _NARROW


def tell(drawn: Figure, *parts: str) -> None:
    """Put facts, one text each, in the heading of a picture; empty ones are left out."""
    text = "; ".join(part for part in parts if part)
    if text:
        drawn.text(0.0, 1.0, text, label=FACTS)


FACTS = "facts"  # label of the texts in the heading


def fact(result: Result, name: str, words: str = "", unit: str = "") -> str:
    """Describe a scalar, in its unit or a multiple ("mm s-1" of m s-1, "%" of 1).

    Empty if the result has no such number; dimensionless ones stay so.
    """
    known = result.scalars.get(name)
    if known is None or isinstance(known.value, bool) or not isinstance(known.value, int | float):
        return ""
    times = _multiple(known.unit, unit)
    unit = unit if times else known.unit
    times = times or 1.0
    described = f"{words or name.replace('_', ' ')} {number(times * known.value)}"
    return f"{described}\N{NO-BREAK SPACE}{raised(unit or known.unit)}".rstrip()


def _multiple(unit: str, wanted: str) -> float | None:
    """Number of wanted units in one unit; None if it is no multiple."""
    if unit == "1":
        return 100.0 if wanted == "%" else None
    times = {"": 1.0, "m": 1e3, "µ": 1e6, "k": 1e-3}.get(wanted.removesuffix(unit))
    power = re.fullmatch(r"[A-Za-z]+(-?\d)", unit.split()[0])  # the prefix is raised with its unit
    return times ** int(power[1]) if times and power else times


def number(value: float, digits: int = 4) -> str:
    """Format a number with this many significant digits, powers of ten raised."""
    mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "−").partition("e")
    if not exponent:
        return mantissa
    return rf"{mantissa}·10$^{{{int(exponent.replace('−', '-'))}}}$"


def needed(result: Result, name: str) -> Any:
    """Value of a scalar or attribute; UnknownNameError if the result has neither."""
    value = scalar(result, name)
    if value is None:
        known = [*result.scalars, *result.attributes]
        raise UnknownNameError("the result", "number", [name], known)
    return value


def draw_limits(
    axes: Axes, limits: Sequence[tuple[float, ...]], colours: Sequence[str] = LINKS
) -> list[Line2D]:
    """Thin dashed lines: grey if all curves share them, in their own colours otherwise.

    `limits`: levels, one tuple per curve; empty draws nothing. Returns entries of the legend.
    """
    shared = len(set(limits)) == 1
    for values, colour in zip(limits[:1] if shared else limits, colours, strict=False):
        for value in values:
            axes.axhline(value, color=GREY if shared else colour, linestyle=LIMIT, linewidth=0.8,
                         zorder=1.5)  # fmt: skip
    return [line("limit" if shared else "limits", GREY, LIMIT, 0.8)] if limits else []


def line(
    text: str, colour: str = GREY, dashes: Any = "-", width: float = 1.3, marker: str = ""
) -> Line2D:
    """Make an entry of a legend."""
    return Line2D(
        [], [], color=colour, linestyle=dashes, linewidth=width, marker=marker, label=text
    )


def ranges(limits: Any, count: int) -> list[tuple[float, ...]]:
    """Limits of a length as one pair per link; empty without limits.

    `limits`: [low, high] for all, or one such pair per link.
    """
    if limits is None:
        return []
    pairs = limits if isinstance(limits[0], list) else [limits] * count
    return [(low, high) for low, high in pairs]


def rate_ranges(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Limits of a rate as one pair per link.

    `limit`: as for `symmetric`, or [contractions, extensions] with one list each.
    """
    if isinstance(limit, list) and isinstance(limit[0], list):
        return [(-contraction, extension) for contraction, extension in zip(*limit, strict=True)]
    return symmetric(limit, count)


def few_decades(axis: Axis) -> None:
    """Ticks of a logarithmic axis that spans a decade or two, written out."""
    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high < 150 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps, numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    axis.set_minor_locator(NullLocator())


def symmetric(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Limits of an absolute value, one for all or one per curve, as one pair each."""
    return [(-value, value) for (value,) in ceilings(limit, count)]


def ceilings(limit: Any, count: int) -> list[tuple[float, ...]]:
    """Upper limits, one for all or one per curve, as 1-tuples; empty without a limit."""
    if limit is None:
        return []
    return [(value,) for value in (limit if isinstance(limit, list) else [limit] * count)]


def stretches(time: np.ndarray, holds: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of time in which a condition holds; single instants are left out.

    `time` (m,) ascends; a time may occur twice, before and after a jump.
    """
    steps = np.concatenate([[False], holds[:-1] & holds[1:], [False]])
    edges = np.flatnonzero(steps[:-1] != steps[1:])
    return [(float(time[a]), float(time[b])) for a, b in edges.reshape(-1, 2) if time[b] > time[a]]


def draw_rests(axes: Axes, time: np.ndarray, resting: np.ndarray) -> None:
    """One row per mass, filled while it rests; glides are shaded across all rows.

    `time` (m,) as for `stretches`; `resting` (masses, m), whether each mass rests.
    """
    entries: list[Artist] = [Patch(color=GREY, label="rests")]
    for start, end in stretches(time, ~np.any(resting, axis=0)):
        axes.axvspan(start, end, color=GLIDE, linewidth=0)
        entries[1:] = [Patch(color=GLIDE, label="worm glides")]
    for i, (rests, colour) in enumerate(zip(resting, shades(MASSES, len(resting)), strict=True)):
        bars = [(start, end - start) for start, end in stretches(time, rests)]
        axes.broken_barh(bars, (i - 0.38, 0.76), color=colour, linewidth=0)
    each = range(0, len(resting), 1 if len(resting) <= 12 else 5)
    axes.set_yticks(each, [str(i) for i in each])
    axes.set_ylim(len(resting) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0)
    axes.set_ylabel("mass\nat rest")
    legend(axes, entries)


def shades(palette: Sequence[str], count: int) -> Sequence[str]:
    """Colours of a palette, or a ramp if there are not enough."""
    if count <= len(palette):
        return palette[:count]
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, count))]


def labels(what: str, count: int, *, worm: bool = True) -> list[str]:
    """Names of links, masses, motors or other parts, numbered from 0."""
    worm = worm and what == "mass" and count > 1
    ends = {0: " (head)", count - 1: " (tail)"} if worm else {}
    return [f"{what} {i}{ends.get(i, '')}" for i in range(count)]


def styles(palette: Sequence[str], count: int) -> list[tuple[str, Any]]:
    """Colour and dashes of each curve; a ramp of colours for many."""
    many = count > len(palette)
    return [
        (colour, "-" if many else DASHES[(j + j // 4) % 4])
        for j, colour in enumerate(shades(palette, count))
    ]


def handles(what: str, count: int, *, worm: bool = True) -> list[Line2D]:
    """Lines for a legend of links or masses; of many the ends and the middle only."""
    if what == "link":
        named = zip(labels(what, count), styles(LINKS, count), strict=True)
        lines = [line(name, *style) for name, style in named]
    else:
        lines = list(map(line, labels(what, count, worm=worm), shades(MASSES, count)))
    return lines if count <= len(MASSES) else [lines[0], lines[count // 2], lines[-1]]


def legend(axes: Axes, entries: Sequence[Artist] | None = None, title: str = "") -> None:
    """Put a legend where it covers nothing: beside the axes, in one column above them.

    Of `entries`, or of labelled curves. Set the title of the axes before.
    """
    entries = list(axes.get_legend_handles_labels()[0] if entries is None else entries)
    if narrow():
        legend_above(axes, entries, title, share=0.75)
    else:
        texts, _ = _fitted(entries, 0.25)
        axes.legend(entries, texts, loc="center left", bbox_to_anchor=(1.0, 0.5), title=title)


def legend_above(
    axes: Axes, entries: Sequence[Artist] | None = None, title: str = "", share: float = 0.9
) -> None:
    """Put a legend above axes that take this share of the sheet, below their title."""
    entries = list(axes.get_legend_handles_labels()[0] if entries is None else entries)
    texts, columns = _fitted(entries, share)
    axes.legend(entries, texts, loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=columns,
                title=title, alignment="left")  # fmt: skip
    if heading := axes.get_title(loc="left"):
        rows = max(sum(1 + text.count("\n") for text in column)
                   for column in np.array_split(np.array(texts), columns))  # fmt: skip
        axes.set_title(heading, pad=5 + 11 * (rows + bool(title)))


def legend_below(drawn: Figure, entries: Sequence[Artist] | None = None) -> None:
    """Put a legend for all panels below them; of labelled curves if no entries are given."""
    if entries is None:
        found = [
            pair
            for axes in drawn.axes
            for pair in zip(*axes.get_legend_handles_labels(), strict=True)
        ]
        named = {text: entry for entry, text in reversed(found)}
        entries = [named[text] for text in dict.fromkeys(text for _, text in found)]
    texts, columns = _fitted(entries, 1.0)
    drawn.legend(list(entries), texts, loc="outside lower center", ncols=columns)


def _fitted(entries: Sequence[Artist], share: float) -> tuple[list[str], int]:
    """Texts of a legend, long ones in lines, and number of columns in a share of the sheet."""
    room = share * 72 * rcParams["figure.figsize"][0]
    longest = min(52, int((room - 30) / 4.1))
    texts = [wrapped(str(entry.get_label()), longest) for entry in entries]
    widths = [26 + 4.1 * max(map(_letters, text.split("\n"))) for text in texts]
    counts = range(len(entries), 1, -1)
    fits = [n for n in counts if sum(map(max, np.array_split(widths, n))) < room] or [1]
    rows = math.ceil(len(entries) / fits[0])  # as few as possible, with columns of similar length
    return texts, min(n for n in fits if math.ceil(len(entries) / n) == rows)


def wrapped(text: str, letters: int) -> str:
    """Break a text into lines of this many letters, without breaking formulas."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|[^ \n])+", text):
        if lines[-1] and _letters(f"{lines[-1]} {word}") > letters:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def room(abreast: int) -> int:
    """Number of letters of a title that fit above each of several panels side by side."""
    return max(8, int(13 * rcParams["figure.figsize"][0] / abreast) - 2)


def _letters(text: str) -> int:
    """Number of visible letters of a text."""
    return len(re.sub(r"\\[a-z]+", "x", text).translate({ord(mark): None for mark in "${}^_"}))


def label(text: str, unit: str) -> str:
    """Axis label with a UDUNITS unit; 'm s-1' appears as m s with a raised -1, '1' not at all."""
    return text if unit == "1" else f"{text} ({raised(unit)})"


def raised(unit: str) -> str:
    """Format a UDUNITS unit with raised powers, and '1' as nothing."""
    text = "" if unit == "1" else unit.replace(" ", "\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"$^{\1}$", text)


def scalar(result: Result, name: str) -> Any:
    """Value of a scalar or attribute, None if the result has neither."""
    if name in result.scalars:
        return result.scalars[name].value
    return result.attributes.get(name)
