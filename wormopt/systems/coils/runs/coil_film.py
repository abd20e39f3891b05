"""Runs of kind ``coil-film``: a film over a row of coils, simulated from switch to switch."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import ArgumentError, Interrupted, SceneError, SolveError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.hydrostatics import Fluid, Langevin, Linear
from wormopt.magnetics.ripples import field_stiffness, growth_rate, normal_field_number
from wormopt.magnetics.travelling import switched_course
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.result import Check, Result, left_out
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.cargo import Float
from wormopt.systems.coils.film import RowField, coil_film, inside_field, row_field
from wormopt.systems.coils.layer import Layer
from wormopt.systems.coils.runs import cargo
from wormopt.systems.coils.runs.coil_row import row_of, warnings_of_coils
from wormopt.systems.coils.scenes.coil_design import CoilDesignScene
from wormopt.systems.coils.scenes.coil_film import CoilFilmScene

ACCEPTED = {"half the cells": 0.1, "smaller steps": 1e-3, "volume": 1e-10, "field": 1e-6}
"""Accepted errors over the depth, the volume and the largest field."""
_SMALL = 0.1  # share of a neglected effect from which it is reported
_STEPS = 200_000
_ADVICE = "lower switching.ampere_turns, or raise film.top, grid.cells or fluid.viscosity"
_SPOTS = 7  # number of places and times at which fields are compared


@dataclass(frozen=True, eq=False)
class Setup:
    """Objects of a scene."""

    layer: Layer
    row: CoilRow
    course: Gait
    ground: float  # m
    top: float  # m
    own_field: bool
    cargo: Float | None
    start: float  # initial position of the float, m
    end: float  # s
    times: np.ndarray  # s

    def field(self) -> RowField:
        """Return the field of the row over the film."""
        return row_field(self.row, self.layer, self.ground, self.top)

    def follow(self, tolerance: float, report: Report) -> Trajectory:
        """Simulate the film from flat, in its cells.

        A SolveError or Interrupted has the motion so far.
        """
        film = coil_film(
            self.layer, self.row, ground=self.ground, top=self.top, own_field=self.own_field,
            cargo=self.cargo,
        )  # fmt: skip
        try:
            return simulate(
                drive(film, self.course, periodic=True), self.end, times=self.times,
                x0={"position": self.start} if self.cargo else None,
                route="cvodes", report=report,
                tolerance=Tolerance(tolerance, tolerance, max_steps=_STEPS),
            )  # fmt: skip
        except SolveError as error:
            reason = f"the film cannot be simulated to the end: {error.reason}"
            raise SolveError(reason, _ADVICE, error.partial, error.code) from None


def run(scene: Scene[CoilFilmScene], report: Report) -> Result:
    """Simulate the film, then on half the cells, and with smaller steps.

    Status "failed" if these differ, or if the film leaves the resolved heights. Raises SceneError
    if a winding is too near, SolveError if the film cannot be simulated to the end.
    """
    table, begin = scene.table, time.perf_counter()
    setup = setup_of(scene)
    try:
        field = setup.field()
    except ArgumentError as error:
        raise SceneError(scene.name, [("film.ground", str(error))]) from None
    motion = _followed(scene, setup, report)
    followed = time.perf_counter()
    report("half the cells", 0.5)
    layer = replace(setup.layer, cells=setup.layer.cells // 2)
    coarse = replace(setup, layer=layer)
    try:
        rough = coarse.follow(table.grid.tolerance, report)
        close = coarse.follow(table.grid.tolerance / 10, report)
    except Interrupted:
        raise Interrupted(_partial(scene, setup, motion)) from None
    except SolveError as error:
        found = _partial(scene, setup, motion)
        raise SolveError(error.reason, _ADVICE, found, error.code) from None
    done = time.perf_counter()
    h, depth = motion["thickness"].T, setup.layer.depth
    pairs = h[-1].reshape(-1, 2).mean(axis=1)
    end = rough["thickness"][:, -1]
    found = {
        "half the cells": float(np.abs(pairs - end).max() / depth),
        "smaller steps": float(np.abs(close["thickness"][:, -1] - end).max() / depth),
        "volume": float(np.abs(h.mean(axis=1) / depth - 1).max()),
        "field": _field_error(setup, field, h),
    }
    inside = _inside(setup, field, h)
    flow = motion["flow"].T
    scalars = _scalars(table, setup, h, flow) | {
        "normal_field_number": _normal_field_number(setup, field),
        "own_field_left_out": _left_out(setup, h, inside),
        "grid_error": found["half the cells"] / 3,
        "step_error": found["smaller steps"],
        "volume_error": found["volume"],
    }
    checks, warnings = list(_checks(found, scalars, setup)), list(_warnings(table, scalars))
    if setup.cargo and table.cargo:
        scalars |= cargo.scalars_of(setup.layer, setup.cargo, motion, rough)
        scalars["float_captured"] = cargo.captured(table, motion["position"][0])
        checks += cargo.checks_of(scalars, setup.cargo, setup.layer)
        warnings += cargo.warnings_of(table.cargo, table.film, setup.cargo, scalars)
    return conclude(
        scene,
        scalars,
        _variables(setup, motion),
        checks=checks,
        facts={"steps": motion.n_steps, "cells": setup.layer.cells},
        warnings=warnings,
        timings={"film": followed - begin, "recheck": done - followed},
        attributes=_attributes(table),
    )


def _attributes(table: CoilFilmScene) -> dict[str, Any]:
    """Return sizes that plots draw to scale."""
    row = {"pitch": table.coils.pitch}
    if table.cargo is None:
        return row
    return row | {"float": {"length": table.cargo.length, "thickness": table.cargo.thickness}}


def _partial(scene: Scene[CoilFilmScene], setup: Setup, motion: Trajectory) -> Result:
    attributes = _attributes(scene.table)
    return conclude(scene, {}, _variables(setup, motion), attributes=attributes)


def _followed(scene: Scene[CoilFilmScene], setup: Setup, report: Report) -> Trajectory:
    """Return the motion of the film; a failed motion is kept up to where it ends."""
    try:
        return setup.follow(scene.table.grid.tolerance, report)
    except SolveError as error:
        found = _partial(scene, setup, error.partial)
        raise SolveError(error.reason, error.suggestion, found, error.code) from None
    except Interrupted as stop:
        raise Interrupted(_partial(scene, setup, stop.partial)) from None


def _variables(setup: Setup, motion: Trajectory) -> dict[str, Any]:
    """Return arrays of a motion."""
    layer = setup.layer
    found = {
        "time": motion.time,
        "x": layer.places,
        "face": layer.start + layer.step * np.arange(layer.cells + 1),
        "thickness": motion["thickness"].T,
        "flow": motion["flow"].T,
        "coil_place": setup.row.places,
        "current": setup.course(np.mod(motion.time, setup.course.period)).T,
    }
    if setup.cargo:
        found["float_position"] = motion["position"][0]
        found["float_velocity"] = motion["velocity"][0]
    return found


def layer_of(table: CoilFilmScene | CoilDesignScene, row: CoilRow, per_pitch: int) -> Layer:
    """Return the film of a scene, with an even number of cells so that half as many fit."""
    magnet, film = table.fluid, table.film
    law: Linear | Langevin = Linear(magnet.chi)
    if magnet.saturation is not None:
        law = Langevin(magnet.chi, magnet.saturation)
    fluid = Fluid(magnet.density, magnet.surface_tension, law, table.gravity)
    length = row.places[-1] + 2 * film.overhang
    cells = 2 * max(math.ceil(length / row.pitch * per_pitch / 2 - 1e-9), 5)
    return Layer(fluid, magnet.viscosity, film.depth, length, cells, start=-film.overhang)


def setup_of(scene: Scene[CoilFilmScene]) -> Setup:
    """Return film, row and waveform of a scene."""
    table = scene.table
    film, switching, row = table.film, table.switching, row_of(table.coils)
    layer = layer_of(table, row, table.grid.cells)
    amount = table.coils.ampere_turns if switching.ampere_turns is None else switching.ampere_turns
    course = switched_course(
        row.count, amount, switching.rate, on=switching.on, every=switching.every
    )
    steps = table.course.switches
    end = steps / switching.rate
    times = np.linspace(0, end, steps * table.course.samples + 1)
    top = film.top * film.depth
    start = table.cargo.start if table.cargo else 0.0
    body = cargo.float_of(table.cargo, layer) if table.cargo else None
    return Setup(layer, row, course, film.ground, top, film.own_field, body, start, end, times)


def _currents(setup: Setup, count: int) -> np.ndarray:
    """Return the currents of the steps that occur, shape (coils, steps); `count` at most."""
    steps = np.linspace(0, setup.course.pieces - 1, min(count, setup.course.pieces)).astype(int)
    return np.hstack([setup.course.on_piece(k, np.zeros(1)) for k in steps.tolist()])


def _field_error(setup: Setup, field: RowField, h: np.ndarray) -> float:
    """Return the largest difference of the film's field to the row's at a few times, relative."""
    worst, largest = 0.0, 1e-300
    for k, currents in enumerate(_currents(setup, _SPOTS).T):
        z = h[(k * len(h)) // _SPOTS]
        known = setup.row.field(setup.layer.places, setup.ground + z, currents)
        worst = max(worst, float(np.abs(np.array(field(z, currents)) - known).max()))
        largest = max(largest, float(np.abs(known).max()))
    return worst / largest


def _inside(setup: Setup, field: RowField, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the field across and along the surface, inside, at all times; (times, cells), A/m."""
    currents = setup.course(np.mod(setup.times, setup.course.period))
    slopes = np.gradient(h, setup.layer.step, axis=1)
    parts = [
        inside_field(setup.layer.fluid, field(z, now), slope, own_field=setup.own_field)
        for z, slope, now in zip(h, slopes, currents.T, strict=True)
    ]
    along, _, across = zip(*parts, strict=True)
    return np.array(across), np.array(along)


