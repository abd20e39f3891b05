"""Makes gaits from the shapes that scenes name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wormopt.errors import SceneError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.study.scene import Scene
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait, travelling_sine
from wormopt.systems.spiked.files import load_gait
from wormopt.systems.spiked.shapes import (
    BlockWaveShape,
    FastShape,
    FileShape,
    Shape,
    SineShape,
)


def gait_of_shape(shape: Shape, scene: Scene[Any], key: str = "gait") -> Gait:
    """Make the gait that a scene names; `key` is the key path of the shape.

    Paths are relative to the scene's folder. Raises SceneError if the gait's file cannot be used.
    """
    links = scene.table.worm.links
    if isinstance(shape, FastShape):
        return fast_gait(shape.period, shape.rest_length, shape.elongation)
    if isinstance(shape, FileShape):
        return _from_file(shape, scene, key)
    if isinstance(shape, SineShape):
        return travelling_sine(links, shape.period, shape.rest_length, shape.amplitude, shape.lag)
    length, ramp = (shape.length[0], shape.length[1]), shape.ramp or 0.0
    if isinstance(shape, BlockWaveShape):
        return block_wave(links, shape.resting, shape.period, length, shape.profile, ramp)
    return accordion(links, shape.period, length, shape.profile, ramp)


def _from_file(shape: FileShape, scene: Scene[Any], key: str) -> Gait:
    path = scene.folder / Path(shape.file)
    try:
        gait = load_gait(path, shape.point, scene.table.units)
    except UnknownNameError as error:
        raise SceneError(scene.name, [(f"{key}.point", f"{shape.file}: {error}")]) from None
    except (OSError, ValueError) as error:
        said = str(error)
        named = said if said.startswith(path.name) else f"{shape.file}: {said}"
        raise SceneError(scene.name, [(f"{key}.file", named)]) from None
    if gait.links != scene.table.worm.links:
        message = (
            f"the file has {gait.links} links, the worm {scene.table.worm.links}; set worm.links = "
            f"{gait.links}"
        )
        raise SceneError(scene.name, [(f"{key}.file", message)])
    return gait if shape.period is None else gait.with_period(shape.period)
