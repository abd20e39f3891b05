"""Picture of a sweep: results over the keys that vary."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from wormopt.families.gathered import NUMBERED, as_typed, everywhere
from wormopt.plotting.parts import GREY, LINKS, RED, label, legend, narrow, sheet
from wormopt.result import Result

# Number of results shown by default.
_MOST = 4
_LOST: dict[str, Any] = {"hatch": "////", "facecolor": "#F2F2F2", "edgecolor": GREY, "linewidth": 0}


def sweep(result: Result) -> Figure:
    """Maps over two keys, lines over one, and points over each where there are more.

    Lists of numbers, such as one number per tracker, are lines or points in one panel.
    """
    result = as_typed(result)
    names = shown(result)
    axes = result.attributes["axes"]
    grid = len(axes) == len(result["status"].dims)
    if grid and len(axes) == 2 and all(name in result.attributes["numbers"] for name in names):
        return _maps(result, names, [axis["dim"] for axis in axes])
    return _columns(result, names, [axis["dim"] for axis in axes], lines=grid and len(axes) == 1)


def shown(result: Result) -> list[str]:
    """Requested results, or the first varying ones of the kind, without duplicates."""
    asked = result.attributes.get("shown")
    if asked:
        return list(asked)
    first, unlike = result.attributes["numbers"], dict[bytes, str]()
    first = first or result.attributes.get("series", [])
    for name in first:
        if _varies(result[name].values):
            unlike.setdefault(result[name].values.tobytes(), name)
    return [*unlike.values()][:_MOST] or first[:1] or ["status"]


def _varies(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and np.ptp(finite) > 1e-6 * np.max(np.abs(finite)))


def _maps(result: Result, names: list[str], dims: list[str]) -> Figure:
    columns = 1 if narrow() else min(len(names), 2)
    rows = -(-len(names) // columns)
    figure = sheet(4.6 * columns, 3.4 * rows, narrow=2.4 * rows)
    y, x = (result[dim] for dim in dims)
    lost = ~np.isin(result["status"].values, NUMBERED)
    for k, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, k + 1)
        values = np.ma.masked_invalid(np.where(lost, np.nan, result[name].values))
        mesh = axes.pcolormesh(_edges(x.values), _edges(y.values), values, cmap="viridis")
        figure.colorbar(mesh, ax=axes, label=_named(result, name))
        _mark_lost(axes, x.values, y.values, lost)
        _scale(axes, "x", result, dims[1])
        _scale(axes, "y", result, dims[0])
        axes.grid(visible=False)
    _tell_lost(figure, lost)
    return figure


def _mark_lost(axes: Axes, x: np.ndarray, y: np.ndarray, lost: np.ndarray) -> None:
    across, up = _edges(x).tolist(), _edges(y).tolist()
    for i, j in np.argwhere(lost).tolist():
        width, height = across[j + 1] - across[j], up[i + 1] - up[i]
        axes.add_patch(Rectangle((across[j], up[i]), width, height, **_LOST))


def _columns(result: Result, names: list[str], dims: list[str], lines: bool) -> Figure:
    """A column for every key, a row for every result."""
    figure = sheet(max(4.2 * len(dims), 6.4), 2.3 * len(names) + 0.6)
    panels: Any = figure.subplots(len(names), len(dims), squeeze=False, sharex="col", sharey="row")
    lost = ~np.isin(result["status"].values.ravel(), NUMBERED)
    for j, dim in enumerate(dims):
        at = everywhere(result, dim, result[dim].values)
        for i, name in enumerate(names):
            axes, series = panels[i, j], result[name].values.reshape(lost.size, -1).T
            for entry, values in enumerate(series):
                colour, named = LINKS[entry % len(LINKS)], f"entry {entry}"
                axes.plot(at, np.where(lost, np.nan, values), "o-" if lines else "o",
                          color=colour, markersize=4, label=named)  # fmt: skip
            if len(series) > 1 and j == len(dims) - 1:
                legend(axes)
            for k in np.flatnonzero(lost):
                axes.plot(at[k], 0.02, "x", color=RED, transform=axes.get_xaxis_transform())
            if j == 0:
                axes.set_ylabel(_named(result, name))
        _scale(panels[-1, j], "x", result, dim)
    _tell_lost(figure, lost, cross=True)
    return figure


def _named(result: Result, name: str) -> str:
    return label(name.replace("_", " "), result[name].unit)


def _scale(axes: Axes, which: str, result: Result, dim: str) -> None:
    """Label an axis by its key; texts are unchanged, equal ratios get a logarithmic scale."""
    (axis,) = (axis for axis in result.attributes["axes"] if axis["dim"] == dim)
    values = result[dim].values
    getattr(axes, f"set_{which}label")(label(axis["key"], result[dim].unit))
    if any(isinstance(value, str | list | bool) for value in axis["values"]):
        ticks = [str(value) for value in axis["values"]]
        getattr(axes, f"set_{which}ticks")(values, ticks)
    elif _is_geometric(values):
        getattr(axes, f"set_{which}scale")("log")


def _is_geometric(values: np.ndarray) -> bool:
    values = np.unique(values)
    if len(values) < 3 or values[0] <= 0 or values[-1] < 5 * values[0]:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.ptp(ratios) < 1e-6 * ratios[0])


def _edges(values: np.ndarray) -> np.ndarray:
    """Borders of cells around ascending or descending values, half way between them."""
    if len(values) == 1:
        half = 0.5 * abs(values[0]) or 0.5
        return np.array([values[0] - half, values[0] + half])
    if _is_geometric(values):
        return np.exp(_edges(np.log(values)))
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _tell_lost(figure: Figure, lost: np.ndarray, cross: bool = False) -> None:
    if not lost.any():
        return
    words = f"no accepted result ({int(lost.sum())} of {lost.size})"
    mark = (
        Line2D([], [], marker="x", color=RED, linestyle="none", label=words)
        if cross
        else Patch(label=words, **_LOST)
    )
    figure.legend(handles=[mark], loc="outside lower right")
