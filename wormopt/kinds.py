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


KINDS: dict[str, Kind | StudyKind] = {} | dict(studies_in(_SYSTEMS))

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
