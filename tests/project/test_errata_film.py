"""docs/errata.md on the film of magnetic fluid, (20)-(31): each line of it proven with sympy.

Starred letters of the chapter are dimensional; here they carry a trailing ``_``. Fields depend on
x, z and t, those of the travelling wave on xi = t - x alone.
"""

from typing import Any

import pytest
import sympy as sp
from simplified import zero
from sympy import Rational as Q

Function: Any = sp.Function  # its types do not say that it makes functions

Expression = Any  # of sympy, whose types are loose

x, z, t, xi = sp.symbols("x z t xi", real=True)
C, tension, field_factor = sp.symbols("C W kappa", real=True)  # kappa = (mu - 1) / (8 pi)
delta = sp.symbols("delta", positive=True)
d, k, omega, eta, rho, gamma = sp.symbols("d k omega eta rho gamma", positive=True)

eps, U_c = d * k, omega / k
scale_p = eta * omega / eps**2
Re = rho * U_c * d / eta


# --- (25): scaling -----------------------------------------------------------------------

x_, z_, t_ = sp.symbols("x^* z^* t^*", real=True)
u, w, p = (Function(name)(x, z, t) for name in ("u", "w", "p"))
h = Function("h")(x, t)
SCALED: Any = {x: k * x_, z: z_ / d, t: omega * t_}
CORRECT, PRINTED = eps * U_c, eps / U_c  # w^* over w


def starred(field: Expression, size: Expression) -> Expression:
    return size * field.subs(SCALED, simultaneous=True)


def unstarred(expression: Expression) -> Expression:
    back: Any = {x_: x / k, z_: z * d, t_: t / omega}
    return sp.simplify(expression.subs(back, simultaneous=True).doit())


def continuity(size_of_w: Expression) -> Expression:
    """(20), left, in dimensionless variables."""
    flow = sp.diff(starred(u, U_c), x_) + sp.diff(starred(w, size_of_w), z_)
    return unstarred(flow / (k * U_c))


def kinematic_condition(size_of_w: Expression) -> Expression:
    """(22) in dimensionless variables."""
    height = starred(h, d)
    rise = sp.diff(height, t_) + starred(u, U_c) * sp.diff(height, x_) - starred(w, size_of_w)
    return unstarred(rise / (d * omega))


def test_continuity_and_the_free_surface_keep_their_form_under_the_corrected_25():
    assert zero(continuity(CORRECT) - sp.diff(u, x) - sp.diff(w, z))
    rise = sp.diff(h, t) + u * sp.diff(h, x) - w
    assert zero(kinematic_condition(CORRECT) - rise)


def test_the_printed_scale_of_w_leaves_a_factor_with_a_unit():
    """1/U_c^2 before w: no pure number, so no equation between pure numbers."""
    assert zero(continuity(PRINTED) - sp.diff(u, x) - sp.diff(w, z) / U_c**2)
    rise = sp.diff(h, t) + u * sp.diff(h, x) - w / U_c**2
    assert zero(kinematic_condition(PRINTED) - rise)


def test_momentum_under_25_becomes_that_of_lubrication():
    """(20), right: inertia has the factor eps Re, p_z is of order eps^2; left are p_x = u_zz and
    p_z = 0. The scales of p and W are right as printed."""
    along, up, pressure = starred(u, U_c), starred(w, CORRECT), starred(p, scale_p)

    def momentum(velocity: Expression, axis: Any) -> Expression:
        carried = along * sp.diff(velocity, x_) + up * sp.diff(velocity, z_)
        viscous = eta * (sp.diff(velocity, x_, 2) + sp.diff(velocity, z_, 2))
        return rho * (sp.diff(velocity, t_) + carried) + sp.diff(pressure, axis) - viscous

    def inertia(velocity: Expression) -> Expression:
        return sp.diff(velocity, t) + u * sp.diff(velocity, x) + w * sp.diff(velocity, z)

    horizontal = unstarred(momentum(along, x_) / (scale_p * k))
    assert zero(
        horizontal
        - (eps * Re * inertia(u) + sp.diff(p, x) - eps**2 * sp.diff(u, x, 2) - sp.diff(u, z, 2))
    )
    vertical = unstarred(momentum(up, z_) / (scale_p / d))
    viscous = eps**2 * sp.diff(w, x, 2) + sp.diff(w, z, 2)
    assert zero(vertical - (eps**3 * Re * inertia(w) + sp.diff(p, z) - eps**2 * viscous))
    curvature = unstarred(gamma * sp.diff(starred(h, d), x_, 2) / scale_p)
    assert zero(curvature - gamma * d * k**2 / scale_p * sp.diff(h, x, 2))


