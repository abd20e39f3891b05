"""Pictures of magnetisable bodies and rods in a channel."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GREY,
    LINKS,
    RED,
    line,
    number,
    patch,
    raised,
)
from wormopt.result import Result

_UNITS = ("mm", "mm s-1", "mN", "mJ")
# Colours of shapes by their order.
_COLOURS = (*LINKS[:3], "#CC79A7", "#56B4E9", "#882255")
_MARKERS = "osD^v"
_ASSUMED = ((0, (5, 2)), (0, (2, 1.2)), (0, (1, 1)))  # dashes of assumed shapes
_WIDER = 1.6
_ACTIVE, _BEYOND = "#F1D9BF", 0.55  # active coils, drawn beyond the channel by this share of it
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
    "damping_time": "damping",
    "coil_outer": "radius of the coils",
    "coil_clearance": "clearance of the coils",
}


# -- a body between coils --------------------------------------------------------------------------


def channel_velocity(result: Result) -> Figure:
    """Plot velocity over coil frequency, in closed form and measured; both axes logarithmic."""
    page = Page(result, 4.4, 4.4, _UNITS)
    panel, per = page.panel(), result["velocity_per_frequency"].value
    for k, name in enumerate(page["shapes"]):
        panel.curve("frequency", "velocity", f"{name}: {number(1e3 * per[k])} mm per switch",
                    pick=k, words="velocity $v$", color=_COLOURS[k], ls=DASHES[k % 4])  # fmt: skip
    panel.axes.margins(x=0.05)
    marks = zip(*(page[f"measured{end}"] for end in ("", "_frequency", "_velocity")), strict=True)
    for k, (text, at, measured) in enumerate(marks):
        unit = f"{number(measured)}\N{NO-BREAK SPACE}{raised('mm s-1')}"
        panel.curve(at, measured, f"{text}: {unit}", marker=_MARKERS[k % 5], ls="none", color=RED,
                    zorder=3, mfc="none" if k else RED)  # fmt: skip
    panel.axes.set(xscale="log", yscale="log")
    valid_below, stops_above = page.get("valid_below"), page.get("stops_above")
    low, high = panel.axes.get_xlim()
    if stops_above is not None:
        high = max(high, _WIDER * stops_above)
    if valid_below is not None:
        panel.axes.axvspan(valid_below, high, color="#EEEEEE", zorder=0,
                           label=f"eq. 32 not valid: $n \\geq$ {valid_below:g}")  # fmt: skip
    if stops_above is not None:
        panel.level(stops_above, f"stands still above {stops_above:g}, from the text", axis="x",
                    lw=0.9)  # fmt: skip
    panel.axes.set_xlim(low, high)
    panel.named("x", "frequency", "coil switches per second $n$")
    page.facts("the body moves against the field", "eq. 32 (WLLS), inertia neglected")
    return page.legend()


# -- shapes of a segment ---------------------------------------------------------------------------


def segment_shapes(result: Result) -> Figure:
    """Plot centre lines of a segment between the walls, and the distances between them.

    The channel is above, at equal scales. Below are distances from one exact shape: from the rod,
    if there is one, which is then also drawn as a whole.
    """
    rod = "rod_x" in result
    page = Page(result, 5.2, 6.4 if rod else 4.4, _UNITS)
    names, exact = page["shapes"], page["exact"] == 1
    # of two drawings to scale that are equally high
    widths = [np.ptp(page["x"]) / 1.12, np.ptp(page["rod_x"]) / (1 + 2 * _BEYOND)] if rod else None
    panels = page.mosaic(
        "AR;DD" if rod else "A;D", "A;R;D" if rod else "A;D", (1.5, 1),
        (1.6, 1.1, 1) if rod else (1.5, 1), widths,
    )  # fmt: skip
    above, below = panels["A"], panels["D"]
    first = len(names) - 1 if rod else int(np.argmax(exact))
    x, y, wide, thick = (page[name] for name in ("x", "y", "channel", "body"))
    words = [name.replace("_", " ") for name in names]
    beyond = 0.06 * wide
    above.axes.axhspan(-beyond, 0, color="#BBBBBB")
    above.axes.axhspan(wide, wide + beyond, color="#BBBBBB", label="wall")
    _body(above, x[first], y[first], page["theta"][first], thick, f"body, {words[first]}")
    apart = np.hypot(x - x[first], y - y[first])
    for k, name in enumerate(words):
        dashes = DASHES[k % 4] if exact[k] else _ASSUMED[k % 3]
        kind = "assumed" if not exact[k] else "in the field" if name == "rod" else "elastica"
        above.curve(x[k], y[k], f"{name} ({kind}): {number(page['arc_length'][k])} mm",
                    color=_COLOURS[k % 6], lw=1.4 if exact[k] else 1, ls=dashes)  # fmt: skip
        if k != first:
            below.curve("share", apart[k], color=_COLOURS[k % 6], lw=1.2, ls=dashes)
    above.axes.set(xlim=(x[first][0], x[first][-1]), ylim=(-beyond, wide + beyond))
    above.axes.set_aspect("equal", adjustable="box")
    above.label("position along the channel $x$ (mm)", "height $y$ (mm)")
    below.label("share of the segment's length ($s/l_s$)", f"distance from {words[first]} (mm)")
    below.axes.set_ylim(bottom=0)
    if rod:
        _rod(panels["R"])
    page.facts(f"channel diameter {wide:g} mm", f"body diameter {thick:g} mm", *_nearest(page))
    return page.legend()


def _rod(panel: Panel) -> None:
    """Draw the whole rod at rest, active coils, and wall forces."""
    page, axes = panel.page, panel.axes
    wide, radius, count = page["channel"], page["body"] / 2, page["coils_on"]
    pitch, clearance, outer = map(page.length, ("pitch", "coil_clearance", "coil_outer"))
    # nodes represent different lengths, so the drawn forces are forces per length
    share = _raw(page, "rod_node_length")
    forces = {wall: _raw(page, f"rod_force_{wall}_at") / share for wall in ("upper", "lower")}
    largest = max(float(part.max()) for part in forces.values()) or 1.0
    reach = _BEYOND * wide
    for k in range(count):
        place = pitch * (k - (count - 1) / 2)
        base = wide + clearance if k % 2 == 0 else -reach
        axes.add_patch(Rectangle((place - outer, base), 2 * outer, reach - clearance, color=_ACTIVE,
                                 label=None if k else "active coils"))  # fmt: skip
        panel.level(place, axis="x", ls=(0, (3, 3)))
    for wall in (0.0, wide):
        panel.level(wall, color="black", ls="-", lw=1)
    x, y = page["rod_x"], page["rod_y"]
    _body(panel, x, y, page["rod_angle"], 2 * radius, "body, rod")
    panel.curve(x, y, color=_COLOURS[5])
    for wall, base, side in (("upper", wide, 1), ("lower", 0.0, -1)):
        text = f"wall forces, up to {number(largest)} {raised('N m-1')}" if side > 0 else None
        _forces(panel, x, forces[wall], base, side * 0.9 * reach / largest, label=text)
    panel.scenery()
    axes.set(xlim=(x.min() - 2 * radius, x.max() + 2 * radius), ylim=(-reach, wide + reach))
    panel.label("position along the channel\nfrom the middle of the block (mm)", "height $y$ (mm)")
    page.facts(f"rod at rest at {page['assumed_ampere_turns']:g} ampere-turns",
               rod_force_upper="force of the upper wall",
               rod_force_lower="force of the lower wall")  # fmt: skip


def _raw(page: Page, name: str) -> np.ndarray:
    """Values of a variable in its own unit."""
    return page.result[name].values


def _body(
    panel: Panel, x: np.ndarray, y: np.ndarray, angle: np.ndarray, thick: float, text: str
) -> None:
    """Draw both sides of the body, half its thickness from the centre line."""
    panel.axes.fill(*_outline(x, y, angle, thick), color="#F3E3C3", linewidth=0, label=text)


def _outline(x: np.ndarray, y: np.ndarray, angle: np.ndarray, thick: float) -> np.ndarray:
    """Return the outline of a body from its centre line and the angles of its sections."""
    across = thick / 2 * np.array([-np.sin(angle), np.cos(angle)])
    middle = np.array([x, y])
    return np.hstack([middle + across, (middle - across)[:, ::-1]])


def _nearest(page: Page) -> list[str]:
    rows = (page[name] for name in ("exact_shapes", "closest_shape", "closest_distance"))
    return [
        f"closest to {exact.replace('_', ' ')}: "
        + (f"{name}, {number(apart, 3)} mm" if name else "not from wall to wall")
        for exact, name, apart in zip(*rows, strict=True)
    ]


# -- a rod that switched coils move ----------------------------------------------------------------


def rod_motion(result: Result) -> Figure:
    """Plot shapes over a repeat of the pattern (left), displacement and energy balance (right)."""
    page = Page(result, 5.6, 8.2, _UNITS)
    panels = page.mosaic("SP;SW", "S;P;W", (1, 1), (2.6, 1, 1))
    shapes, place, work = (panels[name] for name in "SPW")
    work.axes.sharex(place.axes)
    _snapshots(shapes)
    place.curve(page["time"], "centre", color="black", words="mean position")
    place.axes.tick_params(labelbottom=False)
    for (name, color, text), dashes in zip(_WORKS, DASHES, strict=True):
        work.curve(page["time"], f"work_{name}", f"work of {text}", words="work on the rod",
                   color=color, ls=dashes)  # fmt: skip
    work.named("x", "time")
    shapes.entries += [
        patch("coil on", _LIT),
        patch("coil off", _COIL),
        line("force of a wall", RED),
    ]
    page.facts(
        "coils on alternate sides, assumed; their pattern moves to the right",
        velocity_mean="mean velocity", velocity_error="its 95 % interval ±",
        energy_error=("", "%"), pressed_max="largest wall force",
    )  # fmt: skip
    return page.legend()


def _snapshots(panel: Panel) -> None:
    """Draw channel and rod at equal times over one repeat of the pattern, time downward."""
    page, frames = panel.page, panel.page["frame"]
    chosen = np.linspace(len(frames) // 2, len(frames) - 1, _SNAPSHOTS).astype(int)
    lanes = 2.3 * page.length("channel")
    low, high = _reach(page, chosen)
    for k, frame in enumerate(chosen):
        _scene(panel, int(frame), -k * lanes, (low, high))
        panel.axes.text(high, -k * lanes, f" {frames[frame]:.3f} s", va="center", color=GREY,
                        fontsize=7.5)  # fmt: skip
    panel.axes.set(xlim=(low, high), ylim=(-(len(chosen) - 0.4) * lanes, 0.6 * lanes))
    panel.scenery(heights=False)
    panel.label("position $x$ (mm)")


def _reach(page: Page, frames: np.ndarray) -> tuple[float, float]:
    """Return the range of positions to draw, in mm."""
    x, pitch = page["rod_x"][frames], page.length("pitch")
    return x.min() - 0.8 * pitch, x.max() + 0.8 * pitch


def _scene(panel: Panel, frame: int, height: float, reach: tuple[float, float]) -> None:
    """Draw walls, coils and rod of one frame, the middle of the channel at a height, in mm."""
    page, axes = panel.page, panel.axes
    half, pitch = page.length("channel") / 2, page.length("pitch")
    _, outer, length, clearance = page.length("coil")
    first, count = page["first_coil"][frame], page["coils_on"][frame]
    shown = min(length, 0.5 * half)
    for k in range(int(reach[0] // pitch) - 1, int(reach[1] // pitch) + 2):
        side = 1 if k % 2 == 0 else -1
        lit = (k - first) % page["every"] < count
        base = height + side * (half + clearance) - (shown if side < 0 else 0)
        axes.add_patch(Rectangle((k * pitch - outer, base), 2 * outer, shown, linewidth=0,
                                 facecolor=_LIT if lit else _COIL))  # fmt: skip
    for wall in (-half, half):
        panel.level(height + wall, color="black", ls="-", lw=1)
    x, y, angle = (page[f"rod_{name}"][frame] for name in ("x", "y", "angle"))
    halves = slice(None, len(x) // 2 + 1), slice(len(x) // 2, None)
    for part, color in zip(halves, _BODY, strict=True):
        rim = _outline(x[part], height + y[part], angle[part], page.length("body"))
        axes.fill(*rim, color=color, linewidth=0, zorder=2)
    pressed = {wall: page[f"pressed_{wall}"] for wall in ("upper", "lower")}
    largest = max(forces.max() for forces in pressed.values())
    for wall, side in (("upper", half), ("lower", -half)):
        _forces(panel, x, pressed[wall][frame], height + side, side / largest, zorder=3)


def _forces(
    panel: Panel, x: np.ndarray, forces: np.ndarray, wall: float, scale: float, **style: Any
) -> None:
    """Draw forces of a wall on a rod as lines outside the channel."""
    lines = [
        [(place, wall), (place, wall + scale * force)]
        for place, force in zip(x, forces, strict=True)
        if force > 0
    ]
    panel.axes.add_collection(LineCollection(lines, colors=RED, linewidths=1.1, **style))


def _stage(result: Result) -> Page:
    page = Page(result, 2.5, 1.45, _UNITS)
    panel, size = page.panel(), 1.7 * page.length("channel")
    panel.axes.set(xlim=_reach(page, np.arange(len(page["frame"]))), ylim=(-size / 1.6, size / 1.6))
    panel.scenery(heights=False)
    panel.label("position $x$ (mm)")
    return page


def _pose(panel: Panel, frame: int) -> None:
    _scene(panel, frame, 0.0, panel.axes.get_xlim())
    panel.above(f"$t$ = {panel.page['frame'][frame]:.3f} s")


animation = Animation(144, _stage, _pose)


# -- velocity over the frequency of switching ------------------------------------------------------


def rod_frequency(result: Result) -> Figure:
    """Plot velocity over frequency with natural frequencies and marks; below, sensitivities."""
    known = "changed_velocity" in result
    page = Page(result, 6.6 if known else 4.0, 7.4 if known else 4.4, _UNITS)
    page.facts(frequency_best="fastest at", velocity_best="highest velocity")
    rates = page["sensitive_rate"] if known else ()
    grid = page.drawn.add_gridspec(2, len(rates), height_ratios=(1.3, 1)) if known else None
    _curve(page.panel(grid[0, :] if grid else None))
    below = [page.panel(grid[1, k]) for k in range(len(rates))] if grid else []
    for k, panel in enumerate(below):
        if k:
            panel.axes.sharey(below[0].axes)
            panel.axes.sharex(below[0].axes)
        _tornado(panel, k, rf"{rates[k]:g} switches s$^{{-1}}$")
    return page.legend()


def _curve(panel: Panel) -> None:
    """Draw the mean velocity against the field's travel, in mm/s, with its 95 % interval."""
    page = panel.page
    sets = [(name, LINKS[color], text) for name, color, text in (
        ("curve", 0, "simulated, 95 % intervals"), ("refined", 2, "simulated near the best")
    ) if f"{name}_rate" in page]  # fmt: skip
    known = np.hstack([[page[f"{name}_rate"], -page[f"{name}_velocity"]] for name, *_ in sets])
    known = known[:, np.argsort(known[0])]
    rate = page["curve_rate"]
    slope = -1e3 * float(page.result.scalars["velocity_per_frequency_slow"].value)
    best = -(page.get("pattern_velocity") or np.nan)
    top = 1.25 * np.nanmax([*known[1], best])
    natural = page.get("eigenfrequencies") or []
    listed = f"natural frequencies: {', '.join(map('{:.3g}'.format, natural))} Hz"
    for k, value in enumerate(natural):
        panel.level(value, "" if k else listed, axis="x", color="#BBBBBB", ls=(0, (2, 2)))
    slow = np.geomspace(rate[0], max(top / slope, rate[0]) if slope > 0 else rate[-1])
    panel.curve(slow, slope * slow, f"slow limit: {number(slope, 3)} mm per switch", color=GREY,
                lw=1, ls=DASHES[1])  # fmt: skip
    panel.level(0, color="black", ls="-")
    panel.curve(*known, color=LINKS[0], lw=1.1)
    for name, color, text in sets:
        panel.axes.errorbar(
            page[f"{name}_rate"], -page[f"{name}_velocity"], page[f"{name}_error"], color=color,
            label=text, fmt="o", capsize=2.5, linewidth=1, markersize=3,
        )  # fmt: skip
    if page.get("pattern_rate") is not None:
        panel.curve(page["pattern_rate"], best, rf"best pattern: {number(best, 3)} mm s$^{{-1}}$",
                    marker="*", ls="none", color=LINKS[1], ms=9)  # fmt: skip
    for (where, speed, text), mark in zip(page.get("measured") or [], "sxD^vP" * 5, strict=False):
        panel.curve(where, 1e3 * speed, text, marker=mark, ls="none", color=RED)
    panel.axes.set_xscale("log")
    panel.axes.set_ylim(top=top)
    panel.label("coil switches per second $n$ (s$^{-1}$)",
                "velocity against the field (mm s$^{-1}$)")  # fmt: skip


