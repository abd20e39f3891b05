"""Plots of a body that crawls slowly: its strokes in the plane, and the forces in one stroke."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    draw_rests,
    fact,
    handles,
    label,
    legend,
    line,
    scalar,
    shades,
    sheet,
    stretches,
    styles,
    tell,
)
from wormopt.result import Result
from wormopt.systems.planar.plots.bodies import course

_NO_TURN = 1e-9


def crawl(result: Result) -> Figure:
    """Plot the body at equal times of its strokes, resting masses filled, and its mean place."""
    drawn = course(result, "mean of the masses")
    _mark_rests(drawn.axes[0], result)
    turns = abs(scalar(result, "turn") or 0.0) > _NO_TURN
    centre, radius = scalar(result, "circle_centre"), scalar(result, "circle_radius")
    if turns and centre and radius < 10 * np.ptp(result["x"].values):
        drawn.axes[0].add_patch(
            Circle(centre, radius, fill=False, edgecolor=GREY, linestyle=LIMIT, linewidth=0.8)
        )
    in_place = "drift" in result.scalars
    tell(
        drawn,
        fact(result, "distance", "distance of the head per stroke") if not in_place else "",
        fact(result, "turn", "turn to the left") if turns else "",
        fact(result, "work", "work"),
    )
    return drawn


def _mark_rests(axes: Axes, result: Result) -> None:
    time, resting = result["time"].values, result["resting"].values > 0
    x, y = result["x"].values, result["y"].values
    for i, colour in enumerate(shades(MASSES, len(x))):
        at = [np.searchsorted(time, start) for start, _ in stretches(time, resting[i])]
        axes.plot(x[i, at], y[i, at], "o", color=colour, markersize=5.5, zorder=4.5)


def forces(result: Result) -> Figure:
    """Plot ground forces, actuator loads, and resting masses over a stroke."""
    names = [name for name in ("link_force", "joint_torque") if name in result]
    drawn = sheet(7.1, 5.2 + 1.4 * len(names), 9.6)
    panels = drawn.subplots(3 + len(names), sharex=True)
    phase = result["phase"].values
    resting = result["stroke_resting"].values > 0
    for axes, name, words in zip(
        panels, ("ground_ahead", "ground_left"), ("forward", "to the left"), strict=False
    ):
        _draw_forces(axes, phase, result[name].values, resting)
        axes.set_ylabel(_lines(f"ground,\n{words}", result[name].unit))
    legend(panels[0], [*handles("mass", len(resting)), line("mass rests", GREY, width=2.6)])
    for axes, name in zip(panels[2:], names, strict=False):
        _draw_loads(axes, result, name)
    draw_rests(panels[-1], phase, resting)
    panels[-1].set_xlabel("phase of the stroke")
    tell(drawn, fact(result, "work", "work per stroke"), fact(result, "stages", "stages"))
    return drawn


def _draw_forces(axes: Axes, phase: np.ndarray, force: np.ndarray, rests: np.ndarray) -> None:
    """Draw a force, thick where the mass rests; corners of a stroke are jumps."""
    for row, still, colour in zip(force, rests, shades(MASSES, len(force)), strict=True):
        axes.plot(phase, row, color=colour, linewidth=0.9)
        axes.plot(phase, np.where(still, row, np.nan), color=colour, linewidth=2.6)
    axes.margins(x=0)


def _draw_loads(axes: Axes, result: Result, name: str) -> None:
    words, what = {
        "link_force": ("links,\npush", "link"),
        "joint_torque": ("joints,\ntorque", "joint"),
    }[name]
    rows = result[name].values
    drawing = styles(LINKS, len(rows))
    for row, (colour, dashes) in zip(rows, drawing, strict=True):
        axes.plot(result["phase"].values, row, color=colour, linestyle=dashes, linewidth=1.1)
    axes.margins(x=0)
    axes.set_ylabel(_lines(words, result[name].unit))
    first = 1 if what == "joint" else 0
    legend(axes, [line(f"{what} {j + first}", *each) for j, each in enumerate(drawing)][:9])


def _lines(words: str, unit: str) -> str:
    return words if unit == "1" else label(f"{words}\n", unit)
