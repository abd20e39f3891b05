"""Pictures of rows of coils: their travelling field, and currents for a wave of a film."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import GREY, LINKS, facts, label, scalar, sheet
from wormopt.result import Result

_SNAPSHOTS = 3


def travelling_field(result: Result) -> Figure:
    """Field along the row over time, at some instants, and in the frame of the wave.

    Places in mm; in the frame of the wave, mean and range of H² over the places.
    """
    drawn = sheet(9, 9.5)
    rows = drawn.add_gridspec(3, 1, height_ratios=(4, 3, 3))
    x, t = 1e3 * result["place"].values, result["time"].values
    field = result["field"].values
    half = (t[1] - t[0]) / 2 if len(t) > 1 else t[0]
    spread = drawn.add_subplot(rows[0])
    shown = spread.pcolormesh(
        _edges(x), np.append(t - half, t[-1] + half), field, vmin=0, shading="flat", rasterized=True
    )
    drawn.colorbar(shown, ax=spread, label=label("field $H$", result["field"].unit))
    spread.grid(visible=False)
    spread.set_ylabel(label("time $t$", result["time"].unit))
    spread.set_title(facts(result, "wave_speed", "field_max"), loc="left")
    still = drawn.add_subplot(rows[1], sharex=spread)
    steps = np.unique(np.linspace(0, len(t), 2 * _SNAPSHOTS + 1).astype(int)[1::2])
    for colour, step in zip(LINKS, steps, strict=False):
        still.plot(x, field[step], color=colour, linewidth=1.6, label=f"$t$ = {t[step]:.3g} s")
    for place in 1e3 * result["coil_place"].values:
        still.axvline(place, ymax=0.03, color=GREY, linewidth=1)
    still.set_ylim(0, 1.3 * max(float(field.max()), 1e-12))
    still.set_xlabel("place $x$ (mm), coils marked")
    still.set_ylabel(label("field $H$", result["field"].unit))
    still.legend(loc="upper left", ncols=len(steps))
    frame = drawn.add_subplot(rows[2])
    _profile(frame, result, first=-np.pi)
    frame.set_title(facts(result, "ripple", "first_harmonic_share"), loc="left")
    frame.legend(loc="upper right")
    return drawn


def row_currents(result: Result) -> Figure:
    """H² wanted and found in the frame of the wave, and the currents of a few neighbours.

    H² found is drawn with its mean and its range over the places.
    """
    drawn = sheet(9, 7)
    above, below = drawn.subplots(2, 1)
    _profile(above, result)
    phase = result["phase"].values
    above.plot(
        phase / np.pi, result["square_target"].values, color="black", linestyle=(0, (5, 2)),
        linewidth=1.8, label="wanted, $H_0^2 - D$",
    )  # fmt: skip
    above.set_title(facts(result, "field_residual", "ripple", "H0"), loc="left")
    above.legend(loc="best")
    t, currents = result["time"].values, result["current"].values
    for k in range(min(3, len(currents))):
        below.plot(t, currents[k], color=LINKS[k], linewidth=1.8, label=f"coil {k}")
    limit = scalar(result, "currents_limit")
    reached = float(np.abs(currents).max())
    if limit is not None and reached > 0.6 * limit:
        for sign in (-1, 1):
            if sign * currents.max() > 0 or currents.min() < 0:
                below.axhline(sign * limit, color=GREY, linestyle=(0, (5, 3)), linewidth=1)
    below.margins(x=0)
    below.set_title(facts(result, "currents_max", "currents_limit"), loc="left")
    below.set_ylabel(label("current $I$, ampere-turns", result["current"].unit))
    below.set_xlabel(label("time $t$", result["time"].unit))
    below.legend(loc="best")
    return drawn


def _profile(axes: Axes, result: Result, first: float = 0.0) -> None:
    """H² over one wave from a phase on: its mean over the places, and its range."""
    phase = np.mod(result["phase"].values - first, 2 * np.pi) + first
    order = np.argsort(phase)
    low, high, mean = (result[f"square_{name}"].values[order] for name in ("low", "high", "mean"))
    phase = phase[order] / np.pi
    axes.fill_between(phase, low, high, color=LINKS[0], alpha=0.2, label="range over the places")
    axes.plot(phase, mean, color=LINKS[0], linewidth=1.8, label="mean")
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    axes.set_xlabel(r"phase $\xi = \omega t - k x$ ($\pi$ rad)")
    axes.set_ylabel(label("$H^2$", result["square_mean"].unit))


def _edges(x: np.ndarray) -> np.ndarray:
    middle = (x[1:] + x[:-1]) / 2
    return np.concatenate([x[:1], middle, x[-1:]])
