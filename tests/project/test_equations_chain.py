"""docs/equations.md, (1)-(15): what our Models of spiked worms, chains and trackers say.

Forces of the ground are free symbols, so that what holds, holds for every law of friction. Where a
builder takes any number of links, all sizes that have every kind of row are proven: rows of inner
masses are made by the same shifted columns, and know their two neighbours only.
"""

from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from sympy import Rational as Q

from tests.oracles.by_symbols import Symbols, zero
from wormopt.control.lambda_tracker import Feedback, lambda_tracker
from wormopt.control.loop import Reference, gait_reference
from wormopt.model.friction import Coulomb, Spike, Stribeck, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Model, pack
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait
from wormopt.systems.spiked.dynamics import driven_worm, spiked_worm

PRIMES = (2.0, 3.0, 5.0, 7.0, 11.0, 13.0)
LINKS = (1, 2, 3, 5)
low, high, v, r = sp.symbols("F^+ F^- v v_reg", positive=True)


def spiked(links: int) -> tuple[Model, Symbols]:
    """Worm with spikes; masses, drag and load are primes, as it takes numbers only."""
    model = spiked_worm(PRIMES[: links + 1], 17.0, 19.0)
    return model, Symbols.of(model)


def along(model: Model, symbols: Symbols, expression: Any) -> Any:
    """Time derivative of an expression of SymPy by the Model's own ode."""
    x = symbols.column(*(s.name for s in model.x))
    rates = symbols(model.ode)
    gradient = sp.Matrix([expression]).jacobian(x)
    return (gradient * rates)[0] + sp.diff(expression, symbols["t"])


def spans(links: int, lengths: Any) -> list[Any]:
    """S_i = l_1 + ... + l_i."""
    column = [lengths] if links == 1 else list(lengths)
    return [sp.Add(*column[:i]) for i in range(links + 1)]


# -- (1) to (7) -----------------------------------------------------------------------------------


@pytest.mark.parametrize("links", LINKS)
def test_1_spikes_are_on_the_velocities_of_the_masses(links: int):
    """Contact i sees x_i' of x_i = x_0 - S_i, and its law lets it slide forward only."""
    model, s = spiked(links)
    for contact, span in zip(model.contacts, spans(links, s["length"]), strict=True):
        assert zero(s.one(contact.velocity) - along(model, s, s["position"] - span))
        assert contact.law.directions == (1,)


@pytest.mark.parametrize("links", LINKS)
def test_2_the_head_moves_with_the_largest_rate_and_a_common_part(links: int):
    """From (1) and (6): with mass k behind which none falls, x_0' = S_k' + w and w = v_k.

    The other masses then have v_i = w + (S_k' - S_i'), and S_k' - S_i' >= 0 as S_k' is the
    largest: all v_i >= 0 where w >= 0; and w >= 0 as v_k is one of them. So (1) is w >= 0.
    """
    model, s = spiked(links)
    rates = [along(model, s, span) for span in spans(links, s["length"])]
    velocities = [s.one(contact.velocity) for contact in model.contacts]
    for k in range(links + 1):  # the leader, case by case
        w = s["velocity"] - rates[k]
        assert zero(velocities[k] - w)
        for i in range(links + 1):
            assert zero(velocities[i] - (w + (rates[k] - rates[i])))


def test_2_as_printed_compares_a_velocity_with_a_length():
    """x_0' >= S_i, without the dot: v_i and what is printed differ by S_i - S_i'."""
    model, s = spiked(2)
    span = spans(2, s["length"])[1]
    printed, ours = s["velocity"] - span, s.one(model.contacts[1].velocity)
    assert zero(printed - ours - (s["rate"][0] - s["length"][0]))


def general_gait() -> Gait:
    """Cubic gait of two links; its numbers are symbols of the Model's schedule."""
    polynomial = np.zeros((2, 2, 4))
    polynomial[:, :, 0], polynomial[0, :, 2], polynomial[0, :, 3] = 2.0, [3.0, -3.0], [-2.0, 2.0]
    polynomial[1, :, 0] = [3.0, 1.0]
    polynomial[1, :, 2], polynomial[1, :, 3] = [-3.0, 3.0], [2.0, -2.0]
    return Gait(np.array([0.0, 1.0, 2.0]), polynomial)


