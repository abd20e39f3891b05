"""`wormopt stress`: its matrix, its judge, a quick cut of it."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from wormopt import cli
from wormopt.bench.stress import GROUPS, matrix, motions
from wormopt.bench.stress.chain_cells import cells, jumping_gait
from wormopt.bench.stress.matrix import cases, stress, summary, table
from wormopt.bench.stress.motions import judge
from wormopt.bench.stress.verdict import Case, Undecided, Verdict, above, apart, many
from wormopt.errors import ArgumentError, SolveError


def cell_named(name: str):
    (found,) = [cell for cell in cells() if cell.name == name]
    return found


def test_the_matrix_is_as_large_as_promised():
    matrix = cells()
    assert len(matrix) >= 450
    assert sum(cell.core for cell in matrix) == 200
    assert len({cell.name for cell in matrix}) == len(matrix)
    assert max(cell.worm.links for cell in matrix) == 100
    assert max(cell.span for cell in matrix) == 1000.0
    widths = [cell.v_reg for cell in matrix if cell.v_reg]
    assert (min(widths), max(widths)) == (1e-7, 1e-1)
    trackers = [cell.tracker for cell in matrix if cell.tracker]
    assert {t.radius for t in trackers} >= {1.0, 1e-1 / 2, 1e-2, 1e-3, 1e-4}
    assert {t.gain for t in trackers} >= {1.0, 1e2, 1e3, 1e4}
    for numbers in ("stiffness", "mass"):
        spread = [getattr(cell.worm, numbers) for cell in matrix]
        assert max(s.max() / s.min() for s in spread) > 5e5


def test_the_matrix_is_the_same_every_time():
    once, again = cells(), cells()
    assert [c.name for c in once] == [c.name for c in again]
    for one, other in zip(once, again, strict=True):
        assert np.array_equal(one.worm.mass, other.worm.mass)
        assert np.array_equal(one.worm.gait.breaks, other.worm.gait.breaks)
    assert np.array_equal(jumping_gait(2, 3).breaks, jumping_gait(2, 3).breaks)


@pytest.mark.parametrize(
    "name",
    [
        "chain of 2, block, exact stiction, c 40",
        "chain of 3 on spikes, sine, drag 0.5",
        "filter tracker, block, v_reg 0.025, lambda 0.2, k0 1",
        "derivative tracker, sine, exact F 1:10, lambda 0.2, k0 1",
        "jumping reference 3, smooth",
        "huge stiction, chain of 1, exact",
    ],
)
def test_each_second_route_agrees(name: str):
    cell = cell_named(name)
    verdict = judge(replace(cell, span=min(cell.span, 2.0)))
    assert (verdict.verdict, verdict.known) == ("right", 1.0)
    assert verdict.off < 0.5


def test_a_wrong_motion_is_seen(monkeypatch: pytest.MonkeyPatch):
    cell = replace(cell_named("chain of 2, sine, exact F 1:2, c 10"), span=1.0)
    simulate = motions.simulate

    def wrong(*given, **options):
        motion = simulate(*given, **options)
        return replace(motion, states=motion.states * (1 + 1e-7))

    monkeypatch.setattr(motions, "simulate", wrong)
    verdict = judge(cell)
    assert verdict.verdict == "wrong"
    assert "times what is allowed" in verdict.reason


def refusing(code: str, partial: object, change: str = "never"):
    def refuse(*_given, **_options):
        raise SolveError("no", change, partial, code)

    return refuse


def crashing(*_given, **_options):
    raise ZeroDivisionError("oh")


@pytest.mark.parametrize(
    ("simulate", "verdict", "reason"),
    [
        (refusing("stiff", object()), "refused", "stiff"),
        (refusing("", object()), "wrong", "refused without code"),
        (refusing("stiff", None), "wrong", "refused without code"),
        (refusing("stiff", object(), ""), "wrong", "refused without code"),
        (crashing, "wrong", "ZeroDivisionError: oh"),
    ],
)
def test_refusals_need_a_reason_and_crashes_are_wrong(
    simulate, verdict: str, reason: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(motions, "simulate", simulate)
    found = judge(cell_named("chain of 1, sine, exact F 1:2, c 10"))
    assert found.verdict == verdict
    assert reason in found.reason


def test_a_second_route_that_fails_leaves_the_cell_undecided(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motions, "second_route", crashing)
    found = judge(replace(cell_named("chain of 1, sine, exact F 1:2, c 10"), span=0.5))
    assert (found.verdict, found.reason) == ("undecided", "second route: ZeroDivisionError: oh")


VERDICTS = [
    Verdict("a", "core: x", True, "right"),
    Verdict("b", "core: x", True, "right", known=0.5),
    *(Verdict(f"c{k}", "y", False, "right") for k in range(8)),
    Verdict("d", "y", False, "refused", "stiff"),
]


def test_the_summary_counts():
    found = summary(VERDICTS)
    assert (found["cells"], found["right"], found["refused"], found["wrong"]) == (11, 10, 1, 0)
    assert (found["core"], found["core_right"], found["right_in_part"]) == (2, 2, 1)
    assert found["reasons"] == {"stiff": 1}
    assert found["passed"]
    assert "passed" in table(VERDICTS)
    assert not summary([])["passed"]


@pytest.mark.parametrize(
    "more",
    [
        Verdict("e", "y", False, "wrong", "off"),
        Verdict("e", "core: x", True, "refused", "stiff"),
        Verdict("e", "y", False, "undecided", "chaos"),
    ],
)
def test_it_passes_only_if_all_three_numbers_are_met(more: Verdict):
    few = [v for v in VERDICTS if v.name != "c7"]  # nine tenths exactly with one more
    assert not summary([*few, more])["passed"]
    assert "NOT passed" in table([*few, more])
    assert f"{more.verdict}: e" in table([*few, more])


def test_an_interrupted_run_tells_what_it_knows(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def stopped(_groups, **_options) -> Iterator[Verdict]:
        yield from VERDICTS[:3]
        raise KeyboardInterrupt

    monkeypatch.setattr(matrix, "stress", stopped)
    assert cli.main(["stress", "--json"]) == 130
    found = json.loads(capsys.readouterr().out)
    assert (found["cells"], found["complete"], found["passed"]) == (3, False, False)


@pytest.mark.parametrize(("verdicts", "code"), [(VERDICTS, 0), (VERDICTS[-3:], 3)])
def test_the_exit_code_tells_whether_it_passed(
    verdicts: list[Verdict], code: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(matrix, "stress", lambda _groups, **_: iter(verdicts))
    assert cli.main(["stress"]) == code


@pytest.mark.slow
def test_a_quick_cut_has_nothing_wrong():
    found = summary(list(stress(quick=True, report=lambda *_: None)))
    assert found["wrong"] == 0
    assert found["passed"], found["not_right"]


# -- questions that are no motions ---------------------------------------------------------------


def question(*found: tuple[str, float]) -> Case:
    return Case("a question", "questions", lambda _dice: iter(found))


def test_a_case_is_right_if_nothing_compared_is_too_far_off():
    verdict = question(("one", 0.3), ("other", 0.7)).judge()
    assert (verdict.verdict, verdict.off) == ("right", 0.7)


@pytest.mark.parametrize("found", [[("one", 0.3), ("other", 1.5)], [("one", np.nan)], []])
def test_a_case_is_wrong_if_something_is_off_or_unknown_or_nothing_compared(found):
    assert question(*found).judge().verdict == "wrong"


@pytest.mark.parametrize(
    ("error", "verdict"),
    [
        (SolveError("no", "give more"), "refused"),
        (SolveError("no"), "wrong"),
        (ArgumentError(""), "wrong"),
        (Undecided("it does not converge"), "undecided"),
        (ZeroDivisionError("oh"), "wrong"),
    ],
)
def test_only_errors_that_name_what_to_change_are_refusals(error: Exception, verdict: str):
    def compare(_dice: np.random.Generator) -> Iterator[tuple[str, float]]:
        yield "one", 0.0
        raise error

    assert Case("a", "questions", compare).judge().verdict == verdict


def test_distances_are_shares_of_what_is_allowed():
    assert apart([1.0, 2.1], [1.0, 2.0], 0.1) == pytest.approx(0.5)
    assert apart(0.1, 0.0, 0.1, size=2.0) == pytest.approx(0.5)
    assert (apart(0.0, 0.0, 0.1), apart(1e-9, 0.0, 0.1)) == (0.0, np.inf)
    assert (above(3.0, 2.0, 0.1), above(1.0, 2.0, 0.1)) == (pytest.approx(5.0), 0.0)
    with pytest.raises(Undecided):
        apart([1.0], [1.0, 2.0], 0.1)
    with pytest.raises(Undecided):
        apart(1.0, np.nan, 0.1)


def test_each_case_throws_its_own_dice_the_same_every_time():
    thrown: list[float] = []

    def compare(dice: np.random.Generator) -> Iterator[tuple[str, float]]:
        thrown.append(dice.random())
        yield "one", 0.0

    for _ in range(2):
        for case in many("questions", compare, 2, quick=False):
            case.judge()
    assert thrown[:2] == thrown[2:]
    assert thrown[0] != thrown[1]


def test_an_unknown_group_is_refused(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["stress", "motion"]) == 2
    said = capsys.readouterr().err
    assert "motion;" in said
    assert all(name in said for name in GROUPS)


def test_groups_are_named_on_the_command_line(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def none(groups, **options):
        asked.append((groups, options["quick"]))
        return iter(VERDICTS)

    monkeypatch.setattr(matrix, "stress", none)
    assert cli.main(["stress", "Gaits", "films", "gaits", "--quick"]) == 0
    assert asked == [(["gaits", "films"], True)]
