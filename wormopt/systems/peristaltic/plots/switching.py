"""Plot of optimal switching times, with lengths and velocity."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LINKS,
    fact,
    label,
    labels,
    legend,
    line,
    needed,
    shades,
    sheet,
    stretches,
    tell,
)
from wormopt.result import Result


def switching(result: Result) -> Figure:
    """Plot when each coil is on, the lengths of all segments, and the velocity over a period.

    The inside of a bar is black while its segment rests on the wall.
    """
    drawn = sheet(7.1, 5.0, 5.2)
    coils, middle, below = drawn.subplots(3, sharex=True, height_ratios=(1, 2, 1))
    time, lengths = result["instant"].values, result["length"].values
    count = len(lengths)
    colours = shades(LINKS, count)
    for j, colour in enumerate(colours):
        for name, high, shade in (("coil", 0.4, colour), ("anchored", 0.1, "black")):
            spans = stretches(time, result[name].values[j] > 0.5)
            bars = [(begin, end - begin) for begin, end in spans]
            coils.broken_barh(bars, (j - high, 2 * high), color=shade, linewidth=0)
        middle.plot(time, lengths[j], color=colour)
    coils.set_yticks(range(count), [str(j) for j in range(count)])
    coils.set_ylim(count - 0.5, -0.5)
    coils.set_ylabel("coil $j$ on")
    coils.grid(visible=False)
    legend(middle, [*map(line, labels("segment", count), colours)])
    middle.set_ylabel(label("length $l_j$", result["length"].unit))
    for switch in np.unique(needed(result, "phase_times")):
        for axes in (middle, below):
            axes.axvline(switch, color=GREY, linewidth=0.4, zorder=0)
    below.plot(time, result["velocity"].values, color="black")
    below.axhline(needed(result, "speed"), color=GREY, linewidth=1, linestyle=":")
    legend(below, [line("centre", "black"), line("mean", GREY, ":", 1)])
    below.set_ylabel(label("velocity", result["velocity"].unit))
    below.set_xlabel(label("time $t$", result["instant"].unit))
    below.margins(x=0)
    tell(
        drawn,
        fact(result, "speed", "mean velocity"),
        fact(result, "energy_per_distance", "energy per distance"),
        fact(result, "time", "period"),
    )
    drawn.align_ylabels()
    return drawn