def test_2_of_a_gait_that_is_prescribed():
    """`driven_worm`: with resting mass k, v_i = S_k' - S_i' + w for all gaits and times."""
    model = driven_worm(general_gait(), [1.0, 1.0, 1.0], 1.0, 1.0)
    s = Symbols.of(model)
    rates = [sp.diff(span, s["t"]) for span in spans(2, s(model["length"]))]
    for k in range(3):
        share = {symbol: int(i == k) for i, symbol in enumerate(s["resting"])}
        velocity = s(model["velocity"]).subs(share)
        for i in range(3):
            assert zero(velocity[i] - (rates[k] - rates[i] + s["glide"]))


@pytest.mark.parametrize("links", LINKS)
def test_3_momentum_of_every_mass_of_a_spiked_worm(links: int):
    """m_i x_i'' = -k v_i - Gamma + mu_i - mu_{i+1} + lambda_i, and nothing is left at the tail."""
    model, s = spiked(links)
    loads = s["contact"]
    forces = [sp.Integer(0), *s(model["actuator_force"]), sp.Integer(0)]
    for i, contact in enumerate(model.contacts):
        velocity = s.one(contact.velocity)
        inputs = {s.column("rate")[j]: s.column("acceleration")[j] for j in range(links)}
        acceleration = along(model, s, velocity)
        assert set(inputs) <= s.column("rate").free_symbols
        outer = -17 * velocity - 19 + loads[i]
        assert zero(int(PRIMES[i]) * acceleration - outer - forces[i] + forces[i + 1])


def lagrange(T: Any, V: Any, R: Any, q: list[Any], qd: list[Any], qdd: list[Any]) -> list[Any]:
    """d/dt dT/dq' - dT/dq + dV/dq + dR/dq' of every coordinate."""
    found = []
    for one, rate in zip(q, qd, strict=True):
        momentum = sp.diff(T, rate)
        changed = sum(sp.diff(momentum, a) * b for a, b in zip([*q, *qd], [*qd, *qdd], strict=True))
        found.append(changed - sp.diff(T, one) + sp.diff(V, one) + sp.diff(R, rate))
    return found


@pytest.mark.parametrize("links", LINKS)
def test_3_and_10_of_a_chain_follow_from_lagrange(links: int):
    """T, V of the springs about l0 and Rayleigh's function of the dashpots, for all numbers."""
    model, s = chain_of(links)
    x, velocity = list(s["position"]), list(s["velocity"])
    m, c, d, rest, k = (
        s.column(n) for n in ("mass", "stiffness", "damping", "rest_length", "drag")
    )
    T = sum(m[i] * velocity[i] ** 2 for i in range(links + 1)) / 2
    length = [x[j] - x[j + 1] for j in range(links)]
    rate = [velocity[j] - velocity[j + 1] for j in range(links)]
    V = sum(c[j] * (length[j] - rest[j]) ** 2 for j in range(links)) / 2
    R = sum(d[j] * rate[j] ** 2 for j in range(links)) / 2
    R += sum(k[i] * velocity[i] ** 2 for i in range(links + 1)) / 2
    # power of the inputs u_j l_j', of friction and of the load gives generalised forces
    power = sum(s.column("input")[j] * rate[j] for j in range(links))
    power += sum((s["contact"][i] - s["load"][i]) * velocity[i] for i in range(links + 1))
    acceleration = list(s(model.ode)[links + 1 :])
    equations = lagrange(T, V, R, x, velocity, acceleration)
    for equation, rated in zip(equations, velocity, strict=True):
        assert zero(equation - sp.diff(power, rated))
    assert zero(s(model.ode)[: links + 1, :] - s["velocity"])


def chain_of(links: int, **more: Any) -> tuple[Model, Symbols]:
    """Chain with dry friction; all its numbers are parameters."""
    model = chain(links, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0,
                  law=Coulomb(1.0, 2.0), **more)  # fmt: skip
    return model, Symbols.of(model, positive=("mass", "stiffness", "damping"))


