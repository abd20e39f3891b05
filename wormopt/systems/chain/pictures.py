"""Pictures of chains: trackers, motions, optima, controllers compared, linear theory, readings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from wormopt.errors import ArgumentError
from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    colours,
    few_decades,
    labels,
    line,
    narrow,
    patch,
    room,
    wrapped,
)
from wormopt.result import Result

_STRIP, _REFERENCE = 0.16, (0, (1, 1.2))
# Widths of the bars that show rests, and the length of the shortest shown, in points.
_REST, _THIN_REST, _SHORTEST_REST = 4.0, 2.0, 1.2
_MOST_SIGNALS = 16  # shown in one picture
_TUBE = r"$\lambda$, radius of the tube"
# Rows of the pictures of trackers, and how high: in the order of figures 5 to 8.
_ROWS = {
    "length": ("length $l_j$", 2.6),
    "error_norm": ("error $|e|$", 1.6),
    "gain": ("gain $k$", 1.4),
    "input": ("input $u_j$", 2.0),
    "position": ("position $x_i$", 2.6),
}

# -- trackers side by side -------------------------------------------------------------------------


def trackers(result: Result) -> Figure:
    """Outputs with the tube, error, gain, inputs and motion, one column per tracker.

    The order is that of figures 5 to 8 of Zimmermann et al. 2007. Rows share scales; there is no
    row for a missing gain.
    """
    missing = {"gain": "gain" not in result, "position": "center_velocity" not in result}
    page, columns = _grid(result, [name for name in _ROWS if not missing.get(name)])
    for column, panels in enumerate(columns):
        for name, panel in panels.items():
            if name == "length":
                _draw_strips(panel, column)
            one = name in ("error_norm", "gain")
            look: Any = {"color": "black"} if one else {"lw": 1.2}
            what = "mass" if name == "position" else "link"
            panel.curves(page["time"], page[name][column], what=what, legend=False, ls="-", **look)
        _draw_tube(panels["error_norm"], column)
        if "position" in panels:  # of a chain
            _draw_rests(panels["position"], column, upward=False)
    return _explain(page, columns[0], "length", "position")


def bands(result: Result) -> Figure:
    """Quantile bands of an ensemble, one column per tracker, rows as in `trackers`.

    The dark band holds half of the members, the light band 90 %.
    """
    page, columns = _grid(result, list(_ROWS), "_band")
    for column, panels in enumerate(columns):
        _draw_strips(panels["length"], column)
        for name, panel in panels.items():
            _draw_band(panel, f"{name}_band", column, "mass" if name == "position" else "link")
        _draw_tube(panels["error_norm"], column)
    shares = [line("median"), patch("half of all", GREY, alpha=0.4),
              patch("90 % of all", GREY, alpha=0.2)]  # fmt: skip
    columns[0]["position"].entries += shares
    return _explain(page, columns[0], "length_band", "position_band")


def _grid(
    result: Result, rows: Sequence[str], ending: str = ""
) -> tuple[Page, list[dict[str, Panel]]]:
    """Panels by name, a column for each tracker with it as title; rows share their scales."""
    heights = [_ROWS[row][1] for row in rows]
    page = Page(result, 1.0 + 0.68 * sum(heights), 1.2 + 0.5 * sum(heights))
    names = page["trackers"]
    panels = page.grid(len(rows), len(names), sharex=True, sharey="row", height_ratios=heights)
    for name, (panel, *_) in zip(rows, panels, strict=True):
        panel.label(y=_ROWS[name][0], of=name + ending)
        panel.axes.margins(x=0)
    for column, name in enumerate(names):
        panels[0][column].axes.set_title(wrapped(name, room(len(names))), weight="bold")
        panels[-1][column].named("x", "time")
    return page, [dict(zip(rows, column, strict=True)) for column in zip(*panels, strict=True)]


def _explain(page: Page, panels: dict[str, Panel], lengths: str, places: str) -> Figure:
    """One legend for all columns, below them."""
    first = panels["length"]
    first.entries = [
        *_entries("link", page[lengths].shape[-2]),
        line("reference", GREY, _REFERENCE, 1),
        patch(r"reference $\pm\lambda$", GREY, alpha=2 * _STRIP),
        line(_TUBE, GREY, LIMIT, 0.9),
        *([line("funnel", GREY, ":", 0.9)] if "funnel" in page else []),
    ]
    if last := panels.get("position"):
        last.entries[:0] = _entries("mass", page[places].shape[-2])
    return page.legend()


def _entries(what: str, count: int) -> list[Any]:
    """Legend of links, masses or similar; of many entries only the ends."""
    own, names = colours(what, count), labels(what, count)
    shown = range(count) if count <= len(MASSES if what == "mass" else LINKS) else (0, count - 1)
    return [line(names[j], own[j]) for j in shown]


def _draw_strips(panel: Panel, column: int) -> None:
    """References, each with its tube as a strip."""
    page = panel.page
    time, tube, references = page["time"], page["tube"][column], page["reference"]
    for reference, color in zip(references, colours("link", len(references)), strict=True):
        panel.band(time, reference - tube, reference + tube, color=color, alpha=_STRIP)
        panel.curve(time, reference, color=color, lw=0.9, ls=_REFERENCE)


def _draw_tube(panel: Panel, column: int) -> None:
    """Radius of the tube, and the funnel, over the norm of the error in decades."""
    page = panel.page
    for name, dashes in (("tube", LIMIT), ("funnel", ":")):
        if name in page:
            panel.curve(page["time"], page[name][column], color=GREY, lw=0.9, ls=dashes)
    panel.axes.set_yscale("log")
    # An error that passes through 0 would dominate the logarithmic scale.
    low, high = panel.axes.get_ylim()
    panel.axes.set_ylim(max(low, 0.1 * float(page["tube"][column].min())), high)
    few_decades(panel.axes.yaxis)


def _draw_rests(panel: Panel, column: int, *, upward: bool) -> None:
    """Thick lines over a path while its mass rests."""
    page = panel.page
    if "rest_start" not in page:
        return
    time, position = page["time"], page["position"]
    position = position[column] if position.ndim == 3 else np.atleast_2d(position)
    own = colours("mass", len(position))
    points = (390 if upward else 250) / (time[-1] - time[0])
    shown = [r for r in _rests(page, column) if points * (r[2] - r[1]) >= _SHORTEST_REST]
    bars = []
    for mass, start, end in shown:
        x = np.interp((start + end) / 2, time, position[mass])
        bars.append([(x, start), (x, end)] if upward else [(start, x), (end, x)])
    # Not wider than long, so that short rests do not look like crosses.
    widths = [min(max(points * (end - start), _THIN_REST), _REST) for _, start, end in shown]
    lines = LineCollection(bars, colors=[own[mass] for mass, *_ in shown], linewidths=widths)
    lines.set_capstyle("butt")
    panel.axes.add_collection(lines)
    if not any(entry.get_label() == "rests" for other in page.panels for entry in other.entries):
        panel.entry("rests", lw=_REST)


def _rests(page: Page, column: int) -> Iterator[tuple[int, float, float]]:
    rows = zip(*(page[f"rest_{name}"] for name in ("contact", "start", "end")), strict=True)
    owners = page.get("rest_tracker")
    for k, (mass, start, end) in enumerate(rows):
        if owners is None or owners[k] == column:
            yield int(mass), float(start), float(end)


def _draw_band(panel: Panel, name: str, column: int, what: str) -> None:
    time, values = panel.page["time"], panel.page[name][column]
    values = values if values.ndim == 3 else values[:, None, :]
    own = ["black"] if values.shape[1] == 1 else colours(what, values.shape[1])
    for j, color in enumerate(own):
        low, lower, middle, upper, high = values[:, j]
        panel.band(time, low, high, color=color, alpha=0.2)
        panel.band(time, lower, upper, color=color)
        panel.curve(time, middle, color=color, lw=1.2)


# -- motions ---------------------------------------------------------------------------------------


def motion(result: Result) -> Figure:
    """Path of every mass, time upward, one column per tracker; thick lines where a mass rests.

    Requires the variables ``time`` and ``position``.
    """
    page = Page(result, 4.4, 3.4)
    names, values = result.attributes.get("trackers", [""]), page["position"]
    (panels,) = page.grid(1, len(names), sharex=True, sharey=True)
    panels[0].entries = _entries("mass", values.shape[-2] if values.ndim > 1 else 1)
    for column, (panel, name) in enumerate(zip(panels, names, strict=True)):
        position = values[column] if values.ndim == 3 else np.atleast_2d(values)
        for path, color in zip(position, colours("mass", len(position)), strict=True):
            panel.curve(path, page["time"], color=color, lw=1)
        _draw_rests(panel, column, upward=True)
        panel.named("x", "position", "position $x_i$")
        if len(names) > 1:
            panel.axes.set_title(wrapped(name, room(len(names))), weight="bold")
        panel.axes.margins(0.04, 0.0)
    panels[0].named("y", "time")
    if len(names) == 1:
        page.facts(distance="", mean_speed="")
    return page.legend()


def signals(result: Result) -> Figure:
    """Signals listed in the attribute ``signals`` over time, one below the other.

    Rests of a single contact are shaded; rests of several contacts have a band of their own below.
    Dotted: times at which contacts of an optimal motion change.
    """
    names = [name for name in result.attributes["signals"] if name in result][:_MOST_SIGNALS]
    contacts, rests = result.attributes["contacts"], "rest_start" in result
    band = rests and len(contacts) > 1
    heights = [1.1] * len(names) + ([0.3 + 0.12 * len(contacts)] if band else [])
    page = Page(result, 0.8 + sum(heights), 0.9 + 0.85 * sum(heights))
    panels = page.rows(*heights)
    time = "instant" if "instant" in result else "time"
    for panel, name in zip(panels, names, strict=False):
        _draw_signal(panel, name, time)
        for _, start, end in _rests(page, 0) if rests and not band else ():
            panel.axes.axvspan(start, end, color=GLIDE, linewidth=0)
    if band:
        _draw_band_of_rests(panels[-1], contacts)
    elif rests:
        panels[-1].entries.append(patch("at rest", GLIDE))
    phases = page.get("phase_times") or []
    for panel in panels:
        for instant in phases[1:-1]:
            panel.level(instant, axis="x", ls=":")
    if phases:
        panels[-1].entry("contact changes", GREY, ":", 0.8)
    page.facts(distance="", mean_speed="", n_events="events", speed="mean speed", time="",
               n_phases="phases")  # fmt: skip
    panels[-1].named("x", time)
    return page.legend() if any(panel.labelled() for panel in panels) else page.drawn


def _draw_signal(panel: Panel, name: str, time: str) -> None:
    page, values = panel.page, np.atleast_2d(panel.page[name])
    what = page.result[name].dims[0]
    own = ["black"] if len(values) == 1 else colours(what, len(values))
    names = {entry.get_label() for entry in _entries(what, len(values))}
    for j, text in enumerate(labels(what, len(values))):
        # Dashes distinguish curves that overlap.
        dashes = DASHES[j] if len(values) <= len(DASHES) else "-"
        shown = text if len(values) > 1 and text in names else ""
        panel.curve(time, values[j], shown, color=own[j], lw=1.2, ls=dashes)
    if name == "length" and "command" in page:
        for row, color in zip(page["command"], own, strict=True):
            panel.curve(time, row, color=color, lw=0.9, ls=_REFERENCE)
        panel.entry("commanded", GREY, _REFERENCE, 0.9)
    panel.label(y=name.replace("_", "\n", 1).replace("_", " "), of=name)


def _draw_band_of_rests(panel: Panel, contacts: Sequence[str]) -> None:
    """One row per contact, filled while the contact rests."""
    for i, color in enumerate(colours("mass", len(contacts))):
        spans = [(start, end) for mass, start, end in _rests(panel.page, 0) if mass == i]
        panel.bars(i, spans, color)
    panel.ranks(len(contacts), "mass\nat rest" if contacts[0].startswith("mass ") else "at rest")
    few = len(contacts) <= len(MASSES)
    names = [name.removeprefix("mass ") for name in contacts] if few else []
    panel.axes.set_yticks(range(len(names)), names)


def convergence(result: Result) -> Figure:
    """Errors of relaxed contact over width of the law and number of arcs, both logarithmic.

    Dotted lines have the slope of order 1; the bars at the last points are the error estimates made
    without the exact answer.
    """
    page = Page(result, 2.9, 4.2)
    left, right = page.beside(2, sharey=True)
    for panel, over, what, slope in (
        (left, "width", "smoothed", 1), (right, "arcs", "complementarity", -1),
    ):  # fmt: skip
        x, error = page[over], np.abs(page[f"{what}_error"])
        bar = page[f"objective_{what}_error_bar"]
        panel.curve(x, error, "error", color="black", marker="o", ms=4)
        panel.curve(x, error[-1] * (x / x[-1]) ** slope, "order 1", color=GREY, ls=":")
        upward = [[0.0], [max(bar - error[-1], 0.0)]]
        panel.axes.errorbar(x[-1], error[-1], upward, color="black", capsize=3,
                            label="estimated error")  # fmt: skip
        panel.axes.set(xscale="log", yscale="log")
    few_decades(left.axes.xaxis)
    left.axes.invert_xaxis()
    right.axes.set_xticks(page["arcs"], [f"{n:g}" for n in page["arcs"]], minor=False)
    right.axes.minorticks_off()
    left.named("x", "width", "width $v_{reg}$ of the smoothed law")
    right.label("arcs $N$ of the grid (complementarity)")
    for panel in (left, right) if narrow() else (left,):
        panel.label(y="error of the objective", of="smoothed_error")
    page.facts(order_smoothed="order of the smoothed law",
               order_complementarity="of complementarity")  # fmt: skip
    return page.legend()


# -- a comparison of controllers -------------------------------------------------------------------

# Quantities of the drawn plants in box plots.
_BOXES = {
    "time_outside_tube": "time outside the tube",
    "error_peak": "largest $|e|$",
    "input_rms": "rms of $u$",
    "distance": r"distance $\Delta x$",
}
_ENDS = (0.05, 0.95)  # of the plants, 90 % lie between
_LEAST = 0.02  # of the tube's radius; smaller errors are not shown


def comparison(result: Result) -> Figure:
    """Error over time, one panel per controller; largest error against input, per reference.

    Crosses are drawn plants.
    """
    columns = 2 if narrow() else 3
    names, references = result.attributes["rivals"], result.attributes["references"]
    rows = math.ceil(len(names) / columns)
    page = Page(result, 2.8 + 1.15 * rows, 2.8 + 1.05 * rows)
    above, below = page.drawn.add_gridspec(2, 1, height_ratios=(0.95 * rows, 2.4))
    panels = page.grid(rows, columns, within=above, sharex=True, sharey=True)
    for k, panel in enumerate(panel for row in panels for panel in row):
        if k >= len(names):
            panel.axes.remove()
            continue
        for reference, values in enumerate(page["error_norm"][:, k]):
            panel.curve(page["time"], values, **_style(reference))
        panel.level("tube_radius")
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(_LEAST * page["tube_radius"], 3.0 * np.nanmax(page["error_norm"]))
        panel.axes.margins(x=0)
        panel.axes.set_title(wrapped(f"{ascii_lowercase[k]}: {names[k]}", room(columns)))
        if k % columns == 0:
            panel.label(y="error $|e|$", of="error_norm")
        if k >= len(names) - columns:
            panel.axes.tick_params(labelbottom=True)
            panel.named("x", "time")
    (efforts,) = page.grid(1, len(references), within=below, sharex=True, sharey=True)
    for k, panel in enumerate(efforts):
        _draw_errors_over_input(panel, k)
        panel.label("rms of $u$", of="drawn_input_rms")
        text = f"a to {ascii_lowercase[len(names) - 1]} for {references[k]}"
        panel.axes.set_title(wrapped(text, room(len(references))))
    efforts[0].label(y="largest $|e|$\nafter capture", of="error_norm")
    page.facts(tube_radius="radius of the tube", draws="drawn plants")
    return page.legend(
        *(line(name, **_style(k)) for k, name in enumerate(references)),
        line(_TUBE, GREY, LIMIT, 0.8),
        line("90 % of the drawn plants", GREY, "-", 0.8),
    )


def _style(reference: int) -> dict[str, Any]:
    """Colour, dashes and width of the curves of a reference."""
    dashes = ("-", (0, (4, 1.2)), (0, (1.5, 1)))[reference % 3]
    return {"color": LINKS[reference % 4], "ls": dashes, "lw": 1.0}


def _draw_errors_over_input(panel: Panel, reference: int) -> None:
    """Letters for the nominal plant; crosses extend over most of the other plants."""
    page, names = panel.page, ("input_rms", "error_peak")
    points = np.array([_numbers(page, name, reference) for name in names]).T
    drawn = [page[f"drawn_{name}"][reference] for name in names]
    for k, point in enumerate(points):
        for across, (values, centre) in enumerate(zip(drawn, point, strict=True)):
            finite = values[k][np.isfinite(values[k])]
            if finite.size and np.isfinite(centre):
                ends, same = np.quantile(finite, _ENDS), [point[1 - across]] * 2
                panel.curve(*((same, ends) if across else (ends, same)), color=GREY, lw=0.8)
    panel.level("tube_radius")
    panel.axes.set_yscale("log")
    for letters, (x, y) in _together(points):
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": GREY, "lw": 0.5}
        panel.axes.text(x, y, letters, ha="center", va="center", size=7.5, bbox=box, zorder=5)
    panel.axes.margins(0.14)


def _together(points: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Positions of letters, with one text for letters that would overlap."""
    places = np.column_stack([points[:, 0], np.log(points[:, 1])])
    room = np.array([0.07, 0.05]) * np.nanmax(np.ptp(places, axis=0)[None], axis=0)
    groups: list[list[int]] = []
    for k in np.flatnonzero(np.isfinite(places).all(axis=1)).tolist():
        near = (g for g in groups if np.all(abs(places[g[0]] - places[k]) < room))
        group = next(near, None)
        if group is None:
            groups.append([k])
        else:
            group.append(k)
    return [(" ".join(ascii_lowercase[k] for k in g), points[g[0]]) for g in groups]


def _numbers(page: Page, name: str, reference: int) -> list[float]:
    return [np.nan if value is None else value for value in page[name][reference]]


def draws(result: Result) -> Figure:
    """Box plots over the drawn plants, one row per reference.

    Boxes hold half of the plants, whiskers 90 %; a cross is the nominal plant.
    """
    references, names = result.attributes["references"], result.attributes["rivals"]
    drawn = {name: result[f"drawn_{name}"].values for name in _BOXES}
    boxes = [pair for pair in _BOXES.items() if np.isfinite(drawn[pair[0]]).any()]
    count = len(boxes)
    columns = count if not narrow() else 1 if count % 2 else 2
    lines = count // columns * len(references)
    high = (0.45 + 0.155 * len(names)) * lines + 0.5
    page = Page(result, high, high + 0.3)
    panels = [panel for row in page.grid(lines, columns, sharey=True) for panel in row]
    for place, panel in enumerate(panels):
        reference, (name, text) = place // count, boxes[place % count]
        if place >= count:  # each quantity has one scale
            panel.axes.sharex(panels[place % count].axes)
        _draw_boxes(panel, name, reference)
        panel.label(text, of=f"drawn_{name}")
        if place % count == 0:
            panel.axes.set_title(references[reference], weight="bold")
        if place % columns == 0:
            panel.axes.set_yticks(range(len(names)), names)
            panel.label(y="controller")
    page.facts(tube_radius="radius of the tube", draws="drawn plants")
    return page.legend(
        patch("half of the plants", LINKS[0], alpha=0.45),
        line("90 %", GREY, "-", 1),
        line("median", "black"),
        line("nominal plant", LINKS[3], "none", marker="x"),
    )


