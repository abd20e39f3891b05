"""Pictures of gaits and their design: lengths, way, loads, limits, proof, animation.

Values of time stand twice where something jumps, so lines draw jumps as they are.
"""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from wormopt.plotting.parts import (
    GLIDE,
    GREY,
    LINKS,
    MASSES,
    RED,
    ceilings,
    draw_limits,
    facts,
    label,
    legend,
    link_handles,
    link_lines,
    mass_handles,
    raised,
    ranges,
    rate_ranges,
    scalar,
    shades,
    sheet,
    stretches,
    symmetric,
)
from wormopt.result import Result

_PERIODS = 2  # shown of a motion
_FRAMES_PER_PERIOD = 36
FRAMES = _PERIODS * _FRAMES_PER_PERIOD
_CENTRED: dict[str, Any] = {"ha": "center", "va": "center_baseline", "size": 9, "weight": "bold"}
OBJECTIVES = {
    "peak_spike_load": r"largest load on a spike, max $\lambda_i$",
    "peak_actuator_force": r"largest actuator force, max $|\mu_j|$",
    "energy_per_distance": "energy per distance",
    "acceleration_effort": "acceleration effort",
}


def gait(result: Result) -> Figure:
    """Link lengths and rates over a period with their limits, and which mass rests when.

    Needs ``time``, ``resting``, ``length``, ``rate``. Glides are shaded; no title yet.
    """
    masses = len(result["resting"].values)
    heights = (3.0, 2.0, 0.25 + 0.17 * masses)
    drawn = sheet(8, 2.0 + sum(heights))
    lengths, rates, band = drawn.subplots(3, sharex=True, height_ratios=heights)
    links = len(result["length"].values)
    _draw_links(lengths, result, "length", "link length $l_j$")
    own = shades(LINKS, links)
    draw_limits(lengths, ranges(scalar(result, "length_limits"), links), own)
    legend(lengths, link_handles(links))
    _draw_links(rates, result, "rate", r"rate $\dot l_j$")
    draw_limits(rates, rate_ranges(scalar(result, "rate_limit"), links), own)
    _draw_band(band, result)
    band.set_xlabel(label("time $t$", result["time"].unit))
    lengths.set_title(_facts(result, "speed", "advance", "period", "ceiling"), loc="left")
    drawn.align_ylabels()
    return drawn


def _facts(result: Result, *names: str) -> str:
    """Facts of a gait; of several cycles a period what one of them, as drawn, takes and gives."""
    cycles = result.scalars.get("cycles")
    if cycles is None or cycles.value == 1:
        return facts(result, *names)
    whole = {name: result.scalars[name] for name in ("period", "advance")}
    period, advance = (f"{w.value / cycles.value:.6g} {raised(w.unit)}" for w in whole.values())
    told = facts(result, *(name for name in names if name not in whole))
    return f"{told}    {cycles.value} cycles a period, each {period.strip()} and {advance.strip()}"


def motion(result: Result) -> Figure:
    """Path of every mass over two periods, time upward as in figure 3 of the chapter.

    Needs ``time``, ``resting``, ``position``. Heavy lines: a mass rests; shaded: glides.
    """
    time, position = result["time"].values, result["position"].values
    period, advance = time[-1], position[0, -1] - position[0, 0]
    drawn = sheet(7.5, 7)
    axes = drawn.subplots()
    resting = result["resting"].values.astype(bool)
    glides = stretches(time, ~np.any(resting, axis=0))
    for turn in range(_PERIODS):
        t, x = time + turn * period, position + turn * advance
        for start, end in glides:
            axes.axhspan(start + turn * period, end + turn * period, color=GLIDE, linewidth=0)
        for i, colour in enumerate(shades(MASSES, len(x))):
            axes.plot(x[i], t, color=colour, linewidth=1.3)
            axes.add_collection(_heavy(x[i], t, resting[i], colour))
    for i, colour in enumerate(shades(MASSES, len(position))):
        for x, t in ((position[i, 0], 0.0), (position[i, -1] + advance, _PERIODS * period)):
            disc = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
            axes.text(x, t, str(i), bbox=disc, color="white", zorder=5, **_CENTRED)
    axes.margins(0.04, 0.05)
    axes.set_xlabel(label("position $x_i$", result["position"].unit))
    axes.set_ylabel(label("time $t$", result["time"].unit))
    axes.set_title(_facts(result, "advance", "speed"), loc="left")
    handles = [Line2D([], [], color=GREY, linewidth=5, label="rests on its spikes"),
               Line2D([], [], color=GREY, linewidth=1.3, label="moves")]  # fmt: skip
    if glides:
        handles.append(Line2D([], [], color=GLIDE, linewidth=8, label="whole worm glides"))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3)
    return drawn


