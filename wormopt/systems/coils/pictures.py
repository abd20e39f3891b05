"""Pictures of rows of coils, films and floats over them, fluids at rest, and materials."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wormopt.pictures.page import Animation, Page, Panel, edges
from wormopt.pictures.style import (
    DASHES,
    GLIDE,
    GREY,
    LINKS,
    MASSES,
    RED,
    narrow,
    number,
    patch,
    raised,
)
from wormopt.result import Result

_UNITS = ("mm", "mm s-1", "mm2", "mm2 s-1", "kA m-1", "kA2 m-2", "mT")
_SNAPSHOTS_OF_FIELD = 3
_SNAPSHOTS = 4
_FRAMES, _AROUND = 5, 2.0  # number of times shown, and lengths of the float shown beside it
_SORTS = ("", "mean_field_", "block_")
_NAMES = ("design", "best by the mean field", "best block")
_WINDING = "#D9A066"
_OFF, _ON, _WATER = "#EADFCF", "#D98C3F", "#CFE3F3"  # coils without current and with it; the film
_PHASE = r"phase $\xi = \omega t - k x$ ($\pi$ rad)"


# -- rows of coils: their travelling field, and currents for a wave of a film ----------------------


def travelling_field(result: Result) -> Figure:
    """Plot the field along the row over time, at a few times, and in the frame of the wave.

    Positions in mm; in the frame of the wave, mean and range of H² over the positions.
    """
    page = Page(result, 6.6, 6.0, _UNITS)
    spread, still, frame = page.rows(4, 3, 3, share=False)
    still.axes.sharex(spread.axes)
    t, field = page["time"], page["field"]
    half = (t[1] - t[0]) / 2 if len(t) > 1 else t[0]
    spread.map("place", np.append(t - half, t[-1] + half), "field", vmin=0)
    spread.label("")
    spread.named("y", "time")
    steps = np.unique(np.linspace(0, len(t), 2 * _SNAPSHOTS_OF_FIELD + 1).astype(int)[1::2])
    for color, dashes, step in zip(LINKS, DASHES, steps, strict=False):
        still.curve("place", "field", f"at {t[step]:.3g} s", pick=step, color=color, ls=dashes,
                    words="field $H$")  # fmt: skip
    _draw_coils(still)
    still.axes.set_ylim(0, 1.1 * max(float(field.max()), 1e-12))
    _profile(frame, first=-np.pi)
    page.facts(
        pitch="assumed pitch", wave_speed="speed of the wave", field_max="largest field",
        ripple=("", "%"), first_harmonic_share=("share of first harmonic", "%"),
    )  # fmt: skip
    return page.legend()


def row_currents(result: Result) -> Figure:
    """Plot wanted and computed H² in the frame of the wave, and currents of a few neighbours.

    The computed H² has its mean and its range over the positions.
    """
    page = Page(result, 4.6, 5.0, _UNITS)
    above, below = page.rows(1, 1, share=False)
    _profile(above)
    above.curve(page["phase"] / np.pi, "square_target", "wanted, $H_0^2 - D$", color="black",
                ls=DASHES[1])  # fmt: skip
    above.legend()
    currents = page["current"][:3]
    below.curves("time", currents, what="coil")
    limit = page.get("currents_limit")
    levels = [] if limit is None else [sign * limit for sign in (-1, 1)
                                       if (sign * page["current"]).max() > 0.6 * limit]  # fmt: skip
    below.limits([(level,) for level in levels][-1:])
    for level in levels[:-1]:
        below.level(level)
    below.label(y="current $I$ (ampere-turns)")
    below.legend()
    page.facts(
        field_residual=("residual of the field", "%"), ripple=("", "%"), H0="mean field $H_0$",
        currents_max="largest current", currents_limit="limit",
    )  # fmt: skip
    return page.drawn


def _profile(panel: Panel, first: float = 0.0) -> None:
    """Draw H² over one wave from a phase on: mean and range over the positions."""
    page = panel.page
    phase = np.mod(page["phase"] - first, 2 * np.pi) + first
    order = np.argsort(phase)
    phase = phase[order] / np.pi
    panel.curve(
        phase, "square_mean", "mean over the row", pick=order, words="$H^2$", color=LINKS[0]
    )
    panel.label(y="$H^2$", of="square_mean")
    panel.band(phase, page["square_low"][order], page["square_high"][order], "range over the row",
               color=LINKS[0], alpha=0.2)  # fmt: skip
    panel.axes.set_ylim(bottom=0)
    panel.axes.margins(x=0)
    panel.label(_PHASE)


def _draw_coils(panel: Panel) -> None:
    """Mark places of coils by ticks at the bottom."""
    for place in panel.page["coil_place"]:
        panel.axes.axvline(place, ymax=0.04, color=GREY, linewidth=1)
    panel.entry("coil", GREY, "none", marker="|")


# -- films over rows of coils ----------------------------------------------------------------------


def coil_film(result: Result) -> Figure:
    """Plot thickness over position and time, and thickness and flow at a few times.

    The thickness is stretched relative to the position; ticks below are the coils.
    """
    page = Page(result, 6.8, 6.2, _UNITS)
    spread, still, flow = page.rows(4, 3, 2.4)
    t, flat = page["time"], float(page["thickness"][0].mean())
    spread.map("face", np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]]), "thickness",
               "thickness $h$", about=flat)  # fmt: skip
    spread.named("y", "time")
    kept = np.linspace(0, len(t) - 1, _SNAPSHOTS + 1).astype(int)[1:]
    for color, dashes, k in zip(LINKS, DASHES, kept, strict=False):
        still.curve("x", "thickness", f"at {t[k]:.3g} s", pick=k, words="thickness $h$",
                    color=color, ls=dashes)  # fmt: skip
        flow.curve("face", "flow", pick=k, words="flow $Q$", color=color, ls=dashes)
    still.level(flat, ls="-", lw=1)
    _draw_coils(still)
    still.axes.set_ylim(bottom=0)
    flow.named("x", "x", "position $x$")
    row = f"row assumed: {len(page['coil_place'])} coils {number(page.length('pitch'))} mm apart"
    page.facts(
        row, wave_speed="", carried_per_switch="", thickness_max="thickest",
        thickness_min="thinnest", grid_error=("", "%"),
    )  # fmt: skip
    return page.legend()


def cargo(result: Result) -> Figure:
    """Plot the float on the film at a few times, to scale, and its path over the coils'."""
    page = Page(result, 7.0, 7.4, _UNITS)
    t, X, places = page["time"], page["float_position"], page["coil_place"]
    *frames, path = page.rows(*[1] * _FRAMES, 4, share=False)
    on, thick = page["current"] > 0, 1e3 * page["float"]["thickness"]
    for panel, k in zip(frames, np.linspace(0, len(t) - 1, _FRAMES).astype(int), strict=True):
        low, high = _carried(panel, k, page["thickness"].max() + 3 * thick)
        seen = places[on[k] & (low < places) & (places < high)]
        panel.axes.plot(seen, 0 * seen, "|", color="black", markersize=12, clip_on=False)
        panel.axes.set_title(f"{t[k]:.3g} s", loc="left", fontsize="small")
    frames[0].axes.set_title("height to scale; strokes: active coils", loc="right",
                             fontsize="small")  # fmt: skip
    frames[-1].label("position $x$ (mm)")
    half = page.length("pitch") / 2
    path.map(np.append(places - half, places[-1] + half), t, on[:-1], cmap="Greys", vmax=4)
    path.curve(X, t, "middle of the float", color=MASSES[0])
    path.entries.append(patch("active coils", "0.75"))
    path.label("position $x$ (mm)")
    path.named("y", "time")
    path.axes.legend(handles=path.labelled(), loc="upper left")
    page.facts(
        float_speed="mean speed", wave_speed="", float_captured=("keeps up in", "%"),
        draught="", energy_error=("", "%"),
    )  # fmt: skip
    return page.drawn