def _draw_boxes(panel: Panel, name: str, reference: int) -> None:
    nominal = _numbers(panel.page, name, reference)
    for k, values in enumerate(panel.page[f"drawn_{name}"][reference]):
        finite = values[np.isfinite(values)]
        if finite.size:
            low, lower, middle, upper, high = np.quantile(finite, (0.05, 0.25, 0.5, 0.75, 0.95))
            panel.curve([low, high], [k, k], color=GREY, lw=1)
            panel.axes.barh(k, upper - lower, left=lower, height=0.6, color=LINKS[0], alpha=0.45)
            panel.curve([middle, middle], [k - 0.3, k + 0.3], color="black")
        panel.curve(nominal[k], k, marker="x", color=LINKS[3], ms=4.5, mew=1.2)
    panel.axes.set_ylim(len(nominal) - 0.5, -0.5)
    panel.axes.grid(visible=False, axis="y")
    panel.axes.margins(x=0.04)


# -- linear theory ---------------------------------------------------------------------------------

_DEGREES = 180 / np.pi
_ROUNDING = 1e-11  # of the largest response at a frequency; smaller ones are rounding
# marked gains: name, words, colour, dashes
_MARKS = {
    "gain_learned": ("gain learned by the tracker", LINKS[3], "-"),
    "gain_linear": ("least gain by harmonics", LINKS[0], (0, (6, 2))),
    "gain_simulated": ("least gain by simulation", LINKS[2], (0, (2, 1))),
    "gain_sure": ("gain sufficient for any friction", GREY, (0, (6, 1.5, 1.5, 1.5))),
}


