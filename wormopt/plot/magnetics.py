"""Pictures of magnetic materials."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plot.parts import GLIDE, GREY, LINKS, facts, label, scalar, sheet
from wormopt.result import Result

__all__ = ["stress_strain"]


def stress_strain(result: Result) -> Figure:
    """Stress against strain, with the field and without: the chapter's figure 12.

    Parameters
    ----------
    result : Result
        Of kind ``material``.

    Returns
    -------
    Figure
        Strain in per cent; shaded where strains are no longer small.
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
