"""Pictures of pairs: velocity over time, resonance, the best field, prescribed oscillations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

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
    legend_below,
    line,
    needed,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

# Contact state of each mass, below the curves; forward sliding is white.
_DOES = {0: ("rests", "#D9A93A"), -1: ("slides back", "#D9C7D0")}


def velocity(result: Result) -> Figure:
    """Plot velocity of the pair over time, exact and averaged: figure 13 of Zimmermann et al. 2007.

    The whole time is above; below are the last periods of the field, in which it is steady.
    """
    drawn = sheet(7.1, 5.2, 4.8)
    whole, late = drawn.subplots(2, 1, height_ratios=(3, 2))
    t, close = result["time"].values, result["late_time"].values
    whole.plot(t, result["velocity"].values, color="#BBBBBB", linewidth=0.6, label="exact")
    late.plot(close, result["late_velocity"].values, color="#AAAAAA", linewidth=1)
    _averages(whole, result, np.full(len(t), True))
    _averages(late, result, (t >= close[0]) & (t <= close[-1]))
    for axes in (whole, late):
        axes.axhline(_steady(result), color=RED, linewidth=0.8, linestyle=(0, (1, 2)),
                     label="steady, by averaging")  # fmt: skip
        axes.margins(x=0)
        axes.set_ylabel(label("velocity $V$", result["velocity"].unit))
    stated = scalar(result, "velocity_stated")
    if stated is not None:
        whole.axhline(stated, color=GREY, linewidth=0.8, linestyle=LIMIT, label="stated")
    late.set_xlabel(label("time $t$", result["time"].unit))
    late.set_title("the last periods of the field")
    end = _ending(result)
    tell(
        drawn,
        fact(result, f"velocity_steady{end}", "steady velocity by averaging"),
        fact(result, f"velocity_exact_mean{end}", "exactly"),
    )
    legend_below(drawn)
    return drawn


def _averages(axes: Axes, result: Result, shown: np.ndarray) -> None:
    t = result["time"].values[shown]
    for name, colour, dashes, text in (
        ("velocity_period", "black", "-", "exact, mean over a period"),
        ("velocity_first", LINKS[0], DASHES[1], "average, first order"),
        ("velocity_second", LINKS[1], DASHES[3], "average, second order"),
    ):
        if name in result:
            values = result[name].values[shown]
            axes.plot(t, values, color=colour, linestyle=dashes, label=text)


def _ending(result: Result) -> str:
    """Return the suffix of names of scalars in the units of the plot."""
    return "_si" if "velocity_steady_si" in result.scalars else ""


def _steady(result: Result) -> float:
    return needed(result, f"velocity_steady{_ending(result)}")


def resonance(result: Result) -> Figure:
    """Plot steady velocity and amplitude of the pair over the detuning of its field.

    Axes are logarithmic if all values have one sign; unstable states are dashed, folds marked.
    """
    drawn = sheet(7.1, 5.0, 4.8)
    above, below = drawn.subplots(2, 1, sharex=True)
    parts = (
        (above, "velocity", "velocity $V$", ("velocity_exact", "exact")),
        (below, "amplitude", "amplitude $a$\nof half the stretch", None),
    )
    for axes, name, text, exact in parts:
        values = result[f"curve_{name}"].values
        _branches(axes, result, values)
        if exact and exact[0] in result:
            exactly = result[exact[0]].values
            axes.plot(result["detuning"].values, exactly, ".", color=LINKS[1], markersize=4,
                      markevery=max(1, len(exactly) // 60), zorder=3,
                      label="exact motion, mean")  # fmt: skip
        if values.min() > 0 and values.max() > 20 * values.min():
            axes.set_yscale("log")
        axes.set_ylabel(label(text, result[f"curve_{name}"].unit))
    for fold in needed(result, "delta_fold"):
        for axes in (above, below):
            axes.axvline(fold, color=RED, linewidth=0.8, linestyle=LIMIT, label="fold")
        above.annotate(
            f"fold {number(fold)}", (fold, 1), (3, -10), xycoords=("data", "axes fraction"),
            textcoords="offset points", color=RED, fontsize=7.5,
        )  # fmt: skip
    detunings = result["detuning"].values
    below.set_xlim(detunings.min(), detunings.max())
    below.set_xlabel(r"detuning $\Delta$ of the field ($\nu = \sqrt{2} + \varepsilon \Delta$)")
    tell(
        drawn,
        fact(result, "eps", r"small parameter $\varepsilon$"),
        fact(result, "averaging_error", "error of averaging"),
        fact(result, "averaging_error_second", "to second order"),
        fact(result, "confirmed", "points confirmed"),
    )
    legend_below(drawn)
    return drawn


def _branches(axes: Axes, result: Result, values: np.ndarray) -> None:
    """Draw each branch as a line, dashed where it is unstable."""
    detuning, stable = result["curve_detuning"].values, result["curve_stable"].values
    labelled: set[bool] = set()
    for branch in np.unique(result["curve_branch"].values):
        own = result["curve_branch"].values == branch
        for kind, dashes, text in ((1, "-", "average"), (0, DASHES[2], "average, unstable")):
            shown = np.where(stable[own] == kind, values[own], np.nan)
            if np.isnan(shown).all():
                continue
            axes.plot(
                detuning[own], shown, color=LINKS[0], linestyle=dashes,
                label=None if kind in labelled else text,
            )  # fmt: skip
            labelled.add(bool(kind))


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
    entries = handles("mass", len(result["velocity"].values), worm=False)
    for entry, dashes in zip(entries, DASHES, strict=False):
        entry.set_linestyle(dashes)
    legend(rows[2], [*entries, line("mean velocity", GREY, ":", 1)])
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
