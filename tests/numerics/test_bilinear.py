"""Bilinear programs against closed forms, brute force over what is held, and IPOPT."""

from math import sqrt

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from wormopt.numerics.bilinear import BilinearProgram, BilinearRows, Climb, Point

EXACT = Climb(tolerance=1e-12, steps=200)


def point(found: Point | None) -> Point:
    assert found is not None
    return found


# -- closed forms ------------------------------------------------------------------------------


def product(a: float, b: float, c: float) -> BilinearProgram:
    """The largest x y with a x + b y <= c."""
    rows = BilinearRows()
    x, y = rows.columns(np.array([10 * c / a, 10 * c / b]))
    rows.add([(x, a), (y, b)], [], -np.inf, c)
    area = rows.add([], [(x, y, 1.0)], -np.inf, np.inf)
    return BilinearProgram(rows, np.array([x]), int(area[0]))


coefficients = st.floats(0.2, 5.0)


@settings(max_examples=examples(30), derandomize=True)
@given(coefficients, coefficients, coefficients, st.floats(0.05, 0.95))
def test_a_product_on_a_line(a, b, c, share):
    """Half of c for either factor: c^2 / (4 a b), inside the range and so at no vertex."""
    program = product(a, b, c)
    start = point(program.restore(np.array([share * c / a, 0.0])))
    assert start.value == pytest.approx(share * (1 - share) * c**2 / (a * b), rel=1e-9)
    best = program.climb(start, EXACT)
    assert best.value == pytest.approx(c**2 / (4 * a * b), rel=1e-7)
    assert program.violation(best.x) <= 1e-9 * c
    # there is nothing to be sharpened, and nothing is lost
    sharp, _ = program.sharpen(best)
    assert sharp.value >= best.value * (1 - 1e-7)
    assert program.violation(sharp.x) <= 1e-9 * c


@settings(max_examples=examples(30), derandomize=True)
@given(st.floats(0.2, 5.0), st.floats(0.1, 2.0), st.floats(0.01, 0.9))
def test_a_ratio(c, delay, share):
    """The largest h v / (h + delay) with h + v <= c is at h = sqrt(delay^2 + delay c) - delay."""
    rows = BilinearRows()
    h, v, d = rows.columns(np.array([c, c, 2 * delay]))
    rows.add([(h, 1.0), (v, 1.0)], [], -np.inf, c)
    rows.add([(d, 1.0)], [], delay, delay)
    way = rows.add([], [(h, v, 1.0)], -np.inf, np.inf)
    time = rows.add([(h, 1.0), (d, 1.0)], [], -np.inf, np.inf)
    program = BilinearProgram(rows, np.array([h]), int(way[0]), int(time[0]))
    best = sqrt(delay**2 + delay * c) - delay
    found = program.climb(point(program.restore(np.array([share * c, 0.0, 0.0]))), EXACT)
    assert found.value == pytest.approx(best * (c - best) / (best + delay), rel=1e-7)
    assert found.value == program.value(found.x)


def vertex(a: float, b: float) -> tuple[BilinearProgram, int]:
    """The largest x with x y <= b and y >= x + a; and the number of the first row."""
    rows = BilinearRows()
    x, y = rows.columns(np.array([10.0, 20.0]))
    row = rows.add([], [(x, y, 1.0)], -np.inf, b)
    rows.add([(y, 1.0), (x, -1.0)], [], a, np.inf)
    gain = rows.add([(x, 1.0)], [], -np.inf, np.inf)
    return BilinearProgram(rows, np.array([y]), int(gain[0])), int(row[0])


@settings(max_examples=examples(30), derandomize=True)
@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_a_vertex_is_sharpened_to_rounding(a, b):
    """Both rows are active: x (x + a) = b; and b may be had for dx/db = 1 / (2 x + a)."""
    program, row = vertex(a, b)
    best = (sqrt(a**2 + 4 * b) - a) / 2
    start = point(program.restore(np.array([0.0, a + 1.0])))
    rough = program.climb(start, Climb(tolerance=1e-3))
    assert rough.value == pytest.approx(best, rel=2e-2)
    near = program.climb(start, EXACT)
    sharp, multipliers = program.sharpen(near)
    assert sharp.value == pytest.approx(best, rel=1e-14)
    assert program.violation(sharp.x) <= 1e-12
    assert multipliers[row] == pytest.approx(1 / (2 * best + a), rel=1e-6)


def test_sharpening_where_nothing_is_feasible_changes_nothing():
    program, row = vertex(1.0, 1.0)
    far = Point(np.array([5.0, 0.0]), 5.0)
    sharp, multipliers = program.sharpen(far)
    assert sharp is far
    assert multipliers[row] == 0.0


def test_no_point_is_restored_where_there_is_none():
    rows = BilinearRows()
    x = rows.columns(np.ones(2))
    gain = rows.add([(x[0], 1.0)], [(x[0], x[1], 1.0)], 3.0, np.inf)  # is 2 at most
    program = BilinearProgram(rows, x[1:], int(gain[0]))
    assert program.restore(np.array([1.0, 1.0])) is None


def test_a_climb_is_stopped_and_given_up():
    program = product(1.0, 1.0, 2.0)
    start = point(program.restore(np.array([0.1, 0.0])))
    once = program.climb(start, EXACT, stop=lambda _: True)
    assert start.value < once.value < 1.0
    assert program.climb(start, Climb(enough=1e6)).value == start.value


def test_columns_without_room_are_no_columns_and_their_terms_are_zero():
    rows = BilinearRows()
    x = rows.columns(np.array([[1.0, 0.0], [0.0, 2.0]]))
    assert x.tolist() == [[0, -1], [-1, 1]]
    rows.add([(x.ravel(), 1.0)], [(x.ravel(), x.T.ravel()[::-1], 5.0)], -np.inf, 1.5)
    assert rows.count == 4
    (row, column, _), (at, _, _, _) = rows.terms()
    assert (row.tolist(), column.tolist(), at.tolist()) == ([0, 3], [0, 1], [0, 3])


