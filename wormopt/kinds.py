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
    "optimal-crawl": Kind(
        summary="optimise the inputs of a chain that crawls on dry friction: fastest or cheapest",
        table="wormopt.systems.chain.scenes.optimal_crawl:OptimalCrawlScene",
        study="wormopt.systems.chain.runs.optimal_crawl",
        pictures=_drawn("chain.plots.optimum", "signals", "convergence"),
        wanted=("convergence",),
    ),
    "film-wave": Kind(
        summary="optimise the wave of a magnetic fluid film: largest transport or least field",
        table="wormopt.systems.film.scenes.film_wave:FilmWaveScene",
        study="wormopt.systems.film.runs.film_wave",
        pictures=_drawn("film.plots.film", "film_wave"),
    ),
    "film-forward": Kind(
        summary="compute the wave of a magnetic fluid film under a given field, and its stability",
        table="wormopt.systems.film.scenes.film_forward:FilmForwardScene",
        study="wormopt.systems.film.runs.film_forward",
        pictures=_drawn("film.plots.thin_film", "forward", "basins"),
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
        | _drawn("spiked.pictures", "gait", "motion", "spikes"),
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
