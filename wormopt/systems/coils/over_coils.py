"""A film over a row of coils, with or without a float: for kinds coil-film and coil-design."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import ArgumentError, Fault, SceneError, SolveError
from wormopt.result import left_out
from wormopt.study import (
    Given,
    array,
    attributes,
    check,
    entry,
    number,
    on_use,
    parts,
    positive,
    scalar,
    stage,
    value,
    whole,
)
from wormopt.systems.coils.tables import Coils, MagneticFluid
from wormopt.systems.shared.studies import SIStudy

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.coils.film import FilmSetup, Float, Layer, RowField, rigid, row_field
    from wormopt.systems.coils.film_code import simulate_film

_LIGHTEST = 1e-9  # least mass of a float over the film's: lighter ones need too many steps
_FARTHEST = 100  # largest distance from the last coil to a wall, in pitches
_AFLOAT = 0.01  # share of the depth
_HEAVY = 0.5  # draught over depth from which a warning is given


class ViscousFluid(MagneticFluid):
    """A magnetic fluid that flows."""

    viscosity: float = positive("viscosity", "dynamic viscosity", default=0.05)


class Film(Given):
    """The film, in a trough with upright walls along the row.

    A film that may reach a winding is refused, as are walls more than 100 pitches from the last
    coils.
    """

    depth: float = positive("length", "thickness without field")
    ground: float = number(
        "length", "height of the ground above the middle of the coils, or of the gap"
    )
    overhang: float = positive(
        "length", "distance from the last coils' middles to the walls", default=20e-3
    )
    top: float = number(
        "share",
        "largest thickness over `depth` accepted; more is a failure",
        above=1,
        most=20,
        default=4.0,
    )
    own_field: bool = entry(
        "whether the fluid reduces the field across it, as in a flat layer", default=True
    )

    @property
    def highest(self) -> float:
        """Largest thickness accepted, in m."""
        return self.top * self.depth

    def faults_in(self, coils: Coils) -> Iterator[Fault]:
        """Yield a fault if the film may reach a winding, or is too long."""
        farthest = _FARTHEST * coils.pitch
        if self.overhang > farthest:
            yield (
                "film.overhang",
                f"{self.overhang:g} is more than {_FARTHEST} pitches, where no coil moves the "
                f"film; write {farthest:g} at most",
            )
        low, high = coils.taken
        bottom, top = self.ground, self.ground + self.highest
        # the row is symmetric about its middle height
        nearest = 0.0 if bottom <= 0 <= top else min(abs(bottom), abs(top))
        if low <= high and nearest <= high and max(abs(bottom), abs(top)) >= low:
            yield (
                "film.ground",
                f"{self.ground:g} puts a coil inside the fluid, which may reach from there to "
                f"{top:g} (by film.top times film.depth); windings reach from {low:g} to {high:g} "
                f"from the middle; write a ground above {high:g}",
            )


class Cargo(Given):
    """A float on the film, as wide as the trough: a non-magnetic plate of one material.

    Its stiffness tapers to its tips over half of `edge` beyond `length` on each side. Plates with
    negligible bending count as rigid. A start with the float outside the walls is refused, as are
    almost no mass and a mass above what the film carries.
    """

    length: float = positive("length", "length along the row")
    thickness: float = positive("length", "thickness of the plate")
    density: float = positive("density", "density of the plate")
    youngs_modulus: float = positive(
        "stress", "Young's modulus; bending stiffness is modulus thickness³ / 12", default=1e9
    )
    start: float = number("length", "initial position of its middle; coil 0 is at 0", default=0.0)
    edge: float | None = positive(
        "length",
        "length of its tapered ends, assumed; two thirds of `length` if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.edge is not None and self.edge > self.length:
            yield (
                "edge",
                f"{self.edge:g} exceeds the length of the float; write {self.length:g} at most",
            )

    def faults_in(
        self, coils: Coils, film: Film, fluid: MagneticFluid, gravity: float
    ) -> Iterator[Fault]:
        """Yield faults of a float that the film cannot carry, without mass, or outside."""
        # largest displaced fluid, and the pull of upright menisci at its ends
        borne = fluid.density * film.highest
        borne += 2 * fluid.surface_tension / (gravity * self.length)
        if self.density * self.thickness > borne:
            yield (
                "cargo.thickness",
                f"{self.thickness:g}: this float is so heavy that it lies on the ground, for any "
                f"height of the film (up to film.top times film.depth); write at most "
                f"{borne / self.density:.2g}, or a smaller cargo.density",
            )
        lightest = _LIGHTEST * fluid.density * film.depth / self.thickness
        if self.density < lightest:
            yield (
                "cargo.density",
                f"{self.density:g}: the float has less than a billionth of the film's mass; write "
                f"at least {lightest:g}, or a larger cargo.thickness",
            )
        low = -film.overhang + self.length / 2
        high = (coils.count - 1) * coils.pitch + film.overhang - self.length / 2
        if not low <= self.start <= high:
            yield (
                "cargo.start",
                f"{self.start:g}: a float of length {self.length:g} is not between the walls; "
                + (f"write {low:g} to {high:g}" if low <= high else "write a smaller cargo.length"),
            )

    @property
    def stiffness(self) -> float:
        """Bending stiffness, in N m."""
        return self.youngs_modulus * self.thickness**3 / 12

    def on(self, layer: Layer) -> Float:
        """Return the float on a film, with its stiffness limited to that of a rigid float."""
        mass = self.density * self.thickness * self.length
        stiffness = min(self.stiffness, rigid(layer, self.length))
        return Float(self.length, mass, stiffness, self.edge or 0.0)


class Cells(Given):
    """Resolution in space and time."""

    cells: int = whole(2, 64, "cells per pitch; compared with half as many", default=12)
    tolerance: float = number(
        "share", "relative tolerance of a time step", least=1e-10, most=0.001, default=1e-5
    )


@dataclass(frozen=True)
class FloatNumbers:
    """Numbers of the motion of a float."""

    draught: float = value("length", "static draught of the float: mass over density and length")
    float_travel: float = value("length", "displacement of the float")
    float_bend: float = value("length", "largest deviation of its underside from a straight line")
    float_clearance: float = value("length", "least thickness of the film below the float")
    float_grid_error: float = value(
        "length", "error of its end place, estimated from half the cells"
    )
    energy_error: float = value("share", "error of the work balance, relative to the dissipation")
    momentum_error: float = value(
        "share", "error of the push, relative to the float's largest forces"
    )


class OverCoils(SIStudy):
    """A film of magnetic fluid over a row of coils, with or without a float on it."""

    remedy: ClassVar[str]
    """What to change if a simulation fails."""

    coils: Coils = entry("the row", default=Coils)
    fluid: ViscousFluid = entry("the fluid")
    film: Film = entry("the film")
    cargo: Cargo | None = entry("a float on the film", default=None)
    grid: Cells = entry("resolution", default=Cells)
    gravity: float = positive("acceleration", "acceleration of gravity", default=9.80665)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.film.faults_in(self.coils)
        if self.cargo:
            yield from self.cargo.faults_in(self.coils, self.film, self.fluid, self.gravity)

    def layer_of(self, per_pitch: int) -> Layer:
        """Return the film, with an even number of cells so that half as many fit."""
        film, pitch = self.film, self.coils.pitch
        length = self.coils.row.places[-1] + 2 * film.overhang
        cells = 2 * max(math.ceil(length / pitch * per_pitch / 2 - 1e-9), 5)
        fluid = self.fluid.under(self.gravity)
        return Layer(fluid, self.fluid.viscosity, film.depth, length, cells, start=-film.overhang)

    def setup(self, layer: Layer) -> FilmSetup:
        """Return film, row and float, with the cells of a layer."""
        body, start = (self.cargo.on(layer), self.cargo.start) if self.cargo else (None, 0.0)
        return FilmSetup(
            layer, self.coils.row, self.film.ground, self.film.highest, self.film.own_field, body,
            start,
        )  # fmt: skip

    @cached_property
    def layer(self) -> Layer:
        """The film in all its cells."""
        return self.layer_of(self.grid.cells)

    @cached_property
    def field(self) -> RowField:
        """Field of the row over the film; SceneError if it is not resolved there."""
        try:
            return row_field(self.coils.row, self.layer, self.film.ground, self.film.highest)
        except ArgumentError as error:
            raise self.too_near(error) from None

    def too_near(self, error: ArgumentError) -> SceneError:
        """Return the error for a winding so near that its field is not resolved."""
        return SceneError(self.name, [("film.ground", str(error))])

    # -- motions: of a kind ------------------------------------------------------------------------

    @cached_property
    def currents(self) -> Gait:
        """Ampere-turns of the coils over time."""
        raise NotImplementedError

    @cached_property
    def times(self) -> np.ndarray:
        """Times at which states are kept, in s."""
        raise NotImplementedError

    @stage
    def motion(self) -> Trajectory:
        return self.follow(self.currents, self.layer, self.grid.tolerance)

    @stage
    def half_the_cells(self) -> Trajectory:
        return self.follow(self.currents, self.half, self.grid.tolerance)

    @stage
    def smaller_steps(self) -> Trajectory:
        return self.follow(self.currents, self.half, self.grid.tolerance / 10)

    @property
    def half(self) -> Layer:
        """The film in half the cells."""
        return replace(self.layer, cells=self.layer.cells // 2)

    def follow(self, currents: Gait, layer: Layer, tolerance: float) -> Trajectory:
        """Return the motion in the cells of a layer; a SolveError has the motion so far."""
        _ = self.field  # SceneError if it is not resolved
        try:
            setup = self.setup(layer)
            return simulate_film(setup, currents, self.times, tolerance, self.report)
        except SolveError as error:
            reason = f"the film cannot be simulated to the end: {error.reason}"
            raise SolveError(reason, self.remedy, error.partial, error.code) from None

    # -- the film ----------------------------------------------------------------------------------

    @array("time", "time", "time", name="time")
    def instants(self) -> np.ndarray:
        return self.motion.time

    @array("length", "x", "position along the row")
    def x(self) -> np.ndarray:
        return self.layer.places

    @array("length", "time x", "thickness of the film")
    def thickness(self) -> np.ndarray:
        return self.motion["thickness"].T

    @array("length", "coil", "position of the coil")
    def coil_place(self) -> np.ndarray:
        return self.coils.row.places

    @array("ampere_turns", "time coil", "ampere-turns")
    def current(self) -> np.ndarray:
        return self.currents(np.mod(self.instants, self.currents.period)).T

    @array("length", "time", "position of the float's middle", when="cargo")
    def float_position(self) -> np.ndarray:
        return self.motion["position"][0]

    @scalar("length", "largest thickness")
    def thickness_max(self) -> float:
        return float(self.thickness.max())

    @scalar("length", "least thickness")
    def thickness_min(self) -> float:
        return float(self.thickness.min())

    @check(1e-10, "{value:.2g} of the volume is lost")
    def volume(self) -> float:
        return float(np.abs(self.thickness.mean(axis=1) / self.layer.depth - 1).max())

    @property
    def highest(self) -> float:
        """Largest thickness accepted, in m."""
        return self.film.highest

    @check(
        "highest",
        "the film reaches a thickness of {value:.3g}, above film.top times film.depth = "
        "{limit:.3g}, up to which the field is resolved; raise film.top",
        "length",
    )
    def top(self) -> float:
        return self.thickness_max

    @attributes
    def sizes(self) -> dict[str, Any]:
        """Sizes that pictures draw to scale."""
        row, body = {"pitch": self.coils.pitch}, self.cargo
        return row | (
            {"float": {"length": body.length, "thickness": body.thickness}} if body else {}
        )

    # -- the float ---------------------------------------------------------------------------------

    @property
    def body(self) -> Float:
        """The float, where there is one."""
        assert self.cargo
        return self.cargo.on(self.layer)

    @parts(FloatNumbers, when="cargo")
    def float_numbers(self) -> FloatNumbers:
        return float_numbers(self.layer, self.body, self.motion, self.half_the_cells)

    @check(
        0.1,
        "half the cells change the float's end by {value:.2g} of its length; raise grid.cells",
        when="cargo",
    )
    def float_on_half_the_cells(self) -> float:
        return 3 * self.float_numbers.float_grid_error / self.body.length

    @check(
        0.01,
        "energy is not balanced; the error is {value:.2g} of the dissipation; lower grid.tolerance",
        when="cargo",
    )
    def energy(self) -> float:
        return self.float_numbers.energy_error

    @check(
        0.1,
        "the forces on film and float differ by {value:.2g}; raise grid.cells or cargo.edge",
        when="cargo",
    )
    def momentum(self) -> float:
        return self.float_numbers.momentum_error

    @property
    def left_below(self) -> float:
        """Share of the depth that is left below the float."""
        return self.float_numbers.float_clearance / self.layer.depth

    @check(
        1.0,
        "{left_below:.2g} of the film's depth is left below the float: it touches the ground; "
        "lower cargo.density or cargo.thickness, or raise film.depth",
        when="cargo",
    )
    def afloat(self) -> float:
        return _AFLOAT / max(self.left_below, 1e-300)

    def warnings_of_float(self) -> Iterator[str]:
        """Yield assumptions about the float, and warnings near its limits."""
        if self.cargo is None:
            return
        yield (
            "the float spans the trough from side to side, its whole underside lies on the film, "
            "and its vertical inertia is neglected"
        )
        share = self.float_numbers.draught / self.film.depth
        if share > _HEAVY:
            yield left_out(share, f"the float presses the film down by {share:.2g} of its depth")
        if self.cargo.stiffness > self.body.stiffness:
            modulus = 12 * self.body.stiffness / self.cargo.thickness**3
            yield (
                "the float counts as rigid: a load as high as the film's depth would bend it by "
                "less than a hundredth of the depth, and it is computed with "
                f"cargo.youngs_modulus = {modulus:.2g} Pa"
            )


def float_numbers(layer: Layer, body: Float, motion: Trajectory, rough: Trajectory) -> FloatNumbers:
    """Return numbers of a float's motion; `rough` is the motion on half the cells."""
    X, h = motion["position"][0], motion["thickness"]
    work, lost, energy = (motion[name][0] for name in ("field_work", "dissipated", "energy"))
    push, pressed, shear = (motion[name][0] for name in ("push", "pressed", "shear"))
    below = np.abs(layer.places[:, None] - X) <= max(body.length, 1.01 * layer.step) / 2
    # nothing moves yet at time 0
    forces = max(float(np.abs(push).max() + np.abs(shear).max()), 1e-300)
    gap = np.abs(energy - energy[0] - work + lost)
    return FloatNumbers(
        draught=body.mass / layer.fluid.density / body.length,
        float_travel=float(X[-1] - X[0]),
        float_bend=max(_bend(layer.places[on], z[on]) for z, on in zip(h.T, below.T, strict=True)),
        float_clearance=float(h[below].min()),
        float_grid_error=float(abs(rough["position"][0, -1] - X[-1]) / 3),
        energy_error=float(gap.max() / max(lost[-1], 1e-300)),
        momentum_error=float(np.abs(push - pressed)[1:].max() / forces),
    )


def _bend(x: np.ndarray, z: np.ndarray) -> float:
    if len(x) < 3:
        return 0.0
    return float(np.abs(z - np.polyval(np.polyfit(x - x[0], z, 1), x - x[0])).max())
