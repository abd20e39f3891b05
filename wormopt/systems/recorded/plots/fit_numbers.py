"""Picture of single measured numbers with the values that a scene computes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    MASSES,
    RED,
    fact,
    few_decades,
    legend_below,
    line,
    narrow,
    raised,
    sheet,
    tell,
)
from wormopt.result import Result


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
