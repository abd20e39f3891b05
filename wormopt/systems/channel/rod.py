"""A planar rod with any stretch, shear and bending: its energy on finite elements.

The cross sections of the geometrically exact rod move as rigid discs: each has a place (x, y) and
an angle. Elements interpolate all three by polynomials on Gauss-Lobatto nodes. Strains are taken at
as many Gauss points as the degree, one less than exact quadrature of slender rods would need, so
shear does not lock for slender rods. Masses are lumped by Lobatto quadrature. Frequencies converge
at the order 2 degree.

Sources: E. Reissner, ZAMP 23 (1972) 795 for the strains; J. C. Simo, Comput. Methods Appl. Mech.
Eng. 49 (1985) 55; T. J. R. Hughes, The Finite Element Method (1987), 4.4 and 7.3 for the
quadratures; G. R. Cowper, J. Appl. Mech. 33 (1966) 335 for the shear of round sections.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from wormopt.errors import ArgumentError

_DIGITS = 1e-15


@dataclass(frozen=True)
class Stiffness:
    """Stiffnesses of a rod against its strains; numbers or CasADi expressions."""

    stretching: Any  # E A, N
    shearing: Any  # k G A, N
    bending: Any  # E I, N m²


@dataclass(frozen=True)
class Rod:
    """A round rod of linear elastic material, straight without load.

    Parameters
    ----------
    length, diameter : float
        Length and diameter, m.
    youngs_modulus : float
        Young's modulus, Pa.
    density : float
        Density, kg/m³.
    damping_time : float, optional
        Ratio of viscosity and Young's modulus of a Kelvin-Voigt material, in s: a vibration of
        angular frequency w loses 2 pi w times this share of its energy in a period.
    poisson_ratio : float, optional
        Poisson's ratio, 0.5 for constant volume.
    elements, degree : int, optional
        Number of elements, and degree of their polynomials.
    skin : float, optional
        Thickness, in m, of the skin of a rod that is filled with a fluid: only the skin resists
        strains, only the fluid is magnetised, `density` is that of the whole. Solid if 0.

    Raises
    ------
    ArgumentError
        If a value is not positive or out of its range.

    Examples
    --------
    >>> rod = Rod(length=48e-3, diameter=4e-3, youngs_modulus=5e4, density=1100.0, elements=12)
    >>> rod.count, float(rod.weights.sum().round(12)), round(rod.stiffness().bending * 1e9, 3)
    (25, 0.048, 628.319)
    """

    length: float
    diameter: float
    youngs_modulus: float
    density: float
    damping_time: float = 0.0
    poisson_ratio: float = 0.5
    elements: int = 24
    degree: int = 2
    skin: float = 0.0

    def __post_init__(self) -> None:
        least = {
            "damping_time": 0.0,
            "skin": 0.0,
            "poisson_ratio": -1.0,
            "elements": 1,
            "degree": 1,
        }
        for item in fields(self):
            value = getattr(self, item.name)
            low = least.get(item.name, 0.0)
            fine = value >= low if item.name in least else value > low
            if not (fine and math.isfinite(value)):
                words = f"at least {low:g}" if item.name in least else "positive"
                raise ArgumentError(f"rod: {item.name} must be {words}, not {value!r}")
        if not -1 < self.poisson_ratio <= 0.5:
            raise ArgumentError(
                f"rod: poisson_ratio must be above -1 and at most 0.5, not {self.poisson_ratio:g}"
            )

        if 2 * self.skin > self.diameter:
            raise ArgumentError(
                f"rod: a skin of {self.skin:g} m is thicker than the radius; write less"
            )

    @property
    def _hole(self) -> float:
        """Inner over outer diameter of the section that resists strains."""
        return 1 - 2 * self.skin / self.diameter if self.skin else 0.0

    @property
    def magnetised_area(self) -> float:
        """Area on which the field acts: whole section, or the fluid in its skin, in m²."""
        return self.area * (self._hole**2 if self.skin else 1.0)

    @property
    def area(self) -> float:
        """Area of the cross section, in m²."""
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> float:
        """Second moment of the cross section about its axis of bending, in m⁴."""
        return math.pi * self.diameter**4 / 64

    @property
    def shear_ratio(self) -> float:
        """Share k of the section that carries shear times G / E (Cowper, round or a tube)."""
        nu, square = self.poisson_ratio, self._hole**2
        bulge = (7 + 6 * nu) * (1 + square) ** 2 + (20 + 12 * nu) * square
        return 3 * (1 + square) ** 2 / bulge

    def stiffness(self, youngs_modulus: Any = None) -> Stiffness:
        """Return the stiffness against stretching, shearing and bending.

        Parameters
        ----------
        youngs_modulus : float or casadi.SX, optional
            Young's modulus instead of the rod's own, Pa.

        Returns
        -------
        Stiffness
        """
        E = self.youngs_modulus if youngs_modulus is None else youngs_modulus
        stretching = E * self.area * (1 - self._hole**2)
        bending = E * self.second_moment * (1 - self._hole**4)
        return Stiffness(stretching, stretching * self.shear_ratio, bending)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.elements * self.degree + 1

    @cached_property
    def nodes(self) -> np.ndarray:
        """Distances of the nodes from the first end along the rod, shape (count,), in m."""
        size = self.length / self.elements
        inner = (_lobatto(self.degree)[0][:-1] + 1) / 2
        return np.append((np.arange(self.elements)[:, None] + inner).ravel() * size, self.length)

    @cached_property
    def weights(self) -> np.ndarray:
        """Lengths lumped at the nodes, shape (count,), in m; their sum is the length."""
        share = np.multiply(_lobatto(self.degree)[1], self.length / (2 * self.elements))
        found = np.zeros(self.count)
        for first in range(0, self.count - 1, self.degree):
            found[first : first + self.degree + 1] += share
        return found

    @property
    def inertia(self) -> tuple[np.ndarray, np.ndarray]:
        """Mass of every node in kg, and moment of inertia in kg m², shape (count,) each."""
        lumped = self.density * self.weights
        return self.area * lumped, self.second_moment * lumped

    def strains(self, x: Any, y: Any, angle: Any) -> tuple[Any, Any, Any]:
        """Return stretch, shear and curvature at the Gauss points.

        Parameters
        ----------
        x, y, angle : casadi.SX or casadi.DM
            Columns of ``count`` places in m, and angles of the sections in rad.

        Returns
        -------
        stretch, shear, curvature : casadi.SX or casadi.DM
            Columns of ``elements * degree``; the last one in 1/m.
        """
        slope, value, _ = self._gauss
        along, across, turned = slope @ x, slope @ y, value @ angle
        cosine, sine = ca.cos(turned), ca.sin(turned)
        return along * cosine + across * sine - 1, across * cosine - along * sine, slope @ angle

    def energy(self, strains: Iterable[Any], stiffness: Stiffness | None = None) -> Any:
        """Return the elastic energy of strains; of their rates, the power per damping time.

        Parameters
        ----------
        strains : iterable
            Stretch, shear and curvature, as from `strains`.
        stiffness : Stiffness, optional
            Stiffness instead of the rod's own.

        Returns
        -------
        casadi.SX or casadi.DM
            Energy in J.

        Examples
        --------
        A quarter circle has the energy E I pi² / (8 length) on any mesh:

        >>> rod = Rod(1.0, 0.1, 1e6, 1000.0, elements=3, degree=2)
        >>> bend = (ca.DM.zeros(6), ca.DM.zeros(6), ca.DM([math.pi / 2] * 6))
        >>> float(rod.energy(bend) / rod.stiffness().bending - math.pi**2 / 8) < 1e-14
        True
        """
        resist = self.stiffness() if stiffness is None else stiffness
        weights = self._gauss[2]
        stretch, shear, curvature = (ca.dot(weights, part * part) / 2 for part in strains)
        return resist.stretching * stretch + resist.shearing * shear + resist.bending * curvature

    @cached_property
    def _gauss(self) -> tuple[ca.DM, ca.DM, ca.DM]:
        """Matrices from nodes to slopes and values at the Gauss points, and their weights."""
        places, weights = legendre.leggauss(self.degree)
        value, slope = _lagrange(_lobatto(self.degree)[0], places)
        size, parts = self.length / self.elements, range(self.elements)
        return (
            _chained(slope * 2 / size, parts),
            _chained(value, parts),
            ca.DM(np.tile(weights * size / 2, self.elements)),
        )


def _chained(block: np.ndarray, parts: range) -> ca.DM:
    """Return the sparse matrix of a row of elements that share their end nodes."""
    rows, columns = block.shape
    shared = np.zeros((rows * len(parts), (columns - 1) * len(parts) + 1))
    for k in parts:
        first = k * (columns - 1)
        shared[k * rows : (k + 1) * rows, first : first + columns] = block
    return ca.sparsify(ca.DM(shared), _DIGITS)


def _lobatto(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Lobatto nodes on [-1, 1] and their weights."""
    series = np.zeros(degree + 1)
    series[-1] = 1.0
    inner = legendre.legroots(legendre.legder(series)).real
    nodes = np.concatenate([[-1.0], np.sort(inner), [1.0]])
    return nodes, 2 / (degree * (degree + 1) * legendre.legval(nodes, series) ** 2)


def _lagrange(nodes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and slopes of the Lagrange polynomials of nodes, one row per place."""
    degree = len(nodes) - 1
    coefficients = np.linalg.inv(legendre.legvander(nodes, degree))
    slopes = legendre.legval(places, legendre.legder(coefficients))
    return legendre.legvander(places, degree) @ coefficients, np.atleast_2d(slopes.T)
