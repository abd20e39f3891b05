"""docs/errata.md on worms with spikes and chains, (1)-(15), and the page itself.

The other files named test_errata_ are on the pair, the film and the channel.
"""

import ast
import functools
import re
from pathlib import Path
from typing import Any

import pytest
import sympy as sp
from places import DOCS, TESTS
from simplified import zero
from sympy import Rational as Q

Function: Any = sp.Function  # its types do not say that it makes functions

HERE = Path(__file__).parent
Expression = Any  # of sympy, whose types are loose

PAGE = (DOCS / "errata.md").read_text("utf-8")

t, v = sp.symbols("t v", real=True)
low, high = sp.symbols("F^+ F^-", positive=True)
x0, x1, x2, v0, v1, v2, u1, u2 = sp.symbols("x_0:3 v_0:3 u_1:3", real=True)
c1, c2, d1, d2 = sp.symbols("c_1:3 d_1:3", positive=True)


# --- The page ----------------------------------------------------------------------------


@functools.cache
def functions_in(path: Path) -> set[str]:
    """Names of the test functions of a file."""
    tree = ast.parse(path.read_text("utf-8"))
    names = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    return {name for name in names if name.startswith("test_")}


NAMED = re.findall(r"`(test_\w+\.py)::(test_\w+)`", PAGE)
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("|") and not re.match(r"\| (where|---)", line)
]


def test_every_test_named_on_the_page_exists():
    assert len(NAMED) > 30
    for file, name in NAMED:
        (path,) = TESTS.rglob(file)
        assert name in functions_in(path), f"{file} has no {name}"
    mentioned = set(re.findall(r"\btest_\w+", PAGE))
    assert mentioned == {part.removesuffix(".py") for pair in NAMED for part in pair}


def test_every_correction_has_a_test_or_is_a_reading():
    assert len(ROWS) > 30
    for row in ROWS:
        assert len(row) == 4, row
        where, printed, holds, shown = row
        assert all((where, printed, holds)), row
        assert shown == "reading" or re.search(r"`test_\w+\.py::test_\w+`", shown), row


def test_every_proof_is_named_on_the_page():
    about_the_page = {
        "test_every_test_named_on_the_page_exists",
        "test_every_correction_has_a_test_or_is_a_reading",
        "test_every_proof_is_named_on_the_page",
    }
    files = sorted(HERE.glob("test_errata*.py"))
    assert len(files) == 4
    there = {(path.name, name) for path in files for name in functions_in(path)}
    assert {pair for pair in there if pair[1] not in about_the_page} <= set(NAMED)


# --- (7) ---------------------------------------------------------------------------------


def test_a_worm_that_starts_faster_glides_although_sigma_is_positive():
    """m = k = sigma = 1 and w(0) = 1: w' + w + 1 = 0 keeps w > 0, mode 1, until ln 2."""
    time, w = sp.Symbol("t", positive=True), Function("w")
    law = sp.Eq(sp.diff(w(time), time) + w(time) + 1, 0)
    found = sp.dsolve(law, w(time), ics={w(0): 1}).rhs  # type: ignore[union-attr]
    assert zero(found - (2 * sp.exp(-time) - 1))
    assert sp.solve(found, time) == [sp.log(2)]
    assert found.subs(time, sp.log(2) / 2).is_positive


# --- (3), (8), (10): links ---------------------------------------------------------------


def link_forces(rest_1: Expression, rest_2: Expression) -> list[Expression]:
    """mu_0 to mu_3 of (8), corrected."""
    first = c1 * (x0 - x1 - rest_1) + d1 * (v0 - v1) - u1
    second = c2 * (x1 - x2 - rest_2) + d2 * (v1 - v2) - u2
    return [sp.Integer(0), first, second, sp.Integer(0)]


def newton(mu: list[Expression]) -> list[Expression]:
    """Right of (3) without external forces."""
    return [mu[i] - mu[i + 1] for i in range(3)]


HEAD = -c1 * (x0 - x1) - d1 * (v0 - v1) + u1  # rows of (10) without F
MIDDLE = c1 * (x0 - x1) - c2 * (x1 - x2) + d1 * (v0 - v1) - d2 * (v1 - v2) + u2 - u1
MIDDLE_PRINTED = -c1 * (x1 - x2) + c2 * (x0 - x1) - d1 * (v1 - v2) + d2 * (v0 - v1) + u2 - u1
TAIL = c2 * (x1 - x2) + d2 * (v1 - v2) - u2


def test_3_with_the_corrected_8_is_the_corrected_10():
    found = newton(link_forces(sp.Integer(0), sp.Integer(0)))
    assert all(zero(f - row) for f, row in zip(found, (HEAD, MIDDLE, TAIL), strict=True))


