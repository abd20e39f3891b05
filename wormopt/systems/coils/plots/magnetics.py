"""Plots of magnetic materials, and of the pair they drive."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    needed,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result


def stress_strain(result: Result) -> Figure:
    """Plot stress over strain (%), with field and without: figure 12 of Zimmermann et al. 2007.

    Strains that are no longer small are shaded.
    """
    drawn = sheet(7.1, 4.2, 3.2)
    axes = drawn.subplots()
    percent = 100 * result["strain"].values
    field = needed(result, "field")
    for name, colour, dashes, text in (
        ("stress_without_field", GREY, DASHES[1], "without field, slope $3\\eta$"),
        (
            "stress_with_field",
            LINKS[0],
            "-",
            rf"$H$ = {number(field)} A m$^{{-1}}$, slope $E_{{eff}}$",
        ),
    ):
        axes.plot(percent, result[name].values, color=colour, linestyle=dashes, label=text)
    _mark(axes, result, percent)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.margins(x=0)
    axes.set_xlabel("strain $u$ (%)")
    axes.set_ylabel(label("stress $p$", result["stress_with_field"].unit))
    tell(
        drawn,
        fact(result, "permeability"),
        fact(result, "lame_eta", r"Lamé coefficient $\eta$", "kPa"),
        fact(result, "stiffness", "stiffness of the bar"),
    )
    legend_below(drawn)
    return drawn


def _mark(axes: Axes, result: Result, percent: np.ndarray) -> None:
    """Mark u0 and the range beyond small strains."""
    u0, small = 100 * needed(result, "u0"), 100 * needed(result, "small_strain")
    if percent[0] <= u0 <= percent[-1] and u0:
        axes.plot(u0, 0.0, marker="o", color=LINKS[0], clip_on=False, zorder=3)
        axes.annotate(
            f"$u_0$ = {number(u0, 3)} %", (u0, 0.0), (5, -11), textcoords="offset points",
            color=LINKS[0],
        )  # fmt: skip
    beyond = [(small, percent[-1]), (percent[0], -small)]
    for index, (start, end) in enumerate(span for span in beyond if span[0] < span[1]):
        start, end = max(start, percent[0]), min(end, percent[-1])
        text = "" if index else "beyond small strains"
        axes.axvspan(start, end, color=GLIDE, zorder=0, label=text or None)


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