# --- (27), (28): velocities and flow rate ------------------------------------------------

F = Function("F")(x, t)
ALONG = F * (z**2 / 2 - h * z)
UP = F * sp.diff(h, x) * z**2 / 2 + sp.diff(F, x) * (h * z**2 / 2 - z**3 / 6)
UP_PRINTED = F * sp.diff(h, x) * z**2 / 2 + sp.diff(F, x) * (h * z**2 / 4 - z**3 / 6)


def test_27_right_for_u_and_corrected_for_w():
    """u_zz = F, no slip below, no shear on top; then w_z = -u_x and w = 0 below give w."""
    assert zero(sp.diff(ALONG, z, 2) - F)
    assert ALONG.subs(z, 0) == 0
    assert zero(sp.diff(ALONG, z).subs(z, h))
    assert zero(UP + sp.integrate(sp.expand(sp.diff(ALONG, x)), (z, 0, z)))
    assert UP.subs(z, 0) == 0


def test_the_printed_w_of_27_makes_fluid():
    source = sp.diff(ALONG, x) + sp.diff(UP_PRINTED, z)
    assert zero(source + h * z * sp.diff(F, x) / 2)


def test_28_follows_with_the_corrected_w_only():
    """At the surface h_t + u h_x - w is h_t + Q_x, the left of (28), with Q = -F h^3 / 3."""
    Q_ = sp.integrate(sp.expand(ALONG), (z, 0, h))
    assert zero(Q_ + F * h**3 / 3)
    balance = sp.diff(h, t) + sp.diff(Q_, x)
    rise = (sp.diff(h, t) + (ALONG * sp.diff(h, x))).subs(z, h)
    assert zero(rise - UP.subs(z, h) - balance)
    assert zero(rise - UP_PRINTED.subs(z, h) - balance - sp.diff(F, x) * h**3 / 4)


def test_a_travelling_wave_carries_h_plus_a_constant():
    height = Function("h")
    Q_ = height(xi) + C
    balance = sp.diff(height(t - x), t) + sp.diff(Q_.subs(xi, t - x), x)
    assert zero(balance.doit())
    mean = sp.integrate(1 + delta * sp.cos(xi) + C, (xi, 0, 2 * sp.pi)) / (2 * sp.pi)
    assert zero(mean - 1 - C)


# --- (23), (29)-(31): the field ----------------------------------------------------------

WAVE = 1 + delta * sp.cos(xi)
C_RIGHT = -2 * (1 - delta**2) / (2 + delta**2)
# D of (31) over 8 pi / (mu - 1), as printed.
D_PRINTED = -tension * delta * sp.cos(xi) + 3 * delta * sp.sin(xi) * (2 + delta * sp.cos(xi)) / (
    (2 + delta**2) * WAVE**2
)


def remainder_of_29(shape: Expression, field: Expression, constant: Expression, power: int):
    """(29), left less right, with C / h^power; field is (mu - 1) / (8 pi) H^2."""
    right = -3 / shape**2 - 3 * constant / shape**power
    return tension * sp.diff(shape, xi, 3) + sp.diff(field, xi) - right


