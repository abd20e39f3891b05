"""Pictures of benchmarks: error against time, cost of a step against length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator

from wormopt.bench.cases import GOAL, Case
from wormopt.bench.chain_length import LONG, Length, slope
from wormopt.bench.design import OWN, Attempt, bounds
from wormopt.bench.ocp import Timed
from wormopt.bench.smoothing import Smoothing, order
from wormopt.bench.work_precision import Record

_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#332288", "#882255")
_MARKS = "os^Dv<>pP*Xh"


def draw_records(case: Case, records: Sequence[Record], path: Path) -> None:
    """Draw error against time of every solver to a PNG file."""
    figure, axes = _axes("time of a warm run (s)", "error in positions and velocities")
    axes.axhline(GOAL, color="#999999", linewidth=0.8, linestyle="--")
    for k, record in enumerate(records):
        points = [p for p in record.points if p.error > 0]
        if not points:
            continue
        axes.plot(
            [p.time for p in points],
            [p.error for p in points],
            color=_COLOURS[k % len(_COLOURS)],
            marker=_MARKS[k % len(_MARKS)],
            markersize=4,
            linewidth=2.2 if record.solver == "wormopt" else 1.0,
            linestyle="-" if k < len(_COLOURS) else "--",
            label=record.solver,
        )
    axes.yaxis.set_major_locator(LogLocator(numticks=20))  # every decade has its label
    axes.text(1.0, GOAL, "compared here ", transform=axes.get_yaxis_transform(), color="#666666",
              fontsize=7.5, ha="right", va="bottom")  # fmt: skip
    axes.set_title(f"{case.name}: {case.title}", fontsize=9)
    axes.legend(fontsize=7.5, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure.savefig(path, dpi=130)


def draw_lengths(found: Sequence[Length], path: Path) -> None:
    """Draw the cost of a step against the number of links to a PNG file."""
    figure, axes = _axes("links n", "time of a step (s)")
    for k, contact in enumerate(("smooth", "exact")):
        kept = [c for c in found if c.contact == contact and c.step > 0]
        exponent = slope(found, contact)
        label = (
            contact if math.isnan(exponent) else f"{contact}: n^{exponent:.2f} from n = {LONG} on"
        )
        axes.plot(
            [c.links for c in kept],
            [c.step for c in kept],
            color=_COLOURS[k],
            marker=_MARKS[k],
            markersize=4,
            label=label,
        )
    lengths = sorted({c.links for c in found})
    axes.xaxis.set_major_locator(FixedLocator(lengths))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_title("chain_length: cost of a step of a chain of n links", fontsize=9)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)


def draw_smoothing(found: Sequence[Smoothing], path: Path) -> None:
    """Draw how far the smooth motion is from the exact one, and its steps, to a PNG file."""
    width = "width of the smooth law v_reg"
    figure, left = _axes(width, "largest difference of positions", place=121)
    _, right = _axes(width, "steps", figure=figure, place=122)
    widths = [s.v_reg for s in found]
    label = f"order {order(found):.2f} below 1e-2"
    style = {"color": _COLOURS[1], "marker": "o", "markersize": 4}
    left.plot(widths, [s.difference for s in found], label=label, **style)
    right.plot(widths, [s.steps for s in found], label="smooth", **style)
    label = f"exact, with {found[0].events} events"
    right.axhline(found[0].exact_steps, color=_COLOURS[0], label=label)
    for axes in (left, right):
        axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)


def draw_times(known: Sequence[Timed], path: Path) -> None:
    """Draw the times to build and to solve as bars to a PNG file."""
    solved = [t for t in known if t.solves]
    labels = [f"{t.solver}\n{t.grid}" for t in solved]
    figure = Figure(figsize=(8, 1.2 + 0.5 * len(solved)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, name, values in (
        (left, "time to build (s)", [t.build for t in solved]),
        (right, "median time to solve (s)", [t.solve for t in solved]),
    ):
        colours = [_COLOURS[0] if t.solver == "wormopt" else _COLOURS[1] for t in solved]
        axes.barh(labels, values, color=colours, height=0.6)
        axes.set_xlabel(name)
        axes.grid(visible=True, axis="x", color="#E6E6E6", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    left.invert_yaxis()
    figure.savefig(path, dpi=130)


def draw_gaps(known: Sequence[Attempt], path: Path) -> None:
    """Draw the best gait's distance from the bound over time, to a PNG file.

    It shows all problems, and the median.
    """
    figure, axes = _axes("time (s)", "distance of the speed from its bound")
    most = bounds(known)
    last = max((seconds for a in known for seconds, _ in a.course), default=1.0)
    times = np.geomspace(1e-2, max(last, 1.0), 400)
    for k, solver in enumerate(dict.fromkeys(a.solver for a in known)):
        gaps = np.array([_gaps(a, most[a.problem], times) for a in known if a.solver == solver])
        axes.plot(times, gaps.T, color=_COLOURS[k], linewidth=0.5, alpha=0.4)
        width = 2.6 if solver == OWN else 1.6
        axes.plot(
            times,
            np.quantile(gaps, 0.5, axis=0, method="higher"),
            color=_COLOURS[k],
            linewidth=width,
            label=solver,
        )
    axes.set_ylim(1e-5, 1.1)
    axes.set_title("design: median over the problems, each of them thin", fontsize=9)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)


def _gaps(attempt: Attempt, bound: float, times: np.ndarray) -> np.ndarray:
    speeds = np.zeros_like(times)
    for seconds, speed in attempt.course:
        speeds[times >= seconds] = speed
    return np.maximum(1 - speeds / bound, 1e-5) if bound > 0 else np.ones_like(times)


def _axes(across: str, up: str, figure: Figure | None = None, place: int = 111):
    figure = figure or Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.add_subplot(place, xscale="log", yscale="log", xlabel=across, ylabel=up)
    axes.grid(visible=True, color="#E6E6E6", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes
