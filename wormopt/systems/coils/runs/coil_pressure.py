"""Runs of kind ``coil-pressure``: surface and pressure of a magnetic fluid at a coil."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Decimal, localcontext
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError, interruptible
from wormopt.magnetics.hydrostatics import Fluid, Langevin, Linear, Placed, balance
from wormopt.magnetics.material import MU0
from wormopt.magnetics.winding import Coil
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.profile import Profile, Settled, settle
from wormopt.systems.coils.rested import Rested, field_of_pressure
from wormopt.systems.coils.scenes.hydrostatics import CoilPressureScene

ACCEPTED = {"defect": 1e-4, "volume_error": 1e-9, "force_imbalance": 1e-6, "field_error": 1e-7}
"""Accepted values of the trust report."""
_DEMAGNETISED = 0.1
_STRONG = 10.0  # tesla; above all but the largest laboratory magnets
# The error of the field's quadrature is exp(-2 _DIGITS) of it at the nearest point.
_DIGITS = 10.0
# Share of the gap under a coil above that may be filled; the field is resolved up to it.
_FILLED = 0.75
_UNRESOLVED = 1e-3
# Number of points along the bottom, up the fluid, and of the map around coil and fluid.
_ALONG, _DEEP, _WIDE, _HIGH = 401, 13, 97, 61


@dataclass(frozen=True, eq=False)
class Setup:
    """Objects of a scene."""

    fluid: Fluid
    placed: Placed  # the coil and its place
    profile: Profile  # the surface, with the current as its load
    ceiling: float  # height up to which the field is resolved, m; infinite over a coil


def run(scene: Scene[CoilPressureScene], report: Report) -> Result:
    """Raise the current from 0; return surface, pressure and field at its full value.

    Status "failed" if a check fails. Raises SceneError if the coil is impossible, and SolveError,
    with the current reached, if no surface rests at the full current.
    """
    table, begin = scene.table, time.perf_counter()
    setup = setup_of(scene)
    with interruptible():
        settled = settle(
            setup.profile, tolerance=table.surface.tolerance, degree=table.surface.degree,
            floor=0.0, ceiling=setup.ceiling, report=report,
        )  # fmt: skip
    solved = time.perf_counter()
    report("checking", None)
    rested = Rested(setup.fluid, setup.placed, settled, table.coil.ampere_turns * settled.load)
    result = _result(scene, rested, {"solve": solved - begin})
    if settled.stop is not None or not settled.resolved:
        reason, suggestion, code = _why(table, setup, settled)
        raise SolveError(reason, suggestion, result.failed(reason), code)
    return result


def setup_of(scene: Scene[CoilPressureScene]) -> Setup:
    """Return fluid, coil and surface of a scene; raises SceneError if the coil is impossible."""
    table = scene.table
    magnet, layer, winding = table.fluid, table.layer, table.coil
    law: Linear | Langevin = Linear(magnet.chi)
    if magnet.saturation is not None:
        law = Langevin(magnet.chi, magnet.saturation)
    fluid = Fluid(magnet.density, magnet.surface_tension, law, table.gravity)
    try:
        coil = Coil(winding.inner_radius, winding.outer_radius, winding.length)
    except ArgumentError as error:
        raise SceneError(scene.name, [("coil", str(error))]) from None
    placed = Placed(coil, winding.axis, winding.side, winding.distance)
    clearance, ceiling = winding.distance, math.inf
    if winding.side == "above":
        gap = winding.distance - layer.thickness
        clearance, ceiling = (1 - _FILLED) * gap, layer.thickness + _FILLED * gap
    profile = _profile(fluid, placed, table, coil.nodes(clearance, _DIGITS))
    return Setup(fluid, placed, profile, ceiling)


def _profile(fluid: Fluid, placed: Placed, table: CoilPressureScene, nodes: int) -> Profile:
    x, h, slope, bend, level, load = (ca.SX.sym(name) for name in "x h slope bend P I".split())
    current = table.coil.ampere_turns * load
    Hx, Hz = placed.field(x, h, nodes)
    rest = balance(fluid, (current * Hx, current * Hz), h, slope, bend, level)
    half = table.layer.width / 2
    return Profile(
        x, h, slope, bend, level, load, rest,
        ends=(-half, half), mean=table.layer.thickness, walls=table.layer.walls,
    )  # fmt: skip


def _result(scene: Scene[CoilPressureScene], rested: Rested, timings: dict[str, float]) -> Result:
    begin, table = time.perf_counter(), scene.table
    equations, y, load = rested.settled.equations, rested.settled.y, rested.settled.load
    facts = {
        "degree": equations.n,
        "tail": equations.tail(y),
        "defect": equations.defect(y, load),
        "volume_error": rested.volume_error,
        "force_imbalance": rested.force_imbalance,
        "field_error": rested.field_error,
        "growth_rate": float(equations.rates_of_growth(y, load)[0].real),
        "accepted": ACCEPTED,
        "demagnetisation": rested.demagnetisation,
    }
    x = np.linspace(*equations.profile.ends, _ALONG)
    return conclude(
        scene,
        _scalars(rested, table, x)
        | {name: facts[name] for name in ("volume_error", "demagnetisation")},
        _along(rested, table, x) | _inside(rested, x[:: _ALONG // 100]) | _around(rested, x),
        checks=_checks(facts),
        facts=facts,
        warnings=_warnings(rested, table, facts["demagnetisation"]),
        timings=timings | {"check": time.perf_counter() - begin},
        attributes={"winding": rested.placed.section},
    )


def _checks(facts: dict[str, Any]) -> Iterator[Check]:
    for key, accepted in ACCEPTED.items():
        name, found = key.replace("_", " "), facts[key]
        yield Check(name, found, accepted, f"{name} is {found:.2g}; {accepted:g} is accepted")
    growth = facts["growth_rate"]
    yield Check("growth rate", growth, 0.0, "the surface is not stable", passed=growth < 0)


def _warnings(rested: Rested, table: CoilPressureScene, demagnetised: float) -> Iterator[str]:
    if demagnetised > _DEMAGNETISED:
        yield (
            f"the field of the coil is computed as without fluid; by the estimate of a flat layer "
            f"the fluid reduces its pull on the surface by up to {demagnetised:.0%}"
        )
    stated = table.stated_pressure
    if stated is not None:
        needed = MU0 * field_of_pressure(rested.fluid, stated)
        if needed > _STRONG:
            yield (
                f"stated_pressure = {stated:g} Pa would need a field of {needed:.3g} T in this "
                "fluid, far above that of any coil; check its unit"
            )


# -- contents of the result ------------------------------------------------------------------------


def _scalars(rested: Rested, table: CoilPressureScene, x: np.ndarray) -> dict[str, Any]:
    thickness, fluid = table.layer.thickness, rested.fluid
    h, bottom = rested.surface(x), rested.pressure(x, np.zeros_like(x))
    below, above = (np.hypot(*rested.field(x, z)) for z in (np.zeros_like(x), h))
    still = fluid.weight * thickness
    change = float(np.max(bottom)) - still
    ratio = np.asarray(fluid.magnetisation.ratio(below**2))
    found = {
        "ampere_turns": rested.current,
        "pressure_max": np.max(bottom),
        "pressure_change_max": change,
        "pressure_without_field": still,
        "surface_rise_max": np.max(h) - thickness,
        "surface_drop_max": thickness - np.min(h),
        "slope_max": np.max(np.abs(rested.surface(x, 1))),
        "field_bottom_max": np.max(below),
        "field_surface_max": np.max(above),
        "induction_bottom_max": np.max(MU0 * (1 + ratio) * below),
        "magnetic_force": rested.force,
        "capillary_length": fluid.capillary_length,
        "stated_pressure": table.stated_pressure,
    }
    if table.stated_pressure is None:
        return found
    needed = field_of_pressure(fluid, table.stated_pressure)
    return found | {
        "pressure_over_stated": change / table.stated_pressure,
        "field_for_stated": needed,
        "induction_for_stated": MU0 * needed,
    }


def _along(rested: Rested, table: CoilPressureScene, x: np.ndarray) -> dict[str, np.ndarray]:
    """Return arrays at the bottom and the surface, and the branch of surfaces over the current."""
    h, flat, path = rested.surface(x), np.zeros_like(x), rested.settled.path
    return {
        "x": x,
        "surface": h,
        "pressure": rested.pressure(x, flat),
        "field_bottom": np.hypot(*rested.field(x, flat)),
        "field_surface": np.hypot(*rested.field(x, h)),
        "branch_current": path[:, 0] * table.coil.ampere_turns,
        "branch_highest": path[:, 2],
        "branch_lowest": path[:, 1],
    }


def _inside(rested: Rested, x: np.ndarray) -> dict[str, np.ndarray]:
    """Return the pressure in the fluid at equal shares of its height."""
    share = np.linspace(0, 1, _DEEP)
    z = share[:, None] * rested.surface(x)
    p = rested.pressure(np.broadcast_to(x, z.shape), z)
    return {"share": share, "inside_x": x, "inside_z": z, "inside_pressure": p}


def _around(rested: Rested, along: np.ndarray) -> dict[str, np.ndarray]:
    """Return the induction on a grid around coil and fluid; not a number in the winding."""
    placed, coil = rested.placed, rested.placed.coil
    size = coil.length / 2 if placed.axis == "vertical" else coil.outer
    top = float(np.max(rested.surface(along)))
    ends = (placed.middle - 1.2 * size, placed.middle + 1.2 * size)
    x = np.linspace(along[0], along[-1], _WIDE)
    z = np.linspace(min(0.0, ends[0]), max(1.5 * top, ends[1]), _HIGH)
    X, Z = np.meshgrid(x, z)
    free = placed.clearance(X, Z) > 1e-3 * coil.outer
    B = np.full((2, *X.shape), np.nan)
    H = np.array(rested.field(X[free], Z[free]))
    wet = (Z[free] >= 0) & (Z[free] <= rested.surface(X[free]))
    ratio = np.asarray(rested.fluid.magnetisation.ratio(np.sum(H**2, axis=0)))
    B[:, free] = MU0 * (1 + wet * ratio) * H
    return {"map_x": x, "map_z": z, "induction_x": B[0], "induction_z": B[1]}


# -- surfaces that do not rest ---------------------------------------------------------------------


def _rounded_down(number: float, digits: int = 3) -> str:
    """Return a number >= 0 as text of a few digits, rounded down."""
    with localcontext(rounding=ROUND_FLOOR):
        return f"{float(f'{Decimal(number):.{digits}g}'):g}"


def _why(table: CoilPressureScene, setup: Setup, settled: Settled) -> tuple[str, str, str]:
    """Return reason, suggestion and code of a surface that does not rest at the full current."""
    stop = settled.stop
    if stop is None:
        return (
            f"a polynomial of degree {settled.equations.n} does not resolve the surface: its last "
            f"coefficients are {settled.equations.tail(settled.y):.2g} of the thickness",
            "write a larger surface.degree or surface.tolerance, or a smaller layer.width",
            "unresolved",
        )
    current = stop.load * table.coil.ampere_turns
    unsure = not stop.uncertainty <= _UNRESOLVED * stop.load
    at = f"{'about ' if unsure else ''}{current:.{3 if unsure else 6}g} ampere-turns"
    below = "write usual values of fluid and layer"
    if current > 0:
        below = f"write coil.ampere_turns below {_rounded_down(current)}"
    x = np.linspace(*settled.equations.profile.ends, 801)
    steep = float(np.abs(settled.equations.at(settled.y, x, 1)).max())
    words = {
        "fold": (
            f"no surface near the layer rests above {at}, where the branch folds: the "
            "field's pull grows faster with height than weight and surface tension do",
            f"{below}, or move the coil away",
        ),
        "unstable": (
            f"the surface becomes unstable at {at} and moves sideways",
            f"{below}, or move the coil away",
        ),
        "floor": (
            f"the layer runs dry at {at}, at x = {stop.x:.3g} m: the coil draws the fluid off",
            f"{below}, or a larger layer.thickness",
        ),
        "ceiling": (
            f"at {at} the fluid rises to {setup.ceiling:.3g} m at x = {stop.x:.3g} m, three "
            "quarters of the gap to the coil, and is about to touch it",
            f"{below}, or a larger coil.distance",
        ),
        "lost": (
            f"the surface cannot be continued beyond {at}; its largest slope is {steep:.2g} there, "
            "and an overhanging surface has no height over x",
            f"{below}, or raise surface.degree",
        ),
    }
    return (*words[stop.why], stop.why)