def test_the_normal_stress_needs_the_field_only_in_total():
    """(23) to first order in mu - 1: p = gamma / R - (mu - 1) / (8 pi) H^2."""
    excess, normal, tangential = sp.symbols("excess H_n H_t", real=True)
    mu = 1 + excess
    magnetic = (mu * normal) ** 2 / (8 * sp.pi) * (1 / mu - 1) - tangential**2 / (
        8 * sp.pi
    ) * excess
    first = sp.diff(magnetic, excess).subs(excess, 0)
    assert magnetic.subs(excess, 0) == 0
    assert zero(first + (normal**2 + tangential**2) / (8 * sp.pi))


def test_29_has_c_over_the_cube_of_h():
    """p = -W h'' - kappa H^2 on the surface (R^-1 = -h''), p_x = -p', F = p_x, Q = h + C."""
    height, squared = Function("h")(xi), Function("H2")(xi)
    pressure = -tension * sp.diff(height, xi, 2) - field_factor * squared
    slope = -sp.diff(pressure, xi)  # p_x
    flow = -slope * height**3 / 3 - (height + C)  # (28), right
    found = remainder_of_29(height, field_factor * squared, C, 3)
    assert zero(-3 * flow / height**3 - found)
    printed = remainder_of_29(height, field_factor * squared, C, 2)
    assert zero(found - printed - 3 * C * (1 / height**3 - 1 / height**2))


def test_30_holds_integrals_over_the_square_and_the_cube():
    """(30) put into the corrected (29), for any shape; with 1/h in both integrals it fails."""
    height = Function("h")(xi)

    def field(first: int, second: int) -> Expression:
        parts = [sp.Integral(1 / height**power, xi) for power in (first, second)]
        return -tension * sp.diff(height, xi, 2) - 3 * parts[0] - 3 * C * parts[1]

    assert zero(remainder_of_29(height, field(2, 3), C, 3))
    for first, second in ((1, 1), (2, 2)):
        rest = remainder_of_29(height, field(first, second), C, 3)
        assert not zero(rest.subs(height, WAVE).doit().subs({xi: 0, delta: Q(1, 2), C: -1}))


def test_periodicity_gives_c():
    """Where C has the value printed, the right of (29) is the slope of a periodic function. So its
    mean is 0, and as 1/h^3 > 0 it is for no other C."""
    periodic = -3 * delta * sp.sin(xi) * (2 + delta * sp.cos(xi)) / ((2 + delta**2) * WAVE**2)
    assert zero(sp.diff(periodic, xi) + 3 / WAVE**2 + 3 * C_RIGHT / WAVE**3)
    assert zero(periodic.subs(xi, xi + 2 * sp.pi) - periodic)
    assert zero(1 + C_RIGHT - 3 * delta**2 / (2 + delta**2))
    values = [C_RIGHT.subs(delta, Q(v)) for v in ("0.1", "0.5", "0.9")]
    assert values == [-Q(198, 201), -Q(2, 3), -Q(38, 281)]


@pytest.mark.parametrize("power", [1, 2])
def test_with_the_printed_integrands_periodicity_would_give_no_flow(power: int):
    """(1 + C)/h^power has the mean 0 for C = -1 only: no mean flow 1 + C, but (31) has one."""
    integrand = 1 / WAVE**power + C / WAVE**power
    assert zero(integrand - (1 + C) / WAVE**power)
    assert zero(integrand.subs(C, -1))
    assert (1 + C_RIGHT).subs(delta, Q(1, 2)) == Q(1, 3)


def test_31_solves_the_corrected_29_and_not_the_printed_one():
    assert zero(remainder_of_29(WAVE, -D_PRINTED, C_RIGHT, 3))
    rest = remainder_of_29(WAVE, -D_PRINTED, C_RIGHT, 2)
    assert not zero(rest.subs({xi: 0, delta: Q(1, 2)}))
