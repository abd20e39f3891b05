"""Pictures of films of magnetic fluid: waves, floats and bodies, best waves, given fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike

from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    few_decades,
    narrow,
    number,
    patch,
)
from wormopt.result import Result

_TURN = 2 * math.pi
_WATER, _FIELD = "#CFE3F3", "#D98C3F"
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
    page = Page(result, 5.6, 8.4)
    parts = page.grid(*((4, 1) if narrow() else (2, 2)))
    flow, shape, fields, own = (panel for row in parts for panel in row)
    _mean_flow(flow)
    _water(shape, "xi", "height", label="thickness $h$ over its mean")
    shape.curve("xi", "surface_velocity", "surface velocity $u_s$", color=LINKS[3], ls=DASHES[1])
    shape.level(1.0, "speed of the wave")
    shape.label(y="thickness, velocity")
    for k, delta in enumerate(page["field_delta"]):
        squared = page["field_curves"][k]
        mean = float(np.trapezoid(squared, page["xi"]) / _TURN)
        fields.curve("xi", squared / mean, f"{delta:g}: {number(mean)}", ls=DASHES[k % 4],
                     color=MASSES[k % len(MASSES)])  # fmt: skip
    fields.label(y=r"$H^2/H_0^2$, least")
    own.curve("xi", "field_squared", r"least field $(\mu-1)H^2/(8\pi P)$", color=LINKS[2])
    own.curve("xi", "film_pressure", "pressure $p/P$ minus mean", color=LINKS[1], ls=DASHES[1])
    own.level(0, color="black", ls="-")
    own.label(y="field, pressure")
    if "field" in page:
        _field_axis(own)
    for panel in (shape, fields, own):
        _phases(panel)
    for panel in (flow, shape, fields, own):
        title = r"$\delta$: $(\mu-1)H_0^2/(8\pi P)$" if panel is fields else ""
        panel.legend(title, above=_share())
    bar = page.get("mean_flow_bar")
    page.facts(
        page.fact("delta", r"amplitude $\delta$"),
        page.fact("mean_flow", "mean flow"),
        "" if bar is None else
        rf"with $\varepsilon^2$ {number(page['mean_flow_corrected'])} ± {number(bar, 2)}",
        tension_number="surface tension $W$", d_max="largest field $D$", xi_at_d_max=r"at $\xi$ =",
    )  # fmt: skip
    return page.drawn


def _share() -> float:
    return 0.85 if narrow() else 0.42


def _water(panel: Panel, x: Any, height: Any, **style: Any) -> None:
    """Draw a film up to its surface."""
    panel.band(x, 0, height, color=_WATER, alpha=1, zorder=0)
    panel.curve(x, height, style.pop("label", ""), color=LINKS[0], **style)


def _mean_flow(panel: Panel) -> None:
    page = panel.page
    panel.curve("curve_delta", "curve_mean_flow", "cosine wave", color=LINKS[0])
    panel.curve("curve_delta", "curve_square_wave", "upper bound of all waves", color=GREY,
                ls=DASHES[1])  # fmt: skip
    panel.curve(page["delta"], page["mean_flow"], "this wave", marker="o", ls="", color=RED)
    if page.get("mean_flow_bar") is not None:
        panel.axes.errorbar(page["delta"], page["mean_flow_corrected"], yerr=page["mean_flow_bar"],
                            fmt="_", color=LINKS[3], capsize=3,
                            label=r"with $\varepsilon^2$, error bar")  # fmt: skip
    panel.axes.set(xlim=(0, 1), ylim=(0, None))
    panel.label(r"amplitude $\delta$ over mean thickness", r"mean flow $\overline{Q}$")


def _field_axis(panel: Panel) -> None:
    """Right axis with the field whose square is drawn."""
    most = float(panel.page["field"].max()) / 1e3
    unit = most / math.sqrt(float(panel.page["field_squared"].max()))

    def to_field(squared: ArrayLike) -> np.ndarray:
        return unit * np.sign(squared) * np.sqrt(np.abs(squared))

    def from_field(field: ArrayLike) -> np.ndarray:
        return np.sign(field) * (np.asarray(field) / unit) ** 2

    beside = panel.axes.secondary_yaxis("right", functions=(to_field, from_field))
    ticks = np.asarray(MaxNLocator(5).tick_values(0.0, most))
    beside.set_yticks(ticks[(ticks == 0) | (ticks > most / 3)])  # the others are close together
    beside.set_ylabel("field $H$ (kA m$^{-1}$)", color=LINKS[2])
    beside.tick_params(axis="y", colors=LINKS[2])


def _phases(panel: Panel, first: float = 0.0, words: str = r"phase $\xi = t - x$ (rad)") -> None:
    """Scale of a whole period from a phase on."""
    names = ("−π", "−π/2", "0", "π/2", "π", "3π/2", "2π")[2 if first == 0 else 0 :][:5]
    panel.axes.set_xlim(first, first + _TURN)
    panel.axes.set_xticks(np.linspace(first, first + _TURN, 5), names)
    panel.label(words)


# -- floats and bodies -----------------------------------------------------------------------------


def ride(result: Result) -> Figure:
    """Paths of floats over the travelling wave, and of tracers below them.

    Above: time over position, dark where the film is thick. Below: tracer paths in the frame of the
    wave, or velocities over the phase if there are no tracers.
    """
    page = Page(result, 6.0, 6.2)
    over, below = page.rows(3, 2, share=False)
    _waterfall(over)
    if "tracer_height" in result:
        _from_the_wave(below)
    else:
        for k, (values, length) in enumerate(
            zip(page["body_velocity"], np.atleast_1d(page["float_length"]), strict=True)
        ):
            below.curve(page["xi"], values / _speed(page), f"length {length:g}", color=MASSES[k],
                        ls=DASHES[k % 4])  # fmt: skip
        below.level(1.0, "speed of the wave")
        _phases(below)
        below.label(y="velocity over the wave's")
        below.legend()
    page.facts("lengths in wavelengths", delta=r"amplitude $\delta$", mean_flow="mean flow")
    return page.drawn


def _speed(page: Page) -> float:
    return page.get("wave_speed") or 1.0


def _scales(page: Page) -> tuple[float, float]:
    """1/k and 1/omega in the units of the result."""
    if page.get("wave_speed") is None:
        return 1.0, 1.0
    length = page["wavelength"] / _TURN
    return length, length / _speed(page)


def _waterfall(panel: Panel) -> None:
    page, (length, duration) = panel.page, _scales(panel.page)
    wavelength, time = _TURN * length, page["time"]
    shown = time <= time[0] + _PERIODS * _TURN * duration
    places = page["float_position"][:, shown]
    x = np.linspace(places.min() - 0.3 * wavelength, places.max() + 0.3 * wavelength, 500)
    t = np.linspace(time[0], time[shown][-1], 400)
    phase = np.mod(t[:, None] / duration - x[None, :] / length, _TURN)
    h = np.interp(phase, page["xi"], page["height"])
    panel.map(x / wavelength, t, h, cmap="Blues", shading="auto",
              vmin=h.min() - 0.3 * np.ptp(h), vmax=h.max() + 0.8 * np.ptp(h))  # fmt: skip
    drifts = _drifts(page)
    for k, (length, held) in enumerate(zip(*_each(page, "float_length", "trapped"), strict=True)):
        text = f"{length:g}: {drifts[k]}" if drifts else f"length {length:g}"
        panel.curve(places[k] / wavelength, time[shown], text + ", held" * bool(held),
                    color=MASSES[k], lw=1.6, ls=DASHES[k % 4])  # fmt: skip
    panel.label("position $x$ in wavelengths")
    panel.named("y", "time")
    panel.entries.append(patch("crests of the film", "#6BA3CE"))
    panel.legend("length: drift with $\\varepsilon^2$\nover the wave's speed" if drifts else "")


def _each(page: Page, *names: str) -> list[np.ndarray]:
    """Scalars that are a number for each float, or one number."""
    return [np.atleast_1d(page[name]) for name in names]


def _drifts(page: Page) -> list[str]:
    """Drift of every float over the wave speed with its error estimate; empty where unknown."""
    bars = page.get("float_drift_bar")
    if bars is None or None in np.atleast_1d(bars):
        return []
    pairs = zip(*_each(page, "float_drift_corrected", "float_drift_bar"), strict=True)
    return [f"{number(v / _speed(page))} ± {number(bar / _speed(page), 2)}" for v, bar in pairs]


def _from_the_wave(panel: Panel) -> None:
    page, (length, duration) = panel.page, _scales(panel.page)
    place = np.linspace(-math.pi, math.pi, 401)  # in the frame of the wave
    _water(panel, place, np.interp(np.mod(-place, _TURN), page["xi"], page["height"]))
    held, drifts = _each(page, "tracer_trapped", "tracer_drift_closed")
    for k, path in enumerate(page["tracer_position"]):
        at = np.mod(path / length - page["time"] / duration + math.pi, _TURN) - math.pi
        panel.curve(at, page["tracer_height"][k], ls="", marker=".", ms=1.6, color=MASSES[k])
        text = "held" if held[k] else f"drift {number(drifts[k] / _speed(page), 3)}"
        panel.entry(text, MASSES[k], "none", marker="o")
    _phases(panel, -math.pi, "position in the frame of the wave, $x - t$ (rad)")
    panel.axes.set_ylim(0, None)
    panel.axes.ticklabel_format(axis="y", scilimits=(-3, 3), useMathText=True)
    panel.label(y="height $z$", of="tracer_height")
    panel.legend("tracers,\ndrift over the wave's speed")


def carried(result: Result) -> Figure:
    """Body in the wave in the last period, and its velocity."""
    page = Page(result, 6.6, 6.2)
    t, turn = page["time"], _TURN * _scales(page)[1]
    *frames, below = page.rows(*[1] * _FRAMES, 2.6, share=False)
    shown = np.searchsorted(t, np.linspace(max(t[0], t[-1] - turn), t[-1], _FRAMES))
    _frames(frames, page["position"][None], [result.attributes["length"]], shown)
    late = t >= t[-1] - _TURNS * turn
    below.curve(t[late], page["velocity"][late] / _speed(page), "body", color=MASSES[0])
    if page.get("drift") is not None:
        below.level(page["drift"] / _speed(page), "drift", color=LINKS[1], lw=1.3)
    below.axes.margins(x=0)
    below.named("x", "time")
    below.label(y="velocity over the wave's")
    below.legend()
    page.facts(
        drift="drift", drift_massless="without mass", mass="mass", friction="friction",
        friction_forward="no forward motion from", friction_backward="no backward motion from",
    )  # fmt: skip
    return page.drawn


def floats(result: Result) -> Figure:
    """Floats on the wave at some times, from the first on, and the field that makes the wave."""
    page = Page(result, 5.6, 6.2)
    *rows, field = page.rows(*[1] * _FRAMES, 0.8, share=False)
    t, turn = page["time"], _TURN * _scales(page)[1]
    shown = np.searchsorted(t, np.linspace(t[0], min(t[-1], t[0] + 1.5 * turn), _FRAMES))
    lengths = [float(each) for each in np.atleast_1d(result.attributes["lengths"])]
    _frames(rows, page["float_position"], lengths, shown)
    rows[-1].axes.set_xlabel("")
    low, high = rows[-1].axes.get_xlim()
    place = np.linspace(low, high, 801)
    phase = _phase(page, t[shown[-1]], place)
    field.curve(place, np.interp(phase, page["xi"], page["field_squared"]), color=GREY)
    field.axes.set(xlim=(low, high), ylim=(0, None), yticks=[])
    field.label("place $x$ (wavelengths)", "$H^2$")
    for k, each in enumerate(lengths):
        rows[0].entry(f"length {each:g}", MASSES[k], lw=4)
    rows[0].legend()
    page.facts(
        "lengths in wavelengths", delta=r"amplitude $\delta$", float_drift="drift", trapped="held"
    )
    return page.drawn


def _floating(
    panel: Panel, place: np.ndarray, middles: ArrayLike, lengths: Sequence[float], time: float
) -> None:
    """Draw film and bodies at a time; positions and lengths in wavelengths."""
    page, across, high = panel.page, _depth(panel.page), _high(panel.page)

    def film(x: np.ndarray) -> np.ndarray:
        return np.interp(_phase(page, time, x), page["xi"], page["height"]) / across

    panel.filled(place, film(place), _WATER, edgecolor=LINKS[0], linewidth=1.3, zorder=1)
    for i, (middle, length) in enumerate(zip(np.asarray(middles), lengths, strict=True)):
        half = max(length, _SHORT) / 2
        under = np.linspace(middle - half, middle + half, 41)
        low = np.zeros(41) if page.result.attributes.get("on") == "ground" else film(under)
        order = 3 - length  # short bodies before long bodies
        panel.band(under, low, low + high, color=MASSES[i], alpha=1, zorder=order)


def _depth(page: Page) -> float:
    """Mean thickness of the film."""
    return float(np.mean(page["height"][:-1]))


def _high(page: Page) -> float:
    """Height at which bodies are drawn, in thicknesses of the film."""
    return max(page.result.attributes.get("height", 0.0), _FLAT)


def _phase(page: Page, time: float, place: np.ndarray) -> np.ndarray:
    """Phases from 0 to 2 pi of positions in wavelengths."""
    return np.mod(time / _scales(page)[1] - _TURN * place, _TURN)


def _frames(
    rows: Sequence[Panel], places: np.ndarray, lengths: Sequence[float], at: np.ndarray
) -> None:
    """Film and bodies at the times of the indices; `places` is (body, time)."""
    page = rows[0].page
    places, unit = places / (_TURN * _scales(page)[0]), page.unit("time").replace("1", "")
    place = np.linspace(places[:, at].min() - 1, places[:, at].max() + 1, 801)
    for panel, k in zip(rows, at, strict=True):
        time = float(page["time"][k])
        _floating(panel, place, places[:, k], lengths, time)
        panel.scenery(equal=False)
        panel.axes.set(xlim=(place[0], place[-1]), ylim=(0, None), ylabel="$h/d$")
        panel.axes.tick_params(labelbottom=panel is rows[-1])
        panel.axes.set_title(f"at {time:.4g} {unit}", loc="left", fontsize="small")
    rows[-1].label("place $x$ (wavelengths)")


def _stage_wave(result: Result) -> Page:
    """Draw the axes around the bodies in the first periods of the wave; heights are stretched."""
    page = Page(result, 2.3, 1.9)
    panel, places = page.panel(), _bodies(page)[0]
    shown = page["time"] <= page["time"][0] + _TURNS * _TURN * _scales(page)[1]
    places, top = places[:, shown], 1.1 * float(page["height"].max()) / _depth(page) + _high(page)
    low = -0.6 if "field_squared" in page else -0.05
    panel.axes.set(xlim=(places.min() - 1, places.max() + 1), ylim=(low, top))
    panel.level(0, color="black", ls="-", lw=1)
    panel.scenery(equal=False)
    panel.axes.set_yticks([tick for tick in panel.axes.get_yticks() if 0 <= tick < top])
    panel.label("place $x$ (wavelengths)", "$h/d$, stretched")
    if "field_squared" in page:
        panel.axes.set_title("orange: the square of the field", loc="right")
    return page


def _pose_wave(panel: Panel, frame: int) -> None:
    page, t = panel.page, panel.page["time"]
    now = t[0] + _TURNS * _TURN * _scales(page)[1] * frame / animation.frames
    place = np.linspace(*panel.axes.get_xlim(), 161)
    places, lengths = _bodies(page)
    _floating(panel, place, [np.interp(now, t, row) for row in places], lengths, now)
    if "field_squared" in page:
        squared = np.interp(_phase(page, now, place), page["xi"], page["field_squared"])
        panel.filled(place, 0.45 * squared / page["field_squared"].max() - 0.55, _FIELD, -0.55)
    unit = page.unit("time").replace("1", "")
    panel.above(f"$t$ = {now:.2f} {unit}".strip())


def _bodies(page: Page) -> tuple[np.ndarray, list[float]]:
    """Places (body, time) in wavelengths, and lengths."""
    attributes = page.result.attributes
    places = page["float_position"] if "float_position" in page else page["position"][None]
    lengths = np.atleast_1d(
        attributes["lengths"] if "lengths" in attributes else attributes["length"]
    )
    return places / (_TURN * _scales(page)[0]), [float(each) for each in lengths]


animation = Animation(144, _stage_wave, _pose_wave)


# -- the best wave ---------------------------------------------------------------------------------


def film_wave(result: Result) -> Figure:
    """Thickness, field and surface velocity over one wavelength; below, other films if swept.

    Dashed in colour: the cosine wave within the same limits.
    """
    swept = "sweep_mean_flow" in result
    page = Page(result, 7.4 if swept else 5.0, 8.0 if swept else 5.0)
    shape, field, velocity, *other = page.rows(*(1, 1, 1, 1.5)[: 3 + swept], share=False)
    for panel, name, text in (
        (shape, "height", "thickness $h$ over its mean"),
        (field, "field_pressure", r"field $(\mu-1)H^2/(8\pi P)$"),
        (velocity, "surface_velocity", "surface velocity $u_s$"),
    ):
        panel.curve("xi", name, words=text, color=LINKS[0])
        if f"{name}_cosine" in result:
            panel.curve(page["xi_cosine"], f"{name}_cosine", color=LINKS[3], lw=1.1, ls=_OTHER)
        _phases(panel, words=r"phase $\xi = t - x$ (rad)" if panel is velocity else "")
        panel.axes.tick_params(labelbottom=panel is velocity)
    _water(shape, "xi", "height")
    shape.axes.set_ylim(0, None)
    for level in page["thickness_limits"]:
        shape.level(level, zorder=1.5)
    limit = page.get("field_limit")
    for level in (0.0, page.get("field_range") if limit is None else limit):
        field.level(level, zorder=1.5)
    velocity.level(1.0, color="black", ls=":", lw=0.9)
    shape.entry("best wave", LINKS[0])
    if "height_cosine" in result:
        shape.entry("cosine wave", LINKS[3], _OTHER)
    shape.entry("limits", GREY, LIMIT, 0.8)
    shape.entry("speed of the wave: it holds faster floats", "black", ":", 0.9)
    shape.legend(above=0.9)
    page.facts(
        mean_flow="mean flow", mean_flow_cosine="cosine wave",
        mean_flow_supremum="upper bound of all waves", tension_number="surface tension $W$",
        field_range=r"range of the field $\beta$", crests="", float_drift="drift of a float",
        float_drift_cosine="cosine wave",
    )  # fmt: skip
    for panel in other:
        _draw_sweep(panel)
    return page.drawn


def _draw_sweep(panel: Panel) -> None:
    """Gap to the supremum over the parameter with more values."""
    page = panel.page
    tension, field = page["sweep_tension"], page["sweep_field"]
    along = len(tension) >= len(field)
    places, others = (tension, field) if along else (field, tension)
    for name, color in (("best", ""), ("cosine", RED)):
        flow = page["sweep_mean_flow" if name == "best" else "sweep_mean_flow_cosine"]
        gaps = page["mean_flow_supremum"] - (flow.T if along else flow)
        for k, gap in enumerate(gaps):
            panel.axes.loglog(
                places, gap, "s--" if color else "o-", color=color or LINKS[k % 4], ms=4,
                alpha=0.4 + 0.6 / (1 + k) if color else 1,
                label=f"{name}, {'field' if along else '$W$'} {others[k]:.3g}",
            )  # fmt: skip
    panel.label("surface tension ($W$)" if along else r"range of the field ($\beta$)",
                "flow below the supremum")  # fmt: skip
    few_decades(panel.axes.xaxis)
    panel.legend()


# -- a film in a given field -----------------------------------------------------------------------


def forward(result: Result) -> Figure:
    """Motion of a film, its end, the field, and the eigenvalues; steady branches if continued."""
    branches = "branch_delta" in result
    page = Page(result, 6.4, 8.5 if branches else 7.2)
    panels = page.mosaic(
        "CF;CH;SB" if branches else "CF;CH;SH", "C;F;H;S;B" if branches else "C;F;H;S",
        (5, 4, 5), (1.5, *[1.0] * (3 + branches)),
    )  # fmt: skip
    _course(panels["C"])
    _film(panels["F"])
    panels["H"].curve(*_closed(page, "field_pressure"), color=LINKS[3])
    panels["H"].label(y=r"field $(\mu - 1) H^2 / 8\pi$")
    _spectrum(panels["S"])
    if branches:
        _branches(panels["B"])
    for name in "CFH":
        panels[name].axes.set_xlim(0, 2)
        panels[name].axes.xaxis.set_major_locator(MaxNLocator(5))
        panels[name].label(r"phase $\xi$ ($\pi$ rad)")
    words = {name: text for name, _, text in _OUTCOMES}[page["outcome"]]
    page.facts(
        f"the film {words}" if words.endswith(("s", "wave")) else words,
        tension_number="surface tension $W$", growth_rate_max="largest growth rate",
    )  # fmt: skip
    return page.drawn


def _stage_forward(result: Result) -> Page:
    """Draw the prescribed film, and the field below; heights are stretched."""
    page = Page(result, 2.3, 1.9)
    panel, top = page.panel(), 1.1 * float(page["thickness"].max())
    xi, field = _closed(page, "field_pressure")
    low, least, most = -0.5 * top, float(field.min()), float(field.max()) or 1.0
    share = (field - least) / ((most - least) or 1.0)
    panel.filled(xi, low * (0.9 - 0.75 * share), _FIELD, 0.9 * low)
    if "thickness_wave" in page:
        panel.curve(*_closed(page, "thickness_wave"), color="black", ls=DASHES[1], lw=1, zorder=4)
    panel.level(0, color="black", ls="-", lw=1)
    panel.scenery(equal=False)
    panel.axes.set(xlim=(0, 2), ylim=(low, top))
    panel.axes.set_yticks([tick for tick in panel.axes.get_yticks() if 0 <= tick < top])
    panel.axes.set_title("dashed: the prescribed film; orange: $H^2$", loc="right")
    panel.label(r"phase $\xi$ ($\pi$ rad)", "thickness $h$")
    return page


def _pose_forward(panel: Panel, frame: int) -> None:
    page, t = panel.page, panel.page["time"]
    now = t[0] + (t[-1] - t[0]) * frame / (animation_of_film.frames - 1)
    h = np.array([np.interp(now, t, column) for column in page["thickness"].T])
    xi = np.append(page["xi"] / math.pi, 2.0)
    panel.filled(xi, np.append(h, h[0]), _WATER, edgecolor=LINKS[0], linewidth=1.3, zorder=2)
    panel.above(f"{now / _TURN:.2f} periods")


animation_of_film = Animation(120, _stage_forward, _pose_forward)


def _closed(page: Page, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Phases in units of pi and values, the first repeated at the end."""
    values = page[name] if page[name].ndim == 1 else page[name][0]
    return np.append(page["xi"] / math.pi, 2.0), np.append(values, values[0])


