"""Plots of magnetic fluids at rest, and of their membranes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from wormopt.plotting.parts import (
    DASHES,
    GREY,
    LIMIT,
    LINKS,
    RED,
    fact,
    label,
    legend_below,
    line,
    narrow,
    needed,
    sheet,
    tell,
)
from wormopt.result import Result

_WINDING = "#D9A066"


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