def test_the_printed_8_has_the_wrong_link_and_the_wrong_sign():
    """Its mu_1 joins masses 1 and 2, mu_2 a mass that is not there; one link back it is minus the
    force that (3) and (10) need."""
    joints = [(x0, v0), (x1, v1), (x2, v2)]

    def printed(front: int, c: Expression, d: Expression, u: Expression) -> Expression:
        (xa, va), (xb, vb) = joints[front], joints[front + 1]
        return c * (xb - xa) + d * (vb - va) + u

    assert not printed(1, c1, d1, u1).has(x0)  # mu_1 as printed does not know the head
    with pytest.raises(IndexError):
        printed(2, c2, d2, u2)
    _, first, second, _ = link_forces(sp.Integer(0), sp.Integer(0))
    assert zero(printed(0, c1, d1, u1) + first)
    assert zero(printed(1, c2, d2, u2) + second)


def test_the_printed_middle_row_of_10_makes_momentum_unless_links_are_alike():
    """The chapter's own numbers have c_1 = c_2, d_1 = d_2, where the rows agree."""
    assert zero(HEAD + MIDDLE + TAIL)
    from_nothing = (c2 - c1) * (x0 - x2) + (d2 - d1) * (v0 - v2)
    assert zero(HEAD + MIDDLE_PRINTED + TAIL - from_nothing)
    assert zero(MIDDLE_PRINTED - MIDDLE - from_nothing)


def test_springs_without_rest_length_pull_with_20_on_the_reference():
    """c = 10, both lengths 2, no motion, no friction: u_j = c (l_j - l0_j) keeps the links."""
    length = sp.Integer(2)
    still: Any = {x0: 4, x1: 2, x2: 0, v0: 0, v1: 0, v2: 0, c1: 10, c2: 10}
    for rest, needed in ((sp.Integer(0), 20), (length, 0)):
        rows = [row.subs(still) for row in newton(link_forces(rest, rest))]
        assert sp.solve(rows, [u1, u2]) == {u1: needed, u2: needed}


# --- (9) and its stand-in ----------------------------------------------------------------


def test_the_printed_interval_of_friction_at_rest_is_empty():
    """Its ends are exchanged: between F^- > 0 and -F^+ < 0 there is nothing."""
    assert sp.Interval.open(high, -low) is sp.S.EmptySet
    holds = sp.Interval(-low, high)
    assert all(holds.contains(force) == sp.true for force in (-low, 0, high))


def test_the_printed_stand_in_drives_where_friction_brakes():
    """(F+ + F-)/2 tanh(v / v_reg) + (F+ - F-)/2 has the sign of v when |v| is large."""
    printed = Q(11, 2) * sp.tanh(40 * v) - Q(9, 2)
    general = (low + high) / 2 * sp.tanh(40 * v) + (low - high) / 2
    assert zero(general.subs({low: 1, high: 10}) - printed)
    steep = sp.tanh(40 * v)
    ahead, back = (general.subs(steep, sp.limit(steep, v, end)) for end in (sp.oo, -sp.oo))
    assert zero(ahead - low)  # along a positive v: (9) has -F+
    assert zero(back + high)  # along a negative v: (9) has +F-
    assert printed.subs(v, 0) == -Q(9, 2)
    assert zero(printed.subs(v, sp.atanh(Q(9, 11)) / 40))


# --- (15) and the start ------------------------------------------------------------------

l0, e = sp.symbols("l_0 epsilon", positive=True)
COSINE = sp.cos(3 * sp.pi * t)
PIECES = [  # the five cases of (15): lengths, from, to
    (l0 * (1 - e * (-1 + COSINE)), Q(0), Q(2, 3)),
    (l0, Q(2, 3), Q(1)),
    (l0 * (1 - e * (1 - COSINE)), Q(0), Q(1, 3)),
    (l0 * (1 - 2 * e), Q(1, 3), Q(2, 3)),
    (l0 * (1 - e * (1 + COSINE)), Q(2, 3), Q(1)),
]


@pytest.mark.parametrize("pieces", [PIECES[:2], PIECES[2:]])
def test_15_is_two_lists_of_cases_each_smooth_and_over_one_period(pieces: list[Any]):
    """Lengths and rates are continuous, from the end of a period to the next too."""
    assert pieces[0][1] == 0
    assert pieces[-1][2] == 1
    for (before, _, end), (after, begin, _) in zip(pieces, pieces[1:] + pieces[:1], strict=True):
        assert end % 1 == begin
        for order in (0, 1):
            jump = sp.diff(after, t, order).subs(t, begin) - sp.diff(before, t, order).subs(t, end)
            assert zero(jump)


def test_15_as_one_list_would_give_two_lengths_at_once():
    first, third = PIECES[0], PIECES[2]
    assert first[1] == third[1]
    assert zero((first[0] - third[0]).subs(t, Q(1, 6)) - 2 * l0 * e)


def test_the_printed_start_has_lengths_of_minus_two_against_plus_two():
    """y = (x_0 - x_1, x_1 - x_2); (4, 2, 0) starts on the reference."""
    outputs, numbers = (x0 - x1, x1 - x2), {l0: 2, e: Q(15, 100)}
    reference = [PIECES[k][0].subs(t, 0).subs(numbers) for k in (0, 2)]
    assert reference == [2, 2]
    for start, lengths in (((0, 2, 4), [-2, -2]), ((4, 2, 0), [2, 2])):
        at: Any = dict(zip((x0, x1, x2), start, strict=True))
        assert [y.subs(at) for y in outputs] == lengths