def _course(panel: Panel) -> None:
    page, h = panel.page, panel.page["thickness"]
    if len(h) == 1:  # the film was ruptured at the start
        panel.curve(*_closed(page, "thickness_end"), color=LINKS[0])
        panel.axes.grid(visible=False)
    else:
        panel.map(_closed(page, "thickness")[0], page["time"] / _TURN,
                  np.column_stack([h, h[:, 0]]), "thickness $h$", shading="gouraud",
                  cmap="viridis")  # fmt: skip
    panel.label(y="time in periods")
    if page.get("broke_xi") is not None:
        panel.curve(page["broke_xi"] / math.pi, page["broke_time"] / _TURN, "breaks here",
                    marker="x", color=RED, ms=7, markeredgewidth=1.6, clip_on=False,
                    ls="none")  # fmt: skip
        panel.legend(above=0.42)


def _film(panel: Panel) -> None:
    end = _closed(panel.page, "thickness_end")
    panel.band(end[0], 0, end[1], color=LINKS[0], alpha=0.15)
    panel.curve(*end, "at the end", color=LINKS[0])
    if "thickness_wave" in panel.page:
        panel.curve(*_closed(panel.page, "thickness_wave"), "prescribed", color="black",
                    ls=DASHES[1], lw=1)  # fmt: skip
    panel.curve(*_closed(panel.page, "thickness"), "at the start", color=GREY, lw=0.8, ls=":")
    panel.axes.set_ylim(bottom=0)
    panel.label(y="thickness $h$")
    panel.legend(above=_share())


