"""docs/equations.md, peristaltic worms: what our segments, chains and drags say.

Sizes of segments are symbols, in spite of the classes' own checks of numbers, unless a builder
takes numbers only.
"""

from typing import Any

import casadi as ca
import pytest
import sympy as sp
from sympy import Rational as Q

from tests.oracles.by_symbols import Symbols, unchecked, zero
from wormopt.magnetics.material import MU0
from wormopt.systems.peristaltic import membranes
from wormopt.systems.peristaltic.chain import Bed, Body, DragGround, DryGround, peristaltic_worm
from wormopt.systems.peristaltic.drag import drag_worm
from wormopt.systems.peristaltic.drag_gaits import area_matrix, cost_matrix
from wormopt.systems.peristaltic.membranes import (
    Fibres,
    balloon_problem,
    barrel_swelling,
    determinant,
    fill_at,
    free_stretch,
    loading_at,
)
from wormopt.systems.peristaltic.segment import Segment, curvatures, density, slopes
from wormopt.systems.peristaltic.tables import Tube

NAMES = ("L", "R", "h", "G", "c", "a", "lam", "th", "p", "R_t", "N")
CA = {name: ca.SX.sym(name) for name in NAMES}
S = Symbols(CA, positive=set(NAMES) - {"N"})
L, R, h, G, c, a, lam, th, p, R_t, pull = (S[name] for name in NAMES)
STIFF = 2 * sp.pi * R * G * h


def segment(**more: Any) -> Segment:
    sizes = {"length": CA["L"], "radius": CA["R"], "wall": CA["h"], "shear_modulus": CA["G"],
             "coil_share": CA["c"], "neo_hookean": CA["a"]}  # fmt: skip
    return unchecked(Segment, **(sizes | more))


OUT = {lam - c: 1}  # the segment is longer than its coil


# -- membrane -------------------------------------------------------------------------------------


def test_energy_is_mooneys_of_an_incompressible_wall():
    """I1 and I2 of the stretches lam, th and 1 / (lam th), which keep the wall's volume."""
    squares = [lam**2, th**2, 1 / (lam * th) ** 2]
    first, second = sum(squares), sum(1 / one for one in squares)
    assert zero(sp.prod(squares) - 1)
    ours = S.one(density(CA["lam"], CA["th"], CA["a"]))
    assert zero(ours - (a * first + (1 - a) * second - 3) / 2)
    gradient = [sp.diff(ours, one) for one in (lam, th)]
    assert zero(S(ca.vertcat(*slopes(CA["lam"], CA["th"], CA["a"]))) - sp.Matrix(gradient))
    seconds = [sp.diff(ours, lam, 2), sp.diff(ours, lam, th), sp.diff(ours, th, 2)]
    assert zero(S(ca.vertcat(*curvatures(CA["lam"], CA["th"], CA["a"]))) - sp.Matrix(seconds))


def test_an_even_pressure_does_nothing_to_a_sealed_cylinder():
    """Volume kept: th = lam^(-1/2). Then w_th = 0, the pressure w_th G h / (R lam th) is 0."""
    around = S.one(slopes(CA["lam"], CA["th"], CA["a"])[1])
    assert zero(around.subs(th, 1 / sp.sqrt(lam)))
    assert zero(S.one(segment().radius_at(CA["lam"])) ** 2 * L * lam - R**2 * L)


def test_pulls_of_a_segment_are_derivatives_of_its_energies():
    """Membrane, and a field p over c L of it: energy -p (V / l) c L, so p pi R² c / lam²."""
    one = segment()
    energy = S.one(one.energy(CA["lam"]))
    assert zero(energy - L * STIFF * S.one(density(CA["lam"], CA["lam"] ** -0.5, CA["a"])))
    elastic = S.one(one.elastic_pull(CA["lam"]))
    assert zero(elastic - sp.diff(energy, lam) / L)
    assert zero(elastic.subs(a, 1) - STIFF * (lam - lam**-2))
    field = S.one(one.magnetic_energy(CA["lam"], CA["p"]), OUT)
    area = sp.pi * R**2 / lam  # V / l
    assert zero(field + p * area * c * L)
    coil = S.one(one.coil_pull(CA["lam"], CA["p"]), OUT)
    assert zero(coil - sp.diff(field, lam) / L)
    assert zero(coil - p * sp.pi * R**2 * c / lam**2)
    # within the even field its energy does not know the length, and nothing pulls
    inside = {lam - c: -1}
    assert S.one(one.coil_pull(CA["lam"], CA["p"]), inside) == 0
    assert not S.one(one.magnetic_energy(CA["lam"], CA["p"]), inside).has(lam)


