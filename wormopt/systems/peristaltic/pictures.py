"""Pictures of peristaltic worms: segments, bodies that swell and thin, anchors, gaits, works."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    RED,
    VARIABLES,
    colours,
    line,
    number,
    patch,
    room,
    stretches,
    wrapped,
)
from wormopt.result import Result

_UNITS = ("mm", "mm s-1", "mN")
_THIN, _THICK = "#BFD9EA", "#4F93C4"  # a long segment and a short one
_OFF, _ON = "#EADFCF", "#D98C3F"  # a coil without current and with it
_shade = LinearSegmentedColormap.from_list("segment", [_THIN, _THICK])  # 0 long, 1 short
_glow = LinearSegmentedColormap.from_list("coil", [_OFF, _ON])  # 0 off, 1 on


def _draw_segment(
    panel: Panel, ends: tuple[float, float], radii: tuple[float, float], height: float, **style: Any
) -> None:
    """Draw a bulge between two rings on an axis; `radii`: at the rings and in the middle."""
    s = np.linspace(-1, 1, 41)
    along = (ends[0] + ends[1]) / 2 + s * (ends[1] - ends[0]) / 2
    out = radii[0] + (radii[1] - radii[0]) * (1 - np.abs(s) ** 5)
    usual = {"edgecolor": "white", "linewidth": 0.6, "zorder": 2, "alpha": None}
    panel.band(along, height - out, height + out, **(usual | style))


def _rows_at(page: Page, name: str, t: Any, time: str = "time") -> np.ndarray:
    """Return rows of a variable at times t, interpolated linearly between samples."""
    return np.array([np.interp(t, page[time], row) for row in page[name]])


# -- one segment -----------------------------------------------------------------------------------

_WALL = "#8C8C8C"
_SHOWN = 0.3  # largest drawn swelling over the radius


def segment(result: Result) -> Figure:
    """Plot the segment without field, in its coil, against its load, in its tube, and inflated.

    Swellings are enlarged by the factor stated in the plot. Coils are brown.
    """
    balloon = "membrane_radius" in result
    states = _states(Page(result, 1.0, units=_UNITS))
    count = len(states) + balloon
    page = Page(result, 1.15 * count + 0.9, 0.8 * count + 1.1, _UNITS)
    length, radius = page.length("length"), page.length("radius")
    tube = page.length("tube_radius") if page.get("tube_radius") else None
    most = max([abs(r - radius) for _, _, r in states] + ([tube - radius] if tube else []))
    factor = _round(_SHOWN * radius / most) if most else 1.0
    rows = page.rows(*[1] * count)
    for panel, (words, stretch, swollen) in zip(rows, states, strict=False):
        x, shown = np.array([-1.0, 1.0]), radius + factor * (swollen - radius)
        _outline(panel, length / 2 * stretch * x, np.full(2, shown))
        _coil(panel, lit=words != "without field")
        if words.startswith("in its tube") and tube:
            for side in (-1, 1):
                wall = side * (radius + factor * (tube - radius))
                panel.level(wall, color=_WALL, ls="-", lw=2.5)
        panel.axes.set_title(words)
    if balloon:
        place, swollen = page["membrane_place"], page["membrane_radius"]
        _outline(rows[-1], np.concatenate([-place[::-1], place]),
                 np.concatenate([swollen[::-1], swollen]))  # fmt: skip
        rows[-1].axes.set_title(
            f"not sealed, at a pressure of {page['inflation_pressure']:g} Pa: swelling to scale"
        )
    for panel in rows:
        panel.scenery(equal=False, heights=False)
        panel.axes.spines["bottom"].set_visible(panel is rows[-1])
        panel.axes.tick_params(bottom=panel is rows[-1])
    rows[-1].label("axial position $z$ (mm)")
    page.facts(
        f"swellings enlarged {factor:g} times", page.fact("stroke", unit="%"),
        page.fact("normal_force", "normal force on the tube"), page.fact("holding", "holds"),
        "will not move" if page.get("moves") is False else "",
    )  # fmt: skip
    return page.legend(
        patch("segment", _THIN, edgecolor="black", linewidth=0.6),
        patch("coil with current", _ON),
        patch("without", "white", edgecolor=_ON, linewidth=0.6),
        *([line("tube", _WALL, lw=2.5)] if tube else []),
    )


def _states(page: Page) -> list[tuple[str, float, float]]:
    """Return title, stretch and radius of each state that is drawn as a cylinder."""
    stretch, contact = page["stretch"], page.get("stretch_contact")
    states = [("without field", 1.0), ("in its coil", stretch)]
    if page["load"]:
        states.append(("in its coil, against the load", page["stretch_loaded"]))
    if contact is not None:
        words = "pressed on its wall" if page["normal_force"] else "off its wall"
        states.append((f"in its tube, {words}", max(stretch, contact)))
    return [(words, lam, page.length("radius") * lam**-0.5) for words, lam in states]


def _round(number: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... up to a number, at least 1."""
    power = 10.0 ** np.floor(np.log10(max(number, 1.0)))
    return float(power * max(step for step in (1, 2, 5) if step * power <= max(number, 1.0)))


