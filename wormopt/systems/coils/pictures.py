"""Pictures of rows of coils, films and floats over them, fluids at rest, and materials."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from wormopt.plotting.parts import (
    DASHES,
    GLIDE,
    GREY,
    LIMIT,
    LINKS,
    MASSES,
    RED,
    draw_limits,
    fact,
    label,
    legend,
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

_SNAPSHOTS_OF_FIELD = 3
_FIELD = label("field $H$", "kA m-1")
_SNAPSHOTS = 4
_FRAMES, _AROUND = 5, 2.0  # number of times shown, and lengths of the float shown beside it
_SORTS = ("", "mean_field_", "block_")
_NAMES = ("design", "best by the mean field", "best block")
_WINDING = "#D9A066"


# -- rows of coils: their travelling field, and currents for a wave of a film ----------------------


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
    steps = np.unique(np.linspace(0, len(t), 2 * _SNAPSHOTS_OF_FIELD + 1).astype(int)[1::2])
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
    limit_lines = []
    limit = scalar(result, "currents_limit")
    for sign in (-1, 1):
        if limit is not None and (sign * currents).max() > 0.6 * limit:
            limit_lines = draw_limits(below, [(sign * limit,)])
    below.margins(x=0)
    below.set_ylabel(label("current $I$", "ampere-turns"))
    below.set_xlabel(label("time $t$", result["time"].unit))
    legend(below, [*below.get_legend_handles_labels()[0], *limit_lines])
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


# -- films over rows of coils ----------------------------------------------------------------------


def coil_film(result: Result) -> Figure:
    """Plot thickness over position and time, and thickness and flow at a few times.

    The thickness is stretched relative to the position; ticks below are the coils.
    """
    drawn = sheet(7.1, 6.8, 6.2)
    spread, still, flow = drawn.subplots(3, height_ratios=(4, 3, 2.4), sharex=True)
    x, t = 1e3 * result["x"].values, result["time"].values
    face, h = 1e3 * result["face"].values, 1e3 * result["thickness"].values
    flat = float(h[0].mean())
    most = max(float(np.abs(h - flat).max()), 1e-12)
    edges = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]])
    shown = spread.pcolormesh(
        face, edges, h, cmap="RdBu_r", vmin=flat - most, vmax=flat + most, shading="flat",
        rasterized=True,
    )  # fmt: skip
    drawn.colorbar(shown, ax=spread, label="thickness $h$ (mm)", pad=0.01)
    spread.grid(visible=False)
    spread.set_ylabel(label("time $t$", result["time"].unit))
    kept = np.linspace(0, len(t) - 1, _SNAPSHOTS + 1).astype(int)[1:]
    for colour, dashes, k in zip(LINKS, DASHES, kept, strict=False):
        still.plot(x, h[k], color=colour, linestyle=dashes, label=f"at {t[k]:.3g} s")
        flow.plot(face, 1e6 * result["flow"].values[k], color=colour, linestyle=dashes)
    still.axhline(flat, color=GREY, linewidth=1)
    for place in 1e3 * result["coil_place"].values:
        still.axvline(place, ymax=0.04, color=GREY, linewidth=1)
    still.set_ylim(bottom=0)
    still.set_ylabel("thickness $h$ (mm)")
    flow.set_ylabel(label("flow $Q$", "mm2 s-1"))
    flow.set_xlabel("position $x$ (mm)")
    flow.margins(x=0)
    entries = [*still.get_lines()[: len(kept)], line("coil", GREY, "none", marker="|")]
    legend_below(drawn, entries)
    tell(
        drawn,
        switching_note(result),
        fact(result, "wave_speed", "wave speed", "mm s-1"),
        fact(result, "carried_per_switch", "carried per switch", "mm2"),
        fact(result, "thickness_max", "thickest", "mm"),
        fact(result, "thickness_min", "thinnest", "mm"),
        fact(result, "grid_error", "grid error", "%"),
    )
    return drawn


def switching_note(result: Result) -> str:
    """Return the assumed row of a plot: no rig with all of these values is published."""
    count, pitch = len(result["coil_place"].values), 1e3 * result.attributes["pitch"]
    return f"row assumed: {count} coils {number(pitch)} mm apart"


def cargo(result: Result) -> Figure:
    """Plot the float on the film at a few times, to scale, and its path over the coils'."""
    t, x = result["time"].values, 1e3 * result["x"].values
    h, X = 1e3 * result["thickness"].values, 1e3 * result["float_position"].values
    length, thick = (1e3 * result.attributes["float"][name] for name in ("length", "thickness"))
    drawn = sheet(7.1, 7.0, 7.4)
    *frames, path = drawn.subplots(_FRAMES + 1, height_ratios=[1] * _FRAMES + [4])
    top = h.max() + 3 * thick
    on = result["current"].values > 0
    places = 1e3 * result["coil_place"].values
    for axes, k in zip(frames, np.linspace(0, len(t) - 1, _FRAMES).astype(int), strict=True):
        axes.fill_between(x, 0, h[k], color=LINKS[0], alpha=0.5, linewidth=0)
        below = np.abs(x - X[k]) <= length / 2
        axes.fill_between(x[below], h[k][below], h[k][below] + thick, color=MASSES[0])
        low, high = X[k] - _AROUND * length, X[k] + _AROUND * length
        seen = places[on[k] & (low < places) & (places < high)]
        axes.plot(seen, 0 * seen, "|", color="black", markersize=12, clip_on=False)
        axes.set(xlim=(low, high), ylim=(0, top), ylabel="$z$ (mm)")
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set_title(f"{t[k]:.3g} s", loc="left", fontsize="small")
    frames[0].set_title("height to scale; strokes: active coils", loc="right", fontsize="small")
    frames[-1].set_xlabel("position $x$ (mm)")
    _path(path, result, t, X, places, on)
    tell(
        drawn,
        fact(result, "float_speed", "mean speed", "mm s-1"),
        fact(result, "wave_speed", "wave speed", "mm s-1"),
        fact(result, "float_captured", "keeps up in", "%"),
        fact(result, "draught", "draught", "mm"),
        fact(result, "energy_error", "energy error", "%"),
    )
    return drawn


