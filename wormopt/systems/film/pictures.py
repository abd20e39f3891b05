"""Pictures of films of magnetic fluid: waves, floats and bodies, best waves, given fields."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
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
    legend_below,
    line,
    narrow,
    needed,
    number,
    scalar,
    sheet,
    tell,
)
from wormopt.result import Result

_TURN = 2 * math.pi
_PHASES = ("0", "π/2", "π", "3π/2", "2π")
_CREST = "#6BA3CE"
_OTHER = (0, (4, 2))
_PERIODS = 8  # of the wave, in which paths of floats are drawn
_FRAMES = 4
_SHORT, _FLAT = 0.02, 0.1  # bodies are drawn at least as long and as high as this
_TURNS = 4.0  # periods of the wave whose velocities are drawn
# Outcomes in the order of their codes: name, colour, label.
_OUTCOMES = (
    ("wave", "#D6E9F8", "takes the wave"),
    ("other", "#F2B84B", "another steady film"),
    ("moving", "#A48FC0", "still moves"),
    ("breaks", "#B5473A", "breaks"),
    ("unresolved", "#FFFFFF", "not resolved"),
)
_FEW = 12  # eigenvalues that are drawn


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
        h0 = float(np.trapezoid(squared[k], xi) / _TURN)
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
    axes.set_xlim(0, _TURN)
    axes.set_xticks(np.linspace(0, _TURN, 5), _PHASES)
    axes.set_xlabel(text)


# -- floats and bodies -----------------------------------------------------------------------------


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
    length = needed(result, "wavelength") / _TURN
    return length, length / speed


def _waterfall(axes: Axes, result: Result) -> None:
    length, duration = _scales(result)
    wavelength = _TURN * length
    time, position = result["time"].values, result["float_position"].values
    shown = time <= time[0] + _PERIODS * _TURN * duration
    places = position[:, shown]
    x = np.linspace(places.min() - 0.3 * wavelength, places.max() + 0.3 * wavelength, 500)
    t = np.linspace(time[0], time[shown][-1], 400)
    phase = t[:, None] / duration - x[None, :] / length
    h = np.interp(np.mod(phase, _TURN), result["xi"].values, result["height"].values)
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
    note = "length: drift with $\\varepsilon^2$\nover the wave's speed" if drifts else ""
    legend(axes, entries, note)


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
    surface = np.interp(np.mod(-place, _TURN), xi, height)
    axes.fill_between(place, surface, color="#CFE3F3")
    axes.plot(place, surface, color=LINKS[0])
    held = np.atleast_1d(needed(result, "tracer_trapped"))
    drifts = np.atleast_1d(needed(result, "tracer_drift_closed"))
    speed = scalar(result, "wave_speed") or 1.0
    for k, (path, z) in enumerate(
        zip(result["tracer_position"].values, result["tracer_height"].values, strict=True)
    ):
        at = np.mod(path / length - time / duration + math.pi, _TURN) - math.pi
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


def carried(result: Result) -> Figure:
    """Body in the wave in the last period, and its velocity.

    Heights are stretched relative to lengths.
    """
    speed = scalar(result, "wave_speed") or 1.0
    t, turn = result["time"].values, _TURN * _scales(result)[1]
    drawn = sheet(7.1, 6.6, 6.2)
    *frames, below = drawn.subplots(_FRAMES + 1, height_ratios=[1] * _FRAMES + [2.6])
    shown = np.searchsorted(t, np.linspace(max(t[0], t[-1] - turn), t[-1], _FRAMES))
    _frames(frames, result, result["position"].values[None], [result.attributes["length"]], shown)
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
    t, turn = result["time"].values, _TURN * _scales(result)[1]
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


def _phase(result: Result, time: float, place: np.ndarray) -> np.ndarray:
    """Phases from 0 to 2 pi of positions in wavelengths."""
    return np.mod(time / _scales(result)[1] - _TURN * place, _TURN)


def _frames(
    rows: Sequence[Axes], result: Result, places: np.ndarray, lengths: list[float], at: np.ndarray
) -> None:
    """Film and bodies at the times of the indices; `places` is (body, time)."""
    turn, unit = _TURN * _scales(result)[0], result["time"].unit
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


# -- the best wave ---------------------------------------------------------------------------------


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


# -- a film in a given field -----------------------------------------------------------------------


def forward(result: Result) -> Figure:
    """Motion of a film, its end, the field, and the eigenvalues; steady branches if continued."""
    branches = "branch_delta" in result
    drawn = sheet(7.1, 6.4, 8.5 if branches else 7.2)
    if narrow():
        heights = [1.5, *[1.0] * (3 + branches)]
        panels = drawn.subplot_mosaic("C;F;H;S;B" if branches else "C;F;H;S", height_ratios=heights)
    else:
        panels = drawn.subplot_mosaic(
            "CF;CH;SB" if branches else "CF;CH;SH", height_ratios=[5, 4, 5]
        )
    _course(drawn, panels["C"], result)
    _film(panels["F"], result)
    _field(panels["H"], result)
    _spectrum(panels["S"], result)
    if branches:
        _branches(panels["B"], result)
    words = {name: text for name, _, text in _OUTCOMES}[needed(result, "outcome")]
    tell(
        drawn,
        f"the film {words}" if words.endswith(("s", "wave")) else words,
        fact(result, "tension_number", "surface tension $W$"),
        fact(result, "growth_rate_max", "largest growth rate"),
    )
    return drawn


def _phases_in_pi(axes: Axes) -> None:
    axes.set_xlim(0, 2)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(r"phase $\xi$ ($\pi$ rad)")


def _closed(result: Result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Phases in units of pi and values, the first repeated at the end."""
    xi, values = result["xi"].values / math.pi, result[name].values
    return np.append(xi, 2.0), np.append(values, values[0])


