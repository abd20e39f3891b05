"""Pictures of averaged motions."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wormopt.pictures.page import Page, Panel
from wormopt.pictures.style import DASHES, GREY, LINKS, MASSES, RED
from wormopt.result import Result


def reversals(result: Result) -> Figure:
    """Prescribed velocities over a period with their reversals, and the velocity of the centre.

    Above: masses slide backward below the line at -V; dots: reversals of the exact motion. Below:
    exact and averaged velocity of the centre, with the steady velocities.
    """
    page = Page(result, 5.0, 5.0)
    above, below = page.rows(1, 1, share=False)
    _draw_period(above)
    if "center_velocity" in page:
        below.curve("time", "center_velocity", "exact", color=LINKS[0], lw=1.8,
                    words="velocity of the centre $V$")  # fmt: skip
    below.curve("time", "center_velocity_averaged", "averaged, order 1", color=LINKS[1], lw=1.1,
                ls=DASHES[1], words="velocity of the centre $V$")  # fmt: skip
    named = set[str]()
    for V, stable in zip(page["steady_velocities"], page["steady_stable"], strict=True):
        text = "steady" if stable else "steady, unstable"
        below.level(V, "" if text in named else text, color=GREY if stable else RED, ls=":", lw=1,
                    zorder=1.5)  # fmt: skip
        named.add(text)
    below.legend()
    page.facts(velocity_exact_mean="mean velocity", smallness="small parameter",
               velocity_steady="steady velocity by averaging")  # fmt: skip
    return page.drawn


def _draw_period(panel: Panel) -> None:
    page, share = panel.page, panel.page["share"]
    panel.curves("share", "relative_velocity", worm=False, words="velocity relative to the centre")
    exact = page.get("velocity_exact_mean")
    panel.level(-page["velocity_steady"] if exact is None else -exact, "$-V$: a mass reverses",
                lw=0.9)  # fmt: skip
    if "event_share" in page:
        for at, contact in zip(page["event_share"], page["event_contact"], strict=True):
            here = np.interp(at, share, page["relative_velocity"][contact])
            color = MASSES[contact % len(MASSES)]
            panel.curve(at, here, marker="o", color=color, ms=4.5, clip_on=False)
            panel.level(at, axis="x", color=color, ls="-", lw=0.7, alpha=0.5)
        panel.entry("exact reversal", GREY, "none", marker="o")
    panel.axes.set_xlim(0, 1)
    panel.legend()
