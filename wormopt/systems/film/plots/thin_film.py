"""Pictures of a film that a given field moves: its course and stability, and where films go."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from wormopt.plotting.parts import GREY, LINKS, RED, facts, scalar, sheet
from wormopt.result import Result

_TURN = 2 * math.pi
# Outcomes in the order of their numbers: name, colour, words.
_OUTCOMES = (
    ("wave", "#9CCBE8", "takes the wave"),
    ("other", "#F4C86A", "another steady film"),
    ("moving", "#C9B6DC", "still moves"),
    ("breaks", "#E08A76", "breaks"),
    ("unresolved", "#DDDDDD", "not resolved"),
)
_FEW = 12


def forward(result: Result) -> Figure:
    """Course of a film, its end, the field, and the eigenvalues; steady branches if followed."""
    drawn = sheet(10.5, 8.2)
    branches = "branch_delta" in result
    places = drawn.add_gridspec(3, 2, height_ratios=(5, 4, 5))
    course = drawn.add_subplot(places[:2, 0])
    _course(drawn, course, result)
    _film(drawn.add_subplot(places[0, 1]), result)
    _spectrum(drawn.add_subplot(places[2, 0]), result)
    _field(drawn.add_subplot(places[1, 1] if branches else places[1:, 1]), result)
    if branches:
        _branches(drawn.add_subplot(places[2, 1]), result)
    words = {name: text for name, _, text in _OUTCOMES}[scalar(result, "outcome")]
    numbers = facts(result, "tension_number", "growth_rate_max")
    course.set_title(f"{words}    {numbers}", loc="left")
    return drawn


def _phases(axes: Axes) -> None:
    axes.set_xlim(0, 2)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(r"phase $\xi$ ($\pi$ rad)")


def _closed(result: Result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Phases in units of pi and values, the first once more at the end."""
    xi, values = result["xi"].values / math.pi, result[name].values
    return np.append(xi, 2.0), np.append(values, values[0])


def _course(drawn: Figure, axes: Axes, result: Result) -> None:
    xi = np.append(result["xi"].values, _TURN) / math.pi
    time, h = result["time"].values / _TURN, result["thickness"].values
    if len(time) == 1:  # it was broken to begin with
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
            scalar(result, "broke_xi") / math.pi, scalar(result, "broke_time") / _TURN,
            marker="x", color=RED, markersize=9, markeredgewidth=2, clip_on=False,
        )  # fmt: skip


def _film(axes: Axes, result: Result) -> None:
    start = result["thickness"].values[0]
    xi, end = _closed(result, "thickness_end")
    axes.fill_between(xi, 0, end, color=LINKS[0], alpha=0.15, linewidth=0)
    axes.plot(xi, end, color=LINKS[0], linewidth=2, label="at the end")
    if "thickness_wave" in result:
        axes.plot(
            *_closed(result, "thickness_wave"), color="black", linestyle=(0, (4, 3)),
            linewidth=1.3, label="prescribed",
        )  # fmt: skip
    axes.plot(xi, np.append(start, start[0]), color=GREY, linewidth=1, label="at the start")
    _phases(axes)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("thickness $h$")
    axes.legend(loc="best", fontsize=8.5)


def _field(axes: Axes, result: Result) -> None:
    axes.plot(*_closed(result, "field_pressure"), color=LINKS[3], linewidth=1.8)
    _phases(axes)
    axes.set_ylabel(r"field $(\mu - 1) H^2 / 8\pi$")


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
                markerfacecolor="none",
            )  # fmt: skip
            shown.append(rates[0])
    axes.axvline(0, color=RED, linewidth=0.9)
    axes.text(0.99, 0.03, "unstable", color=RED, ha="right", fontsize=8.5, transform=axes.transAxes)
    axes.set_xlabel(r"growth rate ($\mathrm{Re}\,\lambda$)")
    axes.set_ylabel(r"angular rate ($\mathrm{Im}\,\lambda$)")
    if shown:
        together = np.concatenate(shown)
        right = max(0.0, float(together.max())) + 0.5
        axes.set_xlim(float(together.min()) - 0.4, right)
        axes.axvspan(0, right, color=RED, alpha=0.06, linewidth=0)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8.5)


def _branches(axes: Axes, result: Result) -> None:
    number = result["branch_number"].values
    for which in np.unique(number):
        own = number == which
        delta, crest = (result[f"branch_{n}"].values[own] for n in ("delta", "thickness_max"))
        stable = result["branch_growth"].values[own] < 0
        colour = "black" if which == 0 else LINKS[1]
        axes.plot(delta, np.where(stable, crest, np.nan), color=colour, linewidth=1.8)
        axes.plot(delta, crest, color=colour, linewidth=1.2, linestyle=(0, (3, 3)), zorder=1)
    for fold in scalar(result, "delta_fold"):
        axes.axvline(fold, color=RED, linewidth=0.8)
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("largest thickness")
    axes.set_title("steady films; dashed where not stable", loc="left")


def basins(result: Result) -> Figure:
    """Where flat films go, over the amplitude and the number of surface tension.

    A cell for each film, with the largest rate of growth on the prescribed wave.
    """
    delta, tension = result["map_delta"].values, result["map_tension"].values
    outcome, growth = result["map_outcome"].values, result["map_growth"].values
    drawn = sheet(2.6 + 0.78 * len(delta), 2.4 + 0.55 * len(tension))
    axes = drawn.subplots()
    colours = ListedColormap([colour for _, colour, _ in _OUTCOMES])
    norm = BoundaryNorm(np.arange(-0.5, len(_OUTCOMES)), len(_OUTCOMES))
    axes.pcolormesh(outcome.T, cmap=colours, norm=norm, edgecolors="white", linewidth=1.5)
    for i, j in np.ndindex(outcome.shape):
        rate = growth[i, j]
        if np.isfinite(rate):
            axes.text(
                i + 0.5, j + 0.5, f"{rate:+.2f}", ha="center", va="center", fontsize=8.5,
                color=RED if rate > 0 else "black", weight="bold" if rate > 0 else "normal",
            )  # fmt: skip
    axes.grid(visible=False)
    for axis, values in ((axes.xaxis, delta), (axes.yaxis, tension)):
        axis.set_major_locator(FixedLocator((np.arange(len(values)) + 0.5).tolist()))
        axis.set_major_formatter(FuncFormatter(_cell(values)))
        axis.set_tick_params(length=0)
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("surface tension $W$")
    axes.set_title("numbers: largest growth rate on the prescribed wave", loc="left")
    present = [
        Patch(color=colour, label=text)
        for k, (_, colour, text) in enumerate(_OUTCOMES)
        if np.any(outcome == k)
    ]
    drawn.legend(handles=present, loc="outside lower center", ncols=len(present))
    return drawn


def _cell(values: np.ndarray) -> Any:
    def written(place: float, _: object) -> str:
        k = int(place)
        return f"{values[k]:g}" if 0 <= k < len(values) else ""

    return written
