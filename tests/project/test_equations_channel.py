"""docs/equations.md, (32)-(36), the elastica and the rod: what our functions and Models say."""

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from math import comb
from typing import Any
from unittest import mock

import casadi as ca
import pytest
import sympy as sp
from sympy import Rational as Q

from tests.oracles.by_symbols import Symbols, zero
from wormopt.model.model import Model
from wormopt.systems.channel import closed_forms
from wormopt.systems.channel.closed_forms import (
    Shape,
    arc_length,
    center_line,
    segment_count,
    velocity_per_frequency,
)
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod
from wormopt.systems.channel.segments import CLOSINGS, Closing, elastica, slender_guess

SIZES = {name: ca.SX.sym(name) for name in ("x", "L", "d", "w", "l_s", "k", "l_w")}
S = Symbols(SIZES, positive=SIZES)
x, L, d, w, l_s, k_s, l_w = (S[name] for name in SIZES)
H = d - w


def line_of(shape: Shape) -> Any:
    """Our centre line in SymPy."""
    return S.one(center_line(shape, *(SIZES[name] for name in "xLdw")))


def length_of(shape: Shape) -> Any:
    return S.one(arc_length(shape, SIZES["L"], SIZES["d"] - SIZES["w"]))


# -- (32) -----------------------------------------------------------------------------------------


def cycle(segments: int) -> tuple[list[Any], int]:
    """Move a straight body by a window of three coils that travels forward, switch by switch.

    Nodes 0 to k join its segments; a segment between two coils that are on is bent, and L long
    instead of l_s. Bent segments press on the walls and hold. So one that bends draws back what
    lies in front of it, and one that stretches pushes back what lies behind it. Gives the ways of
    the nodes, and the number of switches.
    """
    ways = [sp.Integer(0)] * (segments + 1)
    bent: set[int] = set()
    switches = 0
    for front in range(segments + 3):  # node at which the foremost coil is
        switches += 1
        window = range(front - 2, front + 1)
        now = {j for j in range(segments) if j in window and j + 1 in window}
        for j in sorted(now - bent):  # nodes j + 1 and on are drawn back
            ways = [way - (l_s - L) * int(i > j) for i, way in enumerate(ways)]
        for j in sorted(bent - now):  # nodes up to j are pushed back
            ways = [way - (l_s - L) * int(i <= j) for i, way in enumerate(ways)]
        bent = now
    assert not bent  # straight again, as it began
    return ways, switches


@pytest.mark.parametrize("segments", range(1, 9))
def test_32_by_counting_switches_and_segments(segments: int):
    """Every segment bends once and stretches once, so node i goes back i + (k - i) times.

    That is k_s (l_s - L) for every node, against the field, in k_s + 3 switches of the time 1 / n;
    our velocity for one switch per second is the size of their quotient. Node by node the counts
    are i and k - i for any k.
    """
    ways, switches = cycle(segments)
    assert switches == segments + 3
    for way in ways:
        assert zero(way + segments * (l_s - L))
    ours = S.one(velocity_per_frequency(SIZES["L"], SIZES["l_s"], SIZES["k"]))
    assert zero(ours.subs(k_s, segments) + ways[0] / switches)
    assert closed_forms.DIRECTION == -1
    assert zero(ours - k_s * (l_s - L) / (k_s + 3))


def test_32_counts_by_the_nearest_integer_where_the_floor_as_printed_does_not_fit():
    """Sample 1, line: l_w / l_s = 48 / sqrt(149), of which the floor is 3; 1.26 n needs 4."""
    ratio = l_w / l_s
    args = SIZES["l_w"], SIZES["l_s"]
    assert S.one(segment_count(*args, "floor")) == sp.floor(ratio)
    nearest = S.one(segment_count(*args, "nearest"))
    assert nearest == sp.floor(ratio + Q(1, 2))
    sample = {l_w: 48, l_s: sp.sqrt(149)}
    assert sp.floor(ratio.subs(sample)) == 3
    assert nearest.subs(sample) == 4
    speed = {count: count * (sp.sqrt(149) - 10) / (count + 3) for count in (3, 4)}
    assert Q("1.255") < speed[4] < Q("1.265")
    assert speed[3] < Q("1.255")


# -- (33) to (36) ---------------------------------------------------------------------------------


