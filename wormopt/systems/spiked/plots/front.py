"""Pictures of a Pareto front: its points, and the gait at its knee."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LINKS,
    RED,
    label,
    legend_below,
    narrow,
    scalar,
    sheet,
    tell,
    wrapped,
)
from wormopt.result import Result
from wormopt.systems.spiked.plots import gaits
from wormopt.systems.spiked.plots.gaits import OBJECTIVES


def front(result: Result) -> Figure:
    """Draw speed and cost of all points; neighbours with one resting sequence are joined.

    Needs ``front_speed``, ``front_value`` and ``front_accepted``; ``front_order`` marks jumps.
    """
    speed, value = result["front_speed"], result["front_value"]
    accepted = result["front_accepted"].values.astype(bool)
    drawn = sheet(7.5, 5.5)
    axes = drawn.subplots()
    x, y = speed.values, value.values
    _draw_line(axes, result)
    if not accepted.all():
        axes.plot(x[~accepted], y[~accepted], "o", color=RED, markerfacecolor="none",
                  markeredgewidth=1.6, markersize=8, label="not accepted")  # fmt: skip
    _draw_knee(axes, result)
    ceiling = scalar(result, "ceiling")
    if ceiling is not None:
        axes.axvline(ceiling, color=GREY, linestyle="--", linewidth=1, label="ceiling on speed")
    objective = str(scalar(result, "front_objective") or "")
    name = OBJECTIVES.get(objective, objective.replace("_", " ") or "objective")
    axes.set_xlabel(label("mean speed $v$", speed.unit))
    axes.set_ylabel(label(wrapped(name, 24 if narrow() else 60), value.unit))
    axes.margins(0.06)
    legend_below(drawn)
    return drawn


def _draw_line(axes: Axes, result: Result) -> None:
    """Draw the points on the front, joined to the next one of the same resting sequence."""
    x, y = result["front_speed"].values, result["front_value"].values
    accepted = result["front_accepted"].values.astype(bool)
    order = result["front_order"].values if "front_order" in result else np.zeros(len(x))
    line = np.argsort(x)
    line = line[accepted[line]]
    jumps = np.flatnonzero(np.diff(order[line])) + 1
    for k, run in enumerate(np.split(line, jumps)):
        axes.plot(x[run], y[run], "o-", color=LINKS[0], linewidth=1.6, markersize=7,
                  label=None if k else "best found")  # fmt: skip
    for k, at in enumerate(jumps):
        axes.axvline(x[line[at - 1 : at + 1]].mean(), color=GREY, linestyle=":", linewidth=1,
                     label=None if k else "resting sequence changes")  # fmt: skip


def _draw_knee(axes: Axes, result: Result) -> None:
    knee = scalar(result, "front_knee")
    if knee is None:
        return
    at = result["front_speed"].values[knee], result["front_value"].values[knee]
    axes.plot(*at, "*", color=LINKS[1], markersize=15, markeredgecolor="white", zorder=4,
              label=f"knee, point {knee}")  # fmt: skip


def gait(result: Result) -> Figure:
    """Draw link lengths, rates, accelerations and rests of the gait at the knee over a cycle."""
    return _of_knee(gaits.gait(result), result)


def motion(result: Result) -> Figure:
    """Draw the path of every mass over two cycles of the gait at the knee, time upward."""
    return _of_knee(gaits.motion(result), result)


def spikes(result: Result) -> Figure:
    """Draw spike loads and actuator forces over a cycle of the gait at the knee."""
    return _of_knee(gaits.spikes(result), result)


def _of_knee(drawn: Figure, result: Result) -> Figure:
    """Add to the figure that its gait is the one at the knee."""
    knee, last = scalar(result, "front_knee"), len(result["front_speed"].values) - 1
    which = "" if knee is None else f", point {knee} of 0 to {last}"
    tell(drawn, f"the gait at the knee of the front{which}")
    return drawn
