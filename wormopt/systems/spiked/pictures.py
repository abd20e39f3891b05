"""Pictures of gaits, designs, fronts, proofs and steps.

Times appear twice where something jumps, so lines draw the jumps.

Limits are scalars of a result, or attributes, that may be missing: ``length_limits`` ([low, high]
or one such pair per link), ``rate_limit`` (a number, one per link, or [contraction, extension]
with one list each), ``acceleration_limit`` and ``actuator_force_limit`` (a number or one per
link), ``spike_load_limit`` (a number or one per mass).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import (
    CENTRED,
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    RED,
    colours,
    line,
    narrow,
    number,
    patch,
    raised,
    stretches,
)
from wormopt.result import Result
from wormopt.shown import whole_lists

CYCLES = 2  # cycles shown of a motion
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
    heights = (2.0, 1.4, 1.4, 0.25 + 0.12 * len(result["resting"].values))
    page = Page(result, 0.5 + sum(heights), 1.1 + 0.75 * sum(heights))
    *panels, rests = page.rows(*heights)
    for panel, name, text in zip(
        panels,
        ("length", "rate", "acceleration"),
        ("link length $l_j$", r"rate $\dot l_j$", r"acceleration $\ddot l_j$"),
        strict=True,
    ):
        panel.curves("time", name, words=text)
        panel.limits(_limits(page, f"{name}_limits" if name == "length" else f"{name}_limit", name))
    panels[0].legend()
    rests.rests("time", "resting")
    _tell(page, advance="", period="")
    value, speed = page.get("objective"), page.get("speed")
    proven = value == speed and page.get("gap_certified") is not None
    page.facts(page.fact("bound", "proven bound") if proven else
               page.fact("ceiling", "no gait is faster than"))  # fmt: skip
    return _at_the_knee(page)


def _tell(page: Page, **more: Any) -> None:
    page.facts(speed="mean speed", **more)


def _at_the_knee(page: Page) -> Figure:
    """Say of the gait of a front that it is the one at the knee."""
    if "front_speed" in page:
        knee, last = page.get("front_knee"), len(page["front_speed"]) - 1
        which = "" if knee is None else f", point {knee} of 0 to {last}"
        page.facts(f"the gait at the knee of the front{which}")
    return page.drawn


def _limits(page: Page, name: str, of: str) -> list[tuple[float, ...]]:
    """Limits, a tuple for each link or mass: ranges of lengths, absolute values, or loads."""
    limit, count = page.get(name), len(page[of])
    if limit is None:
        return []
    pairs = isinstance(limit, list) and isinstance(limit[0], list)
    if of == "length":
        return [tuple(pair) for pair in (limit if pairs else [limit] * count)]
    if pairs:
        return [(-contraction, extension) for contraction, extension in zip(*limit, strict=True)]
    values = limit if isinstance(limit, list) else [limit] * count
    return [(value,) if of == "reaction" else (-value, value) for value in values]


def motion(result: Result) -> Figure:
    """Draw the path of every mass over two cycles, time upward.

    This is the form of figure 3 of Zimmermann et al. 2007. Needs ``time``, ``resting``,
    ``position``. Heavy lines: a mass rests; shaded: glides.
    """
    page = Page(result, 5.6, 3.9)
    panel, time, position = page.panel(), page["time"], page["position"]
    cycle, advance = time[-1], position[0, -1] - position[0, 0]
    resting, own = page["resting"] > 0, colours("mass", len(position))
    glides = stretches(time, ~np.any(resting, axis=0))
    for turn in range(CYCLES):
        t, x = time + turn * cycle, position + turn * advance
        for start, end in glides:
            panel.axes.axhspan(start + turn * cycle, end + turn * cycle, color=GLIDE, linewidth=0)
        for i, color in enumerate(own):
            panel.curve(x[i], t, color=color, lw=1)
            spans = [[(np.interp(at, t, x[i]), at) for at in span]
                     for span in stretches(t, resting[i])]  # fmt: skip
            panel.axes.add_collection(
                LineCollection(spans, colors=color, linewidths=4, zorder=3, capstyle="butt")
            )
    for i, color in enumerate(own):
        disc = {"boxstyle": "circle,pad=0.25", "fc": color, "ec": "white"}
        for x, t in ((position[i, 0], 0.0), (position[i, -1] + advance, CYCLES * cycle)):
            panel.axes.text(x, t, str(i), bbox=disc, color="white", zorder=5, size=7, **CENTRED)
    panel.axes.margins(0.04, 0.06)
    panel.named("x", "position", "position $x_i$; mass 0 is the head")
    panel.named("y", "time")
    panel.entries += [line("rests on its spikes", lw=4), line("moves", lw=1)]
    panel.entries += [patch("the worm glides", GLIDE)] if glides else []
    _tell(page, advance="", period="")
    page.legend()
    return _at_the_knee(page)


def spikes(result: Result) -> Figure:
    """Draw spike loads, lambda and sigma of eq. 7, and actuator forces over a cycle with limits."""
    page = Page(result, 5.8, 5.2)
    loads, mean, forces = page.rows(3, 2, 2.5)
    masses = len(page["reaction"])
    for i, color in enumerate(colours("mass", masses)):
        loads.band("time", 0, page["reaction"][i], color=color, alpha=0.12)
    loads.curves("time", "reaction", words=r"load on spikes $\lambda_i$")
    for i, drawn in enumerate(loads.axes.lines):
        drawn.set_zorder(3 + (masses - i) / masses)
    loads.limits(_limits(page, "spike_load_limit", "reaction"), "mass")
    if jumps := page.get("impulses") or []:
        top = loads.axes.get_xaxis_transform()
        loads.curve([at for at, _ in jumps], [1.0] * len(jumps), "impulse", marker="v", color=RED,
                    ls="none", clip_on=False, transform=top)  # fmt: skip
    mean.curve("time", "sigma", r"$\sigma$, needed to prevent gliding", color="#BBBBBB", lw=3,
               words="mean over the masses")  # fmt: skip
    mean.curve("time", "reaction_mean", r"$\lambda$, mean spike load", color="black", lw=1)
    mean.level(0.0, ls="-")
    forces.curves("time", "actuator_force", words=r"actuator force $\mu_j$")
    forces.limits(_limits(page, "actuator_force_limit", "actuator_force"))
    for panel in (loads, mean, forces):
        panel.legend()
    page.facts(spike_load_max="largest load on a spike",
               actuator_force_max="largest actuator force")  # fmt: skip
    return _at_the_knee(page)


# -- limits and what they cost ---------------------------------------------------------------------

# Smaller elasticities are rounding; more bars cannot be read.
_NO_INFLUENCE, _MOST_BARS = 1e-6, 24


def limits(result: Result) -> Figure:
    """Draw bars of the relative sensitivity of the objective to each limit.

    Needs ``limit_elasticity`` and the attribute ``limits``. The longest is on top; limits
    that do not bind are named in the heading.
    """
    elasticity = result["limit_elasticity"].values
    binding = [k for k in np.argsort(-abs(elasticity)) if abs(elasticity[k]) > _NO_INFLUENCE]
    shown = binding[:_MOST_BARS]
    tall = 0.9 + 0.24 * max(3, len(shown))
    page = Page(result, tall, tall + 0.2)
    panel, known = page.panel(), page["limits"]
    axes, better = panel.axes, 1.0 if known["objective"] == "speed" else -1.0
    for place, k in enumerate(shown):
        length = float(elasticity[k])
        helps = better * length > 0
        axes.barh(place, length, 0.66, color=LINKS[0] if helps else LINKS[3],
                  hatch=None if helps else "////", edgecolor="white", linewidth=0)  # fmt: skip
        mark = " *" if known["one_sided"][k] else ""
        axes.text(1.02, place, f"{length:+.3g}{mark}".replace("-", "−"), color=GREY, size=7.5,
                  va="center", transform=axes.get_yaxis_transform())  # fmt: skip
    panel.level(0.0, axis="x", ls="-")
    axes.set_yticks(range(len(shown)), [_limit_text(known, k) for k in shown])
    axes.set_ylim(max(3, len(shown)) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.05)
    cost = OBJECTIVES.get(known["objective"], "").partition(",")[0]
    of = f"of the {cost}" if cost else "of speed"
    panel.label(rf"relative sensitivity {of} to the limit ($\%/\%$)", "limit")
    page.facts(*_limit_notes(known, elasticity, len(binding) - len(shown)))
    return page.legend(
        patch("better when raised", LINKS[0]),
        patch("better when lowered", LINKS[3], hatch="////", edgecolor="white"),
    )


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
        notes += [f"{text}: {', '.join(whole_lists(names, known['name']))}"] if names else []
    notes += [f"{hidden} shorter bars not shown"] if hidden else []
    if any(known["one_sided"]):
        notes.append("* sensitivity to relaxing; that to tightening differs")
    return notes


# -- periods and loads at which kinematics alone determines the motion -----------------------------


def region(result: Result) -> Figure:
    """Draw the largest spike load by period and load, and where the worm glides or spikes break."""
    page = Page(result, 4.6, 3.9)
    panel, period, load = page.panel(), page["region_period"], page["region_load"]
    least, peaks = page["region_least_load"], page["region_spike_load"]
    panel.axes.grid(visible=False)
    if np.isfinite(peaks).any():
        # each column continues below the border, where it is covered, so that no cell ends above
        lowest = np.nanmin(peaks, axis=1, keepdims=True, initial=np.nanmax(peaks))
        held = np.where(np.isnan(peaks), lowest, peaks).T
        unit = page.unit("region_spike_load")
        panel.map("region_period", "region_load", held, f"largest load on a spike ({raised(unit)})",
                  cmap="Blues", shading="gouraud")  # fmt: skip
    panel.band(period, load[0], least, "the worm glides", color=GLIDE, alpha=1, zorder=2)
    panel.curve(period, least, "smallest load without gliding, $w = 0$", color="black", lw=1.4,
                zorder=3)  # fmt: skip
    if "region_most_load" in result:
        _draw_strength(panel)
    own, at = page.get("region_gait_load"), page.get("period")
    if own is not None and at is not None:
        panel.curve(at, own, "this gait", marker="X", color=RED, mec="white", ms=9, zorder=5,
                    ls="none")  # fmt: skip
    panel.axes.set(xlim=(period[0], period[-1]), ylim=(load[0], load[-1]))
    panel.named("x", "region_period", "period $T$")
    panel.named("y", "region_load", r"load $\Gamma$ on every mass")
    panel.axes.tick_params(color=GREY)
    if least.min() > load[-1]:
        page.facts("the worm glides at all loads of this map")
    return page.legend()


def _draw_strength(panel: Panel) -> None:
    """Draw the loads at which a spike breaks."""
    page, period = panel.page, panel.page["region_period"]
    least, most = page["region_least_load"], page["region_most_load"]
    strength = number(page["region_spike_strength"])
    strength = f"{strength} {page.unit('region_spike_load')}".removesuffix(" 1")
    panel.band(
        period, np.maximum(most, least), max(page["region_load"][-1], most.max()),
        f"a spike carries more than {strength}", facecolor="none", edgecolor=RED, hatch="///",
        alpha=None, zorder=2,
    )  # fmt: skip
    # covered where the worm glides and breaks no spike
    panel.curve(period, most, color=RED, lw=1.4, zorder=1.5)


# -- a proof, and a Pareto front -------------------------------------------------------------------


def certificate(result: Result) -> Figure:
    """Draw the proven bound over time with the objective of the gait.

    Needs ``proof_time``, ``proof_bound``, ``proof_value``.
    """
    page = Page(result, 3.2, 3.0)
    panel = page.panel()
    time, bound, value = (page[f"proof_{name}"] for name in ("time", "bound", "value"))
    panel.curve(time, bound, "proven bound for all gaits", ds="steps-post", marker=".",
                color=LINKS[0])  # fmt: skip
    panel.curve(time, value, "this gait", color="black", ls=(0, (4, 2)))
    panel.band(time, value, bound, step="post", color=LINKS[0], alpha=0.12)
    panel.named("x", "proof_time", "computing time $t$")
    panel.named("y", "proof_bound", "objective and its bound")
    _tell(page, bound="proven bound", gap_certified="gap")
    return page.legend()


def front(result: Result) -> Figure:
    """Draw speed and cost of all points; neighbours with one resting sequence are joined."""
    page = Page(result, 5.2)
    panel, x, y = page.panel(), page["front_speed"], page["front_value"]
    accepted = page["front_accepted"] > 0
    order = page["front_order"] if "front_order" in page else np.zeros(len(x))
    joined = np.argsort(x)
    joined = joined[accepted[joined]]
    jumps = np.flatnonzero(np.diff(order[joined])) + 1
    for k, run in enumerate(np.split(joined, jumps)):
        panel.curve(x[run], y[run], "" if k else "best found", marker="o", color=LINKS[0], lw=1.6,
                    ms=7)  # fmt: skip
    for k, at in enumerate(jumps):
        panel.level(x[joined[at - 1 : at + 1]].mean(), "" if k else "resting sequence changes",
                    axis="x", ls=":", lw=1)  # fmt: skip
    if not accepted.all():
        panel.curve(x[~accepted], y[~accepted], "not accepted", marker="o", ls="none", color=RED,
                    mfc="none", markeredgewidth=1.6, ms=8)  # fmt: skip
    knee = page.get("front_knee")
    if knee is not None:
        panel.curve(x[knee], y[knee], f"knee, point {knee}", marker="*", ls="none", ms=15,
                    color=LINKS[1], mec="white", zorder=4)  # fmt: skip
    panel.level("ceiling", "ceiling on speed", axis="x", ls="--", lw=1)
    objective = str(page.get("front_objective") or "")
    panel.named("x", "front_speed", "mean speed $v$")
    panel.named("y", "front_value",
                OBJECTIVES.get(objective, objective.replace("_", " ") or "objective"))  # fmt: skip
    panel.axes.margins(0.06)
    return page.legend()


# -- step commands ---------------------------------------------------------------------------------


def steps(result: Result) -> Figure:
    """Draw commanded and ideal lengths, a reversal, motor rates and positions of the masses.

    The result is of kind ``stepper``; motor 0 drives link 0.
    """
    page = Page(result, 7.2, 7.6, ("mm", "mm s-1"))
    lengths, rates, places, turn = page.rows(2.4, 2, 3, 2.2, share=False)
    lengths.curves(page["time"], "commanded", legend=False, words="length $l_j$", lw=3, alpha=0.35,
                   ls="-")  # fmt: skip
    lengths.curves(page["time"], "length", lw=0.9, ls="-")
    lengths.entry("commanded", lw=3, alpha=0.4)
    lengths.entry("gait", lw=0.9)
    rates.curves(page["time"], "turn_rate", legend=False)
    for name, text, style in (
        ("turn_rate_limit", "limit of the motor", {"color": RED, "ls": LIMIT, "lw": 0.9}),
        ("start_rate", "start rate", {"color": GREY, "ls": ":", "lw": 0.9}),
    ):
        if level := float(page.get(name) or 0.0):
            rates.level(level, text, **style)
            rates.level(-level, **style)
    rates.label(y="rate of the motors (turns s$^{-1}$)")
    places.curves("time", "position_ideal", legend=False, lw=0.9, ls=DASHES[1],
                  words="position $x_i$")  # fmt: skip
    places.curves("time", "position")
    places.entry("ideal gait", GREY, DASHES[1], 0.9)
    for panel in (lengths, rates):
        panel.axes.sharex(places.axes)
        panel.axes.tick_params(labelbottom=False)
    link, now = int(page["turn_link"][0]), page["turn_time"]
    commanded, ideal = (1e3 * (page[f"turn_{name}"] - page["turn_commanded"][0])
                        for name in ("commanded", "length"))  # fmt: skip
    turn.curve(now, commanded, "commanded", ds="steps-post", color=LINKS[link], lw=1.8, alpha=0.6)
    turn.curve(now, ideal, "gait", color="black", lw=0.9)
    turn.axes.margins(x=0)
    turn.label("close-up, time $t$ (s)", f"$l_{link}$ at a reversal, change (µm)")
    for panel in (lengths, rates, places, turn):
        panel.legend()
    page.facts(
        travel_per_step=("", "µm"), quantisation_error=("", "µm"), period="",
        period_min="shortest possible", speed="mean speed", speed_ideal="ideal", backslip="",
    )  # fmt: skip
    return page.drawn
