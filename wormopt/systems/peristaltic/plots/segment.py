"""Plots of one segment of a peristaltic worm."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    legend_below,
    line,
    narrow,
    needed,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result
from wormopt.systems.peristaltic.plots.parts import ON, THIN, without_heights

_WALL = "#8C8C8C"
# Largest drawn swelling over the radius.
_SHOWN = 0.3


def segment(result: Result) -> Figure:
    """Plot the segment without field, in its coil, against its load, in its tube, and inflated.

    Swellings are enlarged by the factor stated in the plot. Coils are brown.
    """
    length, radius = needed(result, "length"), needed(result, "radius")
    states = _states(result)
    tube = scalar(result, "tube_radius")
    most = max([abs(r - radius) for _, _, r in states] + ([tube - radius] if tube else []))
    factor = _round(_SHOWN * radius / most) if most else 1.0
    balloon = "membrane_radius" in result
    count = len(states) + balloon
    drawn = sheet(7.1, 1.15 * count + 0.9, 0.8 * count + 1.1)
    rows = np.atleast_1d(drawn.subplots(count, 1, sharex=True))
    for axes, (words, stretch, swollen) in zip(rows, states, strict=False):
        x = np.linspace(-1, 1, 101)
        shown = radius + factor * (np.full_like(x, swollen) - radius)
        _outline(axes, 500 * length * stretch * x, 1e3 * shown)
        _coil(axes, result, lit=words != "without field")
        if words.startswith("in its tube") and tube:
            wall = 1e3 * (radius + factor * (tube - radius))
            for side in (-wall, wall):
                axes.axhline(side, color=_WALL, linewidth=2.5)
        axes.set_title(words)
    if balloon:
        _balloon(rows[-1], result)
    for axes in rows:
        without_heights(axes)
    for axes in rows[:-1]:
        axes.spines["bottom"].set_visible(False)
        axes.tick_params(bottom=False)
    rows[-1].set_xlabel("axial position $z$ (mm)")
    legend_below(
        drawn,
        [
            Patch(facecolor=THIN, edgecolor="black", label="segment"),
            Patch(facecolor=ON, label="coil with current"),
            Patch(facecolor="white", edgecolor=ON, label="without"),
            *([line("tube", _WALL, width=2.5)] if tube else []),
        ],
    )
    tell(
        drawn,
        f"swellings enlarged {factor:g} times",
        fact(result, "stroke", unit="%"),
        fact(result, "normal_force", "normal force on the tube", "mN"),
        fact(result, "holding", "holds", "mN"),
        "will not move" if scalar(result, "moves") is False else "",
    )
    return drawn


def _states(result: Result) -> list[tuple[str, float, float]]:
    """Return title, stretch and radius of each state that is drawn as a cylinder."""
    radius, stretch = needed(result, "radius"), needed(result, "stretch")
    states = [("without field", 1.0), ("in its coil", stretch)]
    if needed(result, "load"):
        states.append(("in its coil, against the load", needed(result, "stretch_loaded")))
    contact = scalar(result, "stretch_contact")
    if contact is not None:
        words = "pressed on its wall" if needed(result, "normal_force") else "off its wall"
        states.append((f"in its tube, {words}", max(stretch, contact)))
    return [(words, lam, radius * lam**-0.5) for words, lam in states]


def _round(number: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... up to a number, at least 1."""
    power = 10.0 ** np.floor(np.log10(max(number, 1.0)))
    return float(power * max(step for step in (1, 2, 5) if step * power <= max(number, 1.0)))


def _outline(axes: Axes, x: np.ndarray, radius: np.ndarray) -> None:
    axes.fill_between(x, -radius, radius, facecolor=THIN, edgecolor="black", linewidth=0.8)
    for end in (0, -1):
        axes.plot([x[end]] * 2, [-radius[end], radius[end]], color="black", linewidth=2)


def _coil(axes: Axes, result: Result, *, lit: bool) -> None:
    """Draw the coil above and below: the field of the ideal coil, or the real winding."""
    length, radius = 1e3 * needed(result, "length"), 1e3 * needed(result, "radius")
    wound = scalar(result, "winding_length")
    half = 500 * wound if wound else needed(result, "coil_share") * length / 2
    for side in (-1, 1):
        axes.fill_between(
            [-half, half], side * 1.5 * radius, side * 1.8 * radius, linewidth=0.8,
            facecolor=ON if lit else "white", edgecolor=ON,
        )  # fmt: skip
    axes.set_ylim(-1.9 * radius, 1.9 * radius)


def _balloon(axes: Axes, result: Result) -> None:
    """Draw the true membrane under its given pressure, with its swelling to scale."""
    place, radius = (1e3 * result[f"membrane_{name}"].values for name in ("place", "radius"))
    _outline(axes, np.concatenate([-place[::-1], place]), np.concatenate([radius[::-1], radius]))
    pressure = needed(result, "inflation_pressure")
    axes.set_title(f"not sealed, at a pressure of {pressure:g} Pa: swelling to scale")


def stroke(result: Result) -> Figure:
    """Plot strokes over the coil's pressure, and forces on the ends over the stretch."""
    drawn = sheet(7.1, 3.3, 5.6)
    left, right = drawn.subplots(*((2, 1) if narrow() else (1, 2)))
    pressure = result["pressure"].values
    curves: list[tuple[str, str, str, Any]] = [
        ("free_stroke", "free", LINKS[0], DASHES[0]),
        ("deepest_stroke", "with the best coil", LINKS[2], DASHES[2]),
    ]
    if needed(result, "load"):
        curves.insert(1, ("loaded_stroke", "against the load", LINKS[1], DASHES[1]))
    for name, words, colour, dashes in curves:
        values = 100 * result[name].values
        left.plot(pressure, values, color=colour, linestyle=dashes, label=words)
    given = needed(result, "coil_pressure")
    left.plot(given, 100 * needed(result, "stroke"), "o", color=RED, label="the coil's pressure")
    contact = scalar(result, "stretch_contact")
    if contact is not None:
        left.axhline(100 * (1 - contact), color=GREY, linestyle=LIMIT, linewidth=0.9,
                     label="to the wall")  # fmt: skip
    left.set_xlabel("magnetic pressure (Pa)")
    left.set_ylabel("stroke (%)")
    left.margins(x=0)
    stretch = result["axial_stretch"].values
    forces = [("return_forces", "push of the rubber", "black", "-")]
    forces.append(("coil_pulls", "pull of the ideal coil", LINKS[3], DASHES[3]))
    if "winding_pulls" in result:
        forces.append(("winding_pulls", "pull of the winding", "#8C5A1E", DASHES[1]))
    for name, words, colour, dashes in forces:
        values = 1e3 * result[name].values
        right.plot(stretch, values, color=colour, linestyle=dashes, label=words)
    if contact is not None:
        right.axvline(contact, color=GREY, linestyle=LIMIT, linewidth=0.9)
    right.set_xlabel("stretch $l/L$ (1 unstressed)")
    right.set_ylabel("force on the ends (mN)")
    right.margins(x=0)
    legend_below(drawn)
    tell(
        drawn,
        fact(result, "stroke", "free stroke", "%"),
        fact(result, "loading", "pressure over $Gh/R$"),
        fact(result, "winding_share", "share of the equivalent ideal coil"),
    )
    return drawn