def _heavy(x: np.ndarray, t: np.ndarray, rests: np.ndarray, colour: str) -> LineCollection:
    """Stretches of a path on which the mass rests, as heavy lines."""
    lines = [[(np.interp(at, t, x), at) for at in stretch] for stretch in stretches(t, rests)]
    return LineCollection(lines, colors=colour, linewidths=5, zorder=3, capstyle="butt")


def spikes(result: Result) -> Figure:
    """Spike loads, lambda and sigma of (7), and actuator forces over a period with limits.

    Needs ``time``, ``resting``, ``reaction``, ``reaction_mean``, ``sigma`` and
    ``actuator_force``.
    """
    masses, links = len(result["reaction"].values), len(result["actuator_force"].values)
    time = result["time"].values
    drawn = sheet(8, 8.5)
    loads, mean, forces = drawn.subplots(3, sharex=True, height_ratios=(3, 2, 2.5))
    own = shades(MASSES, masses)
    for i, (load, colour) in enumerate(zip(result["reaction"].values, own, strict=True)):
        loads.plot(time, load, color=colour, linewidth=1.8, zorder=3 + (masses - i) / masses)
        loads.fill_between(time, load, color=colour, alpha=0.12, linewidth=0)
    draw_limits(loads, ceilings(scalar(result, "spike_load_limit"), masses), own)
    legend(loads, mass_handles(masses))
    loads.set_ylabel(label("load on the\nspikes $\\lambda_i$", result["reaction"].unit))
    loads.set_title(facts(result, "spike_load_max", "actuator_force_max"), loc="left")
    needed = {"color": "#BBBBBB", "linewidth": 3.5, "label": r"$\sigma$, needed to hold"}
    carried = {"color": "black", "linewidth": 1.3, "label": r"$\lambda$, mean load"}
    mean.plot(time, result["sigma"].values, **needed)
    mean.plot(time, result["reaction_mean"].values, **carried)
    mean.axhline(0.0, color=GREY, linewidth=0.8)
    legend(mean, [Line2D([], [], **needed), Line2D([], [], **carried)])
    mean.set_ylabel(label("mean over\nthe masses", result["sigma"].unit))
    _draw_links(forces, result, "actuator_force", "actuator\nforce $\\mu_j$")
    draw_limits(
        forces, symmetric(scalar(result, "actuator_force_limit"), links), shades(LINKS, links)
    )
    legend(forces, link_handles(links))
    forces.set_xlabel(label("time $t$", result["time"].unit))
    drawn.align_ylabels()
    return drawn


def limits(result: Result) -> Figure:
    """Bars of what each limit is worth: per cent of the objective per per cent of the limit.

    Needs ``limit_elasticity`` and the attribute ``limits``. The longest is on top; limits
    that do not bind are named below.
    """
    elasticity, known = result["limit_elasticity"].values, result.attributes["limits"]
    binding = [k for k in np.argsort(-abs(elasticity)) if abs(elasticity[k]) > _NO_INFLUENCE]
    shown = binding[:_MOST_BARS]
    drawn = sheet(8, 2.5 + 0.34 * max(3, len(shown)))
    axes = drawn.subplots()
    better = 1.0 if known["objective"] == "speed" else -1.0
    for place, k in enumerate(shown):
        length = float(elasticity[k])
        axes.barh(place, length, 0.66, color=LINKS[0] if better * length > 0 else LINKS[3])
        mark = " *" if known["one_sided"][k] else ""
        axes.annotate(f"{length:+.3g}{mark}", (length, place), **_beside(length))
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(shown)), [_limit_text(known, k) for k in shown])
    axes.set_ylim(max(3, len(shown)) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.16)
    axes.set_ylabel("limit")
    cost = OBJECTIVES.get(known["objective"], "").partition(",")[0]
    of = f"of the {cost}" if cost else "speed"
    axes.set_xlabel(rf"per cent {of} per per cent of the limit ($\%/\%$)")
    axes.set_title(_limit_notes(known, elasticity, len(binding) - len(shown)), loc="left")
    handles = [
        Line2D([], [], color=colour, linewidth=7, label=f"better when {way}")
        for colour, way in ((LINKS[0], "raised"), (LINKS[3], "lowered"))
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=2)
    return drawn


# Elasticities below this are rounding; more bars than these cannot be read.
_NO_INFLUENCE, _MOST_BARS = 1e-6, 24


