"""docs/equations.md, (20)-(31) and the film's theory: what our functions and Models say.

They take CasADi's symbols, so all numbers are free; the shape is any function h(xi), xi = t - x,
unless it is the cosine.
"""

from typing import Any

import casadi as ca
import numpy as np
import sympy as sp
from hints import Patch
from sympy import Rational as Q

from tests.oracles.by_symbols import Symbols, unchecked, zero
from wormopt.magnetics.pressure import field_of, gaussian_pressure
from wormopt.model.model import Signal
from wormopt.systems.film import given_field
from wormopt.systems.film.body import HeavyFloat, LyingBody, carried_body
from wormopt.systems.film.cosine import CosineWave, square_wave_flow
from wormopt.systems.film.float import body_velocity, cosine_drift, floating, tracers
from wormopt.systems.film.lubrication import (
    field_slope,
    flow,
    pressure_gradient,
    stream_function,
    surface_velocity,
    velocities,
)
from wormopt.systems.film.units import Fluid

Function: Any = sp.Function  # its types do not say that it makes functions

NAMES = ("z", "h", "slope", "third", "C", "W")
CA = {name: ca.SX.sym(name) for name in NAMES}
S = Symbols(CA, positive=("h",))
xi, z, C, W = sp.Symbol("xi", real=True), S["z"], S["C"], S["W"]
h = Function("h")(xi)
SHAPE = {S["h"]: h, S["slope"]: sp.diff(h, xi), S["third"]: sp.diff(h, xi, 3)}


def of_shape(expression: Any) -> Any:
    """The expression with h(xi) for the symbols of thickness and slopes."""
    return S.one(expression).subs(SHAPE)


def by_x(expression: Any) -> Any:
    """Derivative by x of what depends on t - x."""
    return -sp.diff(expression, xi)


U, UP = (of_shape(part) for part in velocities(CA["z"], CA["h"], CA["slope"], CA["C"]))
F = of_shape(pressure_gradient(CA["h"], CA["C"]))
SLOPE = of_shape(field_slope(CA["h"], CA["third"], CA["C"], CA["W"]))

FLUID = ("viscosity", "density", "surface_tension", "depth", "wavelength", "frequency", "mu_r")
SI = {name: ca.SX.sym(name) for name in FLUID}
OIL = unchecked(Fluid, **SI)
si = Symbols(SI, positive=FLUID)


# -- (20) to (26) ---------------------------------------------------------------------------------


def test_20_continuity_and_momentum_of_lubrication():
    """u_x + w_z = 0, u_zz = p_x with p_x free of z: what is left of (20) for eps to 0."""
    assert zero(by_x(U) + sp.diff(UP, z))
    assert zero(sp.diff(U, z, 2) - F)
    assert not F.has(z)


def test_20_in_our_units_inertia_has_the_share_eps_re():
    """Terms of (20) over P k: viscous ones 1 (by z) and eps² (by x), inertia eps Re."""
    eta, d, rho = si["viscosity"], si["depth"], si["density"]
    eps, speed, P, Re = (si.one(part) for part in (OIL.eps, OIL.speed, OIL.pressure, OIL.reynolds))
    k = 2 * sp.pi / si["wavelength"]
    assert zero(eta * speed / d**2 / (P * k) - 1)
    assert zero(eta * speed * k**2 / (P * k) - eps**2)
    assert zero(rho * speed**2 * k / (P * k) - eps * Re)
    # upwards, with w* = eps U_c w, over P / d: p_z is of order eps²
    assert zero(eta * eps * speed / d**2 / (P / d) - eps**2)


def test_21_the_fluid_rests_on_the_ground():
    assert U.subs(z, 0) == 0
    assert UP.subs(z, 0) == 0


def test_22_the_surface_is_carried_by_the_fluid():
    """h_t + u h_x = w on z = h."""
    rise = sp.diff(h, xi) + U * by_x(h) - UP
    assert zero(rise.subs(z, h))


