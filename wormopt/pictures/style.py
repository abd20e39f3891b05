# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownLambdaType=false
"""Style of pictures: colours, sizes, and how numbers, units and names are written.

Everything is numbered from 0: mass 0 is the head, link 0 joins masses 0 and 1.
"""

from __future__ import annotations

import math
import re
import warnings
from base64 import b64encode
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, rc_context, rcParams
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from wormopt.lazy import above

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType  # since Matplotlib 3.11

# Safe for colour-blind readers: masses by Tol ("muted"), links by Okabe and Ito, and a third
# palette for variables beside them; joints begin at the other end of that of links. Dashes
# distinguish links in grey, and where curves overlap.
MASSES = ("#332288", "#CC6677", "#117733", "#999933", "#882255",
          "#44AA99", "#AA4499", "#DDAA33", "#4BA3D3")  # fmt: skip
LINKS = ("#0072B2", "#E69F00", "#009E73", "#D55E00") * 2
VARIABLES = ("#8C510A", "#B22222", "#1B7F79", "#7B3FB2", "#8A8A8A")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (6, 1.2, 1.2, 1.2)))
GREY, RED, GLIDE = "#5A5A5A", "#B22222", "#F3E3C3"
LIMIT: Any = (0, (5, 3))  # dashes of limits, thin and grey
CENTRED: dict[str, Any] = {"ha": "center", "va": "center_baseline", "weight": "bold"}
COLUMN, PAGE = 85.0, 180.0  # widths of one column and of two in a journal, mm
INCH = 25.4
_NARROW, _INCHES = 120.0, 7.1  # heights of pictures are given for this width
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


@contextmanager
def styled(more: Mapping[RcKeyType, Any] = MappingProxyType({})) -> Generator[None]:
    """Draw in our style, and with more settings of Matplotlib."""
    with rc_context({**STYLE, **more}), warnings.catch_warnings():
        # a title may have letters that the font lacks
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


class Sheet(Figure):
    """A figure that notebooks show, without a window."""

    page: Any = None  # which an animation draws on
    moves: Any = None  # the animation

    def _repr_html_(self) -> str | None:
        if self.moves is None:
            return None
        svg: str = above("wormopt.pictures:moving_svg")(self.moves, self)
        code = b64encode(svg.encode()).decode()
        return f'<img src="data:image/svg+xml;base64,{code}" alt="an animation">'

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        with styled():
            self.savefig(file, format="png")
        return file.getvalue()


def sheet(height: float, slim: float | None = None) -> Sheet:
    """Make an empty figure of the requested width, without a window.

    `height` is in inches if it fills a page; `slim` in one column, if that is not in proportion.
    """
    wanted = rcParams["figure.figsize"][0]
    tall = height * wanted / _INCHES
    if slim is not None:
        share = np.clip((wanted * INCH - COLUMN) / (PAGE - COLUMN), 0, None)
        tall = float(slim + share * (height * PAGE / INCH / _INCHES - slim))
    return Sheet((wanted, tall), layout=ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.04))


def narrow() -> bool:
    """Whether pictures are one column wide: legends and panels are then below others."""
    return rcParams["figure.figsize"][0] * INCH < _NARROW


# -- numbers, units and words ----------------------------------------------------------------------


def number(value: float, digits: int = 4) -> str:
    """Format a number with this many significant digits, powers of ten raised."""
    mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "−").partition("e")
    if not exponent:
        return mantissa
    return rf"{mantissa}·10$^{{{int(exponent.replace('−', '-'))}}}$"


def label(text: str, unit: str) -> str:
    """Axis label with a UDUNITS unit; 'm s-1' appears as m s with a raised -1, '1' not at all."""
    return text if unit == "1" else f"{text} ({raised(unit)})"


