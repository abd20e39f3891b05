"""Pictures of certificates: a bound over time, and what was ruled out with which durations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from wormopt.plotting.parts import GREY, LINKS, RED, facts, label, scalar, sheet
from wormopt.result import Result


def certificate(result: Result) -> Figure:
    """Proven bound over time with the gait's own value; right, the boxes over two durations.

    Needs ``proof_time``, ``proof_bound``, ``proof_value``; for sequences of three phases
    also ``leaf_shortest``, ``leaf_longest``, ``leaf_bound``.
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
    phases = scalar(result, "certified_phases")
    axes.step(time.values, bound.values, where="post", color=LINKS[0], linewidth=1.8,
              label=f"no gait of at most {phases} phases is better")  # fmt: skip
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
    shortest, longest = scalar(result, "leaf_period")
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
        star = {"color": RED, "markersize": 13, "markeredgecolor": "white"}
        axes.plot(*own[:2], "*", label="durations of the gait", **star)
    axes.set_xlim(0.0, longest)
    axes.set_ylim(0.0, longest)
    axes.grid(visible=False)
    masses = [", ".join(map(str, resting)) for resting in scalar(result, "leaf_sequence")]
    axes.set_xlabel(label(f"how long {_rest(masses[0])}, $h_1$", low.unit))
    axes.set_ylabel(label(f"how long {_rest(masses[1])}, $h_2$", low.unit))
    axes.set_title(f"boxes of the sequence {' – '.join(masses)}", loc="left", color=GREY)


def _part(low: np.ndarray, high: np.ndarray, least: float, most: float) -> list[np.ndarray]:
    """Corners of what a box leaves to h_1 and h_2 where least <= h_1 + h_2 <= most."""
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
