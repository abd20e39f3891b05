"""Scenes: TOML files read into frozen typed tables. Data only, nothing is computed here."""

from wormopt.scene.scene import Scene, load_scene, packaged_scenes
from wormopt.scene.types import SceneTable

__all__ = ["Scene", "SceneTable", "load_scene", "packaged_scenes"]