def _carried(panel: Panel, k: int, top: float) -> tuple[float, float]:
    """Draw film and float at an instant, to scale; gives the ends of what is shown."""
    page = panel.page
    x, h, X = page["x"], page["thickness"][k], float(page["float_position"][k])
    length, thick = (1e3 * page["float"][name] for name in ("length", "thickness"))
    panel.band(x, 0, h, color=LINKS[0], alpha=0.5)
    below = np.abs(x - X) <= length / 2
    panel.band(x[below], h[below], h[below] + thick, color=MASSES[0], alpha=1, linewidth=0.6)
    ends = X - _AROUND * length, X + _AROUND * length
    panel.axes.set(xlim=ends, ylim=(0, top), ylabel="$z$ (mm)")
    panel.scenery()
    return ends


def _stage(result: Result) -> Page:
    """Draw the row of coils; heights are stretched."""
    page = Page(result, 2.3, 1.9, _UNITS)
    panel, x, places = page.panel(), page["x"], page["coil_place"]
    top = 1.3 * page["thickness"].max() + 3 * _thick(page)
    panel.axes.set(xlim=(x[0], x[-1]), ylim=(-0.5 * top, top))
    panel.level(0, color="black", ls="-", lw=1)
    half, low = 0.4 * np.diff(places).min(), -0.4 * top
    for place in places:
        panel.axes.add_patch(Rectangle((place - half, low), 2 * half, -0.75 * low, facecolor=_OFF,
                                       edgecolor="none"))  # fmt: skip
    panel.scenery(equal=False)
    panel.label("position $x$ (mm)", "height $z$ (mm), stretched")
    panel.axes.set_yticks([tick for tick in panel.axes.get_yticks() if 0 <= tick < top])
    return page


