"""Pictures of linear theory: frequency response, poles and zeros, margins over the gain."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    fact,
    label,
    legend_below,
    line,
    narrow,
    scalar,
    sheet,
    styles,
    tell,
)
from wormopt.result import Result

_DEGREES = 180 / np.pi
_LEAST = 1e-11  # of the largest response at a frequency; smaller ones are rounding
# marked gains: name, words, colour, dashes
_MARKS = {
    "gain_learned": ("gain learned by the tracker", LINKS[3], "-"),
    "gain_linear": ("least gain by harmonics", LINKS[0], (0, (6, 2))),
    "gain_simulated": ("least gain by simulation", LINKS[2], (0, (2, 1))),
    "gain_sure": ("gain sufficient for any friction", GREY, (0, (6, 1.5, 1.5, 1.5))),
}


def response(result: Result) -> Figure:
    """Gain and phase of the chain over frequency, from one input per column to all lengths."""
    omega, magnitude = result["omega"].values, result["magnitude"].values
    rounding = _LEAST * magnitude.max(axis=(0, 1))
    links = magnitude.shape[1]
    shown = min(links, 2 if narrow() else 3)  # Further inputs have similar responses.
    drawn = sheet(7.1, 4.6, 3.8)
    axes = drawn.subplots(2, shown, sharex=True, sharey="row", squeeze=False)
    engine: Any = drawn.get_layout_engine()
    engine.set(wspace=0.08)  # The first and last tick of neighbours must not overlap.
    for j in range(shown):
        for i, (colour, dashes) in enumerate(styles(LINKS, links)):
            look: Any = {"color": colour, "linestyle": dashes}
            size = np.where(magnitude[i, j] > rounding, magnitude[i, j], np.nan)
            angle = np.where(np.isnan(size), np.nan, result["phase"].values[i, j])
            axes[0, j].loglog(omega, size, label=f"to length of link {i}", **look)
            axes[1, j].semilogx(omega, angle * _DEGREES, **look)
        axes[0, j].set_title(f"from input {j}")
        axes[1, j].set_xlabel(label(r"frequency $\omega$", result["omega"].unit))
        low, high = axes[1, j].get_ylim()
        axes[1, j].yaxis.set_major_locator(MultipleLocator(90 if high - low < 540 else 180))
        axes[1, j].margins(x=0)
    axes[0, 0].set_ylabel(label(r"$|G(i\omega)|$", result["magnitude"].unit))
    axes[1, 0].set_ylabel(r"phase of $G(i\omega)$ (°)")
    drawn.align_ylabels()
    legend_below(drawn, axes[0, 0].get_lines())
    tell(drawn, fact(result, "common_zero", "zero"))
    return drawn


def poles(result: Result) -> Figure:
    """Poles and zeros of the chain, and the loop's poles as the frozen gain grows.

    Axes are linear near 0 and logarithmic beyond, alike in both directions.
    """
    real, imag = result["loop_real"].values, result["loop_imag"].values
    drawn = sheet(7.1, 4.6, 4.2)
    axes = drawn.subplots()
    paths = axes.scatter(
        real, imag, c=np.log10(np.repeat(result["gain"].values[:, None], real.shape[1], axis=1)),
        s=7, cmap="viridis", linewidths=0, zorder=2,
    )  # fmt: skip
    bar = drawn.colorbar(paths, ax=axes, shrink=0.8, label="$\\log_{10}$ of the frozen gain $k$")
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    marks = [
        ("pole", "x", "black", 6, "poles of the chain"),
        ("zero", "o", LINKS[0], 7, "zeros of the chain"),
        ("learned", "+", LINKS[3], 8, "poles of the loop at the learned gain"),
    ]
    for name, marker, colour, size, _ in marks:
        axes.plot(result[f"{name}_real"].values, result[f"{name}_imag"].values, marker,
                  color=colour, markersize=size, markerfacecolor="none", zorder=3)  # fmt: skip
    _both_symlog(axes, result)
    legend_below(drawn, [
        Line2D([], [], color=colour, linestyle="none", marker=marker, markersize=size,
               markerfacecolor="none", label=words)
        for _, marker, colour, size, words in marks
    ])  # fmt: skip
    tell(drawn, fact(result, "gain_learned", "learned gain"),
         fact(result, "common_zero", "zero"))  # fmt: skip
    return drawn


def _both_symlog(axes: Axes, result: Result) -> None:
    """Scales that show poles of all sizes, with a line at the stability limit."""
    real = np.concatenate([result[f"{n}_real"].values.ravel() for n in ("pole", "zero", "loop")])
    imag = np.concatenate([result[f"{n}_imag"].values.ravel() for n in ("pole", "loop")])
    sizes = np.abs(real[real != 0])
    small = float(10 ** np.floor(np.log10(sizes.min()))) if sizes.size else 1.0
    axes.set_xscale("symlog", linthresh=small)
    axes.set_yscale("symlog", linthresh=1.0)
    left, right = min(float(real.min()), -small), max(float(real.max()), 0.0)
    axes.set_xlim(2 * left, max(2 * right, small))
    decades = np.arange(np.log10(small), np.floor(np.log10(max(-left, right))) + 0.5)
    ticks = 10.0 ** decades[:: 1 + len(decades) // (4 if narrow() else 9)]
    axes.set_xticks([*-ticks[::-1], 0.0, *ticks[ticks <= right]])
    high = 1.5 * max(float(np.abs(imag).max()), 1.0)
    axes.set_ylim(-high, high)
    axes.axvline(0.0, color=GREY, linewidth=0.8, zorder=1)
    axes.set_xlabel(label("real part", result["pole_real"].unit))
    axes.set_ylabel(label("imaginary part", result["pole_real"].unit))


def margins(result: Result) -> Figure:
    """Phase margin, disk margin and errors over the frozen gain.

    Vertical lines: the learned gain and the sufficient gains.
    """
    gain = result["gain"].values
    drawn = sheet(7.1, 6.0, 5.6)
    axes = drawn.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.7))
    axes[0].semilogx(gain, result["phase_margins"].values * _DEGREES, color="black")
    axes[0].set_ylabel("phase\nmargin (°)")
    axes[0].set_ylim(0, 185)
    axes[0].yaxis.set_major_locator(MultipleLocator(45))
    axes[1].semilogx(gain, result["disk_margins"].values, color="black")
    axes[1].set_ylabel("disk\nmargin")
    axes[1].set_ylim(0, 2.1)
    _draw_errors(axes[2], result)
    for name, (_, colour, dashes) in _MARKS.items():
        value = scalar(result, name)
        if value is not None:
            for each in axes:
                each.axvline(value, color=colour, linestyle=dashes, linewidth=1.1, zorder=1)
    axes[2].set_xlabel("frozen gain $k$")
    for each in axes:
        each.margins(x=0)
    drawn.align_ylabels()
    legend_below(drawn, [
        line("without dry friction", "black"),
        line("bound for any friction", "black", ":"),
        line("simulated", "black", "none", marker="."),
        line(r"$\lambda$, radius of the tube", GREY, LIMIT, 0.8),
        *(line(words, colour, dashes, 1.1)
          for name, (words, colour, dashes) in _MARKS.items()
          if scalar(result, name) is not None),
    ])  # fmt: skip
    tell(drawn, fact(result, "gain_learned", "learned gain"),
         fact(result, "gain_linear", "by harmonics"),
         fact(result, "gain_simulated", "by simulation"))  # fmt: skip
    return drawn


def _draw_errors(axes: Axes, result: Result) -> None:
    gain = result["gain"].values
    axes.loglog(gain, result["error_linear"].values, color="black")
    axes.loglog(gain, result["error_bound"].values, color="black", linestyle=":")
    axes.loglog(result["tried_gain"].values, result["tried_error"].values, ".", color="black")
    axes.axhline(scalar(result, "tube_radius"), color=GREY, linestyle=LIMIT, linewidth=0.8)
    axes.set_ylabel(label("largest error $|e|$\nafter a long time", result["error_linear"].unit))