def _path(
    axes: Axes, result: Result, t: np.ndarray, X: np.ndarray, places: np.ndarray, on: np.ndarray
) -> None:
    half = 500 * result.attributes["pitch"]
    edges = np.concatenate([places - half, places[-1:] + half])
    axes.pcolormesh(edges, t, on[:-1], cmap="Greys", vmax=4, shading="flat", rasterized=True)
    axes.plot(X, t, color=MASSES[0], label="middle of the float")
    axes.fill_betweenx([], [], color="0.75", label="active coils")
    axes.grid(visible=False)
    axes.set_xlabel("position $x$ (mm)")
    axes.set_ylabel(label("time $t$", result["time"].unit))
    axes.legend(loc="upper left")


# -- designed currents -----------------------------------------------------------------------------


def coil_design(result: Result) -> Figure:
    """Plot waveforms, paths of the float, currents over coil and time, and the film."""
    drawn = sheet(7.1, 7.4, 8.4)
    shape = drawn.add_gridspec(3, 2, height_ratios=(3, 3.4, 1.3))
    _courses(drawn.add_subplot(shape[0, 0]), result)
    _ways(drawn.add_subplot(shape[0, 1]), result)
    _currents(drawn, drawn.add_subplot(shape[1, :]), result)
    _film(drawn.add_subplot(shape[2, :]), result)
    entries = [
        line(name, colour, dashes)
        for name, colour, dashes in zip(_NAMES, LINKS, DASHES, strict=False)
    ]
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "float_speed", "design", "mm s-1"),
        fact(result, "mean_field_speed", "mean field", "mm s-1"),
        fact(result, "block_speed", "block", "mm s-1"),
        fact(result, "power", "power", "W"),
        fact(result, "over_mean_field", "gain over mean field", "%"),
        fact(result, "over_block", "gain over block", "%"),
        fact(result, "neighbour_gain", "gain of best neighbour", "%"),
    )
    return drawn


