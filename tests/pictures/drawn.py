"""A result for each picture."""

import dataclasses
from functools import cache

from places import SAVED

import wormopt as wo
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
    "limits": ("design_fast_gait", SI, *QUICK),
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
    "shift": ("gait_shift",),
    "transitions": ("gait_shift",),
}


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
