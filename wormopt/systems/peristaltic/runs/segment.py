"""Runs of kind ``peristaltic-segment``: strokes, limits and hold of one segment."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.magnetics.winding import Coil
from wormopt.numerics.chebyshev import resolve
from wormopt.progress import Report
from wormopt.result import Check, Result, Unchecked
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.peristaltic.scenes.segment import SegmentScene
from wormopt.systems.peristaltic.segment.barrel import barrel_swelling
from wormopt.systems.peristaltic.segment.fibres import Fibres, range_of_fill
from wormopt.systems.peristaltic.segment.inflation import (
    WIDEST,
    inflated,
    largest_loading,
    limit_of_inflation,
)
from wormopt.systems.peristaltic.segment.membrane import Balloon, balloon
from wormopt.systems.peristaltic.segment.rubber import density, slopes
from wormopt.systems.peristaltic.segment.segment import Segment, Tube
from wormopt.systems.peristaltic.segment.wound import WoundSegment

_ACCEPTED = 1e-9
_NONE = 1e-9  # a reserve below this share counts as none
_ASSUMED = {
    "sealed": "no fluid leaves or enters the segment, so uniform pressure does not deform it; "
    "only [inflation] lets fluid in",
    "ideal coil": "the field of [coil] is uniform over a share of the segment and 0 at its ends; "
    "[winding] has the field on the axis of a real coil, which the fluid does not change",
    "cylinder": "the segment stays a cylinder, its ends as wide as its middle; barrel_radius and "
    "[inflation] show the effect of rings at the ends",
    "no wrinkles": "the wall carries the axial compression that a sealed cylinder has when it "
    "shortens; a shell with so thin a wall buckles at a stroke of about 2 h / (3 R)",
    "caps": "the pull of the field across the ends, chi times the pressure there, is neglected",
    "rubber": "incompressible, without creep, hysteresis or bending stiffness of the wall",
}

_NO_SHAPE = (
    "the true membrane is not computed: at this small pressure it bends only at its rings, too "
    "sharply to be resolved, and is a cylinder elsewhere"
)


def run(scene: Scene[SegmentScene], report: Report) -> Result:
    """Compute strokes, hold and limits; status "failed" if the energy disagrees.

    Raises SceneError for a pressure above the limit of inflation, a load without friction, and
    rubber that is too soft.
    """
    table, begin = scene.table, time.perf_counter()
    part, coil = table.segment, table.coil
    segment = Segment(
        part.length, part.radius, part.wall, part.shear_modulus, coil.share, part.neo_hookean
    )
    report("strokes", 0.0)
    try:
        scalars, variables = _strokes(segment, table), _curves(segment, table)
    except ArgumentError as error:
        raise SceneError(scene.name, [("segment.shear_modulus", str(error))]) from None
    checks = [_least_energy(segment, coil.pressure, scalars["stretch"])]
    if table.tube:
        tube = Tube(table.tube.radius, table.tube.friction)
        scalars |= _hold(scene, segment, tube)
        checks.append(_wall_work(segment, tube, coil.pressure))
    if table.winding:
        report("field of the coil", 0.3)
        wound = _wound(segment, table)
        scalars |= _real(wound, table)
        variables |= _field(wound, table)
    warnings = list(_warnings(segment, table, scalars))
    if table.inflation:
        report("inflation", 0.5)
        scalars |= _inflation(scene, segment)
        shape = _true_shape(segment, table.inflation.pressure)
        if shape is None:
            warnings.append(_NO_SHAPE)
        else:
            scalars |= _swollen(shape)
            variables |= _meridian(segment, shape)
            checks.append(_first_integral(segment, shape))
    return conclude(
        scene, scalars, variables, checks=checks, facts={"assumptions": _ASSUMED},
        warnings=warnings, timings={"solve": time.perf_counter() - begin}, attributes=_sizes(table),
    )  # fmt: skip


def _sizes(table: SegmentScene) -> dict[str, Any]:
    """Return sizes that plots need beside the results; lengths in m."""
    part, winding, tube = table.segment, table.winding, table.tube
    sizes = {"length": part.length, "radius": part.radius, "coil_share": table.coil.share}
    sizes |= {"coil_pressure": table.coil.pressure, "load": table.load}
    if tube:
        sizes["tube_radius"] = tube.radius
    if table.inflation:
        sizes["inflation_pressure"] = table.inflation.pressure
    if winding:
        sizes["winding_length"] = winding.length
    return sizes


def _strokes(segment: Segment, table: SegmentScene) -> dict[str, Any]:
    """Return the effect of the coil on a free segment."""
    pressure, load = table.coil.pressure, table.load
    stretch = segment.stretch_at(pressure)
    longest, loaded = segment.stretch_at(0.0, -load), segment.stretch_at(pressure, load)
    return {
        "stroke": 1 - stretch,
        "stroke_loaded": max(longest - loaded, 0.0),
        "swelling": segment.radius_at(stretch) - segment.radius,
        "stretch": stretch,
        "stretch_extended": longest,
        "stretch_loaded": loaded,
        "stretch_deepest": segment.deepest_stretch(pressure),
        "loading": segment.loading(pressure),
        "coil_pull": segment.coil_pull(1.0, pressure),
        "barrel_radius": segment.radius * barrel_swelling(stretch),
        "weight": table.fluid.density * table.gravity * segment.volume,
        "head": 2 * table.fluid.density * table.gravity * segment.radius,
    }


def _hold(scene: Scene[SegmentScene], segment: Segment, tube: Tube) -> dict[str, Any]:
    """Return the forces of a segment that fills its tube."""
    table = scene.table
    pressure, load = table.coil.pressure, table.load
    stretch = tube.stretch_at_contact(segment)
    push = -segment.elastic_pull(stretch)
    unit = segment.coil_pull(stretch, 1.0)
    free, loaded = (max(tube.normal_force(segment, pressure, pull), 0.0) for pull in (0.0, load))
    if load and not tube.friction:
        asks = f"write at least {load / loaded:.3g}" if loaded else "there is no normal force"
        raise SceneError(
            scene.name, [("tube.friction", f"no friction holds no load of {load:g} N; {asks}")]
        )
    drag = tube.friction * table.fluid.density * table.gravity * segment.volume
    holding = tube.friction * loaded
    return {
        "moves": bool(holding > 0 and holding >= load + drag and push >= drag),
        "normal_force": free,
        "holding": tube.friction * free,
        "holding_loaded": holding,
        "drag": drag,
        "gap": tube.radius - segment.radius,
        "stretch_contact": stretch,
        "surplus": tube.surplus(segment, pressure),
        "return_force": push,
        "pressure_to_wall": push / unit if unit else None,
        "modulus_to_wall": segment.shear_modulus * pressure * unit / push,
    }


def _wound(segment: Segment, table: SegmentScene) -> WoundSegment:
    winding = table.winding
    assert winding
    coil = Coil(winding.inner_radius, winding.outer_radius, winding.length)
    return WoundSegment(segment, coil, table.fluid.chi)


def _real(wound: WoundSegment, table: SegmentScene) -> dict[str, Any]:
    assert table.winding
    return {
        "winding_pressure": wound.pressure(0.0, table.winding.ampere_turns),
        "winding_share": wound.share(1.0),
        "winding_stretch": wound.stretch_at(table.winding.ampere_turns),
    }


def _inflation(scene: Scene[SegmentScene], segment: Segment) -> dict[str, Any]:
    """Return shapes of a cylinder, and of one with fibres, under a given pressure."""
    given, a = scene.table.inflation, segment.neo_hookean
    assert given
    limit, unit = limit_of_inflation(a), 1 / segment.loading(1.0)
    found: dict[str, Any] = {"pressure_max": limit.loading * unit if limit else None}
    try:
        _, hoop, stretch = inflated(segment.loading(given.pressure), a)
    except ArgumentError:
        most = largest_loading(a) * unit
        what = "the limit of inflation" if limit else f"the pressure that swells it {WIDEST:g}-fold"
        message = f"{given.pressure:g} Pa is above {what}; write at most {most:.6g}"
        raise SceneError(scene.name, [("inflation.pressure", message)]) from None
    found |= {"inflated_hoop": hoop, "inflated_stretch": stretch}
    if given.fibre_angle is not None:
        fibres = Fibres(segment, given.fibre_angle)
        try:
            angle = fibres.angle_at(given.pressure)
        except ArgumentError as error:
            raise SceneError(scene.name, [("inflation.fibre_angle", str(error))]) from None
        found |= {"fibre_angle": angle, "fibre_stretch": float(fibres.stretches(angle)[0])}
    if given.fill is not None:
        low, high = range_of_fill(given.fill)
        found |= {"fill_angle_low": low, "fill_angle_high": high}
    return found


def _true_shape(segment: Segment, pressure: float) -> Balloon | None:
    """Return the true membrane, or None if it bends too sharply to be resolved."""
    slenderness, loading = segment.length / segment.radius, segment.loading(pressure)
    try:
        return balloon(slenderness, loading=loading, neo_hookean=segment.neo_hookean)
    except SolveError as error:
        if error.code == "unresolved":
            return None
        raise


def _swollen(shape: Balloon) -> dict[str, Any]:
    return {
        "membrane_hoop": shape.radius[0],
        "membrane_stretch": shape.stretch,
        "membrane_volume": shape.volume,
    }


def _meridian(segment: Segment, shape: Balloon) -> dict[str, np.ndarray]:
    return {
        "membrane_place": segment.radius * shape.place,
        "membrane_radius": segment.radius * shape.radius,
    }


def _curves(segment: Segment, table: SegmentScene) -> dict[str, np.ndarray]:
    """Return strokes up to twice the pressure, and forces over the stretch."""
    most = 2 * table.coil.pressure or segment.shear_modulus * segment.wall / segment.radius
    pressures = np.linspace(0.0, most, table.points)
    longest = segment.stretch_at(0.0, -table.load)
    loaded = longest - np.array([segment.stretch_at(p, table.load) for p in pressures])
    least, largest = table.stretches
    stretches = np.linspace(least, largest, table.points)
    return {
        "pressure": pressures,
        "free_stroke": np.array([1 - segment.stretch_at(p) for p in pressures]),
        "loaded_stroke": np.maximum(loaded, 0.0),
        "deepest_stroke": np.array([1 - segment.deepest_stretch(p) for p in pressures]),
        "axial_stretch": stretches,
        "return_forces": -segment.elastic_pull(stretches),
        "coil_pulls": segment.coil_pull(stretches, table.coil.pressure),
    }


def _field(wound: WoundSegment, table: SegmentScene) -> dict[str, np.ndarray]:
    assert table.winding
    turns = table.winding.ampere_turns
    places = wound.segment.length * np.linspace(-0.75, 0.75, table.points)
    least, largest = table.stretches
    stretches = np.linspace(least, largest, table.points)
    return {
        "field_place": places,
        "field_pressure": wound.pressure(places, turns),
        "winding_pulls": wound.coil_pull(stretches, turns),
    }


def _least_energy(segment: Segment, pressure: float, stretch: float) -> Check:
    """Compare an equilibrium stretch with that of the least energy."""

    def energy(stretch: np.ndarray) -> np.ndarray:
        return (segment.energy(stretch) + segment.magnetic_energy(stretch, pressure))[None]

    low = max(0.9 * stretch, segment.coil_share)
    series = resolve(energy, low, 1.1 * stretch)
    rests = np.array([low, *series.derivative().roots(0)])
    error = abs(rests[np.argmin(series(rests)[0])] - stretch)
    advice = f"the stretch differs by {error:.2g} from that of the least energy"
    return Check("stretch of the least energy", error, _ACCEPTED, advice)


def _wall_work(segment: Segment, tube: Tube, pressure: float) -> Check:
    """Compare the normal force with minus the derivative of the energy by the tube's radius."""

    def energy(radius: np.ndarray) -> np.ndarray:
        stretch = (segment.radius / radius) ** 2
        return (segment.energy(stretch) + segment.magnetic_energy(stretch, pressure))[None]

    # on the side where the coil's pull does not end
    pulled = tube.stretch_at_contact(segment) >= segment.coil_share
    low, high = (0.99, 1.0) if pulled else (1.0, 1.01)
    series = resolve(energy, low * tube.radius, high * tube.radius)
    work = -float(series.derivative()(np.array([tube.radius]))[0, 0])
    size = abs(work) + 2 * segment.length / tube.radius * segment.stiffness
    error = abs(work - tube.normal_force(segment, pressure)) / size
    advice = f"the normal force differs by {error:.2g} from the derivative of the energy"
    return Check("work of the wall", error, _ACCEPTED, advice)


