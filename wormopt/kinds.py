"""Registry of scene kinds."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from wormopt.kind import Kind


def _drawn(module: str, *names: str) -> dict[str, str]:
    """Pictures that functions of one module below `wormopt.systems` draw, words as their names."""
    return {name: f"wormopt.systems.{module}:{name}" for name in names}


KINDS: dict[str, Kind] = {
    "gait": Kind(
        summary="what a given gait does: speed, resting masses, spike loads, forces, energy",
        table="wormopt.systems.spiked.scenes.gait:GaitScene",
        study="wormopt.systems.spiked.runs.gait",
        pictures=_drawn("spiked.plots.gaits", "gait", "motion", "spikes")
        | _drawn("spiked.plots.region", "region")
        | {"animation": "wormopt.systems.spiked.plots.animation:first_frame"},
        wanted=("gait", "motion", "spikes", "region", "animation"),
    ),
    "gait-design": Kind(
        summary="the best gait within limits on links, spikes and actuators",
        table="wormopt.systems.spiked.scenes.gait_design:GaitDesignScene",
        study="wormopt.systems.spiked.runs.gait_design",
        pictures=_drawn("spiked.plots.gaits", "gait", "motion", "spikes", "limits")
        | _drawn("spiked.plots.certificate", "certificate")
        | {"animation": "wormopt.systems.spiked.plots.animation:first_frame"},
        wanted=("limits",),
        exports={"certificate.json": "wormopt.systems.spiked.runs.gait_design:as_json"},
    ),
    "gait-pareto": Kind(
        summary="front of the best gaits between speed and a second objective",
        table="wormopt.systems.spiked.scenes.gait_design:GaitParetoScene",
        study="wormopt.systems.spiked.runs.gait_pareto",
        pictures=_drawn("spiked.plots.front", "front", "gait", "motion", "spikes"),
        table_file=True,
    ),
    "gait-shift": Kind(
        summary="a worm that shifts gears by its loads on a way that rises, and the best schedule",
        table="wormopt.systems.gears.scenes:GaitShiftScene",
        study="wormopt.systems.gears.run",
        pictures=_drawn("gears.plot", "shift", "transitions"),
    ),
    "stepper": Kind(
        summary="a gait as commands for stepping motors, and how the worm moves by them",
        table="wormopt.systems.spiked.scenes.stepper:StepperScene",
        study="wormopt.systems.spiked.runs.stepper",
        pictures=_drawn("spiked.plots.stepper", "steps"),
        exports={
            "steps.csv": "wormopt.systems.spiked.runs.stepper:as_csv",
            "steps.c": "wormopt.systems.spiked.runs.stepper:as_c",
        },
    ),
    "track": Kind(
        summary="a chain whose links follow a gait by adaptive trackers, under friction",
        table="wormopt.systems.chain.scenes.track:TrackScene",
        study="wormopt.systems.chain.runs.track",
        pictures=_drawn("chain.plots.simulation", "trackers", "motion", "bands"),
    ),
    "linear": Kind(
        summary="poles, zeros and margins of a chain under a tracker, and the gains that suffice",
        table="wormopt.systems.chain.scenes.linear:LinearScene",
        study="wormopt.systems.chain.runs.linear",
        pictures={"bode": "wormopt.systems.chain.plots.linear:response"}
        | _drawn("chain.plots.linear", "poles", "margins"),
    ),
    "tracker-readings": Kind(
        summary="the chapter's two trackers under every reading of what it leaves open",
        table="wormopt.systems.chain.scenes.readings:ReadingsScene",
        study="wormopt.systems.chain.runs.readings",
        pictures=_drawn("chain.plots.readings", "readings")
        | _drawn("chain.plots.simulation", "trackers"),
        table_file=True,
        exports={"readings.csv": "wormopt.systems.chain.runs.readings:as_csv"},
    ),
    "track-optimal": Kind(
        summary="a chain whose links follow a gait by the best input, replayed by the simulator",
        table="wormopt.systems.chain.scenes.track_optimal:TrackOptimalScene",
        study="wormopt.systems.chain.runs.track_optimal",
        pictures=_drawn("chain.plots.simulation", "trackers", "motion"),
    ),
    "track-predictive": Kind(
        summary="a chain whose links follow a gait by predictive control, decisions timed",
        table="wormopt.systems.chain.scenes.track_predictive:TrackPredictiveScene",
        study="wormopt.systems.chain.runs.track_predictive",
        pictures=_drawn("chain.plots.predictive", "predictive", "estimates"),
        table_file=True,
    ),
    "compare-tracking": Kind(
        summary="trackers, LQR and optimal inputs side by side, also on plants not as believed",
        table="wormopt.systems.chain.scenes.compare_tracking:CompareScene",
        study="wormopt.systems.chain.runs.compare_tracking",
        pictures=_drawn("chain.plots.comparison", "comparison", "draws"),
        table_file=True,
    ),
    "simulate": Kind(
        summary="a chain with given inputs, or a model of your own, moving in time",
        table="wormopt.systems.chain.scenes.simulate:SimulateScene",
        study="wormopt.systems.chain.runs.simulate",
        pictures=_drawn("chain.plots.simulation", "motion", "signals"),
    ),
    "optimal-crawl": Kind(
        summary="the inputs by which a chain crawls fastest or cheapest under dry friction",
        table="wormopt.systems.chain.scenes.optimal_crawl:OptimalCrawlScene",
        study="wormopt.systems.chain.runs.optimal_crawl",
        pictures=_drawn("chain.plots.optimum", "signals", "convergence"),
        wanted=("convergence",),
    ),
    "slide": Kind(
        summary="a block on dry ground that goes somewhere in the shortest time, or least effort",
        table="wormopt.systems.block.scenes:SlideScene",
        study="wormopt.systems.block.run",
        pictures=_drawn("chain.plots.optimum", "signals"),
    ),
    "two-mass": Kind(
        summary="two masses on rough ground, slow stroke and fast return, best ratio of masses",
        table="wormopt.systems.swinging.scenes.internal_mass:TwoMassScene",
        study="wormopt.systems.swinging.runs.internal_mass",
        pictures=_drawn("chain.plots.optimum", "signals"),
    ),
    "capsule": Kind(
        summary="a capsule driven by a mass that jumps to and fro inside, fastest cycle",
        table="wormopt.systems.swinging.scenes.internal_mass:CapsuleScene",
        study="wormopt.systems.swinging.runs.internal_mass",
        pictures=_drawn("chain.plots.optimum", "signals"),
    ),
    "pair-waveform": Kind(
        summary="the periodic field that moves a magneto-elastic pair fastest, or cheapest",
        table="wormopt.systems.pair.scenes.pair_waveform:PairWaveformScene",
        study="wormopt.systems.pair.runs.pair_waveform",
        pictures=_drawn("pair.plots.waveform", "waveform"),
    ),
    "harmonic-masses": Kind(
        summary="masses that swing about their centre as prescribed: their speed, averaged, exact",
        table="wormopt.systems.swinging.scenes.harmonic_masses:HarmonicMassesScene",
        study="wormopt.systems.swinging.runs.harmonic_masses",
        pictures=_drawn("pair.plots.averaging", "reversals"),
    ),
    "material": Kind(
        summary="an elastic composite in a magnetic field: strain, modulus, and which one it is",
        table="wormopt.systems.coils.scenes.material:MaterialScene",
        study="wormopt.systems.coils.runs.material",
        pictures=_drawn("coils.plots.magnetics", "stress_strain"),
    ),
    "magnetic-pair": Kind(
        summary="two masses on a magneto-elastic link in a pulsating field, exactly and averaged",
        table="wormopt.systems.pair.scenes.magnetic_pair:MagneticPairScene",
        study="wormopt.systems.pair.runs.magnetic_pair",
        pictures=_drawn("coils.plots.magnetics", "velocity"),
    ),
    "resonance": Kind(
        summary="steady motions of the magneto-elastic pair along the frequency of its field",
        table="wormopt.systems.pair.scenes.magnetic_pair:ResonanceScene",
        study="wormopt.systems.pair.runs.resonance",
        pictures=_drawn("coils.plots.magnetics", "resonance"),
    ),
    "peristaltic-design": Kind(
        summary="the fastest gait of a peristaltic worm that anchors in a tube, with its bound",
        table="wormopt.systems.peristaltic.scenes.design:PeristalticDesignScene",
        study="wormopt.systems.peristaltic.runs.design",
        pictures=_drawn("peristaltic.plots.anchored", "peristalsis")
        | {"animation": "wormopt.systems.peristaltic.plots.anchored:first_frame"},
    ),
    "film-flow": Kind(
        summary="a film of magnetic fluid under a wave: its mean flow, and the field it takes",
        table="wormopt.systems.film.scenes.film:FilmFlowScene",
        study="wormopt.systems.film.runs.film_flow",
        pictures=_drawn("film.plots.film", "film"),
    ),
    "float": Kind(
        summary="what the wave on a film carries: floats on the surface, points of the fluid",
        table="wormopt.systems.film.scenes.film:FloatScene",
        study="wormopt.systems.film.runs.float",
        pictures=_drawn("film.plots.film", "ride") | _drawn("film.plots.body", "floats"),
    ),
    "film-body": Kind(
        summary="a body with a mass that a given wave carries: on the surface, or on the ground",
        table="wormopt.systems.film.scenes.film_body:FilmBodyScene",
        study="wormopt.systems.film.runs.film_body",
        pictures=_drawn("film.plots.body", "carried"),
    ),
    "film-wave": Kind(
        summary="the wave of a film of magnetic fluid that carries most, or needs the least field",
        table="wormopt.systems.film.scenes.film_wave:FilmWaveScene",
        study="wormopt.systems.film.runs.film_wave",
        pictures=_drawn("film.plots.film", "film_wave"),
    ),
    "peristaltic-drag": Kind(
        summary="the best gait of a peristaltic worm on drag that hangs on length",
        table="wormopt.systems.peristaltic.scenes.drag:PeristalticDragScene",
        study="wormopt.systems.peristaltic.runs.drag",
        pictures=_drawn("peristaltic.plots.drag", "drag_gait")
        | _drawn("peristaltic.plots.body", "body")
        | {"animation": "wormopt.systems.peristaltic.plots.body:first_frame"},
    ),
    "peristaltic-switching": Kind(
        summary="when to switch the coils of a peristaltic worm that are on or off",
        table="wormopt.systems.peristaltic.scenes.switching:PeristalticSwitchingScene",
        study="wormopt.systems.peristaltic.runs.switching",
        pictures=_drawn("peristaltic.plots.switching", "switching")
        | _drawn("peristaltic.plots.body", "body")
        | {"animation": "wormopt.systems.peristaltic.plots.body:first_frame"},
    ),
    "planar-crawl": Kind(
        summary="a stroke of a body that crawls slowly on dry ground: way, turn, work, who rests",
        table="wormopt.systems.planar.scenes.crawl:PlanarCrawlScene",
        study="wormopt.systems.planar.runs.crawl",
        pictures=_drawn("planar.plots.crawl", "crawl", "forces")
        | {"animation": "wormopt.systems.planar.plots.bodies:first_frame"},
    ),
    "planar-turn": Kind(
        summary="a worm of two links turns in place: how fast, and that hardly any is faster",
        table="wormopt.systems.planar.scenes.turn:PlanarTurnScene",
        study="wormopt.systems.planar.runs.turn",
        pictures=_drawn("planar.plots.crawl", "crawl")
        | _drawn("planar.plots.turn", "turning")
        | _drawn("planar.plots.crawl", "forces")
        | {"animation": "wormopt.systems.planar.plots.bodies:first_frame"},
    ),
    "planar-swim": Kind(
        summary="a stroke of a body on viscous ground, given or the best: way, work, heights",
        table="wormopt.systems.planar.scenes.swim:PlanarSwimScene",
        study="wormopt.systems.planar.runs.swim",
        pictures=_drawn("planar.plots.swim", "swim", "heights")
        | {"animation": "wormopt.systems.planar.plots.swim:first_frame"},
    ),
    "planar-design": Kind(
        summary="the best gait of a body in the plane: fastest, turning, or cheapest to a pose",
        table="wormopt.systems.planar.scenes.design:PlanarDesignScene",
        study="wormopt.systems.planar.runs.design",
        pictures=_drawn("planar.plots.design", "planar_gait")
        | {"animation": "wormopt.systems.planar.plots.design:first_frame"},
    ),
    "planar-serpenoid": Kind(
        summary="how fast a serpenoid wave carries a long worm over viscous or dry ground",
        table="wormopt.systems.planar.scenes.serpenoid:PlanarSerpenoidScene",
        study="wormopt.systems.planar.runs.serpenoid",
        pictures=_drawn("planar.plots.serpenoid", "serpenoid"),
    ),
    "planar-motion": Kind(
        summary="a worm of masses and springs in the plane, its joints bend: how it moves",
        table="wormopt.systems.planar.scenes.motion:PlanarMotionScene",
        study="wormopt.systems.planar.runs.motion",
        pictures=_drawn("planar.plots.plane", "plane", "forces")
        | {"animation": "wormopt.systems.planar.plots.bodies:first_frame"},
    ),
    "planar-block": Kind(
        summary="a block that slides on ground that resists each direction differently: its stop",
        table="wormopt.systems.planar.scenes.block:PlanarBlockScene",
        study="wormopt.systems.planar.runs.block",
        pictures=_drawn("planar.plots.block", "block"),
    ),
    "planar-path": Kind(
        summary="a path through the plane to a pose, past obstacles, of steps of a few gaits",
        table="wormopt.systems.planar.scenes.path:PlanarPathScene",
        study="wormopt.systems.planar.runs.path",
        pictures=_drawn("planar.plots.path", "path")
        | {"animation": "wormopt.systems.planar.plots.path:first_frame"},
    ),
    "coil-row": Kind(
        summary="the travelling magnetic field of a row of coils that are switched in turn",
        table="wormopt.systems.coils.scenes.coil_rows:CoilRowScene",
        study="wormopt.systems.coils.runs.coil_row",
        pictures=_drawn("coils.plots.coils", "travelling_field"),
    ),
    "coil-film": Kind(
        summary="a film of magnetic fluid over a row of coils that are switched in turn",
        table="wormopt.systems.coils.scenes.coil_film:CoilFilmScene",
        study="wormopt.systems.coils.runs.coil_film",
        pictures=_drawn("coils.plots.film", "coil_film", "cargo"),
    ),
    "coil-design": Kind(
        summary="currents of a row of coils that carry a float fastest, or with least power",
        table="wormopt.systems.coils.scenes.coil_design:CoilDesignScene",
        study="wormopt.systems.coils.runs.coil_design",
        pictures=_drawn("coils.plots.design", "coil_design"),
    ),
    "coil-inverse": Kind(
        summary="currents of a row of coils whose field comes nearest to what a film's wave needs",
        table="wormopt.systems.coils.scenes.coil_rows:CoilInverseScene",
        study="wormopt.systems.coils.runs.coil_inverse",
        pictures=_drawn("coils.plots.coils", "row_currents"),
    ),
    "film-forward": Kind(
        summary="which wave a film of magnetic fluid takes under a given field, and its stability",
        table="wormopt.systems.film.scenes.film_forward:FilmForwardScene",
        study="wormopt.systems.film.runs.film_forward",
        pictures=_drawn("film.plots.thin_film", "forward", "basins"),
    ),
    "coil-pressure": Kind(
        summary="surface and pressure of a layer of magnetic fluid at an excited coil",
        table="wormopt.systems.coils.scenes.hydrostatics:CoilPressureScene",
        study="wormopt.systems.coils.runs.coil_pressure",
        pictures=_drawn("coils.plots.hydrostatics", "coil_pressure"),
    ),
    "membrane": Kind(
        summary="the thickness of a membrane between strain and loss of fluid, and the front",
        table="wormopt.systems.coils.scenes.hydrostatics:MembraneScene",
        study="wormopt.systems.coils.runs.membrane",
        pictures=_drawn("coils.plots.hydrostatics", "membrane"),
    ),
    "peristaltic-segment": Kind(
        summary="a membrane segment in its coil and tube: strokes, hold on the wall, limits",
        table="wormopt.systems.peristaltic.scenes.segment:SegmentScene",
        study="wormopt.systems.peristaltic.runs.segment",
        pictures=_drawn("peristaltic.plots.segment", "segment", "stroke"),
    ),
    "rod-frequency": Kind(
        summary="how fast a magnetisable rod crawls over the frequency of its coils, and why",
        table="wormopt.systems.channel.scenes.rod_frequency:RodFrequencyScene",
        study="wormopt.systems.channel.runs.rod_frequency",
        pictures=_drawn("channel.plots.rod", "rod_frequency"),
    ),
    "rod-motion": Kind(
        summary="a magnetisable rod between walls, moved by coils switched in turn: how it crawls",
        table="wormopt.systems.channel.scenes.rod:RodMotionScene",
        study="wormopt.systems.channel.runs.rod_motion",
        pictures=_drawn("channel.plots.rod", "rod_motion")
        | {"animation": "wormopt.systems.channel.plots.rod:first_frame"},
    ),
    "peristaltic-worm": Kind(
        summary="a worm of membrane segments with coils, on the ground or in a tube: how it crawls",
        table="wormopt.systems.peristaltic.scenes.worm:PeristalticWormScene",
        study="wormopt.systems.peristaltic.runs.worm",
        pictures=_drawn("peristaltic.plots.worm", "worm", "course")
        | {"animation": "wormopt.systems.peristaltic.plots.worm:first_frame"},
    ),
    "channel-worm": Kind(
        summary="a magnetisable body in a channel: its velocity over the frequency of the coils",
        table="wormopt.systems.channel.scenes.channel:ChannelWormScene",
        study="wormopt.systems.channel.runs.channel_worm",
        pictures=_drawn("channel.plots.channel", "channel_velocity"),
    ),
    "fit": Kind(
        summary="numbers of a worm found from recordings of its motion, and how sure they are",
        table="wormopt.systems.recorded.scenes.fit:FitScene",
        study="wormopt.systems.recorded.runs.fit",
        pictures=_drawn("recorded.plots.fit", "recordings")
        | _drawn("recorded.plots.found", "parameters", "correlation")
        | _drawn("recorded.plots.fit", "profiles", "prediction"),
        table_file=True,
    ),
    "experiment": Kind(
        summary="which run of a worm tells its numbers best, within what it can do",
        table="wormopt.systems.recorded.scenes.experiment:ExperimentScene",
        study="wormopt.systems.recorded.runs.experiment",
        pictures=_drawn("recorded.plots.experiment", "course", "errors", "regions"),
        exports={"course.csv": "wormopt.systems.recorded.runs.experiment:as_csv"},
    ),
    "fit-numbers": Kind(
        summary="keys of a scene found from single numbers measured, velocities over frequency say",
        table="wormopt.systems.recorded.scenes.fit_numbers:FitNumbersScene",
        study="wormopt.systems.recorded.runs.fit_numbers",
        pictures=_drawn("recorded.plots.fit_numbers", "measurements")
        | _drawn("recorded.plots.found", "parameters", "correlation"),
        table_file=True,
    ),
    "fit-design": Kind(
        summary="a gait that keeps its limits for a worm whose numbers were found from recordings",
        table="wormopt.systems.recorded.scenes.fit_design:FitDesignScene",
        study="wormopt.systems.recorded.runs.fit_design",
        pictures=_drawn("recorded.plots.fit_design", "forces", "loads")
        | _drawn("spiked.plots.gaits", "gait", "motion", "spikes"),
    ),
    "segment-shapes": Kind(
        summary="a segment of that body between two coils: assumed shapes and the exact elastica",
        table="wormopt.systems.channel.scenes.channel:SegmentShapesScene",
        study="wormopt.systems.channel.runs.segment_shapes",
        pictures=_drawn("channel.plots.channel", "segment_shapes"),
    ),
}

SWEEP = Kind(
    summary="a scene computed at many values of some of its keys",
    table="wormopt.scene.swept:Swept",
    study="wormopt.sweeps.sweep",
    pictures={"sweep": "wormopt.sweeps.plots:sweep"},
    exports={"points.csv": "wormopt.sweeps.gathered:as_csv"},
)
"""What results of sweeps are; no kind of scene, since any scene can be swept."""


def kind_of(result: Any) -> Kind | None:
    """Kind of a Result, None where it is not registered."""
    return SWEEP if result.kind == "sweep" else KINDS.get(result.kind)


def near(name: str) -> str:
    """Kind that may be meant by a name that is none; "" where none is close."""
    return next(iter(get_close_matches(name, KINDS, n=1)), "")