def _beside(length: float) -> dict[str, Any]:
    """Place a number at the end of its bar, outside."""
    side = 1.0 if length > 0 else -1.0
    return {"xytext": (4 * side, 0), "textcoords": "offset points", "size": 9, "va": "center",
            "ha": "left" if side > 0 else "right", "color": GREY}  # fmt: skip


def _limit_text(known: dict[str, Any], k: int) -> str:
    return f"{known['name'][k]} = {known['value'][k]:.4g} {raised(known['unit'][k])}".rstrip()


def _limit_notes(known: dict[str, Any], elasticity: np.ndarray, hidden: int) -> str:
    """What the bars do not show, in a few lines."""
    idle = np.flatnonzero(abs(elasticity) <= _NO_INFLUENCE)
    notes = []
    for text, is_zero in (("without influence", False), ("not shown as they are 0", True)):
        names = [known["name"][k] for k in idle if (known["value"][k] == 0) == is_zero]
        if names:
            notes.append(f"{text}: {', '.join(names)}")
    if hidden:
        notes.append(f"{hidden} shorter bars left out")
    if any(known["one_sided"]):
        notes.append("* counts when relaxed; tightened it counts differently")
    return "\n".join(line for note in notes for line in textwrap.wrap(note, 72))


def certificate(result: Result) -> Figure:
    """Proven bound over time with the gait's own value; right, the boxes over two durations.

    Needs ``proof_time``, ``proof_bound``, ``proof_value``; for sequences of three phases
    also ``leaf_shortest``, ``leaf_longest``, ``leaf_bound``.
    """
    leaves = "leaf_bound" in result
    drawn = sheet(11 if leaves else 6.5, 4.8)
    axes = drawn.subplots(1, 2 if leaves else 1, squeeze=False)[0]
    _draw_bound(axes[0], result)
    if leaves:
        _draw_leaves(axes[1], drawn, result)
    drawn.legend(loc="outside lower center", ncols=3)
    return drawn


def _draw_bound(axes: Axes, result: Result) -> None:
    time, bound, value = (result[f"proof_{name}"] for name in ("time", "bound", "value"))
    phases = scalar(result, "certified_phases")
    axes.step(time.values, bound.values, where="post", color=LINKS[0], linewidth=1.8,
              label=f"no gait of at most {phases} phases is better")  # fmt: skip
    axes.plot(time.values, value.values, color=LINKS[1], linewidth=1.8, label="the gait")
    axes.fill_between(time.values, value.values, bound.values, step="post", color=LINKS[0],
                      alpha=0.12, linewidth=0)  # fmt: skip
    axes.set_xlabel(label("time spent $t$", time.unit))
    axes.set_ylabel(label("objective and its bound", bound.unit))
    axes.set_title(facts(result, "gap_certified", "certified_phases"), loc="left")


def _draw_leaves(axes: Axes, drawn: Figure, result: Result) -> None:
    """Boxes over the first two durations, coloured by how far below the best they are."""
    low, high = result["leaf_shortest"], result["leaf_longest"]
    bound = result["leaf_bound"].values
    shortest, longest = scalar(result, "leaf_period")
    parts = [
        _part(a, b, shortest - b[2], longest - a[2])
        for a, b in zip(low.values, high.values, strict=True)
    ]
    there = np.array([len(part) > 2 for part in parts])
    drawing = PatchCollection(
        [Polygon(part) for part in parts if len(part) > 2],
        cmap="viridis", edgecolor="white", linewidth=0.4,
    )  # fmt: skip
    drawing.set_array(bound[there])
    axes.add_collection(drawing)
    name = label("bound on the speed in a box", result["leaf_bound"].unit)
    drawn.colorbar(drawing, ax=axes, label=name)
    own = scalar(result, "leaf_durations")
    if own:
        star = {"color": RED, "markersize": 13, "markeredgecolor": "white"}
        axes.plot(*own[:2], "*", label="durations of the gait", **star)
    axes.set_xlim(0.0, longest)
    axes.set_ylim(0.0, longest)
    axes.grid(visible=False)
    masses = [", ".join(map(str, resting)) for resting in scalar(result, "leaf_sequence")]
    axes.set_xlabel(label(f"how long {_rest(masses[0])}, $h_1$", low.unit))
    axes.set_ylabel(label(f"how long {_rest(masses[1])}, $h_2$", low.unit))
    axes.set_title(f"boxes of the sequence {' – '.join(masses)}", loc="left", color=GREY)


