"""Picture of the best field of a magneto-elastic pair, the harmonic field, and the motions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    MASSES,
    fact,
    handles,
    label,
    legend,
    line,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result

# Contact state of each mass, below the curves; forward sliding is white.
_DOES = {0: ("rests", "#D9A93A"), -1: ("slides back", "#D9C7D0")}


def waveform(result: Result) -> Figure:
    """Field, stretch and velocities over one period, with times of rest and backward sliding.

    Dashed: the harmonic field, and the stretch in it.
    """
    drawn = sheet(7.1, 5.4, 5.8)
    rows = drawn.subplots(4, sharex=True, height_ratios=(2, 2, 2, 0.6))
    time = result["instant"].values
    for axes, name in zip(rows, ("field", "stretch"), strict=False):
        other = result[f"{name}_harmonic"].values
        axes.plot(time, result[name].values, color="black", label="best")
        axes.plot(time, other, color=GREY, lw=1, linestyle=DASHES[1], label="harmonic")
        legend(axes, [*axes.get_lines()])
    rows[0].set_ylabel(label("field $G$", result["field"].unit))
    rows[1].set_ylabel(label("stretch $x_1 - x_0$", result["stretch"].unit))
    for mass, velocity in enumerate(result["velocity"].values):
        rows[2].plot(time, velocity, color=MASSES[mass], linestyle=DASHES[mass])
    rows[2].axhline(needed(result, "speed"), color=GREY, lw=1, linestyle=":")
    told = handles("mass", len(result["velocity"].values), worm=False)
    for entry, dashes in zip(told, DASHES, strict=False):
        entry.set_linestyle(dashes)
    legend(rows[2], [*told, line("mean velocity", GREY, ":", 1)])
    rows[2].set_ylabel(label("velocity $v_i$", result["velocity"].unit))
    _draw_modes(rows[3], result)
    rows[3].set_xlabel(label("time $t$", result["instant"].unit))
    tell(
        drawn,
        fact(result, "speed", "mean velocity"),
        fact(result, "speed_harmonic", "in the harmonic field"),
        fact(result, "gain", "gain"),
    )
    rows[0].margins(x=0)
    drawn.align_ylabels()
    return drawn


def _draw_modes(axes: Axes, result: Result) -> None:
    """One row per mass, filled while it rests or slides back."""
    modes, times = np.array(needed(result, "mode_sequence")), needed(result, "phase_times")
    spans = list(zip(times[:-1], np.diff(times), strict=True))
    for mass in range(modes.shape[1]):
        for mode, (_, colour) in _DOES.items():
            bars = [span for span, m in zip(spans, modes[:, mass], strict=True) if m == mode]
            axes.broken_barh(bars, (mass - 0.4, 0.8), color=colour, linewidth=0)
    axes.set_yticks(range(modes.shape[1]), [str(m) for m in range(modes.shape[1])])
    axes.set_ylabel("mass $i$")
    axes.set_ylim(modes.shape[1] - 0.5, -0.5)
    axes.grid(visible=False)
    shown = [
        Patch(color=colour, label=does)
        for mode, (does, colour) in _DOES.items()
        if np.any(modes == mode)
    ]
    legend(axes, shown)
