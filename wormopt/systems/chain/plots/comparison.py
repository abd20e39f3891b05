"""Pictures of controllers compared: errors in time, error against input, plants drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wormopt.plotting.parts import GREY, LINKS, label, scalar, sheet
from wormopt.result import Result

_DOTTED = " + LQR"  # what stands around a plan
# What box plots show of the plants drawn.
_BOXES = {
    "time_outside_tube": "time outside the tube",
    "error_peak": r"largest $|e|$",
    "input_rms": "rms of $u$",
    "distance": r"distance $\Delta x$",
}


def comparison(result: Result) -> Figure:
    """Errors in time, and largest error against input, one column per reference.

    Small dots are plants that are not as believed.
    """
    names, references = result.attributes["rivals"], result.attributes["references"]
    drawn = sheet(5.4 * len(references), 9.2)
    axes = drawn.subplots(2, len(references), squeeze=False, sharey="row", height_ratios=(1, 1.2))
    for k, reference in enumerate(references):
        _draw_errors(axes[0, k], result, k)
        _draw_prices(axes[1, k], result, k)
        axes[0, k].set_title(reference, loc="left", color="black", weight="bold")
        axes[0, k].set_xlabel(label("time $t$", result["time"].unit))
        axes[1, k].set_xlabel(label("rms of $u$", result["drawn_input_rms"].unit))
    unit = result["error_norm"].unit
    axes[0, 0].set_ylabel(label("error $|e|$", unit))
    axes[1, 0].set_ylabel(label(r"largest $|e|$ after capture", unit))
    handles = [
        Line2D([], [], color=c, linestyle=s, marker="os"[s != "-"], label=name)
        for name, (c, s) in _styles(names).items()
    ]
    tube = Line2D([], [], color=GREY, linestyle="--", label=r"$\lambda$")
    drawn.legend(handles=[*handles, tube], loc="outside lower center", ncols=3)
    return drawn


def _styles(names: list[str]) -> dict[str, tuple[str, Any]]:
    """Colour and line of each rival; a plan with LQR around it has the plan's colour."""
    colours = dict(zip((n for n in names if _DOTTED not in n), _COLOURS, strict=False))
    return {
        name: (colours.get(name.removesuffix(_DOTTED), GREY), ":" if _DOTTED in name else "-")
        for name in names
    }


_COLOURS = (*LINKS[:4], "#882255", "#44AA99", "#999933", "#AA4499")


def _draw_errors(axes: Axes, result: Result, reference: int) -> None:
    time, rows = result["time"].values, result["error_norm"].values[reference]
    styles = _styles(result.attributes["rivals"])
    for values, (colour, line) in zip(rows, styles.values(), strict=False):
        axes.plot(time, values, color=colour, linestyle=line, linewidth=1.2)
    axes.axhline(_radius(result), color=GREY, linestyle="--", linewidth=1.2)
    axes.set_yscale("log")
    axes.set_ylim(1e-3, 3.0 * float(np.nanmax(rows)))
    axes.margins(x=0)


def _draw_prices(axes: Axes, result: Result, reference: int) -> None:
    styles = _styles(result.attributes["rivals"])
    nominal = [result.scalars[name].value[reference] for name in ("input_rms", "error_peak")]
    drawn = [result[f"drawn_{name}"].values[reference] for name in ("input_rms", "error_peak")]
    for k, (colour, line) in enumerate(styles.values()):
        full = line == "-"
        axes.plot(drawn[0][k], drawn[1][k], ".", color=colour, markersize=2, alpha=0.5)
        axes.plot(
            _number(nominal[0][k]), _number(nominal[1][k]), "o" if full else "s", color=colour,
            markersize=8, markerfacecolor=colour if full else "white", zorder=4,
        )  # fmt: skip
    axes.axhline(_radius(result), color=GREY, linestyle="--", linewidth=1.2)
    axes.set_yscale("log")


def _radius(result: Result) -> float:
    return float(scalar(result, "tube_radius"))


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def draws(result: Result) -> Figure:
    """Box plots over the plants that are not as believed, one row per reference.

    Boxes hold half of the plants, whiskers 90 %; a cross is the worm as it is believed.
    """
    references, names = result.attributes["references"], result.attributes["rivals"]
    drawn = sheet(13.0, 2.0 + (1.0 + 0.32 * len(names)) * len(references))
    axes = drawn.subplots(len(references), len(_BOXES), squeeze=False, sharey=True, sharex="col")
    for k, reference in enumerate(references):
        for column, (name, text) in enumerate(_BOXES.items()):
            _draw_boxes(axes[k, column], result, name, k)
            axes[-1, column].set_xlabel(label(text, result[f"drawn_{name}"].unit))
        axes[k, 0].set_title(reference, loc="left", color="black", weight="bold")
        axes[k, 0].set_yticks(range(len(names)), names)
        axes[k, 0].set_ylabel("controller")
    axes[0, 0].invert_yaxis()
    return drawn


def _draw_boxes(axes: Axes, result: Result, name: str, reference: int) -> None:
    rows = result[f"drawn_{name}"].values[reference]
    nominal = result.scalars[name].value[reference]
    for k, values in enumerate(rows):
        seen = values[np.isfinite(values)]
        if seen.size:
            low, lower, middle, upper, high = np.quantile(seen, (0.05, 0.25, 0.5, 0.75, 0.95))
            axes.plot([low, high], [k, k], color=GREY, linewidth=1)
            axes.barh(k, upper - lower, left=lower, height=0.55, color=LINKS[0], alpha=0.45)
            axes.plot([middle, middle], [k - 0.28, k + 0.28], color="black", linewidth=1.5)
        axes.plot(_number(nominal[k]), k, "x", color=LINKS[3], markersize=6)
    axes.margins(x=0.04)
