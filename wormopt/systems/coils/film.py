"""A film of magnetic fluid over a row of coils as a Model, with and without a float; SI units.

The film h(x, t) lies on flat ground at z = 0. For small slopes the momentum balance across the film
leaves P = p + rho g z - mu0 int M dH constant from ground to surface, so that

    h_t + Q_x = 0,   Q = -h³ / (3 eta) P_x,   P = rho g h - gamma h'' / (1 + h'²)^(3/2) - pull,

where `pull` is the total pull on the surface: mu0 int M dH + mu0 M_n² / 2 of a field, less the
pressure of a float. M along H leaves no tangential stress on the surface. P is minus `balance` of
`wormopt.magnetics.hydrostatics` times the weight per volume: at rest the surface is that of kind
"coil-pressure".

The film is computed in finite volumes of second order: h in equal cells, Q on the faces between
them with the mobility

    (h_r - h_l) / int_l^r 3 eta dh / h³ = 2 h_l² h_r² / (3 eta (h_l + h_r)),

which dissipates the entropy int int 3 eta / h³ as the equation does, and keeps the film positive
(Zhornitskaya and Bertozzi, SIAM J. Numer. Anal. 37, 2000). The state is the volume to the left of
each face, so the total volume is always conserved. Pressures are derivatives of an energy, so that
flow dissipates exactly the energy that is lost.

A float is coupled both ways. It spans the film across. Its weight presses on the film. It resists
bending, keeps the surface from stretching, and moves the fluid at the surface with its own velocity
V. With its coverage c, 1 below it and 0 beside it, and G = P_x, Onsager's principle (least sum of
dissipation and rate of energy) gives

    Q = -h³ / (3 eta) (1 - 3/4 c) G + c h V / 2,
    m V' = -dE/dX - int c (eta V / h + h G / 2) dx,

where E is the energy of film and float, which loses what is dissipated,

    dE/dt = int pull h_t dx - int [h³ / (3 eta) (1 - 3/4 c) G² + c eta V² / h] dx,

The balance is exact in the cells too. Where c is between 0 and 1, at the ends, fluid slips along
the float.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.hydrostatics import Fluid, flat_field, pull
from wormopt.magnetics.material import check_number
from wormopt.model.model import Model, Output, Signal
from wormopt.model.values import numbers

Ends = Literal["walls", "periodic"]
Pull = Callable[[ca.SX, ca.SX], Any]
"""Function of (h, h') in the cells, in m and 1: the pull on the surface there, in Pa."""

_FEWEST = 5


@dataclass(frozen=True)
class Layer:
    """A film of magnetic fluid on flat ground, divided into equal cells.

    Raises ArgumentError if a value is not above 0, or cells are too few.
    """

    fluid: Fluid
    viscosity: float  # Pa s
    depth: float  # mean thickness, m
    length: float  # along x, m
    cells: int
    start: float = 0.0  # x of the film's left end, m
    ends: Ends = "walls"  # upright walls without flow through them; or a periodic film

    def __post_init__(self) -> None:
        for name in ("viscosity", "depth", "length"):
            check_number(name, getattr(self, name))
        if self.ends not in get_args(Ends):
            raise ArgumentError(f'no ends "{self.ends}"; there are {", ".join(get_args(Ends))}')
        if self.cells < _FEWEST:
            raise ArgumentError(f"{self.cells} cells are too few; give at least {_FEWEST}")

    @property
    def step(self) -> float:
        """Width of a cell, in m."""
        return self.length / self.cells

    @property
    def places(self) -> np.ndarray:
        """Middles of the cells, shape (cells,), in m."""
        return self.start + self.step * (np.arange(self.cells) + 0.5)

    def volume(self, thickness: ArrayLike) -> np.ndarray:
        """Return the state of a film (m³ per metre across) from thickness (m) in the cells.

        Raises ArgumentError if it is not positive in each cell, or its mean not the depth.
        """
        h = np.broadcast_to(numbers("thickness", thickness), (self.cells,))
        if not np.all(h > 0):
            raise ArgumentError("the thickness must be above 0 in every cell")
        if abs(h.mean() / self.depth - 1) > 1e-9:
            raise ArgumentError(f"the mean thickness is {h.mean():g} m, not {self.depth:g} m")
        return self.step * np.cumsum(h - self.depth)[:-1]

    def thickness(self, volume: ca.SX) -> ca.SX:
        """Return the thickness in the cells, (cells,), of a state (cells - 1,)."""
        whole = ca.vertcat(0, volume, 0)
        return self.depth + (whole[1:] - whole[:-1]) / self.step

    def slope(self, h: ca.SX) -> ca.SX:
        """Return the slope h' in the cells; walls are mirrors."""
        left, right = self.beside(h)
        return (right - left) / (2 * self.step)

    def beside(self, values: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the values in the cells to the left and to the right of each."""
        first, last = values[0], values[-1]
        if self.ends == "periodic":
            first, last = last, first
        return ca.vertcat(first, values[:-1]), ca.vertcat(values[1:], last)

    def energy(self, h: ca.SX, covered: Any = 0.0) -> ca.SX:
        """Return the energy of weight and surface, in J per metre across, above that of flat cells.

        `covered`: share of the surface that is covered, on the faces right of the cells.
        """
        rise = (self.beside(h)[1] - h) / self.step
        stretched = rise * rise / (1 + (1 + rise * rise) ** 0.5)
        surface = self.fluid.surface_tension * (1 - covered) * stretched
        return self.step * ca.sum1(self.fluid.weight * h * h / 2 + surface)

    def faces(self, cells: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the values left and right of each face, both ends included."""
        if self.ends == "periodic":
            cells = ca.vertcat(cells[-1], cells, cells[0])
        return cells[:-1], cells[1:]

    def ended(self, flow: ca.SX) -> ca.SX:
        """Return the flow on all faces, from that on those of `faces`."""
        return flow if self.ends == "periodic" else ca.vertcat(0, flow, 0)

    def mobility(self, h: ca.SX) -> ca.SX:
        """Return the flow at a pressure gradient of -1, in m⁴/(N s)."""
        low, high = self.faces(h)
        return 2 * low**2 * high**2 / (3 * self.viscosity * (low + high))

    def gradient(self, P: ca.SX) -> ca.SX:
        """Return the pressure gradient on the faces."""
        left, right = self.faces(P)
        return (right - left) / self.step


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
        away = (x if isinstance(x, ca.SX) else ca.DM(x)) - X
        if layer.ends == "periodic":
            away = away - layer.length * ca.floor(away / layer.length + 0.5)
        return ca.fmin(ca.fmax((self.length / 2 - ca.fabs(away)) / self.fade + 0.5, 0), 1)

    def coverage(self, layer: Layer, x: Any, X: Any) -> Any:
        """Return the share of the surface at x (m) that a float with its middle at X covers."""
        u = self.within(layer, x, X)
        return u**3 * (10 - 15 * u + 6 * u * u)

    def energy(self, layer: Layer, h: ca.SX, X: ca.SX) -> ca.SX:
        """Return the energy of weight, bending, and end walls, in J per metre across."""
        return self.stored(layer, h, X) + self.stopped(layer, X)

    def stored(self, layer: Layer, h: ca.SX, X: ca.SX) -> ca.SX:
        """Return the energy of weight and bending, in J per metre across."""
        covered = self.coverage(layer, layer.places, X)
        stiffness = self.stiffness * _tapered(self.within(layer, layer.places, X))
        left, right = layer.beside(h)
        bend = (right - 2 * h + left) / layer.step**2
        load = self.mass / self.length * layer.fluid.gravity
        stored = load * covered * (h - layer.depth) + stiffness * bend * bend / 2
        return layer.step * ca.sum1(stored)

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
    passed, shear, lost = dragged(layer, cargo, h, X, V, layer.gradient(by_h / layer.step - pull))
    flow = layer.ended(passed)
    # a shift of film and float together along x changes the energy by the force on the walls
    borne = layer.fluid.weight * (h[-1] ** 2 - h[0] ** 2) / 2
    stop = -ca.gradient(cargo.stopped(layer, X), X)
    area, length, speed, energies = sizes_of(layer, cargo)
    spent = partial(Signal, unit="energy_per_width", nominal=energies, value=0.0)
    return Model(
        "float on a film over coils",
        x=[
            Signal("volume", volume, "area", nominal=area, value=0.0),
            Signal("position", X, "length", nominal=length),
            Signal("velocity", V, "speed", nominal=speed, value=0.0),
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


def sizes_of(layer: Layer, cargo: Float) -> tuple[float, float, float, float]:
    """Return nominal sizes of volumes, positions, velocities, and works."""
    heap = _heap(layer, cargo.length)
    speed = heap * layer.depth**2 / (3 * layer.viscosity * cargo.length)
    return layer.depth * layer.step, cargo.length, speed, heap * layer.depth * cargo.length


def dragged(
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
    """Return the share of the stiffness at a share 0 to 1 of the taper, from the tip."""
    # The end of a stiff float makes a kink of the surface up to about B u⁹ = gamma (f u)². Few
    # powers start as gently and spread that kink over more of the end f.
    return u**9 * (55 - 99 * u + 45 * u * u)


def rigid(layer: Layer, length: float) -> float:
    """Return the stiffness in N m above which a float, carried at its ends, hardly bends."""
    return 5 / 384 * _heap(layer, length) * length**4 / (_RIGID * layer.depth)


def _heap(layer: Layer, length: float) -> float:
    """Return the pressure of a heap as high as the film is deep, and of this length, in Pa."""
    fluid = layer.fluid
    return layer.depth * (fluid.weight + fluid.surface_tension / length**2)


_DEGREES = (4, 8, 10, 14, 24)
_RESOLVED, _ROUNDING = 1e-7, 1e-12


def surface_film(
    layer: Layer,
    drawn: Pull,
    *,
    u: Sequence[Signal] = (),
    p: Sequence[Signal] = (),
    t: ca.SX | None = None,
) -> Model:
    """Return the Model of a film whose surface a pressure draws up.

    `drawn` may hold the symbols of `u`, `p` and `t`. The state is ``volume`` (cells - 1), 0 for a
    flat film; outputs are ``thickness`` in the cells and ``flow`` Q on the faces, from the left.
    """
    volume = ca.SX.sym("volume", layer.cells - 1)
    h, known = layer.thickness(volume), ca.SX.sym("h", layer.cells)
    restoring = ca.Function("P", [known], [ca.gradient(layer.energy(known), known) / layer.step])
    P = restoring(h) - drawn(h, layer.slope(h))
    flow = layer.ended(-layer.mobility(h) * layer.gradient(P))
    return Model(
        "film over coils",
        x=[Signal("volume", volume, "area", nominal=layer.depth * layer.step, value=0.0)],
        ode=flow[0] - flow[1:-1],
        u=u,
        p=p,
        t=ca.SX.sym("t") if t is None else t,
        outputs=[Output("thickness", h, "length"), Output("flow", flow, "flow_per_width")],
    )


@dataclass(frozen=True, eq=False)
class RowField:
    """Field of a row of coils over a film: polynomials in z in the middle of each cell."""

    series: np.ndarray  # (3, degree + 1, cells, coils) Chebyshev coefficients over [0, top], 1/m
    top: float  # largest height of their validity, m

    def __call__(self, z: Any, currents: Any) -> list[Any]:
        """Return components (cells,) of H, in A/m, at heights (cells,) above the ground."""
        return self.by_terms(z, self.terms(currents))

    def terms(self, currents: Any) -> Any:
        """Return the coefficients of all polynomials that are not 0, under currents (coils, ...).

        Currents are few and coefficients many: simulations take coefficients of each piece of
        time, not a sum over the coils in every evaluation.
        """
        kept = self.series[self._present].reshape(-1, self.series.shape[-1])
        if isinstance(currents, ca.SX):
            return ca.mtimes(ca.DM(kept), currents)
        return np.tensordot(kept, currents, 1)

    def by_terms(self, z: Any, terms: Any) -> list[Any]:
        """Return the components of `__call__`, from the coefficients."""
        _, count, cells, _ = self.series.shape
        place, first, found = 2 * z / self.top - 1, 0, []
        for present in self._present:
            rows = range(first, first + (count * cells if present else 0), cells)
            found.append(_clenshaw([terms[k : k + cells] for k in rows], place))
            first = rows.stop
        return found

    @property
    def _present(self) -> np.ndarray:
        """Which components are not 0."""
        return np.array([part.any() for part in self.series])


def _clenshaw(terms: Sequence[Any], place: Any) -> Any:
    """Return the Chebyshev series with coefficients `terms`, from degree 0 on, at `place`."""
    one, two = 0.0 * place, 0.0 * place
    for term in terms[:0:-1]:
        one, two = 2 * place * one - two + term, one
    return place * one - two + terms[0] if terms else one


@lru_cache(maxsize=4)
def row_field(row: CoilRow, layer: Layer, ground: float, top: float) -> RowField:
    """Return the field of a row whose coils' middles lie `ground` (m) below the film's ground.

    `top`: largest thickness needed, m. Raises ArgumentError if a winding is there, or so near that
    a polynomial of degree 24 does not represent the field to 1e-7 of the largest.
    """
    for degree in _DEGREES:
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        x, z = np.meshgrid(layer.places, ground + top * (nodes + 1) / 2)
        values = row.influence(x.ravel(), z.ravel()).reshape(3, degree + 1, -1)
        weights = np.linalg.inv(chebyshev.chebvander(nodes, degree))
        series = np.einsum("jk,ckm->cjm", weights, values)
        sizes = np.abs(series).max(axis=(1, 2))
        if np.abs(series[:, -2:]).max() <= _RESOLVED * sizes.max():
            series[sizes <= _ROUNDING * sizes.max()] = 0.0  # components that vanish by symmetry
            return RowField(series.reshape(3, degree + 1, layer.cells, row.count), top)
    raise ArgumentError(
        "a winding is so near to the film that its field is not resolved there; give a ground "
        f"farther from the coils, or a film that reaches less than {top:g} m above it"
    )


def coil_film(
    layer: Layer,
    row: CoilRow,
    *,
    ground: float,
    top: float,
    own_field: bool = True,
    cargo: Float | None = None,
) -> Model:
    """Build the Model of a film over a row of coils, with their currents as input.

    The first coil is at x = 0; the `ground` under the film is above the middle of the coils or of
    their gap, and the field is resolved up to the largest thickness `top`. The state is ``volume``
    to the left of the faces between cells, less that of a flat film; the input is ``current``,
    ampere-turns of each coil; outputs are ``thickness`` in the cells and ``flow`` (Q) on the faces.
    A float adds those of `floated_film`. With `own_field` the fluid reduces the field across it, as
    in a flat layer. ArgumentError if a winding is in the film, or too near to it.
    """
    if not (math.isfinite(ground) and top > layer.depth):
        raise ArgumentError("ground must be finite, and top above the depth")
    field, current = row_field(row, layer, ground, top), ca.SX.sym("current", row.count)
    given = Signal("current", current, "ampere_turns", value=0.0)
    return _film_by_terms(layer, field, given, field.terms(current), cargo, own_field=own_field)


def _film_by_terms(
    layer: Layer,
    field: RowField,
    given: Signal,
    terms: ca.SX,
    cargo: Float | None,
    *,
    own_field: bool,
) -> Model:
    """Return the Model of `coil_film` with the input `given`, on which coefficients depend."""

    def drawn(h: ca.SX, slope: ca.SX) -> Any:
        return surface_pull(layer.fluid, field.by_terms(h, terms), slope, own_field=own_field)

    if cargo:
        return floated_film(layer, drawn, cargo, u=[given])
    return surface_film(layer, drawn, u=[given])


@dataclass(frozen=True)
class FilmSetup:
    """A film over a row of coils, with or without a float, that starts flat and at rest."""

    layer: Layer
    row: CoilRow
    ground: float  # m
    top: float  # m
    own_field: bool
    cargo: Float | None
    start: float  # initial position of the float, m

    def model(self) -> Model:
        """Return the Model, with the currents as input."""
        return coil_film(
            self.layer, self.row, ground=self.ground, top=self.top, own_field=self.own_field,
            cargo=self.cargo,
        )  # fmt: skip

    @property
    def field(self) -> RowField:
        """Field of the row."""
        return row_field(self.row, self.layer, self.ground, self.top)

    def model_by_terms(self) -> Model:
        """Return the Model with `terms` of the field as input, evaluated several times faster."""
        terms = ca.SX.sym("terms", len(self.field.terms(np.zeros(self.row.count))))
        given = Signal("terms", terms, "magnetic_field", value=0.0)
        return _film_by_terms(
            self.layer, self.field, given, terms, self.cargo, own_field=self.own_field
        )


def surface_pull(fluid: Fluid, H: Sequence[Any], slope: Any, *, own_field: bool) -> Any:
    """Return the pull of a field with components x, y, z (A/m) outside on a surface, in Pa."""
    along, across, up = inside_field(fluid, H, slope, own_field=own_field)
    return pull(fluid, (along, up), 0.0, across)


def inside_field(fluid: Fluid, H: Sequence[Any], slope: Any, *, own_field: bool) -> tuple[Any, ...]:
    """Return the field (A/m) in the fluid: along its surface, along y, and across the surface.

    `H`: components x, y, z outside; `own_field`: whether the component across is reduced.
    """
    if own_field:
        return flat_field(fluid.magnetisation, H, slope)
    along, y, up = H
    root = (1 + slope * slope) ** 0.5
    return (along + slope * up) / root, y, (up - slope * along) / root
