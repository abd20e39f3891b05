"""Plots of a swimmer over a stroke: body in the plane, height functions, animation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    line,
    narrow,
    sheet,
    tell,
)
from wormopt.result import Result

_SNAPSHOTS = 5
_STROKES, _FRAMES_PER_STROKE = 4, 36
FRAMES = _STROKES * _FRAMES_PER_STROKE
_TWISTS = ("displacement forward", "displacement to the left", "turn")


def swim(result: Result) -> Figure:
    """Plot the body at equal times of a stroke, the path of its centre, and shape over time."""
    drawn = sheet(7.1, 3.6, 5.4)
    if narrow():
        course, plane = drawn.subplots(2, 1, height_ratios=(2, 3))
    else:
        course, plane = drawn.subplots(1, 2, width_ratios=(2, 3))
    x, y, time = (result[name].values for name in ("x", "y", "instant"))
    picked = np.linspace(0, len(time) - 1, _SNAPSHOTS).round().astype(int)
    for rank, k in enumerate(picked):
        depth = 0.25 + 0.75 * rank / (_SNAPSHOTS - 1)
        plane.plot(x[:, k], y[:, k], color=LINKS[0], alpha=depth, linewidth=2)
        plane.plot(x[0, k], y[0, k], "o", color=LINKS[0], alpha=depth, markersize=3.5)
    plane.plot(x.mean(axis=0), y.mean(axis=0), color=RED, linewidth=1.2)
    plane.set_aspect("equal", adjustable="datalim")
    plane.set_xlabel(label("$x$", result["x"].unit))
    plane.set_ylabel(label("$y$", result["y"].unit))
    course.set_xlabel(label("time $t/T$", result["instant"].unit))
    course.set_ylabel("shape $s_k$")
    colours = [LINKS[k % len(LINKS)] for k in range(1, len(result["shape"].values) + 1)]
    for colour, row in zip(colours, result["shape"].values, strict=True):
        course.plot(time, row, color=colour)
    course.margins(x=0)
    entries = [
        line("body, later darker; head dotted", LINKS[0], width=2),
        line("mean of the masses", RED),
        *(line(f"shape variable {k + 1}", colour) for k, colour in enumerate(colours[:4])),
    ]
    legend_below(drawn, entries)
    tell(drawn, *_facts(result))
    return drawn


def _facts(result: Result) -> list[str]:
    names = {"distance": "way", "turn": "turn", "efficiency": "efficiency"}
    if abs(result.scalars["turn"].value) < 1e-9:  # rounding
        del names["turn"]
    return [fact(result, name, words) for name, words in names.items()]


def heights(result: Result) -> Figure:
    """Plot the curvature of the connection over both shape variables, with the stroke."""
    drawn = sheet(7.1, 2.6, 7.0)
    shape = result["shape"].values
    s1, s2 = result["height_s1"].values, result["height_s2"].values
    panels = drawn.subplots(*((3, 1) if narrow() else (1, 3)), sharex=True, sharey=True)
    for axes, values, name in zip(panels, result["height"].values, _TWISTS, strict=True):
        most = float(np.abs(values).max()) or 1.0
        filled = axes.contourf(s1, s2, values.T, np.linspace(-most, most, 22), cmap="RdBu_r")
        axes.contour(s1, s2, values.T, [0.0], colors=GREY, linewidths=0.7)
        axes.plot(shape[0], shape[1], color="black", linewidth=1.4)
        k = len(shape[0]) // 12
        axes.annotate(
            "", shape[:, k + 1], shape[:, k], arrowprops={"arrowstyle": "-|>", "color": "black"}
        )
        axes.set_aspect("equal")
        axes.set_title(f"{name}, per area")
        axes.set_xlabel(label("$s_1$", result["height_s1"].unit))
        axes.grid(visible=False)
        drawn.colorbar(filled, ax=axes, shrink=0.6, ticks=[-most, 0, most], format="%.2g")
    for axes in panels if narrow() else panels[:1]:
        axes.set_ylabel(label("$s_2$", result["height_s2"].unit))
    frame = str(result.trust.get("frame", ""))
    tell(drawn, f"in the {frame} frame" if frame else "", fact(result, "distance", "distance"))
    return drawn


def first_frame(result: Result) -> Figure:
    """Plot the body at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 4.0, 3.0)
    axes = drawn.subplots()
    x, y = _placed(result, np.arange(0, FRAMES, 3))
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
    for old in [*axes.lines[1:], *axes.texts]:  # the first line is the trace
        old.remove()
    x, y = _placed(result, np.array([frame]))
    axes.plot(x[:, 0], y[:, 0], color=LINKS[0], linewidth=3)
    axes.plot(x[:, 0], y[:, 0], "o", color="black", markersize=3)
    axes.plot(x[0, 0], y[0, 0], "o", color=RED, markersize=6)
    axes.text(0.01, 0.94, f"stroke {frame / _FRAMES_PER_STROKE:.2f}", color=GREY,
              transform=axes.transAxes)  # fmt: skip


def _placed(result: Result, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (masses, frames), strokes repeated from the end pose of the last one."""
    time = result["instant"].values
    places = np.stack([result["x"].values, result["y"].values])
    turn, first, last = _motion(places)
    found = []
    for frame in frames:
        strokes, part = divmod(int(frame), _FRAMES_PER_STROKE)
        share = part / _FRAMES_PER_STROKE
        now = np.array([[np.interp(share, time, row) for row in rows] for rows in places])
        for _ in range(strokes):
            now = last + turn @ (now - first)
        found.append(now)
    x, y = np.stack(found, axis=-1)
    return x, y


def _motion(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rigid motion of a stroke: rotation (2, 2), head before and after (2, 1)."""
    begin, end = places[..., 0], places[..., -1]
    a, b = begin[:, 0] - begin[:, 1], end[:, 0] - end[:, 1]
    c, s = a @ b / (a @ a), (a[0] * b[1] - a[1] * b[0]) / (a @ a)
    return np.array([[c, -s], [s, c]]), begin[:, :1], end[:, :1]
