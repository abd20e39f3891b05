"""Bounds of linear programs against exact rational arithmetic and a second route."""

import subprocess
import sys
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from typing import Any

import highspy
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.optimize import linprog

from wormopt.numerics.linear_program import LinearProgram, Rows, interior_point, simplex, solve

ULP = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Numbers:
    """A linear program written down: maximise c x, low <= A x <= high, least <= x <= most."""

    c: np.ndarray
    A: np.ndarray
    low: np.ndarray
    high: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def program(self) -> LinearProgram:
        rows = Rows()
        for row, low, high in zip(self.A, self.low, self.high, strict=True):
            # zeros are stored too, so that they can be changed
            rows.add([(j, float(value)) for j, value in enumerate(row)], float(low), float(high))
        return LinearProgram(self.c, rows, self.least, self.most)

    def planes(self) -> list[tuple[list[Fraction], Fraction]]:
        """All a x <= b in exact numbers."""
        found = []
        n = len(self.c)
        for row, low, high in zip(
            [*self.A, *np.eye(n)], [*self.low, *self.least], [*self.high, *self.most], strict=True
        ):
            exact = [Fraction(float(v)) for v in row]
            if high < np.inf:
                found.append((exact, Fraction(float(high))))
            if low > -np.inf:
                found.append(([-v for v in exact], -Fraction(float(low))))
        return found

    def exact_maximum(self) -> Fraction | None:
        """Largest value over all vertices; None where there is no feasible point."""
        planes = self.planes()
        best = None
        for chosen in combinations(planes, len(self.c)):
            x = solved([list(a) for a, _ in chosen], [b for _, b in chosen])
            if x is None or any(dot(a, x) > b for a, b in planes):
                continue
            value = dot([Fraction(float(v)) for v in self.c], x)
            best = value if best is None else max(best, value)
        return best

    def exact_bound(self, duals: np.ndarray) -> Fraction | None:
        """What the multipliers prove, in exact numbers; None where a side is missing."""
        value, left = Fraction(0), [Fraction(float(v)) for v in self.c]
        for y, row, low, high in zip(duals, self.A, self.low, self.high, strict=True):
            side = high if y > 0 else low
            if y == 0 or np.isinf(side):  # without a side the multiplier counts as zero
                continue
            value += Fraction(float(y)) * Fraction(float(side))
            left = [
                d - Fraction(float(y)) * Fraction(float(a)) for d, a in zip(left, row, strict=True)
            ]
        for d, least, most in zip(left, self.least, self.most, strict=True):
            value += d * Fraction(float(most if d > 0 else least))
        return value


def dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def solved(A: list[list[Fraction]], b: list[Fraction]) -> list[Fraction] | None:
    """Gauss and Jordan in exact numbers; None if the matrix is singular."""
    rows = [[*a, v] for a, v in zip(A, b, strict=True)]
    for k in range(len(rows)):
        pivot = next((r for r in range(k, len(rows)) if rows[r][k] != 0), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for r in range(len(rows)):
            if r != k and rows[r][k] != 0:
                rows[r] = [v - rows[r][k] * w for v, w in zip(rows[r], rows[k], strict=True)]
    return [row[-1] for row in rows]


# Integers meet in degenerate vertices; other numbers round. Underflow is not what is tested.
coefficient = st.one_of(
    st.integers(-3, 3).map(float),
    st.floats(-10.0, 10.0).filter(lambda v: v == 0.0 or abs(v) > 1e-9),
)
FEW = st.integers(1, 3)
multiplier = st.one_of(
    coefficient, st.floats(-1e8, 1e8).filter(lambda v: v == 0.0 or abs(v) > 1e-20)
)


@st.composite
def programs(draw, columns=FEW, rows=FEW) -> Numbers:
    n, m = draw(columns), draw(rows)

    def some(size: int, values=coefficient) -> np.ndarray:
        return np.array(draw(st.lists(values, min_size=size, max_size=size)))

    least = some(n)
    most = least + np.abs(some(n))
    sides = np.sort([some(m), some(m)], axis=0)
    kind = draw(st.lists(st.sampled_from("both low high equal".split()), min_size=m, max_size=m))
    low = np.array([-np.inf if k == "high" else s for k, s in zip(kind, sides[0], strict=True)])
    high = np.array([np.inf if k == "low" else s for k, s in zip(kind, sides[1], strict=True)])
    high = np.where(np.array(kind) == "equal", low, high)
    return Numbers(some(n), some(n * m).reshape(m, n), low, high, least, most)


@settings(max_examples=examples(60), derandomize=True)
@given(programs(), st.data())
def test_any_multipliers_bound_the_maximum_in_exact_numbers(numbers, data):
    m = len(numbers.low)
    duals = np.array(data.draw(st.lists(multiplier, min_size=m, max_size=m)))
    bound = Fraction(numbers.program().bound(duals))
    promised, best = numbers.exact_bound(duals), numbers.exact_maximum()
    assert promised is not None
    assert bound >= promised
    if best is not None:
        assert promised >= best
    # and rounding is all that is added
    size = 1 + np.abs(duals).sum() * 200
    assert float(bound - promised) <= 1e-12 * size


@settings(max_examples=examples(60), derandomize=True)
@given(programs(), st.data())
def test_the_bound_holds_for_coefficients_a_few_roundoffs_away(numbers, data):
    """Coefficients come from sums and products of their own, and so are not exact."""
    m, n = numbers.A.shape
    duals = np.array(data.draw(st.lists(multiplier, min_size=m, max_size=m)))
    off = np.array(data.draw(st.lists(st.integers(-4, 4), min_size=m * n, max_size=m * n)))
    A = numbers.A * (1 + ULP * off.reshape(m, n))
    other = Numbers(numbers.c, A, numbers.low, numbers.high, numbers.least, numbers.most)
    promised = other.exact_bound(duals)
    assert promised is not None
    assert Fraction(numbers.program().bound(duals)) >= promised


@settings(max_examples=examples(80), derandomize=True)
@given(programs())
def test_the_bound_is_never_below_the_exact_maximum(numbers):
    found = numbers.program().maximise()
    best = numbers.exact_maximum()
    if best is None:  # no claim can be wrong; a proof is asked for in tests of its own
        return
    assert found.bound > -np.inf
    assert Fraction(found.bound) >= best
    duals = np.abs(found.row_duals).sum() if found.x.size else 0.0
    assert float(Fraction(found.bound) - best) <= 1e-6 * (1 + duals)


@settings(max_examples=examples(60), derandomize=True)
@given(programs(columns=st.integers(2, 7), rows=st.integers(1, 8)))
def test_bounds_agree_with_a_second_route(numbers):
    """SciPy's interior-point method, with presolve and another form of the same program."""
    parts = [(numbers.A, numbers.high), (-numbers.A, -numbers.low)]
    A = np.vstack([a[b < np.inf] for a, b in parts])
    b = np.concatenate([b[b < np.inf] for _, b in parts])
    box = np.column_stack([numbers.least, numbers.most])
    second = linprog(-numbers.c, A, b, bounds=box, method="highs-ipm")
    found = numbers.program().maximise()
    if found.bound == -np.inf:
        assert second.status == 2
    elif second.status == 0 and found.x.size:
        # a row that is nearly a multiple of another makes both solvers' tolerances count
        size = 1 + np.abs(found.row_duals).sum()
        assert found.bound == pytest.approx(-second.fun, abs=1e-6 * size)
        assert numbers.c @ found.x == pytest.approx(found.bound, abs=1e-6 * size)
        assert np.all(numbers.A @ found.x <= numbers.high + 1e-7)
        assert np.all(numbers.A @ found.x >= numbers.low - 1e-7)


# -- programs without a feasible point ---------------------------------------------------------


def two_sides(least: float) -> LinearProgram:
    """x0 + x1 >= least with both at most 1."""
    rows = Rows()
    rows.add([(0, 1.0), (1, 1.0)], least, np.inf)
    return LinearProgram(np.array([1.0, 0.5]), rows, np.zeros(2), np.ones(2))


def test_no_feasible_point_is_proven():
    for least in (2.0 + 1e-6, 2.5, 1e6):
        assert two_sides(least).maximise().bound == -np.inf
    for least in (-1.0, 1.0, 1.75):
        assert two_sides(least).maximise().bound == pytest.approx(1.5, abs=1e-12)


def test_what_only_rounding_could_forbid_is_not_called_impossible():
    """At 2 one point is left; a side above by less than tolerances is not proven to have none."""
    assert two_sides(2.0).maximise().bound >= 1.5
    assert two_sides(float(np.nextafter(2.0, 3.0))).maximise().bound > -np.inf


# -- a solver that is wrong --------------------------------------------------------------------


class Liar:
    """Stands in for the solver, and says what it is told to say."""

    def __init__(self, status=None, ray=(), duals=(), valid=True, run=highspy.HighsStatus.kOk):
        self._status, self._ray, self._duals = status, list(ray), list(duals)
        self._valid, self._run = valid, run

    def run(self):
        return self._run

    def getRunTime(self):
        return 0.0

    def getInfo(self):
        return highspy.HighsInfo()

    def clearSolver(self):
        return highspy.HighsStatus.kOk

    def setOptionValue(self, *_):
        return highspy.HighsStatus.kOk

    def getModelStatus(self):
        return self._status

    def getDualRay(self):
        return highspy.HighsStatus.kOk, bool(self._ray), self._ray

    def getSolution(self):
        solution = highspy.HighsSolution()
        solution.row_dual, solution.col_value = self._duals, [0.0, 0.0]
        solution.dual_valid = self._valid
        return solution


Status = highspy.HighsModelStatus


@pytest.mark.parametrize(
    "liar",
    [
        *(Liar(Status.kInfeasible, ray) for ray in ((), (1.0,), (-1.0,), (1e6,))),
        *(Liar(Status.kOptimal, duals=[dual]) for dual in (-100.0, -1.0, 0.0, 0.5, 100.0)),
        Liar(Status.kTimeLimit, valid=False),
        Liar(Status.kNotset, valid=False, run=highspy.HighsStatus.kError),
    ],
)
def test_false_claims_and_no_claims_leave_a_poor_bound_but_a_true_one(liar: Any):
    program = two_sides(1.0)
    program._highs = liar
    found = program.maximise()
    assert 1.5 <= found.bound <= 1.5 + 1e-12
    assert liar._valid or not found.x.size


# -- stating programs --------------------------------------------------------------------------


@pytest.mark.parametrize(("lower", "upper"), [(-np.inf, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_a_column_without_bounds_is_refused(lower, upper):
    rows = Rows()
    rows.add([(0, 1.0), (1, 1.0)], -np.inf, 1.0)
    with pytest.raises(ValueError, match="finite bounds"):
        LinearProgram(np.ones(2), rows, np.array([0.0, lower]), np.array([1.0, upper]))


def test_blocks_of_rows_are_put_together():
    rows = Rows()
    first = rows.add([(np.array([0, 1, -1]), 2.0), (2, np.array([1.0, 2.0, 3.0]))], 0.0, 1.0)
    second = rows.add([(1, 1.0), (1, 0.5)], -np.inf, np.array([4.0]))
    assert (first.tolist(), second.tolist()) == ([0, 1, 2], [3])
    starts, column, value, lower, upper = rows.assemble(3)
    matrix = sparse.csr_array((value, column, starts), (4, 3))
    # column -1 is left out, terms of one place are added up
    expected = [[2.0, 0.0, 1.0], [0.0, 2.0, 2.0], [0.0, 0.0, 3.0], [0.0, 1.5, 0.0]]
    assert matrix.toarray().tolist() == expected
    assert lower.tolist() == [0.0, 0.0, 0.0, -np.inf]
    assert upper.tolist() == [1.0, 1.0, 1.0, 4.0]


def test_the_solver_prints_nothing():
    """It must be asked in a process of its own: HiGHS greets but once."""
    code = "from wormopt.numerics.linear_program import simplex; simplex().run()"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == ""


def transport(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Carry goods from as many places to others at least cost: costs, supplies, demands."""
    draw = np.random.default_rng(size)
    supply = draw.uniform(1.0, 2.0, size)
    return draw.uniform(1.0, 9.0, (size, size)), supply, draw.permutation(supply)


def carried(size: int) -> tuple[Any, float]:
    """A transport problem in the solver, and its least cost by another route of SciPy's."""
    cost, supply, demand = transport(size)
    row, column = np.indices((size, size))
    rows, own = np.concatenate([row.ravel(), size + column.ravel()]), np.arange(size * size)
    matrix = sparse.csc_array((np.ones(2 * size * size), (rows, np.tile(own, 2))))
    sides = np.concatenate([supply, demand])
    known = linprog(cost.ravel(), A_eq=matrix[:-1], b_eq=sides[:-1], method="highs-ds")
    highs = simplex()
    model: Any = highspy.HighsLp()
    model.num_row_, model.num_col_ = 2 * size, size * size
    model.col_cost_, model.col_lower_ = cost.ravel(), np.zeros(size * size)
    model.col_upper_ = np.full(size * size, np.inf)
    model.row_lower_ = model.row_upper_ = sides
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_, model.a_matrix_.index_ = matrix.indptr, matrix.indices
    model.a_matrix_.value_ = matrix.data
    highs.passModel(model)
    return highs, known.fun


@pytest.mark.parametrize("size", [5, 20])
def test_where_the_simplex_method_does_not_end_interior_points_do(size: int):
    highs, least = carried(size)
    status, pivots = solve(highs, 1)
    assert status == highspy.HighsModelStatus.kOptimal
    assert pivots <= 1
    assert highs.getInfo().objective_function_value == pytest.approx(least, rel=1e-9)


def test_the_limit_of_pivots_counts_for_each_program_alone():
    highs, least = carried(20)
    _, whole = solve(highs)
    for _ in range(3):
        highs.clearSolver()
        status, pivots = solve(highs, whole)
        assert (status, pivots) == (highspy.HighsModelStatus.kOptimal, whole)
    assert whole > 1
    assert highs.getInfo().objective_function_value == pytest.approx(least, rel=1e-9)


def test_coefficients_that_the_solver_refuses_give_the_poor_bound():
    rows = Rows()
    rows.add([(0, 1e30), (1, 1.0)], -np.inf, 1.0)
    program = LinearProgram(np.array([1.0, 2.0]), rows, np.zeros(2), np.array([3.0, 4.0]))
    assert program.maximise().bound == pytest.approx(3.0 + 2 * 4.0, rel=1e-12)


# -- interior points -----------------------------------------------------------------------------


@settings(max_examples=examples(10), derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_interior_points_end_where_the_simplex_method_does(seed: int):
    """Rows with entries in two parts, which are added up."""
    random = np.random.default_rng(seed)
    matrix, cost = random.normal(size=(6, 3)), random.normal(size=3)
    upper = random.uniform(0.1, 2.0, 6)
    row, column = (np.tile(v.ravel(), 2) for v in np.indices(matrix.shape))
    entries = row, column, np.tile(matrix.ravel() / 2, 2)
    x = interior_point(cost, entries, upper, 5.0, 10.0)
    found = linprog(cost, matrix, upper, bounds=[(-5.0, 5.0)] * 3)
    assert cost @ x == pytest.approx(found.fun, abs=1e-5)
    assert np.all(matrix @ x <= upper + 1e-6)


def test_interior_points_are_stopped_at_once(monkeypatch: pytest.MonkeyPatch):
    """Interrupted twice, they wait for the solver's thread: to leave it would abort the process."""
    calls: list[str] = []

    class Working:
        def is_alive(self) -> bool:
            return calls.count("wait") < 3

        def join(self, seconds: float) -> None:
            calls.append("wait")
            if calls.count("wait") < 3:
                raise KeyboardInterrupt

    monkeypatch.setattr(highspy.Highs, "startSolve", lambda _: Working())
    monkeypatch.setattr(highspy.Highs, "cancelSolve", lambda _: calls.append("cancel"))
    one = np.zeros(1, int), np.zeros(1, int), np.ones(1)
    with pytest.raises(KeyboardInterrupt):
        interior_point(np.ones(1), one, np.ones(1), 1.0, 1.0)
    assert calls == ["wait", "cancel", "wait", "wait"]
