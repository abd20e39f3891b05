"""Plot of designed currents: the waveform of a coil, and the motion of the float."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    MASSES,
    fact,
    label,
    legend_below,
    line,
    sheet,
    tell,
)
from wormopt.result import Result

_SORTS = ("", "mean_field_", "block_")
_NAMES = ("design", "best by the mean field", "best block")
_AROUND = 2.0  # lengths of the float shown on each side of it


def coil_design(result: Result) -> Figure:
    """Plot waveforms, paths of the float, currents over coil and time, and the film."""
    drawn = sheet(7.1, 7.4, 8.4)
    shape = drawn.add_gridspec(3, 2, height_ratios=(3, 3.4, 1.3))
    _courses(drawn.add_subplot(shape[0, 0]), result)
    _ways(drawn.add_subplot(shape[0, 1]), result)
    _currents(drawn, drawn.add_subplot(shape[1, :]), result)
    _film(drawn.add_subplot(shape[2, :]), result)
    entries = [
        line(name, colour, dashes)
        for name, colour, dashes in zip(_NAMES, LINKS, DASHES, strict=False)
    ]
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "float_speed", "design", "mm s-1"),
        fact(result, "mean_field_speed", "mean field", "mm s-1"),
        fact(result, "block_speed", "block", "mm s-1"),
        fact(result, "power", "power", "W"),
        fact(result, "over_mean_field", "gain over mean field", "%"),
        fact(result, "over_block", "gain over block", "%"),
        fact(result, "neighbour_gain", "gain of best neighbour", "%"),
    )
    return drawn


def _ramps(result: Result) -> bool:
    """Return whether currents change continuously, so that they have a slope."""
    return result.scalars["slew_max"].value is not None


def _courses(axes: Axes, result: Result) -> None:
    """Draw the waveform of a coil over its steps, with the same number of values per step."""
    per_step = len(result["pattern"].values) / result.scalars["repeat"].value
    for sort, colour, dashes in zip(_SORTS, LINKS, DASHES, strict=False):
        values = result[f"{sort}pattern"].values
        steps = np.arange(len(values) + 1) / per_step
        values = np.append(values, values[0])
        axes.plot(
            steps, values, color=colour, linestyle=dashes,
            drawstyle="default" if _ramps(result) else "steps-post",
        )  # fmt: skip
    axes.set_xlabel("steps of the pattern")
    axes.set_ylabel(label("ampere-turns of a coil", "A"))


def _ways(axes: Axes, result: Result) -> None:
    for sort, colour, dashes in zip(_SORTS, LINKS, DASHES, strict=False):
        time = result[f"{sort}time"].values
        place = result["float_position" if not sort else f"{sort}position"].values
        axes.plot(time, 1e3 * place, color=colour, linestyle=dashes)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel("position of the float (mm)")


def _currents(drawn: Figure, axes: Axes, result: Result) -> None:
    """Draw the currents of the design over position and time, with the float's path."""
    t, places = result["time"].values, 1e3 * result["coil_place"].values
    current = result["current"].values
    half = (places[1] - places[0]) / 2
    edges = np.append(places - half, places[-1] + half)
    most = float(np.abs(current).max())
    # the mean of currents that jump never flows
    between = (current[:-1] + current[1:]) / 2 if _ramps(result) else current[:-1]
    shown = axes.pcolormesh(
        t, edges, between.T, cmap="RdBu_r", vmin=-most, vmax=most, shading="flat", rasterized=True
    )
    axes.plot(t, 1e3 * result["float_position"].values, color="black", linewidth=2)
    half_way = len(t) // 2
    axes.annotate(
        "float", (t[half_way], 1e3 * result["float_position"].values[half_way]), (-8, 6),
        textcoords="offset points", ha="right", va="bottom",
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1},
    )  # fmt: skip
    axes.grid(visible=False)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel("position $x$ (mm)")
    drawn.colorbar(shown, ax=axes, label="ampere-turns (A)", pad=0.01)


def _film(axes: Axes, result: Result) -> None:
    """Draw film and float, to scale, at three quarters of the time."""
    k = 3 * (len(result["time"].values) - 1) // 4
    x, h = 1e3 * result["x"].values, 1e3 * result["thickness"].values[k]
    X = 1e3 * float(result["float_position"].values[k])
    length, thick = (1e3 * result.attributes["float"][name] for name in ("length", "thickness"))
    axes.fill_between(x, 0, h, color=LINKS[0], alpha=0.5, linewidth=0)
    below = np.abs(x - X) <= length / 2
    axes.fill_between(x[below], h[below], h[below] + thick, color=MASSES[0])
    axes.axhline(float(result["thickness"].values[0].mean() * 1e3), color=GREY, linewidth=0.5)
    axes.set(xlim=(X - _AROUND * length, X + _AROUND * length), ylim=(0, 1.2 * h.max() + thick))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("position $x$ (mm)")
    axes.set_ylabel("$z$ (mm)")
    axes.set_title(
        f"film and float with the design at {result['time'].values[k]:.3g} s, to scale",
        loc="left", fontsize="small",
    )  # fmt: skip
