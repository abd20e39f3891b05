"""docs/equations.md, (16)-(19) and the material: what our Models of the magneto-elastic pair say.

Mass, stiffness, push, frequency, field and friction are symbols.
"""

from functools import cache
from typing import Any

import casadi as ca
import pytest
import sympy as sp
from sympy import Rational as Q

from tests.oracles.by_symbols import Symbols, zero
from wormopt.magnetics.material import MU0, effective_modulus, field_strain, softening
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.systems.pair.exact import magnetic_pair
from wormopt.systems.pair.slow import averaged_pair, slow_pair, steady_form

ABOVE = ("mass", "stiffness", "push", "frequency", "friction_forward", "friction_backward")
GIVEN: Any = {"law": Coulomb(1.0, 2.0), "push": 1.0, "frequency": 1.0}
a, eps, low, high = sp.symbols("a epsilon F^+ F^-", positive=True)
xi, phi, alpha = sp.symbols("xi phi alpha", real=True)


@cache
def exact() -> tuple[Model, Symbols]:
    model = magnetic_pair(**GIVEN)
    return model, Symbols.of(model, positive=ABOVE)


@cache
def slow() -> tuple[Model, Symbols]:
    model = slow_pair(**GIVEN)
    return model, Symbols.of(model, positive=ABOVE)


@cache
def average() -> tuple[Model, Symbols]:
    model = averaged_pair(**GIVEN)
    return model, Symbols.of(model, positive=ABOVE)


def dimensionless(s: Symbols) -> dict[Any, Any]:
    """m = c = 1, P = eps, G = 1 + cos(nu t), and friction alike for both."""
    one = {s["mass"]: 1, s["stiffness"]: 1, s["push"]: eps}
    ground = dict.fromkeys(s["friction_forward"], eps * low)
    ground |= dict.fromkeys(s["friction_backward"], eps * high)
    return one | ground | dict.fromkeys(s["cosines"], 1)


# -- (16), (17) -----------------------------------------------------------------------------------


def test_16_follows_from_lagrange():
    """T = m (x_1'² + x_2'²) / 2, V = c (x_2 - x_1)² / 2; dashpot, friction and +-P G do work."""
    model, s = exact()
    x, v, rates = s["position"], s["velocity"], s(model.ode)
    power = s["push"] * s.one(model["field"]) * (v[1] - v[0]) + s["contact"].dot(v)
    lost = s["damping"] * (v[1] - v[0]) ** 2 / 2
    V = s["stiffness"] * (x[1] - x[0]) ** 2 / 2
    for i in (0, 1):
        law = s["mass"] * rates[2 + i] + sp.diff(V, x[i]) + sp.diff(lost, v[i])
        assert zero(law - sp.diff(power, v[i]))
    assert zero(rates[:2, :] - v)
    waves = [c * sp.cos(k * s["frequency"] * s["t"]) for k, c in enumerate(s["cosines"])]
    assert zero(s.one(model["field"]) - sum(waves))


def test_16_as_printed_in_its_own_units():
    """x_1'' + x_1 - x_2 = -eps [F(x_1') + 1 + cos(nu t)]; our forces are -eps F."""
    model, s = exact()
    x, rates = s["position"], s(model.ode).subs(dimensionless(s)).subs(s["damping"], 0)
    push = 1 + sp.cos(s["frequency"] * s["t"])
    F = [-force / eps for force in s["contact"]]
    assert zero(rates[2] + x[0] - x[1] + eps * (F[0] + push))
    assert zero(rates[3] + x[1] - x[0] + eps * (F[1] - push))


def test_17_moves_as_16_does():
    """Both Models, by the chain rule: positions and velocities from V and (p, q), without loss.

    z = p cos psi + q sin psi, z' = Omega (q cos psi - p sin psi), psi = nu t.
    """
    (one, s), (other, r) = exact(), slow()
    V, (p, q), t = r["center_velocity"], r["swing"], r["t"]
    omega, psi = sp.sqrt(2 * r["stiffness"] / r["mass"]), r["frequency"] * t
    z, rate = p * sp.cos(psi) + q * sp.sin(psi), omega * (q * sp.cos(psi) - p * sp.sin(psi))
    slow_states = sp.Matrix([V, p, q])
    center = sp.Symbol("center")
    places, speeds = sp.Matrix([center - z, center + z]), sp.Matrix([V - rate, V + rate])
    there = dict(zip(s.column("position", "velocity"), [*places, *speeds], strict=True))
    rates = s(one.ode).subs(s["damping"], 0).subs(there, simultaneous=True)

    def moved(expression: Any) -> Any:
        change = expression.jacobian(slow_states) * r(other.ode)
        return change + sp.diff(expression, t) + sp.diff(expression, center) * V

    assert zero(moved(places) - rates[:2, :])
    assert zero(moved(speeds) - rates[2:, :])
    assert zero(sp.Matrix([r.one(c.velocity) for c in other.contacts]) - speeds)


