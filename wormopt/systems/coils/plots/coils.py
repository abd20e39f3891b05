"""Plots of rows of coils: their travelling field, and currents for a wave of a film."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LINKS,
    draw_limits,
    fact,
    label,
    legend,
    legend_below,
    line,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

_SNAPSHOTS = 3
_FIELD = label("field $H$", "kA m-1")


def travelling_field(result: Result) -> Figure:
    """Plot the field along the row over time, at a few times, and in the frame of the wave.

    Positions in mm; in the frame of the wave, mean and range of H² over the positions.
    """
    drawn = sheet(7.1, 6.6, 6.0)
    spread, still, frame = drawn.subplots(3, height_ratios=(4, 3, 3))
    still.sharex(spread)
    x, t = 1e3 * result["place"].values, result["time"].values
    field = 1e-3 * result["field"].values
    half = (t[1] - t[0]) / 2 if len(t) > 1 else t[0]
    shown = spread.pcolormesh(
        _edges(x), np.append(t - half, t[-1] + half), field, vmin=0, shading="flat", rasterized=True
    )
    drawn.colorbar(shown, ax=spread, label=_FIELD, pad=0.01)
    spread.grid(visible=False)
    spread.set_ylabel(label("time $t$", result["time"].unit))
    steps = np.unique(np.linspace(0, len(t), 2 * _SNAPSHOTS + 1).astype(int)[1::2])
    for colour, dashes, step in zip(LINKS, DASHES, steps, strict=False):
        still.plot(x, field[step], color=colour, linestyle=dashes, label=f"at {t[step]:.3g} s")
    for place in 1e3 * result["coil_place"].values:
        still.axvline(place, ymax=0.04, color=GREY, linewidth=1)
    still.set_ylim(0, 1.1 * max(float(field.max()), 1e-12))
    still.set_xlabel("position $x$ (mm)")
    still.set_ylabel(_FIELD)
    _profile(frame, result, first=-np.pi)
    entries = [*still.get_lines()[: len(steps)], line("coil", GREY, "none", marker="|")]
    legend_below(drawn, [*entries, *frame.get_legend_handles_labels()[0]])
    tell(
        drawn,
        fact(result, "pitch", "assumed pitch", "mm"),
        fact(result, "wave_speed", "speed of the wave"),
        fact(result, "field_max", "largest field", "kA m-1"),
        fact(result, "ripple", unit="%"),
        fact(result, "first_harmonic_share", "share of first harmonic", "%"),
    )
    return drawn


def row_currents(result: Result) -> Figure:
    """Plot wanted and computed H² in the frame of the wave, and currents of a few neighbours.

    The computed H² has its mean and its range over the positions.
    """
    drawn = sheet(7.1, 4.6, 5.0)
    above, below = drawn.subplots(2, 1)
    _profile(above, result)
    above.plot(
        result["phase"].values / np.pi, 1e-6 * result["square_target"].values, color="black",
        linestyle=DASHES[1], label="wanted, $H_0^2 - D$",
    )  # fmt: skip
    legend(above)
    t, currents = result["time"].values, result["current"].values
    for k in range(min(3, len(currents))):
        below.plot(t, currents[k], color=LINKS[k], linestyle=DASHES[k], label=f"coil {k}")
    told = []
    limit = scalar(result, "currents_limit")
    for sign in (-1, 1):
        if limit is not None and (sign * currents).max() > 0.6 * limit:
            told = draw_limits(below, [(sign * limit,)])
    below.margins(x=0)
    below.set_ylabel(label("current $I$", "ampere-turns"))
    below.set_xlabel(label("time $t$", result["time"].unit))
    legend(below, [*below.get_legend_handles_labels()[0], *told])
    tell(
        drawn,
        fact(result, "field_residual", "residual of the field", "%"),
        fact(result, "ripple", unit="%"),
        fact(result, "H0", "mean field $H_0$", "kA m-1"),
        fact(result, "currents_max", "largest current"),
        fact(result, "currents_limit", "limit"),
    )
    return drawn


def _profile(axes: Axes, result: Result, first: float = 0.0) -> None:
    """Draw H² over one wave from a phase on: mean and range over the positions."""
    phase = np.mod(result["phase"].values - first, 2 * np.pi) + first
    order = np.argsort(phase)
    low, high, mean = (
        1e-6 * result[f"square_{name}"].values[order] for name in ("low", "high", "mean")
    )
    phase = phase[order] / np.pi
    axes.plot(phase, mean, color=LINKS[0], label="mean over the row")
    axes.fill_between(phase, low, high, color=LINKS[0], alpha=0.2, linewidth=0,
                      label="range over the row")  # fmt: skip
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    axes.set_xlabel(r"phase $\xi = \omega t - k x$ ($\pi$ rad)")
    axes.set_ylabel(label("$H^2$", "kA2 m-2"))


def _edges(x: np.ndarray) -> np.ndarray:
    middle = (x[1:] + x[:-1]) / 2
    return np.concatenate([x[:1], middle, x[-1:]])
