"""Pictures of averaged motions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wormopt.plotting.parts import GREY, LINKS, MASSES, RED, facts, label, legend, scalar, sheet
from wormopt.result import Result


def reversals(result: Result) -> Figure:
    """Prescribed velocities over a period with their reversals, and the course of the centre.

    Above: masses slide backward below the line at -V; dots: reversals of the exact motion.
    Below: exact and averaged velocity of the centre, with the steady velocities.
    """
    drawn = sheet(9, 7)
    above, below = drawn.subplots(2, 1)
    _draw_period(above, result)
    _draw_course(below, result)
    above.set_title(
        facts(result, "velocity_exact_mean", "velocity_steady", "smallness"), loc="left"
    )
    return drawn


def _draw_period(axes: Axes, result: Result) -> None:
    share, relative = result["share"].values, result["relative_velocity"].values
    colours = [MASSES[i % len(MASSES)] for i in range(len(relative))]
    for own, colour in zip(relative, colours, strict=True):
        axes.plot(share, own, color=colour, linewidth=1.8)
    exact = scalar(result, "velocity_exact_mean")
    V = scalar(result, "velocity_steady") if exact is None else exact
    axes.axhline(-V, color=GREY, linewidth=1.2, linestyle=(0, (5, 2)))
    if "event_share" in result:
        for at, contact in zip(
            result["event_share"].values, result["event_contact"].values, strict=True
        ):
            here = np.interp(at, share, relative[contact])
            axes.plot(at, here, "o", color=colours[contact], markersize=6, clip_on=False)
            axes.axvline(at, color=colours[contact], linewidth=0.7, alpha=0.5)
    axes.set_xlim(0, 1)
    axes.set_xlabel("share of the period")
    axes.set_ylabel(label("velocity relative to centre", result["relative_velocity"].unit))
    named = [
        Line2D([], [], color=colour, linewidth=1.8, label=f"mass {i}")
        for i, colour in enumerate(colours)
    ]
    level = Line2D([], [], color=GREY, linestyle=(0, (5, 2)), label="$-V$: a mass reverses")
    legend(axes, [*named, level])


def _draw_course(axes: Axes, result: Result) -> None:
    time, handles = result["time"].values, []
    if "center_velocity" in result:
        handles += axes.plot(
            time, result["center_velocity"].values, color=LINKS[0], linewidth=2.2, label="exact"
        )
    handles += axes.plot(
        time,
        result["center_velocity_averaged"].values,
        color=LINKS[1],
        linewidth=1.4,
        linestyle=(0, (4, 2)),
        label="averaged, order 1",
    )
    steady = zip(scalar(result, "steady_velocities"), scalar(result, "steady_stable"), strict=True)
    for V, stable in steady:
        axes.axhline(V, color=GREY if stable else RED, linewidth=1, linestyle=":", zorder=1.5)
        text = "steady" if stable else "steady, not stable"
        if text not in [handle.get_label() for handle in handles]:
            colour = GREY if stable else RED
            handles.append(Line2D([], [], color=colour, linestyle=":", label=text))
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel(label("velocity of the centre $V$", result["center_velocity_averaged"].unit))
    legend(axes, handles)