# -- random programs ---------------------------------------------------------------------------


class Drawn:
    """Maximise c v + h Q v with A v + h B v <= b, 0 <= v <= 1, 0 <= h <= 1; by plain matrices."""

    def __init__(self, seed: int, held: int, free: int = 4, count: int = 6) -> None:
        random = np.random.default_rng(seed)
        self.held, self.free = held, free
        self.A = random.uniform(-1.0, 1.0, (count, free))
        self.B = random.uniform(-1.0, 1.0, (count, held, free))
        self.c = random.uniform(-1.0, 1.0, free)
        self.Q = random.uniform(-1.0, 1.0, (held, free))
        self.b = random.uniform(0.1, 1.0, count)  # v = 0 keeps all rows

    def program(self) -> BilinearProgram:
        rows = BilinearRows()
        h, v = rows.columns(np.ones(self.held)), rows.columns(np.ones(self.free))

        def add(linear, products, upper):
            terms = [(int(v[j]), linear[j]) for j in range(self.free)]
            both = [
                (int(h[i]), int(v[j]), products[i, j])
                for i in range(self.held)
                for j in range(self.free)
            ]
            return rows.add(terms, both, -np.inf, upper)

        for a, b, most in zip(self.A, self.B, self.b, strict=True):
            add(a, b, most)
        gain = add(self.c, self.Q, np.inf)
        return BilinearProgram(rows, h, int(gain[0]))

    def best(self, h: np.ndarray) -> float:
        """Best value with h held, by another solver of linear programs."""
        found = linprog(
            -(self.c + h @ self.Q),
            self.A + np.einsum("i,kij->kj", h, self.B),
            self.b,
            bounds=(0, 1),
            method="highs-ipm",
        )
        return -found.fun

    def by_ipopt(self, h: np.ndarray, v: np.ndarray, radius: float) -> float:
        """The best with h near a point, by an interior-point method that knows no linear parts."""
        x, y = ca.SX.sym("h", self.held), ca.SX.sym("v", self.free)  # type: ignore[arg-type]
        rows = [
            ca.dot(a, y) + ca.bilin(ca.DM(b), x, y) for a, b in zip(self.A, self.B, strict=True)
        ]
        gain = ca.dot(self.c, y) + ca.bilin(ca.DM(self.Q), x, y)
        options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}
        solver = ca.nlpsol(
            "s", "ipopt", {"x": ca.vertcat(x, y), "f": -gain, "g": ca.vertcat(*rows)}, options
        )
        low = np.concatenate([np.maximum(h - radius, 0.0), 0 * v])
        high = np.concatenate([np.minimum(h + radius, 1.0), 0 * v + 1.0])
        found = solver(x0=np.concatenate([h, v]), lbx=low, ubx=high, lbg=-np.inf, ubg=self.b)
        return -float(found["f"])


seeds = st.integers(0, 2**32 - 1)


@pytest.mark.slow
@settings(max_examples=examples(15), derandomize=True)
@given(seeds, st.floats(0.0, 1.0))
def test_one_held_column_against_brute_force(seed, first):
    drawn = Drawn(seed, held=1)
    program = drawn.program()
    start = point(program.restore(np.array([first, *np.zeros(4)])))
    assert start.value == pytest.approx(drawn.best(np.array([first])), abs=1e-7)
    found = program.climb(start, EXACT)
    assert found.value >= start.value
    assert program.violation(found.x) <= 1e-8
    h = found.x[program.held]
    assert found.value == pytest.approx(drawn.best(h), abs=1e-7)
    grid = np.linspace(0.0, 1.0, 101)
    values = np.array([drawn.best(np.array([g])) for g in grid])
    # a slope leads up from neither side of it
    near = np.abs(grid - h) <= 0.01
    assert values[near].max() <= found.value + 1e-3
    starts = [point(program.restore(np.array([g, *np.zeros(4)]))) for g in grid[::10]]
    best = max(program.climb(s, EXACT).value for s in starts)
    assert best >= values.max() - 1e-7


@settings(max_examples=examples(15), derandomize=True)
@given(seeds)
def test_where_a_climb_ends_ipopt_gains_nothing(seed):
    """Nothing to first order: a saddle has no slope either."""
    drawn = Drawn(seed, held=3)
    program = drawn.program()
    random = np.random.default_rng(seed)
    start = point(program.restore(np.concatenate([random.uniform(0, 1, 3), np.zeros(4)])))
    found = program.climb(start, EXACT)
    assert drawn.by_ipopt(found.x[:3], found.x[3:], 1e-3) <= found.value + 1e-6
    sharp, _ = program.sharpen(found)
    assert program.violation(sharp.x) <= max(1e-12, program.violation(found.x))
    assert sharp.value >= found.value - 1e-7


@settings(max_examples=examples(20), derandomize=True)
@given(seeds)
def test_derivatives_are_those_of_the_values(seed):
    """Products are quadratic: central differences are exact but for rounding."""
    program, random = Drawn(seed, held=2).program(), np.random.default_rng(seed)
    x, step = random.uniform(0, 1, 6), random.uniform(-1, 1, 6)
    difference = (program.values(x + step) - program.values(x - step)) / 2
    jacobian = program.jacobian(x)
    assert jacobian @ step == pytest.approx(difference, abs=1e-12)
    slope = program.slope(x) @ step
    both = (program.value(x + step) - program.value(x - step)) / 2
    assert slope == pytest.approx(both, abs=1e-12)