def _part(low: np.ndarray, high: np.ndarray, least: float, most: float) -> list[np.ndarray]:
    """Corners of what a box leaves to h_1 and h_2 where least <= h_1 + h_2 <= most."""
    (x, y), (X, Y) = low[:2], high[:2]
    corners = [np.array(corner) for corner in ((x, y), (X, y), (X, Y), (x, Y))]
    for sign, side in ((1.0, most), (-1.0, -least)):
        kept = []
        for a, b in zip(corners, np.roll(corners, -1, axis=0) if corners else [], strict=True):
            inside_a, inside_b = side - sign * a.sum(), side - sign * b.sum()
            if inside_a >= 0:
                kept.append(a)
            if inside_a * inside_b < 0:
                kept.append(a + (b - a) * inside_a / (inside_a - inside_b))
        corners = kept
    return corners


def _rest(masses: str) -> str:
    return f"masses {masses} rest" if "," in masses else f"mass {masses} rests"


def first_frame(result: Result) -> Figure:
    """The worm on the ground as the animation begins, for `pose` to change.

    Needs ``time``, ``resting`` and ``position``.
    """
    drawn = sheet(8, 2.6)
    _stage(drawn.subplots(), result)
    pose(drawn, result, 0)
    return drawn


def _stage(axes: Axes, result: Result) -> None:
    """Ground with ticks, wide enough for all periods shown."""
    position = result["position"].values
    reach = position[0].max() + (_PERIODS - 1) * (position[0, -1] - position[0, 0])
    margin = 0.04 * (reach - position.min())
    axes.set_xlim(position.min() - margin, reach + margin)
    axes.set_ylim(-0.75, 1.0)
    axes.axhspan(-0.75, -0.35, color="#EFEBE4", linewidth=0)
    axes.axhline(-0.35, color=GREY, linewidth=1.2)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(label("position $x$", result["position"].unit))


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the worm of `first_frame` to a frame (0 to ``FRAMES - 1``), in place.

    Masses at rest are filled and have their spikes out.
    """
    axes = drawn.axes[0]
    for old in [*axes.lines[1:], *axes.texts]:  # the first line is the ground
        old.remove()
    time, position = result["time"].values, result["position"].values
    turn, part = divmod(frame, _FRAMES_PER_PERIOD)
    t = time[-1] * part / _FRAMES_PER_PERIOD
    x = np.array([np.interp(t, time, row) for row in position])
    x += turn * (position[0, -1] - position[0, 0])
    rests = result["resting"].values[:, np.searchsorted(time, t, side="right") - 1].astype(bool)
    for j, colour in enumerate(shades(LINKS, len(x) - 1)):
        axes.plot(x[j : j + 2], [0, 0], color=colour, linewidth=4, alpha=0.8, zorder=2)
    for i, colour in enumerate(shades(MASSES, len(x))):
        if rests[i]:
            axes.plot(x[i], -0.37, marker="v", markersize=11, color=colour, zorder=3)
        axes.plot(x[i], 0, "o", markersize=19, markeredgecolor=colour, markeredgewidth=2.5,
                  markerfacecolor=colour if rests[i] else "white", zorder=4)  # fmt: skip
        axes.text(x[i], 0, str(i), color="white" if rests[i] else colour, zorder=5, **_CENTRED)
    axes.text(0.01, 0.9, f"t = {turn + part / _FRAMES_PER_PERIOD:.2f} T", color=GREY,
              transform=axes.transAxes)  # fmt: skip


def _draw_links(axes: Axes, result: Result, name: str, text: str) -> None:
    time, rows = result["time"].values, result[name].values
    for row, line in zip(rows, link_lines(len(rows)), strict=True):
        axes.plot(time, row, color=line.get_color(), ls=line.get_linestyle(), linewidth=1.8)
    axes.set_xlim(time[0], time[-1])
    axes.set_ylabel(label(text, result[name].unit))


def _draw_band(axes: Axes, result: Result) -> None:
    """One row per mass, filled while it rests, and the glides shaded through all rows."""
    time, resting = result["time"].values, result["resting"].values.astype(bool)
    for start, end in stretches(time, ~np.any(resting, axis=0)):
        axes.axvspan(start, end, color=GLIDE, linewidth=0)
    for i, (rests, colour) in enumerate(zip(resting, shades(MASSES, len(resting)), strict=True)):
        bars = [(start, end - start) for start, end in stretches(time, rests)]
        axes.broken_barh(bars, (i - 0.38, 0.76), color=colour, linewidth=0)
    axes.set_yticks(range(len(resting)), [str(i) for i in range(len(resting))])
    axes.set_ylim(len(resting) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_ylabel("mass\nat rest")
