"""Plots of a magnetisable rod in a channel: shapes, displacement, velocity over frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    line,
    narrow,
    needed,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

FRAMES = 144
_SNAPSHOTS = 7
_COIL, _LIT = "#EADFCF", "#D98C3F"
# Colours of the body's two halves, which show its motion past the walls.
_BODY = (LINKS[0], "#66B2E0")

_WORKS = (
    ("load", LINKS[0], "the field"),
    ("friction", RED, "friction"),
    ("damping", LINKS[2], "damping"),
    ("walls", LINKS[1], "impacts"),
)
_NAMES = {
    "youngs_modulus": "Young's modulus",
    "density": "density",
    "damping_time": "damping",
    "susceptibility": "susceptibility",
    "friction": "friction",
    "coil_outer": "radius of the coils",
    "coil_clearance": "clearance of the coils",
}


def rod_motion(result: Result) -> Figure:
    """Plot shapes over a repeat of the pattern (left), displacement and energy balance (right)."""
    drawn = sheet(7.1, 5.6, 8.2)
    if narrow():
        shapes, way, work = drawn.subplots(3, height_ratios=(2.6, 1, 1))
    else:
        grid = drawn.add_gridspec(2, 2, width_ratios=(1, 1.05))
        shapes = drawn.add_subplot(grid[:, 0])
        way, work = drawn.add_subplot(grid[0, 1]), drawn.add_subplot(grid[1, 1])
    work.sharex(way)
    _snapshots(shapes, result)
    time = result["time"].values
    way.plot(time, 1e3 * result["centre"].values, color="black")
    way.set_ylabel("mean position (mm)")
    way.tick_params(labelbottom=False)
    for (name, colour, text), dashes in zip(_WORKS, DASHES, strict=True):
        work.plot(time, 1e3 * result[f"work_{name}"].values, color=colour, linestyle=dashes,
                  label=f"work of {text}")  # fmt: skip
    work.set_xlabel("time $t$ (s)")
    work.set_ylabel("work on the rod (mJ)")
    entries = [
        Patch(color=_LIT, label="coil on"),
        Patch(color=_COIL, label="coil off"),
        line("force of a wall", RED),
        *work.get_lines(),
    ]
    legend_below(drawn, entries)
    tell(
        drawn,
        "coils on alternate sides, assumed; their pattern moves to the right",
        fact(result, "velocity_mean", "mean velocity", "mm s-1"),
        fact(result, "velocity_error", "its 95 % interval ±", "mm s-1"),
        fact(result, "energy_error", "energy error", "%"),
        fact(result, "pressed_max", "largest wall force", "mN"),
    )
    return drawn


def _snapshots(axes: Axes, result: Result) -> None:
    """Draw channel and rod at equal times over one repeat of the pattern, time downward."""
    frames = result["frame"].values
    chosen = np.linspace(len(frames) // 2, len(frames) - 1, _SNAPSHOTS).astype(int)
    lanes = 2.3 * needed(result, "channel") * 1e3
    low, high = _reach(result, chosen)
    for k, frame in enumerate(chosen):
        _scene(axes, result, int(frame), -k * lanes, (low, high))
        axes.text(
            high, -k * lanes, f" {frames[frame]:.3f} s", va="center",
            color=GREY, fontsize=7.5,
        )  # fmt: skip
    axes.set_xlim(low, high)
    axes.set_ylim(-(len(chosen) - 0.4) * lanes, 0.6 * lanes)
    axes.set_aspect("equal", adjustable="box")
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("position $x$ (mm)")


def _reach(result: Result, frames: np.ndarray) -> tuple[float, float]:
    """Return the range of positions to draw, in mm."""
    x, pitch = result["rod_x"].values[frames], needed(result, "pitch")
    return 1e3 * (x.min() - 0.8 * pitch), 1e3 * (x.max() + 0.8 * pitch)


def _scene(
    axes: Axes, result: Result, frame: int, height: float, reach: tuple[float, float]
) -> None:
    """Draw walls, coils and rod of one frame, the middle of the channel at a height, in mm."""
    known = result.attributes
    half, pitch = 5e2 * known["channel"], 1e3 * known["pitch"]
    _, outer, length, clearance = (1e3 * size for size in known["coil"])
    first, count = result["first_coil"].values[frame], result["coils_on"].values[frame]
    shown = min(length, 0.5 * half)
    for k in range(int(reach[0] // pitch) - 1, int(reach[1] // pitch) + 2):
        side = 1 if k % 2 == 0 else -1
        lit = (k - first) % known["every"] < count
        base = height + side * (half + clearance) - (shown if side < 0 else 0)
        axes.add_patch(
            Rectangle((k * pitch - outer, base), 2 * outer, shown, linewidth=0,
                      facecolor=_LIT if lit else _COIL)
        )  # fmt: skip
    for wall in (-half, half):
        axes.axhline(height + wall, color="black", linewidth=1)
    x, y = (1e3 * result[f"rod_{name}"].values[frame] for name in "xy")
    angle, radius = result["rod_angle"].values[frame], 5e2 * known["body"]
    for part, colour in zip((slice(None, len(x) // 2 + 1), slice(len(x) // 2, None)), _BODY,
                            strict=True):  # fmt: skip
        across = radius * np.array([-np.sin(angle[part]), np.cos(angle[part])])
        rim = np.hstack([
            [x[part] + across[0], y[part] + across[1]],
            [(x[part] - across[0])[::-1], (y[part] - across[1])[::-1]],
        ])  # fmt: skip
        axes.fill(rim[0], height + rim[1], color=colour, linewidth=0, zorder=2)
    _forces(axes, result, frame, height, half)


def _forces(axes: Axes, result: Result, frame: int, height: float, half: float) -> None:
    """Draw wall forces on the rod as lines outside the channel."""
    largest = max(result[f"pressed_{wall}"].values.max() for wall in ("upper", "lower"))
    x, lines = 1e3 * result["rod_x"].values[frame], []
    for wall, side in (("upper", 1), ("lower", -1)):
        pressed = result[f"pressed_{wall}"].values[frame]
        for place, force in zip(x, pressed, strict=True):
            if force > 0:
                base = height + side * half
                lines.append([(place, base), (place, base + side * half * force / largest)])
    axes.add_collection(LineCollection(lines, colors=RED, linewidths=1.1, zorder=3))


def first_frame(result: Result) -> Figure:
    """Plot the rod in its channel at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 2.5, 1.45)
    drawn.subplots()
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Change the figure of `first_frame` to show a frame, 0 to ``FRAMES - 1``."""
    axes = drawn.axes[0]
    axes.clear()
    time = result["frame"].values
    reach = _reach(result, np.arange(len(time)))
    _scene(axes, result, frame, 0.0, reach)
    size = 1.7e3 * needed(result, "channel")
    axes.set_xlim(reach)
    axes.set_ylim(-size / 1.6, size / 1.6)
    axes.set_aspect("equal", adjustable="box")
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.set_xlabel(label("position $x$", "mm"))
    axes.set_title(f"$t$ = {time[frame]:.3f} s")


def rod_frequency(result: Result) -> Figure:
    """Plot velocity over frequency with natural frequencies and marks; below, sensitivities."""
    known = "changed_velocity" in result
    drawn = sheet(7.1, 6.6 if known else 4.0, 7.4 if known else 4.4)
    tell(
        drawn,
        fact(result, "frequency_best", "fastest at"),
        fact(result, "velocity_best", "highest velocity", "mm s-1"),
    )
    rates = result["sensitive_rate"].values if known else ()
    grid = drawn.add_gridspec(2, len(rates), height_ratios=(1.3, 1)) if known else None
    above = drawn.add_subplot(grid[0, :]) if grid else drawn.subplots()
    _curve(above, result)
    first = None
    for k, rate in enumerate(rates):
        axes = drawn.add_subplot(grid[1, k], sharey=first, sharex=first) if grid else above
        first = first or axes
        _tornado(axes, result, k, rf"{rate:g} switches s$^{{-1}}$")
    legend_below(drawn)
    return drawn


def _curve(axes: Axes, result: Result) -> None:
    """Draw the mean velocity against the field's travel, in mm/s, with its 95 % interval."""
    rate, velocity = result["curve_rate"].values, -1e3 * result["curve_velocity"].values
    known = np.vstack([rate, velocity])
    if "refined_rate" in result:
        near = result["refined_rate"].values, -1e3 * result["refined_velocity"].values
        known = np.hstack([known, near])
    known = known[:, np.argsort(known[0])]
    slope = -1e3 * float(needed(result, "velocity_per_frequency_slow"))
    best = -1e3 * float(scalar(result, "pattern_velocity") or np.nan)
    top = 1.25 * np.nanmax([*known[1], best])
    natural = _natural(result)
    told = f"natural frequencies: {', '.join(map('{:.3g}'.format, natural))} Hz"
    for value in natural:
        axes.axvline(value, color="#BBBBBB", linewidth=0.8, linestyle=(0, (2, 2)), label=told)
    slow = np.geomspace(rate[0], max(top / slope, rate[0]) if slope > 0 else rate[-1])
    axes.plot(
        slow,
        slope * slow,
        color=GREY,
        linewidth=1,
        linestyle=DASHES[1],
        label=f"slow limit: {number(slope, 3)} mm per switch",
    )
    axes.axhline(0, color="black", linewidth=0.8)
    axes.plot(*known, color=LINKS[0], linewidth=1.1)
    bars: dict[str, Any] = {"fmt": "o", "capsize": 2.5, "linewidth": 1, "markersize": 3}
    axes.errorbar(rate, velocity, 1e3 * result["curve_error"].values, color=LINKS[0],
                  label="simulated, 95 % intervals", **bars)  # fmt: skip
    if "refined_rate" in result:
        axes.errorbar(
            result["refined_rate"].values, -1e3 * result["refined_velocity"].values,
            1e3 * result["refined_error"].values, color=LINKS[2], label="simulated near the best",
            **bars,
        )  # fmt: skip
    if scalar(result, "pattern_rate") is not None:
        axes.plot(scalar(result, "pattern_rate"), best, "*", color=LINKS[1], markersize=9,
                  label=rf"best pattern: {number(best, 3)} mm s$^{{-1}}$")  # fmt: skip
    for (where, speed, text), mark in zip(
        result.attributes.get("measured", []), ("s", "x", "D", "^", "v", "P") * 5, strict=False
    ):
        axes.plot(where, 1e3 * speed, mark, color=RED, markersize=5, label=text)
    axes.set_xscale("log")
    axes.set_ylim(top=top)
    axes.set_xlabel("coil switches per second $n$ (s$^{-1}$)")
    axes.set_ylabel("velocity against\nthe field (mm s$^{-1}$)")