def test_4_a_spike_is_complementary():
    """Sliding without force, rest with any force forward; and smooth spikes tend to that.

    The smooth load f = scale (sqrt(v² + v_reg²) - v) / (2 v_reg) obeys
    f v = v_reg (scale / 4 - f² / scale): with v_reg to 0 and f bounded the product vanishes.
    """
    scale, speed, width = ca.SX.sym("s"), ca.SX.sym("v"), ca.SX.sym("r")
    s = Symbols({"s": scale, "v": speed, "r": width}, positive=("s", "r"))
    law = Spike(scale=scale)
    assert law.directions == (1,)
    assert law.slip_force(speed, 1) == 0
    assert law.stick_interval == (0.0, float("inf"))
    f = s.one(law.smooth(speed, width))
    assert zero(f * s["v"] - s["r"] * (s["s"] / 4 - f**2 / s["s"]))


@pytest.mark.parametrize("sign_of_force", [-1, 0, 1])
def test_5_is_the_only_load_that_satisfies_4_and_newton(sign_of_force: int):
    """At rest the contact's acceleration is (f + lambda) / m, as our chain's own ode says.

    (4) with a >= 0 asks for lambda >= 0, f + lambda >= 0, lambda (f + lambda) = 0: the roots of
    the product are 0 and -f, of which the signs leave (5), and `Spike`'s interval holds it.
    """
    model = chain(2, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, law=Spike())
    s = Symbols.of(model, positive=("mass",))
    size = sp.Symbol("a", positive=True)
    f, rested = sign_of_force * size, sp.sign(0)
    by_5 = -Q(1, 2) * (1 - rested) * (1 - sp.sign(f)) * f
    for i in range(3):
        load = s["contact"][i]
        acceleration = s(model.ode)[3 + i]
        free = acceleration.subs(load, 0) * s["mass"][i]  # f_i of the text before (5)
        assert zero(acceleration * s["mass"][i] - free - load)
    x = sp.Symbol("lambda")
    roots = {root for root in sp.solve(x * (f + x), x) if root >= 0 and f + root >= 0}
    assert roots == {by_5}
    assert Spike().stick_interval == (0.0, float("inf"))  # all loads that (5) ever asks for
    # while it slides forward (5) gives none, as the law does
    assert (1 - sp.sign(size)) * (1 - sp.sign(f)) * f == 0
    assert Spike().slip_force(1.0, 1) == 0.0


@pytest.mark.parametrize("links", LINKS)
def test_6_lengths_are_distances_of_neighbours(links: int):
    """x_{j-1} - x_j = l_j: the rates of both sides are the same, as (1) has v_i = x_0' - S_i'."""
    model, s = spiked(links)
    velocities = [s.one(contact.velocity) for contact in model.contacts]
    for j in range(links):
        apart = velocities[j] - velocities[j + 1]
        assert zero(apart - along(model, s, s.column("length")[j]))
    worm, symbols = chain_of(links)
    places, lengths = symbols["position"], symbols(worm["length"])
    assert zero(lengths - places[:-1, :] + places[1:, :])


def test_7_follows_from_lagrange():
    """One free coordinate x_0, lengths prescribed: T = sum m_i (x_0' - S_i')² / 2.

    Forces -k v_i - Gamma + lambda_i do work on x_0 through all masses. The head of our Model,
    for masses that differ; with equal ones and x_0' = V_0 + w it is (7).
    """
    model = driven_worm(general_gait(), [1.0, 2.0, 3.0], 1.0, 1.0)
    s = Symbols.of(model)
    m, k, gamma, w = s["mass"], s["drag"], s["load"], s["glide"]
    acceleration = s(model.ode)[1]
    lengths = s(model["length"])
    for leader in range(3):
        share = {symbol: int(i == leader) for i, symbol in enumerate(s["resting"])}
        S = [sp.diff(span, s["t"]) for span in spans(2, lengths)]
        bends = [sp.diff(one, s["t"]) for one in S]
        head, head_rate = S[leader] + w, bends[leader] + acceleration.subs(share)
        # d/dt dT/dx_0' with the rates S_i' as functions of time
        momentum = sum(m[i] * (head_rate - bends[i]) for i in range(3))
        outer = sum(-k * (head - one) - gamma for one in S) + s["contact"]
        assert zero(momentum - outer)
        # (7): equal masses, W_0 = V_0 - mean S_i', lambda the mean of the reactions
        M = sp.Symbol("m", positive=True)
        W = S[leader] - sum(S) / 3
        sigma = M * sp.diff(W, s["t"]) + k * W + gamma
        alike = acceleration.subs(share).subs(dict.fromkeys(m, M))
        assert zero(M * alike + k * w + sigma - s["contact"] / 3)