def _pose(panel: Panel, frame: int) -> None:
    """Draw the film, the float, and the coils that are on, darker with more current."""
    page, t, x = panel.page, panel.page["time"], panel.page["x"]
    now = t[0] + (t[-1] - t[0]) * frame / (animation.frames - 1)
    k = min(int(np.searchsorted(t, now, side="right")) - 1, len(t) - 1)
    after = min(k + 1, len(t) - 1)
    share = (now - t[k]) / (t[after] - t[k]) if after > k else 0.0
    h = (1 - share) * page["thickness"][k] + share * page["thickness"][after]
    panel.filled(x, h, _WATER, edgecolor=LINKS[0], linewidth=1.0, zorder=2)
    current, most = np.abs(page["current"][k]), float(np.abs(page["current"]).max()) or 1.0
    low = panel.axes.get_ylim()[0]
    half = 0.4 * np.diff(page["coil_place"]).min()
    for place, strength in zip(page["coil_place"], current / most, strict=True):
        if strength > 0:
            box = (place - half, 0.8 * low), 2 * half, -0.6 * low
            panel.axes.add_patch(Rectangle(*box, facecolor=_ON, alpha=strength, edgecolor="none"))
    if "float_position" in page:
        X = (1 - share) * page["float_position"][k] + share * page["float_position"][after]
        under = X + 500 * page["float"]["length"] * np.linspace(-1, 1, 41)
        on = np.interp(under, x, h)
        panel.band(under, on, on + _thick(page), color=MASSES[0], alpha=1, zorder=4)
    panel.above(f"$t$ = {now:.2f} s")


def _thick(page: Page) -> float:
    """Thickness of the float in mm, 0 without one."""
    return 1e3 * page["float"]["thickness"] if "float_position" in page else 0.0


animation = Animation(144, _stage, _pose)


# -- designed currents -----------------------------------------------------------------------------


