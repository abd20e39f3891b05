"""Registry of scene kinds: each is one class, found by its `kind` and loaded on use."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

_SYSTEMS = Path(__file__).parent / "systems"
_STUDY = re.compile(r'^class (\w+)\([^)]*\bkind="([\w-]+)"[^)]*\):\n    """(.+)$', re.MULTILINE)


@dataclass(frozen=True)
class Kind:
    """A kind of scene."""

    summary: str  # what such a scene computes, in one line
    name: str  # of the class, a Study
    module: str

    def load(self) -> Any:
        """Load the class; reading or checking a scene loads no numerics with it."""
        return getattr(import_module(self.module), self.name)

    @property
    def pictures(self) -> Mapping[str, str]:
        """Word of ``want``: "module:function" that composes the picture of a result.

        An `Animation` instead of a function composes one that moves.
        """
        return self.load().drawn_by


def studies_in(systems: Path) -> Iterator[tuple[str, Kind]]:
    """Yield kinds by name: classes in a folder of systems with a `kind`, without importing them."""
    for path in sorted(systems.glob("*/*.py")):
        text = path.read_text(encoding="utf-8")
        for name, kind, first in _STUDY.findall(text) if 'kind="' in text else ():
            module = f"wormopt.systems.{path.parent.name}.{path.stem}"
            yield kind, Kind(f"{first[0].lower()}{first[1:]}".strip('."'), name, module)


KINDS = dict(studies_in(_SYSTEMS))

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
    "Recordings and fits": ("fit", "fit-numbers", "fit-design", "friction-design", "experiment"),
    "Small problems": ("slide", "two-mass", "capsule", "harmonic-masses"),
}  # fmt: skip
"""Titles of systems, and the kinds of scene of each."""

SWEEP = Kind("compute a scene at many values of some of its keys", "Swept", "wormopt.study.swept")
"""Kind of the results of sweeps. It is not in `KINDS`, because any scene can be swept."""


def kind_of(result: Any) -> Kind | None:
    """Return the kind of a Result, or None if it is not registered."""
    return SWEEP if result.kind == "sweep" else KINDS.get(result.kind)


def near(name: str) -> str:
    """Return the kind whose name is closest to an unknown name, or "" if none is close."""
    return next(iter(get_close_matches(name, KINDS, n=1)), "")
