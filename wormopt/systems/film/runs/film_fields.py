"""Travelling field of a scene: of a prescribed wave, or given over a wavelength."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.magnetics.pressure import magnetic_pressure
from wormopt.result import Result
from wormopt.study.scene import Scene
from wormopt.systems.film.given_field import GivenField, WaveField
from wormopt.systems.film.scenes.film_forward import FilmForwardScene
from wormopt.systems.film.shapes import Wave, grid
from wormopt.systems.film.units import Fluid
from wormopt.tables import Wrong, read_table
from wormopt.units import parsed, scale

# Units of values in files of SI scenes; a pressure is in multiples of P.
_UNITS = {"pressure": "1", "field_squared": "A2 m-2", "field": "A m-1"}


def field_of_scene(
    scene: Scene[FilmForwardScene], wave: Wave | None, tension: float
) -> WaveField | GivenField:
    """Make the field of a scene: that of the prescribed wave unless another is given.

    Raises SceneError if a file contains no field, or the field is not periodic.
    """
    given = scene.table.field
    if given is None:
        assert wave is not None  # the table ensures it
        return WaveField(wave, tension)
    key = "field.samples" if given.samples is not None else "field.file"
    try:
        values = np.array(given.samples) if given.samples is not None else _read(scene, given)
        field = GivenField(_pressure(values, given, scene.table.film.scales))
        field.slope(scene.table.grid.points)
    except (ArgumentError, ValueError, OSError, KeyError) as error:
        raise SceneError(scene.name, [(key, str(error).strip("'\""))]) from None
    return field


def _pressure(values: np.ndarray, given: Any, fluid: Fluid | None) -> np.ndarray:
    """Samples as (mu - 1) H² / (8 pi) in units of P."""
    if given.quantity == "pressure":
        return values
    if given.quantity == "field_squared" and values.min() < 0:
        raise ArgumentError(f"H² is {values.min():.6g} at its least; write values of 0 or above")
    square = values if given.quantity == "field_squared" else values * values
    if fluid is None:
        return (given.mu_r - 1) * square / (8 * math.pi)
    return np.asarray(magnetic_pressure(fluid.mu_r, np.sqrt(square))) / fluid.pressure


def _read(scene: Scene[FilmForwardScene], given: Any) -> np.ndarray:
    path = scene.folder / given.file
    if given.variable is None:
        return _read_table(path, given.quantity, scene.table.units)
    values = Result.load(path)[given.variable].values
    if values.ndim != 1:
        raise ArgumentError(
            f"{given.variable} has {values.ndim} axes, but a field depends on xi only; write a "
            "variable with one axis"
        )
    return np.asarray(values, dtype=float)


def _read_table(path: Path, quantity: str, units: str) -> np.ndarray:
    """Last column of a table; the first of two columns is the phase."""
    wrong: list[Wrong] = []
    table = read_table(path, wrong, named=False)
    if wrong or table is None:
        raise ArgumentError(f"{path.name}{wrong[0][1]}")
    if table.texts:
        named = ", ".join(sorted(table.texts))
        raise ArgumentError(f"{path.name}: column {named} contains text; write numbers only")
    columns = [np.array(column) for column in table.values.values()]
    if not 1 <= len(columns) <= 2:
        raise ArgumentError(
            f"{path.name} must have one column of values, or two columns xi and values"
        )
    for name, column in zip(table.values, columns, strict=True):
        if not np.isfinite(column).all():
            line = table.lines[int(np.flatnonzero(~np.isfinite(column))[0])]
            raise ArgumentError(f"{path.name} line {line}, column {name}: a number is missing")
    if len(columns) == 2:
        wanted = grid(len(columns[0]))
        if np.abs(columns[0] - wanted).max() > 1e-6 * 2 * math.pi:
            raise ArgumentError(
                f"the phases in {path.name} must be 2 pi k / {len(columns[0])} for k = 0, 1, ...: "
                "one wavelength without its end"
            )
    name = list(table.values)[-1]
    return columns[-1] * _size(table.units.get(name, "1"), quantity, units, path.name)


def _size(unit: str, quantity: str, units: str, file: str) -> float:
    """Factor of values in a unit."""
    if unit == "1":
        return 1.0
    wanted = _UNITS[quantity] if units == "SI" else "1"
    try:
        (size, dimension), (one, needed) = scale(unit), parsed(wanted)
    except ValueError as error:
        raise ArgumentError(f'{file}: "{unit}" {error}; write {wanted}') from None
    if dimension != needed:
        raise ArgumentError(f'{file}: "{unit}" is not a unit of {quantity} here; write {wanted}')
    return float(size / one)