def response(result: Result) -> Figure:
    """Gain and phase of the chain over frequency, from one input per column to all lengths."""
    page = Page(result, 4.6, 3.8)
    magnitude, phase = page["magnitude"], page["phase"]
    shown = min(len(magnitude), 2 if narrow() else 3)  # Further inputs have similar responses.
    gains, phases = page.grid(2, shown, sharex=True, sharey="row")
    engine: Any = page.drawn.get_layout_engine()
    engine.set(wspace=0.08)  # The first and last tick of neighbours must not overlap.
    size = np.where(magnitude > _ROUNDING * magnitude.max(axis=(0, 1)), magnitude, np.nan)
    angle = np.where(np.isnan(size), np.nan, phase) * _DEGREES
    for j, (above, below) in enumerate(zip(gains, phases, strict=True)):
        above.curves(page["omega"], size[:, j], what="to length of link", legend=not j)
        below.curves("omega", angle[:, j], what="to length of link", legend=False)
        above.axes.set(xscale="log", yscale="log", title=f"from input {j}")
        below.named("x", "omega", r"frequency $\omega$")
        low, high = below.axes.get_ylim()
        below.axes.yaxis.set_major_locator(MultipleLocator(90 if high - low < 540 else 180))
    gains[0].label(y=r"$|G(i\omega)|$", of="magnitude")
    phases[0].label(y=r"phase of $G(i\omega)$ (°)")
    page.facts(common_zero="zero")
    return page.legend()


