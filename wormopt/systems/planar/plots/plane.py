"""Plots of a body in the plane: path, forces and works over time, and animation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    MASSES,
    RED,
    fact,
    handles,
    label,
    legend,
    line,
    shades,
    sheet,
    styles,
    tell,
)
from wormopt.result import Result
from wormopt.systems.planar.plots.bodies import course

_WORKS = (
    ("actuator", LINKS[0], "actuators"),
    ("ground", RED, "ground"),
    ("damping", LINKS[2], "dashpots"),
    ("pull", LINKS[1], "weight"),
    ("wall", GREY, "obstacles"),
)


def plane(result: Result) -> Figure:
    """Plot the body at equal times, resting masses filled, and the path of its mass centre."""
    drawn = course(result, "centre of mass")
    tell(
        drawn,
        fact(result, "distance", "distance of the centre of mass"),
        fact(result, "turn", "turn to the left"),
    )
    return drawn


def forces(result: Result) -> Figure:
    """Plot forces of ground and actuators over time, and works."""
    joints = "torque" in result
    drawn = sheet(7.1, 7.2 if joints else 6.0, 8.4)
    panels = drawn.subplots(4 if joints else 3, sharex=True)
    time = result["time"].values
    size = np.hypot(result["ground_x"].values, result["ground_y"].values)
    colours = shades(MASSES, len(size))
    for row, colour in zip(size, colours, strict=True):
        panels[0].plot(time, row, color=colour, linewidth=1)
    panels[0].set_ylabel(_lines("force of\nthe ground", result["ground_x"].unit))
    legend(panels[0], handles("mass", len(size)))
    labels = {
        "input": ("force $u_j$\nin links", "link"),
        "torque": ("torque $w_j$\nin joints", "joint"),
    }
    for axes, (name, (words, what)) in zip(panels[1:-1], labels.items(), strict=False):
        rows = result[name].values
        drawing = styles(LINKS, len(rows))
        for row, (colour, dashes) in zip(rows, drawing, strict=True):
            axes.plot(time, row, color=colour, linestyle=dashes, linewidth=1.1)
        axes.set_ylabel(_lines(words, result[name].unit))
        legend(axes, [line(f"{what} {j}", *each) for j, each in enumerate(drawing)][:9])
    for (name, colour, words), dashes in zip(_WORKS, (*DASHES, ":"), strict=True):
        done = result[f"work_{name}"].values if f"work_{name}" in result else 0.0
        if np.any(done):
            panels[-1].plot(time, done, color=colour, linestyle=dashes, label=words)
    energy = result["energy"].values
    panels[-1].plot(time, energy - energy[0], color="black", linewidth=0.8, label="stored")
    panels[-1].set_ylabel(_lines("work on\nthe body", result["energy"].unit))
    panels[-1].set_xlabel(label("time $t$", result["time"].unit))
    legend(panels[-1])
    tell(drawn, fact(result, "actuator_work", "work of the actuators"),
         fact(result, "energy_error", "energy error"))  # fmt: skip
    return drawn


def _lines(words: str, unit: str) -> str:
    return words if unit == "1" else label(f"{words}\n", unit)
