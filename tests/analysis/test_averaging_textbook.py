"""Averages of textbook problems and of a block with dry friction, by SymPy and by hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from averaged_models import EPS, block, rates_of, smooth
from scipy.optimize import root_scalar

from wormopt.analysis.average import average
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, Signal, pack
from wormopt.simulation.simulate import simulate


class Turning:
    """Cosines and sines as polynomials in w = exp(i t) and 1/w."""

    w = sp.Symbol("w")

    def cos(self, order: Any) -> Any:
        return (self.w**order + self.w**-order) / 2

    def sin(self, order: Any) -> Any:
        return (self.w**order - self.w**-order) / (2 * sp.I)


def powers(expression: Any) -> dict[int, Any]:
    """Coefficients of the powers of w."""
    found: dict[int, Any] = {}
    for term in sp.Add.make_args(sp.expand(expression)):
        rest, power = term.as_independent(Turning.w)
        n = 0 if power == 1 else int(power.as_base_exp()[1])
        found[n] = found.get(n, 0) + rest
    return found


def by_sympy(ode: Callable[..., Any], names: str) -> tuple[Any, Any, tuple[Any, ...]]:
    """Mean of f, and mean of (df/dx) u with u the integral of f less its mean, without mean."""
    x = sp.symbols(f"{names},", real=True)
    f = sp.Matrix(ode(*x, 1, Turning()))
    swings = [powers(rate) for rate in f]
    u = sp.Matrix(
        [sum(c / (sp.I * n) * Turning.w**n for n, c in own.items() if n) for own in swings]
    )
    first = sp.Matrix([own.get(0, 0) for own in swings])
    second = sp.Matrix([powers(rate).get(0, 0) for rate in f.jacobian(x) * u])
    return first, second, x


def numbers_of(expression: Any, values: dict[Any, float]) -> np.ndarray:
    found = [complex(entry.subs(values).evalf(20)) for entry in expression]
    assert max(abs(number.imag) for number in found) < 1e-15
    return np.array([number.real for number in found])


def growing(x: Any, t: Any, m: Any) -> list[Any]:
    return [x * m.sin(t) + m.cos(t) + x**2 * m.sin(2 * t) - x / 3]


def van_der_pol(p: Any, q: Any, t: Any, m: Any) -> list[Any]:
    """z'' + z = eps (1 - z^2) z' with z = p cos(t) + q sin(t)."""
    z, rate = p * m.cos(t) + q * m.sin(t), q * m.cos(t) - p * m.sin(t)
    force = (1 - z**2) * rate
    return [-force * m.sin(t), force * m.cos(t)]


def spun(p: Any, q: Any, t: Any, m: Any) -> list[Any]:
    return [p * q * m.cos(t) + m.sin(t) ** 2 * q, p**2 * m.sin(t) - q * m.cos(t) + m.cos(3 * t)]


@pytest.mark.parametrize(
    ("ode", "names"), [(growing, "x"), (van_der_pol, "p q"), (spun, "p q")],
    ids=["growing", "van der Pol", "spun"],
)  # fmt: skip
def test_smooth_problems_against_symbolic_averages(ode: Any, names: str):
    first, second, symbols = by_sympy(ode, names.replace(" ", ","))
    model = smooth(ode, names)
    one, two = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    random = np.random.default_rng(8)
    for x in random.uniform(-2, 2, (5, len(symbols))):
        values = dict(zip(symbols, x, strict=True))
        f1, f2 = (numbers_of(expression, values) for expression in (first, second))
        assert one(x) == pytest.approx(EPS * f1, rel=0, abs=1e-14)
        assert two(x) - one(x) == pytest.approx(EPS**2 * f2, rel=0, abs=1e-15)
        assert np.abs(f2).max() > 1e-3


def test_the_limit_cycle_of_van_der_pol_is_slower_by_a_sixteenth():
    # Lindstedt: amplitude 2, frequency 1 - eps^2 / 16
    two = rates_of(average(smooth(van_der_pol, "p q"), 2 * np.pi, order=2))
    for phase in (0.0, 1.0):
        p, q = 2 * np.cos(phase), 2 * np.sin(phase)
        rate = two([p, q])
        assert (p * rate[1] - q * rate[0]) / 4 == pytest.approx(EPS**2 / 16, rel=1e-10)
        assert (p * rate[0] + q * rate[1]) / 4 == pytest.approx(0.0, abs=1e-16)


