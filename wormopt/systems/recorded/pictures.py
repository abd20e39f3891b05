"""Pictures of fits, planned experiments, and gaits for fitted worms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from wormopt.errors import UnknownNameError
from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    ceilings,
    draw_limits,
    fact,
    few_decades,
    handles,
    label,
    legend,
    legend_above,
    legend_below,
    line,
    narrow,
    needed,
    number,
    raised,
    scalar,
    shades,
    sheet,
    tell,
)
from wormopt.result import Result

_BESIDE = 0.55  # share of the sheet's width for the bars; numbers are beside them
_ABREAST, _PER_ROW = 3, 3  # runs and profiles side by side
_MOST_SIGMA = 6.0  # larger residuals are drawn at the edge
_BEST, _RANDOM = LINKS[0], GREY
_PAIRS = 6  # largest number of pairs whose regions are drawn
_SURE = 2.4477  # radius in standard deviations of a plane region with 95 % confidence
_MOST = 2000  # number of readings that are drawn, the first ones

# -- estimates -------------------------------------------------------------------------------------


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
        text = f"{number(value[k], _digits(value[k], error[k]))} ± {number(error[k], 2)}"
        text = text if np.isfinite(error[k]) else f"{number(value[k])}, not identifiable"
        unit = raised(units[k])
        axes.annotate(f"{text} {unit}", (1.01, k), xycoords=("axes fraction", "data"), va="center")
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
            text = f"{values[i, j]:.2f}".replace("-", "−")
            axes.text(
                j, i, text, ha="center", va="center", size=7, color="white" if dark else "black"
            )
    axes.set_xticks(range(count), names, rotation=90, parse_math=False)
    axes.set_yticks(range(count), names, parse_math=False)
    axes.set_xlabel("parameter $p_j$ (its error)")
    axes.set_ylabel("parameter $p_i$")
    axes.grid(visible=False)
    drawn.colorbar(shown, ax=axes, label="correlation of errors", fraction=0.05)
    return drawn


# -- fits of recordings ----------------------------------------------------------------------------


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
    text = "prediction with its 95 % band" if ahead else "fit"
    entries = [line("reading", GREY, "", marker="."), line(text, GREY)]
    entries += [line(f"entry {k}", colour) for k, colour in enumerate(colours)] if most > 1 else []
    legend_below(drawn, entries)
    drawn.align_ylabels()
    return drawn


def _signals(result: Result, runs: Sequence[int]) -> list[str]:
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


# -- fits of single numbers ------------------------------------------------------------------------


def measurements(result: Result) -> Figure:
    """Draw measurements with two standard deviations, and computed values before and after."""
    names, uses = result.attributes["measurements"], np.array(result.attributes["uses"])
    key = result.attributes["changed_key"]
    drawn = sheet(7.1, 3.6, 4.2)
    axes = drawn.subplots()
    x = result["changed"].values if key else np.arange(len(names))
    measured, deviation = result["measured"].values, result["deviation"].values
    for use, marker in (("fit", "o"), ("predict", "s")):
        own = uses == use
        axes.errorbar(
            x[own], measured[own], 2 * deviation[own], fmt=marker, color=MASSES[0], capsize=3,
            markersize=5, fillstyle="full" if use == "fit" else "none",
        )  # fmt: skip
    axes.plot(x, result["at_start"].values, "x", color=GREY, markersize=6)
    axes.plot(x, result["fitted"].values, "D", color=RED, markersize=5, fillstyle="none")
    if key:
        axes.set_xlabel(f"key $q$ ({key})".replace("_", " "))
        if x.min() > 0 and x.max() > 8 * x.min():
            axes.set_xscale("log")
            if not narrow():
                few_decades(axes.xaxis)
    else:
        axes.set_xticks(x, names, rotation=20, ha="right", parse_math=False)
    axes.set_ylabel(_of(result))
    entries = [line("measured, ± 2 standard deviations", MASSES[0], "", marker="o")]
    if "predict" in uses:
        entries.append(line("held out", MASSES[0], "", marker="s"))
    entries += [line("computed at the start", GREY, "", marker="x")]
    entries += [line("computed with the estimates", RED, "", marker="D")]
    for entry in entries[1:]:
        entry.set_fillstyle("none")
    legend_below(drawn, entries)
    tell(drawn, fact(result, "n_measurements", "measurements"), fact(result, "n_runs", "runs"))
    return drawn


def _of(result: Result) -> str:
    """Name and unit of the measured scalar, if there is only one."""
    names, units = (set(result.attributes[key]) for key in ("scalars", "scalar_units"))
    if len(names) > 1:
        return "measured numbers"
    unit = units.pop()
    return names.pop().replace("_", " ") + (f" ({raised(unit)})" if unit != "1" else "")


# -- planned experiments ---------------------------------------------------------------------------


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
    labels = [name if name in wanted else f"{name} (not wanted)" for name in names]
    axes.set_yticks(range(len(names)), labels, parse_math=False)
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
    labels = [f"$p$: {names[k]} ({units[k] or 1})".replace("_", " ") for k in pair]
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.locator_params(nbins=3)


def _moves(result: Result, name: str) -> bool:
    return bool(np.ptp(result[name].values, axis=1).any())


def _limits(result: Result, name: str) -> list[float]:
    """Limits of a signal along the motion, from the scene."""
    limits = result.attributes.get("limits", {}).get(name, ())
    return [edge for edge in limits if isinstance(edge, float)]


# -- gaits for fitted worms ------------------------------------------------------------------------


def forces(result: Result) -> Figure:
    """Draw recorded actuator forces, their fit and the residuals of the first run.

    Needs ``reading_time``, ``reading_run``, ``read_force`` and ``fitted_force``.
    """
    first = np.flatnonzero(result["reading_run"].values == result["reading_run"].values[0])[:_MOST]
    time, read = result["reading_time"].values[first], result["read_force"].values[:, first]
    fitted = result["fitted_force"].values[:, first]
    drawn = sheet(7.1, 4.4, 4.4)
    above, below = drawn.subplots(2, sharex=True, height_ratios=(2, 1))
    for j, colour in enumerate(shades(LINKS, len(read))):
        above.plot(time, read[j], ".", color=colour, markersize=1.5, alpha=0.6)
        above.plot(time, fitted[j], color="black", linewidth=0.7, zorder=3)
        below.plot(time, read[j] - fitted[j], ".", color=colour, markersize=1.5, alpha=0.6)
    below.axhline(0.0, color="black", linewidth=0.7)
    unit = result["read_force"].unit
    above.set_ylabel(label("actuator force $\\mu_j$", unit))
    below.set_ylabel(label("reading − fit", unit))
    below.set_xlabel(label("time $t$", result["reading_time"].unit))
    legend(above, [*handles("link", len(read)), line("fit", "black", width=0.7)])
    tell(
        drawn,
        fact(result, "load_found"),
        fact(result, "load_error", "standard error"),
        fact(result, "drag_found"),
    )
    drawn.align_ylabels()
    return drawn


def loads(result: Result) -> Figure:
    """Draw the load of a resting spike over a cycle: estimated, worst case, and on the plant.

    Needs ``band_time``, ``band_load``, ``band_error``. With a plant, it also needs ``plant_time``
    and the like, and shows the gait that assumes exact estimates.
    """
    limit = scalar(result, "spike_load_limit")
    alike = [limit] if isinstance(limit, float) else []
    tall = 1.9 * len(alike)
    drawn = sheet(7.1, 3.6 + tall, 4.0 + tall)
    rows = 1 + len(alike)
    panels = drawn.subplots(rows, sharex=True, squeeze=False, height_ratios=(2, 1)[:rows])
    entries: list[Artist] = []
    for axes in panels[:, 0]:
        entries = _draw_loads(axes, result)
        entries += draw_limits(axes, ceilings(limit, 1)[:1], [GREY])
        axes.set_ylabel(label("load of a\nresting spike", result["band_load"].unit))
        axes.margins(x=0)
    panels[0, 0].set_ylim(bottom=0.0)
    for most in alike:
        room = float(result["band_error"].values.max())
        panels[1, 0].set_ylim(most - 4 * room, most + room)
        panels[1, 0].set_ylabel(label("load near\nthe limit", result["band_load"].unit))
    panels[-1, 0].set_xlabel(label("time $t$ in a cycle", result["band_time"].unit))
    drawn.align_ylabels()
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "plant_share", "speed over that of the gait designed with true parameters"),
        fact(result, "plant_spike_load_max", "largest load on the plant"),
    )
    return drawn


def _draw_loads(axes: Axes, result: Result) -> list[Artist]:
    """Draw band and curves; returns their legend entries."""
    time, load = result["band_time"].values, result["band_load"].values
    error, colour = result["band_error"].values, LINKS[0]
    axes.fill_between(time, load - error, load + error, color=colour, alpha=0.25, linewidth=0)
    axes.plot(time, load, color=colour)
    entries: list[Artist] = [
        line("with the estimates", colour),
        Patch(color=colour, alpha=0.25, label="for all parameters in the ellipsoid"),
    ]
    if "plant_share" in result.scalars:
        plant, bold = (
            [result[f"{name}_{what}"].values for what in ("time", "load")]
            for name in ("plant", "bold")
        )
        axes.plot(*plant, color="black", linestyle=DASHES[1], linewidth=1)
        axes.plot(*bold, color=RED, linewidth=0.8)
        entries += [
            line("on the plant", "black", DASHES[1], 1),
            line("on the plant, gait that assumes exact estimates", RED, width=0.8),
        ]
    return entries