def test_23_no_shear_on_the_surface_and_the_normal_stress_of_thin_films():
    """Of (23) for eps to 0: u_z = 0, and p + W h_xx + (mu - 1) H² / (8 pi) = const.

    The curvature h_xx / (1 + eps² h_x²)^(3/2) tends to h_xx; the field's stress is -(mu - 1)
    (mu H_n² + H_t²) / (8 pi), which for mu to 1 is that of H² alone.
    """
    assert zero(sp.diff(U, z).subs(z, h))
    # p_x = -W h_xxx - K_x, K = (mu - 1) H² / (8 pi); our slope is K'
    K_x = -SLOPE
    assert zero(F + W * by_x(by_x(by_x(h))) + K_x)
    mu, Hn, Ht, bend, eps, steep = sp.symbols("mu H_n H_t h_xx eps h_x", positive=True)
    stress = (mu * Hn) ** 2 / (8 * sp.pi) * (1 / mu - 1) - Ht**2 / (8 * sp.pi) * (mu - 1)
    ours = Symbols({"m": CA["h"], "H": CA["z"]}).one(gaussian_pressure(CA["h"], CA["z"]))
    m, H = sp.symbols("m H", real=True)
    first = sp.diff(stress, mu).subs(mu, 1) * (mu - 1)  # in mu - 1, and nothing at mu = 1
    assert stress.subs(mu, 1) == 0
    assert zero(first + ours.subs({m: mu, H: sp.sqrt(Hn**2 + Ht**2)}))
    curvature = bend / (1 + eps**2 * steep**2) ** Q(3, 2)
    assert curvature.subs(eps, 0) == bend


def test_24_and_25_our_cosine_is_the_given_wave_in_units_of_the_depth():
    a, d, omega, k, t, x = sp.symbols("a d omega k t x", positive=True)
    delta, phase = ca.SX.sym("delta"), ca.SX.sym("xi")
    s = Symbols({"delta": delta, "xi": phase}, positive=("delta",))
    ours = s.one(CosineWave(delta).height(phase))
    star = d + a * sp.cos(omega * t - k * x)
    assert zero(star / d - ours.subs({s["delta"]: a / d, s["xi"]: omega * t - k * x}))
    for order in range(5):
        assert zero(s.one(CosineWave(delta).height(phase, order)) - sp.diff(ours, s["xi"], order))


def test_25_scales_of_our_fluid():
    """eps = d k, U_c = omega / k, P = eta omega / eps², Re = rho U_c d / eta, W = gamma d k²/P."""
    k = 2 * sp.pi / si["wavelength"]
    eta, rho, gamma, d, omega = (
        si[name] for name in ("viscosity", "density", "surface_tension", "depth", "frequency")
    )
    P = eta * omega / (d * k) ** 2
    known = {"wave_number": k, "eps": d * k, "speed": omega / k, "pressure": P,
             "reynolds": rho * omega / k * d / eta, "tension": gamma * d * k**2 / P}  # fmt: skip
    for name, value in known.items():
        assert zero(si.one(getattr(OIL, name)) - value)


def test_25_as_printed_the_scale_of_w_does_not_keep_continuity():
    """w* = w U_c / eps would leave u_x + w_z / U_c² with our u and w, which is not 0."""
    speed = sp.Symbol("U_c", positive=True)
    printed = by_x(U) + sp.diff(UP, z) / speed**2
    assert zero(printed - by_x(U) * (1 - 1 / speed**2))
    assert not zero(by_x(U))


# -- (27) to (31) ---------------------------------------------------------------------------------


def test_27_is_ours_with_h_in_place_of_half_h():
    h_x, F_x = by_x(h), by_x(F)
    assert zero(U - F * (z**2 / 2 - h * z))
    assert zero(UP - (F * h_x * z**2 / 2 + F_x * (h * z**2 / 2 - z**3 / 6)))
    printed = F * h_x * z**2 / 2 + F_x * (h / 2 * z**2 / 2 - z**3 / 6)
    gap = -F_x * h * z**2 / 4
    assert zero(printed - UP - gap)
    assert not zero(gap)
    # so much fluid the printed one makes
    assert zero(by_x(U) + sp.diff(printed, z) - sp.diff(gap, z))


