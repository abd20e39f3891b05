"""What a user asks for, read into typed tables, and the studies that compute it."""

from wormopt.study.scene import Scene, load_scene, packaged_scenes
from wormopt.study.types import SceneTable

__all__ = ["Scene", "SceneTable", "load_scene", "packaged_scenes"]
