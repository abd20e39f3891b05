"""Pictures of worms in the plane: bodies, forces, gaits, paths, swimmers, and a sliding block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    VARIABLES,
    colours,
    labels,
    line,
    narrow,
    patch,
    stretches,
)
from wormopt.result import Result

_SOLID, _SWEPT, _BODY = "#BDB6AC", "#DCE9F3", "#7FB2D6"
_SNAPSHOTS = 9
_NO_TURN = 1e-8  # smaller turns are rounding
_WORKS = (
    ("actuator", "actuators"),
    ("ground", "ground"),
    ("damping", "dashpots"),
    ("pull", "weight"),
    ("wall", "obstacles"),
)

# -- bodies: a result has time, places x and y of the masses, whether each is resting, and the trace
# center_x, center_y ---------------------------------------------------------------------------


def plane(result: Result) -> Figure:
    """Plot the body at equal times, resting masses filled, and the path of its mass centre."""
    page = _course(result, "centre of mass")
    page.facts(distance="distance of the centre of mass", turn="turn to the left")
    return page.drawn


def crawl(result: Result) -> Figure:
    """Plot the body at equal times of its strokes, resting masses filled, and its mean place."""
    page = _course(result, "mean of the masses")
    x, y, axes = page["x"], page["y"], page.panels[0].axes
    for i, color in enumerate(colours("mass", len(x))):
        starts = [start for start, _ in stretches(page["time"], page["resting"][i] > 0)]
        at = np.searchsorted(page["time"], starts)
        axes.plot(x[i, at], y[i, at], "o", color=color, markersize=5.5, zorder=4.5)
    turns = abs(page.get("turn") or 0.0) > _NO_TURN
    centre, radius = page.get("circle_centre"), page.get("circle_radius")
    if turns and centre and radius < 10 * np.ptp(x):
        axes.add_patch(Circle(centre, radius, fill=False, edgecolor=GREY, ls=LIMIT, lw=0.8))
    page.facts(
        page.fact("distance", "distance of the head per stroke") * ("drift" not in page),
        page.fact("turn", "turn to the left") * turns, work="",
    )  # fmt: skip
    return page.drawn


def _course(result: Result, traced: str) -> Page:
    """Plot the body at equal times, older ones fainter, resting masses filled, and a trace."""
    (left, right), (low, high) = _reach(result)
    share, count = (high - low) / (right - left), len(result["x"].values)
    tall = float(np.clip(6.0 * share + 1.3, 2.4, 7.0))
    slim = float(np.clip(3.0 * share + 0.8 + 0.08 * (count + 4), 2.0, 7.0))
    page = Page(result, tall, slim)
    panel = page.panel()
    _ground(panel)
    time = page["time"]
    for k, t in enumerate(np.linspace(time[0], time[-1], _SNAPSHOTS)):
        _draw_body(panel, t, 0.2 + 0.8 * k / (_SNAPSHOTS - 1))
    panel.curve(page["center_x"], page["center_y"], color="black", lw=0.9, zorder=5)
    panel.entries += map(line, labels("mass", count), colours("mass", count))
    panel.entry("mass held by the ground", GREY, "none", marker="o")
    panel.entry("mass moves", GREY, "none", marker="o", mfc="white")
    panel.entry(traced, "black", lw=0.9)
    if page.get("obstacles"):
        panel.entries.append(patch("obstacle", _SOLID, edgecolor=GREY, linewidth=0.6))
    page.legend()
    return page


def _reach(result: Result) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and largest x and y shown."""
    x, y = result["x"].values, result["y"].values
    for each in result.attributes.get("obstacles") or []:
        if each["shape"] == "disc":
            (a, b), r = each["centre"], each["radius"]
            x, y = np.append(x, [a - r, a + r]), np.append(y, [b - r, b + r])
    more = 0.04 * max(np.ptp(x), np.ptp(y)) + 1e-12
    half = max(np.ptp(y) / 2, 0.1 * np.ptp(x)) + more
    middle = (y.max() + y.min()) / 2
    return (float(x.min() - more), float(x.max() + more)), (middle - half, middle + half)