def test_unloaded_segment_in_closed_form():
    """lam³ = 1 - kappa c / 2; in the best coil, c = lam, lam³ + kappa lam / 2 = 1."""
    one = segment()
    kappa = S.one(one.loading(CA["p"]))
    assert zero(kappa - p * R / (G * h))
    surplus = (
        S.one(one.elastic_pull(CA["lam"])) + S.one(one.coil_pull(CA["lam"], CA["p"]), OUT)
    ).subs(a, 1)
    assert zero(surplus * lam**2 / STIFF - (lam**3 - 1 + kappa * c / 2))
    assert zero((surplus * lam**2 / STIFF).subs(c, lam) - (lam**3 - 1 + kappa * lam / 2))


def test_a_rigid_tube_is_pressed_by_minus_the_derivative_of_the_energy():
    """At lam_c = (R / R_t)² the energy less the work of a pull N falls with R_t at the rate N_w."""
    one, tube = segment(), unchecked(Tube, radius=CA["R_t"], friction=0.0)
    contact = (R / R_t) ** 2
    U = S.one(one.energy(CA["lam"])) + S.one(one.magnetic_energy(CA["lam"], CA["p"]), OUT)
    U = (U - pull * L * lam).subs(lam, contact)
    # stretch_at_contact compares numbers; its formula is lam^(-1/2) R = R_t
    assert zero(S.one(one.radius_at(CA["lam"])).subs(lam, contact) - R_t)
    surplus = S.one(one.coil_pull(CA["lam"], CA["p"]), OUT) + S.one(one.elastic_pull(CA["lam"]))
    F = surplus.subs(lam, contact) - pull
    assert zero(2 * L * contact / R_t * F + sp.diff(U, R_t))
    numbers = Segment(1.0, 1.0, 1.0, 1.0, coil_share=0.125)
    told = Symbols({"p": CA["p"], "N": CA["N"]}, positive=["p"])
    ours = told.one(Tube(2.0, 0.0).normal_force(numbers, CA["p"], CA["N"]))
    data = {L: 1, R: 1, h: 1, G: 1, c: Q(1, 8), a: 1, R_t: 2}
    assert zero(ours - (2 * L * contact / R_t * F).subs(data))
    assert tube.radius is CA["R_t"]


def test_a_bed_pushes_by_its_energy():
    """p = k (r - R_t): pushed longer by p pi r², pressed by 2 p V / r, both from one energy."""
    one, stiff = segment(), ca.SX.sym("k")
    s = Symbols({**CA, "k": stiff}, positive={*NAMES, "k"} - {"N"})
    bed = unchecked(Bed, tube=unchecked(Tube, radius=CA["R_t"], friction=0.0), stiffness=stiff)
    radius = R / sp.sqrt(lam)
    on = {radius - R_t: 1}
    energy = s.one(bed.energy(one, CA["lam"]), on)
    depth = radius - R_t
    assert zero(s.one(bed.pressure(one, CA["lam"]), on) - s["k"] * depth)
    push = s.one(bed.push(one, CA["lam"]), on)
    assert zero(push - sp.pi * radius**2 * s["k"] * depth)
    assert zero(sp.diff(energy, lam) / L + push)
    normal = s.one(bed.normal_force(one, CA["lam"]), on)
    assert zero(normal - s["k"] * depth * 2 * sp.pi * radius * L * lam)
    off = {radius - R_t: -1}
    assert [s.one(f(one, CA["lam"]), off) for f in (bed.pressure, bed.push, bed.energy)] == [0] * 3


