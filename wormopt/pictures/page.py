# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""A Page of Panels over the variables and scalars of a result.

Variables declare unit, dimensions and meaning, so that axes label themselves, curves of links and
masses take their colours and names, and numbers appear in the units that the page shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from wormopt.errors import UnknownNameError
from wormopt.pictures.style import (
    GLIDE,
    GREY,
    LIMIT,
    colours,
    fitted,
    label,
    labels,
    line,
    multiple,
    named,
    narrow,
    number,
    raised,
    sheet,
    stretches,
    styles,
)
from wormopt.quantities import Variable
from wormopt.result import Result

FACTS = "facts"  # label of the texts in the heading
Data = str | ArrayLike
_SYMBOLS = {"time": "time $t$", "instant": "time $t$"}


class Page:
    """A sheet that shows a result in panels, with one legend and facts in numbers.

    `page["speed"]` is the value of a variable, a scalar or an attribute, in the unit shown.

    Parameters
    ----------
    result : Result
        The result shown.
    tall, slim : float
        Height in inches as wide as a page, and in one column, if not in proportion.
    units : tuple of str
        Units that are shown instead of their multiples, "mm" and "mm s-1" say.
    """

    def __init__(
        self, result: Result, tall: float, slim: float | None = None, units: Iterable[str] = ()
    ) -> None:
        self.result, self.units = result, tuple(units)
        self.drawn = sheet(tall, slim)
        self.drawn.page = self
        self.panels: list[Panel] = []

    def __contains__(self, name: str) -> bool:
        return name in self.result

    def __getitem__(self, name: str) -> Any:
        value = self.get(name)
        if value is None:
            known = [*(v.name for v in self.result.variables), *self.result.scalars]
            what = "scalar or variable"
            raise UnknownNameError("the result", what, [name], [*known, *self.result.attributes])
        return value

    def get(self, name: str) -> Any:
        """Value of that name in the unit shown; None where it is unknown or absent."""
        if name in self.result.scalars:
            known = self.result.scalars[name]
            times = self._shown(known.unit)[1]
            return known.value if times == 1 or known.value is None else _times(known.value, times)
        if name in self.result:
            variable = self.result[name]
            times = self._shown(variable.unit)[1]
            return variable.values if times == 1 else times * variable.values
        return self.result.attributes.get(name)

    def length(self, name: str) -> Any:
        """Attribute that is a length, or several, in metres, in the unit shown."""
        return self._shown("m")[1] * np.array(self[name])

    def unit(self, name: str) -> str:
        """Unit in which a variable or scalar is shown."""
        return self._shown(self.result[name].unit)[0]

    def _shown(self, unit: str) -> tuple[str, float]:
        for wanted in self.units if unit != "1" else ():
            if times := multiple(unit, wanted):
                return wanted, times
        return unit, 1.0

    # -- panels

    def panel(self, place: Any = None) -> Panel:
        """A panel at a place of a grid, or the only one."""
        axes = self.drawn.add_subplot(place) if place is not None else self.drawn.subplots()
        return self._made(axes)

    def rows(self, *heights: float, share: bool = True) -> list[Panel]:
        """Panels of these heights, one below another, with one x axis or with their own."""
        drawn = self.drawn.subplots(
            len(heights), sharex=share, height_ratios=heights, squeeze=False
        )  # fmt: skip
        return [self._made(axes) for axes in drawn[:, 0]]

    def grid(self, down: int, across: int, within: Any = None, **more: Any) -> list[list[Panel]]:
        """Panels in rows and columns of the sheet or of a place in a grid."""
        if within is None:
            drawn = self.drawn.subplots(down, across, squeeze=False, **more)
        else:
            drawn = within.subgridspec(down, across).subplots(squeeze=False, **more)
        return [[self._made(axes) for axes in row] for row in drawn]

    def beside(self, count: int, **more: Any) -> list[Panel]:
        """Panels side by side, or one below another in a column."""
        drawn = self.grid(*((count, 1) if narrow() else (1, count)), **more)
        return [panel for row in drawn for panel in row]

    def mosaic(
        self,
        wide: str,
        slim: str,
        tall: Sequence[float],
        taller: Sequence[float],
        widths: Sequence[float] | None = None,
    ) -> dict[str, Panel]:
        """Panels by letter, as they lie on a page and in a column, with the heights of rows."""
        if narrow():
            drawn = self.drawn.subplot_mosaic(slim, height_ratios=taller)
        else:
            drawn = self.drawn.subplot_mosaic(wide, height_ratios=tall, width_ratios=widths)
        return {name: self._made(axes) for name, axes in drawn.items()}

    def _made(self, axes: Axes) -> Panel:
        self.panels.append(Panel(axes, self))
        return self.panels[-1]

    # -- facts and the legend

    def fact(self, name: str, words: str = "", unit: str = "") -> str:
        """Describe a scalar, in its unit or a multiple ("mm s-1" of m s-1, "%" of 1).

        Empty if the result has no such number; dimensionless ones stay so.
        """
        known = self.result.scalars.get(name)
        if (known is None or isinstance(known.value, bool)
                or not isinstance(known.value, int | float)):  # fmt: skip
            return ""
        times = multiple(known.unit, unit) if unit else None
        unit, times = (unit, times) if times else self._shown(known.unit)
        described = f"{words or name.replace('_', ' ')} {number(times * known.value)}"
        return f"{described}\N{NO-BREAK SPACE}{raised(unit)}".rstrip()

    def facts(self, *texts: str, **scalars: str | tuple[str, str]) -> None:
        """Put facts in the heading: texts, and scalars with words for them, or words and a unit."""
        numbers = [self.fact(name, *([words] if isinstance(words, str) else words))
                   for name, words in scalars.items()]  # fmt: skip
        text = "; ".join(part for part in (*texts, *numbers) if part)
        if text:
            self.drawn.text(0.0, 1.0, text, label=FACTS)

    def legend(self, *more: Artist) -> Figure:
        """Put one legend below all panels, for those without one and for more; give the sheet."""
        named = dict[str, Artist]()
        bare = [panel for panel in self.panels if panel.axes.get_legend() is None]
        for entry in [*(entry for panel in bare for entry in panel.labelled()), *more]:
            named.setdefault(str(entry.get_label()), entry)
        entries = [*named.values()]
        texts, columns = fitted(entries, 1.0)
        self.drawn.legend(entries, texts, loc="outside lower center", ncols=columns)
        return self.drawn


