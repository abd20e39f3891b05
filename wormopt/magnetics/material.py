"""Elastic composite with a magnetic fluid: elongation and softening in a field.

The stress p pulls a bar along its axis, in a uniform field H across it. For small strains and a
first Lamé coefficient far above the second, its strain is u = p / E_eff + u0. Source: section 3.2
of Zimmermann et al. 2007. The functions take numbers, arrays or CasADi expressions without checks;
`MagnetoElastic` takes numbers and refuses values for which the formulas do not hold.

For `identify_material`: with X = mu_r - 1, P = mu0 H² and e = E_eff / P, the shear modulus can be
eliminated exactly from the two formulas of the material, which leaves a cubic:

(1 + 4 u0) X³ + 10 (1 + 2 u0) X² + (25 - 10 e u0 (1 + u0)) X - 50 e u0 = 0.

For u0 > 0 its coefficients change their sign once, for either sign of the third. So exactly one
root is positive, and it meets all other conditions. The derivation is in docs/theory-magnetics.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers
from wormopt.result import left_out

Expression = Any
"""A float, an array, or a CasADi expression."""
MU0 = 4e-7 * math.pi
"""Permeability of vacuum in N/A², as in Zimmermann et al. 2007; the measured value differs by
1e-10.
"""
SMALL_STRAIN = 0.1
"""Upper limit of small strains: the neglected u²/2 is 5 % of u there."""
# Accepted difference between 3 eta, the modulus without field, and that of a compressible bar.
_MODULUS_ERROR = 0.01
# Accepted difference between the field in a round bar across the field and the applied field.
_FIELD_ERROR = 0.05
LARGEST = 1e30
"""Largest number allowed: products of a few are finite."""


def softening(mu_r: Expression, lame_eta: Expression, field: Expression) -> Expression:
    """Softening by the field, G = mu0 a1 H² / (2 eta) with a1 = -(2/5) (mu_r - 1)².

    `mu_r`: of the unstrained material; `lame_eta`: shear modulus eta, Pa; `field`: H, A/m.
    Negative; the formulas hold above -3/2. Source: section 3.2 of Zimmermann et al. 2007, below eq.
    16.
    """
    return MU0 * _a1(mu_r) * field * field / (2 * lame_eta)


def field_strain(mu_r: Expression, lame_eta: Expression, field: Expression) -> Expression:
    """Strain by the field alone, u0 = mu0 (2 (mu_r - 1) - a1) H² / (12 eta (1 + 2 G / 3)).

    Positive where 1 + 2 G / 3 is; units as for `softening`. Source: section 3.2 of Zimmermann et
    al. 2007.
    """
    pull = MU0 * (2 * (mu_r - 1) - _a1(mu_r)) * field * field
    return pull / (12 * lame_eta * (1 + 2 * softening(mu_r, lame_eta, field) / 3))


def effective_modulus(mu_r: Expression, lame_eta: Expression, field: Expression) -> Expression:
    """Young's modulus in the field, E_eff = 3 eta (1 + 2 G / 3) / (1 + G / 2), in Pa.

    3 eta without field, smaller with it; units as for `softening`. Source: section 3.2 of
    Zimmermann et al. 2007.
    """
    G = softening(mu_r, lame_eta, field)
    return 3 * lame_eta * (1 + 2 * G / 3) / (1 + G / 2)


def _a1(mu_r: Expression) -> Expression:
    # Products replace powers, since a power of a large float raises OverflowError.
    return -2 * (mu_r - 1) * (mu_r - 1) / 5


def check_number(name: str, value: object, above: float = 0.0) -> float:
    """Check a caller's value and return it as a number for which the formulas can be evaluated."""
    fits = isinstance(value, Real) and not isinstance(value, bool)
    if not (fits and above < float(value) <= LARGEST):  # pyright: ignore[reportArgumentType]
        raise ArgumentError(
            f"{name} must be a number above {above:g} and at most {LARGEST:g}, not {value!r}"
        )
    return float(value)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class MagnetoElastic:
    """An elastic composite with a magnetic fluid in it.

    Source: section 3.2 of Zimmermann et al. 2007.

    Parameters
    ----------
    mu_r : float
        Relative permeability of the unstrained material, above 1.
    lame_eta : float
        Second Lamé coefficient (shear modulus) eta in Pa, positive.
    lame_lambda : float, optional
        First Lamé coefficient lambda in Pa, positive. No formula contains it; it is used to check
        that lambda is far above eta.

    Raises
    ------
    ArgumentError
        If a value is not a number, or outside these bounds.

    Examples
    --------
    >>> rubber = MagnetoElastic(mu_r=1.1, lame_eta=5e3)
    >>> rubber.youngs_modulus()
    15000.0
    >>> round(float(rubber.strain(200.0, field=1.5e5)), 6)
    0.110222
    """

    mu_r: float
    lame_eta: float
    lame_lambda: float | None = None

    def __post_init__(self) -> None:
        check_number("mu_r", self.mu_r, above=1.0)
        check_number("lame_eta", self.lame_eta)
        if self.lame_lambda is not None:
            check_number("lame_lambda", self.lame_lambda)

    @property
    def poisson_ratio(self) -> float | None:
        """Poisson's ratio lambda / (2 (lambda + eta)), None if lambda is unknown."""
        if self.lame_lambda is None:
            return None
        return self.lame_lambda / (2 * (self.lame_lambda + self.lame_eta))

    @property
    def largest_field(self) -> float:
        """Field in A/m below which the formulas hold, where G is -3/2."""
        return math.sqrt(7.5 * self.lame_eta / MU0) / (self.mu_r - 1)

    def softening(self, field: float) -> float:
        """Softening G in a field; an error where the formulas do not hold.

        Parameters
        ----------
        field : float
            Field H in A/m, of either sign.

        Returns
        -------
        float
            Between -3/2 and 0, dimensionless.

        Raises
        ------
        ArgumentError
            If the field is not a number, or 1 + 2 G / 3 is not above 0; the message gives the
            allowed field and permeability.

        Examples
        --------
        >>> MagnetoElastic(4.0, 1e4).softening(1.5e5)
        Traceback (most recent call last):
            ...
        wormopt.errors.ArgumentError: mu_r = 4 with ... a field below 81433.8 A/m, or ...
        """
        field = abs(check_number("field", field, above=-LARGEST))
        G = softening(self.mu_r, self.lame_eta, field)
        if not 1 + 2 * G / 3 > 0:
            largest_mu_r = 1 + self.largest_field / field * (self.mu_r - 1)
            raise ArgumentError(
                f"mu_r = {self.mu_r:g} with lame_eta = {self.lame_eta:g} Pa in the field {field:g} "
                f"A/m has G = {G:g}, but the formulas hold only above -3/2; write a field below "
                f"{self.largest_field:.6g} A/m, or mu_r below {largest_mu_r:.6g} at this field"
            )
        return float(G)

    def field_strain(self, field: float) -> float:
        """Strain u0 by a field alone.

        Parameters
        ----------
        field : float
            Field H in A/m.

        Returns
        -------
        float
            Strain, dimensionless, not negative: the bar elongates.

        Raises
        ------
        ArgumentError
            As `softening`.
        """
        self.softening(field)
        return float(field_strain(self.mu_r, self.lame_eta, field))

    def youngs_modulus(self, field: float = 0.0) -> float:
        """Young's modulus E_eff in a field.

        Parameters
        ----------
        field : float, optional
            Field H in A/m.

        Returns
        -------
        float
            Modulus in Pa; 3 eta without field.

        Raises
        ------
        ArgumentError
            As `softening`.
        """
        self.softening(field)
        return float(effective_modulus(self.mu_r, self.lame_eta, field))

    def strain(self, stress: ArrayLike, field: float = 0.0) -> np.ndarray:
        """Strain u = p / E_eff + u0 of a bar.

        Parameters
        ----------
        stress : array_like, any shape
            Stress p in Pa, positive for tension.
        field : float, optional
            Field H in A/m.

        Returns
        -------
        ndarray
            Strain, dimensionless, same shape.

        Raises
        ------
        ArgumentError
            As `softening`, or if the stress is not a number.

        Examples
        --------
        >>> MagnetoElastic(1.1, 5e3).strain([0.0, 150.0]).tolist()
        [0.0, 0.01]
        """
        return numbers("stress", stress) / self.youngs_modulus(field) + self.field_strain(field)

    def stress(self, strain: ArrayLike, field: float = 0.0) -> np.ndarray:
        """Stress p = E_eff (u - u0) of a bar, the inverse of `strain`.

        Parameters
        ----------
        strain : array_like, any shape
            Strain u, dimensionless.
        field : float, optional
            Field H in A/m.

        Returns
        -------
        ndarray
            Stress in Pa, same shape.

        Raises
        ------
        ArgumentError
            As `softening`, or if the strain is not a number.
        """
        return self.youngs_modulus(field) * (numbers("strain", strain) - self.field_strain(field))

    def stiffness(self, length: float, area: float, field: float = 0.0) -> float:
        """Spring constant c = E_eff S0 / l0 of a bar.

        Parameters
        ----------
        length : float
            Length l0 of the unstrained bar in m, positive.
        area : float
            Cross section S0 of the unstrained bar in m², positive.
        field : float, optional
            Field H in A/m.

        Returns
        -------
        float
            Spring constant in N/m.

        Raises
        ------
        ArgumentError
            As `softening`, or if length or area is not positive.

        Examples
        --------
        >>> MagnetoElastic(1.1, 5e3).stiffness(length=0.03, area=6e-6)
        3.0
        """
        length, area = check_number("length", length), check_number("area", area)
        return self.youngs_modulus(field) * area / length

    def warnings(self, field: float, strain: ArrayLike = 0.0) -> Iterator[str]:
        """Yield a warning for each assumption of the formulas that is violated or unchecked.

        Parameters
        ----------
        field : float
            Field H in A/m.
        strain : array_like, optional
            Strains that occur besides u0.

        Yields
        ------
        str
            Warning.

        Raises
        ------
        ArgumentError
            As `softening`.

        Examples
        --------
        >>> len(list(MagnetoElastic(1.05, 5e3, lame_lambda=1e6).warnings(1.5e5)))
        0
        """
        u0, largest = self.field_strain(field), float(np.max(np.abs(numbers("strain", strain))))
        if u0 > SMALL_STRAIN:
            yield left_out(
                u0, f"u0 = {u0:.3g} is above the limit of small strains, {SMALL_STRAIN:g}"
            )
        if largest > SMALL_STRAIN:
            yield left_out(
                largest,
                f"strains reach {largest:.3g}, but the linear law holds for small strains, up to "
                f"about {SMALL_STRAIN:g}",
            )
        yield from self._warnings_of_lambda()
        inside = (self.mu_r - 1) / (self.mu_r + 1)
        if field and inside > _FIELD_ERROR:
            yield (
                "the field in the material is assumed to be the applied field; in a long round "
                f"bar across the field it is {inside:.0%} smaller"
            )

    def _warnings_of_lambda(self) -> Iterator[str]:
        if self.lame_lambda is None:
            yield (
                "the first Lamé coefficient lame_lambda is not given; it is assumed to be far "
                "above the second, without a check"
            )
            return
        # E = eta (3 lambda + 2 eta) / (lambda + eta) without field
        excess = 1 / (3 * self.lame_lambda / self.lame_eta + 2)
        if excess > _MODULUS_ERROR:
            yield (
                f"lame_lambda is {self.lame_lambda / self.lame_eta:.3g} times lame_eta, too small "
                f"for an incompressible material: already without field, 3 eta is {excess:.1%} "
                "above Young's modulus"
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
