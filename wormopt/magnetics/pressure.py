"""Pressure of a magnetic field on a weakly magnetic fluid, in SI and Gaussian units.

A field H acts on the surface of a fluid with permeability mu_r, slightly above 1, like a pressure:
mu0 (mu_r - 1) H² / 2 in SI units, (mu_r - 1) H² / (8 pi) in Gaussian units. All conversions between
the two systems are in this module. Functions take numbers, arrays or CasADi expressions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wormopt.magnetics.material import MU0

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

    Expression = ca.SX | np.ndarray | float


OERSTED = 1e3 / (4 * math.pi)
"""The Gaussian unit of H, in A/m."""


def magnetic_pressure(mu_r: Expression, field: Expression) -> Expression:
    """Magnetic pressure mu0 (mu_r - 1) H² / 2, in Pa, of the field H in A/m."""
    return MU0 * (mu_r - 1) * field * field / 2


def gaussian_pressure(mu_r: Expression, field: Expression) -> Expression:
    """Magnetic pressure in Gaussian units, (mu_r - 1) H² / (8 pi), in dyn/cm² (0.1 Pa).

    H in oersted; `mu_r` is the same number in both systems.
    """
    return (mu_r - 1) * field * field / (8 * math.pi)


def field_of(mu_r: Expression, pressure: Expression) -> Expression:
    """Field H in A/m of a given `magnetic_pressure` in Pa; `mu_r` above 1."""
    return (2 * pressure / (MU0 * (mu_r - 1))) ** 0.5