def poles(result: Result) -> Figure:
    """Poles and zeros of the chain, and the loop's poles as the frozen gain grows.

    Axes are linear near 0 and logarithmic beyond, alike in both directions.
    """
    page = Page(result, 4.6, 4.2)
    panel, real = page.panel(), page["loop_real"]
    gains = np.repeat(page["gain"][:, None], real.shape[1], axis=1)
    paths = panel.axes.scatter(real, page["loop_imag"], c=np.log10(gains), s=7, cmap="viridis",
                               linewidths=0, zorder=2)  # fmt: skip
    bar = page.drawn.colorbar(paths, ax=panel.axes, shrink=0.8,
                              label="$\\log_{10}$ of the frozen gain $k$")  # fmt: skip
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    for name, marker, color, size, text in (
        ("pole", "x", "black", 6, "poles of the chain"),
        ("zero", "o", LINKS[0], 7, "zeros of the chain"),
        ("learned", "+", LINKS[3], 8, "poles of the loop at the learned gain"),
    ):
        panel.curve(page[f"{name}_real"], page[f"{name}_imag"], text, marker=marker, color=color,
                    ls="none", ms=size, mfc="none", zorder=3)  # fmt: skip
    _both_symlog(panel)
    page.facts(gain_learned="learned gain", common_zero="zero")
    return page.legend()


