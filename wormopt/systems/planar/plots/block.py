"""Plot of a block that slides in the plane until it stops."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result


def block(result: Result) -> Figure:
    """Plot the path with the velocity, its components over time, and the friction ellipse."""
    drawn = sheet(7.1, 5.4, 8.6)
    (way, ellipse), (speed, force) = drawn.subplots(2, 2)
    time, x, y = (result[name].values for name in ("time", "x", "y"))
    way.plot(x, y, color=LINKS[0])
    marks = np.searchsorted(time, np.linspace(0, needed(result, "stop_time"), 9)[:-1])
    arrows = [result[f"{name}_velocity"].values[marks] for name in "xy"]
    way.quiver(x[marks], y[marks], *arrows, angles="xy", color=GREY, width=0.006)
    way.plot(x[-1], y[-1], "o", color=RED, label="at rest")
    way.set_aspect("equal", adjustable="datalim")
    way.margins(0.1)
    way.set_xlabel(label("position $x$", result["x"].unit))
    way.set_ylabel(label("position $y$", result["y"].unit))
    way.legend(frameon=False, fontsize=7.5)
    for axes, kind, words in (
        (speed, "{}_velocity", "velocity"),
        (force, "friction_{}", "friction"),
    ):
        for name, colour, dashes in (("x", LINKS[0], "-"), ("y", LINKS[1], (0, (5, 1.5)))):
            values = result[kind.format(name)]
            axes.plot(time, values.values, color=colour, linestyle=dashes, label=f"along ${name}$")
        axes.axvline(needed(result, "stop_time"), color=GREY, linestyle=LIMIT, linewidth=0.8)
        axes.set_xlabel(label("time $t$", result["time"].unit))
        axes.set_ylabel(label(words, values.unit))
        axes.legend(frameon=False, fontsize=7.5)
    _draw_ellipse(ellipse, result)
    tell(
        drawn,
        fact(result, "stop_time", "stops at time"),
        fact(result, "distance", "distance"),
        fact(result, "stop_error", "difference to second route"),
    )
    return drawn


def _draw_ellipse(axes: Axes, result: Result) -> None:
    """Draw the limit of friction, and the friction force over time."""
    angle, heading = np.linspace(0, 2 * np.pi, 361), needed(result, "heading")
    # backward motion is resisted by a forward force
    along = np.cos(angle) * np.where(
        np.cos(angle) > 0, needed(result, "backward"), needed(result, "forward")
    )
    across = needed(result, "sideways") * np.sin(angle)
    c, s = np.cos(heading), np.sin(heading)
    axes.plot(c * along - s * across, s * along + c * across, color=GREY, linestyle=LIMIT,
              linewidth=0.9, label="limit of friction")  # fmt: skip
    fx, fy = result["friction_x"].values, result["friction_y"].values
    slides = result["time"].values < needed(result, "stop_time")
    axes.plot(fx[slides], fy[slides], color=LINKS[0], linewidth=2, label="sliding")
    axes.plot(fx[-1], fy[-1], "o", color=RED, label="at rest")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(label("friction along $x$", result["friction_x"].unit))
    axes.set_ylabel(label("friction along $y$", result["friction_y"].unit))
    axes.legend(frameon=False, fontsize=7.5, loc="upper left")
