"""A film of magnetic fluid over a row of coils, as a Model: lubrication in SI units.

The film h(x, t) lies on flat ground at z = 0. For small slopes the momentum balance across the film
leaves P = p + rho g z - mu0 int M dH constant from ground to surface, so that

    h_t + Q_x = 0,   Q = -h³ / (3 eta) P_x,   P = rho g h - gamma h'' / (1 + h'²)^(3/2) - pull,

where `pull` is the total pull on the surface: mu0 int M dH + mu0 M_n² / 2 of a field, less the
pressure of a float. M along H leaves no tangential stress on the surface. P is minus `balance` of
`wormopt.magnetics.hydrostatics` times the weight per volume: at rest the surface is that of kind
"coil-pressure".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from wormopt.control.drive import drive
from wormopt.errors import ArgumentError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.hydrostatics import Fluid, flat_field, pull
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal
from wormopt.progress import Report
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.coils.cargo import Float, floated_film
from wormopt.systems.coils.layer import Layer, Pull

_DEGREES = (4, 8, 10, 14, 24)
_RESOLVED = 1e-7
_STEPS = 200_000


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
        if np.abs(series[:, -2:]).max() <= _RESOLVED * np.abs(series).max():
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

    Parameters
    ----------
    layer : Layer
        The film and its cells.
    row : CoilRow
        The coils, the first at x = 0.
    ground : float
        Height of the ground under the film above the middle of the coils or of their gap, in m.
    top : float
        Largest thickness expected, in m; the field is resolved up to it.
    own_field : bool, optional
        Whether the fluid reduces the field across it, as in a flat layer.
    cargo : Float, optional
        A float on the film.

    Returns
    -------
    Model
        The state is ``volume`` to the left of the faces between cells, less that of a flat film;
        the input is ``current``, ampere-turns of each coil; outputs are ``thickness`` in the cells
        and ``flow`` (Q) on the faces. A float adds those of `floated_film`.

    Raises
    ------
    ArgumentError
        If a winding is in the film, or too near to it.

    Examples
    --------
    >>> import wormopt as wo
    >>> from wormopt.magnetics.hydrostatics import Fluid, Linear
    >>> from wormopt.systems.coils.layer import Layer
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

    given = [Signal("current", current, "ampere_turns", value=0.0)]
    return (
        floated_film(layer, drawn, cargo, u=given) if cargo else surface_film(layer, drawn, u=given)
    )


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

    def simulate(
        self, currents: Gait, times: np.ndarray, tolerance: float, report: Report
    ) -> Trajectory:
        """Return the motion under periodic currents until the last of the times."""
        return simulate(
            drive(self.model(), currents, periodic=True), float(times[-1]), times=times,
            x0={"position": self.start} if self.cargo else None,
            route="cvodes", report=report,
            tolerance=Tolerance(tolerance, tolerance, max_steps=_STEPS),
        )  # fmt: skip


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