def _both_symlog(panel: Panel) -> None:
    """Scales that show poles of all sizes, with a line at the stability limit."""
    page, axes = panel.page, panel.axes
    real = np.concatenate([page[f"{name}_real"].ravel() for name in ("pole", "zero", "loop")])
    imag = np.concatenate([page[f"{name}_imag"].ravel() for name in ("pole", "loop")])
    sizes = np.abs(real[real != 0])
    small = float(10 ** np.floor(np.log10(sizes.min()))) if sizes.size else 1.0
    axes.set_xscale("symlog", linthresh=small)
    axes.set_yscale("symlog", linthresh=1.0)
    left, right = min(float(real.min()), -small), max(float(real.max()), 0.0)
    axes.set_xlim(2 * left, max(2 * right, small))
    decades = np.arange(np.log10(small), np.floor(np.log10(max(-left, right))) + 0.5)
    ticks = 10.0 ** decades[:: 1 + len(decades) // (4 if narrow() else 9)]
    axes.set_xticks([*-ticks[::-1], 0.0, *ticks[ticks <= right]])
    high = 1.5 * max(float(np.abs(imag).max()), 1.0)
    axes.set_ylim(-high, high)
    panel.level(0.0, axis="x", ls="-", zorder=1)
    panel.label("real part", "imaginary part", of="pole_real")


def margins(result: Result) -> Figure:
    """Phase margin, disk margin and errors over the frozen gain.

    Vertical lines: the learned gain and the sufficient gains.
    """
    page = Page(result, 6.0, 5.6)
    phase, disk, error = page.rows(1.0, 1.0, 1.7)
    phase.curve("gain", page["phase_margins"] * _DEGREES, color="black")
    phase.label(y="phase margin (°)")
    phase.axes.set_ylim(0, 185)
    phase.axes.yaxis.set_major_locator(MultipleLocator(45))
    disk.curve("gain", "disk_margins", color="black")
    disk.axes.set(ylim=(0, 2.1), xscale="log")
    error.curve("gain", "error_linear", "without dry friction", color="black",
                words="largest error $|e|$ after a long time")  # fmt: skip
    error.curve("gain", "error_bound", "bound for any friction", color="black", ls=":")
    error.curve(page["tried_gain"], page["tried_error"], "simulated", color="black", ls="",
                marker=".")  # fmt: skip
    error.level("tube_radius", _TUBE)
    error.axes.set_yscale("log")
    for name, (text, color, dashes) in _MARKS.items():
        for panel in (phase, disk, error):
            panel.level(name, text, axis="x", color=color, ls=dashes, lw=1.1, zorder=1)
    error.label("frozen gain $k$")
    page.facts(gain_learned="learned gain", gain_linear="by harmonics",
               gain_simulated="by simulation")  # fmt: skip
    return page.legend()


# -- predictive control ----------------------------------------------------------------------------

_CONTROLLERS = (GREY, *LINKS[:4])
# parameters of links; all others are of masses
_OF_LINKS = {"stiffness", "damping", "rest_length"}


def predictive(result: Result) -> Figure:
    """Error over time, cost on all plants, and cumulative distribution of decision durations."""
    page = Page(result, 4.3, 6.6)
    panels = page.mosaic("EE;TC", "E;T;C", (1, 1), (1, 1, 1))
    error, times, costs = (panels[name] for name in "ETC")
    names = page["controllers"]
    for k, name in enumerate(names):
        style = {"color": _CONTROLLERS[k % len(_CONTROLLERS)], "ls": DASHES[k % len(DASHES)]}
        error.curve("time", page["error_norm"][k], name, lw=1.0, **style)
        duration = 1e3 * np.sort(page["decision_seconds"][k])
        if np.isfinite(duration).all():
            share = (np.arange(len(duration)) + 1) / len(duration)
            times.curve(duration, share, ds="steps-post", **style)
        if "drawn_cost" in page:
            dots = page["drawn_cost"][k]
            costs.curve(dots, np.full(len(dots), k), marker="o", ls="", ms=3, mfc="none",
                        color=style["color"])  # fmt: skip
        costs.curve(page["cost"][k], k, marker="x", color="black", mew=1.2)
    error.level("tube_radius", _TUBE)
    error.axes.set_ylim(bottom=0)
    error.label(y="error $|e|$", of="error_norm")
    times.level(1e3 * page["decision_period"], axis="x", color="black", ls="-")
    times.axes.set(xscale="log", ylim=(0, 1))
    few_decades(times.axes.xaxis)
    times.label("duration of a decision in ms\n(black: between decisions)",
                "share of shorter decisions")  # fmt: skip
    costs.axes.set_yticks(range(len(names)), [""] * len(names))
    costs.axes.set_ylim(len(names) - 0.5, -0.5)
    costs.axes.locator_params("x", nbins=4)
    costs.label(r"$\int |e|^2 + \rho |u|^2$ d$t$", of="cost")
    costs.axes.set_xlabel(costs.axes.get_xlabel() + "\n(cross: nominal plant)")
    costs.label(y="controller, in the legend's order")
    costs.axes.grid(visible=False, axis="y")
    page.facts(decision_period=("time between decisions", "ms"))
    return page.legend()


def estimates(result: Result) -> Figure:
    """Estimated over true parameters, a panel for each kind, a colour for each plant."""
    if "estimated" not in result:
        raise ArgumentError(
            "the result has no estimates of drawn plants; write the tables [estimation] and "
            "[plants]"
        )
    names, values = result.attributes["parameters"], result["estimated"].values
    kinds = list(dict.fromkeys(name.split(" ")[0] for name in names))
    columns = 1 if narrow() else min(3, len(kinds))
    rows = math.ceil(len(kinds) / columns)
    page = Page(result, 1.0 + 1.7 * rows, 1.2 + 1.45 * rows)
    panels = [panel for row in page.grid(rows, columns, sharex=True) for panel in row]
    for panel, kind in zip(panels, kinds, strict=False):
        for k, name in enumerate(names):
            own, _, number = name.partition(" ")
            for member, ratios in enumerate(values[k] if own == kind else ()):
                panel.curve(page["decision_time"], ratios, color=MASSES[member % len(MASSES)],
                            ls=DASHES[int(number or 0) % 4], lw=0.9)  # fmt: skip
        panel.level(1.0, color="black", ls="-")
        panel.axes.set_title(kind.replace("_", " "))
        panel.label(y="estimate / truth")
    panels[0].axes.set_xlim(0.0, page["time"][-1])
    for panel in panels[len(kinds) :]:
        panel.axes.remove()
    for panel in panels[max(0, len(kinds) - columns) : len(kinds)]:
        panel.axes.tick_params(labelbottom=True)
        panel.named("x", "time")
    entries = [line(words, GREY, DASHES[k]) for k, words in enumerate(_numbered(names))]
    plants = values.shape[1]
    entries += [line(f"plant {k}", MASSES[k]) for k in range(plants) if plants <= len(MASSES)]
    page.facts("a colour for each plant")
    return page.legend(*entries)


def _numbered(names: list[str]) -> list[str]:
    """Meaning of each dash pattern, for example "mass 0, link 0"."""
    found: dict[int, set[str]] = {}
    for name in names:
        kind, _, number = name.partition(" ")
        found.setdefault(int(number or 0), set()).add("link" if kind in _OF_LINKS else "mass")
    return [
        ", ".join(f"{what} {k}" for what in sorted(found[k], reverse=True))
        for k in sorted(found)[: len(DASHES)]
    ]


# -- readings of a text ----------------------------------------------------------------------------

_SENTENCES = {
    "quick": "(13) captures quickly",
    "open": "(14) does not capture",
    "settled": "gain of (13) converges",
    "growing": "gain of (14) grows",
    "closer": "(13) is closer",
    "learning": "gains grow outside",
    "working": "both stay bounded",
}
_KEYS = {"rest_length": "rest length", "growth": r"$\gamma$", "friction": "$F_+$, $F_-$"}


def readings(result: Result) -> Figure:
    """Every reading with the sentences it supports, and the shares of readings by entry.

    Readings are sorted by the number of sentences they support; the last column is all of them.
    """
    supported = result["supported"].values > 0
    supported = np.column_stack([supported, supported.all(axis=1)])
    rows = _shares(result, supported)
    high = 0.19 * len(rows)
    page = Page(result, 1.9 + high, 4.2 + high)
    if narrow():
        shares, each = page.rows(high, 1.8, share=False)
    else:
        ((each, shares),) = page.grid(1, 2, width_ratios=(1, 1.9))
    order = np.lexsort((*supported[:, :-1].T, -supported[:, :-1].sum(axis=1)))
    each.axes.pcolormesh(supported[order], cmap=ListedColormap(["white", LINKS[0]]), vmin=0, vmax=1)
    each.axes.set_ylim(len(supported), 0)
    each.label(y="reading, best first")
    _draw_shares(shares, rows, len(supported))
    for panel in (each, shares):
        names = [*_SENTENCES.values(), "all"]
        panel.axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=90)
        panel.level(len(names) - 1, axis="x", color="black", ls="-")
        panel.axes.tick_params(length=0)
        panel.axes.grid(visible=False)
    page.facts(n_readings="readings $N$", n_supporting="that support all")
    return page.legend(patch("supports the sentence", LINKS[0]),
                       patch("does not", "white", edgecolor=GREY, linewidth=0.6))  # fmt: skip


