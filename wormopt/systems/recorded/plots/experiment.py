"""Pictures of planned experiments: inputs, expected errors and confidence regions."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    MASSES,
    fact,
    label,
    legend_above,
    legend_below,
    line,
    narrow,
    sheet,
    tell,
)
from wormopt.result import Result

_BEST, _RANDOM = LINKS[0], GREY
_PAIRS = 6  # largest number of pairs whose regions are drawn
_SURE = 2.4477  # radius in standard deviations of a plane region with 95 % confidence


def course(result: Result) -> Figure:
    """Draw the chosen inputs, and the limited and measured signals of the motion."""
    moved = [name for name in result.attributes["courses"] if _moves(result, f"course_{name}")]
    shown = [f"course_{name}" for name in moved]
    shown += [name for name in result.attributes["limits"] if name not in shown]
    shown += [name for name in ("position",) if name in result and name not in shown]
    drawn = sheet(7.1, 1.0 + 1.5 * len(shown), 1.0 + 1.7 * len(shown))
    rows = np.atleast_1d(drawn.subplots(len(shown), sharex=True))
    time = result["time"]
    for axes, name in zip(rows, shown, strict=True):
        values = result[name].values
        colours = MASSES if name == "position" else LINKS
        for k, row in enumerate(values):
            axes.plot(
                time.values,
                row,
                color=colours[k],
                linestyle=DASHES[k % len(DASHES)],
                label=f"[{k}]",
            )
        words = name.removeprefix("course_").replace("_", " ")
        words = f"{words}, chosen" if name.startswith("course_") else words
        axes.set_ylabel(label(words, result[name].unit))
        for edge in _limits(result, name):
            axes.axhline(edge, color=GREY, lw=1, linestyle=":")
        if len(values) > 1:
            legend_above(axes, [*axes.get_lines()[: len(values)]])
    rows[-1].set_xlabel(label("time $t$", time.unit))
    rows[0].margins(x=0)
    drawn.align_ylabels()
    tell(
        drawn,
        fact(result, "shrinkage", "confidence region smaller than after the best random run by"),
    )
    return drawn


def errors(result: Result) -> Figure:
    """Draw expected relative standard errors: before, after the planned run and random ones."""
    names = result.attributes["unknowns"]
    size = np.where(result["value"].values != 0, np.abs(result["value"].values), 1.0) / 100
    drawn = sheet(7.1, 1.3 + 0.42 * len(names))
    axes = drawn.subplots()
    rivals = result["rival_error"].values / size
    before, after = (result[name].values / size for name in ("error_before", "error"))
    for k in range(len(names)):
        axes.plot(rivals[:, k], np.full(len(rivals), k), "|", color=_RANDOM, markersize=9)
        axes.plot(rivals[0, k], k, "s", color=_RANDOM, markersize=5)
        if np.isfinite(before[k]):
            axes.plot(before[k], k, "o", color="black", markerfacecolor="white", markersize=6)
        axes.plot(after[k], k, "o", color=_BEST, markersize=6)
    axes.set_xscale("log")
    wanted = result.attributes["wanted"]
    told = [name if name in wanted else f"{name} (not wanted)" for name in names]
    axes.set_yticks(range(len(names)), told, parse_math=False)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_ylabel("parameter $p$")
    axes.set_xlabel(r"standard error $\sigma_p/|\hat p|$ (%)")
    entries = [
        line("after the planned run", _BEST, "", marker="o"),
        line("after the best random run", _RANDOM, "", marker="s"),
        line("after random runs", _RANDOM, "", marker="|"),
    ]
    if np.isfinite(before).any():
        entries.append(line("known before", "black", "", marker="o"))
        entries[-1].set_markerfacecolor("white")
    legend_below(drawn, entries)
    return drawn


def regions(result: Result) -> Figure:
    """Draw 95 % confidence regions of pairs of wanted parameters."""
    names, wanted = result.attributes["unknowns"], result.attributes["wanted"]
    pairs = [*combinations([names.index(name) for name in wanted], 2)][:_PAIRS]
    if not pairs:
        return errors(result)
    across = min(1 if narrow() else 3, len(pairs))
    down = -(-len(pairs) // across)
    drawn = sheet(max(2.6 * across, 4.0) + 0.3, 2.6 * down + 0.7)
    for axes, pair in zip(
        np.ravel(drawn.subplots(down, across, squeeze=False)), pairs, strict=False
    ):
        _draw_regions(axes, result, pair)
    for axes in drawn.axes[len(pairs) :]:
        axes.set_axis_off()
    legend_below(
        drawn,
        [line("after the planned run", _BEST), line("after the best random run", _RANDOM, "--")],
    )
    return drawn


def _draw_regions(axes: Axes, result: Result, pair: tuple[int, int]) -> None:
    turn = np.linspace(0.0, 2 * np.pi, 181)
    circle = _SURE * np.array([np.cos(turn), np.sin(turn)])
    names, units = result.attributes["unknowns"], result.attributes["unknown_units"]
    value = result["value"].values[list(pair)]
    for name, colour, dashes in (
        ("covariance_random", _RANDOM, "--"),
        ("covariance", _BEST, "-"),
    ):
        inner = result[name].values[np.ix_(pair, pair)]
        if np.isfinite(inner).all():
            ring = value[:, None] + np.linalg.cholesky(inner) @ circle
            axes.plot(*ring, color=colour, linestyle=dashes)
    axes.plot(*value, "+", color="black", markersize=5)
    told = [f"$p$: {names[k]} ({units[k] or 1})".replace("_", " ") for k in pair]
    axes.set_xlabel(told[0])
    axes.set_ylabel(told[1])
    axes.locator_params(nbins=3)


def _moves(result: Result, name: str) -> bool:
    return bool(np.ptp(result[name].values, axis=1).any())


def _limits(result: Result, name: str) -> list[float]:
    """Limits of a signal along the motion, from the scene."""
    limits = result.attributes.get("limits", {}).get(name, ())
    return [edge for edge in limits if isinstance(edge, float)]