def test_28_flow_from_the_profile_and_from_continuity():
    """Q is the integral of u, -F h³ / 3 = h + C; h_t + Q_x = 0; the stream function is its own."""
    Q_ = of_shape(flow(CA["h"], CA["C"]))
    assert zero(sp.integrate(sp.expand(U), (z, 0, h)) - Q_)
    assert zero(-F * h**3 / 3 - Q_)
    assert zero(sp.diff(h, xi) + by_x(Q_))
    stream = of_shape(stream_function(CA["z"], CA["h"], CA["C"]))
    assert zero(sp.diff(stream, z) - (U - 1))
    assert zero(-by_x(stream) - UP)  # w = -psi_x in the wave's frame
    assert zero(stream.subs(z, h) - C)
    assert zero(of_shape(surface_velocity(CA["h"], CA["C"])) - U.subs(z, h))


def test_29_is_our_slope_of_the_field_with_the_cube_of_h():
    """W h''' + K' = -3 / h² - 3 C / h³."""
    left = W * sp.diff(h, xi, 3) + SLOPE
    assert zero(left - (-3 / h**2 - 3 * C / h**3))
    printed = -3 / h**2 - 3 * C / h**2
    assert zero(printed - left - 3 * C * (1 - h) / h**3)


DELTA, XI, TENSION = ca.SX.sym("delta"), ca.SX.sym("xi"), ca.SX.sym("W")
COS = Symbols({"delta": DELTA, "xi": XI, "W": TENSION}, positive=("delta",))
WAVE = CosineWave(DELTA)


def test_30_the_field_of_any_wave_is_the_integral_of_29():
    """H² = H0² - D with D' = -K' of (29), for the cosine: it repeats, as all in it does."""
    ours = COS.one(WAVE.field_function(XI, TENSION))
    args = (WAVE.height(XI), WAVE.height(XI, 3), WAVE.constant, TENSION)
    assert zero(sp.diff(ours, COS["xi"]) + COS.one(field_slope(*args)))
    assert zero(ours.subs(COS["xi"], COS["xi"] + 2 * sp.pi) - ours)
    # printed integrands 1 / h and 1 / h differ from those of (29)
    assert zero(
        (-3 / h - 3 * C / h) - (-3 / h**2 - 3 * C / h**3) - 3 * (h - 1) * (-h - C * (h + 1)) / h**3
    )


def test_30_only_our_c_makes_the_field_repeat():
    """The mean of 1/h² + C/h³ vanishes: these means are 1/y³ and (2 + delta²) / (2 y⁵).

    By antiderivatives: 1/h has the mean 1/y (y² = 1 - delta²), and (sin xi / h^n)' reduces the
    powers; what repeats has the mean 0.
    """
    d, x = COS["delta"], COS["xi"]
    H = COS.one(WAVE.height(XI))
    y2 = 1 - d**2
    # (delta sin / h)' = y²/h² - 1/h and (delta sin / h²)' = (2 y²/h³ - 3/h² + 1/h)
    assert zero(sp.diff(-d * sp.sin(x) / H, x) - (y2 / H**2 - 1 / H))
    assert zero(sp.diff(-d * sp.sin(x) / H**2, x) - (2 * y2 / H**3 - 3 / H**2 + 1 / H))
    y = sp.sqrt(y2)
    first = 1 / y
    second = first / y2
    third = (3 * second - first) / (2 * y2)
    assert zero(second + COS.one(WAVE.constant) * third)
    assert zero(COS.one(WAVE.mean_flow) - 1 - COS.one(WAVE.constant))
    assert zero(COS.one(WAVE.constant) + 2 * (1 - d**2) / (2 + d**2))
    assert zero(COS.one(WAVE.inverse(XI, 0.0)) - 1 / H)


def test_31_is_our_field_function():
    d, x = COS["delta"], COS["xi"]
    c, s = sp.cos(x), sp.sin(x)
    printed = -COS["W"] * d * c + 3 * d * s * (2 + d * c) / ((2 + d**2) * (1 + d * c) ** 2)
    assert zero(COS.one(WAVE.field_function(XI, TENSION)) - printed)