def test_the_second_tongue_of_mathieu_has_its_known_edges():
    # z'' + (1 + d + eps cos t) z = 0 is at its limits of stability for d = 5 eps^2/12, -eps^2/12
    eps = 1e-3
    for edge, row in ((5 / 12, 0), (-1 / 12, 1)):

        def mathieu(p: Any, q: Any, t: Any, m: Any, edge: float = edge) -> list[Any]:
            z = p * m.cos(t) + q * m.sin(t)
            force = -(edge * eps + m.cos(t)) * z
            return [-force * m.sin(t), force * m.cos(t)]

        averages = average(smooth(mathieu, "p q", eps), 2 * np.pi, order=2)
        slopes = ca.Function("A", [pack(averages.x)], [ca.jacobian(averages.ode, pack(averages.x))])
        matrix = np.array(slopes([0.3, 0.4]))
        # the other entry stays, of the size of the width of the tongue: half of 5/12 + 1/12
        still, other = sorted(np.abs([matrix[0, 1], matrix[1, 0]]))
        assert still < 2 * eps**3
        assert other == pytest.approx(eps**2 / 4, rel=5e-3)
        assert np.abs([matrix[0, 0], matrix[1, 1]]).max() < 1e-16
        assert np.abs(matrix[row, 1 - row]) in (pytest.approx(still), pytest.approx(other))


def block_by_sympy() -> tuple[Any, Any, tuple[Any, ...]]:
    """Mean friction on shifted pieces, differentiated by the shift."""
    t, V, F, B, g, d = sp.symbols("t V F B g d", real=True)
    turn = sp.acos(-V)  # forward for |t| < turn
    first = (-F * turn + B * (sp.pi - turn)) / sp.pi
    ahead, behind = -F - first, B - first  # rates of u
    # u from t = -turn on, over both pieces, and then without its mean
    begin = sp.Symbol("u0")
    on = begin + ahead * (t + turn) + g * (sp.cos(turn) - sp.cos(t))
    at = on.subs(t, turn)
    off = at + behind * (t - turn) + g * (sp.cos(turn) - sp.cos(t))
    area = sp.integrate(on, (t, -turn, turn)) + sp.integrate(off, (t, turn, 2 * sp.pi - turn))
    begin_value = sp.solve(sp.Eq(area, 0), begin)[0]
    # v + d u + cos(t) = 0 at turn + d s: u - sin(turn) s = 0, and at -turn: u + sin(turn) s = 0
    late = at.subs(begin, begin_value) / sp.sin(turn)
    early = -begin_value / sp.sin(turn)
    forward = (turn + d * late) - (-turn + d * early)
    mean = (-F * forward + B * (2 * sp.pi - forward)) / (2 * sp.pi)
    return first, sp.diff(mean, d), (V, F, B, g)


def test_the_pushed_block_against_shifted_pieces():
    first, second, symbols = block_by_sympy()
    push = 0.8 * EPS
    model = block(ode=lambda v, t, f: f + push * ca.sin(t))
    one, two = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    for V in (-0.9, -0.3, 0.0, 0.25, 0.7):
        values = dict(zip(symbols, (V, 0.5 * EPS, EPS, push), strict=True))
        assert one([V])[0] == pytest.approx(float(first.subs(values)), abs=1e-16)
        expected = float(second.subs(values))
        assert two([V])[0] - one([V])[0] == pytest.approx(expected, abs=1e-17)
        # what is left when all is said: the push shifts both reversals alike
        short = -1.5 * EPS * push * V / (np.pi * np.sqrt(1 - V**2))
        assert expected == pytest.approx(short, abs=1e-17)


def zero_of(function: Callable[[float], float]) -> float:
    return root_scalar(function, bracket=(0.2, 0.8), xtol=1e-300, rtol=1e-14).root


def orders(errors: Sequence[float], sizes: Sequence[float]) -> np.ndarray:
    return np.diff(np.log(errors)) / np.diff(np.log(sizes))


@pytest.mark.slow
def test_errors_of_the_pushed_block_have_the_orders_promised():
    # periodic motion of the block itself: reversals by root search, nothing integrated numerically
    sizes, errors = (0.08, 0.04, 0.02, 0.01), {1: [], 2: []}
    for eps in sizes:
        law, push = Coulomb(0.5 * eps, eps), 0.8 * eps
        slow = block(law, ode=lambda v, t, f, push=push: f + push * ca.sin(t))
        states = [Signal("x", ca.SX.sym("x"), value=0.0), *slow.x]
        moving = replace(slow, x=states, ode=ca.vertcat(slow.x[0].symbol, slow.ode))

        def over_a_period(V: float, moving: Model = moving) -> np.ndarray:
            return simulate(moving, 2 * np.pi, x0={"v": V}).end

        start = zero_of(lambda V: over_a_period(V)[1] - V)
        exact = over_a_period(start)[0] / (2 * np.pi)
        for order in (1, 2):
            rate = rates_of(average(slow, 2 * np.pi, order=order))
            steady = zero_of(lambda V, rate=rate: rate([V])[0])
            errors[order].append(abs(exact - steady))
    assert orders(errors[1], sizes) == pytest.approx(1.0, abs=0.15)
    assert orders(errors[2], sizes) == pytest.approx(2.0, abs=0.25)
    assert errors[1][-1] < 0.5 * sizes[-1]
    assert errors[2][-1] < 1.0 * sizes[-1] ** 2