def raised(unit: str) -> str:
    """Format a UDUNITS unit with raised powers, and '1' as nothing."""
    text = "" if unit == "1" else unit.replace(" ", "\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"$^{\1}$", text)


def multiple(unit: str, wanted: str) -> float | None:
    """Number of wanted units ("mm s-1" of m s-1, "%" of 1) in one unit; None if it is none."""
    if unit == "1":
        return 100.0 if wanted == "%" else None
    times = {"": 1.0, "m": 1e3, "µ": 1e6, "k": 1e-3}.get(wanted.removesuffix(unit))
    power = re.fullmatch(r"[A-Za-z]+(-?\d)", unit.split()[0])  # the prefix is raised with its unit
    return times ** int(power[1]) if times and power else times


def wrapped(text: str, letters: float) -> str:
    """Break a text into lines of this many letters, without breaking formulas."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|[^ \n])+", text):
        if lines[-1] and visible(f"{lines[-1]} {word}") > letters:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def visible(text: str) -> int:
    """Number of visible letters of a text."""
    return len(re.sub(r"\\[a-z]+", "x", text).translate({ord(mark): None for mark in "${}^_"}))


def room(abreast: int) -> int:
    """Number of letters of a title that fit above each of several panels side by side."""
    return max(8, int(13 * rcParams["figure.figsize"][0] / abreast) - 2)


# -- curves and their names ------------------------------------------------------------------------


def shades(palette: Sequence[str], count: int) -> Sequence[str]:
    """Colours of a palette, or a ramp if there are not enough."""
    if count <= len(palette):
        return palette[:count]
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, count))]


def colours(what: str, count: int) -> Sequence[str]:
    """Colours of masses and rings, of joints, or of links and all else."""
    others = LINKS[::-1] if what == "joint" else LINKS
    return shades(MASSES if what in ("mass", "ring") else others, count)


def styles(what: str, count: int) -> list[tuple[str, Any]]:
    """Colour and dashes of each curve: those of masses are solid."""
    plain = what in ("mass", "ring") or count > len(LINKS)
    return [
        (colour, "-" if plain else DASHES[(j + j // 4) % 4])
        for j, colour in enumerate(colours(what, count))
    ]


def labels(what: str, count: int, *, worm: bool = True) -> list[str]:
    """Names of links, masses, motors or other parts, numbered from 0."""
    ends = {0: " (head)", count - 1: " (tail)"} if worm and what == "mass" and count > 1 else {}
    return [f"{what.removesuffix('_entry')} {i}{ends.get(i, '')}" for i in range(count)]


def named(count: int) -> Sequence[int]:
    """Indices that a legend names: of more than nine entries the ends and the middle."""
    return range(count) if count <= len(MASSES) else (0, count // 2, count - 1)


def line(
    text: str, color: str = GREY, ls: Any = "-", lw: float = 1.3, marker: str = "", **style: Any
) -> Line2D:
    """Make an entry of a legend, for what many artists draw."""
    look: dict[str, Any] = {"color": color, "ls": ls, "lw": lw, "marker": marker} | style
    return Line2D([], [], label=text, **look)


def patch(text: str, color: str, **style: Any) -> Patch:
    """Make an entry of a legend that is an area."""
    look: dict[str, Any] = {"linewidth": 0} | style
    return Patch(facecolor=color, label=text, **look)


def fitted(entries: Sequence[Artist], share: float) -> tuple[list[str], int]:
    """Texts of a legend, long ones in lines, and number of columns in a share of the sheet."""
    room = share * 72 * rcParams["figure.figsize"][0]
    longest = min(52, int((room - 30) / 4.1))
    texts = [wrapped(str(entry.get_label()), longest) for entry in entries]
    widths = [26 + 4.1 * max(map(visible, text.split("\n"))) for text in texts]
    counts = range(len(entries), 1, -1)
    fits = [n for n in counts if sum(map(max, np.array_split(widths, n))) < room] or [1]
    rows = math.ceil(len(entries) / fits[0])  # as few as possible, with columns of similar length
    return texts, min(n for n in fits if math.ceil(len(entries) / n) == rows)


def few_decades(axis: Axis) -> None:
    """Ticks of a logarithmic axis that spans a decade or two, written out."""
    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high < 150 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps, numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    axis.set_minor_locator(NullLocator())


def stretches(time: np.ndarray, holds: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of time in which a condition holds; single instants are left out.

    `time` (m,) ascends; a time may occur twice, before and after a jump.
    """
    steps = np.concatenate([[False], holds[:-1] & holds[1:], [False]])
    edges = np.flatnonzero(steps[:-1] != steps[1:])
    return [(float(time[a]), float(time[b])) for a, b in edges.reshape(-1, 2) if time[b] > time[a]]
