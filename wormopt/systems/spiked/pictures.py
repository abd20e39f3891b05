"""Pictures of gaits, designs, fronts, proofs and steps.

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
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
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
    number,
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
    wrapped,
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
        limit_lines = draw_limits(axes, limits, shades(LINKS, links))
        if axes is panels[0]:
            legend(axes, [*handles("link", links), *limit_lines])
    draw_rests(panels[-1], result["time"].values, result["resting"].values.astype(bool))
    panels[-1].set_xlabel(label("time $t$", result["time"].unit))
    tell(drawn, *_cycle(result), _fastest(result))
    drawn.align_ylabels()
    return _tell_knee(drawn, result)


def _tell_knee(drawn: Figure, result: Result) -> Figure:
    """Say of the gait of a front that it is the one at the knee."""
    if "front_speed" in result:
        knee, last = scalar(result, "front_knee"), len(result["front_speed"].values) - 1
        which = "" if knee is None else f", point {knee} of 0 to {last}"
        tell(drawn, f"the gait at the knee of the front{which}")
    return drawn


def _cycle(result: Result) -> list[str]:
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
    return _tell_knee(drawn, result)


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
    limit_lines = draw_limits(loads, ceilings(scalar(result, "spike_load_limit"), masses), own)
    legend(loads, [*handles("mass", masses), *limit_lines, *_draw_impulses(loads, result)])
    loads.set_ylabel(label("load on spikes\n$\\lambda_i$", result["reaction"].unit))
    mean.plot(time, result["sigma"].values, color="#BBBBBB", linewidth=3,
              label=r"$\sigma$, needed to prevent gliding")  # fmt: skip
    mean.plot(time, result["reaction_mean"].values, color="black", linewidth=1,
              label=r"$\lambda$, mean spike load")  # fmt: skip
    mean.axhline(0.0, color=GREY, linewidth=0.8)
    legend(mean)
    mean.set_ylabel(label("mean over\nthe masses", result["sigma"].unit))
    _draw_links(forces, result, "actuator_force", "actuator\nforce $\\mu_j$")
    limit_lines = draw_limits(
        forces, symmetric(scalar(result, "actuator_force_limit"), links), shades(LINKS, links)
    )
    legend(forces, [*handles("link", links), *limit_lines])
    forces.set_xlabel(label("time $t$", result["time"].unit))
    tell(
        drawn,
        fact(result, "spike_load_max", "largest load on a spike"),
        fact(result, "actuator_force_max", "largest actuator force"),
    )
    drawn.align_ylabels()
    return _tell_knee(drawn, result)


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


# -- an animation, in which masses at rest have their spikes out -----------------------------------

_FRAMES_PER_CYCLE = 36
FRAMES = CYCLES * _FRAMES_PER_CYCLE


def first_frame(result: Result) -> Figure:
    """Draw the worm at the start of the animation, for `pose` to change.

    Needs ``time``, ``resting`` and ``position``.
    """
    drawn = sheet(7.1, 1.9, 1.3)
    _stage(drawn.subplots(), result)
    pose(drawn, result, 0)
    return drawn


def _stage(axes: Axes, result: Result) -> None:
    """Draw the ground with ticks, wide enough for all cycles shown."""
    position = result["position"].values
    reach = position[0].max() + (CYCLES - 1) * (position[0, -1] - position[0, 0])
    margin = 0.04 * (reach - position.min())
    axes.set_xlim(position.min() - margin, reach + margin)
    axes.set_ylim(-0.75, 1.0)
    axes.axhspan(-0.75, -0.35, color="#EFEBE4", linewidth=0)
    axes.axhline(-0.35, color=GREY, linewidth=1.2)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(label("position $x$; filled: at rest on its spikes", result["position"].unit))


def pose(drawn: Figure, result: Result, frame: int) -> None:
    """Move the worm of `first_frame` to a frame (0 to ``FRAMES - 1``), in place.

    Masses at rest are filled and have their spikes out.
    """
    axes = drawn.axes[0]
    for old in [*axes.lines[1:], *axes.texts]:  # the first line is the ground
        old.remove()
    time, position = result["time"].values, result["position"].values
    turn, part = divmod(frame, _FRAMES_PER_CYCLE)
    t = time[-1] * part / _FRAMES_PER_CYCLE
    x = np.array([np.interp(t, time, row) for row in position])
    x += turn * (position[0, -1] - position[0, 0])
    rests = result["resting"].values[:, np.searchsorted(time, t, side="right") - 1].astype(bool)
    size = 0.8 if drawn.get_figwidth() > 5 else 0.65
    for j, colour in enumerate(shades(LINKS, len(x) - 1)):
        axes.plot(x[j : j + 2], [0, 0], color=colour, linewidth=4 * size, alpha=0.8, zorder=2)
    for i, colour in enumerate(shades(MASSES, len(x))):
        if rests[i]:
            axes.plot(x[i], -0.37, marker="v", markersize=11 * size, color=colour, zorder=3)
        axes.plot(x[i], 0, "o", markersize=19 * size, markeredgecolor=colour,
                  markeredgewidth=2.5 * size,
                  markerfacecolor=colour if rests[i] else "white", zorder=4)  # fmt: skip
        axes.text(x[i], 0, str(i), color="white" if rests[i] else colour, zorder=5,
                  size=7, **CENTRED)  # fmt: skip
    axes.text(0.01, 0.9, f"cycle {turn + part / _FRAMES_PER_CYCLE:.2f}", color=GREY,
              transform=axes.transAxes)  # fmt: skip


# -- periods and loads at which kinematics alone determines the motion -----------------------------


def region(result: Result) -> Figure:
    """Draw the largest spike load by period and load, and where the worm glides or spikes break.

    Needs ``region_period``, ``region_load``, ``region_spike_load`` and ``region_least_load``;
    ``region_most_load`` if the strength of a spike is known. A cross marks the gait itself.
    """
    period, load = result["region_period"], result["region_load"]
    least, peaks = result["region_least_load"].values, result["region_spike_load"]
    top = load.values[-1]
    drawn = sheet(7.1, 4.6, 3.9)
    axes = drawn.subplots()
    axes.grid(visible=False)
    if np.isfinite(peaks.values).any():
        # each column continues below the border, where it is covered, so that no cell ends above
        lowest = np.nanmin(peaks.values, axis=1, keepdims=True, initial=np.nanmax(peaks.values))
        held = np.where(np.isnan(peaks.values), lowest, peaks.values).T
        image = axes.pcolormesh(
            period.values, load.values, held, cmap="Blues", shading="gouraud", rasterized=True
        )
        drawn.colorbar(image, ax=axes, label=label("largest load on a spike", peaks.unit))
    axes.fill_between(period.values, load.values[0], least, color=GLIDE, linewidth=0, zorder=2)
    axes.plot(period.values, least, color="black", linewidth=1.4, zorder=3)
    entries: list[Artist] = [
        Patch(facecolor=GLIDE, label="the worm glides"),
        line("smallest load without gliding, $w = 0$", "black"),
    ]
    if "region_most_load" in result:
        most = result["region_most_load"].values
        axes.fill_between(
            period.values, np.maximum(most, least), max(top, most.max()), facecolor="none",
            edgecolor=RED, hatch="///", linewidth=0, zorder=2,
        )  # fmt: skip
        # covered where the worm glides and breaks no spike
        axes.plot(period.values, most, color=RED, linewidth=1.4, zorder=1.5)
        strength = f"{number(scalar(result, 'region_spike_strength'))} {peaks.unit}"
        entries.append(
            Patch(facecolor="none", edgecolor=RED, hatch="///",
                  label=f"a spike carries more than {strength.removesuffix(' 1')}")
        )  # fmt: skip
    own, at = scalar(result, "region_gait_load"), scalar(result, "period")
    if own is not None and at is not None:
        entries += axes.plot([at], [own], "X", color=RED, markeredgecolor="white", markersize=9,
                             zorder=5, linestyle="none", label="this gait")  # fmt: skip
    axes.set_xlim(period.values[0], period.values[-1])
    axes.set_ylim(load.values[0], top)
    axes.set_xlabel(label("period $T$", period.unit))
    axes.set_ylabel(label(r"load $\Gamma$ on every mass", load.unit))
    axes.tick_params(color=GREY)
    if least.min() > top:
        tell(drawn, "the worm glides at all loads of this map")
    legend_below(drawn, entries)
    return drawn


# -- a proof: the bound decreases towards the objective --------------------------------------------


def certificate(result: Result) -> Figure:
    """Draw the proven bound over time with the objective of the gait.

    Needs ``proof_time``, ``proof_bound``, ``proof_value``.
    """
    drawn = sheet(7.1, 3.2, 3.0)
    axes = drawn.subplots()
    time, bound, value = (result[f"proof_{name}"] for name in ("time", "bound", "value"))
    axes.step(time.values, bound.values, where="post", marker=".", color=LINKS[0],
              label="proven bound for all gaits")  # fmt: skip
    axes.plot(time.values, value.values, color="black", linestyle=(0, (4, 2)),
              label="this gait")  # fmt: skip
    axes.fill_between(time.values, value.values, bound.values, step="post", color=LINKS[0],
                      alpha=0.12, linewidth=0)  # fmt: skip
    axes.set_xlabel(label("computing time $t$", time.unit))
    axes.set_ylabel(label("objective and its bound", bound.unit))
    tell(
        drawn,
        fact(result, "speed", "mean speed"),
        fact(result, "bound", "proven bound"),
        fact(result, "gap_certified", "gap"),
    )
    legend_below(drawn)
    return drawn


# -- a Pareto front --------------------------------------------------------------------------------


def front(result: Result) -> Figure:
    """Draw speed and cost of all points; neighbours with one resting sequence are joined.

    Needs ``front_speed``, ``front_value`` and ``front_accepted``; ``front_order`` marks jumps.
    """
    speed, value = result["front_speed"], result["front_value"]
    accepted = result["front_accepted"].values.astype(bool)
    drawn = sheet(7.5, 5.5)
    axes = drawn.subplots()
    x, y = speed.values, value.values
    _draw_line(axes, result)
    if not accepted.all():
        axes.plot(x[~accepted], y[~accepted], "o", color=RED, markerfacecolor="none",
                  markeredgewidth=1.6, markersize=8, label="not accepted")  # fmt: skip
    _draw_knee(axes, result)
    ceiling = scalar(result, "ceiling")
    if ceiling is not None:
        axes.axvline(ceiling, color=GREY, linestyle="--", linewidth=1, label="ceiling on speed")
    objective = str(scalar(result, "front_objective") or "")
    name = OBJECTIVES.get(objective, objective.replace("_", " ") or "objective")
    axes.set_xlabel(label("mean speed $v$", speed.unit))
    axes.set_ylabel(label(wrapped(name, 24 if narrow() else 60), value.unit))
    axes.margins(0.06)
    legend_below(drawn)
    return drawn


def _draw_line(axes: Axes, result: Result) -> None:
    """Draw the points on the front, joined to the next one of the same resting sequence."""
    x, y = result["front_speed"].values, result["front_value"].values
    accepted = result["front_accepted"].values.astype(bool)
    order = result["front_order"].values if "front_order" in result else np.zeros(len(x))
    line = np.argsort(x)
    line = line[accepted[line]]
    jumps = np.flatnonzero(np.diff(order[line])) + 1
    for k, run in enumerate(np.split(line, jumps)):
        axes.plot(x[run], y[run], "o-", color=LINKS[0], linewidth=1.6, markersize=7,
                  label=None if k else "best found")  # fmt: skip
    for k, at in enumerate(jumps):
        axes.axvline(x[line[at - 1 : at + 1]].mean(), color=GREY, linestyle=":", linewidth=1,
                     label=None if k else "resting sequence changes")  # fmt: skip


def _draw_knee(axes: Axes, result: Result) -> None:
    knee = scalar(result, "front_knee")
    if knee is None:
        return
    at = result["front_speed"].values[knee], result["front_value"].values[knee]
    axes.plot(*at, "*", color=LINKS[1], markersize=15, markeredgecolor="white", zorder=4,
              label=f"knee, point {knee}")  # fmt: skip


# -- step commands ---------------------------------------------------------------------------------


def steps(result: Result) -> Figure:
    """Draw commanded and ideal lengths, a reversal, motor rates and positions of the masses.

    The result is of kind ``stepper``; motor 0 drives link 0.
    """
    drawn = sheet(7.1, 7.2, 7.6)
    lengths, rates, places, turn = drawn.subplots(4, height_ratios=(2.4, 2, 3, 2.2))
    rates.sharex(lengths)
    places.sharex(lengths)
    time, looks = result["time"].values, styles(LINKS, len(result["length"].values))
    for j, (colour, dashes) in enumerate(looks):
        lengths.plot(time, 1e3 * result["commanded"].values[j], color=colour, linewidth=3,
                     alpha=0.35)  # fmt: skip
        lengths.plot(time, 1e3 * result["length"].values[j], color=colour, linewidth=0.9)
        rates.plot(time, result["turn_rate"].values[j], color=colour, linestyle=dashes)
    wide = line("commanded", GREY, width=3)
    wide.set_alpha(0.4)
    legend(lengths, [*handles("link", len(looks)), wide, line("gait", width=0.9)])
    lengths.set_ylabel("length $l_j$ (mm)")
    _draw_motor_limits(rates, result)
    _draw_positions(places, result)
    for axes in (lengths, rates):
        axes.tick_params(labelbottom=False)
    places.set_xlim(time[0], time[-1])
    _close_up(turn, result)
    tell(
        drawn,
        fact(result, "travel_per_step", unit="µm"),
        fact(result, "quantisation_error", unit="µm"),
        fact(result, "period"),
        fact(result, "period_min", "shortest possible"),
        fact(result, "speed", "mean speed", "mm s-1"),
        fact(result, "speed_ideal", "ideal", "mm s-1"),
        fact(result, "backslip", unit="mm"),
    )
    drawn.align_ylabels()
    return drawn


def _close_up(axes: Axes, result: Result) -> None:
    """Draw the steps of one link near a reversal, relative to the length commanded there."""
    link = int(result["turn_link"].values[0])
    time = result["turn_time"].values
    base = result["turn_commanded"].values[0]
    commanded = 1e6 * (result["turn_commanded"].values - base)
    ideal = 1e6 * (result["turn_length"].values - base)
    axes.step(time, commanded, where="post", color=LINKS[link], linewidth=1.8, alpha=0.6,
              label="commanded")  # fmt: skip
    axes.plot(time, ideal, color="black", linewidth=0.9, label="gait")
    legend(axes)
    axes.margins(x=0)
    axes.set_ylabel(f"$l_{link}$ at a reversal,\nchange (µm)")
    axes.set_xlabel("close-up, time $t$ (s)")


def _draw_motor_limits(axes: Axes, result: Result) -> None:
    """Draw the motor's largest rate and start rate, in both directions."""
    limit, start = (float(scalar(result, k) or 0.0) for k in ("turn_rate_limit", "start_rate"))
    levels = [(limit, line("limit of the motor", RED, LIMIT, 0.9))]
    if start:
        levels.append((start, line("start rate", GREY, ":", 0.9)))
    for value, own in levels:
        for level in (-value, value):
            axes.axhline(level, color=own.get_color(), linestyle=own.get_linestyle(), lw=0.9)
    legend(axes, [own for _, own in levels])
    axes.set_ylabel(label("rate of the\nmotors", "turns s-1"))


def _draw_positions(axes: Axes, result: Result) -> None:
    """Draw positions of the masses by steps, and those of the ideal gait."""
    time = result["time"].values
    rows, ideal = result["position"].values, result["position_ideal"].values
    for row, lossless, colour in zip(rows, ideal, MASSES, strict=False):
        axes.plot(time, 1e3 * lossless, color=colour, linewidth=0.9, linestyle=DASHES[1])
        axes.plot(time, 1e3 * row, color=colour)
    dashed = line("ideal gait", GREY, DASHES[1], 0.9)
    legend(axes, [*handles("mass", len(rows)), dashed])
    axes.set_ylabel("position $x_i$\n(mm)")
    axes.set_xlabel("time $t$ (s)")
