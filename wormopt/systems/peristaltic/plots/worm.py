"""Plots of a peristaltic worm: its body as it swells and thins, its path, and its energies."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

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
    legend_below,
    line,
    needed,
    number,
    shades,
    sheet,
    tell,
)
from wormopt.result import Result
from wormopt.systems.peristaltic.plots.parts import (
    OFF,
    ON,
    THICK,
    draw_segment,
    glow,
    shade,
    without_heights,
)

FRAMES = 144
_SNAPSHOTS = 8
_WORKS = (
    ("coil", LINKS[0], "coils"),
    ("friction", RED, "dry friction"),
    ("drag", LINKS[3], "drag"),
    ("damping", LINKS[2], "dashpots"),
    ("load", LINKS[1], "load"),
)


def worm(result: Result) -> Figure:
    """Plot the body just before each switch of the last cycle, in its coils and its tube."""
    chosen = _snapshots(result)
    lanes = 3.9e3 * needed(result, "radius")
    reach = _reach(result, chosen)
    shape = len(chosen) * lanes / (reach[1] - reach[0])
    drawn = sheet(7.1, 6.2 * shape + 1.2, 2.8 * shape + 1.4)
    axes = drawn.subplots()
    for k, instant in enumerate(chosen):
        _body(axes, result, int(instant), -k * lanes, reach)
        axes.text(reach[1], -k * lanes, f" {result['time'].values[instant]:.3g} s", va="center",
                  color=GREY, fontsize=7.5)  # fmt: skip
    _frame(axes, reach, (-(len(chosen) - 0.45) * lanes, 0.55 * lanes))
    legend_below(drawn, _entries(result))
    tell(
        drawn,
        f"deformation and displacement enlarged {number(_times(result))} times",
        fact(result, "advance", "advance per cycle", "mm"),
        fact(result, "slip", "slip per cycle", "mm"),
    )
    return drawn


def course(result: Result) -> Figure:
    """Plot positions of the rings, forces of the wall or lengths, and the balance of works."""
    drawn = sheet(7.1, 5.6, 7.6)
    way, middle, work = drawn.subplots(3, sharex=True)
    time, x = result["time"].values, result["position"].values
    for ring, colour in zip(x, shades(MASSES, len(x)), strict=True):
        way.plot(time, 1e3 * (ring - ring[0]), color=colour, linewidth=1)
    way.set_ylabel("position of rings\n(mm)")
    legend(way, handles("ring", len(x), worm=False))
    pressed = result["normal_force"].values
    walled = pressed.max() > 0
    shown = 1e3 * pressed if walled else result["stretch"].values
    for row, colour in zip(shown, shades(LINKS[:4], len(shown)), strict=True):
        middle.plot(time, row, color=colour, linewidth=1)
    middle.set_ylabel("force of the wall\n(mN)" if walled else "stretch $l/L$")
    colours = shades(LINKS[:4], len(shown))
    legend(middle, [line(f"segment {j}", colour) for j, colour in enumerate(colours)][:9])
    for (name, colour, words), dashes in zip(_WORKS, (*DASHES, "-"), strict=True):
        done = result[f"work_{name}"].values
        if np.any(done):
            work.plot(time, 1e6 * done, color=colour, linestyle=dashes, label=words)
    work.plot(time, 1e6 * (result["stored"].values - result["stored"].values[0]), color="black",
              linewidth=0.8, label="stored")  # fmt: skip
    work.set_ylabel("work on the worm\n(µJ)")
    work.set_xlabel("time $t$ (s)")
    legend(work)
    tell(
        drawn,
        fact(result, "speed", "mean speed", "mm s-1"),
        fact(result, "advance_share", "share of ideal advance", "%"),
        fact(result, "holding_reserve", "holding reserve", "%"),
        fact(result, "energy_error", "energy error"),
    )
    return drawn


def first_frame(result: Result) -> Figure:
    """Plot the worm in its coils at the start of the animation, for `pose` to change."""
    drawn = sheet(7.1, 2.1, 1.6)
    drawn.subplots()
    pose(drawn, result, 0)
    return drawn


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Change the figure of `first_frame` to show a frame, 0 to ``FRAMES - 1``."""
    axes = drawn.axes[0]
    axes.clear()
    chosen = _instants(result, FRAMES, cycles=2)
    reach, half = _reach(result, chosen), 1.9e3 * needed(result, "radius")
    _body(axes, result, int(chosen[frame]), 0.0, reach)
    _frame(axes, reach, (-half, half))
    axes.set_title(
        f"$t$ = {result['time'].values[chosen[frame]]:.2f} s; deformation and displacement "
        f"enlarged {number(_times(result))} times"
    )


