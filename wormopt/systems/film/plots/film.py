"""Pictures of a film of magnetic fluid, of what its wave carries, and of the best wave."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from wormopt.plotting.parts import (
    GREY,
    LINKS,
    MASSES,
    RED,
    draw_limits,
    facts,
    label,
    legend,
    scalar,
    sheet,
)
from wormopt.result import Result

_PHASES = ("0", "π/2", "π", "3π/2", "2π")
_PERIODS = 8
_OTHER = (0, (4, 2))
_BELOW: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.2), "ncols": 2}


def film(result: Result) -> Figure:
    """Mean flow against amplitude (the chapter's figure 15), and the squared field by phase.

    Fields are over their largest least H0², because those differ a hundredfold.
    """
    drawn = sheet(10.5, 7.6)
    (flow, shape), (fields, own) = drawn.subplots(2, 2)
    _mean_flow(flow, result)
    xi = result["xi"].values
    shape.fill_between(xi, result["height"].values, color="#CFE3F3")
    shape.plot(xi, result["height"].values, color=LINKS[0], label="thickness $h$ over its mean")
    shape.plot(
        xi, result["surface_velocity"].values, color=LINKS[3], label="surface velocity $u_s$"
    )
    shape.axhline(1.0, color=GREY, linewidth=1, linestyle=(0, (5, 3)))
    shape.annotate("speed of the wave", (np.pi, 1.0), (0, 3), textcoords="offset points",
                   ha="center", color=GREY, fontsize=9)  # fmt: skip
    shape.legend(**_BELOW)
    _fields(fields, result)
    own.plot(xi, result["field_squared"].values, color=LINKS[2],
             label=r"field $(\mu-1)H^2/(8\pi P)$, least")  # fmt: skip
    own.plot(xi, result["film_pressure"].values, color=LINKS[1], label="pressure $p/P$, less mean")
    own.axhline(0, color="black", linewidth=0.8)
    own.legend(**_BELOW)
    if "field" in result:
        _field_axis(own, result)
    for axes in (shape, fields, own):
        _phases(axes)
    shape.set_title(facts(result, "delta", "c_constant", "mean_flow"), loc="left")
    fields.set_title(facts(result, "tension_number"), loc="left")
    own.set_title(facts(result, "d_max", "xi_at_d_max"), loc="left")
    return drawn


def _mean_flow(axes: Axes, result: Result) -> None:
    delta = result["curve_delta"].values
    axes.plot(delta, result["curve_mean_flow"].values, color=LINKS[0], linewidth=2,
              label="cosine wave")  # fmt: skip
    axes.plot(delta, result["curve_square_wave"].values, color=GREY, linestyle=(0, (5, 2)),
              label="no wave has more")  # fmt: skip
    axes.plot(scalar(result, "delta"), scalar(result, "mean_flow"), "o", color=RED,
              label="this wave")  # fmt: skip
    axes.set_xlim(0, 1)
    axes.set_ylim(0, None)
    axes.set_xlabel(r"amplitude $\delta$ over mean thickness")
    axes.set_ylabel(r"mean flow $\overline{Q}$")
    axes.legend(loc="upper left")


def _fields(axes: Axes, result: Result) -> None:
    xi, squared = result["xi"].values, result["field_curves"].values
    for k, delta in enumerate(result["field_delta"].values):
        h0 = float(np.trapezoid(squared[k], xi) / (2 * math.pi))
        axes.plot(xi, squared[k] / h0, color=MASSES[k % len(MASSES)], label=f"{delta:g}: {h0:.4g}")
    axes.set_ylabel(r"$H^2/H_0^2$, least")
    axes.legend(
        title=r"$\delta$: $(\mu-1)H_0^2/(8\pi P)$", loc="upper left", bbox_to_anchor=(0.0, -0.2),
        ncols=3,
    )  # fmt: skip


def _field_axis(axes: Axes, result: Result) -> None:
    """On the right, the field of which the square is drawn."""
    most = float(result["field"].values.max()) / 1e3
    unit = most / math.sqrt(float(result["field_squared"].values.max()))

    def to_field(squared: ArrayLike) -> np.ndarray:
        return unit * np.sign(squared) * np.sqrt(np.abs(squared))

    def from_field(field: ArrayLike) -> np.ndarray:
        return np.sign(field) * (np.asarray(field) / unit) ** 2

    beside = axes.secondary_yaxis("right", functions=(to_field, from_field))
    ticks = np.asarray(MaxNLocator(5).tick_values(0.0, most))
    beside.set_yticks(ticks[(ticks == 0) | (ticks > most / 3)])  # the others lie close together
    beside.set_ylabel("of this the field $H$ (kA m$^{-1}$)", color=LINKS[2])
    beside.tick_params(axis="y", colors=LINKS[2])


def _phases(axes: Axes, text: str = r"phase $\xi = t - x$ (rad)") -> None:
    axes.set_xlim(0, 2 * math.pi)
    axes.set_xticks(np.linspace(0, 2 * math.pi, 5), _PHASES)
    axes.set_xlabel(text)


def ride(result: Result) -> Figure:
    """Paths of floats over the travelling wave, and of points of the fluid below them.

    Above: time by place, dark where the film is thick. Below: tracer paths seen from the
    wave, or velocities by phase if there are no tracers.
    """
    drawn = sheet(9.5, 8.2)
    over, below = drawn.subplots(2, 1, height_ratios=(3, 2))
    _waterfall(over, result)
    if "tracer_height" in result:
        _from_the_wave(below, result)
    else:
        _speeds(below, result)
    return drawn


def _scales(result: Result) -> tuple[float, float]:
    """1/k and 1/omega in the units of the result."""
    speed = scalar(result, "wave_speed")
    if speed is None:
        return 1.0, 1.0
    length = scalar(result, "wavelength") / (2 * math.pi)
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
    lengths = np.atleast_1d(scalar(result, "float_length"))
    held = np.atleast_1d(scalar(result, "trapped"))
    for k, path in enumerate(places):
        text = f"length {lengths[k]:g}" + (", held" if held[k] else "")
        axes.plot(path / wavelength, time[shown], color=MASSES[k], linewidth=2, label=text)
    axes.grid(visible=False)
    axes.set_xlabel("place $x$ in wavelengths")
    axes.set_ylabel(label("time $t$", result["time"].unit))
    axes.set_title(
        "first periods; dark: crests; lengths in wavelengths    "
        + facts(result, "delta", "mean_flow"),
        loc="left",
    )
    legend(axes, axes.get_lines())


def _from_the_wave(axes: Axes, result: Result) -> None:
    length, duration = _scales(result)
    time, xi = result["time"].values, result["xi"].values
    height = result["height"].values
    place = np.linspace(-math.pi, math.pi, 401)  # as seen from the wave
    surface = np.interp(np.mod(-place, 2 * math.pi), xi, height)
    axes.fill_between(place, surface, color="#CFE3F3")
    axes.plot(place, surface, color=LINKS[0])
    held = np.atleast_1d(scalar(result, "tracer_trapped"))
    drifts = np.atleast_1d(scalar(result, "tracer_drift_closed"))
    speed = scalar(result, "wave_speed") or 1.0
    for k, (path, z) in enumerate(
        zip(result["tracer_position"].values, result["tracer_height"].values, strict=True)
    ):
        at = np.mod(path / length - time / duration + math.pi, 2 * math.pi) - math.pi
        text = "held" if held[k] else f"drift {drifts[k] / speed:.3f}"
        axes.plot(at, z, ".", markersize=2.2, color=MASSES[k], label=text)
    axes.set_xlim(-math.pi, math.pi)
    axes.set_ylim(0, None)
    axes.set_xticks(np.linspace(-math.pi, math.pi, 5), ["−π", "−π/2", "0", "π/2", "π"])
    axes.set_xlabel("place as seen from the wave, which goes right, $x - t$ (rad)")
    axes.ticklabel_format(axis="y", scilimits=(-3, 3), useMathText=True)
    axes.set_ylabel(label("height $z$", result["tracer_height"].unit))
    axes.set_title("points of the fluid on their lines; drift over the speed of the wave",
                   loc="left")  # fmt: skip
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), markerscale=5)


def _speeds(axes: Axes, result: Result) -> None:
    lengths = np.atleast_1d(scalar(result, "float_length"))
    speed = scalar(result, "wave_speed") or 1.0
    for k, values in enumerate(result["body_velocity"].values):
        axes.plot(result["xi"].values, values / speed, color=MASSES[k],
                  label=f"length {lengths[k]:g}")  # fmt: skip
    axes.axhline(1.0, color=GREY, linewidth=1, linestyle=(0, (5, 3)))
    _phases(axes)
    axes.set_ylabel("velocity over the wave's")
    legend(axes, axes.get_lines()[:-1])


def film_wave(result: Result) -> Figure:
    """Thickness, field and surface velocity over one wavelength; below, other films if swept.

    Dashed in colour: the cosine wave within the same limits.
    """
    swept = "sweep_mean_flow" in result
    drawn = sheet(9, 10.5 if swept else 8.2)
    rows = drawn.subplots(3 + swept, gridspec_kw={"hspace": 0.08})
    xi = result["xi"].values
    for axes, name, text in zip(
        rows,
        ("height", "field_pressure", "surface_velocity"),
        ("thickness $h$ over its mean", r"field $(\mu-1)H^2/(8\pi P)$", "surface velocity $u_s$"),
        strict=False,
    ):
        axes.plot(xi, result[name].values, color=LINKS[0], lw=1.8, label="best")
        if f"{name}_cosine" in result:
            axes.plot(result["xi_cosine"].values, result[f"{name}_cosine"].values,
                      color=LINKS[3], lw=1.3, linestyle=_OTHER, label="cosine")  # fmt: skip
        axes.set_ylabel(text)
        _phases(axes, "")
        legend(axes, [*axes.get_lines()])
    rows[0].fill_between(xi, result["height"].values, color="#CFE3F3", zorder=0)
    rows[0].set_ylim(0, None)
    draw_limits(rows[0], [(level,) for level in scalar(result, "thickness_limits")], [GREY] * 2)
    limit = scalar(result, "field_limit")
    draw_limits(rows[1], [(0.0, scalar(result, "field_range") if limit is None else limit)])
    draw_limits(rows[2], [(1.0,)])
    rows[2].annotate("speed of the wave: floats are held from here on", (np.pi, 1.0), (0, -13),
                     textcoords="offset points", ha="center", color=GREY, fontsize=9)  # fmt: skip
    rows[2].set_xlabel(r"phase ($\xi = t - x$)")
    rows[0].set_title(
        facts(result, "mean_flow", "mean_flow_cosine", "mean_flow_supremum"), loc="left"
    )
    rows[1].set_title(facts(result, "tension_number", "field_range", "crests"), loc="left")
    rows[2].set_title(facts(result, "float_drift", "float_drift_cosine"), loc="left")
    if swept:
        _draw_sweep(rows[3], result)
    drawn.align_ylabels()
    return drawn


def _draw_sweep(axes: Axes, result: Result) -> None:
    """What is missing to the supremum, against the parameter of which there are more values."""
    supremum = scalar(result, "mean_flow_supremum")
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
    axes.set_ylabel("flow below supremum")
    legend(axes, [*axes.get_lines()])