def _ground(panel: Panel) -> None:
    """Draw obstacles, with limits and labels of both axes, which have the same scale."""
    across, up = _reach(panel.page.result)
    panel.axes.set(xlim=across, ylim=up)
    panel.axes.set_aspect("equal", adjustable="box")
    for each in panel.page.get("obstacles") or []:
        _draw_obstacle(panel.axes, each)
    _places(panel, "position ")


def _places(panel: Panel, words: str = "") -> None:
    panel.label(f"{words}$x$", of="x")
    panel.label(y=f"{words}$y$", of="y")


def _draw_body(panel: Panel, t: float, strength: float) -> None:
    """Draw one body: the sample at `t` or the first after it."""
    page, time = panel.page, panel.page["time"]
    k = min(int(np.searchsorted(time, t - 1e-12)), len(time) - 1)
    x, y, rests = page["x"][:, k], page["y"][:, k], page["resting"][:, k] > 0
    panel.curve(x, y, color=GREY, lw=1.6, alpha=strength, zorder=3)
    for i, color in enumerate(colours("mass", len(x))):
        panel.curve(x[i], y[i], marker="o", ms=5.5, color=color, alpha=strength, zorder=4, mew=1.2,
                    mfc=color if rests[i] else "white")  # fmt: skip


def _stage_body(result: Result) -> Page:
    (left, right), (low, high) = _reach(result)
    height = float(np.clip(6.2 * (high - low) / (right - left) + 0.8, 1.6, 6.0))
    page = Page(result, height, height / 1.8)
    _ground(page.panel())
    return page


def _pose_body(panel: Panel, frame: int) -> None:
    page, time = panel.page, panel.page["time"]
    t = time[0] + (time[-1] - time[0]) * frame / (animation.frames - 1)
    past = time <= t
    panel.curve(page["center_x"][past], page["center_y"][past], color=GREY, lw=0.9)
    _draw_body(panel, t, 1.0)
    unit = "" if page.unit("time") == "1" else f" {page.unit('time')}"
    panel.axes.text(0.01, 0.9, f"$t$ = {t:.2f}{unit}", color=GREY, transform=panel.axes.transAxes)


animation = Animation(120, _stage_body, _pose_body)

# -- obstacles -------------------------------------------------------------------------------------


def _draw_obstacle(axes: Axes, each: Any) -> None:
    """Draw an obstacle from its table; the limits of the axes are already set."""
    style: dict[str, Any] = {"facecolor": _SOLID, "edgecolor": GREY, "linewidth": 0.6, "zorder": 2}
    if each["shape"] == "disc":
        axes.add_patch(Circle(each["centre"], each["radius"], **style))
    elif each["shape"] == "block":
        axes.add_patch(Polygon(each["corners"], **style))
    elif each["shape"] == "wall":
        normal = np.array([np.cos(each["angle"]), np.sin(each["angle"])])
        size = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()), 1e-300)
        along, far = np.array([-normal[1], normal[0]]), 1e3 * size
        point = np.array(each["point"])
        corners = [point + far * along, point - far * along]
        axes.add_patch(Polygon([*corners, *(c - far * normal for c in corners[::-1])], **style))
    else:
        ends = np.array([each["start"], each["end"]])
        if each.get("radius"):
            _thick(axes, ends[:, :1], ends[:, 1:], each["radius"], color=_SOLID, zorder=2)
        axes.plot(ends[:, 0], ends[:, 1], color=GREY, linewidth=1.0, zorder=2)


def _thick(axes: Axes, x: np.ndarray, y: np.ndarray, radius: float, **style: Any) -> None:
    """Draw bodies (n, m) of links as capsules, with the radius in units of the plane."""
    outlines = [
        _capsule(x[j : j + 2, k], y[j : j + 2, k], radius)
        for k in range(x.shape[1])
        for j in range(x.shape[0] - 1)
    ]
    look: dict[str, Any] = {"linewidths": 0.0} | style
    axes.add_collection(PolyCollection(outlines, **look))