def _first_integral(segment: Segment, shape: Balloon) -> Check:
    """Return the spread of the membrane's first integral w - lam_1 w_1 along the meridian."""
    radius, _, stretch, _, _ = shape.solution.at(np.linspace(0.0, 1.0, len(shape.radius)))
    w = density(stretch, radius, segment.neo_hookean)
    along, _ = slopes(stretch, radius, segment.neo_hookean)
    spread = float(np.ptp(w - stretch * along))
    advice = f"the first integral of the membrane varies by {spread:.2g} along it"
    return Check("first integral of the membrane", spread, _ACCEPTED, advice)


def _warnings(segment: Segment, table: SegmentScene, found: dict[str, Any]) -> Iterator[str]:
    pressure = table.coil.pressure
    if table.tube and not found["moves"]:
        yield f"the segment will not move: {_why(table, found)}"
    if table.tube and found["moves"] and _spare(table, found) <= _NONE:
        yield (
            "the segment moves without any reserve: the wall just holds load and drag, or the "
            "rubber just overcomes the drag"
        )
    if 0 < pressure < found["head"]:
        yield Unchecked(
            f"the weight of the fluid makes a pressure of {found['head']:.3g} Pa over its "
            f"width, more than the {pressure:.3g} Pa of the field: the segment sags"
        )
    if found["stretch"] == segment.coil_share:
        yield "the coil pulls the whole segment into its uniform field, where its pull ends"


