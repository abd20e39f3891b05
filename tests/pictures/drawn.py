"""A result for each picture, and what a picture shows where."""

import dataclasses
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from hints import Patch
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from places import SAVED

import wormopt as wo
from wormopt.kinds import KINDS
from wormopt.pictures import figure
from wormopt.result import Result

# Packaged scenes whose results are drawn, by picture; those saved are made by results/make.py.
SI = 'units="SI"'

QUICK = ('search.effort="quick"', "search.sequence=[[0],[1],[2]]", "search.workers=1")


def two_trackers(end: float, links: int = 2) -> tuple[str, ...]:
    """`track_sine` with so many links."""
    places = [2.0 * (links - i) for i in range(links + 1)]
    changes = (f"worm.links={links}", f"start.position={places}", "tolerance.recheck=false")
    return ("track_sine", SI, *changes, f"time.end={end}", "time.samples=41")


SCENES: dict[str, tuple[str, ...]] = {
    "limits": ("design_fast_gait",),
    "front": ("pareto_speed_load",),
    "certificate": ("certified_gait",),
    "trackers": two_trackers(2.0),
    "bode": ("linear_chain",),
    "poles": ("linear_chain",),
    "margins": ("linear_chain",),
    "predictive": ("track_predictive",),
    "estimates": ("track_predictive",),
    "readings": ("tracker_readings",),
    "bands": ("random_links",),
    "signals": ("own_model", SI, "time.end=3.0"),
    "comparison": ("compare_tracking",),
    "draws": ("compare_tracking",),
    "convergence": ("optimal_crawl",),
    "waveform": ("pair_waveform_design",),
    "drag_gait": ("peristaltic_drag",),
    "body": ("peristaltic_switching",),
    "switching": ("peristaltic_switching",),
    "stress_strain": ("fig12_stress_strain",),
    "velocity": ("fig13_magnetic_pair",),
    "resonance": ("resonance_curve",),
    "coil_pressure": ("fig25_coil_pressure",),
    "membrane": ("membrane",),
    "segment": ("peristaltic_segment",),
    "stroke": ("peristaltic_segment", "samples=21"),
    "worm": ("peristaltic_tube",),
    "course": ("peristaltic_tube",),
    "steps": ("prototype_steps",),
    "channel_velocity": ("fig19_channel_worm",),
    "segment_shapes": ("segment_shapes",),
    "coil_film": ("fig24_travelling_wave",),
    "cargo": ("coil_cargo",),
    "carried": ("body_in_film",),
    "floats": ("fig27_float", "time.periods=3.0"),
    "travelling_field": ("travelling_field",),
    "coil_design": ("coil_cargo_design",),
    "row_currents": ("coil_row_inverse",),
    "reversals": ("three_masses_harmonic",),
    "film": ("fig15_film_flow",),
    "ride": ("fig27_float", "film.delta=0.65", "floats.length=[0.0,0.5]", "tracers.height=[0.5]"),
    "film_wave": ("film_wave_design",),
    "forward": ("film_forward",),
    "basins": ("film_basins",),
    "rod_motion": ("fig21_rod_motion",),
    "peristalsis": ("peristaltic_design", "worm.segments=3", "limits.reserve=1.0"),
    "swim": ("planar_purcell",),
    "heights": ("planar_purcell",),
    "serpenoid": ("planar_serpenoid", SI, "waves=[]"),
    "plane": ("planar_chain",),
    "forces": ("planar_chain",),
    "block": ("planar_block",),
    "planar_gait": ("planar_gait_design",),
    "crawl": ("planar_three_link",),
    "turning": ("planar_turn_in_place",),
    "path": ("planar_path",),
    "rod_frequency": ("fig22_frequency_response",),
    "region": ("gait_region",),
    "recordings": ("fit_chain",),
    "correlation": ("fit_chain",),
    "prediction": ("fit_chain",),
    "parameters": ("fit_pair",),
    "profiles": ("fit_pair",),
    "measurements": ("fit_channel_worm",),
    "errors": ("experiment_chain",),
    "regions": ("experiment_chain",),
    "loads": ("fit_then_design",),
    "holding": ("friction_gait",),
    "shift": ("gait_shift",),
    "transitions": ("gait_shift",),
}


PICTURES = sorted({picture for kind in KINDS.values() for picture in kind.pictures})


@cache
def real(name: str, *changes: str) -> Result:
    """Result of a packaged scene: saved where that takes long, computed once otherwise."""
    saved = SAVED / f"{name}.nc"
    if saved.exists() and not changes:
        return Result.load(saved)
    return wo.run(wo.load_scene(name, changes))


def sample(picture: str) -> Result:
    return real(*SCENES.get(picture, ("fast_gait", SI)))


def without(result: Result, *beginnings: str) -> Result:
    """A result that lacks the variables whose names begin so."""
    kept = tuple(v for v in result.variables if not v.name.startswith(beginnings))
    return dataclasses.replace(result, variables=kept)


@cache
def standard(picture: str) -> Figure:
    """A picture as wide as a column, where there is least room, to be looked at only."""
    return figure(sample(picture), picture, width=85)


def composed(picture: str) -> Figure:
    """As `standard`, but without title and breaks of lines, which take longest.

    Those of readings stand side by side only on a page.
    """
    width = None if picture == "readings" else 85
    with Patch.context() as patch:
        patch.setattr("wormopt.pictures._fit", lambda drawn: None)
        return figure(sample(picture), picture, width=width, title=False)


class Box(NamedTuple):
    """What is written, or a legend or panel; whose it is; size in points; corners in pixels."""

    what: str | Legend | Axes
    owner: Any
    size: float
    corners: np.ndarray


def boxes(drawn: Figure) -> list[Box]:
    """All texts that are seen."""
    canvas = FigureCanvasAgg(drawn)
    drawn.draw_without_rendering()
    renderer, hidden = canvas.get_renderer(), set(_ticks_outside(drawn))
    return [
        Box(text.get_text(), text.axes, float(text.get_fontsize()),
            text.get_window_extent(renderer).get_points())
        for text in drawn.findobj(Text)
        if isinstance(text, Text) and text.get_visible() and text.get_text().strip()
        and text not in hidden
    ]  # fmt: skip


def _ticks_outside(drawn: Figure) -> Iterator[Text]:
    """Labels of ticks that are not seen."""
    for axis in (a for axes in drawn.axes for a in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        slack = 1e-9 * (high - low)
        for minor in (False, True):
            ticks = axis.get_minor_ticks() if minor else axis.get_major_ticks()
            for at, tick in zip(axis.get_ticklocs(minor=minor), ticks, strict=False):
                yield tick.label2
                if not low - slack <= at <= high + slack:
                    yield tick.label1


def areas(drawn: Figure) -> tuple[list[Box], list[Box]]:
    """Panels and legends of a picture that has been laid out."""
    panels = [axes for axes in drawn.axes if axes.get_visible() and axes.axison]
    own = [(legend, axes) for axes in panels if (legend := axes.get_legend())]
    legends = [*((legend, None) for legend in drawn.legends), *own]
    return (
        [Box(axes, axes, 0.0, axes.get_window_extent().get_points()) for axes in panels],
        [Box(legend, axes, 0.0, legend.get_window_extent().get_points())
         for legend, axes in legends],
    )  # fmt: skip


def overlap(a: Box, b: Box) -> float:
    """By how many pixels two boxes cover each other; below 0 they are apart."""
    common = np.minimum(a.corners[1], b.corners[1]) - np.maximum(a.corners[0], b.corners[0])
    return float(common.min())
