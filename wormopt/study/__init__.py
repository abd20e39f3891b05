# pyright: strict
"""Scenes read into typed tables, and the studies that compute them."""

from wormopt.lazy import on_use
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.members import (
    array,
    arrays,
    attributes,
    check,
    checks,
    facts,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.study.scene import Scene, load_scene, packaged_scenes
from wormopt.study.study import Study

__all__ = [
    "Given",
    "Scene",
    "Study",
    "array",
    "arrays",
    "attributes",
    "check",
    "checks",
    "entry",
    "facts",
    "load_scene",
    "number",
    "on_use",
    "packaged_scenes",
    "parts",
    "positive",
    "scalar",
    "scalars",
    "signal",
    "stage",
    "value",
    "warnings",
    "whole",
]
