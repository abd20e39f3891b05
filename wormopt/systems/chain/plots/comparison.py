"""Pictures of a comparison of controllers: error over time, error against input, drawn plants."""

from __future__ import annotations

import math
from itertools import islice
from string import ascii_lowercase

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    fact,
    label,
    legend_below,
    line,
    narrow,
    needed,
    room,
    sheet,
    tell,
    wrapped,
)
from wormopt.result import Result

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
    names, references = needed(result, "rivals"), needed(result, "references")
    columns = 2 if narrow() else 3
    rows = math.ceil(len(names) / columns)
    drawn = sheet(7.1, 2.8 + 1.15 * rows, 2.8 + 1.05 * rows)
    above, below = drawn.add_gridspec(2, 1, height_ratios=(0.95 * rows, 2.4))
    panels = above.subgridspec(rows, columns).subplots(sharex=True, sharey=True, squeeze=False)
    for k, axes in enumerate(panels.ravel()):
        if k < len(names):
            _draw_errors(axes, result, k)
            axes.set_title(wrapped(f"{ascii_lowercase[k]}: {names[k]}", room(columns)))
        else:
            axes.remove()
    for axes in panels[:, 0]:
        axes.set_ylabel(label("error $|e|$", result["error_norm"].unit))
    for k in range(len(names) - columns, len(names)):
        axes = panels.ravel()[k]
        axes.set_xlabel(label("time $t$", result["time"].unit))
        axes.tick_params(labelbottom=True)
    efforts = below.subgridspec(1, len(references)).subplots(
        sharex=True, sharey=True, squeeze=False
    )[0]
    for k, axes in enumerate(efforts):
        _draw_errors_over_input(axes, result, k)
        axes.set_xlabel(label("rms of $u$", result["drawn_input_rms"].unit))
        axes.set_title(wrapped(f"a to {ascii_lowercase[len(names) - 1]} for {references[k]}",
                               room(len(references))))  # fmt: skip
    efforts[0].set_ylabel(label("largest $|e|$\nafter capture", result["error_norm"].unit))
    legend_below(drawn, [
        *(line(name, *_style(k)) for k, name in enumerate(references)),
        line(r"$\lambda$, radius of the tube", GREY, LIMIT, 0.8),
        line("90 % of the drawn plants", GREY, "-", 0.8),
    ])  # fmt: skip
    tell(drawn, *_plants(result))
    return drawn


def _plants(result: Result) -> list[str]:
    return [fact(result, "tube_radius", "radius of the tube"),
            fact(result, "draws", "drawn plants")]  # fmt: skip


def _style(reference: int) -> tuple[str, object, float]:
    """Colour, dashes and width of the curves of a reference."""
    return LINKS[reference % 4], ("-", (0, (4, 1.2)), (0, (1.5, 1)))[reference % 3], 1.0


def _draw_errors(axes: Axes, result: Result, rival: int) -> None:
    time, rows = result["time"].values, result["error_norm"].values
    for k, values in enumerate(rows[:, rival]):
        colour, dashes, width = _style(k)
        axes.plot(time, values, color=colour, linestyle=dashes, linewidth=width)  # pyright: ignore[reportArgumentType]
    axes.axhline(needed(result, "tube_radius"), color=GREY, linestyle=LIMIT, linewidth=0.8)
    axes.set_yscale("log")
    axes.set_ylim(_LEAST * needed(result, "tube_radius"), 3.0 * float(np.nanmax(rows)))
    axes.margins(x=0)


def _draw_errors_over_input(axes: Axes, result: Result, reference: int) -> None:
    """Letters for the nominal plant; crosses extend over most of the other plants."""
    names = ("input_rms", "error_peak")
    points = np.array([_numbers(result, name, reference) for name in names]).T
    drawn = [result[f"drawn_{name}"].values[reference] for name in names]
    for k, point in enumerate(points):
        for across, (values, centre) in enumerate(zip(drawn, point, strict=True)):
            finite = values[k][np.isfinite(values[k])]
            if finite.size and np.isfinite(centre):
                ends = np.quantile(finite, _ENDS)
                same = [point[1 - across]] * 2
                axes.plot(*((same, ends) if across else (ends, same)), color=GREY, linewidth=0.8)
    axes.axhline(needed(result, "tube_radius"), color=GREY, linestyle=LIMIT, linewidth=0.8)
    axes.set_yscale("log")
    for letters, (x, y) in _together(points):
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": GREY, "lw": 0.5}
        axes.text(x, y, letters, ha="center", va="center", size=7.5, bbox=box, zorder=5)
    axes.margins(0.14)


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


def _numbers(result: Result, name: str, reference: int) -> list[float]:
    return [np.nan if value is None else value for value in needed(result, name)[reference]]


def draws(result: Result) -> Figure:
    """Box plots over the drawn plants, one row per reference.

    Boxes hold half of the plants, whiskers 90 %; a cross is the nominal plant.
    """
    references, names = needed(result, "references"), needed(result, "rivals")
    columns = 2 if narrow() else len(_BOXES)
    lines = len(_BOXES) // columns * len(references)
    high = (0.45 + 0.155 * len(names)) * lines + 0.5
    drawn = sheet(7.1, high, high + 0.3)
    axes = drawn.subplots(lines, columns, squeeze=False, sharey=True)
    for column, own in enumerate(axes.ravel()[len(_BOXES) :]):  # Each quantity has one scale.
        own.sharex(axes.ravel()[column % len(_BOXES)])
    parts = iter(axes.ravel())
    for k, reference in enumerate(references):
        for number, (own, (name, text)) in enumerate(
            zip(islice(parts, len(_BOXES)), _BOXES.items(), strict=False)
        ):
            _draw_boxes(own, result, name, k)
            text = text.replace("outside ", "outside\n") if narrow() else text
            own.set_xlabel(label(text, result[f"drawn_{name}"].unit))
            own.set_ylim(len(names) - 0.5, -0.5)
            if not number:
                own.set_title(reference, weight="bold")
    for own in axes[:, 0]:
        own.set_yticks(range(len(names)), names)
        own.set_ylabel("controller")
    legend_below(drawn, [
        Patch(color=LINKS[0], alpha=0.45, linewidth=0, label="half of the plants"),
        line("90 %", GREY, "-", 1),
        line("median", "black"),
        line("nominal plant", LINKS[3], "none", marker="x"),
    ])  # fmt: skip
    tell(drawn, *_plants(result))
    return drawn


def _draw_boxes(axes: Axes, result: Result, name: str, reference: int) -> None:
    rows = result[f"drawn_{name}"].values[reference]
    nominal = _numbers(result, name, reference)
    for k, values in enumerate(rows):
        finite = values[np.isfinite(values)]
        if finite.size:
            low, lower, middle, upper, high = np.quantile(finite, (0.05, 0.25, 0.5, 0.75, 0.95))
            axes.plot([low, high], [k, k], color=GREY, linewidth=1)
            axes.barh(k, upper - lower, left=lower, height=0.6, color=LINKS[0], alpha=0.45)
            axes.plot([middle, middle], [k - 0.3, k + 0.3], color="black")
        axes.plot(nominal[k], k, "x", color=LINKS[3], markersize=4.5, markeredgewidth=1.2)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.04)
