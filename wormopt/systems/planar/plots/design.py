"""Plots of a gait in the plane: the moving body, its shape over time, and the stroke."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, LINKS, RED, fact, label, legend_below, line, sheet, tell
from wormopt.result import Result

_SNAPSHOTS = 6
FRAMES = 72


def planar_gait(result: Result) -> Figure:
    """Plot the body at equal times of a cycle, resting masses, shape over time, and stroke."""
    drawn = sheet(7.1, 5.0, 8.0)
    narrow = drawn.get_figwidth() < 5
    if narrow:
        plane, loop, course = drawn.subplots(3, height_ratios=(2, 1.6, 1.2))
    else:
        grid = drawn.add_gridspec(2, 2, height_ratios=(3, 2))
        plane = drawn.add_subplot(grid[0, :])
        loop, course = drawn.add_subplot(grid[1, 0]), drawn.add_subplot(grid[1, 1])
    _plane(plane, result)
    time, shape = result["time"], result["shape"].values
    colours = [LINKS[k % len(LINKS)] for k in range(len(shape))]
    for k, (colour, row) in enumerate(zip(colours, shape, strict=True)):
        course.plot(time.values, row, color=colour, linestyle="-" if k < 4 else "--")
    course.set_xlabel(label("time $t$", time.unit))
    course.set_ylabel("shape variables")
    course.margins(x=0)
    _loop(loop, result)
    entries = [
        line("body, later darker; head dotted", LINKS[0], width=2),
        line("mean of the masses", RED),
        line("mass at rest", "black", dashes="", marker="s"),
        *(line(f"shape variable {k + 1}", colour) for k, colour in enumerate(colours[:6])),
    ]
    legend_below(drawn, entries)
    tell(drawn, *_facts(result))
    return drawn


def _plane(plane: Axes, result: Result) -> None:
    x, y, rest = (result[name].values for name in ("x", "y", "rest"))
    time = result["time"].values
    at = np.linspace(time[0], time[-1], _SNAPSHOTS)
    picked = np.clip(np.searchsorted(time, at), 0, len(time) - 1)
    for rank, k in enumerate(picked):
        depth = 0.2 + 0.8 * rank / (_SNAPSHOTS - 1)
        plane.plot(x[:, k], y[:, k], color=LINKS[0], alpha=depth, linewidth=2)
        plane.plot(x[0, k], y[0, k], "o", color=LINKS[0], alpha=depth, markersize=4)
        still = rest[:, k] > 0.5
        plane.plot(x[still, k], y[still, k], "s", color="black", markersize=3, alpha=depth)
    plane.plot(x.mean(axis=0), y.mean(axis=0), color=RED, linewidth=1.2)
    plane.set_aspect("equal", adjustable="datalim")
    plane.set_xlabel(label("$x$", result["x"].unit))
    plane.set_ylabel(label("$y$", result["y"].unit))


def _loop(loop: Axes, result: Result) -> None:
    """Draw the stroke by the last two shape variables, or over time if there is only one."""
    shape, corner = result["shape"].values, result["corner"].values
    if len(shape) < 2:
        loop.set_visible(False)
        return
    loop.plot(shape[-2], shape[-1], color=GREY)
    loop.plot(corner[:, -2], corner[:, -1], "o", color=GREY, markersize=3)
    k = shape.shape[1] // 12
    for i in (0, shape.shape[1] // 2):
        loop.annotate(
            "", shape[-2:, i + k], shape[-2:, i], arrowprops={"arrowstyle": "-|>", "color": GREY}
        )
    loop.set_xlabel(f"shape variable {len(shape) - 1}")
    loop.set_ylabel(f"shape variable {len(shape)}")


def _facts(result: Result) -> list[str]:
    names = {
        "distance": "way",
        "turn": "turn",
        "duration": "in",
        "work": "work",
        "turn_over_bound": "rate over bound",
        "work_over_bound": "work over bound",
    }
    if abs(result.scalars["turn"].value) < 1e-8:  # rounding
        del names["turn"]
    return [fact(result, name, words) for name, words in names.items()]


def first_frame(result: Result) -> Figure:
    """Plot the body at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 4.0, 3.0)
    axes = drawn.subplots()
    x, y = result["x"].values, result["y"].values
    axes.plot(x.mean(axis=0), y.mean(axis=0), color=GREY, linewidth=0.8, linestyle=":")
    margin = 0.1 * float(np.ptp(x) + np.ptp(y))
    axes.set_xlim(x.min() - margin, x.max() + margin)
    axes.set_ylim(y.min() - margin, y.max() + margin)
    axes.set_aspect("equal")
    axes.set_xlabel(label("$x$", result["x"].unit))
    axes.set_ylabel(label("$y$", result["y"].unit))
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the body of `first_frame` to a frame (0 to ``FRAMES - 1``), in place."""
    axes = drawn.axes[0]
    for old in list(axes.lines[1:]):  # the first line is the trace
        old.remove()
    time = result["time"].values
    k = min(int(np.searchsorted(time, time[-1] * frame / (FRAMES - 1))), len(time) - 1)
    x, y, still = (result[name].values[:, k] for name in ("x", "y", "rest"))
    axes.plot(x, y, color=LINKS[0], linewidth=3)
    axes.plot(x[0], y[0], "o", color=RED, markersize=6)
    axes.plot(x[still > 0.5], y[still > 0.5], "s", color="black", markersize=5)