def test_33_is_our_sine_with_its_shift():
    ours = line_of("sine")
    assert zero(ours - (d / 2 + H / 2 * sp.sin(sp.pi * (x - L / 2) / L)))
    assert [zero(ours.subs(x, at) - known) for at, known in ((0, w / 2), (L, d - w / 2))] == [
        True
    ] * 2
    printed = H / 2 * sp.sin(sp.pi * x / L)
    assert printed.subs(x, 0) == printed.subs(x, L) == 0  # from a wall to itself
    assert zero(sp.diff(printed, x).subs(x, x - L / 2) - sp.diff(ours, x))  # its length is the same


def test_33_length_is_a_quarter_of_an_ellipse(monkeypatch: pytest.MonkeyPatch):
    """1 + y'² = 1 + s sin²(pi x / L): L times a mean over a quarter turn; axes 1, sqrt(1 + s)."""
    monkeypatch.setattr(closed_forms, "_ellipse", lambda longest: longest)
    longest = length_of("sine") / L
    slope = sp.diff(line_of("sine"), x)
    assert zero(slope**2 - (longest**2 - 1) * sp.sin(sp.pi * x / L) ** 2)


class Series:
    """Power series with exact coefficients, as far as they are kept."""

    def __init__(self, coefficients: list[Fraction]) -> None:
        self.c = coefficients

    def _with(self, other: Any, by: Callable[[Any, Any], Any]) -> "Series":
        rest = [Fraction(0)] * (len(self.c) - 1)
        theirs = other.c if isinstance(other, Series) else [Fraction(other), *rest]
        return Series([by(a, b) for a, b in zip(self.c, theirs, strict=True)])

    def __add__(self, other: Any) -> "Series":
        return self._with(other, lambda a, b: a + b)

    def __sub__(self, other: Any) -> "Series":
        return self._with(other, lambda a, b: a - b)

    def __mul__(self, other: Any) -> "Series":
        b = other.c if isinstance(other, Series) else [Fraction(other)]
        size = len(self.c)
        found = [Fraction(0)] * size
        for i, one in enumerate(self.c):
            for j, two in enumerate(b[: size - i]):
                found[i + j] += one * two
        return Series(found)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> "Series":
        if not isinstance(other, Series):
            return self * (1 / Fraction(other))
        found: list[Fraction] = []
        for n, one in enumerate(self.c):
            known = sum((q * other.c[n - i] for i, q in enumerate(found)), Fraction(0))
            found.append((one - known) / other.c[0])
        return Series(found)

    def __pow__(self, power: float) -> "Series":
        assert power == 0.5
        assert self.c[0] == 1
        root = [Fraction(1)]
        for n in range(1, len(self.c)):
            known = sum((root[i] * root[n - i] for i in range(1, n)), Fraction(0))
            root.append((self.c[n] - known) / 2)
        return Series(root)


def test_33_length_by_the_arithmetic_geometric_mean_is_that_of_the_ellipse():
    """Our own steps on power series in s: all coefficients are those of the mean of the root.

    The mean of sqrt(1 + s sin²) has (1/2 over n) (2n over n) / 4^n. Each step of the mean doubles
    the orders that are right, so seven of them leave none of these out; DLMF 19.8 has the theorem.
    """
    order = 12
    s = Series([Fraction(1), Fraction(1), *[Fraction(0)] * (order - 2)])
    found = closed_forms._ellipse(s**0.5)
    for n, coefficient in enumerate(found.c):
        half = sp.binomial(Q(1, 2), n) * comb(2 * n, n) / 4**n
        assert Q(coefficient.numerator, coefficient.denominator) == half


def test_34_is_our_beam_and_the_rest_of_a_clamped_one(monkeypatch: pytest.MonkeyPatch):
    """y'''' = 0, flat at both walls; the integrand of its length is that of our quadrature."""
    ours = line_of("beam")
    a, b = -2 * H / L**3, 3 * H / L**2
    assert zero(ours - (a * x**3 + b * x**2 + w / 2))
    assert zero(sp.diff(ours, x, 4))
    slope = sp.diff(ours, x)
    assert [zero(slope.subs(x, at)) for at in (0, L)] == [True, True]
    assert zero(ours.subs(x, L) - (d - w / 2))
    t = ca.SX.sym("t")
    with_t = Symbols({**SIZES, "t": t}, positive=SIZES)
    monkeypatch.setattr(closed_forms, "_gauss_points", lambda: (((1 - t * t) ** 2, 1.0),))
    rise = SIZES["d"] - SIZES["w"]
    at_t = with_t.one(arc_length("beam", SIZES["L"], rise))
    there = 1 + slope.subs(x, L * (1 + with_t["t"]) / 2) ** 2
    assert zero(at_t**2 - L**2 * there)


