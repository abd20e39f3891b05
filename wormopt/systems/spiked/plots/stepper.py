"""Picture of step commands: lengths, a close-up of steps, motor rates, positions of the masses."""

from __future__ import annotations

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
    scalar,
    sheet,
    styles,
    tell,
)
from wormopt.result import Result


def steps(result: Result) -> Figure:
    """Draw commanded and ideal lengths, a reversal, motor rates and positions of the masses.

    The result is of kind ``stepper``; motor 0 drives link 0.
    """
    drawn = sheet(7.1, 7.2, 7.6)
    lengths, rates, places, turn = drawn.subplots(4, height_ratios=(2.4, 2, 3, 2.2))
    rates.sharex(lengths)
    places.sharex(lengths)
    time, looks = result["time"].values, styles(LINKS, len(result["length"].values))
    for j, (colour, dashes) in enumerate(looks):
        lengths.plot(time, 1e3 * result["commanded"].values[j], color=colour, linewidth=3,
                     alpha=0.35)  # fmt: skip
        lengths.plot(time, 1e3 * result["length"].values[j], color=colour, linewidth=0.9)
        rates.plot(time, result["turn_rate"].values[j], color=colour, linestyle=dashes)
    wide = line("commanded", GREY, width=3)
    wide.set_alpha(0.4)
    legend(lengths, [*handles("link", len(looks)), wide, line("gait", width=0.9)])
    lengths.set_ylabel("length $l_j$ (mm)")
    _limits(rates, result)
    _motion(places, result)
    for axes in (lengths, rates):
        axes.tick_params(labelbottom=False)
    places.set_xlim(time[0], time[-1])
    _close_up(turn, result)
    tell(
        drawn,
        fact(result, "travel_per_step", unit="µm"),
        fact(result, "quantisation_error", unit="µm"),
        fact(result, "period"),
        fact(result, "period_min", "shortest possible"),
        fact(result, "speed", "mean speed", "mm s-1"),
        fact(result, "speed_ideal", "ideal", "mm s-1"),
        fact(result, "backslip", unit="mm"),
    )
    drawn.align_ylabels()
    return drawn


def _close_up(axes: Axes, result: Result) -> None:
    """Draw the steps of one link near a reversal, relative to the length commanded there."""
    link = int(result["turn_link"].values[0])
    time = result["turn_time"].values
    base = result["turn_commanded"].values[0]
    commanded = 1e6 * (result["turn_commanded"].values - base)
    ideal = 1e6 * (result["turn_length"].values - base)
    axes.step(time, commanded, where="post", color=LINKS[link], linewidth=1.8, alpha=0.6,
              label="commanded")  # fmt: skip
    axes.plot(time, ideal, color="black", linewidth=0.9, label="gait")
    legend(axes)
    axes.margins(x=0)
    axes.set_ylabel(f"$l_{link}$ at a reversal,\nchange (µm)")
    axes.set_xlabel("close-up, time $t$ (s)")


def _limits(axes: Axes, result: Result) -> None:
    """Draw the motor's largest rate and start rate, in both directions."""
    limit, start = (float(scalar(result, k) or 0.0) for k in ("turn_rate_limit", "start_rate"))
    levels = [(limit, line("limit of the motor", RED, LIMIT, 0.9))]
    if start:
        levels.append((start, line("start rate", GREY, ":", 0.9)))
    for value, own in levels:
        for level in (-value, value):
            axes.axhline(level, color=own.get_color(), linestyle=own.get_linestyle(), lw=0.9)
    legend(axes, [own for _, own in levels])
    axes.set_ylabel(label("rate of the\nmotors", "turns s-1"))


def _motion(axes: Axes, result: Result) -> None:
    """Draw positions of the masses by steps, and those of the ideal gait."""
    time = result["time"].values
    rows, ideal = result["position"].values, result["position_ideal"].values
    for row, lossless, colour in zip(rows, ideal, MASSES, strict=False):
        axes.plot(time, 1e3 * lossless, color=colour, linewidth=0.9, linestyle=DASHES[1])
        axes.plot(time, 1e3 * row, color=colour)
    dashed = line("ideal gait", GREY, DASHES[1], 0.9)
    legend(axes, [*handles("mass", len(rows)), dashed])
    axes.set_ylabel("position $x_i$\n(mm)")
    axes.set_xlabel("time $t$ (s)")