def test_field_of_a_pressure_undoes_the_pressure():
    """H from (mu_r - 1) mu0 H² / 2, by which D of (31) becomes a field in A/m."""
    mu_r, P = ca.SX.sym("mu_r"), ca.SX.sym("P")
    s = Symbols({"m": mu_r, "P": P}, positive=("m", "P"),
                constants={4e-7 * float(sp.pi): sp.Symbol("mu0", positive=True)})  # fmt: skip
    found = s.one(field_of(mu_r, P))
    assert zero(sp.Symbol("mu0", positive=True) * (s["m"] - 1) * found**2 / 2 - s["P"])


# -- what rides on the film -----------------------------------------------------------------------


def test_floats_move_with_the_surface():
    """x' = 3 (1 + C / h) / 2 = u on z = h at the phase t - x, by the Model's own ode."""
    model = floating(CosineWave(0.5))
    s = Symbols.of(model, positive=("amplitude",))
    phase = s["t"] - s["position"]
    H = 1 + s["amplitude"] * sp.cos(phase)
    c = -2 * (1 - s["amplitude"] ** 2) / (2 + s["amplitude"] ** 2)
    top = U.subs(z, h).doit().subs(C, c)
    assert zero(s.one(model.ode) - top.subs(h, H))
    any_wave: Any = _Any()
    assert zero(S.one(body_velocity(any_wave, CA["z"])) - S.one(surface_velocity(CA["h"], CA["C"])))


class _Any:
    """A wave of any height."""

    constant = CA["C"]

    def height(self, _: Any) -> Any:
        return CA["h"]


def test_tracers_keep_their_stream_function():
    """x' = u, z' = w; psi of the Model does not change along its ode."""
    model = tracers(CosineWave(0.5), height=0.5)
    s = Symbols.of(model, positive=("amplitude",))
    psi, x = s.one(model["stream"]), s.column("position", "height")
    change = (sp.Matrix([psi]).jacobian(x) * s(model.ode))[0] + sp.diff(psi, s["t"])
    assert zero(change)


def test_drift_of_small_floats_in_closed_form():
    """T_L is the integral of 1 / (1 - u_s) = -2 + 6 C / (h + 3 C), and the drift 1 - 2 pi / T_L.

    The mean of 1 / (a + delta cos xi) is -1 / sqrt(a² - delta²) for a = 1 + 3 C < -delta, and
    that root is y S / (2 + delta²) with y² = 1 - delta² and S as in the code.
    """
    d, H = COS["delta"], sp.Symbol("h")
    c = COS.one(WAVE.constant)
    assert zero(1 / (1 - Q(3, 2) * (1 + c / H)) - (-2 + 6 * c / (H + 3 * c)))
    y, size = sp.symbols("y S", positive=True)
    known = {y: sp.sqrt(1 - d**2), size: sp.sqrt((4 - d**2 - 6 * d) * (4 - d**2 + 6 * d))}
    root = y * size / (2 + d**2)
    assert zero((root**2).subs(known) - (1 + 3 * c) ** 2 + d**2)
    turn = -2 - 6 * c / root  # T_L / (2 pi)
    assert zero((1 - 1 / turn).subs(known) - COS.one(cosine_drift(DELTA)))


def pulled(body: HeavyFloat | LyingBody) -> tuple[Symbols, Any, Any, Any]:
    """Symbols of the body's Model, thickness over it, C, and the force on it."""
    model = carried_body(body, mass=0.25)
    s = Symbols.of(model, positive=("mass",))
    height = 1 + sp.cos(s["t"] - s["position"]) / 2
    rates = s(model.ode)
    rates = rates.subs({each: 0 for each in rates.free_symbols if each.name == "contact"})
    force, v = sp.cancel(rates[1] * s["mass"]), s["velocity"]
    assert zero(rates - sp.Matrix([v, force / s["mass"], force * v, force]))
    return s, height, Q(-2, 3), force


