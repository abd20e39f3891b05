"""Pictures of fits: recordings with their fit, profiles, and predictions of held-out runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wormopt.errors import UnknownNameError
from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    MASSES,
    fact,
    label,
    legend_below,
    line,
    narrow,
    needed,
    raised,
    shades,
    sheet,
    tell,
)
from wormopt.result import Result

_ABREAST, _PER_ROW = 3, 3  # runs and profiles side by side
_MOST_SIGMA = 6.0  # larger residuals are drawn at the edge


def recordings(result: Result) -> Figure:
    """Draw readings and fit of every fitted run, and residuals over the noise below."""
    drawn = _panels(result, [k for k, use in enumerate(result.attributes["uses"]) if use == "fit"])
    tell(
        drawn,
        fact(result, "n_readings", "readings"),
        fact(result, "n_unknowns", "unknowns"),
        fact(result, "chi2_per_reading", "χ² per reading"),
    )
    return drawn


def prediction(result: Result) -> Figure:
    """Draw held-out runs with their prediction and its band."""
    aside = [k for k, use in enumerate(result.attributes["uses"]) if use == "predict"]
    if not aside:
        raise UnknownNameError("the result", "held-out run", ["predict"], [])
    drawn = _panels(result, aside, ahead=True)
    tell(
        drawn,
        fact(result, "prediction_coverage", "in the band", "%"),
        fact(result, "prediction_chi2", "χ² over its expectation"),
    )
    return drawn


def _panels(result: Result, runs: Sequence[int], *, ahead: bool = False) -> Figure:
    shown, signals = list(runs)[:_ABREAST], _signals(result, runs)
    height = 0.6 + 2.5 * len(signals)
    drawn = sheet(7.1, height, height + 0.9)
    rows = drawn.subplots(
        2 * len(signals), len(shown), sharex="col", squeeze=False,
        height_ratios=[2.2, 1.0] * len(signals),
    )  # fmt: skip
    most = max(result[f"recorded_{name}"].values.shape[1] for name in signals)
    colours = shades(MASSES, most)
    for row, name in enumerate(signals):
        for column, run in enumerate(shown):
            upper, lower = rows[2 * row : 2 * row + 2, column]
            _draw_signal(upper, lower, result, name, run, colours)
            if column == 0:
                words = name.replace("_", " ")
                upper.set_ylabel(label(words, result[f"recorded_{name}"].unit))
                lower.set_ylabel("residual\nover band" if ahead else "residual\nover noise")
    for column, run in enumerate(shown):
        rows[0, column].set_title(result.attributes["runs"][run], parse_math=False)
        rows[-1, column].set_xlabel(label("time $t$", result["recorded_time"].unit))
    told = "prediction with its 95 % band" if ahead else "fit"
    entries = [line("reading", GREY, "", marker="."), line(told, GREY)]
    entries += [line(f"entry {k}", colour) for k, colour in enumerate(colours)] if most > 1 else []
    legend_below(drawn, entries)
    drawn.align_ylabels()
    return drawn


def _signals(result: Result, runs: Sequence[int]) -> list[str]:
    """Signals recorded in these runs."""
    return [
        name
        for name in result.attributes["signals"]
        if np.isfinite(result[f"recorded_{name}"].values[list(runs)]).any()
    ]


def _draw_signal(
    upper: Axes, lower: Axes, result: Result, name: str, run: int, colours: Sequence[str]
) -> None:
    time = result["recorded_time"].values[run]
    read, fitted, left = (
        result[f"{what}_{name}"].values[run] for what in ("recorded", "fitted", "residual")
    )
    for k, colour in enumerate(colours[: len(read)]):
        upper.plot(time, read[k], ".", color=colour, markersize=2.5, alpha=0.5)
        upper.plot(time, fitted[k], color=colour, linewidth=1.0)
        if f"band_{name}" in result:
            band = 1.96 * result[f"band_{name}"].values[run, k]
            upper.fill_between(
                time, fitted[k] - band, fitted[k] + band, color=colour, alpha=0.25, linewidth=0
            )
        inside = np.clip(left[k], -_MOST_SIGMA, _MOST_SIGMA)
        lower.plot(time, inside, ".", color=colour, markersize=2)
    for level in (-2.0, 2.0):
        lower.axhline(level, color=GREY, linestyle=LIMIT, linewidth=0.8)
    upper.margins(x=0)


def profiles(result: Result) -> Figure:
    """Draw the rise of the cost as each parameter is held at other values."""
    names, units = result.attributes["unknowns"], result.attributes["unknown_units"]
    values, rises = result["profile_value"].values, result["profile_rise"].values
    threshold: Any = needed(result, "profile_threshold")
    abreast = min(len(names), 2 if narrow() else _PER_ROW)
    rows = -(-len(names) // abreast)
    height = 0.5 + 1.7 * rows
    drawn = sheet(7.1, height, height + 0.6)
    panels = drawn.subplots(rows, abreast, squeeze=False, sharey=True)
    for k, axes in enumerate(panels.flat):
        if k >= len(names):
            axes.set_visible(False)
            continue
        axes.plot(values[k], rises[k], color=MASSES[0], marker=".", markersize=4)
        error, best = result["standard_error"].values[k], result["estimate"].values[k]
        if np.isfinite(error) and error > 0:
            fine = np.linspace(np.nanmin(values[k]), np.nanmax(values[k]), 101)
            axes.plot(fine, ((fine - best) / error) ** 2, color=GREY, linestyle=LIMIT, linewidth=1)
        axes.axhline(threshold, color=GREY, linestyle=":", linewidth=1)
        axes.set_ylim(0.0, 1.6 * threshold)
        axes.xaxis.set_major_locator(MaxNLocator(2 if narrow() else 3))
        unit = raised(units[k])
        axes.set_xlabel(f"$p$: {names[k]} ({unit or 1})".replace("_", " "))
    for axes in panels[:, 0]:
        axes.set_ylabel("rise of $\\chi^2$")
    legend_below(
        drawn,
        [
            line("profile", MASSES[0], marker="."),
            line("from the curvature at the best fit", GREY, LIMIT, 1),
            line("threshold", GREY, ":", 1),
        ],
    )
    return drawn
