"""Pictures of averaged motions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    fact,
    handles,
    label,
    legend,
    line,
    needed,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result


def reversals(result: Result) -> Figure:
    """Prescribed velocities over a period with their reversals, and the velocity of the centre.

    Above: masses slide backward below the line at -V; dots: reversals of the exact motion. Below:
    exact and averaged velocity of the centre, with the steady velocities.
    """
    drawn = sheet(7.1, 5.0, 5.0)
    above, below = drawn.subplots(2, 1)
    _draw_period(above, result)
    _draw_course(below, result)
    tell(
        drawn,
        fact(result, "velocity_exact_mean", "mean velocity"),
        fact(result, "velocity_steady", "steady velocity by averaging"),
        fact(result, "smallness", "small parameter"),
    )
    return drawn


def _draw_period(axes: Axes, result: Result) -> None:
    share, relative = result["share"].values, result["relative_velocity"].values
    colours = [MASSES[i % len(MASSES)] for i in range(len(relative))]
    for own, colour in zip(relative, colours, strict=True):
        axes.plot(share, own, color=colour)
    exact = scalar(result, "velocity_exact_mean")
    V = needed(result, "velocity_steady") if exact is None else exact
    axes.axhline(-V, color=GREY, linewidth=0.9, linestyle=LIMIT)
    if "event_share" in result:
        for at, contact in zip(
            result["event_share"].values, result["event_contact"].values, strict=True
        ):
            here = np.interp(at, share, relative[contact])
            axes.plot(at, here, "o", color=colours[contact], markersize=4.5, clip_on=False)
            axes.axvline(at, color=colours[contact], linewidth=0.7, alpha=0.5)
    axes.set_xlim(0, 1)
    axes.set_xlabel("share of the period")
    axes.set_ylabel(label("velocity relative\nto the centre", result["relative_velocity"].unit))
    entries = [line("$-V$: a mass reverses", GREY, LIMIT, 0.9)]
    if "event_share" in result:
        entries.append(line("exact reversal", GREY, "none", marker="o"))
    legend(axes, [*handles("mass", len(relative), worm=False), *entries])


def _draw_course(axes: Axes, result: Result) -> None:
    time, entries = result["time"].values, []
    if "center_velocity" in result:
        entries += axes.plot(
            time, result["center_velocity"].values, color=LINKS[0], linewidth=1.8, label="exact"
        )
    entries += axes.plot(
        time,
        result["center_velocity_averaged"].values,
        color=LINKS[1],
        linewidth=1.1,
        linestyle=DASHES[1],
        label="averaged, order 1",
    )
    steady = zip(needed(result, "steady_velocities"), needed(result, "steady_stable"), strict=True)
    for V, stable in steady:
        axes.axhline(V, color=GREY if stable else RED, linewidth=1, linestyle=":", zorder=1.5)
        text = "steady" if stable else "steady, unstable"
        if text not in [entry.get_label() for entry in entries]:
            colour = GREY if stable else RED
            entries.append(line(text, colour, ":", 1))
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel(label("velocity of\nthe centre $V$", result["center_velocity_averaged"].unit))
    legend(axes, entries)
