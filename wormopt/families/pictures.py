# pyright: strict, reportUnknownMemberType=false
"""Picture of a sweep: results over the keys that vary."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from wormopt.families.gathered import NUMBERED, as_typed, everywhere
from wormopt.pictures.page import Page, Panel, edges
from wormopt.pictures.style import GREY, LINKS, RED, label, line, narrow
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
    keys = [
        everywhere(result, a["dim"], result[a["dim"]].values) for a in result.attributes["axes"]
    ]
    for name in first:
        if _varies(result[name].values) and not _among(result[name].values, keys):
            unlike.setdefault(result[name].values.tobytes(), name)
    return [*unlike.values()][:_MOST] or first[:1] or ["status"]


def _among(values: np.ndarray, keys: list[np.ndarray]) -> bool:
    """Whether a result only repeats a key that is swept."""
    found = values.ravel()
    known = np.isfinite(found)
    same = (key for key in keys if key.shape == found.shape and key.dtype.kind in "fi")
    return any(np.allclose(found[known], key[known], rtol=1e-12, atol=0.0) for key in same)


def _varies(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and np.ptp(finite) > 1e-6 * np.max(np.abs(finite)))


def _maps(result: Result, names: list[str], dims: list[str]) -> Figure:
    columns = 1 if narrow() else min(len(names), 2)
    rows = -(-len(names) // columns)
    page = Page(result, 7.1 / (4.6 * columns) * 3.4 * rows, 2.4 * rows)
    y, x = (page[dim] for dim in dims)
    lost = ~np.isin(page["status"], NUMBERED)
    panels = [panel for row in page.grid(rows, columns) for panel in row]
    for panel in panels[len(names) :]:
        panel.axes.set_axis_off()
    for panel, name in zip(panels, names, strict=False):
        values = np.ma.masked_invalid(np.where(lost, np.nan, page[name]))
        panel.map(_edges(x), _edges(y), values, _named(page, name), rasterized=False)
        _mark_lost(panel, x, y, lost)
        _scale(panel, "x", dims[1])
        _scale(panel, "y", dims[0])
    return _explain_lost(page, lost)


def _mark_lost(panel: Panel, x: np.ndarray, y: np.ndarray, lost: np.ndarray) -> None:
    across, up = _edges(x).tolist(), _edges(y).tolist()
    for i, j in np.argwhere(lost).tolist():
        width, height = across[j + 1] - across[j], up[i + 1] - up[i]
        panel.axes.add_patch(Rectangle((across[j], up[i]), width, height, **_LOST))


def _columns(result: Result, names: list[str], dims: list[str], lines: bool) -> Figure:
    """A column for every key, a row for every result."""
    page = Page(result, 0.6 + 2.1 * len(names))
    panels = page.grid(len(names), len(dims), sharex="col", sharey="row")
    lost = ~np.isin(page["status"].ravel(), NUMBERED)
    for j, dim in enumerate(dims):
        at = everywhere(result, dim, page[dim])
        for row, name in zip(panels, names, strict=True):
            panel, series = row[j], page[name].reshape(lost.size, -1).T
            for entry, values in enumerate(series):
                panel.curve(at, np.where(lost, np.nan, values), f"entry {entry}", marker="o", ms=4,
                            ls="-" if lines else "", color=LINKS[entry % len(LINKS)])  # fmt: skip
            if len(series) > 1 and j == len(dims) - 1:
                panel.legend()
            for k in np.flatnonzero(lost):
                panel.axes.plot(at[k], 0.02, "x", color=RED,
                                transform=panel.axes.get_xaxis_transform())  # fmt: skip
            if j == 0:
                panel.label(y=_named(page, name))
        _scale(panels[-1][j], "x", dim)
    return _explain_lost(page, lost, cross=True)


def _named(page: Page, name: str) -> str:
    return label(name.replace("_", " "), page.unit(name))


def _scale(panel: Panel, which: str, dim: str) -> None:
    """Label an axis by its key; texts are unchanged, equal ratios get a logarithmic scale."""
    (axis,) = (axis for axis in panel.page["axes"] if axis["dim"] == dim)
    values = panel.page[dim]
    panel.label(**{which: axis["key"]}, of=dim)
    if any(isinstance(value, str | list | bool) for value in axis["values"]):
        ticks = [str(value) for value in axis["values"]]
        getattr(panel.axes, f"set_{which}ticks")(values, ticks)
    elif _is_geometric(values):
        getattr(panel.axes, f"set_{which}scale")("log")


def _is_geometric(values: np.ndarray) -> bool:
    values = np.unique(values)
    if len(values) < 3 or values[0] <= 0 or values[-1] < 5 * values[0]:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.ptp(ratios) < 1e-6 * ratios[0])


def _edges(values: np.ndarray) -> np.ndarray:
    """Borders of cells around values, half way between them, in ratio if their ratio is one."""
    return np.exp(edges(np.log(values))) if _is_geometric(values) else edges(values)


def _explain_lost(page: Page, lost: np.ndarray, cross: bool = False) -> Figure:
    if lost.any():
        words = f"no accepted result ({int(lost.sum())} of {lost.size})"
        mark = line(words, RED, "none", marker="x") if cross else Patch(label=words, **_LOST)
        page.drawn.legend(handles=[mark], loc="outside lower right")
    return page.drawn
