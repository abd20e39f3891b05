"""Errors of explicit steps: the orders of what tells them, and steps that one of it misjudges."""

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import DOP853
from scipy.optimize import root_scalar

from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.steps import DOP853 as OURS
from wormopt.simulation.steps import EMBEDDED

# -- orders ----------------------------------------------------------------------------------

Tree = tuple["Tree", ...]  # a root, by the trees that grow from it


@cache
def trees(order: int, largest: int | None = None) -> list[Tree]:
    """Rooted trees of so many nodes, none above the root larger than `largest`."""
    if order == 1:
        return [()]
    return [tuple(forest) for forest in forests(order - 1, largest or order - 1)]


def forests(nodes: int, largest: int) -> list[list[Tree]]:
    """Sets of trees of so many nodes together, each counted once."""
    sets: dict[str, list[Tree]] = {}
    for first in range(min(nodes, largest), 0, -1):
        rests = forests(nodes - first, first) if nodes > first else [[]]
        for tree in trees(first):
            for rest in rests:
                found = sorted([tree, *rest], key=repr)
                sets[repr(found)] = found
    return list(sets.values())


def weights(tree: Tree) -> np.ndarray:
    """Elementary weights of the stages of DOP853 (Hairer, Norsett, Wanner, section II.2)."""
    product = np.ones(DOP853.n_stages)
    for branch in tree:
        product *= DOP853.A @ weights(branch)
    return product


def test_coefficients_are_those_of_scipy():
    a = np.array([row + [0.0] * (16 - len(row)) for row in OURS["A"]])
    whole = np.zeros((16, 16))
    whole[:12, :12], whole[12, :12], whole[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA
    assert np.array_equal(a, whole)
    assert np.array_equal(OURS["C"], [*DOP853.C, 1.0, *DOP853.C_EXTRA])
    for name, scipys in {"B": DOP853.B, "D": DOP853.D}.items():
        assert np.array_equal(OURS[name], scipys)
    assert np.array_equal(OURS["E5"], DOP853.E5[:-1])
    assert np.array_equal(OURS["E3"], DOP853.E3[:-1])


def test_there_are_as_many_trees_as_cayley_counted():
    assert [len(trees(order)) for order in range(1, 8)] == [1, 1, 2, 4, 9, 20, 48]


@pytest.mark.parametrize(("which", "order"), [(0, 6), (1, 5), (2, 3)])
def test_embedded_formulas_are_of_their_orders(which: int, order: int):
    sums = [
        max(abs(EMBEDDED[which] @ weights(tree)) for tree in trees(n)) for n in range(1, order + 2)
    ]
    assert max(sums[:-1]) < 1e-14
    assert sums[-1] > 5e-5


# -- steps into a steep layer ----------------------------------------------------------------

WIDTH, PULL, LAW = 1e-5, 10.0, Coulomb(1.0, 2.0)
START = -9 * WIDTH


def rate(v: float) -> float:
    """Acceleration of a unit mass that is pulled forward, by the smooth law."""
    return PULL + 0.5 - 1.5 * np.tanh(v / WIDTH)


def time_to(v: float) -> float:
    """When it has velocity v, but for a constant: the integral of dv / rate(v)."""
    a, b, u = PULL + 0.5, 1.5, v / WIDTH
    return WIDTH * (a * u + b * np.log(a * np.cosh(u) - b * np.sinh(u))) / (a**2 - b**2)


def embedded_step(h: float) -> tuple[float, float, float]:
    """A step of DOP853 from the start: its differences to formulas of order 5 and 3, its end."""
    slopes = np.zeros(0)
    for row in DOP853.A:
        slopes = np.append(slopes, rate(START + h * (row[: len(slopes)] @ slopes)))
    sums = [e @ slopes for e in (DOP853.E5[:-1], DOP853.E3[:-1], DOP853.B)]
    five, three, way = (h * float(each) for each in sums)
    return five, three, START + way


def misjudged() -> Iterator[float]:
    """Lengths of steps at which the formula of order 5 sees no error by chance."""
    lengths = np.linspace(7 * WIDTH, 15 * WIDTH, 200) / PULL
    for a, b in pairwise(lengths):
        if embedded_step(a)[0] * embedded_step(b)[0] < 0:
            yield root_scalar(lambda h: embedded_step(h)[0], bracket=(a, b), xtol=1e-20).root


def pulled_mass() -> Model:
    """A mass whose position is so large that the first step is as long as it may be."""
    x, v, force = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("force")
    states = [Signal("position", x, value=1.0), Signal("velocity", v, value=START)]
    contacts = [Contact("mass", v, force, LAW)]
    return Model("mass", states, ca.vertcat(v, PULL + force), contacts=contacts)


def end_velocity(route: str, span: float, **asked: Any) -> float:
    """Where the mass is told to end, alone or as one of nine in lanes."""
    if route != "lanes":
        return float(simulate(pulled_mass(), span, route=route, **asked).end[1])  # type: ignore[arg-type]
    return float(simulate_ensemble(pulled_mass(), span, [Scenario()] * 9, **asked).end[4, 1])


@pytest.mark.parametrize("route", ["native", "lanes", "python"])
def test_steps_into_a_layer_are_not_misjudged_where_one_formula_sees_nothing(route: str):
    lengths = list(misjudged())
    assert len(lengths) == 3
    for h in lengths:
        five, three, end = embedded_step(h)
        assert abs(five) < 1e-9 * abs(three)
        assert abs(time_to(end) - time_to(START) - h) > 1e-3 * h  # so wrong is the step
        span, tolerance = 1.5 * h, Tolerance(1e-11, 1e-12, max_step=h)
        found = end_velocity(route, span, contact=Smooth(WIDTH), tolerance=tolerance)
        assert time_to(found) - time_to(START) == pytest.approx(span, rel=1e-8)


# The first step is 1e-6 long where nothing moves, and each is six times as long as the one before:
# so the tenth begins here.
BEGIN = 1e-6 * (6**9 - 1) / 5


def test_nor_are_derivatives_whose_states_stand_still(route: Route):
    def seen_by_five(h: float) -> float:
        return float(DOP853.E5[:-1] @ np.tanh((h * DOP853.C - 8) / width))

    width, middle = 0.4, BEGIN + 8
    h = root_scalar(seen_by_five, bracket=(9.0, 10.0), xtol=1e-14).root
    x, size, t = ca.SX.sym("x"), ca.SX.sym("size"), ca.SX.sym("t")
    model = Model(
        "still",
        t=t,
        x=[Signal("x", x, value=1.0)],
        p=[Signal("size", size, value=0.0)],
        ode=size * (1 + ca.tanh((t - middle) / width)),  # 0 to the last bit at BEGIN
    )
    tolerance = Tolerance(1e-11, 1e-12, max_step=h)
    end = BEGIN + 1.5 * h
    motion = simulate(model, end, tolerance=tolerance, sensitivities=["size"], route=route)
    right = end + width * np.log(np.cosh((end - middle) / width) / np.cosh(middle / width))
    assert motion.end_derivative[0, 0] == pytest.approx(right, abs=1e-7)
