"""`wormopt stress`: its matrix, its judge, a quick cut of it."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from wormopt import cli
from wormopt.bench import stress as module
from wormopt.bench.cells import cells, jumping_gait
from wormopt.bench.stress import Verdict, judge, stress, summary, table
from wormopt.errors import SolveError


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
    simulate = module.simulate

    def wrong(*given, **options):
        motion = simulate(*given, **options)
        return replace(motion, states=motion.states * (1 + 1e-7))

    monkeypatch.setattr(module, "simulate", wrong)
    verdict = judge(cell)
    assert verdict.verdict == "wrong"
    assert "times what is allowed" in verdict.reason


def refusing(code: str, partial: object):
    def refuse(*_given, **_options):
        raise SolveError("no", "never", partial, code)

    return refuse


def crashing(*_given, **_options):
    raise ZeroDivisionError("oh")


@pytest.mark.parametrize(
    ("simulate", "verdict", "reason"),
    [
        (refusing("stiff", object()), "refused", "stiff"),
        (refusing("", object()), "wrong", "refused without code"),
        (refusing("stiff", None), "wrong", "refused without code"),
        (crashing, "wrong", "ZeroDivisionError: oh"),
    ],
)
def test_refusals_need_a_reason_and_crashes_are_wrong(
    simulate, verdict: str, reason: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "simulate", simulate)
    found = judge(cell_named("chain of 1, sine, exact F 1:2, c 10"))
    assert found.verdict == verdict
    assert reason in found.reason


def test_a_second_route_that_fails_leaves_the_cell_undecided(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "second_route", crashing)
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
    def stopped(**_options) -> Iterator[Verdict]:
        yield from VERDICTS[:3]
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "stress", stopped)
    assert cli.main(["stress", "--json"]) == 130
    found = json.loads(capsys.readouterr().out)
    assert (found["cells"], found["complete"], found["passed"]) == (3, False, False)


@pytest.mark.parametrize(("verdicts", "code"), [(VERDICTS, 0), (VERDICTS[-3:], 3)])
def test_the_exit_code_tells_whether_it_passed(
    verdicts: list[Verdict], code: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "stress", lambda **_: iter(verdicts))
    assert cli.main(["stress"]) == code


@pytest.mark.slow
def test_a_quick_cut_has_nothing_wrong():
    found = summary(list(stress(quick=True, report=lambda *_: None)))
    assert found["wrong"] == 0
    assert found["passed"], found["not_right"]