def test_a_heavy_float_is_dragged_by_the_shear_below_it():
    """Couette on top of (27): u = F (z²/2 - h z) + tau z takes the float's v on z = h.

    So tau = (v - u_s) / h, and m v' = -tau - w h_x with the weight w down the slope.
    """
    s, H, c, force = pulled(HeavyFloat(CosineWave(0.5), weight=0.5))
    tau = sp.Symbol("tau")
    profile = U.subs(z, h).doit().subs(C, c).subs(h, H) + tau * H
    (shear,) = sp.solve(profile - s["velocity"], tau)
    assert zero(force - (-shear - Q(1, 2) * sp.diff(H, s["position"])))


def test_a_lying_body_is_pulled_by_the_flow_over_it():
    """Over a floor at z = b that moves at v goes Q - b v: shear on it, and capillary -b p_x."""
    s, H, c, force = pulled(LyingBody(CosineWave(0.5), height=0.25, tension=0.125))
    up, F, gap = sp.symbols("up F gap", positive=True)  # up: above the floor
    over = s["velocity"] + F * (up**2 / 2 - gap * up)  # no shear at the surface
    total = sp.integrate(over, (up, 0, gap)) + Q(1, 4) * s["velocity"]
    (found,) = sp.solve(total - (H + c), F)
    shear = sp.diff(over, up).subs(up, 0).subs(F, found).subs(gap, H - Q(1, 4))
    pressure = -Q(1, 8) * sp.diff(H, s["position"], 2)
    assert zero(force - (shear - Q(1, 4) * sp.diff(pressure, s["position"])))


CENTRAL = ([1 / 12, -2 / 3, 0, 2 / 3, -1 / 12], [-1 / 6, 4 / 3, -1 / 6])


def test_a_film_under_a_given_field_obeys_28_and_29(monkeypatch: Patch):
    """Point by point: h_t = D (Q - h), Q = -F h³ / 3, F = W h_xxx + K_x, at any K_x and films.

    So steady films have Q - h = C, which is (28), and volume is kept. Differences are of order
    four: h_xxx is that of the volume V whose D is h - 1, with the moments of a fourth derivative.
    """
    for ours, exact in zip(given_field._weights(4), CENTRAL, strict=True):
        assert np.abs(ours - exact).max() < 1e-14  # rounded; below they are fractions
    monkeypatch.setattr(given_field, "_weights", lambda _: tuple(map(np.array, CENTRAL)))
    points, step = 8, sp.pi / 4
    slope, tension = ca.SX.sym("slope", points), ca.SX.sym("W")
    p = [Signal("slope", slope), Signal("W", tension)]
    model = given_field.thin_film(slope, tension, order=4, p=p)
    s = Symbols.of(model, columns={"slope": slope, "W": tension})
    H, flows = s(model["thickness"]), s(model["flow"])
    rates, around = H.jacobian(s["volume"]) * s(model.ode), range(-2, 3)
    weights = [Q(1, 12), -Q(2, 3), 0, Q(2, 3), -Q(1, 12)]
    third = [sp.cancel((-3 * flows[i] / H[i] ** 3 - s["slope"][i]) / s["W"]) for i in range(points)]
    assert zero(sum(H) - points)
    for i in range(points):
        beside = [(i + k) % points for k in around]
        known = sum(w * (flows[k] - H[k]) for w, k in zip(weights, beside, strict=True)) / step
        assert zero(rates[i] - known)
        row = {k: sp.diff(third[i], s["volume"][k - 1]) * step**4 for k in range(1, points)}
        offsets = {(k - i + 4) % points - 4: weight for k, weight in row.items()}
        assert zero(third[i] - sum(w * s["volume"][k - 1] for k, w in row.items()) / step**4)
        if i == 0:  # the volume at the first point is 0, by which no moment of others changes
            moments = [sum(w * k**n for k, w in offsets.items()) for n in range(1, 8)]
            assert moments == [0, 0, 0, 24, 0, 0, 0]


def test_the_bound_of_mean_flow_is_that_of_the_square_wave():
    """Half of the wavelength at 1 + delta, half at 1 - delta: C = -mean h^-2 / mean h^-3."""
    d = COS["delta"]
    squares, cubes = (((1 + d) ** -n + (1 - d) ** -n) / 2 for n in (2, 3))
    assert zero(COS.one(square_wave_flow(DELTA)) - (1 - squares / cubes))
