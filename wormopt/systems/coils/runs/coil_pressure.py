"""Scenes of kind ``coil-pressure``: surface and pressure of a magnetic fluid at a coil."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Decimal, localcontext
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError, interruptible
from wormopt.magnetics.hydrostatics import Fluid, Langevin, Linear, balance
from wormopt.magnetics.placed import Placed
from wormopt.magnetics.winding import Coil
from wormopt.progress import Report
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.coils.profile import Profile
from wormopt.systems.coils.runs.coil_forces import ACCEPTED, Rested, checks_of
from wormopt.systems.coils.runs.coil_maps import scalars_of, variables_of
from wormopt.systems.coils.scenes.coil_pressure import CoilPressureScene
from wormopt.systems.coils.settle import Settled, settle

# The field's quadrature is off by exp(-2 _DIGITS) of it at the nearest point.
_DIGITS = 10.0
# Of the gap under a coil above, so much may be filled: the field is resolved that far.
_FILLED = 0.75
_UNRESOLVED = 1e-3


@dataclass(frozen=True, eq=False)
class Setup:
    """What a scene says, as objects."""

    fluid: Fluid
    placed: Placed  # the coil and where it is
    profile: Profile  # the surface, with the current as its load
    ceiling: float  # height up to which the field is resolved, m; infinite over a coil


def run(scene: Scene[CoilPressureScene], report: Report) -> Result:
    """Raise the current from 0; give surface, pressure and field at its full value.

    Status "failed" where checks do not hold. Raises SceneError if the coil cannot be, and
    SolveError, naming the current reached, if the surface does not rest at the full one.
    """
    table, begin = scene.table, time.perf_counter()
    setup = setup_of(scene)
    surface = table.surface
    with interruptible():
        settled = settle(
            setup.profile, tolerance=surface.tolerance, degree=surface.degree, floor=0.0,
            ceiling=setup.ceiling, report=report,
        )  # fmt: skip
    solved = time.perf_counter()
    report("checking", None)
    rested = Rested(setup.fluid, setup.placed, settled, table.coil.ampere_turns * settled.load)
    result = _result(scene, rested)
    timings = {"solve": solved - begin, "check": time.perf_counter() - solved}
    result = _with(result, timings)
    if settled.stop is not None or not settled.resolved:
        reason, suggestion, code = _why(table, setup, settled)
        partial = _with(result, timings, status="failed", reason=reason)
        raise SolveError(reason, suggestion, partial, code)
    return result


def setup_of(scene: Scene[CoilPressureScene]) -> Setup:
    """Make fluid, coil and surface of a scene; SceneError if the coil cannot be."""
    table = scene.table
    magnet, layer = table.fluid, table.layer
    law: Linear | Langevin = Linear(magnet.chi)
    if magnet.saturation is not None:
        law = Langevin(magnet.chi, magnet.saturation)
    fluid = Fluid(magnet.density, magnet.surface_tension, law, table.gravity)
    winding = table.coil
    try:
        coil = Coil(winding.inner_radius, winding.outer_radius, winding.length)
    except ArgumentError as error:
        raise SceneError(scene.name, [("coil", str(error))]) from None
    placed = Placed(coil, winding.axis, winding.side, winding.distance)
    clearance, ceiling = winding.distance, math.inf
    if winding.side == "above":
        gap = winding.distance - layer.thickness
        clearance, ceiling = (1 - _FILLED) * gap, layer.thickness + _FILLED * gap
    profile = _profile(fluid, placed, table, _nodes(coil, clearance))
    return Setup(fluid, placed, profile, ceiling)


def _nodes(coil: Coil, clearance: float) -> int:
    reach = math.asinh(2 * clearance / (coil.outer - coil.inner))
    return min(150, 2 + math.ceil(max(_DIGITS / reach, 2.0)))


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


def _result(scene: Scene[CoilPressureScene], rested: Rested) -> Result:
    table = scene.table
    trust = checks_of(rested, table)
    faults = [
        f"{name.replace('_', ' ')} is {trust[name]:.2g}, where {accepted:g} is accepted"
        for name, accepted in ACCEPTED.items()
        if not trust[name] <= accepted
    ]
    if trust["growth_rate"] >= 0:
        faults.append("the surface is not stable")
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=scalars_of(rested, table, trust),
        variables=variables_of(rested, table),
        trust=trust,
        attributes={"winding": rested.placed.section},
        scene_text=scene.text,
    )


def _with(result: Result, timings: dict[str, float], **changes: Any) -> Result:
    return replace(result, timings_s=timings, **changes)


def _rounded_down(number: float, digits: int = 3) -> str:
    """A number, 0 or above, of a few digits that is not above a given one."""
    with localcontext(rounding=ROUND_FLOOR):
        return f"{float(f'{Decimal(number):.{digits}g}'):g}"


def _why(table: CoilPressureScene, setup: Setup, settled: Settled) -> tuple[str, str, str]:
    """Reason, suggestion and code of a surface that does not rest at the full current."""
    stop = settled.stop
    if stop is None:
        return (
            f"a polynomial of degree {settled.equations.n} does not resolve the surface: its last "
            f"coefficients are {settled.equations.tail(settled.y):.2g} of the thickness",
            "raise surface.degree or surface.tolerance, or take a narrower tank",
            "unresolved",
        )
    current = stop.load * table.coil.ampere_turns
    unsure = not stop.uncertainty <= _UNRESOLVED * stop.load
    at = f"{'about ' if unsure else ''}{current:.{3 if unsure else 6}g} ampere-turns"
    below = f"write coil.ampere_turns below {_rounded_down(current)}"
    steep = float(
        np.abs(
            settled.equations.at(settled.y, np.linspace(*settled.equations.profile.ends, 801), 1)
        ).max()
    )
    words = {
        "fold": (
            f"there is no surface at rest near the layer beyond {at}, where the branch folds: "
            "the field's pull grows faster with height than weight and surface tension do",
            f"{below}, or move the coil away",
        ),
        "unstable": (
            f"the surface loses its stability at {at} and gives way sideways",
            f"{below}, or move the coil away",
        ),
        "floor": (
            f"the layer runs dry at {at}, at x = {stop.x:.3g} m: the coil draws the fluid off",
            f"{below}, or take a thicker layer",
        ),
        "ceiling": (
            f"at {at} the fluid rises to {setup.ceiling:.3g} m at x = {stop.x:.3g} m, three "
            "quarters of the way to the coil, and is about to touch it",
            f"{below}, or a larger coil.distance",
        ),
        "lost": (
            f"the surface cannot be followed beyond {at}; its largest slope is {steep:.2g} there, "
            "and where it is to overhang there is no height over x",
            f"{below}, or raise surface.degree",
        ),
    }
    return (*words[stop.why], stop.why)
