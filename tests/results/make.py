"""Real results that tests of pictures draw, of packaged scenes that take too long to run for it.

python tests/results/make.py [NAME ...] makes them anew, all or those named; all take two minutes.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import wormopt as wo

HERE = Path(__file__).parent
# Scene: what makes it quicker, and its result smaller.
SCENES = {
    "compare_tracking": [
        'units="SI"', "time.end=3.0", "tube.capture=1.0", "time.samples=101", "mesh.arcs=15",
        "draws.members=6", "draws.known=1", "crawl.arcs=30",
    ],
    "optimal_crawl": ["mesh.arcs=30"],
    "resonance_curve": [
        'pair.friction={kind="stribeck", forward=0.3, backward=0.6, stick_forward=0.9, '
        "stick_backward=1.8, v_stribeck=0.15}",
        "frequencies.detuning=[0.3, 3.0]", "frequencies.points=60",
        "confirm.time=300.0", "confirm.periods=20",
    ],
    "three_masses_harmonic": [
        'units="SI"', 'worm.friction={kind="stribeck", forward=0.001, backward=0.001, '
        "stick_forward=0.03, stick_backward=0.03, v_stribeck=0.8}",
        "start.velocity=0.1", "time.periods=2",
    ],
    "random_links": ['units="SI"', "ensemble.members=5", "time.samples=41", "time.end=3.0"],
    "travelling_field": [],
    "segment_shapes": [],
    "film_forward": ["time.samples=41", "time.periods=20"],
    "film_basins": [
        "film.delta=0.98", "film.tension=1.0", "map.delta=[0.3,0.9,0.98]", "map.tension=[0.1,1.0]",
        "time.samples=41",
    ],
    "film_wave_design": ["map={tension=[0.1,0.02], field=[2.0]}"],
    "fig13_magnetic_pair": ["time.samples=201"],
    "fig24_travelling_wave": ["time.switches=20", "time.samples=2"],
    "coil_cargo": ["time.switches=8", "coils.count=12"],
    "coil_cargo_design": [],
    "coil_row_inverse": [],
    "fig25_coil_pressure": [],
    "pair_waveform_design": [],
    "peristaltic_drag": ['units="SI"', "worm.segments=2"],
    "peristaltic_switching": ['units="SI"', "worm.segments=2"],
    "planar_path": ['units="SI"'],
    "planar_gait_design": ['units="SI"', "search.corners=4"],
    "pareto_speed_load": [
        'units="SI"', 'search.effort="quick"', "search.workers=1",
        "search.sequence=[[0],[2],[1]]", "pareto.points=4",
    ],
    "planar_three_link": ['units="SI"'],
    "linear_chain": [
        'units="SI"', "time.end=2.0", "gains.count=7", "tolerance.recheck=false",
        "tolerance.relative=1e-7",
    ],
    "track_predictive": [
        'units="SI"', "time.end=0.5", "tube.capture=0.1", "time.samples=101", "plants.members=2",
        "predictive.horizon=0.1", "predictive.period=0.02", "estimation.window=0.1",
    ],
    "gait_shift": ['units="SI"', "way.goal=12.0"],
    "gait_region": ['units="SI"'],
    "design_fast_gait": [
        'units="SI"', 'search.effort="quick"', "search.sequence=[[0],[1],[2]]", "search.workers=1",
    ],
    "certified_gait": [
        'units="SI"', 'search.effort="quick"', "search.sequence=[[0],[1],[2]]", "search.workers=1",
        "search.certify.gap=2e-2",
    ],
    "body_in_film": [
        'units="SI"', "time.periods=3.0", "time.samples=301",
        "film.fluid={mu_r=1.05, viscosity=0.02, density=1200.0, surface_tension=0.03, depth=1e-4, "
        "wavelength=0.02, frequency=5.0}",
        'body={on="ground", height=0.3, density=2700.0, friction_coefficient=0.4}',
    ],
    "planar_turn_in_place": ['units="SI"'],
    "planar_purcell": [
        'units="SI"',
        'stroke={course="polygon",corners=[[1.0,1.0],[-1.0,1.0],[-1.0,-1.0],[1.0,-1.0]]}',
    ],
    "planar_chain": ['units="SI"', "time.end=3.0", "time.samples=101"],
    "planar_block": ['units="SI"'],
    "peristaltic_tube": ["time.cycles=2", "time.settle=1"],
    "tracker_readings": [
        'units="SI"', "readings.period=[1]", "readings.growth=[1]", 'readings.signs=["printed"]',
        "readings.rest_length=[0]", "time.samples=41",
    ],
    "fit_chain": [],
    "fit_pair": [],
    "fit_channel_worm": [],
    "experiment_chain": [],
    "fit_then_design": ['units="SI"'],
    "friction_gait": ['search.effort="quick"'],
    "fig21_rod_motion": [],
    "fig22_frequency_response": [
        "frequencies=[5,50,500]", "search.rounds=1", "search.refine=2",
        "sensitivity={factors=[0.5,2.0],frequencies=[20,100]}", "time.cycles=4", "time.end=1.0",
    ],
}  # fmt: skip


def main(names: list[str]) -> None:
    """Run the scenes and keep their results."""
    for name in names:
        with TemporaryDirectory() as folder:
            wo.run(wo.load_scene(name, SCENES[name])).save(folder)
            (HERE / f"{name}.nc").write_bytes((Path(folder) / "result.nc").read_bytes())


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