def test_35_is_our_line_with_half_the_width_of_the_body():
    ours, printed = line_of("line"), H * x / L
    assert zero(ours - printed - w / 2)
    assert zero(sp.diff(ours - printed, x))


def test_36_is_the_length_of_our_line():
    """sqrt(L² + (d - d_w)²), which is l_s and no count k_s: it has the unit of L."""
    ours = length_of("line")
    assert zero(ours**2 - L**2 - H**2)
    slope = sp.diff(line_of("line"), x)
    assert zero(ours**2 - L**2 * (1 + slope**2))
    scale = sp.Symbol("scale", positive=True)
    scaled = ours.subs({L: scale * L, d: scale * d, w: scale * w}, simultaneous=True)
    assert zero(scaled**2 - scale**2 * ours**2)
    assert ours.subs({L: 10, d: 10, w: 4}) == 2 * sp.sqrt(34)


# -- elastica -------------------------------------------------------------------------------------


@pytest.mark.parametrize("closing", CLOSINGS)
def test_elastica_is_stationary_energy_under_its_closing(closing: Closing):
    """Euler's equation of theta'²/2 with multipliers of span (N) and rise (V); its first integral.

    With a free length the Hamiltonian theta'²/2 + N cos theta + V sin theta vanishes, at the wall
    theta'²/2 + N: the closing of `sleeve`.
    """
    problem = elastica(closing)
    columns = {"y": problem.y, "p": problem.p, "given": problem.given,
               "start": problem.start, "end": problem.end}  # fmt: skip
    s = Symbols(columns)
    theta, curvature, _, _, _ = s["y"]
    length, V, N = s["p"]
    rates = s(problem.ode) / length
    # density theta'²/2 - N cos theta - V sin theta: d/ds of theta' is the derivative by theta
    energy = -N * sp.cos(theta) - V * sp.sin(theta)
    assert zero(rates[1] - sp.diff(energy, theta))
    assert zero(rates[0] - curvature)
    assert zero(rates[2:, :] - sp.Matrix([sp.cos(theta), sp.sin(theta), curvature**2 / 2]))
    hamiltonian = curvature**2 / 2 + N * sp.cos(theta) + V * sp.sin(theta)
    change = sp.diff(hamiltonian, theta) * rates[0] + sp.diff(hamiltonian, curvature) * rates[1]
    assert zero(change)
    last = s(problem.conditions)[-1]
    start = s["start"]
    known = {
        "point_contact": N,
        "sleeve": hamiltonian.subs({theta: 0, curvature: start[1]}),
        "length": length - s.column("given")[-1],
    }
    assert zero(last - known[closing])


def test_elastica_of_small_rise_is_the_beam_of_34():
    """Our slender guess: theta = y', theta'' = -V and the energy of (34), with L = 1."""
    rise, share = sp.symbols("rise s", positive=True)
    theta, curvature, along, y, energy = slender_guess("point_contact", rise, share)[0]
    length, V, N = slender_guess("point_contact", rise, share)[1]
    assert zero(y - (line_of("beam") - w / 2).subs({x: share, L: 1, d: w + rise}))
    assert zero(sp.Matrix([theta - sp.diff(y, share), curvature - sp.diff(theta, share)]))
    assert zero(sp.diff(curvature, share) + V)
    assert zero(sp.diff(energy, share) - curvature**2 / 2)
    assert (along, N) == (share, 0)
    assert zero(length - 1 - sp.integrate(theta**2 / 2, (share, 0, 1)))


# -- rod ------------------------------------------------------------------------------------------


def rod_of(degree: int) -> tuple[Model, Symbols, Any, Any, Any]:
    """One element in a channel, with any slopes, values and weights of its quadrature."""
    rod = Rod(2.0, 2.0, 1.0, 1.0, damping_time=1.0, elements=1, degree=degree)
    matrices = [ca.SX.sym(n, degree, size) for n, size in (("B", degree + 1), ("N", degree + 1),
                                                            ("g", 1))]  # fmt: skip
    rod.__dict__["_gauss"] = tuple(matrices)
    with mock.patch("wormopt.model.model.check_symbols"):  # matrices stand for numbers
        model = channel_rod(rod, 3.0, 0.5)
    columns = {name: ca.vec(m) for name, m in zip("BNg", matrices, strict=True)}
    s = Symbols.of(model, columns=columns)
    shapes = [sp.Matrix(degree + 1, degree, list(s.column(n))).T for n in "BN"]
    return model, s, *shapes, s.column("g")


