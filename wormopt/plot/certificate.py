"""Pictures of certificates: a bound over time, and what was ruled out with which durations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wormopt.plot.parts import GREY, LINKS, RED, facts, label, scalar, sheet
from wormopt.result import Result

__all__ = ["certificate"]


def certificate(result: Result) -> Figure:
    """Proven bound over time beside the gait's own value, and the boxes of durations behind it.

    Parameters
    ----------
    result : Result
        With the variables ``proof_time``, ``proof_bound`` and ``proof_value``; where a sequence
        of three phases was looked at also ``leaf_shortest``, ``leaf_longest``, ``leaf_bound``.

    Returns
    -------
    Figure
        Left the bound, right the boxes over two durations.
    """
    leaves = "leaf_bound" in {variable.name for variable in result.variables}
    drawn = sheet(11 if leaves else 6.5, 4.8)
    axes = drawn.subplots(1, 2 if leaves else 1, squeeze=False)[0]
    _draw_bound(axes[0], result)
    if leaves:
        _draw_leaves(axes[1], drawn, result)
    drawn.legend(loc="outside lower center", ncols=3)
    return drawn


def _draw_bound(axes: Axes, result: Result) -> None:
    time, bound, value = (result[f"proof_{name}"] for name in ("time", "bound", "value"))
    axes.step(time.values, bound.values, where="post", color=LINKS[0], linewidth=1.8,
              label="no gait is better than this")  # fmt: skip
    axes.plot(time.values, value.values, color=LINKS[1], linewidth=1.8, label="the gait")
    axes.fill_between(time.values, value.values, bound.values, step="post", color=LINKS[0],
                      alpha=0.12, linewidth=0)  # fmt: skip
    axes.set_xlabel(label("time spent $t$", time.unit))
    axes.set_ylabel(label("objective and its bound", bound.unit))
    axes.set_title(facts(result, "gap_certified", "certified_phases"), loc="left")


def _draw_leaves(axes: Axes, drawn: Figure, result: Result) -> None:
    """Boxes over the first two durations, coloured by how far below the best they are."""
    low, high = result["leaf_shortest"], result["leaf_longest"]
    bound = result["leaf_bound"].values
    order = np.argsort(bound)
    corners, sizes = low.values[order, :2], (high.values - low.values)[order, :2]
    boxes = [Rectangle((x, y), *size) for (x, y), size in zip(corners, sizes, strict=True)]
    drawing = PatchCollection(boxes, cmap="viridis", edgecolor="white", linewidth=0.4)
    drawing.set_array(bound[order])
    axes.add_collection(drawing)
    drawn.colorbar(drawing, ax=axes, label=label("bound on the speed in the box", result["leaf_bound"].unit))
    own = scalar(result, "gait_durations")
    if own:
        axes.plot(*own[:2], "*", color=RED, markersize=11, markeredgecolor="white", label="the gait's durations")
    axes.set_xlim(0.0, float(high.values[:, 0].max()))
    axes.set_ylim(0.0, float(high.values[:, 1].max()))
    axes.grid(visible=False)
    masses = low.text.removeprefix("shortest durations of the phases in which these masses rest: ")
    first, second, *_ = masses.split("; ")
    axes.set_xlabel(label(f"duration of rest of mass {first} $h_1$", low.unit))
    axes.set_ylabel(label(f"duration of rest of mass {second} $h_2$", low.unit))
    axes.set_title(f"boxes of the sequence {masses}", loc="left", color=GREY)
