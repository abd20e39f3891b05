"""Pictures of a body in the plane: where it was over time, what acted on it, and animated."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    MASSES,
    RED,
    fact,
    handles,
    label,
    legend,
    legend_below,
    line,
    shades,
    sheet,
    styles,
    tell,
)
from wormopt.result import Result

FRAMES = 120
_SNAPSHOTS = 9
_WORKS = (
    ("actuator", LINKS[0], "actuators"),
    ("ground", RED, "ground"),
    ("damping", LINKS[2], "dashpots"),
    ("pull", LINKS[1], "weight"),
)


def plane(result: Result) -> Figure:
    """The body at equal times, fainter the longer ago; masses at rest filled; trace of its centre.

    Both axes have one scale.
    """
    (left, right), (low, high) = _reach(result)
    share = (high - low) / (right - left)
    height = float(np.clip(6.0 * share + 1.3, 2.4, 7.0))
    drawn = sheet(7.1, height, max(height, 4.0))
    axes = drawn.subplots()
    _stage(axes, result)
    time = result["time"].values
    for k, t in enumerate(np.linspace(time[0], time[-1], _SNAPSHOTS)):
        _draw(axes, result, t, 0.2 + 0.8 * k / (_SNAPSHOTS - 1))
    axes.plot(result["center_x"].values, result["center_y"].values, color="black", linewidth=0.9,
              zorder=5)  # fmt: skip
    masses = len(result["x"].values)
    held = line("ground holds the mass", GREY, "none", marker="o")
    free = line("mass moves", GREY, "none", marker="o")
    free.set_markerfacecolor("white")
    trace = line("centre of mass", "black", width=0.9)
    legend_below(drawn, [*handles("mass", masses), held, free, trace])
    tell(
        drawn,
        fact(result, "distance", "way of the centre of mass"),
        fact(result, "turn", "turn to the left"),
    )
    return drawn


def forces(result: Result) -> Figure:
    """Forces of the ground and of the actuators over time, and where their work goes."""
    joints = "torque" in result
    drawn = sheet(7.1, 7.2 if joints else 6.0, 8.4)
    panels = drawn.subplots(4 if joints else 3, sharex=True)
    time = result["time"].values
    size = np.hypot(result["ground_x"].values, result["ground_y"].values)
    colours = shades(MASSES, len(size))
    for row, colour in zip(size, colours, strict=True):
        panels[0].plot(time, row, color=colour, linewidth=1)
    panels[0].set_ylabel(_lines("force of\nthe ground", result["ground_x"].unit))
    legend(panels[0], handles("mass", len(size)))
    told = {
        "input": ("force $u_j$\nin links", "link"),
        "torque": ("torque $w_j$\nin joints", "joint"),
    }
    for axes, (name, (words, what)) in zip(panels[1:-1], told.items(), strict=False):
        rows = result[name].values
        drawing = styles(LINKS, len(rows))
        for row, (colour, dashes) in zip(rows, drawing, strict=True):
            axes.plot(time, row, color=colour, linestyle=dashes, linewidth=1.1)
        axes.set_ylabel(_lines(words, result[name].unit))
        legend(axes, [line(f"{what} {j}", *each) for j, each in enumerate(drawing)][:9])
    for (name, colour, words), dashes in zip(_WORKS, DASHES, strict=True):
        done = result[f"work_{name}"].values
        if np.any(done):
            panels[-1].plot(time, done, color=colour, linestyle=dashes, label=words)
    energy = result["energy"].values
    panels[-1].plot(time, energy - energy[0], color="black", linewidth=0.8, label="stored")
    panels[-1].set_ylabel(_lines("work on\nthe body", result["energy"].unit))
    panels[-1].set_xlabel(label("time $t$", result["time"].unit))
    legend(panels[-1])
    tell(drawn, fact(result, "actuator_work", "work of the actuators"),
         fact(result, "energy_error", "energy missing"))  # fmt: skip
    return drawn


def first_frame(result: Result) -> Figure:
    """The body as the animation begins, for `pose` to change."""
    (left, right), (low, high) = _reach(result)
    height = float(np.clip(6.2 * (high - low) / (right - left) + 0.8, 1.6, 6.0))
    drawn = sheet(7.1, height, height / 1.8)
    _stage(drawn.subplots(), result)
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
    _draw(axes, result, t, 1.0)
    unit = "" if result["time"].unit == "1" else f" {result['time'].unit}"
    axes.text(0.01, 0.9, f"$t$ = {t:.2f}{unit}", color=GREY, transform=axes.transAxes)


def _lines(words: str, unit: str) -> str:
    return words if unit == "1" else label(f"{words}\n", unit)


def _reach(result: Result) -> tuple[tuple[float, float], tuple[float, float]]:
    x, y = result["x"].values, result["y"].values
    more = 0.04 * max(np.ptp(x), np.ptp(y)) + 1e-12
    half = max(np.ptp(y) / 2, 0.1 * np.ptp(x)) + more
    middle = (y.max() + y.min()) / 2
    return (float(x.min() - more), float(x.max() + more)), (middle - half, middle + half)


def _stage(axes: Axes, result: Result) -> None:
    across, up = _reach(result)
    axes.set_xlim(across)
    axes.set_ylim(up)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(label("place $x$", result["x"].unit))
    axes.set_ylabel(label("place $y$", result["y"].unit))


def _draw(axes: Axes, result: Result, t: float, strength: float) -> None:
    """One body; the sample at `t` or the first after it."""
    k = min(int(np.searchsorted(result["time"].values, t - 1e-12)), len(result["time"].values) - 1)
    x, y = result["x"].values[:, k], result["y"].values[:, k]
    rests = result["resting"].values[:, k] > 0
    axes.plot(x, y, color=GREY, linewidth=1.6, alpha=strength, zorder=3)
    for i, colour in enumerate(shades(MASSES, len(x))):
        axes.plot(x[i], y[i], "o", markersize=5.5, color=colour, alpha=strength, zorder=4,
                  markerfacecolor=colour if rests[i] else "white",
                  markeredgewidth=1.2)  # fmt: skip
