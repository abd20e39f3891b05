"""Pictures of a film of magnetic fluid: waves, floats and tracers on them, and the best wave."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    draw_limits,
    fact,
    few_decades,
    label,
    legend,
    legend_above,
    line,
    narrow,
    needed,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

_PHASES = ("0", "π/2", "π", "3π/2", "2π")
_PERIODS = 8
_CREST = "#6BA3CE"
_OTHER = (0, (4, 2))


def film(result: Result) -> Figure:
    """Mean flow over amplitude, and the squared field over phase.

    The first panel is figure 15 of Zimmermann et al. 2007. Fields are relative to their largest
    least H0², since these differ by a factor of a hundred.
    """
    drawn = sheet(7.1, 5.6, 8.4)
    parts = drawn.subplots(*((4, 1) if narrow() else (2, 2))).ravel()
    flow, shape, fields, own = parts
    _mean_flow(flow, result)
    xi = result["xi"].values
    shape.fill_between(xi, result["height"].values, color="#CFE3F3")
    shape.plot(xi, result["height"].values, color=LINKS[0], label="thickness $h$ over its mean")
    shape.plot(xi, result["surface_velocity"].values, color=LINKS[3], linestyle=DASHES[1],
               label="surface velocity $u_s$")  # fmt: skip
    shape.axhline(1.0, color=GREY, linewidth=0.8, linestyle=LIMIT, label="speed of the wave")
    shape.set_ylabel("thickness, velocity")
    legend_above(shape, share=_share())
    _fields(fields, result)
    own.plot(xi, result["field_squared"].values, color=LINKS[2],
             label="least field $(\\mu-1)H^2/(8\\pi P)$")  # fmt: skip
    own.plot(xi, result["film_pressure"].values, color=LINKS[1], linestyle=DASHES[1],
             label="pressure $p/P$ minus mean")  # fmt: skip
    own.axhline(0, color="black", linewidth=0.8)
    own.set_ylabel("field, pressure")
    legend_above(own, share=_share())
    if "field" in result:
        _field_axis(own, result)
    for axes in (shape, fields, own):
        _phases(axes)
    tell(
        drawn,
        fact(result, "delta", r"amplitude $\delta$"),
        fact(result, "mean_flow", "mean flow"),
        *_corrected(result),
        fact(result, "tension_number", "surface tension $W$"),
        fact(result, "d_max", "largest field $D$"),
        fact(result, "xi_at_d_max", r"at $\xi$ ="),
    )
    return drawn


def _corrected(result: Result) -> Iterator[str]:
    """Mean flow with the next order and its error estimate, where they are known."""
    bar = scalar(result, "mean_flow_bar")
    if bar is not None:
        value = number(needed(result, "mean_flow_corrected"))
        yield rf"with $\varepsilon^2$ {value} ± {number(bar, 2)}"


def _share() -> float:
    """Share of the sheet for a panel of `film`."""
    return 0.85 if narrow() else 0.42


def _mean_flow(axes: Axes, result: Result) -> None:
    delta = result["curve_delta"].values
    axes.plot(delta, result["curve_mean_flow"].values, color=LINKS[0],
              label="cosine wave")  # fmt: skip
    axes.plot(delta, result["curve_square_wave"].values, color=GREY, linestyle=DASHES[1],
              label="upper bound of all waves")  # fmt: skip
    axes.plot(needed(result, "delta"), needed(result, "mean_flow"), "o", color=RED,
              label="this wave")  # fmt: skip
    bar = scalar(result, "mean_flow_bar")
    if bar is not None:
        axes.errorbar(needed(result, "delta"), needed(result, "mean_flow_corrected"), yerr=bar,
                      fmt="_", color=LINKS[3], capsize=3,
                      label=r"with $\varepsilon^2$, error bar")  # fmt: skip
    axes.set_xlim(0, 1)
    axes.set_ylim(0, None)
    axes.set_xlabel(r"amplitude $\delta$ over mean thickness")
    axes.set_ylabel(r"mean flow $\overline{Q}$")
    legend_above(axes, share=_share())


def _fields(axes: Axes, result: Result) -> None:
    xi, squared = result["xi"].values, result["field_curves"].values
    for k, delta in enumerate(result["field_delta"].values):
        h0 = float(np.trapezoid(squared[k], xi) / (2 * math.pi))
        axes.plot(xi, squared[k] / h0, color=MASSES[k % len(MASSES)],
                  linestyle=DASHES[k % 4], label=f"{delta:g}: {number(h0)}")  # fmt: skip
    axes.set_ylabel(r"$H^2/H_0^2$, least")
    legend_above(axes, title=r"$\delta$: $(\mu-1)H_0^2/(8\pi P)$", share=_share())


def _field_axis(axes: Axes, result: Result) -> None:
    """Right axis with the field whose square is drawn."""
    most = float(result["field"].values.max()) / 1e3
    unit = most / math.sqrt(float(result["field_squared"].values.max()))

    def to_field(squared: ArrayLike) -> np.ndarray:
        return unit * np.sign(squared) * np.sqrt(np.abs(squared))

    def from_field(field: ArrayLike) -> np.ndarray:
        return np.sign(field) * (np.asarray(field) / unit) ** 2

    beside = axes.secondary_yaxis("right", functions=(to_field, from_field))
    ticks = np.asarray(MaxNLocator(5).tick_values(0.0, most))
    beside.set_yticks(ticks[(ticks == 0) | (ticks > most / 3)])  # the others are close together
    beside.set_ylabel("field $H$ (kA m$^{-1}$)", color=LINKS[2])
    beside.tick_params(axis="y", colors=LINKS[2])


def _phases(axes: Axes, text: str = r"phase $\xi = t - x$ (rad)") -> None:
    axes.set_xlim(0, 2 * math.pi)
    axes.set_xticks(np.linspace(0, 2 * math.pi, 5), _PHASES)
    axes.set_xlabel(text)


def ride(result: Result) -> Figure:
    """Paths of floats over the travelling wave, and of tracers below them.

    Above: time over position, dark where the film is thick. Below: tracer paths in the frame of the
    wave, or velocities over the phase if there are no tracers.
    """
    drawn = sheet(7.1, 6.0, 6.2)
    over, below = drawn.subplots(2, 1, height_ratios=(3, 2))
    _waterfall(over, result)
    if "tracer_height" in result:
        _from_the_wave(below, result)
    else:
        _speeds(below, result)
    tell(
        drawn,
        "lengths in wavelengths",
        fact(result, "delta", r"amplitude $\delta$"),
        fact(result, "mean_flow", "mean flow"),
    )
    return drawn


def _scales(result: Result) -> tuple[float, float]:
    """1/k and 1/omega in the units of the result."""
    speed = scalar(result, "wave_speed")
    if speed is None:
        return 1.0, 1.0
    length = needed(result, "wavelength") / (2 * math.pi)
    return length, length / speed


def _waterfall(axes: Axes, result: Result) -> None:
    length, duration = _scales(result)
    wavelength = 2 * math.pi * length
    time, position = result["time"].values, result["float_position"].values
    shown = time <= time[0] + _PERIODS * 2 * math.pi * duration
    places = position[:, shown]
    x = np.linspace(places.min() - 0.3 * wavelength, places.max() + 0.3 * wavelength, 500)
    t = np.linspace(time[0], time[shown][-1], 400)
    phase = t[:, None] / duration - x[None, :] / length
    h = np.interp(np.mod(phase, 2 * math.pi), result["xi"].values, result["height"].values)
    axes.pcolormesh(x / wavelength, t, h, cmap="Blues", shading="auto", rasterized=True,
                    vmin=h.min() - 0.3 * np.ptp(h), vmax=h.max() + 0.8 * np.ptp(h))  # fmt: skip
    lengths = np.atleast_1d(needed(result, "float_length"))
    held = np.atleast_1d(needed(result, "trapped"))
    drifts = _drifts(result)
    for k, path in enumerate(places):
        text = f"{lengths[k]:g}: {drifts[k]}" if drifts else f"length {lengths[k]:g}"
        text += ", held" if held[k] else ""
        axes.plot(path / wavelength, time[shown], color=MASSES[k], linewidth=1.6,
                  linestyle=DASHES[k % 4], label=text)  # fmt: skip
    axes.grid(visible=False)
    axes.set_xlabel("position $x$ in wavelengths")
    axes.set_ylabel(label("time $t$", result["time"].unit))
    entries = [*axes.get_lines(), Patch(color=_CREST, label="crests of the film")]
    told = "length: drift with $\\varepsilon^2$\nover the wave's speed" if drifts else ""
    legend(axes, entries, told)


def _drifts(result: Result) -> list[str]:
    """Drift of every float over the wave speed with its error estimate; empty where unknown."""
    bars = result.scalars.get("float_drift_bar")
    if bars is None or bars.value is None or None in np.atleast_1d(bars.value):
        return []
    speed = scalar(result, "wave_speed") or 1.0
    values = np.atleast_1d(needed(result, "float_drift_corrected")) / speed
    pairs = zip(values, np.atleast_1d(bars.value) / speed, strict=True)
    return [f"{number(value)} ± {number(bar, 2)}" for value, bar in pairs]


def _from_the_wave(axes: Axes, result: Result) -> None:
    length, duration = _scales(result)
    time, xi = result["time"].values, result["xi"].values
    height = result["height"].values
    place = np.linspace(-math.pi, math.pi, 401)  # in the frame of the wave
    surface = np.interp(np.mod(-place, 2 * math.pi), xi, height)
    axes.fill_between(place, surface, color="#CFE3F3")
    axes.plot(place, surface, color=LINKS[0])
    held = np.atleast_1d(needed(result, "tracer_trapped"))
    drifts = np.atleast_1d(needed(result, "tracer_drift_closed"))
    speed = scalar(result, "wave_speed") or 1.0
    for k, (path, z) in enumerate(
        zip(result["tracer_position"].values, result["tracer_height"].values, strict=True)
    ):
        at = np.mod(path / length - time / duration + math.pi, 2 * math.pi) - math.pi
        text = "held" if held[k] else f"drift {number(drifts[k] / speed, 3)}"
        axes.plot(at, z, ".", markersize=1.6, color=MASSES[k], label=text)
    axes.set_xlim(-math.pi, math.pi)
    axes.set_ylim(0, None)
    axes.set_xticks(np.linspace(-math.pi, math.pi, 5), ["−π", "−π/2", "0", "π/2", "π"])
    axes.set_xlabel("position in the frame of the wave, $x - t$ (rad)")
    axes.ticklabel_format(axis="y", scilimits=(-3, 3), useMathText=True)
    axes.set_ylabel(label("height $z$", result["tracer_height"].unit))
    entries = [
        line(str(own.get_label()), str(own.get_color()), "none", marker="o")
        for own in axes.get_lines()[1:]
    ]
    legend(axes, entries, "tracers,\ndrift over the wave's speed")


def _speeds(axes: Axes, result: Result) -> None:
    lengths = np.atleast_1d(needed(result, "float_length"))
    speed = scalar(result, "wave_speed") or 1.0
    for k, values in enumerate(result["body_velocity"].values):
        axes.plot(result["xi"].values, values / speed, color=MASSES[k], linestyle=DASHES[k % 4],
                  label=f"length {lengths[k]:g}")  # fmt: skip
    axes.axhline(1.0, color=GREY, linewidth=0.8, linestyle=LIMIT, label="speed of the wave")
    _phases(axes)
    axes.set_ylabel("velocity over the wave's")
    legend(axes)


def film_wave(result: Result) -> Figure:
    """Thickness, field and surface velocity over one wavelength; below, other films if swept.

    Dashed in colour: the cosine wave within the same limits.
    """
    swept = "sweep_mean_flow" in result
    drawn = sheet(7.1, 7.4 if swept else 5.0, 8.0 if swept else 5.0)
    rows = drawn.subplots(3 + swept, height_ratios=(1, 1, 1, 1.5)[: 3 + swept])
    xi = result["xi"].values
    for axes, name, text in zip(
        rows,
        ("height", "field_pressure", "surface_velocity"),
        (
            "thickness $h$\nover its mean",
            "field\n$(\\mu-1)H^2/(8\\pi P)$",
            "surface\nvelocity $u_s$",
        ),
        strict=False,
    ):
        axes.plot(xi, result[name].values, color=LINKS[0], label="best")
        if f"{name}_cosine" in result:
            axes.plot(result["xi_cosine"].values, result[f"{name}_cosine"].values,
                      color=LINKS[3], lw=1.1, linestyle=_OTHER, label="cosine")  # fmt: skip
        axes.set_ylabel(text)
        _phases(axes, "")
    rows[0].fill_between(xi, result["height"].values, color="#CFE3F3", zorder=0)
    rows[0].set_ylim(0, None)
    draw_limits(rows[0], [(level,) for level in needed(result, "thickness_limits")], [GREY] * 2)
    limit = scalar(result, "field_limit")
    draw_limits(rows[1], [(0.0, scalar(result, "field_range") if limit is None else limit)])
    rows[2].axhline(1.0, color="black", linestyle=":", linewidth=0.9)
    for axes in rows[:2]:
        axes.tick_params(labelbottom=False)
    rows[2].set_xlabel(r"phase $\xi = t - x$ (rad)")
    cosine = [line("cosine wave", LINKS[3], _OTHER)] * ("height_cosine" in result)
    legend_above(rows[0], [
        line("best wave", LINKS[0]), *cosine, line("limits", GREY, LIMIT, 0.8),
        line("speed of the wave: it holds faster floats", "black", ":", 0.9),
    ])  # fmt: skip
    tell(
        drawn,
        fact(result, "mean_flow", "mean flow"),
        fact(result, "mean_flow_cosine", "cosine wave"),
        fact(result, "mean_flow_supremum", "upper bound of all waves"),
        fact(result, "tension_number", "surface tension $W$"),
        fact(result, "field_range", r"range of the field $\beta$"),
        fact(result, "crests"),
        fact(result, "float_drift", "drift of a float"),
        fact(result, "float_drift_cosine", "cosine wave"),
    )
    if swept:
        _draw_sweep(rows[3], result)
    drawn.align_ylabels()
    return drawn


def _draw_sweep(axes: Axes, result: Result) -> None:
    """Gap to the supremum over the parameter with more values."""
    supremum = needed(result, "mean_flow_supremum")
    tension, field = (result[f"sweep_{name}"].values for name in ("tension", "field"))
    flows = {"best": result["sweep_mean_flow"], "cosine": result["sweep_mean_flow_cosine"]}
    along = len(tension) >= len(field)
    places, others = (tension, field) if along else (field, tension)
    for name, variable in flows.items():
        gaps = supremum - (variable.values.T if along else variable.values)
        for k, gap in enumerate(gaps):
            text = f"{name}, {'field' if along else '$W$'} {others[k]:.3g}"
            best = name == "best"
            axes.loglog(places, gap, "o-" if best else "s--", color=LINKS[k % 4] if best else RED,
                        alpha=1 if best else 0.4 + 0.6 / (1 + k), ms=4, label=text)  # fmt: skip
    axes.set_xlabel("surface tension ($W$)" if along else r"range of the field ($\beta$)")
    few_decades(axes.xaxis)
    axes.set_ylabel("flow below\nthe supremum")
    legend(axes)
