"""Runs of kind ``coil-row``: the field of a row of coils that are switched in turn.

Also functions shared with kind ``coil-inverse``.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.magnetics.coils import Coil, CoilRow, field_by_quadrature
from wormopt.magnetics.travelling import (
    MovingProfile,
    harmonic_shares,
    moving_profile,
    switched_course,
)
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.scenes.coil_rows import CoilRowScene, CoilsTable, LineTable, RowScene

ACCEPTED = 1e-8
"""Accepted relative difference of fields by formula and by quadrature."""
# Current density that copper carries for long without cooling, in A/m².
_DENSITY = 5e6
_PER_PITCH, _PHASES_PER_STEP, _MOST_PHASES = 16, 16, 1024
_WAVELENGTH_POINTS = 256
_CHECKED = 3


def run(scene: Scene[CoilRowScene], report: Report) -> Result:
    """Return the field along the row over time, and how uniformly it travels.

    Status "failed" if quadrature finds another field.
    """
    table = scene.table
    row, course, amount = row_of(table.coils), _course(table), _ampere_turns(table)
    wavelength = course.pieces * row.pitch
    z, begin = table.line.height, time.perf_counter()
    report("field along the row", None)
    x = row.pitch * np.linspace(-1, row.count, _PER_PITCH * (row.count + 1) + 1)
    steps = (course.breaks[:-1] + course.breaks[1:]) / 2
    field = np.sqrt(row.square(x, z, course(steps))).T
    report("frame of the wave", 0.5)
    profile = moving_profile(
        row,
        course,
        interior(row, table.line, _PER_PITCH),
        z,
        wavelength=wavelength,
        period=course.period,
        phases=min(_PHASES_PER_STEP * course.pieces, _MOST_PHASES),
    )
    shares = _shares(row, course, wavelength, z, table.switching.on)
    done = time.perf_counter()
    report("second route", 0.8)
    error = _error(row, course, z)
    speed = table.coils.pitch * table.switching.rate
    return conclude(
        scene,
        {
            "field_max": float(field.max()),
            "wave_speed": speed,
            "wavelength": wavelength,
            "frequency": speed / wavelength,
            "first_harmonic_share": shares[0],
            "harmonic_shares": shares,
            "ripple": profile.ripple,
            "currents_max": amount,
        }
        | sizes(table),
        {
            "place": x,
            "time": steps,
            "field": field,
            "coil_place": row.places,
            "current": course(steps),
        }
        | in_the_frame(profile),
        checks=[
            Check(
                "field by quadrature",
                error,
                ACCEPTED,
                f"the field by quadrature differs by {error:.2g} of the largest; {ACCEPTED:g} is "
                "accepted; write a line farther from the windings",
            )
        ],
        facts={"recheck": {"error": error, "accepted": ACCEPTED, "points": _CHECKED}},
        warnings=_warnings(table, amount, shares),
        timings={"field": done - begin, "recheck": time.perf_counter() - done},
    )


def row_of(table: CoilsTable) -> CoilRow:
    """Return the row of a scene."""
    coil = Coil(table.inner, table.outer, table.length, table.ampere_turns)
    return CoilRow(coil, table.count, table.pitch, table.axis, table.gap)


def interior(row: CoilRow, line: LineTable, per_pitch: int) -> np.ndarray:
    """Return positions along the row, in m, far from its ends and evenly over whole pitches.

    There is one position more than `per_pitch` gives, so that no two have the same place relative
    to their nearest coil, and all together are evenly spaced over a pitch too.
    """
    pitches = row.count - 1 - 2 * line.margin
    count = pitches * per_pitch + 1
    return row.pitch * (line.margin + pitches * (np.arange(count) + 0.5) / count)


def sizes(table: RowScene) -> dict[str, Any]:
    """Return scalars: sizes of the row, most of them assumptions of the scene."""
    coils = table.coils
    section = coils.length * (coils.outer - coils.inner)
    return {
        "coils": coils.count,
        "pitch": coils.pitch,
        "coil_inner": coils.inner,
        "coil_outer": coils.outer,
        "coil_length": coils.length,
        "coil_gap": coils.gap,
        "line_height": table.line.height,
        "currents_limit": coils.ampere_turns,
        "current_density_limit": coils.ampere_turns / section,
    }


def in_the_frame(profile: MovingProfile) -> dict[str, np.ndarray]:
    """Return arrays of H² over the phase of the wave."""
    return {
        "phase": profile.xi,
        "square_mean": profile.mean,
        "square_low": profile.square.min(axis=0),
        "square_high": profile.square.max(axis=0),
    }


def warnings_of_coils(table: CoilsTable, largest: float) -> Iterator[str]:
    """Yield warnings about effects the formulas neglect at `largest` ampere-turns."""
    density = largest / (table.length * (table.outer - table.inner))
    if density > _DENSITY:
        yield (
            f"{density / 1e6:.3g} A/mm² over the whole section of the winding; without cooling "
            f"copper carries about {_DENSITY / 1e6:g} for long"
        )


def _ampere_turns(table: CoilRowScene) -> float:
    """Return the ampere-turns of an active coil."""
    given = table.switching.ampere_turns
    return table.coils.ampere_turns if given is None else given


def _course(table: CoilRowScene) -> Gait:
    switching = table.switching
    return switched_course(
        table.coils.count,
        _ampere_turns(table),
        switching.rate,
        on=switching.on,
        every=switching.every,
    )


def _shares(row: CoilRow, course: Gait, wavelength: float, z: float, on: int) -> np.ndarray:
    """Return harmonics of H along one wavelength about the middle, with a block there."""
    middle = (row.count - 1) // 2
    step = (middle - (on - 1) // 2) % course.pieces
    centre = row.pitch * (middle + (0.5 if on % 2 == 0 else 0.0))
    points = np.arange(_WAVELENGTH_POINTS) / _WAVELENGTH_POINTS - 0.5
    currents = course.on_piece(step, np.zeros(1))
    return harmonic_shares(np.sqrt(row.square(centre + wavelength * points, z, currents)[:, 0]))


def _error(row: CoilRow, course: Gait, z: float) -> float:
    """Return the largest difference of the field to that by quadrature, over the largest field.

    The points are arbitrary.
    """
    share = (np.arange(_CHECKED) * 0.6180339887) % 1.0
    x = row.pitch * (row.count - 1) * share
    currents = course(course.period * (share[::-1] + 0.01))
    formula = np.einsum("cmk,km->cm", row.influence(x, z), currents)
    second = field_by_quadrature(row, x, z, currents)
    largest = float(np.max(np.abs(second), initial=0.0))
    return float(np.max(np.abs(formula - second))) / largest if largest else 0.0


def _warnings(table: CoilRowScene, amount: float, shares: np.ndarray) -> Iterator[str]:
    yield from warnings_of_coils(table.coils, amount)
    if not shares.any():
        yield "the field does not vary along the row: there is no wave"