def _spectrum(panel: Panel) -> None:
    page, shown = panel.page, list[np.ndarray]()
    for name, mark, color, text in (
        ("wave", "o", "black", "prescribed wave"), ("end", "x", LINKS[0], "film at the end"),
    ):  # fmt: skip
        if f"growth_{name}" in page:
            rates = page[f"growth_{name}"][:_FEW], page[f"swing_{name}"][:_FEW]
            panel.curve(*rates, text, ls="none", marker=mark, color=color, mfc="none", ms=4)
            shown.append(rates[0])
    panel.level(0, axis="x", color=RED, lw=0.9, ls="-")
    panel.axes.text(0.99, 0.03, "unstable", color=RED, ha="right", fontsize=7.5,
                    transform=panel.axes.transAxes)  # fmt: skip
    panel.label(
        r"growth rate ($\mathrm{Re}\,\lambda$)", r"angular frequency ($\mathrm{Im}\,\lambda$)"
    )
    if shown:
        together = np.concatenate(shown)
        right = max(0.0, float(together.max())) + 0.5
        panel.axes.set_xlim(float(together.min()) - 0.4, right)
        panel.axes.axvspan(0, right, color=RED, alpha=0.06, linewidth=0)
        panel.legend(above=_share())


def _branches(panel: Panel) -> None:
    page = panel.page
    for which in np.unique(page["branch_number"]):
        own = page["branch_number"] == which
        delta, crest = page["branch_delta"][own], page["branch_thickness_max"][own]
        stable, color = page["branch_growth"][own] < 0, "black" if which == 0 else LINKS[1]
        text = f"{'prescribed' if which == 0 else 'other'} branch, stable"
        known = [entry.get_label() for entry in panel.labelled()]
        panel.curve(delta, np.where(stable, crest, np.nan), "" if text in known else text,
                    color=color)  # fmt: skip
        panel.curve(delta, crest, "unstable" if which == 0 else "", color=color, lw=1,
                    ls=DASHES[2], zorder=1)  # fmt: skip
    for k, fold in enumerate(page["delta_fold"]):
        panel.level(fold, "" if k else "fold", axis="x", color=RED, ls=":")
    panel.label(r"amplitude that the field prescribes ($\delta$)", "largest thickness")
    panel.legend(above=_share())


