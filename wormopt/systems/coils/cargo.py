"""A float on a film over coils as a Model: lubrication in SI units, coupled both ways.

The float spans the film across. Its weight presses on the film. It resists bending, keeps the
surface from stretching, and moves the fluid at the surface with its own velocity V. With its
coverage c, 1 below it and 0 beside it, and G = P_x, Onsager's principle (least sum of dissipation
and rate of energy) gives

    Q = -h³ / (3 eta) (1 - 3/4 c) G + c h V / 2,
    m V' = -dE/dX - int c (eta V / h + h G / 2) dx,

where E is the energy of film and float, which loses what is dissipated,

    dE/dt = int pull h_t dx - int [h³ / (3 eta) (1 - 3/4 c) G² + c eta V² / h] dx,

The balance is exact in the cells too. Where c is between 0 and 1, at the ends, fluid slips along
the float.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.coils.layer import Layer, Pull

_STOP = 1e3  # stiffness of the walls, in weights of fluid
_RIGID = 0.01  # of the depth: a float that a heap of fluid bends by less counts as rigid


@dataclass(frozen=True)
class Float:
    """A float, per metre across.

    Raises ArgumentError if a value is out of range.
    """

    length: float  # m
    mass: float  # kg/m
    stiffness: float = 0.0  # in bending, N m
    edge: float = 0.0  # length of its tapered ends, m; 0: two thirds of its length

    def __post_init__(self) -> None:
        for name in ("length", "mass"):
            check_number(name, getattr(self, name))
        for name in ("stiffness", "edge"):
            if getattr(self, name) != 0:
                check_number(name, getattr(self, name))
        if self.edge > self.length:
            raise ArgumentError(f"an edge of {self.edge:g} m is longer than the float")

    @property
    def fade(self) -> float:
        """Length of its tapered ends, in m."""
        return self.edge or 2 * self.length / 3

    def within(self, layer: Layer, x: Any, X: Any) -> Any:
        """Return the share of the taper from its tip, 0 to 1, at positions x (m), middle at X."""
        away = ca.DM(x) - X
        if layer.ends == "periodic":
            away = away - layer.length * ca.floor(away / layer.length + 0.5)
        return ca.fmin(ca.fmax((self.length / 2 - ca.fabs(away)) / self.fade + 0.5, 0), 1)

    def coverage(self, layer: Layer, x: Any, X: Any) -> Any:
        """Return the share of the surface at x (m) that a float with its middle at X covers."""
        u = self.within(layer, x, X)
        return u**3 * (10 - 15 * u + 6 * u * u)

    def energy(self, layer: Layer, h: ca.SX, X: ca.SX) -> ca.SX:
        """Return the energy of weight, bending, and end walls, in J per metre across."""
        covered = self.coverage(layer, layer.places, X)
        stiffness = self.stiffness * _tapered(self.within(layer, layer.places, X))
        left, right = layer.beside(h)
        bend = (right - 2 * h + left) / layer.step**2
        load = self.mass / self.length * layer.fluid.gravity
        stored = load * covered * (h - layer.depth) + stiffness * bend * bend / 2
        return layer.step * ca.sum1(stored) + self.stopped(layer, X)

    def stopped(self, layer: Layer, X: ca.SX) -> Any:
        """Return the energy of stiff end walls, in J per metre across."""
        if layer.ends == "periodic":
            return ca.SX(0)
        beyond = ca.fabs(X - layer.start - layer.length / 2) + (self.length - layer.length) / 2
        return _STOP * layer.fluid.weight * layer.depth * ca.fmax(beyond, 0) ** 2 / 2


def floated_film(
    layer: Layer,
    drawn: Pull,
    cargo: Float,
    *,
    u: Sequence[Signal] = (),
    p: Sequence[Signal] = (),
    t: ca.SX | None = None,
) -> Model:
    """Return the Model of a film with a float on it, whose surface a pressure draws up.

    `drawn` may hold the symbols of `u`, `p` and `t`. States are ``volume``, ``position`` of the
    float's middle, its ``velocity``, and, since the start, ``field_work`` and ``dissipated``.
    Outputs are ``thickness``, ``flow``, ``energy`` (without that of the field), the forces
    ``shear`` and ``push`` on the float, and ``pressed``, which is ``push`` from the film's balance.
    """
    volume = ca.SX.sym("volume", layer.cells - 1)
    X, V = ca.SX.sym("position"), ca.SX.sym("velocity")
    h = layer.thickness(volume)
    energy, by_h, by_X = _energy(layer, cargo, h, X)
    pull, slope = drawn(h, layer.slope(h)), layer.slope(h)
    passed, shear, lost = _dragged(layer, cargo, h, X, V, layer.gradient(by_h / layer.step - pull))
    flow = layer.ended(passed)
    # a shift of film and float together along x changes the energy by the force on the walls
    borne = layer.fluid.weight * (h[-1] ** 2 - h[0] ** 2) / 2
    stop = -ca.gradient(cargo.stopped(layer, X), X)
    heap = _heap(layer, cargo.length)
    spent = partial(
        Signal, unit="energy_per_width", nominal=heap * layer.depth * cargo.length, value=0.0
    )
    return Model(
        "float on a film over coils",
        x=[
            Signal("volume", volume, "area", nominal=layer.depth * layer.step, value=0.0),
            Signal("position", X, "length", nominal=cargo.length),
            Signal(
                "velocity",
                V,
                "speed",
                nominal=heap * layer.depth**2 / (3 * layer.viscosity * cargo.length),
                value=0.0,
            ),
            spent("field_work", ca.SX.sym("field_work")),
            spent("dissipated", ca.SX.sym("dissipated")),
        ],
        ode=ca.vertcat(
            flow[0] - flow[1:-1],
            V,
            (shear - by_X) / cargo.mass,
            ca.dot(pull, flow[:-1] - flow[1:]),
            lost,
        ),
        u=u,
        p=p,
        t=ca.SX.sym("t") if t is None else t,
        outputs=[
            Output("thickness", h, "length"),
            Output("flow", flow, "flow_per_width"),
            Output("energy", energy + cargo.mass * V * V / 2, "energy_per_width"),
            Output("shear", shear, "force_per_width"),
            Output("push", -by_X, "force_per_width"),
            Output("pressed", stop + borne - ca.dot(by_h, slope), "force_per_width"),
        ],
    )


def _dragged(
    layer: Layer, cargo: Float, h: ca.SX, X: ca.SX, V: ca.SX, G: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return flow on the faces, shear force of the fluid on the float, and dissipated power."""
    edges = layer.start + layer.step * np.arange(layer.cells + 1)
    widths = np.full(layer.cells + 1, layer.step)
    if layer.ends == "walls":
        edges, widths = edges[1:-1], widths[1:-1]
    else:  # the first face is the last
        widths[[0, -1]] /= 2
    c, (low, high) = cargo.coverage(layer, edges, X), layer.faces(h)
    thick = 2 * low * high / (low + high)
    mobility = layer.mobility(h) * (1 - 0.75 * c)
    drag = c * layer.viscosity * V / thick
    flow = -mobility * G + c * thick * V / 2
    shear = -ca.dot(ca.DM(widths), drag + c * thick * G / 2)
    return flow, shear, ca.dot(ca.DM(widths), mobility * G * G + drag * V)