def _natural(result: Result) -> list[float]:
    found = scalar(result, "eigenfrequencies") or []
    return [float(value) for value in found]


def _tornado(axes: Axes, result: Result, column: int, title: str) -> None:
    """Draw bars from the unchanged velocity to the velocities with each parameter changed."""
    changed = -1e3 * result["changed_velocity"].values[:, :, column]
    factors = result["changed_factor"].values[:, :, column]
    plain = -1e3 * float(result["unchanged_velocity"].values[column])
    error = 1e3 * float(result["unchanged_error"].values[column])
    names = [str(name) for name in needed(result, "parameters")]
    axes.axvspan(plain - error, plain + error, color="#EFEFEF", linewidth=0,
                 label="unchanged, with its error")  # fmt: skip
    axes.axvline(plain, color=GREY, linewidth=0.8)
    for row, (speeds, shares) in enumerate(zip(changed, factors, strict=True)):
        for speed, share in zip(speeds, shares, strict=True):
            more = share > 1
            axes.barh(row + (0.18 if more else -0.18), speed - plain, 0.34, plain, linewidth=0,
                      color=LINKS[3] if more else LINKS[0], hatch="////" if more else None,
                      edgecolor="white",
                      label=f"parameter {'raised' if more else 'lowered'}")  # fmt: skip
    shown = [
        f"{_NAMES.get(name, name)}\n×" + ", ×".join(f"{share:.3g}" for share in shares)
        for name, shares in zip(names, factors, strict=True)
    ]
    axes.set_yticks(range(len(names)), shown)
    axes.set_ylim(len(names) - 0.4, -0.7)
    if column:
        axes.tick_params(labelleft=False)
    else:
        axes.set_ylabel("changed parameter")
    axes.set_xlabel("velocity (mm s$^{-1}$)")
    axes.set_title(title)
    axes.margins(x=0.14)
