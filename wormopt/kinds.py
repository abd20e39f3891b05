"""Registry of scene kinds."""

from __future__ import annotations

import re
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from wormopt.kind import Kind, StudyKind

_SYSTEMS = Path(__file__).parent / "systems"
_STUDY = re.compile(r'^class (\w+)\([^)]*\bkind="([\w-]+)"[^)]*\):\n    """(.+)$', re.MULTILINE)


def _drawn(module: str, *names: str) -> dict[str, str]:
    """Map names of pictures to the functions of these names in a module of `wormopt.systems`."""
    return {name: f"wormopt.systems.{module}:{name}" for name in names}


def studies_in(systems: Path) -> Iterator[tuple[str, StudyKind]]:
    """Yield kinds by name: classes in a folder of systems that say theirs, without importing it."""
    for path in sorted(systems.glob("*/*.py")):
        for name, kind, first in _STUDY.findall(path.read_text(encoding="utf-8")):
            module = f"wormopt.systems.{path.parent.name}.{path.stem}"
            summary = f"{first[0].lower()}{first[1:]}".strip('."')
            yield kind, StudyKind(summary, f"{module}:{name}")


KINDS: dict[str, Kind | StudyKind] = {
    "gait": Kind(
        summary="simulate a given gait: speed, anchored masses, spike loads, forces, energy",
        table="wormopt.systems.spiked.scenes.gait:GaitScene",
        study="wormopt.systems.spiked.runs.gait",
        pictures=_drawn("spiked.plots.gaits", "gait", "motion", "spikes")
        | _drawn("spiked.plots.region", "region")
        | {"animation": "wormopt.systems.spiked.plots.animation:first_frame"},
        wanted=("gait", "motion", "spikes", "region", "animation"),
    ),
    "gait-design": Kind(
        summary="design the fastest gait within limits on links, spikes and actuators",
        table="wormopt.systems.spiked.scenes.gait_design:GaitDesignScene",
        study="wormopt.systems.spiked.runs.gait_design",
        pictures=_drawn("spiked.plots.gaits", "gait", "motion", "spikes", "limits")
        | _drawn("spiked.plots.certificate", "certificate")
        | {"animation": "wormopt.systems.spiked.plots.animation:first_frame"},
        wanted=("limits",),
        exports={"certificate.json": "wormopt.systems.spiked.runs.gait_design:as_json"},
    ),
    "gait-pareto": Kind(
        summary="compute the Pareto front of gaits between speed and a second objective",
        table="wormopt.systems.spiked.scenes.gait_design:GaitParetoScene",
        study="wormopt.systems.spiked.runs.gait_pareto",
        pictures=_drawn("spiked.plots.front", "front", "gait", "motion", "spikes"),
        table_file=True,
    ),
    "gait-shift": Kind(
        summary="switch gaits on a slope by the spike load, and optimise the switching schedule",
        table="wormopt.systems.gears.scenes:GaitShiftScene",
        study="wormopt.systems.gears.run",
        pictures=_drawn("gears.plot", "shift", "transitions"),
    ),
    "stepper": Kind(
        summary="convert a gait into stepping-motor commands and simulate the resulting motion",
        table="wormopt.systems.spiked.scenes.stepper:StepperScene",
        study="wormopt.systems.spiked.runs.stepper",
        pictures=_drawn("spiked.plots.stepper", "steps"),
        exports={
            "steps.csv": "wormopt.systems.spiked.runs.stepper:as_csv",
            "steps.c": "wormopt.systems.spiked.runs.stepper:as_c",
        },
    ),
    "track": Kind(
        summary="track a gait with adaptive controllers on a chain with friction",
        table="wormopt.systems.chain.scenes.track:TrackScene",
        study="wormopt.systems.chain.runs.track",
        pictures=_drawn("chain.plots.simulation", "trackers", "motion", "bands"),
    ),
    "linear": Kind(
        summary="analyse a chain with a tracker: poles, zeros, margins, sufficient gains",
        table="wormopt.systems.chain.scenes.linear:LinearScene",
        study="wormopt.systems.chain.runs.linear",
        pictures={"bode": "wormopt.systems.chain.plots.linear:response"}
        | _drawn("chain.plots.linear", "poles", "margins"),
    ),
    "tracker-readings": Kind(
        summary="compare interpretations of the tracker example of Zimmermann et al. 2007",
        table="wormopt.systems.chain.scenes.readings:ReadingsScene",
        study="wormopt.systems.chain.runs.readings",
        pictures=_drawn("chain.plots.readings", "readings")
        | _drawn("chain.plots.simulation", "trackers"),
        table_file=True,
        exports={"readings.csv": "wormopt.systems.chain.runs.readings:as_csv"},
    ),
    "track-optimal": Kind(
        summary="compute the optimal input that keeps a chain on a gait, checked by simulation",
        table="wormopt.systems.chain.scenes.track_optimal:TrackOptimalScene",
        study="wormopt.systems.chain.runs.track_optimal",
        pictures=_drawn("chain.plots.simulation", "trackers", "motion"),
    ),
    "track-predictive": Kind(
        summary="track a gait by model predictive control, with measured computing times",
        table="wormopt.systems.chain.scenes.track_predictive:TrackPredictiveScene",
        study="wormopt.systems.chain.runs.track_predictive",
        pictures=_drawn("chain.plots.predictive", "predictive", "estimates"),
        table_file=True,
    ),
    "compare-tracking": Kind(
        summary="compare adaptive trackers, LQR and optimal inputs, also with model errors",
        table="wormopt.systems.chain.scenes.compare_tracking:CompareScene",
        study="wormopt.systems.chain.runs.compare_tracking",
        pictures=_drawn("chain.plots.comparison", "comparison", "draws"),
        table_file=True,
    ),
    "simulate": Kind(
        summary="simulate a chain with given inputs, or a model of your own",
        table="wormopt.systems.chain.scenes.simulate:SimulateScene",
        study="wormopt.systems.chain.runs.simulate",
        pictures=_drawn("chain.plots.simulation", "motion", "signals"),
    ),
    "optimal-crawl": Kind(
        summary="optimise the inputs of a chain that crawls on dry friction: fastest or cheapest",
        table="wormopt.systems.chain.scenes.optimal_crawl:OptimalCrawlScene",
        study="wormopt.systems.chain.runs.optimal_crawl",
        pictures=_drawn("chain.plots.optimum", "signals", "convergence"),
        wanted=("convergence",),
    ),
    "two-mass": Kind(
        summary="optimise two masses on rough ground: slow stroke, fast return, best mass ratio",
        table="wormopt.systems.swinging.scenes.internal_mass:TwoMassScene",
        study="wormopt.systems.swinging.runs.internal_mass",
        pictures=_drawn("chain.plots.optimum", "signals"),
    ),
    "capsule": Kind(
        summary="optimise the cycle of a capsule driven by an internal mass",
        table="wormopt.systems.swinging.scenes.internal_mass:CapsuleScene",
        study="wormopt.systems.swinging.runs.internal_mass",
        pictures=_drawn("chain.plots.optimum", "signals"),
    ),
    "pair-waveform": Kind(
        summary="optimise the periodic field that drives a magneto-elastic pair",
        table="wormopt.systems.pair.scenes.pair_waveform:PairWaveformScene",
        study="wormopt.systems.pair.runs.pair_waveform",
        pictures=_drawn("pair.pictures", "waveform"),
    ),
    "harmonic-masses": Kind(
        summary="compute the speed of masses with prescribed oscillations, averaged and exact",
        table="wormopt.systems.swinging.scenes.harmonic_masses:HarmonicMassesScene",
        study="wormopt.systems.swinging.runs.harmonic_masses",
        pictures=_drawn("pair.plots.averaging", "reversals"),
    ),
    "magnetic-pair": Kind(
        summary="simulate two masses on a magneto-elastic link in a pulsating field",
        table="wormopt.systems.pair.scenes.magnetic_pair:MagneticPairScene",
        study="wormopt.systems.pair.runs.magnetic_pair",
        pictures=_drawn("pair.pictures", "velocity"),
    ),
    "film-flow": Kind(
        summary="compute the mean flow of a magnetic fluid film under a wave, and its field",
        table="wormopt.systems.film.scenes.film:FilmFlowScene",
        study="wormopt.systems.film.runs.film_flow",
        pictures=_drawn("film.plots.film", "film"),
    ),
    "float": Kind(
        summary="compute the drift of floats and fluid particles on a film with a travelling wave",
        table="wormopt.systems.film.scenes.film:FloatScene",
        study="wormopt.systems.film.runs.float",
        pictures=_drawn("film.plots.film", "ride") | _drawn("film.plots.body", "floats"),
    ),
    "film-body": Kind(
        summary="simulate a body with mass in a film with a wave: floating or on the ground",
        table="wormopt.systems.film.scenes.film_body:FilmBodyScene",
        study="wormopt.systems.film.runs.film_body",
        pictures=_drawn("film.plots.body", "carried"),
    ),
    "film-wave": Kind(
        summary="optimise the wave of a magnetic fluid film: largest transport or least field",
        table="wormopt.systems.film.scenes.film_wave:FilmWaveScene",
        study="wormopt.systems.film.runs.film_wave",
        pictures=_drawn("film.plots.film", "film_wave"),
    ),
    "planar-design": Kind(
        summary="design a planar gait: fastest, turning, or cheapest to a pose",
        table="wormopt.systems.planar.scenes.design:PlanarDesignScene",
        study="wormopt.systems.planar.runs.design",
        pictures=_drawn("planar.plots.design", "planar_gait")
        | {"animation": "wormopt.systems.planar.plots.design:first_frame"},
    ),
    "planar-motion": Kind(
        summary="simulate a planar chain of masses and springs with bending joints",
        table="wormopt.systems.planar.scenes.motion:PlanarMotionScene",
        study="wormopt.systems.planar.runs.motion",
        pictures=_drawn("planar.plots.plane", "plane", "forces")
        | {"animation": "wormopt.systems.planar.plots.bodies:first_frame"},
    ),
    "planar-path": Kind(
        summary="plan a path to a pose past obstacles from the steps of a few gaits",
        table="wormopt.systems.planar.scenes.path:PlanarPathScene",
        study="wormopt.systems.planar.runs.path",
        pictures=_drawn("planar.plots.path", "path")
        | {"animation": "wormopt.systems.planar.plots.path:first_frame"},
    ),
    "film-forward": Kind(
        summary="compute the wave of a magnetic fluid film under a given field, and its stability",
        table="wormopt.systems.film.scenes.film_forward:FilmForwardScene",
        study="wormopt.systems.film.runs.film_forward",
        pictures=_drawn("film.plots.thin_film", "forward", "basins"),
    ),
    "coil-pressure": Kind(
        summary="compute the surface and pressure of a magnetic fluid layer at an excited coil",
        table="wormopt.systems.coils.scenes.hydrostatics:CoilPressureScene",
        study="wormopt.systems.coils.runs.coil_pressure",
        pictures=_drawn("coils.plots.hydrostatics", "coil_pressure"),
    ),
    "membrane": Kind(
        summary="choose the thickness of a membrane: strain against loss of fluid, Pareto front",
        table="wormopt.systems.coils.scenes.hydrostatics:MembraneScene",
        study="wormopt.systems.coils.runs.membrane",
        pictures=_drawn("coils.plots.hydrostatics", "membrane"),
    ),
    "rod-frequency": Kind(
        summary="compute the velocity of a magnetisable rod over the frequency of its coils",
        table="wormopt.systems.channel.scenes.rod_frequency:RodFrequencyScene",
        study="wormopt.systems.channel.runs.rod_frequency",
        pictures=_drawn("channel.plots.rod", "rod_frequency"),
    ),
    "rod-motion": Kind(
        summary="simulate a magnetisable rod between walls, driven by coils switched in turn",
        table="wormopt.systems.channel.scenes.rod:RodMotionScene",
        study="wormopt.systems.channel.runs.rod_motion",
        pictures=_drawn("channel.plots.rod", "rod_motion")
        | {"animation": "wormopt.systems.channel.plots.rod:first_frame"},
    ),
    "channel-worm": Kind(
        summary="compute the velocity of a magnetisable body in a channel over the coil frequency",
        table="wormopt.systems.channel.scenes.channel:ChannelWormScene",
        study="wormopt.systems.channel.runs.channel_worm",
        pictures=_drawn("channel.plots.channel", "channel_velocity"),
    ),
    "fit": Kind(
        summary="estimate parameters from recordings of a motion, with confidence intervals",
        table="wormopt.systems.recorded.scenes.fit:FitScene",
        study="wormopt.systems.recorded.runs.fit",
        pictures=_drawn("recorded.plots.fit", "recordings")
        | _drawn("recorded.plots.found", "parameters", "correlation")
        | _drawn("recorded.plots.fit", "profiles", "prediction"),
        table_file=True,
    ),
    "experiment": Kind(
        summary="plan the experiment that identifies the parameters of a worm best",
        table="wormopt.systems.recorded.scenes.experiment:ExperimentScene",
        study="wormopt.systems.recorded.runs.experiment",
        pictures=_drawn("recorded.plots.experiment", "course", "errors", "regions"),
        exports={"course.csv": "wormopt.systems.recorded.runs.experiment:as_csv"},
    ),
    "fit-design": Kind(
        summary="design a gait whose limits hold for a worm with fitted parameters",
        table="wormopt.systems.recorded.scenes.fit_design:FitDesignScene",
        study="wormopt.systems.recorded.runs.fit_design",
        pictures=_drawn("recorded.plots.fit_design", "forces", "loads")
        | _drawn("spiked.plots.gaits", "gait", "motion", "spikes"),
    ),
    "segment-shapes": Kind(
        summary="compare assumed shapes of a segment between two coils with the exact elastica",
        table="wormopt.systems.channel.scenes.channel:SegmentShapesScene",
        study="wormopt.systems.channel.runs.segment_shapes",
        pictures=_drawn("channel.plots.channel", "segment_shapes"),
    ),
} | dict(studies_in(_SYSTEMS))