def _outline(panel: Panel, x: np.ndarray, radius: np.ndarray) -> None:
    panel.band(x, -radius, radius, facecolor=_THIN, edgecolor="black", linewidth=0.8, alpha=None)
    for end in (0, -1):
        panel.curve([x[end]] * 2, [-radius[end], radius[end]], color="black", lw=2)


def _coil(panel: Panel, *, lit: bool) -> None:
    """Draw the coil above and below: the field of the ideal coil, or the real winding."""
    page, radius = panel.page, panel.page.length("radius")
    wound = page.get("winding_length")
    length = page.length("winding_length") if wound else page["coil_share"] * page.length("length")
    half = length / 2
    for side in (-1, 1):
        panel.band([-half, half], side * 1.5 * radius, side * 1.8 * radius, linewidth=0.8,
                   facecolor=_ON if lit else "white", edgecolor=_ON, alpha=None)  # fmt: skip
    panel.axes.set_ylim(-1.9 * radius, 1.9 * radius)


def stroke(result: Result) -> Figure:
    """Plot strokes over the coil's pressure, and forces on the ends over the stretch."""
    page = Page(result, 3.3, 5.6, _UNITS)
    left, right = page.beside(2)
    for name, text, k in (
        ("free_stroke", "free", 0),
        *([("loaded_stroke", "against the load", 1)] if page["load"] else []),
        ("deepest_stroke", "with the best coil", 2),
    ):
        left.curve("pressure", 100 * page[name], text, color=LINKS[k], ls=DASHES[k])
    left.curve(page["coil_pressure"], 100 * page["stroke"], "the coil's pressure", ls="",
               marker="o", color=RED)  # fmt: skip
    contact = page.get("stretch_contact")
    if contact is not None:
        left.level(100 * (1 - contact), "to the wall", lw=0.9)
        right.level(contact, axis="x", lw=0.9)
    left.named("x", "pressure", "magnetic pressure")
    left.label(y="stroke (%)")
    for name, text, color, dashes in (
        ("return_forces", "push of the rubber", "black", "-"),
        ("coil_pulls", "pull of the ideal coil", LINKS[3], DASHES[3]),
        ("winding_pulls", "pull of the winding", "#8C5A1E", DASHES[1]),
    ):
        if name in page:
            right.curve("axial_stretch", name, text, words="force on the ends", color=color,
                        ls=dashes)  # fmt: skip
    right.named("x", "axial_stretch", "stretch $l/L$ (1 unstressed)")
    page.facts(stroke=("free stroke", "%"), loading="pressure over $Gh/R$",
               winding_share="share of the equivalent ideal coil")  # fmt: skip
    return page.legend()


# -- a worm in its coils and its tube --------------------------------------------------------------

_WORKS = (
    ("coil", "coils"),
    ("friction", "dry friction"),
    ("drag", "drag"),
    ("damping", "dashpots"),
    ("load", "load"),
)


def worm(result: Result) -> Figure:
    """Plot the body just before each switch of the last cycle, in its coils and its tube."""
    whole = Page(result, 1.0, units=_UNITS)
    # samples of the last cycle, just before each switch or at equal times
    count = whole["steps"] if whole["steps"] > 1 else 8
    chosen = _instants(whole, 20 * count + 1, cycles=1)[19::20]
    lanes, reach = 3.9 * whole.length("radius"), _reach(whole, chosen)
    shape = len(chosen) * lanes / (reach[1] - reach[0])
    page = Page(result, 6.2 * shape + 1.2, 2.8 * shape + 1.4, _UNITS)
    panel = page.panel()
    for k, instant in enumerate(chosen):
        _draw_worm(panel, int(instant), -k * lanes, reach)
        panel.axes.text(reach[1], -k * lanes, f" {page['time'][instant]:.3g} s", va="center",
                        color=GREY, fontsize=7.5)  # fmt: skip
    _frame(panel, reach, (-(len(chosen) - 0.45) * lanes, 0.55 * lanes))
    page.facts(
        f"deformation and displacement enlarged {number(_times(page))} times",
        advance="advance per cycle", slip="slip per cycle",
    )  # fmt: skip
    pressed = line("rests, pressed to the wall", RED, "none", marker="^")
    return page.legend(
        patch("coil that is on", _ON), patch("coil that is off", _OFF),
        patch("short and thick", _THICK), *([pressed] if result.attributes["tube"] else []),
        line("rests by its weight", RED, "none", marker="^", mfc="white"),
    )  # fmt: skip