def _shares(result: Result, supported: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Share of readings that support each sentence, by entry."""
    rows = [("every reading", supported.mean(axis=0))]
    for k, (name, entries) in enumerate(result.attributes["choices"].items()):
        for i, entry in enumerate(entries):
            own = result["reading_choice"].values[:, k] == i
            rows.append((f"{_KEYS.get(name, name)}  {_text(entry)}", supported[own].mean(axis=0)))
    return rows


def _text(entry: Any) -> str:
    if isinstance(entry, list | tuple):
        return ", ".join(f"{value:g}" for value in entry)
    if entry is None:
        return "the reference"
    return entry.replace("_", " ") if isinstance(entry, str) else f"{entry:.3g}"


def _draw_shares(panel: Panel, rows: Sequence[tuple[str, np.ndarray]], count: int) -> None:
    shares = np.array([values for _, values in rows])
    shade = shares.copy()
    # few readings support all, so small shares are shown darker than they are
    shade[:, -1] = np.sqrt(shade[:, -1])
    panel.axes.pcolormesh(shade, cmap="Blues", vmin=0, vmax=1.3)
    for (i, j), share in np.ndenumerate(shares):
        text = f"{100 * share:.0f}" if share == 0 or share >= 0.01 else f"{100 * share:.1f}"
        panel.axes.text(j + 0.5, i + 0.53, text, ha="center", va="center", size=6.5,
                        color="white" if shade[i, j] > 0.8 else "black")  # fmt: skip
    panel.axes.set_yticks(np.arange(len(rows)) + 0.5, [name for name, _ in rows])
    panel.axes.set_ylim(len(rows), 0)
    panel.label(f"share of a row's readings,\nof $N$ = {count} in all (%)")