def basins(result: Result) -> Figure:
    """Outcomes of flat films, over the amplitude and the surface tension.

    A cell for each film, with the largest growth rate of the prescribed wave.
    """
    tall = 1.6 + 0.3 * len(result["map_tension"].values)
    page = Page(result, tall, tall + 0.3)
    panel = page.panel()
    outcome, growth = page["map_outcome"], page["map_growth"]
    colours = ListedColormap([color for _, color, _ in _OUTCOMES])
    norm = BoundaryNorm(np.arange(-0.5, len(_OUTCOMES)), len(_OUTCOMES))
    panel.axes.pcolormesh(outcome.T, cmap=colours, norm=norm, edgecolors=GREY, linewidth=0.5)
    for i, j in np.argwhere(np.isfinite(growth)):
        panel.axes.text(
            i + 0.5, j + 0.5, f"{growth[i, j]:+.2f}".replace("-", "−"), ha="center", va="center",
            fontsize=6.5 if narrow() else 7.5,
            color="white" if outcome[i, j] == 3 else "black",
            weight="bold" if growth[i, j] > 0 else "normal",
        )  # fmt: skip
    panel.axes.grid(visible=False)
    for axis, name in ((panel.axes.xaxis, "map_delta"), (panel.axes.yaxis, "map_tension")):
        values = page[name]
        axis.set_major_locator(FixedLocator((np.arange(len(values)) + 0.5).tolist()))
        axis.set_major_formatter(FuncFormatter(_cell(values)))
        axis.set_tick_params(length=0)
    panel.label(r"amplitude that the field prescribes ($\delta$)", "surface tension $W$")
    page.facts("numbers: largest growth rate of the prescribed wave, bold where it is unstable")
    for k, (_, color, text) in enumerate(_OUTCOMES):
        if np.any(outcome == k):
            panel.entries.append(patch(text, color, edgecolor=GREY, linewidth=0.6))
    return page.legend()


def _cell(values: np.ndarray) -> Any:
    def written(place: float, _: object) -> str:
        k = int(place)
        return f"{values[k]:g}" if 0 <= k < len(values) else ""

    return written
