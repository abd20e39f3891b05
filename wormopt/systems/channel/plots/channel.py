"""Plots of magnetisable bodies in a channel."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    legend_below,
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
_COIL = "#F1D9BF"


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
        face, told = (
            "none" if k else RED,
            f"{text}: {number(1e3 * measured)}\N{NO-BREAK SPACE}{raised('mm s-1')}",
        )
        axes.plot(at, 1e3 * measured, _MARKERS[k % 5], color=RED, markersize=5, zorder=3,
                  markerfacecolor=face, label=told)  # fmt: skip
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
        told = None if k else "active coils"
        axes.add_patch(Rectangle((place - outer, base), 2 * outer, tall, color=_COIL, label=told))
        axes.axvline(place, color=GREY, linewidth=0.8, linestyle=(0, (3, 3)))
    for wall in (0.0, wide):
        axes.axhline(wall, color="black", linewidth=1)
    _body(axes, x, y, result["rod_angle"].values, 2 * radius, "rod")
    axes.plot(x, y, color=_COLOURS[5])
    lines = [
        [(place, base), (place, base + side * 0.9 * reach * force / largest)]
        for wall, base, side in (("upper", wide, 1), ("lower", 0.0, -1))
        for place, force in zip(x, forces[wall], strict=True)
        if force > 0
    ]
    axes.add_collection(LineCollection(
        lines, colors=RED, linewidths=1.1,
        label=f"wall forces, up to {number(largest)} {raised('N m-1')}",
    ))  # fmt: skip
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
    across = thick / 2 * np.array([-np.sin(theta), np.cos(theta)])
    middle = np.array([x, y])
    outline = np.hstack([middle + across, (middle - across)[:, ::-1]])
    axes.fill(*outline, color="#F3E3C3", linewidth=0, label=f"body, {name.replace('_', ' ')}")


def _nearest(result: Result) -> list[str]:
    told = zip(*(needed(result, name) for name in
                 ("exact_shapes", "closest_shape", "closest_distance")), strict=True)  # fmt: skip
    return [
        f"closest to {exact.replace('_', ' ')}: "
        + (f"{name}, {number(1e3 * apart, 3)} mm" if name else "not from wall to wall")
        for exact, name, apart in told
    ]