@pytest.mark.parametrize("links", LINKS)
def test_7_is_the_sum_of_all_momentum_laws(links: int):
    """`spiked_worm`, which has loads of its own for all spikes: lambda is their mean."""
    model, s = spiked(links)
    velocities = [s.one(contact.velocity) for contact in model.contacts]
    total = sum(int(m) * along(model, s, one) for m, one in zip(PRIMES, velocities, strict=False))
    mean = s.one(model["reaction_mean"])
    assert zero(mean - sum(s["contact"]) / (links + 1))
    assert zero(total / (links + 1) - (mean - 17 * sum(velocities) / (links + 1) - 19))


def test_7_loads_behind_the_tail_vanish():
    """The loads shared by the resting masses, and (3) from the head down, leave nothing over."""
    model = driven_worm(general_gait(), [1.0, 2.0, 3.0], 1.0, 1.0)
    s = Symbols.of(model)
    shares = s["resting"]
    # all load is carried, once
    whole = {shares[0]: 1 - shares[1] - shares[2]}
    forces = [sp.Integer(0), *s(model["actuator_force"]), sp.Integer(0)]
    velocity = s(model["velocity"])
    for i in range(3):
        bend = sp.diff(velocity[i], s["t"]) + s(model.ode)[1]
        outer = -s["drag"] * velocity[i] - s["load"] + shares[i] * s["contact"]
        gap = s["mass"][i] * bend - outer - forces[i] + forces[i + 1]
        assert zero(gap.subs(whole))


# -- (8) to (12) ----------------------------------------------------------------------------------


def test_8_corrected_is_the_force_of_our_links_and_the_printed_one_is_not():
    model, s = chain_of(2)
    x, rate = s["position"], s["velocity"]
    c, d, u = s["stiffness"], s["damping"], s["input"]
    ours = s(model["link_force"])
    for j in (0, 1):  # link j + 1 of the text
        stretch = x[j] - x[j + 1] - s["rest_length"][j]
        assert zero(ours[j] - (c[j] * stretch + d[j] * (rate[j] - rate[j + 1]) - u[j]))
    # printed, for its link 1: c (x_2 - x_1) + d (x_2' - x_1') + u_1, the other link and sign
    printed = c[0] * (x[2] - x[1]) + d[0] * (rate[2] - rate[1]) + u[0]
    gap = sp.expand(printed - ours[0].subs(s["rest_length"][0], 0))
    assert gap.coeff(u[0]) == 2
    assert gap.coeff(x[0]) == -c[0]


def test_9_dry_friction_case_by_case():
    model, s = chain_of(2)
    law = model.contacts[0].law
    forward, backward = s["friction_forward"][0], s["friction_backward"][0]
    assert s.one(law.slip_force(ca.SX(1), 1)) == -forward
    assert s.one(law.slip_force(ca.SX(-1), -1)) == backward
    assert [s.one(end) for end in law.stick_interval] == [-forward, backward]
    # printed: F0 in (F-, -F+), of which the lower end lies F- + F+ above the upper one
    assert zero((backward - -forward) - (forward + backward))


def test_9_the_smooth_law_is_the_chapters_and_tends_to_the_dry_one():
    """-(5.5 tanh(40 v) - 4.5) for F+ = 1, F- = 10; the limits for v_reg to 0 are those of (9)."""
    ahead, behind, speed, width = (ca.SX.sym(name) for name in ("f", "b", "v", "r"))
    s = Symbols({"f": ahead, "b": behind, "v": speed, "r": width}, positive=("f", "b", "r"))
    smooth = s.one(Coulomb(ahead, behind).smooth(speed, width))
    chapter = -(Q(11, 2) * sp.tanh(40 * s["v"]) - Q(9, 2))
    assert zero(smooth.subs({s["f"]: 1, s["b"]: 10, s["r"]: Q(1, 40)}) - chapter)
    t = sp.Symbol("t", positive=True)
    for sign, known in ((1, -s["f"]), (-1, s["b"])):
        sharp = smooth.subs(s["v"], sign * s["r"] * t)  # v / v_reg = t grows, tanh t tends to 1
        assert zero(sharp.subs(sp.tanh(t), 1) - known)
    assert sp.tanh(sp.oo) == 1
    # as printed, without the sign, it pushes where friction brakes: by F+ at high speed
    printed = -chapter
    assert printed.subs(sp.tanh(40 * s["v"]), 1) == 1


