"""The stress matrix: its cases, its judge, a quick cut of it."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.stress import GROUPS, averages, gaits, matrix, motions, optima
from tests.stress.__main__ import main
from tests.stress.chain_cells import cells, jumping_gait
from tests.stress.crawl_route import Crawling, most_speed
from tests.stress.matrix import cases, stress, summary, table
from tests.stress.motions import judge
from tests.stress.verdict import Case, Undecided, Verdict, above, apart, many
from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.spiked.construct import fast_gait


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


@pytest.mark.slow
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
    assert main(["--json"]) == 130
    found = json.loads(capsys.readouterr().out)
    assert (found["cells"], found["complete"], found["passed"]) == (3, False, False)


@pytest.mark.parametrize(("verdicts", "code"), [(VERDICTS, 0), (VERDICTS[-3:], 3)])
def test_the_exit_code_tells_whether_it_passed(
    verdicts: list[Verdict], code: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(matrix, "stress", lambda _groups, **_: iter(verdicts))
    assert main([]) == code


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


NAN = ("one", np.nan)


@pytest.mark.parametrize(
    "found", [[("one", 0.3), ("other", 1.5)], [NAN], [NAN, ("other", 0.1)], []]
)
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
        for case in many([("questions", compare, 2)], quick=False):
            case.judge()
    assert thrown[:2] == thrown[2:]
    assert thrown[0] != thrown[1]


def test_an_unknown_group_is_refused(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit, match="2"):
        main(["motion"])
    said = capsys.readouterr().err
    assert "motion;" in said
    assert all(name in said for name in GROUPS)
    with pytest.raises(SystemExit):
        main(["--help"])
    said = capsys.readouterr().out
    assert all(name in said and what in said for name, what in GROUPS.items())


def test_groups_are_named_on_the_command_line(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def none(groups, **options):
        asked.append((groups, options["quick"]))
        return iter(VERDICTS)

    monkeypatch.setattr(matrix, "stress", none)
    assert main(["Gaits", "films", "gaits", "--quick"]) == 0
    assert asked == [(["gaits", "films"], True)]


GROUPS_HERE = ("motions", "planar", "gaits", "optima", "averages")
"""Groups of which tests here speak; films, bodies, fields, segments and swimmers have their own."""


def test_the_groups_have_as_many_cases_as_promised():
    asked = {group: cases(group, quick=False) for group in GROUPS_HERE}
    assert {group: len(found) for group, found in asked.items()} == COUNTS
    names = [case.name for found in asked.values() for case in found]
    assert len(set(names)) == len(names)


COUNTS = {"motions": 452, "planar": 200, "gaits": 376, "optima": 129, "averages": 105}


def case_named(group: str, name: str) -> Case:
    (found,) = [case for case in cases(group, quick=False) if case.name == name]
    return found


CHEAP = [
    ("gaits", "crawls: smooth 0"),
    ("gaits", "crawls: corners 5"),
    ("gaits", "extreme crawls: waves 9"),
    ("gaits", "designs: impossible 0"),
    ("gaits", "certificates: plain, one link 0"),
    ("optima", "optima: forward 0"),
    ("optima", "optima: back 0"),
    ("optima", "optima: effort 0"),
    ("averages", "averages: smooth, order 2 0"),
    ("averages", "averages: friction, order 1 0"),
    ("averages", "averages: friction, order 2 0"),
    *(
        pytest.param("gaits", name, marks=pytest.mark.slow)
        for name in ("one link: mass ratios 0", "designs: impossible 1")
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("group", "name"), CHEAP)
def test_other_routes_agree(group: str, name: str):
    verdict = case_named(group, name).judge()
    assert verdict.verdict == "right", verdict.reason


class Off:
    """Something of which one number is told wrong."""

    def __init__(self, true: object, **wrong: object) -> None:
        self._true = true
        self.__dict__ |= wrong

    def __getattr__(self, name: str):
        return getattr(self._true, name)


def off(name: str, factor: float):
    """Make a function that tells one number of its answer too large."""

    def wrap(asked):
        def wrong(*given, **options):
            true = asked(*given, **options)
            return Off(true, **{name: getattr(true, name) * factor})

        return wrong

    return wrap


@pytest.mark.parametrize(
    ("module", "name", "asked", "number", "factor", "told"),
    [
        (gaits, "crawls: waves 0", "crawl", "speed", 1 + 1e-6, "speed"),
        (gaits, "one link: plain 0", "design", "speed", 1 + 1e-6, "speed"),
        (gaits, "certificates: plain, one link 0", "certify", "bound", 0.5, "known motion"),
        (gaits, "certificates: plain, one link 0", "certify", "bound", 2.0, "bound of rates"),
        (optima, "optima: forward 0", "optimise_switching_times", "objective", 1 + 1e-6, "time"),
        (optima, "optima: effort 0", "optimise", "objective", 1 - 1e-2, "less"),
        (averages, "averages: smooth, order 1 0", "average", "ode", 1 + 1e-6, "averaged"),
        (averages, "averages: friction, order 2 0", "average", "ode", 1 + 1e-2, "second order"),
    ],
)
def test_a_wrong_answer_is_seen(
    module, name: str, asked: str, number: str, factor: float, told: str, monkeypatch
):
    case = case_named(module.__name__.rpartition(".")[2], name)
    monkeypatch.setattr(module, asked, off(number, factor)(getattr(module, asked)))
    verdict = case.judge()
    assert verdict.verdict == "wrong"
    assert told in verdict.reason


def test_a_design_that_breaks_a_limit_is_seen(monkeypatch: pytest.MonkeyPatch):
    true = gaits.design

    def hasty(worm, limits, *more, **options):
        return true(worm, limits.vary(rate=1.01 * limits.rate), *more, **options)

    monkeypatch.setattr(gaits, "design", hasty)
    verdict = case_named("gaits", "one link: plain 1").judge()
    assert verdict.verdict == "wrong"


def test_the_bound_of_rates_is_that_of_theory():
    """Ceilings over the rate for a resting masses of n + 1, in fractions."""
    for links, known in {1: [1 / 2], 2: [1, 1 / 3], 3: [3 / 2, 2 / 3, 1 / 4]}.items():
        rate = np.full(links, 2.0)
        found = [most_speed(rate, rate, a) / 2.0 for a in range(1, links + 1)]
        assert found == pytest.approx(known, rel=1e-9)


def test_the_route_of_crawls_knows_the_fast_gait():
    """Sine pulses of three masses: speed 4 e l0 / T, loads in closed form."""
    other = Crawling(fast_gait(1.0), np.ones(3), 1.0, 20.0)
    assert other.rests
    assert other.advance == pytest.approx(1.2, rel=1e-12)
    least, most = other.extremes(other.load_on)
    assert (least[0], most[0]) == pytest.approx((6.704136, 113.595024), abs=1e-5)
    speed, doubt = other.stepped
    assert abs(speed - 1.2) <= doubt < 1e-5


def test_one_link_is_as_fast_as_theory_says():
    """Speeds up to 1, a 20, load 5: half a period at 1 less what both ends of a stroke cost."""
    asked = gaits.Asked(1, (1.0, 1.0), 5.0, 1.0, 0.6, 1.0, 20.0)
    assert asked.together == pytest.approx(0.425, rel=1e-12)
    assert asked.one_cycle
