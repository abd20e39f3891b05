"""Plots of a path through the plane: obstacles, bodies, area swept, goal."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from wormopt.plotting.parts import (
    GLIDE,
    GREY,
    LINKS,
    MASSES,
    RED,
    fact,
    label,
    legend_below,
    line,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result
from wormopt.systems.planar.plots.obstacles import SOLID, draw_obstacle, thick

FRAMES = 160
_SWEPT, _BODY = "#DCE9F3", "#7FB2D6"


def path(result: Result) -> Figure:
    """Plot bodies between steps, area swept, path of the head, obstacles, and goal."""
    drawn = _sheet(result)
    axes = drawn.subplots()
    _stage(axes, result)
    x, y = _course(result)
    thick(axes, x, y, _radius(result), color=_SWEPT, zorder=1)
    stops = _stops(result)
    thick(axes, x[:, stops], y[:, stops], _radius(result), color=_BODY, zorder=3,
           linewidths=0.6, edgecolor="white")  # fmt: skip
    axes.plot(x[0], y[0], color="black", linewidth=0.9, zorder=4)
    axes.plot(x[0, stops], y[0, stops], "o", color="black", markersize=2.5, zorder=4)
    pinned = result["pinned"].values > 0.5
    axes.plot(x[pinned], y[pinned], ".", color=MASSES[1], markersize=3, zorder=5)
    entries = [
        Patch(color=_BODY, label="body between steps"),
        Patch(color=_SWEPT, label="area swept"),
        line("head", "black", "-", 0.9),
        Line2D([], [], color=MASSES[1], marker=".", linestyle="", label="pinned"),
        Patch(color=SOLID, label="obstacle"),
        line("goal", RED),
    ]
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "steps"),
        fact(result, "time"),
        fact(result, "work"),
        fact(result, "room", "least clearance"),
    )
    return drawn


def first_frame(result: Result) -> Figure:
    """Plot the body among its obstacles at the start of the animation, for `pose` to change."""
    drawn = _sheet(result)
    axes = drawn.subplots()
    _stage(axes, result)
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the body of `first_frame` to a frame (0 to ``FRAMES - 1``), in place."""
    axes = drawn.axes[0]
    for old in [*axes.collections, *axes.texts, *axes.lines]:
        if old.get_gid() == "moves":
            old.remove()
    time = result["instant"].values
    t = time[-1] * frame / (FRAMES - 1)
    x, y = _course(result)
    now = np.array([[np.interp(t, time, row) for row in rows] for rows in (x, y)])
    k = min(int(np.searchsorted(time, t, side="right")), len(time) - 1)
    thick(axes, now[0, :, None], now[1, :, None], _radius(result), color=LINKS[0], zorder=3,
           gid="moves")  # fmt: skip
    axes.plot(x[0, :k], y[0, :k], color="black", linewidth=0.9, zorder=2, gid="moves")
    pinned = result["pinned"].values[:, k] > 0.5
    axes.plot(*now, "o", color="white", markersize=4, zorder=4, gid="moves")
    axes.plot(*now[:, pinned], "o", color=MASSES[1], markersize=5, zorder=5, gid="moves")
    text = axes.text(0.01, 0.97, f"t = {t:.2f}", color=GREY, transform=axes.transAxes, va="top")
    text.set_gid("moves")


def _stage(axes: Axes, result: Result) -> None:
    """Draw obstacles, corridor, via points and goal, with equal axes."""
    for each in needed(result, "obstacles"):
        draw_obstacle(axes, each)
    corridor = result.attributes.get("corridor")
    if corridor:
        corners, width = np.array(corridor[0]), corridor[1]
        thick(axes, corners[:, :1], corners[:, 1:], width, color=GLIDE, zorder=0)
        axes.plot(*corners.T, color=GREY, linestyle=":", linewidth=0.8, zorder=1)
    for place in result.attributes.get("via") or []:
        axes.plot(*place, "+", color=GREY, markersize=8, zorder=5)
    gx, gy, angle = needed(result, "goal")
    size = max(4 * _radius(result), 0.03 * float(np.ptp(result["x"].values)))
    axes.annotate("", (gx + size * np.cos(angle), gy + size * np.sin(angle)), (gx, gy),
                  arrowprops={"arrowstyle": "-|>", "color": RED}, zorder=6)  # fmt: skip
    axes.add_patch(Circle((gx, gy), max(needed(result, "tolerance"), size / 4), fill=False,
                          edgecolor=RED, linewidth=1.2, zorder=6))  # fmt: skip
    unit = result["x"].unit
    axes.set_xlabel(label("$x$", unit))
    axes.set_ylabel(label("$y$", unit))
    (left, right), (low, high) = _window(result)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_aspect("equal", adjustable="box")


def _window(result: Result) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and largest x and y shown."""
    x, y = _course(result)
    goal = needed(result, "goal")
    margin = 2 * _radius(result) + 0.05 * float(max(np.ptp(x), np.ptp(y)))
    return tuple(
        (float(min(row.min(), at)) - margin, float(max(row.max(), at)) + margin)
        for row, at in ((x, goal[0]), (y, goal[1]))
    )  # type: ignore[return-value]


def _sheet(result: Result) -> Figure:
    """Return a figure with the height that its contents need."""
    (left, right), (low, high) = _window(result)
    ratio = float(np.clip((high - low) / (right - left), 0.2, 1.2))
    return sheet(7.1, 6.4 * ratio + 0.9, 2.6 * ratio + 1.3)


def _course(result: Result) -> tuple[np.ndarray, np.ndarray]:
    return result["x"].values, result["y"].values


def _radius(result: Result) -> float:
    return float(needed(result, "radius")) or 0.01 * float(np.ptp(result["x"].values))


def _stops(result: Result) -> list[int]:
    """Return the instants between steps."""
    m = result["x"].values.shape[1]
    steps = len(result["amplitude"].values) if "amplitude" in result else 0
    each = m // max(steps, 1)
    return [*range(0, m, each), m - 1] if steps else [0]