def coil_design(result: Result) -> Figure:
    """Plot waveforms, paths of the float, currents over coil and time, and the film."""
    page = Page(result, 7.4, 8.4, _UNITS)
    shape = page.drawn.add_gridspec(3, 2, height_ratios=(3, 3.4, 1.3))
    waveforms, paths = page.panel(shape[0, 0]), page.panel(shape[0, 1])
    ramps = page.get("slew_max") is not None  # of currents that change continuously
    per_step = len(page["pattern"]) / page["repeat"]
    for sort, name, color, dashes in zip(_SORTS, _NAMES, LINKS, DASHES, strict=False):
        values = page[f"{sort}pattern"]
        waveforms.curve(np.arange(len(values) + 1) / per_step, np.append(values, values[0]), name,
                      color=color, ls=dashes, ds="default" if ramps else "steps-post")  # fmt: skip
        place = page[f"{sort}position" if sort else "float_position"]
        paths.curve(page[f"{sort}time"], place, color=color, ls=dashes)
    waveforms.label("steps of the pattern", "ampere-turns of a coil (A)")
    paths.named("x", "time")
    paths.label(y="position of the float (mm)")
    _currents(page.panel(shape[1, :]), ramps=ramps)
    film = page.panel(shape[2, :])
    k = 3 * (len(page["time"]) - 1) // 4
    thick = 1e3 * page["float"]["thickness"]
    _carried(film, k, 1.2 * page["thickness"][k].max() + thick)
    film.level(float(page["thickness"][0].mean()), ls="-", lw=0.5)
    film.label("position $x$ (mm)")
    film.axes.set_title(
        f"film and float with the design at {page['time'][k]:.3g} s, to scale", fontsize="small"
    )
    page.facts(
        float_speed="design", mean_field_speed="mean field", block_speed="block", power="",
        over_mean_field=("gain over mean field", "%"), over_block=("gain over block", "%"),
        neighbour_gain=("gain of best neighbour", "%"),
    )  # fmt: skip
    return page.legend()


def _currents(panel: Panel, *, ramps: bool) -> None:
    """Draw the currents of the design over position and time, with the float's path."""
    page, t, places = panel.page, panel.page["time"], panel.page["coil_place"]
    current, X = page["current"], page["float_position"]
    # the mean of currents that jump never flows
    between = (current[:-1] + current[1:]) / 2 if ramps else current[:-1]
    panel.map(t, edges(places), between.T, "ampere-turns (A)", about=0.0)
    panel.curve(t, X, color="black", lw=2)
    half_way = len(t) // 2
    panel.axes.annotate(
        "float", (t[half_way], X[half_way]), (-8, 6),
        textcoords="offset points", ha="right", va="bottom",
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1},
    )  # fmt: skip
    panel.named("x", "time")
    panel.label(y="position $x$ (mm)")


# -- fluid at rest, and membranes ------------------------------------------------------------------


def coil_pressure(result: Result) -> Figure:
    """Plot induction, surface and bottom pressure: figure 25 of Zimmermann et al. 2007.

    Coil and field have one scale above; the surface, in the middle, has a stretched height.
    """
    page = Page(result, 7.0, 6.2, _UNITS)
    top, middle, bottom = page.rows(3 if narrow() else 4.2, 3, 3)
    _field(top)
    x, z = np.broadcast_arrays(page["inside_x"], page["inside_z"])
    middle.map(x, z, "inside_pressure", "pressure $p$", shading="gouraud", cmap="viridis",
               rasterized=False)  # fmt: skip
    middle.curve("x", "surface", color=RED, words="height $z$")
    middle.axes.set_ylim(0, 1.1 * page["surface"].max())
    top.entries.append(patch("winding", _WINDING, edgecolor="black", linewidth=0.6))
    top.entry("surface of the fluid", RED)
    top.entry("field lines", "#404040", lw=0.6)
    bottom.curve("x", "pressure", "in the field", color=LINKS[0])
    bottom.level("pressure_without_field", "without field", lw=1, ls=DASHES[1])
    bottom.axes.set_ylim(bottom=0)
    bottom.label("position $x$ (mm)")
    page.facts(
        ampere_turns="ampere-turns", field_bottom_max="largest field at the bottom",
        surface_rise_max="rise of the surface", surface_drop_max="drop",
        pressure_max="largest pressure", stated_pressure="stated",
    )  # fmt: skip
    return page.legend()


