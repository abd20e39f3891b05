"""Animation of a crawling worm; masses at rest have their spikes out."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, LINKS, MASSES, label, shades, sheet
from wormopt.result import Result
from wormopt.systems.spiked.plots.gaits import CENTRED, CYCLES

_FRAMES_PER_CYCLE = 36
FRAMES = CYCLES * _FRAMES_PER_CYCLE


def first_frame(result: Result) -> Figure:
    """Draw the worm at the start of the animation, for `pose` to change.

    Needs ``time``, ``resting`` and ``position``.
    """
    drawn = sheet(7.1, 1.9, 1.3)
    _stage(drawn.subplots(), result)
    pose(drawn, result, 0)
    return drawn


def _stage(axes: Axes, result: Result) -> None:
    """Draw the ground with ticks, wide enough for all cycles shown."""
    position = result["position"].values
    reach = position[0].max() + (CYCLES - 1) * (position[0, -1] - position[0, 0])
    margin = 0.04 * (reach - position.min())
    axes.set_xlim(position.min() - margin, reach + margin)
    axes.set_ylim(-0.75, 1.0)
    axes.axhspan(-0.75, -0.35, color="#EFEBE4", linewidth=0)
    axes.axhline(-0.35, color=GREY, linewidth=1.2)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(label("position $x$; filled: at rest on its spikes", result["position"].unit))


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the worm of `first_frame` to a frame (0 to ``FRAMES - 1``), in place.

    Masses at rest are filled and have their spikes out.
    """
    axes = drawn.axes[0]
    for old in [*axes.lines[1:], *axes.texts]:  # the first line is the ground
        old.remove()
    time, position = result["time"].values, result["position"].values
    turn, part = divmod(frame, _FRAMES_PER_CYCLE)
    t = time[-1] * part / _FRAMES_PER_CYCLE
    x = np.array([np.interp(t, time, row) for row in position])
    x += turn * (position[0, -1] - position[0, 0])
    rests = result["resting"].values[:, np.searchsorted(time, t, side="right") - 1].astype(bool)
    size = 0.8 if drawn.get_figwidth() > 5 else 0.65
    for j, colour in enumerate(shades(LINKS, len(x) - 1)):
        axes.plot(x[j : j + 2], [0, 0], color=colour, linewidth=4 * size, alpha=0.8, zorder=2)
    for i, colour in enumerate(shades(MASSES, len(x))):
        if rests[i]:
            axes.plot(x[i], -0.37, marker="v", markersize=11 * size, color=colour, zorder=3)
        axes.plot(x[i], 0, "o", markersize=19 * size, markeredgecolor=colour,
                  markeredgewidth=2.5 * size,
                  markerfacecolor=colour if rests[i] else "white", zorder=4)  # fmt: skip
        axes.text(x[i], 0, str(i), color="white" if rests[i] else colour, zorder=5,
                  size=7, **CENTRED)  # fmt: skip
    axes.text(0.01, 0.9, f"cycle {turn + part / _FRAMES_PER_CYCLE:.2f}", color=GREY,
              transform=axes.transAxes)  # fmt: skip
