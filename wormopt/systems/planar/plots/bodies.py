"""Bodies in the plane, shared by plots of planar motion: stage, snapshots, frames.

A result has ``time``, places ``x`` and ``y`` (masses, time), whether a mass is ``resting``, and the
trace ``center_x``, ``center_y``.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    GREY,
    MASSES,
    handles,
    label,
    legend_below,
    line,
    shades,
    sheet,
)
from wormopt.result import Result
from wormopt.systems.planar.plots.obstacles import SOLID, draw_obstacle

FRAMES = 120
_SNAPSHOTS = 9


def course(result: Result, traced: str) -> Figure:
    """Plot the body at equal times, older ones fainter, resting masses filled, and a trace.

    Both axes have the same scale.
    """
    (left, right), (low, high) = reach(result)
    share = (high - low) / (right - left)
    height = float(np.clip(6.0 * share + 1.3, 2.4, 7.0))
    count = len(result["x"].values) + 4  # legend entries, in two columns if it is narrow
    drawn = sheet(7.1, height, float(np.clip(3.0 * share + 0.8 + 0.08 * count, 2.0, 7.0)))
    axes = drawn.subplots()
    stage(axes, result)
    time = result["time"].values
    for k, t in enumerate(np.linspace(time[0], time[-1], _SNAPSHOTS)):
        body(axes, result, t, 0.2 + 0.8 * k / (_SNAPSHOTS - 1))
    axes.plot(result["center_x"].values, result["center_y"].values, color="black", linewidth=0.9,
              zorder=5)  # fmt: skip
    masses = len(result["x"].values)
    held = line("mass held by the ground", GREY, "none", marker="o")
    free = line("mass moves", GREY, "none", marker="o")
    free.set_markerfacecolor("white")
    entries = [*handles("mass", masses), held, free, line(traced, "black", width=0.9)]
    solid = Patch(facecolor=SOLID, edgecolor=GREY, label="obstacle")
    legend_below(drawn, [*entries, solid] if result.attributes.get("obstacles") else entries)
    return drawn


def first_frame(result: Result) -> Figure:
    """Plot the body at the start of the animation, for `pose` to change."""
    (left, right), (low, high) = reach(result)
    height = float(np.clip(6.2 * (high - low) / (right - left) + 0.8, 1.6, 6.0))
    drawn = sheet(7.1, height, height / 1.8)
    stage(drawn.subplots(), result)
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the body of `first_frame` to a frame (0 to ``FRAMES - 1``), in place."""
    axes = drawn.axes[0]
    for old in [*axes.lines, *axes.texts]:
        old.remove()
    time = result["time"].values
    t = time[0] + (time[-1] - time[0]) * frame / (FRAMES - 1)
    past = time <= t
    axes.plot(result["center_x"].values[past], result["center_y"].values[past], color=GREY,
              linewidth=0.9)  # fmt: skip
    body(axes, result, t, 1.0)
    unit = "" if result["time"].unit == "1" else f" {result['time'].unit}"
    axes.text(0.01, 0.9, f"$t$ = {t:.2f}{unit}", color=GREY, transform=axes.transAxes)


def reach(result: Result) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and largest x and y shown."""
    x, y = result["x"].values, result["y"].values
    for each in result.attributes.get("obstacles") or []:
        if each["shape"] == "disc":
            (a, b), r = each["centre"], each["radius"]
            x, y = np.append(x, [a - r, a + r]), np.append(y, [b - r, b + r])
    more = 0.04 * max(np.ptp(x), np.ptp(y)) + 1e-12
    half = max(np.ptp(y) / 2, 0.1 * np.ptp(x)) + more
    middle = (y.max() + y.min()) / 2
    return (float(x.min() - more), float(x.max() + more)), (middle - half, middle + half)


def stage(axes: Axes, result: Result) -> None:
    """Set limits and labels of both axes, which have the same scale."""
    across, up = reach(result)
    axes.set_xlim(across)
    axes.set_ylim(up)
    axes.set_aspect("equal", adjustable="box")
    for each in result.attributes.get("obstacles") or []:
        draw_obstacle(axes, each)
    axes.set_xlabel(label("position $x$", result["x"].unit))
    axes.set_ylabel(label("position $y$", result["y"].unit))


def body(axes: Axes, result: Result, t: float, strength: float) -> None:
    """Draw one body: the sample at `t` or the first after it."""
    k = min(int(np.searchsorted(result["time"].values, t - 1e-12)), len(result["time"].values) - 1)
    x, y = result["x"].values[:, k], result["y"].values[:, k]
    rests = result["resting"].values[:, k] > 0
    axes.plot(x, y, color=GREY, linewidth=1.6, alpha=strength, zorder=3)
    for i, colour in enumerate(shades(MASSES, len(x))):
        axes.plot(x[i], y[i], "o", markersize=5.5, color=colour, alpha=strength, zorder=4,
                  markerfacecolor=colour if rests[i] else "white",
                  markeredgewidth=1.2)  # fmt: skip
