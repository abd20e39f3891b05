"""Pictures of magnetic materials, and of the pair they drive."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GLIDE, GREY, LINKS, RED, facts, label, legend, scalar, sheet
from wormopt.result import Result


def stress_strain(result: Result) -> Figure:
    """Stress against strain (%), with the field and without: the chapter's figure 12.

    Shaded where strains are no longer small.
    """
    drawn = sheet(7.5, 5)
    axes = drawn.subplots()
    percent = 100 * result["strain"].values
    field = scalar(result, "field")
    for name, colour, dashes, text in (
        ("stress_without_field", GREY, (0, (5, 2)), "without field, slope $3\\eta$"),
        ("stress_with_field", LINKS[0], "-", f"$H$ = {field:g} A/m, slope $E_{{eff}}$"),
    ):
        axes.plot(
            percent, result[name].values, color=colour, linestyle=dashes, linewidth=2, label=text
        )
    _mark(axes, result, percent)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.margins(x=0)
    axes.set_xlabel("strain $u$ (%)")
    axes.set_ylabel(label("stress $p$", result["stress_with_field"].unit))
    axes.set_title(facts(result, "permeability", "lame_eta", "stiffness"), loc="left")
    axes.legend(loc="upper left")
    return drawn


def _mark(axes: Axes, result: Result, percent: np.ndarray) -> None:
    """Point out u0 and what is beyond small strains."""
    u0, small = 100 * scalar(result, "u0"), 100 * scalar(result, "small_strain")
    if percent[0] <= u0 <= percent[-1] and u0:
        axes.plot(u0, 0.0, marker="o", color=LINKS[0], clip_on=False, zorder=3)
        axes.annotate(
            f"$u_0$ = {u0:.3g} %", (u0, 0.0), (6, -14), textcoords="offset points", color=LINKS[0]
        )
    beyond = [(small, percent[-1]), (percent[0], -small)]
    for index, (start, end) in enumerate(span for span in beyond if span[0] < span[1]):
        start, end = max(start, percent[0]), min(end, percent[-1])
        text = "" if index else "beyond small strains"
        axes.axvspan(start, end, color=GLIDE, zorder=0, label=text or None)


def velocity(result: Result) -> Figure:
    """Velocity of the pair over time, exactly and on average: the chapter's figure 13.

    The whole time above; below, the last periods of the field, in which it is steady.
    """
    drawn = sheet(9, 6.5)
    whole, late = drawn.subplots(2, 1, height_ratios=(3, 2))
    t, close = result["time"].values, result["late_time"].values
    whole.plot(t, result["velocity"].values, color="#BBBBBB", linewidth=0.8, label="exact")
    late.plot(close, result["late_velocity"].values, color="#999999", linewidth=1.2)
    _averages(whole, result, np.full(len(t), True))
    _averages(late, result, (t >= close[0]) & (t <= close[-1]))
    for axes in (whole, late):
        axes.axhline(_steady(result), color="black", linewidth=0.8, linestyle=(0, (6, 3)))
        axes.margins(x=0)
        axes.set_ylabel(label("velocity $V$", result["velocity"].unit))
    stated = scalar(result, "velocity_stated")
    if stated is not None:
        whole.axhline(stated, color=GREY, linewidth=1, linestyle=(0, (1, 2)))
        whole.annotate(
            "stated", (t[-1], stated), (-4, -12), textcoords="offset points", ha="right", color=GREY
        )
    late.set_xlabel(label("time $t$", result["time"].unit))
    late.set_title("the last periods of the field", loc="left")
    whole.set_title(
        facts(result, *(f"velocity_{name}{_ending(result)}" for name in ("steady", "exact_mean"))),
        loc="left",
    )
    legend(whole, [*whole.get_lines()[:4]])
    return drawn


def _averages(axes: Axes, result: Result, shown: np.ndarray) -> None:
    t = result["time"].values[shown]
    for name, colour, dashes, text in (
        ("velocity_period", "black", "-", "exact, mean over\na period"),
        ("velocity_first", LINKS[0], "-", "average,\nfirst order"),
        ("velocity_second", LINKS[1], (0, (4, 2)), "average,\nsecond order"),
    ):
        if name in result:
            values = result[name].values[shown]
            axes.plot(t, values, color=colour, linestyle=dashes, linewidth=1.8, label=text)


def _ending(result: Result) -> str:
    """Of the names of scalars in the units of the picture."""
    return "_si" if "velocity_steady_si" in result.scalars else ""


def _steady(result: Result) -> float:
    return scalar(result, f"velocity_steady{_ending(result)}")


def resonance(result: Result) -> Figure:
    """Steady velocity and amplitude of the pair over the detuning of its field.

    Logarithmic axes where all are of one sign; unstable states dashed, folds marked.
    """
    drawn = sheet(9, 6.5)
    above, below = drawn.subplots(2, 1, sharex=True)
    parts = (
        (above, "velocity", "velocity $V$", ("velocity_exact", "exact")),
        (below, "amplitude", "amplitude $a$ of half the stretch", None),
    )
    for axes, name, text, exact in parts:
        values = result[f"curve_{name}"].values
        _branches(axes, result, values)
        if exact and exact[0] in result:
            axes.plot(
                result["detuning"].values, result[exact[0]].values, ".", color=LINKS[1],
                markersize=3.5, zorder=3, label="exact motion, mean",
            )  # fmt: skip
        if values.min() > 0 and values.max() > 20 * values.min():
            axes.set_yscale("log")
        axes.set_ylabel(label(text, result[f"curve_{name}"].unit))
    for fold in scalar(result, "delta_fold"):
        above.axvline(fold, color=RED, linewidth=0.8)
        below.axvline(fold, color=RED, linewidth=0.8)
        above.annotate(
            f"fold {fold:.4g}", (fold, 1), (3, -10), xycoords=("data", "axes fraction"),
            textcoords="offset points", color=RED, fontsize=9,
        )  # fmt: skip
    detunings = result["detuning"].values
    below.set_xlim(detunings.min(), detunings.max())
    below.set_xlabel(r"detuning $\Delta$ of the field ($\nu = \sqrt{2} + \varepsilon \Delta$)")
    above.set_title(
        facts(result, "eps", "averaging_error", "averaging_error_second", "confirmed"), loc="left"
    )
    above.legend(loc="upper right")
    return drawn


def _branches(axes: Axes, result: Result, values: np.ndarray) -> None:
    """Each branch as a line, dashed where it is not stable."""
    detuning, stable = result["curve_detuning"].values, result["curve_stable"].values
    labelled: set[bool] = set()
    for number in np.unique(result["curve_branch"].values):
        own = result["curve_branch"].values == number
        for kind, dashes, text in ((1, "-", "average"), (0, (0, (4, 2)), "average, not stable")):
            shown = np.where(stable[own] == kind, values[own], np.nan)
            if np.isnan(shown).all():
                continue
            axes.plot(
                detuning[own], shown, color=LINKS[0], linestyle=dashes, linewidth=1.8,
                label=None if kind in labelled else text,
            )  # fmt: skip
            labelled.add(bool(kind))