def _spare(table: SegmentScene, found: dict[str, Any]) -> float:
    """Return the least unused share of hold and push."""
    hold, push = found["holding_loaded"], found["return_force"]
    return min(1 - (table.load + found["drag"]) / hold, 1 - found["drag"] / push)


def _why(table: SegmentScene, found: dict[str, Any]) -> str:
    """Return why a segment does not move, with values that suffice."""
    if not found["normal_force"]:
        asks = [f"coil.share below {found['stretch_contact']:.4g}"]
        if found["pressure_to_wall"]:
            asks = [f"coil.pressure = {found['pressure_to_wall']:.4g}"]
        if found["modulus_to_wall"]:
            asks.append(f"segment.shear_modulus = {found['modulus_to_wall']:.4g}")
        return (
            f"it swells by {1e6 * found['swelling']:.3g} µm of the {1e6 * found['gap']:.3g} µm to "
            f"the wall; write {', or '.join(asks)}"
        )
    needed = table.load + found["drag"]
    if not needed:
        return "without friction nothing holds; write a tube.friction above 0"
    if found["holding_loaded"] < needed:
        return (
            f"the wall holds {1e3 * found['holding_loaded']:.3g} mN, less than load and drag, "
            f"{1e3 * needed:.3g} mN"
        )
    return (
        f"the rubber pushes with {1e3 * found['return_force']:.3g} mN against a drag of "
        f"{1e3 * found['drag']:.3g} mN"
    )
