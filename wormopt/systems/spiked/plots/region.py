"""Picture of the periods and loads at which kinematics alone determines a gait's motion."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    GLIDE,
    GREY,
    RED,
    label,
    legend_below,
    line,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result


def region(result: Result) -> Figure:
    """Draw the largest spike load by period and load, and where the worm glides or spikes break.

    Needs ``region_period``, ``region_load``, ``region_spike_load`` and ``region_least_load``;
    ``region_most_load`` if the strength of a spike is known. A cross marks the gait itself.
    """
    period, load = result["region_period"], result["region_load"]
    least, peaks = result["region_least_load"].values, result["region_spike_load"]
    top = load.values[-1]
    drawn = sheet(7.1, 4.6, 3.9)
    axes = drawn.subplots()
    axes.grid(visible=False)
    if np.isfinite(peaks.values).any():
        # each column continues below the border, where it is covered, so that no cell ends above
        lowest = np.nanmin(peaks.values, axis=1, keepdims=True, initial=np.nanmax(peaks.values))
        held = np.where(np.isnan(peaks.values), lowest, peaks.values).T
        image = axes.pcolormesh(
            period.values, load.values, held, cmap="Blues", shading="gouraud", rasterized=True
        )
        drawn.colorbar(image, ax=axes, label=label("largest load on a spike", peaks.unit))
    axes.fill_between(period.values, load.values[0], least, color=GLIDE, linewidth=0, zorder=2)
    axes.plot(period.values, least, color="black", linewidth=1.4, zorder=3)
    entries: list[Artist] = [
        Patch(facecolor=GLIDE, label="the worm glides"),
        line("smallest load without gliding, $w = 0$", "black"),
    ]
    if "region_most_load" in result:
        most = result["region_most_load"].values
        axes.fill_between(
            period.values, np.maximum(most, least), max(top, most.max()), facecolor="none",
            edgecolor=RED, hatch="///", linewidth=0, zorder=2,
        )  # fmt: skip
        # covered where the worm glides and breaks no spike
        axes.plot(period.values, most, color=RED, linewidth=1.4, zorder=1.5)
        strength = f"{number(scalar(result, 'region_spike_strength'))} {peaks.unit}"
        entries.append(
            Patch(facecolor="none", edgecolor=RED, hatch="///",
                  label=f"a spike carries more than {strength.removesuffix(' 1')}")
        )  # fmt: skip
    own, at = scalar(result, "region_gait_load"), scalar(result, "period")
    if own is not None and at is not None:
        entries += axes.plot([at], [own], "X", color=RED, markeredgecolor="white", markersize=9,
                             zorder=5, linestyle="none", label="this gait")  # fmt: skip
    axes.set_xlim(period.values[0], period.values[-1])
    axes.set_ylim(load.values[0], top)
    axes.set_xlabel(label("period $T$", period.unit))
    axes.set_ylabel(label(r"load $\Gamma$ on every mass", load.unit))
    axes.tick_params(color=GREY)
    if least.min() > top:
        tell(drawn, "the worm glides at all loads of this map")
    legend_below(drawn, entries)
    return drawn
