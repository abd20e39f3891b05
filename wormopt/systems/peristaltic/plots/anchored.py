"""Plots of a worm that anchors in its tube: body over a cycle, advance, animation."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    legend,
    legend_below,
    needed,
    number,
    sheet,
    tell,
)
from wormopt.result import Result
from wormopt.systems.peristaltic.plots.parts import THIN, draw_segment, rows_at

_PERIODS, _FRAMES_PER_PERIOD = 2, 48
FRAMES = _PERIODS * _FRAMES_PER_PERIOD
# Relative to the drawn length of a short segment: drawn stroke; half the thickness of a ring, of a
# worm at rest and of its tube. Real changes are too small to be seen.
_STROKE, _RING, _THIN, _WIDE = 0.45, 0.165, 0.22, 0.36
_ANCHORED, _FREE = LINKS[0], THIN


def peristalsis(result: Result) -> Figure:
    """Plot the body in its tube at the start of each phase, its anchors, and its advance.

    Needs ``time``, ``length``, ``radius``, ``anchored``, ``position`` and the wave. Changes
    of length and thickness are enlarged.
    """
    begins = np.arange(0, len(result["time"].values), 2)
    tall = 0.5 * (len(begins) + 1)
    drawn = sheet(7.1, tall + 2.6, tall + 2.6)
    body, way = drawn.subplots(2, 1, height_ratios=(tall, 1.9))
    for row, k in enumerate(begins):
        _draw_body(body, result, -row, result["time"].values[k], int(k))
    _stage(body, result, len(begins), 1)
    body.set_yticks(-np.arange(len(begins)), [number(result["time"].values[k], 3) for k in begins])
    body.set_ylabel(label("time $t$, downward", result["time"].unit))
    _draw_way(way, result)
    tell(
        drawn,
        fact(result, "speed", "mean speed", "mm s-1"),
        fact(result, "ceiling", "upper bound", "mm s-1"),
        fact(result, "wave_speed", "wave", "mm s-1"),
        fact(result, "stroke", "stroke", "mm"),
    )
    entries = [Patch(color=_ANCHORED, label="anchored on the wall"),
               Patch(color=_FREE, label="moving, off the wall")]  # fmt: skip
    legend_below(drawn, entries)
    return drawn


def _draw_way(axes: Axes, result: Result) -> None:
    """Draw the position of the head in the gait and in the wave, and the bound of all gaits."""
    period, unit = needed(result, "period"), result["position"].unit
    scale, unit = (1e3, "mm") if unit == "m" else (1.0, unit)
    _repeated(axes, result["time"].values, scale * result["position"].values[0], period,
              color=LINKS[0], label="designed gait")  # fmt: skip
    _repeated(axes, result["wave_time"].values, scale * result["wave_position"].values, period,
              color=LINKS[1], linestyle=DASHES[1], label="wave")  # fmt: skip
    end = _PERIODS * period
    axes.plot([0, end], [0, scale * needed(result, "bound") * end], color=RED, linestyle=LIMIT,
              linewidth=0.9, label="bound on the mean")  # fmt: skip
    axes.set_xlim(0, end)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel(label("position of the head", unit))
    legend(axes)


def _repeated(
    axes: Axes, time: np.ndarray, way: np.ndarray, period: float, **style: object
) -> None:
    """Draw a motion cycle by cycle for the periods shown."""
    turns = np.arange(np.ceil(_PERIODS * period / time[-1] - 1e-9))
    advance = way[-1] - way[0]
    axes.plot(
        (time + time[-1] * turns[:, None]).ravel(),
        (way - way[0] + advance * turns[:, None]).ravel(),
        **style,  # pyright: ignore[reportArgumentType]
    )


def _drawn_rings(result: Result, t: float) -> np.ndarray:
    """Return the drawn positions of rings at time t, in lengths of a short segment."""
    shortest, stroke = needed(result, "shortest"), needed(result, "stroke")
    turn, t = divmod(t, needed(result, "period"))
    head = rows_at(result, "position", t)[0] + turn * needed(result, "advance")
    lengths = 1 + (rows_at(result, "length", t) - shortest) * _STROKE / stroke
    return head * _STROKE / stroke - np.concatenate([[0.0], np.cumsum(lengths)])


def _draw_body(axes: Axes, result: Result, row: float, t: float, at: int) -> None:
    """Draw the worm at time t; `at` is the sample with the anchors of that time."""
    rings = _drawn_rings(result, t)
    thin, wide = needed(result, "worm_radius"), needed(result, "tube_radius")
    radii = (rows_at(result, "radius", t % needed(result, "period")) - thin) / (wide - thin)
    for j, anchored in enumerate(result["anchored"].values[:, at].astype(bool)):
        half = _THIN + (_WIDE - _THIN) * radii[j]
        draw_segment(axes, (rings[j + 1], rings[j]), (_RING, half), row, edgecolor=GREY,
                     facecolor=_ANCHORED if anchored else _FREE)  # fmt: skip
        if anchored:
            middle = (rings[j] + rings[j + 1]) / 2
            axes.plot([middle] * 2, [row - _WIDE, row + _WIDE], linestyle="none", marker="s",
                      markersize=3.5, color=RED, zorder=3)  # fmt: skip
    for wall in (row - _WIDE, row + _WIDE):
        axes.axhline(wall, color=GREY, linewidth=1.0, zorder=1)


def _stage(axes: Axes, result: Result, rows: int, periods: int) -> None:
    """Set limits for the worm and its path, without a scale where changes are enlarged."""
    rings = np.array([_drawn_rings(result, t) for t in result["time"].values[:-1]])
    advance = needed(result, "advance") * _STROKE / needed(result, "stroke")
    axes.set_xlim(rings.min() - 0.2, rings[:, 0].max() + (periods - 1) * advance + 0.2)
    axes.set_ylim(-rows + 0.5, 0.5)
    axes.set_xticks([])
    axes.grid(visible=False)
    axes.set_xlabel("forward → (changes enlarged)")


def first_frame(result: Result) -> Figure:
    """Plot the worm in its tube at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 1.5, 1.2)
    drawn.subplots()
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the worm of `first_frame` to a frame (0 to ``FRAMES - 1``), in place."""
    axes = drawn.axes[0]
    axes.clear()
    period, time = needed(result, "period"), result["time"].values
    t = period * frame / _FRAMES_PER_PERIOD
    at = int(np.searchsorted(time, t % period, side="right")) - 1
    _draw_body(axes, result, 0.0, t, at)
    _stage(axes, result, 1, _PERIODS)
    axes.set_yticks([])
    axes.text(0.01, 0.88, f"t = {t / period:.2f} T", color=GREY, transform=axes.transAxes)