def course(result: Result) -> Figure:
    """Plot positions of the rings, forces of the wall or lengths, and the balance of works."""
    page = Page(result, 5.6, 7.6, ("mm", "mm s-1", "mN", "µJ"))
    places, middle, work = page.rows(1, 1, 1)
    x, stored = page["position"], page["stored"]
    places.curves("time", x - x[:, :1], what="ring", lw=1)
    places.label(y="position of rings", of="position")
    walled = page["normal_force"].max() > 0
    middle.curves("time", "normal_force" if walled else "stretch", ls="-", lw=1,
                  words="force of the wall" if walled else "stretch $l/L$")  # fmt: skip
    for (name, text), color, dashes in zip(_WORKS, VARIABLES, (*DASHES, ":"), strict=True):
        if page[f"work_{name}"].any():
            work.curve("time", f"work_{name}", text, words="work on the worm", color=color,
                       ls=dashes)  # fmt: skip
    work.curve("time", stored - stored[0], "stored", color="black", lw=0.8)
    for panel in (places, middle, work):
        panel.legend()
    page.facts(
        speed="mean speed", advance_share=("share of ideal advance", "%"),
        holding_reserve=("holding reserve", "%"), energy_error="energy error",
    )  # fmt: skip
    return page.drawn


def _stage_worm(result: Result) -> Page:
    page = Page(result, 2.1, 1.6, _UNITS)
    half = 1.9 * page.length("radius")
    chosen = _instants(page, animation_of_worm.frames, cycles=2)
    panel = page.panel()
    _frame(panel, _reach(page, chosen), (-half, half))
    text = f"deformation and displacement enlarged {number(_times(page))} times"
    panel.axes.set_title(wrapped(text, 0.7 * room(1)), loc="right")
    return page


def _pose_worm(panel: Panel, frame: int) -> None:
    page = panel.page
    instant = int(_instants(page, animation_of_worm.frames, cycles=2)[frame])
    _draw_worm(panel, instant, 0.0, panel.axes.get_xlim())
    panel.above(f"$t$ = {page['time'][instant]:.2f} s")


animation_of_worm = Animation(144, _stage_worm, _pose_worm)


def _instants(page: Page, count: int, *, cycles: int) -> np.ndarray:
    """Return samples at equal times over the last cycles."""
    time = page["time"]
    since = max(time[-1] - cycles * page["period"], time[0])
    return np.searchsorted(time, np.linspace(since, time[-1], count) - 1e-9 * time[-1])


def _times(page: Page) -> float:
    """Return the factor that enlarges deformation and displacement: to a quarter of the radius."""
    radii = page["stretch"] ** -0.5 - 1
    return float(f"{max(0.25 / max(np.abs(radii).max(), 1e-6), 1.0):.0e}")


def _places(page: Page) -> np.ndarray:
    """Return the drawn positions of the rings (rings, times), in mm."""
    x = page["position"]
    return x[:, :1] + _times(page) * (x - x[:, :1])


def _reach(page: Page, instants: np.ndarray) -> tuple[float, float]:
    x, more = _places(page)[:, instants], page.length("length") / 2
    return float(x.min() - more), float(x.max() + more)