def test_inflated_tubes_are_at_rest_and_their_limit_is_that_of_the_hessian():
    """Stationary: w - kappa th² lam / 2; free ends in closed form, load of the wall, stability."""
    th_ = CA["th"]
    w = S.one(density(CA["lam"], th_, CA["a"]))
    kappa = sp.Symbol("kappa")
    total = w - kappa * th**2 * lam / 2
    free, loading = S.one(free_stretch(th_)), S.one(loading_at(th_))
    square = sp.Symbol("q", positive=True)  # lam², neo-Hookean
    energy = total.subs(a, 1)
    from_wall = sp.solve(sp.diff(energy, th), kappa)[0]
    ends = sp.numer(sp.together(sp.diff(energy, lam).subs(kappa, from_wall)))
    assert zero(sp.cancel(ends.subs(lam, sp.sqrt(square))).subs(square, free**2))
    assert zero(loading - from_wall.subs(lam, free))
    hessian = sp.hessian(energy, (lam, th)).subs(kappa, from_wall).det()
    assert zero(S.one(determinant(th_)) - hessian.subs(lam, free))


def test_inflated_tubes_of_mooneys_rubber_too():
    """Any share a: the quadratic of lam² is that of both balances."""
    w = S.one(density(CA["lam"], CA["th"], CA["a"]))
    x = S.one(free_stretch(CA["th"], CA["a"])) ** 2
    ends = sp.diff(w, lam) * 2 * lam - th * sp.diff(
        w, th
    )  # kappa th² / 2 = w_lam, kappa th lam = w_th
    square = sp.Symbol("q", positive=True)
    assert zero(sp.cancel(sp.expand(ends * lam**2).subs(lam, sp.sqrt(square))).subs(square, x))


def test_barrel_holds_the_volume_of_its_cylinder():
    """pi int r² over the length, r = R + (r_max - R)(1 - s²), is pi R² L."""
    ours, share = S.one(barrel_swelling(CA["lam"])), sp.Symbol("s")
    bulge = sp.Symbol("b")
    volume = sp.integrate(sp.expand((1 + bulge * (1 - share**2)) ** 2), (share, -1, 1)) / 2
    assert zero((volume * lam - 1).subs(bulge, ours - 1))


def test_membrane_of_the_true_shape_balances_forces_along_and_across():
    """d/ds of the tension's two components: pressure on a cut acts along the axis and across it.

    Along, w_1 cos phi - kappa rho² / 2 does not change; across, w_1 sin phi changes by the hoop's
    tension less the pressure. w - lam_1 w_1 is kept too, as the wall is alike along itself.
    """
    problem = balloon_problem("pressure", 1.0)
    s = Symbols({"y": problem.y, "kappa": problem.p, "given": problem.given})
    rho, _, lam1, phi, _ = s["y"]
    kappa = s["kappa"]
    rates = s(problem.ode)

    def change(expression: Any) -> Any:
        return (sp.Matrix([expression]).jacobian(s["y"]) * rates)[0]

    w = density_in_sympy(lam1, rho)
    tension = sp.diff(w, lam1)
    assert zero(change(tension * sp.cos(phi) - kappa * rho**2 / 2))
    assert zero(change(w - lam1 * tension))
    # across, per unstressed length: (w_1 sin phi)' = w_2 - kappa rho lam_1 cos phi
    half = s.column("given")[2] / 2
    across = change(tension * sp.sin(phi)) / half
    assert zero(across - (sp.diff(w, rho) - kappa * rho * lam1 * sp.cos(phi)))


def density_in_sympy(stretch: Any, hoop: Any) -> Any:
    """Neo-Hookean."""
    return (stretch**2 + hoop**2 + 1 / (stretch * hoop) ** 2 - 3) / 2


