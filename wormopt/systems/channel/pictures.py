"""Pictures of magnetisable bodies and rods in a channel."""

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
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    line,
    narrow,
    needed,
    number,
    raised,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

# Colours of shapes by their order.
_COLOURS = (*LINKS[:3], "#CC79A7", "#56B4E9", "#882255")
_MARKERS = "osD^v"
_ASSUMED = ((0, (5, 2)), (0, (2, 1.2)), (0, (1, 1)))  # dashes of assumed shapes
_WIDER = 1.6
_ACTIVE = "#F1D9BF"
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


# -- a body between coils --------------------------------------------------------------------------


def channel_velocity(result: Result) -> Figure:
    """Plot velocity over coil frequency, in closed form and measured; both axes logarithmic.

    The range beyond the validity of the formula is grey. `result` is of kind ``channel-worm``.
    """
    drawn = sheet(7.1, 4.4, 4.4)
    axes = drawn.subplots()
    frequency, velocity = result["frequency"].values, 1e3 * result["velocity"].values
    per = [1e3 * v for v in needed(result, "velocity_per_frequency")]
    for k, name in enumerate(needed(result, "shapes")):
        axes.plot(frequency, velocity[k], color=_COLOURS[k], linestyle=DASHES[k % 4],
                  label=f"{name}: {number(per[k])} mm per switch")  # fmt: skip
    marks = zip(*(needed(result, f"measured{end}") for end in ("", "_frequency", "_velocity")),
                strict=True)  # fmt: skip
    for k, (text, at, measured) in enumerate(marks):
        axes.plot(
            at, 1e3 * measured, _MARKERS[k % 5], color=RED, markersize=5, zorder=3,
            markerfacecolor="none" if k else RED,
            label=f"{text}: {number(1e3 * measured)}\N{NO-BREAK SPACE}{raised('mm s-1')}",
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    _limits(axes, result)
    axes.set_xlabel("coil switches per second $n$ (s$^{-1}$)")
    axes.set_ylabel("velocity $v$ (mm s$^{-1}$)")
    tell(drawn, "the body moves against the field", "eq. 32 (WLLS), inertia neglected")
    legend_below(drawn)
    return drawn


def _limits(axes: Axes, result: Result) -> None:
    """Shade the range where eq. 32 is not valid; a line marks where the body is said to stop."""
    valid_below, stops_above = scalar(result, "valid_below"), scalar(result, "stops_above")
    low, high = axes.get_xlim()
    if stops_above is not None:
        high = max(high, _WIDER * stops_above)
    if valid_below is not None:
        axes.axvspan(valid_below, high, color="#EEEEEE", zorder=0,
                     label=f"eq. 32 not valid: $n \\geq$ {valid_below:g}")  # fmt: skip
    if stops_above is not None:
        axes.axvline(stops_above, color=GREY, linestyle=LIMIT, linewidth=0.9,
                     label=f"stands still above {stops_above:g}, from the text")  # fmt: skip
    axes.set_xlim(low, high)


def segment_shapes(result: Result) -> Figure:
    """Plot centre lines of a segment between the walls, and the distances between them.

    The channel is above, at equal scales. Below are distances from one exact shape: from the rod,
    if there is one, which is then also drawn as a whole.
    """
    names, exact = needed(result, "shapes"), result["exact"].values == 1
    rod = "rod_x" in result
    drawn = sheet(7.1, 5.2, 6.4 if rod else 4.4)
    if narrow() and rod:
        panels = drawn.subplot_mosaic("A;R;D", height_ratios=[1.6, 1.1, 1])
    else:
        panels = drawn.subplot_mosaic("AR;DD" if rod else "A;D", height_ratios=[1.5, 1])
    above, below = panels["A"], panels["D"]
    if rod:
        _rod(panels["R"], result)
    x, y = 1e3 * result["x"].values, 1e3 * result["y"].values
    first = len(names) - 1 if rod else int(np.argmax(exact))
    wide, thick = 1e3 * needed(result, "channel"), 1e3 * needed(result, "body")
    _walls(above, x[first], wide)
    _body(above, x[first], y[first], result["theta"].values[first], thick, names[first])
    lengths = [1e3 * length for length in needed(result, "arc_length")]
    apart = np.hypot(x - x[first], y - y[first])
    for k, name in enumerate(names):
        style = DASHES[k % 4] if exact[k] else _ASSUMED[k % 3]
        kind = "assumed" if not exact[k] else "in the field" if name == "rod" else "elastica"
        called = f"{name.replace('_', ' ')} ({kind})"
        above.plot(x[k], y[k], color=_COLOURS[k % 6], linewidth=1.4 if exact[k] else 1,
                   linestyle=style, label=f"{called}: {number(lengths[k])} mm")  # fmt: skip
        if k != first:
            below.plot(result["share"].values, apart[k], color=_COLOURS[k % 6], linewidth=1.2,
                       linestyle=style)  # fmt: skip
    above.set_xlabel("position along the channel $x$ (mm)")
    above.set_ylabel("height $y$ (mm)")
    above.set_aspect("equal", adjustable="box")
    tell(drawn, f"channel diameter {wide:g} mm", f"body diameter {thick:g} mm", *_nearest(result))
    below.set_xlabel("share of the segment's length ($s/l_s$)")
    below.set_ylabel(f"distance from\n{names[first].replace('_', ' ')} (mm)")
    below.margins(x=0)
    below.set_ylim(bottom=0)
    legend_below(drawn)
    return drawn


def _rod(axes: Axes, result: Result) -> None:
    """Draw the whole rod at rest, active coils, and wall forces."""
    known = result.attributes
    wide, radius = 1e3 * needed(result, "channel"), 5e2 * needed(result, "body")
    x, y = (1e3 * result[f"rod_{name}"].values for name in "xy")
    # nodes represent different lengths, so the drawn forces are forces per length
    share = result["rod_node_length"].values
    forces = {wall: result[f"rod_force_{wall}_at"].values / share for wall in ("upper", "lower")}
    largest = max(float(part.max()) for part in forces.values()) or 1.0
    reach = 0.55 * wide
    for k in range(known["coils_on"]):
        place = 1e3 * known["pitch"] * (k - (known["coils_on"] - 1) / 2)
        base = wide + 1e3 * known["coil_clearance"] if k % 2 == 0 else -reach
        outer, tall = 1e3 * known["coil_outer"], reach - 1e3 * known["coil_clearance"]
        axes.add_patch(Rectangle((place - outer, base), 2 * outer, tall, color=_ACTIVE,
                                 label=None if k else "active coils"))  # fmt: skip
        axes.axvline(place, color=GREY, linewidth=0.8, linestyle=(0, (3, 3)))
    for wall in (0.0, wide):
        axes.axhline(wall, color="black", linewidth=1)
    _body(axes, x, y, result["rod_angle"].values, 2 * radius, "rod")
    axes.plot(x, y, color=_COLOURS[5])
    for wall, base, side in (("upper", wide, 1), ("lower", 0.0, -1)):
        text = f"wall forces, up to {number(largest)} {raised('N m-1')}" if side > 0 else None
        _forces(axes, x, forces[wall], base, side * 0.9 * reach / largest, label=text)
    axes.set_xlim(x.min() - 2 * radius, x.max() + 2 * radius)
    axes.set_ylim(-reach, wide + reach)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("position along the channel\nfrom the middle of the block (mm)")
    axes.set_ylabel("height $y$ (mm)")
    tell(
        axes.get_figure(root=True) or Figure(),
        f"rod at rest at {needed(result, 'assumed_ampere_turns'):g} ampere-turns",
        fact(result, "rod_force_upper", "force of the upper wall", "mN"),
        fact(result, "rod_force_lower", "force of the lower wall", "mN"),
    )
    axes.grid(visible=False)


def _walls(axes: Axes, x: np.ndarray, wide: float) -> None:
    beyond = 0.06 * wide
    axes.axhspan(-beyond, 0, color="#BBBBBB")
    axes.axhspan(wide, wide + beyond, color="#BBBBBB", label="wall")
    axes.set_ylim(-beyond, wide + beyond)
    axes.set_xlim(x[0], x[-1])


def _body(
    axes: Axes, x: np.ndarray, y: np.ndarray, theta: np.ndarray, thick: float, name: str
) -> None:
    """Draw both sides of the body, half its thickness from the centre line."""
    axes.fill(*_outline(x, y, theta, thick), color="#F3E3C3", linewidth=0,
              label=f"body, {name.replace('_', ' ')}")  # fmt: skip


def _outline(x: np.ndarray, y: np.ndarray, angle: np.ndarray, thick: float) -> np.ndarray:
    """Return the outline of a body from its centre line and the angles of its sections."""
    across = thick / 2 * np.array([-np.sin(angle), np.cos(angle)])
    middle = np.array([x, y])
    return np.hstack([middle + across, (middle - across)[:, ::-1]])


def _nearest(result: Result) -> list[str]:
    names = ("exact_shapes", "closest_shape", "closest_distance")
    rows = zip(*(needed(result, name) for name in names), strict=True)
    return [
        f"closest to {exact.replace('_', ' ')}: "
        + (f"{name}, {number(1e3 * apart, 3)} mm" if name else "not from wall to wall")
        for exact, name, apart in rows
    ]


# -- a rod that switched coils move ----------------------------------------------------------------


def rod_motion(result: Result) -> Figure:
    """Plot shapes over a repeat of the pattern (left), displacement and energy balance (right)."""
    drawn = sheet(7.1, 5.6, 8.2)
    if narrow():
        shapes, place, work = drawn.subplots(3, height_ratios=(2.6, 1, 1))
    else:
        grid = drawn.add_gridspec(2, 2, width_ratios=(1, 1.05))
        shapes = drawn.add_subplot(grid[:, 0])
        place, work = drawn.add_subplot(grid[0, 1]), drawn.add_subplot(grid[1, 1])
    work.sharex(place)
    _snapshots(shapes, result)
    time = result["time"].values
    place.plot(time, 1e3 * result["centre"].values, color="black")
    place.set_ylabel("mean position (mm)")
    place.tick_params(labelbottom=False)
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
    angle = result["rod_angle"].values[frame]
    halves = slice(None, len(x) // 2 + 1), slice(len(x) // 2, None)
    for part, colour in zip(halves, _BODY, strict=True):
        rim = _outline(x[part], height + y[part], angle[part], 1e3 * known["body"])
        axes.fill(*rim, color=colour, linewidth=0, zorder=2)
    largest = max(result[f"pressed_{wall}"].values.max() for wall in ("upper", "lower"))
    for wall, side in (("upper", half), ("lower", -half)):
        pressed = result[f"pressed_{wall}"].values[frame]
        _forces(axes, x, pressed, height + side, side / largest, zorder=3)


def _forces(
    axes: Axes, x: np.ndarray, forces: np.ndarray, wall: float, scale: float, **style: Any
) -> None:
    """Draw forces of a wall on a rod as lines outside the channel."""
    lines = [
        [(place, wall), (place, wall + scale * force)]
        for place, force in zip(x, forces, strict=True)
        if force > 0
    ]
    axes.add_collection(LineCollection(lines, colors=RED, linewidths=1.1, **style))


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
    natural = scalar(result, "eigenfrequencies") or []
    listed = f"natural frequencies: {', '.join(map('{:.3g}'.format, natural))} Hz"
    for value in natural:
        axes.axvline(value, color="#BBBBBB", linewidth=0.8, linestyle=(0, (2, 2)), label=listed)
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
