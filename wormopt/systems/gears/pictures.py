"""Pictures of scenes of kind "gait-shift"."""

from __future__ import annotations

from matplotlib.figure import Figure

from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import GREY, LIMIT, LINKS, RED, raised
from wormopt.result import Result

# name, variables of time, gear and place, colour, dashes
_SCHEDULES = (
    ("supervisor", "stroke_time", "stroke", LINKS[0], "-"),
    ("best schedule", "best_stroke_time", "best_stroke", GREY, (0, (2, 1))),
    ("tracked chain", "adaptive_sample", "adaptive", LINKS[1], (0, (5, 1.5))),
)


def shift(result: Result) -> Figure:
    """Draw gear, loads with their limits and position over time, and the load along the route."""
    page = Page(result, 6.6, 7.6)
    gear, spike, force, position, ground = page.rows(1, 1.2, 1.2, 1.4, 1, share=False)
    for upper in (gear, spike, force):
        upper.axes.sharex(position.axes)
        upper.axes.tick_params(labelbottom=False)
    for name, time, of, color, dashes in _SCHEDULES:
        look = {"color": color, "ls": dashes}
        if f"{of}_gear" in page:
            gear.curve(page[time], page[f"{of}_gear"], name, ds="steps-post", **look)
        if f"{of}_place" in page:
            position.curve(page[time], page[f"{of}_place"], name, **look)
    count = len(page["gear_speeds"])
    gear.axes.set(yticks=range(count), ylim=(-0.3, count - 0.7), ylabel="gear")
    for panel, name, words in ((spike, "spike_load", "spike load"),
                               (force, "actuator_force", "actuator force")):  # fmt: skip
        # strokes of a cycle differ: a line would fill the band between their curves
        panel.curve(page["stroke_time"], f"stroke_{name}", words=words, ls="", marker=".",
                    color=LINKS[0], ms=1.2)  # fmt: skip
        panel.entry("largest in each stroke", LINKS[0], "none", marker=".")
        if page.get(f"{name}_limit") is not None:
            panel.level(f"{name}_limit", color=RED, lw=1)
            panel.entry("limit", RED, LIMIT, 1)
        panel.axes.set_ylim(bottom=0)
    alone, place = page.get("fixed_time"), page["stroke_place"]
    if alone is not None:
        position.curve([0.0, alone], place[[0, -1]], "best single gear", color=GREY, lw=0.8)
    ends = [page[name][-1] for name in ("stroke_time", "adaptive_sample") if name in page]
    position.axes.set_xlim(0.0, 1.02 * max(ends))
    position.label("time $t$", of="stroke_time")
    position.label(y="mean position $x$", of="stroke_place")
    _draw_ground(ground)
    for panel in (gear, spike, force, position, ground):
        panel.legend()
    page.facts(time="arrives at", best_time="best in hindsight", fixed_time="best single gear")
    return page.drawn


def _draw_ground(panel: Panel) -> None:
    """Draw the load along the route, and limits of gears near it."""
    page, load = panel.page, panel.page["stroke_load"]
    panel.curve("stroke_place", "stroke_load", "on each mass", color="black", words="load")
    for k, (_, most) in enumerate(page["gear_loads"]):
        if most < 2 * load.max():
            panel.level(most, f"limit of gear {k}", color=LINKS[k % 8])
    panel.axes.set_ylim(bottom=0)
    panel.label("mean position $x$", of="stroke_place")


def transitions(result: Result) -> Figure:
    """Draw speed and admissible loads of each gear, and durations of the shifts between them."""
    page = Page(result, 2.6, 3.0)
    panel, axes, speeds = page.panel(), page.panels[0].axes, page["gear_speeds"]
    loads = page["gear_loads"]
    for k, (speed, (low, high)) in enumerate(zip(speeds, loads, strict=True)):
        panel.curve([low, high], [speed, speed], color=LINKS[k % 8], lw=4)
        axes.annotate(f"gear {k}, {page['gear_resting'][k]} at rest", (high, speed), (0, 5),
                      textcoords="offset points", ha="right", fontsize="small")  # fmt: skip
    unit = raised(page.unit("up_durations"))
    durations = zip(page["up_durations"], page["down_durations"], strict=True)
    for k, (up, down) in enumerate(durations):
        both = max(loads[k][0], loads[k + 1][0]), min(loads[k][1], loads[k + 1][1])
        at = both[0] + (both[1] - both[0]) / 4
        panel.arrow((at, speeds[k]), (at, speeds[k + 1]), GREY, "<->")
        note = f"  shifts take {up:.3g} up, {down:.3g} down {unit}".rstrip()
        note = note if up + down else "  shifts take no time"
        axes.annotate(note, (at, (speeds[k] + speeds[k + 1]) / 2), va="center", fontsize="small")
    axes.set_ylim(0, 1.2 * max(speeds))
    axes.set_xlim(left=0)
    panel.label(r"admissible load $\Gamma$ on each mass", of="gear_loads")
    panel.label(y="mean speed", of="gear_speeds")
    return page.drawn
