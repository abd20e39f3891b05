"""Picture of step commands: lengths, a close-up of steps, rates of the motors, way of the worm."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wormopt.plotting.parts import (
    GREY,
    LINKS,
    MASSES,
    RED,
    facts,
    label,
    legend,
    link_handles,
    mass_handles,
    scalar,
    sheet,
)
from wormopt.result import Result


def steps(result: Result) -> Figure:
    """Commanded and ideal lengths, close-up of a turn, motor rates with limits, mass positions.

    The result is of kind ``stepper``.
    """
    drawn = sheet(8.5, 11)
    lengths, turn, rates, places = drawn.subplots(4, height_ratios=(2.4, 2.4, 2, 3))
    time = result["time"].values
    count = len(result["length"].values)
    for j in range(count):
        lengths.plot(time, 1e3 * result["commanded"].values[j], color=LINKS[j], linewidth=4,
                     alpha=0.35)  # fmt: skip
        lengths.plot(time, 1e3 * result["length"].values[j], color=LINKS[j], linewidth=1.1)
        rates.plot(time, result["turn_rate"].values[j], color=LINKS[j], linewidth=1.8)
    wide = Line2D([], [], color=GREY, linewidth=4, alpha=0.35, label="commanded")
    thin = Line2D([], [], color=GREY, linewidth=1.1, label="gait")
    legend(lengths, [*link_handles(count), wide, thin])
    lengths.set_ylabel("link length $l_j$\n(mm)")
    lengths.set_title(facts(result, "travel_per_step", "quantisation_error"), loc="left")
    _close_up(turn, result)
    _limits(rates, result)
    _motion(places, result)
    for axes in (lengths, rates, places):
        axes.set_xlim(time[0], time[-1])
    lengths.set_xticklabels([])
    rates.set_xticklabels([])
    drawn.align_ylabels()
    return drawn


def _close_up(axes: Axes, result: Result) -> None:
    """Steps about a turn of one link, counted from the length commanded there."""
    link = int(result["turn_link"].values[0])
    time = result["turn_time"].values
    base = result["turn_commanded"].values[0]
    commanded = 1e6 * (result["turn_commanded"].values - base)
    ideal = 1e6 * (result["turn_length"].values - base)
    axes.step(time, commanded, where="post", color=LINKS[link], linewidth=2.2, alpha=0.6)
    axes.plot(time, ideal, color="black", linewidth=1.1)
    handles = [
        Line2D([], [], color=LINKS[link], linewidth=2.2, alpha=0.6, label="commanded"),
        Line2D([], [], color="black", linewidth=1.1, label="gait"),
    ]
    legend(axes, handles)
    axes.margins(x=0)
    axes.set_ylabel(f"$l_{link + 1}$ near a turn,\nchange (µm)")
    axes.set_xlabel("time $t$ (s), close-up")


def _limits(axes: Axes, result: Result) -> None:
    """The motor's largest rate and its start rate, in both directions."""
    limit, start = (float(scalar(result, k) or 0.0) for k in ("turn_rate_limit", "start_rate"))
    lines = [Line2D([], [], color=RED, linestyle="--", linewidth=1.1, label="limit")]
    levels = [limit]
    if start:
        lines.append(Line2D([], [], color=GREY, linestyle=":", linewidth=1.1, label="start rate"))
        levels.append(start)
    for line, value in zip(lines, levels, strict=True):
        for level in (-value, value):
            axes.axhline(level, color=line.get_color(), linestyle=line.get_linestyle(), lw=1.1)
    legend(axes, lines)
    axes.set_ylabel(label("rate of the\nmotors", "turns s-1"))
    axes.set_title(facts(result, "period", "period_min"), loc="left")


def _motion(axes: Axes, result: Result) -> None:
    """Places of the masses by steps, and those of the gait without any loss."""
    time = result["time"].values
    rows, ideal = result["position"].values, result["position_ideal"].values
    for row, lossless, colour in zip(rows, ideal, MASSES, strict=False):
        axes.plot(time, 1e3 * lossless, color=colour, linewidth=1.1, linestyle=(0, (4, 2)))
        axes.plot(time, 1e3 * row, color=colour, linewidth=1.8)
    dashed = Line2D([], [], color=GREY, linewidth=1.1, linestyle=(0, (4, 2)), label="ideal gait")
    legend(axes, [*mass_handles(len(rows)), dashed])
    axes.set_ylabel("position $x_i$\n(mm)")
    axes.set_xlabel("time $t$ (s)")
    axes.set_title(facts(result, "speed", "speed_ideal", "backslip"), loc="left")
