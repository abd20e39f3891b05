"""Picture of readings: entries that support each sentence, and how many support all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import GREY, LINKS, fact, legend_below, narrow, needed, sheet, tell
from wormopt.result import Result

_NAMES = {
    "quick": "(13) captures quickly",
    "open": "(14) does not capture",
    "settled": "gain of (13) converges",
    "growing": "gain of (14) grows",
    "closer": "(13) is closer",
    "learning": "gains grow outside",
    "working": "both stay bounded",
}
_KEYS = {"rest_length": "rest length", "growth": r"$\gamma$", "friction": "$F_+$, $F_-$"}


def readings(result: Result) -> Figure:
    """Every reading with the sentences it supports, and the shares of readings by entry.

    Readings are sorted by the number of sentences they support; the last column is all of them.
    """
    rows = _rows(result)
    high = 0.19 * len(rows)
    drawn = sheet(7.1, 1.9 + high, 4.2 + high)
    if narrow():
        shares, each = drawn.subplots(2, 1, height_ratios=(high, 1.8))
    else:
        each, shares = drawn.subplots(1, 2, width_ratios=(1, 1.9))
    _draw_all(each, result)
    _draw_shares(shares, rows, len(result["supported"].values))
    legend_below(drawn, [
        Patch(color=LINKS[0], label="supports the sentence"),
        Patch(facecolor="white", edgecolor=GREY, linewidth=0.6, label="does not"),
    ])  # fmt: skip
    tell(drawn, fact(result, "n_readings", "readings $N$"),
         fact(result, "n_supporting", "that support all"))  # fmt: skip
    return drawn


def _supported(result: Result) -> np.ndarray:
    """Whether each sentence, and whether all, hold for each reading (readings, sentences + 1)."""
    supported = result["supported"].values > 0
    return np.column_stack([supported, supported.all(axis=1)])


def _rows(result: Result) -> list[tuple[str, np.ndarray]]:
    """Share of readings that support each sentence, by entry."""
    supported, picks = _supported(result), result["reading_choice"].values
    rows = [("every reading", supported.mean(axis=0))]
    choices: Mapping[str, Sequence[Any]] = needed(result, "choices")
    for k, (name, entries) in enumerate(choices.items()):
        for i, entry in enumerate(entries):
            rows.append((f"{_KEYS.get(name, name)}  {_text(entry)}",
                         supported[picks[:, k] == i].mean(axis=0)))  # fmt: skip
    return rows


def _text(entry: Any) -> str:
    if isinstance(entry, list | tuple):
        return ", ".join(f"{value:g}" for value in entry)
    if entry is None:
        return "the reference"
    return entry.replace("_", " ") if isinstance(entry, str) else f"{entry:.3g}"


def _draw_all(axes: Axes, result: Result) -> None:
    supported = _supported(result)
    order = np.lexsort((*supported[:, :-1].T, -supported[:, :-1].sum(axis=1)))
    axes.pcolormesh(supported[order], cmap=ListedColormap(["white", LINKS[0]]), vmin=0, vmax=1)
    axes.set_ylim(len(supported), 0)
    axes.set_ylabel("reading, best first")
    _name_columns(axes)


def _draw_shares(axes: Axes, rows: Sequence[tuple[str, np.ndarray]], count: int) -> None:
    shares = np.array([values for _, values in rows])
    shade = shares.copy()
    shade[:, -1] = np.sqrt(shade[:, -1])  # Few readings support all, so small shares are shown
    # darker than they are.
    axes.pcolormesh(shade, cmap="Blues", vmin=0, vmax=1.3)
    for (i, j), share in np.ndenumerate(shares):
        text = f"{100 * share:.0f}" if share == 0 or share >= 0.01 else f"{100 * share:.1f}"
        colour = "white" if shade[i, j] > 0.8 else "black"
        axes.text(j + 0.5, i + 0.53, text, ha="center", va="center", size=6.5, color=colour)
    axes.set_yticks(np.arange(len(rows)) + 0.5, [name for name, _ in rows])
    axes.set_ylim(len(rows), 0)
    _name_columns(axes)
    axes.set_xlabel(f"share of a row's readings,\nof $N$ = {count} in all (%)")


def _name_columns(axes: Axes) -> None:
    names = [*_NAMES.values(), "all"]
    axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=90)
    axes.axvline(len(names) - 1, color="black", linewidth=0.8)
    axes.tick_params(length=0)
    axes.grid(visible=False)
