"""Pictures of a film in a given field: motion and stability, and outcomes of flat films."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    RED,
    fact,
    legend_above,
    legend_below,
    narrow,
    needed,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

_TURN = 2 * math.pi
# Outcomes in the order of their codes: name, colour, label.
_OUTCOMES = (
    ("wave", "#D6E9F8", "takes the wave"),
    ("other", "#F2B84B", "another steady film"),
    ("moving", "#A48FC0", "still moves"),
    ("breaks", "#B5473A", "breaks"),
    ("unresolved", "#FFFFFF", "not resolved"),
)
_FEW = 12


def forward(result: Result) -> Figure:
    """Motion of a film, its end, the field, and the eigenvalues; steady branches if continued."""
    branches = "branch_delta" in result
    drawn = sheet(7.1, 6.4, 8.5 if branches else 7.2)
    if narrow():
        heights = [1.5, *[1.0] * (3 + branches)]
        panels = drawn.subplot_mosaic("C;F;H;S;B" if branches else "C;F;H;S", height_ratios=heights)
    else:
        panels = drawn.subplot_mosaic(
            "CF;CH;SB" if branches else "CF;CH;SH", height_ratios=[5, 4, 5]
        )
    _course(drawn, panels["C"], result)
    _film(panels["F"], result)
    _field(panels["H"], result)
    _spectrum(panels["S"], result)
    if branches:
        _branches(panels["B"], result)
    words = {name: text for name, _, text in _OUTCOMES}[needed(result, "outcome")]
    tell(
        drawn,
        f"the film {words}" if words.endswith(("s", "wave")) else words,
        fact(result, "tension_number", "surface tension $W$"),
        fact(result, "growth_rate_max", "largest growth rate"),
    )
    return drawn


def _phases(axes: Axes) -> None:
    axes.set_xlim(0, 2)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(r"phase $\xi$ ($\pi$ rad)")


def _closed(result: Result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Phases in units of pi and values, the first repeated at the end."""
    xi, values = result["xi"].values / math.pi, result[name].values
    return np.append(xi, 2.0), np.append(values, values[0])


def _course(drawn: Figure, axes: Axes, result: Result) -> None:
    xi = np.append(result["xi"].values, _TURN) / math.pi
    time, h = result["time"].values / _TURN, result["thickness"].values
    if len(time) == 1:  # the film was ruptured at the start
        axes.plot(*_closed(result, "thickness_end"), color=LINKS[0])
    else:
        closed = np.column_stack([h, h[:, 0]])
        image = axes.pcolormesh(
            xi, time, closed, cmap="viridis", shading="gouraud", rasterized=True
        )
        drawn.colorbar(image, ax=axes, label="thickness $h$", pad=0.02)
    axes.grid(visible=False)
    _phases(axes)
    axes.set_ylabel("time in periods")
    if scalar(result, "broke_xi") is not None:
        axes.plot(
            needed(result, "broke_xi") / math.pi, needed(result, "broke_time") / _TURN,
            marker="x", color=RED, markersize=7, markeredgewidth=1.6, clip_on=False,
            linestyle="none", label="breaks here",
        )  # fmt: skip
        legend_above(axes, share=0.42)


def _film(axes: Axes, result: Result) -> None:
    start = result["thickness"].values[0]
    xi, end = _closed(result, "thickness_end")
    axes.fill_between(xi, 0, end, color=LINKS[0], alpha=0.15, linewidth=0)
    axes.plot(xi, end, color=LINKS[0], label="at the end")
    if "thickness_wave" in result:
        axes.plot(
            *_closed(result, "thickness_wave"), color="black", linestyle=DASHES[1],
            linewidth=1, label="prescribed",
        )  # fmt: skip
    axes.plot(
        xi,
        np.append(start, start[0]),
        color=GREY,
        linewidth=0.8,
        linestyle=":",
        label="at the start",
    )
    _phases(axes)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("thickness $h$")
    legend_above(axes, share=0.85 if narrow() else 0.42)


def _field(axes: Axes, result: Result) -> None:
    axes.plot(*_closed(result, "field_pressure"), color=LINKS[3])
    _phases(axes)
    axes.set_ylabel("field\n$(\\mu - 1) H^2 / 8\\pi$")


