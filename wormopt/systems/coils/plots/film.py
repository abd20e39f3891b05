"""Pictures of films over rows of coils."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    fact,
    label,
    legend_below,
    line,
    sheet,
    tell,
)
from wormopt.result import Result

_SNAPSHOTS = 4


def coil_film(result: Result) -> Figure:
    """Thickness over place and time, at some times, and the flow then.

    The thickness is stretched against the place; ticks below are the coils.
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
    flow.set_xlabel("place $x$ (mm)")
    flow.margins(x=0)
    entries = [*still.get_lines()[: len(kept)], line("coil", GREY, "none", marker="|")]
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "wave_speed", "coils switched at", "mm s-1"),
        fact(result, "carried_per_switch", "carried a switch", "mm2"),
        fact(result, "thickness_max", "thickest", "mm"),
        fact(result, "thickness_min", "thinnest", "mm"),
        fact(result, "grid_error", "error of the grid", "%"),
    )
    return drawn
