"""A film of magnetic fluid over a row of coils, as a Model: lubrication in SI units.

The film h(x, t) lies on flat ground at z = 0. In the limit of small slopes the momentum law up the
film leaves P = p + rho g z - mu0 int M dH the same from ground to surface, so that

    h_t + Q_x = 0,   Q = -h³ / (3 eta) P_x,   P = rho g h - gamma h'' / (1 + h'²)^(3/2) - pull,

where `pull` is all that draws the surface up: mu0 int M dH + mu0 M_n² / 2 of a field, less what
lies on it. M along H leaves no tangential stress on the surface. P is minus `balance` of
`wormopt.magnetics.hydrostatics` times the weight per volume: at rest the surface is that of kind
"coil-pressure".

Finite volumes of second order: h in equal cells, Q on the faces between them with the mobility

    (h_r - h_l) / int_l^r 3 eta dh / h³ = 2 h_l² h_r² / (3 eta (h_l + h_r)),

by which the entropy int int 3 eta / h³ is dissipated as in the equation itself, and which keeps
the film positive (Zhornitskaya and Bertozzi, SIAM J. Numer. Anal. 37, 2000). The state is the
volume to the left of each face, so that no volume is lost whatever it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.hydrostatics import Fluid, balance, pull
from wormopt.magnetics.material import check_number
from wormopt.magnetics.ripples import flat_field
from wormopt.model.model import Model, Output, Signal
from wormopt.model.values import numbers

Ends = Literal["walls", "periodic"]
Pull = Callable[[ca.SX, ca.SX], Any]
"""(h, h') in the cells, in m and 1, to what draws the surface up there, in Pa."""

_FEWEST = 5
_DEGREES = (4, 8, 10, 14, 24)
_RESOLVED = 1e-7


@dataclass(frozen=True)
class Layer:
    """A film of magnetic fluid on flat ground, cut into equal cells.

    Raises ArgumentError if a number is not above 0, or cells are too few.
    """

    fluid: Fluid
    viscosity: float  # Pa s
    depth: float  # mean thickness, m
    length: float  # along x, m
    cells: int
    start: float = 0.0  # where the film begins, x in m
    ends: Ends = "walls"  # upright walls, no flow through them; or the film repeats

    def __post_init__(self) -> None:
        for name in ("viscosity", "depth", "length"):
            check_number(name, getattr(self, name))
        if self.ends not in get_args(Ends):
            raise ArgumentError(f'no ends "{self.ends}"; there are {", ".join(get_args(Ends))}')
        if self.cells < _FEWEST:
            raise ArgumentError(f"{self.cells} cells are too few; take at least {_FEWEST}")

    @property
    def step(self) -> float:
        """Width of a cell, in m."""
        return self.length / self.cells

    @property
    def places(self) -> np.ndarray:
        """Middles of the cells, shape (cells,), in m."""
        return self.start + self.step * (np.arange(self.cells) + 0.5)

    def volume(self, thickness: ArrayLike) -> np.ndarray:
        """State of a film (m³ per metre across) of given thickness (m) in the cells.

        Raises ArgumentError if it is not positive in each cell, or its mean not the depth.
        """
        h = np.broadcast_to(numbers("thickness", thickness), (self.cells,))
        if not np.all(h > 0):
            raise ArgumentError("the thickness must be above 0 in every cell")
        if abs(h.mean() / self.depth - 1) > 1e-9:
            raise ArgumentError(f"the mean thickness is {h.mean():g} m, not {self.depth:g} m")
        return self.step * np.cumsum(h - self.depth)[:-1]


def surface_film(
    layer: Layer,
    drawn: Pull,
    *,
    u: Sequence[Signal] = (),
    p: Sequence[Signal] = (),
    t: ca.SX | None = None,
) -> Model:
    """Model of a film whose surface is drawn up by a pressure.

    `drawn` may hold the symbols of `u`, `p` and `t`. State ``volume`` (cells - 1), 0 for a flat
    film; outputs ``thickness`` in the cells and ``flow`` Q on the faces, from the left end on.
    """
    volume = ca.SX.sym("volume", layer.cells - 1)
    whole = ca.vertcat(0, volume, 0)
    h = layer.depth + (whole[1:] - whole[:-1]) / layer.step
    left, right = _beside(h, layer.ends)
    slope = (right - left) / (2 * layer.step)
    bend = ((right - h) - (h - left)) / layer.step**2
    # the pull goes into P by itself, so that `drawn` may be more than a field's
    P = -layer.fluid.weight * balance(layer.fluid, (0.0, 0.0), h, slope, bend, 0.0)
    P = P - drawn(h, slope)
    flow = _flow(layer, h, P)
    return Model(
        "film over coils",
        x=[Signal("volume", volume, "area", nominal=layer.depth * layer.step, value=0.0)],
        ode=flow[0] - flow[1:-1],
        u=u,
        p=p,
        t=ca.SX.sym("t") if t is None else t,
        outputs=[Output("thickness", h, "length"), Output("flow", flow, "flow_per_width")],
    )


def _beside(values: ca.SX, ends: Ends) -> tuple[ca.SX, ca.SX]:
    """Values in the cells to the left and to the right; walls are mirrors."""
    first, last = values[0], values[-1]
    if ends == "periodic":
        first, last = last, first
    return ca.vertcat(first, values[:-1]), ca.vertcat(values[1:], last)


def _flow(layer: Layer, h: ca.SX, P: ca.SX) -> ca.SX:
    """Q on all faces, both ends included."""
    if layer.ends == "periodic":
        h, P = ca.vertcat(h[-1], h, h[0]), ca.vertcat(P[-1], P, P[0])
    low, high = h[:-1], h[1:]
    mobility = 2 * low**2 * high**2 / (3 * layer.viscosity * (low + high))
    inner = -mobility * (P[1:] - P[:-1]) / layer.step
    return inner if layer.ends == "periodic" else ca.vertcat(0, inner, 0)


@dataclass(frozen=True, eq=False)
class RowField:
    """Field of a row of coils over a film: polynomials in z in the middle of each cell."""

    series: np.ndarray  # (3, degree + 1, cells, coils) Chebyshev coefficients over [0, top], 1/m
    top: float  # up to which they hold, m

    def __call__(self, z: Any, currents: Any) -> list[Any]:
        """Components (cells,) of H, in A/m, at heights (cells,) above the ground."""
        place = 2 * z / self.top - 1
        return [self._sum(part, place, currents) for part in self.series]

    def _sum(self, part: np.ndarray, place: Any, currents: Any) -> Any:
        if not part.any():
            return 0 * place
        symbolic = isinstance(currents, ca.SX)
        terms = [ca.mtimes(ca.DM(c), currents) if symbolic else c @ currents for c in part]
        # Clenshaw's rule
        one, two = 0.0 * place, 0.0 * place
        for term in terms[:0:-1]:
            one, two = 2 * place * one - two + term, one
        return place * one - two + terms[0]


@lru_cache(maxsize=4)
def row_field(row: CoilRow, layer: Layer, ground: float, top: float) -> RowField:
    """Field of a row whose coils' middles lie `ground` (m) below the film's ground.

    `top`: greatest thickness at which it is wanted, m. Raises ArgumentError if a winding is there,
    or so near that a polynomial of degree 24 does not hold the field to 1e-7 of the largest.
    """
    for degree in _DEGREES:
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        x, z = np.meshgrid(layer.places, ground + top * (nodes + 1) / 2)
        values = row.influence(x.ravel(), z.ravel()).reshape(3, degree + 1, -1)
        weights = np.linalg.inv(chebyshev.chebvander(nodes, degree))
        series = np.einsum("jk,ckm->cjm", weights, values)
        if np.abs(series[:, -2:]).max() <= _RESOLVED * np.abs(series).max():
            return RowField(series.reshape(3, degree + 1, layer.cells, row.count), top)
    raise ArgumentError("a winding is so near to the film that its field is not resolved there")


def coil_film(
    layer: Layer, row: CoilRow, *, ground: float, top: float, own_field: bool = True
) -> Model:
    """Model of a film over a row of coils, with their currents as input.

    Parameters
    ----------
    layer : Layer
        The film and its cells.
    row : CoilRow
        The coils, the first at x = 0.
    ground : float
        Height of the ground under the film above the middle of the coils or of their gap, in m.
    top : float
        Greatest thickness that is looked for, in m; the field is resolved up to it.
    own_field : bool, optional
        Whether the fluid weakens the field across it, as a flat layer does.

    Returns
    -------
    Model
        State ``volume`` to the left of the faces between cells, less that of a flat film; input
        ``current``, ampere-turns of each coil; outputs ``thickness`` in the cells, ``flow`` (Q)
        on the faces.

    Raises
    ------
    ArgumentError
        If a winding is in the film, or too near to it.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.magnetics.hydrostatics import Fluid, Linear
    >>> from wormopt.systems.coils.film import Layer, coil_film
    >>> row = wo.magnetics.CoilRow(
    ...     wo.magnetics.Coil(2e-3, 4.5e-3, 5e-3), count=2, pitch=10e-3, axis="vertical"
    ... )
    >>> layer = Layer(Fluid(1200.0, 0.03, Linear(0.35)), 0.05, 1e-3, 0.03, 30, start=-0.01)
    >>> film = coil_film(layer, row, ground=5e-3, top=3e-3)
    >>> motion = wo.simulate(film, 0.1, p={"current": [200.0, 0.0]}, route="cvodes")
    >>> bool(motion["thickness"][:, -1].argmax() == 9)
    True
    """
    if not (math.isfinite(ground) and top > layer.depth):
        raise ArgumentError("ground must be finite, and top above the depth")
    field = row_field(row, layer, ground, top)
    current = ca.SX.sym("current", row.count)

    def drawn(h: ca.SX, slope: ca.SX) -> Any:
        H = field(h, current)
        return surface_pull(layer.fluid, H, slope, own_field=own_field)

    return surface_film(layer, drawn, u=[Signal("current", current, "ampere_turns", value=0.0)])


def surface_pull(fluid: Fluid, H: Sequence[Any], slope: Any, *, own_field: bool) -> Any:
    """Pull of a field with components x, y, z (A/m) outside on a surface, in Pa."""
    along, across, up = inside_field(fluid, H, slope, own_field=own_field)
    return pull(fluid, (along, up), 0.0, across)


def inside_field(fluid: Fluid, H: Sequence[Any], slope: Any, *, own_field: bool) -> tuple[Any, ...]:
    """Field (A/m) in the fluid: along its surface, along y, and across the surface.

    `H`: components x, y, z outside; `own_field`: whether that across is weakened.
    """
    if own_field:
        return flat_field(fluid.magnetisation, H, slope)
    along, y, up = H
    root = (1 + slope * slope) ** 0.5
    return (along + slope * up) / root, y, (up - slope * along) / root