def test_fibres_pull_by_their_volume_and_lock_where_it_is_largest(monkeypatch: pytest.MonkeyPatch):
    """lam = cos al / cos al0, th = sin al / sin al0 keep the fibres' length; pull = p dV/dl."""
    monkeypatch.setattr(membranes, "math", ca)
    angle, start = ca.SX.sym("al"), ca.SX.sym("al0")
    s = Symbols({**CA, "al": angle, "al0": start}, positive=set(NAMES) - {"N"})
    wound = unchecked(Fibres, segment=segment(), angle=start)
    al, al0 = s["al"], s["al0"]
    stretch, hoop = s(ca.vertcat(*wound.stretches(angle)))
    # a fibre of unit length: along it cos al0, round it sin al0 of the unstressed wall
    assert zero((stretch * sp.cos(al0)) ** 2 + (hoop * sp.sin(al0)) ** 2 - 1)
    volume = s.one(wound.volume(angle))
    length = L * stretch
    by_length = sp.diff(volume, al) / sp.diff(length, al)
    assert zero(s.one(wound.pull(angle, CA["p"])) + p * by_length)
    energy = s.one(wound.energy(angle))
    assert zero(s.one(wound.elastic_pull(angle)) - sp.diff(energy, al) / sp.diff(length, al))
    monkeypatch.undo()
    fill = s.one(fill_at(angle))
    neutral: Any = {sp.cos(al): 1 / sp.sqrt(3), sp.sin(al): sp.sqrt(Q(2, 3))}  # tan² = 2
    assert zero(sp.diff(fill, al).subs(neutral))
    assert zero(fill.subs(neutral) - 1)


# -- chain ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("clamped", [False, True])
@pytest.mark.parametrize("segments", [1, 2, 3])
def test_chain_follows_from_lagrange(segments: int, clamped: bool):
    """Rings with half of both neighbours' masses, membranes, coils, dashpots, load, friction.

    Numbers of two kinds of segments in turn; forces of the ground are free.
    """
    kinds = [Segment(1.0, 0.5, 1.0, 1.0, coil_share=0.25), Segment(2.0, 0.25, 1.0, 3.0)]
    body = Body([kinds[j % 2] for j in range(segments)], mass=2.0, damping=3.0, mu_r=2.0,
                load=float(segments), gravity=1.0)  # fmt: skip
    model = peristaltic_worm(body, DryGround(0.25, 0.5), "clamp" if clamped else "mid")
    mu0 = sp.Symbol("mu0", positive=True)
    s = Symbols.of(model, constants={MU0: mu0})
    x, v, n = s["position"], s["velocity"], segments
    lengths = [sp.Symbol(f"l{j}", positive=True) for j in range(n)]
    apart = {x[j]: sum(lengths[j:], x[n]) for j in range(n)}  # all longer than their coils
    masses = [1, *[2] * (n - 1), 1]
    V = R_ = sp.Integer(0)
    for j in range(n):
        one = body.segments[j]
        size, radius, share = (sp.nsimplify(k) for k in (one.length, one.radius, one.coil_share))
        stretch = (x[j] - x[j + 1]) / size
        stiff = 2 * sp.pi * radius * sp.nsimplify(one.shear_modulus)
        V += size * stiff * (stretch**2 + 2 / stretch - 3) / 2
        V -= mu0 * s.column("field")[j] ** 2 / 2 * sp.pi * radius**2 * size * share / stretch
        R_ += 3 * (v[j] - v[j + 1]) ** 2 / 2
    power = -sum(v[i] * masses[i] for i in range(n + 1)) * Q(n, 2 * n)
    seen = list(v) if clamped else [(v[j] + v[j + 1]) / 2 for j in range(n)]
    for contact, force, speed in zip(model.contacts, s.column("contact"), seen, strict=True):
        assert zero(s.one(contact.velocity) - speed)
        power += force * speed
    coils = [sp.nsimplify(one.length * one.coil_share) for one in body.segments]
    longer = {x[j] - x[j + 1] - coils[j]: 1 for j in range(n)}
    ode = s(model.ode, longer)
    for i in range(n + 1):
        law = masses[i] * ode[n + 1 + i] + sp.diff(V, x[i]) + sp.diff(R_, v[i])
        assert zero((law - sp.diff(power, v[i])).subs(apart))


