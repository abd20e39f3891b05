"""Plots of a peristaltic worm as it swells and thins: snapshots over a period, animation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, fact, label, sheet, tell
from wormopt.result import Result
from wormopt.systems.peristaltic.plots.parts import (
    ON,
    draw_segment,
    rows_at,
    shade,
    without_heights,
)

_SNAPSHOTS, _PERIODS, _FRAMES_PER_PERIOD = 9, 3, 40
FRAMES = _PERIODS * _FRAMES_PER_PERIOD
# Largest radius over the usual length of a segment, and radius of rings over that of a segment.
_THICK, _WAIST = 0.45, 0.72


def body(result: Result) -> Figure:
    """Plot the worm at equal times of a period, from top to bottom; its path dotted.

    Segments keep their volume: short ones are thick. Orange edges: the coil is on.
    """
    drawn = sheet(7.1, 4.2, 4.2)
    axes = drawn.subplots()
    time = result["instant"].values
    at = np.linspace(0.0, time[-1], _SNAPSHOTS)
    places, scale = _rings(result, at), _Scale(result)
    down = 2.3 * scale.thick * np.arange(_SNAPSHOTS)
    for k, row in enumerate(places.T):
        _draw(axes, row, -down[k], scale, _coils(result, at[k]))
    for ring in (0, -1):
        path = result["position"].values[ring]
        axes.plot(path, -down[-1] * time / time[-1], color=GREY, linewidth=0.8, linestyle=":")
    margin = 1.3 * scale.thick
    axes.set_xlim(places.min() - margin, places.max() + margin)
    axes.set_ylim(-down[-1] - margin, margin)
    axes.set_yticks(-down[::4], [f"{share:g}" for share in np.linspace(0, 1, len(down[::4]))])
    axes.set_ylabel("time over period")
    axes.set_xlabel(label("position $x$, head to the right", result["position"].unit))
    axes.grid(visible=False)
    tell(
        drawn,
        fact(result, "distance", "displacement per period"),
        fact(result, "speed", "mean velocity"),
    )
    return drawn


def first_frame(result: Result) -> Figure:
    """Plot the worm on its ground at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 1.7, 1.3)
    axes, scale = drawn.subplots(), _Scale(result)
    places = result["position"].values
    way = _PERIODS * (places[0, -1] - places[0, 0])
    ends = places.min() + min(way, 0.0), places.max() + max(way, 0.0)
    axes.set_xlim(ends[0] - scale.thick, ends[1] + scale.thick)
    axes.set_ylim(-2.2 * scale.thick, 2.2 * scale.thick)
    axes.axhline(-1.1 * scale.thick, color=GREY, linewidth=1.2)
    without_heights(axes)
    axes.set_xlabel(label("position $x$", result["position"].unit))
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the worm of `first_frame` to a frame (0 to ``FRAMES - 1``), in place."""
    axes = drawn.axes[0]
    for old in [*axes.collections, *axes.texts]:
        old.remove()
    turn, part = divmod(frame, _FRAMES_PER_PERIOD)
    places, share = result["position"].values, part / _FRAMES_PER_PERIOD
    t = share * result["instant"].values[-1]
    way = places[0, -1] - places[0, 0]
    row = _rings(result, t) + turn * way
    _draw(axes, row, 0.0, _Scale(result), _coils(result, t))
    axes.text(0.01, 0.88, f"t = {turn + share:.2f} T", color=GREY, transform=axes.transAxes)


class _Scale:
    """Sizes shared by all frames of one motion."""

    def __init__(self, result: Result) -> None:
        lengths = result["length"].values
        self.usual = float(lengths.mean())
        self.shortest, self.longest = float(lengths.min()), float(lengths.max())
        self.thick = _THICK * self.usual * self.radius(self.shortest)

    def radius(self, length: float) -> float:
        """Return the radius relative to the usual one, at constant volume."""
        return float(np.sqrt(self.usual / length))

    def shade(self, length: float) -> tuple[float, ...]:
        """Return the colour for a length."""
        return shade((self.longest - length) / max(self.longest - self.shortest, 1e-300))


def _rings(result: Result, t: np.ndarray | float) -> np.ndarray:
    return rows_at(result, "position", t, "instant")


def _coils(result: Result, t: float) -> np.ndarray:
    """Return which coils (N,) are on at a time."""
    if "coil" not in result:
        return np.zeros(len(result["length"].values), bool)
    time = result["instant"].values
    k = min(int(np.searchsorted(time, t, side="right")), len(time) - 1)
    return result["coil"].values[:, k] > 0.5


def _draw(axes: Axes, rings: np.ndarray, middle: float, scale: _Scale, on: np.ndarray) -> None:
    thick = _THICK * scale.usual
    for (front, rear), lit in zip(pairwise(rings), on, strict=True):
        length = front - rear
        radii = _WAIST * thick, thick * scale.radius(length)
        style = {"edgecolor": ON, "linewidth": 1.8, "zorder": 3} if lit else {}
        draw_segment(axes, (rear, front), radii, middle, facecolor=scale.shade(length), **style)
