"""Plots of films over rows of coils."""

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
    number,
    sheet,
    tell,
)
from wormopt.result import Result

_SNAPSHOTS = 4
_FRAMES, _AROUND = 5, 2.0  # number of times shown, and lengths of the float shown beside it


def coil_film(result: Result) -> Figure:
    """Plot thickness over position and time, and thickness and flow at a few times.

    The thickness is stretched relative to the position; ticks below are the coils.
    """
    drawn = sheet(7.1, 6.8, 6.2)
    spread, still, flow = drawn.subplots(3, height_ratios=(4, 3, 2.4), sharex=True)
    x, t = 1e3 * result["x"].values, result["time"].values
    face, h = 1e3 * result["face"].values, 1e3 * result["thickness"].values
    flat = float(h[0].mean())
    most = max(float(np.abs(h - flat).max()), 1e-12)
    edges = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]])
    shown = spread.pcolormesh(
        face, edges, h, cmap="RdBu_r", vmin=flat - most, vmax=flat + most, shading="flat",
        rasterized=True,
    )  # fmt: skip
    drawn.colorbar(shown, ax=spread, label="thickness $h$ (mm)", pad=0.01)
    spread.grid(visible=False)
    spread.set_ylabel(label("time $t$", result["time"].unit))
    kept = np.linspace(0, len(t) - 1, _SNAPSHOTS + 1).astype(int)[1:]
    for colour, dashes, k in zip(LINKS, DASHES, kept, strict=False):
        still.plot(x, h[k], color=colour, linestyle=dashes, label=f"at {t[k]:.3g} s")
        flow.plot(face, 1e6 * result["flow"].values[k], color=colour, linestyle=dashes)
    still.axhline(flat, color=GREY, linewidth=1)
    for place in 1e3 * result["coil_place"].values:
        still.axvline(place, ymax=0.04, color=GREY, linewidth=1)
    still.set_ylim(bottom=0)
    still.set_ylabel("thickness $h$ (mm)")
    flow.set_ylabel(label("flow $Q$", "mm2 s-1"))
    flow.set_xlabel("position $x$ (mm)")
    flow.margins(x=0)
    entries = [*still.get_lines()[: len(kept)], line("coil", GREY, "none", marker="|")]
    legend_below(drawn, entries)
    tell(
        drawn,
        told_of_row(result),
        fact(result, "wave_speed", "wave speed", "mm s-1"),
        fact(result, "carried_per_switch", "carried per switch", "mm2"),
        fact(result, "thickness_max", "thickest", "mm"),
        fact(result, "thickness_min", "thinnest", "mm"),
        fact(result, "grid_error", "grid error", "%"),
    )
    return drawn


def told_of_row(result: Result) -> str:
    """Return the assumed row of a plot: no rig with all of these values is published."""
    count, pitch = len(result["coil_place"].values), 1e3 * result.attributes["pitch"]
    return f"row assumed: {count} coils {number(pitch)} mm apart"


def cargo(result: Result) -> Figure:
    """Plot the float on the film at a few times, to scale, and its path over the coils'."""
    t, x = result["time"].values, 1e3 * result["x"].values
    h, X = 1e3 * result["thickness"].values, 1e3 * result["float_position"].values
    length, thick = (1e3 * result.attributes["float"][name] for name in ("length", "thickness"))
    drawn = sheet(7.1, 7.0, 7.4)
    *frames, path = drawn.subplots(_FRAMES + 1, height_ratios=[1] * _FRAMES + [4])
    top = h.max() + 3 * thick
    on = result["current"].values > 0
    places = 1e3 * result["coil_place"].values
    for axes, k in zip(frames, np.linspace(0, len(t) - 1, _FRAMES).astype(int), strict=True):
        axes.fill_between(x, 0, h[k], color=LINKS[0], alpha=0.5, linewidth=0)
        below = np.abs(x - X[k]) <= length / 2
        axes.fill_between(x[below], h[k][below], h[k][below] + thick, color=MASSES[0])
        low, high = X[k] - _AROUND * length, X[k] + _AROUND * length
        seen = places[on[k] & (low < places) & (places < high)]
        axes.plot(seen, 0 * seen, "|", color="black", markersize=12, clip_on=False)
        axes.set(xlim=(low, high), ylim=(0, top), ylabel="$z$ (mm)")
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set_title(f"{t[k]:.3g} s", loc="left", fontsize="small")
    frames[0].set_title("height to scale; strokes: active coils", loc="right", fontsize="small")
    frames[-1].set_xlabel("position $x$ (mm)")
    _path(path, result, t, X, places, on)
    tell(
        drawn,
        fact(result, "float_speed", "mean speed", "mm s-1"),
        fact(result, "wave_speed", "wave speed", "mm s-1"),
        fact(result, "float_captured", "keeps up in", "%"),
        fact(result, "draught", "draught", "mm"),
        fact(result, "energy_error", "energy error", "%"),
    )
    return drawn


def _path(
    axes: Axes, result: Result, t: np.ndarray, X: np.ndarray, places: np.ndarray, on: np.ndarray
) -> None:
    half = 500 * result.attributes["pitch"]
    edges = np.concatenate([places - half, places[-1:] + half])
    axes.pcolormesh(edges, t, on[:-1], cmap="Greys", vmax=4, shading="flat", rasterized=True)
    axes.plot(X, t, color=MASSES[0], label="middle of the float")
    axes.fill_betweenx([], [], color="0.75", label="active coils")
    axes.grid(visible=False)
    axes.set_xlabel("position $x$ (mm)")
    axes.set_ylabel(label("time $t$", result["time"].unit))
    axes.legend(loc="upper left")
