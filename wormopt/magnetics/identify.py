"""Identify mu_r and eta of a material from a strain and a modulus measured in one field.

With X = mu_r - 1, P = mu0 H² and e = E_eff / P, the shear modulus can be eliminated exactly from
the two formulas of the material, which leaves a cubic:

(1 + 4 u0) X³ + 10 (1 + 2 u0) X² + (25 - 10 e u0 (1 + u0)) X - 50 e u0 = 0.

For u0 > 0 its coefficients change their sign once, for either sign of the third. So exactly one
root is positive, and it meets all other conditions. The derivation is in docs/theory-magnetics.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import (
    LARGEST,
    MU0,
    MagnetoElastic,
    check_number,
    effective_modulus,
    field_strain,
    softening,
)

ACCEPTED = 1e-12
"""Largest accepted relative difference between the measured values and those of the formulas."""
_POLISHES = 20
# A root is real if its imaginary part is within this share of its size.
_REAL = 1e-9


@dataclass(frozen=True)
class Root:
    """One root of the cubic."""

    mu_r: complex  # relative permeability
    lame_eta: float | None  # second Lamé coefficient, Pa; None: root not real
    softening: float | None  # G; None: root not real
    refused: str  # why it is no material; empty if it is one


@dataclass(frozen=True)
class Identification:
    """The identified material and its residual.

    Parameters
    ----------
    material : MagnetoElastic
        The only material that the formulas allow.
    residual : float
        Largest relative difference of u0 and E_eff between this material and the measurement.
    roots : tuple of Root
        All three roots of the cubic, the material's first.

    Examples
    --------
    >>> import wormopt as wo
    >>> found = wo.magnetics.identify_material(0.071, 16e3, 1.5e5)
    >>> round(found.material.mu_r, 6), found.residual < 1e-9
    (1.078848, True)
    """

    material: MagnetoElastic
    residual: float
    roots: tuple[Root, ...]


def identify_material(
    u0: float, youngs_modulus_eff: float, field: float, *, lame_lambda: float | None = None
) -> Identification:
    """Find the permeability and the shear modulus of a bar measured in one field.

    Parameters
    ----------
    u0 : float
        Strain by the field alone, positive.
    youngs_modulus_eff : float
        Slope E_eff of stress over strain in the same field, in Pa, positive.
    field : float
        Field H in A/m, positive.
    lame_lambda : float, optional
        First Lamé coefficient in Pa, on which the answer does not depend.

    Returns
    -------
    Identification
        There is exactly one material for any positive numbers.

    Raises
    ------
    ArgumentError
        If a number is not positive, or mu_r is so near to 1, or the strain so large, that rounding
        leaves less than 12 digits of what was measured.

    Examples
    --------
    >>> found = identify_material(0.071, 16e3, 1.5e5)
    >>> round(found.material.mu_r, 6), round(found.material.lame_eta, 3)
    (1.078848, 5339.212)
    >>> [root.refused for root in found.roots]
    ['', 'mu_r is not above 1', 'mu_r is not above 1']
    """
    measured = (
        check_number("u0, the strain by the field,", u0),
        check_number("youngs_modulus_eff", youngs_modulus_eff),
        check_number("field", field),
    )
    roots = sorted(_roots(*measured), key=lambda root: root.refused != "")
    mu_r, eta = roots[0].mu_r.real, roots[0].lame_eta
    residual = float("inf")
    if eta is not None and not roots[0].refused:
        residual = forward_residual(mu_r, eta, *measured)
    if eta is None or not residual <= ACCEPTED or max(mu_r, eta) > LARGEST:
        raise ArgumentError(
            f"no material has u0 = {u0:g} and youngs_modulus_eff = {youngs_modulus_eff:g} Pa at "
            f"field = {field:g} A/m to 12 digits: mu_r - 1 = {mu_r - 1:g} is lost in rounding, or "
            "a number too large; check the numbers and their units (Pa, A/m)"
        )
    return Identification(MagnetoElastic(mu_r, eta, lame_lambda), residual, tuple(roots))


def forward_residual(
    mu_r: float, lame_eta: float, u0: float, youngs_modulus_eff: float, field: float
) -> float:
    """Evaluate the formulas of a material; return the larger relative difference.

    `mu_r`, `lame_eta` are the material, the others the measured values.
    """
    strain = float(field_strain(mu_r, lame_eta, field))
    modulus = float(effective_modulus(mu_r, lame_eta, field))
    return max(abs(strain / u0 - 1), abs(modulus / youngs_modulus_eff - 1))


def _roots(u0: float, modulus: float, field: float) -> Iterator[Root]:
    for X in _susceptibilities(u0, modulus, field):
        if X.imag:
            yield Root(1 + X, None, None, "mu_r is not real")
            continue
        mu_r, eta = 1 + X.real, _shear_modulus(X.real, u0, modulus, field)
        G = float(softening(mu_r, eta, field)) if eta else float("-inf")
        yield Root(mu_r, eta, G, _why_not(mu_r, eta, G))


def _why_not(mu_r: float, eta: float, G: float) -> str:
    if not mu_r > 1:
        return "mu_r is not above 1"
    if not eta > 0:
        return "lame_eta is not above 0"
    # 1 + G/2 > 0 follows
    return "" if 1 + 2 * G / 3 > 0 else "1 + 2 G / 3 is not above 0"


def _shear_modulus(X: float, u0: float, modulus: float, field: float) -> float:
    """Shear modulus eta by E_eff q = eta (4 q - 1), q = 1 + G/2; by G itself where q is small."""
    P = MU0 * field * field
    q = X * (X + 5) * P / (10 * u0 * modulus)
    return modulus * q / (4 * q - 1) if q > 0.5 else X * X * P / (10 * (1 - q))


def _susceptibilities(u0: float, modulus: float, field: float) -> list[complex]:
    """Roots X = mu_r - 1 of the cubic, largest real part first."""
    pull = modulus * u0 / (MU0 * field * field)
    cubic = [1 + 4 * u0, 10 * (1 + 2 * u0), 25 - 10 * pull * (1 + u0), -50 * pull]
    size = max(abs(c / cubic[0]) ** (1 / k) for k, c in enumerate(cubic[1:], 1))
    scaled = np.array([c / cubic[0] / size**k for k, c in enumerate(cubic)])
    found = [_polished(scaled, root) * size for root in np.roots(scaled)]
    return sorted(found, key=lambda X: -X.real)


def _polished(cubic: np.ndarray, root: complex) -> complex:
    """Newton's method, as long as the polynomial decreases."""
    root = complex(root)
    slope, value = np.polyder(cubic), np.polyval(cubic, root)
    for _ in range(_POLISHES):
        steep = np.polyval(slope, root)
        moved = root - value / steep if steep else root
        less = np.polyval(cubic, moved)
        if not abs(less) < abs(value):
            break
        root, value = complex(moved), less
    return complex(root.real) if abs(root.imag) <= _REAL * abs(root) else root