def _times(value: Any, times: float) -> Any:
    """A number, or a list of numbers, in another unit."""
    if isinstance(value, list):
        return [_times(each, times) for each in value]
    return times * value if isinstance(value, int | float) else value


class Panel:
    """One set of axes of a page."""

    def __init__(self, axes: Axes, page: Page | None = None) -> None:
        self.axes, self._page = axes, page
        self.entries: list[Artist] = []  # of the legend, beside what is labelled in the axes

    @property
    def page(self) -> Page:
        assert self._page is not None
        return self._page

    def _values(self, data: Data) -> np.ndarray:
        return self.page[data] if isinstance(data, str) else np.asarray(data)

    # -- labels and legend

    def label(self, x: str | None = None, y: str | None = None, of: str = "") -> None:
        """Label axes, each with the unit of the variable or scalar `of`."""
        for axis, words in (("x", x), ("y", y)):
            if words is not None:
                text = label(words, self.page.unit(of)) if of else words
                getattr(self.axes, f"set_{axis}label")(text)

    def named(self, axis: str, name: str, words: str = "") -> None:
        """Label an axis from the declaration of a variable.

        `words` replace its meaning; a formula is put behind it.
        """
        variable = self.page.result[name]
        meaning = _SYMBOLS.get(name) or _meaning(variable)
        text = f"{meaning} {words}" if words.startswith("$") else words or meaning
        getattr(self.axes, f"set_{axis}label")(label(text, self.page.unit(name)))

    def _auto(self, axis: str, data: Data, words: str = "") -> None:
        """Label an axis that has no label yet from a variable, where its ticks have numbers."""
        own = getattr(self.axes, f"{axis}axis")
        side = {"x": "labelbottom", "y": "labelleft"}[axis]
        shown = own.get_tick_params().get(side, True)
        if isinstance(data, str) and shown and not own.get_label().get_text():
            self.named(axis, data, words)

    def entry(self, text: str, *style: Any, **more: Any) -> None:
        """Add a line to the legend."""
        self.entries.append(line(text, *style, **more))

    def labelled(self) -> list[Artist]:
        """Entries of the legend."""
        return [*self.axes.get_legend_handles_labels()[0], *self.entries]  # pyright: ignore

    def legend(self, title: str = "", *, above: float = 0.0) -> None:
        """Put a legend where it covers nothing: beside the axes, above them in a column.

        `above`: always above axes that take this share of the sheet. Set the title before.
        """
        entries = self.labelled()
        if narrow() or above:
            texts, columns = fitted(entries, above or 0.75)
            self.axes.legend(entries, texts, loc="lower left", bbox_to_anchor=(-0.02, 1.0),
                             ncols=columns, title=title, alignment="left")  # fmt: skip
            if heading := self.axes.get_title(loc="left"):
                rows = max(sum(1 + text.count("\n") for text in column)
                           for column in np.array_split(np.array(texts), columns))  # fmt: skip
                self.axes.set_title(heading, pad=6 + 12 * (rows + bool(title)))
        else:
            texts, _ = fitted(entries, 0.25)
            self.axes.legend(
                entries, texts, loc="center left", bbox_to_anchor=(1.0, 0.5), title=title
            )

    # -- what is drawn

    def curve(
        self, x: Data, y: Data, text: str = "", *, words: str = "", pick: Any = ..., **style: Any
    ) -> Line2D:
        """Draw y over x; names of variables label the axes. `pick` is an index into y."""
        (drawn,) = self.axes.plot(
            self._values(x), self._values(y)[pick], label=text or None, **style
        )  # fmt: skip
        self._along(x)
        self._auto("y", y, words)
        return drawn

    def curves(self, x: Data, y: Data, *, what: str = "", words: str = "", pick: Any = ...,
               worm: bool = True, legend: bool = True, **style: Any) -> None:  # fmt: skip
        """Draw a curve for each entry of a variable, with the colour and the name of what it is.

        `what` is the first dimension if y is a name: "mass", "link" or another part.
        """
        rows = np.atleast_2d(self._values(y)[pick])
        if isinstance(y, str) and not what:
            what = self.page.result[y].dims[-2]
        texts, shown = labels(what, len(rows), worm=worm), named(len(rows)) if legend else ()
        for j, (color, dashes) in enumerate(styles(what, len(rows))):
            look: dict[str, Any] = {"color": color, "ls": dashes} | style
            self.axes.plot(self._values(x), rows[j], label=texts[j] if j in shown else None, **look)
        self._along(x)
        self._auto("y", y, words)

    def _along(self, x: Data) -> None:
        """Label the x axis, without margins where a variable is the coordinate."""
        self._auto("x", x)
        if isinstance(x, str):
            self.axes.margins(x=0)

    def band(self, x: Data, low: Data, high: Data, text: str = "", **style: Any) -> None:
        """Fill between two curves."""
        look: dict[str, Any] = {"alpha": 0.25, "linewidth": 0} | style
        self.axes.fill_between(self._values(x), self._values(low), self._values(high),
                               label=text or None, **look)  # fmt: skip

    def filled(self, x: np.ndarray, y: np.ndarray, color: str, low: float = 0.0, **style: Any
               ) -> None:  # fmt: skip
        """Fill the area from a level up to a curve across the axes; its sides are beyond them."""
        left, right = x[0] - np.ptp(x), x[-1] + np.ptp(x)
        across = np.append(x, [right, right, left, left])
        (area,) = self.axes.fill(across, np.append(y, [y[-1], low, low, y[0]]), color, **style)
        area.set_linewidth(style.get("linewidth", 0.0))

    def level(
        self, value: str | float | None, text: str = "", *, axis: str = "y", **style: Any
    ) -> None:
        """Draw a thin line across at a number or a scalar; nothing if it is unknown."""
        at: float | None = self.page.get(value) if isinstance(value, str) else value
        look: dict[str, Any] = {"color": GREY, "ls": LIMIT, "lw": 0.8} | style
        across = self.axes.axhline if axis == "y" else self.axes.axvline
        if at is not None:
            across(at, label=text or None, **look)

    def arrow(self, tail: Any, tip: Any, color: str, style: str = "-|>", **more: Any) -> None:
        """Draw an arrow between two points."""
        look = {"arrowstyle": style, "color": color}
        self.axes.annotate("", tuple(tip), tuple(tail), arrowprops=look, **more)

    def limits(self, levels: Sequence[tuple[float, ...]], what: str = "link") -> None:
        """Draw limits, a tuple for each curve: grey if all share them, else in their colours."""
        shared = len(set(levels)) == 1
        own = colours(what, len(levels))
        for values, color in zip(levels[:1] if shared else levels, own, strict=False):
            for value in values:
                self.level(value, color=GREY if shared else color, zorder=1.5)
        if levels:
            self.entry("limit" if shared else "limits", GREY, LIMIT, 0.8)

    def map(self, x: Data, y: Data, z: Data, words: str = "", *, about: float | None = None,
            **style: Any) -> None:  # fmt: skip
        """Draw a variable in colours over x and y, cell by cell unless shading is "gouraud".

        `about`: the value at the middle of the colours.
        """
        across, up, values = self._values(x), self._values(y), self._values(z)
        look: dict[str, Any] = {"shading": "flat", "rasterized": True} | style
        if look["shading"] == "flat":
            up, across = (
                edges(at) if len(at) == count else at
                for at, count in zip((up, across), values.shape, strict=True)
            )
        if about is not None:
            most = max(float(np.abs(values - about).max()), 1e-12)
            look |= {"cmap": "RdBu_r", "vmin": about - most, "vmax": about + most}
        shown = self.axes.pcolormesh(across, up, values, **look)
        if isinstance(z, str):
            words = (
                words
                if words and not words.startswith("$")
                else f"{_meaning(self.page.result[z])} {words}"
            )
            words = label(words.strip(), self.page.unit(z))
        if words:
            self.axes.figure.colorbar(shown, ax=self.axes, label=words, pad=0.01)
        self.axes.grid(visible=False)
        self._auto("x", x)
        self._auto("y", y)

    def bars(
        self, row: float, spans: Iterable[tuple[float, float]], color: Any, half: float = 0.38
    ) -> None:
        """Fill intervals (start, end) of one row."""
        lengths = [(start, end - start) for start, end in spans]
        self.axes.broken_barh(lengths, (row - half, 2 * half), color=color, linewidth=0)

    def ranks(self, count: int, what: str) -> None:
        """Number rows from the top."""
        each = range(0, count, 1 if count <= 12 else 5)
        self.axes.set_yticks(each, [str(i) for i in each])
        self.axes.set_ylim(count - 0.5, -0.5)
        self.axes.grid(visible=False, axis="y")
        self.axes.margins(x=0)
        self.axes.set_ylabel(what)

    def rests(self, x: Data, resting: Data) -> None:
        """One row per mass, filled while it rests; glides are shaded across all rows."""
        time, held = self._values(x), self._values(resting) > 0
        self.entries.append(Patch(color=GREY, label="rests"))
        glides = stretches(time, ~np.any(held, axis=0))
        for span in glides:
            self.axes.axvspan(*span, color=GLIDE, linewidth=0)
        if glides:
            self.entries.append(Patch(color=GLIDE, label="worm glides"))
        for i, color in enumerate(colours("mass", len(held))):
            self.bars(i, stretches(time, held[i]), color)
        self.ranks(len(held), "mass\nat rest")
        self._auto("x", x)
        self.legend()

    def above(self, text: str) -> None:
        """Write above the axes, such as the time of a frame."""
        self.axes.text(0.0, 1.02, text, va="bottom", transform=self.axes.transAxes)

    def scenery(self, *, equal: bool = True, heights: bool = True) -> None:
        """Make the panel one in which things are drawn: without a grid, to scale.

        `heights`: whether the y axis has a scale.
        """
        self.axes.grid(visible=False)
        if equal:
            self.axes.set_aspect("equal", adjustable="box")
        if not heights:
            self.axes.set_yticks([])
            self.axes.spines["left"].set_visible(False)