GROUPS: dict[str, tuple[str, ...]] = {
    "Spiked worms and gaits": ("gait", "gait-design", "gait-pareto", "gait-shift", "stepper"),
    "Chains and control": (
        "simulate", "optimal-crawl", "track", "track-optimal", "track-predictive",
        "compare-tracking", "linear", "tracker-readings",
    ),
    "Magnetic pairs and materials": ("magnetic-pair", "resonance", "pair-waveform", "material"),
    "Magnetic films": ("film-flow", "film-forward", "film-wave", "float", "film-body"),
    "Coils": (
        "coil-row", "coil-film", "coil-design", "coil-inverse", "coil-pressure", "membrane",
    ),
    "Peristaltic worms": (
        "peristaltic-worm", "peristaltic-design", "peristaltic-drag", "peristaltic-segment",
        "peristaltic-switching",
    ),
    "Channels and rods": ("channel-worm", "rod-motion", "rod-frequency", "segment-shapes"),
    "Planar robots": (
        "planar-crawl", "planar-swim", "planar-motion", "planar-design", "planar-turn",
        "planar-path", "planar-serpenoid", "planar-block",
    ),
    "Recordings and fits": ("fit", "fit-numbers", "fit-design", "experiment"),
    "Small problems": ("slide", "two-mass", "capsule", "harmonic-masses"),
}  # fmt: skip
"""Titles of systems, and the kinds of scene of each."""

SWEEP = Kind(
    summary="compute a scene at many values of some of its keys",
    table="wormopt.study.swept:Swept",
    study="wormopt.sweeps.sweep",
    pictures={"sweep": "wormopt.sweeps.plots:sweep"},
    exports={"points.csv": "wormopt.sweeps.gathered:as_csv"},
)
"""Kind of the results of sweeps. It is not in `KINDS`, because any scene can be swept."""


def kind_of(result: Any) -> Kind | StudyKind | None:
    """Return the kind of a Result, or None if it is not registered."""
    return SWEEP if result.kind == "sweep" else KINDS.get(result.kind)


def near(name: str) -> str:
    """Return the kind whose name is closest to an unknown name, or "" if none is close."""
    return next(iter(get_close_matches(name, KINDS, n=1)), "")
