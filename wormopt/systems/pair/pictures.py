"""Pictures of pairs: velocity over time, resonance, the best field, prescribed oscillations."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import DASHES, GREY, LINKS, MASSES, RED, number, patch
from wormopt.result import Result

# Contact state of each mass, below the curves; forward sliding is white.
_DOES = {0: ("rests", "#D9A93A"), -1: ("slides back", "#D9C7D0")}
_AVERAGES = (
    ("velocity_period", "black", "-", "exact, mean over a period"),
    ("velocity_first", LINKS[0], DASHES[1], "average, first order"),
    ("velocity_second", LINKS[1], DASHES[3], "average, second order"),
)


def velocity(result: Result) -> Figure:
    """Plot velocity of the pair over time, exact and averaged: figure 13 of Zimmermann et al. 2007.

    The whole time is above; below are the last periods of the field, in which it is steady.
    """
    page = Page(result, 5.2, 4.8)
    whole, late = page.rows(3, 2, share=False)
    t, close = page["time"], page["late_time"]
    whole.curve(t, "velocity", "exact", color="#BBBBBB", lw=0.6, words="velocity $V$")
    late.curve(close, "late_velocity", color="#AAAAAA", lw=1, words="velocity $V$")
    # scalars in the units of the plot
    end = "_si" if "velocity_steady_si" in page else ""
    for panel, shown in (whole, t == t), (late, (t >= close[0]) & (t <= close[-1])):
        for name, color, dashes, text in _AVERAGES:
            if name in page:
                panel.curve(t[shown], page[name][shown], text, color=color, ls=dashes)
        panel.level(f"velocity_steady{end}", "steady, by averaging", color=RED, ls=(0, (1, 2)))
        panel.axes.margins(x=0)
    whole.level("velocity_stated", "stated")
    late.named("x", "time")
    late.axes.set_title("the last periods of the field")
    page.facts(**{f"velocity_steady{end}": "steady velocity by averaging",
                  f"velocity_exact_mean{end}": "exactly"})  # fmt: skip
    return page.legend()


def resonance(result: Result) -> Figure:
    """Plot steady velocity and amplitude of the pair over the detuning of its field.

    Axes are logarithmic if all values have one sign; unstable states are dashed, folds marked.
    """
    page = Page(result, 5.0, 4.8)
    above, below = page.rows(1, 1)
    for panel, name, text in (
        (above, "velocity", "velocity $V$"),
        (below, "amplitude", "amplitude $a$ of half the stretch"),
    ):
        values, exact = page[f"curve_{name}"], page.get(f"{name}_exact")
        _branches(panel, values)
        if exact is not None:
            panel.curve(page["detuning"], exact, "exact motion, mean", ls="", marker=".", ms=4,
                        color=LINKS[1], zorder=3, markevery=max(1, len(exact) // 60))  # fmt: skip
        if values.min() > 0 and values.max() > 20 * values.min():
            panel.axes.set_yscale("log")
        panel.named("y", f"curve_{name}", text)
    for fold in page["delta_fold"]:
        for panel in (above, below):
            panel.level(fold, "fold", axis="x", color=RED)
        above.axes.annotate(
            f"fold {number(fold)}", (fold, 1), (-3, -10), xycoords=("data", "axes fraction"),
            textcoords="offset points", color=RED, fontsize=7.5, ha="right",
        )  # fmt: skip
    shown = [*page["detuning"], *page["delta_fold"]]
    below.axes.set_xlim(min(shown), max(shown))
    below.label(r"detuning $\Delta$ of the field ($\nu = \sqrt{2} + \varepsilon \Delta$)")
    page.facts(
        eps=r"small parameter $\varepsilon$", averaging_error="error of averaging",
        averaging_error_second="to second order", confirmed="points confirmed",
    )  # fmt: skip
    return page.legend()


def _branches(panel: Panel, values: np.ndarray) -> None:
    """Draw each branch as a line, dashed where it is unstable."""
    detuning, stable, number_of = (panel.page[f"curve_{name}"]
                                   for name in ("detuning", "stable", "branch"))  # fmt: skip
    for branch in np.unique(number_of):
        own = number_of == branch
        for kind, dashes, text in ((1, "-", "average"), (0, DASHES[2], "average, unstable")):
            shown = np.where(stable[own] == kind, values[own], np.nan)
            if not np.isnan(shown).all():
                panel.curve(detuning[own], shown, text, color=LINKS[0], ls=dashes)


def waveform(result: Result) -> Figure:
    """Field, stretch and velocities over one period, with times of rest and backward sliding.

    Dashed: the harmonic field, and the stretch in it.
    """
    page = Page(result, 5.4, 5.8)
    *upper, speeds, modes = page.rows(2, 2, 2, 0.6)
    for panel, name, words in zip(upper, ("field", "stretch"), ("field $G$", "stretch $x_1 - x_0$"),
                                  strict=True):  # fmt: skip
        panel.curve("instant", name, "best", color="black", words=words)
        panel.curve("instant", f"{name}_harmonic", "harmonic", color=GREY, lw=1, ls=DASHES[1])
    for mass, values in enumerate(page["velocity"]):
        speeds.curve("instant", values, f"mass {mass}", color=MASSES[mass], ls=DASHES[mass])
    speeds.named("y", "velocity", "velocity $v_i$")
    speeds.level("speed", "mean velocity", ls=":", lw=1)
    _draw_modes(modes)
    for panel in (*upper, speeds, modes):
        panel.legend()
    page.facts(speed="mean velocity", speed_harmonic="in the harmonic field", gain="gain")
    return page.drawn


def _draw_modes(panel: Panel) -> None:
    """One row per mass, filled while it rests or slides back."""
    sequence, times = np.array(panel.page["mode_sequence"]), panel.page["phase_times"]
    spans = [*pairwise(times)]
    for mode, (does, color) in _DOES.items():
        for mass, modes in enumerate(sequence.T):
            own = [span for span, m in zip(spans, modes, strict=True) if m == mode]
            panel.bars(mass, own, color, 0.4)
        if np.any(sequence == mode):
            panel.entries.append(patch(does, color))
    panel.ranks(sequence.shape[1], "mass $i$")
    panel.axes.grid(visible=False)
    panel.named("x", "instant")
