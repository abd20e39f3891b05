"""Scenes of kind ``coil-row``: the field of a row of coils that are switched in turn."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.travelling import (
    MovingProfile,
    harmonic_shares,
    moving_profile,
    switched_course,
)
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.coils.runs.coil_parts import (
    ACCEPTED,
    coil_scalars,
    interior,
    recheck,
    row_of,
    warnings_of_coils,
)
from wormopt.systems.coils.scenes.coil_row import CoilRowScene

_PER_PITCH, _PHASES_PER_STEP, _MOST_PHASES = 16, 16, 1024
_WAVELENGTH_POINTS = 256
_CHECKED = 3


def run(scene: Scene[CoilRowScene], report: Report) -> Result:
    """Field along the row over time, and how evenly it travels.

    Status "failed" where the field found by quadrature is another one.
    """
    table = scene.table
    row = row_of(table.coils)
    course, wavelength, amount = _course(table)
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
    check = _second(row, course, table)
    fault = "" if check["error"] <= ACCEPTED else _fault(check["error"])
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if fault else "ok",
        reason=fault,
        scalars=_scalars(table, field, profile, shares, wavelength, amount),
        variables=tuple(_variables(row, x, course, field, profile)),
        trust={"recheck": check, "warnings": [*_warnings(table, amount, shares)]},
        timings_s={"field": done - begin, "recheck": time.perf_counter() - done},
        scene_text=scene.text,
    )


def _course(table: CoilRowScene) -> tuple[Gait, float, float]:
    """Currents, wavelength, ampere-turns of a coil that is on."""
    coils, switching = table.coils, table.switching
    given = switching.ampere_turns
    amount = coils.ampere_turns if given is None else given
    course = switched_course(
        coils.count, amount, switching.rate, on=switching.on, every=switching.every
    )
    return course, course.pieces * coils.pitch, amount


def _shares(row: CoilRow, course: Gait, wavelength: float, z: float, on: int) -> np.ndarray:
    """Harmonics of H along one wavelength about the middle, a block being there."""
    middle = (row.count - 1) // 2
    step = (middle - (on - 1) // 2) % course.pieces
    centre = row.pitch * (middle + (0.5 if on % 2 == 0 else 0.0))
    points = np.arange(_WAVELENGTH_POINTS) / _WAVELENGTH_POINTS - 0.5
    currents = course.on_piece(step, np.zeros(1))
    return harmonic_shares(np.sqrt(row.square(centre + wavelength * points, z, currents)[:, 0]))


def _second(row: CoilRow, course: Gait, table: CoilRowScene) -> dict[str, Any]:
    """Compare the field with that by quadrature, at points that are nothing special."""
    share = (np.arange(_CHECKED) * 0.6180339887) % 1.0
    x = row.pitch * (row.count - 1) * share
    currents = course(course.period * (share[::-1] + 0.01))
    return recheck(row, x, table.line.height, currents)


def _fault(error: float) -> str:
    return (
        f"the field found by quadrature differs by {error:.2g} of the largest, where "
        f"{ACCEPTED:g} is accepted; the line is too near to a winding"
    )


def _scalars(
    table: CoilRowScene,
    field: np.ndarray,
    profile: MovingProfile,
    shares: np.ndarray,
    wavelength: float,
    amount: float,
) -> dict[str, Scalar]:
    rate = table.switching.rate
    found = {
        "field_max": (float(field.max()), "magnetic_field"),
        "wave_speed": (table.coils.pitch * rate, "speed"),
        "wavelength": (wavelength, "length"),
        "frequency": (table.coils.pitch * rate / wavelength, "rate"),
        "first_harmonic_share": (shares[0], "share"),
        "harmonic_shares": (shares, "share"),
        "ripple": (profile.ripple, "share"),
        "currents_max": (amount, "ampere_turns"),
    }
    own = {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}
    return own | coil_scalars(table.coils, table.line)


def _variables(
    row: CoilRow, x: np.ndarray, course: Gait, field: np.ndarray, profile: MovingProfile
) -> Iterator[Variable]:
    metre, second, ampere = (unit_of(kind, "SI") for kind in ("length", "time", "ampere_turns"))
    strength, square = unit_of("magnetic_field", "SI"), unit_of("magnetic_field_squared", "SI")
    steps = (course.breaks[:-1] + course.breaks[1:]) / 2
    yield Variable("place", metre, ("place",), x, "place along the row")
    yield Variable("time", second, ("time",), steps, "middle of each step of switching")
    yield Variable("field", strength, ("time", "place"), field, "field H")
    yield Variable("coil_place", metre, ("coil",), row.places, "place of the coil")
    yield Variable("current", ampere, ("coil", "time"), course(steps), "ampere-turns")
    yield Variable("phase", "rad", ("phase",), profile.xi, "phase of the wave")
    for name, values in (
        ("square_mean", profile.mean),
        ("square_low", profile.square.min(axis=0)),
        ("square_high", profile.square.max(axis=0)),
    ):
        yield Variable(name, square, ("phase",), values, f"H² in the frame of the wave, {name[7:]}")


def _warnings(table: CoilRowScene, amount: float, shares: np.ndarray) -> Iterator[str]:
    yield from warnings_of_coils(table.coils, amount)
    if not shares.any():
        yield "the field does not vary along the row: there is no wave"
