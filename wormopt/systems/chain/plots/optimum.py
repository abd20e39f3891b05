"""Pictures of optimal motions: signals over ``instant``, and convergence of relaxed contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    fact,
    few_decades,
    label,
    legend_below,
    narrow,
    needed,
    sheet,
    tell,
)
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.systems.chain.plots import simulation


def signals(result: Result) -> Figure:
    """Signals of an optimal motion over time, one below the other, with the phase changes."""
    drawn = simulation.signals(over_time(result))
    tell(drawn, fact(result, "speed", "mean speed"), fact(result, "time"),
         fact(result, "n_phases", "phases"))  # fmt: skip
    return drawn


def over_time(result: Result) -> Result:
    """Rename the coordinate ``instant`` of an optimal motion to ``time``, as in other pictures.

    The scalar ``time``, the duration of the motion, is left out.
    """

    def called(name: str) -> str:
        return "time" if name == "instant" else name

    def renamed(variable: Variable) -> Variable:
        dims = tuple(map(called, variable.dims))
        return replace(variable, name=called(variable.name), dims=dims)

    others = {name: value for name, value in result.scalars.items() if name != "time"}
    return replace(result, scalars=others, variables=tuple(map(renamed, result.variables)))


def convergence(result: Result) -> Figure:
    """Errors of relaxed contact over width of the law and number of arcs, both logarithmic.

    Dotted lines have the slope of order 1; the bars at the last points are the error estimates made
    without the exact answer.
    """
    drawn = sheet(7.1, 2.9, 2.6)
    left, right = drawn.subplots(1, 2, sharey=True)
    _draw(left, result, "width", "smoothed", 1)
    left.set_xlabel(
        label("width $v_{reg}$" + narrow() * "\n" + " of the smoothed law", result["width"].unit)
    )
    left.invert_xaxis()
    _draw(right, result, "arcs", "complementarity", -1)
    right.set_xlabel("arcs $N$ of the grid" + (narrow() * "\n" or " ") + "(complementarity)")
    left.set_ylabel(label("error of the objective", result["smoothed_error"].unit))
    tell(
        drawn,
        fact(result, "order_smoothed", "order of the smoothed law"),
        fact(result, "order_complementarity", "of complementarity"),
    )
    legend_below(drawn)
    return drawn


def _draw(axes: Axes, result: Result, over: str, what: str, slope: int) -> None:
    x, error = result[over].values, np.abs(result[f"{what}_error"].values)
    bar = needed(result, f"objective_{what}_error_bar")
    axes.loglog(x, error, color="black", marker="o", markersize=4, label="error")
    axes.loglog(x, error[-1] * (x / x[-1]) ** slope, color=GREY, linestyle=":", label="order 1")
    upward = [[0.0], [max(bar - error[-1], 0.0)]]
    axes.errorbar(x[-1], error[-1], upward, color="black", capsize=3, label="estimated error")
    if over == "arcs":
        axes.set_xticks(x, [f"{n:g}" for n in x], minor=False)
        axes.minorticks_off()
    else:
        few_decades(axes.xaxis)
