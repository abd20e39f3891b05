"""Pictures of scenes of kind "gait-shift"."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    legend,
    line,
    needed,
    raised,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result


def shift(result: Result) -> Figure:
    """Draw gear, loads with their limits and position over time, and the load along the route."""
    drawn = sheet(7.1, 6.6, 7.6)
    gear, spike, force, way, ground = drawn.subplots(5, height_ratios=(1, 1.2, 1.2, 1.4, 1))
    time = result["stroke_time"].values
    for upper in (gear, spike, force):
        upper.sharex(way)
        upper.tick_params(labelbottom=False)
    _draw_gears(result, gear)
    for axes, name, limit, what in (
        (spike, "stroke_spike_load", "spike_load_limit", "spike load"),
        (force, "stroke_actuator_force", "actuator_force_limit", "actuator\nforce"),
    ):
        # strokes of a cycle differ: a line would fill the band between their curves
        axes.plot(time, result[name].values, ".", color=LINKS[0], markersize=1.2)
        most, entries = (
            scalar(result, limit),
            [line("largest in each stroke", LINKS[0], "none", marker=".")],
        )
        if most is not None:
            axes.axhline(most, color=RED, linestyle=LIMIT, linewidth=1)
            entries.append(line("limit", RED, LIMIT, 1))
        axes.set_ylabel(label(what, result[name].unit))
        axes.set_ylim(bottom=0)
        legend(axes, entries)
    _draw_way(result, way, ground)
    tell(
        drawn,
        fact(result, "time", "arrives at"),
        fact(result, "best_time", "best in hindsight"),
        fact(result, "fixed_time", "best single gear"),
    )
    drawn.align_ylabels()
    return drawn


def _draw_gears(result: Result, axes: Axes) -> None:
    """Draw the gear over time: supervisor, best schedule and tracked chain."""
    entries = []
    for name, (time, gear), colour, dashes in (
        ("supervisor", ("stroke_time", "stroke_gear"), LINKS[0], "-"),
        ("best schedule", ("best_stroke_time", "best_stroke_gear"), GREY, (0, (2, 1))),
        ("tracked chain", ("adaptive_sample", "adaptive_gear"), LINKS[1], (0, (5, 1.5))),
    ):
        if gear in result:
            axes.plot(
                result[time].values,
                result[gear].values,
                color=colour,
                linestyle=dashes,
                drawstyle="steps-post",
            )
            entries.append(line(name, colour, dashes))
    count = len(needed(result, "gear_speeds"))
    axes.set_yticks(range(count))
    axes.set_ylim(-0.3, count - 0.7)
    axes.set_ylabel("gear")
    legend(axes, entries)


def _draw_way(result: Result, way: Axes, ground: Axes) -> None:
    """Draw positions over time, and the load along the route."""
    entries = []
    for name, (time, place), colour, dashes in (
        ("supervisor", ("stroke_time", "stroke_place"), LINKS[0], "-"),
        ("best schedule", ("best_stroke_time", "best_stroke_place"), GREY, (0, (2, 1))),
        ("tracked chain", ("adaptive_sample", "adaptive_place"), LINKS[1], (0, (5, 1.5))),
    ):
        if place in result:
            way.plot(result[time].values, result[place].values, color=colour, linestyle=dashes)
            entries.append(line(name, colour, dashes))
    alone = scalar(result, "fixed_time")
    place = result["stroke_place"].values
    if alone is not None:
        way.plot([0.0, alone], place[[0, -1]], color=GREY, linewidth=0.8)
        entries.append(line("best single gear", GREY, "-", 0.8))
    way.set_ylabel(label("mean position $x$", result["stroke_place"].unit))
    way.set_xlabel(label("time $t$", result["stroke_time"].unit))
    ends = [
        result[name].values[-1] for name in ("stroke_time", "adaptive_sample") if name in result
    ]
    way.set_xlim(0.0, 1.02 * max(ends))
    legend(way, entries)
    ground.plot(place, result["stroke_load"].values, color="black")
    loads = np.array(needed(result, "gear_loads"), dtype=float)
    for k, (_, most) in enumerate(loads):
        if most < 2 * result["stroke_load"].values.max():
            ground.axhline(most, color=LINKS[k % 8], linestyle=LIMIT, linewidth=0.8)
    named = [line("on each mass", "black")]
    named += [
        line(f"limit of gear {k}", LINKS[k % 8], LIMIT, 0.8)
        for k, (_, most) in enumerate(loads)
        if most < 2 * result["stroke_load"].values.max()
    ]
    legend(ground, named)
    ground.set_ylim(bottom=0)
    ground.margins(x=0)
    ground.set_ylabel(label("load", result["stroke_load"].unit))
    ground.set_xlabel(label("mean position $x$", result["stroke_place"].unit))


def transitions(result: Result) -> Figure:
    """Draw speed and admissible loads of each gear, and durations of the shifts between them."""
    drawn = sheet(7.1, 2.6, 3.0)
    axes = drawn.subplots()
    speeds = needed(result, "gear_speeds")
    loads, resting = needed(result, "gear_loads"), needed(result, "gear_resting")
    for k, (speed, (low, high)) in enumerate(zip(speeds, loads, strict=True)):
        colour = LINKS[k % 8]
        axes.plot([low, high], [speed, speed], color=colour, linewidth=4)
        axes.annotate(
            f"gear {k}, {resting[k]} at rest",
            (high, speed),
            (0, 5),
            textcoords="offset points",
            fontsize="small",
            ha="right",
        )
    for k, (up, down) in enumerate(
        zip(needed(result, "up_durations"), needed(result, "down_durations"), strict=True)
    ):
        both = max(loads[k][0], loads[k + 1][0]), min(loads[k][1], loads[k + 1][1])
        at = both[0] + (both[1] - both[0]) / 4
        axes.annotate(
            "",
            (at, speeds[k + 1]),
            (at, speeds[k]),
            arrowprops={"arrowstyle": "<->", "color": GREY},
        )
        unit = raised(result.scalars["up_durations"].unit)
        note = f"  shifts take {up:.3g} up, {down:.3g} down {unit}".rstrip()
        note = note if up + down else "  shifts take no time"
        axes.annotate(note, (at, (speeds[k] + speeds[k + 1]) / 2), fontsize="small", va="center")
    axes.set_ylim(0, 1.2 * max(speeds))
    axes.set_xlim(left=0)
    unit = result.scalars["gear_loads"].unit
    axes.set_xlabel(label("admissible load $\\Gamma$ on each mass", unit))
    axes.set_ylabel(label("mean speed", result.scalars["gear_speeds"].unit))
    return drawn
