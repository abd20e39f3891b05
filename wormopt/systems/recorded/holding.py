"""Picture of the ground that holds a worm with fitted friction."""

from __future__ import annotations

from matplotlib.figure import Figure

from wormopt.pictures.page import Page
from wormopt.pictures.style import DASHES, LINKS, MASSES
from wormopt.result import Result


def holding(result: Result) -> Figure:
    """Draw the force of the ground on resting masses, and what is left until one slips."""
    page = Page(result, 4.6, 4.6)
    above, below = page.rows(3, 2)
    for i, row in enumerate(page["held"]):
        above.curve("time", row, f"mass {i}", color=MASSES[i % len(MASSES)], ls=DASHES[i % 4])
    forward, backward = (result.scalars[f"{way}_found"].value for way in ("forward", "backward"))
    above.limits([(max(backward), -max(forward))])
    above.label(y="ground on resting mass", of="held")
    time, left, error = (page[f"band_{name}"] for name in ("time", "load", "error"))
    below.curve(time, left, "with the estimates", color=LINKS[0])
    below.band(time, left - error, left + error, "for all parameters in the ellipsoid",
               color=LINKS[0])  # fmt: skip
    below.level(0.0, color="black", ls="-", lw=0.7)
    below.label(y="left until it slips", of="band_load")
    below.named("x", "band_time", "time $t$ in a cycle")
    for panel in (above, below):
        panel.axes.margins(x=0)
    page.facts(speed="", plant_share="speed over that of the gait designed with true parameters")
    return page.legend()
