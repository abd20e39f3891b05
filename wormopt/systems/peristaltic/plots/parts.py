"""Drawings shared by plots of peristaltic worms: segments, coils, rings."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from wormopt.result import Result

THIN, THICK = "#BFD9EA", "#4F93C4"
"""Colours of a long segment and of a short one."""
OFF, ON = "#EADFCF", "#D98C3F"
"""Colours of a coil without current and with it."""
shade = LinearSegmentedColormap.from_list("segment", [THIN, THICK])
"""Colour map of a segment, from 0, long and thin, to 1, short and thick."""
glow = LinearSegmentedColormap.from_list("coil", [OFF, ON])
"""Colour map of a coil, from 0, off, to 1, on."""


def draw_segment(
    axes: Axes,
    ends: tuple[float, float],
    radii: tuple[float, float],
    height: float,
    **style: Any,
) -> None:
    """Draw a bulge between two rings on an axis; `radii`: at the rings and in the middle."""
    s = np.linspace(-1, 1, 41)
    along = (ends[0] + ends[1]) / 2 + s * (ends[1] - ends[0]) / 2
    out = radii[0] + (radii[1] - radii[0]) * (1 - np.abs(s) ** 5)
    usual = {"edgecolor": "white", "linewidth": 0.6, "zorder": 2}
    axes.fill_between(along, height - out, height + out, **(usual | style))


def rows_at(result: Result, name: str, t: Any, time: str = "time") -> np.ndarray:
    """Return rows of a variable at times t, interpolated linearly between samples."""
    return np.array([np.interp(t, result[time].values, row) for row in result[name].values])


def without_heights(axes: Axes) -> None:
    """Remove the axis that would measure across the worm."""
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)