# -- the body ------------------------------------------------------------------------------------


def _snapshots(result: Result) -> np.ndarray:
    """Return samples of the last cycle, just before each switch or at equal times."""
    steps = needed(result, "steps")
    count = steps if steps > 1 else _SNAPSHOTS
    return _instants(result, 20 * count + 1, cycles=1)[19::20]


def _instants(result: Result, count: int, *, cycles: int) -> np.ndarray:
    """Return samples at equal times over the last cycles."""
    time = result["time"].values
    since = max(time[-1] - cycles * needed(result, "period"), time[0])
    return np.searchsorted(time, np.linspace(since, time[-1], count) - 1e-9 * time[-1])


def _times(result: Result) -> float:
    """Return the factor that enlarges deformation and displacement: to a quarter of the radius."""
    radii = result["stretch"].values ** -0.5 - 1
    return float(f"{max(0.25 / max(np.abs(radii).max(), 1e-6), 1.0):.0e}")


def _places(result: Result) -> np.ndarray:
    """Return the drawn positions of the rings (rings, times), in mm."""
    x, times = result["position"].values, _times(result)
    return 1e3 * (x[:, :1] + times * (x - x[:, :1]))


def _reach(result: Result, instants: np.ndarray) -> tuple[float, float]:
    x, more = _places(result)[:, instants], 5e2 * needed(result, "length")
    return float(x.min() - more), float(x.max() + more)


def _body(
    axes: Axes, result: Result, instant: int, height: float, reach: tuple[float, float]
) -> None:
    """Draw segments, coils, anchors and tube at one instant, with the axis at a height in mm."""
    times, radius = _times(result), 1e3 * needed(result, "radius")
    x, stretch = _places(result)[:, instant], result["stretch"].values[:, instant]
    radii = radius * (1 + times * (stretch**-0.5 - 1))
    most = 1 - result["stretch"].values.min()
    lit = result["current"].values[:, instant] / needed(result, "current")
    tube = result.attributes["tube"]
    if tube:
        wall = radius + times * (1e3 * tube - radius)
        for side in (-1, 1):
            axes.plot(reach, [height + side * wall] * 2, color="black", linewidth=1)
    rim = 1.36 * radius
    for j, swollen in enumerate(radii):
        colour = shade((1 - stretch[j]) / most)
        draw_segment(axes, (x[j + 1], x[j]), (0.8 * radius, swollen), height, facecolor=colour)
        wide = needed(result, "coil_share") * (x[j] - x[j + 1])
        for base in (height + rim, height - rim - 0.16 * radius):
            axes.add_patch(
                Rectangle(((x[j] + x[j + 1] - wide) / 2, base), wide, 0.16 * radius, linewidth=0,
                          facecolor=glow(lit[j] ** 2))
            )  # fmt: skip
    _anchors(axes, result, instant, x, height - rim - 0.32 * radius)


def _anchors(axes: Axes, result: Result, instant: int, x: np.ndarray, base: float) -> None:
    """Mark resting contacts below: filled if the wall presses, empty if only weight does."""
    resting = result["resting"].values[:, instant] > 0
    pressed = result["normal_force"].values[:, instant] > 0
    spots = (x[:-1] + x[1:]) / 2
    if needed(result, "anchoring") == "clamp":
        spots, pressed = x, np.append(pressed, False) | np.append(False, pressed)
    for which, face in ((resting & pressed, RED), (resting & ~pressed, "white")):
        axes.plot(spots[which], np.full(which.sum(), base), "^", color=RED, markersize=3.8,
                  markerfacecolor=face, markeredgewidth=0.7)  # fmt: skip


def _frame(axes: Axes, reach: tuple[float, float], heights: tuple[float, float]) -> None:
    axes.set_xlim(reach)
    axes.set_ylim(heights)
    axes.set_aspect("equal", adjustable="box")
    without_heights(axes)
    axes.set_xlabel(label("drawn position $x$", "mm"))


def _entries(result: Result) -> list[Artist]:
    found: list[Artist] = [
        Patch(color=ON, label="coil that is on"),
        Patch(color=OFF, label="coil that is off"),
        Patch(color=THICK, label="short and thick"),
    ]
    light = line("rests by its weight", RED, "none", marker="^")
    light.set_markerfacecolor("white")
    pressed = line("rests, pressed to the wall", RED, "none", marker="^")
    return [*found, *([pressed] if result.attributes["tube"] else []), light]
