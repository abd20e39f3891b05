# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Signals of a motion over time, one below the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from wormopt.labelled import SampledMotion
from wormopt.pictures.page import Panel
from wormopt.pictures.style import sheet, styled

_RESTS = "resting"  # a band below all other signals


def signals(motion: SampledMotion, names: Sequence[str]) -> Figure:
    """Draw one panel for each signal, and below them which mass rests, if that is known.

    UnknownNameError for a name that the motion does not have.
    """
    rests = _RESTS in motion.names and motion.dimension(_RESTS) == "mass"
    names = [name for name in names if not (rests and name == _RESTS)]
    heights = [1.7] * len(names) + [1.0] * rests
    with styled():
        drawn = sheet(7.1 / 9 * (0.8 + sum(heights)))
        rows = drawn.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)
        panels = [Panel(axes) for axes in rows[:, 0]]
        for panel, name in zip(panels, names, strict=False):
            values = np.atleast_2d(motion[name])
            what = "mass" if len(values) == 1 else motion.dimension(name)
            panel.curves(motion.time, values, what=what, worm=False, legend=len(values) > 1)
            if len(values) > 1:
                panel.legend()
            panel.axes.set_ylabel(name.replace("_", "\n", 1).replace("_", " "), parse_math=False)
            panel.axes.margins(x=0)
        if rests:
            panels[-1].rests(motion.time, motion[_RESTS])
        panels[-1].axes.set_xlabel("time $t$")
        drawn.align_ylabels()
    return drawn
