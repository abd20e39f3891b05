"""Picture of a proof: how the bound on all gaits came down to the gait that is best."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from wormopt.plotting.parts import (
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    narrow,
    needed,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result


def certificate(result: Result) -> Figure:
    """Proven bound over time with the gait's own value; right, the boxes over two durations.

    Needs ``proof_time``, ``proof_bound``, ``proof_value``; for sequences of three phases
    also ``leaf_shortest``, ``leaf_longest``, ``leaf_bound``.
    """
    leaves = "leaf_bound" in result
    drawn = sheet(7.1, 3.2, 5.8 if leaves else 3.0)
    parts = (1 + leaves, 1) if narrow() else (1, 1 + leaves)
    axes = drawn.subplots(*parts, squeeze=False).ravel()
    _draw_bound(axes[0], result)
    if leaves:
        _draw_leaves(axes[1], drawn, result)
    tell(
        drawn,
        fact(result, "speed", "mean speed"),
        fact(result, "bound", "proven bound"),
        fact(result, "gap_certified", "gap"),
        fact(result, "boxes_explored"),
    )
    legend_below(drawn)
    return drawn


def _draw_bound(axes: Axes, result: Result) -> None:
    time, bound, value = (result[f"proof_{name}"] for name in ("time", "bound", "value"))
    phases = scalar(result, "certified_phases")
    axes.step(time.values, bound.values, where="post", color=LINKS[0],
              label=f"proven bound, at most {phases} phases a cycle")  # fmt: skip
    axes.plot(time.values, value.values, color="black", linestyle=(0, (4, 2)),
              label="the gait")  # fmt: skip
    axes.fill_between(time.values, value.values, bound.values, step="post", color=LINKS[0],
                      alpha=0.12, linewidth=0)  # fmt: skip
    axes.set_xlabel(label("time spent $t$", time.unit))
    axes.set_ylabel(label("objective and its bound", bound.unit))


def _draw_leaves(axes: Axes, drawn: Figure, result: Result) -> None:
    """Boxes over the first two durations, coloured by how far below the best they are."""
    low, high = result["leaf_shortest"], result["leaf_longest"]
    bound = result["leaf_bound"].values
    shortest, longest = needed(result, "leaf_period")
    parts = [
        _part(a, b, shortest - b[2], longest - a[2])
        for a, b in zip(low.values, high.values, strict=True)
    ]
    there = np.array([len(part) > 2 for part in parts])
    drawing = PatchCollection(
        [Polygon(part) for part in parts if len(part) > 2],
        cmap="viridis", edgecolor="white", linewidth=0.4,
    )  # fmt: skip
    drawing.set_array(bound[there])
    axes.add_collection(drawing)
    name = label("bound on the speed in a box", result["leaf_bound"].unit)
    drawn.colorbar(drawing, ax=axes, label=name)
    own = scalar(result, "leaf_durations")
    if own:
        star = {"color": RED, "markersize": 11, "markeredgecolor": "white"}
        axes.plot(*own[:2], "*", label="durations of the gait", **star)
    axes.set_xlim(0.0, longest)
    axes.set_ylim(0.0, longest)
    axes.grid(visible=False)
    masses = [", ".join(map(str, resting)) for resting in needed(result, "leaf_sequence")]
    axes.set_xlabel(label(f"how long {_rest(masses[0])}, $h_0$", low.unit))
    axes.set_ylabel(label(f"how long {_rest(masses[1])}, $h_1$", low.unit))
    axes.set_title(f"boxes of the sequence {' – '.join(masses)}")


def _part(low: np.ndarray, high: np.ndarray, least: float, most: float) -> list[np.ndarray]:
    """Corners of what a box leaves to h_0 and h_1 where least <= h_0 + h_1 <= most."""
    (x, y), (X, Y) = low[:2], high[:2]
    corners = [np.array(corner) for corner in ((x, y), (X, y), (X, Y), (x, Y))]
    for sign, side in ((1.0, most), (-1.0, -least)):
        kept = []
        for a, b in zip(corners, np.roll(corners, -1, axis=0) if corners else [], strict=True):
            inside_a, inside_b = side - sign * a.sum(), side - sign * b.sum()
            if inside_a >= 0:
                kept.append(a)
            if inside_a * inside_b < 0:
                kept.append(a + (b - a) * inside_a / (inside_a - inside_b))
        corners = kept
    return corners


def _rest(masses: str) -> str:
    return f"masses {masses} rest" if "," in masses else f"mass {masses} rests"
