"""Pictures of predictive control: errors, duration of decisions, costs, estimated parameters."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.errors import ArgumentError
from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    fact,
    few_decades,
    label,
    legend_below,
    line,
    narrow,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result

_COLOURS = (GREY, *LINKS[:4])

# parameters of links; all others are of masses
_OF_LINKS = {"stiffness", "damping", "rest_length"}


def predictive(result: Result) -> Figure:
    """Error over time, cost on all plants, and cumulative distribution of decision durations."""
    names = needed(result, "controllers")
    below = narrow()
    drawn = sheet(7.1, 4.3, 6.6)
    grid = drawn.add_gridspec(3 if below else 2, 1 if below else 2)
    error = drawn.add_subplot(grid[0, 0] if below else grid[0, :])
    _draw_errors(error, result, names)
    _draw_times(drawn.add_subplot(grid[1, 0]), result, names)
    _draw_costs(drawn.add_subplot(grid[2, 0] if below else grid[1, 1]), result, names)
    legend_below(drawn, [
        *(line(name, *_style(k)) for k, name in enumerate(names)),
        line(r"$\lambda$, radius of the tube", GREY, LIMIT, 0.8),
    ])  # fmt: skip
    tell(drawn, fact(result, "decision_period", "time between decisions", "ms"))
    return drawn


def _style(k: int) -> tuple[str, object]:
    return _COLOURS[k % len(_COLOURS)], DASHES[k % len(DASHES)]


def _draw_errors(axes: Axes, result: Result, names: list[str]) -> None:
    time = result["time"].values
    for k in range(len(names)):
        colour, dashes = _style(k)
        axes.plot(time, result["error_norm"].values[k], color=colour, linestyle=dashes, lw=1.0)  # pyright: ignore[reportArgumentType]
    axes.axhline(needed(result, "tube_radius"), color=GREY, linestyle=LIMIT, linewidth=0.8)
    axes.margins(x=0)
    axes.set_ylim(bottom=0)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel(label("error $|e|$", result["error_norm"].unit))


def _draw_times(axes: Axes, result: Result, names: list[str]) -> None:
    """Share of decisions below a duration, with a line at the time between decisions."""
    for k in range(len(names)):
        seconds = np.sort(result["decision_seconds"].values[k])
        if np.isfinite(seconds).all():
            colour, dashes = _style(k)
            share = (np.arange(len(seconds)) + 1) / len(seconds)
            axes.step(1e3 * seconds, share, color=colour, linestyle=dashes, where="post")  # pyright: ignore[reportArgumentType]
    axes.axvline(1e3 * needed(result, "decision_period"), color="black", linewidth=0.8)
    axes.set_xscale("log")
    few_decades(axes.xaxis)
    axes.set_ylim(0, 1)
    axes.set_xlabel("duration of a decision in ms\n(black: between decisions)")
    axes.set_ylabel("share of shorter decisions")


def _draw_costs(axes: Axes, result: Result, names: list[str]) -> None:
    """A cross for the nominal plant, dots for other plants."""
    for k, cost in enumerate(needed(result, "cost")):
        if "drawn_cost" in result:
            dots = result["drawn_cost"].values[k]
            axes.plot(dots, np.full(len(dots), k), "o", ms=3, mfc="none", color=_style(k)[0])
        axes.plot(cost, k, "x", color="black", markersize=5, markeredgewidth=1.2)
    axes.set_yticks(range(len(names)), [""] * len(names))
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_ylabel("controller,\nin the legend's order")
    unit = result.scalars["cost"].unit
    axes.set_xlabel(label(r"$\int |e|^2 + \rho |u|^2$ d$t$", unit) + "\n(cross: nominal plant)")
    axes.grid(visible=False, axis="y")


def estimates(result: Result) -> Figure:
    """Estimated over true parameters, a panel for each kind, a colour for each plant."""
    if "estimated" not in result:
        raise ArgumentError(
            "the result has no estimates of drawn plants; write the tables [estimation] and "
            "[plants]"
        )
    names, values = needed(result, "parameters"), result["estimated"].values
    kinds = list(dict.fromkeys(name.split(" ")[0] for name in names))
    columns = 1 if narrow() else min(3, len(kinds))
    lines = math.ceil(len(kinds) / columns)
    drawn = sheet(7.1, 1.0 + 1.7 * lines, 1.2 + 1.45 * lines)
    panels = drawn.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    time = result["decision_time"].values
    panels[0].set_xlim(0.0, result["time"].values[-1])
    for axes, kind in zip(panels, kinds, strict=False):
        for k, name in enumerate(names):
            if name.split(" ")[0] != kind:
                continue
            number = int(name.split(" ")[1]) if " " in name else 0
            for member, ratios in enumerate(values[k]):
                colour = MASSES[member % len(MASSES)]
                axes.plot(time, ratios, color=colour, linestyle=DASHES[number % 4], linewidth=0.9)
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.set_title(kind.replace("_", " "))
        axes.set_ylabel("estimate / truth")
    for axes in panels[len(kinds) :]:
        axes.remove()
    for axes in panels[max(0, len(kinds) - columns) : len(kinds)]:
        axes.set_xlabel(label("time $t$", result["time"].unit))
        axes.tick_params(labelbottom=True)
    entries = [line(words, GREY, DASHES[k]) for k, words in enumerate(_numbered(names))]
    plants = values.shape[1]
    entries += [line(f"plant {k}", MASSES[k]) for k in range(plants) if plants <= len(MASSES)]
    legend_below(drawn, entries)
    tell(drawn, "a colour for each plant")
    return drawn


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
