"""Pictures of scenes of kind "fit-design": recorded and fitted forces, and spike loads."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    RED,
    ceilings,
    draw_limits,
    fact,
    handles,
    label,
    legend,
    legend_below,
    line,
    scalar,
    shades,
    sheet,
    tell,
)
from wormopt.result import Result

_MOST = 2000  # number of readings that are drawn, the first ones


def forces(result: Result) -> Figure:
    """Draw recorded actuator forces, their fit and the residuals of the first run.

    Needs ``reading_time``, ``reading_run``, ``read_force`` and ``fitted_force``.
    """
    first = np.flatnonzero(result["reading_run"].values == result["reading_run"].values[0])[:_MOST]
    time, read = result["reading_time"].values[first], result["read_force"].values[:, first]
    fitted = result["fitted_force"].values[:, first]
    drawn = sheet(7.1, 4.4, 4.4)
    above, below = drawn.subplots(2, sharex=True, height_ratios=(2, 1))
    for j, colour in enumerate(shades(LINKS, len(read))):
        above.plot(time, read[j], ".", color=colour, markersize=1.5, alpha=0.6)
        above.plot(time, fitted[j], color="black", linewidth=0.7, zorder=3)
        below.plot(time, read[j] - fitted[j], ".", color=colour, markersize=1.5, alpha=0.6)
    below.axhline(0.0, color="black", linewidth=0.7)
    unit = result["read_force"].unit
    above.set_ylabel(label("actuator force $\\mu_j$", unit))
    below.set_ylabel(label("reading − fit", unit))
    below.set_xlabel(label("time $t$", result["reading_time"].unit))
    legend(above, [*handles("link", len(read)), line("fit", "black", width=0.7)])
    tell(
        drawn,
        fact(result, "load_found"),
        fact(result, "load_error", "standard error"),
        fact(result, "drag_found"),
    )
    drawn.align_ylabels()
    return drawn


def loads(result: Result) -> Figure:
    """Draw the load of a resting spike over a cycle: estimated, worst case, and on the plant.

    Needs ``band_time``, ``band_load``, ``band_error``. With a plant, it also needs ``plant_time``
    and the like, and shows the gait that assumes exact estimates.
    """
    limit = scalar(result, "spike_load_limit")
    alike = [limit] if isinstance(limit, float) else []
    tall = 1.9 * len(alike)
    drawn = sheet(7.1, 3.6 + tall, 4.0 + tall)
    rows = 1 + len(alike)
    panels = drawn.subplots(rows, sharex=True, squeeze=False, height_ratios=(2, 1)[:rows])
    entries: list[Artist] = []
    for axes in panels[:, 0]:
        entries = _draw_loads(axes, result)
        entries += draw_limits(axes, ceilings(limit, 1)[:1], [GREY])
        axes.set_ylabel(label("load of a\nresting spike", result["band_load"].unit))
        axes.margins(x=0)
    panels[0, 0].set_ylim(bottom=0.0)
    for most in alike:
        room = float(result["band_error"].values.max())
        panels[1, 0].set_ylim(most - 4 * room, most + room)
        panels[1, 0].set_ylabel(label("load near\nthe limit", result["band_load"].unit))
    panels[-1, 0].set_xlabel(label("time $t$ in a cycle", result["band_time"].unit))
    drawn.align_ylabels()
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "plant_share", "speed over that of the gait designed with true parameters"),
        fact(result, "plant_spike_load_max", "largest load on the plant"),
    )
    return drawn


def _draw_loads(axes: Axes, result: Result) -> list[Artist]:
    """Draw band and curves; returns their legend entries."""
    time, load = result["band_time"].values, result["band_load"].values
    error, colour = result["band_error"].values, LINKS[0]
    axes.fill_between(time, load - error, load + error, color=colour, alpha=0.25, linewidth=0)
    axes.plot(time, load, color=colour)
    entries: list[Artist] = [
        line("with the estimates", colour),
        Patch(color=colour, alpha=0.25, label="for all parameters in the ellipsoid"),
    ]
    if "plant_share" in result.scalars:
        plant, bold = (
            [result[f"{name}_{what}"].values for what in ("time", "load")]
            for name in ("plant", "bold")
        )
        axes.plot(*plant, color="black", linestyle=DASHES[1], linewidth=1)
        axes.plot(*bold, color=RED, linewidth=0.8)
        entries += [
            line("on the plant", "black", DASHES[1], 1),
            line("on the plant, gait that assumes exact estimates", RED, width=0.8),
        ]
    return entries