def _left_out(setup: Setup, h: np.ndarray, inside: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the largest stiffness by the field of ripples, over weight and surface tension.

    The field across reduces stiffness, more for a thicker film. The field along adds stiffness,
    more for a thinner film. Each one by itself therefore bounds both together.
    """
    fluid = setup.layer.fluid
    across, along = (float(np.abs(part).max()) for part in inside)
    waves = np.pi * np.arange(1, setup.layer.cells) / setup.layer.length
    taken = field_stiffness(fluid, h.max(), waves, across)
    added = -field_stiffness(fluid, h.min(), waves, 0.0, along)
    restoring = fluid.weight + fluid.surface_tension * waves**2
    return abs(float(np.max(np.maximum(taken, added) / restoring)))  # 0.0, not -0.0


def _normal_field_number(setup: Setup, field: RowField) -> float:
    """Return the normal-field number of the strongest field across the flat film."""
    layer, flat = setup.layer, np.full(setup.layer.cells, setup.layer.depth)
    across = [
        inside_field(layer.fluid, field(flat, now), 0.0 * flat, own_field=True)[2]
        for now in _currents(setup, setup.course.pieces).T
    ]
    return normal_field_number(layer.fluid, layer.depth, float(np.abs(across).max()))


def _scalars(table: CoilFilmScene, setup: Setup, h: np.ndarray, flow: np.ndarray) -> dict[str, Any]:
    layer, fluid = setup.layer, setup.layer.fluid
    slopes = np.abs(np.diff(h, axis=1)) / layer.step
    middle = layer.start + layer.length / 2
    right = np.clip((layer.places + layer.step / 2 - middle) / layer.step, 0, 1)
    carried = float(layer.step * ((h[-1] - h[0]) @ right))
    block = table.switching.on * table.coils.pitch
    rate = growth_rate(fluid, layer.viscosity, layer.depth, 2 * np.pi / block)
    inner = np.abs(flow[:, 1:-1])
    return {
        "carried": carried,
        "carried_per_switch": carried / table.course.switches,
        "thickness_max": float(h.max()),
        "thickness_min": float(h.min()),
        "slope_max": float(slopes.max()),
        "wave_speed": table.coils.pitch * table.switching.rate,
        "relaxation_time": -1 / rate,
        "capillary_length": fluid.capillary_length,
        "inertia": float(np.max(fluid.density * inner * slopes) / layer.viscosity),
    }


def _checks(found: dict[str, float], scalars: dict[str, Any], setup: Setup) -> Iterator[Check]:
    advice = {
        "half the cells": "half the cells change the film by {:.2g} of its depth; raise grid.cells",
        "smaller steps": "smaller steps change the film by {:.2g} of its depth; lower "
        "grid.tolerance",
        "volume": "{:.2g} of the volume is lost",
        "field": "the field at the surface has an error of {:.2g}; move the coils from the film",
    }
    for name, accepted in ACCEPTED.items():
        yield Check(name, found[name], accepted, advice[name].format(found[name]))
    highest = scalars["thickness_max"]
    yield Check(
        "top", highest, setup.top,
        f"the film reaches a thickness of {highest:.3g} m, above film.top times film.depth = "
        f"{setup.top:.3g} m, up to which the field is resolved; raise film.top",
    )  # fmt: skip
    number = scalars["normal_field_number"]
    yield Check(
        "flat surface", number, 1.0,
        f"the field across the film cancels {number:.2g} of weight and surface tension: its "
        "surface forms peaks, which are not computed; lower switching.ampere_turns",
    )  # fmt: skip


def _warnings(table: CoilFilmScene, scalars: dict[str, Any]) -> Iterator[str]:
    amount = table.switching.ampere_turns
    yield from warnings_of_coils(
        table.coils, table.coils.ampere_turns if amount is None else amount
    )
    told = {
        "slope_max": "slopes of the surface reach {:.2g}; lubrication assumes small slopes",
        "inertia": "inertia is neglected; its share reaches {:.2g}",
        "own_field_left_out": "the neglected effect of surface ripples on the field is, by first "
        "harmonics, up to {:.2g} of weight and surface tension",
    }
    for name, words in told.items():
        if scalars[name] > _SMALL:
            yield left_out(scalars[name], words.format(scalars[name]))