@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_rod_follows_from_lagrange(degree: int):
    """T of lumped masses, V of Reissner's strains, Rayleigh's function of their rates, walls.

    For any shape functions, slopes and weights, so for every degree of the elements up to two;
    an element more adds a term of the same form.
    """
    model, s, B, N, g = rod_of(degree)
    nodes = degree + 1
    X, Y, angle = (s.column(n) for n in ("along", "across", "angle"))
    rates = s.column("along_rate", "across_rate", "angle_rate")
    q = sp.Matrix.vstack(X, Y, angle)
    turned, x_s, y_s = N * angle, B * X, B * Y
    stretch = [x_s[i] * sp.cos(turned[i]) + y_s[i] * sp.sin(turned[i]) - 1 for i in range(degree)]
    shear = [y_s[i] * sp.cos(turned[i]) - x_s[i] * sp.sin(turned[i]) for i in range(degree)]
    strains = [stretch, shear, list(B * angle)]
    area, moment, E = sp.pi, sp.pi / 4, s["youngs_modulus"]
    resist = [E * area, E * area * Q(3, 10), E * moment]
    V = sum(
        k * g[i] * e[i] ** 2 for k, e in zip(resist, strains, strict=True) for i in range(degree)
    )
    R = s["damping_time"] * sum(
        k * g[i] * ((sp.Matrix([e[i]]).jacobian(q) * rates)[0]) ** 2
        for k, e in zip(resist, strains, strict=True)
        for i in range(degree)
    )
    share = {1: [1, 1], 2: [Q(1, 3), Q(4, 3), Q(1, 3)]}[degree]
    inertia = [s["density"] * size * one for size in (area, area, moment) for one in share]
    power, names = sp.Integer(0), ("along_rate", "across_rate", "angle_rate")
    for i in range(nodes):
        v, up, spin = (s.column(name)[i] for name in names)
        power += s.column("force_along")[i] * v + s.column("force_across")[i] * up
        for wall, side in enumerate((1, -1)):  # radius 1, so that (channel - diameter) / 2 = 1/2
            contact = model.contacts[2 * i + wall]
            slides = v - side * spin  # a disc that turns, at its rim
            assert zero(s.one(contact.velocity) - slides)
            assert zero(s.one(contact.gap) - (Q(1, 2) - side * Y[i]))
            power += s["contact"][2 * i + wall] * slides - s["pressed"][2 * i + wall] * side * up
    ode = s(model.ode)
    assert zero(ode[: 3 * nodes, :] - rates)
    for i in range(3 * nodes):
        law = inertia[i] * ode[3 * nodes + i] + sp.diff(V / 2, q[i]) + sp.diff(R / 2, rates[i])
        assert zero(law - sp.diff(power, rates[i]))
    assert zero(s.one(model["strain_energy"]) - V / 2)


def test_rod_strains_do_not_feel_rigid_motions():
    """Turned and moved as a whole: stretch, shear and curvature are what they were."""
    rod = Rod(2.0, 2.0, 1.0, 1.0, elements=2, degree=1)
    columns = {name: ca.SX.sym(name, rod.count) for name in ("x", "y", "angle")}
    s = Symbols(columns)
    X, Y, angle = (s[name] for name in columns)
    beta, up, on = sp.symbols("beta up on", real=True)
    strains = sp.Matrix.vstack(*(s(one) for one in rod.strains(*columns.values())))
    c, sn = sp.cos(beta), sp.sin(beta)
    moved = [*(c * X - sn * Y + on * sp.ones(3, 1)), *(sn * X + c * Y + up * sp.ones(3, 1)),
             *(angle + beta * sp.ones(3, 1))]  # fmt: skip
    there = dict(zip([*X, *Y, *angle], moved, strict=True))
    gap = strains.subs(there, simultaneous=True) - strains
    assert zero(gap.applyfunc(lambda e: sp.expand_trig(sp.expand(e))))
    straight = {one: at for i, one in enumerate(X) for at in [i]}
    assert zero(strains.subs(straight).subs(dict.fromkeys([*Y, *angle], 0)))
    assert all(b - a == 1.0 for a, b in pairwise(rod.nodes))
