"""Picture of a proof: the decrease of the bound towards the objective of the gait."""

from __future__ import annotations

from matplotlib.figure import Figure

from wormopt.plotting.parts import LINKS, fact, label, legend_below, sheet, tell
from wormopt.result import Result


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
