"""Pictures of bodies in a given wave."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wormopt.plotting.parts import (
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    fact,
    label,
    legend,
    line,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

_FRAMES = 4
_SHORT, _FLAT = 0.02, 0.1  # short and flat bodies are drawn at least as long and as high as this;
# periods of the wave whose velocities are drawn
_TURNS = 4.0  # periods of the wave whose velocities are drawn


def carried(result: Result) -> Figure:
    """Body in the wave in the last period, and its velocity.

    Heights are stretched relative to lengths.
    """
    speed = scalar(result, "wave_speed") or 1.0
    t, turn = result["time"].values, 2 * math.pi * _scales(result)[1]
    drawn = sheet(7.1, 6.6, 6.2)
    *frames, below = drawn.subplots(_FRAMES + 1, height_ratios=[1] * _FRAMES + [2.6])
    shown = np.searchsorted(t, np.linspace(max(t[0], t[-1] - turn), t[-1], _FRAMES))
    told = result.attributes
    _frames(frames, result, result["position"].values[None], [told["length"]], shown)
    late = t >= t[-1] - _TURNS * turn
    below.plot(t[late], result["velocity"].values[late] / speed, color=MASSES[0], label="body")
    drift = scalar(result, "drift")
    if drift is not None:
        below.axhline(drift / speed, color=LINKS[1], linestyle=LIMIT, label="drift")
    below.margins(x=0)
    below.set_xlabel(label("time $t$", result["time"].unit))
    below.set_ylabel("velocity over the wave's")
    legend(below)
    tell(
        drawn,
        fact(result, "drift", "drift"),
        fact(result, "drift_massless", "without mass"),
        fact(result, "mass", "mass"),
        fact(result, "friction", "friction"),
        fact(result, "friction_forward", "no forward motion from"),
        fact(result, "friction_backward", "no backward motion from"),
    )
    drawn.align_ylabels()
    return drawn


def floats(result: Result) -> Figure:
    """Floats on the wave at some times, from the first on, and the field that makes the wave.

    Heights are stretched relative to lengths; the field has no scale.
    """
    drawn = sheet(7.1, 5.6, 6.2)
    frames = drawn.subplots(_FRAMES + 1, height_ratios=[1] * _FRAMES + [0.8])
    t, turn = result["time"].values, 2 * math.pi * _scales(result)[1]
    shown = np.searchsorted(t, np.linspace(t[0], min(t[-1], t[0] + 1.5 * turn), _FRAMES))
    lengths = np.atleast_1d(result.attributes["lengths"])
    places = result["float_position"].values
    *rows, field = frames
    _frames(rows, result, places, list(lengths), shown)
    rows[-1].set_xlabel("")
    low, high = rows[-1].get_xlim()
    place = np.linspace(low, high, 801)
    phase = _phase(result, t[shown[-1]], place)
    squared = np.interp(phase, result["xi"].values, result["field_squared"].values)
    field.plot(place, squared, color=GREY)
    field.set(xlim=(low, high), ylim=(0, None), ylabel="$H^2$")
    field.set_yticks([])
    field.set_xlabel("place $x$ (wavelengths)")
    entries = [line(f"length {each:g}", MASSES[k], width=4) for k, each in enumerate(lengths)]
    legend(rows[0], entries)
    tell(
        drawn,
        "lengths in wavelengths",
        fact(result, "delta", r"amplitude $\delta$"),
        fact(result, "float_drift", "drift"),
        fact(result, "trapped", "held"),
    )
    return drawn


def _scales(result: Result) -> tuple[float, float]:
    """1/k and 1/omega in the units of the result."""
    speed = scalar(result, "wave_speed") or 1.0
    length = (scalar(result, "wavelength") or 2 * math.pi) / (2 * math.pi)
    return length, length / speed


def _phase(result: Result, time: float, place: np.ndarray) -> np.ndarray:
    """Phases from 0 to 2 pi of positions in wavelengths."""
    return np.mod(time / _scales(result)[1] - 2 * math.pi * place, 2 * math.pi)


def _frames(
    rows: Sequence[Axes], result: Result, places: np.ndarray, lengths: list[float], at: np.ndarray
) -> None:
    """Film and bodies at the times of the indices; `places` is (body, time)."""
    turn, unit = 2 * math.pi * _scales(result)[0], result["time"].unit
    across = float(np.mean(result["height"].values[:-1]))
    lying = result.attributes.get("on") == "ground"
    thick = max(result.attributes.get("height", 0.0), _FLAT)
    seen = places[:, at] / turn
    place = np.linspace(seen.min() - 1, seen.max() + 1, 801)
    for axes, k in zip(rows, at, strict=True):
        time = float(result["time"].values[k])

        def film(x: np.ndarray, time: float = time) -> np.ndarray:
            phase = _phase(result, time, x)
            return np.interp(phase, result["xi"].values, result["height"].values) / across

        axes.fill_between(place, film(place), color="#CFE3F3", linewidth=0)
        axes.plot(place, film(place), color=LINKS[0])
        for i, (middle, length) in enumerate(zip(places[:, k] / turn, lengths, strict=True)):
            half = max(length, _SHORT) / 2
            under = np.linspace(middle - half, middle + half, 41)
            low = np.zeros(41) if lying else film(under)
            order = 3 - length  # short bodies before long bodies
            axes.fill_between(under, low, low + thick, color=MASSES[i], linewidth=0, zorder=order)
        axes.set(xlim=(place[0], place[-1]), ylim=(0, None), ylabel="$h/d$")
        axes.grid(visible=False)
        axes.tick_params(labelbottom=axes is rows[-1])
        axes.set_title(f"at {time:.4g} {unit if unit != '1' else ''}", loc="left", fontsize="small")
    rows[-1].set_xlabel("place $x$ (wavelengths)")