def _draw_worm(panel: Panel, instant: int, height: float, reach: tuple[float, float]) -> None:
    """Draw segments, coils, anchors and tube at one instant, with the axis at a height in mm."""
    page = panel.page
    times, radius, tube = _times(page), page.length("radius"), page.result.attributes["tube"]
    x, stretch = _places(page)[:, instant], page["stretch"][:, instant]
    radii = radius * (1 + times * (stretch**-0.5 - 1))
    most, lit = 1 - page["stretch"].min(), page["current"][:, instant] / _current(page)
    for side in (-1, 1) if tube else ():
        wall = side * (radius + times * (page.length("tube") - radius))
        panel.curve(reach, [height + wall] * 2, color="black", lw=1)
    rim = 1.36 * radius
    for j, swollen in enumerate(radii):
        _draw_segment(panel, (x[j + 1], x[j]), (0.8 * radius, swollen), height,
                      facecolor=_shade((1 - stretch[j]) / most))  # fmt: skip
        wide = page["coil_share"] * (x[j] - x[j + 1])
        for base in (height + rim, height - rim - 0.16 * radius):
            panel.axes.add_patch(
                Rectangle(((x[j] + x[j + 1] - wide) / 2, base), wide, 0.16 * radius, linewidth=0,
                          facecolor=_glow(lit[j] ** 2))
            )  # fmt: skip
    # resting contacts: filled if the wall presses, empty if only weight does
    resting, pressed = page["resting"][:, instant] > 0, page["normal_force"][:, instant] > 0
    spots = (x[:-1] + x[1:]) / 2
    if page["anchoring"] == "clamp":
        spots, pressed = x, np.append(pressed, False) | np.append(False, pressed)
    for which, face in ((resting & pressed, RED), (resting & ~pressed, "white")):
        panel.curve(spots[which], np.full(which.sum(), height - rim - 0.32 * radius), ls="",
                    marker="^", color=RED, ms=3.8, mfc=face, mew=0.7)  # fmt: skip


def _current(page: Page) -> float:
    """Current of a coil that is on: a scalar, beside the variable of that name."""
    return float(page.result.attributes["current"])


def _frame(panel: Panel, reach: tuple[float, float], heights: tuple[float, float]) -> None:
    panel.axes.set(xlim=reach, ylim=heights)
    panel.scenery(heights=False)
    panel.label("drawn position $x$ (mm)")


# -- a worm on drag, its gait and its switching ----------------------------------------------------

_PERIODS, _FRAMES_PER_PERIOD = 3, 40
# Largest radius over the usual length of a segment, and radius of rings over that of a segment.
_FULL, _WAIST = 0.45, 0.72


def drag_gait(result: Result) -> Figure:
    """Plot lengths of all segments over a period, the best small gait dashed, and velocity."""
    page = Page(result, 4.2, 4.6)
    top, below = page.rows(2, 1)
    top.curves("instant", "length_small", lw=0.9, ls=DASHES[1], legend=False, words="length $l_j$")
    top.curves("instant", "length", ls="-")
    top.entry("best small gait", GREY, DASHES[1], 0.9)
    top.legend()
    _velocity(below)
    page.facts(distance="displacement per period", distance_small="by small strains",
               segments_per_wave="")  # fmt: skip
    return page.drawn


def _velocity(panel: Panel) -> None:
    panel.curve("instant", "velocity", "centre", color="black", words="velocity")
    panel.level("speed", "mean", ls=":", lw=1)
    panel.legend()


def switching(result: Result) -> Figure:
    """Plot when each coil is on, the lengths of all segments, and the velocity over a period.

    The inside of a bar is black while its segment rests on the wall.
    """
    page = Page(result, 5.0, 5.2)
    coils, middle, below = page.rows(1, 2, 1)
    count = len(page["length"])
    for j, color in enumerate(colours("segment", count)):
        for name, half, own in (("coil", 0.4, color), ("anchored", 0.1, "black")):
            coils.bars(j, stretches(page["instant"], page[name][j] > 0.5), own, half)
    coils.ranks(count, "coil $j$ on")
    coils.axes.grid(visible=False)
    middle.curves("instant", "length", ls="-", words="length $l_j$")
    middle.legend()
    for switch in np.unique(page["phase_times"]):
        for panel in (middle, below):
            panel.level(switch, axis="x", ls="-", lw=0.4, zorder=0)
    _velocity(below)
    page.facts(speed="mean velocity", energy_per_distance="", time="period")
    return page.drawn


