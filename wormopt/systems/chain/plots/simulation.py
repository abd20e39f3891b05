"""Pictures of simulated motions: trackers side by side, paths with rests, bands, signals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    fact,
    few_decades,
    label,
    labels,
    legend_below,
    line,
    needed,
    room,
    scalar,
    shades,
    sheet,
    tell,
    wrapped,
)
from wormopt.result import Result

_STRIP, _REFERENCE = 0.16, (0, (1, 1.2))
# Widths of the bars that show rests, and the length of the shortest shown, in points.
_REST, _THIN_REST, _SHORTEST_REST = 4.0, 2.0, 1.2
_MOST_SIGNALS = 16  # shown in one picture
# Rows of the pictures of trackers, and how high: in the order of figures 5 to 8.
_ROWS = {
    "length": ("length $l_j$", 2.6),
    "error_norm": ("error $|e|$", 1.6),
    "gain": ("gain $k$", 1.4),
    "input": ("input $u_j$", 2.0),
    "position": ("position $x_i$", 2.6),
}


def trackers(result: Result) -> Figure:
    """Outputs with the tube, error, gain, inputs and motion, one column per tracker.

    The order is that of figures 5 to 8 of Zimmermann et al. 2007. Rows share scales; there is no
    row for a missing gain.
    """
    names = needed(result, "trackers")
    links, masses = result["length"].values.shape[1], result["position"].values.shape[1]
    time = result["time"].values
    rows = [name for name in _ROWS if name in result]
    axes = _grid(result, rows)
    for column in range(len(names)):
        panels = dict(zip(rows, axes[:, column], strict=True))
        _draw_strips(panels["length"], result, column)
        _draw_rows(panels["length"], result, "length", column, LINKS)
        for signal in panels.keys() & {"error_norm", "gain"}:
            panels[signal].plot(time, result[signal].values[column], color="black")
        _draw_tube(panels["error_norm"], result, column)
        _draw_rows(panels["input"], result, "input", column, LINKS)
        _draw_rows(panels["position"], result, "position", column, MASSES)
        _draw_rests(panels["position"], result, column, upward=False)
    _explain(axes[0, 0].figure, result, [*_entries(LINKS, links), *_strip_entries()],
             [*_entries(MASSES, masses), *_rest_entries(result)])  # fmt: skip
    return axes[0, 0].figure


def _grid(result: Result, rows: Sequence[str], ending: str = "") -> np.ndarray:
    """Axes by row and tracker, with the tracker as title; rows share their scales."""
    names = needed(result, "trackers")
    heights = [_ROWS[row][1] for row in rows]
    drawn = sheet(7.1, 1.0 + 0.68 * sum(heights), 1.2 + 0.5 * sum(heights))
    axes = drawn.subplots(
        len(rows), len(names), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    for name, row in zip(rows, axes[:, 0], strict=True):
        row.set_ylabel(label(_ROWS[name][0], result[name + ending].unit))
        row.margins(x=0)
    for name, top, bottom in zip(names, axes[0], axes[-1], strict=True):
        top.set_title(wrapped(name, room(len(names))), weight="bold")
        bottom.set_xlabel(label("time $t$", result["time"].unit))
    drawn.align_ylabels()
    return axes


def _explain(drawn: Figure, result: Result, *groups: Sequence[Artist]) -> None:
    """One legend for all columns, below them."""
    tube = [line(r"$\lambda$, radius of the tube", GREY, LIMIT, 0.9)]
    funnel = [line("funnel", GREY, ":", 0.9)] if "funnel" in result else []
    legend_below(drawn, [*groups[0], *tube, *funnel, *groups[1]])


def _strip_entries() -> list[Artist]:
    return [
        line("reference", GREY, _REFERENCE, 1),
        Patch(color=GREY, alpha=2 * _STRIP, linewidth=0, label=r"reference $\pm\lambda$"),
    ]


def _rest_entries(result: Result) -> list[Artist]:
    return [line("rests", width=_REST)] if "rest_start" in result else []


def _entries(palette: Sequence[str], count: int, what: str = "") -> list[Line2D]:
    """Legend of links, masses or similar; of many entries only the ends."""
    what = what.removesuffix("_entry") or ("mass" if palette is MASSES else "link")
    shown = range(count) if count <= len(palette) else (0, count - 1)
    own, names = shades(palette, count), labels(what, count)
    return [line(names[j], own[j]) for j in shown]


def _draw_rows(axes: Axes, result: Result, name: str, column: int, palette: Sequence[str]) -> None:
    time, rows = result["time"].values, result[name].values[column]
    for row, colour in zip(rows, shades(palette, len(rows)), strict=True):
        axes.plot(time, row, color=colour, linewidth=1.2)


def _draw_strips(axes: Axes, result: Result, column: int) -> None:
    """References, each with its tube as a strip."""
    time, tube = result["time"].values, result["tube"].values[column]
    references = result["reference"].values
    for reference, colour in zip(references, shades(LINKS, len(references)), strict=True):
        axes.fill_between(
            time, reference - tube, reference + tube, color=colour, alpha=_STRIP, linewidth=0
        )
        axes.plot(time, reference, color=colour, linewidth=0.9, linestyle=_REFERENCE)


def _draw_tube(axes: Axes, result: Result, column: int) -> None:
    """Radius of the tube, and the funnel, over the norm of the error in decades."""
    time = result["time"].values
    for name, style in (("tube", LIMIT), ("funnel", ":")):
        if name in result:
            axes.plot(time, result[name].values[column], color=GREY, linewidth=0.9, linestyle=style)
    axes.set_yscale("log")
    # An error that passes through 0 would dominate the logarithmic scale.
    low, high = axes.get_ylim()
    low = max(low, 0.1 * float(result["tube"].values[column].min()))
    axes.set_ylim(low, high)
    few_decades(axes.yaxis)


def _draw_rests(axes: Axes, result: Result, column: int, *, upward: bool) -> None:
    """Thick lines over a path while its mass rests."""
    if "rest_start" not in result:
        return
    time, position = result["time"].values, result["position"].values
    position = position[column] if position.ndim == 3 else np.atleast_2d(position)
    colours = shades(MASSES, len(position))
    points = (390 if upward else 250) / (time[-1] - time[0])
    shown = [r for r in _rests(result, column) if points * (r[2] - r[1]) >= _SHORTEST_REST]
    bars = []
    for mass, start, end in shown:
        x = np.interp((start + end) / 2, time, position[mass])
        bars.append([(x, start), (x, end)] if upward else [(start, x), (end, x)])
    # Not wider than long, so that short rests do not look like crosses.
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
    """Path of every mass, time upward, one column per tracker; thick lines where a mass rests.

    Requires the variables ``time`` and ``position``.
    """
    names = result.attributes.get("trackers", [""])
    several = result["position"].values.ndim == 3
    time = result["time"].values
    drawn = sheet(7.1, 4.4, 3.4)
    row = drawn.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for column, (axes, name) in enumerate(zip(row, names, strict=True)):
        values = result["position"].values
        position = values[column] if several else np.atleast_2d(values)
        for path, colour in zip(position, shades(MASSES, len(position)), strict=True):
            axes.plot(path, time, color=colour, linewidth=1)
        _draw_rests(axes, result, column, upward=True)
        axes.set_xlabel(label("position $x_i$", result["position"].unit))
        if len(names) > 1:
            axes.set_title(wrapped(name, room(len(names))), weight="bold")
        axes.margins(0.04, 0.0)
    row[0].set_ylabel(label("time $t$", result["time"].unit))
    if len(names) == 1:
        tell(drawn, fact(result, "distance"), fact(result, "mean_speed"))
    masses = result["position"].values.shape[-2] if result["position"].values.ndim > 1 else 1
    legend_below(drawn, [*_entries(MASSES, masses), *_rest_entries(result)])
    return drawn


def bands(result: Result) -> Figure:
    """Quantile bands of an ensemble, one column per tracker, rows as in `trackers`.

    The dark band holds half of the members, the light band 90 %.
    """
    axes = _grid(result, list(_ROWS), "_band")
    for column in range(len(needed(result, "trackers"))):
        _draw_strips(axes[0, column], result, column)
        for row, signal in enumerate(_ROWS):
            palette = MASSES if signal == "position" else LINKS
            _draw_band(axes[row, column], result, f"{signal}_band", column, palette)
        _draw_tube(axes[1, column], result, column)
    links = result["length_band"].values.shape[2]
    masses = result["position_band"].values.shape[2]
    shares = [
        line("median"),
        Patch(color=GREY, alpha=0.4, linewidth=0, label="half of all"),
        Patch(color=GREY, alpha=0.2, linewidth=0, label="90 % of all"),
    ]
    _explain(axes[0, 0].figure, result, [*_entries(LINKS, links), *_strip_entries()],
             [*_entries(MASSES, masses), *shares])  # fmt: skip
    return axes[0, 0].figure


def _draw_band(axes: Axes, result: Result, name: str, column: int, palette: Sequence[str]) -> None:
    time, values = result["time"].values, result[name].values[column]
    values = values if values.ndim == 3 else values[:, None, :]
    colours = ["black"] if values.shape[1] == 1 else shades(palette, values.shape[1])
    for j, colour in enumerate(colours):
        low, lower, middle, upper, high = values[:, j]
        axes.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0)
        axes.fill_between(time, lower, upper, color=colour, alpha=0.25, linewidth=0)
        axes.plot(time, middle, color=colour, linewidth=1.2)


def signals(result: Result) -> Figure:
    """Signals listed in the attribute ``signals`` over time, one below the other.

    Rests of a single contact are shaded; rests of several contacts have a band of their own below.
    """
    names = [name for name in needed(result, "signals") if name in result][:_MOST_SIGNALS]
    contacts = needed(result, "contacts")
    band = "rest_start" in result and len(contacts) > 1
    heights = [1.1] * len(names) + ([0.3 + 0.12 * len(contacts)] if band else [])
    drawn = sheet(7.1, 0.8 + sum(heights), 0.9 + 0.85 * sum(heights))
    rows = drawn.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    entries: list[Artist] = []
    for axes, name in zip(rows, names, strict=False):
        entries += _draw_signal(axes, result, name)
        if "rest_start" in result and not band:
            for _, start, end in _rests(result, 0):
                axes.axvspan(start, end, color=GLIDE, linewidth=0)
    if band:
        _draw_band_of_rests(rows[-1], result, contacts)
    elif "rest_start" in result:
        entries.append(Patch(color=GLIDE, label="at rest"))
    if "phase_times" in result.scalars:
        entries += _draw_phases(rows, result)
    if entries:
        legend_below(drawn, list({str(entry.get_label()): entry for entry in entries}.values()))
    rows[-1].set_xlabel(label("time $t$", result["time"].unit))
    tell(drawn, *(fact(result, name) for name in ("distance", "mean_speed")),
         fact(result, "n_events", "events"))  # fmt: skip
    drawn.align_ylabels()
    return drawn


def _draw_phases(rows: Iterable[Axes], result: Result) -> list[Artist]:
    """Times at which contacts of an optimal motion change."""
    for axes in rows:
        for instant in (scalar(result, "phase_times") or [])[1:-1]:
            axes.axvline(instant, color=GREY, linewidth=0.8, linestyle=":")
    return [line("contact changes", GREY, ":", 0.8)]


def _draw_signal(axes: Axes, result: Result, name: str) -> list[Line2D]:
    """Curves of a signal; returns the entries of its legend."""
    time, values = result["time"].values, np.atleast_2d(result[name].values)
    kind = result[name].dims[0]
    palette = MASSES if kind == "mass" else LINKS
    colours = ["black"] if len(values) == 1 else shades(palette, len(values))
    entries = _entries(palette, len(values), kind) if len(values) > 1 else []
    for j, (row, colour) in enumerate(zip(values, colours, strict=True)):
        # Dashes distinguish curves that overlap.
        dashes = DASHES[j] if len(values) <= len(DASHES) else "-"
        axes.plot(time, row, color=colour, linewidth=1.2, linestyle=dashes)
        if j < len(entries):
            entries[j].set_linestyle(dashes)
    if name == "length" and "command" in result:
        for row, colour in zip(result["command"].values, colours, strict=True):
            axes.plot(time, row, color=colour, linewidth=0.9, linestyle=_REFERENCE)
        entries.append(line("commanded", GREY, _REFERENCE, 0.9))
    axes.set_ylabel(label(name.replace("_", "\n", 1).replace("_", " "), result[name].unit))
    axes.margins(x=0)
    return entries


def _draw_band_of_rests(axes: Axes, result: Result, contacts: Sequence[str]) -> None:
    """One row per contact, filled while the contact rests."""
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