def polar(rates: Any, s: Symbols) -> tuple[Any, Any, Any]:
    """V', a' and xi' from V', p', q' with p = a cos xi, q = a sin xi."""
    p, q = s["swing"]
    turned = {p: a * sp.cos(xi), q: a * sp.sin(xi)}
    V, P, Q_ = (rate.subs(sp.sqrt(p**2 + q**2), a).subs(turned) for rate in rates)
    return V, P * sp.cos(xi) + Q_ * sp.sin(xi), (Q_ * sp.cos(xi) - P * sp.sin(xi)) / a


def test_17_as_printed_but_for_the_phase():
    """V', a' and phi' of our slow Model with phi = psi - xi are those of the text."""
    model, s = slow()
    V, rate, turn = polar(s(model.ode), s)
    nu, omega = s["frequency"], sp.sqrt(2)
    there = {s["t"]: (phi + xi) / nu, **dimensionless(s)}
    F1, F2 = (-force / eps for force in s["contact"])
    push = F1 - F2 + 2 * (1 + sp.cos(phi + xi))
    printed = (
        -eps / 2 * (F1 + F2),
        -eps / (2 * omega) * sp.sin(phi) * push,
        omega - eps / (2 * a * omega) * sp.cos(phi) * push,
    )
    for ours, known in zip((V, rate, nu - turn), printed, strict=True):
        assert zero(sp.expand_trig((ours - known).subs(there)))
    for contact, side in zip(model.contacts, (1, -1), strict=True):
        seen = s.one(contact.velocity).subs(there)
        seen = seen.subs(dict(zip(s["swing"], (a * sp.cos(xi), a * sp.sin(xi)), strict=True)))
        known = s["center_velocity"] + side * a * omega * sp.sin(phi)
        assert zero(sp.expand_trig(seen - known))
    # psi' = V, as printed, is not the rate of the phase nu t of the field
    assert sp.diff(nu * s["t"], s["t"]) == nu != s["center_velocity"]


# -- (18) -----------------------------------------------------------------------------------------


def test_the_velocities_change_sign_at_these_phases():
    """With V = a Omega sin alpha: v_1 ~ sin alpha + sin phi = 2 sin((phi + alpha) / 2) cos(...)."""
    p, q = (phi + alpha) / 2, (phi - alpha) / 2
    assert sp.simplify(2 * sp.sin(p) * sp.cos(q) - sp.sin(phi) - sp.sin(alpha)) == 0
    # affine in phi and |alpha| <= pi / 2, p and q are largest and smallest at the ends of each arc
    quarter = sp.pi / 2
    forward, backward = (-alpha, sp.pi + alpha), (sp.pi + alpha, 2 * sp.pi - alpha)
    for angle, arc, low, high in (
        (p, forward, 0, sp.pi),  # sin p >= 0 on all of the turn
        (p, backward, 0, sp.pi),
        (q, forward, -quarter, quarter),  # cos q >= 0
        (q, backward, quarter, 3 * quarter),  # cos q <= 0
    ):
        corners = [
            angle.subs(phi, end).subs(alpha, side * quarter) for end in arc for side in (-1, 1)
        ]
        assert all(low <= corner <= high for corner in corners)


def mean_of_slow(forces: Any) -> Any:
    """Mean over phi of our slow Model's ode; `forces`: of contact i, arcs (from, to, force)."""
    model, s = slow()
    p, q = s["swing"]
    rates = s(model.ode).subs({p: a * sp.cos(xi), q: a * sp.sin(xi)})
    rates = sp.expand(sp.expand_trig(rates.subs(s["t"], (phi + xi) / s["frequency"])))
    turn = (phi, 0, 2 * sp.pi)
    free = rates.subs(dict.fromkeys(s["contact"], 0))
    found = free.applyfunc(lambda e: sp.integrate(sp.expand(e), turn))
    for i, contact in enumerate(s["contact"]):
        share = rates.diff(contact)
        for start, end, force in forces(s, i):
            found += force * share.applyfunc(lambda e, s=start, t=end: sp.integrate(e, (phi, s, t)))
    return found / (2 * sp.pi)