def _energy(
    layer: Layer, cargo: Float, thickness: ca.SX, position: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the energy of film and float, and its derivatives by cell thickness and by X."""
    h, X = ca.SX.sym("h", layer.cells), ca.SX.sym("X")
    right = cargo.coverage(layer, layer.places + layer.step / 2, X)
    energy = layer.energy(h, right) + cargo.energy(layer, h, X)
    found = ca.Function("energy", [h, X], [energy, ca.gradient(energy, h), ca.gradient(energy, X)])
    values: Any = found(thickness, position)
    return values


def _tapered(u: Any) -> Any:
    """Return the share of the stiffness at a share 0 to 1 of the taper, from the tip.

    The end of a stiff float makes a kink of the surface up to about B u⁹ = gamma (f u)². Few powers
    start as gently and spread that kink over more of the end f.
    """
    return u**9 * (55 - 99 * u + 45 * u * u)


def rigid(layer: Layer, length: float) -> float:
    """Return the stiffness in N m above which a float, carried at its ends, hardly bends."""
    return 5 / 384 * _heap(layer, length) * length**4 / (_RIGID * layer.depth)


def _heap(layer: Layer, length: float) -> float:
    """Return the pressure of a heap as high as the film is deep, and of this length, in Pa."""
    fluid = layer.fluid
    return layer.depth * (fluid.weight + fluid.surface_tension / length**2)