def _capsule(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    front = np.arctan2(y[1] - y[0], x[1] - x[0]) + np.linspace(-np.pi / 2, np.pi / 2, 13)
    rear = front + np.pi
    return np.vstack([
        np.column_stack([x[end] + radius * np.cos(a), y[end] + radius * np.sin(a)])
        for end, a in ((1, front), (0, rear))
    ])  # fmt: skip


# -- forces ----------------------------------------------------------------------------------------


def motion_forces(result: Result) -> Figure:
    """Plot forces of ground and actuators over time, and works."""
    loads = [name for name in ("input", "torque") if name in result]
    page = Page(result, 7.2 if "torque" in result else 6.0, 8.4)
    ground, *own, work = page.rows(*[1] * (2 + len(loads)))
    size = np.hypot(page["ground_x"], page["ground_y"])
    ground.curves("time", size, what="mass", lw=1)
    ground.label(y="force of the ground", of="ground_x")
    ground.legend()
    _draw_loads(own, loads, "time")
    for (name, text), color, dashes in zip(_WORKS, VARIABLES, (*DASHES, ":"), strict=True):
        done = page.get(f"work_{name}")
        if done is not None and done.any():
            work.curve(page["time"], done, text, color=color, ls=dashes)
    energy = page["energy"]
    work.curve(page["time"], energy - energy[0], "stored", color="black", lw=0.8)
    work.label(y="work on the body", of="energy")
    work.named("x", "time")
    work.legend()
    page.facts(actuator_work="work of the actuators", energy_error="energy error")
    return page.drawn


_LOADS = {
    "input": "force $u_j$ in links",
    "torque": "torque $w_j$ in joints",
    "link_force": "links, push",
    "joint_torque": "joints, torque",
}


def _draw_loads(panels: Sequence[Panel], names: Sequence[str], x: str, first: int = 0) -> None:
    """Draw loads of actuators of links and joints."""
    for panel, name in zip(panels, names, strict=True):
        panel.curves(x, name, words=_LOADS[name], lw=1.1)
        if first and "joint" in name:  # joints have the number of the mass
            for j, drawn in enumerate(panel.axes.lines):
                drawn.set_label(f"joint {j + first}")
        panel.legend()


def crawl_forces(result: Result) -> Figure:
    """Plot ground forces, actuator loads, and resting masses over a stroke."""
    names = [name for name in ("link_force", "joint_torque") if name in result]
    page = Page(result, 5.2 + 1.4 * len(names), 8.5)
    *ground, rests = page.rows(*[1] * (3 + len(names)))
    resting = page["stroke_resting"] > 0
    for panel, name, words in (
        (ground[0], "ground_ahead", "forward"), (ground[1], "ground_left", "to the left"),
    ):  # fmt: skip
        panel.curves("phase", name, words=f"ground, {words}", lw=0.9, legend=panel is ground[0])
        held = np.where(resting, page[name], np.nan)  # corners of a stroke are jumps
        panel.curves("phase", held, what="mass", lw=2.6, legend=False)
    ground[0].entry("mass rests", lw=2.6)
    ground[0].legend()
    _draw_loads(ground[2:], names, "phase", first=1)
    rests.rests("phase", resting)
    rests.label("phase of the stroke")
    page.facts(work="work per stroke", stages="")
    return page.drawn


def turning(result: Result) -> Figure:
    """Plot heading and its bound over time, resting masses, and the friction they need."""
    page = Page(result, 5.4, 7.6)
    heading, rests, hold = page.rows(3, 1.5, 2, share=False)
    time, angle = page["time"], page["mean_heading"]
    heading.curve(time, angle - angle[0], "mean angle of both links", color=LINKS[0])
    sign = np.sign(angle[-1] - angle[0]) or 1.0
    heading.curve(time, sign * page["heading_rate_bound"] * time, "at the bound", color=RED,
                  ls=LIMIT, lw=0.9)  # fmt: skip
    heading.axes.margins(x=0)
    heading.label(y="heading", of="mean_heading")
    heading.legend()
    rests.rests("time", "resting")
    hold.curve("swing_angle", "hold_by_angle", "long link", color=LINKS[0],
               words="share of friction needed for rest")  # fmt: skip
    hold.named("x", "swing_angle", r"angle of the joint $\phi$ in a swing")
    hold.level(1.0, "available")
    hold.axes.set_ylim(0, 1.08 * max(1.0, float(page["hold_by_angle"].max())))
    hold.legend()
    page.facts(heading_rate="mean rate of the heading", heading_rate_bound="bound",
               gap=("gap", "%"))  # fmt: skip
    return page.drawn


# -- a path through the plane ----------------------------------------------------------------------


def path(result: Result) -> Figure:
    """Plot bodies between steps, area swept, path of the head, obstacles, and goal."""
    page = _stage_path(result)
    panel, x, y = page.panels[0], page["x"], page["y"]
    _thick(panel.axes, x, y, _radius(page), color=_SWEPT, zorder=1)
    stops = _stops(page)
    _thick(panel.axes, x[:, stops], y[:, stops], _radius(page), color=_BODY, zorder=3,
           linewidths=0.6, edgecolor="white")  # fmt: skip
    panel.curve(x[0], y[0], color="black", lw=0.9, zorder=4)
    panel.curve(x[0, stops], y[0, stops], ls="", marker="o", color="black", ms=2.5, zorder=4)
    pinned = page["pinned"] > 0.5
    panel.curve(x[pinned], y[pinned], ls="", marker=".", color=MASSES[1], ms=3, zorder=5)
    page.facts(steps="", time="", work="", room="least clearance")
    return page.legend(
        patch("body between steps", _BODY),
        patch("area swept", _SWEPT),
        line("head", "black", "-", 0.9),
        line("pinned", MASSES[1], "", marker="."),
        patch("obstacle", _SOLID),
        line("goal", RED),
    )


def _stage_path(result: Result) -> Page:
    """Draw obstacles, corridor, via points and goal, with equal axes."""
    x, y, goal = result["x"].values, result["y"].values, result.attributes["goal"]
    radius = float(result.attributes["radius"]) or 0.01 * float(np.ptp(x))
    margin = 2 * radius + 0.05 * float(max(np.ptp(x), np.ptp(y)))
    (left, right), (low, high) = (
        (float(min(row.min(), at)) - margin, float(max(row.max(), at)) + margin)
        for row, at in ((x, goal[0]), (y, goal[1]))
    )
    ratio = float(np.clip((high - low) / (right - left), 0.2, 1.2))
    page = Page(result, 6.4 * ratio + 0.9, 2.6 * ratio + 1.3)
    panel, axes = page.panel(), page.panels[0].axes
    for each in page["obstacles"]:
        _draw_obstacle(axes, each)
    if corridor := page.get("corridor"):
        corners, width = np.array(corridor[0]), corridor[1]
        _thick(axes, corners[:, :1], corners[:, 1:], width, color=GLIDE, zorder=0)
        panel.curve(*corners.T, color=GREY, ls=":", lw=0.8, zorder=1)
    for place in page.get("via") or []:
        panel.curve(*place, marker="+", color=GREY, ms=8, zorder=5)
    gx, gy, angle = goal
    size = max(4 * radius, 0.03 * float(np.ptp(x)))
    tip = gx + size * np.cos(angle), gy + size * np.sin(angle)
    panel.arrow((gx, gy), tip, RED, zorder=6)
    axes.add_patch(Circle((gx, gy), max(page["tolerance"], size / 4), fill=False, edgecolor=RED,
                          linewidth=1.2, zorder=6))  # fmt: skip
    _places(panel)
    axes.set(xlim=(left, right), ylim=(low, high))
    axes.set_aspect("equal", adjustable="box")
    return page


def _pose_path(panel: Panel, frame: int) -> None:
    page, axes = panel.page, panel.axes
    time, x, y = page["instant"], page["x"], page["y"]
    t = time[-1] * frame / (animation_of_path.frames - 1)
    now = np.array([[np.interp(t, time, row) for row in rows] for rows in (x, y)])
    k = min(int(np.searchsorted(time, t, side="right")), len(time) - 1)
    _thick(axes, now[0, :, None], now[1, :, None], _radius(page), color=LINKS[0], zorder=3)
    panel.curve(x[0, :k], y[0, :k], color="black", lw=0.9, zorder=2)
    pinned = page["pinned"][:, k] > 0.5
    axes.plot(*now, "o", color="white", markersize=4, zorder=4)
    axes.plot(*now[:, pinned], "o", color=MASSES[1], markersize=5, zorder=5)
    axes.text(0.01, 0.97, f"t = {t:.2f}", color=GREY, transform=axes.transAxes, va="top")


animation_of_path = Animation(160, _stage_path, _pose_path)


def _radius(page: Page) -> float:
    return float(page["radius"]) or 0.01 * float(np.ptp(page["x"]))


def _stops(page: Page) -> list[int]:
    """Return the instants between steps."""
    m = page["x"].shape[1]
    steps = len(page["amplitude"]) if "amplitude" in page else 0
    return [*range(0, m, m // steps), m - 1] if steps else [0]


# -- gaits and swimmers, by their shape ------------------------------------------------------------


def planar_gait(result: Result) -> Figure:
    """Plot the body at equal times of a cycle, resting masses, shape over time, and stroke."""
    page = Page(result, 5.0, 8.0)
    panels = page.mosaic("PP;LC", "P;L;C", (3, 2), (2, 1.6, 1.2))
    body, loop, over_time = (panels[name] for name in "PLC")
    shape, time = page["shape"], page["time"]
    at = np.searchsorted(time, np.linspace(time[0], time[-1], 6))
    _shapes(body, np.clip(at, 0, len(time) - 1), 0.2)
    for k, row in enumerate(shape):
        text = f"shape variable {k + 1}" if k < 6 else ""
        over_time.curve(time, row, text, color=LINKS[k % len(LINKS)], ls="-" if k < 4 else "--")
    over_time.named("x", "time")
    over_time.label(y="shape variables")
    over_time.axes.margins(x=0)
    if len(shape) < 2:
        loop.axes.set_visible(False)
    else:
        _stroke(loop, shape[-2:], page["corner"][:, -2:], len(shape))
    body.entry("mass at rest", "black", "", marker="s")
    turns = abs(page["turn"]) >= _NO_TURN
    page.facts(
        page.fact("distance"), page.fact("turn") * turns, duration="in", work="",
        turn_over_bound="rate over bound", work_over_bound="work over bound",
    )  # fmt: skip
    return page.legend()


def _shapes(panel: Panel, picked: np.ndarray, faint: float) -> None:
    """Draw the body at some samples, later ones darker, and the mean of its masses."""
    page, x, y = panel.page, panel.page["x"], panel.page["y"]
    for k, depth in zip(picked, np.linspace(faint, 1, len(picked)), strict=True):
        look = {"color": LINKS[0], "alpha": depth}
        panel.curve(x[:, k], y[:, k], lw=2, **look)
        panel.curve(x[0, k], y[0, k], ls="", marker="o", ms=4, **look)
        if "rest" in page:
            still = page["rest"][:, k] > 0.5
            panel.curve(x[still, k], y[still, k], ls="", marker="s", color="black", ms=3,
                        alpha=depth)  # fmt: skip
    panel.entry("body, later darker; head dotted", LINKS[0], lw=2)
    panel.curve(x.mean(axis=0), y.mean(axis=0), "mean of the masses", color=RED, lw=1.2)
    panel.axes.set_aspect("equal", adjustable="datalim")
    _places(panel)


def _stroke(panel: Panel, shape: np.ndarray, corner: np.ndarray, count: int) -> None:
    """Draw the stroke by the last two shape variables."""
    panel.curve(*shape, color=GREY)
    panel.curve(*corner.T, ls="", marker="o", color=GREY, ms=3)
    k = shape.shape[1] // 12
    for i in (0, shape.shape[1] // 2):
        panel.arrow(shape[:, i], shape[:, i + k], GREY)
    panel.label(f"shape variable {count - 1}", f"shape variable {count}")


def swim(result: Result) -> Figure:
    """Plot the body at equal times of a stroke, the path of its centre, and shape over time."""
    page = Page(result, 3.6, 5.4)
    if narrow():
        over_time, body = page.rows(2, 3, share=False)
    else:
        ((over_time, body),) = page.grid(1, 2, width_ratios=(2, 3))
    time, shape = page["instant"], page["shape"]
    _shapes(body, np.linspace(0, len(time) - 1, 5).round().astype(int), 0.25)
    for k, row in enumerate(shape):
        over_time.curve(time, row, f"shape variable {k + 1}" if k < 4 else "",
                     color=LINKS[(k + 1) % len(LINKS)])  # fmt: skip
    over_time.named("x", "instant", "time $t/T$")
    over_time.label(y="shape $s_k$")
    over_time.axes.margins(x=0)
    turns = abs(page["turn"]) >= _NO_TURN
    page.facts(page.fact("distance"), page.fact("turn") * turns, efficiency="")
    return page.legend()


def heights(result: Result) -> Figure:
    """Plot the curvature of the connection over both shape variables, with the stroke."""
    page = Page(result, 2.6, 7.0)
    panels, shape = page.beside(3, sharex=True, sharey=True), page["shape"]
    twists = ("displacement forward", "displacement to the left", "turn")
    for panel, values, name in zip(panels, page["height"], twists, strict=True):
        axes, most = panel.axes, float(np.abs(values).max()) or 1.0
        where = page["height_s1"], page["height_s2"], values.T
        filled = axes.contourf(*where, np.linspace(-most, most, 22), cmap="RdBu_r")
        axes.contour(*where, [0.0], colors=GREY, linewidths=0.7)
        panel.curve(shape[0], shape[1], color="black", lw=1.4)
        k = len(shape[0]) // 12
        panel.arrow(shape[:, k], shape[:, k + 1], "black")
        panel.scenery()
        axes.set_title(f"{name}, per area")
        panel.label("$s_1$", of="height_s1")
        page.drawn.colorbar(filled, ax=axes, shrink=0.6, ticks=[-most, 0, most], format="%.2g")
    for panel in panels if narrow() else panels[:1]:
        panel.label(y="$s_2$", of="height_s2")
    frame = str(result.trust.get("frame", ""))
    page.facts(f"in the {frame} frame" if frame else "", distance="")
    return page.drawn


def _arena(result: Result, x: np.ndarray, y: np.ndarray) -> Page:
    """A stage around places (masses, times), with the mean of the masses."""
    page = Page(result, 4.0, 3.0)
    panel, margin = page.panel(), 0.1 * float(np.ptp(x) + np.ptp(y))
    panel.curve(x.mean(axis=0), y.mean(axis=0), color=GREY, lw=0.8, ls=":")
    panel.axes.set(xlim=(x.min() - margin, x.max() + margin),
                   ylim=(y.min() - margin, y.max() + margin))  # fmt: skip
    panel.axes.set_aspect("equal")
    _places(panel)
    return page


def _draw_shape(panel: Panel, x: np.ndarray, y: np.ndarray) -> None:
    panel.curve(x, y, color=LINKS[0], lw=3)
    panel.curve(x[0], y[0], marker="o", color=RED, ms=6, zorder=3)


def _stage_gait(result: Result) -> Page:
    return _arena(result, result["x"].values, result["y"].values)


def _pose_gait(panel: Panel, frame: int) -> None:
    page, time = panel.page, panel.page["time"]
    at = time[-1] * frame / (animation_of_gait.frames - 1)
    k = min(int(np.searchsorted(time, at)), len(time) - 1)
    x, y, still = (page[name][:, k] for name in ("x", "y", "rest"))
    _draw_shape(panel, x, y)
    panel.curve(x[still > 0.5], y[still > 0.5], ls="", marker="s", color="black", ms=5)


animation_of_gait = Animation(72, _stage_gait, _pose_gait)

_FRAMES_PER_STROKE = 36


def _stage_stroke(result: Result) -> Page:
    return _arena(result, *_placed(result, np.arange(0, animation_of_stroke.frames, 3)))


def _pose_stroke(panel: Panel, frame: int) -> None:
    x, y = _placed(panel.page.result, np.array([frame]))
    panel.curve(x[:, 0], y[:, 0], ls="", marker="o", color="black", ms=3, zorder=2.5)
    _draw_shape(panel, x[:, 0], y[:, 0])
    panel.axes.text(0.01, 0.94, f"stroke {frame / _FRAMES_PER_STROKE:.2f}", color=GREY,
                    transform=panel.axes.transAxes)  # fmt: skip


animation_of_stroke = Animation(4 * _FRAMES_PER_STROKE, _stage_stroke, _pose_stroke)


def _placed(result: Result, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (masses, frames), strokes repeated from the end pose of the last one."""
    time = result["instant"].values
    places = np.stack([result["x"].values, result["y"].values])
    turn, first, last = _rigid(places)
    found = []
    for frame in frames:
        strokes, part = divmod(int(frame), _FRAMES_PER_STROKE)
        share = part / _FRAMES_PER_STROKE
        now = np.array([[np.interp(share, time, row) for row in rows] for rows in places])
        for _ in range(strokes):
            now = last + turn @ (now - first)
        found.append(now)
    x, y = np.stack(found, axis=-1)
    return x, y


def _rigid(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rigid motion of a stroke: rotation (2, 2), head before and after (2, 1)."""
    begin, end = places[..., 0], places[..., -1]
    a, b = begin[:, 0] - begin[:, 1], end[:, 0] - end[:, 1]
    c, s = a @ b / (a @ a), (a[0] * b[1] - a[1] * b[0]) / (a @ a)
    return np.array([[c, -s], [s, c]]), begin[:, :1], end[:, :1]


def serpenoid(result: Result) -> Figure:
    """Plot speed over amplitude with the best one and that of the scene; the best wave below."""
    page = Page(result, 4.2, 4.6)
    wave, speed = page.rows(1, 2, share=False)
    best = page["amplitude_best"]
    speed.curve("amplitude", "speed_by_amplitude", color=LINKS[0], words="speed $V/c$")
    speed.curve(best, page["speed_best"], "best", ls="", marker="o", color=RED)
    speed.named("x", "amplitude", r"amplitude $\alpha$")
    speed.axes.legend(loc="lower center")
    s = np.linspace(0, 4 * np.pi, 1200)
    x, y = (np.cumsum(f(best * np.sin(s))) * (s[1] - s[0]) / (2 * np.pi) for f in (np.cos, np.sin))
    wave.curve(x, y - y.mean(), color=RED, lw=2)
    wave.axes.set_aspect("equal")
    wave.label("best wave: $x$ over body length per wave", "$y$ over the same")
    wave.level(0, ls="-", lw=0.6)
    page.facts(speed="speed $V/c$", amplitude_best="best α", speed_best="best $V/c$")
    return page.drawn


# -- a block that slides until it stops ------------------------------------------------------------


def block(result: Result) -> Figure:
    """Plot the path with the velocity, its components over time, and the friction ellipse."""
    page = Page(result, 5.4, 8.6)
    parts = page.grid(*((4, 1) if narrow() else (2, 2)))
    path, ellipse, speed, force = (panel for row in parts for panel in row)
    time, x, y, stop = (page[name] for name in ("time", "x", "y", "stop_time"))
    path.curve(x, y, color=LINKS[0])
    marks = np.searchsorted(time, np.linspace(0, stop, 9)[:-1])
    arrows = [page[f"{name}_velocity"][marks] for name in "xy"]
    path.axes.quiver(x[marks], y[marks], *arrows, angles="xy", color=GREY, width=0.006)
    path.curve(x[-1], y[-1], "at rest", ls="", marker="o", color=RED)
    path.axes.set_aspect("equal", adjustable="datalim")
    path.axes.margins(0.1)
    _places(path, "position ")
    for panel, kind, words in (
        (speed, "{}_velocity", "velocity"),
        (force, "friction_{}", "friction"),
    ):
        for name, color, dashes in (("x", LINKS[0], "-"), ("y", LINKS[1], DASHES[1])):
            panel.curve(time, kind.format(name), f"along ${name}$", words=words, color=color,
                        ls=dashes)  # fmt: skip
        panel.level(stop, axis="x")
        panel.named("x", "time")
    _draw_ellipse(ellipse)
    for panel in (path, speed, force, ellipse):
        panel.legend(above=0.85 if narrow() else 0.42)
    page.facts(stop_time="stops at time", distance="", stop_error="difference to second route")
    return page.drawn


def _draw_ellipse(panel: Panel) -> None:
    """Draw the limit of friction, and the friction force over time."""
    page = panel.page
    angle, heading = np.linspace(0, 2 * np.pi, 361), page["heading"]
    # backward motion is resisted by a forward force
    along = np.cos(angle) * np.where(np.cos(angle) > 0, page["backward"], page["forward"])
    across = page["sideways"] * np.sin(angle)
    c, s = np.cos(heading), np.sin(heading)
    panel.curve(c * along - s * across, s * along + c * across, "limit of friction", color=GREY,
                ls=LIMIT, lw=0.9)  # fmt: skip
    fx, fy, slides = page["friction_x"], page["friction_y"], page["time"] < page["stop_time"]
    panel.curve(fx[slides], fy[slides], "sliding", color=LINKS[0], lw=2)
    panel.curve(fx[-1], fy[-1], "at rest", ls="", marker="o", color=RED)
    panel.axes.set_aspect("equal", adjustable="datalim")
    panel.label("friction along $x$", "friction along $y$", of="friction_x")
