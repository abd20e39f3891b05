"""Pressure of a magnetic field on a weakly magnetic fluid, and fields in SI and Gaussian units.

A field H acts on the surface of a fluid of permeability mu_r, little above 1, as a pressure would:
mu0 (mu_r - 1) H² / 2 in SI units, (mu_r - 1) H² / (8 pi) in Gaussian ones. That is the only place
where the two systems meet. Functions take numbers, arrays or CasADi expressions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wormopt.magnetics.material import MU0

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

    Expression = ca.SX | np.ndarray | float

__all__ = ["OERSTED", "field_of", "gaussian_pressure", "magnetic_pressure"]

OERSTED = 1e3 / (4 * math.pi)
"""The Gaussian unit of H, in A/m."""


def magnetic_pressure(mu_r: Expression, field: Expression) -> Expression:
    """mu0 (mu_r - 1) H² / 2.

    Parameters
    ----------
    mu_r : float, ndarray or casadi.SX
        Relative permeability.
    field : float, ndarray or casadi.SX
        Field H in A/m.

    Returns
    -------
    float, ndarray or casadi.SX
        In Pa.

    Examples
    --------
    >>> round(magnetic_pressure(1.1, 1e4), 6)
    6.283185
    """
    return MU0 * (mu_r - 1) * field * field / 2


def gaussian_pressure(mu_r: Expression, field: Expression) -> Expression:
    """(mu_r - 1) H² / (8 pi), the same in Gaussian units.

    Parameters
    ----------
    mu_r : float, ndarray or casadi.SX
        Permeability; the same number in both systems.
    field : float, ndarray or casadi.SX
        Field H in oersted.

    Returns
    -------
    float, ndarray or casadi.SX
        In dyn/cm², a tenth of a Pa.

    Examples
    --------
    >>> pascal = gaussian_pressure(1.1, 1e4 / OERSTED) / 10
    >>> round(pascal / magnetic_pressure(1.1, 1e4) - 1, 12)
    0.0
    """
    return (mu_r - 1) * field * field / (8 * math.pi)


def field_of(mu_r: Expression, pressure: Expression) -> Expression:
    """Field of a given `magnetic_pressure`.

    Parameters
    ----------
    mu_r : float, ndarray or casadi.SX
        Relative permeability, above 1.
    pressure : float, ndarray or casadi.SX
        In Pa, 0 or above.

    Returns
    -------
    float, ndarray or casadi.SX
        H in A/m; divided by `OERSTED`, in oersted.

    Examples
    --------
    >>> round(field_of(1.1, magnetic_pressure(1.1, 1e4)), 6)
    10000.0
    """
    return (2 * pressure / (MU0 * (mu_r - 1))) ** 0.5