def _course(drawn: Figure, axes: Axes, result: Result) -> None:
    xi = np.append(result["xi"].values, _TURN) / math.pi
    time, h = result["time"].values / _TURN, result["thickness"].values
    if len(time) == 1:  # the film was ruptured at the start
        axes.plot(*_closed(result, "thickness_end"), color=LINKS[0])
    else:
        closed = np.column_stack([h, h[:, 0]])
        image = axes.pcolormesh(
            xi, time, closed, cmap="viridis", shading="gouraud", rasterized=True
        )
        drawn.colorbar(image, ax=axes, label="thickness $h$", pad=0.02)
    axes.grid(visible=False)
    _phases_in_pi(axes)
    axes.set_ylabel("time in periods")
    if scalar(result, "broke_xi") is not None:
        axes.plot(
            needed(result, "broke_xi") / math.pi, needed(result, "broke_time") / _TURN,
            marker="x", color=RED, markersize=7, markeredgewidth=1.6, clip_on=False,
            linestyle="none", label="breaks here",
        )  # fmt: skip
        legend_above(axes, share=0.42)


def _film(axes: Axes, result: Result) -> None:
    start = result["thickness"].values[0]
    xi, end = _closed(result, "thickness_end")
    axes.fill_between(xi, 0, end, color=LINKS[0], alpha=0.15, linewidth=0)
    axes.plot(xi, end, color=LINKS[0], label="at the end")
    if "thickness_wave" in result:
        axes.plot(
            *_closed(result, "thickness_wave"), color="black", linestyle=DASHES[1],
            linewidth=1, label="prescribed",
        )  # fmt: skip
    axes.plot(
        xi,
        np.append(start, start[0]),
        color=GREY,
        linewidth=0.8,
        linestyle=":",
        label="at the start",
    )
    _phases_in_pi(axes)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("thickness $h$")
    legend_above(axes, share=_share())


def _field(axes: Axes, result: Result) -> None:
    axes.plot(*_closed(result, "field_pressure"), color=LINKS[3])
    _phases_in_pi(axes)
    axes.set_ylabel("field\n$(\\mu - 1) H^2 / 8\\pi$")