# -- drag -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [2, 3])
def test_drags_of_all_segments_sum_to_zero(segments: int):
    """In units of L and c0: sum c(l_j) u_j' = 0, u_j the middles of segments."""
    model = drag_worm(segments, 1.0)
    s = Symbols.of(model, positive=("length",))
    rate = s["rate"]
    powers = {one ** s["exponent"]: sp.Symbol(f"c{j}", positive=True)
              for j, one in enumerate(s["length"])}  # fmt: skip
    behind = [sum(rate[:j]) + rate[j] / 2 for j in range(segments)]  # of the head's own rate
    mean = s.one(model["speed"]).subs(powers)
    velocities = [mean + sum(behind) / segments - one for one in behind]
    assert zero(sum(k * v for k, v in zip(powers.values(), velocities, strict=True)))
    # dissipation along every segment, of which the ends move by half of its rate
    at, speed = sp.Symbol("at"), sp.Symbol("speed")
    lost: Any = sum(
        k * sp.integrate(sp.expand((v - mean + speed + r * at) ** 2), (at, -Q(1, 2), Q(1, 2)))
        for k, v, r in zip(powers.values(), velocities, rate, strict=True)
    )
    assert zero(lost.subs(speed, mean) - s.one(model["dissipation"]).subs(powers))


@pytest.mark.parametrize("segments", [2, 3])
def test_way_of_small_gaits_is_that_of_the_area_matrix(segments: int):
    """To second order dX = (a L / N) int e^T K e': the speed's first variation, less what repeats.

    Its matrix A (speed = e^T A e') and (a L / N) K differ by a symmetric one, whose form is the
    derivative of e^T (A - A') e / 2. Without exponent the speed is 0: no gait moves at all.
    """
    model = drag_worm(segments, 1.0)
    s = Symbols.of(model, positive=("length",))
    speed, size, rate = s.one(model["speed"]), s["length"], s["rate"]
    still = dict.fromkeys(size, 1)
    assert zero(speed.subs(still))
    assert zero(speed.subs(s["exponent"], 0))
    A = sp.Matrix(segments, segments, lambda j, k: sp.diff(speed, size[j], rate[k]).subs(still))
    K = sp.Matrix(segments, segments, lambda j, k: (sp.sign(j - k) - Q(j - k, segments)) / 2)
    ours = sp.Matrix(area_matrix(segments).tolist()).applyfunc(
        lambda e: sp.nsimplify(e, rational=True)
    )
    assert zero((ours - K).applyfunc(lambda e: 0 if abs(e) < Q(1, 10**15) else e))
    gap = A - s["exponent"] / segments * K
    assert zero(gap - gap.T)


def test_cost_of_drag_of_small_gaits():
    """Dissipation of uniform drag: e'^T M e' with M = S^T S + 1 / 12, in our own numbers."""
    model = drag_worm(3, 0.0)
    s = Symbols.of(model, positive=("length",))
    lost = s.one(model["dissipation"]).subs(s["exponent"], 0)
    M = sp.hessian(lost, list(s["rate"])) / 2
    ours = sp.Matrix(cost_matrix(3, "dissipation").tolist())
    assert all(abs(gap) < 1e-15 for gap in (ours - M))


def test_ground_of_a_segment():
    """Drag c0 (l / L)^a; dry friction in proportion to the weight."""
    s = Symbols({"lam": CA["lam"], "G": CA["G"]}, positive=("lam", "G"))
    assert zero(s.one(DragGround(2.0, -1.0).law(CA["lam"]).drag) - 2 / s["lam"])
    law = DryGround(0.25, 0.5).law(0, CA["G"])
    assert zero(
        sp.Matrix([s.one(law.forward), s.one(law.backward)])
        - s["G"] * sp.Matrix([Q(1, 4), Q(1, 2)])
    )
