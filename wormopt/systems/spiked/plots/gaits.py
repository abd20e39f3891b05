"""Pictures of gaits and their design: lengths, paths, loads, limits.

Times appear twice where something jumps, so lines draw the jumps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wormopt.plotting.parts import (
    GLIDE,
    GREY,
    LINKS,
    MASSES,
    RED,
    ceilings,
    draw_limits,
    draw_rests,
    fact,
    handles,
    label,
    legend,
    legend_below,
    line,
    narrow,
    needed,
    raised,
    ranges,
    rate_ranges,
    scalar,
    shades,
    sheet,
    stretches,
    styles,
    symmetric,
    tell,
)
from wormopt.result import Result

CYCLES = 2  # cycles shown of a motion
CENTRED: dict[str, Any] = {"ha": "center", "va": "center_baseline", "weight": "bold"}
OBJECTIVES = {
    "peak_spike_load": r"largest load on a spike, max $\lambda_i$",
    "peak_actuator_force": r"largest actuator force, max $|\mu_j|$",
    "energy_per_distance": "energy per distance",
    "acceleration_effort": "acceleration effort",
}


def gait(result: Result) -> Figure:
    """Draw link lengths, rates and accelerations over a cycle with their limits, and rests.

    Needs ``time``, ``resting``, ``length``, ``rate``, ``acceleration``. Glides are shaded.
    """
    masses, links = len(result["resting"].values), len(result["length"].values)
    heights = (2.0, 1.4, 1.4, 0.25 + 0.12 * masses)
    drawn = sheet(7.1, 0.5 + sum(heights), 1.1 + 0.75 * sum(heights))
    panels = drawn.subplots(4, sharex=True, height_ratios=heights)
    for axes, name, text, limits in zip(
        panels,
        ("length", "rate", "acceleration"),
        ("link length $l_j$", r"rate $\dot l_j$", r"acceleration $\ddot l_j$"),
        (
            ranges(scalar(result, "length_limits"), links),
            rate_ranges(scalar(result, "rate_limit"), links),
            symmetric(scalar(result, "acceleration_limit"), links),
        ),
        strict=False,
    ):
        _draw_links(axes, result, name, text)
        told = draw_limits(axes, limits, shades(LINKS, links))
        if axes is panels[0]:
            legend(axes, [*handles("link", links), *told])
    draw_rests(panels[-1], result["time"].values, result["resting"].values.astype(bool))
    panels[-1].set_xlabel(label("time $t$", result["time"].unit))
    tell(drawn, *_cycle(result), _fastest(result))
    drawn.align_ylabels()
    return drawn


def _cycle(result: Result) -> list[str]:
    """Speed, advance and period."""
    return [fact(result, "speed", "mean speed"), fact(result, "advance"), fact(result, "period")]


def _fastest(result: Result) -> str:
    """Upper bound on the speed: the proven one if there is one, else the ceiling."""
    value, speed = scalar(result, "objective"), scalar(result, "speed")
    if value == speed and scalar(result, "gap_certified") is not None:
        return fact(result, "bound", "proven bound")
    return fact(result, "ceiling", "no gait is faster than")


def motion(result: Result) -> Figure:
    """Draw the path of every mass over two cycles, time upward.

    This is the form of figure 3 of Zimmermann et al. 2007. Needs ``time``, ``resting``,
    ``position``. Heavy lines: a mass rests; shaded: glides.
    """
    time, position = result["time"].values, result["position"].values
    cycle, advance = time[-1], position[0, -1] - position[0, 0]
    drawn = sheet(7.1, 5.6, 3.9)
    axes = drawn.subplots()
    resting = result["resting"].values.astype(bool)
    glides = stretches(time, ~np.any(resting, axis=0))
    for turn in range(CYCLES):
        t, x = time + turn * cycle, position + turn * advance
        for start, end in glides:
            axes.axhspan(start + turn * cycle, end + turn * cycle, color=GLIDE, linewidth=0)
        for i, colour in enumerate(shades(MASSES, len(x))):
            axes.plot(x[i], t, color=colour, linewidth=1)
            axes.add_collection(_heavy(x[i], t, resting[i], colour))
    for i, colour in enumerate(shades(MASSES, len(position))):
        for x, t in ((position[i, 0], 0.0), (position[i, -1] + advance, CYCLES * cycle)):
            disc = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
            axes.text(x, t, str(i), bbox=disc, color="white", zorder=5, size=7, **CENTRED)
    axes.margins(0.04, 0.06)
    axes.set_xlabel(label("position $x_i$; mass 0 is the head", result["position"].unit))
    axes.set_ylabel(label("time $t$", result["time"].unit))
    tell(drawn, *_cycle(result))
    entries: list[Artist] = [line("rests on its spikes", width=4), line("moves", width=1)]
    if glides:
        entries.append(Patch(color=GLIDE, label="the worm glides"))
    legend_below(drawn, entries)
    return drawn


def _heavy(x: np.ndarray, t: np.ndarray, rests: np.ndarray, colour: str) -> LineCollection:
    """Parts of a path on which the mass rests, as heavy lines."""
    lines = [[(np.interp(at, t, x), at) for at in stretch] for stretch in stretches(t, rests)]
    return LineCollection(lines, colors=colour, linewidths=4, zorder=3, capstyle="butt")


def spikes(result: Result) -> Figure:
    """Draw spike loads, lambda and sigma of eq. 7, and actuator forces over a cycle with limits.

    Needs ``time``, ``resting``, ``reaction``, ``reaction_mean``, ``sigma`` and
    ``actuator_force``. Impulses, where velocities jump, are marked above.
    """
    masses, links = len(result["reaction"].values), len(result["actuator_force"].values)
    time, own = result["time"].values, shades(MASSES, masses)
    drawn = sheet(7.1, 5.8, 5.2)
    loads, mean, forces = drawn.subplots(3, sharex=True, height_ratios=(3, 2, 2.5))
    for i, (load, colour) in enumerate(zip(result["reaction"].values, own, strict=True)):
        loads.plot(time, load, color=colour, zorder=3 + (masses - i) / masses)
        loads.fill_between(time, load, color=colour, alpha=0.12, linewidth=0)
    told = draw_limits(loads, ceilings(scalar(result, "spike_load_limit"), masses), own)
    legend(loads, [*handles("mass", masses), *told, *_draw_impulses(loads, result)])
    loads.set_ylabel(label("load on spikes\n$\\lambda_i$", result["reaction"].unit))
    mean.plot(time, result["sigma"].values, color="#BBBBBB", linewidth=3,
              label=r"$\sigma$, needed to prevent gliding")  # fmt: skip
    mean.plot(time, result["reaction_mean"].values, color="black", linewidth=1,
              label=r"$\lambda$, mean spike load")  # fmt: skip
    mean.axhline(0.0, color=GREY, linewidth=0.8)
    legend(mean)
    mean.set_ylabel(label("mean over\nthe masses", result["sigma"].unit))
    _draw_links(forces, result, "actuator_force", "actuator\nforce $\\mu_j$")
    told = draw_limits(
        forces, symmetric(scalar(result, "actuator_force_limit"), links), shades(LINKS, links)
    )
    legend(forces, [*handles("link", links), *told])
    forces.set_xlabel(label("time $t$", result["time"].unit))
    tell(
        drawn,
        fact(result, "spike_load_max", "largest load on a spike"),
        fact(result, "actuator_force_max", "largest actuator force"),
    )
    drawn.align_ylabels()
    return drawn


def _draw_impulses(axes: Axes, result: Result) -> list[Artist]:
    """Draw arrows from above where velocities jump; returns their legend entries."""
    jumps = scalar(result, "impulses") or []
    style: dict[str, Any] = {"marker": "v", "color": RED, "linestyle": "none", "markersize": 5}
    across = axes.get_xaxis_transform()
    return [
        *axes.plot([at for at, _ in jumps], [1.0] * len(jumps), transform=across, clip_on=False,
                   label="impulse", **style)
    ] if jumps else []  # fmt: skip


def limits(result: Result) -> Figure:
    """Draw bars of the relative sensitivity of the objective to each limit.

    Needs ``limit_elasticity`` and the attribute ``limits``. The longest is on top; limits
    that do not bind are named in the heading.
    """
    elasticity, known = result["limit_elasticity"].values, needed(result, "limits")
    binding = [k for k in np.argsort(-abs(elasticity)) if abs(elasticity[k]) > _NO_INFLUENCE]
    shown = binding[:_MOST_BARS]
    tall = 0.9 + 0.24 * max(3, len(shown))
    drawn = sheet(7.1, tall, tall + 0.2)
    axes = drawn.subplots()
    better = 1.0 if known["objective"] == "speed" else -1.0
    for place, k in enumerate(shown):
        length = float(elasticity[k])
        helps = better * length > 0
        axes.barh(place, length, 0.66, color=LINKS[0] if helps else LINKS[3],
                  hatch=None if helps else "////", edgecolor="white", linewidth=0)  # fmt: skip
        mark = " *" if known["one_sided"][k] else ""
        axes.text(1.02, place, f"{length:+.3g}{mark}".replace("-", "−"), color=GREY, size=7.5,
                  va="center", transform=axes.get_yaxis_transform())  # fmt: skip
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(shown)), [_limit_text(known, k) for k in shown])
    axes.set_ylim(max(3, len(shown)) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.05)
    axes.set_ylabel("limit")
    cost = OBJECTIVES.get(known["objective"], "").partition(",")[0]
    of = f"of the {cost}" if cost else "of speed"
    axes.set_xlabel(rf"relative sensitivity {of}" + (narrow() * "\n" or " ")
                    + r"to the limit ($\%/\%$)")  # fmt: skip
    tell(drawn, *_limit_notes(known, elasticity, len(binding) - len(shown)))
    legend_below(drawn, [
        Patch(facecolor=LINKS[0], label="better when raised"),
        Patch(facecolor=LINKS[3], hatch="////", edgecolor="white", linewidth=0,
              label="better when lowered"),
    ])  # fmt: skip
    return drawn


# Smaller elasticities are rounding; more bars cannot be read.
_NO_INFLUENCE, _MOST_BARS = 1e-6, 24


def _limit_text(known: dict[str, Any], k: int) -> str:
    between = "\n= " if narrow() else " = "
    name = known["name"][k].removeprefix("gait.") if narrow() else known["name"][k]
    return f"{name}{between}{known['value'][k]:.4g} {raised(known['unit'][k])}".rstrip()


def _limit_notes(known: dict[str, Any], elasticity: np.ndarray, hidden: int) -> list[str]:
    """Notes on limits without a bar."""
    idle = np.flatnonzero(abs(elasticity) <= _NO_INFLUENCE)
    notes = []
    for text, is_zero in (("no influence", False), ("not shown because they are 0", True)):
        names = [known["name"][k] for k in idle if (known["value"][k] == 0) == is_zero]
        if names:
            notes.append(f"{text}: {', '.join(names)}")
    if hidden:
        notes.append(f"{hidden} shorter bars not shown")
    if any(known["one_sided"]):
        notes.append("* sensitivity to relaxing; that to tightening differs")
    return notes


def _draw_links(axes: Axes, result: Result, name: str, text: str) -> None:
    time, rows = result["time"].values, result[name].values
    for row, (colour, dashes) in zip(rows, styles(LINKS, len(rows)), strict=True):
        axes.plot(time, row, color=colour, linestyle=dashes)
    axes.set_xlim(time[0], time[-1])
    axes.set_ylabel(label(text, result[name].unit))