def test_9_variants_blend_their_own_sliding_forces():
    """Stribeck's and viscous friction by the same blend: sliding forces of both sides, tanh."""
    f, b, sf, sb, w, speed, width = (ca.SX.sym(n) for n in "f b sf sb w v r".split())
    s = Symbols(dict(zip("f b sf sb w v r".split(), (f, b, sf, sb, w, speed, width), strict=True)))
    fall = sp.exp(-((s["v"] / s["w"]) ** 2))
    ahead, behind = (-(s[c] + (s[h] - s[c]) * fall) for c, h in (("f", "sf"), ("b", "sb")))
    law = Stribeck(f, b, sf, sb, w)
    assert zero(s.one(law.slip_force(speed, 1)) - ahead)
    assert zero(s.one(law.slip_force(speed, -1)) + behind)
    blend = (ahead - behind) / 2 + (ahead + behind) / 2 * sp.tanh(s["v"] / s["r"])
    assert zero(s.one(law.smooth(speed, width)) - blend)
    assert zero(s.one(Viscous(f).smooth(speed, width)) + s["f"] * s["v"])


def test_10_corrected_is_our_chain_of_three_and_the_printed_row_is_not():
    model, s = chain_of(2)
    (x0, x1, x2), (v0, v1, v2) = s["position"], s["velocity"]
    (c1, c2), (d1, d2), (u1, u2) = s["stiffness"], s["damping"], s["input"]
    F0, F1, F2 = s["contact"]
    corrected = [
        -c1 * (x0 - x1) - d1 * (v0 - v1) + F0 + u1,
        c1 * (x0 - x1) - c2 * (x1 - x2) + d1 * (v0 - v1) - d2 * (v1 - v2) + F1 + u2 - u1,
        c2 * (x1 - x2) + d2 * (v1 - v2) + F2 - u2,
    ]
    bare = {symbol: 0 for name in ("rest_length", "drag", "load") for symbol in s.column(name)}
    momenta = [s["mass"][i] * s(model.ode)[3 + i].subs(bare) for i in range(3)]
    for row, momentum in zip(corrected, momenta, strict=True):
        assert zero(row - momentum)
    printed = c2 * (x0 - x1) - c1 * (x1 - x2) + d2 * (v0 - v1) - d1 * (v1 - v2) + F1 + u2 - u1
    gap = (c2 - c1) * (x0 - x2) + (d2 - d1) * (v0 - v2)
    assert zero(printed - momenta[1] - gap)
    assert zero(gap.subs({c2: c1, d2: d1}))  # and only there, as x0 - x2 is free


def held(plant: Model, s: Symbols) -> Reference:
    """Reference of two links that is any cubic of time."""
    numbers = np.arange(8.0).reshape(1, 2, 4) + 1
    return gait_reference(Gait(np.array([0.0, 1.0]), numbers), plant.t, periodic=False)


def tracked(feedback: Feedback, **more: Any) -> tuple[Model, Symbols, Any, Any]:
    """Chain of two links under a tracker: the loop, its symbols, and e and u in SymPy."""
    plant, s = chain_of(2)
    loop = lambda_tracker(plant, held(plant, s), tube_radius=0.2, feedback=feedback, **more)
    symbols = Symbols.of(loop, positive=("tube_radius", "gain", "gain_growth"))
    return loop, symbols, symbols(loop["error"]), loop["input"]


def test_11_trackers_move_rest_lengths_by_their_stiffness():
    """u_j = c_j times the command: in (8), the rest length is l0_j + u_j / c_j."""
    signs_of_force: dict[Any, int] = {}
    forces = []
    for actuator in ("force", "rest_length"):
        _, s, e, u = tracked("derivative", actuator=actuator)
        forces.append(s(u, outside(s, e, signs_of_force)))
    c = s["stiffness"]
    for j in (0, 1):
        assert zero(forces[1][j] - c[j] * forces[0][j])
    model, s = chain_of(2)
    link, command = s(model["link_force"]), sp.symbols("l_1 l_2")
    for j in (0, 1):
        moved = link[j].subs(s["rest_length"][j], s["rest_length"][j] + command[j])
        pushed = link[j].subs(s["input"][j], s["input"][j] + s["stiffness"][j] * command[j])
        assert zero(moved - pushed)


