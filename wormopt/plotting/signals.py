"""Signals of a motion over time, one below the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wormopt.model.motion import SampledMotion
from wormopt.plotting.parts import LINKS, MASSES, STYLE, legend, shades, sheet


def signals(motion: SampledMotion, names: Sequence[str]) -> Figure:
    """Draw one panel for each signal; UnknownNameError for a name the motion has not."""
    with rc_context(STYLE):
        drawn = sheet(9, 0.8 + 1.7 * len(names))
        panels = drawn.subplots(len(names), sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, names, strict=True):
            values = np.atleast_2d(motion[name])
            count = len(values)
            palette = MASSES if count == 1 or motion.dimension(name) == "mass" else LINKS
            colours = shades(palette, count)
            for row, colour in zip(values, colours, strict=True):
                axes.plot(motion.time, row, color=colour, linewidth=1.5)
            shown = range(count) if count <= len(palette) else (0, count // 2, count - 1)
            lines = [Line2D([], [], color=colours[j], label=str(j), linewidth=1.8) for j in shown]
            if count > 1:
                legend(axes, lines)
            axes.set_ylabel(name.replace("_", "\n", 1).replace("_", " "), parse_math=False)
            axes.margins(x=0)
        panels[-1].set_xlabel("time $t$")
        drawn.align_ylabels()
    return drawn