def body(result: Result) -> Figure:
    """Plot the worm at equal times of a period, from top to bottom; its path dotted.

    Segments keep their volume: short ones are thick. Orange edges: the coil is on.
    """
    page = Page(result, 4.2, 4.2)
    panel, time, count = page.panel(), page["instant"], 9
    at = np.linspace(0.0, time[-1], count)
    places, thick = _rows_at(page, "position", at, "instant"), _thickest(page)
    down = 2.3 * thick * np.arange(count)
    for k, row in enumerate(places.T):
        _draw_body(panel, row, -down[k], at[k])
    for ring in (0, -1):
        panel.curve(page["position"][ring], -down[-1] * time / time[-1], color=GREY, lw=0.8, ls=":")
    margin = 1.3 * thick
    panel.axes.set(xlim=(places.min() - margin, places.max() + margin),
                   ylim=(-down[-1] - margin, margin))  # fmt: skip
    panel.axes.set_yticks(-down[::4], [f"{share:g}" for share in np.linspace(0, 1, 3)])
    panel.scenery(equal=False)
    panel.named("x", "position", "position $x$, head to the right")
    panel.label(y="time over period")
    page.facts(distance="displacement per period", speed="mean velocity")
    return page.drawn


def _thickest(page: Page) -> float:
    """Radius of the shortest segment as it is drawn; volumes are constant."""
    lengths = page["length"]
    return _FULL * float(lengths.mean()) ** 1.5 / float(lengths.min()) ** 0.5


def _draw_body(panel: Panel, rings: np.ndarray, middle: float, t: float) -> None:
    """Draw all segments at a time of the period."""
    page, lengths = panel.page, panel.page["length"]
    usual, least, most = float(lengths.mean()), float(lengths.min()), float(lengths.max())
    on = np.zeros(len(lengths), bool)
    if "coil" in page:
        time = page["instant"]
        on = page["coil"][:, min(int(np.searchsorted(time, t, side="right")), len(time) - 1)] > 0.5
    for (front, rear), lit in zip(pairwise(rings), on, strict=True):
        length = front - rear
        radii = _WAIST * _FULL * usual, _FULL * usual * float(np.sqrt(usual / length))
        style = {"edgecolor": _ON, "linewidth": 1.8, "zorder": 3} if lit else {}
        shade = _shade((most - length) / max(most - least, 1e-300))
        _draw_segment(panel, (rear, front), radii, middle, facecolor=shade, **style)


def _stage_body(result: Result) -> Page:
    page = Page(result, 1.7, 1.3)
    panel, places, thick = page.panel(), page["position"], _thickest(page)
    moved = _PERIODS * (places[0, -1] - places[0, 0])
    ends = places.min() + min(moved, 0.0), places.max() + max(moved, 0.0)
    panel.axes.set(xlim=(ends[0] - thick, ends[1] + thick), ylim=(-2.2 * thick, 2.2 * thick))
    panel.level(-1.1 * thick, ls="-", lw=1.2)
    panel.scenery(equal=False, heights=False)
    panel.named("x", "position", "position $x$")
    return page


def _pose_body(panel: Panel, frame: int) -> None:
    page, places = panel.page, panel.page["position"]
    turn, part = divmod(frame, _FRAMES_PER_PERIOD)
    share = part / _FRAMES_PER_PERIOD
    t = share * page["instant"][-1]
    moved = turn * (places[0, -1] - places[0, 0])
    _draw_body(panel, _rows_at(page, "position", t, "instant") + moved, 0.0, t)
    panel.axes.text(0.01, 0.88, f"t = {turn + share:.2f} T", color=GREY,
                    transform=panel.axes.transAxes)  # fmt: skip


animation = Animation(_PERIODS * _FRAMES_PER_PERIOD, _stage_body, _pose_body)


# -- a worm that anchors in its tube ---------------------------------------------------------------

_ROUNDS, _FRAMES_PER_ROUND = 2, 48
# Relative to the drawn length of a short segment: drawn stroke; half the thickness of a ring, of a
# worm at rest and of its tube. Real changes are too small to be seen.
_STROKE, _RING, _SLACK, _WIDE = 0.45, 0.165, 0.22, 0.36
_ANCHORED = LINKS[0]