def _spectrum(axes: Axes, result: Result) -> None:
    shown = []
    for name, mark, colour, text in (
        ("wave", "o", "black", "prescribed wave"),
        ("end", "x", LINKS[0], "film at the end"),
    ):
        if f"growth_{name}" in result:
            rates = result[f"growth_{name}"].values[:_FEW], result[f"swing_{name}"].values[:_FEW]
            axes.plot(
                *rates, linestyle="none", marker=mark, color=colour, label=text,
                markerfacecolor="none", markersize=4,
            )  # fmt: skip
            shown.append(rates[0])
    axes.axvline(0, color=RED, linewidth=0.9)
    axes.text(0.99, 0.03, "unstable", color=RED, ha="right", fontsize=7.5, transform=axes.transAxes)
    axes.set_xlabel(r"growth rate ($\mathrm{Re}\,\lambda$)")
    axes.set_ylabel("angular frequency ($\\mathrm{Im}\\,\\lambda$)")
    if shown:
        together = np.concatenate(shown)
        right = max(0.0, float(together.max())) + 0.5
        axes.set_xlim(float(together.min()) - 0.4, right)
        axes.axvspan(0, right, color=RED, alpha=0.06, linewidth=0)
        legend_above(axes, share=_share())


def _branches(axes: Axes, result: Result) -> None:
    number = result["branch_number"].values
    for which in np.unique(number):
        own = number == which
        delta, crest = (result[f"branch_{n}"].values[own] for n in ("delta", "thickness_max"))
        stable = result["branch_growth"].values[own] < 0
        colour = "black" if which == 0 else LINKS[1]
        axes.plot(delta, np.where(stable, crest, np.nan), color=colour,
                  label=f"{'prescribed' if which == 0 else 'other'} branch, stable")  # fmt: skip
        axes.plot(delta, crest, color=colour, linewidth=1, linestyle=DASHES[2], zorder=1,
                  label="unstable" if which == 0 else None)  # fmt: skip
    for fold in needed(result, "delta_fold"):
        axes.axvline(fold, color=RED, linewidth=0.8, linestyle=":", label="fold")
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("largest thickness")
    entries, texts = axes.get_legend_handles_labels()
    legend_above(axes, list(dict(zip(texts, entries, strict=True)).values()),
                 share=_share())  # fmt: skip


def basins(result: Result) -> Figure:
    """Outcomes of flat films, over the amplitude and the surface tension.

    A cell for each film, with the largest growth rate of the prescribed wave.
    """
    delta, tension = result["map_delta"].values, result["map_tension"].values
    outcome, growth = result["map_outcome"].values, result["map_growth"].values
    tall = 1.6 + 0.3 * len(tension)
    drawn = sheet(7.1, tall, tall + 0.3)
    axes = drawn.subplots()
    colours = ListedColormap([colour for _, colour, _ in _OUTCOMES])
    norm = BoundaryNorm(np.arange(-0.5, len(_OUTCOMES)), len(_OUTCOMES))
    axes.pcolormesh(outcome.T, cmap=colours, norm=norm, edgecolors=GREY, linewidth=0.5)
    for i, j in np.ndindex(outcome.shape):
        rate = growth[i, j]
        if np.isfinite(rate):
            axes.text(
                i + 0.5, j + 0.5, f"{rate:+.2f}".replace("-", "−"), ha="center", va="center",
                fontsize=6.5 if narrow() else 7.5,
                color="white" if outcome[i, j] == 3 else "black",
                weight="bold" if rate > 0 else "normal",
            )  # fmt: skip
    axes.grid(visible=False)
    for axis, values in ((axes.xaxis, delta), (axes.yaxis, tension)):
        axis.set_major_locator(FixedLocator((np.arange(len(values)) + 0.5).tolist()))
        axis.set_major_formatter(FuncFormatter(_cell(values)))
        axis.set_tick_params(length=0)
    axes.set_xlabel(r"amplitude that the field prescribes ($\delta$)")
    axes.set_ylabel("surface tension $W$")
    tell(drawn, "numbers: largest growth rate of the prescribed wave, bold where it is unstable")
    present = [
        Patch(facecolor=colour, edgecolor=GREY, label=text)
        for k, (_, colour, text) in enumerate(_OUTCOMES)
        if np.any(outcome == k)
    ]
    legend_below(drawn, present)
    return drawn


def _cell(values: np.ndarray) -> Any:
    def written(place: float, _: object) -> str:
        k = int(place)
        return f"{values[k]:g}" if 0 <= k < len(values) else ""

    return written
