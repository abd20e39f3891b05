"""Numbers and maps of a fluid at rest at a coil, for its Result."""

from __future__ import annotations

from typing import Any

import numpy as np

from wormopt.magnetics.material import MU0
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.systems.coils.runs.coil_forces import Rested, field_of_pressure
from wormopt.systems.coils.scenes.coil_pressure import CoilPressureScene

_ALONG, _DEEP, _WIDE, _HIGH = 401, 13, 97, 61


def scalars_of(
    rested: Rested, table: CoilPressureScene, trust: dict[str, Any]
) -> dict[str, Scalar]:
    """Scalars of the result; `trust` is from `checks_of`."""
    x, thickness = _places(rested), table.layer.thickness
    h, bottom = rested.surface(x), rested.pressure(x, np.zeros_like(x))
    below, above = (np.hypot(*rested.field(x, z)) for z in (np.zeros_like(x), h))
    change = float(np.max(bottom)) - rested.fluid.weight * thickness
    ratio = np.asarray(rested.fluid.magnetisation.ratio(below**2))
    found: dict[str, tuple[Any, str]] = {
        "ampere_turns": (rested.current, "current"),
        "pressure_max": (np.max(bottom), "stress"),
        "pressure_change_max": (change, "stress"),
        "pressure_without_field": (rested.fluid.weight * thickness, "stress"),
        "surface_rise_max": (np.max(h) - thickness, "length"),
        "surface_drop_max": (thickness - np.min(h), "length"),
        "slope_max": (np.max(np.abs(rested.surface(x, 1))), "share"),
        "field_bottom_max": (np.max(below), "magnetic_field"),
        "field_surface_max": (np.max(above), "magnetic_field"),
        "induction_bottom_max": (np.max(MU0 * (1 + ratio) * below), "induction"),
        "magnetic_force": (rested.force, "force_per_length"),
        "capillary_length": (rested.fluid.capillary_length, "length"),
        "volume_error": (trust["volume_error"], "share"),
        "demagnetisation": (trust["demagnetisation"], "share"),
        "stated_pressure": (table.stated_pressure, "stress"),
    }
    if table.stated_pressure is not None:
        needed = field_of_pressure(rested.fluid, table.stated_pressure)
        found["pressure_over_stated"] = (change / table.stated_pressure, "share")
        found["field_for_stated"] = (needed, "magnetic_field")
        found["induction_for_stated"] = (MU0 * needed, "induction")
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def variables_of(rested: Rested, table: CoilPressureScene) -> tuple[Variable, ...]:
    """Variables of the result: along the bottom, in the fluid, and around the coil."""
    x = _places(rested)
    h, flat = rested.surface(x), np.zeros_like(x)
    along = {
        "x": (x, "length", "place along the bottom"),
        "surface": (h, "length", "height of the surface"),
        "pressure": (rested.pressure(x, flat), "stress", "pressure on the bottom"),
        "field_bottom": (np.hypot(*rested.field(x, flat)), "magnetic_field", "H at the bottom"),
        "field_surface": (np.hypot(*rested.field(x, h)), "magnetic_field", "H at the surface"),
    }
    found = [
        Variable(n, unit_of(kind, "SI"), ("x",), v, text) for n, (v, kind, text) in along.items()
    ]
    path = rested.settled.path
    branch = {
        "branch_current": (
            path[:, 0] * table.coil.ampere_turns,
            "current",
            "current of the branch",
        ),
        "branch_highest": (path[:, 2], "length", "highest point of the surface"),
        "branch_lowest": (path[:, 1], "length", "lowest point of the surface"),
    }
    found += [
        Variable(n, unit_of(kind, "SI"), ("branch",), v, text)
        for n, (v, kind, text) in branch.items()
    ]
    return (*found, *_inside(rested, x[:: _ALONG // 100]), *_around(rested))


def _places(rested: Rested) -> np.ndarray:
    return np.linspace(*rested.settled.equations.profile.ends, _ALONG)


def _inside(rested: Rested, x: np.ndarray) -> tuple[Variable, ...]:
    """Pressure in the fluid at equal shares of its height."""
    share = np.linspace(0, 1, _DEEP)
    z = share[:, None] * rested.surface(x)
    p = rested.pressure(np.broadcast_to(x, z.shape), z)
    dims, pascal = ("share", "inside_x"), unit_of("stress", "SI")
    metre = unit_of("length", "SI")
    return (
        Variable("share", "1", ("share",), share, "height over that of the surface"),
        Variable("inside_x", metre, ("inside_x",), x, "place along the bottom"),
        Variable("inside_z", metre, dims, z, "height"),
        Variable("inside_pressure", pascal, dims, p, "pressure in the fluid"),
    )


def _around(rested: Rested) -> tuple[Variable, ...]:
    """Induction on a grid that holds coil and fluid; not a number in the winding."""
    placed, coil = rested.placed, rested.placed.coil
    size = coil.length / 2 if placed.axis == "vertical" else coil.outer
    left, right = rested.settled.equations.profile.ends
    top = float(np.max(rested.surface(_places(rested))))
    ends = (placed.middle - 1.2 * size, placed.middle + 1.2 * size)
    x = np.linspace(left, right, _WIDE)
    z = np.linspace(min(0.0, ends[0]), max(1.5 * top, ends[1]), _HIGH)
    X, Z = np.meshgrid(x, z)
    free = placed.clearance(X, Z) > 1e-3 * coil.outer
    B = np.full((2, *X.shape), np.nan)
    H = np.array(rested.field(X[free], Z[free]))
    wet = (Z[free] >= 0) & (Z[free] <= rested.surface(X[free]))
    ratio = np.asarray(rested.fluid.magnetisation.ratio(np.sum(H**2, axis=0)))
    B[:, free] = MU0 * (1 + wet * ratio) * H
    tesla, metre, dims = unit_of("induction", "SI"), unit_of("length", "SI"), ("map_z", "map_x")
    return (
        Variable("map_x", metre, ("map_x",), x, "place along the bottom"),
        Variable("map_z", metre, ("map_z",), z, "height"),
        Variable("induction_x", tesla, dims, B[0], "induction along x"),
        Variable("induction_z", tesla, dims, B[1], "induction along z"),
    )