def _tornado(panel: Panel, column: int, title: str) -> None:
    """Draw bars from the unchanged velocity to the velocities with each parameter changed."""
    page, axes = panel.page, panel.axes
    changed, factors = -page["changed_velocity"][:, :, column], page["changed_factor"][:, :, column]
    plain, error = -page["unchanged_velocity"][column], page["unchanged_error"][column]
    axes.axvspan(plain - error, plain + error, color="#EFEFEF", linewidth=0,
                 label="unchanged, with its error")  # fmt: skip
    panel.level(plain, axis="x", ls="-")
    for row, (speeds, shares) in enumerate(zip(changed, factors, strict=True)):
        for speed, share in zip(speeds, shares, strict=True):
            more = share > 1
            axes.barh(row + (0.18 if more else -0.18), speed - plain, 0.34, plain, linewidth=0,
                      color=LINKS[3] if more else LINKS[0], hatch="////" if more else None,
                      edgecolor="white",
                      label=f"parameter {'raised' if more else 'lowered'}")  # fmt: skip
    shown = [
        f"{_NAMES.get(name, name)}\n×" + ", ×".join(f"{share:.3g}" for share in shares)
        for name, shares in zip(page["parameters"], factors, strict=True)
    ]
    axes.set_yticks(range(len(shown)), shown)
    axes.set_ylim(len(shown) - 0.4, -0.7)
    axes.tick_params(labelleft=not column)
    panel.label("velocity (mm s$^{-1}$)", None if column else "changed parameter")
    axes.set_title(title)
    axes.margins(x=0.14)
