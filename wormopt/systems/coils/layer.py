"""A film on flat ground in finite volumes: its thickness, energy and mobility.

Finite volumes of second order: h in equal cells, Q on the faces between them with the mobility

    (h_r - h_l) / int_l^r 3 eta dh / h³ = 2 h_l² h_r² / (3 eta (h_l + h_r)),

which dissipates the entropy int int 3 eta / h³ as the equation does, and keeps the film positive
(Zhornitskaya and Bertozzi, SIAM J. Numer. Anal. 37, 2000). The state is the volume to the left of
each face, so the total volume is always conserved. Pressures are derivatives of an energy, so that
flow dissipates exactly the energy that is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.hydrostatics import Fluid
from wormopt.magnetics.material import check_number
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
