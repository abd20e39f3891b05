"""Plots of a worm that turns in place: heading with its bound, and friction needed for rest."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    RED,
    draw_rests,
    fact,
    label,
    legend,
    line,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result


def turning(result: Result) -> Figure:
    """Plot heading and its bound over time, resting masses, and the friction they need."""
    drawn = sheet(7.1, 5.4, 7.6)
    heading, rests, hold = drawn.subplots(3, height_ratios=(3, 1.5, 2))
    time, angle = result["time"].values, result["mean_heading"].values
    heading.plot(time, angle - angle[0], color=LINKS[0])
    way = np.sign(angle[-1] - angle[0]) or 1.0
    bound = way * needed(result, "heading_rate_bound")
    heading.plot(time, bound * time, color=RED, linestyle=LIMIT, linewidth=0.9)
    legend(heading, [line("mean angle of both links", LINKS[0]), line("at the bound", RED, LIMIT)])
    heading.set_ylabel(label("heading", result["mean_heading"].unit))
    heading.margins(x=0)
    draw_rests(rests, time, result["resting"].values > 0)
    rests.set_xlabel(label("time $t$", result["time"].unit))
    hold.plot(result["swing_angle"].values, result["hold_by_angle"].values, color=LINKS[0])
    hold.axhline(1.0, color=GREY, linestyle=LIMIT, linewidth=0.8)
    hold.set_ylim(0, 1.08 * max(1.0, float(result["hold_by_angle"].values.max())))
    hold.set_xlabel(label("angle of the joint $\\phi$ in a swing", result["swing_angle"].unit))
    hold.set_ylabel("share of friction\nneeded for rest")
    hold.margins(x=0)
    legend(hold, [line("long link", LINKS[0]), line("available", GREY, LIMIT, 0.8)])
    tell(
        drawn,
        fact(result, "heading_rate", "mean rate of the heading"),
        fact(result, "heading_rate_bound", "bound"),
        fact(result, "gap", "gap", "%"),
    )
    return drawn