def _field(panel: Panel) -> None:
    """Draw lines and magnitude of the induction, the winding, and the surface."""
    page, axes = panel.page, panel.axes
    x, z, along, up = (page[name] for name in ("map_x", "map_z", "induction_x", "induction_z"))
    size = np.hypot(along, up)
    most = np.nanmax(size)
    if most > 0:
        norm = LogNorm(vmin=max(np.nanmin(size), 1e-3 * most), vmax=most)
        panel.map(x, z, size, "induction $B$ (mT)", norm=norm, cmap="Blues", shading="nearest",
                  rasterized=False)  # fmt: skip
        axes.streamplot(x, z, np.nan_to_num(along), np.nan_to_num(up), color="#404040",
                        linewidth=0.6, arrowsize=0.6, density=1.1)  # fmt: skip
    for left, low, wide, high in 1e3 * np.array(page["winding"]):
        axes.add_patch(Rectangle((left, low), wide, high, facecolor=_WINDING, edgecolor="black",
                                 linewidth=0.8, zorder=3))  # fmt: skip
    panel.curve(page["x"], page["surface"], color=RED, lw=1.1)
    panel.level(0, color="black", ls="-", lw=1)
    panel.scenery()
    axes.set(xlim=(x[0], x[-1]), ylim=(z[0], z[-1]))
    panel.label(y="height $z$ (mm)")


def membrane(result: Result) -> Figure:
    """Plot strain over loss of fluid for all thicknesses, and remaining pressure over thickness.

    The front is dashed beyond a limit.
    """
    page = Page(result, 3.2, 5.4, _UNITS)
    left, right = page.beside(2)
    within, best = page["front_within"] == 1, page["thickness_best"]
    for panel, x, y in (
        (left, 100 * page["front_loss"], 100 * page["front_strain"]),
        (right, page["front_thickness"], page["front_contact_pressure"]),
    ):
        panel.curve(x, y, "beyond a limit", color=GREY, lw=1, ls=DASHES[1])
        panel.curve(x, np.where(within, y, np.nan), "allowed", color=LINKS[0], lw=1.8)
        panel.axes.set_xscale("log")
    spot = {"marker": "o", "ls": "none", "color": RED, "zorder": 3}
    left.curve(100 * page["loss_share"], 100 * page["strain"], f"best: {best:.3g} mm", **spot)
    right.curve(best, page["contact_pressure"], **spot)
    left.level(100 * page["loss_max"], "limits", axis="x", color=RED)
    left.level(100 * page["strain_max"], color=RED)
    left.axes.set_yscale("log")
    left.label("fluid lost within the lifetime (%)", "strain by the pressure (%)")
    right.label("thickness $h_m$ (mm)")
    right.label(y="remaining pressure on the ground", of="front_contact_pressure")
    right.level(0, color="black", ls="-")
    limited = str(page["limited_by"]).replace("_", " ")
    page.facts(f"limited by {limited}", stress=("", "kPa"), bending_stiffness="")
    return page.legend()


# -- materials -------------------------------------------------------------------------------------


def stress_strain(result: Result) -> Figure:
    """Plot stress over strain (%), with field and without: figure 12 of Zimmermann et al. 2007.

    Strains that are no longer small are shaded.
    """
    page = Page(result, 4.2, 3.2)
    panel, percent = page.panel(), 100 * page["strain"]
    field = f"$H$ = {number(page['field'])} {raised('A m-1')}, slope $E_{{eff}}$"
    panel.curve(percent, "stress_without_field", r"without field, slope $3\eta$",
                words="stress $p$", color=GREY, ls=DASHES[1])  # fmt: skip
    panel.curve(percent, "stress_with_field", field, color=LINKS[0])
    u0, small = 100 * page["u0"], 100 * page["small_strain"]
    if percent[0] <= u0 <= percent[-1] and u0:
        panel.curve(u0, 0.0, marker="o", color=LINKS[0], clip_on=False, zorder=3)
        panel.axes.annotate(f"$u_0$ = {number(u0, 3)} %", (u0, 0.0), (5, -11), color=LINKS[0],
                            textcoords="offset points")  # fmt: skip
    beyond = [(small, percent[-1]), (percent[0], -small)]
    for index, (start, end) in enumerate(span for span in beyond if span[0] < span[1]):
        panel.axes.axvspan(max(start, percent[0]), min(end, percent[-1]), color=GLIDE, zorder=0,
                           label=None if index else "beyond small strains")  # fmt: skip
    panel.level(0, color="black", ls="-")
    panel.axes.margins(x=0)
    panel.label("strain $u$ (%)")
    page.facts(permeability="", lame_eta=(r"Lamé coefficient $\eta$", "kPa"),
               stiffness="stiffness of the bar")  # fmt: skip
    return page.legend()