def _spectrum(axes: Axes, result: Result) -> None:
    shown = []
    for name, mark, colour, text in (
        ("wave", "o", "black", "prescribed wave"),
        ("end", "x", LINKS[0], "film at the end"),
    ):
        if f"growth_{name}" in result:
            rates = result[f"growth_{name}"].values[:_FEW], result[f"swing_{name}"].values[:_FEW]
            axes.plot(
                *rates, linestyle="none", marker=mark, color=colour, label=text,
                markerfacecolor="none", markersize=4,
            )  # fmt: skip
            shown.append(rates[0])
    axes.axvline(0, color=RED, linewidth=0.9)
    axes.text(0.99, 0.03, "unstable", color=RED, ha="right", fontsize=7.5, transform=axes.transAxes)
    axes.set_xlabel(r"growth rate ($\mathrm{Re}\,\lambda$)")
    axes.set_ylabel("angular frequency ($\\mathrm{Im}\\,\\lambda$)")
    if shown:
        together = np.concatenate(shown)
        right = max(0.0, float(together.max())) + 0.5
        axes.set_xlim(float(together.min()) - 0.4, right)
        axes.axvspan(0, right, color=RED, alpha=0.06, linewidth=0)
        legend_above(axes, share=0.85 if narrow() else 0.42)


def _branches(axes: Axes, result: Result) -> None:
    number = result["branch_number"].values
    for which in np.unique(number):
        own = number == which
        delta, crest = (result[f"branch_{n}"].values[own] for n in ("delta", "thickness_max"))
        stable = result["branch_growth"].values[own] < 0
        colour = "black" if which == 0 else LINKS[1]
        axes.plot(delta, np.where(stable, crest, np.nan), color=colour,
                  label=f"{'prescribed' if which == 0 else 'other'} branch, stable")  # fmt: skip
        axes.plot(delta, crest, color=colour, linewidth=1, linestyle=DASHES[2], zorder=1,
                  label="unstable" if which == 0 else None)  # fmt: skip
    for fold in needed(result, "delta_fold"):
        axes.axvline(fold, color=RED, linewidth=0.8, linestyle=":", label="fold")
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("largest thickness")
    entries, texts = axes.get_legend_handles_labels()
    legend_above(axes, list(dict(zip(texts, entries, strict=True)).values()),
                 share=0.85 if narrow() else 0.42)  # fmt: skip


def basins(result: Result) -> Figure:
    """Outcomes of flat films, over the amplitude and the surface tension.

    A cell for each film, with the largest growth rate of the prescribed wave.
    """
    delta, tension = result["map_delta"].values, result["map_tension"].values
    outcome, growth = result["map_outcome"].values, result["map_growth"].values
    tall = 1.6 + 0.3 * len(tension)
    drawn = sheet(7.1, tall, tall + 0.3)
    axes = drawn.subplots()
    colours = ListedColormap([colour for _, colour, _ in _OUTCOMES])
    norm = BoundaryNorm(np.arange(-0.5, len(_OUTCOMES)), len(_OUTCOMES))
    axes.pcolormesh(outcome.T, cmap=colours, norm=norm, edgecolors=GREY, linewidth=0.5)
    for i, j in np.ndindex(outcome.shape):
        rate = growth[i, j]
        if np.isfinite(rate):
            axes.text(
                i + 0.5, j + 0.5, f"{rate:+.2f}".replace("-", "−"), ha="center", va="center",
                fontsize=6.5 if narrow() else 7.5,
                color="white" if outcome[i, j] == 3 else "black",
                weight="bold" if rate > 0 else "normal",
            )  # fmt: skip
    axes.grid(visible=False)
    for axis, values in ((axes.xaxis, delta), (axes.yaxis, tension)):
        axis.set_major_locator(FixedLocator((np.arange(len(values)) + 0.5).tolist()))
        axis.set_major_formatter(FuncFormatter(_cell(values)))
        axis.set_tick_params(length=0)
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("surface tension $W$")
    tell(drawn, "numbers: largest growth rate of the prescribed wave, bold where it is unstable")
    present = [
        Patch(facecolor=colour, edgecolor=GREY, label=text)
        for k, (_, colour, text) in enumerate(_OUTCOMES)
        if np.any(outcome == k)
    ]
    legend_below(drawn, present)
    return drawn


def _cell(values: np.ndarray) -> Any:
    def written(place: float, _: object) -> str:
        k = int(place)
        return f"{values[k]:g}" if 0 <= k < len(values) else ""

    return written