def both_ways(s: Symbols, i: int) -> list[tuple[Any, Any, Any]]:
    """Contact 0 slides forward for phi from -alpha to pi + alpha, contact 1 half a turn on."""
    start, turn = -alpha + i * sp.pi, sp.pi + 2 * alpha
    ahead, behind = s["friction_forward"][i], s["friction_backward"][i]
    return [(start, start + turn, -ahead), (start + turn, start + 2 * sp.pi, behind)]


def one_way(way: int) -> Any:
    def forces(s: Symbols, i: int) -> list[tuple[Any, Any, Any]]:
        force = -s["friction_forward"][i] if way > 0 else s["friction_backward"][i]
        return [(sp.Integer(0), 2 * sp.pi, force)]

    return forces


def averaged_in_casadi(signs: Any) -> tuple[Any, Symbols, Any]:
    """Our (18) on one branch, with the swing in polar form, and Omega."""
    model, s = average()
    V, (p, q) = s["center_velocity"], s["swing"]
    omega = sp.sqrt(2 * s["stiffness"] / s["mass"])
    top = sp.sqrt(p**2 + q**2) * omega
    rates = s(model.ode, {key(V, top): sign for key, sign in signs})
    rates = rates.subs(sp.sqrt(p**2 + q**2), a).subs({p: a * sp.cos(xi), q: a * sp.sin(xi)})
    return rates.subs(V, a * omega * sp.sin(alpha)), s, omega


SLOWER = (lambda V, top: top - V, 1), (lambda V, top: top + V, 1)


@pytest.mark.parametrize("way", [1, -1])
def test_18_is_the_mean_of_our_17_while_velocities_change_sign(way: int):
    """For all numbers, of either sign of V; friction of both masses may differ."""
    ours, _, _ = averaged_in_casadi([*SLOWER, (lambda V, top: V, way)])
    for part in ours.atoms(sp.asin):
        assert zero(part.args[0] - sp.sin(alpha))
    for part in ours.atoms(sp.Pow):
        if part.exp == Q(1, 2) and part.has(sp.sin(alpha)):
            assert zero(part.base - 1 + sp.sin(alpha) ** 2)  # cos alpha > 0
    root = sp.Wild("root", properties=[lambda e: e.has(sp.sin(alpha))])
    ours = ours.replace(sp.asin, lambda _: alpha).replace(sp.sqrt(root), sp.cos(alpha))
    gap = ours - mean_of_slow(both_ways)
    assert zero(gap.applyfunc(sp.expand_trig))


@pytest.mark.parametrize("way", [1, -1])
def test_18_is_the_mean_of_our_17_while_both_masses_run_one_way(way: int):
    """V' = -eps F+ or +eps F-, and the swing loses nothing, as one constant acts on both."""
    faster = (lambda V, top: V - top, way), (lambda V, top: V + top, way)
    ours, _, _ = averaged_in_casadi([*faster, (lambda V, top: V, way)])
    assert not ours.has(alpha)
    assert zero(ours - mean_of_slow(one_way(way)))


@pytest.mark.parametrize("one_way", [False, True])
def test_18_as_printed_differs_from_our_averages(one_way: bool):
    """In polar form: a' lacks 1 + a times sin xi, xi' 1 + 1/a times cos xi; V' is right.

    Half a turn of xi mends signs only. At rest xi' needs cos xi = 2 Omega Delta: no 1/2 has one.
    """
    model, s = average()
    V, (p, q) = s["center_velocity"], s["swing"]
    omega, delta = sp.sqrt(2), sp.Symbol("Delta", real=True)
    top = sp.sqrt(p**2 + q**2) * sp.sqrt(2 * s["stiffness"] / s["mass"])
    faster = -1 if one_way else 1
    ours = polar(s(model.ode, {V: 1, faster * (top - V): 1, top + V: 1}), s)
    there = {s["frequency"]: omega + eps * delta, **dimensionless(s)}
    ours = [part.subs(there) for part in ours]
    E, share = (high + low) / sp.pi, V / (a * omega)
    lost = sp.Integer(0) if one_way else E * sp.sqrt(1 - share**2)
    corrected = (
        -eps * (low if one_way else E * sp.asin(share) - (high - low) / 2),
        -eps / omega * (lost - sp.sin(xi) / 2),
        eps * (delta + sp.cos(xi) / (2 * a * omega)),
    )
    printed = (
        corrected[0],
        -eps / omega * (lost + a / 2 * sp.sin(xi)),
        eps * (delta - sp.cos(xi) / (2 * omega)),
    )
    gaps = (
        sp.Integer(0),
        -eps / (2 * omega) * (1 + a) * sp.sin(xi),
        -eps / (2 * omega) * (1 + 1 / a) * sp.cos(xi),
    )
    of_half_a_turn = (
        sp.Integer(0),
        -eps / (2 * omega) * (a - 1) * sp.sin(xi),
        eps / (2 * omega) * (1 / a - 1) * sp.cos(xi),
    )
    for mine, right, wrong, gap, rest in zip(
        ours, corrected, printed, gaps, of_half_a_turn, strict=True
    ):
        assert zero(mine - right)
        assert zero(wrong - mine - gap)
        assert zero(wrong - mine.subs(xi, xi + sp.pi) - rest)
    (cosine,) = sp.solve(printed[2], sp.cos(xi))
    assert cosine.subs(delta, Q(1, 2)) == sp.sqrt(2)


