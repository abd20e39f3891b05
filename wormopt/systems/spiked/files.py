"""Reads gaits from files: tables and saved Results."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError, SceneError, UnknownNameError
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.study.scene import Scene
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait, travelling_sine
from wormopt.systems.spiked.shapes import (
    BlockWaveShape,
    FastShape,
    FileShape,
    Shape,
    SineShape,
)
from wormopt.tables import SUFFIXES

_DIMS = {
    "breaks": ("gait_break",),
    "polynomial": ("gait_piece", "link", "gait_power"),
    "omega": ("gait_piece",),
    "cosine": ("gait_piece", "link"),
    "sine": ("gait_piece", "link"),
}


def gait_of_result(result: Result, point: int | None = None) -> Gait:
    """Read the gait of a Result, or of a point of a front; ArgumentError if there is none."""
    if point is not None:
        return _gait_of_point(result, point)
    if "gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no gait")
    return Gait(**{k: result[f"gait_{k}"].values for k in _DIMS if f"gait_{k}" in result})


def _gait_of_point(result: Result, point: int) -> Gait:
    if "front_gait_polynomial" not in result:
        raise ArgumentError(f"the result of scene {result.scene!r} contains no front; omit point")
    breaks, pieces = (result[f"front_gait_{name}"].values for name in ("breaks", "polynomial"))
    if point not in range(len(breaks)):
        where = f"the front of scene {result.scene!r}"
        raise UnknownNameError(where, "point", [point], map(str, range(len(breaks))))
    own = breaks[point][np.isfinite(breaks[point])]
    return Gait(own, pieces[point][: len(own) - 1])


def load_gait(
    path: str | Path,
    point: int | None = None,
    units: Literal["dimensionless", "SI"] | None = None,
) -> Gait:
    """Load a gait from a table (t, l_0, l_1, ...) or from a saved Result.

    Parameters
    ----------
    path : str or Path
        A text file (``.csv``, ``.txt``, ``.tsv``, ``.dat``), a ``result.nc``, or a result's folder.
    point : int, optional
        Point of a front (kind ``gait-pareto``), numbered from 0, the slowest. The default is its
        knee.
    units : {"dimensionless", "SI"}, optional
        Units of the returned gait: lengths in m and times in s, or no units. By default, a table
        is converted to SI, and a result keeps its units.

    Returns
    -------
    Gait
        Link lengths over one closed period.

    Raises
    ------
    OSError
        If the file cannot be read.
    ArgumentError
        If it contains no gait, has no such point, or has other units.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import wormopt as wo
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "gait.csv"
    ...     wo.fast_gait(1.0).to_csv(path)
    ...     gait = wo.load_gait(path, units="dimensionless")
    >>> gait.links, gait.period
    (2, 1.0)
    """
    path = Path(path)
    if path.suffix.lower() in SUFFIXES:
        if point is not None:
            raise ArgumentError("point is given, but a gait table contains one gait; omit point")
        return Gait.from_csv(path, units=units or "SI")
    result = Result.load(path)
    gait = gait_of_result(result, point)
    unit = result["gait_polynomial"].unit if "gait_polynomial" in result else "1"
    if units == "SI" and unit not in ("1", "m"):
        raise ArgumentError(f"the gait is in {unit}, not in m; name a result with link lengths")
    if units == "dimensionless" and unit != "1":
        what = f'the gait is in {unit}, but units are dimensionless; write units = "SI"'
        raise ArgumentError(f"{what}, or write a table without units")
    return gait


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
        message = str(error)
        named = message if message.startswith(path.name) else f"{shape.file}: {message}"
        raise SceneError(scene.name, [(f"{key}.file", named)]) from None
    if gait.links != scene.table.worm.links:
        message = (
            f"the file has {gait.links} links, the worm {scene.table.worm.links}; set worm.links = "
            f"{gait.links}"
        )
        raise SceneError(scene.name, [(f"{key}.file", message)])
    return gait if shape.period is None else gait.with_period(shape.period)