def peristalsis(result: Result) -> Figure:
    """Plot the body in its tube at the start of each phase, its anchors, and its advance.

    Needs ``time``, ``length``, ``radius``, ``anchored``, ``position`` and the wave. Changes
    of length and thickness are enlarged.
    """
    begins = np.arange(0, len(result["time"].values), 2)
    tall = 0.5 * (len(begins) + 1)
    page = Page(result, tall + 2.6, tall + 2.6, _UNITS)
    shape, head = page.rows(tall, 1.9, share=False)
    for row, k in enumerate(begins):
        _draw_anchored(shape, -row, page["time"][k], int(k))
    _tube(shape, len(begins), 1)
    shape.axes.set_yticks(-np.arange(len(begins)), [number(page["time"][k], 3) for k in begins])
    shape.label(y="time $t$, downward", of="time")
    period = page["period"]
    _repeated(head, page["time"], page["position"][0], "designed gait", color=LINKS[0])
    _repeated(head, page["wave_time"], page["wave_position"], "wave", color=LINKS[1], ls=DASHES[1])
    end = _ROUNDS * period
    head.curve([0, end], [0, page["bound"] * end], "bound on the mean", color=RED, ls=LIMIT, lw=0.9)
    head.axes.set_xlim(0, end)
    head.named("x", "time")
    head.label(y="position of the head", of="position")
    head.legend()
    page.facts(speed="mean speed", ceiling="upper bound", wave_speed="wave", stroke="stroke")
    shape.entries = [patch("anchored on the wall", _ANCHORED), patch("moving, off the wall", _THIN)]
    return page.legend()


def _repeated(panel: Panel, time: np.ndarray, place: np.ndarray, text: str, **style: Any) -> None:
    """Draw a motion cycle by cycle for the periods shown."""
    turns = np.arange(np.ceil(_ROUNDS * panel.page["period"] / time[-1] - 1e-9))[:, None]
    far = place - place[0] + (place[-1] - place[0]) * turns
    panel.curve((time + time[-1] * turns).ravel(), far.ravel(), text, **style)


def _drawn_rings(page: Page, t: float) -> np.ndarray:
    """Return the drawn positions of rings at time t, in lengths of a short segment."""
    larger = _STROKE / page["stroke"]
    turn, t = divmod(t, page["period"])
    head = _rows_at(page, "position", t)[0] + turn * page["advance"]
    lengths = 1 + (_rows_at(page, "length", t) - page["shortest"]) * larger
    return head * larger - np.concatenate([[0.0], np.cumsum(lengths)])


def _draw_anchored(panel: Panel, row: float, t: float, at: int) -> None:
    """Draw the worm at time t; `at` is the sample with the anchors of that time."""
    page = panel.page
    rings, thin, wide = _drawn_rings(page, t), page["worm_radius"], page["tube_radius"]
    radii = (_rows_at(page, "radius", t % page["period"]) - thin) / (wide - thin)
    for j, anchored in enumerate(page["anchored"][:, at] > 0):
        half = _SLACK + (_WIDE - _SLACK) * radii[j]
        _draw_segment(panel, (rings[j + 1], rings[j]), (_RING, half), row, edgecolor=GREY,
                      facecolor=_ANCHORED if anchored else _THIN)  # fmt: skip
        if anchored:
            panel.curve([(rings[j] + rings[j + 1]) / 2] * 2, [row - _WIDE, row + _WIDE], ls="",
                        marker="s", ms=3.5, color=RED, zorder=3)  # fmt: skip
    for wall in (row - _WIDE, row + _WIDE):
        panel.level(wall, ls="-", lw=1.0, zorder=1)


def _tube(panel: Panel, rows: int, rounds: int) -> None:
    """Set limits for the worm and its path, without a scale where changes are enlarged."""
    page = panel.page
    rings = np.array([_drawn_rings(page, t) for t in page["time"][:-1]])
    advance = page["advance"] * _STROKE / page["stroke"]
    panel.axes.set(xlim=(rings.min() - 0.2, rings[:, 0].max() + (rounds - 1) * advance + 0.2),
                   ylim=(-rows + 0.5, 0.5), xticks=[])  # fmt: skip
    panel.axes.grid(visible=False)
    panel.label("forward → (changes enlarged)")


def _stage_anchored(result: Result) -> Page:
    page = Page(result, 1.5, 1.2, _UNITS)
    _tube(page.panel(), 1, _ROUNDS)
    page.panels[0].axes.set_yticks([])
    return page


def _pose_anchored(panel: Panel, frame: int) -> None:
    period, time = panel.page["period"], panel.page["time"]
    t = period * frame / _FRAMES_PER_ROUND
    at = int(np.searchsorted(time, t % period, side="right")) - 1
    _draw_anchored(panel, 0.0, t, at)
    panel.axes.text(0.01, 0.88, f"t = {t / period:.2f} T", color=GREY,
                    transform=panel.axes.transAxes)  # fmt: skip


animation_of_anchors = Animation(_ROUNDS * _FRAMES_PER_ROUND, _stage_anchored, _pose_anchored)