# -- (19), material -------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [1, -1])
def test_19_makes_our_18_zero(way: int):
    """Our closed form put into our average, for either sign of Delta; |Phi| < pi / 2."""
    names = ("f", "b", "d")
    symbols = {name: ca.SX.sym(name) for name in names}
    r = Symbols(symbols, positive=("f", "b"))
    signs = {r["d"]: way}
    velocity, swing, lag = (r.one(part, signs) for part in steady_form(*symbols.values()))
    gap, E, Phi = sp.Symbol("g", positive=True), *sp.symbols("E Phi", positive=True)
    # F+ and F- by E and Phi, whose definitions are those of the text
    F_low, F_high = sp.pi * E / 2 - E * Phi, sp.pi * E / 2 + E * Phi
    assert zero((F_low + F_high) / sp.pi - E)
    assert zero(sp.pi / 2 * (F_high - F_low) / (F_high + F_low) - Phi)
    into = {r["f"]: F_low, r["b"]: F_high, r["d"]: way * gap}
    R = sp.Symbol("R", positive=True)

    def told(expression: Any) -> Any:
        plain = sp.cancel(expression.subs(into)) if expression.is_rational_function() else None
        found = expression.subs(into) if plain is None else plain
        return found.replace(lambda e: isinstance(e, sp.cos | sp.sin),
                             lambda e: e.func(sp.cancel(e.args[0])))  # fmt: skip

    roots = {part for part in told(swing).atoms(sp.Pow) if part.exp == Q(1, 2) and part.has(E)}
    for root in roots:
        assert zero(root.base - Q(1, 4) + E**2 * sp.cos(Phi) ** 2)
    V, A, lag = (told(part).subs(dict.fromkeys(roots, R)) for part in (velocity, swing, lag))
    assert zero(V - sp.sin(Phi) * R / gap)
    assert zero(A - R / (sp.sqrt(2) * gap))
    assert isinstance(lag, sp.acos)
    assert zero(lag.args[0] + 2 * way * R)
    # in (18), proven ours above: s = V / (a Omega) = sin Phi, sin xi >= 0 as xi is in [0, pi]
    assert zero(V / (A * sp.sqrt(2)) - sp.sin(Phi))
    assert zero(E * Phi - (F_high - F_low) / 2)  # V': asin(sin Phi) = Phi
    square = 1 - sp.cos(lag) ** 2  # sin² xi
    assert zero(
        (square - (2 * E * sp.cos(Phi)) ** 2).subs(R, sp.sqrt(Q(1, 4) - E**2 * sp.cos(Phi) ** 2))
    )
    assert zero(way * gap + lag.args[0] / (2 * A * sp.sqrt(2)))  # xi'


def test_the_material_is_that_of_the_text():
    """G, u_0 and E_eff of section 3.2, and their product as printed: no field, no change."""
    names = ("mu_r", "eta", "H")
    symbols = {name: ca.SX.sym(name) for name in names}
    mu0 = sp.Symbol("mu0", positive=True)
    s = Symbols(symbols, positive=names, constants={MU0: mu0})
    mu, eta, H = (s[name] for name in names)
    a1 = -Q(2, 5) * (mu - 1) ** 2
    G = mu0 * a1 * H**2 / (2 * eta)
    args = tuple(symbols.values())
    assert zero(s.one(softening(*args)) - G)
    u0 = mu0 * (2 * (mu - 1) - a1) * H**2 / (12 * eta * (1 + 2 * G / 3))
    assert zero(s.one(field_strain(*args)) - u0)
    E = s.one(effective_modulus(*args))
    assert zero(E - 3 * eta * (1 + 2 * G / 3) / (1 + G / 2))
    assert zero(E.subs(H, 0) - 3 * eta)