def test_12_outputs_are_distances():
    model, s = chain_of(2)
    x = s["position"]
    assert zero(s(model["length"]) - sp.Matrix([x[0] - x[1], x[1] - x[2]]))
    assert zero(sp.Matrix([along(model, s, y) for y in s(model["length"])]) - s(model["rate"]))


# -- (13) to (15) ---------------------------------------------------------------------------------


def outside(s: Symbols, e: Any, more: Any = ()) -> dict[Any, int]:
    """|e| is larger than lambda."""
    return {e.dot(e) - s["tube_radius"] ** 2: 1, **dict(more)}


def within(s: Symbols, e: Any) -> dict[Any, int]:
    return {e.dot(e) - s["tube_radius"] ** 2: -1}


@pytest.mark.parametrize("case", [outside, within])
@pytest.mark.parametrize("feedback", ["derivative", "filter"])
def test_13_and_14_with_time_derivatives_of_the_loop_itself(feedback: Feedback, case: Any):
    """u = -(k s + d/dt(k s)) with s = e (13) or theta (14), d/dt by the loop's own ode.

    Lengths do not know u before their second derivative, so that nothing is circular. In and out
    of the tube: there k' = gamma (|e| - lambda)², here 0.
    """
    loop, s, e, u = tracked(feedback)
    signs = case(s, e)
    k, rates = s["gain"], s(loop.ode, signs)
    fed = e if feedback == "derivative" else s["filter"]
    x = s.column(*(signal.name for signal in loop.x))
    product = k * fed
    total = product.jacobian(x) * rates + sp.diff(product, s["t"])
    assert zero(s(u, signs) + product + total)
    growth = s.one(loop["gain_rate"], signs)
    size = sp.sqrt(e.dot(e))
    known = s["gain_growth"] * (size - s["tube_radius"]) ** 2 if case is outside else sp.Integer(0)
    assert zero(growth - known)
    if feedback == "filter":
        assert zero(rates[-2:, :] - k**2 * (e - s["filter"]))
        assert not s(u, signs).has(*s["velocity"])  # no derivative of the output


PRINTED_15 = {  # by thirds of the period: l_1, then l_2
    0: ("1 - e*(-1 + cos(3*pi*t))", "1 - e*(1 - cos(3*pi*t))"),
    1: ("1 - e*(-1 + cos(3*pi*t))", "1 - 2*e"),
    2: ("1", "1 - e*(1 + cos(3*pi*t))"),
}


@pytest.mark.parametrize(("rest", "elongation"), [(2.0, 0.15), (1.0, 0.25)])
def test_15_is_our_fast_gait(rest: float, elongation: float):
    """Piece by piece for all t; in l0 and l0 e it is linear, so two pairs of them are all."""
    gait, time = fast_gait(1.0, rest, elongation), ca.SX.sym("t")
    reference = gait_reference(gait, time)
    schedule = reference.schedule
    assert schedule is not None
    t, e = sp.Symbol("t", real=True), sp.Symbol("e")
    read: Any = sp.sympify
    slope: Any = sp.diff
    ends = []
    for piece, printed in PRINTED_15.items():
        numbers = [*schedule.values[piece], schedule.breaks[piece]]
        symbols = ca.vertcat(schedule.symbol, schedule.begin)
        ours = Symbols({"t": time})(ca.substitute(reference.value, symbols, ca.DM(numbers)))
        known = [read(one, {"t": t, "e": e}).subs(e, Q(str(elongation))) for one in printed]
        for one, other in zip(ours, known, strict=True):
            assert zero(one - Q(str(rest)) * other)
        ends.append((known, Q(piece, 3), Q(piece + 1, 3)))
    for (a, _, end), (b, start, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        for one, other in zip(a, b, strict=True):  # of one piece into the next, with its slope
            for order in (0, 1):
                gap = slope(one, t, order).subs(t, end) - slope(other, t, order).subs(t, start)
                assert sp.simplify(gap) == 0
    first, second = ends[0][0]  # in one list, both would be the length from 0 to T / 3
    assert sp.simplify(first - second).subs(t, Q(1, 6)) == 2 * Q(str(elongation))


def test_pack_is_the_order_of_symbols():
    """What these proofs rest on: columns of `Symbols` are the Model's states in their order."""
    model, s = chain_of(2)
    names = [signal.name for signal in model.x]
    assert s(pack(model.x)) == s.column(*names)
