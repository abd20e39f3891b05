"""Drawings of obstacles and capsules in the plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Circle, Polygon

from wormopt.plotting.parts import GREY

SOLID = "#BDB6AC"


def draw_obstacle(axes: Axes, each: Any) -> None:
    """Draw an obstacle from its table; the limits of the axes are already set."""
    style = {"facecolor": SOLID, "edgecolor": GREY, "linewidth": 0.6, "zorder": 2}
    if each["shape"] == "disc":
        axes.add_patch(Circle(each["centre"], each["radius"], **style))
    elif each["shape"] == "block":
        axes.add_patch(Polygon(each["corners"], **style))
    elif each["shape"] == "wall":
        normal = np.array([np.cos(each["angle"]), np.sin(each["angle"])])
        along, far = np.array([-normal[1], normal[0]]), 1e3 * _size(axes)
        point = np.array(each["point"])
        corners = [point + far * along, point - far * along]
        axes.add_patch(Polygon([*corners, *(c - far * normal for c in corners[::-1])], **style))
    else:
        ends = np.array([each["start"], each["end"]])
        if each.get("radius"):
            thick(axes, ends[:, :1], ends[:, 1:], each["radius"], color=SOLID, zorder=2)
        axes.plot(ends[:, 0], ends[:, 1], color=GREY, linewidth=1.0, zorder=2)


def _size(axes: Axes) -> float:
    return max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()), 1e-300)


def thick(axes: Axes, x: np.ndarray, y: np.ndarray, radius: float, **style: Any) -> None:
    """Draw bodies (n, m) of links as capsules, with the radius in units of the plane."""
    usual: dict[str, Any] = {"linewidths": 0.0}
    outlines = [
        _capsule(x[j : j + 2, k], y[j : j + 2, k], radius)
        for k in range(x.shape[1])
        for j in range(x.shape[0] - 1)
    ]
    axes.add_collection(PolyCollection(outlines, **(usual | style)))


def _capsule(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    angle = np.arctan2(y[1] - y[0], x[1] - x[0])
    half = np.linspace(-np.pi / 2, np.pi / 2, 13)
    front = angle + half
    rear = front + np.pi
    ahead = np.column_stack([x[1] + radius * np.cos(front), y[1] + radius * np.sin(front)])
    behind = np.column_stack([x[0] + radius * np.cos(rear), y[0] + radius * np.sin(rear)])
    return np.vstack([ahead, behind])