def _ramps(result: Result) -> bool:
    """Return whether currents change continuously, so that they have a slope."""
    return result.scalars["slew_max"].value is not None


def _courses(axes: Axes, result: Result) -> None:
    """Draw the waveform of a coil over its steps, with the same number of values per step."""
    per_step = len(result["pattern"].values) / result.scalars["repeat"].value
    for sort, colour, dashes in zip(_SORTS, LINKS, DASHES, strict=False):
        values = result[f"{sort}pattern"].values
        steps = np.arange(len(values) + 1) / per_step
        values = np.append(values, values[0])
        axes.plot(
            steps, values, color=colour, linestyle=dashes,
            drawstyle="default" if _ramps(result) else "steps-post",
        )  # fmt: skip
    axes.set_xlabel("steps of the pattern")
    axes.set_ylabel(label("ampere-turns of a coil", "A"))


def _ways(axes: Axes, result: Result) -> None:
    for sort, colour, dashes in zip(_SORTS, LINKS, DASHES, strict=False):
        time = result[f"{sort}time"].values
        place = result["float_position" if not sort else f"{sort}position"].values
        axes.plot(time, 1e3 * place, color=colour, linestyle=dashes)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel("position of the float (mm)")


def _currents(drawn: Figure, axes: Axes, result: Result) -> None:
    """Draw the currents of the design over position and time, with the float's path."""
    t, places = result["time"].values, 1e3 * result["coil_place"].values
    current = result["current"].values
    half = (places[1] - places[0]) / 2
    edges = np.append(places - half, places[-1] + half)
    most = float(np.abs(current).max())
    # the mean of currents that jump never flows
    between = (current[:-1] + current[1:]) / 2 if _ramps(result) else current[:-1]
    shown = axes.pcolormesh(
        t, edges, between.T, cmap="RdBu_r", vmin=-most, vmax=most, shading="flat", rasterized=True
    )
    axes.plot(t, 1e3 * result["float_position"].values, color="black", linewidth=2)
    half_way = len(t) // 2
    axes.annotate(
        "float", (t[half_way], 1e3 * result["float_position"].values[half_way]), (-8, 6),
        textcoords="offset points", ha="right", va="bottom",
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1},
    )  # fmt: skip
    axes.grid(visible=False)
    axes.set_xlabel(label("time $t$", result["time"].unit))
    axes.set_ylabel("position $x$ (mm)")
    drawn.colorbar(shown, ax=axes, label="ampere-turns (A)", pad=0.01)


def _film(axes: Axes, result: Result) -> None:
    """Draw film and float, to scale, at three quarters of the time."""
    k = 3 * (len(result["time"].values) - 1) // 4
    x, h = 1e3 * result["x"].values, 1e3 * result["thickness"].values[k]
    X = 1e3 * float(result["float_position"].values[k])
    length, thick = (1e3 * result.attributes["float"][name] for name in ("length", "thickness"))
    axes.fill_between(x, 0, h, color=LINKS[0], alpha=0.5, linewidth=0)
    below = np.abs(x - X) <= length / 2
    axes.fill_between(x[below], h[below], h[below] + thick, color=MASSES[0])
    axes.axhline(float(result["thickness"].values[0].mean() * 1e3), color=GREY, linewidth=0.5)
    axes.set(xlim=(X - _AROUND * length, X + _AROUND * length), ylim=(0, 1.2 * h.max() + thick))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("position $x$ (mm)")
    axes.set_ylabel("$z$ (mm)")
    axes.set_title(
        f"film and float with the design at {result['time'].values[k]:.3g} s, to scale",
        loc="left", fontsize="small",
    )  # fmt: skip


# -- fluid at rest, and membranes ------------------------------------------------------------------


