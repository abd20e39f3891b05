"""What studies of coils share: the row of a scene, its interior, a second route to its field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.quantities import Scalar, unit_of
from wormopt.systems.coils.scenes.coil_row import CoilsTable, LineTable

ACCEPTED = 1e-8
"""Largest relative difference of fields by formula and by quadrature that is accepted."""
# Angles over half a turn times the clearance over the radius: sums over all of them are then off
# by exp(-2 * 16) or less. The other half of the turn is the same.
_ANGLES, _MOST_ANGLES = 16, 1000
_TOLERANCE = 1e-10
# What copper carries for long without cooling, in A/m².
_DENSITY = 5e6


def row_of(table: CoilsTable) -> CoilRow:
    """Make the row of a scene."""
    coil = Coil(table.inner, table.outer, table.length, table.ampere_turns)
    return CoilRow(coil, table.count, table.pitch, table.axis, table.gap)


def interior(row: CoilRow, line: LineTable, per_pitch: int) -> np.ndarray:
    """Places along the row, in m, far from its ends and evenly over whole pitches.

    One more in all than `per_pitch` gives, so that no two lie alike towards their nearest
    coil and all together are even over a pitch too.
    """
    pitches = row.count - 1 - 2 * line.margin
    count = pitches * per_pitch + 1
    return row.pitch * (line.margin + pitches * (np.arange(count) + 0.5) / count)


def field_by_quadrature(row: CoilRow, x: np.ndarray, z: float, currents: np.ndarray) -> np.ndarray:
    """Field (3, m), in A/m, at points of the line by Biot-Savart, integrated over the windings.

    `currents` (count, m): ampere-turns at each point. No elliptic integral: sums over
    the angle, adaptive quadrature over radius and length.
    """
    from scipy.integrate import quad_vec

    direction = ("along", "across", "vertical").index(row.axis)
    offset = 0.0 if row.gap is None else (row.gap + row.coil.length) / 2
    sides = (0.0,) if row.gap is None else (-offset, offset)
    # points as seen from each coil: shape (3, sides, count, m)
    seen = np.zeros((3, len(sides), row.count, len(x)))
    seen[0] = x - row.places[:, None]
    seen[2] = z
    seen[direction] -= np.array(sides)[:, None, None]
    s = seen[direction][..., None]
    away = np.delete(seen, direction, axis=0)
    rho = np.hypot(*away)[..., None]
    share = float(np.min(row.clearance(x, z))) / row.coil.outer
    count = min(math.ceil(_ANGLES / min(share, 1.0)), _MOST_ANGLES)
    cosine = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    flat = rho * rho
    across = 2 * rho * cosine

    def loop(a: float, place: float) -> np.ndarray:
        rise = s - place
        square = a * a + rise * rise + flat - a * across
        cube = 1 / (square * np.sqrt(square))
        first, second = cube.mean(axis=-1), (cosine * cube).mean(axis=-1)
        return a / 2 * np.stack([a * first - rho[..., 0] * second, rise[..., 0] * second])

    coil = row.coil
    half = coil.length / 2

    def sheet(a: float) -> np.ndarray:
        return quad_vec(lambda p: loop(a, p), -half, half, epsrel=_TOLERANCE, norm="max")[0]

    whole = quad_vec(sheet, coil.inner, coil.outer, epsrel=_TOLERANCE, norm="max")[0]
    axial, radial = whole / (coil.length * (coil.outer - coil.inner))
    outward = np.divide(away, rho[..., 0], out=np.zeros_like(away), where=rho[..., 0] > 0)
    vector = np.insert(outward * radial, direction, axial, axis=0)
    return np.einsum("cskm,km->cm", vector, currents)


def recheck(row: CoilRow, x: np.ndarray, z: float, currents: np.ndarray) -> dict[str, Any]:
    """Compare the field by formula with that of `field_by_quadrature`.

    Returns ``error`` (largest difference over the largest field), ``accepted``, ``points``.
    """
    formula = np.einsum("cmk,km->cm", row.influence(x, z), currents)
    second = field_by_quadrature(row, x, z, currents)
    largest = float(np.max(np.abs(second), initial=0.0))
    error = float(np.max(np.abs(formula - second))) / largest if largest else 0.0
    return {"error": error, "accepted": ACCEPTED, "points": len(x)}


def coil_scalars(table: CoilsTable, line: LineTable) -> dict[str, Scalar]:
    """Sizes of the row, most of them assumptions of the scene."""
    section = table.length * (table.outer - table.inner)
    found: dict[str, tuple[Any, str]] = {
        "coils": (table.count, "count"),
        "pitch": (table.pitch, "length"),
        "coil_inner": (table.inner, "length"),
        "coil_outer": (table.outer, "length"),
        "coil_length": (table.length, "length"),
        "coil_gap": (table.gap, "length"),
        "line_height": (line.height, "length"),
        "currents_limit": (table.ampere_turns, "ampere_turns"),
        "current_density_limit": (table.ampere_turns / section, "current_density"),
    }
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def warnings_of_coils(table: CoilsTable, largest: float) -> Iterator[str]:
    """Yield what the formulas neglect of coils at `largest` ampere-turns."""
    density = largest / (table.length * (table.outer - table.inner))
    if density > _DENSITY:
        yield (
            f"{density / 1e6:.3g} A/mm² over the whole section of the winding; without cooling "
            f"copper carries about {_DENSITY / 1e6:g} for long"
        )
