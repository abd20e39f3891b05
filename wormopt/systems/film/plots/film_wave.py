"""The best wave of a film beside the cosine wave: shape, field, speed of the surface."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, LINKS, RED, draw_limits, facts, legend, scalar, sheet
from wormopt.result import Result

_PHASES = ("0", "π/2", "π", "3π/2", "2π")
_OTHER = (0, (4, 2))


def film_wave(result: Result) -> Figure:
    """Thickness, field and surface velocity over one wavelength; below, other films if swept.

    Dashed in colour: the cosine wave within the same limits.
    """
    swept = "sweep_mean_flow" in result
    drawn = sheet(9, 10.5 if swept else 8.2)
    rows = drawn.subplots(3 + swept, gridspec_kw={"hspace": 0.08})
    xi = result["xi"].values
    for axes, name, text in zip(
        rows,
        ("height", "field_pressure", "surface_velocity"),
        ("thickness $h$ over its mean", r"field $(\mu-1)H^2/(8\pi P)$", "surface velocity $u_s$"),
        strict=False,
    ):
        axes.plot(xi, result[name].values, color=LINKS[0], lw=1.8, label="best")
        if f"{name}_cosine" in result:
            axes.plot(result["xi_cosine"].values, result[f"{name}_cosine"].values,
                      color=LINKS[3], lw=1.3, linestyle=_OTHER, label="cosine")  # fmt: skip
        axes.set_ylabel(text)
        axes.set_xlim(0, 2 * math.pi)
        axes.set_xticks(np.linspace(0, 2 * math.pi, 5), _PHASES)
        legend(axes, [*axes.get_lines()])
    rows[0].fill_between(xi, result["height"].values, color="#CFE3F3", zorder=0)
    rows[0].set_ylim(0, None)
    draw_limits(rows[0], [(level,) for level in scalar(result, "thickness_limits")], [GREY] * 2)
    limit = scalar(result, "field_limit")
    draw_limits(rows[1], [(0.0, scalar(result, "field_range") if limit is None else limit)])
    draw_limits(rows[2], [(1.0,)])
    rows[2].annotate("speed of the wave: floats are held from here on", (np.pi, 1.0), (0, -13),
                     textcoords="offset points", ha="center", color=GREY, fontsize=9)  # fmt: skip
    rows[2].set_xlabel(r"phase ($\xi = t - x$)")
    rows[0].set_title(
        facts(result, "mean_flow", "mean_flow_cosine", "mean_flow_supremum"), loc="left"
    )
    rows[1].set_title(facts(result, "tension_number", "field_range", "crests"), loc="left")
    rows[2].set_title(facts(result, "float_drift", "float_drift_cosine"), loc="left")
    if swept:
        _draw_sweep(rows[3], result)
    drawn.align_ylabels()
    return drawn


def _draw_sweep(axes: Axes, result: Result) -> None:
    """What is missing to the supremum, against the parameter of which there are more values."""
    supremum = scalar(result, "mean_flow_supremum")
    tension, field = (result[f"sweep_{name}"].values for name in ("tension", "field"))
    flows = {"best": result["sweep_mean_flow"], "cosine": result["sweep_mean_flow_cosine"]}
    along = len(tension) >= len(field)
    places, others = (tension, field) if along else (field, tension)
    for name, variable in flows.items():
        gaps = supremum - (variable.values.T if along else variable.values)
        for k, gap in enumerate(gaps):
            text = f"{name}, {'field' if along else '$W$'} {others[k]:.3g}"
            best = name == "best"
            axes.loglog(places, gap, "o-" if best else "s--", color=LINKS[k % 4] if best else RED,
                        alpha=1 if best else 0.4 + 0.6 / (1 + k), ms=4, label=text)  # fmt: skip
    axes.set_xlabel("surface tension ($W$)" if along else r"range of the field ($\beta$)")
    axes.set_ylabel("flow below supremum")
    legend(axes, [*axes.get_lines()])
