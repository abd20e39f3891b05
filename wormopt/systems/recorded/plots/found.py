"""Pictures of estimates: their intervals and the correlation of their errors."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    MASSES,
    legend_below,
    line,
    narrow,
    number,
    raised,
    sheet,
)
from wormopt.result import Result

_BESIDE = 0.55  # share of the sheet's width for the bars; numbers are beside them


def parameters(result: Result) -> Figure:
    """Draw every estimate with its relative interval, and its value in its own unit."""
    names, units = result.attributes["unknowns"], result.attributes["unknown_units"]
    value, error = result["estimate"].values, result["standard_error"].values
    ends = result["interval"].values
    count = len(names)
    height = 0.9 + 0.28 * count
    drawn = sheet(7.1, height, height + 0.3)
    axes = drawn.subplots()
    scale = np.where(value != 0, np.abs(value), 1.0) / 100
    low, high = ((ends[:, side] - value) / scale for side in (0, 1))
    reach = 1.15 * max(
        float(np.max(np.abs([low, high]), initial=0.0, where=np.isfinite([low, high]))), 1e-9
    )
    for k in range(count):
        known = np.isfinite([low[k], high[k]]).all()
        axes.plot(
            np.clip([low[k], high[k]], -reach, reach), [k, k], color=MASSES[0],
            linestyle="-" if known else LIMIT, marker="|" if known else "",
        )  # fmt: skip
        told = f"{number(value[k], _digits(value[k], error[k]))} ± {number(error[k], 2)}"
        told = told if np.isfinite(error[k]) else f"{number(value[k])}, not identifiable"
        unit = raised(units[k])
        axes.annotate(f"{told} {unit}", (1.01, k), xycoords=("axes fraction", "data"), va="center")
    axes.plot(np.zeros(count), range(count), "o", color=MASSES[0], markersize=4)
    axes.axvline(0.0, color=GREY, linewidth=0.6)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(count - 0.5, -0.5)
    axes.set_ylabel("parameter $p$")
    axes.set_yticks(range(count), names, parse_math=False)
    axes.set_xlabel(r"difference from the estimate, $(p - \hat p)/\hat p$ (%)")
    legend_below(
        drawn,
        [line("estimate", MASSES[0], "", marker="o"), line("interval", MASSES[0], marker="|")],
    )
    return drawn


def _digits(value: float, error: float) -> int:
    """Number of significant digits such that two digits of the error show."""
    if not (np.isfinite(error) and error > 0 and value != 0):
        return 4
    return int(np.clip(np.ceil(np.log10(abs(value) / error)) + 2, 2, 8))


def correlation(result: Result) -> Figure:
    """Draw the correlation of the errors of all pairs of parameters."""
    names, values = result.attributes["unknowns"], result["correlation"].values
    count = len(names)
    drawn = sheet(7.1, 1.2 + 0.42 * count, 1.4 + 0.3 * count)
    axes = drawn.subplots()
    shown = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    for i in range(count if count <= (4 if narrow() else 16) else 0):
        for j in range(count):
            dark = abs(values[i, j]) > 0.6
            told = f"{values[i, j]:.2f}".replace("-", "−")
            axes.text(
                j, i, told, ha="center", va="center", size=7, color="white" if dark else "black"
            )
    axes.set_xticks(range(count), names, rotation=90, parse_math=False)
    axes.set_yticks(range(count), names, parse_math=False)
    axes.set_xlabel("parameter $p_j$ (its error)")
    axes.set_ylabel("parameter $p_i$")
    axes.grid(visible=False)
    drawn.colorbar(shown, ax=axes, label="correlation of errors", fraction=0.05)
    return drawn