def _meaning(variable: Variable) -> str:
    """Words for a variable: the beginning of its meaning."""
    return variable.long_name.split(",")[0] or variable.name.replace("_", " ")


def edges(values: np.ndarray) -> np.ndarray:
    """Borders of cells around ascending or descending values, half way between them."""
    if len(values) == 1:
        half = 0.5 * abs(values[0]) or 0.5
        return np.array([values[0] - half, values[0] + half])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


@dataclass(frozen=True)
class Animation:
    """A picture that moves: a stage that stays, and what is drawn on its first panel per frame."""

    frames: int  # number of frames
    stage: Callable[[Result], Page]  # makes the page
    pose: Callable[[Panel, int], None]  # draws a frame, 0 to ``frames - 1``, on the panel

    def __call__(self, result: Result) -> Figure:
        drawn = self.stage(result).drawn
        drawn.moves = self
        axes = drawn.axes[0]
        for artist in _moving(axes):
            artist.set_gid("stays")
        self.show(drawn, 0)
        return drawn

    def show(self, drawn: Any, frame: int) -> None:
        """Change a figure that shows other frames to show this one."""
        self.pose(self._cleared(drawn), frame)

    def show_all(self, drawn: Any, every: int = 1) -> None:
        """Change a figure to show all frames; the ids of artists begin with ``frame-NUMBER-``.

        With `every`, some frames are left out; the others are counted from 0.
        """
        panel = self._cleared(drawn)
        for count, frame in enumerate(range(0, self.frames, every)):
            self.pose(panel, frame)
            for k, artist in enumerate(a for a in _moving(panel.axes) if a.get_gid() is None):
                artist.set_gid(f"frame-{count}-{k}")

    def _cleared(self, drawn: Any) -> Panel:
        (panel, *_) = drawn.page.panels
        for artist in _moving(panel.axes):
            if artist.get_gid() != "stays":
                artist.remove()
        return panel


def _moving(axes: Axes) -> list[Artist]:
    return [*axes.lines, *axes.patches, *axes.collections, *axes.texts]
