"""Registry of scene kinds: which table a kind is read into and which study computes it.

Modules are named as text and loaded on use, so that reading or checking a scene loads no
numerics and running one loads those of its own kind only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Kind:
    """One kind of scene.

    Parameters
    ----------
    summary : str
        What a scene of this kind computes, in one line.
    table : str
        "module:Class" of the typed table its scenes are read into.
    study : str
        Module whose ``run(scene, report)`` computes the Result.
    pictures : tuple of str
        The words of ``want`` that stand for a picture.
    table_file : bool
        Whether its results have a table of their own, in a file to read.
    exports : mapping of str to str
        Further files that are saved with a result: name, and the "module:function" that makes
        its text of the result, or None where the result did not come so far.
    """

    summary: str
    table: str
    study: str
    pictures: tuple[str, ...]
    table_file: bool = False
    exports: Mapping[str, str] = field(default_factory=dict)

    def load_table(self) -> Any:
        """Load the class that scenes of this kind are read into."""
        module, name = self.table.split(":")
        return getattr(import_module(module), name)

    def load_study(self) -> Any:
        """Load the module that computes scenes of this kind."""
        return import_module(self.study)

    def load_exports(self) -> dict[str, Callable[[Any], str | None]]:
        """Load the functions that make the texts of further files."""
        parts = {name: text.split(":") for name, text in self.exports.items()}
        return {name: getattr(import_module(m), f) for name, (m, f) in parts.items()}


KINDS: dict[str, Kind] = {
    "gait": Kind(
        summary="what a given gait does: speed, resting masses, spike loads, forces, energy",
        table="wormopt.scenes.gait:GaitScene",
        study="wormopt.studies.gait",
        pictures=("gait", "motion", "spikes", "animation"),
    ),
    "gait-design": Kind(
        summary="the best gait within limits on links, spikes and actuators",
        table="wormopt.scenes.gait_design:GaitDesignScene",
        study="wormopt.studies.gait_design",
        pictures=("gait", "motion", "spikes", "limits", "certificate", "animation"),
    ),
    "gait-pareto": Kind(
        summary="front of the best gaits between speed and a second objective",
        table="wormopt.scenes.gait_pareto:GaitParetoScene",
        study="wormopt.studies.gait_pareto",
        pictures=("front", "gait", "motion", "spikes"),
    ),
    "stepper": Kind(
        summary="a gait as commands for stepping motors, and how the worm moves by them",
        table="wormopt.scenes.stepper:StepperScene",
        study="wormopt.studies.stepper",
        pictures=("steps",),
        exports={
            "steps.csv": "wormopt.studies.step_files:as_csv",
            "steps.c": "wormopt.studies.step_files:as_c",
        },
    ),
    "track": Kind(
        summary="a chain whose links follow a gait by adaptive trackers, under friction",
        table="wormopt.scenes.track:TrackScene",
        study="wormopt.studies.track",
        pictures=("trackers", "motion", "bands"),
    ),
    "track-optimal": Kind(
        summary="a chain whose links follow a gait by the best input, replayed by the simulator",
        table="wormopt.scenes.track_optimal:TrackOptimalScene",
        study="wormopt.studies.track_optimal",
        pictures=("trackers", "motion"),
    ),
    "compare-tracking": Kind(
        summary="trackers, LQR and optimal inputs side by side, also on plants not as believed",
        table="wormopt.scenes.compare_tracking:CompareScene",
        study="wormopt.studies.compare_tracking",
        pictures=("comparison", "draws"),
        table_file=True,
    ),
    "simulate": Kind(
        summary="a chain with given inputs, or a model of your own, moving in time",
        table="wormopt.scenes.simulate:SimulateScene",
        study="wormopt.studies.simulate",
        pictures=("motion", "signals"),
    ),
    "optimal-crawl": Kind(
        summary="the inputs by which a chain crawls fastest or cheapest under dry friction",
        table="wormopt.scenes.optimal_crawl:OptimalCrawlScene",
        study="wormopt.studies.optimal_crawl",
        pictures=("signals", "convergence"),
    ),
    "slide": Kind(
        summary="a block on dry ground that goes somewhere in the shortest time, or least effort",
        table="wormopt.scenes.slide:SlideScene",
        study="wormopt.studies.slide",
        pictures=("signals",),
    ),
    "two-mass": Kind(
        summary="two masses on rough ground, slow stroke and fast return, best ratio of masses",
        table="wormopt.scenes.internal_mass:TwoMassScene",
        study="wormopt.studies.two_mass",
        pictures=("signals",),
    ),
    "capsule": Kind(
        summary="a capsule driven by a mass that jumps to and fro inside, fastest cycle",
        table="wormopt.scenes.internal_mass:CapsuleScene",
        study="wormopt.studies.capsule",
        pictures=("signals",),
    ),
    "pair-waveform": Kind(
        summary="the periodic field that moves a magneto-elastic pair fastest, or cheapest",
        table="wormopt.scenes.pair_waveform:PairWaveformScene",
        study="wormopt.studies.pair_waveform",
        pictures=("waveform",),
    ),
    "harmonic-masses": Kind(
        summary="masses that swing about their centre as prescribed: their speed, averaged, exact",
        table="wormopt.scenes.harmonic_masses:HarmonicMassesScene",
        study="wormopt.studies.harmonic_masses",
        pictures=("reversals",),
    ),
    "material": Kind(
        summary="an elastic composite in a magnetic field: strain, modulus, and which one it is",
        table="wormopt.scenes.material:MaterialScene",
        study="wormopt.studies.material",
        pictures=("stress_strain",),
    ),
    "magnetic-pair": Kind(
        summary="two masses on a magneto-elastic link in a pulsating field, exactly and averaged",
        table="wormopt.scenes.magnetic_pair:MagneticPairScene",
        study="wormopt.studies.magnetic_pair",
        pictures=("velocity",),
    ),
    "resonance": Kind(
        summary="steady motions of the magneto-elastic pair along the frequency of its field",
        table="wormopt.scenes.magnetic_pair:ResonanceScene",
        study="wormopt.studies.resonance",
        pictures=("resonance",),
    ),
    "film-flow": Kind(
        summary="a film of magnetic fluid under a wave: its mean flow, and the field it takes",
        table="wormopt.scenes.film:FilmFlowScene",
        study="wormopt.studies.film_flow",
        pictures=("film",),
    ),
    "float": Kind(
        summary="what the wave on a film carries: floats on the surface, points of the fluid",
        table="wormopt.scenes.film:FloatScene",
        study="wormopt.studies.float",
        pictures=("ride",),
    ),
    "film-wave": Kind(
        summary="the wave of a film of magnetic fluid that carries most, or needs the least field",
        table="wormopt.scenes.film_wave:FilmWaveScene",
        study="wormopt.studies.film_wave",
        pictures=("film_wave",),
    ),
    "coil-row": Kind(
        summary="the travelling magnetic field of a row of coils that are switched in turn",
        table="wormopt.scenes.coil_row:CoilRowScene",
        study="wormopt.studies.coil_row",
        pictures=("travelling_field",),
    ),
    "coil-inverse": Kind(
        summary="currents of a row of coils whose field comes nearest to what a film's wave needs",
        table="wormopt.scenes.coil_inverse:CoilInverseScene",
        study="wormopt.studies.coil_inverse",
        pictures=("row_currents",),
    ),
    "film-forward": Kind(
        summary="which wave a film of magnetic fluid takes under a given field, and its stability",
        table="wormopt.scenes.film_forward:FilmForwardScene",
        study="wormopt.studies.film_forward",
        pictures=("forward", "basins"),
    ),
    "coil-pressure": Kind(
        summary="surface and pressure of a layer of magnetic fluid at an excited coil",
        table="wormopt.scenes.coil_pressure:CoilPressureScene",
        study="wormopt.studies.coil_pressure",
        pictures=("coil_pressure",),
    ),
    "membrane": Kind(
        summary="the thickness of a membrane between strain and loss of fluid, and the front",
        table="wormopt.scenes.membrane:MembraneScene",
        study="wormopt.studies.membrane",
        pictures=("membrane",),
    ),
    "rod-frequency": Kind(
        summary="how fast a magnetisable rod crawls over the frequency of its coils, and why",
        table="wormopt.scenes.rod_frequency:RodFrequencyScene",
        study="wormopt.studies.rod_frequency",
        pictures=("rod_frequency",),
    ),
    "rod-motion": Kind(
        summary="a magnetisable rod between walls, moved by coils switched in turn: how it crawls",
        table="wormopt.scenes.rod_motion:RodMotionScene",
        study="wormopt.studies.rod_motion",
        pictures=("rod_motion", "animation"),
    ),
    "channel-worm": Kind(
        summary="a magnetisable body in a channel: its velocity over the frequency of the coils",
        table="wormopt.scenes.channel:ChannelWormScene",
        study="wormopt.studies.channel_worm",
        pictures=("channel_velocity",),
    ),
    "segment-shapes": Kind(
        summary="a segment of that body between two coils: assumed shapes and the exact elastica",
        table="wormopt.scenes.channel:SegmentShapesScene",
        study="wormopt.studies.segment_shapes",
        pictures=("segment_shapes",),
    ),
}
