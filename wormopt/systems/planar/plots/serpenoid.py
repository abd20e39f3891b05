"""Plots of the speed of a serpenoid wave over its amplitude, and of the wave."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, LINKS, RED, fact, label, needed, sheet, tell
from wormopt.result import Result


def serpenoid(result: Result) -> Figure:
    """Plot speed over amplitude with the best one and that of the scene; the best wave below."""
    drawn = sheet(7.1, 4.2, 4.6)
    below, top = drawn.subplots(2, height_ratios=(1, 2))
    amplitude, speed = result["amplitude"], result["speed_by_amplitude"].values
    top.plot(amplitude.values, speed, color=LINKS[0])
    best = needed(result, "amplitude_best")
    top.plot(best, needed(result, "speed_best"), "o", color=RED, label="best")
    top.set_xlabel(label(r"amplitude $\alpha$", amplitude.unit))
    top.set_ylabel("speed $V/c$")
    top.margins(x=0)
    top.legend(loc="lower center")
    s = np.linspace(0, 4 * np.pi, 1200)
    psi = best * np.sin(s)
    step = s[1] - s[0]
    x, y = np.cumsum(np.cos(psi)) * step, np.cumsum(np.sin(psi)) * step
    below.plot(x / (2 * np.pi), (y - y.mean()) / (2 * np.pi), color=RED, linewidth=2)
    below.set_aspect("equal")
    below.set_xlabel("best wave: $x$ over body length per wave")
    below.set_ylabel("$y$ over the same")
    below.axhline(0, color=GREY, linewidth=0.6)
    tell(drawn, fact(result, "speed", "speed $V/c$"), fact(result, "amplitude_best", "best α"),
         fact(result, "speed_best", "best $V/c$"))  # fmt: skip
    return drawn
