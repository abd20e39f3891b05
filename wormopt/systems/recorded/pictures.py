"""Pictures of fits, planned experiments, and gaits for fitted worms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wormopt.errors import UnknownNameError
from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    colours,
    few_decades,
    label,
    line,
    narrow,
    number,
    raised,
)
from wormopt.result import Result

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
    count = len(names)
    height = 0.9 + 0.28 * count
    page = Page(result, height, height + 0.3)
    panel, value, error = page.panel(), page["estimate"], page["standard_error"]
    off = (page["interval"] - value[:, None]) / _percent(value)[:, None]
    reach = 1.15 * max(float(np.abs(off[np.isfinite(off)]).max(initial=0.0)), 1e-9)
    for k, ends in enumerate(off):
        known = np.isfinite(ends).all()
        panel.curve(np.clip(ends, -reach, reach), [k, k], color=MASSES[0],
                    ls="-" if known else LIMIT, marker="|" if known else "")  # fmt: skip
        text = f"{number(value[k], _digits(value[k], error[k]))} ± {number(error[k], 2)}"
        text = text if np.isfinite(error[k]) else f"{number(value[k])}, not identifiable"
        panel.axes.annotate(f"{text} {raised(units[k])}", (1.01, k), va="center",
                            xycoords=("axes fraction", "data"))  # fmt: skip
    panel.curve(np.zeros(count), range(count), marker="o", ls="", color=MASSES[0], ms=4)
    panel.level(0.0, axis="x", ls="-", lw=0.6)
    panel.axes.set_xlim(-reach, reach)
    _list(panel, names)
    panel.label(r"difference from the estimate, $(p - \hat p)/\hat p$ (%)")
    return page.legend(line("estimate", MASSES[0], "", marker="o"),
                       line("interval", MASSES[0], marker="|"))  # fmt: skip


def _percent(value: np.ndarray) -> np.ndarray:
    """A hundredth of each number; of 1 where it is 0."""
    return np.where(value != 0, np.abs(value), 1.0) / 100


def _list(panel: Panel, names: Sequence[str]) -> None:
    """Name a row for each parameter."""
    panel.axes.set_ylim(len(names) - 0.5, -0.5)
    panel.axes.set_yticks(range(len(names)), names, parse_math=False)
    panel.label(y="parameter $p$")


def _digits(value: float, error: float) -> int:
    """Number of significant digits such that two digits of the error show."""
    if not (np.isfinite(error) and error > 0 and value != 0):
        return 4
    return int(np.clip(np.ceil(np.log10(abs(value) / error)) + 2, 2, 8))


def correlation(result: Result) -> Figure:
    """Draw the correlation of the errors of all pairs of parameters."""
    names, values = result.attributes["unknowns"], result["correlation"].values
    count = len(names)
    page = Page(result, 1.2 + 0.42 * count, 1.4 + 0.3 * count)
    axes = page.panel().axes
    shown = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    for i, j in np.ndindex(values.shape if count <= (4 if narrow() else 16) else (0, 0)):
        axes.text(j, i, f"{values[i, j]:.2f}".replace("-", "−"), ha="center", va="center", size=7,
                  color="white" if abs(values[i, j]) > 0.6 else "black")  # fmt: skip
    axes.set_xticks(range(count), names, rotation=90, parse_math=False)
    axes.set_yticks(range(count), names, parse_math=False)
    page.panels[0].label("parameter $p_j$ (its error)", "parameter $p_i$")
    axes.grid(visible=False)
    page.drawn.colorbar(shown, ax=axes, label="correlation of errors", fraction=0.05)
    return page.drawn


# -- fits of recordings ----------------------------------------------------------------------------


def recordings(result: Result) -> Figure:
    """Draw readings and fit of every fitted run, and residuals over the noise below."""
    runs = [k for k, use in enumerate(result.attributes["uses"]) if use == "fit"]
    page = _panels(result, runs, "fit", "residual\nover noise")
    page.facts(n_readings="readings", n_unknowns="unknowns", chi2_per_reading="χ² per reading")
    return page.drawn


def prediction(result: Result) -> Figure:
    """Draw held-out runs with their prediction and its band."""
    aside = [k for k, use in enumerate(result.attributes["uses"]) if use == "predict"]
    if not aside:
        raise UnknownNameError("the result", "held-out run", ["predict"], [])
    page = _panels(result, aside, "prediction with its 95 % band", "residual\nover band")
    page.facts(prediction_coverage=("in the band", "%"), prediction_chi2="χ² over its expectation")
    return page.drawn


def _panels(result: Result, runs: Sequence[int], computed: str, below: str) -> Page:
    """A column for each of the first runs: each signal, and its residuals below."""
    shown = list(runs)[:_ABREAST]
    signals = [name for name in result.attributes["signals"]
               if np.isfinite(result[f"recorded_{name}"].values[list(runs)]).any()]  # fmt: skip
    height = 0.6 + 2.5 * len(signals)
    page = Page(result, height, height + 0.9)
    rows = page.grid(2 * len(signals), len(shown), sharex="col",
                     height_ratios=[2.2, 1.0] * len(signals))  # fmt: skip
    most = max(page[f"recorded_{name}"].shape[1] for name in signals)
    for upper, lower, name in zip(rows[::2], rows[1::2], signals, strict=True):
        for column, run in enumerate(shown):
            _draw_signal(upper[column], lower[column], name, run, colours("mass", most))
        upper[0].label(y=name.replace("_", " "), of=f"recorded_{name}")
        lower[0].label(y=below)
    for column, run in enumerate(shown):
        rows[0][column].axes.set_title(result.attributes["runs"][run], parse_math=False)
        rows[-1][column].label("time $t$", of="recorded_time")
    entries = [line("reading", GREY, "", marker="."), line(computed, GREY)]
    entries += [line(f"entry {k}", color) for k, color in enumerate(colours("mass", most))
                if most > 1]  # fmt: skip
    page.legend(*entries)
    return page


def _draw_signal(upper: Panel, lower: Panel, name: str, run: int, own: Sequence[str]) -> None:
    page = upper.page
    time = page["recorded_time"][run]
    read, fitted, left = (
        page[f"{what}_{name}"][run] for what in ("recorded", "fitted", "residual")
    )
    for k, color in enumerate(own[: len(read)]):
        upper.curve(time, read[k], ls="", marker=".", color=color, ms=2.5, alpha=0.5)
        upper.curve(time, fitted[k], color=color, lw=1.0)
        if f"band_{name}" in page:
            band = 1.96 * page[f"band_{name}"][run, k]
            upper.band(time, fitted[k] - band, fitted[k] + band, color=color)
        inside = np.clip(left[k], -_MOST_SIGMA, _MOST_SIGMA)
        lower.curve(time, inside, ls="", marker=".", color=color, ms=2)
    for level in (-2.0, 2.0):
        lower.level(level)
    upper.axes.margins(x=0)


def profiles(result: Result) -> Figure:
    """Draw the rise of the cost as each parameter is held at other values."""
    names, units = result.attributes["unknowns"], result.attributes["unknown_units"]
    abreast = min(len(names), 2 if narrow() else _PER_ROW)
    rows = -(-len(names) // abreast)
    height = 0.5 + 1.7 * rows
    page = Page(result, height, height + 0.6)
    panels = [panel for row in page.grid(rows, abreast, sharey=True) for panel in row]
    values, threshold = page["profile_value"], page["profile_threshold"]
    for k, panel in enumerate(panels):
        if k >= len(names):
            panel.axes.set_visible(False)
            continue
        panel.curve(values[k], page["profile_rise"][k], color=MASSES[0], marker=".", ms=4)
        error, best = page["standard_error"][k], page["estimate"][k]
        if np.isfinite(error) and error > 0:
            fine = np.linspace(np.nanmin(values[k]), np.nanmax(values[k]), 101)
            panel.curve(fine, ((fine - best) / error) ** 2, color=GREY, ls=LIMIT, lw=1)
        panel.level(threshold, ls=":", lw=1)
        panel.axes.set_ylim(0.0, 1.6 * threshold)
        panel.axes.xaxis.set_major_locator(MaxNLocator(2 if narrow() else 3))
        panel.label(f"$p$: {names[k]} ({raised(units[k]) or 1})".replace("_", " "))
    for panel in panels[::abreast]:
        panel.label(y=r"rise of $\chi^2$")
    return page.legend(
        line("profile", MASSES[0], marker="."),
        line("from the curvature at the best fit", GREY, LIMIT, 1),
        line("threshold", GREY, ":", 1),
    )


# -- fits of single numbers ------------------------------------------------------------------------


def measurements(result: Result) -> Figure:
    """Draw measurements with two standard deviations, and computed values before and after."""
    names, uses = result.attributes["measurements"], np.array(result.attributes["uses"])
    key = result.attributes["changed_key"]
    page = Page(result, 3.6, 4.2)
    panel, axes = page.panel(), page.panels[0].axes
    x = page["changed"] if key else np.arange(len(names))
    for use, marker, text in (("fit", "o", "measured, ± 2 standard deviations"),
                              ("predict", "s", "held out")):  # fmt: skip
        own, face = uses == use, None if use == "fit" else "none"
        if own.any():
            axes.errorbar(x[own], page["measured"][own], 2 * page["deviation"][own], fmt=marker,
                          color=MASSES[0], capsize=3, ms=5, mfc=face)  # fmt: skip
            panel.entry(text, MASSES[0], "", marker=marker, mfc=face)
    for name, marker, size, color, text in (
        ("at_start", "x", 6, GREY, "computed at the start"),
        ("fitted", "D", 5, RED, "computed with the estimates"),
    ):
        style = {"marker": marker, "ls": "", "color": color, "mfc": "none"}
        panel.curve(x, page[name], ms=size, **style)
        panel.entry(text, **style)
    if key:
        panel.label(f"key $q$ ({key})".replace("_", " "))
        if x.min() > 0 and x.max() > 8 * x.min():
            axes.set_xscale("log")
            if not narrow():
                few_decades(axes.xaxis)
    else:
        axes.set_xticks(x, names, rotation=20, ha="right", parse_math=False)
    # all may measure one scalar
    measured, units = (set(result.attributes[key]) for key in ("scalars", "scalar_units"))
    panel.label(y="measured numbers" if len(measured) > 1 else
                label(measured.pop().replace("_", " "), units.pop()))  # fmt: skip
    page.facts(n_measurements="measurements", n_runs="runs")
    return page.legend()


# -- planned experiments ---------------------------------------------------------------------------


def course(result: Result) -> Figure:
    """Draw the chosen inputs, and the limited and measured signals of the motion."""
    inputs = [f"course_{name}" for name in result.attributes["courses"]]
    shown = [name for name in inputs if np.ptp(result[name].values, axis=1).any()]
    limits = result.attributes["limits"]
    shown += [name for name in limits if name not in shown]
    shown += ["position"] if "position" in result and "position" not in shown else []
    page = Page(result, 1.0 + 1.5 * len(shown), 1.0 + 1.7 * len(shown))
    for panel, name in zip(page.rows(*[1] * len(shown)), shown, strict=True):
        words = name.removeprefix("course_").replace("_", " ")
        panel.label(y=words + ", chosen" * (words != name.replace("_", " ")), of=name)
        what = "mass" if name == "position" else "link"
        several = len(page[name]) > 1
        panel.curves("time", name, what=what, worm=False, legend=several)
        for edge in limits.get(name, ()):
            if isinstance(edge, float):
                panel.level(edge, ls=":", lw=1)
        if several:
            panel.legend(above=0.9)
    page.facts(shrinkage="confidence region smaller than after the best random run by")
    return page.drawn


def errors(result: Result) -> Figure:
    """Draw expected relative standard errors: before, after the planned run and random ones."""
    names, wanted = result.attributes["unknowns"], result.attributes["wanted"]
    page = Page(result, 1.3 + 0.42 * len(names))
    panel, rows = page.panel(), np.arange(len(names))
    size = _percent(page["value"])
    rivals, before = page["rival_error"] / size, page["error_before"] / size
    for values in rivals:
        panel.curve(values, rows, ls="", marker="|", color=_RANDOM, ms=9)
    panel.curve(rivals[0], rows, ls="", marker="s", color=_RANDOM, ms=5)
    known = np.isfinite(before)
    panel.curve(before[known], rows[known], ls="", marker="o", color="black", mfc="white", ms=6)
    panel.curve(page["error"] / size, rows, ls="", marker="o", color=_BEST, ms=6)
    panel.axes.set_xscale("log")
    _list(panel, [name if name in wanted else f"{name} (not wanted)" for name in names])
    panel.label(r"standard error $\sigma_p/|\hat p|$ (%)")
    panel.entry("after the planned run", _BEST, "", marker="o")
    panel.entry("after the best random run", _RANDOM, "", marker="s")
    panel.entry("after random runs", _RANDOM, "", marker="|")
    if known.any():
        panel.entry("known before", "black", "", marker="o", mfc="white")
    return page.legend()


def regions(result: Result) -> Figure:
    """Draw 95 % confidence regions of pairs of wanted parameters."""
    names, units = result.attributes["unknowns"], result.attributes["unknown_units"]
    wanted = [names.index(name) for name in result.attributes["wanted"]]
    pairs = [*combinations(wanted, 2)][:_PAIRS]
    if not pairs:
        return errors(result)
    across = min(1 if narrow() else 3, len(pairs))
    down = -(-len(pairs) // across)
    scale = 7.1 / (max(2.6 * across, 4.0) + 0.3)
    page = Page(result, scale * (2.6 * down + 0.7))
    panels = [panel for row in page.grid(down, across) for panel in row]
    turn = np.linspace(0.0, 2 * np.pi, 181)
    circle = _SURE * np.array([np.cos(turn), np.sin(turn)])
    for panel, pair in zip(panels, pairs, strict=False):
        value = page["value"][list(pair)]
        for name, color, dashes in (("covariance_random", _RANDOM, "--"),
                                    ("covariance", _BEST, "-")):  # fmt: skip
            inner = page[name][np.ix_(pair, pair)]
            if np.isfinite(inner).all():
                ring = value[:, None] + np.linalg.cholesky(inner) @ circle
                panel.curve(*ring, color=color, ls=dashes)
        panel.curve(*value, marker="+", color="black")
        panel.label(*(f"$p$: {names[k]} ({units[k] or 1})".replace("_", " ") for k in pair))
        panel.axes.locator_params(nbins=3)
    for panel in panels[len(pairs) :]:
        panel.axes.set_axis_off()
    return page.legend(line("after the planned run", _BEST),
                       line("after the best random run", _RANDOM, "--"))  # fmt: skip


# -- gaits for fitted worms ------------------------------------------------------------------------


def forces(result: Result) -> Figure:
    """Draw recorded actuator forces, their fit and the residuals of the first run."""
    page = Page(result, 4.4, 4.4)
    above, below = page.rows(2, 1)
    first = np.flatnonzero(page["reading_run"] == page["reading_run"][0])[:_MOST]
    time = page["reading_time"][first]
    read, fitted = (page[name][:, first] for name in ("read_force", "fitted_force"))
    for j, color in enumerate(colours("link", len(read))):
        dots = {"ls": "", "marker": ".", "color": color, "ms": 1.5, "alpha": 0.6}
        above.curve(time, read[j], **dots)
        above.curve(time, fitted[j], color="black", lw=0.7, zorder=3)
        below.curve(time, read[j] - fitted[j], **dots)
        above.entry(f"link {j}", color, DASHES[j % 4])
    below.level(0.0, color="black", ls="-", lw=0.7)
    above.label(y=r"actuator force $\mu_j$", of="read_force")
    below.label(y="reading − fit", of="read_force")
    below.label("time $t$", of="reading_time")
    above.entry("fit", "black", lw=0.7)
    above.legend()
    page.facts(load_found="", load_error="standard error", drag_found="")
    return page.drawn


def loads(result: Result) -> Figure:
    """Draw the load of a resting spike over a cycle: estimated, worst case, and on the plant."""
    limit = result.scalars["spike_load_limit"].value if "spike_load_limit" in result else None
    alike = [limit] if isinstance(limit, float) else []
    tall = 1.9 * len(alike)
    page = Page(result, 3.6 + tall, 4.0 + tall)
    whole, *near = page.rows(*(2, 1)[: 1 + len(alike)])
    for panel in (whole, *near):
        _draw_loads(panel)
        panel.limits([(each,) for each in (limit if isinstance(limit, list) else alike)][:1])
    whole.label(y="load of a resting spike", of="band_load")
    whole.axes.set_ylim(bottom=0.0)
    for panel in near:
        space = float(page["band_error"].max())
        panel.axes.set_ylim(alike[0] - 4 * space, alike[0] + space)
        panel.label(y="load near the limit", of="band_load")
    (near or [whole])[-1].named("x", "band_time", "time $t$ in a cycle")
    page.facts(plant_share="speed over that of the gait designed with true parameters",
               plant_spike_load_max="largest load on the plant")  # fmt: skip
    return page.legend()


def _draw_loads(panel: Panel) -> None:
    page = panel.page
    time, load, error = (page[f"band_{name}"] for name in ("time", "load", "error"))
    panel.curve(time, load, "with the estimates", color=LINKS[0])
    panel.band(time, load - error, load + error, "for all parameters in the ellipsoid",
               color=LINKS[0])  # fmt: skip
    if "plant_share" in page.result.scalars:
        panel.curve(page["plant_time"], page["plant_load"], "on the plant", color="black",
                    ls=DASHES[1], lw=1)  # fmt: skip
        text = "on the plant, gait that assumes exact estimates"
        panel.curve(page["bold_time"], page["bold_load"], text, color=RED, lw=0.8)
    panel.axes.margins(x=0)
