"""Pictures of optimal motions: how relaxed contact converges to the exact one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plot.parts import GREY, facts, scalar, sheet
from wormopt.result import Result

__all__ = ["convergence"]


def convergence(result: Result) -> Figure:
    """Errors of relaxed contact against the width of the law and the number of arcs.

    Parameters
    ----------
    result : Result
        Of kind ``optimal-crawl`` with ``want`` "convergence".

    Returns
    -------
    Figure
        Both axes logarithmic; the dotted lines have the slope of order 1, the bars at the last
        points are the error bars stated without knowing the exact answer.
    """
    drawn = sheet(9, 4)
    left, right = drawn.subplots(1, 2, sharey=True)
    _draw(left, result, "width", "smoothed", 1)
    left.set_xlabel("width $v_{reg}$ of the smoothed law")
    left.invert_xaxis()
    _draw(right, result, "arcs", "complementarity", -1)
    right.set_xlabel("arcs of the grid, complementarity")
    left.set_ylabel("error of the objective")
    left.set_title(facts(result, "order_smoothed"), loc="left")
    right.set_title(facts(result, "order_complementarity"), loc="left")
    return drawn


def _draw(axes: Axes, result: Result, over: str, what: str, slope: int) -> None:
    x, error = result[over].values, np.abs(result[f"{what}_error"].values)
    bar = scalar(result, f"objective_{what}_error_bar")
    axes.loglog(x, error, color="black", marker="o", markersize=4)
    axes.loglog(x, error[-1] * (x / x[-1]) ** slope, color=GREY, linestyle=":")
    axes.errorbar(x[-1], error[-1], [[0.0], [max(bar - error[-1], 0.0)]], color="black", capsize=3)
    axes.grid(visible=True, color="#E6E6E6", linewidth=0.6)
    if over == "arcs":
        axes.set_xticks(x, [f"{n:g}" for n in x], minor=False)
        axes.minorticks_off()
