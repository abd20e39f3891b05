"""Pictures of simulated motions: trackers side by side, the way with its rests, bands, signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from wormopt.plotting.parts import (
    GLIDE,
    GREY,
    LINKS,
    MASSES,
    facts,
    label,
    legend,
    link_handles,
    mass_handles,
    shades,
    sheet,
)
from wormopt.result import Result

_STRIP, _REFERENCE = 0.16, (0, (1, 1.2))
# Widths of the bars that show rests, and the length of the shortest shown, in points.
_REST, _THIN_REST, _SHORTEST_REST = 5.0, 2.5, 1.5
_MOST_SIGNALS = 16  # shown in one picture
# Rows of the pictures of trackers: the chapter's figures 5 to 8, and the error itself.
_ROWS = {
    "length": "link length $l_j$",
    "error_norm": "error $|e|$",
    "gain": "gain $k$",
    "input": "input $u_j$",
    "position": "position $x_i$",
}
_HEIGHTS = (3, 1.6, 1.6, 2, 3)


def trackers(result: Result) -> Figure:
    """Outputs with the tube, error, gain, inputs and motion, one column per tracker.

    The chapter's figures 5 to 8 in one. Rows share their scales; none for a missing gain.
    """
    names = result.attributes["trackers"]
    time = result["time"].values
    rows = {name: row for row, name in enumerate(name for name in _ROWS if name in result)}
    heights = [height for name, height in zip(_ROWS, _HEIGHTS, strict=True) if name in rows]
    drawn = sheet(3.2 + 4.2 * len(names), sum(heights) + 0.5)
    axes = drawn.subplots(
        len(rows), len(names), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    for column, name in enumerate(names):
        _draw_strips(axes[0, column], result, column)
        _draw_rows(axes[0, column], result, "length", column, LINKS)
        for signal in rows.keys() & {"error_norm", "gain"}:
            values = result[signal].values[column]
            axes[rows[signal], column].plot(time, values, color="black", lw=1.5)
        _draw_tube(axes[1, column], result, column)
        _draw_rows(axes[rows["input"], column], result, "input", column, LINKS)
        _draw_rows(axes[-1, column], result, "position", column, MASSES)
        _draw_rests(axes[-1, column], result, column, upward=False)
        axes[0, column].set_title(name, loc="left", color="black", weight="bold")
        axes[-1, column].set_xlabel(label("time $t$", result["time"].unit))
    for signal, row in rows.items():
        axes[row, 0].set_ylabel(label(_ROWS[signal], result[signal].unit))
        axes[row, 0].margins(x=0)
    _explain(list(axes[:, -1]), result)
    drawn.align_ylabels()
    return drawn


def _explain(axes: Sequence[Axes], result: Result) -> None:
    """Legends beside the last column."""
    links, masses = result["length"].values.shape[1], result["position"].values.shape[1]
    legend(axes[0], [*_entries(LINKS, links), *_strip_handles()])
    legend(axes[1], _tube_handles(result))
    legend(axes[-1], [*_entries(MASSES, masses), *_rest_handles(result)])


def _strip_handles() -> list[Line2D]:
    return [
        Line2D([], [], color=GREY, linewidth=1.2, linestyle=_REFERENCE, label="reference"),
        Line2D([], [], color=GREY, alpha=2 * _STRIP, linewidth=8, label=r"$\pm\lambda$ strip"),
    ]


def _tube_handles(result: Result) -> list[Line2D]:
    tube = Line2D([], [], color=GREY, linewidth=1.2, linestyle="--", label=r"$\lambda$")
    funnel = Line2D([], [], color=GREY, linewidth=1.2, linestyle=":", label="funnel")
    return [tube, funnel] if "funnel" in result else [tube]


def _rest_handles(result: Result) -> list[Line2D]:
    heavy = Line2D([], [], color=GREY, linewidth=5, label="rests")
    return [heavy] if "rest_start" in result else []


def _entries(palette: Sequence[str], count: int, what: str = "") -> list[Line2D]:
    """Legend of links or masses, or of whatever has so many entries; ends only of many."""
    if not what:
        what = "mass" if palette is MASSES else "link"
    if count <= len(palette) and what in ("mass", "link"):
        return mass_handles(count) if what == "mass" else link_handles(count)
    first = 1 if what == "link" else 0
    shown = range(count) if count <= len(palette) else (0, count - 1)
    own, what = shades(palette, count), what.removesuffix("_entry")
    return [Line2D([], [], color=own[j], linewidth=1.8, label=f"{what} {first + j}") for j in shown]


def _draw_rows(
    axes: Axes, result: Result, name: str, column: int, palette: Sequence[str], width: float = 1.5
) -> None:
    time, rows = result["time"].values, result[name].values[column]
    for row, colour in zip(rows, shades(palette, len(rows)), strict=True):
        axes.plot(time, row, color=colour, linewidth=width)


def _draw_strips(axes: Axes, result: Result, column: int) -> None:
    """References and the strips that the tube makes around each of them."""
    time, tube = result["time"].values, result["tube"].values[column]
    references = result["reference"].values
    for reference, colour in zip(references, shades(LINKS, len(references)), strict=True):
        axes.fill_between(
            time, reference - tube, reference + tube, color=colour, alpha=_STRIP, linewidth=0
        )
        axes.plot(time, reference, color=colour, linewidth=1.2, linestyle=_REFERENCE)


def _draw_tube(axes: Axes, result: Result, column: int) -> None:
    """Radius of the tube, and the funnel, over the norm of the error in decades."""
    time = result["time"].values
    for name, style in (("tube", "--"), ("funnel", ":")):
        if name in result:
            axes.plot(time, result[name].values[column], color=GREY, linewidth=1.2, linestyle=style)
    axes.set_yscale("log")
    # an error that passes through 0 would show nothing but that
    low, high = axes.get_ylim()
    low = max(low, 0.1 * float(result["tube"].values[column].min()))
    axes.set_ylim(low, high)
    steps = (1.0, 2.0, 5.0) if high < 60 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=steps, numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def _draw_rests(axes: Axes, result: Result, column: int, *, upward: bool) -> None:
    """Heavy lines over a path while its mass rests."""
    if "rest_start" not in result:
        return
    time, position = result["time"].values, result["position"].values
    position = position[column] if position.ndim == 3 else position
    colours = shades(MASSES, len(position))
    points = (390 if upward else 250) / (time[-1] - time[0])
    shown = [r for r in _rests(result, column) if points * (r[2] - r[1]) >= _SHORTEST_REST]
    bars = []
    for mass, start, end in shown:
        x = np.interp((start + end) / 2, time, position[mass])
        bars.append([(x, start), (x, end)] if upward else [(start, x), (end, x)])
    # no wider than long, lest short ones look like crosses
    widths = [min(max(points * (end - start), _THIN_REST), _REST) for _, start, end in shown]
    lines = LineCollection(bars, colors=[colours[mass] for mass, *_ in shown], linewidths=widths)
    lines.set_capstyle("butt")
    axes.add_collection(lines)


def _rests(result: Result, column: int) -> Iterator[tuple[int, float, float]]:
    names = ("rest_contact", "rest_start", "rest_end")
    rows = zip(*(result[name].values for name in names), strict=True)
    owners = result["rest_tracker"].values if "rest_tracker" in result else None
    for k, (mass, start, end) in enumerate(rows):
        if owners is None or owners[k] == column:
            yield int(mass), float(start), float(end)


def motion(result: Result) -> Figure:
    """Way of every mass, time upward, one column per tracker; heavy lines where a mass rests.

    Needs the variables ``time`` and ``position``.
    """
    names = result.attributes.get("trackers", [""])
    several = result["position"].values.ndim == 3
    time = result["time"].values
    drawn = sheet(2.0 + 5.5 * len(names), 7)
    row = drawn.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for column, (axes, name) in enumerate(zip(row, names, strict=True)):
        values = result["position"].values
        position = values[column] if several else values
        for path, colour in zip(position, shades(MASSES, len(position)), strict=True):
            axes.plot(path, time, color=colour, linewidth=1.3)
        _draw_rests(axes, result, column, upward=True)
        axes.set_xlabel(label("position $x_i$", result["position"].unit))
        axes.set_title(name if len(names) > 1 else facts(result, "distance", "mean_speed"),
                       loc="left")  # fmt: skip
        axes.margins(0.04, 0.0)
    row[0].set_ylabel(label("time $t$", result["time"].unit))
    masses = result["position"].values.shape[-2]
    handles = [*_entries(MASSES, masses), *_rest_handles(result)]
    drawn.legend(handles=handles, loc="outside lower center", ncols=5)
    return drawn


def bands(result: Result) -> Figure:
    """Quantile bands of an ensemble, one column per tracker, rows as in `trackers`.

    Half of the members lie in the dark band, 90 % in the light one.
    """
    names = result.attributes["trackers"]
    drawn = sheet(3.4 + 4.2 * len(names), 11.5)
    axes = drawn.subplots(
        5, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=_HEIGHTS
    )
    for column, name in enumerate(names):
        _draw_strips(axes[0, column], result, column)
        for row, signal in enumerate(_ROWS):
            palette = MASSES if signal == "position" else LINKS
            _draw_band(axes[row, column], result, f"{signal}_band", column, palette)
        _draw_tube(axes[1, column], result, column)
        axes[0, column].set_title(name, loc="left", color="black", weight="bold")
        axes[-1, column].set_xlabel(label("time $t$", result["time"].unit))
    for row, (signal, text) in enumerate(_ROWS.items()):
        axes[row, 0].set_ylabel(label(text, result[f"{signal}_band"].unit))
        axes[row, 0].margins(x=0)
    links = result["length_band"].values.shape[2]
    masses = result["position_band"].values.shape[2]
    legend(axes[0, -1], [*_entries(LINKS, links), *_strip_handles()])
    legend(axes[1, -1], _tube_handles(result))
    patches = [
        Line2D([], [], color=GREY, linewidth=1.5, label="median"),
        Line2D([], [], color=GREY, alpha=0.4, linewidth=8, label="half of all"),
        Line2D([], [], color=GREY, alpha=0.2, linewidth=8, label="90 % of all"),
    ]
    legend(axes[2, -1], patches)
    legend(axes[-1, -1], _entries(MASSES, masses))
    drawn.align_ylabels()
    return drawn


def _draw_band(axes: Axes, result: Result, name: str, column: int, palette: Sequence[str]) -> None:
    time, values = result["time"].values, result[name].values[column]
    values = values if values.ndim == 3 else values[:, None, :]
    colours = ["black"] if values.shape[1] == 1 else shades(palette, values.shape[1])
    for j, colour in enumerate(colours):
        low, lower, middle, upper, high = values[:, j]
        axes.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0)
        axes.fill_between(time, lower, upper, color=colour, alpha=0.25, linewidth=0)
        axes.plot(time, middle, color=colour, linewidth=1.5)


def signals(result: Result) -> Figure:
    """Signals listed in the attribute ``signals`` against time, one below the other.

    Rests of a single contact are shaded, those of several in a band of their own below.
    """
    names = [name for name in result.attributes["signals"] if name in result][:_MOST_SIGNALS]
    contacts = result.attributes["contacts"]
    band = "rest_start" in result and len(contacts) > 1
    heights = [1.7] * len(names) + ([0.3 + 0.15 * len(contacts)] if band else [])
    drawn = sheet(9, 1.6 + sum(heights))
    rows = drawn.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes, name in zip(rows, names, strict=False):
        _draw_signal(axes, result, name)
        if "rest_start" in result and not band:
            for _, start, end in _rests(result, 0):
                axes.axvspan(start, end, color=GLIDE, linewidth=0)
    if band:
        _draw_band_of_rests(rows[-1], result, contacts)
    rows[-1].set_xlabel(label("time $t$", result["time"].unit))
    shaded = "    shaded: at rest" if "rest_start" in result and not band else ""
    rows[0].set_title(facts(result, "distance", "mean_speed", "n_events") + shaded, loc="left")
    drawn.align_ylabels()
    return drawn


def _draw_signal(axes: Axes, result: Result, name: str) -> None:
    time, values = result["time"].values, np.atleast_2d(result[name].values)
    entries = result[name].dims[0]
    palette = MASSES if entries == "mass" else LINKS
    colours = ["black"] if len(values) == 1 else shades(palette, len(values))
    handles = _entries(palette, len(values), entries) if len(values) > 1 else []
    for row, colour in zip(values, colours, strict=True):
        axes.plot(time, row, color=colour, linewidth=1.5)
    if name == "length" and "command" in result:
        for row, colour in zip(result["command"].values, colours, strict=True):
            axes.plot(time, row, color=colour, linewidth=1.2, linestyle=_REFERENCE)
        handles.append(
            Line2D([], [], color=GREY, linewidth=1.2, linestyle=_REFERENCE, label="commanded")
        )
    if handles:
        legend(axes, handles)
    axes.set_ylabel(label(name.replace("_", "\n", 1).replace("_", " "), result[name].unit))
    axes.margins(x=0)


def _draw_band_of_rests(axes: Axes, result: Result, contacts: Sequence[str]) -> None:
    """One row per contact, filled while it rests."""
    for i, colour in enumerate(shades(MASSES, len(contacts))):
        bars = [(start, end - start) for mass, start, end in _rests(result, 0) if mass == i]
        axes.broken_barh(bars, (i - 0.38, 0.76), color=colour, linewidth=0)
    few = len(contacts) <= len(MASSES)
    names = [name.removeprefix("mass ") for name in contacts] if few else []
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(contacts) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_ylabel("mass\nat rest" if contacts[0].startswith("mass ") else "at rest")
    axes.margins(x=0)
