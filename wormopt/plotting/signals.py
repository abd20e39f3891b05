"""Signals of a motion over time, one below the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from wormopt.labelled import SampledMotion
from wormopt.plotting.parts import LINKS, MASSES, STYLE, draw_rests, legend, line, sheet, styles

_RESTS = "resting"  # a band below all other signals


def signals(motion: SampledMotion, names: Sequence[str]) -> Figure:
    """Draw one panel for each signal, and below them which mass rests, if that is known.

    UnknownNameError for a name that the motion does not have.
    """
    rests = _RESTS in motion.names and motion.dimension(_RESTS) == "mass"
    names = [name for name in names if not (rests and name == _RESTS)]
    heights = [1.7] * len(names) + [1.0] * rests
    with rc_context(STYLE):
        drawn = sheet(9, 0.8 + sum(heights))
        panels = drawn.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)
        for axes, name in zip(panels[:, 0], names, strict=False):
            values = np.atleast_2d(motion[name])
            count = len(values)
            palette = MASSES if count == 1 or motion.dimension(name) == "mass" else LINKS
            looks = styles(palette, count)
            for row, (colour, dashes) in zip(values, looks, strict=True):
                axes.plot(motion.time, row, color=colour, linestyle=dashes, linewidth=1.5)
            shown = range(count) if count <= len(palette) else (0, count // 2, count - 1)
            if count > 1:
                legend(axes, [line(str(j), *looks[j], 1.8) for j in shown])
            axes.set_ylabel(name.replace("_", "\n", 1).replace("_", " "), parse_math=False)
            axes.margins(x=0)
        if rests:
            draw_rests(panels[-1, 0], motion.time, motion[_RESTS].astype(bool))
        panels[-1, 0].set_xlabel("time $t$")
        drawn.align_ylabels()
    return drawn