def coil_pressure(result: Result) -> Figure:
    """Plot induction, surface and bottom pressure: figure 25 of Zimmermann et al. 2007.

    Coil and field have one scale above; the surface, in the middle, has a stretched height.
    """
    drawn = sheet(7.1, 7.0, 6.2)
    top, middle, bottom = drawn.subplots(
        3, 1, height_ratios=(3 if narrow() else 4.2, 3, 3), sharex=True
    )
    _field(drawn, top, result)
    _surface(drawn, middle, result)
    x = 1e3 * result["x"].values
    bottom.plot(x, result["pressure"].values, color=LINKS[0], label="in the field")
    still = needed(result, "pressure_without_field")
    bottom.axhline(still, color=GREY, linewidth=1, linestyle=DASHES[1], label="without field")
    bottom.set_ylim(bottom=0)
    bottom.set_ylabel(label("pressure on\nthe bottom", result["pressure"].unit))
    bottom.set_xlabel("position $x$ (mm)")
    bottom.margins(x=0)
    for axes in (top, middle):
        axes.tick_params(labelbottom=False)
    entries = [
        Patch(facecolor=_WINDING, edgecolor="black", label="winding"),
        line("surface of the fluid", RED),
        line("field lines", "#404040", width=0.6),
        *bottom.get_lines(),
    ]
    legend_below(drawn, entries)
    tell(
        drawn,
        fact(result, "ampere_turns", "ampere-turns"),
        fact(result, "field_bottom_max", "largest field at the bottom", "kA m-1"),
        fact(result, "surface_rise_max", "rise of the surface", "mm"),
        fact(result, "surface_drop_max", "drop", "mm"),
        fact(result, "pressure_max", "largest pressure"),
        fact(result, "stated_pressure", "stated"),
    )
    return drawn


def _field(drawn: Figure, axes: Axes, result: Result) -> None:
    """Draw lines and magnitude of the induction, the winding, and the surface."""
    x, z = 1e3 * result["map_x"].values, 1e3 * result["map_z"].values
    Bx, Bz = result["induction_x"].values, result["induction_z"].values
    size = 1e3 * np.hypot(Bx, Bz)
    if np.nanmax(size) > 0:
        norm = LogNorm(vmin=max(np.nanmin(size), 1e-3 * np.nanmax(size)), vmax=np.nanmax(size))
        image = axes.pcolormesh(x, z, size, norm=norm, cmap="Blues", shading="nearest")
        drawn.colorbar(image, ax=axes, label="induction $B$ (mT)", pad=0.01)
        axes.streamplot(
            x, z, np.nan_to_num(Bx), np.nan_to_num(Bz), color="#404040", linewidth=0.6,
            arrowsize=0.6, density=1.1,
        )  # fmt: skip
    for left, low, wide, high in needed(result, "winding"):
        axes.add_patch(
            Rectangle((1e3 * left, 1e3 * low), 1e3 * wide, 1e3 * high, facecolor=_WINDING,
                      edgecolor="black", linewidth=0.8, zorder=3)
        )  # fmt: skip
    axes.plot(1e3 * result["x"].values, 1e3 * result["surface"].values, color=RED, linewidth=1.1)
    axes.axhline(0, color="black", linewidth=1)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(z[0], z[-1])
    axes.grid(visible=False)
    axes.set_ylabel("height $z$ (mm)")


def _surface(drawn: Figure, axes: Axes, result: Result) -> None:
    """Draw the pressure in the fluid below its surface."""
    x = np.broadcast_to(1e3 * result["inside_x"].values, result["inside_z"].values.shape)
    image = axes.pcolormesh(
        x, 1e3 * result["inside_z"].values, result["inside_pressure"].values, cmap="viridis",
        shading="gouraud",
    )  # fmt: skip
    drawn.colorbar(image, ax=axes, label=label("pressure $p$", result["inside_pressure"].unit),
                   pad=0.01)  # fmt: skip
    axes.plot(1e3 * result["x"].values, 1e3 * result["surface"].values, color=RED)
    axes.set_ylim(0, 1.1e3 * result["surface"].values.max())
    axes.set_ylabel("height $z$ (mm)")


