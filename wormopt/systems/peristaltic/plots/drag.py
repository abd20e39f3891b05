"""Plot of the best gait of a worm on drag, with the best small gait."""

from __future__ import annotations

from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
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
    tell,
)
from wormopt.result import Result


def drag_gait(result: Result) -> Figure:
    """Plot lengths of all segments over a period, the best small gait dashed, and velocity."""
    drawn = sheet(7.1, 4.2, 4.6)
    top, below = drawn.subplots(2, sharex=True, height_ratios=(2, 1))
    time, lengths = result["instant"].values, result["length"].values
    colours = shades(LINKS, len(lengths))
    for colour, found, small in zip(colours, lengths, result["length_small"].values, strict=True):
        top.plot(time, small, color=colour, linewidth=0.9, linestyle=DASHES[1])
        top.plot(time, found, color=colour)
    names = labels("segment", len(lengths))
    legend(
        top,
        [*map(line, names, colours), line("best small gait", GREY, DASHES[1], 0.9)],
    )
    top.set_ylabel(label("length $l_j$", result["length"].unit))
    below.plot(time, result["velocity"].values, color="black")
    below.axhline(needed(result, "speed"), color=GREY, linewidth=1, linestyle=":")
    legend(below, [line("centre", "black"), line("mean", GREY, ":", 1)])
    below.set_ylabel(label("velocity", result["velocity"].unit))
    below.set_xlabel(label("time $t$", result["instant"].unit))
    below.margins(x=0)
    tell(
        drawn,
        fact(result, "distance", "displacement per period"),
        fact(result, "distance_small", "by small strains"),
        fact(result, "segments_per_wave"),
    )
    drawn.align_ylabels()
    return drawn