def membrane(result: Result) -> Figure:
    """Plot strain over loss of fluid for all thicknesses, and remaining pressure over thickness.

    The front is dashed beyond a limit.
    """
    drawn = sheet(7.1, 3.2, 5.4)
    left, right = drawn.subplots(*((2, 1) if narrow() else (1, 2)))
    loss, strain = (100 * result[f"front_{name}"].values for name in ("loss", "strain"))
    thickness = 1e3 * result["front_thickness"].values
    within = result["front_within"].values == 1
    best = 1e3 * needed(result, "thickness_best")
    for axes, x, y in (
        (left, loss, strain),
        (right, thickness, result["front_contact_pressure"].values),
    ):
        axes.plot(x, y, color=GREY, linewidth=1, linestyle=DASHES[1], label="beyond a limit")
        axes.plot(x, np.where(within, y, np.nan), color=LINKS[0], linewidth=1.8, label="allowed")
    left.plot(
        100 * needed(result, "loss_share"), 100 * needed(result, "strain"), "o", color=RED,
        zorder=3, label=f"best: {best:.3g} mm",
    )  # fmt: skip
    right.plot(best, needed(result, "contact_pressure"), "o", color=RED, zorder=3)
    left.axvline(100 * needed(result, "loss_max"), color=RED, linewidth=0.8, linestyle=LIMIT,
                 label="limits")  # fmt: skip
    left.axhline(100 * needed(result, "strain_max"), color=RED, linewidth=0.8, linestyle=LIMIT)
    left.set_xscale("log")
    left.set_yscale("log")
    left.set_xlabel("fluid lost within the lifetime (%)")
    left.set_ylabel("strain by the pressure (%)")
    right.set_xscale("log")
    right.set_xlabel("thickness $h_m$ (mm)")
    right.set_ylabel(label("remaining pressure\non the ground", "Pa"))
    right.axhline(0, color="black", linewidth=0.8)
    legend_below(drawn)
    limited = str(needed(result, "limited_by")).replace("_", " ")
    tell(drawn, f"limited by {limited}", fact(result, "stress", unit="kPa"),
         fact(result, "bending_stiffness"))  # fmt: skip
    return drawn


# -- materials -------------------------------------------------------------------------------------


def stress_strain(result: Result) -> Figure:
    """Plot stress over strain (%), with field and without: figure 12 of Zimmermann et al. 2007.

    Strains that are no longer small are shaded.
    """
    drawn = sheet(7.1, 4.2, 3.2)
    axes = drawn.subplots()
    percent = 100 * result["strain"].values
    field = needed(result, "field")
    for name, colour, dashes, text in (
        ("stress_without_field", GREY, DASHES[1], "without field, slope $3\\eta$"),
        (
            "stress_with_field",
            LINKS[0],
            "-",
            rf"$H$ = {number(field)} A m$^{{-1}}$, slope $E_{{eff}}$",
        ),
    ):
        axes.plot(percent, result[name].values, color=colour, linestyle=dashes, label=text)
    _mark(axes, result, percent)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.margins(x=0)
    axes.set_xlabel("strain $u$ (%)")
    axes.set_ylabel(label("stress $p$", result["stress_with_field"].unit))
    tell(
        drawn,
        fact(result, "permeability"),
        fact(result, "lame_eta", r"Lamé coefficient $\eta$", "kPa"),
        fact(result, "stiffness", "stiffness of the bar"),
    )
    legend_below(drawn)
    return drawn


def _mark(axes: Axes, result: Result, percent: np.ndarray) -> None:
    """Mark u0 and the range beyond small strains."""
    u0, small = 100 * needed(result, "u0"), 100 * needed(result, "small_strain")
    if percent[0] <= u0 <= percent[-1] and u0:
        axes.plot(u0, 0.0, marker="o", color=LINKS[0], clip_on=False, zorder=3)
        axes.annotate(
            f"$u_0$ = {number(u0, 3)} %", (u0, 0.0), (5, -11), textcoords="offset points",
            color=LINKS[0],
        )  # fmt: skip
    beyond = [(small, percent[-1]), (percent[0], -small)]
    for index, (start, end) in enumerate(span for span in beyond if span[0] < span[1]):
        start, end = max(start, percent[0]), min(end, percent[-1])
        text = "" if index else "beyond small strains"
        axes.axvspan(start, end, color=GLIDE, zorder=0, label=text or None)
